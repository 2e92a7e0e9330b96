"""Rims and arcs: the circular edges of a solid, closed and open, each as its chords with the circle beside them.

Rules
-----
* A *circular chain* is a run of chords of one circle. A closed one is a rim, an open one an arc.
* The circle is the CAD model's where the solid carries it, else fitted to the chords (see `circle_fit`).
* Its axis points to where the faces along it face on the whole, so that of a hole's rim out of the material; its chords
  run counter-clockwise about the axis.
* Numbers follow the order of the model's edges, sharp ones first; so they do not depend on what is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from aspectgraph.solid.topology import Edge, FacetedSurface
from ground.short_repr import short_repr

# Circles: the true one that a chain of chords stands for, and the one fitted to points.
#
# Reference: I. Kåsa, A circle fitting procedure and its error analysis, IEEE Trans. Instrum.
# Meas. 25 (1976), for the linear fit, which is exact where the points lie on a circle.


FloatArray = npt.NDArray[np.float64]


class Circle(NamedTuple):
    """A circle in space.

    Attributes
    ----------
    centre : ndarray, shape (3,)
        In mm.
    axis : ndarray, shape (3,)
        Unit normal of its plane.
    radius_mm : float
        In mm.
    """

    centre: FloatArray
    axis: FloatArray
    radius_mm: float

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return short_repr(self)

    def distances_mm(self, points: FloatArray) -> FloatArray:
        """Return the distances of points from the circle.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            In mm.

        Returns
        -------
        ndarray of float64, shape (n,)
            In mm.
        """
        offset = points - self.centre
        along = offset @ self.axis
        across = np.linalg.norm(offset - along[:, None] * self.axis, axis=1)
        return np.asarray(np.hypot(along, across - self.radius_mm), dtype=np.float64)

    def flipped(self) -> Circle:
        """Return the circle with the opposite axis.

        Returns
        -------
        Circle
            The same circle with its axis the other way.
        """
        return Circle(self.centre, -self.axis, self.radius_mm)


class CircularEdge(NamedTuple):
    """A circular edge of the CAD model and its chords.

    Attributes
    ----------
    circle : Circle
        The true circle.
    vertices : tuple of int
        Ends of its chords in order; of a closed one, the first comes again at the end.
    turn_deg : float
        How far the true surfaces' normals turn across it, in degrees.
    """

    circle: Circle
    vertices: tuple[int, ...]
    turn_deg: float

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return short_repr(self)


def fit_circle(points: FloatArray) -> Circle | None:
    """Fit a circle to points in space: their plane by least squares, then the circle in it.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        At least three, in mm.

    Returns
    -------
    Circle or None
        None if the points lie on a line.
    """
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if spread[1] <= 1e-9 * spread[0]:
        return None
    flat = (points - middle) @ axes[:2].T
    system = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, offset = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(offset + x * x + y * y, 0.0)))
    return Circle(middle + x * axes[0] + y * axes[1], axes[2], radius)


# Circular chains of chords in a solid that no longer says what its edges were.
#
# Rules
# -----
# * A chord is an edge across which the normal turns by at least `SHARP_MESH_DEG`.
# * At a vertex, two chords continue each other if they turn by at most `MAX_TURN_DEG`, the normal turns the same way
#   across both, and neither turns less into any third edge of that kind.
# * A run of chords is circular if its vertices leave one circle by no more than `RELATIVE_RESIDUAL` of the radius and
#   no chord is longer than `UNEVEN` times the median: the flat of a D is not part of its arc.
# * A closed run is a rim if it has `MIN_CHORDS` chords or more, an open one an arc from `MIN_ARC_CHORDS`.
#
# A prism that really has eight or more sides is therefore offered as a rim; read it from STEP to
# be sure.


SHARP_MESH_DEG = 33.0
"""Gentler edges may lie inside a curved surface: twelve facets to a full turn, and some rounding."""

MIN_CHORDS = 8
"""Squares and hexagons are common as squares and hexagons (slots, sockets, nuts); circles have more chords than six."""

MIN_ARC_CHORDS = 3
"""A quarter circle of twelve chords to the full turn; with fewer, any two even chamfers would do."""

MAX_TURN_DEG = 360.0 / MIN_CHORDS + 1.0
"""What eight chords turn by at a vertex, and some rounding."""

UNEVEN = 1.5
"""How much longer than the median a chord of a circle may be; exporters leave a short one over, not a long one."""

RELATIVE_RESIDUAL = 1e-3
"""Coordinates with four digits; the sagitta of sixty chords to the full turn."""


def fitted_chains(solid: FacetedSurface) -> list[CircularEdge]:
    """Return the circular chains of a solid with the circles fitted to them, by their lowest edge."""
    following = _continuations(solid)
    chains = [run for path in _paths(solid, following) for run in _circular_runs(solid, path)]
    circles = [_chain(solid, run) for run in chains]
    edge_of = {
        frozenset(edge.vertices): edge.id
        for edge in solid.edges
        if abs(edge.dihedral_deg) >= SHARP_MESH_DEG
    }
    lowest = [min(edge_of[frozenset(p)] for p in pairwise(c.vertices)) for c in circles]
    return [circles[i] for i in np.argsort(lowest, kind="stable").tolist()]


def _chain(solid: FacetedSurface, run: list[int]) -> CircularEdge:
    circle = fit_circle(solid.vertices[run])
    assert circle is not None, "a circular run has a circle"
    # the turn is that of the chords, which the caller measures
    return CircularEdge(circle, tuple(run), 180.0)


def _continuations(solid: FacetedSurface) -> dict[tuple[int, int], int]:
    """Return for a chord walked from u to v, as (u, v), the vertex w that continues it, if any."""
    ends: dict[int, list[tuple[int, bool]]] = {}
    for edge in solid.edges:
        if abs(edge.dihedral_deg) >= SHARP_MESH_DEG:
            a, b = edge.vertices
            ends.setdefault(a, []).append((b, edge.dihedral_deg > 0))
            ends.setdefault(b, []).append((a, edge.dihedral_deg > 0))
    following: dict[tuple[int, int], int] = {}
    for v, around in ends.items():
        offsets = solid.vertices[[w for w, _ in around]] - solid.vertices[v]
        unit = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
        convex = np.array([flag for _, flag in around])
        # turn between walking in along one and out along the other
        turn = np.degrees(np.arccos(np.clip(-(unit @ unit.T), -1.0, 1.0)))
        turn[convex[:, None] != convex[None, :]] = np.inf
        np.fill_diagonal(turn, np.inf)
        nearest = np.argmin(turn, axis=1)
        for i, j in enumerate(nearest.tolist()):
            if nearest[j] == i and turn[i, j] <= MAX_TURN_DEG:
                following[around[i][0], v] = around[j][0]
    return following


def _paths(solid: FacetedSurface, following: dict[tuple[int, int], int]) -> list[list[int]]:
    """Return the maximal paths of chords that continue each other, as vertices; closed ones end where they start."""
    done: set[frozenset[int]] = set()
    paths = []
    for edge in solid.edges:
        if frozenset(edge.vertices) in done or abs(edge.dihedral_deg) < SHARP_MESH_DEG:
            continue
        path = list(edge.vertices)
        while len(path) < 3 or path[0] != path[-1]:
            ahead = following.get((path[-2], path[-1]))
            if ahead is None:
                break
            path.append(ahead)
        if path[0] != path[-1] or following.get((path[-2], path[-1])) != path[1]:
            path.reverse()
            while (ahead := following.get((path[-2], path[-1]))) is not None and ahead not in path:
                path.append(ahead)
        done |= {frozenset(pair) for pair in pairwise(path)}
        paths.append(path)
    return paths


def _circular_runs(solid: FacetedSurface, path: list[int]) -> list[list[int]]:
    """Return the circular runs of a path: all of a closed one, or the longest that follow each other."""
    closed = path[0] == path[-1]
    if closed and _is_circular(solid, path):
        return [path] if len(path) - 1 >= MIN_CHORDS else []
    if closed:
        path = _from_a_corner(solid, path)
    runs = []
    start = 0
    while start + MIN_ARC_CHORDS < len(path):
        end = start + MIN_ARC_CHORDS
        if not _is_circular(solid, path[start : end + 1]):
            start += 1
            continue
        while end + 1 < len(path) and _is_circular(solid, path[start : end + 2]):
            end += 1
        runs.append(path[start : end + 1])
        start = end
    return runs


def _from_a_corner(solid: FacetedSurface, path: list[int]) -> list[int]:
    """Return a closed path turned so that it starts at the end of its longest chord, where no arc is cut in two."""
    lengths = np.linalg.norm(np.diff(solid.vertices[path], axis=0), axis=1)
    start = int(np.argmax(lengths)) + 1
    return path[start:-1] + path[: start + 1]


def _is_circular(solid: FacetedSurface, run: list[int]) -> bool:
    points = solid.vertices[run]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if lengths.max() > UNEVEN * np.median(lengths):
        return False
    circle = fit_circle(points)
    return circle is not None and bool(
        circle.distances_mm(points).max() <= RELATIVE_RESIDUAL * circle.radius_mm
    )


SHARP_DEG = 5.0
"""Default for the smallest turn of the normal across an edge that is seen, in degrees."""

SAME_CIRCLE = 1e-4
"""Circles of edges that follow each other are one if they differ by no more than this share of the radius.

Writers state the two halves of a circle separately, rounded to their own number of digits.
"""


@dataclass(frozen=True)
class Arc:
    """An open circular edge.

    Attributes
    ----------
    id : str
        ``"a0"``, ``"a1"``, …: the same for the same file.
    centre : ndarray of float64, shape (3,), read-only
        Centre of the circle, in mm.
    axis : ndarray of float64, shape (3,), read-only
        Unit normal of its plane, on the side that its faces mostly face.
    radius_mm : float
        In mm.
    edge_ids : tuple of int
        Its chords in order, counter-clockwise about the axis.
    vertices : tuple of int
        The ends of the chords in the same order; one more than chords for an arc.
    residual_mm : float
        Largest distance of these from the circle.
    chord_mm : float
        Largest distance of a chord from the circle (its sagitta).
    dihedral_deg : float
        Smallest turn of the normal across it, in degrees, without sign.
    fitted : bool
        Whether the circle was fitted to the chords. Otherwise it is that of the CAD model.
    start_rad, end_rad : float
        Angles about the axis from `reference` where the first chord starts and the last one ends, 0
        ≤ start_rad < 2π, start_rad < end_rad ≤ start_rad + 2π.
    """

    id: str
    centre: FloatArray = field(compare=False)
    axis: FloatArray = field(compare=False)
    radius_mm: float
    edge_ids: tuple[int, ...]
    vertices: tuple[int, ...]
    residual_mm: float
    chord_mm: float
    dihedral_deg: float
    fitted: bool
    start_rad: float
    end_rad: float

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in ("centre", "axis"):
            array = np.array(getattr(self, name), dtype=np.float64) + 0.0  # no negative zeros
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def circle(self) -> Circle:
        """The circle."""
        return Circle(self.centre, self.axis, self.radius_mm)

    @property
    def reference(self) -> FloatArray:
        """Direction of angle 0 in the circle's plane, from a coordinate axis; shape (3,)."""
        return reference_direction(self.axis)


@dataclass(frozen=True)
class Rim(Arc):
    """A closed circular edge.

    Attributes
    ----------
    id : str
        ``"r0"``, ``"r1"``, …: the same for the same file.
    centre : ndarray of float64, shape (3,), read-only
        Centre of the circle, in mm.
    axis : ndarray of float64, shape (3,), read-only
        Unit normal of its plane, on the side that its faces mostly face.
    radius_mm : float
        In mm.
    edge_ids : tuple of int
        Its chords in order, counter-clockwise about the axis.
    vertices : tuple of int
        The ends of the chords in the same order; as many as chords.
    residual_mm : float
        Largest distance of these from the circle.
    chord_mm : float
        Largest distance of a chord from the circle (its sagitta).
    dihedral_deg : float
        Smallest turn of the normal across it, in degrees, without sign.
    fitted : bool
        Whether the circle was fitted to the chords. Otherwise it is that of the CAD model.
    start_rad, end_rad : float
        Angle about the axis from `reference` where the first chord starts, and this angle plus 2π.
    """

    __repr__ = short_repr


def reference_direction(axis: FloatArray) -> FloatArray:
    """Return a unit vector across an axis: that of x, y, z which is farthest from it, made perpendicular."""
    unit = np.zeros(3)
    unit[int(np.argmin(np.abs(axis)))] = 1.0
    across = unit - (unit @ axis) * axis
    return np.asarray(across / np.linalg.norm(across), dtype=np.float64)


def find_arcs(
    solid: FacetedSurface, circular_edges: Sequence[CircularEdge] | None
) -> tuple[Arc, ...]:
    """Return all rims and arcs of a solid, numbered each, however blunt.

    Parameters
    ----------
    solid : Solid
        The part.
    circular_edges : sequence of CircularEdge or None
        What the CAD model says; None: circles are fitted.
    """
    if circular_edges is None:
        chains = fitted_chains(solid)
        in_chains = {v for chain in chains for v in chain.vertices}
        edges = (edge for edge in solid.edges if edge.vertices[0] in in_chains)
        edge_of = {frozenset(edge.vertices): edge.id for edge in edges}
    else:
        edge_of = {frozenset(edge.vertices): edge.id for edge in solid.edges}
        pieces = [piece for edge in circular_edges for piece in _unbroken(edge, edge_of)]
        chains = _joined(pieces)
    arcs = [_arc(solid, chain, edge_of, fitted=circular_edges is None) for chain in chains]
    arcs.sort(key=lambda arc: arc.dihedral_deg < SHARP_DEG)
    rims = [arc for arc in arcs if isinstance(arc, Rim)]
    opens = [arc for arc in arcs if not isinstance(arc, Rim)]
    return tuple(_numbered(arc, f"r{i}") for i, arc in enumerate(rims)) + tuple(
        _numbered(arc, f"a{i}") for i, arc in enumerate(opens)
    )


def _numbered(arc: Arc, number: str) -> Arc:
    return replace(arc, id=number)


def _unbroken(edge: CircularEdge, edge_of: dict[frozenset[int], int]) -> list[CircularEdge]:
    """Return the runs of an edge's chords that are edges of the solid; reading may have left some out."""
    runs: list[list[int]] = [[edge.vertices[0]]] if edge.vertices else []
    for a, b in pairwise(edge.vertices):
        if frozenset((a, b)) in edge_of:
            runs[-1].append(b)
        else:
            runs.append([b])
    return [edge._replace(vertices=tuple(run)) for run in runs if len(run) > 1]


def _joined(pieces: list[CircularEdge]) -> list[CircularEdge]:
    """Join pieces of one circle that follow each other, in the order of the first piece of each."""
    chains: list[CircularEdge] = []
    for piece in pieces:
        grown = piece
        place = len(chains)
        for i in range(len(chains) - 1, -1, -1):
            joint = _join(chains[i], grown)
            if joint is not None:
                grown = joint
                place = i
                del chains[i]
        chains.insert(min(place, len(chains)), grown)
    return chains


def _join(chain: CircularEdge, other: CircularEdge) -> CircularEdge | None:
    """Return two chains end to end, or None if they do not meet, or not on one circle."""
    a = chain.vertices
    b = other.vertices
    if (chain.turn_deg < SHARP_DEG) != (other.turn_deg < SHARP_DEG):
        return None
    if (
        a[0] == a[-1]
        or b[0] == b[-1]
        or not {a[0], a[-1]} & {b[0], b[-1]}
        or not _same(chain.circle, other.circle)
    ):
        return None
    if a[0] in (b[0], b[-1]) and a[-1] not in (b[0], b[-1]):
        a = a[::-1]
    if b[-1] == a[-1]:
        b = b[::-1]
    longer = chain if len(chain.vertices) >= len(other.vertices) else other
    return CircularEdge(longer.circle, a + b[1:], min(chain.turn_deg, other.turn_deg))


def _same(circle: Circle, other: Circle) -> bool:
    permitted = SAME_CIRCLE * circle.radius_mm
    tilt = float(np.linalg.norm(np.cross(circle.axis, other.axis))) * circle.radius_mm
    apart = float(np.linalg.norm(circle.centre - other.centre))
    return max(apart, tilt, abs(circle.radius_mm - other.radius_mm)) <= permitted


def _arc(
    solid: FacetedSurface, chain: CircularEdge, edge_of: dict[frozenset[int], int], *, fitted: bool
) -> Arc:
    """Return the rim or arc of a chain, not yet numbered."""
    vertices = chain.vertices
    closed = vertices[0] == vertices[-1]
    edges = [edge_of[frozenset(pair)] for pair in pairwise(vertices)]
    circle = chain.circle
    if _faces_away(solid, edges, circle.axis):
        circle = circle.flipped()
    points = solid.vertices[list(vertices)]
    if _turns_clockwise(points, circle):
        vertices = vertices[::-1]
        edges = edges[::-1]
        points = points[::-1]
    start, span = angles_of(points, circle)
    middles = 0.5 * (points[1:] + points[:-1])
    turn = min(chain.turn_deg, *(abs(solid.edges[e].dihedral_deg) for e in edges))
    return (Rim if closed else Arc)(
        id="",
        centre=circle.centre,
        axis=circle.axis,
        radius_mm=float(circle.radius_mm),
        edge_ids=tuple(edges),
        vertices=vertices[:-1] if closed else vertices,
        residual_mm=float(circle.distances_mm(points).max()),
        chord_mm=float(circle.distances_mm(middles).max()),
        dihedral_deg=float(turn),
        fitted=fitted,
        start_rad=start,
        end_rad=start + (2.0 * np.pi if closed else span),
    )


def _faces_away(solid: FacetedSurface, edges: list[int], axis: FloatArray) -> bool:
    """Whether the faces along the chords face against the axis; if neither way, whether its largest part is < 0."""
    ends = solid.vertices[[solid.edges[e].vertices for e in edges]]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    towards = solid.normals[[solid.edges[e].faces for e in edges]].sum(axis=1) @ axis
    mean = float(towards @ lengths / lengths.sum())
    if abs(mean) > 1e-6:
        return mean < 0
    return bool(axis[int(np.argmax(np.abs(axis).round(9)))] < 0)


def _steps(points: FloatArray, circle: Circle) -> tuple[float, FloatArray]:
    """Return the angle of the first point, and the turns from each point to the next, in -π..π."""
    x = reference_direction(circle.axis)
    y = np.cross(circle.axis, x)
    offset = points - circle.centre
    angle = np.arctan2(offset @ y, offset @ x)
    return float(angle[0]), np.asarray(
        (np.diff(angle) + np.pi) % (2.0 * np.pi) - np.pi, dtype=np.float64
    )


def _turns_clockwise(points: FloatArray, circle: Circle) -> bool:
    return float(_steps(points, circle)[1].sum()) < 0


def angles_of(points: FloatArray, circle: Circle) -> tuple[float, float]:
    """Return the angle of the first of some points in order, 0 to 2π, and how far they turn to the last one."""
    first, steps = _steps(points, circle)
    return first % (2.0 * np.pi), float(steps.sum())


# Which edges show as lines, and how a straight one ends: at a corner, or smoothly in an arc.
#
# Rules
# -----
# * An edge *shows* if the surface turns there: a straight edge by `SHARP_DEG`, a chord of a curve by `FEATURE_DEG`, a
#   chord between two facets of curved surfaces by `CURVED_FEATURE_DEG`, as facets meet at angles that the part has not.
#   So every edge that can be an entity shows.
# * An end of an edge is a *corner* if another edge that shows leaves it at `CORNER_DEG` or more from the edge's line,
#   either way. Otherwise it is *tangent*: the edge runs on smoothly, and an image has no point to measure a length to.


FEATURE_DEG = 20.0
"""Smallest turn of the normal at which a chord of a curve shows, in degrees: above half of 30, by which facets turn.

A smooth seam beside a curved face turns by as much as half a facet."""

CURVED_FEATURE_DEG = 40.0
"""The same of a chord between two facets of curved surfaces."""

CORNER_DEG = 25.0
"""Smallest angle at which another edge leaves a corner, in degrees: below 17 an image's end is off by two pixels."""


@dataclass(frozen=True)
class EdgeEnd:
    """One end of a straight edge: a corner or a tangent arc.

    Attributes
    ----------
    kind : str
        ``"corner"`` or ``"tangent"``, see the module's rules.
    vertex : int
        The vertex where it ends.
    angle_deg : float
        Largest angle between its line and another visible edge there, 0 to 90 degrees. It is 0 if
        there is none.
    arc : str or None
        For a tangent end, the rim or arc that continues the edge. None if it is not a circle.
    """

    kind: str
    vertex: int
    angle_deg: float
    arc: str | None = None

    @property
    def text(self) -> str:
        """The kind in words, with the arc: ``"corner"``, ``"tangent (a21)"``."""
        return f"{self.kind} ({self.arc})" if self.arc else self.kind


def edges_that_show(solid: FacetedSurface) -> NDArray[np.bool_]:
    """Return which edges show as lines wherever they are seen, shape (e,).

    Parameters
    ----------
    solid : Solid
        The part.

    Returns
    -------
    ndarray of bool, shape (e,)
        In the order of ``solid.edges``.
    """
    turns = np.array([abs(edge.turn_deg) for edge in solid.edges])
    curved = np.array([edge.curved for edge in solid.edges], dtype=bool)
    on_curved = np.array([face.curved for face in solid.faces], dtype=bool)
    inside = on_curved[[edge.faces for edge in solid.edges]].all(axis=1)
    of_chords = np.where(inside, CURVED_FEATURE_DEG, FEATURE_DEG)
    return np.asarray(turns >= np.where(curved, of_chords, SHARP_DEG))


def edges_at_vertices(solid: FacetedSurface) -> dict[int, list[Edge]]:
    """Return the edges at each vertex, those that show."""
    by_vertex: dict[int, list[Edge]] = {}
    for edge_id in np.flatnonzero(edges_that_show(solid)):
        edge = solid.edges[edge_id]
        for vertex in edge.vertices:
            by_vertex.setdefault(vertex, []).append(edge)
    return by_vertex


def find_edge_ends(
    solid: FacetedSurface,
    edge: Edge,
    showing: Mapping[int, Sequence[Edge]],
    arc_of: Mapping[int, str],
) -> tuple[EdgeEnd, ...]:
    """Return how an edge ends at both of its vertices.

    Parameters
    ----------
    solid : Solid
        The part.
    edge : Edge
        One of its edges.
    showing : mapping
        Of each vertex, the edges that show there, see `edges_at_vertices`.
    arc_of : mapping
        Id of an edge to that of the rim or arc it is a chord of.

    Returns
    -------
    tuple of EdgeEnd
        In the order of ``edge.vertices``.
    """
    return tuple(
        _end(solid, edge, vertex, showing.get(vertex, ()), arc_of) for vertex in edge.vertices
    )


def _end(
    solid: FacetedSurface,
    edge: Edge,
    vertex: int,
    showing: Sequence[Edge],
    arc_of: Mapping[int, str],
) -> EdgeEnd:
    others = [other for other in showing if other.id != edge.id]
    line = _direction(solid, edge, vertex)
    cosines = [float(line @ _direction(solid, other, vertex)) for other in others]
    angles = [float(np.degrees(np.arccos(min(1.0, abs(cosine))))) for cosine in cosines]
    widest = max(angles, default=0.0)
    if widest >= CORNER_DEG:
        return EdgeEnd("corner", vertex, widest)
    # of the edges it may run on in, the one that bends least
    ahead = sorted((cosine, other.id) for cosine, other in zip(cosines, others, strict=True))
    arc = next((arc_of[other] for _, other in ahead if other in arc_of), None)
    return EdgeEnd("tangent", vertex, widest, arc)


def _direction(solid: FacetedSurface, edge: Edge, vertex: int) -> NDArray[np.float64]:
    """Return the unit vector along an edge away from one of its vertices."""
    a, b = edge.vertices
    along = solid.vertices[b if vertex == a else a] - solid.vertices[vertex]
    return np.asarray(along / np.linalg.norm(along), dtype=np.float64)
