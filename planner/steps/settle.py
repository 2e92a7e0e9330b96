"""Last step: the final cover is chosen, and every setting in it gets the best pose that simulation supports."""

from __future__ import annotations

import numpy as np

from planner.columns.candidates import derive_seed
from planner.columns.realise_column import best_supported, without_contradicted
from planner.cover.few_columns import few_columns
from planner.setting.pose_setting import setting_at
from planner.setting.sensor_setting import SensorSetting
from planner.steps.run import Run


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
    return without_contradicted(run.judge, settings, run.seed)


def _holds(run: Run, setting: SensorSetting, names: tuple[str, ...]) -> bool:
    """Judge a setting anew: whether it inspects all these entities."""
    return bool(run.judge(setting.cam2world[None]).inspects[0, np.isin(run.names, names)].all())
