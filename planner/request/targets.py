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
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.camera.pose import PoseUncertainty
from planner.exceptions import RequestError

if TYPE_CHECKING:
    from typing import Self

    from errors.measurands import Measurand, MeasurandModel
    from planner.request.dimension import Dimension
    from planner.request.models import DimensionModels, Means, TargetModels


# How the poses of images will be known when values are read, as a request states it.


OWN_EDGES = "own edges"
GIVEN = "given"


@dataclass(frozen=True)
class RegistrationRecord:
    """How the poses of images will be known.

    Attributes
    ----------
    method : str
        "own edges": from the part's own edges in each image. "given": as surely as ``pose_uncertainty`` says.
    surfaces_mm : float or None
        Standard deviation of the position of faces along their normals. None is that of the targets.
    pose_uncertainty : PoseUncertainty or None
        Of given poses.
    """

    method: str
    surfaces_mm: float | None = None
    pose_uncertainty: PoseUncertainty | None = None


# What is known of a setting's pose when its values are read.


LEAST_POSE = np.array([1e-4] * 3 + [1e-6] * 3)
"""Standard deviations of poses that are said to be exact, mm and rad."""


@dataclass(frozen=True)
class PoseKnowledge:
    """What is known of a pose after registration.

    Attributes
    ----------
    pose_uncertainty : PoseUncertainty
        How far the camera may be from where registration puts it.
    by_surfaces : mapping of str to float
        Standard deviation of values by the deviations of surfaces, beside that by the pose; by target, in its unit.
        A target without one has that of its own surfaces.
    """

    pose_uncertainty: PoseUncertainty
    by_surfaces: Mapping[str, float] = field(default_factory=dict)

    def of_target(self, means: Means, name: str) -> Means:
        """Return what a target is measured with at this pose."""
        return replace(
            means,
            pose_uncertainty=self.pose_uncertainty,
            by_surfaces=self.by_surfaces.get(name),
            own_edges=None,
        )

    def with_prior(self, before: NDArray[np.float64], now: NDArray[np.float64]) -> PoseKnowledge:
        """Return what is known if another covariance was known before the image.

        Parameters
        ----------
        before, now : array (6, 6)
            The covariance of the camera's displacement that this is from, and the other one.
        """
        least = np.diag(LEAST_POSE**2)
        root = np.sqrt(np.diag(now + least))
        units = np.outer(root, root)
        old, new, known = (
            np.linalg.inv((one + least) / units)
            for one in (before, now, self.pose_uncertainty.covariance)
        )
        # what the image tells is not negative
        values, vectors = np.linalg.eigh(known - old)
        image = (vectors * np.maximum(values, 0.0)) @ vectors.T
        covariance = np.linalg.inv(new + image) * units
        return replace(self, pose_uncertainty=_symmetric(covariance))

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON.

        Returns
        -------
        dict
            Lists, texts and numbers.
        """
        return {
            **self.pose_uncertainty.to_dict(),
            **({"by_surfaces": dict(self.by_surfaces)} if self.by_surfaces else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PoseKnowledge:
        """Build from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        PoseKnowledge
            Equal to the one written.
        """
        covariance = np.asarray(data["covariance"], dtype=np.float64)
        return cls(PoseUncertainty(covariance), dict(data.get("by_surfaces", {})))


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
    # a plan in a file needs no models
    ...  # joined

    own_edges = means.own_edges
    if own_edges is None:
        raise ValueError("own_edges must be given. Got none.")
    inverse = np.linalg.inv(np.asarray(cam2world, dtype=np.float64))[None]
    dimensions = [target for target in targets if isinstance(target, DimensionTarget)]
    if not dimensions:
        return PoseKnowledge(_symmetric(own_edges.poses(inverse).covariance[0]))
    models = DimensionTarget.models(dimensions, means)
    columns = np.arange(len(dimensions))
    known = models.known(own_edges, inverse, np.zeros(len(columns), dtype=np.int64), columns)
    excess = np.sqrt(np.maximum(known.variance - known.by_pose, 0.0))
    scales = [model.scale(inverse) for model in models.models]
    by_surfaces = {
        target.name: float(own / scale) if scale > 0 else 0.0
        for target, own, scale in zip(dimensions, excess, scales, strict=True)
    }
    return PoseKnowledge(_symmetric(known.covariance[0]), by_surfaces)


def _symmetric(covariance: NDArray[np.float64]) -> PoseUncertainty:
    return PoseUncertainty((covariance + covariance.T) / 2)


def means_at(means: Means, setting: Any, name: str) -> Means:
    """Return what a target of a setting is measured with.

    Parameters
    ----------
    means : Means
        Those of the plan.
    setting : SensorSetting
        With or without knowledge of its pose.
    name : str
        The target.
    """
    known = getattr(setting, "registered", None)
    return means if known is None else known.of_target(means, name)


@dataclass(frozen=True)
class Witness:
    """Entities that in one image give the value of a target.

    Attributes
    ----------
    entities : tuple of str
        Names of the entities, which must be observable as a whole and together.
    segments : array (s, 2, 3)
        Pairs of points that must be in the picture and in focus, mm. Those of a circle are drawn around it, so the
        whole circle is in the picture if they are.
    resolved : array of bool (s,)
        Whose images must be long enough.
    ends : array (2, 3)
        Two points of the entities, far apart, mm. What holds for every pose that inspects the target, holds for them;
        the lower bound and the sampling of poses rest on them.
    measurand : Measurand
        The value and its geometry.
    """

    entities: tuple[str, ...]
    segments: NDArray[np.float64] = field(repr=False, compare=False)
    resolved: NDArray[np.bool_] = field(repr=False, compare=False)
    ends: NDArray[np.float64] = field(repr=False, compare=False)
    measurand: Measurand = field(repr=False, compare=False)


@dataclass(frozen=True)
class Target(ABC):
    """One named item of a request, resolved on the part.

    Attributes
    ----------
    name : str
        Its name.
    witnesses : tuple of Witness
        Any of them gives the value.
    """

    name: str
    witnesses: tuple[Witness, ...]
    in_image: ClassVar[bool] = False
    """Whether the value is a length in the image: then the ends must be found there, as `Detectability` says."""

    @property
    def witness(self) -> Witness:
        """The only witness; a target that still has several is asked for one of them, by `choosing`."""
        (witness,) = self.witnesses
        return witness

    def choosing(self, k: int, name: str | None = None) -> Self:
        """Return the same target with one of its witnesses, under its own name or another one."""
        return replace(self, name=name or self.name, witnesses=(self.witnesses[k],))

    @property
    def measurand(self) -> Measurand:
        """The value and its geometry, as the only witness gives them."""
        return self.witness.measurand

    @classmethod
    @abstractmethod
    def models(cls, targets: Sequence[Any], means: Means) -> TargetModels:
        """Return how probably targets of this kind are measured accurately."""

    @abstractmethod
    def permitted_error(self, accuracy: float) -> float:
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
        """Return how probably the value is accurate, of poses (n, 4, 4); (n,)."""
        wanted = np.ones((len(cam2world), 1), dtype=bool)
        return self.models([self], means).probability_where(cam2world, wanted)

    def description(self, means: Means) -> MeasurandModel:
        """Return the model that describes uncertainty and budget of the value at a pose."""
        from planner.request.models import measurand_model

        return measurand_model(self.measurand, self.permitted_error(means.accuracy), means)


@dataclass(frozen=True)
class EdgeTarget(Target):
    """An edge whose length is measured as in the paper, both ends on whole pixels, at the accuracy of the request."""

    in_image = True

    @classmethod
    def models(cls, targets: Sequence[Target], means: Means) -> TargetModels:
        """Return the paper's density for all edges together; it is evaluated for many at once."""
        from planner.request.models import EdgeModels

        return EdgeModels(np.array([target.witness.ends for target in targets]), means)

    def permitted_error(self, accuracy: float) -> float:
        """Return the same share of the length as of the image's length, mm."""
        return (1.0 - accuracy) * self.measurand.nominal

    def least_image_mm(self, accuracy: float, quantile_mm: float, min_length_mm: float) -> float:
        """Return the length in which the quantization error is small enough, or the one that is asked for."""
        half_width = 0.5 * (math.log(2.0 - accuracy) - math.log(accuracy))
        return max(min_length_mm, quantile_mm / half_width)


@dataclass(frozen=True)
class DimensionTarget(Target):
    """A dimension of the drawing, with its own permitted error.

    Attributes
    ----------
    dimension : Dimension
        What is measured.
    max_error : float
        Largest permitted error, mm (angles: degrees).
    """

    dimension: Dimension
    max_error: float

    @classmethod
    def models(cls, targets: Sequence[DimensionTarget], means: Means) -> DimensionModels:
        """Return the models of the measurands."""
        from planner.request.models import DimensionModels, key_of

        return DimensionModels(
            [target.description(means) for target in targets],
            means.own_edges,
            [key_of(target.name, target.witness.entities) for target in targets],
        )

    def permitted_error(self, accuracy: float) -> float:
        """Return the dimension's own, mm (angles: degrees)."""
        return self.max_error

    def surfaces_mm(self, means: Means) -> float:
        """Return how far its faces are off their place, one standard deviation, mm."""
        own = self.dimension.surfaces_mm
        return means.surfaces_mm if own is None else own

    def description(self, means: Means) -> MeasurandModel:
        """Return the model of the value with the dimension's own faces."""
        return super().description(replace(means, surfaces_mm=self.surfaces_mm(means)))

    def least_image_mm(self, accuracy: float, quantile_mm: float, min_length_mm: float) -> float:
        """Return 0: how short an image of two of its points may be, follows from no constraint."""
        return 0.0


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
            "plan_inspection measures it if it is asked for."
        )


def edge_target(name: str, endpoints: ArrayLike) -> EdgeTarget:
    """Return the target that an edge is: both ends (2, 3) in the picture, its length measured."""
    from errors.measurands import Line
    from errors.measurands.measurand import measurand

    ends = np.asarray(endpoints, dtype=np.float64)
    length = measurand("length", [Line(ends[0], ends[1])])
    return EdgeTarget(name, (Witness((name,), ends[None], np.ones(1, dtype=bool), ends, length),))


def edge_targets(entities: Mapping[str, Any], names: Sequence[str]) -> tuple[Target, ...]:
    """Return the targets that edges of a space are, in the order of the names."""
    return tuple(edge_target(name, entities[name].endpoints) for name in names)


# Which of the witnesses that a model offers for a dimension are planned with.
#
# A model offers up to sixty sets of entities for one distance. Each costs regions, poses and
# proof, and most look alike to a camera. So few are kept: those that can be in one picture, as
# different as they get.


class WitnessChoice(NamedTuple):
    """How many witnesses of a dimension are kept, and which can be in one picture.

    Attributes
    ----------
    most : int
        Witnesses of a dimension at most.
    widest_mm : float
        Two points that are farther apart are never in one sharp image.
    stretch_mm : float
        Of edges that are longer, stretches of about this length are considered, too.
    """

    most: int = 1
    widest_mm: float = np.inf
    stretch_mm: float = np.inf


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
        for k, own in enumerate(sets)
        # of equal sets the first stays
        if not any(other < own or (other == own and i < k) for i, other in enumerate(sets))
    ]
    fitting = [k for k in needed if _extent_mm(witnesses[k]) <= choice.widest_mm]
    left = fitting or needed[:1]
    middles = np.array([witnesses[k].segments.reshape(-1, 3).mean(axis=0) for k in left])
    chosen = [0]
    while len(chosen) < min(choice.most, len(left)):
        apart = np.linalg.norm(middles[:, None] - middles[chosen], axis=-1).min(axis=1)
        apart[chosen] = -1.0
        # of equally far ones the first: distances that differ by rounding are equal
        chosen.append(int(np.argmax(np.round(apart, 6))))
    return sorted(left[k] for k in chosen)


def _extent_mm(witness: Witness) -> float:
    """Return how far apart the two points of a witness are that are farthest apart."""
    ends: NDArray[np.float64] = witness.ends
    return float(np.linalg.norm(ends[1] - ends[0]))
