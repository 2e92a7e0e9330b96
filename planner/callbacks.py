"""What a planning calls while it goes on, and when it ends: a time limit, and the gap that is good enough."""

from __future__ import annotations

import math
import os
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from planner.argument_kinds import FROM_0_BELOW_1, POSITIVE_SECONDS, check_number
from planner.exceptions import RequestError
from planner.progress import Progress, TimeIsUpError, TimeLeft, report

REGIONS_SHARE = 0.5
"""Share of a time limit that the regions of visibility may take."""

SEARCH_SHARE = 0.8
"""Share of a time limit after which the search ends, so that simulation, report and graph have the rest."""

LIT_SEARCH_SHARE = 0.65
"""The same where lamps are to be found, too: they are sought for the plan that the search ends with."""

LAMPS_SHARE = 0.9
"""Share of a time limit after which no more lamps are sought."""

SETTLING_SHARE = 0.05
"""Share of a time limit in which the settings of a plan that it ended are still moved off their limits."""

SIMULATION_SHARE = 0.88
"""Share of a time limit after which the simulation ends."""

LEAST_SIMULATION_S = 2.0
"""Seconds that the simulation may take, however short a time limit is: a plan that is not checked is worth less."""

LEAST_SETTLING_S = 0.7
"""Seconds that this may take, however short a time limit is."""

FORESEEN_SHARE = 0.91
"""Share of a time limit after which it is no longer computed what `measure` will state."""

PAGE_S = 0.008
"""Seconds that the page takes for each target, without pictures."""

PICTURES_SHARE = 0.95
"""Share of a time limit after which no more pictures are drawn, so that the page can be put together."""

LEAST_SEARCH_S = 5.0
"""Seconds between a first glance at the part and the next plan on the way. Regions and search have them of a limit
that is shorter, or that reading the part has taken."""

KEPT_LIMIT_S = 5.0
"""Limits from this one on are kept up to a few seconds. A shorter one gives regions and search their least time."""

# of the time until the search ends, where reading the part has taken much of the limit
_LATE_REGIONS_SHARE = 2.0 / 3.0
# seconds beyond the limit: until when regions and search may take their least time, until when
# there must be a first plan, and until when a simulation may take its least time
_SEARCH_BEYOND_S = 0.5
_FIRST_PLAN_BEYOND_S = 1.0
_SIMULATION_BEYOND_S = 1.0


class Deadline:
    """When a planning ends.

    Parameters
    ----------
    time_limit_s : float or None
        From now; None never ends it.
    gap : float
        Share of the settings that the bound may miss.
    begun : float, optional
        When the time began to run, as `time.monotonic` counts. Default: now.

    Raises
    ------
    RequestError
        If the limit is not positive, or the gap not in [0, 1).
    """

    def __init__(
        self, time_limit_s: float | None = None, gap: float = 0.0, begun: float | None = None
    ):
        if time_limit_s is not None:
            check_number("time_limit_s", time_limit_s, POSITIVE_SECONDS)
        self.gap = check_number("gap", gap, FROM_0_BELOW_1)
        self._limit = math.inf if time_limit_s is None else float(time_limit_s)
        now = time.monotonic()
        self._begin = now if begun is None else begun
        # of the clock that other processes share
        self._wall_begin = time.time() - (now - self._begin)
        # until when a first plan may take its least time, whatever the limit is
        self._latest = self._limit if self._limit >= KEPT_LIMIT_S else math.inf
        # from when on there is something to end with
        self._armed_at = math.inf
        # a file that tells other processes so, once they have work
        self._sign: Path | None = None

    @property
    def limited(self) -> bool:
        """Whether there is a time limit."""
        return self._limit < math.inf

    def of_regions(self) -> float:
        """Return when the regions of visibility end, as `time.time` counts; infinity without a limit."""
        now = time.time()
        if self._latest == math.inf:
            return max(self.at(REGIONS_SHARE), now + LEAST_SEARCH_S)
        late = now + _LATE_REGIONS_SHARE * (self._of_search(now) - now)
        return max(self.at(REGIONS_SHARE), late)

    def of_search(
        self, gap: float = 0.0, share: float = SEARCH_SHARE, *, later_s: float = 0.0
    ) -> Deadline:
        """Return the deadline of the search that begins now: its share of the limit, or its least time.

        Its share is shorter by the seconds of what must come later.
        """
        if not self.limited:
            return Deadline(None, gap)
        end = self._of_search(time.time(), share, later_s)
        deadline = Deadline(max(end - self._wall_begin, 1e-3), gap, self._begin)
        deadline._latest = self._latest
        return deadline

    def _of_search(self, now: float, share: float = SEARCH_SHARE, later_s: float = 0.0) -> float:
        if self._latest == math.inf:
            return self.at(share)
        latest = self._wall_begin + self._latest + _SEARCH_BEYOND_S
        return max(self.at(share) - later_s, min(now + LEAST_SEARCH_S, latest))

    def at(self, share: float = 1.0) -> float:
        """Return when a share of the time limit has passed, as `time.time` counts; infinity without a limit."""
        return self._wall_begin + share * self._limit

    def seconds_left(self, share: float = 1.0) -> float | None:
        """Return how long it is until a share of the limit has passed, 1 ms at least; None without one."""
        if not self.limited:
            return None
        return max(share * self._limit - (time.monotonic() - self._begin), 1e-3)

    def of_settling(self) -> float:
        """Return when settings are no longer moved off their limits after the time is up, as `time.time` counts.

        That is now where the least time does not fit any more.
        """
        now = time.time()
        latest = self._wall_begin + self._latest + _FIRST_PLAN_BEYOND_S
        if now + LEAST_SETTLING_S > latest:
            return now
        return min(now + max(SETTLING_SHARE * self._limit, LEAST_SETTLING_S), latest)

    def time_left(
        self, share: float = 1.0, least_s: float = 0.0, *, later_s: float = 0.0
    ) -> TimeLeft:
        """Return what tells whether another piece of work fits until a share of the limit has passed.

        It ends before what must come later, which takes some seconds. Work that comes late has half of that time. It
        has its least seconds if they end soon after the limit.
        """
        now = time.time()
        latest = self._wall_begin + self._latest + _SIMULATION_BEYOND_S
        earliest = min(now + least_s, latest)
        end = min(self.at(share), self.at() - later_s)
        return TimeLeft(max(end, (now + self.at() - later_s) / 2.0, earliest))

    @contextmanager
    def stated_whole(self) -> Iterator[None]:
        """Let an error about the time limit in the block state the whole limit.

        The work in the block may know only what is left of it.
        """
        try:
            yield
        except RequestError as error:
            if error.parameter != "time_limit_s" or not self.limited:
                raise
            got = f"{self._limit:g}"
            raise RequestError.of_rule(error.parameter, error.rule, got, hint=error.hint) from error

    def arm(self) -> None:
        """From now on there is something to end with."""
        self._arm_at(-math.inf)

    def glance_s(self) -> float:
        """Return for how many seconds there may be another glance: half of what is left, or its least time."""
        passed = time.monotonic() - self._begin
        shortest = min(LEAST_SEARCH_S, self._latest + _FIRST_PLAN_BEYOND_S - passed)
        return max((self._limit - passed) / 2.0, shortest)

    def arm_soon(self) -> None:
        """There is a first plan to end with, for limits under `KEPT_LIMIT_S` only after `LEAST_SEARCH_S`."""
        wait_s = LEAST_SEARCH_S if self._latest == math.inf else 0.0
        self._arm_at(min(self._armed_at, time.monotonic() + wait_s))

    def _arm_at(self, moment: float) -> None:
        if moment != self._armed_at:
            self._armed_at = moment
            if self._sign is not None:
                _write_sign(self._sign, self._wall_begin + (moment - self._begin))

    def check(self) -> None:
        """Raise `TimeIsUpError` if the time is up and there is something to end with, or it is up for a first plan."""
        now = time.monotonic()
        passed = now - self._begin
        is_first_late = passed > self._latest + _FIRST_PLAN_BEYOND_S
        if passed > self._limit and (now >= self._armed_at or is_first_late):
            raise TimeIsUpError

    def check_now(self) -> Callable[[], None]:
        """Return a check for other processes that raises as `check` does, also by what there is to end with later."""
        latest = self._latest + _FIRST_PLAN_BEYOND_S
        with_plan = max(self._limit, self._armed_at - self._begin)
        until = self._wall_begin + max(self._limit, min(with_plan, latest))
        if self._sign is None and self._armed_at == math.inf and self.limited:
            self._sign = _new_sign(self)
        return _CheckElsewhere(until, self._wall_begin + self._limit, self._sign).check

    def wanted_bound(self, n_settings: int) -> int:
        """Return the bound that is good enough for so many settings."""
        return math.ceil(n_settings * (1.0 - self.gap) - 1e-9)


@dataclass(frozen=True)
class _CheckElsewhere:
    """A check for another process: when it ends in any case, and when it ends if a file says that there is a plan."""

    until: float
    limit: float
    sign: Path | None

    def check(self) -> None:
        """Raise `TimeIsUpError` if the time is up."""
        now = time.time()
        if now > self.until or (now > self.limit and now >= _read_sign(self.sign)):
            raise TimeIsUpError


def _new_sign(deadline: Deadline) -> Path | None:
    """Return an empty file that is removed with a deadline; None where none can be made."""
    try:
        handle, name = tempfile.mkstemp(prefix="aspectgraph-", suffix=".armed")
    except OSError:
        return None
    os.close(handle)
    path = Path(name)
    weakref.finalize(deadline, path.unlink, missing_ok=True)
    return path


def _write_sign(path: Path, moment: float) -> None:
    with suppress(OSError):
        path.write_text(repr(moment))


def _read_sign(path: Path | None) -> float:
    """Return from when on there is something to end with, as `time.time` counts; infinity if nothing says so."""
    try:
        return math.inf if path is None else float(path.read_text())
    except (OSError, ValueError):
        return math.inf


@dataclass(frozen=True)
class Callbacks:
    """What a planning calls while it goes on. An exception that one of them raises cancels the work.

    Parameters
    ----------
    on_stage : callable, optional
        ``on_stage(name)`` is called when a stage of `planner.search.stages` begins.
    on_best : callable, optional
        ``on_best(plan)`` gets the best `InspectionPlan` so far whenever it, or its bound, is better.
    on_bound : callable, optional
        ``on_bound(bound, weights)`` gets every number of settings that is proven to be needed, and the weights of
        targets that prove it, or None; see `planner.bound.lower_bound.ProvenBound`.
    progress : callable, optional
        ``progress(done, total, label)``.
    deadline : Deadline
        Ends the work. Default: never.
    """

    on_stage: Callable[[str], object] | None = None
    on_best: Callable[[Any], object] | None = None
    on_bound: Callable[[int, Any], object] | None = None
    progress: Progress | None = None
    deadline: Deadline = field(default_factory=Deadline)

    @property
    def silent(self) -> Callbacks:
        """The same without progress: of work between other work that may be ended."""
        return replace(self, progress=None)

    @property
    def wants_plans(self) -> bool:
        """Whether plans on the way are of any use: somebody gets them, or the time is limited."""
        return self.on_best is not None or self.deadline.limited

    @property
    def check(self) -> Callable[[], None] | None:
        """What may end long work, if anything may."""
        return self.deadline.check if self.deadline.limited else None

    def report(self, done: int, total: int, label: str) -> None:
        """Pass on how far some work has got, and end it if the time is up."""
        report(self.progress, done, total, label)
        self.deadline.check()

    def stage(self, name: str) -> None:
        """Pass on that a stage begins."""
        if self.on_stage is not None:
            self.on_stage(name)

    def best(self, plan: Any) -> None:
        """Pass on the best plan so far."""
        if self.on_best is not None:
            self.on_best(plan)

    def bound(self, bound: int, weights: Any = None) -> None:
        """Pass on that at least this many settings are needed, and the weights of targets that prove it."""
        if self.on_bound is not None:
            self.on_bound(bound, weights)


NOBODY = Callbacks()
"""Nobody is called, and nothing ends the work."""


# How far a long piece of work has got, in entries by name.


class Checkpoint:
    """Entries by name that an interrupted piece of work goes on from.

    Parameters
    ----------
    kept : dict, optional
        The entries of earlier work for the same request.
    keep : callable, optional
        ``keep(entries)`` gets all entries after each change; see `planner.plan_file.packed` for what they may
        hold.
    """

    def __init__(
        self,
        kept: dict[str, Any] | None = None,
        keep: Callable[[dict[str, Any]], None] | None = None,
    ):
        self._keep = keep
        self._kept = kept or {}
        # an entry that is not replaced still holds
        self._entries = dict(self._kept)

    def get(self, name: str) -> Any:
        """Return the last entry of the earlier work under a name, or None."""
        return self._kept.get(name)

    def put(self, name: str, entry: Any) -> None:
        """Replace the entry under a name."""
        self._entries = {**self._entries, name: entry}
        if self._keep is not None:
            self._keep(self._entries)
