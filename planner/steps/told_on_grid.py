"""What is stated of edges that simulation contradicts in the settings chosen for them: what the pixel grid says.

Where the tolerance is less than two pixels, the density may promise too much of one pose. If what is counted on the
grid is still enough, less is promised; only else another pose has to be found (`planner.steps.pixel_grid`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.request.pixel_grid import lowered
from planner.setting.pose_setting import setting_at
from planner.setting.sensor_setting import SensorSetting
from planner.steps.pixel_grid import contradicted, frequencies
from planner.steps.run import Run


class Told(NamedTuple):
    """Settings with what is stated now.

    Attributes
    ----------
    settings : list of SensorSetting
        The same poses; without an edge where it is not sure enough but is in another one.
    counted : tuple of str
        Edges whose probability is that of the grid now.
    wrong : list of str
        Edges that are sure enough in none of the settings; they are left as they were.
    """

    settings: list[SensorSetting]
    counted: tuple[str, ...]
    wrong: list[str]


def told_on_grid(run: Run, settings: Sequence[SensorSetting]) -> Told:
    """Return settings that state what was counted on the pixel grid, of edges that simulation contradicts.

    Parameters
    ----------
    run : Run
        Its request, and its seed for the simulation.
    settings : sequence of SensorSetting
        What was chosen.
    """
    found, counted, wrong = list(settings), [], []
    for name in contradicted(run, settings):
        rows = [k for k, setting in enumerate(found) if name in setting.entities]
        poses = np.array([found[k].cam2world for k in rows])
        stated = lowered(frequencies(run, run.names.index(name), poses))
        if not (stated >= run.request.probability).any():
            wrong.append(name)
            continue
        counted.append(name)
        for k, probability in zip(rows, stated.tolist(), strict=True):
            if probability >= run.request.probability:
                found[k] = replace(
                    found[k], probability={**found[k].probability, name: probability}
                )
            else:
                found[k] = without(run, found[k], [name])
    return Told([setting for setting in found if setting.entities], tuple(counted), wrong)


def without(run: Run, setting: SensorSetting, names: Sequence[str]) -> SensorSetting:
    """Return a setting without some of its entities; of the others it states what it stated."""
    kept = tuple(name for name in setting.entities if name not in names)
    if not kept:
        return replace(setting, entities=(), probability={})
    fewer = setting_at(
        run.request, setting.cam2world, kept, setting.message, seed=setting.seed, nfev=setting.nfev
    )
    stated = {name: setting.probability[name] for name in kept}
    return replace(fewer, generations=setting.generations, probability=stated)
