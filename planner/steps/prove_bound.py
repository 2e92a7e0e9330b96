"""Second step: a lower bound is proven; poses that the proof comes across join the pools."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from planner.bound.lower_bound import exclusion_proof, exclusive_entities, lower_bound
from planner.bound.proven import ProvenBound, of_all
from planner.columns.candidates import Pools, WarmStart, derive_seed, price_poses
from planner.columns.judge import Judge
from planner.cover.few_columns import few_columns
from planner.executors import Shared
from planner.request.request import Request
from planner.steps.incumbents import SO_FAR, Incumbents
from planner.steps.plan_state import empty_pools
from planner.steps.run import Run


def prove_bound(run: Run, incumbents: Incumbents) -> ProvenBound:
    """Prove a lower bound. Better plans and bounds are told on the way."""
    state = run.state
    inspected = _inspected(run)
    columns = ProofColumns(run)

    def improve(poses: np.ndarray) -> np.ndarray:
        state.joined += 1
        columns.join(poses, derive_seed(run.seed, ["joined", str(state.joined)]))
        incumbents.offer(run)
        return columns.membership[:, inspected]

    def raised(bound: int, weights: np.ndarray | None) -> None:
        incumbents.on_bound(run, ProvenBound(bound, SO_FAR, inspected, _of_all(weights)))

    def _of_all(weights: np.ndarray | None) -> np.ndarray | None:
        return None if weights is None else of_all(weights, inspected)

    checkpoint = run.checkpoint()
    proven = checkpoint.get("proven")
    enough = run.callbacks.deadline.wanted_bound(state.known)
    alone = len(state.incompatible)
    if not inspected[np.isin(run.names, state.incompatible)].all():
        alone = 0
    if proven is None and alone >= enough > 0:
        proven = alone, exclusion_proof(run.request, alone), None
    if proven is None:
        proven = lower_bound(
            run.request.restricted_to(run.names_of(inspected)),
            enough,
            columns.membership[:, inspected],
            effort=run.effort,
            improve=improve,
            checkpoint=checkpoint,
            executor=run.executor,
            callbacks=replace(run.callbacks, on_bound=raised),
        )
        run.save({"proven": list(proven)})
    if proven[0] < alone:
        proven = alone, exclusion_proof(run.request, alone), None
    bound, proof, weights = proven
    found = ProvenBound(bound, proof, inspected, _of_all(weights))
    incumbents.on_bound(run, found)
    return found


def _inspected(run: Run) -> np.ndarray:
    """Return which entities (k,) the proof is for; find at its beginning in how many settings they can be covered."""
    state = run.state
    if state.inspected is None:
        state.inspected = run.pool.inspected
        if state.inspected.any():
            membership = run.pool.membership[:, state.inspected]
            nodes = run.nodes(run.effort.stages.shares.refuting)
            chosen = few_columns(membership, nodes, run.rng("known"), covering=run.effort.cover)
            state.known = len(chosen)
    return state.inspected


def find_incompatible(run: Run) -> None:
    """Find entities of which no setting inspects two: a bound long before the proof."""
    seen = np.flatnonzero(run.pool.inspected)
    if seen.size > 1:
        columns = run.pool.membership[:, seen]
        found = exclusive_entities(run.request, seen, columns, run.executor, run.effort)
        run.state.incompatible = tuple(np.array(run.names)[found].tolist())


def weigh_columns(run: Run) -> None:
    """Find the columns that the proof's weights come from, where they are not those of the plan.

    The proof does not use all conditions. Weights from columns that meet them all are too large for its poses, and it
    would take most of its time to learn so, one pose after the other.
    """
    columns = ProofColumns(run)
    if columns.relaxed is None:
        return
    poses = None
    if run.state.weighing is None:
        run.state.weighing = empty_pools(len(run.names))
        poses = np.concatenate([pool.poses for pool in run.pools])
    price_poses(
        columns.shared,
        run.state.weighing,
        derive_seed(run.seed, ["weighing"]),
        run.effort.pricing_rounds,
        run.executor,
        run.callbacks.silent,
        WarmStart(poses),
        run.checkpoint(),
    )


class ProofColumns:
    """The columns that the proof's weights come from: those of the plan, or of a request without some conditions."""

    def __init__(self, run: Run):
        self._run = run

    @cached_property
    def relaxed(self) -> Request | None:
        """The request without the conditions that the proof does not use; None if it has none."""
        request = self._run.request
        need = request.requirements
        showing = replace(need.showing, separation_px=0.0, min_corner_deg=0.0)
        if showing == need.showing and need.cell is None:
            return None
        return replace(request, requirements=replace(need, showing=showing, cell=None))

    @cached_property
    def shared(self) -> Shared:
        """The judge of that request."""
        assert self.relaxed is not None
        return Shared(Judge(self.relaxed, self._run.effort))

    @property
    def _pools(self) -> Pools:
        state = self._run.state
        return state.pools if state.weighing is None else state.weighing

    @property
    def membership(self) -> np.ndarray:
        """Columns (c, k)."""
        return self._pools.realised.membership

    def join(self, poses: np.ndarray, seed: int) -> None:
        """Add what the proof came across to these columns, and to the plan's."""
        run = self._run
        joining = run.effort.stages.joining
        rounds = joining.rounds_for(len(run.pool))
        silent = run.callbacks.silent
        start = WarmStart(poses)
        weighing = run.state.weighing
        # what is found without some conditions seldom meets them
        own = rounds if weighing is None else joining.rounds
        price_poses(run.shared, run.pools, seed, own, run.executor, silent, start)
        if weighing is not None:
            price_poses(self.shared, weighing, seed, rounds, run.executor, silent, start)
