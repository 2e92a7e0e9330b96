"""Joints for a pose: all branches of an arm within its limits, each checked by its forward kinematics.

EAIK (Ostermeier, Külz and Althoff, 2025) solves arms whose axes intersect or are parallel in closed form, by the
subproblems of Elias and Wen. It knows no limits, and approximates where there is no solution; both are dealt with here.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from itertools import product
from typing import Any

import numpy as np

from planner.exceptions import RobotError
from planner.robot.kinematics import Chain
from planner.robot.transforms import compose, invert

_TURN = 2 * np.pi
# angles of a URDF have nine digits; EAIK looks for parallel axes to more
_NOISE = 1e-8
_POSE = 1e-6
"""A branch is one if its pose is met to this, in rad and in metres."""
_SAME = 1e-6
_M = 1e-3


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
        raise RobotError(
            "a cell needs the extra robot. Install it: pip install aspectgraph[robot]."
        ) from None


def _snapped(numbers: np.ndarray) -> np.ndarray:
    """Return numbers without the noise of the file's digits: those about 0 and 1 are 0 and 1."""
    whole = np.round(numbers)
    return np.where(np.abs(numbers - whole) < _NOISE, whole, numbers)
