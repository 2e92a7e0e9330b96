"""What lamps are asked besides the faces beside edges: that measuring finds enough of each target."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera
from planner.request.targets import Target

Array = NDArray[np.float64]


class TargetReads(Protocol):
    """What measuring will find of a target in a setting."""

    @property
    def reason(self) -> str:
        """Why no lamp helps; empty if one may."""

    def shown(self, lamps: Array) -> NDArray[np.bool_]:
        """Return under which lamps (n, 3), of which one is on, enough of the target is found."""

    def white(self, lamps: Array) -> Array:
        """Return the irradiance (n,) that is overexposed if the image is exposed for the target, 1/mm²."""


class Reads(Protocol):
    """What measuring will find in images of a part under lamps, so that a plan promises no more than is read."""

    def of_target(
        self, cam2world: Array, camera: Camera, target: Target, background: float
    ) -> TargetReads:
        """Return what will be found of a target from a pose, before a background that is 0 or 1."""

    def reserve(
        self, cam2world: Array, camera: Camera, lamps: Array, background: float, whites: Array
    ) -> Array:
        """Return how much more of the part's edges lamps (n, 3) show than an image needs to be registered, as a share.

        Images are exposed so that irradiances (n, p) are white. A negative share (n, p) is too little.
        """

    def unread(self, cam2world: Array, camera: Camera, target: Target, area: Any) -> str:
        """Return why too little of a target is found under a light with an area; empty if enough is."""
