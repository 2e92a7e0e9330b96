"""Questions about joints in a fixturing: whether they are free, and how near anything is."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from planner.robot.collisions import Closeness
from planner.robot.pose_reach import Reacher


class JointChecks(ABC):
    """What a `Cell` says of joints."""

    @abstractmethod
    def _reacher(self, name: str) -> Reacher:
        """Return what knows one fixturing."""

    def free(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return which joints are within limits and keep the clearance.

        Parameters
        ----------
        q : array, shape (n, 6)
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array of bool, shape (n,)
            True where nothing is too near.
        """
        return self._reacher(fixturing).free(np.asarray(q, dtype=np.float64))

    def blocked_by(self, q: np.ndarray, fixturing: str) -> str:
        """Return what is wrong with joints, in words.

        Parameters
        ----------
        q : array_like, shape (6,)
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        str
            Empty if they are free.
        """
        return self._reacher(fixturing).blocked_by(np.asarray(q, dtype=np.float64))

    def clearance(self, q: np.ndarray, fixturing: str) -> Closeness:
        """Return the closest two objects.

        Parameters
        ----------
        q : array_like, shape (6,)
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        Closeness
            Their names and their distance, mm.
        """
        return Closeness(*self._reacher(fixturing).closest(np.asarray(q, dtype=np.float64)))

    def slack_bound(
        self, q: np.ndarray, fixturing: str, enough_mm: float = np.inf, *, share: float = 1.0
    ) -> np.ndarray:
        """Return by how much all distances exceed those required, at least, for joints (n, 6).

        Parameters
        ----------
        q : array, shape (n, 6)
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
        reacher = self._reacher(fixturing)
        return reacher.slack(np.asarray(q, dtype=np.float64), share * reacher.required, enough_mm)

    def in_fixturing(self, fixturing: str) -> Reacher:
        """Return the robot in one fixturing, as moves are checked in it.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        Reacher
            Built when it is first needed.
        """
        return self._reacher(fixturing)
