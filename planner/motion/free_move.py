"""Straight joint moves that are proven free: conservative advancement.

At any joints of the line, the distances of all bodies prove that a share of the whole move to both
sides is free too: no body can move far enough to touch another. The middle is asked first, and what
it leaves open is halved again. Steps would miss thin bodies.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple, Protocol

import numpy as np

MOST_POSES = 4000
"""A line that needs more poses counts as blocked."""
_LEAST_SHARE = 2e-5


class JointSpace(Protocol):
    """What a move needs to know of a robot and what stands around it."""

    @property
    def lower(self) -> np.ndarray:
        """Least joints (k,), rad."""

    @property
    def upper(self) -> np.ndarray:
        """Largest joints (k,), rad."""

    def free_shares(self, joints: np.ndarray, turn: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Return which share of a turn (k,) is free to both sides of joints (n, k): at most reach (n,)."""


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


def check_move(space: JointSpace, start: np.ndarray, end: np.ndarray) -> MoveCheck:
    """Prove that a straight joint move is free, or say where that fails.

    Parameters
    ----------
    space : JointSpace
        The robot and its surroundings.
    start, end : array (k,)
        Joints, rad.

    Returns
    -------
    MoveCheck
        Free only if proven. A line on which less than 0.00002 of it is free around some joints
        counts as blocked.
    """
    turn = np.asarray(end) - np.asarray(start)
    open_parts = np.array([[0.0, 1.0]])
    asked = 0
    while len(open_parts):
        middles = open_parts.mean(axis=1)
        halves = (open_parts[:, 1] - open_parts[:, 0]) / 2
        shares = space.free_shares(start + middles[:, None] * turn, turn, halves)
        asked += len(middles)
        blocked = shares < np.minimum(halves, _LEAST_SHARE)
        if blocked.any() or asked > MOST_POSES:
            return MoveCheck(False, asked, float(middles[int(shares.argmin())]))
        open_parts = _left_open(open_parts, middles, shares)
    return MoveCheck(True, asked)


def _left_open(parts: np.ndarray, middles: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return what the middles do not prove: up to two parts of each."""
    before = np.stack([parts[:, 0], middles - shares], axis=1)
    after = np.stack([middles + shares, parts[:, 1]], axis=1)
    both = np.concatenate([before, after])
    # what rounding leaves of a part is less than any share that is asked for
    return both[both[:, 1] - both[:, 0] > 1e-12]


def check_path(space: JointSpace, path: np.ndarray) -> MoveCheck:
    """Check the straight moves between the joints (n, k) of a path, see `check_move`."""
    asked = 0
    for start, end in itertools.pairwise(path):
        found = check_move(space, start, end)
        asked += found.poses
        if not found.free:
            return MoveCheck(False, asked, found.blocked_at)
    return MoveCheck(True, asked)
