"""Dimensions resolved on the part: which entities, which points, which value, which permitted error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, Line, Measurand, MeasurandError, Position
from errors.measurands.kinds import are_parallel
from errors.measurands.measurand import measurand
from planner.exceptions import RequestError
from planner.request.dimension import Dimension, MaterialCondition, check_side, class_limits
from planner.request.targets import (
    PREFERRED,
    EntityRecord,
    PlannedDimension,
    Target,
    Witness,
    WitnessChoice,
    edge_target,
    kept_witnesses,
)
from planner.request.words import place_name

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid, Stretch
    from aspectgraph.solid.rims import Arc


# Stretches of edges in place of whole edges: a metrologist looks at a short piece of each side of
# a wide slot.
#
# A distance of 1.3 mm between edges of 35 mm asks for a picture of 35 mm, all of it in focus and
# unhidden, if the whole edges must be seen. The value is there on any short piece of both. What
# is measured is the distance at that place: the form of the faces is not averaged (two-point
# size, ISO 14405-1).


MOST_PIECES = 12
"""Pieces of an edge at most."""
_AT_STRETCHES = ("distance", "angle", "centre_to_edge")


def stretch_ways(
    solid: Solid, kind: str, way: Sequence[Entity], stretch_mm: float
) -> list[tuple[Any, ...]]:
    """Return sets of entities with stretches in place of long edges, along the edges.

    Parameters
    ----------
    solid : Solid
        The part.
    kind : str
        Kind of the dimension. A length needs the whole edge.
    way : sequence of Entity
        Entities that give the value.
    stretch_mm : float
        Edges and stretches longer than this, mm, are cut into pieces of about this length.

    Returns
    -------
    list of tuple
        Items as `Dimension` takes them: a `Stretch` of each long edge, beside that of the other edge; the rest as it
        is. None, if no edge is long.
    """
    if kind not in _AT_STRETCHES:
        return []
    cut = [k for k, entity in enumerate(way) if _is_long(entity, stretch_mm)]
    if not cut:
        return []
    pieces = {k: _pieces(solid, way[k], stretch_mm) for k in cut}
    if any(not parts for parts in pieces.values()):
        return []
    longest, *others = sorted(cut, key=lambda k: -len(pieces[k]))
    result = []
    for stretch, middle in pieces[longest]:
        chosen: dict[int, Any] = {longest: stretch}
        for k in others:
            chosen[k] = _nearest(pieces[k], middle)
        result.append(tuple(chosen.get(k, entity) for k, entity in enumerate(way)))
    return list(dict.fromkeys(result))


def _is_long(entity: Entity, stretch_mm: float) -> bool:
    """Tell whether an entity is one edge or stretch that is worth cutting: into two pieces at least."""
    if entity.kind != "edge" or len(entity.edge_ids) != 1:
        return False
    return _length(entity) > 1.5 * stretch_mm


def _length(entity: Entity) -> float:
    return float(np.linalg.norm(entity.endpoints[1] - entity.endpoints[0]))


def _pieces(
    solid: Solid, entity: Entity, stretch_mm: float
) -> list[tuple[Stretch, NDArray[np.float64]]]:
    """Return the pieces of an edge or of a stretch of one, and the middle of each, mm."""
    from aspectgraph import Stretch, pieces_of_edge

    edge = entity.edge_ids[0]
    start, end = solid.edge_points(edge)
    cut: Sequence[Stretch]
    if isinstance(entity.part, Stretch):
        whole = entity.part
        n = min(MOST_PIECES, math.ceil(_length(entity) / stretch_mm - 1e-9))
        cuts = [whole.start + Fraction(k, n) * whole.share for k in range(n + 1)]
        cut = [Stretch(edge, *ends) for ends in pairwise(cuts)]
    else:
        cut = pieces_of_edge(solid, edge, stretch_mm, at_most=MOST_PIECES)
    return [(piece, start + float(piece.start + piece.end) / 2 * (end - start)) for piece in cut]


def _nearest(
    pieces: Sequence[tuple[Stretch, NDArray[np.float64]]], place: NDArray[np.float64]
) -> Stretch:
    """Return the piece whose middle is nearest; of equally near ones the first."""
    away = [round(float(np.linalg.norm(middle - place)), 6) for _, middle in pieces]
    return pieces[int(np.argmin(away))][0]


# Places along an edge: one distance, asked for at several places, is several characteristics.
#
# A stretch measures the distance where it lies (two-point size, ISO 14405-1). How the two faces
# lie to each other along the edges, only several of them tell. So the length over which the two
# edges face each other is divided into equal parts, and the distance is asked for on each.


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
    result: dict[str, Any] = {}
    for name, item in wanted.items():
        if not isinstance(item, Dimension) or item.places == 1:
            result[name] = item
            continue
        try:
            parts = _at_places(solid, item)
        except RequestError as error:
            raise RequestError(f"dimension {name!r}: {error}") from error
        names = [place_name(name, k + 1, item.places) for k in range(item.places)]
        taken = [part_name for part_name in names if part_name in wanted]
        if taken:
            raise RequestError.of_rule(
                "the name", f"of a position of {name!r} must be free", repr(taken[0])
            )
        result.update(zip(names, parts, strict=True))
    return result


def _at_places(solid: Solid, dimension: Dimension) -> list[Dimension]:
    """Return the dimension at each of its places."""
    ways = [[_side(solid, item) for item in way] for way in dimension.witnesses]
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
        raise _refused(dimension, f"{n} positions on {end - begin:.4g} mm of its edges")
    useless = [way for way, sides in zip(ways[1:], stretched[1:], strict=True) if not _reach(sides)]
    if useless:
        edges = ", ".join(str(side.edge) for side in useless[0])
        raise RequestError.of_rule(
            "any", "must hold edges next to a position of the first ones", f"edges {edges}"
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
        edge,
        start,
        end,
        np.array([first + float(share) * (last - first) for share in (start, end)]),
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
    result: list[Any] = []
    for ends in pairwise(shares):
        first, last = sorted(side.start + share * (side.end - side.start) for share in ends)
        fits = side.start <= first < last <= side.end
        result.append(_part(Stretch, side.edge, first, last) if fits else None)
    return result


def _share(value: float) -> Fraction:
    """Return a share as a short fraction: thirds stay thirds, whatever their last digits."""
    return Fraction(value).limit_denominator(_FINEST_CUT)


def _part(stretch: Any, edge: int, first: Fraction, last: Fraction) -> Any:
    """Return a stretch, or the edge itself if it is all of it."""
    return edge if last - first == 1 else stretch(edge, first, last)


SAME_VALUE = 1e-3
"""Nominal values that differ by no more than this are the same, mm (angles: degrees)."""

_MEASURED_OF = {"edge": "length", "rim": "diameter", "arc": "radius"}
"""What is measured of an entity that is no part of a dimension, as drawings dimension it."""


def is_circle(item: object) -> bool:
    """Return whether an item of a request is a rim or arc, by its id or itself, and no dimension."""
    from aspectgraph.entities.entity import is_curve_id
    from aspectgraph.solid.rims import Arc

    return (
        isinstance(item, Arc) or is_curve_id(item) or getattr(item, "kind", None) in ("rim", "arc")
    )


def resolve_wanted(
    solid: Solid,
    wanted: Mapping[str, Any],
    accuracy: float,
    as_lengths: bool = False,
    choice: WitnessChoice = PREFERRED,
) -> tuple[dict[str, Entity], tuple[Target, ...]]:
    """Find the entities of what is to be inspected, and what is asked of them.

    Parameters
    ----------
    solid : Solid
        The part.
    wanted : mapping
        Name to `Dimension`; or to an edge, rim or arc: an id, an `Edge`, `Rim`, `Arc` or `Entity`, or two end points.
        Of a rim the diameter is measured, of an arc the radius.
    accuracy : float
        Accuracy where a dimension has no requirement of its own, and of rims and arcs.
    as_lengths : bool
        Whether edges are dimensions, too: their lengths; the paper's model rounds their ends to pixels.
    choice : WitnessChoice
        Which witnesses of a dimension are kept.

    Returns
    -------
    entities : dict of str to Entity
        Every entity that is needed once: an edge under its item's name, the others under their ids.
    targets : tuple of Target
        The items, in order. A dimension with places is a target for each of them.

    Raises
    ------
    RequestError
        If a dimension cannot be measured as asked; it names it.
    EntityError
        If an entity is not one of the part's.
    """
    from aspectgraph import resolve_entities

    items = with_places(solid, wanted)
    plain = {name: item for name, item in items.items() if not isinstance(item, Dimension)}
    entities: dict[str, Entity] = resolve_entities(solid, plain) if plain else {}
    labels = {_key(entity): name for name, entity in entities.items()}
    targets: list[Target] = []
    curves = {arc.edge_ids: arc for arc in (*solid.rims(), *solid.arcs())}
    for name, item in items.items():
        if isinstance(item, Dimension):
            ways = _ways(solid, name, item, choice, (labels, entities))
            targets.append(_dimension_target(solid, name, item, ways, accuracy, choice, curves))
            continue
        entity = entities[name]
        if entity.kind == "edge" and entity.part is not None:
            raise RequestError(
                f"entity {name!r} must be a whole edge, because a stretch has no length of its own. "
                f"Got {entity.part}."
            )
        if entity.kind == "edge" and not as_lengths:
            targets.append(edge_target(name, entity.endpoints, EntityRecord.of(entity, name)))
            continue
        dimension = Dimension(_MEASURED_OF[entity.kind], (name,), accuracy=accuracy)
        ways = [[entity]]
        targets.append(_dimension_target(solid, name, dimension, ways, accuracy, choice, curves))
    needed = {
        entity for target in targets for witness in target.witnesses for entity in witness.entities
    }
    return {name: entity for name, entity in entities.items() if name in needed}, tuple(targets)


_Known = tuple[dict[tuple[frozenset[int], Any], str], dict[str, "Entity"]]


def _key(entity: Entity) -> tuple[frozenset[int], Any]:
    """Return what two names of one entity have in common."""
    return frozenset(entity.edge_ids), entity.part


def _ways(
    solid: Solid, name: str, dimension: Dimension, choice: WitnessChoice, found: _Known
) -> list[list[Entity]]:
    """Return the entities of each witness: those that are given, and stretches in place of long edges."""
    whole = [[_entity_of(solid, name, item, found) for item in way] for way in dimension.witnesses]
    if not math.isfinite(choice.stretch_mm):
        return whole
    cut = [
        [_entity_of(solid, name, item, found) for item in stretched]
        for way in whole[: choice.n_witnesses]
        for stretched in stretch_ways(solid, dimension.kind, way, choice.stretch_mm)
    ]
    return [*whole, *cut]


def _entity_of(solid: Solid, name: str, given: Any, found: _Known) -> Entity:
    """Return what an item of a dimension stands for; an entity that others need, too, is the same one."""
    from aspectgraph import EntityError, resolve_entities

    labels, entities = found
    try:
        resolved = resolve_entities(solid, {_label(given): given})
    except EntityError as error:
        raise RequestError(f"dimension {name!r}: {error}") from error
    label, entity = next(iter(resolved.items()))
    key = _key(entity)
    if key not in labels:
        # an item may have the name that an id would give
        label = next(text for text in _labels(label) if text not in entities)
        labels[key] = label
        entities[label] = next(iter(resolve_entities(solid, {label: given}).values()))
    return entities[labels[key]]


def _labels(label: str) -> Iterator[str]:
    yield label
    yield from (f"{label} ({number})" for number in range(2, 10_000))


def _label(given: Any) -> str:
    """Return a name for an entity that has none: its id."""
    known_as = getattr(given, "id", getattr(given, "name", given))
    if isinstance(known_as, bool):
        raise RequestError(
            f"an entity must be an id, an edge, a rim or two end points. Got {given!r}."
        )
    if isinstance(known_as, int | np.integer):
        return f"e{known_as}"
    if isinstance(known_as, str):
        return known_as
    try:
        return "edge from " + " to ".join(
            "(" + ", ".join(f"{x:.6g}" for x in point) + ")" for point in known_as
        )
    except (TypeError, ValueError):
        return repr(known_as)


def _dimension_target(
    solid: Solid,
    name: str,
    dimension: Dimension,
    ways: list[list[Entity]],
    accuracy: float,
    choice: WitnessChoice,
    curves: Mapping[tuple[int, ...], Arc],
) -> PlannedDimension:
    """Return the target that a dimension is, given the entities of each of its witnesses."""
    try:
        values = [_value_of(solid, dimension, parts, curves) for parts in ways]
        ways, values = _without_other_stretches(dimension, ways, values)
        if dimension.tolerance_class is not None:
            dimension = dimension.with_limits(values[0].nominal)
        permitted = min(
            dimension.permitted_error(measured.nominal, accuracy) for measured in values
        )
    except (MeasurandError, RequestError) as error:
        raise RequestError(f"dimension {name!r}: {error}") from error
    witnesses = [_witness(parts, value) for parts, value in zip(ways, values, strict=True)]
    _check_same_value(name, witnesses)
    indices = kept_witnesses(witnesses, choice)
    for entity in {measured.name: measured for k in indices for measured in ways[k]}.values():
        _check_chords(name, entity, curves, permitted)
    chosen = tuple(witnesses[k] for k in indices)
    try:
        material = _material(solid, dimension, ways, values, curves)
    except RequestError as error:
        raise RequestError(f"dimension {name!r}: {error}") from error
    return PlannedDimension.of(name, chosen, dimension, permitted, material)


def _material(
    solid: Solid,
    dimension: Dimension,
    ways: Sequence[Sequence[Entity]],
    values: Sequence[Measurand],
    curves: Mapping[tuple[int, ...], Arc],
) -> MaterialCondition | None:
    """Return what widens the zone of a position, by the limits of the size of its hole, pin or slot."""
    if dimension.size is None:
        return None
    sizes = [value.size_mm for value in values if isinstance(value, Position)]
    if max(sizes) - min(sizes) > SAME_VALUE:
        rule = "must hold rims of one diameter with a material condition"
        raise RequestError.of_rule("any", rule, ", ".join(f"{size:.6g}" for size in sizes))
    first = ways[0][0]
    in_hole = _is_inside(solid, ways[0], curves)
    if in_hole is None:
        raise RequestError.of_rule(
            "material", "must be that of a hole, slot or pin, by its walls", first.name
        )
    deviations = dimension.size
    if isinstance(deviations, str):
        if first.edge_ids in curves:
            check_side(deviations, solid, [curves[first.edge_ids]])
        deviations = class_limits(deviations, sizes[0])
    return MaterialCondition.of(dimension.material, deviations, sizes[0], in_hole)


def _is_inside(
    solid: Solid, way: Sequence[Entity], curves: Mapping[tuple[int, ...], Arc]
) -> bool | None:
    """Return whether a rim is that of a hole, or two edges those of a slot; None if the walls do not show it."""
    from aspectgraph.dimensions.tolerances import WALL, is_in_hole

    first = way[0]
    if first.edge_ids in curves:
        return is_in_hole(solid, curves[first.edge_ids])
    along = first.endpoints[1] - first.endpoints[0]
    apart = way[1].endpoints.mean(axis=0) - first.endpoints.mean(axis=0)
    across = apart - (apart @ along) / (along @ along) * along
    across = across / np.linalg.norm(across)
    faces = list(solid.edges[first.edge_ids[0]].faces)
    # the wall of a slot looks at the other edge
    sides = {
        bool(part > 0) for part in (solid.normals[faces] @ across).tolist() if abs(part) >= WALL
    }
    return sides.pop() if len(sides) == 1 else None


def _without_other_stretches(
    dimension: Dimension, ways: list[list[Entity]], values: list[Measurand]
) -> tuple[list[list[Entity]], list[Measurand]]:
    """Leave out stretches in place of long edges that give another value, as of edges that are not quite parallel."""
    n_stated = len(dimension.witnesses)
    first = values[0].nominal
    indices = [
        k
        for k, value in enumerate(values)
        if k < n_stated or abs(value.nominal - first) <= SAME_VALUE
    ]
    return [ways[k] for k in indices], [values[k] for k in indices]


def _value_of(
    solid: Solid,
    dimension: Dimension,
    parts: list[Entity],
    curves: Mapping[tuple[int, ...], Arc],
) -> Measurand:
    """Return the value that entities give; a class of tolerance must be for a hole or shaft as they are."""
    if dimension.tolerance_class is not None:
        arcs = [curves[entity.edge_ids] for entity in parts if entity.edge_ids in curves]
        check_side(dimension.tolerance_class, solid, arcs)
    geometry = [_geometry(solid, entity, curves) for entity in parts]
    return measurand(dimension.kind, geometry, dimension.direction, dimension.groups)


def _witness(parts: list[Entity], value: Measurand) -> Witness:
    """Return entities that give a value together."""
    records = {entity.name: EntityRecord.of(entity) for entity in parts}
    return Witness(tuple(records.values()), value)


def _check_same_value(name: str, witnesses: list[Witness]) -> None:
    """Refuse alternatives that give another value than the first one."""
    first = witnesses[0].measurand.nominal
    for witness in witnesses[1:]:
        nominal = witness.measurand.nominal
        if abs(nominal - first) > SAME_VALUE:
            raise RequestError(
                f"dimension {name!r}: all its sets of entities must give the same nominal value, "
                f"{first:.6g} as {', '.join(witnesses[0].entities)}. "
                f"Got {nominal:.6g} of {', '.join(witness.entities)}."
            )


def _geometry(solid: Solid, entity: Entity, curves: Mapping[tuple[int, ...], Arc]) -> Line | Circle:
    """Return an entity as the error model takes it."""
    if entity.kind == "edge":
        return Line(*entity.endpoints)
    arc = curves[entity.edge_ids] if entity.part is None else _run_arc(solid, entity)
    if entity.kind == "rim":
        return Circle(arc.centre, arc.axis, arc.radius_mm)
    return Circle(
        arc.centre,
        arc.axis,
        arc.radius_mm,
        entity.points[0] - arc.centre,
        arc.end_rad - arc.start_rad,
    )


def _run_arc(solid: Solid, entity: Entity) -> Arc:
    """Return the arc that a run of a rim or arc is."""
    from aspectgraph import Run, run_arc

    assert isinstance(entity.part, Run)
    return run_arc(solid, entity.part)


def _check_chords(
    name: str, entity: Entity, curves: Mapping[tuple[int, ...], Arc], permitted: float
) -> None:
    """Refuse a circle that is known only by too few chords for what is asked of it."""
    arc = curves.get(entity.edge_ids)
    if arc is None or not arc.fitted or arc.chord_mm <= permitted:
        return
    n = len(arc.edge_ids)
    span = arc.end_rad - arc.start_rad
    needed = math.ceil(span / (2 * math.acos(max(0.0, 1 - permitted / arc.radius_mm))))
    # chords of one length would do
    uneven = " of different lengths" if needed <= n else ""
    raise RequestError(
        f"dimension {name!r}: {entity.kind} {arc.id} must have at least {needed} chords, because a "
        f"mesh does not state the true circle and {permitted:.4g} mm of error are permitted. "
        f"Got {n}{uneven}, {arc.chord_mm:.4g} mm off the circle."
    )
