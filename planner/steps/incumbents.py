"""The best plan so far, while a run goes on: an upper bound that can be used at once.

An incumbent is a whole plan: a cover by the columns found so far, each with the candidate pose it was found at,
supported by simulation. It is told of whenever it or its bound gets better. Nothing in a run depends on it, so a run
that is watched ends with the same plan as one that is not.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.bound.lower_bound import exclusion_proof
from planner.bound.proven import ProvenBound
from planner.callbacks import LEAST_SEARCH_S, Callbacks
from planner.columns.candidates import first_poses
from planner.columns.judge import Judgement
from planner.columns.pool import ColumnPool
from planner.plan import InspectionPlan
from planner.setting.sensor_setting import SensorSetting
from planner.steps.assemble import assembled
from planner.steps.run import Run
from planner.steps.supported_columns import SupportedColumns

# between two offers on the way, in times of how long one takes
_OFFERS_APART = 4.0
# seconds, and then a share of the time, for plans on the way of a run that has all the time it needs
_FREE_S = 1.0
_SHARE = 0.1
_TRIVIAL = "Fewer settings than one inspect nothing; the proof of a larger bound had not begun."
SO_FAR = (
    "Covering by optimistic columns, boxes of camera poses checked against necessary conditions (visibility, focus, "
    "sensor size, length of the image), as far as the proof had got."
)


class Incumbents:
    """The best plan so far of one run.

    Parameters
    ----------
    callbacks : Callbacks
        ``on_best`` gets the plan whenever it or its bound is better, ``on_bound`` every bound. Plans are made only if
        they are of use to somebody.

    Attributes
    ----------
    best : InspectionPlan or None
        The plan.
    """

    def __init__(self, callbacks: Callbacks):
        self.best: InspectionPlan | None = None
        self._callbacks = callbacks
        # the best one of each kind
        self._proofs: dict[str, ProvenBound] = {}
        self._columns = SupportedColumns()
        self._begun = time.monotonic()
        self._spent_s = 0.0
        self._offer_again = self._begun + LEAST_SEARCH_S

    def glance(self, run: Run) -> None:
        """Make a plan of very few poses, so that there is one at once; the run does not take these poses in."""
        deadline = self._callbacks.deadline
        # how long a direction takes
        each = 0.0
        for directions in (
            run.effort.stages.improving.directions if self._callbacks.wants_plans else ()
        ):
            begun = time.monotonic()
            # candidate poses make more of the time than a second glance that would take most of it
            left = deadline.seconds_left()
            if left is None and self.best is not None:
                break
            if left is not None and each * directions > max(LEAST_SEARCH_S, left / 2):
                break
            pool = ColumnPool(len(run.names))
            poses = first_poses(run.judge, directions, run.seed)
            judged = self._judged_in_parts(run, poses)
            pool.add(judged.inspects, poses, judged.probability)
            self._offer(run, pool, covers=1)
            if self.best is not None:
                deadline.arm_soon()
            each = (time.monotonic() - begun) / directions
        self._offer_again = time.monotonic() + LEAST_SEARCH_S

    def _judged_in_parts(self, run: Run, poses: NDArray[np.float64]) -> Judgement:
        """Judge poses as many at a time as the judge does itself, and report between."""
        size = run.effort.nearness.batch
        parts = [run.judge(poses[:0])]
        for first in range(0, len(poses), size):
            parts.append(run.judge(poses[first : first + size]))
            self._callbacks.report(first + len(parts[-1].inspects), len(poses), "first poses")
        return Judgement.joined(parts)

    def offer_on_the_way(self, run: Run) -> None:
        """Where the time is limited, see now and then what the columns of an unfinished stage are good for."""
        if not self._callbacks.deadline.limited:
            return
        now = time.monotonic()
        if now >= self._offer_again:
            self.offer(run)
            took = time.monotonic() - now
            self._offer_again = now + took + max(LEAST_SEARCH_S, _OFFERS_APART * took)

    def offer(self, run: Run) -> None:
        """See whether the columns of a run make a better plan."""
        if self._callbacks.wants_plans and run.pool.membership.any() and self._is_affordable():
            self._offer(run, run.pool)
            if self.best is not None:
                self._callbacks.deadline.arm()

    def _is_affordable(self) -> bool:
        """Return whether another plan on the way keeps to its share of the time, where the time is not limited."""
        if self._callbacks.deadline.limited or self.best is None:
            return True
        return self._spent_s <= max(_FREE_S, _SHARE * (time.monotonic() - self._begun))

    def _offer(self, run: Run, pool: ColumnPool, covers: int | None = None) -> None:
        """See whether the columns of a pool make a better plan."""
        begun = time.monotonic()
        cover = self._columns.cover(
            run, pool, (0, 0) if self.best is None else _worth(self.best), covers
        )
        if cover:
            bound, proof = self.proven(run, cover)
            plan = assembled(run, cover, bound, proof, unfinished=True)
            if self.best is None or _worth(plan) > _worth(self.best):
                self.publish(plan)
        self._spent_s += time.monotonic() - begun

    def on_bound(self, run: Run, proven: ProvenBound) -> None:
        """Take in a bound that was proven for some entities."""
        self._callbacks.bound(proven.n, proven.weights)
        self._proofs[proven.proof] = proven
        if self.best is not None:
            known, proof = self.proven(run, self.best.settings)
            if known > self.best.lower_bound:
                self.publish(replace(self.best, lower_bound=known, bound_proof=proof))

    def on_incompatible(self, run: Run) -> None:
        """Take in the bound of entities that exclude each other, if some are known."""
        incompatible = run.state.incompatible
        n = len(incompatible)
        if n > 1:
            seen = np.isin(run.names, incompatible)
            self.on_bound(run, ProvenBound(n, exclusion_proof(run.request, n), seen))

    @property
    def latest(self) -> InspectionPlan:
        """The best plan, once there is one."""
        assert self.best is not None
        return self.best

    def publish(self, plan: InspectionPlan) -> None:
        """Take in the plan of the whole run, and tell of it."""
        self.best = plan
        self._callbacks.best(plan)

    def proven(self, run: Run, settings: Sequence[SensorSetting]) -> tuple[int, str]:
        """Return the bound that holds for what settings inspect, and what it rests on."""
        if not settings:
            return 0, "No entity is inspected."
        seen = np.isin(run.names, [name for setting in settings for name in setting.entities])
        for_these = [(one.for_some(seen), one.proof) for one in self._proofs.values()]
        return max([(1, _TRIVIAL), *for_these], key=lambda one: one[0])


def _worth(plan: InspectionPlan) -> tuple[int, int]:
    """Return what the better one has more of."""
    return len(plan.inspected), -len(plan.settings)
