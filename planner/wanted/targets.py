"""What is to be inspected, resolved on the part: entities to be seen, points to be imaged, a value to be measured.

A *target* is one named item of a request: an edge, whose length is measured as in the paper, or a dimension. It has

entities   what must be observable, as a whole and together
segments   pairs of points whose images must lie in the picture and in focus, and some of them be long enough; the
           polygon of a circle's is drawn around it, so the whole circle is in the picture if they are
ends       two points that lie *on* the entities: what holds for every pose that inspects the target, holds for them;
           the lower bound and the sampling of poses rest on them
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.exceptions import RequestError

if TYPE_CHECKING:
    from errors.measurands import Measurand
    from planner.wanted.dimension import Dimension


@dataclass(frozen=True)
class Target:
    """One named item of a request, resolved on the part.

    Attributes
    ----------
    name : str
        Its name.
    entities : tuple of str
        Names of the entities that must be observable.
    segments : array (s, 2, 3)
        Pairs of points that must be in the picture and in focus, mm.
    resolved : array of bool (s,)
        Whose images must be long enough.
    ends : array (2, 3)
        Two points of the entities, far apart, mm.
    dimension : Dimension or None
        What is measured; None is an edge's length as in the paper, at the accuracy of the request.
    measurand : Measurand or None
        The value and its geometry; None as for ``dimension``.
    permitted_error : float
        Largest permitted error of a dimension, mm (angles: degrees); nan for an edge.
    """

    name: str
    entities: tuple[str, ...]
    segments: NDArray[np.float64] = field(repr=False, compare=False)
    resolved: NDArray[np.bool_] = field(repr=False, compare=False)
    ends: NDArray[np.float64] = field(repr=False, compare=False)
    dimension: Dimension | None = None
    measurand: Measurand | None = field(default=None, repr=False, compare=False)
    permitted_error: float = np.nan


def check_is_edge(name: str, entity: Any) -> None:
    """Raise `RequestError` if an entity of a space whose edges are measured is a rim or arc."""
    kind = getattr(entity, "kind", "edge")
    if kind != "edge":
        raise RequestError(
            "entities of a space must be edges, whose lengths are measured. "
            f"Got {name!r}, which is {'a rim' if kind == 'rim' else 'an arc'}: "
            "plan_inspection measures it if it is asked for."
        )


def edge_target(name: str, endpoints: ArrayLike) -> Target:
    """Return the target that an edge is: both ends (2, 3) in the picture, its length measured."""
    ends = np.asarray(endpoints, dtype=np.float64)
    return Target(name, (name,), ends[None], np.ones(1, dtype=bool), ends)
