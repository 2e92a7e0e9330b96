"""What is to be inspected, resolved on the part: entities to be seen, points to be imaged, a value to be measured.

A *target* is one named item of a request. Any of its *witnesses* gives its value; each is a set of entities that must
be seen together in one image. A target owns its error model: how probable it is that the value is accurate, what that
needs of every pose, and how uncertain the value is. There are two models, of an edge (the paper's density of image
lengths) and of a dimension (a measurand); see `planner.wanted.models`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.exceptions import RequestError

if TYPE_CHECKING:
    from typing_extensions import Self

    from errors.measurands import Measurand, MeasurandModel
    from planner.wanted.dimension import Dimension
    from planner.wanted.models import DimensionModels, Means, TargetModels


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
            Least quantile of the quantization error of a length, see `planner.bound.least_image`.
        min_length_mm : float
            Shortest image that constraints allow.
        """

    def probability(self, cam2world: NDArray[np.float64], means: Means) -> NDArray[np.float64]:
        """Return how probably the value is accurate, of poses (n, 4, 4); (n,)."""
        wanted = np.ones((len(cam2world), 1), dtype=bool)
        return self.models([self], means).probability_where(cam2world, wanted)

    def description(self, means: Means) -> MeasurandModel:
        """Return the model that describes uncertainty and budget of the value at a pose."""
        from planner.wanted.models import measurand_model

        return measurand_model(self.measurand, self.permitted_error(means.accuracy), means)


@dataclass(frozen=True)
class EdgeTarget(Target):
    """An edge whose length is measured as in the paper, both ends on whole pixels, at the accuracy of the request."""

    in_image = True

    @classmethod
    def models(cls, targets: Sequence[Target], means: Means) -> TargetModels:
        """Return the paper's density for all edges together; it is evaluated for many at once."""
        from planner.wanted.models import EdgeModels

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
        from planner.wanted.models import DimensionModels
        from planner.wanted.registered.own_edges import key_of

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
    from errors.measurands import Line, measurand

    ends = np.asarray(endpoints, dtype=np.float64)
    length = measurand("length", [Line(ends[0], ends[1])])
    return EdgeTarget(name, (Witness((name,), ends[None], np.ones(1, dtype=bool), ends, length),))


def edge_targets(entities: Mapping[str, Any], names: Sequence[str]) -> tuple[Target, ...]:
    """Return the targets that edges of a space are, in the order of the names."""
    return tuple(edge_target(name, entities[name].endpoints) for name in names)
