"""From triangles to the faces of a solid: coplanar triangles joined, loops traced, idle vertices removed.

The notation is that of `coplanar`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from aspectgraph.exceptions import SolidError
from aspectgraph.phases import phase
from aspectgraph.solid.checks import default_planarity_mm, face_area_vectors
from aspectgraph.solid.rims import CircularEdge
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import (
    FaceLoops,
    check_fans,
    faces_of,
    newell_area_vector,
    pair_edges,
    signed_dihedrals_deg,
)

# Triangles on their way from a reader to a solid.


@dataclass
class Tessellation:
    """Triangles of a closed surface and what is known of the surface behind them.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Counter-clockwise seen from outside.
    patch : ndarray of int, shape (t,)
        The surface each triangle belongs to, 0..p-1 (all 0 if unknown).
    curved_patch : ndarray of bool, shape (p,)
        Which of them are curved; triangles of two curved ones, or of a curved and a planar one, are never joined.
    curved_edges : set of (int, int)
        Vertex pairs, lower index first, of chords of curved or smooth edges.
    circular_edges : list of CircularEdge or None
        The circular edges of the CAD model; None where they are not known.
    surface_turns : dict of (int, int) to float
        Vertex pairs, lower index first, of the chords of sharp straight edges beside curved patches, and the turn of
        the surfaces' normal there in degrees.
    faceted_patches : set of int
        Patches that are facets without a surface behind them; facets of curved surfaces are recognised among them (see
        `curved_facets`).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    patch: np.ndarray
    curved_patch: np.ndarray
    curved_edges: set[tuple[int, int]] = field(default_factory=set)
    circular_edges: list[CircularEdge] | None = None
    surface_turns: dict[tuple[int, int], float] = field(default_factory=dict)
    faceted_patches: set[int] = field(default_factory=set)


# Coplanar triangles found and grouped.
#
# Notation
# --------
# Half-edge ``h = 3 t + k`` runs from corner k of triangle t to the next corner. ``twin[h]`` is the half-edge on the
# other side, which runs the other way. A *group* is a set of triangles that becomes one face.


def find_twins(triangles: np.ndarray) -> np.ndarray:
    """Return the twin of every half-edge of closed, oriented triangles, shape (3 t,)."""
    start = triangles.astype(np.int64).ravel()
    end = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    n = int(start.max()) + 1
    forward = start * n + end
    backward = end * n + start
    order = np.argsort(forward)
    return order[np.searchsorted(forward, backward, sorter=order)]


def group_coplanar(
    vertices: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    joinable: np.ndarray,
    tolerance_mm: float,
) -> np.ndarray:
    """Label triangles that lie in one plane and hang together.

    Groups grow from the largest triangle left. The plane is refitted whenever the area has doubled; a group that ends
    up uneven all the same is taken apart again.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Closed and oriented.
    twin : ndarray of int, shape (3 t,)
        See `find_twins`.
    joinable : ndarray of bool, shape (3 t,)
        Whether a group may grow across a half-edge.
    tolerance_mm : float
        Largest distance of a corner from the plane of its group.

    Returns
    -------
    ndarray of int, shape (t,)
        Labels 0, 1, ... in order of each group's first triangle.
    """
    corners = (vertices - vertices.mean(axis=0))[triangles]
    area_vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    neighbour = twin // 3
    reachable = np.where(joinable, neighbour, -1).reshape(-1, 3)
    grower = _Grower(corners, area_vectors, reachable, tolerance_mm)
    stays_alone = _stays_alone(corners, area_vectors, reachable, 2.0 * tolerance_mm).tolist()
    for seed in np.argsort(-np.linalg.norm(area_vectors, axis=1), kind="stable").tolist():
        if grower.label[seed] < 0:
            grower.grow(seed, stays_alone[seed])
    label = np.array(grower.label)
    _adopt_slivers(label, grower.areas, corners, neighbour.reshape(-1, 3), tolerance_mm)
    return _in_order(label)


def _stays_alone(
    corners: np.ndarray, area_vectors: np.ndarray, neighbour: np.ndarray, band_mm: float
) -> np.ndarray:
    """Return which triangles are groups of their own if a group begins there: no neighbour lies in their plane."""
    length = np.linalg.norm(area_vectors, axis=1, keepdims=True)
    normal = np.divide(area_vectors, length, out=np.zeros_like(area_vectors), where=length > 0)
    heights = np.einsum("tij,tj->ti", corners, normal)
    height = 0.5 * (heights.min(axis=1) + heights.max(axis=1))
    # `_fits` decides where rounding could
    slack_mm = 1e-6 * band_mm + 1e-12 * float(np.abs(corners).max())
    alone = np.ones(len(corners), dtype=bool)
    for k in range(3):
        other = neighbour[:, k]
        off = np.abs(np.einsum("tij,tj->ti", corners[other], normal) - height[:, None]).max(axis=1)
        alone &= (other < 0) | (off > band_mm + slack_mm)
    return alone


def _in_order(label: np.ndarray) -> np.ndarray:
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


class _Grower:
    """State of `group_coplanar`."""

    def __init__(
        self,
        corners: np.ndarray,
        area_vectors: np.ndarray,
        neighbour: np.ndarray,
        tolerance_mm: float,
    ) -> None:
        self.corners = corners
        self.area_vectors = area_vectors
        self.areas = np.linalg.norm(area_vectors, axis=1)
        self.neighbour = neighbour.tolist()
        self.tolerance_mm = tolerance_mm
        self.label: list[int] = [-1] * len(corners)
        self.n_groups = 0

    def grow(self, seed: int, stays_alone: bool) -> None:
        """Collect a new group around triangle `seed`."""
        members = [seed] if stays_alone else self._flood(seed, 2.0 * self.tolerance_mm)
        if len(members) > 1 and self._unevenness(members) > self.tolerance_mm:
            members = self._flood(seed, 0.5 * self.tolerance_mm)
            if self._unevenness(members) > self.tolerance_mm:
                members = [seed]
        for t in members:
            self.label[t] = self.n_groups
        self.n_groups += 1

    def _flood(self, seed: int, band_mm: float) -> list[int]:
        members = [seed]
        seen = {seed}
        # plain numbers: arrays of three take longer
        x, y, z = self.area_vectors[seed].tolist()
        fitted_area = float(self.areas[seed])
        normal, height = self._plane(np.array([x, y, z]), members)
        plane = (*normal.tolist(), height)
        front = [seed]
        while front:
            for t in self.neighbour[front.pop()]:
                if t < 0 or t in seen or self.label[t] >= 0:
                    continue
                if not self._fits(t, plane, band_mm):
                    continue
                seen.add(t)
                members.append(t)
                front.append(t)
                dx, dy, dz = self.area_vectors[t].tolist()
                x += dx
                y += dy
                z += dz
                area = math.sqrt(x * x + y * y + z * z)
                if area > 2.0 * fitted_area:
                    fitted_area = area
                    normal, height = self._plane(np.array([x, y, z]), members)
                    plane = (*normal.tolist(), height)
        return members

    def _fits(self, t: int, plane: tuple[float, float, float, float], band_mm: float) -> bool:
        u, v, w, height = plane
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self.corners[t].tolist()
        if (
            abs(ax * u + ay * v + az * w - height) > band_mm
            or abs(bx * u + by * v + bz * w - height) > band_mm
            or abs(cx * u + cy * v + cz * w - height) > band_mm
        ):
            return False
        longest = max(
            max(ax, bx, cx) - min(ax, bx, cx),
            max(ay, by, cy) - min(ay, by, cy),
            max(az, bz, cz) - min(az, bz, cz),
        )
        x, y, z = self.area_vectors[t].tolist()
        return bool(x * u + y * v + z * w > -band_mm * longest)

    def _plane(self, total: np.ndarray, members: list[int]) -> tuple[np.ndarray, float]:
        length = np.linalg.norm(total)
        normal = total / length if length > 0 else total
        heights = self.corners[members] @ normal
        return normal, 0.5 * float(heights.min() + heights.max())

    def _unevenness(self, members: list[int]) -> float:
        normal, height = self._plane(self.area_vectors[members].sum(axis=0), members)
        return float(np.abs(self.corners[members] @ normal - height).max())


def _adopt_slivers(
    label: np.ndarray,
    areas: np.ndarray,
    corners: np.ndarray,
    neighbour: np.ndarray,
    tolerance_mm: float,
) -> None:
    """Give triangles without width that stayed alone to the group across their longest side."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    alone = np.bincount(label)[label] == 1
    thin = 2.0 * areas <= tolerance_mm * 1e-3 * sides.max(axis=1)
    for t in np.flatnonzero(alone & thin):
        label[t] = label[neighbour[t, int(np.argmax(sides[t]))]]


# Facets of curved surfaces in a mesh that no longer says what it was.
#
# A mesh file knows triangles only. This is how the flat facets of cylinders, fillets and the like
# are told from faces that were meant flat, so that chords of a hole's rim are not offered as
# straight edges.
#
# Rules
# -----
# * An edge is *gentle* if the normal turns by less than `GENTLE_DEG` there. A *strip* is a face, or two triangles
#   nearly flat across the edge that is the flattest of both.
# * The *width* of a strip is its area over the length of its longest gentle edge. A strip matches a neighbour if it
#   is no wider than `WIDTH_RATIO` times that.
# * Where a plane runs into an arc, it turns by half of what neighbouring strips of the arc do. A gentle edge is
#   *tangent* for a strip if it turns by less than `TANGENT_SHARE` of what the strip across turns, the same way, at
#   another edge.
# * A strip is a *facet* of a curved surface if it has two or more gentle edges to matching neighbours that turn the
#   same way, not all of them tangent, and an arc through the strip that turns by the mean of the two largest turns
#   would stand off from it by no more than `RELATIVE_SAGITTA` of the part's bounding box diagonal.
# * So is a strip that matches a facet across a gentle edge that is not tangent for it.
# * Curved, and thus no candidate, are the gentle edges of facets, and the edges of facets that start at a gentle edge
#   of theirs (the chords of a rim). Not so an edge that meets no gentle one, the straight end of the surface, nor one
#   to a plane that turns by more than `SHARP_SHARE` times what the surface turns inside.
#
# A prism that really has twelve or more sides is therefore taken for a cylinder; read it from
# STEP to keep its edges.


GENTLE_DEG = 33.0
"""Largest turn between neighbouring facets of a curved surface: twelve facets to a full turn, and some rounding."""

RELATIVE_SAGITTA = 0.0125
"""Largest distance of a facet from its arc, as a fraction of the bounding box diagonal: 0.012 for a whole cylinder of
twelve facets."""

WIDTH_RATIO = 4.0
"""How much wider than its neighbour a facet of a curved surface may be."""

TANGENT_SHARE = 0.75
"""Between the half of a tangent plane and the whole of an even arc, nearer to the whole: arcs are seldom uneven."""

FLAT_SHARE = 0.25
"""Two triangles are one strip if they turn by no more than this share of what they turn to others."""

SHARP_SHARE = 2.0
"""A curved surface ends where it turns by more than this many times what it turns inside."""

# a turn that rounding of the vertices explains
_FLAT_DEG = 1e-3


def find_curved(vertices: np.ndarray, loops: FaceLoops) -> tuple[np.ndarray, np.ndarray]:
    """Find the faces that are facets of curved surfaces, and their chords.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    loops : FaceLoops
        The faces of a closed surface, coplanar triangles joined.

    Returns
    -------
    curved : ndarray of bool, shape (f,)
        Which faces are such facets.
    chords : ndarray of int, shape (e, 2)
        Vertex pairs, lower index first.
    """
    edge_vertices, edge_faces = pair_edges(vertices, loops)
    area_vectors = face_area_vectors(vertices, loops)
    areas = np.linalg.norm(area_vectors, axis=1)
    normals = area_vectors / np.maximum(areas[:, None], 1e-300)
    turns = signed_dihedrals_deg(vertices, normals, edge_vertices, edge_faces)
    gentle = np.abs(turns) < GENTLE_DEG
    strip = _pair_triangles(loops.size[loops.outer] == 3, edge_faces[gentle], np.abs(turns[gentle]))
    edge_strips = strip[edge_faces]
    inner = edge_strips[:, 0] == edge_strips[:, 1]
    bend = gentle & ~inner & (np.abs(turns) > _FLAT_DEG)
    lengths = np.linalg.norm(vertices[edge_vertices[:, 1]] - vertices[edge_vertices[:, 0]], axis=1)
    widths = _widths(
        np.bincount(strip, weights=areas), edge_strips[gentle & ~inner], lengths[gentle & ~inner]
    )
    sagitta_mm = RELATIVE_SAGITTA * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    bends = _bends(edge_strips[bend], turns[bend], widths)
    facet = _are_facets(bends, widths, sagitta_mm)
    beside = bends.strip[facet[bends.across] & bends.matches & ~bends.tangent]
    facet[beside] = True
    smooth = gentle & ~_sharp(turns, edge_strips, facet, bends)
    chord = _chords(facet, edge_vertices, edge_strips, smooth, inner)
    return facet[strip], np.sort(edge_vertices[chord], axis=1)


def _pair_triangles(
    triangular: np.ndarray, edge_faces: np.ndarray, turns: np.ndarray
) -> np.ndarray:
    """Number the strips: a strip is a face, or two triangles that are nearly flat across the flattest edge of both."""
    face = edge_faces.ravel()
    across = edge_faces[:, ::-1].ravel()
    turn = np.repeat(turns, 2)
    steepest = np.zeros(len(triangular))
    np.maximum.at(steepest, face, turn)
    # the flattest edge of each triangle; of equals, that to the lower face
    order = np.lexsort((across, turn, face))
    order = order[np.diff(face[order], prepend=-1) > 0]
    flattest = np.full(len(triangular), np.inf)
    beyond = np.full(len(triangular), -1)
    flattest[face[order]] = turn[order]
    beyond[face[order]] = across[order]
    beyond[~triangular] = -1
    strip = np.arange(len(triangular))
    f = np.flatnonzero((beyond >= 0) & (beyond < strip))
    g = beyond[f]
    is_pair = (beyond[g] == f) & (flattest[f] <= FLAT_SHARE * np.minimum(steepest[f], steepest[g]))
    strip[f[is_pair]] = g[is_pair]
    return np.unique(strip, return_inverse=True)[1].ravel()


def _widths(areas: np.ndarray, edge_strips: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the width of every strip across its gentle edges: area over the length of the longest of them."""
    longest = np.zeros(len(areas))
    for side in (0, 1):
        np.maximum.at(longest, edge_strips[:, side], lengths)
    return np.divide(areas, longest, out=np.full(len(areas), np.inf), where=longest > 0)


class _Bends(NamedTuple):
    """The gentle edges that are not flat, each as one of its strips sees it; all of shape (2 e,)."""

    strip: np.ndarray
    across: np.ndarray
    turn: np.ndarray
    matches: np.ndarray
    tangent: np.ndarray


def _bends(edge_strips: np.ndarray, turns: np.ndarray, widths: np.ndarray) -> _Bends:
    """Return the gentle edges of all strips that are not flat."""
    strip = edge_strips.ravel()
    across = edge_strips[:, ::-1].ravel()
    turn = np.repeat(turns, 2)
    size = np.abs(turn)
    largest, second = _two_largest(_way(strip, turn), size, 2 * len(widths))
    # what the strip across turns the same way at another edge
    other = _way(across, turn)
    elsewhere = np.where(largest[other] == size, second[other], largest[other])
    matches = widths[strip] <= WIDTH_RATIO * widths[across]
    return _Bends(strip, across, turn, matches, size < TANGENT_SHARE * elsewhere)


def _way(strip: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Number the two ways in which strips turn."""
    return 2 * strip + (turn > 0)


def _two_largest(
    group: np.ndarray, size: np.ndarray, n_groups: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest and the second largest size in each group, 0 where there is none."""
    order = np.lexsort((-size, group))
    begins = np.diff(group[order], prepend=-1) > 0
    largest = np.zeros(n_groups)
    largest[group[order[begins]]] = size[order[begins]]
    follows = np.flatnonzero(begins[:-1] & ~begins[1:]) + 1
    second = np.zeros(n_groups)
    second[group[order[follows]]] = size[order[follows]]
    return largest, second


def _are_facets(bends: _Bends, widths: np.ndarray, sagitta_mm: float) -> np.ndarray:
    """Return which strips have matching neighbours on two sides, and stand off little from the arc through these."""
    matches = bends.matches
    group = _way(bends.strip[matches], bends.turn[matches])
    n = 2 * len(widths)
    largest, second = _two_largest(group, np.abs(bends.turn[matches]), n)
    n_bends = np.bincount(group, minlength=n)
    n_tangent = np.bincount(group[bends.tangent[matches]], minlength=n)
    # A chord of width w under an arc that turns by t: the arc stands off by w / 2 tan(t / 4).
    turn = 0.5 * (largest + second)
    likely = np.flatnonzero((n_bends >= 2) & (n_tangent < n_bends))
    stands_off = 0.5 * widths[likely // 2] * np.tan(np.radians(turn[likely]) / 4.0)
    facet = np.zeros(len(widths), dtype=bool)
    facet[likely[stands_off <= sagitta_mm] // 2] = True
    return facet


def _sharp(
    turns: np.ndarray, edge_strips: np.ndarray, facet: np.ndarray, bends: _Bends
) -> np.ndarray:
    """Return the edges where a curved surface ends at a plane by turning much more than it does inside."""
    inside = facet[bends.across]
    steepest = np.zeros(len(facet))
    np.maximum.at(steepest, bends.strip[inside], np.abs(bends.turn[inside]))
    ends = facet[edge_strips[:, 0]] != facet[edge_strips[:, 1]]
    side = np.where(facet[edge_strips[:, 0]], edge_strips[:, 0], edge_strips[:, 1])
    # what bends turns by more than zero
    limit = steepest[side]
    return ends & (limit > 0.0) & (np.abs(turns) > SHARP_SHARE * limit)


def _chords(
    facet: np.ndarray,
    edge_vertices: np.ndarray,
    edge_strips: np.ndarray,
    smooth: np.ndarray,
    inner: np.ndarray,
) -> np.ndarray:
    of_facet = facet[edge_strips]
    curved = smooth & of_facet.any(axis=1)
    # a vertex and a facet whose gentle edge ends there
    keys = edge_vertices[:, :, None] * len(facet) + edge_strips[:, None, :]
    here = np.broadcast_to(of_facet[:, None, :], keys.shape)
    around = curved & ~inner
    rims = np.unique(keys[around][here[around]])
    ends = np.flatnonzero(of_facet.any(axis=1) & ~smooth)
    curved[ends] = (np.isin(keys[ends], rims) & here[ends]).any(axis=(1, 2))
    return curved


# Boundary cycles of groups of triangles, and the vertices on them that say nothing.
#
# The notation is that of `coplanar`.


def trace_loops(
    triangles: np.ndarray, twin: np.ndarray, group: np.ndarray
) -> list[list[list[int]]]:
    """Return the boundary cycles of every group; the group lies to the left, no cycle visits a vertex twice."""
    start = triangles.ravel().tolist()
    of_half_edge = np.repeat(group, 3)
    on_rim = of_half_edge != of_half_edge[twin]
    # a triangle alone is its own boundary
    alone = (np.bincount(group) == 1)[group] & on_rim.reshape(-1, 3).all(axis=1)
    loops: list[list[list[int]]] = [[] for _ in range(int(group.max()) + 1)]
    for g, corners in zip(group[alone].tolist(), triangles[alone].tolist(), strict=True):
        loops[g].append(corners)
    pending = (on_rim & ~np.repeat(alone, 3)).tolist()
    rim = on_rim.tolist()
    twins = twin.tolist()
    for first in np.flatnonzero(pending).tolist():
        cycle = []
        h = first
        while pending[h]:
            pending[h] = False
            cycle.append(start[h])
            h = _after(h)
            while not rim[h]:
                h = _after(twins[h])
        if cycle:
            loops[of_half_edge[first]].extend(_split_at_repeats(cycle))
    return loops


def _after(h: int) -> int:
    """Return the next half-edge of the same triangle."""
    return h - 2 if h % 3 == 2 else h + 1


def _split_at_repeats(cycle: list[int]) -> list[list[int]]:
    """Cut a cycle that touches itself in vertices into cycles that do not."""
    simple: list[list[int]] = []
    path: list[int] = []
    place: dict[int, int] = {}
    for v in cycle:
        if v in place:
            cut = place[v]
            simple.append(path[cut:])
            for w in path[cut:]:
                del place[w]
            del path[cut:]
        place[v] = len(path)
        path.append(v)
    return [*simple, path]


def drop_idle_vertices(
    vertices: np.ndarray,
    loops: list[list[list[int]]],
    curved_edges: set[tuple[int, int]],
    tolerance_mm: float,
) -> tuple[list[list[list[int]]], set[tuple[int, int]]]:
    """Remove vertices on a straight run between two faces.

    Returns
    -------
    loops, curved_edges
        Without the removed vertices; a run keeps whether it is curved.
    """
    idle = _idle_vertices(vertices, loops, curved_edges, tolerance_mm)
    if not idle and not curved_edges:
        return loops, set()
    kept_loops = []
    kept_curved = set()
    for cycles in loops:
        kept_cycles = []
        for cycle in cycles:
            corners = cycle if idle.isdisjoint(cycle) else [v for v in cycle if v not in idle]
            corners = corners if len(corners) >= 3 else cycle
            kept_cycles.append(corners)
            if curved_edges:
                kept_curved |= _curved_runs(cycle, corners, curved_edges)
        kept_loops.append(kept_cycles)
    return kept_loops, kept_curved


def _curved_runs(
    cycle: list[int], short_cycle: list[int], curved_edges: set[tuple[int, int]]
) -> set[tuple[int, int]]:
    """Return the edges of `short_cycle` that stand for curved edges of `cycle`."""
    following = dict(zip(cycle, [*cycle[1:], cycle[0]], strict=True))
    pairs = zip(short_cycle, [*short_cycle[1:], short_cycle[0]], strict=True)
    return {_pair(a, b) for a, b in pairs if _pair(a, following[a]) in curved_edges}


def turns_of_runs(
    traced: list[list[list[int]]],
    short_loops: list[list[list[int]]],
    turns: dict[tuple[int, int], float],
) -> dict[tuple[int, int], float]:
    """Return the turns at the edges that are left: the largest along the run of chords each stands for."""
    turn_of_edge: dict[tuple[int, int], float] = {}
    if not turns:
        return turn_of_edge
    for whole, short in zip(
        chain.from_iterable(traced), chain.from_iterable(short_loops), strict=True
    ):
        following = dict(zip(whole, [*whole[1:], whole[0]], strict=True))
        for a, b in zip(short, [*short[1:], short[0]], strict=True):
            at = a
            run_turns = []
            while at != b:
                run_turns.append(turns.get(_pair(at, following[at])))
                at = following[at]
            values = [turn for turn in run_turns if turn is not None]
            if values:
                turn_of_edge[_pair(a, b)] = max(values)
    return turn_of_edge


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _idle_vertices(
    vertices: np.ndarray,
    loops: list[list[list[int]]],
    curved_edges: Iterable[tuple[int, int]],
    tolerance_mm: float,
) -> set[int]:
    all_loops = FaceLoops.of_cycles(loops)
    start = all_loops.start
    twice = np.bincount(start) == 2
    visits = np.flatnonzero(twice[start])
    neighbours: dict[int, set[int]] = {}
    for before, at, after in zip(
        start[all_loops.preceding[visits]].tolist(),
        start[visits].tolist(),
        all_loops.end[visits].tolist(),
        strict=True,
    ):
        neighbours.setdefault(at, set()).update((before, after))
    passing = {v for v, around in neighbours.items() if len(around) == 2}
    passing = {v for v in passing if len({_pair(v, w) in curved_edges for w in neighbours[v]}) == 1}
    passing = {v for v in passing if _is_between(vertices, v, neighbours[v], tolerance_mm)}
    idle: set[int] = set()
    for v in sorted(passing):
        if v not in idle:
            idle |= _idle_inside(vertices, _run_through(v, neighbours, passing), tolerance_mm)
    return _spare_short_cycles(loops, idle)


def _idle_inside(vertices: np.ndarray, run: list[int], tolerance_mm: float) -> set[int]:
    """Return the vertices inside a run that a polyline within the tolerance can do without (Douglas and Peucker)."""
    if len(run) < 3:
        return set()
    points = vertices[run]
    if _is_straight(points, tolerance_mm):
        return set(run[1:-1])
    along = points[-1] - points[0]
    far = 1 + int(np.argmax(np.linalg.norm(np.cross(points[1:-1] - points[0], along), axis=1)))
    return _idle_inside(vertices, run[: far + 1], tolerance_mm) | _idle_inside(
        vertices, run[far:], tolerance_mm
    )


def _spare_short_cycles(loops: list[list[list[int]]], idle: set[int]) -> set[int]:
    """Keep all vertices of cycles that would lose too many."""
    for cycle in chain.from_iterable(loops):
        if not idle.isdisjoint(cycle) and sum(v not in idle for v in cycle) < 3:
            idle = idle - set(cycle)
    return idle


def _is_between(vertices: np.ndarray, v: int, ends: set[int], tolerance_mm: float) -> bool:
    a, b = (vertices[w] for w in ends)
    return bool((vertices[v] - a) @ (b - vertices[v]) > 0) and _is_straight(
        np.array([a, vertices[v], b]), tolerance_mm
    )


def _is_straight(points: np.ndarray, tolerance_mm: float) -> bool:
    along = points[-1] - points[0]
    length = np.linalg.norm(along)
    if length <= tolerance_mm:
        return False
    off = np.cross(points[1:-1] - points[0], along / length)
    return bool(np.linalg.norm(off, axis=1).max() <= tolerance_mm)


def _run_through(v: int, neighbours: dict[int, set[int]], passing: set[int]) -> list[int]:
    """Return the run of passing vertices through `v` with the two vertices that end it."""
    run = [v]
    for _ in range(2):
        run.reverse()
        while run[-1] in passing:
            ahead = [w for w in neighbours[run[-1]] if w not in run]
            if not ahead:
                break
            run.append(ahead[0])
    return run


def assemble(
    tessellation: Tessellation,
    name: str = "",
    planarity_mm: float | None = None,
    notes: Iterable[str] = (),
) -> Solid:
    """Join coplanar triangles into faces and return the validated solid.

    Parameters
    ----------
    tessellation : Tessellation
        Closed, oriented triangles.
    name : str
        Name of the part.
    planarity_mm : float, optional
        Triangles whose corners lie in a plane to within this distance are joined; an edge vertex this close to the line
        between its neighbours is removed where only two faces meet. Default: 10⁻⁶ of the bounding box diagonal.
    notes : iterable of str
        Passed on to the solid.

    Raises
    ------
    SolidError
        The triangles do not bound a valid solid.
    """
    tolerance = (
        default_planarity_mm(tessellation.vertices) if planarity_mm is None else planarity_mm
    )
    notes = list(notes)
    vertices, faces, curved_edges, new, turns = _joined(tessellation, tolerance, notes)
    circular = tessellation.circular_edges
    return Solid(
        vertices,
        faces,
        curved_edges=curved_edges,
        name=name,
        planarity_mm=2 * tolerance,
        notes=notes,
        circular_edges=None
        if circular is None
        else [_with_vertices(edge, new) for edge in circular],
        surface_turns=turns,
    )


def _joined(tessellation: Tessellation, tolerance_mm: float, notes: list[str]) -> Any:
    """Return vertices, faces and curved edges, the new index of every vertex in use, and the turns at edges left."""
    vertices = tessellation.vertices
    triangles = tessellation.triangles
    corners = FaceLoops.of_triangles(triangles)
    pair_edges(vertices, corners)
    check_fans(vertices, corners)
    twin = find_twins(triangles)
    flat = ~tessellation.curved_patch[tessellation.patch]
    here = np.repeat(np.arange(len(triangles)), 3)
    there = twin // 3
    joinable = (tessellation.patch[here] == tessellation.patch[there]) | (flat[here] & flat[there])
    with phase("join coplanar facets"):
        group = group_coplanar(vertices, triangles, twin, joinable, tolerance_mm)
    curved_edges = tessellation.curved_edges | _inner_edges(tessellation, twin)
    with phase("trace the faces"):
        traced = trace_loops(triangles, twin, group)
        cycles, curved_edges = drop_idle_vertices(vertices, traced, curved_edges, tolerance_mm)
    turns = turns_of_runs(traced, cycles, tessellation.surface_turns)
    patches = tessellation.patch[np.unique(group, return_index=True)[1]]
    curved = tessellation.curved_patch[patches]
    loops = FaceLoops.of_cycles([_outer_first(vertices, face_cycles) for face_cycles in cycles])
    facets = np.isin(patches, list(tessellation.faceted_patches))
    curved, chords = _recognise(vertices, loops, curved, facets, notes)
    pairs = np.array([*curved_edges], dtype=np.int64).reshape(-1, 2)
    used, loops, pairs = _renumber(loops, np.concatenate([pairs, chords]))
    new = {old: i for i, old in enumerate(used.tolist())}
    return (
        vertices[used],
        faces_of(loops, curved.tolist()),
        pairs,
        new,
        {(new[a], new[b]): turn for (a, b), turn in turns.items()},
    )


def _recognise(
    vertices: np.ndarray,
    loops: FaceLoops,
    curved: np.ndarray,
    facets: np.ndarray,
    notes: list[str],
) -> tuple[np.ndarray, np.ndarray]:
    """Find the facets of curved surfaces, of those faces that are facets.

    Returns
    -------
    curved : ndarray of bool, shape (f,)
        As given, and these.
    chords : ndarray of int, shape (e, 2)
        Their edges that are no candidates.
    """
    if not facets.any():
        return curved, np.empty((0, 2), dtype=np.int64)
    used, facet_loops, _ = _renumber(loops.only(facets), np.empty((0, 2), dtype=np.int64))
    with phase("find curved surfaces"):
        marked, chords = find_curved(vertices[used], facet_loops)
    if len(chords):
        notes.append(
            f"{int(marked.sum())} faces taken for facets of curved surfaces; their chords are no candidates"
        )
    curved = curved.copy()
    curved[facets] = marked
    return curved, used[chords]


def _with_vertices(edge: CircularEdge, new: dict[int, int]) -> CircularEdge:
    """Return a circular edge in new vertex indices, without the vertices that are not used any more."""
    return edge._replace(vertices=tuple(new[v] for v in edge.vertices if v in new))


def _inner_edges(tessellation: Tessellation, twin: np.ndarray) -> set[tuple[int, int]]:
    """Return the edges inside curved patches."""
    patch = np.repeat(tessellation.patch, 3)
    inner = (patch == patch[twin]) & tessellation.curved_patch[patch]
    start = tessellation.triangles.ravel()[inner]
    end = np.roll(tessellation.triangles, -1, axis=1).ravel()[inner]
    return {(a, b) for a, b in zip(start.tolist(), end.tolist(), strict=True) if a < b}


def _outer_first(vertices: np.ndarray, cycles: list[list[int]]) -> list[list[int]]:
    """Return the cycles of a face with the outer one first."""
    if len(cycles) == 1:
        return cycles
    if not cycles:
        raise SolidError("a solid must have a volume. Got a closed surface that lies in one plane.")
    areas = np.array([newell_area_vector(vertices[cycle]) for cycle in cycles])
    outer = int(np.argmax(areas @ areas.sum(axis=0)))
    return [cycles[outer], *cycles[:outer], *cycles[outer + 1 :]]


def _renumber(loops: FaceLoops, pairs: np.ndarray) -> tuple[np.ndarray, FaceLoops, np.ndarray]:
    """Drop unused vertices: return the old indices in use, and loops and vertex pairs in new indices."""
    used = np.unique(loops.start)
    new = np.full(max(int(used[-1]), int(pairs.max(initial=0))) + 1, -1)
    new[used] = np.arange(len(used))
    pairs = new[pairs]
    return (
        used,
        FaceLoops(new[loops.start], loops.size, loops.loop_face),
        pairs[(pairs >= 0).all(axis=1)],
    )
