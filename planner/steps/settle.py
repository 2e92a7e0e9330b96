"""Last step: the final cover is chosen, and every setting in it gets the best pose that simulation supports.

That pose is moved off its limits, and what it promises is counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.columns.candidates import derive_seed
from planner.columns.centre_column import centre_setting
from planner.columns.realise_column import Supported, without_contradicted
from planner.cover.few_columns import few_columns
from planner.effort.poses import Centring
from planner.executors import in_order
from planner.plan import InspectionPlan
from planner.progress import report
from planner.setting.pose_setting import setting_at, without
from planner.setting.reason import Reason, ReasonKind
from planner.setting.sensor_setting import SensorSetting
from planner.steps.reached_settings import in_order_of_arm
from planner.steps.retry import Centre, ShortTargets
from planner.steps.run import Run
from planner.verify.p_all import MOST_REQUIRED

Proven = Callable[[Run, Sequence[SensorSetting]], tuple[int, str]]


class Settled(NamedTuple):
    """The settings of the final cover.

    Attributes
    ----------
    settings : list of SensorSetting
        With what they promise.
    lost : dict of str to Reason
        Targets of the cover that have the required P_all in none of them.
    """

    settings: list[SensorSetting]
    lost: dict[str, Reason]


def settle(run: Run, inspected: np.ndarray, *, moves: bool = True) -> Settled:
    """Choose the final cover and give every column in it the best pose that simulation supports.

    Parameters
    ----------
    run : Run
        Its pools hold the columns.
    inspected : array of bool (k,)
        Entities that are to be covered.
    moves : bool
        Whether the poses are moved off their limits.
    """
    pool = run.pool
    request = run.request
    chosen = few_columns(
        pool.membership[:, inspected],
        run.nodes(),
        run.rng("settings"),
        pool.quality,
        run.effort.cover,
    )
    candidates = [
        setting_at(
            request, pool.poses[c], names, "candidate pose", seed=derive_seed(run.seed, names)
        )
        for c, names in ((c, run.names_of(pool.membership[c])) for c in chosen)
    ]
    settings = without_contradicted(request, _supported(run, candidates))
    centring = run.effort.centring
    if not moves:
        centring = replace(centring, give_up=0.0)

    def centre(some: Sequence[SensorSetting]) -> list[SensorSetting]:
        return centre_all(run, some, centring)

    return _without_short(run, centre(settings), centre)


def _supported(run: Run, candidates: Sequence[SensorSetting]) -> list[Supported]:
    """Return for each candidate pose the best pose that simulation supports, the candidate itself if it is enough."""
    enough = run.effort.stages.preference.enough
    good = [k for k, one in enumerate(candidates) if min(one.probability.values()) > enough]
    # what was simulated on the way is not simulated again
    for _ in run.simulate([candidates[k] for k in good]):
        pass
    plain = [k for k in good if not run.promises.contradicted_in(candidates[k])]
    kept = {k: Supported(candidates[k], frozenset(candidates[k].entities)) for k in plain}
    rest = [k for k in range(len(candidates)) if k not in kept]
    searched = _searched(run, [candidates[k] for k in rest])
    kept.update(zip(rest, searched, strict=True))
    return [kept[k] for k in range(len(candidates))]


def _searched(run: Run, candidates: Sequence[SensorSetting]) -> list[Supported]:
    """Search a better pose for each candidate pose, and return the better one that simulation supports."""
    gain = run.effort.stages.preference.fitness_gain
    options = []
    outcomes = run.realise([one.entities for one in candidates])
    for candidate, outcome in zip(candidates, outcomes, strict=True):
        found = outcome.setting
        both = [candidate]
        if found is not None and _holds(run, found, candidate.entities):
            both.insert(found.fitness < candidate.fitness - gain, found)
        options.append(both)
    return run.supported(options)


def settle_early(run: Run, plan: InspectionPlan, proven: Proven) -> InspectionPlan:
    """Return a plan that a time limit ended with its settings moved off their limits, and what they promise.

    Parameters
    ----------
    run : Run
        Its request says what is asked.
    plan : InspectionPlan
        The best plan so far.
    proven : callable
        ``proven(run, settings)`` returns the bound for what settings inspect, and what it rests on.
    """
    moved = centre_all(
        run,
        plan.settings,
        run.effort.centring.shorter(),
        until=run.callbacks.deadline.of_settling(),
    )
    settled = _without_short(run, moved)
    settings = settled.settings
    if run.request.requirements.cell is not None:
        settings = in_order_of_arm(run.request, settings, unfinished=True)
    bound, proof = proven(run, settings)
    return replace(
        plan,
        settings=tuple(settings),
        lower_bound=bound,
        bound_proof=proof,
        uninspectable={**plan.uninspectable, **settled.lost},
    )


def _without_short(
    run: Run, settings: Sequence[SensorSetting], centre: Centre | None = None
) -> Settled:
    """Take from settings the targets that lack the required P_all there; return why some are in none any more.

    Where it is said how settings are moved off their limits, these are tried again before they are given up.
    """
    threshold = min(run.request.probability, MOST_REQUIRED)
    short = [{n for n, p in one.p_all.items() if p < threshold} for one in settings]
    fewer = [
        without(run.request, one, sorted(missing)) if missing else one
        for one, missing in zip(settings, short, strict=True)
    ]
    kept = {name for one in fewer for name in one.entities}
    reached: dict[str, float] = {}
    for one, missing in zip(settings, short, strict=True):
        for name in missing - kept:
            reached[name] = max(one.p_all[name], reached.get(name, 0.0))
    fewer = [one for one in fewer if one.entities]
    if reached and centre is not None:
        tried = ShortTargets(run, fewer, reached, centre)
        tried.retry()
        fewer = tried.settings
        reached = tried.reached
    lost = {
        name: Reason.of(
            ReasonKind.PROBABILITY_TOO_LOW,
            f"the best pose found reaches P_all = {best:.4f}, below the required "
            f"{run.request.probability:g}.",
        )
        for name, best in reached.items()
    }
    return Settled(fewer, lost)


def centre_all(
    run: Run, settings: Sequence[SensorSetting], centring: Centring, *, until: float | None = None
) -> list[SensorSetting]:
    """Move settings off their limits, and count what they promise.

    Parameters
    ----------
    run : Run
        Its request says what is asked.
    settings : sequence of SensorSetting
        Settings that simulation supports.
    centring : Centring
        How long to search.
    until : float, optional
        The time limit has passed, which is not asked again. Fewer poses are displaced, and from this time on, as
        `time.time` counts, poses are not moved.

    Returns
    -------
    list of SensorSetting
        In the same order, for the same targets.
    """
    support = run.effort.support
    poses = support.joint_poses
    early = until is not None
    if not early:
        each = support.joint_all_poses // max(sum(len(one.entities) for one in settings), 1)
        poses = min(support.joint_sure_poses, max(each, poses))
    tasks = [
        (
            run.shared,
            setting,
            derive_seed(run.seed, setting.entities),
            poses,
            centring,
            # a pose that needs a neighbour is left as it is
            support.all_trials if early else len(settings),
            math.inf if until is None else until,
        )
        for setting in settings
    ]
    check = (lambda: None) if early else run.callbacks.check
    moved = []
    for setting in in_order(run.executor, centre_setting, tasks, check):
        moved.append(setting)
        # where the time is up already, it is not asked again
        report(run.callbacks.progress, len(moved), len(settings), "margins")
    return moved


def _holds(run: Run, setting: SensorSetting, names: tuple[str, ...]) -> bool:
    """Judge a setting anew: whether it inspects all these entities."""
    return bool(run.judge(setting.cam2world[None]).inspects[0, np.isin(run.names, names)].all())
