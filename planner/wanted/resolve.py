"""Dimensions resolved on the part: which entities, which points, which value, which permitted error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, Line, Measurand, MeasurandError, measurand
from planner.exceptions import RequestError
from planner.wanted.classes import check_side
from planner.wanted.dimension import Dimension
from planner.wanted.places import with_places
from planner.wanted.stretches import stretch_ways
from planner.wanted.targets import DimensionTarget, Target, Witness, edge_target
from planner.wanted.witness_choice import PREFERRED, WitnessChoice, kept_witnesses

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid
    from aspectgraph.solid.rims import Arc

_DIAMETERS = 8
"""Diameters of a circle that must be in the picture; a polygon of twice as many corners is drawn around the circle."""

SAME_VALUE = 1e-3
"""Nominal values that differ by no more than this are the same, mm (angles: degrees)."""

_MEASURED_OF = {"edge": "length", "rim": "diameter", "arc": "radius"}
"""What is measured of an entity that is no part of a dimension, as drawings dimension it."""


def is_circle(item: object) -> bool:
    """Return whether an item of a request is a rim or arc, by its id or itself, and no dimension."""
    from aspectgraph.entities.curves import is_curve_id
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

    wanted = with_places(solid, wanted)
    plain = {name: item for name, item in wanted.items() if not isinstance(item, Dimension)}
    entities: dict[str, Entity] = resolve_entities(solid, plain) if plain else {}
    known = {_key(entity): name for name, entity in entities.items()}
    targets: list[Target] = []
    for name, item in wanted.items():
        if isinstance(item, Dimension):
            ways = _ways(solid, name, item, choice, (known, entities))
            targets.append(_dimension_target(solid, name, item, ways, accuracy, choice))
            continue
        entity = entities[name]
        if entity.kind == "edge" and entity.part is not None:
            raise RequestError(
                f"entity {name!r} must be a whole edge, because a stretch has no length of its own. "
                f"Got {entity.part}."
            )
        if entity.kind == "edge" and not as_lengths:
            targets.append(edge_target(name, entity.endpoints))
            continue
        dimension = Dimension(_MEASURED_OF[entity.kind], (name,), accuracy=accuracy)
        targets.append(_dimension_target(solid, name, dimension, [[entity]], accuracy, choice))
    needed = {entity for one in targets for witness in one.witnesses for entity in witness.entities}
    return {name: entity for name, entity in entities.items() if name in needed}, tuple(targets)


_Known = tuple[dict[tuple[frozenset[int], Any], str], dict[str, "Entity"]]


def _key(entity: Entity) -> tuple[frozenset[int], Any]:
    """Return what two names of one entity have in common."""
    return frozenset(entity.edge_ids), entity.part


def _ways(
    solid: Solid, name: str, dimension: Dimension, choice: WitnessChoice, found: _Known
) -> list[list[Entity]]:
    """Return the entities of each witness: those that are given, and stretches in place of long edges."""
    whole = [
        [_entity_of(solid, name, given, found) for given in way] for way in dimension.witnesses
    ]
    if not math.isfinite(choice.stretch_mm):
        return whole
    cut = [
        [_entity_of(solid, name, given, found) for given in stretched]
        for way in whole[: choice.most]
        for stretched in stretch_ways(solid, dimension.kind, way, choice.stretch_mm)
    ]
    return [*whole, *cut]


def _entity_of(solid: Solid, name: str, given: Any, found: _Known) -> Entity:
    """Return what an item of a dimension stands for; an entity that others need, too, is the same one."""
    from aspectgraph import EntityError, resolve_entities

    known, entities = found
    try:
        resolved = resolve_entities(solid, {_label(given): given})
    except EntityError as error:
        raise RequestError(f"dimension {name!r}: {error}") from error
    label, entity = next(iter(resolved.items()))
    key = _key(entity)
    if key not in known:
        # an item may have the name that an id would give
        label = next(text for text in _labels(label) if text not in entities)
        known[key] = label
        entities[label] = next(iter(resolve_entities(solid, {label: given}).values()))
    return entities[known[key]]


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
) -> DimensionTarget:
    """Return the target that a dimension is, given the entities of each of its witnesses."""
    curves = {arc.edge_ids: arc for arc in (*solid.rims(), *solid.arcs())}
    try:
        values = [_value_of(solid, dimension, parts, curves) for parts in ways]
        ways, values = _without_other_stretches(dimension, ways, values)
        if dimension.tolerance_class is not None:
            dimension = dimension.with_limits(values[0].nominal)
        permitted = min(dimension.permitted_error(one.nominal, accuracy) for one in values)
    except (MeasurandError, RequestError) as error:
        raise RequestError(f"dimension {name!r}: {error}") from error
    witnesses = [_witness(parts, value) for parts, value in zip(ways, values, strict=True)]
    _check_same_value(name, witnesses)
    kept = kept_witnesses(witnesses, choice)
    for entity in {one.name: one for k in kept for one in ways[k]}.values():
        _check_chords(name, entity, curves, permitted)
    return DimensionTarget(name, tuple(witnesses[k] for k in kept), dimension, permitted)


def _without_other_stretches(
    dimension: Dimension, ways: list[list[Entity]], values: list[Measurand]
) -> tuple[list[list[Entity]], list[Measurand]]:
    """Leave out stretches in place of long edges that give another value, as of edges that are not quite parallel."""
    given = len(dimension.witnesses)
    first = values[0].nominal
    own = [k for k, one in enumerate(values) if k < given or abs(one.nominal - first) <= SAME_VALUE]
    return [ways[k] for k in own], [values[k] for k in own]


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
    return measurand(dimension.kind, geometry, direction=dimension.direction)


def _witness(parts: list[Entity], value: Measurand) -> Witness:
    """Return entities that give a value together."""
    pieces = [_segments(item) for item in value.geometry]
    return Witness(
        tuple(dict.fromkeys(entity.name for entity in parts)),
        np.concatenate([segments for segments, _ in pieces]),
        np.concatenate([resolved for _, resolved in pieces]),
        _farthest(np.concatenate([_own_points(item) for item in value.geometry])),
        value,
    )


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
    raise RequestError(
        f"dimension {name!r}: {entity.kind} {arc.id} must have at least {needed} chords, because a "
        f"mesh does not state the true circle and {permitted:.4g} mm of error are permitted. "
        f"Got {n}, {arc.chord_mm:.4g} mm off the circle."
    )


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


def _own_points(geometry: Line | Circle) -> NDArray[np.float64]:
    """Return points that lie on an entity itself; (m, 3)."""
    if isinstance(geometry, Line):
        return np.array([geometry.p, geometry.q])
    span = 2 * math.pi if geometry.is_closed else geometry.span_rad
    return geometry.points(np.linspace(0.0, span, 2 * _DIAMETERS + 1))


def _farthest(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the two points (2, 3) of several that are farthest apart."""
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    return points[list(np.unravel_index(np.argmax(apart), apart.shape))]
