"""A value whose two entities are measured in images of their own: how probable a small error is.

Notation
--------
e₁, e₂   errors of the value by what is fitted of one entity alone, in its own image     r   permitted error

The images have displacements and point errors of their own, so e₁ and e₂ are independent but for surfaces, which have a
normal error. That of a face which carries both entities counts once: its two effects add up before they are squared.
The probability is a sum over small steps of e₂,

    P(|e₁ + e₂| ≤ r) = Σ P(e₂ in step j) P(−r − m_j ≤ e₁ ≤ r − m_j),     m_j the middle of step j,

each factor from the second-order model of an entity. Products of errors of both entities are left out: they are smaller
than the error by a factor of error over nominal value.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.exceptions import InvalidShapeError, MeasurandError
from errors.measurands.geometry import Circle, Frame, Geometry
from errors.measurands.measurand import Measurand, MeasurandModel

Array = NDArray[np.float64]

_STEPS = 400
# of the second error, beyond which nothing counts
_SIGMAS = 7.0


class End(Measurand):
    """What one entity has in a value of several: the others are where they should be.

    Parameters
    ----------
    whole : Measurand
        The value.
    entity : int
        Number of the entity.

    Raises
    ------
    MeasurandError
        If the value is read from the image itself, as the length of an edge is.
    """

    def __init__(self, whole: Measurand, entity: int) -> None:
        if whole.in_image:
            raise MeasurandError.of_rule("kind", "must have entities of its own", repr(whole.kind))
        self.whole = whole
        self.entity = entity
        super().__init__((whole.geometry[entity],), whole.direction)

    def describe(self) -> tuple[float, tuple[Frame, ...], Array, Array]:
        """Return nominal value of the whole, frame, and the derivatives by what is fitted, see `Measurand`."""
        sizes = [_size(shape) for shape in self.whole.geometry]
        first = sum(sizes[: self.entity])
        block = slice(first, first + sizes[self.entity])
        fitted = self.whole.fitted
        frame = self.whole.frames[self.entity]
        return (
            self.whole.nominal,
            (frame,),
            fitted.gradient[block],
            fitted.hessian[block, block],
        )

    def value(self, fitted: list[Array]) -> Array:
        """Return deviations (n,) of the whole by what is fitted of this entity."""
        nothing = [
            np.zeros((len(fitted[0]), _size(shape))) + _nominal(shape)
            for shape in self.whole.geometry
        ]
        nothing[self.entity] = fitted[0]
        return self.whole.value(nothing)

    def by_plane(self, world_to_camera: Array) -> float:
        """Return how far the value moves if the plane of the entity is 1 mm farther out along its normal.

        Parameters
        ----------
        world_to_camera : array (4, 4)
            The pose.
        """
        frame = self.frames[0]
        normal = np.cross(frame.x, frame.y)
        eye = -world_to_camera[:3, :3].T @ world_to_camera[:3, 3]
        shape = self.geometry[0]
        middle = shape.centre if isinstance(shape, Circle) else shape.middle
        ray = middle - eye
        # points on the real plane are carried back along their rays to where it should be
        shift = normal - ray / float(ray @ normal)
        along = np.array([shift @ frame.x, shift @ frame.y])
        gradient = self.fitted.gradient
        if isinstance(shape, Circle):
            larger = -shape.radius_mm / float(ray @ normal)
            return float(gradient[:2] @ along + gradient[2] * larger)
        return float(gradient[0] * along[1])

    def __getstate__(self) -> dict[str, Any]:
        return {"whole": self.whole, "entity": self.entity}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["whole"], state["entity"])  # type: ignore[misc]


class SplitModel:
    """The model of a value of two entities, each measured from a pose of its own.

    Parameters
    ----------
    model : MeasurandModel
        The model of the whole value in one image: permitted error, localisation, surfaces and pose covariance.
    other : MeasurandModel, optional
        The same with what is known of the pose that measures the second entity. Errors by surfaces that both models
        state are those by their own entity. Default: what is known of the first pose.

    Raises
    ------
    MeasurandError
        If the value has not two entities, or is read from the image itself.

    Examples
    --------
    >>> import numpy as np
    >>> from errors.measurands import Line, Localisation, MeasurandModel, SplitModel, measurand
    >>> lines = [Line([0, y, 0], [40, y, 0]) for y in (0, 200)]
    >>> model = MeasurandModel(
    ...     measurand("distance", lines),
    ...     image_distance_mm=26.0,
    ...     pixel_pitch_mm=(0.0035, 0.0035),
    ...     pose_covariance=np.diag([1e-4] * 3 + [1e-8] * 3),
    ...     localisation=Localisation.fit(sigma_px=0.1),
    ...     permitted_error=0.05,
    ... )
    >>> above = np.array([[1, 0, 0, -20], [0, -1, 0, 0], [0, 0, -1, 200], [0, 0, 0, 1.0]])
    >>> other = above + np.array([[0, 0, 0, 0], [0, 0, 0, 200], [0, 0, 0, 0], [0, 0, 0, 0]])
    >>> float(round(SplitModel(model).probability([above, other]), 3))
    0.886
    """

    def __init__(self, model: MeasurandModel, other: MeasurandModel | None = None) -> None:
        value = model.measurand
        if len(value.geometry) != 2:
            raise MeasurandError.of_rule(
                "measurand", "must have two entities", f"{len(value.geometry)}"
            )
        self.whole = model
        self._at_pose = (model, other or model)
        self._is_apart = other is not None
        self.ends = tuple(End(value, k) for k in range(2))

    def probability(self, world_to_camera: ArrayLike) -> float:
        """Return the probability that the error is at most the permitted one.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each entity.

        Returns
        -------
        float
            In [0, 1]; 0 if an entity has no image from its pose.
        """
        poses = self._checked(world_to_camera)
        first, second = self._models(poses)
        sigma = second.describe(poses[1]).standard_uncertainty
        if not math.isfinite(sigma) or not math.isfinite(
            first.describe(poses[0]).standard_uncertainty
        ):
            return 0.0
        error = self.whole.permitted_error
        if sigma == 0.0:
            return float(first.between(poses[0], np.array([[-error, error]]))[0])
        edges = _SIGMAS * sigma * np.linspace(-1.0, 1.0, _STEPS + 1)
        middles = (edges[1:] + edges[:-1]) / 2
        shares = second.between(poses[1], np.stack([edges[:-1], edges[1:]], axis=1))
        within = first.between(poses[0], np.stack([-error - middles, error - middles], axis=1))
        return min(float(shares @ within), 1.0)

    def standard_uncertainty(self, world_to_camera: ArrayLike) -> float:
        """Return the standard deviation of the error, in the unit of the value; infinite without an image.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each entity.
        """
        poses = self._checked(world_to_camera)
        models = self._models(poses)
        return math.hypot(
            *(
                model.describe(pose).standard_uncertainty
                for model, pose in zip(models, poses, strict=True)
            )
        )

    def end_uncertainties(self, world_to_camera: ArrayLike) -> Array:
        """Return the standard deviation (2,) of the error by each entity, without surfaces; infinite without an image.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each entity.
        """
        poses = self._checked(world_to_camera)
        return np.array(
            [
                self._model(k, 0.0, 0.0).describe(pose).standard_uncertainty
                for k, pose in enumerate(poses)
            ]
        )

    def end_probability(self, entity: int, world_to_camera: ArrayLike) -> float:
        """Return the probability that the error by one entity alone is at most the permitted one.

        No pose of the other entity makes the whole value more probable to be right (Anderson, 1955), see
        `docs/mathematics/lower-bound.md`.

        Parameters
        ----------
        entity : int
            Its number, 0 or 1.
        world_to_camera : array_like (4, 4)
            The pose that measures it.
        """
        pose = np.asarray(world_to_camera, dtype=np.float64)
        return float(self._model(entity, 0.0, 0.0).probability(pose[None])[0])

    def _checked(self, world_to_camera: ArrayLike) -> Array:
        poses = np.asarray(world_to_camera, dtype=np.float64)
        if poses.shape != (2, 4, 4):
            raise InvalidShapeError.of_rule(
                "world_to_camera", "must have shape (2, 4, 4)", str(poses.shape)
            )
        return poses

    def _models(self, poses: Array) -> tuple[MeasurandModel, MeasurandModel]:
        """Return the model of each end; surfaces and broken edges, which are normal, count in the first."""
        surfaces = self.by_surfaces(poses)
        return self._model(0, surfaces, self.whole.by_edges), self._model(1, 0.0, 0.0)

    def _model(self, k: int, by_surfaces: float, by_edges: float) -> MeasurandModel:
        whole = self._at_pose[k]
        return MeasurandModel(
            self.ends[k],
            image_distance_mm=whole.image.distance_mm,
            pixel_pitch_mm=whole.image.pitch_mm,
            pose_covariance=whole.covariance,
            localisation=whole.localisation,
            permitted_error=whole.permitted_error,
            by_surfaces=by_surfaces,
            by_edges=by_edges,
        )

    def by_surfaces(self, world_to_camera: Array) -> float:
        """Return the standard deviation of the value by surfaces, in its unit.

        Where both models state what surfaces do to their entity, they are independent.

        Parameters
        ----------
        world_to_camera : array (2, 4, 4)
            The pose that measures each entity.
        """
        first, second = (model.by_surfaces for model in self._at_pose)
        if first is not None and second is not None:
            return math.hypot(first, second) if self._is_apart else first
        effects = [end.by_plane(pose) for end, pose in zip(self.ends, world_to_camera, strict=True)]
        if self.on_one_face:
            # of one face, with normals that may be opposite
            normal = [np.cross(frame.x, frame.y) for frame in self.whole.measurand.frames]
            sign = 1.0 if float(normal[0] @ normal[1]) > 0 else -1.0
            return self.whole.surfaces_mm * abs(effects[0] + sign * effects[1])
        return self.whole.surfaces_mm * math.hypot(*effects)

    @property
    def on_one_face(self) -> bool:
        """Whether one face carries both entities."""
        index, _ = self.whole.measurand.surfaces
        return bool(index[0] == index[1])


def can_be_split(value: Measurand) -> bool:
    """Return whether the entities of a value may be measured in images of their own.

    These are distances of two entities. Of an angle, `measure` reads no such value.

    Parameters
    ----------
    value : Measurand
        The value.
    """
    of_two = len(value.geometry) == 2 and not value.and_more
    return of_two and not value.in_image and value.unit == "mm"


def _size(shape: Geometry) -> int:
    """Return how many numbers are fitted of an entity, see `Measurand.describe`."""
    return 3 if isinstance(shape, Circle) else 2


def _nominal(shape: Geometry) -> Array:
    """Return what is fitted of an entity that is where it should be."""
    if isinstance(shape, Circle):
        return np.array([0.0, 0.0, shape.radius_mm])
    return np.zeros(2)
