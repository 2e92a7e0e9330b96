"""Local refinement of a pose in pose space, by sequential quadratic programming.

The pose moves by x (6,): a translation along the camera's axes and a rotation vector about them, both in units that
change the view by about the same amount. Objective and constraints are smooth inside one convex cell of the covering
domains, whose half-spaces stand in for visibility; all derivatives come from one batch of 12 neighbouring poses.

The method needs no feasible pose to begin with, and of the many constraints few matter anywhere. So the costly one, the
clearance, is left out far from the part, and put in if the pose found breaks it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from planner.camera.pose import moved
from planner.request.constraints import Constraints
from planner.request.request import Objective
from planner.search.first_poses import PoseEncoding, ViewpointSampler

# starts differ by at least this share of the distance or of a parameter's range, or this angle
# in rad. Nearer ones would be refined to the same optimum.
_APART = 0.1
# Positions drawn for each one kept, so that those kept are spread out
_DRAWN_PER_START = 8
# largest number of ends that are refined
_FOLLOWED = 3
# the refinement follows an end that reaches this share of the best merit
_PROMISING = 0.98
# steps from a start, and from a mirrored pose, which may be far from its optimum
_STEPS = 8
_STEPS_MIRRORED = 20
# largest number of refinements of one pose, the first in its cell
_ONWARD_ROUNDS = 5
# A refinement that gains no more than this share is the last
_ONWARD_GAIN = 1e-6
# half the step of the central differences
_DIFFERENCE = 1e-4
# the solver stops at this change of the fitness, on the scale of a probability
_TOLERANCE = 1e-7
# margin kept at every inequality, because the solver accepts violations below its tolerance
_BACK_OFF = 2e-7
# largest move along each of the six directions. The cell of the pose nearly always ends sooner.
_LARGEST_MOVE = 0.5
# upper limit of every slack. A lens in focus to infinity has an infinite slack, without a
# derivative.
_NEVER_BROKEN = 1e3
# number of inequalities of one kind that the solver uses, the tightest ones. Its time grows with
# the square of their number.
_MOST_SLACKS = 24

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
    ) -> None:
        step = _DIFFERENCE * np.eye(6)
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
                (fitness[1:7] - fitness[7:]) / (2 * _DIFFERENCE),
                slacks[0],
                (slacks[1:7] - slacks[7:]).T / (2 * _DIFFERENCE),
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
                    _LARGEST_MOVE - moves,
                    _LARGEST_MOVE + moves,
                ]
            )
            - _BACK_OFF
        )
        return np.minimum(slacks, _NEVER_BROKEN)

    def _nearest(self, name: str, slacks: np.ndarray) -> np.ndarray:
        """Return the columns of slacks (n, m) that were smallest when this was first asked."""
        if slacks.shape[1] <= _MOST_SLACKS:
            return slacks
        if name not in self._kept:
            self._kept[name] = np.argsort(slacks[0], kind="stable")[:_MOST_SLACKS]
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
            options={"maxiter": max_iterations, "ftol": _TOLERANCE},
        )
        return result.x if np.isfinite(result.x).all() else np.zeros(6)


def approach(
    cam2world: np.ndarray,
    half_spaces: np.ndarray,
    objective: Objective,
    constraints: Constraints,
    iterations: int,
) -> tuple[np.ndarray, float, int]:
    """Take a few steps from a pose, feasible or not, towards the nearest local optimum.

    Parameters
    ----------
    cam2world, half_spaces, objective, constraints
        As `refine`.
    iterations : int
        How many steps.

    Returns
    -------
    cam2world : array (4, 4)
        Where the steps lead, feasible or nearly so.
    merit : float
        Its fitness, less the largest violation in units of its scale times the highest fitness there can be.
    nfev : int
        Poses evaluated.
    """
    near = _Neighbourhood(cam2world, half_spaces, objective, constraints)
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

    Returns
    -------
    cam2world : array (4, 4)
        The best feasible pose found, never worse than the given one; the given one if none is feasible.
    fitness : float
        Its fitness; −inf if none is feasible.
    nfev : int
        Poses evaluated.
    """
    near = _Neighbourhood(cam2world, half_spaces, objective, constraints)
    evaluated = 0
    if _clearance(constraints, cam2world) > constraints.requirements.stand_off_mm:
        far = _Neighbourhood(cam2world, half_spaces, objective, constraints)
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


# Local refinement from many starts: which poses to begin with, which to follow, and where to look
# again.
#
# A sum of probabilities has few local optima, but some of them hide. Between two optima with the
# view turned to either side of the entities lies the straight view, and most feasible draws are
# straight views. So there are four kinds of starts: the best of the genetic algorithm; the best
# of its first population around positions far from each other; poses drawn in the covering
# domains with the view turned anyhow, feasible or not; and, once an optimum is found, the same
# with its pan and tilt to the other side.
#
# From every start a few steps are taken (`approach`). The most promising ends that are apart are
# refined, first inside their convex cell of the covering domains and then onward as far as all
# constraints hold.


# turned views: shares of the encoded range of pan, tilt and roll
_TURN = np.array([0.5, 0.5, 1.0])
_MIRRORINGS = ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
_NO_WALLS = np.empty((0, 4))


@dataclass
class Ascent:
    """Refinement of poses with an account of the best one.

    Attributes
    ----------
    sampler, encoding, objective, constraints
        The request.
    enough : float
        Fitness at which to stop.
    cam2world, fitness : array (4, 4), float
        The best feasible pose so far.
    nfev : int
        Poses evaluated so far.
    """

    sampler: ViewpointSampler
    encoding: PoseEncoding
    objective: Objective
    constraints: Constraints
    enough: float
    cam2world: np.ndarray
    fitness: float
    nfev: int = 0

    def consider(self, poses: np.ndarray) -> None:
        """Take the best of feasible poses (m, 4, 4) if it is better."""
        if len(poses):
            values = self.objective.fitness(poses)
            self.nfev += len(poses)
            self._keep(poses[values.argmax()], float(values.max()))

    def climb(self, starts: np.ndarray) -> None:
        """Refine the most promising of the starts (m, 4, 4), feasible or not, and the best pose."""
        ends = [(self.fitness, self.cam2world)]
        for pose in starts:
            walls = self.sampler.cell_of(pose[:3, 3])
            if self.fitness < self.enough and walls is not None:
                ends.append(self._approach(pose, walls))
        for pose in self._promising(ends):
            self._follow(pose)

    def mirror(self) -> None:
        """Try the best pose with the view turned to the other side, as long as that gains."""
        found = -np.inf
        while found < self.fitness < self.enough:
            found = self.fitness
            for signs in _MIRRORINGS:
                parameters = self.encoding.parameters_of(self.cam2world[None])
                parameters[:, 3:5] *= signs
                merit, pose = self._approach(
                    self.encoding.poses(parameters)[0], _NO_WALLS, _STEPS_MIRRORED
                )
                if merit > _PROMISING * self.fitness and self._is_apart(pose, [self.cam2world]):
                    self._follow(pose)

    def _approach(
        self, pose: np.ndarray, walls: np.ndarray, steps: int = _STEPS
    ) -> tuple[float, np.ndarray]:
        pose, merit, nfev = approach(pose, walls, self.objective, self.constraints, steps)
        self.nfev += nfev
        return merit, pose

    def _promising(self, ends: list[Any]) -> list[np.ndarray]:
        """Return the best few poses of (merit, pose), nearly equally good and apart."""
        chosen: list[np.ndarray] = []
        ranked = sorted(ends, key=lambda end: -end[0])
        for merit, pose in ranked:
            if merit < _PROMISING * ranked[0][0] or len(chosen) == _FOLLOWED:
                break
            if self._is_apart(pose, chosen):
                chosen.append(pose)
        return chosen

    def _is_apart(self, pose: np.ndarray, others: list[Any]) -> bool:
        """Whether position or direction of view, or both, differ by a tenth from those of all other poses."""
        far = _APART * np.linalg.norm(pose[:3, 3] - self.constraints.sphere_centre)
        return all(
            np.linalg.norm(pose[:3, 3] - other[:3, 3]) > far
            or np.linalg.norm(pose[:3, 2] - other[:3, 2]) > _APART
            for other in others
        )

    def _follow(self, pose: np.ndarray) -> None:
        """Refine a pose in its cell, and then again and again without walls while it gains."""
        fitness = -np.inf
        walls = self.sampler.cell_of(pose[:3, 3])
        for _ in range(_ONWARD_ROUNDS):
            if self.fitness >= self.enough:
                return
            last = fitness
            pose, fitness, nfev = refine(
                pose,
                _NO_WALLS if walls is None else walls,
                self.objective,
                self.constraints,
            )
            self.nfev += nfev
            self._keep(pose, fitness)
            if walls is None and fitness <= last * (1.0 + _ONWARD_GAIN):
                return
            walls = None

    def _keep(self, pose: np.ndarray, fitness: float) -> None:
        if fitness > self.fitness:
            self.cam2world = pose
            self.fitness = fitness


def best_apart(
    bits: np.ndarray,
    fitness: np.ndarray,
    encoding: PoseEncoding,
    n: int,
) -> np.ndarray:
    """Return up to n chromosomes, best first, that are apart from each other.

    Apart means by a tenth of some parameter's range: neighbours would be refined to the same optimum.
    """
    bits = bits[np.argsort(-fitness, kind="stable")]
    places = encoding.parameters(bits) / np.where(
        encoding.high > encoding.low, encoding.high - encoding.low, 1.0
    )
    chosen: list[int] = []
    for i in range(len(bits)):
        if len(chosen) < n and np.all(
            np.abs(places[chosen] - places[i]).max(axis=1, initial=0.0) > _APART
        ):
            chosen.append(i)
    return bits[chosen]


def best_around(poses: np.ndarray, fitness: np.ndarray, n: int) -> np.ndarray:
    """Return up to n of the poses (m, 4, 4): the best of each group around positions as far apart as can be."""
    centres, group = spread(poses[:, :3, 3], n, int(fitness.argmax()))
    members = [np.flatnonzero(group == g) for g in range(len(centres))]
    return poses[[own[fitness[own].argmax()] for own in members]]


def spread(positions: np.ndarray, n: int, first: int = 0) -> tuple[list[int], np.ndarray]:
    """Choose up to n of positions (m, 3), each the farthest from those before; return them and the nearest of each."""
    centres = [first][:n]
    distance = np.linalg.norm(positions - positions[centres].sum(axis=0), axis=1)
    group = np.zeros(len(positions), dtype=int)
    while len(centres) < n and distance.max() > 0:
        centres.append(int(distance.argmax()))
        to_new = np.linalg.norm(positions - positions[centres[-1]], axis=1)
        group[to_new < distance] = len(centres) - 1
        distance = np.minimum(distance, to_new)
    return centres, group


def turned_views(
    n: int,
    sampler: ViewpointSampler,
    encoding: PoseEncoding,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draw up to n poses (m, 4, 4), feasible or not, in the covering domains.

    Positions are far apart; pan and tilt are at most half of what they may be, roll is anything.
    """
    positions = sampler.sample(_DRAWN_PER_START * n, rng)
    if n == 0 or not len(positions):
        return np.empty((0, 4, 4))
    positions = positions[spread(positions, n)[0]]
    turns = rng.uniform(encoding.low[3:], encoding.high[3:], (len(positions), 3)) * _TURN
    return encoding.poses(np.hstack([positions, turns]))
