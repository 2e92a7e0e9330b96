"""Third step: optimistic columns that would save a setting are realised or refuted."""

from __future__ import annotations

import numpy as np

from planner.cover.few_columns import few_columns, sets_to_realise
from planner.steps.incumbents import Incumbents
from planner.steps.run import Run


def refute(run: Run, inspected: np.ndarray, bound: int, incumbents: Incumbents) -> None:
    """Try to do with fewer settings, not below the bound, by optimistic columns; refute what cannot be realised.

    Parameters
    ----------
    run : Run
        Its pools get what was realised.
    inspected : array of bool (k,)
        Entities that are to be covered.
    bound : int
        Settings that are needed at least.
    incumbents : Incumbents
        Columns that make a better plan are offered.
    """
    left = run.effort.refutations
    enough = None
    rng = run.rng("refutation")
    nodes = run.nodes(run.effort.stages.shares.refuting)
    impossible = np.zeros((0, len(run.names)), dtype=bool)
    while left > 0 and inspected.any():
        realised = run.pool.membership[:, inspected]
        if enough is None:
            enough = len(few_columns(realised, nodes, rng, covering=run.effort.cover))
        if enough <= 1 or bound >= run.callbacks.deadline.wanted_bound(enough):
            return
        near = run.pools.near.membership[:, inspected]
        sets = sets_to_realise(
            realised, near, impossible[:, inspected], enough, nodes, rng, run.effort.cover
        )[:left]
        if not sets:
            return
        left -= len(sets)
        wanted = [tuple(np.array(run.names)[inspected][one].tolist()) for one in sets]
        for names, outcome in zip(wanted, run.realise(wanted), strict=True):
            reached = run.accept(outcome)
            enough = None if reached else enough
            if set(names) - set(reached):
                impossible = np.vstack([impossible, np.isin(run.names, names)])
        incumbents.offer(run)
