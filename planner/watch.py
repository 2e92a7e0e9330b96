"""When a planning is to end: its time limit, and the gap that is good enough."""

from __future__ import annotations

import math
import time
from typing import Any

from planner.exceptions import RequestError
from planner.progress import Progress, report


class TimeIsUpError(Exception):
    """The time limit has passed. It never leaves the package."""


class Watch:
    """Tells when a planning is to end.

    Parameters
    ----------
    time_limit_s : float or None
        From now; None never ends it.
    gap : float
        Share of the settings that the bound may miss.

    Raises
    ------
    RequestError
        If the limit is not positive, or the gap not in [0, 1).
    """

    def __init__(self, time_limit_s: float | None = None, gap: float = 0.0):
        if time_limit_s is not None and not _is_number(time_limit_s, above=0.0):
            raise RequestError.of_rule(
                "time_limit_s", "must be a positive number of seconds", repr(time_limit_s)
            )
        if not (_is_number(gap, above=-math.inf) and 0 <= gap < 1):
            raise RequestError.of_rule("gap", "must be in [0, 1)", repr(gap))
        self.gap = float(gap)
        self._end = math.inf if time_limit_s is None else time.monotonic() + time_limit_s
        self._armed = False

    @property
    def limited(self) -> bool:
        """Whether there is a time limit."""
        return self._end < math.inf

    def arm(self) -> None:
        """From now on there is something to end with."""
        self._armed = True

    def check(self) -> None:
        """Raise `TimeIsUpError` if the time is up and there is something to end with."""
        if self._armed and time.monotonic() > self._end:
            raise TimeIsUpError

    def wanted_bound(self, n_settings: int) -> int:
        """Return the bound that is good enough for so many settings."""
        return math.ceil(n_settings * (1.0 - self.gap) - 1e-9)

    def watched(self, progress: Progress | None) -> Progress | None:
        """Return a progress callable that checks the time too; what is None stays so without a limit."""
        if not self.limited:
            return progress

        def told(done: int, total: int, label: str) -> None:
            report(progress, done, total, label)
            self.check()

        return told


def _is_number(value: Any, above: float) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and above < value < math.inf
    )
