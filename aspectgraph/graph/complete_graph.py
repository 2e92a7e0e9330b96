"""The complete aspect graph of a small solid: every viewing domain on which the line drawing stays the same.

For comparison with the entity-based graph only; its size is why that one exists (paper section 3.4: 71 nodes for an
L-block against 20 for the edges of its step). Space is cut by *all* planes through an edge and a vertex of the solid,
types A and B, and cells with equal drawings are merged across common faces. Surfaces of type C, ruled by three skew
edges, are **not** included: across one of them two T-junctions on an edge change places, and a cell that one of them
crosses gets the drawing of a single witness point.

A drawing lists, for every sharp edge, its visible parts; each end of a part is an end of the edge itself or is named by
the edge of the solid that cuts it off there (a T-junction).

Which cells there are and which touch is decided exactly. The drawing of a cell is computed in doubles, at a witness
point in general position inside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import (
    CROSSED,
    INSIDE,
    Complex,
    add_box,
    allocate,
    cell_triangles,
    measured,
    with_room,
)
from aspectgraph.cells.split import cell_side, leaves, split_cell
from aspectgraph.domains.carve import is_inside
from aspectgraph.domains.find_domains import Ruler, find_domains, largest_extent
from aspectgraph.entities.entity import Entity
from aspectgraph.exact.grid import find_plane, plane_through, sign_at_point
from aspectgraph.exceptions import ContradictionError
from aspectgraph.solid.ray_scene import RayScene
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.scene import Scene, make_scene
from aspectgraph.visibility.visibility_regions import Progress, VisibilityRegions, check_workspace
from ground.decorators import entry_kernel

# Confirm viewing domains with Open3D's ray casting.
#
# From each domain's viewpoint, rays go to points spread along every entity. All of them arriving
# means the entity is seen, one of them stopped means it is not. Rays are float32 and sample the
# entity, so an answer that disagrees with the domain's list is a doubt, not a verdict: doubts are
# settled exactly, by asking each blocked set of the entity whether it holds the viewpoint. A list
# that is wrong by that test raises.


RAYS_PER_ENTITY = 32

# a ray is stopped if it hits before this share of the way to the entity
_ARRIVED = 1.0 - 1e-4
_RAYS_AT_ONCE = 1 << 20


class Confirmation(NamedTuple):
    """What ray casting found for each viewpoint.

    Attributes
    ----------
    n_rays : int
        Rays cast from every viewpoint.
    n_arbitrated : ndarray of int, shape (n,)
        Entities whose answer was settled exactly.
    """

    n_rays: int
    n_arbitrated: np.ndarray


class SightLines:
    """Ray casting from viewpoints to the entities of a solid.

    Parameters
    ----------
    solid : Solid
    entities : sequence of Entity
    rays_per_entity : int
    """

    def __init__(
        self, solid: Solid, entities: Sequence[Entity], rays_per_entity: int = RAYS_PER_ENTITY
    ) -> None:
        self._scene = RayScene(solid.vertices, solid.triangles)
        along = (np.arange(rays_per_entity) + 0.5) / rays_per_entity
        # shape (k, rays, 3)
        self._targets = np.array([_spread(entity, along) for entity in entities])

    def arrive(self, viewpoints: np.ndarray) -> np.ndarray:
        """Whether every ray from (n, 3) viewpoints in mm to each of k entities arrives, as (n, k) bool."""
        k, rays, _ = self._targets.shape
        result = np.empty((len(viewpoints), k), bool)
        rows = max(1, _RAYS_AT_ONCE // (k * rays))
        for start in range(0, len(viewpoints), rows):
            eyes = viewpoints[start : start + rows, None, None]
            hits = self._scene.cast(eyes, self._targets[None] - eyes)["t_hit"]
            result[start : start + rows] = (hits >= _ARRIVED).all(axis=-1)
        return result


def _spread(entity: Entity, along: np.ndarray) -> np.ndarray:
    """Points of an entity at shares of its length, shape (n, 3)."""
    if entity.kind == "edge":
        start, end = entity.endpoints
        return start + along[:, None] * (end - start)
    line = entity.outline
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return np.column_stack([np.interp(along * run[-1], run, line[:, axis]) for axis in range(3)])


@entry_kernel
def is_blocked(sets, query):
    """Whether one of the blocked sets holds an int64 query point (`Grid.to_points`) in its interior, exactly."""
    for k in range(len(sets.first) - 1):
        holds = True
        for j in range(sets.first[k], sets.first[k + 1]):
            if sign_at_point(sets.planes, sets.plane[j], query) * sets.side[j] <= 0:
                holds = False
                break
        if holds:
            return True
    return False


def confirm_nodes(regions: VisibilityRegions, graph: nx.Graph) -> None:
    """Cast rays from near every node's viewpoint and note the result on the node.

    Not from the viewpoint itself: in symmetric parts it lies on partition planes and on seams between blocked sets. Any
    other point of its ball, which lies in one cell, is as good a witness.

    Raises
    ------
    ContradictionError
        If a node's list is wrong.
    """
    names = regions.entity_names
    viewpoints, clearances = (
        np.array([graph.nodes[k][key] for k in graph]) for key in ("viewpoint", "clearance")
    )
    aside = np.random.default_rng(0).normal(size=viewpoints.shape)
    viewpoints = viewpoints + 0.25 * clearances[:, None] * aside / np.linalg.norm(
        aside, axis=1, keepdims=True
    )
    listed = np.array(
        [[name in graph.nodes[node][regions.listed_as] for name in names] for node in graph]
    )
    confirmation = confirm(regions, viewpoints, listed.reshape(len(graph), -1))
    for node in graph:
        graph.nodes[node].update(
            confirmed=True,
            n_rays=confirmation.n_rays,
            n_arbitrated=int(confirmation.n_arbitrated[node]),
        )


def confirm(
    regions: VisibilityRegions, viewpoints: np.ndarray, observable: np.ndarray
) -> Confirmation:
    """Check the lists of domains against rays cast from their viewpoints.

    Parameters
    ----------
    regions : VisibilityRegions
        Of k entities.
    viewpoints : ndarray, shape (n, 3)
        One per domain, in mm.
    observable : ndarray of bool, shape (n, k)
        The domains' lists.

    Raises
    ------
    ContradictionError
        If a list is wrong, naming domain and entity.
    """
    entities = regions.entities
    if not entities or not len(viewpoints):
        return Confirmation(0, np.zeros(len(viewpoints), int))
    seen = SightLines(regions.solid, list(entities.values())).arrive(
        viewpoints
    ) & regions._holds_besides(viewpoints)
    doubts = seen != observable
    queries = regions.grid.to_points(viewpoints)
    for column in np.flatnonzero(doubts.any(axis=0)):
        name, entity = list(entities.items())[column]
        sets = regions._sets(entity)
        for row in np.flatnonzero(doubts[:, column]):
            if is_blocked(sets, queries[row]) == observable[row, column]:
                raise ContradictionError(
                    f"domain {row} must list exactly the entities {regions.listed_as} from {viewpoints[row].tolist()} "
                    f"mm. Its list {'holds' if observable[row, column] else 'lacks'} {name!r}."
                )
    return Confirmation(RAYS_PER_ENTITY * len(entities), doubts.sum(axis=1))


_BOX = np.arange(6)
# least width of a domain, in shares of the part's diameter
_MIN_WIDTH_SHARE = 1e-4
_SHARP_DEG = 1e-6

# a sight line arrives if nothing stops it before this share of its way
_COMPLETE_GRAPH_ARRIVED = 1.0 - 1e-9

Part = tuple[int, int]
"""Visible part of an edge: the edges that cut it off at its start and end, -1 for the edge's own ends."""


def complete_aspect_graph(
    solid: Solid, workspace: ArrayLike | None = None, progress: Progress | None = None
) -> nx.Graph:
    """Build the complete aspect graph of a small solid.

    The number of planes grows with the square of the number of edges, and that of cells with its
    sixth power. An L-block has 29 planes and 1,493 cells.

    Parameters
    ----------
    solid : Solid
        The part.
    workspace : array_like, shape (2, 3), optional
        Corners of the viewpoint space in mm. Default: the part's box,
        extended by ten diagonals in all directions.
    progress : callable, optional
        ``progress(done, total, label)`` after each of the cells of the arrangement; the label is "cells".

    Returns
    -------
    networkx.Graph
        Nodes 0, 1, … with attributes ``drawing`` (text, see `describe_drawing`), ``n_visible`` (edges seen whole),
        ``volume`` (mm³), ``viewpoint`` and ``clearance`` (as in `EntityAspectGraph`) and ``n_cells``; edges with
        ``area`` (mm²); the graph with ``part``, ``n_planes``, ``n_cells`` and ``n_slivers``.

    Raises
    ------
    WorkspaceError
        If the workspace is not a box around the part.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import complete_aspect_graph
    >>> graph = complete_aspect_graph(box)
    >>> len(graph), sorted(graph.nodes[0])[:2]
    (26, ['clearance', 'drawing'])
    """
    box_mm = check_workspace(workspace, solid)
    grid, scene = make_scene(solid)
    sharp = solid.straight_edges(min_dihedral_deg=_SHARP_DEG)
    planes = edge_vertex_planes(scene, np.array([edge.vertices for edge in sharp]))
    cx = arrangement(np.concatenate([grid.box_planes(box_mm), planes]))
    drawings = _label(cx, solid, scene, progress)
    extent = largest_extent(grid.points * grid.scale)
    domains = find_domains(measured(cx, grid), Ruler(_MIN_WIDTH_SHARE * extent, 0.5 * extent))
    graph = nx.Graph(
        part=solid.name,
        n_planes=len(planes),
        n_cells=len(leaves(cx)),
        n_slivers=int(domains.n_slivers),
    )
    for node, domain in enumerate(domains.domains):
        drawing = drawings[domain.label[0]]
        graph.add_node(
            node,
            drawing=drawing,
            n_visible=len(seen_whole(drawing)),
            volume=float(domain.volume * grid.step_mm**3),
            viewpoint=tuple(map(float, grid.measured_to_mm(domain.viewpoint))),
            clearance=float(domain.clearance * grid.step_mm),
            n_cells=len(domain.cells),
        )
    for (i, j), contact in domains.contacts.items():
        graph.add_edge(i, j, area=float(contact.area * grid.step_mm**2))
    return graph


def _label(cx: Complex, solid: Solid, scene: Scene, progress: Progress | None) -> list[str]:
    """Label the cells outside the solid by the number of their drawing; return the drawings."""
    sharp = solid.straight_edges(min_dihedral_deg=_SHARP_DEG)
    lines = Drawing(scene.points, np.array([edge.vertices for edge in sharp]), solid.triangles)
    ids = [edge.id for edge in sharp]
    numbers: dict[str, int] = {}
    present = leaves(cx).tolist()
    for done, c in enumerate(present, start=1):
        witness = interior_point(cell_triangles(cx, c))
        if is_inside(scene, witness):
            cx.label[c, 0] = INSIDE
        else:
            cx.label[c, 0] = numbers.setdefault(
                describe_drawing(lines.visible_parts(witness), ids), len(numbers)
            )
        if progress is not None:
            progress(done, len(present), "cells")
    return list(numbers)


def edge_vertex_planes(scene: Scene, edges: np.ndarray) -> np.ndarray:
    """Return the distinct planes through an edge and a vertex, faces' planes first, int64, shape (p, 4)."""
    rank = np.argsort(np.lexsort(scene.points.T[::-1]))
    edges = edges[np.lexsort(np.sort(rank[edges], axis=1).T[::-1])]
    corners = np.unique(edges)
    corners = corners[np.argsort(rank[corners])]
    planes = np.empty((len(scene.planes) + len(edges) * len(corners), 4), np.int64)
    n = len(scene.planes)
    planes[:n] = scene.planes
    for a, b in edges:
        for vertex in corners:
            plane = plane_through(scene.points[a], scene.points[b], scene.points[vertex])
            trio = np.array([a, b, vertex])
            if plane[:3].any() and find_plane(planes, n, scene.points, trio, scene.resolution) < 0:
                planes[n] = plane
                n += 1
    return planes[:n].copy()


def arrangement(planes: np.ndarray) -> Complex:
    """Return the complex of all cells of planes; the first six are the box."""
    return with_room(lambda n_cells: _arrangement(planes, n_cells))


def _arrangement(planes: np.ndarray, n_cells: int) -> Complex:
    cx = allocate(planes, n_cells)
    add_box(cx, _BOX)
    _cut_everywhere(cx)
    # what follows asks for the leaves again, and must not need more room
    leaves(cx)
    return cx


@entry_kernel
def _cut_everywhere(cx):
    for h in range(6, len(cx.planes)):
        for c in leaves(cx):
            if cell_side(cx, c, h) == CROSSED:
                split_cell(cx, c, h)


def interior_point(triangles: np.ndarray) -> np.ndarray:
    """Return a point in general position inside a convex cell, given triangles of its surface, shape (t, 3, 3)."""
    corners = np.unique(triangles.reshape(-1, 3), axis=0)
    weights = np.random.default_rng(len(corners)).uniform(1.0, 2.0, len(corners))
    return weights @ corners / weights.sum()


class Drawing:
    """Computes line drawings of a solid.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices.
    edges : ndarray of int, shape (m, 2)
        Sharp edges.
    triangles : ndarray of int, shape (t, 3)
        The surface.
    """

    def __init__(self, points: np.ndarray, edges: np.ndarray, triangles: np.ndarray) -> None:
        self.starts, self.ends = (points[edges[:, k]].astype(float) for k in (0, 1))
        self.corners = points[triangles].astype(float)
        self._share = (edges[:, None, :, None] == edges[None, :, None, :]).any(axis=(2, 3))

    def visible_parts(self, viewpoint: np.ndarray) -> list[list[Part]]:
        """Return the visible parts of every edge, in order along it."""
        cuts = [[(0.0, -1)] for _ in self.starts]
        for e, f, t in sorted(self._crossings(viewpoint), key=lambda row: row[2]):
            cuts[e].append((t, f))
        pieces = [
            (e, *pair)
            for e, row in enumerate(cuts)
            for pair in zip(row, [*row[1:], (1.0, -1)], strict=True)
        ]
        edge = np.array([p[0] for p in pieces])
        middle = np.array([0.5 * (p[1][0] + p[2][0]) for p in pieces])
        targets = self.starts[edge] + middle[:, None] * (self.ends - self.starts)[edge]
        parts: list[list[Part]] = [[] for _ in self.starts]
        open_end = False
        for (e, (start, f), (_, g)), arrives in zip(
            pieces, self._arrive(viewpoint, targets), strict=True
        ):
            if arrives and open_end and start > 0.0:
                parts[e][-1] = (parts[e][-1][0], g)
            elif arrives:
                parts[e].append((f, g))
            open_end = arrives
        return parts

    def _crossings(self, v: np.ndarray) -> list[tuple[int, int, float]]:
        """Return (e, f, t) where a nearer edge f crosses edge e, at parameter t on e, for all pairs of edges."""
        a = self.starts - v
        b = self.ends - v
        normal = np.cross(a, b)
        # [e, f]: ends of e against the plane (v, f), and ends of f against the plane (v, e)
        e_start = a @ normal.T
        e_end = b @ normal.T
        f_start = e_start.T
        f_end = e_end.T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = e_start / (e_start - e_end)
            s = f_start / (f_start - f_end)
            on_e = a[:, None] + t[..., None] * (b - a)[:, None]
            on_f = a[None] + s[..., None] * (b - a)[None]
            nearness = (on_f * on_e).sum(axis=2) / (on_e * on_e).sum(axis=2)
        crosses = (e_start * e_end < 0) & (f_start * f_end < 0) & ~self._share
        e, f = np.nonzero(crosses & (nearness > 0) & (nearness < 1))
        return list(zip(e.tolist(), f.tolist(), t[e, f].tolist(), strict=True))

    def _arrive(self, v: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """Return which sight lines from v to points on edges are not stopped by a face."""
        ray = (targets - v)[:, None]
        p, q, r = (self.corners[:, k] - v for k in range(3))
        # The line passes a triangle seen from v where it is on the same side of the planes through v and its sides.
        sides = np.stack([(ray * np.cross(x, y)).sum(axis=2) for x, y in ((p, q), (q, r), (r, p))])
        margin = 1e-12 * np.abs(sides).max(axis=0)
        passes = (sides >= -margin).all(axis=0) | (sides <= margin).all(axis=0)
        normal = np.cross(q - p, r - p)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (p * normal).sum(axis=1) / (ray * normal).sum(axis=2)
        return ~(passes & (share > 0) & (share < _COMPLETE_GRAPH_ARRIVED)).any(axis=1)


def describe_drawing(parts: list[list[Part]], ids: list[int]) -> str:
    """Return a drawing as text: ``4`` is edge 4 seen whole, ``4[-7]`` from its start to where edge 7 cuts it off.

    Parameters
    ----------
    parts : list of list of Part
        Visible parts of each edge, edges counted from 0.
    ids : list of int
        Their ids in the solid.
    """
    words = []
    for e, row in zip(ids, parts, strict=True):
        for start, end in row:
            ends = [str(ids[f]) if f >= 0 else "" for f in (start, end)]
            words.append(f"{e}[{ends[0]}-{ends[1]}]" if any(ends) else str(e))
    return " ".join(words) or "nothing"


def seen_whole(drawing: str) -> tuple[int, ...]:
    """Return the edges that a drawing shows whole."""
    return tuple(int(word) for word in drawing.split() if word.isdigit())
