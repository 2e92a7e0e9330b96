"""P of a setting's targets with the uncertainty that the arm has at this setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from planner.camera.pose_uncertainty import PoseUncertainty
from planner.verify.simulate_setting import SuccessRate, simulate_setting
from planner.wanted.models import EdgeModels
from planner.wanted.planned import PlannedLength, targets_of
from planner.wanted.pose_knowledge import means_at
from planner.wanted.registered.record import OWN_EDGES

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting


def stated_probabilities(
    plan: InspectionPlan, setting: SensorSetting, covariances: np.ndarray
) -> list[dict[str, float]]:
    """Return P of the targets of a setting for several covariances of the camera's pose.

    Parameters
    ----------
    plan : InspectionPlan
        Gives targets, camera and accuracy.
    setting : SensorSetting
        One of its settings.
    covariances : array (n, 6, 6)
        As `PoseUncertainty` has them.

    Returns
    -------
    list of dict of str to float
        P by target for each covariance, given that the image shows the target.
    """
    return [_probabilities(plan, _of_arm(plan, setting, one), one) for one in covariances]


def _of_arm(plan: InspectionPlan, setting: SensorSetting, covariance: np.ndarray) -> SensorSetting:
    """Return a setting whose registration begins with the uncertainty of an arm."""
    known = setting.registered
    asked = plan.request.get("registration") or {}
    if known is None or asked.get("method") != OWN_EDGES:
        return setting
    return replace(
        setting, registered=known.with_prior(plan.pose_uncertainty.covariance, covariance)
    )


def _probabilities(
    plan: InspectionPlan, setting: SensorSetting, covariance: np.ndarray
) -> dict[str, float]:
    by_arm = replace(plan.means, pose_uncertainty=PoseUncertainty(covariance))
    targets = targets_of(plan.targets, setting)
    found = {}
    for name in setting.entities:
        target = targets[name]
        means = means_at(by_arm, setting, name)
        if isinstance(target, PlannedLength):
            own = replace(means, accuracy=target.accuracy)
            model = EdgeModels(target.ends[None], own)
            seen = model.probability_where(setting.cam2world[None], np.ones((1, 1), dtype=bool))
            found[name] = float(seen[0])
        else:
            found[name] = float(target.describe(setting.cam2world, means).probability)
    return found


def shortfalls(probabilities: Sequence[dict[str, float]]) -> np.ndarray:
    """Return how much worse each of several branches is than the best: 0 for the best, at most 1.

    Parameters
    ----------
    probabilities : sequence of dict of str to float
        P by target for each branch.

    Returns
    -------
    array (n,)
        Differences of the smallest P.
    """
    worst = np.array([min(found.values(), default=1.0) for found in probabilities])
    return worst.max(initial=0.0) - worst


def simulated_rates(
    plan: InspectionPlan,
    setting: SensorSetting,
    stated: Mapping[str, float],
    covariance: np.ndarray,
    n: int,
    seed: list[int],
) -> dict[str, SuccessRate]:
    """Measure the targets of a setting from displaced poses of an arm.

    Parameters
    ----------
    plan : InspectionPlan
        Gives targets, camera and accuracy.
    setting : SensorSetting
        One of its settings.
    stated : mapping of str to float
        P by target, which the result is compared with.
    covariance : array (6, 6)
        Of the camera's pose with this arm.
    n : int
        Displaced poses.
    seed : list of int
        Of these poses.

    Returns
    -------
    dict of str to SuccessRate
        By target. A target outside of the image counts as a failure.
    """
    return simulate_setting(
        replace(_of_arm(plan, setting, covariance), probability=dict(stated), p_all={}),
        plan.targets,
        plan.camera,
        PoseUncertainty(covariance),
        accuracy=plan.accuracy,
        n=n,
        rng=np.random.default_rng(seed),
    )
