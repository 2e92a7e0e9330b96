"""A given pose as a sensor setting: what it inspects, how surely, and with what margins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.request.request import Request
from planner.setting.sensor_setting import SensorSetting


def setting_at(
    request: Request,
    cam2world: np.ndarray,
    names: Sequence[str],
    message: str,
    seed: int | None = None,
    nfev: int = 1,
) -> SensorSetting:
    """Describe a pose as a setting that inspects some of the entities of a request.

    Parameters
    ----------
    request : Request
        What is asked.
    cam2world : array (4, 4)
        The pose.
    names : sequence of str
        The entities it is to inspect.
    message : str
        Where it comes from.
    seed : int, optional
        Seed of the work that found it.
    nfev : int
        Poses evaluated for it.

    Returns
    -------
    SensorSetting
        With the probabilities and margins of these entities; whether they suffice is not asked.
    """
    pose = np.asarray(cam2world)[None]
    own = request.at_pose(pose[0], names)
    # what a request without a choice has made already
    modelled = own if request.has_choice else request
    idx = [modelled.names.index(name) for name in names]
    wanted = np.isin(np.arange(len(modelled.names)), idx)[None]
    probability = modelled.objective.probability_where(pose, wanted)
    by_idx = dict(zip(sorted(idx), probability.tolist(), strict=True))
    margins = own.constraints.margins(pose)
    return SensorSetting(
        cam2world=cam2world,
        entities=tuple(names),
        probability={name: by_idx[i] for name, i in zip(names, idx, strict=True)},
        margins={name: float(margin.min()) for name, margin in margins.items()},
        fitness=float(sum(by_idx.values())),
        nfev=nfev,
        generations=0,
        message=message,
        seed=seed,
        witness={name: own.chosen[name] for name in names if name in own.chosen},
        registered=own.known_at(pose[0], names),
    )


def without(request: Request, setting: SensorSetting, names: Sequence[str]) -> SensorSetting:
    """Return a setting without some of its entities; of the others it states what it stated.

    Parameters
    ----------
    request : Request
        What is asked.
    setting : SensorSetting
        The setting.
    names : sequence of str
        The entities it loses.

    Returns
    -------
    SensorSetting
        The same pose; its margins are those of what is left.
    """
    kept = tuple(name for name in setting.entities if name not in names)
    if not kept:
        return replace(setting, entities=(), probability={}, p_all={}, registered=None)
    fewer = setting_at(
        request, setting.cam2world, kept, setting.message, seed=setting.seed, nfev=setting.nfev
    )
    stated = {name: setting.probability[name] for name in kept}
    counted = {name: setting.p_all[name] for name in kept if name in setting.p_all}
    return replace(
        fewer,
        generations=setting.generations,
        probability=stated,
        p_all=counted,
        # all of them held together, so fewer of them did
        p_all_together=setting.p_all_together,
        p_all_poses=setting.p_all_poses,
    )
