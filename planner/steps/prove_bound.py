"""Second step: a lower bound is proven; poses that the proof comes across join the pools."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.bound.lower_bound import exclusion_proof, exclusive_entities, lower_bound
from planner.checkpoint import Checkpoint
from planner.columns.candidates import Pools, WarmStart, derive_seed, price_poses
from planner.columns.judge import Judge
from planner.columns.pool import ColumnPool
from planner.cover.few_columns import few_columns
from planner.executors import Shared
from planner.steps.incumbents import Incumbents
from planner.steps.run import SHARES, Run

_STEP = "lower bound"
WEIGHING = "weighing"


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
    values = (
        _known(run)
        if last is None
        else {name: last[name] for name in ("known", "inspected", "joined")}
    )
    inspected = values["inspected"]
    weighing = _Weighing(run, last)

    def improve(poses: np.ndarray) -> np.ndarray:
        values["joined"] += 1
        weighing.join(poses, derive_seed(run.seed, ["joined", str(values["joined"])]))
        incumbents.offer(run)
        return weighing.columns[:, inspected]

    def keep(entries: Any) -> None:
        run.keep(_STEP, {**values, **weighing.to_dict(), "entries": entries})

    def raised(bound: int) -> None:
        incumbents.on_bound(run, bound, inspected)

    checkpoint = Checkpoint(improve, entries, keep, raised)
    proven = checkpoint.get("proven")
    enough = run.watch.wanted_bound(values["known"])
    alone = len(run.incompatible) if inspected[np.isin(run.names, run.incompatible)].all() else 0
    if proven is None and alone >= enough > 0:
        proven = alone, exclusion_proof(run.request, alone)
    if proven is None:
        proven = lower_bound(
            run.request,
            np.flatnonzero(inspected),
            enough,
            weighing.columns[:, inspected],
            max_nodes=run.effort.bound_nodes,
            checkpoint=checkpoint,
            executor=run.executor,
            progress=run.progress,
        )
        keep({"proven": list(proven)})
    bound, proof = proven if proven[0] >= alone else (alone, exclusion_proof(run.request, alone))
    incumbents.on_bound(run, bound, inspected)
    return bound, proof


def find_incompatible(run: Run) -> None:
    """Find entities of which no setting inspects two: a bound long before the proof."""
    seen = np.flatnonzero(run.pool.inspected)
    if seen.size > 1:
        found = exclusive_entities(run.request, seen, run.pool.membership[:, seen], run.executor)
        run.incompatible = tuple(np.array(run.names)[found].tolist())


class _Weighing:
    """The columns that the proof's weights come from: those of the plan, or of a request without some conditions.

    The proof does not use all conditions. Weights from columns that meet them all are too large for its poses, and it
    would take most of its time to learn so, one pose after the other.
    """

    def __init__(self, run: Run, last: dict[str, Any] | None):
        self._run = run
        need = run.request.requirements
        showing = replace(need.showing, separation_px=0.0, min_corner_deg=0.0)
        self._own: Pools | None = None
        if showing == need.showing:
            return
        self._shared = Shared(
            Judge(replace(run.request, requirements=replace(need, showing=showing)))
        )
        if last is not None:
            self._own = Pools.from_dict(last["weighing"])
            return
        begun = run.kept(WEIGHING)
        poses = None
        if begun is None:
            self._own = Pools(*(ColumnPool(len(run.names)) for _ in Pools._fields))
            poses = np.concatenate([pool.poses for pool in run.pools])
        else:
            self._own = Pools.from_dict(begun["weighing"])
        checkpoint = Checkpoint(
            kept=None if begun is None else begun["entries"],
            keep=lambda told: run.keep(WEIGHING, {**self.to_dict(), "entries": told}),
        )
        self._price(
            self._own,
            poses,
            derive_seed(run.seed, ["weighing"]),
            run.effort.pricing_rounds,
            checkpoint,
        )

    @property
    def columns(self) -> np.ndarray:
        """Columns (c, k)."""
        return (self._run.pools if self._own is None else self._own).realised.membership

    def join(self, poses: np.ndarray, seed: int) -> None:
        """Add what the proof came across to these columns, and to the plan's."""
        run = self._run
        rounds = JOINING.rounds_for(len(run.pool))
        # what is found without some conditions seldom meets them
        own = rounds if self._own is None else JOINING.rounds
        price_poses(run.shared, run.pools, seed, own, run.executor, run.silent, WarmStart(poses))
        if self._own is not None:
            self._price(self._own, poses, seed, rounds)

    def to_dict(self) -> dict[str, Any]:
        """Return what a checkpoint needs."""
        return {} if self._own is None else {"weighing": self._own.to_dict()}

    def _price(
        self,
        pools: Pools,
        poses: np.ndarray | None,
        seed: int,
        rounds: int,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        run = self._run
        price_poses(
            self._shared,
            pools,
            seed,
            rounds,
            run.executor,
            run.silent,
            WarmStart(poses),
            checkpoint,
        )


def _known(run: Run) -> dict[str, Any]:
    """Return what a proof needs to know: which entities are to be covered, and in how many settings they can be."""
    inspected = run.pool.membership.any(axis=0)
    known = 0
    if inspected.any():
        known = len(
            few_columns(
                run.pool.membership[:, inspected], run.nodes(SHARES.refuting), run.rng("known")
            )
        )
    return {"inspected": inspected, "known": known, "joined": 0}
