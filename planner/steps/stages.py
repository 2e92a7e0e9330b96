"""The stages of a plan, in order.

Each stage adds to the run: columns, what excludes each other, a bound, settings. The state is kept when a stage ends,
and within the long ones. A planning that is resumed begins with the stage in which its last checkpoint was taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.columns.realise_column import without_corners
from planner.plan import InspectionPlan
from planner.setting.sensor_setting import SensorSetting
from planner.steps.assemble import assembled
from planner.steps.find_columns import (
    generate_columns,
    generate_first_columns,
    realise_missing_alone,
    sample_poses,
)
from planner.steps.incumbents import Incumbents
from planner.steps.lit_settings import with_lamps
from planner.steps.prove_bound import find_incompatible, prove_bound
from planner.steps.refute import refute
from planner.steps.run import Run
from planner.steps.settle import settle

if TYPE_CHECKING:
    from planner.light.lighting import Lighting


@dataclass
class Work:
    """What the stages hand on.

    Attributes
    ----------
    run : Run
        The pools of columns, and the checkpoints.
    incumbents : Incumbents
        The best plan so far; no stage depends on it.
    lighting : Lighting or None
        What is asked of lamps.
    inspected : array of bool (k,)
        Targets that some column inspects: the bound and the settings are for these.
    bound : int
        Settings that are needed at least.
    proof : str
        What the bound rests on.
    settings : list of SensorSetting
        The settings chosen.
    plan : InspectionPlan or None
        The plan.
    """

    run: Run
    incumbents: Incumbents
    lighting: Lighting | None = None
    inspected: NDArray[np.bool_] | None = None
    bound: int = 0
    proof: str = ""
    settings: list[SensorSetting] | None = None
    plan: InspectionPlan | None = None


class Stage(NamedTuple):
    """One stage of a plan.

    Attributes
    ----------
    run : callable
        ``run(work)`` does it, from the beginning or from its last checkpoint.
    checkpoints : tuple of str
        Steps that the checkpoints taken in it are named after; the first one is also that of its beginning. A stage
        without any begins anew with the stage before.
    """

    run: Callable[[Work], None]
    checkpoints: tuple[str, ...] = ()


def _sample(work: Work) -> None:
    sample_poses(work.run)
    work.incumbents.offer(work.run)


def _find_incompatible(work: Work) -> None:
    find_incompatible(work.run)
    work.incumbents.on_incompatible(work.run)


def _generate_first_columns(work: Work) -> None:
    run = work.run
    incumbents = work.incumbents
    generate_first_columns(run, incumbents)
    incumbents.offer(run)
    # before the columns are improved further, so that others can join what is hard to inspect
    run.uninspectable = realise_missing_alone(run, incumbents)
    incumbents.offer(run)


def _generate_columns(work: Work) -> None:
    generate_columns(work.run, work.incumbents)
    work.incumbents.offer(work.run)


def _prove_bound(work: Work) -> None:
    work.bound, work.proof = prove_bound(work.run, work.incumbents)
    work.inspected = np.asarray(work.run.pool.membership.any(axis=0))


def _refute(work: Work) -> None:
    assert work.inspected is not None
    refute(work.run, work.inspected, work.bound, work.incumbents)


def _settle(work: Work) -> None:
    assert work.inspected is not None
    work.settings = settle(work.run, work.inspected)


def _assemble(work: Work) -> None:
    assert work.settings is not None
    work.plan = assembled(work.run, work.settings, work.bound, work.proof)


def _light(work: Work) -> None:
    if work.lighting is not None and work.plan is not None:
        work.plan = with_lamps(work.run, work.lighting, work.plan)


STAGES = (
    Stage(_sample, ("sampling",)),
    Stage(_find_incompatible, ("candidate poses",)),
    Stage(_generate_first_columns, ("first columns",)),
    Stage(_generate_columns, ("column generation",)),
    Stage(_prove_bound, ("weighing", "lower bound")),
    Stage(_refute),
    Stage(_settle),
    Stage(_assemble),
    Stage(_light),
)


def run_stages(
    run: Run, incumbents: Incumbents, lighting: Lighting | None = None
) -> InspectionPlan:
    """Do all stages that are left to do, and return the plan.

    Parameters
    ----------
    run : Run
        A new one; its memo may hold the checkpoint of an earlier, interrupted one.
    incumbents : Incumbents
        Better plans on the way are offered to it.
    lighting : Lighting, optional
        What is asked of lamps.

    Returns
    -------
    InspectionPlan
        The same whether the planning was interrupted or not.
    """
    work = Work(run, incumbents, lighting)
    last = run.memo.last()
    if last is None:
        run.uninspectable = without_corners(run.judge)
        incumbents.glance(run)
    else:
        run.restore(last)
        incumbents.offer(run)
        incumbents.on_incompatible(run)
    first = 0 if last is None else stage_of(last)
    for k in range(first, len(STAGES)):
        if k > first and STAGES[k].checkpoints:
            run.keep(STAGES[k].checkpoints[0], {})
        STAGES[k].run(work)
    assert work.plan is not None
    return work.plan


def stage_of(checkpoint: dict[str, Any]) -> int:
    """Return the number of the stage in which a checkpoint was taken."""
    step = checkpoint["step"]
    return next(k for k, stage in enumerate(STAGES) if step in stage.checkpoints)
