"""Whether there is time for one more piece of work before a deadline."""

from __future__ import annotations

import math
import time
from collections.abc import Callable


class TimeIsUpError(Exception):
    """The time limit has passed. It never leaves the package."""


class TimeLeft:
    """Tells before each piece of some work whether it fits: if it takes as long as the longest one so far.

    Parameters
    ----------
    until : float
        Deadline, as `clock` counts. Default: never.
    clock : callable
        Seconds.
    """

    def __init__(self, until: float = math.inf, clock: Callable[[], float] = time.time) -> None:
        self.until = until
        self._clock = clock
        self._last = math.nan
        self._longest = 0.0

    @property
    def seconds(self) -> float:
        """Seconds until the deadline, not negative."""
        return max(self.until - self._clock(), 0.0)

    def fits_another(self) -> bool:
        """Return whether one more piece fits; to be called before each piece."""
        if self.until == math.inf:
            return True
        now = self._clock()
        # the first call has no piece before it
        if now - self._last > self._longest:
            self._longest = now - self._last
        self._last = now
        return now + self._longest <= self.until

    def check(self) -> None:
        """Raise `TimeIsUpError` if the deadline has passed."""
        if self._clock() > self.until:
            raise TimeIsUpError
