"""The error models of targets: how probable it is that a value is measured accurately from a pose.

The paper (eqs 6–9) turns the object about the origin of its camera frame, which lies on the image plane, the image
distance d away from the nodal point about which a camera pose turns. To first order the two differ by a translation
that goes into the covariance; the second-order rest, d·φ²/2 along the axis, lowers the true P by 0.004 at 3°. It can
be avoided: P does not change when the image plane and its pixels shrink together towards the nodal point. So the
image is taken at a thousandth of d, with pixels a thousandth as large, where both centres of rotation are one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import errors
from errors.model import Model
from errors.registration import Imaging, KnownPoses, Stretches, Values, known_poses
from ground.short_repr import short_repr
from planner.camera.camera import Camera
from planner.camera.pose import (
    PoseUncertainty,
    cam_to_paper,
    paper_displacement_jacobian,
)
from planner.executors import check_on_the_way
from planner.request.edge_state import SHARP, EdgeState, value_sigma

if TYPE_CHECKING:
    from errors.measurands import Localisation, Measurand, MeasurandModel

# How surely poses and values are known after registration to the part's own edges, at any planned
# pose.
#
# What registration measures is predicted by `errors.registration`; here is what
# belongs to a request: the edges of the part, the camera, and how surfaces move the entities of
# targets.


Array = NDArray[np.float64]
Key = tuple[str, ...]


@dataclass(frozen=True)
class Lifts:
    """How the entities (e) of a target move with the surfaces that carry them.

    Attributes
    ----------
    surfaces : array of int (e, 2)
        Numbers of the surfaces.
    motions : array (e, 2, 3, 6)
        Vector and turn of each entity for each of their numbers.
    free : array of int (f,)
        Numbers of the surfaces that the target measures itself.
    """

    surfaces: NDArray[np.int64]
    motions: Array
    free: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class OwnEdges:
    """Registration to the part's own edges, for poses that are planned.

    Attributes
    ----------
    pose_covariance : array (6, 6)
        Of the camera's displacement before the image.
    stretches : Stretches
        Of the part's edges.
    imaging : Imaging
        How the camera shows them.
    lifts : mapping of tuple of str to Lifts
        By the key of a target, see `key_of`.
    """

    pose_covariance: Array
    stretches: Stretches
    imaging: Imaging
    lifts: Mapping[Key, Lifts]

    def known(
        self, world_to_camera: Array, rows: NDArray[np.int64], keys: Sequence[Key], gradient: Array
    ) -> KnownPoses:
        """Return what is known of poses, and of values there.

        Parameters
        ----------
        world_to_camera : array (n, 4, 4)
            The poses.
        rows : array of int (t,)
            The pose of each value, ascending.
        keys : sequence of tuple of str (t,)
            The target of each value.
        gradient : array (t, e, 6)
            By the displacement of the camera, of each entity alone; zeros behind the entities of a target.
        """
        size = gradient.shape[1]
        surfaces = np.full((len(rows), size, 2), -1, dtype=np.int64)
        motions = np.zeros((len(rows), size, 2, 3, 6))
        free = np.zeros((len(rows), len(self.stretches.sigmas)), dtype=np.bool_)
        for t, key in enumerate(keys):
            lifts = self.lifts[key]
            count = len(lifts.surfaces)
            surfaces[t, :count] = lifts.surfaces
            motions[t, :count] = lifts.motions
            free[t, lifts.free] = True
        values = Values(rows, gradient, surfaces, motions, free)
        return known_poses(
            world_to_camera, self.pose_covariance, self.stretches, self.imaging, values
        )

    def poses_of(
        self, world_to_camera: Array, rows: NDArray[np.int64], keys: Sequence[Key]
    ) -> KnownPoses:
        """Return what is known of poses (n, 4, 4), and of those of targets (t,) whose values are theirs alone."""
        return self.known(world_to_camera, rows, keys, np.zeros((len(rows), 1, 6)))

    def poses(self, world_to_camera: Array) -> KnownPoses:
        """Return what is known of poses (n, 4, 4) alone."""
        return self.known(world_to_camera, np.zeros(0, dtype=np.int64), (), np.zeros((0, 1, 6)))


def key_of(name: str, entities: Sequence[str]) -> Key:
    """Return the key of a target that is measured by entities: its witnesses have one name or several."""
    return (name.partition(" \x1f")[0], *entities)


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
    by_surfaces : float, optional
        Standard deviation of the value by surfaces, where it is known; then ``surfaces_mm`` does not count.
    own_edges : OwnEdges, optional
        Registration that makes poses better known than ``pose_uncertainty`` says.
    edges : EdgeState
        By how much edges are broken; for dimensions. Default: not at all.
    """

    camera: Camera
    pose_uncertainty: PoseUncertainty
    accuracy: float = 0.98
    localisation: Localisation | None = None
    model: Model = "joint"
    surfaces_mm: float = 0.0
    by_surfaces: float | None = None
    own_edges: OwnEdges | None = None
    edges: EdgeState = SHARP

    __repr__ = short_repr


class EdgeModels:
    """The paper's density of image lengths.

    Parameters
    ----------
    ends : array (k, 2, 3)
        Ends of the edges in the part's frame, mm.
    means : Means
        Its pose uncertainty is converted once to the paper's frame, see `PoseUncertainty.paper_covariance`.
    keys : sequence of tuple of str (k,)
        What registration knows the targets by.
    """

    def __init__(self, ends: np.ndarray, means: Means, keys: Sequence[Key] = ()):
        self.ends = ends
        self._keys = tuple(keys)
        self._image_distance = _IMAGE_SCALE * means.camera.image_distance_mm
        self._probability = errors.SuccessModel(
            focal_length_mm=self._image_distance,
            pixel_pitch_mm=[_IMAGE_SCALE * pitch for pitch in means.camera.image_pitch_mm],
            pose_covariance=means.pose_uncertainty.paper_covariance(self._image_distance),
            accuracy=means.accuracy,
            model=means.model,
        )
        self._own_edges = means.own_edges if means.model == "joint" else None

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses for wanted edges; 0 for one not wholly in front of the camera or seen as a point."""
        of, edge = np.nonzero(wanted)
        poses = cam2world[of]
        ends = (self.ends[edge] - poses[:, None, :3, 3]) @ poses[:, :3, :3]
        if self._own_edges is None:
            return self.probability_of(ends)
        used = np.flatnonzero(wanted.any(axis=1))
        rows, columns = np.nonzero(wanted[used])
        keys = [self._keys[i] for i in columns]
        uncertainty = self._own_edges.poses_of(np.linalg.inv(cam2world[used]), rows, keys)
        root = paper_displacement_jacobian(self._image_distance) @ uncertainty.roots
        return self._probability(cam_to_paper(ends, self._image_distance), root)

    def probability_of(self, ends_cam: np.ndarray) -> np.ndarray:
        """Return P (...) of edges whose ends in the camera frame are given, (..., 2, 3) in mm, OpenCV axes."""
        return self._probability(cam_to_paper(ends_cam, self._image_distance))


class DimensionModels:
    """The second-order models of measurands, one for each dimension.

    Parameters
    ----------
    models : sequence of MeasurandModel (k,)
        The models.
    own_edges : OwnEdges, optional
        Registration that says how well each pose is known.
    keys : sequence of tuple of str (k,)
        What registration knows the targets by.

    Attributes
    ----------
    models : tuple of MeasurandModel (k,)
        The models.
    """

    def __init__(
        self,
        models: Sequence[MeasurandModel],
        own_edges: OwnEdges | None = None,
        keys: Sequence[Key] = (),
    ):
        self.models = tuple(models)
        self._own_edges = own_edges
        self._keys = tuple(keys)

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses for wanted dimensions, one after the other, row by row."""
        if self._own_edges is not None:
            return self._registered(self._own_edges, cam2world, wanted)
        result = np.zeros(wanted.shape)
        for i, model in enumerate(self.models):
            rows = np.flatnonzero(wanted[:, i])
            if rows.size:
                # of a part with hundreds of dimensions, all of them take long
                check_on_the_way()
                result[rows, i] = model.probability(np.linalg.inv(cam2world[rows]))
        return result[wanted]

    def _registered(
        self, own_edges: OwnEdges, cam2world: np.ndarray, wanted: np.ndarray
    ) -> np.ndarray:
        used = np.flatnonzero(wanted.any(axis=1))
        inverse = np.linalg.inv(cam2world[used])
        rows, columns = np.nonzero(wanted[used])
        knowledge = self.known(own_edges, inverse, rows, columns)
        excess = np.maximum(knowledge.variance - knowledge.by_pose, 0.0)
        result = np.zeros(len(rows))
        for i in np.unique(columns):
            mask = columns == i
            at = rows[mask]
            poses = knowledge._replace(covariance=knowledge.covariance[at], root=knowledge.root[at])
            result[mask] = self.models[i].probability_at(inverse[at], poses, excess[mask])
        return result

    def known(
        self,
        own_edges: OwnEdges,
        world_to_camera: np.ndarray,
        rows: np.ndarray,
        columns: np.ndarray,
    ) -> KnownPoses:
        """Return what registration tells of poses (n, 4, 4), and of dimensions ``columns`` (t,) at poses ``rows`` (t,).

        Variances are those of x, see `errors.measurands.measurand.Expansion`.
        """
        size = max(len(model.measurand.geometry) for model in self.models)
        gradient = np.zeros((len(rows), size, 6))
        for i in np.unique(columns):
            mask = columns == i
            model = self.models[i]
            by_entity = model.measurand.by_entity(world_to_camera[rows[mask]], model.image)
            gradient[mask, : by_entity.shape[1]] = by_entity
        keys = [self._keys[i] for i in columns]
        return own_edges.known(world_to_camera, rows, keys, gradient)


def measurand_model(value: Measurand, permitted_error: float, means: Means) -> MeasurandModel:
    """Return how surely a value is measured; without a localisation, points lie on whole pixels."""
    from errors.measurands import Localisation

    return value.model(
        image_distance_mm=means.camera.image_distance_mm,
        pixel_pitch_mm=means.camera.image_pitch_mm,
        pose_covariance=means.pose_uncertainty.covariance,
        localisation=means.localisation or Localisation.rounding(),
        permitted_error=permitted_error,
        surfaces_mm=means.surfaces_mm,
        by_surfaces=means.by_surfaces,
        by_edges=value_sigma(value, means.edges),
    )


TargetModels = EdgeModels | DimensionModels
"""How probably each of k targets is measured accurately."""
