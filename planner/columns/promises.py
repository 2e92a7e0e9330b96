"""What simulation finds of what poses promise: each promise is simulated once, in any process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.columns.judge import Judge
from planner.columns.realise_column import PosedOnly, joint_bounds, missing, promised_too_much
from planner.executors import Shared
from planner.setting.sensor_setting import SensorSetting


class Found(NamedTuple):
    """What a simulation of a pose found.

    Attributes
    ----------
    excess : dict of str to float
        By how much simulation contradicts what is stated of an entity, or P_all falls short; 0 if neither.
    bounds : dict of str to (float, int)
        Lower bound of P_all, and over how many displaced poses, of entities that are not contradicted.
    """

    excess: dict[str, float]
    bounds: dict[str, tuple[float, int]]


def simulate_promises(
    shared: Shared, cam2world: np.ndarray, stated: Mapping[str, float], seed: int
) -> Found:
    """Simulate what is stated of entities at a pose, as a task for any executor.

    What comes out for an entity depends on nothing that is stated of others.

    Parameters
    ----------
    shared : Shared of Judge
        Holds the request.
    cam2world : array (4, 4)
        The pose.
    stated : mapping of str to float
        Probabilities by entity.
    seed : int
        Of the displaced poses.
    """
    judge: Judge = shared.value
    # edges see the same displaced poses, whichever they are; a dimension is displaced by draws of its own
    own = [name for name in stated if not judge.request.find_target(name).in_image]
    excess = dict.fromkeys(stated, 0.0)
    for names in (tuple(name for name in stated if name not in own), *((name,) for name in own)):
        if names:
            some = PosedOnly(cam2world, names, {name: stated[name] for name in names})
            excess.update(promised_too_much(judge, some, seed))
    kept = tuple(name for name in stated if excess[name] <= 0.0)
    bounds = joint_bounds(judge, cam2world, kept, seed) if kept else {}
    return Found({**excess, **missing(judge, bounds)}, bounds)


class Promises:
    """What is known of the promises of poses so far.

    Parameters
    ----------
    shared : Shared of Judge
        Holds the request.
    seed : int
        Of the displaced poses.
    """

    def __init__(self, shared: Shared, seed: int):
        self._shared = shared
        self._seed = seed
        self._excess: dict[tuple[bytes, str, float], float] = {}
        self._bounds: dict[tuple[bytes, str], tuple[float, int]] = {}

    def task(self, setting: SensorSetting) -> tuple[Shared, np.ndarray, dict[str, float], int]:
        """Return the arguments of `simulate_promises` for what a setting states and was not simulated."""
        pose = setting.cam2world.tobytes()
        stated = {name: setting.probability[name] for name in setting.entities}
        new = {n: p for n, p in stated.items() if (pose, n, p) not in self._excess}
        return self._shared, setting.cam2world, new, self._seed

    def take(self, setting: SensorSetting, found: Found) -> None:
        """Remember what was found of what a setting states."""
        pose = setting.cam2world.tobytes()
        for name, excess in found.excess.items():
            self._excess[pose, name, setting.probability[name]] = excess
        self._bounds.update({(pose, name): bound for name, bound in found.bounds.items()})

    def contradicted_in(self, setting: SensorSetting) -> dict[str, float]:
        """Return the entities of a setting that simulation contradicts or that lack P_all, and by how much."""
        task = self.task(setting)
        if task[2]:
            self.take(setting, simulate_promises(*task))
        pose = setting.cam2world.tobytes()
        found = {n: self._excess[pose, n, setting.probability[n]] for n in setting.entities}
        return {name: too_much for name, too_much in found.items() if too_much > 0.0}

    def with_bounds(self, setting: SensorSetting) -> SensorSetting:
        """Return a setting that states the P_all that was counted for its entities."""
        pose = setting.cam2world.tobytes()
        if not all((pose, name) in self._bounds for name in setting.entities):
            return setting
        found = {name: self._bounds[pose, name] for name in setting.entities}
        stated = {name: min(lower, setting.probability[name]) for name, (lower, _) in found.items()}
        # what is missed by one at least is missed by no more than all of them miss
        together = max(1.0 - sum(1.0 - p for p in stated.values()), 0.0)
        poses = min((n for _, n in found.values()), default=0)
        return replace(setting, p_all=stated, p_all_together=together, p_all_poses=poses)
