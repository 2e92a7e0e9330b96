"""Values of two settings simulated: both cameras are displaced, and each measures its end.

As in `planner.verify.simulate_setting`, nothing here uses error models. A face that carries entities of both ends has
one deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Position, end_groups
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.request.problem import Problem
from planner.request.registration import PoseKnowledge
from planner.request.targets import PlannedDimension, end_of
from planner.verify.joint_counts import DisplacedChecks
from planner.verify.simulate_setting import (
    SuccessRate,
    ValuePoses,
    clopper_pearson,
    displaced_poses,
    measured_errors,
)

Array = NDArray[np.float64]

_AT_ONCE = 1000


@dataclass(frozen=True, eq=False)
class SplitCameras:
    """A dimension, and the two cameras that measure an end of it each.

    Attributes
    ----------
    target : PlannedDimension
        The whole dimension, with one witness and what it has from the request.
    planned : sequence of array (4, 4)
        The pose for each end.
    knowledge : sequence of (PoseKnowledge or None)
        What registration tells of each pose, under the name of the target.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far each real pose may be from the planned one; both are independent.
    """

    target: PlannedDimension
    planned: Sequence[Array]
    knowledge: Sequence[PoseKnowledge | None]
    camera: Camera
    pose_uncertainty: PoseUncertainty

    @cached_property
    def _ends(self) -> list[PlannedDimension]:
        # where faces are is drawn here, once for both
        return [replace(end_of(self.target, k), surfaces_mm=0.0) for k in range(2)]

    @cached_property
    def _groups(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        return end_groups(self.target.measurand)

    def length_of(self, components: Array) -> Array:
        """Return errors (n,) of the value by sums of the components of both ends (n, c)."""
        if isinstance(self.target.measurand, Position):
            return np.asarray(2.0 * np.linalg.norm(components, axis=1))
        return components[:, 0]

    def _off_mm(self, rng: np.random.Generator, n: int) -> list[Array]:
        """Return how far the face of each entity of the value is off its place, (n, 3) mm each."""
        index, normals = self.target.measurand.surfaces
        faces = {
            k: rng.normal(0.0, self.target.surfaces_mm, n) for k in dict.fromkeys(index.tolist())
        }
        return [
            faces[k][:, None] * normal for k, normal in zip(index.tolist(), normals, strict=True)
        ]

    def draws(self, seed: Sequence[int]) -> SplitDraws:
        """Return a source of draws."""
        return SplitDraws(self, seed)

    def errors(self, draws: SplitDraws, poses: Sequence[Array]) -> tuple[Array, NDArray[np.bool_]]:
        """Measure the dimension from displaced poses.

        Parameters
        ----------
        draws : SplitDraws
            The source of errors.
        poses : sequence of array (n, 4, 4)
            Where each camera is.

        Returns
        -------
        error : array (n,)
            Measured value minus the real one, in the unit of the value; nan without an image.
        outside : array of bool (n,)
            Whether a point of an entity is outside its image.
        """
        n = len(poses[0])
        off_mm = self._off_mm(draws.rng, n)
        total: Any = 0.0
        outside = np.zeros(n, dtype=bool)
        is_position = isinstance(self.target.measurand, Position)
        for k, group in enumerate(self._groups):
            values = draws.values[k]
            by_surfaces = None if is_position else values.by_surfaces(self.target.name)
            off = [off_mm[entity] for entity in group]
            if by_surfaces is not None:
                off = [np.zeros((n, 3))] * len(group)
            measured = partial(
                measured_errors, self._ends[k], self.planned[k], camera=self.camera, rng=draws.rng
            )
            error, lost = measured(values.of(poses[k]), off_mm=off)
            if values.registered:
                _, lost = measured(poses[k], off_mm=off)
            total = total + error
            if by_surfaces is not None:
                total = total + draws.rng.normal(0.0, by_surfaces, (n, 1))
            outside |= lost
        return self.length_of(total), outside


class SplitDraws:
    """Draws of displaced poses and errors of both cameras.

    Parameters
    ----------
    cameras : SplitCameras
        The cameras.
    seed : sequence of int
        Repeats the draws.
    """

    def __init__(self, cameras: SplitCameras, seed: Sequence[int]) -> None:
        self._cameras = cameras
        self.rng = np.random.default_rng([*seed])
        self.values = [
            ValuePoses(pose, knowledge, [*seed, k])
            for k, (pose, knowledge) in enumerate(
                zip(cameras.planned, cameras.knowledge, strict=True)
            )
        ]

    def poses(self, n: int) -> list[Array]:
        """Return displaced poses (n, 4, 4) of each camera."""
        cameras = self._cameras
        return [
            displaced_poses(pose, cameras.pose_uncertainty, n, self.rng) for pose in cameras.planned
        ]


def split_successes(
    cameras: SplitCameras, checks: Sequence[DisplacedChecks], n: int, seed: Sequence[int]
) -> int:
    """Count how often both images show their entity as required, and the value is accurate.

    Parameters
    ----------
    cameras : SplitCameras
        The dimension and its cameras.
    checks : sequence of DisplacedChecks
        What is asked of each image, for its entity alone.
    n : int
        Displaced poses of each camera.
    seed : sequence of int
        Of the draws.
    """
    draws = cameras.draws(seed)
    hits = 0
    for start in range(0, n, _AT_ONCE):
        poses = draws.poses(min(_AT_ONCE, n - start))
        error, _ = cameras.errors(draws, poses)
        valid = np.abs(error) <= cameras.target.permitted_error
        for check, displaced in zip(checks, poses, strict=True):
            for met in check.met(displaced).values():
                valid &= met[:, 0]
        hits += int(valid.sum())
    return hits


def checks_of(problem: Problem, cam2world: Array, name: str) -> DisplacedChecks:
    """Return what is asked of the image of a pose for one target of a request."""
    return DisplacedChecks(problem.at_pose(cam2world, [name]), [name])


def cameras_of(plan: Any, name: str) -> SplitCameras:
    """Return the cameras of a dimension that a plan measures in two settings."""
    ends = plan.ends[name]
    settings = [plan.settings[ends[k]] for k in range(2)]
    target = plan.targets[name]
    if name in settings[0].witness:
        target = target.choosing(settings[0].witness[name])
    return SplitCameras(
        target,
        [np.asarray(setting.cam2world, dtype=np.float64) for setting in settings],
        [setting.registered for setting in settings],
        plan.camera,
        plan.pose_uncertainty,
    )


def simulate_split(
    plan: Any, name: str, n: int, seed: Sequence[int], confidence: float
) -> SuccessRate:
    """Simulate a dimension that a plan measures in two settings.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    name : str
        The dimension.
    n : int
        Displaced poses of each camera.
    seed : sequence of int
        Of the draws.
    confidence : float
        Of the interval.

    Returns
    -------
    SuccessRate
        How often the value is accurate, and both entities are in their images.
    """
    cameras = cameras_of(plan, name)
    draws = cameras.draws(seed)
    hits = lost = 0
    for start in range(0, n, _AT_ONCE):
        error, outside = cameras.errors(draws, draws.poses(min(_AT_ONCE, n - start)))
        hits += int(((np.abs(error) <= cameras.target.permitted_error) & ~outside).sum())
        lost += int(outside.sum())
    return SuccessRate(
        hits,
        n,
        *clopper_pearson(hits, n, confidence),
        confidence,
        lost,
        plan.split[name].probability,
    )
