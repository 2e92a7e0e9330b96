"""How far moves stay free that turn joints and a turntable at the same time.

What turns with the part is looked at from the turntable, where it stands still: there the arm moves.
A pair comes nearer at most by what the arm moves in the base, and by what the body on the turntable
moves: its angle times the distance of its farthest point from the axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.robot.branches import Chain
from planner.robot.collisions import Arm, PairGroup
from planner.robot.moves.advance import Advance
from planner.robot.standing import Standing
from planner.robot.transforms import carry, compose, invert
from planner.robot.turning.turntable import Turntable


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
        frames : array (n, 7, 4, 4)
            The frames of the joints in the base.
        angles : array (n,)
            Angles of the turntable, rad.
        turn : array (7,)
            The move, rad; the last number is that of the turntable.
        reach : array (n,)
            Shares of it beyond which nothing need be known.
        kept : float
            Share of the clearance that pairs must keep.
        """
        first = self._still.shares(frames, turn[:-1], reach, kept)
        backs = np.array([invert(self._table.pose(float(angle))) for angle in angles])
        seen = compose(backs[:, None], frames)
        left = np.maximum(first, 0.0)
        second = self._turned.shares(seen, turn[:-1], left, kept, self._radii * abs(turn[-1]))
        return np.minimum(first, second)
