"""A target as a plan keeps it: all that simulating and reporting it needs, without the part."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from errors.formatting import percent_text
from errors.measurands import Circle, Line, Localisation, Measurand, MeasurandError
from errors.measurands.geometry import Geometry
from errors.measurands.measurand import measurand
from ground.convert import from_plain, to_plain
from planner.camera.camera import Camera
from planner.camera.pose import world_to_cam
from planner.exceptions import PlanFileError
from planner.request.dimension import checked_tolerance, is_one_sided, plain_tolerance
from planner.request.models import Means, measurand_model
from planner.request.targets import DimensionTarget, Target
from planner.request.words import (
    CHARACTERISTICS,
    DIMENSIONS,
    EDGES,
    MIXED,
    TargetWords,
    is_characteristic,
    tolerance_text,
)

if TYPE_CHECKING:
    from errors.measurands import Prediction


# A set of entities that gives the value of a dimension, as a plan keeps it.


@dataclass(frozen=True)
class PlannedWitness:
    """A set of entities that gives the value of a dimension.

    Attributes
    ----------
    entities : tuple of str
        Ids of the entities that must be visible.
    geometry : tuple of Line or Circle
        Their lines and circles, mm, in the part's frame.
    """

    entities: tuple[str, ...]
    geometry: tuple[Geometry, ...] = field(repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON."""
        return {
            "entities": list(self.entities),
            "geometry": [to_plain(item) for item in self.geometry],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PlannedWitness:
        """Build from the result of `to_dict`."""
        return cls(tuple(data["entities"]), _geometry_of(data))


def _geometry_of(data: Mapping[str, Any]) -> tuple[Geometry, ...]:
    """Return the lines and circles that plain values hold."""
    shapes: list[Geometry] = []
    for item in data["geometry"]:
        kind: type[Line] | type[Circle] = Line if "p" in item else Circle
        shapes.append(from_plain(kind, item, PlanFileError))
    return tuple(shapes)


_POINTS = 72


@dataclass(frozen=True)
class PlannedTarget(ABC):
    """The fields of every target of a plan: kind, value and permitted error.

    Attributes
    ----------
    kind : str
        Kind of the dimension, see `Dimension`.
    entities : tuple of str
        Ids of the entities that must be visible.
    geometry : tuple of Line or Circle
        Their lines and circles, mm, in the part's frame.
    permitted_error : float
        Largest permitted error, mm (angles: degrees).
    localisation : Localisation
        Model of the errors of image points.
    """

    kind: str
    entities: tuple[str, ...]
    geometry: tuple[Geometry, ...] = field(repr=False, compare=False)
    permitted_error: float
    localisation: Localisation
    in_image: ClassVar[bool] = False
    """Whether the value is a length in the image, as that of an edge."""
    words: ClassVar[TargetWords] = DIMENSIONS
    """How pages and tables speak of it."""
    n_features = 1
    surfaces_mm = 0.0

    @cached_property
    def measurand(self) -> Measurand:
        """The value and its planes."""
        return measurand(self.kind, self.geometry)

    @property
    def ways(self) -> tuple[tuple[str, ...], ...]:
        """Sets of ids of entities, any of which measures it."""
        return (self.entities,)

    @property
    def nominal(self) -> float:
        """Nominal value, mm (angles: degrees)."""
        return self.measurand.nominal

    @property
    def unit(self) -> str:
        """Unit of its values, "mm" or "deg"."""
        return self.measurand.unit

    @property
    def tolerance(self) -> tuple[float, float] | None:
        """Lower and upper deviation that the drawing allows; None of a target without them."""
        return None

    @property
    @abstractmethod
    def requirement_texts(self) -> tuple[str, str]:
        """What is measured, its tolerance if it has one, and the permitted error."""

    @property
    def share_text(self) -> str:
        """Share of its tolerance that the permitted error is; empty without a tolerance."""
        return ""

    @property
    def value_text(self) -> str:
        """Kind, nominal value and unit."""
        return f"{self.kind.replace('_', ' ')} {self.nominal:.3f} {self.unit}"

    @property
    def points(self) -> NDArray[np.float64]:
        """Points (n, 3) of its entities, among them the ends of lines; mm."""
        ends = [np.array([item.p, item.q]) for item in self.geometry if isinstance(item, Line)]
        return np.concatenate([*(sample_points(item, _POINTS) for item in self.geometry), *ends])

    @abstractmethod
    def permitted_error_px(self, cam2world: NDArray[np.float64], camera: Camera) -> float | None:
        """Return the permitted error in the image of a pose, px; None of an angle."""

    def describe(self, cam2world: NDArray[np.float64], means: Means) -> Prediction:
        """Return how accurately a pose measures the target.

        Parameters
        ----------
        cam2world : array (4, 4)
            The pose.
        means : Means
            Gives the camera and the uncertainty of its pose.

        Returns
        -------
        Prediction
            Probability, uncertainty and its budget.
        """
        found_by = replace(means, localisation=self.localisation, surfaces_mm=self.surfaces_mm)
        model = measurand_model(self.measurand, self.permitted_error, found_by)
        return model.describe(np.linalg.inv(cam2world))


@dataclass(frozen=True)
class PlannedLength(PlannedTarget):
    """The length of an edge as in the paper: both ends on whole pixels, the error a share of the image's length.

    Attributes
    ----------
    ends : array (2, 3)
        Both ends, mm.
    accuracy : float
        Required accuracy A.
    """

    ends: NDArray[np.float64] = field(repr=False, compare=False)
    accuracy: float
    in_image = True
    words = EDGES

    @classmethod
    def of(cls, name: str, ends: NDArray[np.float64], accuracy: float) -> PlannedLength:
        """Return the length of an edge (2, 3), mm, at an accuracy."""
        length = float(np.linalg.norm(ends[1] - ends[0]))
        line = Line(ends[0], ends[1])
        permitted = (1 - accuracy) * length
        return cls("length", (name,), (line,), permitted, Localisation.rounding(), ends, accuracy)

    @property
    def nominal(self) -> float:
        """Its length, mm."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    @property
    def points(self) -> NDArray[np.float64]:
        """Both ends (2, 3), mm."""
        return self.ends

    @property
    def requirement_texts(self) -> tuple[str, str]:
        """What is measured, and the permitted error."""
        return "length", f"error up to {percent_text(1 - self.accuracy)}"

    def permitted_error_px(self, cam2world: NDArray[np.float64], camera: Camera) -> float:
        """Return the share of the length of its image, px."""
        in_camera = world_to_cam(self.ends, cam2world)
        pixels = (in_camera / in_camera[:, 2:] @ camera.matrix.T)[:, :2]
        return (1 - self.accuracy) * float(np.linalg.norm(pixels[1] - pixels[0]))


@dataclass(frozen=True)
class PlannedDimension(PlannedTarget):
    """A dimension as a plan stores it.

    Attributes
    ----------
    kind : str
        Kind of the dimension, see `Dimension`.
    entities : tuple of str
        Ids of the entities that must be visible.
    geometry : tuple of Line or Circle
        Their lines and circles, mm, in the part's frame.
    permitted_error : float
        Largest permitted error, mm (angles: degrees).
    localisation : Localisation
        Model of the errors of image points.
    tolerance : (float, float) or None
        Lower and upper deviation that the drawing allows, mm (angles: degrees).
    direction : (float, float, float) or None
        Direction of a distance.
    n_features : int
        Number of features that it stands for. The entities measure one of them.
    surfaces_mm : float
        Standard deviation of a face's position along its normal, mm.
    surfaces_from : str
        The tolerance of the model that it follows from; empty if it is the default or was given.
    witnesses : tuple of PlannedWitness
        The sets of entities, each of which gives the value, where there are several; the first is
        that of ``entities`` and ``geometry``.
    """

    tolerance: tuple[float, float] | None = None
    direction: tuple[float, float, float] | None = None
    n_features: int = 1
    surfaces_mm: float = 0.0
    surfaces_from: str = ""
    witnesses: tuple[PlannedWitness, ...] = ()

    @classmethod
    def of(
        cls,
        target: DimensionTarget,
        localisation: Localisation | None,
        surfaces_mm: float = 0.0,
    ) -> PlannedDimension:
        """Return the stored form of a dimension that was resolved on the part.

        Parameters
        ----------
        target : DimensionTarget
            The dimension.
        localisation : Localisation or None
            Model of the errors of image points; None is rounding to whole pixels.
        surfaces_mm : float
            Standard deviation of a face's position along its normal, mm.

        Returns
        -------
        PlannedDimension
            The dimension without the part.
        """
        first = target.witnesses[0]
        ways = tuple(
            PlannedWitness(one.entities, one.measurand.geometry) for one in target.witnesses
        )
        return cls(
            first.measurand.kind,
            first.entities,
            first.measurand.geometry,
            target.max_error,
            localisation or Localisation.rounding(),
            target.dimension.tolerance,
            target.dimension.direction,
            target.dimension.n_features,
            surfaces_mm,
            target.dimension.surfaces_from,
            ways if len(ways) > 1 else (),
        )

    def choosing(self, k: int) -> PlannedDimension:
        """Return the dimension as its witness k measures it, from 0.

        Parameters
        ----------
        k : int
            Number of the witness. Without several witnesses, only 0.

        Returns
        -------
        PlannedDimension
            With the entities and the geometry of that witness.

        Raises
        ------
        PlanFileError
            If it has no such witness.
        """
        if k == 0:
            return self
        if not 0 < k < len(self.witnesses):
            raise PlanFileError(
                f"witness must be below {max(1, len(self.witnesses))}, the number of the "
                f"dimension's witnesses. Got {k}."
            )
        return self._by_witness[k]

    @cached_property
    def _by_witness(self) -> list[PlannedDimension]:
        return [
            replace(self, entities=way.entities, geometry=way.geometry) for way in self.witnesses
        ]

    @cached_property
    def measurand(self) -> Measurand:
        """The value and its planes."""
        return measurand(self.kind, self.geometry, self.direction)

    @property
    def ways(self) -> tuple[tuple[str, ...], ...]:
        """Sets of ids of entities, any of which measures it."""
        return tuple(one.entities for one in self.witnesses) or (self.entities,)

    def permitted_error_px(self, cam2world: NDArray[np.float64], camera: Camera) -> float | None:
        """Return the permitted error in the image of a pose, px; None for an angle.

        The scale is d / (z r). z is the mean depth of the entities, r the larger pixel pitch.

        Parameters
        ----------
        cam2world : array (4, 4)
            The pose.
        camera : Camera
            The camera.

        Returns
        -------
        float or None
            In px of the larger pitch.
        """
        if self.unit != "mm":
            return None
        depth = float(world_to_cam(self.points, cam2world)[:, 2].mean())
        scale = camera.image_distance_mm / (depth * max(camera.pixel_pitch_mm))
        return self.permitted_error * scale

    @property
    def requirement_texts(self) -> tuple[str, str]:
        """The target, its tolerance if it has one, and the permitted error with its share of it."""
        nominal = f"{self.kind.replace('_', ' ')} {self.nominal:.6g} {self.unit}"
        error = f"error up to {self.permitted_error:.4g} {self.unit}"
        if self.tolerance is None:
            return nominal, error
        if is_one_sided(self.tolerance):
            return f"{nominal} {tolerance_text(self.tolerance)}", error
        share = self._share(self.tolerance)
        return f"{nominal} {tolerance_text(self.tolerance)}", f"{error} ({share})"

    @property
    def share_text(self) -> str:
        """Share of its tolerance that the permitted error is, such as "25 % of ±0.05".

        Of an uneven tolerance of width T "25 % of T/2"; empty without a tolerance, or if it has one limit.
        """
        if self.tolerance is None or is_one_sided(self.tolerance):
            return ""
        lower, upper = self.tolerance
        width = f"±{upper:.4g}" if lower == -upper else "T/2"
        return f"{self._share(self.tolerance)} of {width}"

    def _share(self, tolerance: tuple[float, float]) -> str:
        """Return the permitted error in percent of half the width of a tolerance."""
        half = (tolerance[1] - tolerance[0]) / 2
        return percent_text(self.permitted_error / half)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON, with the nominal value and its unit.

        Returns
        -------
        dict
            Lists, texts and numbers.
        """
        return {
            "kind": self.kind,
            "unit": self.unit,
            "nominal": self.nominal,
            "tolerance": plain_tolerance(self.tolerance),
            "permitted_error": self.permitted_error,
            "entities": list(self.entities),
            "geometry": [to_plain(item) for item in self.geometry],
            "direction": None if self.direction is None else list(self.direction),
            "localisation": to_plain(self.localisation, defaults=True),
            "n_features": self.n_features,
            "surfaces_mm": self.surfaces_mm,
            "surfaces_from": self.surfaces_from,
            **({"witnesses": [one.to_dict() for one in self.witnesses]} if self.witnesses else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PlannedDimension:
        """Build from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        PlannedDimension
            Equal to the one written.

        Raises
        ------
        PlanFileError
            If fields contradict each other.
        """
        try:
            made = cls(
                data["kind"],
                tuple(data["entities"]),
                _geometry_of(data),
                data["permitted_error"],
                from_plain(Localisation, data["localisation"], PlanFileError),
                None if data["tolerance"] is None else checked_tolerance(data["tolerance"]),
                None if data["direction"] is None else tuple(data["direction"]),
                # files of earlier programs do not state these
                data.get("n_features", 1),
                data.get("surfaces_mm", 0.0),
                data.get("surfaces_from", ""),
                tuple(map(PlannedWitness.from_dict, data.get("witnesses", ()))),
            )
            nominal = made.nominal
        except (MeasurandError, ValueError, TypeError, KeyError) as error:
            raise PlanFileError(f"must be a dimension that can be measured. Got: {error}") from None
        if abs(nominal - data["nominal"]) > 1e-6 * max(1.0, abs(nominal)):
            raise PlanFileError(
                f"nominal must be that of the geometry, {nominal:.9g}. Got {data['nominal']!r}."
            )
        return made

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PlannedDimension):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]


def planned(target: Target, means: Means) -> PlannedTarget:
    """Return what a plan keeps of a target that was resolved on the part."""
    if isinstance(target, DimensionTarget):
        return PlannedDimension.of(target, means.localisation, target.surfaces_mm(means))
    return PlannedLength.of(target.name, target.witness.ends, means.accuracy)


class _Chosen(Protocol):
    """A setting: which targets it measures, and by which witness."""

    @property
    def entities(self) -> Sequence[str]:
        """Names of what it measures."""


def targets_of(
    targets: Mapping[str, PlannedTarget], setting: _Chosen
) -> Mapping[str, PlannedTarget]:
    """Return targets of a plan, by name, as a setting measures them: each by the witness used there."""
    chosen: Mapping[str, int] = getattr(setting, "witness", {})
    if not chosen:
        return targets
    return {**targets, **{name: _choosing(targets[name], k) for name, k in chosen.items()}}


def _choosing(target: PlannedTarget, k: int) -> PlannedTarget:
    return target.choosing(k) if isinstance(target, PlannedDimension) else target


def words_of(targets: Mapping[str, PlannedTarget]) -> TargetWords:
    """Return the words for the targets of a plan, given by name."""
    kinds = {target.words for target in targets.values()}
    if len(kinds) > 1:
        return MIXED
    if DIMENSIONS in kinds and any(map(is_characteristic, targets)):
        return CHARACTERISTICS
    return kinds.pop() if kinds else EDGES


def sample_points(geometry: Geometry, n: int) -> NDArray[np.float64]:
    """Return n points at the middles of equal parts of a line or circle; (n, 3) mm."""
    shares = (np.arange(n) + 0.5) / n
    if isinstance(geometry, Circle):
        return geometry.points(shares * geometry.span_rad)
    return np.asarray(geometry.p + shares[:, None] * (geometry.q - geometry.p))
