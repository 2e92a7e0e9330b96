"""The margin step: a pose that inspects the same targets and stands as far from every limit as it can.

A search ends where the probability is highest, often on a limit, and a limit may be missed when the camera is a little
elsewhere. So the planned pose moves to where the least *share* of room is largest (`planner.request.shares`), as long
as no probability falls by more than is given up. The least share has kinks; its soft minimum

    -τ log Σ exp(-share / τ)

is climbed instead. Corners and separations even jump, when a line comes into view; a pose counts only if lines show
from poses three standard deviations away, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.camera.pose import moved, world_to_cam
from planner.request.request import Request
from planner.request.shares import FULL, probability_share, rooms, shares
from planner.setting.evolution import Schedule, evolve, triangular_factor

if TYPE_CHECKING:
    from planner.effort.poses import Centring

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeastShare:
    """The condition of a pose that leaves the least of its room.

    Attributes
    ----------
    condition : str
        Name of its margin, or "probability".
    share : float
        What is left of its room, see `planner.request.shares`.
    """

    condition: str
    share: float


def centred(request: Request, cam2world: Array, effort: Centring, seed: int) -> Array:
    """Move a pose away from its limits.

    Parameters
    ----------
    request : Request
        What is asked of the targets that the pose inspects, and of no others.
    cam2world : array (4, 4)
        The planned pose.
    effort : Centring
        How long to search, and what may be given up. No probability falls below the required one.
    seed : int
        Seed of the search: the same arguments give the same pose.

    Returns
    -------
    array (4, 4)
        The pose; the planned one if none with a larger least share was found.
    """
    step = _MarginStep(request, np.array(cam2world, dtype=np.float64), effort)
    before = step.least_share(step.start[None])
    if before is None or effort.give_up <= 0.0:
        return step.start
    move = np.zeros(6)
    rng = np.random.default_rng([seed, effort.generations])
    # in a corner of several limits only short moves are feasible
    schedule = Schedule(effort.population, effort.generations, effort.patience, tried=effort.tried)
    for size in effort.steps:
        move, _ = evolve(
            step.value, move, size, rng, schedule, lambda moves: step.is_steady(step.poses(moves))
        )
    if not move.any():
        return step.start
    pose = step.poses(move[None])
    after = step.least_share(pose)
    improved = after is not None and after.share > before.share
    return np.asarray(pose[0]) if improved else step.start


def least_share(request: Request, cam2world: Array) -> LeastShare | None:
    """Return the condition of a pose (4, 4) that leaves least; None if it breaks one."""
    from planner.effort.poses import Centring

    pose = np.array(cam2world, dtype=np.float64)
    return _MarginStep(request, pose, Centring(give_up=1.0)).least_share(pose[None])


class _MarginStep:
    """The shares of poses around a planned one."""

    def __init__(self, request: Request, start: Array, effort: Centring) -> None:
        self.start = start
        self._request = request
        self._constraints = request.constraints
        self._effort = effort
        need = request.requirements
        self._rooms = rooms(
            request.camera, request.space.workspace, need.to_dict(), need.focus_reserve.on_axis_mm
        )
        constraints = self._constraints
        self._distance = math.dist(start[:3, 3], constraints.sphere_centre) or 1.0
        self._first = [
            name
            for name in constraints.constraint_names
            if name not in constraints.shows and name != "visibility"
        ]
        self._floor = np.maximum(request.probability, self._sure(start[None])[0] - effort.give_up)
        self._outline = _hull_points(request)
        self._around = self._displaced()

    def poses(self, moves: Array) -> Array:
        """Return the poses (n, 4, 4) after moves (n, 6)."""
        return moved(self.start, moves, self._distance)

    def value(self, moves: Array) -> Array:
        """Return the soft minimum of the shares of moves (n, 6), less what the outline costs; else -1 or less."""
        poses = self.poses(moves)
        values, found = self._shares(poses)
        feasible = np.flatnonzero(np.isfinite(found).all(axis=1) & (found >= 0.0).all(axis=1))
        if feasible.size:
            soft = [_soft_minimum(row, self._effort.softness) for row in found[feasible].tolist()]
            values[feasible] = np.array(soft) - self._effort.outline * self._cut_off(
                poses[feasible]
            )
        return values

    def least_share(self, pose: Array) -> LeastShare | None:
        """Return the condition of a pose (1, 4, 4) that leaves the least of its room; None if it breaks one."""
        _, found = self._shares(pose)
        if not (np.isfinite(found).all() and (found >= 0.0).all()):
            return None
        k = int(np.argmin(found[0]))
        return LeastShare(self._names[k], float(found[0, k]))

    def _shares(self, poses: Array) -> tuple[Array, Array]:
        """Return how badly poses fail (n,), and their shares (n, s); nan where an earlier condition failed.

        Cheap conditions come first, and the costly ones see only what is left.
        """
        constraints = self._constraints
        margins = constraints.margins(poses, self._first)
        self._names = [
            *shares(dict.fromkeys(margins, 0.0), self._rooms),
            "probability",
            *(name for name in constraints.shows if name in self._rooms),
        ]
        broken = np.zeros(len(poses))
        for name, margin in margins.items():
            missed = np.maximum(-margin.min(axis=1), 0.0)
            broken += np.minimum(missed / constraints.scale(name), FULL)
        values = -2.0 - broken
        found = np.full((len(poses), len(self._names)), np.nan)
        left = np.flatnonzero(broken == 0.0)
        if left.size:
            seen = constraints.margins(poses[left], ["visibility"])["visibility"].min(axis=1) > 0.0
            values[left] = -1.5
            left = left[seen]
        if left.size:
            sure = self._sure(poses[left])
            lacking = np.maximum(self._floor - sure, 0.0).max(axis=1)
            enough = lacking == 0.0
            values[left] = -1.0 - lacking / 4.0
            left = left[enough]
            probable = probability_share(sure[enough].min(axis=1), self._request.probability)
        if not left.size:
            return values, found
        last = constraints.margins(poses[left], constraints.shows)
        own = {name: margin[left] for name, margin in margins.items()}
        room = {**shares(own, self._rooms), "probability": probable[:, None]}
        room.update(shares(last, self._rooms))
        for column, name in enumerate(self._names):
            found[left, column] = room[name].min(axis=1)
        values[left] = -1.0
        return values, found

    def _sure(self, poses: Array) -> Array:
        """Return P (n, k) times the probability of being in focus."""
        return np.asarray(
            self._request.objective.probability(poses) * self._constraints.focus_probability(poses)
        )

    def is_steady(self, poses: Array) -> NDArray[np.bool_]:
        """Return from which poses (n, 4, 4) all lines show after all displacements, too; a robot must reach them."""
        constraints = self._constraints
        reached = constraints.is_reached(poses)
        if not constraints.shows or not reached.any():
            return reached
        displaced = (poses[:, None] @ self._around).reshape(-1, 4, 4)
        shown = constraints.image.show_all(displaced).reshape(len(poses), -1).all(axis=1)
        return np.asarray(shown & reached)

    def _displaced(self) -> Array:
        """Return displacements (12, 4, 4) of three standard deviations: along the columns of a root, both ways."""
        factor = triangular_factor(self._request.pose_uncertainty.covariance)
        moves = np.ascontiguousarray(self._effort.sigmas * factor.T)
        return moved(np.eye(4), np.concatenate([moves, -moves]), 1.0)

    def _cut_off(self, poses: Array) -> Array:
        """Return which share (n,) of the part's outline is outside the picture; 0 where it cannot all be in it."""
        local = world_to_cam(self._outline, poses)
        depth = local[..., 2]
        left, top, right, bottom = self._request.camera.field().inner
        x = local[..., 0] / np.where(depth > 0, depth, np.nan)
        y = local[..., 1] / np.where(depth > 0, depth, np.nan)
        inside = (x >= left) & (x <= right) & (y >= top) & (y <= bottom)
        diagonal = float(np.linalg.norm(np.ptp(self._outline, axis=0)))
        fits = diagonal <= depth.mean(axis=1) * min(right - left, bottom - top)
        return np.where(fits, 1.0 - inside.mean(axis=1), 0.0)


def _soft_minimum(shares_left: list[float], tau: float) -> float:
    """Return -τ log Σ exp(-share / τ), with the same last digits on every machine."""
    least = min(shares_left)
    return least - tau * math.log(
        math.fsum(math.exp(-(share - least) / tau) for share in shares_left)
    )


def _hull_points(request: Request) -> Array:
    """Return the vertices of the part's convex hull (m, 3), mm."""
    from scipy.spatial import ConvexHull

    points = np.asarray(request.space.solid.vertices, dtype=np.float64)
    return np.asarray(points[ConvexHull(points).vertices])
