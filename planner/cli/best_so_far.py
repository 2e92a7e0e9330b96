"""The best plan so far: a line in the log for each, and something to write when the work is interrupted."""

from __future__ import annotations

import time

from planner.plan import InspectionPlan
from planner.progress import Progress, note
from planner.report.wording import incumbent_line


class BestSoFar:
    """Takes in the incumbents of a planning.

    Parameters
    ----------
    progress : callable or None
        Shows a line for each.

    Attributes
    ----------
    plan : InspectionPlan or None
        The latest.
    interrupted : bool
        Whether the planning was.
    """

    def __init__(self, progress: Progress | None):
        self.plan: InspectionPlan | None = None
        self.interrupted = False
        self._progress = progress
        self._start = time.monotonic()

    def __call__(self, plan: InspectionPlan) -> None:
        """Take in one that is better."""
        known = self.plan
        self.plan = plan
        # the last one may be the same with surer poses
        if known is None or _line(known) != _line(plan):
            note(self._progress, incumbent_line(plan, self.seconds))

    @property
    def seconds(self) -> float:
        """Since this began."""
        return time.monotonic() - self._start

    def instead(self) -> InspectionPlan:
        """Return the plan to write when the planning is interrupted.

        Raises
        ------
        KeyboardInterrupt
            If there is none yet.
        """
        if self.plan is None:
            raise KeyboardInterrupt
        self.interrupted = True
        note(self._progress, "interrupted: the best plan so far is written")
        return self.plan


def _line(plan: InspectionPlan) -> str:
    return incumbent_line(plan, 0.0)
