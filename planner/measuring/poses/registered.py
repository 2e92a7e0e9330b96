"""A registered image: the camera's pose, the deviations of the part's surfaces, and how sure both are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aspectgraph.entities.carriers import PARAMETERS
from planner.camera.camera import Camera
from planner.measuring.image.part_edge import PartEdge
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.lamp import Lamp
from planner.wanted.pose_knowledge import LEAST_POSE

Array = NDArray[np.float64]

SAMPLE = np.dtype(
    [
        *(("u", float), ("v", float), ("state", np.int64)),
        *(("edge", np.int64), ("planned_u", float), ("planned_v", float)),
    ]
)
"""A sample of a registration."""
FREE_PX = 10.0
"""Standard deviation of a surface that a target measures, in pixels at the focus distance.

Nothing is assumed of it: edges are searched half as far. With more, camera and surfaces could move together along a
curved valley, and at 0.02 mm a pixel the registration did not come to rest.
"""
CYLINDER_SHARE = 3.0
"""Standard deviation of radius and place of other cylinders, in that of planes: holes are less accurate than faces."""
TILT_SHARE = 0.5
"""How far a plane is lifted at its extent by each tilt, in the standard deviation of its offset."""
LEAST_MM = 1e-4
"""Standard deviation of surfaces that are said to be exact: none is."""


@dataclass(frozen=True)
class Registered:
    """What is known of one image's pose and of the part's surfaces.

    Attributes
    ----------
    cam2world : array (4, 4)
        Estimated pose.
    deviations : array (3k,)
        Estimated deviations of the surfaces, mm, see `aspectgraph.entities.carriers`.
    covariance : array (6 + 3k, 6 + 3k)
        Joint covariance of the displacement of the camera in its own frame (mm, rad) and the deviations.
    method : str
        "given", "planned" or "own edges".
    shift_px : float
        How far the image was off its prediction, px; the median over samples.
    used : int
        Samples that the estimate is from.
    offered : int
        Samples that were searched for.
    misfit_px : float
        Median distance of found points from the registered part, px.
    blur_px : float
        Standard deviation of the image's blur across edges, px.
    chi2 : float
        Square of the pose's displacement in standard deviations of the plan's uncertainty; 6 on average.
    notes : tuple of str
        What the user should know.
    warnings : tuple of str
        What of the request is not as stated.
    prior : array (6 + 3k, 6 + 3k) or None
        What was known before the image; None if nothing is estimated.
    samples : structured array (m,)
        u, v: the samples at the registered pose, px; state: see `planner.measuring.image.scans.State`; edge: number of
        the sample's edge; planned_u, planned_v: the sample at the planned pose.
    lamps : dict of str to Lamp
        The lamps of images that one fits.
    """

    cam2world: Array
    deviations: Array = field(repr=False)
    covariance: Array = field(repr=False)
    method: str
    shift_px: float = 0.0
    used: int = 0
    offered: int = 0
    misfit_px: float = float("nan")
    blur_px: float = float("nan")
    chi2: float = float("nan")
    notes: tuple[str, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
    prior: Array | None = field(default=None, repr=False)
    samples: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, SAMPLE), repr=False)
    lamps: Mapping[str, Lamp] = field(default_factory=dict, repr=False)

    def moved(self, model: PartModel, edge: PartEdge, points: Array) -> Array:
        """Return where points (n, 3) of an edge are, with the estimated deviations."""
        own = self.deviations[model.unknowns_of(edge) - POSE]
        if not own.any():
            return points
        return points + model.displacement(edge, points) @ own


def prior_covariance(
    model: PartModel, pose_covariance: Array, surfaces_mm: float, camera: Camera | None = None
) -> Array:
    """Return what is known of pose and surfaces before an image is looked at: a covariance (6 + 3k, 6 + 3k).

    Parameters
    ----------
    model : PartModel
        The part.
    pose_covariance : array (6, 6)
        Of the planned pose, mm and rad.
    surfaces_mm : float
        Standard deviation of the position of faces, mm.
    camera : Camera, optional
        Of surfaces that a target measures, nothing is assumed that its images show, see `FREE_PX`. Default: they are
        as the others.

    Returns
    -------
    array (6 + 3k, 6 + 3k)
        The covariance.
    """
    variances = np.zeros(model.n_unknowns)
    sigma = max(surfaces_mm, LEAST_MM)
    free_mm = 0.0
    if camera is not None:
        free_mm = FREE_PX * camera.focus_distance_mm / float(camera.matrix.diagonal()[:2].min())
    for k, one in enumerate(model.carriers.surfaces):
        start = POSE + PARAMETERS * k
        if one.is_plane:
            sigmas = sigma * np.array([1.0, TILT_SHARE, TILT_SHARE])
        else:
            sigmas = np.full(PARAMETERS, CYLINDER_SHARE * sigma)
        if k in model.free:
            sigmas = np.maximum(sigmas, free_mm)
        variances[start : start + PARAMETERS] = sigmas**2
    covariance = np.diag(variances)
    # a robot that is said to be exact, or exact in some direction, is not
    covariance[:POSE, :POSE] = pose_covariance + np.diag(LEAST_POSE**2)
    return covariance


def as_given(
    model: PartModel, cam2world: Array, pose_covariance: Array, surfaces_mm: float, method: str
) -> Registered:
    """Return an image whose pose is given, with its covariance; nothing is estimated."""
    covariance = prior_covariance(model, pose_covariance, surfaces_mm)
    nothing = np.zeros(model.n_unknowns - POSE)
    return Registered(np.asarray(cam2world, dtype=np.float64), nothing, covariance, method)


def displaced(cam2world: Array, moves: Array) -> Array:
    """Return poses (n, 4, 4) that are displaced by (n, 6), mm and rad, in the camera's own frame."""
    moves = np.atleast_2d(moves)
    step = np.zeros((len(moves), 4, 4))
    step[:, :3, :3] = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    step[:, :3, 3] = moves[:, :3]
    step[:, 3, 3] = 1.0
    return np.asarray(cam2world @ step)
