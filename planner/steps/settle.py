"""Last step: the final cover is chosen, and every setting in it gets the best pose that simulation supports.

That pose is moved off its limits, and what it promises is counted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.columns.candidates import derive_seed
from planner.columns.centre_column import centre_setting
from planner.columns.realise_column import best_supported, without_contradicted
from planner.cover.few_columns import few_columns
from planner.executors import in_order
from planner.setting.pose_setting import setting_at, without
from planner.setting.reason import Reason, ReasonKind
from planner.setting.sensor_setting import SensorSetting
from planner.steps.run import Run
from planner.verify.p_all import MOST_REQUIRED


def settle(run: Run, inspected: np.ndarray) -> list[SensorSetting]:
    """Choose the final cover and give every column in it the best pose that simulation supports.

    Parameters
    ----------
    run : Run
        Its pools hold the columns.
    inspected : array of bool (k,)
        Entities that are to be covered.
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
    sets = [run.names_of(pool.membership[c]) for c in chosen]
    settings = []
    for c, names, outcome in zip(chosen, sets, run.realise(sets), strict=True):
        seed = derive_seed(run.seed, names)
        found = outcome.setting
        options = [setting_at(request, pool.poses[c], names, "candidate pose", seed=seed)]
        if found is not None and _holds(run, found, names):
            options.insert(
                found.fitness < options[0].fitness - run.effort.stages.preference.fitness_gain,
                found,
            )
        settings.append(best_supported(run.judge, options, seed))
    moved = centre_all(run, without_contradicted(run.judge, settings, run.seed))
    return _without_short(run, moved)


def _without_short(run: Run, settings: Sequence[SensorSetting]) -> list[SensorSetting]:
    """Take from settings the targets that lack the required P_all there.

    A target that has it in no setting is not inspected, and the reason is kept. Every plan for the
    others and one setting for each target lost is a plan for all of them, so the bound falls by their number.
    """
    threshold = min(run.request.probability, MOST_REQUIRED)
    short = [{n for n, p in one.p_all.items() if p < threshold} for one in settings]
    kept = {
        name
        for one, missing in zip(settings, short, strict=True)
        for name in one.entities
        if name not in missing
    }
    lost: dict[str, float] = {}
    for one, missing in zip(settings, short, strict=True):
        for name in missing - kept:
            lost[name] = max(one.p_all[name], lost.get(name, 0.0))
    for name, reached in lost.items():
        run.state.uninspectable[name] = Reason.of(
            ReasonKind.PROBABILITY_TOO_LOW,
            f"the best pose found reaches P_all = {reached:.4f} when all conditions count, below the required "
            f"{run.request.probability:g}.",
        )
    run.state.bound = max(run.state.bound - len(lost), min(1, len(kept)))
    fewer = [
        without(run.request, one, sorted(missing)) if missing else one
        for one, missing in zip(settings, short, strict=True)
    ]
    return [one for one in fewer if one.entities]


def centre_all(run: Run, settings: Sequence[SensorSetting]) -> list[SensorSetting]:
    """Move settings off their limits, and count what they promise.

    Parameters
    ----------
    run : Run
        Its request says what is asked.
    settings : sequence of SensorSetting
        Settings that simulation supports.

    Returns
    -------
    list of SensorSetting
        In the same order, for the same targets.
    """
    support = run.effort.support
    poses = min(
        support.joint_sure_poses,
        max(support.joint_all_poses // max(len(settings), 1), support.joint_poses),
    )
    tasks = [
        (run.shared, setting, derive_seed(run.seed, setting.entities), poses)
        for setting in settings
    ]
    moved = []
    for setting in in_order(run.executor, centre_setting, tasks, run.callbacks.check):
        moved.append(setting)
        run.callbacks.report(len(moved), len(settings), "margins")
    return moved


def _holds(run: Run, setting: SensorSetting, names: tuple[str, ...]) -> bool:
    """Judge a setting anew: whether it inspects all these entities."""
    return bool(run.judge(setting.cam2world[None]).inspects[0, np.isin(run.names, names)].all())
