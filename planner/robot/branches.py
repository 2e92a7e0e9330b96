"""Where the links are for joints, and all joints for a pose: branches within limits, each checked.

EAIK (Ostermeier, Külz and Althoff, 2025) solves arms whose axes intersect or are parallel in closed form, by the
subproblems of Elias and Wen. It knows no limits, and approximates where there is no solution; both are dealt with here.

Notation: F_k is the frame of joint k with its axis along z. F_0 is the base, F_k = F_{k-1} · A_k · Rz(q_k), and the tip
is F_6 · T.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import product
from typing import Any

import numpy as np

from aspectgraph.exceptions import how_to_install
from planner.exceptions import RobotError
from planner.robot.transforms import compose, invert, to_axis
from planner.robot.urdf import N_JOINTS, UrdfArm

_TURN = 2 * np.pi
# angles of a URDF have nine digits; EAIK looks for parallel axes to more
_NOISE = 1e-8
_POSE = 1e-6
"""A branch is one if its pose is met to this, in rad and in metres."""
_SAME = 1e-6
_M = 1e-3


@dataclass(frozen=True)
class Chain:
    """The constant poses of an arm.

    Attributes
    ----------
    steps : array (6, 4, 4)
        A_k: the frame of joint k at zero in the frame of the joint before.
    tip : array (4, 4)
        T: the tip in the frame of the last joint.
    links : array (7, 4, 4)
        The link's own frame in F_k.
    """

    steps: np.ndarray
    tip: np.ndarray
    links: np.ndarray

    @classmethod
    def of(cls, arm: UrdfArm) -> Chain:
        """Return the chain of an arm, its axes turned to z."""
        turns = [np.eye(4), *(to_axis(joint.axis) for joint in arm.joints)]
        backs = [turn.T for turn in turns]
        steps = [
            compose(compose(backs[k], joint.origin), turns[k + 1])
            for k, joint in enumerate(arm.joints)
        ]
        return cls(np.array(steps), compose(backs[-1], arm.tip), np.array(backs))

    def frames(self, q: np.ndarray) -> np.ndarray:
        """Return the frames F_0 … F_6 of joints (n, 6) in the base; (n, 7, 4, 4)."""
        frames = np.empty((len(q), N_JOINTS + 1, 4, 4))
        frames[:, 0] = np.eye(4)
        cosines = np.cos(q)[:, :, None]
        sines = np.sin(q)[:, :, None]
        for k, step in enumerate(self.steps):
            before = compose(frames[:, k], step)
            after = frames[:, k + 1]
            after[:] = before
            after[:, :, 0] = cosines[:, k] * before[:, :, 0] + sines[:, k] * before[:, :, 1]
            after[:, :, 1] = cosines[:, k] * before[:, :, 1] - sines[:, k] * before[:, :, 0]
        return frames

    def tips(self, frames: np.ndarray) -> np.ndarray:
        """Return the poses (n, 4, 4) of the tip."""
        return compose(frames[:, -1], self.tip)

    def jacobian(self, frames: np.ndarray) -> np.ndarray:
        """Return the tip's velocity per joint speed (n, 6, 6): mm and rad in the base's axes."""
        axes = frames[:, 1:, :3, 2]
        levers = self.tips(frames)[:, None, :3, 3] - frames[:, 1:, :3, 3]
        rows = np.concatenate([np.cross(axes, levers), axes], axis=2)
        return np.swapaxes(rows, 1, 2)

    def reach_mm(self) -> np.ndarray:
        """Return how far from each joint's origin the tip can be (6,): the sum of the lengths behind it."""
        offsets = np.concatenate([self.steps[1:], self.tip[None]])[:, :3, 3]
        lengths = np.sqrt((offsets**2).sum(axis=1))
        return np.cumsum(lengths[::-1])[::-1]


class Branches:
    """The solutions of an arm.

    Parameters
    ----------
    chain : Chain
        The arm.
    lower, upper : array (6,)
        Limits of the joints, rad.

    Raises
    ------
    RobotError
        The extra is missing, or EAIK knows no closed form of such an arm.
    """

    def __init__(self, chain: Chain, lower: np.ndarray, upper: np.ndarray) -> None:
        self._chain = chain
        self._lower = lower
        self._upper = upper
        # seen from the first joint, whose axis is z, however the base is turned
        self._to_first = invert(chain.steps[0])
        frames = compose(self._to_first, chain.frames(np.zeros((1, 6))))
        tip = chain.tips(frames)
        self._tip_turn = tip[0, :3, :3]
        axes = _snapped(frames[0, 1:, :3, 2])
        points = _M * np.concatenate([frames[0, 1:, :3, 3], tip[:, :3, 3]])
        offsets = np.diff(points, axis=0, prepend=np.zeros((1, 3)))
        self._solver = needed("eaik.IK_HP").HPRobot(axes, _snapped(offsets))
        if not self._solver.hasKnownDecomposition():
            rule = "must be an arm with a spherical wrist or three parallel axes"
            family = self._solver.getKinematicFamily()
            raise RobotError.of_rule("robot", rule, f"the unknown family {family}")

    def of(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return all branches of poses of the tip.

        Parameters
        ----------
        tips : array (n, 4, 4)
            Poses in the base, mm.

        Returns
        -------
        q : array (m, 6)
            Joints, rad, each at the turn nearest to zero that its limits allow; ordered by pose, then by joints.
        owner : array of int (m,)
            Number of each one's pose.
        """
        found, owner = self._solve(tips)
        q = self.within_limits(found)
        kept = np.isfinite(q).all(axis=1)
        q = q[kept]
        owner = owner[kept]
        met = self._meets(q, tips[owner])
        q = q[met]
        owner = owner[met]
        # noise in the last digits must not decide the order
        keys = np.round(q, 6)
        order = np.lexsort((*keys.T[::-1], owner))
        q = q[order]
        owner = owner[order]
        first = np.ones(len(q), dtype=bool)
        first[1:] = (owner[1:] != owner[:-1]) | (np.abs(np.diff(q, axis=0)).max(axis=1) > _SAME)
        return q[first], owner[first]

    def exist(self, tips: np.ndarray) -> np.ndarray:
        """Return for which poses (n, 4, 4) there are joints, whatever their limits; (n,) bool."""
        q, owner = self._solve(tips)
        met = self._meets(q, tips[owner])
        return np.bincount(owner[met], minlength=len(tips)) > 0

    def within_limits(self, q: np.ndarray) -> np.ndarray:
        """Return joints (m, 6) at the turns nearest to zero within the limits; NaN where there is none."""
        near = q - _TURN * np.round(q / _TURN)
        best = np.full(near.shape, np.nan)
        distance = np.full(near.shape, np.inf)
        for turn in (0.0, -_TURN, _TURN):
            moved = near + turn
            better = (moved >= self._lower) & (moved <= self._upper) & (np.abs(moved) < distance)
            best[better] = moved[better]
            distance[better] = np.abs(moved[better])
        return best

    def turns(self, q: np.ndarray) -> np.ndarray:
        """Return joints (t, 6) that differ from (6,) by full turns, within the limits, the given ones first."""
        choices = []
        for angle, low, high in zip(q, self._lower, self._upper, strict=True):
            count = int(np.ceil((high - low) / _TURN)) + 1
            others = [angle + _TURN * turn for turn in range(-count, count + 1) if turn]
            choices.append([angle, *(one for one in others if low <= one <= high)])
        return np.array(list(product(*choices)))

    def _solve(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what EAIK finds (m, 6), and whose it is (m,)."""
        wanted = compose(self._to_first, tips)
        wanted[:, :3, 3] *= _M
        wanted[:, :3, :3] = np.einsum("nij,kj->nik", wanted[:, :3, :3], self._tip_turn)
        solutions = [self._solver.IK(pose) for pose in wanted]
        exact = [
            np.asarray(one.Q, dtype=np.float64).reshape(-1, 6)[~np.asarray(one.is_LS, dtype=bool)]
            for one in solutions
        ]
        owner = np.repeat(np.arange(len(tips)), [len(q) for q in exact])
        return np.concatenate([np.empty((0, 6)), *exact]), owner

    def _meets(self, q: np.ndarray, tips: np.ndarray) -> np.ndarray:
        """Return which joints (m, 6) bring the tip to the poses (m, 4, 4)."""
        error = np.abs(self._chain.tips(self._chain.frames(q)) - tips)
        error[:, :3, 3] *= _M
        return error.max(axis=(1, 2), initial=0.0) <= _POSE


@cache
def needed(module: str) -> Any:
    """Return a module of the extra, or raise `RobotError` that says how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise RobotError(f"a cell needs the extra robot; {how_to_install('robot')}.") from None


def _snapped(numbers: np.ndarray) -> np.ndarray:
    """Return numbers without the noise of the file's digits: those about 0 and 1 are 0 and 1."""
    whole = np.round(numbers)
    return np.where(np.abs(numbers - whole) < _NOISE, whole, numbers)
