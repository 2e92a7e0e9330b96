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

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from aspectgraph.solid.circle_fit import fitted_chains
from aspectgraph.solid.circles import Circle, CircularEdge, EdgedSurface, FloatArray

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


def reference_direction(axis: FloatArray) -> FloatArray:
    """Return a unit vector across an axis: that of x, y, z which is farthest from it, made perpendicular."""
    unit = np.zeros(3)
    unit[int(np.argmin(np.abs(axis)))] = 1.0
    across = unit - (unit @ axis) * axis
    return np.asarray(across / np.linalg.norm(across), dtype=np.float64)


def find_arcs(
    solid: EdgedSurface, circular_edges: Sequence[CircularEdge] | None
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


def _join(one: CircularEdge, other: CircularEdge) -> CircularEdge | None:
    """Return two chains end to end, or None if they do not meet, or not on one circle."""
    a = one.vertices
    b = other.vertices
    if (one.turn_deg < SHARP_DEG) != (other.turn_deg < SHARP_DEG):
        return None
    if (
        a[0] == a[-1]
        or b[0] == b[-1]
        or not {a[0], a[-1]} & {b[0], b[-1]}
        or not _same(one.circle, other.circle)
    ):
        return None
    if a[0] in (b[0], b[-1]) and a[-1] not in (b[0], b[-1]):
        a = a[::-1]
    if b[-1] == a[-1]:
        b = b[::-1]
    longer = one if len(one.vertices) >= len(other.vertices) else other
    return CircularEdge(longer.circle, a + b[1:], min(one.turn_deg, other.turn_deg))


def _same(one: Circle, other: Circle) -> bool:
    permitted = SAME_CIRCLE * one.radius_mm
    tilt = float(np.linalg.norm(np.cross(one.axis, other.axis))) * one.radius_mm
    apart = float(np.linalg.norm(one.centre - other.centre))
    return max(apart, tilt, abs(one.radius_mm - other.radius_mm)) <= permitted


def _arc(
    solid: EdgedSurface, chain: CircularEdge, edge_of: dict[frozenset[int], int], *, fitted: bool
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


def _faces_away(solid: EdgedSurface, edges: list[int], axis: FloatArray) -> bool:
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
