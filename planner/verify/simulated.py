"""What a simulation needs to know of a plan, and of a setting: rooms above this one have both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty


class Posed(Protocol):
    """A pose and what is measured from it, such as a `SensorSetting`."""

    @property
    def cam2world(self) -> np.ndarray:
        """The pose, (4, 4)."""

    @property
    def entities(self) -> Sequence[str]:
        """Names of what is measured."""

    @property
    def probability(self) -> Mapping[str, float]:
        """Promised probability by name."""


class Planned(Protocol):
    """Settings and what they are for, such as an `InspectionPlan`."""

    @property
    def settings(self) -> Sequence[Posed]:
        """The settings, in order."""

    @property
    def targets(self) -> Mapping[str, Any]:
        """What is measured, by name, as `PlannedTarget`."""

    @property
    def camera(self) -> Camera:
        """The camera."""

    @property
    def pose_uncertainty(self) -> PoseUncertainty:
        """How far the camera may be from where it should be."""

    @property
    def accuracy(self) -> float:
        """Accuracy asked of lengths."""

    @property
    def requirements(self) -> Mapping[str, float]:
        """Limits of the plan by name."""
