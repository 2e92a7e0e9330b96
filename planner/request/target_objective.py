"""The objective of a request that holds dimensions: how probable it is that every item is measured accurately."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.request.objective import Objective
from planner.wanted.targets import Target

if TYPE_CHECKING:
    from errors.measurands import Localisation, MeasurandModel


class TargetObjective(Objective):
    """Success probabilities of edges and dimensions, and the fitness made of them.

    Parameters
    ----------
    edges : Objective
        That of all items as if they were edges; it answers for those that are.
    models : mapping of int to MeasurandModel
        How sure the others are measured, by their column.
    """

    def __init__(self, edges: Objective, models: Mapping[int, MeasurandModel]):
        # what of it is not overridden, is that of the edges
        self.__dict__.update(edges.__dict__)
        self._edges = edges
        self._models = dict(models)

    def probability(self, cam2world: np.ndarray) -> np.ndarray:
        """Return P (n, k) of poses (n, 4, 4), as `Objective.probability`."""
        wanted = np.ones((len(cam2world), len(self._edges.ends)), dtype=bool)
        return self.probability_where(cam2world, wanted).reshape(wanted.shape)

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses (n, 4, 4) for those items that are wanted (n, k), one after the other, row by row."""
        result = np.zeros(wanted.shape)
        own = wanted.copy()
        own[:, list(self._models)] = False
        if own.any():
            result[own] = self._edges.probability_where(cam2world, own)
        for i, model in self._models.items():
            rows = np.flatnonzero(wanted[:, i])
            if rows.size:
                result[rows, i] = model.probability(np.linalg.inv(cam2world[rows]))
        return result[wanted]


def dimension_model(
    target: Target,
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    localisation: Localisation | None,
) -> MeasurandModel:
    """Return how sure a dimension is measured; without a localisation, points lie on whole pixels."""
    from errors.measurands import Localisation, MeasurandModel

    assert target.measurand is not None
    return MeasurandModel(
        target.measurand,
        image_distance_mm=camera.image_distance_mm,
        pixel_pitch_mm=camera.image_pitch_mm,
        pose_covariance=pose_uncertainty.covariance,
        localisation=localisation or Localisation.rounding(),
        permitted_error=target.permitted_error,
    )
