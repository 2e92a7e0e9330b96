"""The error models of targets: how probable it is that a value is measured accurately from a pose.

The paper (eqs 6–9) turns the object about the origin of its camera frame, which lies on the image plane, the image
distance d away from the nodal point about which a camera pose turns. To first order the two differ by a translation
that goes into the covariance; the second-order rest, d·φ²/2 along the axis, lowers the true P by 0.004 at 3°. It can
be avoided: P does not change when the image plane and its pixels shrink together towards the nodal point. So the
image is taken at a thousandth of d, with pixels a thousandth as large, where both centres of rotation are one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

import errors
from planner.camera.camera import Camera
from planner.camera.pose import cam_to_paper, world_to_cam
from planner.camera.pose_uncertainty import PoseUncertainty

if TYPE_CHECKING:
    from errors.measurands import Localisation, Measurand, MeasurandModel

_IMAGE_SCALE = 1e-3


@dataclass(frozen=True)
class Means:
    """What targets are measured with, and how well.

    Attributes
    ----------
    camera : Camera
        The camera; its image distance, to scale, takes the place of f in the paper's eqs 4–9, as the object is near.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    accuracy : float
        Required accuracy A in (0, 1): the measured length of an edge may be wrong by the fraction 1 − A. A dimension
        has a permitted error of its own.
    localisation : Localisation, optional
        How well points are found in the image. Default: on whole pixels.
    model : str
        Error model of edges, see `errors.success_probability`.
    surfaces_mm : float
        Standard deviation of a face's position along its normal, mm; for dimensions.
    """

    camera: Camera
    pose_uncertainty: PoseUncertainty
    accuracy: float = 0.98
    localisation: Localisation | None = None
    model: str = "joint"
    surfaces_mm: float = 0.0


class TargetModels(Protocol):
    """How probably each of k targets is measured accurately."""

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses (n, 4, 4) for those targets that are wanted (n, k), one after the other, row by row."""


class EdgeModels:
    """The paper's density of image lengths.

    Parameters
    ----------
    ends : array (k, 2, 3)
        Ends of the edges in the part's frame, mm.
    means : Means
        Its pose uncertainty is converted once to the paper's frame, see `PoseUncertainty.paper_covariance`.
    """

    def __init__(self, ends: np.ndarray, means: Means):
        self.ends = ends
        self._image_distance = _IMAGE_SCALE * means.camera.image_distance_mm
        self._probability = errors.SuccessModel(
            focal_length_mm=self._image_distance,
            pixel_pitch_mm=[_IMAGE_SCALE * pitch for pitch in means.camera.image_pitch_mm],
            pose_covariance=means.pose_uncertainty.paper_covariance(self._image_distance),
            accuracy=means.accuracy,
            model=means.model,
        )

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses for wanted edges; 0 for one not wholly in front of the camera or seen as a point."""
        return self.probability_of(world_to_cam(self.ends, cam2world)[wanted])

    def probability_of(self, ends_cam: np.ndarray) -> np.ndarray:
        """Return P (...) of edges whose ends in the camera frame are given, (..., 2, 3) in mm, OpenCV axes."""
        return self._probability(cam_to_paper(ends_cam, self._image_distance))


class DimensionModels:
    """The second-order models of measurands, one for each dimension."""

    def __init__(self, models: Sequence[MeasurandModel]):
        self._models = tuple(models)

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses for wanted dimensions, as `TargetModels`."""
        result = np.zeros(wanted.shape)
        for i, model in enumerate(self._models):
            rows = np.flatnonzero(wanted[:, i])
            if rows.size:
                result[rows, i] = model.probability(np.linalg.inv(cam2world[rows]))
        return result[wanted]


def measurand_model(value: Measurand, permitted_error: float, means: Means) -> MeasurandModel:
    """Return how surely a value is measured; without a localisation, points lie on whole pixels."""
    from errors.measurands import Localisation, MeasurandModel

    return MeasurandModel(
        value,
        image_distance_mm=means.camera.image_distance_mm,
        pixel_pitch_mm=means.camera.image_pitch_mm,
        pose_covariance=means.pose_uncertainty.covariance,
        localisation=means.localisation or Localisation.rounding(),
        permitted_error=permitted_error,
        surfaces_mm=means.surfaces_mm,
    )
