"""Graphs of a part: of the entities asked for, and of all of them together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import (
    CROSSED,
    INSIDE,
    CellSet,
    Complex,
    add_box,
    allocate,
    cell_triangles,
    cut_further,
    measured,
    with_room,
)
from aspectgraph.cells.split import at_limits, cell_side, crop, leaves, n_leaves, split_cell
from aspectgraph.domains.carve import carve, is_inside, surface_facets
from aspectgraph.domains.find_domains import (
    Domain,
    Domains,
    Ruler,
    check_min_width,
    find_domains,
    largest_extent,
)
from aspectgraph.entities.entity import Entity
from aspectgraph.exact.grid import Grid, find_plane, plane_through, sign_at_point
from aspectgraph.exceptions import ContradictionError, MemoryLimitError
from aspectgraph.graph.aspect_graph import EntityAspectGraph, PartitionSurface, curve_attributes
from aspectgraph.solid.solid import RayScene, Solid, check_solid
from aspectgraph.visibility.entity_region import Region, SharedPlanes, overlay, share_planes
from aspectgraph.visibility.scene import (
    CONTRAST,
    EDGE_AND_END,
    VERTEX_AND_ENTITY,
    Scene,
    make_scene,
    own_order,
)
from aspectgraph.visibility.visibility_regions import (
    Progress,
    VisibilityRegions,
    check_regions,
    check_workspace,
    compute_regions,
)
from ground.decorators import entry_kernel

# The complete aspect graph of a small solid: every viewing domain on which the line drawing stays
# the same.
#
# For comparison with the entity-based graph only; its size is why that one exists (paper section
# 3.4: 71 nodes for an L-block against 20 for the edges of its step). Space is cut by *all* planes
# through an edge and a vertex of the solid, types A and B, and cells with equal drawings are
# merged across common faces. Surfaces of type C, ruled by three skew edges, are **not** included:
# across one of them two T-junctions on an edge change places, and a cell that one of them crosses
# gets the drawing of a single witness point.
#
# A drawing lists, for every sharp edge, its visible parts; each end of a part is an end of the
# edge itself or is named by the edge of the solid that cuts it off there (a T-junction).
#
# Which cells there are and which touch is decided exactly. The drawing of a cell is computed in
# doubles, at a witness point in general position inside it.


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
    SolidError
        If it is no solid.
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
    check_solid(solid)
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


# Aspect graphs built of the regions of entities, and what a joint graph costs in memory and time.


class Provenance:
    """Looks up which surfaces a shared plane stands for.

    Parameters
    ----------
    solid, scene, grid
        The solid, and itself on its grid.
    entities : sequence of Entity
    regions : sequence of Region
        Region of each entity.
    shared : SharedPlanes
        Their planes.
    """

    def __init__(
        self,
        solid: Solid,
        scene: Scene,
        grid: Grid,
        entities: Sequence[Entity],
        regions: Sequence[Region],
        shared: SharedPlanes,
    ) -> None:
        self._solid = solid
        self._scene = scene
        self._in_mm = grid.planes_to_mm(shared.planes)
        self._entities = entities
        self._regions = regions
        self._shared = shared
        self._edge_of_pair = {frozenset(edge.vertices): edge.id for edge in solid.edges}
        self._rows = [
            {int(n): row for row, n in reversed(list(enumerate(number)))}
            for number in shared.number
        ]

    def surfaces(
        self, planes: Iterable[int], changed: Iterable[int]
    ) -> tuple[PartitionSurface, ...]:
        """Surfaces on the given shared planes for the entities (by position) that change across them."""
        surfaces = []
        for k in changed:
            for plane in planes:
                row = self._rows[k].get(plane)
                if row is not None and self._regions[k].origin[row, 0] >= 0:
                    surfaces.append(self._surface(k, row, plane))
        return tuple(surfaces)

    def _surface(self, k: int, row: int, plane: int) -> PartitionSurface:
        entity = self._entities[k]
        kind, *numbers = self._regions[k].origin[row].tolist()
        next_to = tuple(
            f
            for edge_id in entity.edge_ids
            for f in self._solid.edges[edge_id].faces
            if self._same_plane(
                self._scene.planes[self._scene.plane_of_face[f]], self._shared.planes[plane]
            )
        )
        vertices: tuple[int, ...] = ()
        edges: tuple[int, ...] = ()
        faces: tuple[int, ...] = next_to
        if not next_to:
            if kind == EDGE_AND_END:
                edge = self._edge_of_pair.get(frozenset(numbers[:2]))
                edges = () if edge is None else (edge,)
                ends = numbers[2:] if edges else numbers
                # an end of a stretch is no vertex
                vertices = tuple(v for v in ends if v < len(self._solid.vertices))
            elif kind == VERTEX_AND_ENTITY:
                vertices = (numbers[0],)
                edges = self._spanning(entity, numbers[1:])
            elif kind == CONTRAST:
                edges = self._spanning(entity, numbers[:2])
                faces = (numbers[2],)
            else:
                faces = (numbers[0],)
        in_mm = tuple(self._in_mm[plane].tolist())
        kind_of = "A" if next_to else "B"
        if kind == CONTRAST and not next_to:
            kind_of = "L"
        return PartitionSurface(kind_of, entity.name, vertices, edges, faces, in_mm)

    def _spanning(self, entity: Entity, ends: list[int]) -> tuple[int, ...]:
        """The edges of an entity between two of its vertices: all of an edge or chain, one chord of a rim or arc."""
        chord = self._edge_of_pair.get(frozenset(ends))
        return entity.edge_ids if entity.kind == "edge" or chord is None else (chord,)

    @staticmethod
    def _same_plane(plane: np.ndarray, other: np.ndarray) -> bool:
        return bool((plane == other).all() or (plane == -other).all())


# Memory of a joint graph: about how much it takes, told before the work, and looked at while it
# grows.
#
# The cells of a joint graph grow faster than the number of its entities, and how fast depends on
# the part. So what is known before is an estimate, from the cells of the single regions, that may
# err by `ERROR` either way; what the cells hold while they grow is counted. A graph is refused
# before the work only if the estimate is too large by more than its error, and before all regions
# are there only if the first of them leave no doubt.


try:
    import resource
except ImportError:  # not on Windows
    resource = None  # type: ignore[assignment]


# Bytes and seconds of a graph for (cells of all regions)^_POWER; how many times as much as the overlay's cells it takes
# in the end; and the factor by which the estimate may err. With 10, 20 and 60 edges of nist_ctc_01 the memory was 1.56,
# 1.37 and 0.88 of the estimate (the last by hand, the others by `benchmarks/engine/joint_memory.py`). No other part is
# known.
_BYTES = 5.0


_SECONDS = 2.5e-7


_POWER = 2.0


_OF_OVERLAY = 4.0


ERROR = 3.0


# regions from which the cells of all are guessed: at least so many, and such a share; the guess may err by this besides
_FIRST = 10


_FIRST_SHARE = 0.05


_FIRST_ERROR = 2.0


_GROUP = Path("/sys/fs/cgroup")


_ADVICE = (
    "Ask for fewer entities, or for the regions only: compute_regions answers the same questions, "
    "and a plan needs no joint graph"
)


_GIB = 2**30


class JointEstimate(NamedTuple):
    """Estimated memory and time of a joint graph.

    Attributes
    ----------
    memory_bytes : float
        Largest memory of the graph, in addition to that of the process, bytes.
    seconds : float
        Approximate time in seconds. A busy machine took four to five times as long.
    """

    memory_bytes: float
    seconds: float


def estimate_joint_graph(regions: Sequence[Region]) -> JointEstimate:
    """Return about what the joint graph of regions costs."""
    return _cost(sum(region.n_leaves for region in regions))


def estimate_graph(regions: VisibilityRegions, names: Sequence[str] | None = None) -> JointEstimate:
    """Estimate memory and time of `graph_of`, before you call it.

    Parameters
    ----------
    regions : VisibilityRegions
        From `compute_regions`.
    names : sequence of str, optional
        Names of the entities. Default: all.

    Returns
    -------
    JointEstimate
        ``memory_bytes`` and ``seconds``. The real values may differ by a factor of three, more on a
        busy machine.

    Raises
    ------
    EntityError
        If `regions` are none, or a name is unknown.

    Examples
    --------
    >>> from aspectgraph import compute_regions, estimate_graph, read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> regions = compute_regions(block, {"rim": 17, "depth": 8})
    >>> estimate_graph(regions, ["rim"]).memory_bytes < estimate_graph(regions).memory_bytes < 1e9
    True
    """
    check_regions(regions)
    chosen = regions.check_names(regions.entity_names if names is None else names)
    return estimate_joint_graph([regions._regions[name] for name in chosen])


def _cost(cells: float) -> JointEstimate:
    growth = float(cells) ** _POWER
    return JointEstimate(_BYTES * growth, _SECONDS * growth)


class JointForecast:
    """Ends the computation of regions once their joint graph certainly exceeds the memory.

    Pass it to `compute_regions` as ``kept``. It stores no regions.

    Parameters
    ----------
    limit_bytes : float, optional
        Largest memory of the graph, in bytes. Default: the free memory.

    Raises
    ------
    MemoryLimitError
        If the limit is not a positive number, or in `put`, if the graph cannot fit.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import JointForecast, compute_regions
    >>> regions = compute_regions(box, {"top": 1, "side": 2}, kept=JointForecast(limit_bytes=2**30))
    >>> regions.entity_names
    ('top', 'side')
    """

    def __init__(self, limit_bytes: float | None = None) -> None:
        self.limit, self.whose = _limit(limit_bytes)
        self._total = 0
        self._known = 0
        self._cells = 0

    def begin(self, solid: Solid, box_mm: np.ndarray, entities: Mapping[str, Entity]) -> None:
        """Start with the number of entities.

        Parameters
        ----------
        solid : Solid
            The part.
        box_mm : array (2, 3)
            The workspace.
        entities : mapping of str to Entity
            All of them.
        """
        self._total = len(entities)
        self._known = 0
        self._cells = 0

    def get(self, name: str) -> None:
        """Return None, because it stores no regions.

        Parameters
        ----------
        name : str
            Of an entity.
        """

    def put(self, name: str, region: Region) -> None:
        """Count the cells of a region.

        Parameters
        ----------
        name : str
            Of its entity.
        region : Region
            Where it is observable.

        Raises
        ------
        MemoryLimitError
            If the graph cannot fit.
        """
        self._known = self._known + 1
        self._cells = self._cells + region.n_leaves
        if self._known < max(_FIRST, _FIRST_SHARE * self._total) or self._known == self._total:
            return
        about = _cost(self._cells * self._total / self._known).memory_bytes
        if about > _FIRST_ERROR * ERROR * self.limit:
            got = f"about {in_gib(about)}, estimated from the first {self._known} regions"
            raise _refusal(self._total, self.whose, self.limit, got)


class JointMemory:
    """Ends the work on a joint graph that does not fit; see `overlay`, which it watches.

    Parameters
    ----------
    regions : sequence of Region
        Of the entities.
    limit_bytes : float, optional
        Largest memory of the graph, in bytes. Default: the free memory.
    progress : callable, optional
        ``progress(done, total, "joint graph")``.

    Raises
    ------
    MemoryLimitError
        If the limit is no positive number, or the estimate is beyond it by more than its error.
    """

    def __init__(
        self, regions: Sequence[Region], limit_bytes: float | None, progress: Progress | None = None
    ) -> None:
        self.total = len(regions)
        self.progress = progress
        self.limit, self.whose = _limit(limit_bytes)
        about = estimate_joint_graph(regions)
        if about.memory_bytes > ERROR * self.limit:
            raise self._refused(f"about {in_gib(about.memory_bytes)}, estimated before the work")

    def __call__(self, done: int, held: int) -> None:
        """Look at what the cells hold after some regions."""
        if self.progress is not None:
            self.progress(done, self.total, "joint graph")
        if _OF_OVERLAY * held > self.limit:
            so_far = f"about {in_gib(_OF_OVERLAY * held)} after {done} of {self.total} entities"
            raise self._refused(so_far if done == self.total else f"{so_far}, and more to come")

    def refused(self, error: MemoryError) -> MemoryLimitError:
        """Return the error to raise in place of one that came on the way."""
        if isinstance(error, MemoryLimitError):
            if error.hint:
                return error
            # the room of the cells has a limit, too, which is not the memory
            message = f"the joint graph of {self.total} entities cannot be built: {error}"
            refusal = MemoryLimitError(message)
            refusal.hint = _ADVICE
            return refusal
        return self._refused(
            f"a process that gets no more memory ({str(error).rstrip('.') or 'no reason given'})"
        )

    def _refused(self, got: str) -> MemoryLimitError:
        return _refusal(self.total, self.whose, self.limit, got)


def _refusal(total: int, whose: str, limit: float, got: str) -> MemoryLimitError:
    return MemoryLimitError.of_rule(
        "",
        f"the joint graph of {total} entities must fit {whose}, {in_gib(limit)}",
        got,
        hint=_ADVICE,
        mentions=("memory_limit_bytes",),
    )


def in_gib(memory_bytes: float) -> str:
    """Return an amount of memory for people."""
    return f"{memory_bytes / _GIB:.2g} GiB"


def _limit(limit_bytes: float | None) -> tuple[float, str]:
    """Return what a graph may take, and the words for it."""
    if limit_bytes is None:
        return free_bytes(), "the memory that is free"
    if not limit_bytes > 0:
        raise MemoryLimitError.of_rule(
            "memory_limit_bytes", "must be a positive number of bytes", str(limit_bytes)
        )
    return float(limit_bytes), "memory_limit_bytes"


def free_bytes() -> float:
    """Return the memory that is left: of the machine, its container and the process; infinity where none tells."""
    return min(_left_of_machine(), _left_of_container(), _left_of_process())


def _left_of_machine() -> float:
    return _told_by("/proc/meminfo", "MemAvailable")


def _left_of_container() -> float:
    """Return what the control group of a container leaves; what files only passed through can be had again."""
    try:
        limit, taken = (
            float(_GROUP.joinpath(name).read_text("ascii"))
            for name in ("memory.max", "memory.current")
        )
        stated = dict(
            line.split() for line in _GROUP.joinpath("memory.stat").read_text("ascii").splitlines()
        )
        return max(limit - taken + float(stated["inactive_file"]), 0.0)
    except (OSError, ValueError, KeyError):
        # there is none, or its limit is "max"
        return inf


def _left_of_process() -> float:
    """Return what ``ulimit -v`` leaves."""
    if resource is None:
        return inf
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    taken = _told_by("/proc/self/status", "VmSize")
    return inf if limit == resource.RLIM_INFINITY or taken == inf else max(limit - taken, 0.0)


def _told_by(file: str, name: str) -> float:
    """Return an amount of memory in a file of the kernel; infinity where there is none."""
    try:
        with open(file, encoding="ascii", errors="replace") as lines:
            amounts = dict(line.split(":", 1) for line in lines if ":" in line)
        return 1024.0 * float(amounts[name].split()[0])
    except (OSError, KeyError, ValueError):
        return inf


# cells to reserve room for at first, where the part is cut out of the joint cells, per cell of these
# once the regions are joined: cut, found, described
_STEPS = 3


_ROOM_PER_CELL = 16


def build_aspect_graph(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    workspace: ArrayLike | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    *,
    min_width_mm: float | None = None,
    memory_limit_bytes: float | None = None,
) -> EntityAspectGraph:
    """Build the entity-based aspect graph of a solid.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping of str to edge id, id of a rim or arc, or pair of points
        The entities to measure; see `resolve_entities`.
    workspace : array_like, shape (2, 3), optional
        Corners of the viewpoint space in mm. Default: the part's box,
        extended by ten diagonals in all directions.
    executor : concurrent.futures.Executor, optional
        Computes the entities' regions in parallel.
    progress : callable, optional
        ``progress(done, total, label)`` after each of the entities; the label is the name of the entity, and then
        "joint graph" while their regions are joined.
    min_width_mm : float, optional
        Thinner domains are slivers, and contacts must be wider by half (see `domains`). Away from
        the part the limit grows in proportion to the distance, because snapping turns planes.
        Default: 10⁻⁴ of the largest distance between two vertices, or 0 if snapping moved nothing.
    memory_limit_bytes : float, optional
        Approximate limit of the memory for joining the regions, bytes. Default: the free memory.

    Returns
    -------
    EntityAspectGraph
        Guarantee: every viewpoint outside the solid and off the partition surfaces lies in exactly
        one domain. Its list names exactly the entities with free sight triangles (a rim: of all its
        chords). Merged slivers are the exception.

    Raises
    ------
    EntityError, WorkspaceError, WidthError
        For bad input.
    MemoryLimitError
        If the graph needs more memory than the limit. Use fewer entities; a smaller workspace does
        not help.
    ContradictionError
        If ray casting and exact arbitration refute a domain's list.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid, build_aspect_graph
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> eag = build_aspect_graph(box, {"top": 1, "side": 2})
    >>> eag
    <EntityAspectGraph of 'box': 2 entities, 4 domains, 5 adjacencies>
    >>> eag.graph.nodes[0]["observable"]
    ('top', 'side')
    """
    forecast = JointForecast(memory_limit_bytes)
    regions = compute_regions(
        solid, entities, workspace, executor=executor, progress=progress, kept=forecast
    )
    return graph_of(
        regions, min_width_mm=min_width_mm, memory_limit_bytes=memory_limit_bytes, progress=progress
    )


def graph_of(
    regions: VisibilityRegions,
    names: Sequence[str] | None = None,
    *,
    min_width_mm: float | None = None,
    memory_limit_bytes: float | None = None,
    progress: Progress | None = None,
) -> EntityAspectGraph:
    """Build the graph of some entities from regions already computed; see `build_aspect_graph`.

    Parameters
    ----------
    regions : VisibilityRegions
        From `compute_regions`.
    names : sequence of str, optional
        Names of the entities. Default: all.
    min_width_mm, memory_limit_bytes : float, optional
        As in `build_aspect_graph`.
    progress : callable, optional
        ``progress(done, total, "joint graph")`` after each of the entities, then
        ``progress(done, total, "domains of the graph")``.

    Returns
    -------
    EntityAspectGraph
        With the guarantee of `build_aspect_graph`.

    Raises
    ------
    EntityError
        If `regions` are none, or a name is unknown.
    WidthError
        If `min_width_mm` is out of range.
    MemoryLimitError
        If the graph takes more memory than it may.
    ContradictionError
        If ray casting and exact arbitration refute a domain's list.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import compute_regions, graph_of
    >>> regions = compute_regions(box, {"top": 1, "side": 2})
    >>> graph_of(regions, ["top"])
    <EntityAspectGraph of 'box': 1 entity, 2 domains, 1 adjacency>
    """
    check_regions(regions)
    chosen = regions.subset(regions.entity_names if names is None else names)
    displaced = float(chosen.grid.resolution * chosen.grid.step_mm)
    min_width_mm = check_min_width(min_width_mm, largest_extent(chosen.solid.vertices), displaced)
    memory = JointMemory(list(chosen._regions.values()), memory_limit_bytes, progress)
    try:
        return _joined(chosen, min_width_mm, memory)
    except MemoryError as error:
        raise memory.refused(error) from None


def _joined(
    chosen: VisibilityRegions, min_width_mm: float, memory: JointMemory
) -> EntityAspectGraph:
    grid = chosen.grid
    scene = chosen._scene
    regions = [chosen._regions[name] for name in chosen.entity_names]
    cube = grid.cube_planes(chosen.workspace)
    limits = grid.box_planes(chosen.workspace)
    order = own_order(scene, chosen.solid, chosen.entities.values())
    shared = share_planes(regions, scene, cube, order)
    facets = surface_facets(scene)
    uncut = overlay(
        regions, shared.extended(limits).extended(facets.planes), order=order, watch=memory
    )

    def cut(cx: Complex) -> None:
        carve(cx, scene, facets, len(cube))
        crop(cx, len(shared.planes))
        # what follows asks for the leaves again, and must not need more room
        leaves(cx)

    # facets take room, too, and a part may have many more of them than its regions have cells
    cx = cut_further(uncut, cut, _ROOM_PER_CELL * n_leaves(uncut) + len(facets.planes))
    del uncut
    _report_step(memory.progress, 1)
    extent = largest_extent(grid.points * grid.scale)
    domains = find_domains(measured(cx, grid), Ruler(min_width_mm / grid.step_mm, 0.5 * extent))
    _report_step(memory.progress, 2)
    provenance = Provenance(
        chosen.solid, scene, grid, list(chosen.entities.values()), regions, shared
    )
    graph = _networkx(chosen, cx, domains, provenance, at_limits(cx, len(shared.planes)))
    graph.graph["min_width_mm"] = min_width_mm
    confirm_nodes(chosen, graph)
    _report_step(memory.progress, _STEPS)
    return EntityAspectGraph(chosen, graph, cx, domains)


def _report_step(progress: Progress | None, done: int) -> None:
    if progress is not None:
        progress(done, _STEPS, "domains of the graph")


def _networkx(
    regions: VisibilityRegions,
    cx: Complex,
    domains: Domains,
    provenance: Provenance,
    at_boundary: np.ndarray,
) -> nx.Graph:
    names = regions.entity_names
    grid = regions.grid
    graph = nx.Graph(
        part=regions.solid.name,
        entities=names,
        endpoints=tuple(tuple(map(float, e.endpoints.ravel())) for e in regions.entities.values()),
        workspace_min=tuple(map(float, regions.workspace[0])),
        workspace_max=tuple(map(float, regions.workspace[1])),
        grid_mm=float(grid.step_mm),
        snapping_mm=float(grid.snapping_mm),
        n_slivers=int(domains.n_slivers),
        **curve_attributes(regions.entities.values()),
    )
    members = [_listed(domain) for domain in domains.domains]
    for node, domain in enumerate(domains.domains):
        low, high = CellSet(cx, domain.cells, grid).bounds
        graph.add_node(
            node,
            **{regions.listed_as: tuple(names[k] for k in sorted(members[node]))},
            volume=float(domain.volume * grid.step_mm**3),
            unbounded=bool(at_boundary[domain.cells].any()),
            viewpoint=tuple(map(float, grid.measured_to_mm(domain.viewpoint))),
            clearance=float(domain.clearance * grid.step_mm),
            bbox_min=tuple(map(float, low)),
            bbox_max=tuple(map(float, high)),
            n_cells=len(domain.cells),
        )
    for (i, j), contact in domains.contacts.items():
        graph.add_edge(
            i,
            j,
            area=float(contact.area * grid.step_mm**2),
            surfaces=provenance.surfaces(sorted(contact.planes), sorted(members[i] ^ members[j])),
        )
    return graph


def _listed(domain: Domain) -> set[int]:
    bits = sum(word << (64 * k) for k, word in enumerate(domain.label))
    return {k for k in range(bits.bit_length()) if bits >> k & 1}
