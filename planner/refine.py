"""Local refinement of a feasible pose in pose space, by sequential quadratic programming.

The pose moves by x (6,): a translation along the camera's axes and a rotation vector about them, both in units that
change the view by about the same amount. Objective and constraints are smooth inside one convex cell of the covering
domains, whose half-spaces stand in for visibility; all derivatives come from one batch of 12 neighbouring poses.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from planner.constraints import Constraints
from planner.objective import Objective
from planner.pose import moved

_STEP = 1e-4
_BACK_OFF = 1e-9
_LARGEST_MOVE = 0.5
# of all inequalities of one kind so many, the nearest to being broken, guide the way: the solver's time grows with them
_MOST_SLACKS = 24
_SMOOTH = ("resolution_mm", "focus_mm", "field_of_view_px", "field_of_view_mm", "workspace_mm", "reach", "clearance_mm")


class _Neighbourhood:
    """Fitness and slacks around a pose, with central differences, evaluated once per point."""

    def __init__(self, cam2world, half_spaces, objective: Objective, constraints: Constraints):
        self.start, self.objective, self.constraints = cam2world, objective, constraints
        self.half_spaces = half_spaces
        self.distance = float(np.linalg.norm(cam2world[:3, 3] - constraints.sphere_center)) or 1.0
        self.names = [name for name in _SMOOTH if name in constraints.constraint_names]
        self.nfev = 0
        self._kept: dict[str, np.ndarray] = {}
        self._x: np.ndarray | None = None

    def poses(self, moves: np.ndarray) -> np.ndarray:
        """Return the poses (n, 4, 4) after moves (n, 6)."""
        return moved(self.start, moves, self.distance)

    def at(self, x: np.ndarray):
        """Return (fitness, gradient (6,), slacks (m,), their Jacobian (m, 6)) at a move x (6,)."""
        if self._x is None or not np.array_equal(x, self._x):
            moves = x + np.vstack([np.zeros(6), _STEP * np.eye(6), -_STEP * np.eye(6)])
            poses = self.poses(moves)
            fitness, slacks = self.objective.fitness(poses), self._slacks(moves, poses)
            self.nfev += len(poses)
            self._x = x.copy()
            self._values = (
                fitness[0],
                (fitness[1:7] - fitness[7:]) / (2 * _STEP),
                slacks[0],
                (slacks[1:7] - slacks[7:]).T / (2 * _STEP),
            )
        return self._values

    def _slacks(self, moves: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return all smooth slacks of poses (n, 4, 4) in units of their scale, and of the moves' limits; (n, m)."""
        slacks = self.constraints.slacks(poses, self.names)
        columns = [
            self._nearest(name, value.reshape(len(poses), -1) / self.constraints.scale(name))
            for name, value in slacks.items()
        ]
        norms = np.linalg.norm(self.half_spaces[:, :3], axis=1)
        heights = poses[:, :3, 3] @ self.half_spaces[:, :3].T + self.half_spaces[:, 3]
        inside = -(heights + self.constraints.requirements.visibility_radius_mm * norms) / self._cell_scale
        return np.hstack([*columns, inside, _LARGEST_MOVE - moves, _LARGEST_MOVE + moves]) - _BACK_OFF

    def _nearest(self, name: str, slacks: np.ndarray) -> np.ndarray:
        """Return the columns of slacks (n, m) that were smallest when this was first asked."""
        if name not in self._kept:
            self._kept[name] = np.argsort(slacks[0], kind="stable")[:_MOST_SLACKS]
        return slacks[:, self._kept[name]]

    @property
    def _cell_scale(self) -> np.ndarray:
        norms = np.linalg.norm(self.half_spaces[:, :3], axis=1)
        return np.where(norms > 0, norms * self.distance, 1.0)


def refine(
    cam2world: np.ndarray,
    half_spaces: np.ndarray,
    objective: Objective,
    constraints: Constraints,
    max_iterations: int = 60,
) -> tuple[np.ndarray, float, int]:
    """Improve a feasible pose locally.

    Parameters
    ----------
    cam2world : array (4, 4)
        A feasible pose.
    half_spaces : array (s, 4)
        Rows (a, b) with a·x + b <= 0: the convex cell of the covering domains that holds the pose.
    objective, constraints : Objective, Constraints
        What is maximised, and what must hold.
    max_iterations : int
        Cap on iterations.

    Returns
    -------
    cam2world : array (4, 4)
        The best feasible pose found, never worse than the given one.
    fitness : float
        Its fitness.
    nfev : int
        Poses evaluated.
    """
    near = _Neighbourhood(cam2world, half_spaces, objective, constraints)
    result = minimize(
        lambda x: -near.at(x)[0],
        np.zeros(6),
        jac=lambda x: -near.at(x)[1],
        constraints={"type": "ineq", "fun": lambda x: near.at(x)[2], "jac": lambda x: near.at(x)[3]},
        method="SLSQP",
        options={"maxiter": max_iterations, "ftol": 1e-7},
    )
    # the end point may break a constraint by rounding or where it is not smooth: step back along the way until it holds
    poses = near.poses(np.linspace(0.0, 1.0, 41)[:, None] * result.x)
    poses = np.concatenate([cam2world[None], poses[1:][constraints.feasible(poses[1:])]])
    fitness = objective.fitness(poses)
    best = int(np.argmax(fitness))
    return poses[best], float(fitness[best]), near.nfev + len(poses)
