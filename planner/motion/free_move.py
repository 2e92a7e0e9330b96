"""Straight joint moves that are proven free: conservative advancement.

At joints q the bodies that may collide are at least d(q) apart. A turn by dq moves no point farther
than the sum of lever times abs(dq), and lets no two bodies approach each other by more. So a pose
with d(q) > m proves all poses of the line up to d(q) - m of motion to either side. The middle is
asked first, and what it leaves open is halved again.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple, Protocol

import numpy as np

MOST_POSES = 4000
"""A line that needs more poses counts as blocked."""
_LEAST_GAIN_MM = 0.02
# distances above this much more than must be kept need not be exact: spheres give them quickly
_ENOUGH_MM = 60.0


class JointSpace(Protocol):
    """What a move needs to know of a robot and what stands around it; `planner.robot.Cell` knows it."""

    @property
    def lower(self) -> np.ndarray:
        """Least joints (k,), rad."""

    @property
    def upper(self) -> np.ndarray:
        """Largest joints (k,), rad."""

    @property
    def levers_mm(self) -> np.ndarray:
        """Largest distance (k,) of any moving point from each axis, mm."""

    def distance_bound(self, joints: np.ndarray, enough_mm: float) -> np.ndarray:
        """Return lower bounds (n,) on the distances of bodies, mm, exact below ``enough_mm``."""


class MoveCheck(NamedTuple):
    """Result of a check.

    Attributes
    ----------
    free : bool
        Whether the move is proven to keep the distance.
    poses : int
        Poses whose distances were computed.
    blocked_at : float
        Where it could not be proven, as a share of the move; nan if it is free.
    """

    free: bool
    poses: int
    blocked_at: float = np.nan


def check_move(
    space: JointSpace, start: np.ndarray, end: np.ndarray, keep_mm: float = 0.0
) -> MoveCheck:
    """Prove that a straight joint move keeps a distance, or say where that fails.

    Parameters
    ----------
    space : JointSpace
        The robot and its surroundings.
    start, end : array (k,)
        Joints, rad.
    keep_mm : float
        Distance that all bodies keep, mm.

    Returns
    -------
    MoveCheck
        Free only if proven. A line that comes within 0.02 mm of ``keep_mm`` is not free.
    """
    turn = np.asarray(end) - np.asarray(start)
    motion_mm = float((space.levers_mm * np.abs(turn)).sum())
    open_parts = np.array([[0.0, 1.0]])
    asked = 0
    while len(open_parts):
        middles = open_parts.mean(axis=1)
        halves_mm = motion_mm * (open_parts[:, 1] - open_parts[:, 0]) / 2
        enough_mm = keep_mm + min(float(halves_mm.max()), _ENOUGH_MM) + _LEAST_GAIN_MM
        gaps = space.distance_bound(start + middles[:, None] * turn, enough_mm) - keep_mm
        asked += len(middles)
        blocked = gaps <= _LEAST_GAIN_MM
        if blocked.any() or asked > MOST_POSES:
            worst = int(gaps.argmin())
            return MoveCheck(False, asked, float(middles[worst]))
        open_parts = _left_open(open_parts, middles, gaps, motion_mm)
    return MoveCheck(True, asked)


def _left_open(
    parts: np.ndarray, middles: np.ndarray, gaps: np.ndarray, motion_mm: float
) -> np.ndarray:
    """Return what the distances in the middles do not prove: up to two parts of each."""
    reach = gaps / motion_mm if motion_mm > 0 else np.ones_like(gaps)
    before = np.stack([parts[:, 0], middles - reach], axis=1)
    after = np.stack([middles + reach, parts[:, 1]], axis=1)
    both = np.concatenate([before, after])
    return both[both[:, 1] > both[:, 0]]


def check_path(space: JointSpace, path: Any, keep_mm: float = 0.0) -> MoveCheck:
    """Check the straight moves between the joints (n, k) of a path, see `check_move`."""
    asked = 0
    for start, end in itertools.pairwise(path):
        found = check_move(space, start, end, keep_mm)
        asked += found.poses
        if not found.free:
            return MoveCheck(False, asked, found.blocked_at)
    return MoveCheck(True, asked)
