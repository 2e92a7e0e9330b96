"""The margin step for one setting, as a task for any executor, and what the moved pose promises."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from planner.camera.pose import pose_between
from planner.camera.pose_uncertainty import PoseUncertainty
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
    shared: Shared, setting: SensorSetting, seed: int, poses: int, centring: Centring
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

    Returns
    -------
    SensorSetting
        For the same targets, with their P_all.
    """
    judge: Judge = shared.value
    for pose in _off_limits(judge, setting, seed, centring):
        if not _inspects(judge, pose, setting.entities):
            continue
        own = setting_at(judge.request, pose, setting.entities, _MOVED, seed=setting.seed)
        if not _loses(judge, setting, own, seed, centring.give_up):
            setting = best_supported(judge, [own, setting], seed)
            break
    return with_p_all(judge, setting, seed, poses)


def _off_limits(
    judge: Judge, setting: SensorSetting, seed: int, centring: Centring
) -> Iterator[np.ndarray]:
    """Yield poses with a larger least share, the best first: a line may come into view beyond a cliff."""
    request = judge.request.at_pose(setting.cam2world, setting.entities)
    start = setting.cam2world
    found = []
    for first in range(len(centring.steps)):
        shorter = replace(centring, steps=centring.steps[first:])
        pose = centred(request, start, shorter, seed)
        if (pose != start).any():
            found.append(pose)
            yield pose
    before = least_share(request, start)
    for part, pose in itertools.product(_PARTS if before else (), found[:1]):
        between = pose_between(start, pose, part)
        after = least_share(request, between)
        if before is not None and after is not None and after.share > before.share:
            yield between


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


def _loses(
    judge: Judge, before: SensorSetting, after: SensorSetting, seed: int, give_up: float
) -> bool:
    """Tell whether a target is measured less often from a moved pose: by more than is given up, or far away.

    Both poses are displaced by the same draws.
    """
    own = judge.request
    for sigmas, poses, lost in ((1.0, _NEAR_POSES, give_up), (_FAR_SIGMAS, _FAR_POSES, _WORSE)):
        wide = type(own.pose_uncertainty)(sigmas**2 * own.pose_uncertainty.covariance)
        was, now = (_times_measured(judge, one, wide, poses, seed) for one in (before, after))
        if (np.array(was) - np.array(now) > lost * poses + 1).any():
            return True
    return False


def _times_measured(
    judge: Judge, setting: SensorSetting, displaced_by: PoseUncertainty, poses: int, seed: int
) -> tuple[int, ...]:
    """Return in how many displaced poses each target of a setting is measured."""
    own = judge.request.at_pose(setting.cam2world, setting.entities)
    checks = DisplacedChecks(replace(own, pose_uncertainty=displaced_by), setting.entities)
    return checks.count(setting.cam2world, poses, seed).successes
