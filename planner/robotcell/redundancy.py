"""All joints for a pose of an arm of seven joints: curves of them, of which points stand for all.

With seven joints, one of them more than a pose needs, a pose that is reached leaves the arm a motion: the elbow
swivels while the hand stands still. The curve of these joints is looked at on a grid of one angle:

* of the swivel, where axes 1 to 3 meet in a shoulder and axes 5 to 7 in a wrist, as of KUKA's LBR iiwa. The elbow is
  then on a circle about the line from shoulder to wrist, and each angle leaves eight solutions in closed form
  (Shimizu, Kakuya, Yoon, Kitagaki and Kosuge, 2008);
* of the last or the first joint otherwise, if the other six have a closed form, as of Franka's arms;
* of no one else: Newton's method starts from the drawn joints that lead nearest to the pose, and goes on along
  the curve in both directions.

Where limits leave nothing of the grid, its best points are moved along the curve into them.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.spatial import KDTree

from planner.exceptions import RobotError
from planner.robotcell.branches import Branches, Chain, JointLimits, firsts_in_order
from planner.robotcell.urdf import compose, invert

_TURN = 2 * np.pi
_M = 1e-3
ANGLES = 24
"""So many angles of the swivel, or of a joint, are looked at in a turn."""
_POSE = 1e-6
"""Joints lead to a pose if they meet it to this, in rad and in metres."""
_SHARP = 1e-10
"""Newton's method ends at this, in rad and in metres."""
_APART = 0.15
"""Joints of one pose are told apart if an angle differs by more, rad."""
_MEETS_MM = 1e-4
"""Axes meet in a point if they miss it by no more, mm."""
_NEARLY_MEETS_MM = 25.0
"""Axes that miss a point by no more give starts for Newton's method, mm."""
_ITERATIONS = 30
_LONGEST_STEP = 0.4
"""Longest step of a joint in one iteration, rad."""
_OUTSIDE = 0.3
"""Joints beyond a limit by no more may still be moved into it, rad."""
_SLIDES = 25
_MOVED = 8
"""So many joints of a pose are moved into the limits."""
_DRAWS = 6000
_NEAREST = 16
_WALKED = 0.25
_WALKS = 12
"""Along a curve joints are kept after each step of this length, rad, and so many to each side."""
_TESTED = 24
_LEAST_REFOUND = 0.9


class _Starts(Protocol):
    """What proposes joints for poses.

    Attributes
    ----------
    is_exact : bool
        Whether the joints lead to the poses to all digits.
    """

    is_exact: bool

    def of(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 7) for poses (n, 4, 4), whatever their limits, and whose they are (m,)."""


class RedundantBranches(JointLimits):
    """The solutions of an arm of seven joints.

    Parameters
    ----------
    chain : Chain
        The arm.
    lower, upper : array (7,)
        Limits of the joints, rad.

    Raises
    ------
    RobotError
        If poses that drawn joints lead to are seldom solved.
    """

    def __init__(self, chain: Chain, lower: np.ndarray, upper: np.ndarray) -> None:
        super().__init__(lower, upper)
        self._chain = chain
        self._starts = _starts_of(chain, lower, upper)
        self._drawn: _Drawn | None = None
        draws = _draws(lower, upper, _TESTED)
        solved = len(np.unique(self.of(chain.tips(chain.frames(draws)))[1]))
        if solved < _LEAST_REFOUND * _TESTED:
            rule = "must be an arm whose joints are found from the poses they lead to"
            raise RobotError.of_rule("robot", rule, f"{solved} of {_TESTED} drawn poses")

    def of(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return points of the curves of joints that lead to poses of the tip.

        Parameters
        ----------
        tips : array (n, 4, 4)
            Poses in the base, mm.

        Returns
        -------
        q : array (m, 7)
            Joints within limits, rad, each at the turn nearest to zero that its limits allow; ordered by pose, then by
            joints.
        owner : array of int (m,)
            Number of each one's pose.
        """
        q, owner = self._starts.of(tips)
        joints, whose = self._met(q, owner, tips)
        missing = np.setdiff1d(np.arange(len(tips)), whose)
        if len(missing):
            more = self._moved_into_limits(*_of(missing, q, owner), tips)
            joints = np.concatenate([joints, more[0]])
            whose = np.concatenate([whose, more[1]])
        missing = np.setdiff1d(missing, whose)
        is_all = isinstance(self._starts, _Swivel) and self._starts.is_exact
        if len(missing) and not is_all:
            q, rows = self._from_draws(tips[missing])
            joints = np.concatenate([joints, q])
            whose = np.concatenate([whose, missing[rows]])
        return firsts_in_order(joints, whose, _APART)

    def exist(self, tips: np.ndarray) -> np.ndarray:
        """Return for which poses (n, 4, 4) there are joints, whatever their limits; (n,) bool."""
        q, owner = self._starts.of(tips)
        if not self._starts.is_exact:
            q = _to_poses(self._chain, q, tips[owner])
        met = _errors(self._chain, q, tips[owner]) <= _POSE
        return np.bincount(owner[met], minlength=len(tips)) > 0

    def _met(
        self, q: np.ndarray, owner: np.ndarray, tips: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return which joints (m, 7) are within limits and lead to their poses; starts that are not exact are moved."""
        if not self._starts.is_exact:
            near = self._beyond(q) <= _OUTSIDE
            owner = owner[near]
            q = _to_poses(self._chain, q[near], tips[owner])
        q = self.within_limits(q)
        within = np.isfinite(q).all(axis=1)
        q = q[within]
        owner = owner[within]
        met = _errors(self._chain, q, tips[owner]) <= _POSE
        return q[met], owner[met]

    def _beyond(self, q: np.ndarray) -> np.ndarray:
        """Return how far joints (m, 7) are beyond their limits, at the best turns (m,), rad; 0 within them."""
        return np.asarray(np.abs(self._to_limits(q)).max(axis=1, initial=0.0))

    def _to_limits(self, q: np.ndarray) -> np.ndarray:
        """Return the least turns (m, 7) that bring joints into their limits, rad; 0 for those within them."""
        middle = (self._lower + self._upper) / 2
        near = q - _TURN * np.round((q - middle) / _TURN)
        return np.asarray(np.clip(near, self._lower, self._upper) - near)

    def _moved_into_limits(
        self, q: np.ndarray, owner: np.ndarray, tips: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 7) that lead to their poses, those that a move along their curves brings into limits."""
        order = np.lexsort((self._beyond(q), owner))
        q = q[order]
        owner = owner[order]
        first = np.arange(len(owner)) - np.searchsorted(owner, owner) < _MOVED
        q = q[first]
        owner = owner[first]
        for _ in range(_SLIDES if len(q) else 0):
            wish = self._to_limits(q)
            along = _null_direction(self._chain, q)
            slide = (wish * along).sum(axis=1, keepdims=True) * along
            q = _to_poses(self._chain, q + _capped(2.0 * slide), tips[owner], 3)
        q = self.within_limits(_to_poses(self._chain, q, tips[owner]))
        within = np.isfinite(q).all(axis=1)
        q = q[within]
        owner = owner[within]
        met = _errors(self._chain, q, tips[owner]) <= _POSE
        return q[met], owner[met]

    def _from_draws(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 7) within limits that Newton's method finds from drawn ones, and whose they are (m,)."""
        if self._drawn is None:
            self._drawn = _Drawn(self._chain, self._lower, self._upper)
        q, owner = self._drawn.of(tips)
        q = _to_poses(self._chain, q, tips[owner])
        met = _errors(self._chain, q, tips[owner]) <= _POSE
        return self._moved_into_limits(q[met], owner[met], tips)


def _starts_of(chain: Chain, lower: np.ndarray, upper: np.ndarray) -> _Starts:
    """Return what proposes joints for an arm."""
    swivel = _Swivel(chain)
    if swivel.misses_mm <= _NEARLY_MEETS_MM:
        return swivel
    for joint in (len(chain.steps) - 1, 0):
        try:
            return _LockedJoint(chain, lower, upper, joint)
        except RobotError as error:
            if not error.parameter:
                # the extra is missing
                raise
    return _Drawn(chain, lower, upper)


def _of(rows: np.ndarray, q: np.ndarray, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the joints (m, 7) of some poses, and whose they are (m,)."""
    chosen = np.isin(owner, rows)
    return q[chosen], owner[chosen]


def _draws(lower: np.ndarray, upper: np.ndarray, count: int) -> np.ndarray:
    """Return drawn joints (n, k) within limits, a turn at most."""
    low = np.maximum(lower, -np.pi)
    high = np.maximum(np.minimum(upper, np.pi), low)
    return np.asarray(np.random.default_rng(0).uniform(low, high, (count, len(lower))))


# Shoulder, elbow circle and wrist.
#
# Notation: S is where axes 1 to 3 meet, W where axes 5 to 7 do. R_k is the rotation of A_k, see
# `planner.robotcell.branches`. The distance of S and W gives q_4. The rotation of F_3 must carry
# the line from S to W, as F_3 sees it, to where it is in the base: a turn about it is free, and is
# the swivel. Three joints with a common point give any rotation in two ways, if it can be given.


class _Swivel:
    """Joints in closed form on a grid of the swivel.

    Parameters
    ----------
    chain : Chain
        Of seven joints.

    Attributes
    ----------
    misses_mm : float
        By how much axes miss the points where they should meet, at most.
    is_exact : bool
        Whether they meet.
    """

    def __init__(self, chain: Chain) -> None:
        frames = chain.frames(np.zeros((1, len(chain.steps))))[0]
        shoulder, by_shoulder = _meeting(frames[1:4])
        wrist, by_wrist = _meeting(frames[5:8])
        self.misses_mm = max(by_shoulder, by_wrist)
        self.is_exact = self.misses_mm <= _MEETS_MM
        self._shoulder = shoulder
        self._turns = chain.steps[:, :3, :3]
        self._from_tip = invert(chain.tip)
        self._wrist_in_last = _seen_from(frames[7], wrist)
        # W from joint 4, and S, as joint 4 at zero sees them
        self._wrist_at_elbow = _seen_from(frames[4], wrist)
        self._from_shoulder = -_seen_from(frames[4], shoulder)

    def of(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 7) for poses (n, 4, 4), whatever their limits, and whose they are (m,)."""
        last = compose(tips, self._from_tip)
        across = compose(last, np.append(self._wrist_in_last, 1.0)[:, None])[:, :3, 0]
        across = across - self._shoulder
        elbows, within = self._elbows((across**2).sum(axis=1))
        owner = np.tile(np.arange(len(tips)), 2)[np.tile(within, 2)]
        elbow = elbows.T.ravel()[np.tile(within, 2)]
        owner = np.repeat(owner, ANGLES)
        elbow = np.repeat(elbow, ANGLES)
        swivel = np.tile(np.arange(ANGLES) * (_TURN / ANGLES), len(owner) // ANGLES)
        arm = self._line_in_forearm(elbow)
        upper = np.einsum("nij,njk,nlk->nil", _basis(across[owner]), about_z(swivel), _basis(arm))
        by_shoulder = _spherical(self._turns[:3], upper)
        middle = np.einsum("nij,jk,nkl->nil", upper, self._turns[3], about_z(elbow))
        hand = np.einsum("nji,njk->nik", middle, last[owner, :3, :3])
        by_wrist = _spherical(self._turns[4:], hand)
        q = np.concatenate(
            [
                np.concatenate([first, elbow[:, None], second], axis=1)
                for first in by_shoulder
                for second in by_wrist
            ]
        )
        owner = np.tile(owner, len(q) // max(len(owner), 1))
        order = np.argsort(owner, kind="stable")
        return q[order], owner[order]

    def _elbows(self, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the two angles (n, 2) of joint 4 for squared distances of S and W, and where there are any (n,)."""
        u = self._wrist_at_elbow
        c = self._from_shoulder
        height = (squares - (u**2).sum() - (c**2).sum()) / 2 - u[2] * c[2]
        return _cosine_and_sine(
            float(u[0] * c[0] + u[1] * c[1]), float(u[0] * c[1] - u[1] * c[0]), height
        )

    def _line_in_forearm(self, elbow: np.ndarray) -> np.ndarray:
        """Return the line (n, 3) from S to W in the axes of F_3."""
        seen = np.einsum("nij,j->ni", about_z(elbow), self._wrist_at_elbow) + self._from_shoulder
        return np.einsum("ij,nj->ni", self._turns[3], seen)


def about_z(angles: np.ndarray) -> np.ndarray:
    """Return the turns (n, 3, 3) about z by angles (n,)."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0] = np.sin(angles)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.0
    return turns


def _seen_from(frame: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return a point (3,) in the axes of a frame (4, 4), from its origin."""
    return np.asarray(frame[:3, :3].T @ (point - frame[:3, 3]))


def _meeting(frames: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the point (3,) nearest to the axes of frames (n, 4, 4), and how far the farthest is; inf if none."""
    axes = frames[:, :3, 2]
    points = frames[:, :3, 3]
    aside = np.eye(3) - np.einsum("ki,kj->kij", axes, axes)
    total = aside.sum(axis=0)
    if np.linalg.det(total) < _POSE:
        return points[0], np.inf
    point = np.linalg.solve(total, np.einsum("kij,kj->i", aside, points))
    gaps = np.einsum("kij,kj->ki", aside, point - points)
    return point, float(np.sqrt((gaps**2).sum(axis=1)).max())


def _basis(direction: np.ndarray) -> np.ndarray:
    """Return rotations (n, 3, 3) whose last columns are along vectors (n, 3)."""
    third = direction / np.sqrt((direction**2).sum(axis=1, keepdims=True))
    upright = np.abs(third[:, 2:]) < 1.0 - 1e-3
    side = np.where(upright, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    second = np.cross(third, side)
    second /= np.sqrt((second**2).sum(axis=1, keepdims=True))
    return np.stack([np.cross(second, third), second, third], axis=2)


def _cosine_and_sine(a: float, b: float, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two angles x (n, 2) with a cos x + b sin x = height (n,), and where there are any (n,).

    Where rounding leaves none, the nearest one is both.
    """
    size = float(np.hypot(a, b))
    share = height / max(size, 1e-300)
    half = np.arccos(np.clip(share, -1.0, 1.0))
    middle = np.arctan2(b, a)
    return np.stack([middle + half, middle - half], axis=1), np.abs(share) <= 1.0 + 1e-12


def _spherical(turns: np.ndarray, goal: np.ndarray) -> list[np.ndarray]:
    """Return the two triples of angles (n, 3) by which joints of constant turns (3, 3, 3) give rotations (n, 3, 3).

    With goal = B_1 Rz(a) B_2 Rz(b) B_3 Rz(c), the last column gives b by its height along axis 1, then a; c is left.
    Where b cannot be, it is the nearest.
    """
    first, second, third = turns
    seen = np.einsum("ji,njk->nik", first, goal)
    tip = third[:, 2]
    row = second[2]
    middles, _ = _cosine_and_sine(
        float(row[0] * tip[0] + row[1] * tip[1]),
        float(row[1] * tip[0] - row[0] * tip[1]),
        seen[:, 2, 2] - row[2] * tip[2],
    )
    triples = []
    for b in middles.T:
        turned = np.einsum("ij,njk->nik", second, about_z(b))
        at = np.einsum("nij,j->ni", turned, tip)
        a = np.arctan2(seen[:, 1, 2], seen[:, 0, 2]) - np.arctan2(at[:, 1], at[:, 0])
        before = np.einsum("nij,njk,kl->nil", about_z(a), turned, third)
        last = np.einsum("nji,njk->nik", before, seen)
        c = np.arctan2(last[:, 1, 0], last[:, 0, 0])
        triples.append(np.stack([a, b, c], axis=1))
    return triples


# One joint on a grid, the other six in closed form.


class _LockedJoint:
    """Joints of an arm whose first or last joint stands at angles of a grid.

    Parameters
    ----------
    chain : Chain
        Of seven joints.
    lower, upper : array (7,)
        Limits of the joints, rad.
    joint : int
        The first or the last one, from 0.

    Raises
    ------
    RobotError
        If the other six have no closed form.
    """

    is_exact = True

    def __init__(self, chain: Chain, lower: np.ndarray, upper: np.ndarray, joint: int) -> None:
        self._chain = chain
        self._joint = joint
        steps = np.delete(chain.steps, joint, axis=0)
        is_last = joint > 0
        tip = np.eye(4) if is_last else chain.tip
        links = chain.links[:-1] if is_last else chain.links[1:]
        everywhere = np.full(len(steps), _TURN / 2)
        self._six = Branches(Chain(steps, tip, links), -everywhere, everywhere)
        low = max(float(lower[joint]), -np.pi)
        high = min(float(upper[joint]), np.pi)
        count = max(1, int(np.ceil(ANGLES * (high - low) / _TURN)))
        self._angles = low + (np.arange(count) + 0.5) * (high - low) / count

    def of(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 7) for poses (n, 4, 4), whatever their limits, and whose they are (m,)."""
        turned = np.tile(np.eye(4), (len(self._angles), 1, 1))
        turned[:, :3, :3] = about_z(self._angles)
        moves = invert(compose(self._chain.steps[self._joint], turned))
        if self._joint:
            last = compose(tips, invert(self._chain.tip))
            poses = compose(last[:, None], moves[None])
        else:
            poses = compose(moves[None], tips[:, None])
        q, owner = self._six.of(poses.reshape(-1, 4, 4))
        angles = self._angles[owner % len(self._angles)]
        place = self._joint if self._joint else 0
        return np.insert(q, place, angles, axis=1), owner // len(self._angles)


# Drawn joints, and curves from them.


class _Drawn:
    """Joints that lead near to poses, out of many drawn ones.

    Parameters
    ----------
    chain : Chain
        The arm.
    lower, upper : array (k,)
        Limits of the joints, rad.
    """

    is_exact = False

    def __init__(self, chain: Chain, lower: np.ndarray, upper: np.ndarray) -> None:
        self._chain = chain
        self._q = _draws(lower, upper, _DRAWS)
        self._length = float(chain.reach_mm()[0])
        self._tree = KDTree(self._numbers(chain.tips(chain.frames(self._q))))

    def _numbers(self, tips: np.ndarray) -> np.ndarray:
        """Return poses (n, 4, 4) as numbers (n, 12) whose differences are about as hard to bridge."""
        turns = tips[:, :3, :3].reshape(-1, 9) / np.sqrt(8.0)
        return np.concatenate([2.0 * tips[:, :3, 3] / self._length, turns], axis=1)

    def of(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, k) for poses (n, 4, 4), and whose they are (m,)."""
        rows = self._tree.query(self._numbers(tips), k=_NEAREST)[1]
        q = _to_poses(self._chain, self._q[rows.ravel()], np.repeat(tips, _NEAREST, axis=0))
        owner = np.repeat(np.arange(len(tips)), _NEAREST)
        met = _errors(self._chain, q, tips[owner]) <= _POSE
        return self._walked(*firsts_in_order(q[met], owner[met], _APART), tips)

    def _walked(
        self, q: np.ndarray, owner: np.ndarray, tips: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, k), and others along the curves that lead to the same poses."""
        points = [q]
        for sign in (1.0, -1.0):
            here = q
            course = sign * _null_direction(self._chain, q)
            for _ in range(_WALKS):
                here = _to_poses(self._chain, here + _WALKED * course, tips[owner], 4)
                points.append(here)
                along = _null_direction(self._chain, here)
                ahead = np.where((along * course).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
                course = ahead * along
        return np.concatenate(points), np.tile(owner, len(points))


# Newton's method and motions of the elbow on the arm's own chain.


def _null_direction(chain: Chain, q: np.ndarray) -> np.ndarray:
    """Return the unit motion of joints (m, k) that leaves the pose as it is (m, k)."""
    return np.asarray(np.linalg.svd(_jacobian(chain, chain.frames(q)))[2][:, -1])


def _jacobian(chain: Chain, frames: np.ndarray) -> np.ndarray:
    """Return the Jacobian (m, 6, k) in metres and rad."""
    jacobian = chain.jacobian(frames)
    jacobian[:, :3] *= _M
    return jacobian


def _missing(chain: Chain, frames: np.ndarray, tips: np.ndarray) -> np.ndarray:
    """Return what is missing to poses (m, 6), in metres and rad."""
    reached = chain.tips(frames)
    turn = np.einsum("nij,nkj->nik", tips[:, :3, :3], reached[:, :3, :3])
    missing = np.empty((len(tips), 6))
    missing[:, :3] = _M * (tips[:, :3, 3] - reached[:, :3, 3])
    missing[:, 3] = turn[:, 2, 1] - turn[:, 1, 2]
    missing[:, 4] = turn[:, 0, 2] - turn[:, 2, 0]
    missing[:, 5] = turn[:, 1, 0] - turn[:, 0, 1]
    # twice the sine of half the angle, which grows up to half a turn
    missing[:, 3:] /= np.sqrt(np.maximum(1.0 + np.einsum("nii->n", turn), 1e-2))[:, None]
    return missing


def _to_poses(
    chain: Chain, q: np.ndarray, tips: np.ndarray, iterations: int = _ITERATIONS
) -> np.ndarray:
    """Return joints (m, k) moved by damped steps of least length towards where they lead to poses (m, 4, 4)."""
    q = q.copy()
    rows = np.arange(len(q))
    for _ in range(iterations):
        frames = chain.frames(q[rows])
        missing = _missing(chain, frames, tips[rows])
        is_open = np.abs(missing).max(axis=1, initial=0.0) > _SHARP
        rows = rows[is_open]
        if not len(rows):
            break
        missing = missing[is_open]
        jacobian = _jacobian(chain, frames[is_open])
        normal = np.einsum("nij,nkj->nik", jacobian, jacobian)
        damping = 1e-2 * (missing**2).sum(axis=1) + 1e-14
        normal[:, np.arange(6), np.arange(6)] += damping[:, None]
        weights = np.linalg.solve(normal, missing[:, :, None])[:, :, 0]
        q[rows] += _capped(np.einsum("nij,ni->nj", jacobian, weights))
    return q


def _capped(steps: np.ndarray) -> np.ndarray:
    """Return steps (m, k) shortened to the longest that one iteration takes."""
    longest = np.abs(steps).max(axis=1, initial=0.0)
    return np.asarray(steps * (_LONGEST_STEP / np.maximum(longest, _LONGEST_STEP))[:, None])


def _errors(chain: Chain, q: np.ndarray, tips: np.ndarray) -> np.ndarray:
    """Return by how much joints (m, k) miss poses (m, 4, 4), in metres and in the numbers of rotations (m,)."""
    error = np.abs(chain.tips(chain.frames(q)) - tips)
    error[:, :3, 3] *= _M
    return np.asarray(error.max(axis=(1, 2), initial=0.0))
