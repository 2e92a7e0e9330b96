"""The stages of a plan, in order.

Each stage adds to the state: columns, what excludes each other, a bound, settings. The state is kept when a stage ends,
and within the long ones. A planning that is resumed goes on with the stage that its state names.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.bound.proven import ProvenBound
from planner.columns.realise_column import without_corners
from planner.plan import InspectionPlan
from planner.steps.assemble import assembled
from planner.steps.find_columns import (
    generate_columns,
    generate_first_columns,
    realise_missing_alone,
    sample_poses,
)
from planner.steps.incumbents import Incumbents
from planner.steps.lit_settings import unlit, with_lamps
from planner.steps.plan_state import PlanState
from planner.steps.prove_bound import find_incompatible, prove_bound, weigh_columns
from planner.steps.refute import refute
from planner.steps.run import Run
from planner.steps.settle import settle

if TYPE_CHECKING:
    from planner.light.lighting import Lighting


@dataclass(frozen=True)
class Tools:
    """What the stages work with.

    Attributes
    ----------
    run : Run
        The request, and what searches and remembers.
    incumbents : Incumbents
        The best plan so far; no stage depends on it.
    lighting : Lighting or None
        What is asked of lamps.
    """

    run: Run
    incumbents: Incumbents
    lighting: Lighting | None = None


class Stage(NamedTuple):
    """One stage of a plan.

    Attributes
    ----------
    name : str
        What the state calls it.
    run : callable
        ``run(state, tools)`` does it, from the beginning or from where the entries of the state have got.
    """

    name: str
    run: Callable[[PlanState, Tools], None]


def _sample(state: PlanState, tools: Tools) -> None:
    sample_poses(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)


def _find_incompatible(state: PlanState, tools: Tools) -> None:
    find_incompatible(tools.run)
    tools.incumbents.on_incompatible(tools.run)


def _generate_first_columns(state: PlanState, tools: Tools) -> None:
    generate_first_columns(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)
    # before the columns are improved further, so that others can join what is hard to inspect
    state.uninspectable = realise_missing_alone(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)


def _generate_columns(state: PlanState, tools: Tools) -> None:
    generate_columns(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)


def _weigh(state: PlanState, tools: Tools) -> None:
    weigh_columns(tools.run)


def _prove_bound(state: PlanState, tools: Tools) -> None:
    proven = prove_bound(tools.run, tools.incumbents)
    state.bound = proven.n
    state.proof = proven.proof
    state.bound_of = proven.of
    state.bound_weights = proven.weights
    # poses that the proof came across may inspect more
    state.inspected = state.pools.realised.inspected


def _refute(state: PlanState, tools: Tools) -> None:
    assert state.inspected is not None
    refute(tools.run, state.inspected, state.bound, tools.incumbents)


def _settle(state: PlanState, tools: Tools) -> None:
    assert state.inspected is not None
    settled = settle(tools.run, state.inspected)
    state.uninspectable.update(settled.lost)
    kept = np.isin(tools.run.names, [n for one in settled.settings for n in one.entities])
    assert state.bound_of is not None
    proven = ProvenBound(state.bound, state.proof, state.bound_of, state.bound_weights)
    state.bound = proven.for_some(kept)
    state.plan = assembled(tools.run, settled.settings, state.bound, state.proof)


def _light(state: PlanState, tools: Tools) -> None:
    if tools.lighting is None or state.plan is None:
        return
    plan = with_lamps(tools.run, tools.lighting, state.plan)
    if unlit(plan):
        assert state.inspected is not None
        # where a pose was moved to, no lamp may light what one lights from where it was
        unmoved = settle(tools.run, state.inspected, moves=False)
        draft = assembled(tools.run, unmoved.settings, state.bound, state.proof)
        other = with_lamps(tools.run, tools.lighting, draft)
        if set(other.inspected) == set(plan.inspected) and len(unlit(other)) < len(unlit(plan)):
            plan = other
    state.plan = plan


STAGES = (
    Stage("candidate poses", _sample),
    Stage("incompatible targets", _find_incompatible),
    Stage("first columns", _generate_first_columns),
    Stage("column generation", _generate_columns),
    Stage("weighing", _weigh),
    Stage("lower bound", _prove_bound),
    Stage("refutation", _refute),
    Stage("settings", _settle),
    Stage("lamps", _light),
)


def run_stages(
    run: Run, incumbents: Incumbents, lighting: Lighting | None = None
) -> InspectionPlan:
    """Do all stages that are left to do, and return the plan.

    Parameters
    ----------
    run : Run
        A new one; its state may be that of an earlier, interrupted one.
    incumbents : Incumbents
        Better plans on the way are offered to it.
    lighting : Lighting, optional
        What is asked of lamps.

    Returns
    -------
    InspectionPlan
        The same whether the planning was interrupted or not.
    """
    state = run.state
    tools = Tools(run, incumbents, lighting)
    names = [stage.name for stage in STAGES]
    if state.stage:
        incumbents.offer(run)
        incumbents.on_incompatible(run)
    else:
        state.stage = names[0]
        state.uninspectable = without_corners(run.judge)
        incumbents.glance(run)
    for stage in STAGES[names.index(state.stage) :]:
        if stage.name != state.stage:
            state.stage = stage.name
            run.save({})
        run.callbacks.stage(stage.name)
        stage.run(state, tools)
    assert state.plan is not None
    return state.plan
