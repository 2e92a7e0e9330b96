"""Distances between the arm, the camera and what stands around them.

Every body of the arm is a convex hull, covered by spheres. Spheres bound all distances of many configurations at once;
fcl is asked for the pairs that they leave open.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import RLock
from typing import Any, NamedTuple

import numpy as np

from ground.decorators import njit
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import (
    Body,
    Box,
    Hull,
    Standing,
    StandingBoxes,
    Turntable,
    geometry_of,
    grown,
    hull_of,
    mesh_of,
    transform_of,
)
from planner.robotcell.branches import Chain, needed
from planner.robotcell.urdf import carry, compose, invert


@dataclass(frozen=True, eq=False)
class Moving:
    """A body of the arm or of the camera.

    Attributes
    ----------
    name : str
        Its link, or ``camera``.
    segment : int
        Number of the joint frame F_k it is fixed to; 0 is the base.
    hull : Hull
        The body in that frame.
    is_held : bool
        Whether it is no link, but what the hand carries.
    """

    name: str
    segment: int
    hull: Hull
    is_held: bool = False


@dataclass(frozen=True, order=True)
class Closeness:
    """Two bodies and their distance.

    Attributes
    ----------
    mm : float
        Distance; 0 if they touch.
    first, second : str
        Their names; empty if there are no two bodies.
    """

    mm: float
    first: str
    second: str


class Arm:
    """The moving bodies, and which of them may touch each other.

    Parameters
    ----------
    bodies : sequence of Moving
        By their segments.
    hand_segment : int
        The segment that carries the camera: the last one.
    """

    def __init__(self, bodies: Sequence[Moving], hand_segment: int) -> None:
        fcl = needed("fcl")
        self.hand_segment = hand_segment
        self.bodies = tuple(bodies)
        # bodies of fcl are moved before they are compared, which only one thread may do at a time
        self.lock = RLock()
        self.near_by_mount: dict[tuple[int, int], float] = {}
        """Pairs of a link and what the hand carries that the mount leaves so little, mm: they may only not touch."""
        self._grown: dict[tuple[int, float], Any] = {}
        self._frames: dict[tuple[int, float], np.ndarray] = {}
        self.placed = [fcl.CollisionObject(geometry_of(body.hull)) for body in bodies]
        self.centres = [body.hull.corners.mean(axis=0) for body in bodies]
        segments = [body.segment for body in bodies]
        self.own_pairs = [
            (a, b) for b in range(len(bodies)) for a in range(b) if _may_touch(bodies[a], bodies[b])
        ]
        self.moving = [i for i, segment in enumerate(segments) if segment > 0]
        self.hand = [i for i, segment in enumerate(segments) if segment == hand_segment]
        self.spheres = [body.hull.centres for body in bodies]
        self.radii = np.concatenate([body.hull.radii for body in bodies])
        counts = [len(body.hull.radii) for body in bodies]
        self.starts = np.concatenate([[0], np.cumsum(counts)])

    def keeps_clearance(self, first: int, second: int) -> bool:
        """Return whether two of the bodies must keep the clearance, not only not touch."""
        is_held = self.bodies[first].is_held or self.bodies[second].is_held
        return is_held and (first, second) not in self.near_by_mount

    def sphere_centres(self, frames: np.ndarray, which: Sequence[int]) -> np.ndarray:
        """Return the centres (n, s, 3) of the spheres of bodies, for frames (n, k + 1, 4, 4)."""
        placed = [carry(frames[:, self.bodies[i].segment], self.spheres[i]) for i in which]
        return np.concatenate(placed, axis=1)

    def sphere_radii(self, which: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Return the radii (s,) of the spheres of bodies, and where each body's begin."""
        radii = [self.bodies[i].hull.radii for i in which]
        starts = np.cumsum([0, *(len(group) for group in radii[:-1])])
        return np.concatenate(radii), starts

    def place(self, number: int, frames: np.ndarray, grown_mm: float = 0.0) -> Any:
        """Return the body of fcl, moved to where it is in one configuration's frames (k + 1, 4, 4).

        The array must not be written to later: the same array means the same frames.
        """
        if grown_mm == 0:
            placed = self.placed[number]
        elif (number, grown_mm) in self._grown:
            placed = self._grown[number, grown_mm]
        else:
            outer = geometry_of(grown(self.bodies[number].hull, grown_mm))
            placed = self._grown.setdefault(
                (number, grown_mm), needed("fcl").CollisionObject(outer)
            )
        # pairs of one configuration share bodies
        if self._frames.get((number, grown_mm)) is not frames:
            placed.setTransform(transform_of(frames[self.bodies[number].segment]))
            self._frames[number, grown_mm] = frames
        return placed


# pairs of spheres whose gaps are computed together
_SPHERE_PAIRS_AT_ONCE = 20_000


def _may_touch(a: Moving, b: Moving) -> bool:
    """Return whether two bodies can come closer: neighbours in the chain touch always."""
    return abs(a.segment - b.segment) >= (1 if a.is_held or b.is_held else 2)


class _SpherePairs(NamedTuple):
    """The pairs of spheres of pairs of an arm's bodies, those of a pair of bodies one after the other.

    Attributes
    ----------
    first, second : array (s,)
        Numbers of the spheres.
    radii : array (s,)
        Sums of their radii, mm.
    starts : array (p,)
        Where those of each pair of bodies begin.
    """

    first: np.ndarray
    second: np.ndarray
    radii: np.ndarray
    starts: np.ndarray

    @classmethod
    def of(cls, arm: Arm, pairs: Sequence[tuple[int, int]]) -> _SpherePairs:
        """Return those of pairs of the numbers of bodies."""
        grids = [
            np.indices((arm.starts[a + 1] - arm.starts[a], arm.starts[b + 1] - arm.starts[b]))
            + np.array([arm.starts[a], arm.starts[b]])[:, None, None]
            for a, b in pairs
        ]
        first, second = np.concatenate([grid.reshape(2, -1) for grid in grids], axis=1)
        sizes = [grid[0].size for grid in grids]
        starts = np.concatenate([[0], np.cumsum(sizes[:-1])]).astype(int)
        return cls(first, second, arm.radii[first] + arm.radii[second], starts)

    def least_gaps(self, centres: np.ndarray) -> np.ndarray:
        """Return the least gap (n, p) between spheres of each pair, for centres (n, k, 3) of all of them, mm."""
        apart = centres[:, self.first]
        apart -= centres[:, self.second]
        gaps = np.sqrt((apart**2).sum(axis=-1))
        gaps -= self.radii
        return np.asarray(np.minimum.reduceat(gaps, self.starts, axis=1))


class Surroundings:
    """The arm among bodies that stand still.

    Parameters
    ----------
    arm : Arm
        The arm with the camera.
    standing : sequence of Standing
        Obstacles and the part.
    clearance_mm : float
        Smallest distance to keep, except between links of the arm, and what is mounted nearer to a link: these may
        only not touch, since where they are is known.
    left_out : iterable of (int, int)
        Pairs of the arm's bodies that are not looked at.
    """

    def __init__(
        self,
        arm: Arm,
        standing: Sequence[Standing],
        clearance_mm: float,
        left_out: Iterable[tuple[int, int]] = (),
    ) -> None:
        dropped = set(left_out)
        pairs = [pair for pair in arm.own_pairs if pair not in dropped]
        behind_hand = [i for i in arm.moving if arm.bodies[i].segment != arm.hand_segment]
        self.hand = PairGroup(arm, standing, arm.hand, [], clearance_mm)
        self.rest = PairGroup(arm, standing, behind_hand, pairs, clearance_mm)
        self.all = PairGroup(arm, standing, arm.moving, pairs, clearance_mm)


class PairGroup:
    """Pairs of bodies that are looked at together.

    Parameters
    ----------
    arm : Arm
        The arm with the camera.
    standing : sequence of Standing
        What stands still.
    moving : sequence of int
        Bodies of the arm that are compared with it.
    own : sequence of (int, int)
        Pairs of the arm's own bodies.
    clearance_mm : float
        See `Surroundings`.
    """

    def __init__(
        self,
        arm: Arm,
        standing: Sequence[Standing],
        moving: Sequence[int],
        own: Sequence[tuple[int, int]],
        clearance_mm: float,
    ) -> None:
        self._arm = arm
        self._standing = tuple(standing)
        self._moving = list(moving)
        self._arm_pairs = list(own)
        self._clearance_mm = clearance_mm
        self._pairs = [(i, j, False) for j in range(len(standing)) for i in moving]
        self._pairs += [(a, b, True) for a, b in own]
        self.required = np.array(
            [
                clearance_mm if not both or arm.keeps_clearance(first, second) else 0.0
                for first, second, both in self._pairs
            ]
        )

    @property
    def pairs(self) -> list[tuple[int, int, bool]]:
        """The pairs: a body of the arm, and a body that stands still or, if the third is true, one of the arm."""
        return self._pairs

    @property
    def arm(self) -> Arm:
        """The arm with the camera."""
        return self._arm

    @property
    def standing(self) -> tuple[Standing, ...]:
        """What stands still."""
        return self._standing

    def names(self, column: int) -> tuple[str, str]:
        """Return the names of a pair by its number."""
        first, second, both = self._pairs[column]
        other = self._arm.bodies[second].name if both else self._standing[second].name
        return self._arm.bodies[first].name, other

    def bounds(self, frames: np.ndarray) -> np.ndarray:
        """Return lower bounds (n, p) of the distances of all pairs, for frames (n, k + 1, 4, 4)."""
        if not self._arm_pairs:
            moving = self._arm.sphere_centres(frames, self._moving) if self._moving else frames[:0]
            return self._standing_bounds(moving, len(frames))
        centres = self._arm.sphere_centres(frames, range(len(self._arm.bodies)))
        standing = self._standing_bounds(centres[:, self._moving_spheres], len(frames))
        return np.concatenate([standing, self._own_bounds(centres)], axis=1)

    def _standing_bounds(self, centres: np.ndarray, count: int) -> np.ndarray:
        """Return those of the pairs with what stands still, for centres (n, s, 3) of the moving bodies' spheres."""
        if not self._moving or not self._standing:
            return np.empty((count, 0))
        radii, starts = self._moving_radii
        nearest = self.boxes.distance_bounds(centres) - radii
        bounds = np.minimum.reduceat(nearest, starts, axis=2)
        return bounds.reshape(count, len(self._standing) * len(self._moving))

    def _own_bounds(self, centres: np.ndarray) -> np.ndarray:
        """Return those of the arm's own pairs, for centres (n, s, 3) of all its spheres."""
        spheres = self._own_spheres
        # all pairs at once, of as many configurations as stay in the cache
        at_once = max(1, _SPHERE_PAIRS_AT_ONCE // len(spheres.first))
        bounds = [
            spheres.least_gaps(centres[row : row + at_once])
            for row in range(0, len(centres), at_once)
        ]
        return np.concatenate(bounds) if bounds else np.empty((0, len(self._arm_pairs)))

    @cached_property
    def _moving_spheres(self) -> np.ndarray:
        starts = self._arm.starts
        groups = [np.arange(starts[i], starts[i + 1]) for i in self._moving]
        return np.concatenate(groups) if groups else np.empty(0, dtype=int)

    @cached_property
    def _moving_radii(self) -> tuple[np.ndarray, np.ndarray]:
        return self._arm.sphere_radii(self._moving)

    @cached_property
    def boxes(self) -> StandingBoxes:
        """The boxes about what stands still."""
        return StandingBoxes.of(self._standing)

    @cached_property
    def _own_spheres(self) -> _SpherePairs:
        return _SpherePairs.of(self._arm, self._arm_pairs)

    def open_rows(self, bounds: np.ndarray) -> np.ndarray:
        """Return in which rows (n,) of bounds (n, p) a pair is left that may be too near."""
        return np.asarray(self._may_be_near(bounds).any(axis=1))

    def _may_be_near(self, bounds: np.ndarray) -> np.ndarray:
        return np.asarray((bounds < self.required) | (bounds <= 0))

    def blocker(self, frames: np.ndarray, bounds: np.ndarray) -> int:
        """Return the number of a pair that is too near in one configuration's frames (k + 1, 4, 4), or -1."""
        columns = np.flatnonzero(self._may_be_near(bounds))
        for column in columns[np.argsort(bounds[columns], kind="stable")]:
            if self._is_near(int(column), frames):
                return int(column)
        return -1

    def _is_near(self, column: int, frames: np.ndarray) -> bool:
        """Return whether a pair touches or is nearer than required."""
        with self._arm.lock:
            return self._looks_near(column, frames)

    def _looks_near(self, column: int, frames: np.ndarray) -> bool:
        number, other, both = self._pairs[column]
        required = float(self.required[column])
        if not both and not isinstance(self._standing[other].shape, Hull):
            fcl = needed("fcl")
            body = self._standing[other]
            # distances to meshes take long, and most bodies are farther than required
            outer = self._arm.place(number, frames, self._clearance_mm)
            if not fcl.collide(outer, body.placed):
                segment = frames[self._arm.bodies[number].segment]
                return body.holds(carry(segment, self._arm.centres[number][None])[0])
        mm = self.distance(column, frames)
        return mm <= 0 or mm < required

    def closest(
        self, frames: np.ndarray, bounds: np.ndarray, required: np.ndarray, enough: float
    ) -> tuple[float, int]:
        """Return a lower bound of what the pairs have left over a distance, and the closest pair.

        Parameters
        ----------
        frames, bounds : array (k + 1, 4, 4), (p,)
            One configuration and its bounds.
        required : array (p,)
            Distances to keep, mm.
        enough : float
            From here on bounds suffice; below the result is exact, and -inf if a pair touches.
        """
        best = np.inf
        pair = -1
        slack = bounds - required
        for column in np.argsort(slack, kind="stable"):
            if slack[column] >= min(best, enough):
                break
            mm = self.distance(int(column), frames)
            exact = mm - float(required[column]) if mm > 0 else -np.inf
            if exact < best:
                best = exact
                pair = int(column)
        else:
            return best, pair
        return min(best, float(slack[column])), pair

    def distance(self, column: int, frames: np.ndarray) -> float:
        """Return the distance of a pair in one configuration's frames (k + 1, 4, 4), mm; 0 if it touches."""
        with self._arm.lock:
            return self._distance(column, frames)

    def _distance(self, column: int, frames: np.ndarray) -> float:
        fcl = needed("fcl")
        number, other, both = self._pairs[column]
        first = self._arm.place(number, frames)
        if both:
            return max(0.0, float(fcl.distance(first, self._arm.place(other, frames))))
        body = self._standing[other]
        if not isinstance(body.shape, Hull):
            if fcl.collide(first, body.placed):
                return 0.0
            segment = frames[self._arm.bodies[number].segment]
            if body.holds(carry(segment, self._arm.centres[number][None])[0]):
                return 0.0
        return max(0.0, float(fcl.distance(first, body.placed)))


def bodies_of(
    robot: Robot, cam2flange: np.ndarray, camera: Sequence[Body], light: Sequence[Body] = ()
) -> list[Moving]:
    """Return the links of an arm, and behind them camera and light, given in the camera's frame."""
    bodies = [
        Moving(name, segment, hull)
        for segment, (name, hulls) in enumerate(zip(robot.segment_names, robot.hulls, strict=True))
        for hull in hulls
    ]
    in_hand = compose(robot.chain.tip, cam2flange)
    for body in camera:
        points = body.corners() if isinstance(body, Box) else mesh_of(body, "camera_body")[0]
        bodies.append(
            Moving("camera", robot.n_joints, hull_of(carry(in_hand, points), "camera_body"), True)
        )
    for body in light:
        points = body.corners() if isinstance(body, Box) else mesh_of(body, "light")[0]
        bodies.append(
            Moving("light", robot.n_joints, hull_of(carry(in_hand, points), "light"), True)
        )
    return bodies


def farthest_points(chain: Chain, arm: Arm) -> np.ndarray:
    """Return how far from each joint's axis (k,) a point of the arm can be, at most: lengths of links add up; mm."""
    offsets = np.sqrt((chain.steps[:, :3, 3] ** 2).sum(axis=1))
    n_joints = len(chain.steps)
    farthest = np.zeros(n_joints + 1)
    for body in arm.bodies:
        size = float(np.sqrt((body.hull.corners**2).sum(axis=1)).max())
        farthest[body.segment] = max(farthest[body.segment], size)
    levers = np.zeros(n_joints)
    for joint in range(n_joints):
        lengths = np.concatenate([[0.0], np.cumsum(offsets[joint + 1 :])])
        levers[joint] = (lengths + farthest[joint + 1 :]).max()
    return levers


# How far a straight move in joints stays free, proven at single configurations.
#
# Two bodies that are d apart and must keep m cannot come too near before one has moved by d - m
# as seen from the other. Only the joints between them do that, each by its turn times its lever:
# the distance of the farthest point of the moving body from the joint's axis.


class Advance:
    """The pairs of bodies of an arm, and how fast each may approach.

    Parameters
    ----------
    chain : Chain
        Where the joints are.
    arm : Arm
        The moving bodies.
    group : PairGroup
        The pairs that are looked at.
    """

    def __init__(self, chain: Chain, arm: Arm, group: PairGroup) -> None:
        self._group = group
        segments = np.array([body.segment for body in arm.bodies])
        n_joints = len(chain.steps)
        # joint k turns a body of segment s if k < s
        turned = np.arange(n_joints)[:, None] < segments[None, :]
        self._levers = np.where(turned, static_levers(chain, arm), 0.0)
        pairs = group.pairs
        moving = np.array([second if both else first for first, second, both in pairs], int)
        fixed = [segments[first] if both else 0 for first, _, both in pairs]
        between = np.arange(n_joints)[:, None] >= np.array(fixed, int)[None, :]
        self._spheres = _Spheres.of(arm)
        self._boxes = group.boxes
        self._pairs = _Pairs(
            np.array([first for first, _, _ in pairs], int),
            np.array([second for _, second, _ in pairs], int),
            np.array([both for _, _, both in pairs], bool),
            moving,
            between & turned[:, moving],
        )

    def shares(
        self,
        frames: np.ndarray,
        turn: np.ndarray,
        reach: np.ndarray,
        kept: float,
        others_mm: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Return which share of a turn is free to both sides of configurations.

        Parameters
        ----------
        frames : array (n, k + 1, 4, 4)
            The frames of the joints.
        turn : array (k,)
            The move, rad.
        reach : array (n,)
            Shares of it beyond which nothing need be known.
        kept : float
            Share of the clearance that pairs must keep.
        others_mm : array (p,) or float
            How far the other body of each pair moves on the whole turn, at most.

        Returns
        -------
        array (n,)
            At most `reach`. Not positive if the configuration itself is not free.
        """
        bounds, motions, result = self.approaches(frames, turn, reach, kept, others_mm)
        required = kept * self._group.required
        for row in (result < reach).nonzero()[0].tolist():
            result[row] = self._exact(
                frames[row], bounds[row], required, motions[row], float(reach[row])
            )
        return result

    def approaches(
        self,
        frames: np.ndarray,
        turn: np.ndarray,
        reach: np.ndarray,
        kept: float,
        others_mm: np.ndarray | float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the shares by spheres and the motions, mm, of pairs (n, p), and the least share (n,); see `shares`."""
        required = kept * self._group.required
        steps = np.abs(turn)[:, None] * self._levers
        # joints behind an axis carry the body away from it, or towards it
        behind = np.cumsum(steps[::-1], axis=0)[::-1] - steps
        others = np.empty(len(required))
        others[:] = others_mm
        result: tuple[np.ndarray, np.ndarray, np.ndarray] = _approaches(
            np.ascontiguousarray(frames),
            np.ascontiguousarray(reach, dtype=np.float64),
            self._spheres,
            self._boxes,
            self._pairs,
            _Turning(np.abs(turn), self._levers, behind, required, others),
        )
        return result

    def _exact(
        self,
        frames: np.ndarray,
        bounds: np.ndarray,
        required: np.ndarray,
        motions: np.ndarray,
        reach: float,
    ) -> float:
        best = reach
        (near,) = (bounds < reach).nonzero()
        for column in near[bounds[near].argsort(kind="stable")].tolist():
            if bounds[column] >= best:
                break
            gap = self._group.distance(column, frames)
            # bodies that touch are too near, even if they need keep no distance
            share = (gap - required[column]) / motions[column] if gap > 0 else -1.0
            best = min(best, share)
            if best <= 0:
                break
        return best


class _Spheres(NamedTuple):
    """The spheres of an arm's bodies, those of a body one after the other, in the frames of their segments.

    Attributes
    ----------
    segments : array (b,)
        The segment of each body.
    starts : array (b + 1,)
        Where the spheres of each body begin.
    centres, radii : array (s, 3), (s,)
        Of the spheres, mm.
    middles, sizes : array (b, 3), (b,)
        Centre and radius of one sphere around each body, mm.
    """

    segments: np.ndarray
    starts: np.ndarray
    centres: np.ndarray
    radii: np.ndarray
    middles: np.ndarray
    sizes: np.ndarray

    @classmethod
    def of(cls, arm: Arm) -> _Spheres:
        """Return those of an arm."""
        sizes = [
            np.sqrt(((body.hull.corners - centre) ** 2).sum(axis=1)).max()
            for body, centre in zip(arm.bodies, arm.centres, strict=True)
        ]
        segments = np.array([body.segment for body in arm.bodies])
        starts = np.array(arm.starts, dtype=np.int64)
        centres = np.concatenate(arm.spheres)
        return cls(segments, starts, centres, arm.radii, np.array(arm.centres), np.array(sizes))


class _Pairs(NamedTuple):
    """Pairs of bodies.

    Attributes
    ----------
    first, second : array (p,)
        A body of the arm, and one of the arm or one that stands still.
    is_own : array of bool (p,)
        Whether the second one is of the arm.
    moving : array (p,)
        The body of the arm that moves as seen from the other one.
    between : array of bool (k, p)
        Which joints move it.
    """

    first: np.ndarray
    second: np.ndarray
    is_own: np.ndarray
    moving: np.ndarray
    between: np.ndarray


class _Turning(NamedTuple):
    """A straight move.

    Attributes
    ----------
    turn : array (k,)
        By how much each joint turns, rad.
    levers : array (k, b)
        The largest distance of a point of each body from each joint's axis in any configuration, mm.
    behind : array (k, b)
        By how much the joints behind change that distance on the whole turn, at most, mm.
    required, others : array (p,)
        The distances that pairs must keep, and how far the other body of each moves, mm.
    """

    turn: np.ndarray
    levers: np.ndarray
    behind: np.ndarray
    required: np.ndarray
    others: np.ndarray


@njit(error_model="numpy")
def _approaches(
    frames: np.ndarray,
    reach: np.ndarray,
    spheres: _Spheres,
    boxes: StandingBoxes,
    pairs: _Pairs,
    turning: _Turning,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which share of a turn keeps each pair apart from frames (n, k + 1, 4, 4), by spheres (n, p), at least.

    Then the motions (n, p): how far a pair moves against each other on the whole turn, at most, mm, where no more than
    a share of the turn, ``reach`` (n,), is driven. Then the least share of all pairs, and of ``reach`` (n,).
    """
    n_pairs = len(pairs.first)
    shares = np.empty((len(frames), n_pairs))
    together = reach.copy()
    motions = np.empty((len(frames), n_pairs))
    placed = np.empty_like(spheres.centres)
    moved = np.empty(turning.levers.shape)
    for row in range(len(frames)):
        for body in range(len(spheres.segments)):
            frame = frames[row, spheres.segments[body]]
            for k in range(spheres.starts[body], spheres.starts[body + 1]):
                _carry(frame, spheres.centres[k], placed[k])
        _motions_of(frames[row], reach[row], spheres, turning, moved)
        for pair in range(n_pairs):
            if pairs.is_own[pair]:
                gap = _least_gap(placed, spheres, pairs.first[pair], pairs.second[pair])
            else:
                gap = _least_outside(placed, spheres, boxes, pairs.first[pair], pairs.second[pair])
            total = 0.0
            for joint in range(len(turning.turn)):
                if pairs.between[joint, pair]:
                    total += moved[joint, pairs.moving[pair]]
            total += turning.others[pair]
            motions[row, pair] = total
            # pairs that do not move against each other are as near as they were
            shares[row, pair] = (gap - turning.required[pair]) / total if total > 0 else np.inf
            together[row] = min(together[row], shares[row, pair])
    return shares, motions, together


@njit(error_model="numpy")
def _carry(frame: np.ndarray, point: np.ndarray, moved: np.ndarray) -> None:
    """Write a point (3,) moved by a pose (4, 4)."""
    for i in range(3):
        turned = frame[i, 0] * point[0] + frame[i, 1] * point[1] + frame[i, 2] * point[2]
        moved[i] = turned + frame[i, 3]


@njit(error_model="numpy")
def _least_gap(placed: np.ndarray, spheres: _Spheres, first: int, second: int) -> float:
    """Return the least gap between the spheres of two bodies, for their centres (s, 3), mm."""
    nearest = np.inf
    for i in range(spheres.starts[first], spheres.starts[first + 1]):
        for j in range(spheres.starts[second], spheres.starts[second + 1]):
            x = placed[i, 0] - placed[j, 0]
            y = placed[i, 1] - placed[j, 1]
            z = placed[i, 2] - placed[j, 2]
            gap = np.sqrt(x * x + y * y + z * z) - (spheres.radii[i] + spheres.radii[j])
            nearest = min(nearest, gap)
    return nearest


@njit(error_model="numpy")
def _least_outside(
    placed: np.ndarray, spheres: _Spheres, boxes: StandingBoxes, body: int, box: int
) -> float:
    """Return the least gap between the spheres of a body, at (s, 3), and the box about one that stands still, mm."""
    nearest = np.inf
    turn = boxes.turns[box]
    for k in range(spheres.starts[body], spheres.starts[body + 1]):
        square = 0.0
        for i in range(3):
            at = turn[i, 0] * placed[k, 0] + turn[i, 1] * placed[k, 1] + turn[i, 2] * placed[k, 2]
            at += boxes.shifts[box, i]
            outside = max(max(boxes.lows[box, i] - at, at - boxes.highs[box, i]), 0.0)
            square += outside * outside
        nearest = min(nearest, np.sqrt(square) - spheres.radii[k])
    return nearest


@njit(error_model="numpy")
def _motions_of(
    frames: np.ndarray, reach: float, spheres: _Spheres, turning: _Turning, moved: np.ndarray
) -> None:
    """Write how far each joint moves each body on the whole turn (k, b), at most, mm, in frames (k + 1, 4, 4)."""
    middle = np.empty(3)
    for body in range(len(spheres.segments)):
        _carry(frames[spheres.segments[body]], spheres.middles[body], middle)
        for joint in range(len(turning.turn)):
            frame = frames[joint + 1]
            x = middle[0] - frame[0, 3]
            y = middle[1] - frame[1, 3]
            z = middle[2] - frame[2, 3]
            along = x * frame[0, 2] + y * frame[1, 2] + z * frame[2, 2]
            x -= along * frame[0, 2]
            y -= along * frame[1, 2]
            z -= along * frame[2, 2]
            now = np.sqrt(x * x + y * y + z * z) + spheres.sizes[body]
            lever = min(turning.levers[joint, body], now + reach * turning.behind[joint, body])
            moved[joint, body] = turning.turn[joint] * lever


def static_levers(chain: Chain, arm: Arm) -> np.ndarray:
    """Return the largest distance (k, b) of a point of each body from each axis before it, mm.

    Parameters
    ----------
    chain : Chain
        Where the joints are.
    arm : Arm
        The moving bodies.
    """
    offsets = chain.steps[:, :3, 3]
    lengths = np.sqrt((offsets**2).sum(axis=1))
    radial = np.sqrt((offsets[:, :2] ** 2).sum(axis=1))
    levers = np.zeros((len(chain.steps), len(arm.bodies)))
    for number, body in enumerate(arm.bodies):
        points = body.hull.corners
        size = np.sqrt((points**2).sum(axis=1)).max()
        about_own_axis = np.sqrt((points[:, :2] ** 2).sum(axis=1)).max()
        for joint in range(body.segment):
            if joint == body.segment - 1:
                levers[joint, number] = about_own_axis
            else:
                # the next joint turns with this one, so its place along the axis does not matter
                between = lengths[joint + 2 : body.segment].sum()
                levers[joint, number] = radial[joint + 1] + between + size
    return levers


# How far moves stay free that turn joints and a turntable at the same time.
#
# What turns with the part is looked at from the turntable, where it stands still: there the arm
# moves. A pair comes nearer at most by what the arm moves in the base, and by what the body on
# the turntable moves: its angle times the distance of its farthest point from the axis.


class TurnedAdvance:
    """The pairs of an arm with what stands still, and with what turns.

    Parameters
    ----------
    chain : Chain
        Where the joints are.
    still : PairGroup
        The arm's own pairs, and those with what stands still.
    turning : sequence of Standing
        What turns, at the angle 0.
    table : Turntable
        The axis.
    clearance_mm : float
        Smallest distance of the arm from what turns.
    """

    def __init__(
        self,
        chain: Chain,
        still: PairGroup,
        turning: Sequence[Standing],
        table: Turntable,
        clearance_mm: float,
    ) -> None:
        arm: Arm = still.arm
        self._table = table
        group = PairGroup(arm, turning, arm.moving, [], clearance_mm)
        self._still = Advance(chain, arm, still)
        self._turned = Advance(chain, arm, group)
        radii = [table.radius_mm(carry(body.pose, body.shape.corners)) for body in turning]
        self._radii = np.array([radii[number] for _, number, _ in group.pairs])

    def shares(
        self,
        frames: np.ndarray,
        angles: np.ndarray,
        turn: np.ndarray,
        reach: np.ndarray,
        kept: float,
    ) -> np.ndarray:
        """Return which share of a turn is free to both sides, as `Advance.shares` does.

        Parameters
        ----------
        frames : array (n, k + 1, 4, 4)
            The frames of the joints in the base.
        angles : array (n,)
            Angles of the turntable, rad.
        turn : array (k + 1,)
            The move, rad; the last number is that of the turntable.
        reach : array (n,)
            Shares of it beyond which nothing need be known.
        kept : float
            Share of the clearance that pairs must keep.
        """
        first = self._still.shares(frames, turn[:-1], reach, kept)
        backs = np.array([invert(self._table.pose(float(angle))) for angle in angles])
        seen = compose(backs[:, None], frames)
        limits = np.maximum(first, 0.0)
        second = self._turned.shares(seen, turn[:-1], limits, kept, self._radii * abs(turn[-1]))
        return np.minimum(first, second)
