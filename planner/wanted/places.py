"""Places along an edge: one distance, asked for at several places, is several characteristics.

A stretch measures the distance where it lies (two-point size, ISO 14405-1). How the two faces lie to each other along
the edges, only several of them tell. So the length over which the two edges face each other is divided into equal
parts, and the distance is asked for on each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands.parallel import are_parallel
from planner.exceptions import RequestError
from planner.wanted.dimension import Dimension
from planner.wanted.words.feature_counts import place_name

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid

# cuts where edges do not face each other over their whole length are as fine as those of `facing_cuts`
_FINEST_CUT = 1 << 10
# of a share; ends of edges that face each other are off by the rounding of their coordinates
_ROUNDING = 1e-6


class _Side(NamedTuple):
    """An edge, or a stretch of one: shares of the edge, and its ends (2, 3) in mm."""

    edge: int
    start: Fraction
    end: Fraction
    ends: NDArray[np.float64]


def with_places(solid: Solid, wanted: Mapping[str, Any]) -> dict[str, Any]:
    """Return items with one dimension for each place, where a dimension asks for several.

    Parameters
    ----------
    solid : Solid
        The part.
    wanted : mapping
        Name to what is to be inspected.

    Returns
    -------
    dict
        The items in their order; those with places follow each other from the first edge's first vertex on.

    Raises
    ------
    RequestError
        If the edges of such a dimension have no such places; it names the dimension.
    """
    found: dict[str, Any] = {}
    for name, item in wanted.items():
        if not isinstance(item, Dimension) or item.places == 1:
            found[name] = item
            continue
        try:
            parts = _at_places(solid, item)
        except RequestError as error:
            raise RequestError(f"dimension {name!r}: {error}") from error
        names = [place_name(name, k + 1, item.places) for k in range(item.places)]
        taken = [one for one in names if one in wanted]
        if taken:
            raise RequestError.of_rule(
                "the name", f"of a place of {name!r} must be free", repr(taken[0])
            )
        found.update(zip(names, parts, strict=True))
    return found


def _at_places(solid: Solid, dimension: Dimension) -> list[Dimension]:
    """Return the dimension at each of its places."""
    ways = [[_side(solid, given) for given in way] for way in dimension.witnesses]
    first = ways[0]
    origin = first[0].ends[0]
    along = _direction(first[0])
    reach = [sorted(((side.ends - origin) @ along).tolist()) for side in first]
    begin = max(low for low, _ in reach)
    end = min(high for _, high in reach)
    if not end - begin > _ROUNDING * float(np.ptp(reach)):
        raise _refused(dimension, "edges that do not face each other")
    n = dimension.places
    cuts = [begin + (end - begin) * k / n for k in range(n + 1)]
    stretched = [[_stretches(side, origin, along, cuts) for side in way] for way in ways]
    if any(None in side for side in stretched[0]):
        raise _refused(dimension, f"{n} places on {end - begin:.4g} mm of its edges")
    useless = [way for way, sides in zip(ways[1:], stretched[1:], strict=True) if not _reach(sides)]
    if useless:
        edges = ", ".join(str(side.edge) for side in useless[0])
        raise RequestError.of_rule(
            "any", "must hold edges beside a place of the first ones", f"edges {edges}"
        )
    return [
        _at_place(dimension, [[side[k] for side in way] for way in stretched]) for k in range(n)
    ]


def _at_place(dimension: Dimension, ways: Sequence[Sequence[Any]]) -> Dimension:
    """Return the dimension at one place, by the sets of entities that reach it."""
    first, *others = (tuple(way) for way in ways if None not in way)
    return replace(dimension, entities=first, alternatives=tuple(others), places=1)


def _reach(sides: Sequence[Sequence[Any]]) -> bool:
    """Return whether at some place each of the sides has a stretch."""
    return any(None not in at_place for at_place in zip(*sides, strict=True))


def _refused(dimension: Dimension, got: str) -> RequestError:
    rule = "must be 1 unless two edges face each other for so many stretches"
    return RequestError.of_rule("places", rule, f"{dimension.places} for {got}")


def _side(solid: Solid, given: Any) -> _Side:
    """Return what an item of the dimension stands for; one whole edge, or a stretch of one."""
    from aspectgraph import EntityError, resolve_entities

    try:
        entity: Entity = next(iter(resolve_entities(solid, {"it": given}).values()))
    except EntityError as error:
        raise RequestError(str(error)) from error
    if entity.kind != "edge" or len(entity.edge_ids) != 1:
        kind = f"a {entity.kind}" if entity.kind == "rim" else f"an {entity.kind}"
        got = kind if entity.kind != "edge" else f"a chain of {len(entity.edge_ids)} edges"
        raise RequestError.of_rule("places", "must be 1 unless both entities are edges", got)
    edge = entity.edge_ids[0]
    part: Any = entity.part
    start, end = (Fraction(0), Fraction(1)) if part is None else (part.start, part.end)
    first, last = solid.edge_points(edge)
    return _Side(
        edge, start, end, np.array([first + float(one) * (last - first) for one in (start, end)])
    )


def _direction(side: _Side) -> NDArray[np.float64]:
    along = side.ends[1] - side.ends[0]
    return np.asarray(along / np.linalg.norm(along))


def _stretches(
    side: _Side, origin: NDArray[np.float64], along: NDArray[np.float64], cuts: Sequence[float]
) -> list[Any]:
    """Return the stretch of an edge between each two cuts along a direction; None where it does not reach."""
    from aspectgraph import Stretch

    if not are_parallel(_direction(side), along):
        return [None] * (len(cuts) - 1)
    low, high = ((side.ends - origin) @ along).tolist()
    shares = [_share((cut - low) / (high - low)) for cut in cuts]
    found: list[Any] = []
    for ends in pairwise(shares):
        first, last = sorted(side.start + share * (side.end - side.start) for share in ends)
        fits = side.start <= first < last <= side.end
        found.append(_part(Stretch, side.edge, first, last) if fits else None)
    return found


def _share(value: float) -> Fraction:
    """Return a share as a short fraction: thirds stay thirds, whatever their last digits."""
    return Fraction(value).limit_denominator(_FINEST_CUT)


def _part(stretch: Any, edge: int, first: Fraction, last: Fraction) -> Any:
    """Return a stretch, or the edge itself if it is all of it."""
    return edge if last - first == 1 else stretch(edge, first, last)
