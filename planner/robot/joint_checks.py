"""Questions about joints in a fixturing: whether they are free, and how near anything is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

import numpy as np

from planner.robot.arm import Robot
from planner.robot.collisions import Closeness
from planner.robot.moves.turned_advance import TurnedAdvance
from planner.robot.pose_reach import Reacher
from planner.robot.standing import Fixturing
from planner.robot.transforms import check_rotations, compose, invert
from planner.robot.urdf import N_JOINTS

LINKS_NEAR_MM = 5.0
"""Two links of the arm are named as the closest objects only if they are nearer than this."""


class JointChecks(ABC):
    """What a `Cell` says of joints: six, or seven in a fixturing on a turntable, whose angle is the last."""

    robot: Robot
    cam2flange: np.ndarray

    @abstractmethod
    def _reacher(self, name: str, angle: float = 0.0) -> Reacher:
        """Return what knows one fixturing at an angle of its turntable."""

    @abstractmethod
    def _turned(self, name: str) -> TurnedAdvance:
        """Return what knows moves on a turntable."""

    @abstractmethod
    def _fixturing(self, name: str) -> Fixturing:
        """Return a fixturing by its name."""

    def _by_angle(
        self, q: np.ndarray, fixturing: str
    ) -> Iterator[tuple[np.ndarray, Reacher, np.ndarray]]:
        """Yield the rows of joints (n, 6) or (n, 7) at each angle, what knows it, and the robot's joints."""
        angles = q[:, N_JOINTS] if q.shape[1] > N_JOINTS else np.zeros(len(q))
        for angle in dict.fromkeys(angles.tolist()):
            rows = np.flatnonzero(angles == angle)
            yield rows, self._reacher(fixturing, angle), q[rows, :N_JOINTS]

    def part2base(self, fixturing: str, angle: float = 0.0) -> np.ndarray:
        """Return where the part is.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.
        angle : float
            Angle of its turntable, rad.

        Returns
        -------
        array, shape (4, 4)
            The part's frame in the base, mm.
        """
        one = self._fixturing(fixturing)
        return one.part2base if one.table is None else compose(one.table.pose(angle), one.part2base)

    def part_at(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return where the part is at joints.

        Parameters
        ----------
        q : array_like, shape (6,), or (7,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (4, 4)
            The part's frame in the base, mm.
        """
        return self.part2base(fixturing, float(np.sum(q[N_JOINTS:])))

    def flange(self, cam2world: np.ndarray, fixturing: str, angle: float = 0.0) -> np.ndarray:
        """Return the poses of the tip for poses of the camera.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4) or (4, 4)
            Poses of the camera in the part's frame, mm.
        fixturing : str
            Name of a fixturing.
        angle : float
            Angle of its turntable, rad.

        Returns
        -------
        array, shape (n, 4, 4) or (4, 4)
            Poses of the tip in the base, mm.
        """
        camera = compose(self.part2base(fixturing, angle), check_rotations("cam2world", cam2world))
        return compose(camera, invert(self.cam2flange))

    def cam2world(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the poses of the camera for joints.

        Parameters
        ----------
        q : array, shape (n, 6), or (n, 7) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        """
        joints = np.asarray(q, dtype=np.float64)
        camera = compose(self.robot.forward(joints[:, :N_JOINTS]), self.cam2flange)
        angles = joints[:, N_JOINTS:].sum(axis=1).tolist()
        parts = [self.part2base(fixturing, angle) for angle in angles]
        return compose(invert(np.array(parts).reshape(-1, 4, 4)), camera)

    def limits(self, fixturing: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the largest joints of moves.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (6,), or (7,) on a turntable
            Least joints, rad.
        array, shape (6,), or (7,) on a turntable
            Largest joints, rad.
        """
        table = self._fixturing(fixturing).table
        if table is None:
            return self.robot.lower, self.robot.upper
        low, high = table.range
        return np.append(self.robot.lower, low), np.append(self.robot.upper, high)

    def rates(self, fixturing: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest speeds and accelerations.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (6,), or (7,) on a turntable
            Speeds, rad/s.
        array, shape (6,), or (7,) on a turntable
            Accelerations, rad/s².
        """
        robot = self.robot
        table = self._fixturing(fixturing).table
        if table is None:
            return robot.speeds, robot.accelerations
        return (
            np.append(robot.speeds, table.speed),
            np.append(robot.accelerations, table.acceleration),
        )

    def free(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return which joints are within limits and keep the clearance.

        Parameters
        ----------
        q : array, shape (n, 6), or (n, 7) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array of bool, shape (n,)
            True where nothing is too near.
        """
        joints = np.asarray(q, dtype=np.float64)
        result = np.zeros(len(joints), dtype=bool)
        for rows, reacher, own in self._by_angle(joints, fixturing):
            result[rows] = reacher.free(own)
        return result

    def blocked_by(self, q: np.ndarray, fixturing: str) -> str:
        """Return what is wrong with joints, in words.

        Parameters
        ----------
        q : array_like, shape (6,), or (7,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        str
            Empty if they are free.
        """
        ((_, reacher, own),) = self._by_angle(np.asarray(q, dtype=np.float64)[None], fixturing)
        return reacher.blocked_by(own[0])

    def clearance(
        self, q: np.ndarray, fixturing: str, *, links_mm: float = LINKS_NEAR_MM
    ) -> Closeness:
        """Return what arm or camera is nearest to: the part, an obstacle, or a link of the arm that is very near.

        Parameters
        ----------
        q : array_like, shape (6,), or (7,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.
        links_mm : float
            Pairs of the arm's own links count only if they are nearer than this: some are near in all joints.

        Returns
        -------
        Closeness
            Names of the closest two objects and their distance, mm.
        """
        ((_, reacher, own),) = self._by_angle(np.asarray(q, dtype=np.float64)[None], fixturing)
        return Closeness(*reacher.closest(own[0], links_mm))

    def slack_bound(
        self, q: np.ndarray, fixturing: str, enough_mm: float = np.inf, *, share: float = 1.0
    ) -> np.ndarray:
        """Return by how much all distances exceed those required, at least, for joints (n, 6).

        Parameters
        ----------
        q : array, shape (n, 6), or (n, 7) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.
        enough_mm : float
            Below this the result is exact; above, a quick lower bound.
        share : float
            Share of the clearance that is required.

        Returns
        -------
        array, shape (n,)
            Millimetres; negative if the clearance is not kept, -inf if objects touch.
        """
        joints = np.asarray(q, dtype=np.float64)
        result = np.empty(len(joints))
        for rows, reacher, own in self._by_angle(joints, fixturing):
            result[rows] = reacher.slack(own, share * reacher.required, enough_mm)
        return result

    def free_shares(
        self, q: np.ndarray, turn: np.ndarray, reach: np.ndarray, kept: float, *, fixturing: str
    ) -> np.ndarray:
        """Return which share of a straight move is proven free in both directions from joints.

        Parameters
        ----------
        q : array, shape (n, 6), or (n, 7) on a turntable
            Joints, rad.
        turn : array, shape (6,), or (7,) on a turntable
            The move, rad.
        reach : array, shape (n,)
            Largest shares of it that are of interest.
        kept : float
            Share of the clearance that must be kept.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (n,)
            See `Reacher.free_shares`.
        """
        if self._fixturing(fixturing).table is None:
            return self._reacher(fixturing).free_shares(q, turn, reach, kept)
        frames = self.robot.chain.frames(q[:, :N_JOINTS])
        return self._turned(fixturing).shares(frames, q[:, N_JOINTS], turn, reach, kept)

    def shapes(
        self, q: np.ndarray, fixturing: str
    ) -> list[tuple[str, bool, np.ndarray, np.ndarray]]:
        """Return everything at joints: name, whether it moves, corners in the base, triangles.

        Parameters
        ----------
        q : array_like, shape (6,), or (7,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        list of tuple
            The arm first.
        """
        ((_, reacher, own),) = self._by_angle(np.asarray(q, dtype=np.float64)[None], fixturing)
        return reacher.shapes(own[0])
