"""Where the links are, and how they move with the joints.

Notation: F_k is the frame of joint k with its axis along z. F_0 is the base, F_k = F_{k-1} · A_k · Rz(q_k), and the tip
is F_6 · T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.robot.transforms import compose, to_axis
from planner.robot.urdf import N_JOINTS, UrdfArm


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
