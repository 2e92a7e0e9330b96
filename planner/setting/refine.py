"""Local refinement of a pose in pose space, by sequential quadratic programming.

The pose moves by x (6,): a translation along the camera's axes and a rotation vector about them, both in units that
change the view by about the same amount. Objective and constraints are smooth inside one convex cell of the covering
domains, whose half-spaces stand in for visibility; all derivatives come from one batch of 12 neighbouring poses.

The method needs no feasible pose to begin with, and of the many constraints few matter anywhere. So the costly one, the
clearance, is left out far from the part, and put in if the pose found breaks it.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from planner.camera.pose import moved
from planner.effort.effort import NORMAL
from planner.effort.poses import Climbing
from planner.request.constraints import Constraints
from planner.request.objective import Objective

_SMOOTH = (
    "resolution_mm",
    "focus_mm",
    "field_of_view_px",
    "field_of_view_mm",
    "workspace_mm",
    "reach",
    "clearance_mm",
)


class _Neighbourhood:
    """Fitness and slacks around a pose, with central differences, evaluated once per point."""

    def __init__(
        self,
        cam2world: np.ndarray,
        half_spaces: np.ndarray,
        objective: Objective,
        constraints: Constraints,
        climbing: Climbing,
    ) -> None:
        self._climbing = climbing
        step = climbing.step * np.eye(6)
        self._around = np.vstack([np.zeros(6), step, -step])
        self.start = cam2world
        self.objective = objective
        self.constraints = constraints
        self.distance = float(np.linalg.norm(cam2world[:3, 3] - constraints.sphere_centre)) or 1.0
        norms = np.linalg.norm(half_spaces[:, :3], axis=1)
        self._normals = half_spaces[:, :3]
        self._scales = np.where(norms > 0, norms * self.distance, 1.0)
        self._offsets = half_spaces[:, 3] + constraints.requirements.visibility_radius_mm * norms
        self.names = [name for name in _SMOOTH if name in constraints.constraint_names]
        self._units = {name: constraints.scale(name) for name in self.names}
        self.nfev = 0
        self._values: tuple[float, np.ndarray, np.ndarray, np.ndarray]
        self._kept: dict[str, np.ndarray] = {}
        self._x: np.ndarray | None = None

    def without(self, name: str) -> None:
        """Leave a constraint out."""
        self.names = [other for other in self.names if other != name]

    def poses(self, moves: np.ndarray) -> np.ndarray:
        """Return the poses (n, 4, 4) after moves (n, 6)."""
        return moved(self.start, moves, self.distance)

    def at(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Return (fitness, gradient (6,), slacks (m,), their Jacobian (m, 6)) at a move x (6,)."""
        if self._x is None or (x != self._x).any():
            moves = x + self._around
            poses = self.poses(moves)
            fitness = self.objective.fitness(poses)
            slacks = self._slacks(moves, poses)
            self.nfev += len(poses)
            self._x = x.copy()
            self._values = (
                fitness[0],
                (fitness[1:7] - fitness[7:]) / (2 * self._climbing.step),
                slacks[0],
                (slacks[1:7] - slacks[7:]).T / (2 * self._climbing.step),
            )
        return self._values

    def _slacks(self, moves: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return all smooth slacks of poses (n, 4, 4) in units of their scale, and of the moves' limits; (n, m)."""
        columns = [
            self._nearest(name, value.reshape(len(poses), -1)) / self._units[name]
            for name, value in self.constraints.slacks(poses, self.names).items()
        ]
        inside = -(poses[:, :3, 3] @ self._normals.T + self._offsets) / self._scales
        slacks = (
            np.hstack(
                [
                    *columns,
                    inside,
                    self._climbing.largest_move - moves,
                    self._climbing.largest_move + moves,
                ]
            )
            - self._climbing.back_off
        )
        return np.minimum(slacks, self._climbing.never_broken)

    def _nearest(self, name: str, slacks: np.ndarray) -> np.ndarray:
        """Return the columns of slacks (n, m) that were smallest when this was first asked."""
        if slacks.shape[1] <= self._climbing.most_slacks:
            return slacks
        if name not in self._kept:
            self._kept[name] = np.argsort(slacks[0], kind="stable")[: self._climbing.most_slacks]
        return slacks[:, self._kept[name]]

    def climb(self, max_iterations: int) -> np.ndarray:
        """Return the move (6,) to which the optimiser came."""
        result = minimize(
            lambda x: -self.at(x)[0],
            np.zeros(6),
            jac=lambda x: -self.at(x)[1],
            constraints={
                "type": "ineq",
                "fun": lambda x: self.at(x)[2],
                "jac": lambda x: self.at(x)[3],
            },
            method="SLSQP",
            options={"maxiter": max_iterations, "ftol": self._climbing.tolerance},
        )
        return result.x if np.isfinite(result.x).all() else np.zeros(6)


def approach(
    cam2world: np.ndarray,
    half_spaces: np.ndarray,
    objective: Objective,
    constraints: Constraints,
    iterations: int,
    climbing: Climbing = NORMAL.search.climbing,
) -> tuple[np.ndarray, float, int]:
    """Take a few steps from a pose, feasible or not, towards the nearest local optimum.

    Parameters
    ----------
    cam2world, half_spaces, objective, constraints
        As `refine`.
    iterations : int
        How many steps.
    climbing : Climbing
        How large they are.

    Returns
    -------
    cam2world : array (4, 4)
        Where the steps lead, feasible or nearly so.
    merit : float
        Its fitness, less the largest violation in units of its scale times the highest fitness there can be.
    nfev : int
        Poses evaluated.
    """
    near = _Neighbourhood(cam2world, half_spaces, objective, constraints, climbing)
    near.without("clearance_mm")
    x = near.climb(iterations)
    fitness, _, slacks, _ = near.at(x)
    return (
        near.poses(x[None])[0],
        float(fitness + objective.highest * min(slacks.min(), 0.0)),
        near.nfev,
    )


def refine(
    cam2world: np.ndarray,
    half_spaces: np.ndarray,
    objective: Objective,
    constraints: Constraints,
    max_iterations: int = 60,
    climbing: Climbing = NORMAL.search.climbing,
) -> tuple[np.ndarray, float, int]:
    """Improve a pose locally.

    Parameters
    ----------
    cam2world : array (4, 4)
        A pose, feasible or not.
    half_spaces : array (s, 4)
        Rows (a, b) with a·x + b <= 0: the convex cell of the covering domains that holds the pose.
    objective, constraints : Objective, Constraints
        What is maximised, and what must hold.
    max_iterations : int
        Cap on iterations.
    climbing : Climbing
        How the pose climbs.

    Returns
    -------
    cam2world : array (4, 4)
        The best feasible pose found, never worse than the given one; the given one if none is feasible.
    fitness : float
        Its fitness; −inf if none is feasible.
    nfev : int
        Poses evaluated.
    """
    near = _Neighbourhood(cam2world, half_spaces, objective, constraints, climbing)
    evaluated = 0
    if _clearance(constraints, cam2world) > constraints.requirements.stand_off_mm:
        far = _Neighbourhood(cam2world, half_spaces, objective, constraints, climbing)
        far.without("clearance_mm")
        x = far.climb(max_iterations)
        if _clearance(constraints, far.poses(x[None])[0]) >= 0:
            return _best_of_the_way(far, x)
        evaluated = far.nfev
    pose, fitness, nfev = _best_of_the_way(near, near.climb(max_iterations))
    return pose, fitness, nfev + evaluated


def _clearance(constraints: Constraints, cam2world: np.ndarray) -> float:
    return float(constraints.slacks(cam2world[None], ["clearance_mm"])["clearance_mm"].min())


def _best_of_the_way(near: _Neighbourhood, x: np.ndarray) -> tuple[np.ndarray, float, int]:
    """Return the best feasible pose between start and end of a move (6,), its fitness and the poses evaluated.

    The end may break a constraint by rounding or where it is not smooth; only then are those before it looked at.
    """
    shares = np.array([0.0, 1.0])
    mask = near.constraints.feasible(near.poses(shares[:, None] * x))
    if not mask[1]:
        shares = np.linspace(0.0, 1.0, 41)[:-1]
        mask = np.concatenate(
            [mask[:1], near.constraints.feasible(near.poses(shares[1:, None] * x))]
        )
    poses = near.poses(shares[mask, None] * x)
    if not len(poses):
        return near.start, -np.inf, near.nfev
    fitness = near.objective.fitness(poses)
    best = int(np.argmax(fitness))
    return poses[best], float(fitness[best]), near.nfev + len(poses)
