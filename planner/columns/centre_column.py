"""The margin step for one setting, as a task for any executor, and what the moved pose promises."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from planner.camera.pose import pose_between
from planner.columns.judge import Judge
from planner.columns.realise_column import best_supported, joint_counts, keeps
from planner.effort.poses import Centring
from planner.executors import Shared
from planner.setting.centre import centred, least_share
from planner.setting.pose_setting import setting_at
from planner.setting.sensor_setting import SensorSetting
from planner.verify.p_all import DisplacedChecks

_MOVED = "moved off its limits"
# displaced poses in which a moved pose may not do worse, and those displaced twice as far
_NEAR_POSES = 1000
_FAR_POSES = 400
_FAR_SIGMAS = 2.0
_WORSE = 0.01
# of the way to a pose that loses, one after the other
_PARTS = (0.5, 0.25, 0.125)


def centre_setting(
    shared: Shared,
    setting: SensorSetting,
    seed: int,
    poses: int,
    centring: Centring,
    settings: int = 1,
    until: float = math.inf,
) -> SensorSetting:
    """Move a setting off its limits, and count what it promises.

    Parameters
    ----------
    shared : Shared of Judge
        Holds the request.
    setting : SensorSetting
        A setting that simulation supports.
    seed : int
        Of the search, and of the displaced poses.
    poses : int
        Displaced poses to count over, at least.
    centring : Centring
        How long to search.
    settings : int
        How many settings share the trials that the effort allows a plan.
    until : float
        When the search ends, as `time.time` counts: a setting whose turn comes later stays where it is.

    Returns
    -------
    SensorSetting
        For the same targets, with their P_all.
    """
    judge: Judge = shared.value
    late = time.time() > until
    loses = _Losses(judge, setting, seed, centring.give_up)
    for pose in () if late else _off_limits(judge, setting, seed, centring):
        if time.time() > until:
            break
        if not _inspects(judge, pose, setting.entities):
            continue
        own = setting_at(judge.request, pose, setting.entities, _MOVED, seed=setting.seed)
        if not loses(own):
            setting = best_supported(judge, [own, setting], seed, settings).setting
            break
    return with_p_all(judge, setting, seed, poses)


def _off_limits(
    judge: Judge, setting: SensorSetting, seed: int, centring: Centring
) -> Iterator[np.ndarray]:
    """Yield poses with a larger least share: a line may come into view beyond a cliff.

    The first is the best one of a search. Where it loses something, poses on the way to it follow, and at last the best
    one nearby: a second search of full length would take as long as the first, and mostly lose the same.
    """
    request = judge.request.at_pose(setting.cam2world, setting.entities)
    start = setting.cam2world
    best = centred(request, start, centring, seed)
    if (best == start).all():
        return
    yield best
    before = least_share(request, start)
    for part in _PARTS if before is not None else ():
        between = pose_between(start, best, part)
        after = least_share(request, between)
        if before is not None and after is not None and after.share > before.share:
            yield between
    near = centred(request, start, replace(centring, steps=centring.steps[-1:]), seed)
    if (near != start).any():
        yield near


def with_p_all(judge: Judge, setting: SensorSetting, seed: int, poses: int) -> SensorSetting:
    """Return a setting with the P_all of its targets, counted over so many displaced poses at least."""
    if not setting.entities:
        return setting
    counts = joint_counts(judge, setting.cam2world, setting.entities, seed, poses)
    sure = judge.effort.support.joint_sure_poses
    if poses < sure and not all(keeps(judge, lower) for lower in counts.lower.values()):
        counts = joint_counts(judge, setting.cam2world, setting.entities, seed, sure)
    # no more is promised than the model says of the error alone
    stated = {name: min(counts.lower[name], setting.probability[name]) for name in counts.names}
    together = min(counts.lower_together, *stated.values())
    return replace(setting, p_all=stated, p_all_together=together, p_all_poses=counts.n)


def _inspects(judge: Judge, pose: np.ndarray, names: Sequence[str]) -> bool:
    judged = judge(pose[None]).inspects[0]
    return bool(judged[np.isin(judge.names, names)].all())


class _Losses:
    """Tells whether a target is measured less often from a moved pose: by more than is given up, or far away.

    Both poses are displaced by the same draws.

    Parameters
    ----------
    judge : Judge
        Holds the request.
    before : SensorSetting
        The setting as it was.
    seed : int
        Of the displaced poses.
    give_up : float
        Share of them that may be lost.
    """

    def __init__(self, judge: Judge, before: SensorSetting, seed: int, give_up: float):
        self._judge = judge
        self._before = before
        self._seed = seed
        self._counts = ((1.0, _NEAR_POSES, give_up), (_FAR_SIGMAS, _FAR_POSES, _WORSE))
        self._known: dict[float, np.ndarray] = {}

    def __call__(self, after: SensorSetting) -> bool:
        for sigmas, poses, lost in self._counts:
            if sigmas not in self._known:
                self._known[sigmas] = self._times_measured(self._before, sigmas, poses)
            now = self._times_measured(after, sigmas, poses)
            if (self._known[sigmas] - now > lost * poses + 1).any():
                return True
        return False

    def _times_measured(self, setting: SensorSetting, sigmas: float, poses: int) -> np.ndarray:
        """Return in how many poses, displaced so many times as far, each target of a setting is measured (k,)."""
        asked = self._judge.request
        wide = type(asked.pose_uncertainty)(sigmas**2 * asked.pose_uncertainty.covariance)
        own = asked.at_pose(setting.cam2world, setting.entities)
        checks = DisplacedChecks(replace(own, pose_uncertainty=wide), setting.entities)
        return np.array(checks.count(setting.cam2world, poses, self._seed).successes)
