"""A value whose entities are measured in two images, an end in each: how probable a small error is.

Notation
--------
e₁, e₂   errors of the value by what is fitted of one end alone, in its own image     r   permitted error

An end is one of two entities, or a group of the entities of a position. The images have displacements and point errors
of their own, so e₁ and e₂ are independent but for surfaces, which have a normal error. That of a face which carries
entities of both ends counts once: its two effects add up before they are squared. The probability is a sum over small
steps of e₂,

    P(|e₁ + e₂| ≤ r) = Σ P(e₂ in step j) P(−r − m_j ≤ e₁ ≤ r − m_j),     m_j the middle of step j,

each factor from the second-order model of an end. Products of errors of both ends are left out: they are smaller than
the error by a factor of error over nominal value.

Of a position, e₁ and e₂ are vectors in the plane of the rim. Their sum is a quadratic form of the twelve numbers by
which both cameras are displaced, so its probability is that of `quadratic_disc_probability`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.exceptions import InvalidShapeError, MeasurandError
from errors.measurands.disc import quadratic_disc_probability, quadratic_interval_probability
from errors.measurands.geometry import Circle, FittedEntities, Frame, Geometry
from errors.measurands.measurand import BREAKS_WIDER, Measurand, MeasurandModel
from errors.measurands.position import Position, PositionModel, QuadraticError

Array = NDArray[np.float64]

_STEPS = 400
# of the second error, beyond which nothing counts
_SIGMAS = 7.0
# entities up to which all ways to group them are tried
_MOST_IN_ALL_WAYS = 8
_ON_CIRCLE = 17


class End(Measurand):
    """What some entities have in a value of several: the others are where they should be.

    Parameters
    ----------
    whole : Measurand
        The value.
    entities : int or sequence of int
        Numbers of the entities.

    Raises
    ------
    MeasurandError
        If the value is read from the image itself, as the length of an edge is.
    """

    def __init__(self, whole: Measurand, entities: int | Sequence[int]) -> None:
        if whole.in_image:
            raise MeasurandError.of_rule("kind", "must have entities of its own", repr(whole.kind))
        self.whole = whole
        self.entities = (entities,) if isinstance(entities, int) else tuple(entities)
        shapes = tuple(whole.geometry[k] for k in self.entities)
        super().__init__(shapes, whole.direction)

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Unit of the value."""
        return self.whole.unit

    def describe(self) -> tuple[float, tuple[Frame, ...], Array, Array]:
        """Return nominal value of the whole, frames, and the derivatives by what is fitted, see `Measurand`."""
        fitted = self.whole.fitted
        frames = tuple(self.whole.frames[k] for k in self.entities)
        return self.whole.nominal, frames, *self._own(fitted.gradient, fitted.hessian)

    def _own(self, gradient: Array, hessian: Array) -> tuple[Array, Array]:
        """Return derivatives by what is fitted of these entities, of derivatives by all that is fitted."""
        ends = np.cumsum([0, *map(_size, self.whole.geometry)])
        numbers = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in self.entities])
        return gradient[numbers], hessian[np.ix_(numbers, numbers)]

    def among_all(self, fitted: list[Array]) -> list[Array]:
        """Return what is fitted of all entities of the value: of the others what they should be.

        Parameters
        ----------
        fitted : list of array (n, p)
            Of these entities.
        """
        everything = [
            np.zeros((len(fitted[0]), _size(shape))) + _nominal(shape)
            for shape in self.whole.geometry
        ]
        for k, values in zip(self.entities, fitted, strict=True):
            everything[k] = values
        return everything

    def value(self, fitted: list[Array]) -> Array:
        """Return deviations (n,) of the whole by what is fitted of these entities."""
        return self.whole.value(self.among_all(fitted))

    def components_of(self, fitted: list[Array]) -> Array:
        """Return what adds up over the ends of a value: deviations (n, 1), or e (n, c) of a position."""
        return self.value(fitted)[:, None]

    def by_planes(self, world_to_camera: Array) -> Array:
        """Return how far the components move if the plane of each entity is 1 mm farther out along its normal.

        Parameters
        ----------
        world_to_camera : array (4, 4)
            The pose.

        Returns
        -------
        array (c, e)
            By component and entity. Normals are those of `Measurand.surfaces` of the whole value.
        """
        _, normals = self.whole.surfaces
        # a plane that is off is seen as from a camera that is off by the opposite
        offs = normals[list(self.entities)] @ world_to_camera[:3, :3].T
        moved = [
            fitted.by_entity(world_to_camera[None])[0, :, :3] for fitted in self._by_component()
        ]
        return -np.einsum("cei,ei->ce", np.array(moved), offs)

    def _by_component(self) -> list[FittedEntities]:
        return [self.fitted]

    def __getstate__(self) -> dict[str, Any]:
        return {"whole": self.whole, "entities": self.entities}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["whole"], state["entities"])  # type: ignore[misc]


class PositionEnd(End):
    """What some entities have in the error e of a position.

    Attributes
    ----------
    frame : PositionFrame
        That of the whole position.
    components : list of FittedEntities
        As those of a `Position`, of these entities alone.
    """

    whole: Position

    def __init__(self, whole: Position, entities: int | Sequence[int]) -> None:
        super().__init__(whole, entities)
        self.frame = whole.frame
        self.components = [
            FittedEntities(self.geometry, self.frames, *self._own(fitted.gradient, fitted.hessian))
            for fitted in whole.components
        ]

    def components_of(self, fitted: list[Array]) -> Array:
        """Return what these entities have in e (n, c)."""
        return self.whole.error(self.among_all(fitted))

    def model(self, **means: Any) -> PositionModel:
        """Return how surely it is measured, see `MeasurandModel`."""
        return PositionModel(self, **means)

    def _by_component(self) -> list[FittedEntities]:
        return self.components[: len(self.frame.errors)]


def end_of_value(whole: Measurand, entities: int | Sequence[int]) -> End:
    """Return what some entities have in a value: of a position a `PositionEnd`.

    Parameters
    ----------
    whole : Measurand
        The value.
    entities : int or sequence of int
        Numbers of the entities.
    """
    if isinstance(whole, Position):
        return PositionEnd(whole, entities)
    return End(whole, entities)


def end_groups(value: Measurand) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the entities of a value in two groups, each for an image of its own: as small as both can be.

    The first group holds the first entity. The larger extent of both is the least of all ways to group them. Of equal
    ones, the smaller extents together count. Of many entities, groups are cut across the direction in which they are
    spread most.

    Parameters
    ----------
    value : Measurand
        One that `can_be_split`.
    """
    n = len(value.geometry)
    if n == 2:
        return (0,), (1,)
    apart = _distances(value.geometry)
    best: tuple[tuple[int, ...], tuple[int, ...]] = (0,), tuple(range(1, n))
    lowest = (math.inf, math.inf)
    for first in _first_groups(value.geometry):
        second = tuple(k for k in range(n) if k not in first)
        extents = [round(float(apart[np.ix_(group, group)].max()), 6) for group in (first, second)]
        cost = (max(extents), sum(extents))
        if cost < lowest:
            best = first, second
            lowest = cost
    return best


def _first_groups(geometry: Sequence[Geometry]) -> list[tuple[int, ...]]:
    """Return groups with the first entity; some entity is in none."""
    n = len(geometry)
    if n <= _MOST_IN_ALL_WAYS:
        others = range(1, n)
        return [(0, *chosen) for m in range(n - 1) for chosen in itertools.combinations(others, m)]
    middles = np.array([_points(shape).mean(axis=0) for shape in geometry])
    middles = middles - middles.mean(axis=0)
    _, _, ways = np.linalg.svd(middles, full_matrices=False)
    order = np.argsort(np.round(middles @ ways[0], 6), kind="stable").tolist()
    cuts = []
    for cut in range(1, n):
        group = order[:cut]
        if 0 not in group:
            group = order[cut:]
        cuts.append(tuple(sorted(group)))
    return cuts


def _distances(geometry: Sequence[Geometry]) -> Array:
    """Return how far points of two entities are apart at most, (n, n); mm."""
    points = [_points(shape) for shape in geometry]
    apart = np.zeros((len(points), len(points)))
    for j, first in enumerate(points):
        for k, second in enumerate(points):
            apart[j, k] = np.linalg.norm(first[:, None] - second, axis=2).max()
    return apart


def _points(shape: Geometry) -> Array:
    if isinstance(shape, Circle):
        return shape.points(np.linspace(0.0, shape.span_rad, _ON_CIRCLE))
    return np.array([shape.p, shape.q])


class SplitModel:
    """The model of a value whose two ends are measured from poses of their own; see `end_groups`.

    `split_model` returns that of a position, too.

    Parameters
    ----------
    model : MeasurandModel
        The model of the whole value in one image: permitted error, localisation, surfaces and pose covariance.
    other : MeasurandModel, optional
        The same with what is known of the pose that measures the second end. Errors by surfaces that both models
        state are those by their own end, and independent. Default: what is known of the first pose.
    by_surfaces : float, optional
        Standard deviation of the value by surfaces in both images together, in its unit, where it is known.

    Raises
    ------
    MeasurandError
        If the value cannot be split, or is read from the image itself.

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

    def __init__(
        self,
        model: MeasurandModel,
        other: MeasurandModel | None = None,
        by_surfaces: float | None = None,
    ) -> None:
        value = model.measurand
        if not can_be_split(value):
            raise MeasurandError.of_rule(
                "measurand",
                "must have two entities, or be a position",
                f"{value.kind!r} of {len(value.geometry)}",
            )
        self.whole = model
        self._at_pose = (model, other or model)
        self._is_apart = other is not None
        self._by_surfaces = by_surfaces
        self.ends = tuple(end_of_value(value, group) for group in end_groups(value))

    def probability(self, world_to_camera: ArrayLike) -> float:
        """Return the probability that the error is at most the permitted one.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each end.

        Returns
        -------
        float
            In [0, 1]; 0 if an end has no image from its pose.
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
            The pose that measures each end.
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
        """Return the standard deviation (2,) of the error by each end, without surfaces; infinite without an image.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each end.
        """
        poses = self._checked(world_to_camera)
        return np.array(
            [
                self._model(k, 0.0, 0.0).describe(pose).standard_uncertainty
                for k, pose in enumerate(poses)
            ]
        )

    def end_probability(self, end: int, world_to_camera: ArrayLike) -> float:
        """Return the probability that the error by one end alone is at most the permitted one.

        No pose of the other end makes the whole value more probable to be right (Anderson, 1955), see
        `docs/mathematics/lower-bound.md`.

        Parameters
        ----------
        end : int
            Its number, 0 or 1.
        world_to_camera : array_like (4, 4)
            The pose that measures it.
        """
        pose = np.asarray(world_to_camera, dtype=np.float64)
        return float(self._model(end, 0.0, 0.0).probability(pose[None])[0])

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
        return self.ends[k].model(
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

        Where only the models state what surfaces do to their end, these are independent.

        Parameters
        ----------
        world_to_camera : array (2, 4, 4)
            The pose that measures each end.
        """
        if self._by_surfaces is not None:
            return self._by_surfaces
        first, second = (model.by_surfaces for model in self._at_pose)
        if first is not None and second is not None:
            return math.hypot(first, second) if self._is_apart else first
        return self.whole.surfaces_mm * float(np.linalg.norm(self.by_faces(world_to_camera)))

    def by_faces(self, world_to_camera: Array) -> Array:
        """Return how far the components of the value move if faces are 1 mm off; each counts once in both images.

        Parameters
        ----------
        world_to_camera : array (2, 4, 4)
            The pose that measures each end.

        Returns
        -------
        array (c, e)
            By component, and by the first entity that each face carries; 0 of other entities.
        """
        index, _ = self.whole.measurand.surfaces
        effects = [
            end.by_planes(pose) for end, pose in zip(self.ends, world_to_camera, strict=True)
        ]
        total = np.zeros((len(effects[0]), len(index)))
        for end, effect in zip(self.ends, effects, strict=True):
            for k, entity in enumerate(end.entities):
                total[:, index[entity]] += effect[:, k]
        return total


class SplitPositionModel(SplitModel):
    """The model of a position whose rim and datums are measured from two poses.

    It takes what `SplitModel` takes. Surfaces are those of the model, whatever registration tells of them.
    """

    def probability(self, world_to_camera: ArrayLike) -> float:
        """Return the probability that ‖e₁ + e₂‖ is at most half the permitted error.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each end.

        Returns
        -------
        float
            In [0, 1]; 0 if an end has no image from its pose.
        """
        poses = self._checked(world_to_camera)
        error = self._error(poses)
        if error is None:
            return 0.0
        radius = 0.5 * self.whole.permitted_error
        broken = (0.5 * BREAKS_WIDER * self.whole.by_edges) ** 2
        noise = error.noise + broken * np.eye(len(error.noise))
        if len(noise) == 2:
            return quadratic_disc_probability(error.gradient, error.hessian, noise, radius)
        return quadratic_interval_probability(
            error.gradient[0], error.hessian[0], float(noise[0, 0]), radius
        )

    def covariance_at(self, world_to_camera: ArrayLike) -> Array:
        """Return the covariance of e = e₁ + e₂.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each end.

        Returns
        -------
        array (c, c)
            mm²; infinite without an image.
        """
        error = self._error(self._checked(world_to_camera))
        if error is None:
            n = len(self.whole.measurand.frame.errors)  # type: ignore[attr-defined]
            return np.full((n, n), math.inf)
        return error.covariance

    def standard_uncertainty(self, world_to_camera: ArrayLike) -> float:
        """Return the standard deviation of 2‖e‖ along the axis in which e is largest, mm; infinite without an image.

        Parameters
        ----------
        world_to_camera : array_like (2, 4, 4)
            The pose that measures each end.
        """
        covariance = self.covariance_at(world_to_camera)
        if not np.isfinite(covariance).all():
            return math.inf
        largest = float(np.linalg.eigvalsh(covariance)[-1])
        return math.hypot(2.0 * math.sqrt(max(largest, 0.0)), self.whole.by_edges)

    def _error(self, poses: Array) -> QuadraticError | None:
        """Return e as a quadratic form of what displaces both cameras, in unit variates."""
        parts = []
        for k, pose in enumerate(poses):
            model = self._model(k, 0.0, 0.0)
            assert isinstance(model, PositionModel)
            part = model.in_unit_variates(pose)
            if part is None:
                return None
            parts.append(part)
        n = parts[0].gradient.shape[1]
        hessian = np.zeros((len(parts[0].hessian), 2 * n, 2 * n))
        hessian[:, :n, :n] = parts[0].hessian
        hessian[:, n:, n:] = parts[1].hessian
        faces = self.whole.surfaces_mm * self.by_faces(poses)
        return QuadraticError(
            np.concatenate([part.gradient for part in parts], axis=1),
            hessian,
            parts[0].noise + parts[1].noise + faces @ faces.T,
        )


def split_model(
    model: MeasurandModel, other: MeasurandModel | None = None, by_surfaces: float | None = None
) -> SplitModel:
    """Return the model of a value whose ends are measured from two poses, see `SplitModel`.

    Parameters
    ----------
    model : MeasurandModel
        That of the whole value, with what is known of the pose of the first end.
    other : MeasurandModel, optional
        The same for the second end.
    by_surfaces : float, optional
        Standard deviation of the value by surfaces in both images together, where it is known.
    """
    if isinstance(model.measurand, Position):
        return SplitPositionModel(model, other, by_surfaces)
    return SplitModel(model, other, by_surfaces)


def can_be_split(value: Measurand) -> bool:
    """Return whether two images may measure a value, an end in each.

    These are values of two entities, such as distances and angles, and positions with their datums.

    Parameters
    ----------
    value : Measurand
        The value.
    """
    if value.in_image or isinstance(value, End):
        return False
    return isinstance(value, Position) or (len(value.geometry) == 2 and not value.and_more)


def _size(shape: Geometry) -> int:
    """Return how many numbers are fitted of an entity, see `Measurand.describe`."""
    return 3 if isinstance(shape, Circle) else 2


def _nominal(shape: Geometry) -> Array:
    """Return what is fitted of an entity that is where it should be."""
    if isinstance(shape, Circle):
        return np.array([0.0, 0.0, shape.radius_mm])
    return np.zeros(2)
