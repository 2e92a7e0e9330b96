"""The objective: how probable it is that every entity is measured accurately from a pose."""

from __future__ import annotations

import numpy as np

import errors
from planner.camera import Camera
from planner.exceptions import RequestError
from planner.pose import PoseUncertainty, cam_to_paper, world_to_cam


class Objective:
    """Success probabilities of poses, and the fitness made of them.

    Parameters
    ----------
    ends : array (k, 2, 3)
        Ends of the entities in the part's frame, mm.
    camera : Camera
        The camera; its image distance takes the place of f in the paper's eqs 4–9, as the object is near.
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
            raise RequestError(f"accuracy must be in (0, 1). Got {accuracy!r}.")
        if kind not in ("sum", "min"):
            raise RequestError(f"objective must be 'sum' or 'min'. Got {kind!r}.")
        self.ends, self.camera, self.accuracy, self.kind, self.model = ends, camera, accuracy, kind, model
        self.covariance = pose_uncertainty.paper_covariance(camera.image_distance_mm)

    def probability(self, cam2world: np.ndarray) -> np.ndarray:
        """Return P (n, k) of poses (n, 4, 4); 0 for an entity that is not wholly in front of the camera."""
        ends_cam = world_to_cam(self.ends, cam2world)
        in_front = (ends_cam[..., 2] > 0).all(axis=-1)
        probability = np.zeros(in_front.shape)
        if in_front.any():
            probability[in_front] = errors.success_probability(
                cam_to_paper(ends_cam[in_front], self.camera.image_distance_mm),
                focal_length_mm=self.camera.image_distance_mm,
                pixel_pitch_mm=self.camera.pixel_pitch_mm,
                pose_covariance=self.covariance,
                accuracy=self.accuracy,
                model=self.model,
            )
        return probability

    def fitness(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the fitness (n,) of poses (n, 4, 4): eq 22, or the smallest probability."""
        probability = self.probability(cam2world)
        return probability.sum(axis=1) if self.kind == "sum" else probability.min(axis=1)
