"""How far a straight move in joints stays free, proven at single configurations.

Two bodies that are d apart and must keep m cannot come too near before one has moved by d - m as seen
from the other. Only the joints between them do that, each by its turn times its lever: the distance
of the farthest point of the moving body from the joint's axis.
"""

from __future__ import annotations

import numpy as np

from planner.robot.branches import Chain
from planner.robot.collisions import Arm, PairGroup


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
        self._segments = np.array([body.segment for body in arm.bodies])
        self._centres = np.array(arm.centres)
        corners = [body.hull.corners for body in arm.bodies]
        self._radii = np.array(
            [
                np.sqrt(((points - centre) ** 2).sum(axis=1)).max()
                for points, centre in zip(corners, arm.centres, strict=True)
            ]
        )
        n_joints = len(chain.steps)
        # joint k turns a body of segment s if k < s
        self._turned = np.arange(n_joints)[:, None] < self._segments[None, :]
        self._levers = np.where(self._turned, static_levers(chain, arm), 0.0)
        pairs = group.pairs
        self._moving = np.array([second if both else first for first, second, both in pairs], int)
        fixed = [self._segments[first] if both else 0 for first, _, both in pairs]
        between = np.arange(n_joints)[:, None] >= np.array(fixed, int)[None, :]
        self._between = between & self._turned[:, self._moving]

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
        frames : array (n, 7, 4, 4)
            The frames of the joints.
        turn : array (6,)
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
        group = self._group
        motions = self._motions(frames, np.abs(turn), reach) + others_mm
        required = kept * group.required
        with np.errstate(divide="ignore", invalid="ignore"):
            # pairs that do not move against each other are as near as they were
            bounds = np.where(motions > 0, (group.bounds(frames) - required) / motions, np.inf)
        result = np.minimum(bounds.min(axis=1, initial=np.inf), reach)
        for row in np.flatnonzero(result < reach):
            result[row] = self._exact(
                frames[row], bounds[row], required, motions[row], float(reach[row])
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
        for column in np.argsort(bounds, kind="stable"):
            if bounds[column] >= best:
                break
            gap = self._group.distance(int(column), frames)
            # bodies that touch are too near, even if they need keep no distance
            share = (gap - required[column]) / motions[column] if gap > 0 else -1.0
            best = min(best, share)
            if best <= 0:
                break
        return best

    def _motions(self, frames: np.ndarray, turn: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Return how far (n, p) the bodies of each pair move against each other, per whole turn."""
        origins = frames[:, 1:, None, :3, 3]
        axes = frames[:, 1:, None, :3, 2]
        own = frames[:, self._segments]
        centres = np.einsum("nbij,bj->nbi", own[:, :, :3, :3], self._centres) + own[:, :, :3, 3]
        apart = centres[:, None] - origins
        along = (apart * axes).sum(axis=-1, keepdims=True)
        now = np.sqrt(((apart - along * axes) ** 2).sum(axis=-1)) + self._radii
        # joints behind an axis carry the body away from it, or towards it
        steps = turn[:, None] * self._levers
        behind = np.cumsum(steps[::-1], axis=0)[::-1] - steps
        levers = np.minimum(self._levers, now + reach[:, None, None] * behind)
        moved = turn[:, None] * levers
        return np.asarray((moved[:, :, self._moving] * self._between).sum(axis=1))


def static_levers(chain: Chain, arm: Arm) -> np.ndarray:
    """Return the largest distance (6, b) of a point of each body from each axis before it, mm.

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
                rest = lengths[joint + 2 : body.segment].sum()
                levers[joint, number] = radial[joint + 1] + rest + size
    return levers
