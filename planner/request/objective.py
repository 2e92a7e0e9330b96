"""The objective: how probable it is that every entity is measured accurately from a pose.

The paper (eqs 6–9) turns the object about the origin of its camera frame, which lies on the image plane, the image
distance d away from the nodal point about which a camera pose turns. To first order the two differ by a translation
that goes into the covariance; the second-order rest, d·φ²/2 along the axis, lowers the true P by 0.004 at 3°. It can
be avoided: P does not change when the image plane and its pixels shrink together towards the nodal point. So the
image is taken at a thousandth of d, with pixels a thousandth as large, where both centres of rotation are one.
"""

from __future__ import annotations

import numpy as np

import errors
from planner.camera.camera import Camera
from planner.camera.pose import cam_to_paper, world_to_cam
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.exceptions import RequestError

_IMAGE_SCALE = 1e-3


class Objective:
    """Success probabilities of poses, and the fitness made of them.

    Parameters
    ----------
    ends : array (k, 2, 3)
        Ends of the entities in the part's frame, mm.
    camera : Camera
        The camera; its image distance, to scale, takes the place of f in the paper's eqs 4–9, as the object is near.
    pose_uncertainty : PoseUncertainty
        Converted once to the paper's frame, see `PoseUncertainty.paper_covariance`.
    accuracy : float
        Required accuracy A in (0, 1): the measured length may be wrong by the fraction 1 − A.
    kind : {"sum", "min"}
        Fitness: the sum of the probabilities (the paper), or the smallest.
    model : str
        Error model, see `errors.success_probability`.

    Raises
    ------
    RequestError
        If the accuracy or the kind breaks its rule.
    """

    def __init__(
        self,
        ends: np.ndarray,
        camera: Camera,
        pose_uncertainty: PoseUncertainty,
        accuracy: float,
        kind: str = "sum",
        model: str = "joint",
    ):
        if not 0 < accuracy < 1:
            raise RequestError.of_rule("accuracy", "must be in (0, 1)", repr(accuracy))
        if kind not in ("sum", "min"):
            raise RequestError.of_rule("objective", "must be 'sum' or 'min'", repr(kind))
        self.ends = ends
        self.camera = camera
        self.accuracy = accuracy
        self.kind = kind
        self.model = model
        self._image_distance = _IMAGE_SCALE * camera.image_distance_mm
        self._probability = errors.SuccessModel(
            focal_length_mm=self._image_distance,
            pixel_pitch_mm=[_IMAGE_SCALE * pitch for pitch in camera.image_pitch_mm],
            pose_covariance=pose_uncertainty.paper_covariance(self._image_distance),
            accuracy=accuracy,
            model=model,
        )

    def probability(self, cam2world: np.ndarray) -> np.ndarray:
        """Return P (n, k) of poses (n, 4, 4); 0 for an entity not wholly in front of the camera or seen as a point."""
        return self.probability_of(world_to_cam(self.ends, cam2world))

    def probability_of(self, ends_cam: np.ndarray) -> np.ndarray:
        """Return P (...) of entities whose ends in the camera frame are given, (..., 2, 3) in mm, OpenCV axes."""
        return self._probability(cam_to_paper(ends_cam, self._image_distance))

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses (n, 4, 4) for those entities that are wanted (n, k), one after the other, row by row."""
        return self.probability_of(world_to_cam(self.ends, cam2world)[wanted])

    @property
    def highest(self) -> float:
        """The fitness when every probability is 1."""
        return float(len(self.ends)) if self.kind == "sum" else 1.0

    def fitness(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the fitness (n,) of poses (n, 4, 4): eq 22, or the smallest probability."""
        probability = self.probability(cam2world)
        return probability.sum(axis=1) if self.kind == "sum" else probability.min(axis=1)
