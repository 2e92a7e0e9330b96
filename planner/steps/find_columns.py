"""First step: the pools are filled from viewpoints of every entity, then improved where the cover would profit."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.columns.candidates import Beginning, column_seed, judged_poses, price_poses
from planner.columns.realise_column import without_corners
from planner.executors import in_order
from planner.ledger import Ledger
from planner.progress import report
from planner.setting.reason import Reason
from planner.steps.incumbents import IMPROVING, Incumbents
from planner.steps.prove_bound import WEIGHING, exclude
from planner.steps.run import Run

# entities without a view are tried so many at a time: whole numbers of what several processes take at once
_AT_A_TIME = 8
# rounds of column generation before that: they come across views of many, and a round costs less than trying one
_FIRST_ROUNDS = 10
_SAMPLING, _SAMPLED, _FIRST = "sampling", "candidate poses", "first columns"
_PRICED, _PROVEN = "column generation", "lower bound"


def find_columns(run: Run, incumbents: Incumbents) -> None:
    """Fill the pools, or go on from the checkpoint; columns that make a better plan are offered."""
    last = run.memo.last()
    if last is None:
        run.uninspectable = without_corners(run.judge)
        incumbents.glance(run)
    else:
        run.restore(last)
    if last is None or last["step"] == _SAMPLING:
        _sample(run, 0 if last is None else last["sampled"])
        run.keep(_SAMPLED, {})
    incumbents.offer(run)
    if last is None or last["step"] in (_SAMPLING, _SAMPLED):
        exclude(run)
    incumbents.excluded(run)
    if last is None or last["step"] in (_SAMPLING, _SAMPLED, _FIRST):
        _price(run, incumbents, last, _FIRST)
        incumbents.offer(run)
        # before the columns are improved further, so that others can join what is hard to inspect
        run.uninspectable = _try_alone(run, incumbents)
        incumbents.offer(run)
    if last is None or last["step"] not in (_PROVEN, WEIGHING):
        _price(run, incumbents, last, _PRICED)
        incumbents.offer(run)


def _sample(run: Run, done: int) -> None:
    """Fill the pools from viewpoints of every entity but the first ones, which are done."""
    names = [name for name in run.names if name not in run.uninspectable]
    arguments = [(run.shared, name, run.effort.viewpoints, run.seed) for name in names[done:]]
    for k, (poses, judged) in enumerate(in_order(run.executor, judged_poses, arguments), done + 1):
        run.pools.add(poses, judged)
        run.keep(_SAMPLING, {"sampled": k})
        report(run.progress, k, len(names), _SAMPLED)


def _try_alone(run: Run, incumbents: Incumbents) -> dict[str, Reason]:
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


def _price(run: Run, incumbents: Incumbents, last: dict[str, Any] | None, step: str) -> None:
    """Improve the pools by column generation; ``last`` is the checkpoint this run began with."""
    entries = last["entries"] if last is not None and last["step"] == step else None
    rounds, seed = run.effort.pricing_rounds, run.seed
    if step == _FIRST:
        rounds, seed = min(rounds, _FIRST_ROUNDS), column_seed(run.seed, [step])

    def keep(told: dict[str, Any]) -> None:
        run.keep(step, {"entries": told})
        if told["pricing"]["done"] % IMPROVING.rounds == 0:
            incumbents.offer(run)

    ledger = Ledger(kept=entries, keep=keep)
    begin = Beginning(sought=~np.isin(run.names, list(run.uninspectable)))
    price_poses(run.shared, run.pools, seed, rounds, run.executor, run.progress, begin, ledger)
