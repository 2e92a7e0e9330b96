"""Columns: the pools are filled from viewpoints of every entity, then improved where the cover would profit."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.columns.candidates import WarmStart, derive_seed, judged_poses, price_poses
from planner.executors import in_order
from planner.setting.reason import Reason
from planner.steps.incumbents import Incumbents
from planner.steps.run import Run

# entities without a view are tried so many at a time: whole numbers of what several processes take at once
_AT_A_TIME = 16
# rounds of column generation before that: they come across views of many, and a round costs less than trying one
_FIRST_ROUNDS = 10


def sample_poses(run: Run, incumbents: Incumbents) -> None:
    """Fill the pools from viewpoints of every entity, but for those that the state has."""
    done = run.state.entries.get("sampled", 0)
    names = [name for name in run.names if name not in run.state.uninspectable]
    arguments = [(run.shared, name, run.effort.viewpoints, run.seed) for name in names[done:]]
    check = run.callbacks.check
    found = in_order(run.executor, judged_poses, arguments, check)
    for k, (poses, judged) in enumerate(found, done + 1):
        run.pools.add(poses, judged, run.judge.steady)
        run.save({"sampled": k})
        incumbents.offer_on_the_way(run)
        run.callbacks.report(k, len(names), "candidate poses")


def realise_missing_alone(run: Run, incumbents: Incumbents) -> dict[str, Reason]:
    """Give entities that no pose inspects a run of their own; return the reasons of those that fail.

    What some of them add to the plan is offered before the others are tried, as each takes seconds.
    """
    missing = [name for i, name in enumerate(run.names) if not run.pool.membership[:, i].any()]
    reasons: dict[str, Reason] = {}
    for first in range(0, len(missing), _AT_A_TIME):
        some = missing[first : first + _AT_A_TIME]
        for name, outcome in zip(some, run.realise([(name,) for name in some]), strict=True):
            if name not in run.accept(outcome):
                reasons[name] = outcome.reason_at(run.request.probability)
        if len(reasons) < first + len(some):
            incumbents.offer(run)
    return reasons


def generate_first_columns(run: Run, incumbents: Incumbents) -> None:
    """Improve the pools a little, before targets that no pose inspects are tried alone."""
    rounds = min(run.effort.pricing_rounds, _FIRST_ROUNDS)
    _generate(run, incumbents, rounds, derive_seed(run.seed, ["first columns"]))


def generate_columns(run: Run, incumbents: Incumbents) -> None:
    """Improve the pools by column generation."""
    _generate(run, incumbents, run.effort.pricing_rounds, run.seed)


def _generate(run: Run, incumbents: Incumbents, rounds: int, seed: int) -> None:
    """Improve the pools, from where the state has got."""

    def offer(entries: dict[str, Any]) -> None:
        if entries["pricing"]["done"] % run.effort.stages.improving.rounds == 0:
            incumbents.offer(run)

    warm_start = WarmStart(coverable=~np.isin(run.names, list(run.state.uninspectable)))
    price_poses(
        run.shared,
        run.pools,
        seed,
        rounds,
        run.executor,
        run.callbacks,
        warm_start,
        run.checkpoint(offer),
    )
