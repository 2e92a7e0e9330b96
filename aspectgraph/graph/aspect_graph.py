"""The entity-based aspect graph: viewing domains as nodes, common boundaries as edges (paper section 3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from importlib import import_module
from os import PathLike
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import Complex, cut_further
from aspectgraph.cells.cell_set import CellSet
from aspectgraph.cells.crop import at_limits, crop
from aspectgraph.cells.measure import measured
from aspectgraph.cells.point_location import locate, tree_of
from aspectgraph.cells.simplify import n_leaves
from aspectgraph.cells.split import leaves
from aspectgraph.domains.carve import carve, surface_facets
from aspectgraph.domains.find_domains import Domain, Domains, find_domains
from aspectgraph.domains.width import Ruler, check_min_width, largest_extent
from aspectgraph.entities.straight_edges import Entity
from aspectgraph.exceptions import EntityError
from aspectgraph.graph.curve_attributes import curve_attributes
from aspectgraph.graph.joint_memory import JointForecast, JointMemory
from aspectgraph.graph.partition_surfaces import Provenance
from aspectgraph.graph.ray_confirmation import confirm_nodes
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.overlay import overlay, share_planes
from aspectgraph.visibility.scene import own_order
from aspectgraph.visibility.visibility_regions import Progress, VisibilityRegions, compute_regions

# cells to reserve room for at first, where the part is cut out of the joint cells, per cell of these
# once the regions are joined: cut, found, described
_STEPS = 3
_ROOM_PER_CELL = 16


class EntityAspectGraph:
    """The entity-based aspect graph EAG(E, V, O, A) of a solid.

    E are the entities, V viewing domains, O observable lists, and A adjacencies.

    `build_aspect_graph` makes it.

    Parameters
    ----------
    cx : Complex
        The convex cells that the workspace is cut into.
    domains : Domains
        Which of these cells form which node.

    Attributes
    ----------
    graph : networkx.Graph
        Nodes 0, 1, … are viewing domains, those with the longest lists first. ``observable`` is a
        tuple of names. ``volume`` is that inside the workspace, in mm³. ``unbounded`` is true if
        the domain reaches the workspace's boundary. ``viewpoint`` and ``clearance`` are centre and
        radius, in mm, of the largest ball in one of its cells. Cells at least as wide as the least
        width are preferred. Further attributes are ``bbox_min``, ``bbox_max``, ``n_cells``,
        ``confirmed``, ``n_rays`` and ``n_arbitrated``. Edges have ``area`` (mm²) and ``surfaces``
        (tuple of `PartitionSurface`).
    regions : VisibilityRegions
        The regions of the entities, which answer `observable` and `covering_cells`.
    """

    def __init__(
        self, regions: VisibilityRegions, graph: nx.Graph, cx: Complex, domains: Domains
    ) -> None:
        self.regions = regions
        self.graph = graph
        self._cx = cx
        self._domains = domains
        self._tree = tree_of(cx)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        size = f"{len(self.graph)} domains, {self.graph.number_of_edges()} adjacencies"
        return f"<EntityAspectGraph of {self.solid.name!r}: {len(self.entities)} entities, {size}>"

    @property
    def solid(self) -> Solid:
        """The solid."""
        return self.regions.solid

    @property
    def workspace(self) -> np.ndarray:
        """Lowest and highest corner of the viewpoint space in mm, shape (2, 3)."""
        return self.regions.workspace

    @property
    def entities(self) -> dict[str, Entity]:
        """The entities by name, in order."""
        return self.regions.entities

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the entities, in order."""
        return self.regions.entity_names

    def observable(self, points: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Whether entities are observable from viewpoints; see `VisibilityRegions.observable`.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm, inside the workspace.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name; False inside the solid.

        Raises
        ------
        WorkspaceError
            If a point lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        return self.regions.observable(points, names)

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Viewpoints from which all named entities are observable; see `VisibilityRegions.covering_cells`.

        Parameters
        ----------
        names : sequence of str
            Names of entities, at least one.

        Returns
        -------
        CellSet
            Empty if no viewpoint observes them all.

        Raises
        ------
        EntityError
            If a name is unknown, or none is given.
        """
        return self.regions.covering_cells(names)

    def domain_of(self, points: ArrayLike) -> np.ndarray:
        """Return the node of each viewpoint.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm.

        Returns
        -------
        ndarray of int64, shape (n,)
            Node numbers; -1 inside the solid and outside the workspace.
        """
        viewpoints = np.asarray(points, float).reshape(-1, 3)
        result = np.full(len(viewpoints), -1, np.int64)
        inside = ((viewpoints >= self.workspace[0]) & (viewpoints <= self.workspace[1])).all(axis=1)
        cells = locate(self._tree, self.regions.grid.to_points(viewpoints[inside]))
        result[inside] = self._domains.of_cell[cells]
        return result

    def covering(self, names: Sequence[str]) -> list[int]:
        """Return the nodes whose list contains all names.

        Parameters
        ----------
        names : sequence of str
            Names of entities. Without names, the result is all nodes.

        Returns
        -------
        list of int
            Node numbers, ascending.

        Raises
        ------
        EntityError
            If a name is unknown.
        """
        wanted = set(self.regions.check_names(names))
        return [
            node
            for node, listed in self.graph.nodes(data=self.regions.listed_as)
            if wanted <= set(listed)
        ]

    def cells(self, node: int) -> CellSet:
        """Return the convex cells of one viewing domain.

        Parameters
        ----------
        node : int
            Number of the node.

        Returns
        -------
        CellSet
            The cells that the domain consists of.
        """
        return CellSet(self._cx, self._domains.domains[node].cells, self.regions.grid)

    def sample(
        self, names: Sequence[str], n: int, rng: int | np.random.Generator = 0
    ) -> np.ndarray:
        """Draw viewpoints uniformly from all domains whose list contains the names.

        Parameters
        ----------
        names : sequence of str
            Names of entities.
        n : int
            How many viewpoints.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        ndarray of float64, shape (n, 3)
            Viewpoints in mm.

        Raises
        ------
        EntityError
            If a name is unknown, or no domain covers them.
        """
        nodes = self.covering(names)
        if not nodes:
            raise EntityError.of_rule(
                "names", "must be observable together from somewhere", ", ".join(names)
            )
        cells = np.concatenate([self._domains.domains[node].cells for node in nodes])
        return CellSet(self._cx, cells, self.regions.grid).sample(n, rng)

    def write(self, path: str | PathLike[str]) -> None:
        """Write the graph as GraphML; another name of `write_graphml`. `read_graphml` reads it.

        Parameters
        ----------
        path : str or os.PathLike
            The file; an existing one is replaced.
        """
        # the writer knows graphs, so its module is known by its name here
        import_module("aspectgraph.graph.graphml").write_graphml(self, path)


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
        If a name is unknown.
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
    <EntityAspectGraph of 'box': 1 entities, 2 domains, 1 adjacencies>
    """
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
    own = [chosen._regions[name] for name in chosen.entity_names]
    cube = grid.cube_planes(chosen.workspace)
    limits = grid.box_planes(chosen.workspace)
    order = own_order(scene, chosen.solid, chosen.entities.values())
    shared = share_planes(own, scene, cube, order)
    facets = surface_facets(scene)
    uncut = overlay(own, shared.extended(limits).extended(facets.planes), order=order, watch=memory)

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
    provenance = Provenance(chosen.solid, scene, grid, list(chosen.entities.values()), own, shared)
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
