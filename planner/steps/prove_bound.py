"""Second step: a lower bound is proven; poses that the proof comes across join the pools."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.bound.lower_bound import lower_bound
from planner.columns.candidates import column_seed, price_poses
from planner.cover.few_columns import few_columns
from planner.ledger import Ledger
from planner.steps.incumbents import Incumbents
from planner.steps.run import SHARES, Run

_STEP = "lower bound"


@dataclass(frozen=True)
class Joining:
    """How long the columns are improved from poses that the proof has come across.

    Attributes
    ----------
    rounds : int
        Rounds of column generation at least.
    most_rounds : int
        Rounds at most, while columns are few.
    columns : int
        Rounds times columns is about this: a round over many columns takes longer.
    """

    rounds: int = 5
    most_rounds: int = 25
    columns: int = 20_000

    def rounds_for(self, n_columns: int) -> int:
        """Return the rounds for a pool of so many columns."""
        return min(max(self.rounds, self.columns // max(1, n_columns)), self.most_rounds)


JOINING = Joining()


def prove_bound(run: Run, incumbents: Incumbents) -> tuple[int, str]:
    """Prove a lower bound; return it, and what the proof rests on. Better plans and bounds are told on the way."""
    last = run.kept(_STEP)
    entries = None if last is None else last["entries"]
    values = _known(run) if last is None else {name: last[name] for name in ("known", "inspected", "joined")}
    inspected = values["inspected"]

    def improve(poses: np.ndarray) -> np.ndarray:
        values["joined"] += 1
        seed = column_seed(run.seed, ["joined", str(values["joined"])])
        rounds = JOINING.rounds_for(len(run.pool))
        price_poses(run.shared, run.pools, seed, rounds, run.executor, run.silent, parents=poses)
        incumbents.offer(run)
        return run.pool.membership[:, inspected]

    def raised(bound: int) -> None:
        incumbents.raised(run, bound, inspected)

    ledger = Ledger(improve, entries, lambda told: run.keep(_STEP, {**values, "entries": told}), raised)
    proven = ledger("proven")
    if proven is None:
        proven = lower_bound(
            run.judge,
            np.flatnonzero(inspected),
            run.watch.wanted_bound(values["known"]),
            run.pool.membership[:, inspected],
            max_nodes=run.effort.bound_nodes,
            ledger=ledger,
            executor=run.executor,
            progress=run.progress,
        )
        run.keep(_STEP, {**values, "entries": {"proven": list(proven)}})
    bound, proof = proven
    incumbents.raised(run, bound, inspected)
    return bound, proof


def _known(run: Run) -> dict[str, Any]:
    """Return what a proof needs to know: which entities are to be covered, and in how many settings they can be."""
    inspected, known = run.pool.membership.any(axis=0), 0
    if inspected.any():
        known = len(few_columns(run.pool.membership[:, inspected], run.nodes(SHARES.refuting), run.rng("known")))
    return {"inspected": inspected, "known": known, "joined": 0}
