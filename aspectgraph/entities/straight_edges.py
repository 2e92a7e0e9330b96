"""Entities of interest: straight edges, named and picked by id or by end points, and rims and arcs, picked by id."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from aspectgraph.entities.curves import curve_ends, curve_points, find_curve, is_curve_id
from aspectgraph.entities.parts import Part, Run, Stretch, is_part_text, parse_part
from aspectgraph.entities.resolve_parts import run_of_curve, stretch_ends
from aspectgraph.exceptions import EntityError
from aspectgraph.solid.checks import FARTHEST_MM
from aspectgraph.solid.circles import Circle
from aspectgraph.solid.places import describe_point
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid, check_solid
from aspectgraph.solid.topology import Edge

RELATIVE_TOLERANCE = 1e-4
"""Default distance within which given end points match vertices, as a fraction of the bounding box diagonal."""

_MAY_BE = "an entity must be the id of a rim or arc, an edge id or two finite end points."


@dataclass(frozen=True)
class Entity:
    """A named edge, chain of collinear edges, rim or arc to measure, or a part of one.

    Attributes
    ----------
    name : str
        Name of the entity.
    endpoints : ndarray, shape (2, 3), read-only
        Its two ends in mm. For a rim, which has none, two opposite vertices.
    edge_ids : tuple of int
        Ids of its edges in the solid, ordered from ``endpoints[0]`` to ``endpoints[1]``. For a rim
        or arc, all its chords, counter-clockwise about the circle's axis.
    kind : str
        ``"edge"`` (also for a chain or a stretch), ``"rim"`` or ``"arc"`` (also for a run).
    circle : Circle or None
        The circle of a rim or arc.
    points : ndarray, shape (m, 3), read-only
        The ends of the chords of a rim or arc in order, in mm, or the two ends of an edge. A rim
        does not repeat its first point.
    part : Stretch or Run or None
        What it is a part of an edge, rim or arc. None if it is a whole one.
    """

    name: str
    endpoints: np.ndarray = field(compare=False)
    edge_ids: tuple[int, ...]
    kind: str = "edge"
    circle: Circle | None = field(default=None, compare=False)
    points: np.ndarray = field(default=None, compare=False)  # type: ignore[arg-type]  # that of the ends
    part: Part | None = None

    def __post_init__(self) -> None:
        for name, value in (("endpoints", self.endpoints), ("points", self.points)):
            array = np.array(self.endpoints if value is None else value, dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def outline(self) -> np.ndarray:
        """The polyline of its edges in mm, shape (k, 3). For a rim it ends where it starts."""
        return np.vstack([self.points, self.points[:1]]) if self.kind == "rim" else self.points

    @property
    def length_mm(self) -> float:
        """Distance of the end points in mm: the chord of an arc, about the diameter of a rim."""
        return float(np.linalg.norm(self.endpoints[1] - self.endpoints[0]))


def resolve_entities(
    solid: Solid,
    mapping: Mapping[str, Any] | Iterable[Any],
    tolerance_mm: float | None = None,
    min_dihedral_deg: float = 5.0,
) -> dict[str, Entity]:
    """Find the edges, rims, arcs and parts of them for names, ids or end points.

    Parameters
    ----------
    solid : Solid
        The part.
    mapping : mapping or iterable
        ``{name: edge id}``, ``{name: "r3"}`` with the id of a rim or arc, or ``{name: (p, q)}``
        with end points in mm. End points may span a chain of collinear edges. An `Edge`, `Rim`,
        `Arc`, `Stretch`, `Run` or `Entity` of this solid can replace an id, and so can the text of
        a part, ``"17[0:1/4]"``. Items without names are named ``"e<id>"``, ``"r<n>"``, ``"a<n>"``,
        and parts ``"e17[0:1/4]"`` and ``"r11[3:22]"``.
    tolerance_mm : float, optional
        Largest distance of a given end point from its vertex. Default: 10⁻⁴ of the bounding box
        diagonal.
    min_dihedral_deg : float
        Smallest turn of the normal across an edge that is visible as an edge, in degrees.

    Returns
    -------
    dict
        Name to `Entity`, in the order given.

    Raises
    ------
    EntityError
        There is no such edge, rim or arc. Or the edge belongs to a curve, is smooth, has no length
        or is named twice.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import resolve_entities
    >>> entity = resolve_entities(box, {"top": [[0, 0, 20], [40, 0, 20]]})["top"]
    >>> entity.kind, entity.points.tolist()
    ('edge', [[0.0, 0.0, 20.0], [40.0, 0.0, 20.0]])
    """
    check_solid(solid)
    if not isinstance(mapping, Mapping):
        mapping = {_id_name(item): item for item in _distinct(mapping)}
    if not mapping:
        raise EntityError.of_rule("entities", "must name at least one edge, rim or arc", "none")
    if tolerance_mm is None:
        tolerance_mm = RELATIVE_TOLERANCE * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    if not tolerance_mm > 0:
        raise EntityError.of_rule("tolerance_mm", "must be positive", str(tolerance_mm))
    entities: dict[str, Entity] = {}
    named: dict[tuple[frozenset[int], Part | None], str] = {}
    for name, target in mapping.items():
        if not isinstance(name, str) or not name.strip():
            raise EntityError(f"an entity's name must be text. Got {name!r}.")
        entity = _resolve(solid, name, target, tolerance_mm, min_dihedral_deg)
        for edge_id in entity.edge_ids if entity.kind == "edge" else ():
            _check_edge(solid.edges[edge_id], name, min_dihedral_deg)
        key = (frozenset(entity.edge_ids), entity.part)
        if key in named:
            what = f"edge {min(entity.edge_ids)}" if entity.part is None else str(entity.part)
            raise EntityError(
                f"an edge must be named once. Got {named[key]!r} and {name!r} for {what}."
            )
        named[key] = name
        entities[name] = entity
    return entities


def _id_name(item: Any) -> str:
    if isinstance(item, Edge):
        return f"e{item.id}"
    if isinstance(item, Arc):
        return item.id
    if is_curve_id(item):
        return str(item)
    if isinstance(item, Stretch | Run) or is_part_text(item):
        return (parse_part(item) if isinstance(item, str) else item).name
    if isinstance(item, bool) or not isinstance(item, int | np.integer):
        raise EntityError(f"edge ids must be integers. Got {item!r}.")
    return f"e{item}"


def _distinct(items: Iterable[Any]) -> list[Any]:
    items = list(items)
    for i, item in enumerate(items):
        if any(
            item is other or item == other
            for other in items[:i]
            if np.isscalar(item) and np.isscalar(other)
        ):
            raise EntityError(f"an edge must be named once. Got edge {item} twice.")
    return items


def _resolve(
    solid: Solid, name: str, target: Any, tolerance_mm: float, min_dihedral_deg: float
) -> Entity:
    if isinstance(target, Entity):
        if not target.edge_ids or not all(0 <= i < len(solid.edges) for i in target.edge_ids):
            raise EntityError(
                f"edge ids must be in 0..{len(solid.edges) - 1}. Got {target.edge_ids} for {name!r}."
            )
        return replace(target, name=name)
    if isinstance(target, Arc) or is_curve_id(target):
        return _curve_entity(solid, name, find_curve(solid, target, name, min_dihedral_deg))
    if isinstance(target, Stretch | Run) or is_part_text(target):
        part = parse_part(target) if isinstance(target, str) else target
        return _part_entity(solid, name, part, min_dihedral_deg)
    if isinstance(target, Edge):
        if not (0 <= target.id < len(solid.edges) and solid.edges[target.id] == target):
            raise EntityError(
                f"an edge must be one of the solid's. Got another solid's edge {target.id} for {name!r}."
            )
        target = target.id
    if isinstance(target, int | np.integer) and not isinstance(target, bool):
        if not 0 <= target < len(solid.edges):
            raise EntityError(
                f"an edge id must be in 0..{len(solid.edges) - 1}. Got {target} for {name!r}."
            )
        return Entity(name, solid.edge_points(int(target)), (int(target),))
    try:
        ends = np.array(target, dtype=np.float64)
    except (OverflowError, TypeError, ValueError) as error:
        raise EntityError(f"{_MAY_BE} Got {repr(target)[:200]} for {name!r}.") from error
    if ends.shape != (2, 3) or not (np.abs(ends) <= FARTHEST_MM).all():
        raise EntityError(f"{_MAY_BE} Got {repr(target)[:200]} for {name!r}.")
    if np.linalg.norm(ends[1] - ends[0]) <= tolerance_mm:
        raise EntityError(
            f"an entity must have a length. Got two end points at {describe_point(ends[0])} for {name!r}."
        )
    return _find_chain(solid, name, ends, tolerance_mm)


def _curve_entity(solid: Solid, name: str, curve: Arc) -> Entity:
    points = curve_points(solid, curve)
    kind = "rim" if isinstance(curve, Rim) else "arc"
    return Entity(name, curve_ends(points, curve), curve.edge_ids, kind, curve.circle, points)


def _part_entity(solid: Solid, name: str, part: Part, min_dihedral_deg: float) -> Entity:
    if isinstance(part, Stretch):
        whole = _resolve(solid, name, part.edge, 1.0, min_dihedral_deg)
        ends = stretch_ends(solid, part)
        return replace(whole, endpoints=ends, points=ends, part=part)
    curve = find_curve(solid, part.curve, name, min_dihedral_deg)
    run = run_of_curve(solid, curve, part)
    return replace(_curve_entity(solid, name, run), part=part)


def _check_edge(edge: Edge, name: str, min_dihedral_deg: float) -> None:
    if edge.curved:
        raise EntityError(
            "an entity must be a straight, sharp edge. "
            f"Got edge {edge.id}, part of a curve or of an occluder, for {name!r}."
        )
    if abs(edge.turn_deg) < min_dihedral_deg:
        raise EntityError(
            f"an entity's faces must turn by at least {min_dihedral_deg:g} degrees. "
            f"Got {abs(edge.turn_deg):.3g} at edge {edge.id} for {name!r}."
        )


def _find_chain(solid: Solid, name: str, ends: np.ndarray, tolerance_mm: float) -> Entity:
    """Walk from the vertex at the first end point to the one at the second along edges on the line between."""
    distance = np.linalg.norm(solid.vertices[:, None] - ends, axis=2)
    start, goal = (int(v) for v in np.argmin(distance, axis=0))
    if max(distance[start, 0], distance[goal, 1]) > tolerance_mm:
        raise EntityError(_no_edge(solid, name, ends, tolerance_mm))
    line = solid.vertices[[start, goal]]
    along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    offset = solid.vertices - line[0]
    progress = offset @ along
    on_line = np.linalg.norm(offset - progress[:, None] * along, axis=1) <= tolerance_mm
    steps: dict[int, list[tuple[int, int]]] = {}
    for edge in solid.edges:
        a, b = edge.vertices
        if on_line[a] and on_line[b]:
            a, b = (a, b) if progress[a] < progress[b] else (b, a)
            steps.setdefault(a, []).append((b, edge.id))
    path = _walk(steps, start, goal)
    if path is None:
        raise EntityError(_no_edge(solid, name, ends, tolerance_mm))
    return Entity(name, line, tuple(path))


def _walk(steps: dict[int, list[tuple[int, int]]], start: int, goal: int) -> list[int] | None:
    """Return the edge ids of a path, which only ever goes forward, or None."""
    came: dict[int, tuple[int, int]] = {}
    front = [start]
    while front:
        vertex = front.pop()
        for ahead, edge_id in steps.get(vertex, ()):
            if ahead not in came:
                came[ahead] = (vertex, edge_id)
                front.append(ahead)
    if goal not in came:
        return None
    path = []
    while goal != start:
        goal, edge_id = came[goal]
        path.append(edge_id)
    return path[::-1]


def _no_edge(solid: Solid, name: str, ends: np.ndarray, tolerance_mm: float) -> str:
    points = np.array([solid.edge_points(edge.id) for edge in solid.edges])
    gaps = [
        np.linalg.norm(points[:, order] - ends, axis=2).max(axis=1) for order in ([0, 1], [1, 0])
    ]
    gap = np.minimum(*gaps)
    nearest = int(np.argmin(gap))
    a, b = (describe_point(p) for p in points[nearest])
    return (
        f"end points must lie within {tolerance_mm:.3g} mm of the ends of an edge. Got {name!r} from "
        f"{describe_point(ends[0])} to {describe_point(ends[1])}; the nearest is edge {nearest} from {a} to {b}, "
        f"{gap[nearest]:.3g} mm off."
    )
