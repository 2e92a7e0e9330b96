"""Putting a plan together from settings, at the end of a run or on the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from planner.plan import InspectionPlan
from planner.request.request import Request
from planner.request.witnesses import witness_reasons
from planner.setting.reason import Reason, ReasonKind
from planner.setting.sensor_setting import SensorSetting
from planner.steps.lines_in_window import with_lines_in_windows
from planner.steps.reached_settings import in_order_of_arm
from planner.steps.run import Run
from planner.travel import order_by, pose_distances
from planner.wanted.models import Means
from planner.wanted.planned import PlannedDimension, planned
from planner.wanted.targets import Target

# of entities that have neither a pose nor a reason for that yet
_NOT_YET = Reason.of(ReasonKind.NOT_FOUND_YET, "planning stopped early.")

_LATE = Reason.of(
    ReasonKind.NOT_FOUND_YET,
    "the time limit ended before the program knew from where it is visible.",
)


def assembled(
    run: Run,
    settings: Sequence[SensorSetting],
    bound: int,
    proof: str,
    *,
    unfinished: bool = False,
) -> InspectionPlan:
    """Put the plan together, its settings in the order of travel.

    Parameters
    ----------
    run : Run
        Its request, and its reasons for what is not inspected.
    settings : sequence of SensorSetting
    bound : int
        Settings that are needed at least.
    proof : str
        What that rests on.
    unfinished : bool
        The run goes on.
    """
    request = run.request
    # a later run may have come across a view of one that had none of its own
    seen = {name for setting in settings for name in setting.entities}
    if not unfinished:
        settings = [with_passed_over(request, setting) for setting in settings]
    cell = request.requirements.cell
    found = InspectionPlan(
        settings=tuple(_in_order(request, settings, unfinished)),
        lower_bound=bound,
        bound_proof=proof,
        uninspectable=_reasons(run, unfinished, seen),
        entities=dict(zip(request.names, request.ends, strict=True)),
        camera=request.camera,
        pose_uncertainty=request.pose_uncertainty,
        accuracy=request.accuracy,
        probability=request.probability,
        workspace=np.asarray(request.space.workspace, dtype=float),
        part=request.space.solid.name,
        seed=run.seed,
        dimensions={n: t for n, t in request.measured.items() if isinstance(t, PlannedDimension)},
        requirements=request.requirements.to_dict(),
        request=run.memo.identity,
        unfinished=unfinished,
        cell={} if cell is None else cell.to_dict(),
    )
    return with_lines_in_windows(found, request)


def with_passed_over(request: Request, setting: SensorSetting) -> SensorSetting:
    """Return a setting that says why it uses none of the other witnesses of its targets."""
    if not setting.witness:
        return setting
    some = request.restricted_to(list(setting.witness))
    why = witness_reasons(some.witnesses, setting.cam2world)
    over = {
        target.name: {
            ", ".join(witness.entities): reason
            for k, (witness, reason) in enumerate(zip(target.witnesses, reasons, strict=True))
            if k != setting.witness[target.name]
        }
        for target, reasons in zip(some.targets, why, strict=True)
    }
    return replace(setting, passed_over=over)


def _in_order(
    request: Request, settings: Sequence[SensorSetting], unfinished: bool
) -> Sequence[SensorSetting]:
    """Return settings in the order of travel, by the joints of a robot where there is one."""
    if request.requirements.cell is not None:
        return in_order_of_arm(request, settings, unfinished=unfinished)
    # a better plan follows soon, so its travel is not worth seconds
    distances = pose_distances(np.array([s.cam2world for s in settings]).reshape(-1, 4, 4))
    order = order_by(distances, starts=1) if unfinished else order_by(distances)
    return [settings[i] for i in order]


def needed(target: Target) -> set[str]:
    """Return the names of all entities whose regions a target needs."""
    return {name for witness in target.witnesses for name in witness.entities}


def with_late_targets(
    plan: InspectionPlan, targets: Sequence[Target], means: Means
) -> InspectionPlan:
    """Return a plan with a reason for each target that it does not know, since its region was not complete in time.

    Parameters
    ----------
    plan : InspectionPlan
        A plan for some of the targets.
    targets : sequence of Target
        All targets of the request.
    means : Means
        What they are measured with.

    Returns
    -------
    InspectionPlan
        It is ``unfinished`` if a target was late; otherwise it is the plan itself.
    """
    late = [target.name for target in targets if target.name not in plan.entities]
    if not late:
        return plan
    measured = {target.name: planned(target, means) for target in targets}
    return replace(
        plan,
        unfinished=True,
        uninspectable={**plan.uninspectable, **dict.fromkeys(late, _LATE)},
        entities={target.name: target.witnesses[0].ends for target in targets},
        dimensions={n: t for n, t in measured.items() if isinstance(t, PlannedDimension)},
    )


def _reasons(run: Run, unfinished: bool, seen: set[str]) -> Mapping[str, Reason]:
    """Return why entities are not inspected, in the order in which that was found out."""
    reasons = dict(run.state.uninspectable)
    if unfinished:
        reasons = {name: reasons.get(name, _NOT_YET) for name in run.names}
    return {name: reason for name, reason in reasons.items() if name not in seen}
