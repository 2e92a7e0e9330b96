"""What is to be inspected, resolved on the part: entities to be seen, points to be imaged, a value to be measured.

A *target* is one named item of a request. Any of its *witnesses* gives its value; each is a set of entities that must
be seen together in one image. A target owns its error model: how probable it is that the value is accurate, what that
needs of every pose, and how uncertain the value is. There are two models, of an edge (the paper's density of image
lengths) and of a dimension (a measurand); see `planner.request.models`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from errors.checks import percent_text
from errors.measurands import (
    Circle,
    Line,
    Localisation,
    Measurand,
    Position,
    end_groups,
    end_of_value,
)
from errors.measurands import can_be_split as measurand_can_be_split
from errors.measurands.geometry import Geometry
from errors.measurands.measurand import measurand
from ground.convert import STATED, Meta
from ground.short_repr import short_repr
from planner.camera.camera import Camera
from planner.camera.pose import world_to_cam
from planner.exceptions import PlanFileError, RequestError
from planner.plan_file import Count
from planner.request.dimension import (
    POSITIONS,
    Dimension,
    MaterialCondition,
    half_width,
    is_one_sided,
    zone_text,
)
from planner.request.edge_state import SHARP, EdgeState
from planner.request.models import (
    DimensionModels,
    EdgeModels,
    Means,
    TargetModels,
    key_of,
    measurand_model,
)
from planner.request.registration import PoseKnowledge, symmetric
from planner.request.words import (
    CHARACTERISTICS,
    DIMENSIONS,
    EDGES,
    MIXED,
    TargetWords,
    amount_text,
    is_characteristic,
    limit_text,
    tolerance_text,
)

if TYPE_CHECKING:
    from typing import Self

    from aspectgraph import Entity, Solid
    from errors.measurands import MeasurandModel, Prediction


_DIAMETERS = 8
"""Diameters of a circle that must be in the picture; a polygon of twice as many corners is drawn around the circle."""
# of an entity, that tell where it is in the image
_POINTS = 72
# a probability below this says little of how large the errors are
_LEAST = 0.05


def knowledge_of(
    targets: Sequence[Target], means: Means, cam2world: NDArray[np.float64]
) -> PoseKnowledge:
    """Return what registration to the part's own edges tells of a pose, and of targets there.

    Parameters
    ----------
    targets : sequence of Target
        Each with one witness.
    means : Means
        Holds how the edges register.
    cam2world : array (4, 4)
        The pose.
    """
    own_edges = means.own_edges
    if own_edges is None:
        raise ValueError("own_edges must be given. Got none.")
    inverse = np.linalg.inv(np.asarray(cam2world, dtype=np.float64))[None]
    dimensions = [target for target in targets if isinstance(target, PlannedDimension)]
    edges = [target for target in targets if not isinstance(target, PlannedDimension)]
    keys = [key_of(target.name, target.witness.entities) for target in edges]
    known = own_edges.poses_of(inverse, np.zeros(len(edges), dtype=np.int64), keys)
    covariance = symmetric(known.covariance[0]).covariance
    by_edge = {
        target.name: symmetric(root @ root.T).covariance
        for target, root in zip(edges, known.roots, strict=True)
    }
    if not dimensions:
        return PoseKnowledge(covariance, by_edge=by_edge)
    models = PlannedDimension.models(dimensions, means)
    columns = np.arange(len(dimensions))
    knowledge = models.known(own_edges, inverse, np.zeros(len(columns), dtype=np.int64), columns)
    excess = np.sqrt(np.maximum(knowledge.variance - knowledge.by_pose, 0.0))
    scales = [model.scale(inverse) for model in models.models]
    by_surfaces = {
        target.name: float(deviation / scale) if scale > 0 else 0.0
        for target, deviation, scale in zip(dimensions, excess, scales, strict=True)
    }
    return PoseKnowledge(covariance, by_surfaces, by_edge)


EDGE = "edge"


@dataclass(frozen=True)
class EntityRecord:
    """An entity of the part, as requests and plans state it.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        "edge", "rim" or "arc".
    edges : tuple of int
        Ids of its edges in the part; empty of an edge that was given by its ends.
    part : str
        What it is a part of an edge, rim or arc, such as ``17[0:1/4]``; empty if it is a whole one.
    """

    name: str
    kind: str
    edges: Annotated[tuple[Count, ...], STATED, Meta(title="must be an array of ids")] = ()
    part: Annotated[str, STATED] = ""

    @classmethod
    def of(cls, entity: Any, name: str = "") -> EntityRecord:
        """Return the record of an entity of a space, under its own name or another one."""
        edges = tuple(int(edge) for edge in getattr(entity, "edge_ids", ()))
        part = getattr(entity, "part", None)
        kind = getattr(entity, "kind", EDGE)
        return cls(name or entity.name, kind, edges, "" if part is None else str(part))

    def entity_of(self, solid: Solid) -> Entity:
        """Return the entity of the part under its name."""
        from aspectgraph import resolve_entities

        return resolve_entities(solid, {self.name: self._item(solid)})[self.name]

    def _item(self, solid: Solid) -> Any:
        """Return what stands for it in a request."""
        from aspectgraph import Entity, parse_part

        if self.part:
            return parse_part(self.part)
        if self.kind != EDGE:
            curves = {curve.edge_ids: curve for curve in (*solid.rims(), *solid.arcs())}
            return curves[self.edges]
        if len(self.edges) == 1:
            return self.edges[0]
        first = solid.edge_points(self.edges[0])
        last = solid.edge_points(self.edges[-1])
        # of a chain of collinear edges the ends are farthest apart
        return Entity(self.name, _farthest(np.concatenate([first, last])), self.edges)


@dataclass(frozen=True)
class Witness:
    """Entities that in one image give the value of a target.

    Attributes
    ----------
    records : tuple of EntityRecord
        The entities, which must be observable as a whole and together.
    measurand : Measurand
        The value and its geometry.
    """

    records: tuple[EntityRecord, ...]
    measurand: Measurand = field(repr=False, compare=False)

    @cached_property
    def entities(self) -> tuple[str, ...]:
        """Names of the entities."""
        return tuple(record.name for record in self.records)

    @property
    def geometry(self) -> tuple[Geometry, ...]:
        """Lines and circles, mm, in the part's frame."""
        return self.measurand.geometry

    @cached_property
    def ends(self) -> NDArray[np.float64]:
        """Two points (2, 3) of the entities, far apart, mm.

        What holds for every pose that inspects the target, holds for them; the lower bound and the sampling of poses
        rest on them.
        """
        return _farthest(np.concatenate([_points_on(item) for item in self.geometry]))

    @property
    def segments(self) -> NDArray[np.float64]:
        """Pairs of points (s, 2, 3) that must be in the picture and in focus, mm.

        Those of a circle are drawn around it, so the whole circle is in the picture if they are.
        """
        return self._picture[0]

    @property
    def resolved(self) -> NDArray[np.bool_]:
        """Whose images must be long enough, (s,)."""
        return self._picture[1]

    @cached_property
    def _picture(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        pieces = [_segments(item) for item in self.geometry]
        segments, resolved = zip(*pieces, strict=True)
        return np.concatenate(segments), np.concatenate(resolved)


@dataclass(frozen=True)
class Target(ABC):
    """One named item of a request, resolved on the part: what requests hold, plans store, and reports speak of.

    Attributes
    ----------
    name : str
        Its name.
    witnesses : tuple of Witness
        Any of them gives the value. The first is preferred.
    localisation : Localisation
        Model of the errors of image points; that of the request, once `measured_with` has stated it.
    """

    name: str
    witnesses: tuple[Witness, ...]
    localisation: Localisation = field(
        default_factory=Localisation.rounding, repr=False, kw_only=True
    )
    in_image: ClassVar[bool] = False
    """Whether the value is a length in the image: then the ends must be found there, as `Detectability` says."""
    words: ClassVar[TargetWords] = DIMENSIONS
    """How pages and tables speak of it."""
    n_features = 1
    surfaces_mm = 0.0

    if TYPE_CHECKING:
        # fields of one kind, and properties of the other
        @property
        def kind(self) -> str:
            """Kind of the value, see `Dimension`."""

        @property
        def permitted_error(self) -> float:
            """Largest permitted error, mm (angles: degrees)."""

    @property
    def has_corners(self) -> bool:
        """Whether the value is measured from corner to corner: that of an edge, and a dimension that is a length."""
        return bool(self.measurand.in_image)

    @property
    def tolerance(self) -> tuple[float, float] | None:
        """Lower and upper deviation that the drawing allows; None of a target without them."""
        return None

    @property
    def material(self) -> MaterialCondition | None:
        """What widens the zone of a position; None of all else."""
        return None

    @property
    def datum_names(self) -> tuple[str, ...]:
        """What its datums are called; empty of all but a position."""
        return ()

    @property
    def nominal_text(self) -> str:
        """The nominal value with its unit."""
        return amount_text(f"{self.nominal:.6g}", self.unit)

    @property
    def witness(self) -> Witness:
        """The only witness. Of a target with several, `choosing` returns one with a single witness."""
        (witness,) = self.witnesses
        return witness

    def choosing(self, k: int, name: str | None = None) -> Self:
        """Return the same target with one of its witnesses, under its own name or another one.

        Parameters
        ----------
        k : int
            Number of the witness, from 0.
        name : str, optional
            The other name.

        Returns
        -------
        Target
            With that witness alone.

        Raises
        ------
        PlanFileError
            If it has no such witness.
        """
        if not 0 <= k < len(self.witnesses):
            raise PlanFileError(
                f"witness must be below {len(self.witnesses)}, the number of the target's witnesses. Got {k}."
            )
        return replace(self, name=name or self.name, witnesses=(self.witnesses[k],))

    def remedy(
        self, best: float, required: float, budget: Mapping[str, float] | None = None
    ) -> str:
        """Say what would help where no pose is sure enough; empty where nothing is known.

        Parameters
        ----------
        best : float
            Probability that the best pose reaches.
        required : float
            Probability that is required.
        budget : mapping of str to float, optional
            Variance by source at that pose, as a `Prediction` has it.

        Returns
        -------
        str
            A sentence, or nothing.
        """
        return ""

    @abstractmethod
    def measured_with(self, means: Means) -> Self:
        """Return the target with what it has from the request: localisation, surfaces and accuracy."""

    @property
    def entities(self) -> tuple[str, ...]:
        """Names of the entities of the preferred witness."""
        return self.witnesses[0].entities

    @property
    def geometry(self) -> tuple[Geometry, ...]:
        """Their lines and circles, mm, in the part's frame."""
        return self.witnesses[0].geometry

    @property
    def ends(self) -> NDArray[np.float64]:
        """Two points (2, 3) of them, far apart, mm."""
        return self.witnesses[0].ends

    @property
    def measurand(self) -> Measurand:
        """The value and its geometry, as the preferred witness gives them."""
        return self.witnesses[0].measurand

    @property
    def ways(self) -> tuple[tuple[str, ...], ...]:
        """Sets of names of entities, any of which measures it."""
        return tuple(witness.entities for witness in self.witnesses)

    @property
    def nominal(self) -> float:
        """Nominal value, mm (angles: degrees)."""
        return self.measurand.nominal

    @property
    def unit(self) -> str:
        """Unit of its values, "mm" or "deg"."""
        return self.measurand.unit

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
        return f"{self.kind.replace('_', ' ')} {amount_text(f'{self.nominal:.3f}', self.unit)}"

    @property
    def points(self) -> NDArray[np.float64]:
        """Points (n, 3) of its entities, among them the ends of lines; mm."""
        ends = [np.array([item.p, item.q]) for item in self.geometry if isinstance(item, Line)]
        return np.concatenate([*(sample_points(item, _POINTS) for item in self.geometry), *ends])

    @abstractmethod
    def permitted_error_px(self, cam2world: NDArray[np.float64], camera: Camera) -> float | None:
        """Return the permitted error in the image of a pose, px; None of an angle."""

    @classmethod
    @abstractmethod
    def models(cls, targets: Sequence[Any], means: Means) -> TargetModels:
        """Return how probably targets of this kind are measured accurately."""

    @abstractmethod
    def error_at(self, accuracy: float) -> float:
        """Return the largest error that counts as accurate, mm (angles: degrees)."""

    @abstractmethod
    def least_image_mm(self, accuracy: float, quantile_mm: float, min_length_mm: float) -> float:
        """Return the least length of the image of `Witness.ends` that every inspecting pose has, mm.

        Parameters
        ----------
        accuracy : float
            Required accuracy A.
        quantile_mm : float
            Least quantile of the quantization error of a length, see `planner.bound.pose_space`.
        min_length_mm : float
            Shortest image that constraints allow.
        """

    def probability(self, cam2world: NDArray[np.float64], means: Means) -> NDArray[np.float64]:
        """Return how probably the value is accurate.

        Parameters
        ----------
        cam2world : array (n, 4, 4)
            Poses.
        means : Means
            Those of the request.

        Returns
        -------
        array (n,)
            P.
        """
        everything = np.ones((len(cam2world), 1), dtype=bool)
        return self.models([self], means).probability_where(cam2world, everything)

    def description(self, means: Means) -> MeasurandModel:
        """Return the model that describes uncertainty and budget of the value at a pose."""
        return measurand_model(self.measurand, self.error_at(means.accuracy), means)

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
        model = self.description(replace(means, localisation=self.localisation))
        return model.describe(np.linalg.inv(cam2world))

    def item_of(self, solid: Solid) -> Any:
        """Return the target as `plan_inspection` takes it, on a part."""
        return self.witnesses[0].records[0].entity_of(solid)


@dataclass(frozen=True)
class EdgeTarget(Target):
    """An edge whose length is measured as in the paper, both ends on whole pixels, at the accuracy of the request.

    Attributes
    ----------
    accuracy : float
        Required accuracy A; that of the request, once `measured_with` has stated it.
    """

    accuracy: float = field(default=0.98, repr=False, kw_only=True)
    in_image = True
    words = EDGES

    @classmethod
    def models(cls, targets: Sequence[Target], means: Means) -> TargetModels:
        """Return the paper's density for all edges together; it is evaluated for many at once."""
        keys = [key_of(target.name, target.witness.entities) for target in targets]
        return EdgeModels(np.array([target.witness.ends for target in targets]), means, keys)

    def measured_with(self, means: Means) -> Self:
        """Return the edge with the accuracy of the request; its ends lie on whole pixels."""
        return replace(self, accuracy=means.accuracy)

    @property
    def kind(self) -> str:
        """Kind of the value."""
        return "length"

    @property
    def permitted_error(self) -> float:
        """Largest permitted error, mm."""
        return self.error_at(self.accuracy)

    def error_at(self, accuracy: float) -> float:
        """Return the same share of the length as of the image's length, mm."""
        return (1.0 - accuracy) * self.nominal

    def least_image_mm(self, accuracy: float, quantile_mm: float, min_length_mm: float) -> float:
        """Return the length in which the quantization error is small enough, or the one that is asked for."""
        half_width = 0.5 * (math.log(2.0 - accuracy) - math.log(accuracy))
        return max(min_length_mm, quantile_mm / half_width)

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
class PlannedDimension(Target):
    """A dimension of the drawing, resolved on the part, with its own permitted error.

    Attributes
    ----------
    name : str
        Its name.
    witnesses : tuple of Witness
        The sets of entities, each of which gives the value. The first is preferred.
    kind : str
        Kind of the dimension, see `Dimension`.
    permitted_error : float
        Largest permitted error, mm (angles: degrees).
    localisation : Localisation
        Model of the errors of image points.
    tolerance : (float, float) or None
        Lower and upper deviation that the drawing allows, mm (angles: degrees); one may be infinite.
    share : float or None
        Part of the tolerance's half width that is permitted as error; None of one without a width.
    direction : (float, float, float) or None
        Direction of a distance.
    n_features : int
        Number of features that it stands for. The entities measure one of them.
    stated_surfaces_mm : float or None
        Standard deviation of the position of its faces along their normals, mm, where the dimension states its own.
    surfaces_from : str
        The tolerance of the model that this follows from; empty if it was given.
    edge_break_mm : (float, float) or None
        By how much its edges are broken, least and most, mm, where the dimension states its own.
    material : MaterialCondition or None
        What widens the zone of a position.
    groups : tuple of int
        Number of entities of each datum of a position, see `Dimension`.
    frame : tuple of str
        Names of its datums in the drawing, see `Dimension`.
    surfaces_mm : float
        The same, or that of the request, once `measured_with` has stated it.
    edges : EdgeState
        By how much its edges are broken, by itself or by the request, once `measured_with` has stated it.
    """

    kind: str
    permitted_error: float
    tolerance: tuple[float, float] | None = None
    share: float | None = None
    direction: tuple[float, float, float] | None = None
    n_features: int = 1
    stated_surfaces_mm: float | None = None
    surfaces_from: str = ""
    edge_break_mm: tuple[float, float] | None = None
    material: MaterialCondition | None = None
    groups: tuple[int, ...] = ()
    frame: tuple[str, ...] = ()
    surfaces_mm: float = field(default=0.0, repr=False, kw_only=True)
    edges: EdgeState = field(default=SHARP, repr=False, kw_only=True)

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        name: str,
        witnesses: tuple[Witness, ...],
        dimension: Dimension,
        permitted_error: float,
        material: MaterialCondition | None = None,
    ) -> PlannedDimension:
        """Return what a dimension is on the part.

        Parameters
        ----------
        name : str
            Its name.
        witnesses : tuple of Witness
            The sets of entities that give its value.
        dimension : Dimension
            The dimension as it was given; a tolerance class has become limits.
        permitted_error : float
            Largest permitted error, mm (angles: degrees).
        material : MaterialCondition, optional
            What widens the zone of a position.

        Returns
        -------
        PlannedDimension
            The dimension on the part.
        """
        has_width = dimension.tolerance is not None and not is_one_sided(dimension.tolerance)
        return cls(
            name,
            witnesses,
            dimension.kind,
            float(permitted_error),
            dimension.tolerance,
            dimension.share if has_width else None,
            dimension.direction,
            dimension.n_features,
            dimension.surfaces_mm,
            dimension.surfaces_from,
            dimension.edge_break_mm,
            material,
            dimension.groups,
            dimension.frame,
        )

    @classmethod
    def models(cls, targets: Sequence[PlannedDimension], means: Means) -> DimensionModels:
        """Return the models of the measurands.

        Parameters
        ----------
        targets : sequence of PlannedDimension
            Each with one witness.
        means : Means
            Those of the request.

        Returns
        -------
        DimensionModels
            They give P of many poses at once.
        """
        return DimensionModels(
            [target.description(means) for target in targets],
            means.own_edges,
            [key_of(target.name, target.witness.entities) for target in targets],
        )

    def measured_with(self, means: Means) -> Self:
        """Return the dimension with the localisation of the request, and its surfaces where it states none.

        Parameters
        ----------
        means : Means
            Those of the request.

        Returns
        -------
        PlannedDimension
            A new one.
        """
        return replace(
            self,
            localisation=means.localisation or Localisation.rounding(),
            surfaces_mm=self.surfaces_with(means),
            edges=self.edges_with(means),
        )

    def edges_with(self, means: Means) -> EdgeState:
        """Return by how much its edges are broken: what it states itself, or the request.

        Parameters
        ----------
        means : Means
            Those of the request.

        Returns
        -------
        EdgeState
            The breaks.
        """
        return means.edges if self.edge_break_mm is None else EdgeState(*self.edge_break_mm, True)

    def surfaces_with(self, means: Means) -> float:
        """Return the standard deviation of the position of its faces: its own, or that of the request.

        Parameters
        ----------
        means : Means
            Those of the request.

        Returns
        -------
        float
            mm.
        """
        return means.surfaces_mm if self.stated_surfaces_mm is None else self.stated_surfaces_mm

    def error_at(self, accuracy: float) -> float:
        """Return the permitted error, which the dimension states itself.

        Parameters
        ----------
        accuracy : float
            That of the request; it does not matter here.

        Returns
        -------
        float
            mm (angles: degrees).
        """
        return self.permitted_error

    def description(self, means: Means) -> MeasurandModel:
        """Return the model of the value with the dimension's own faces.

        Parameters
        ----------
        means : Means
            Those of the request.

        Returns
        -------
        MeasurandModel
            It describes uncertainty and budget.
        """
        surfaces_mm = self.surfaces_with(means)
        edges = self.edges_with(means)
        return super().description(replace(means, surfaces_mm=surfaces_mm, edges=edges))

    def describe(self, cam2world: NDArray[np.float64], means: Means) -> Prediction:
        """Return how accurately a pose measures the dimension, by the localisation, surfaces and edges it states.

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
        means = replace(means, surfaces_mm=self.surfaces_mm, edges=self.edges)
        return super().describe(cam2world, means)

    def least_image_mm(self, accuracy: float, quantile_mm: float, min_length_mm: float) -> float:
        """Return 0: how short an image of two of its points may be, follows from no constraint.

        Parameters
        ----------
        accuracy, quantile_mm, min_length_mm : float
            They do not matter here.

        Returns
        -------
        float
            0.
        """
        return 0.0

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
        nominal = f"{self.kind.replace('_', ' ')} {amount_text(f'{self.nominal:.6g}', self.unit)}"
        if self.kind in POSITIONS and self.tolerance is not None:
            share = self._share(self.tolerance)
            error = f"error up to {amount_text(f'{self.permitted_error:.4g}', self.unit)} ({share})"
            return f"{self.kind.replace('_', ' ')} in {self.nominal_text}", error
        error = f"error up to {amount_text(f'{self.permitted_error:.4g}', self.unit)}"
        if self.tolerance is None:
            return nominal, error
        if is_one_sided(self.tolerance):
            return f"{nominal} {tolerance_text(self.tolerance)}", error
        share = self._share(self.tolerance)
        return f"{nominal} {tolerance_text(self.tolerance)}", f"{error} ({share})"

    @property
    def nominal_text(self) -> str:
        """The nominal value with its unit; of a position its zone and datums, because its nominal value is 0."""
        if self.kind not in POSITIONS or self.tolerance is None:
            return super().nominal_text
        widened = "" if self.material is None else f" ({self.material.condition})"
        zone = zone_text(self.kind, self.tolerance[1])
        return " | ".join((f"{zone} {self.unit}{widened}", *self.datum_names))

    @property
    def datum_names(self) -> tuple[str, ...]:
        """Names of the datums of a position in the drawing. Without them, names of the entities that show them."""
        if self.frame or not isinstance(self.measurand, Position):
            return self.frame
        return tuple(self.measurand.datum_names(self.entities))

    @property
    def share_text(self) -> str:
        """Share of its tolerance that the permitted error is, such as "25 % of ±0.05".

        Of an uneven tolerance of width T "25 % of T/2"; empty without a tolerance, or if it has one limit.
        """
        if self.tolerance is None or is_one_sided(self.tolerance):
            return ""
        lower, upper = self.tolerance
        width = "T/2"
        if lower == -upper:
            width = f"±{upper:.4g}"
        elif self.kind in POSITIONS:
            width = zone_text(self.kind, upper)
        return f"{self._share(self.tolerance)} of {width}"

    def _share(self, tolerance: tuple[float, float]) -> str:
        """Return the permitted error in percent of half the width of a tolerance."""
        return percent_text(self.permitted_error / half_width(self.kind, tolerance))

    def remedy(
        self, best: float, required: float, budget: Mapping[str, float] | None = None
    ) -> str:
        """Say what a pose whose probability is too low would do for: a larger permitted error, or none.

        Its errors are taken to be normal. The probability is to be halfway from the required one to 1, because
        P_all asks for more than the error alone.

        Parameters
        ----------
        best : float
            Probability that the pose reaches.
        required : float
            Probability that is required.
        budget : mapping of str to float, optional
            Variance by source at that pose, as a `Prediction` has it. The text names what limits most.

        Returns
        -------
        str
            Sentences. Of a position, whose error has two directions, and without a share of a tolerance, only the one
            on the budget.
        """
        limit = limit_text(budget or {}, self.edges)
        if self.share is None or self.tolerance is None or self.kind in POSITIONS or best < _LEAST:
            return limit
        times = float(ndtri(0.5 + (1.0 + required) / 4.0) / ndtri((1.0 + best) / 2.0))
        # a share is stated by two digits, and no less than it needs
        share = math.ceil(100.0 * times * self.share) / 100.0
        if share > 1.0:
            return f"No share of the tolerance would do there. {limit}".rstrip()
        error = share * half_width(self.kind, self.tolerance)
        amount = amount_text(f"{error:.4g}", self.unit)
        return f"An error of up to {amount}, a share of {share:g}, would do there. {limit}".rstrip()

    def is_limited_by_part(self, budget: Mapping[str, float], required: float) -> bool:
        """Return whether edges and faces of the part alone make the probability too low, for any camera.

        Errors are taken to be normal. Of a position, whose error has two directions, it is not known.

        Parameters
        ----------
        budget : mapping of str to float
            Variance by source, as a `Prediction` has it.
        required : float
            Probability that is required.

        Returns
        -------
        bool
            True if a perfect image of a perfect pose would not do.
        """
        if self.kind in POSITIONS:
            return False
        variance = budget.get("edge_state", 0.0) + budget.get("surfaces", 0.0)
        largest = self.permitted_error / float(ndtri((1.0 + required) / 2.0))
        return variance > largest**2

    def item_of(self, solid: Solid) -> Dimension:
        """Return the dimension as `plan_inspection` takes it, on a part.

        Parameters
        ----------
        solid : Solid
            The part.

        Returns
        -------
        Dimension
            With the entities of the part.
        """
        ways = [
            tuple(record.entity_of(solid) for record in witness.records)
            for witness in self.witnesses
        ]
        # what has no width has an error of its own
        error: dict[str, Any] = {"max_error": self.permitted_error}
        if self.share is not None:
            error = {"share": self.share}
        if self.material is not None:
            assert isinstance(self.measurand, Position), "only a position has a condition"
            error["material"] = self.material.condition
            error["size"] = self.material.deviations(self.measurand.size_mm)
        return Dimension(
            self.kind,
            ways[0],
            tolerance=self.tolerance,
            direction=self.direction,
            n_features=self.n_features,
            alternatives=tuple(ways[1:]),
            surfaces_mm=self.stated_surfaces_mm,
            surfaces_from=self.surfaces_from,
            edge_break_mm=self.edge_break_mm,
            groups=self.groups,
            frame=self.frame,
            **error,
        )


def witness_name(target: Target, k: int) -> str:
    """Return a name for one witness of a target as a target of its own; its own name where it has only one."""
    return target.name if len(target.witnesses) == 1 else f"{target.name} \x1f{k}"


def check_is_edge(name: str, entity: Any) -> None:
    """Raise `RequestError` if an entity of a space whose edges are measured is a rim or arc."""
    kind = getattr(entity, "kind", "edge")
    if kind != "edge":
        raise RequestError(
            "entities of a space must be edges, whose lengths are measured. "
            f"Got {name!r}, which is {'a rim' if kind == 'rim' else 'an arc'}: "
            "plan_inspection measures it."
        )


def edge_target(name: str, endpoints: ArrayLike, record: EntityRecord | None = None) -> EdgeTarget:
    """Return the target that an edge is: both ends (2, 3) in the picture, its length measured."""
    ends = np.asarray(endpoints, dtype=np.float64)
    length = measurand("length", [Line(ends[0], ends[1])])
    return EdgeTarget(name, (Witness((record or EntityRecord(name, EDGE),), length),))


def edge_targets(entities: Mapping[str, Any], names: Sequence[str]) -> tuple[Target, ...]:
    """Return the targets that edges of a space are, in the order of the names."""
    return tuple(
        edge_target(name, entities[name].endpoints, EntityRecord.of(entities[name], name))
        for name in names
    )


def targets_of(targets: Mapping[str, Target], setting: Any) -> Mapping[str, Target]:
    """Return targets of a plan, by name, as a setting measures them: each by the witness used there, or one end."""
    chosen: Mapping[str, int] = getattr(setting, "witness", {})
    ends: Mapping[str, int] = getattr(setting, "ends", {})
    if not chosen and not ends:
        return targets
    here = {**targets, **{name: targets[name].choosing(k) for name, k in chosen.items()}}
    return {**here, **{name: end_of(here[name], k) for name, k in ends.items()}}


class MeasuredPart(NamedTuple):
    """What a setting measures of a target: by which witness, and which end; None for all of it.

    Attributes
    ----------
    name : str
        The target.
    witness, end : int or None
        As in `SensorSetting`.
    """

    name: str
    witness: int | None
    end: int | None

    @classmethod
    def of(cls, name: str, setting: Any) -> MeasuredPart:
        """Return what a setting measures of the target with a name."""
        witness: Mapping[str, int] = getattr(setting, "witness", {})
        ends: Mapping[str, int] = getattr(setting, "ends", {})
        return cls(name, witness.get(name), ends.get(name))


END_SHARE = math.sqrt(0.5)
"""Share of the permitted error that each end of a target may have: half of the variance."""


def can_be_split(target: Target) -> bool:
    """Return whether two settings may measure a target, an end in each."""
    return isinstance(target, PlannedDimension) and measurand_can_be_split(target.measurand)


def end_of(target: Target, end: int) -> PlannedDimension:
    """Return one end of a target as a target of its own: what it has in the value, with its share of the error.

    Parameters
    ----------
    target : Target
        One that `can_be_split`. Each of its witnesses gives one of the end.
    end : int
        0 or 1. It is one of two entities, or a group of them, see `errors.measurands.end_groups`.
    """
    assert isinstance(target, PlannedDimension)
    witnesses = []
    for witness in target.witnesses:
        group = end_groups(witness.measurand)[end]
        records = tuple(witness.records[k] for k in group)
        witnesses.append(Witness(records, end_of_value(witness.measurand, group)))
    error = END_SHARE * target.permitted_error
    return replace(
        target, witnesses=tuple(witnesses), permitted_error=error, tolerance=None, share=None
    )


def words_of(targets: Mapping[str, Target]) -> TargetWords:
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


def _segments(geometry: Line | Circle) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return pairs of points (s, 2, 3) that hold an entity in the picture, and which must be long enough; (s,)."""
    if isinstance(geometry, Line):
        return np.array([[geometry.p, geometry.q]]), np.ones(1, bool)
    if geometry.is_closed:
        points = geometry.points(np.arange(2 * _DIAMETERS) * (math.pi / _DIAMETERS))
        outer = geometry.centre + (points - geometry.centre) / math.cos(math.pi / (2 * _DIAMETERS))
        return np.stack([outer[:_DIAMETERS], outer[_DIAMETERS:]], axis=1), np.ones(_DIAMETERS, bool)
    # the ends, and corners of a polygon around the arc in pairs, of which only the ends tell how long the image is
    step = geometry.span_rad / (2 * _DIAMETERS)
    middles = geometry.points((np.arange(2 * _DIAMETERS) + 0.5) * step)
    outer = geometry.centre + (middles - geometry.centre) / math.cos(step / 2)
    pairs = np.concatenate(
        [
            geometry.points(np.array([0.0, geometry.span_rad], dtype=np.float64))[None],
            outer.reshape(-1, 2, 3),
        ]
    )
    return pairs, np.arange(len(pairs)) == 0


def _points_on(geometry: Line | Circle) -> NDArray[np.float64]:
    """Return points that lie on an entity itself; (m, 3)."""
    if isinstance(geometry, Line):
        return np.array([geometry.p, geometry.q])
    span = 2 * math.pi if geometry.is_closed else geometry.span_rad
    return geometry.points(np.linspace(0.0, span, 2 * _DIAMETERS + 1))


def _farthest(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the two points (2, 3) of several that are farthest apart."""
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    return points[list(np.unravel_index(np.argmax(apart), apart.shape))]


# Which of the witnesses that a model offers for a dimension are planned with.
#
# A model offers up to sixty sets of entities for one distance. Each costs regions, poses and
# proof, and most look alike to a camera. So few are kept: those that can be in one picture, as
# different as they get.


class WitnessChoice(NamedTuple):
    """How many witnesses of a dimension are kept, and which can be in one picture.

    Attributes
    ----------
    n_witnesses : int
        Witnesses of a dimension at most.
    widest_mm : float
        Two points that are farther apart are never in one sharp image.
    stretch_mm : float
        Of edges that are longer, stretches of about this length are considered, too.
    apart : bool
        Whether two images may show the ends of a dimension.
    """

    n_witnesses: int = 1
    widest_mm: float = np.inf
    stretch_mm: float = np.inf
    apart: bool = False


PREFERRED = WitnessChoice()
"""The preferred witness only, whatever the camera."""


def kept_witnesses(witnesses: Sequence[Witness], choice: WitnessChoice) -> list[int]:
    """Return which witnesses to keep, in their order; one at least.

    Left out are those that need more entities than another one, those that no picture holds, and of the rest all but
    a few that lie far apart: the first, then again and again the one whose middle is farthest from those chosen.

    Parameters
    ----------
    witnesses : sequence of Witness
        The preferred one first.
    choice : WitnessChoice
        How many are kept.

    Returns
    -------
    list of int
        Ascending.
    """
    sets = [frozenset(witness.entities) for witness in witnesses]
    needed = [
        k
        for k, needs in enumerate(sets)
        # of equal sets the first stays
        if not any(other < needs or (other == needs and i < k) for i, other in enumerate(sets))
    ]
    fitting = [k for k in needed if _extent_mm(witnesses[k]) <= choice.widest_mm]
    candidates = fitting or needed[:1]
    if not fitting and choice.apart and measurand_can_be_split(witnesses[needed[0]].measurand):
        # no image shows all of it: of the shortest ends those in the middle
        extents = [_longest_end_mm(witnesses[k]) for k in needed]
        shortest = [
            k for k, extent in zip(needed, extents, strict=True) if extent <= 1.01 * min(extents)
        ]
        if extents[0] > choice.widest_mm:
            candidates = [shortest[len(shortest) // 2]]
    middles = np.array([witnesses[k].segments.reshape(-1, 3).mean(axis=0) for k in candidates])
    chosen = [0]
    while len(chosen) < min(choice.n_witnesses, len(candidates)):
        apart = np.linalg.norm(middles[:, None] - middles[chosen], axis=-1).min(axis=1)
        apart[chosen] = -1.0
        # of equally far ones the first: distances that differ by rounding are equal
        chosen.append(int(np.argmax(np.round(apart, 6))))
    return sorted(candidates[k] for k in chosen)


def _longest_end_mm(witness: Witness) -> float:
    """Return how far apart two points of one end of a witness are at most."""
    longest = 0.0
    for group in end_groups(witness.measurand):
        points = np.concatenate([_points_on(witness.geometry[k]) for k in group])
        first, last = _farthest(points)
        longest = max(longest, float(np.linalg.norm(last - first)))
    return longest


def _extent_mm(witness: Witness) -> float:
    """Return how far apart the two points of a witness are that are farthest apart."""
    ends: NDArray[np.float64] = witness.ends
    return float(np.linalg.norm(ends[1] - ends[0]))
