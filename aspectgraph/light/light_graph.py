"""The aspect graph of lamp positions: domains under whose lamps the same entities show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.graph.aspect_graph import EntityAspectGraph, graph_of
from aspectgraph.light.light_regions import DEFAULT_CONTRAST, LightRegions, compute_light
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.visibility_regions import Progress


class LightGraph(EntityAspectGraph):
    """The aspect graph of lamp positions. `build_light_graph` makes it.

    All methods of `EntityAspectGraph` apply to lamps instead of cameras. `domain_of` takes lamp
    positions. `covering`, `cells` and `sample` return domains, cells and positions that light all
    names.

    Parameters
    ----------
    cx : Complex
        The convex cells that the space of lamps is cut into.
    domains : Domains
        Which of these cells form which node.

    Attributes
    ----------
    graph : networkx.Graph
        As in `EntityAspectGraph`, except that nodes list lit entities in ``showing`` instead of
        ``observable``. The graph has the attribute ``contrast``, and surfaces may be of type
        ``"L"``.
    regions : LightRegions
        The regions of the entities.
    """

    regions: LightRegions

    def __repr__(self) -> str:
        """Return a one-line summary."""
        size = f"{len(self.graph)} domains, {self.graph.number_of_edges()} adjacencies"
        return f"<LightGraph of {self.solid.name!r}: {len(self.entities)} entities, {size}>"

    @property
    def contrast(self) -> float:
        """Least contrast."""
        return self.regions.contrast

    def showing(self, lamps: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Whether lamps, each alone, light entities with contrast; see `LightRegions.showing`.

        Parameters
        ----------
        lamps : array_like, shape (n, 3)
            Positions of the lamps in mm, inside the workspace.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name; False inside the solid.

        Raises
        ------
        WorkspaceError
            If a lamp lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        return self.regions.showing(lamps, names)


def build_light_graph(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    contrast: float = DEFAULT_CONTRAST,
    workspace: ArrayLike | None = None,
    executor: Executor | None = None,
    *,
    min_width_mm: float | None = None,
) -> LightGraph:
    """Build the aspect graph of lamp positions.

    Parameters
    ----------
    solid : Solid
        The part: matt, of one albedo.
    entities : mapping of str to edge id, id of a rim or arc, or pair of points
        The entities to light; see `resolve_entities`.
    contrast : float
        Least contrast (absolute value of `contrast`) between the two faces of an edge, strictly between 0 and 1.
    workspace : array_like, shape (2, 3), optional
        Corners of the space of lamps in mm. Default: the part's box,
        extended by ten diagonals in all directions.
    executor : concurrent.futures.Executor, optional
        Computes the entities' regions in parallel.
    min_width_mm : float, optional
        As in `build_aspect_graph`.

    Returns
    -------
    LightGraph
        Every lamp position outside the solid and off the partition surfaces lies in exactly one
        domain. Its list names exactly the lit entities. Merged slivers are the exception.

    Raises
    ------
    LightError, EntityError, WorkspaceError, WidthError
        For bad input.
    ContradictionError
        If ray casting and exact arbitration refute a domain's list.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid, build_light_graph
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> light = build_light_graph(box, {"top": 1, "side": 2}, contrast=0.2)
    >>> light.graph.nodes[0]["showing"]
    ('top', 'side')
    """
    return light_graph_of(
        compute_light(solid, entities, contrast, workspace, executor), min_width_mm=min_width_mm
    )


def light_graph_of(
    regions: LightRegions,
    names: Sequence[str] | None = None,
    *,
    min_width_mm: float | None = None,
    memory_limit_bytes: float | None = None,
    progress: Progress | None = None,
) -> LightGraph:
    """Build the graph of some entities from light regions already computed; see `build_light_graph`.

    Parameters
    ----------
    regions : LightRegions
        From `compute_light`.
    names : sequence of str, optional
        Names of the entities. Default: all.
    min_width_mm, memory_limit_bytes : float, optional
        As in `build_aspect_graph`.
    progress : callable, optional
        ``progress(done, total, "joint graph")`` after each of the entities.

    Returns
    -------
    LightGraph
        With the guarantee of `build_light_graph`.

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
    >>> from aspectgraph import compute_light, light_graph_of
    >>> light = light_graph_of(compute_light(box, {"top": 1, "side": 2}, contrast=0.2))
    >>> light.graph.nodes[0]["showing"]
    ('top', 'side')
    """
    made = graph_of(
        regions,
        names,
        min_width_mm=min_width_mm,
        memory_limit_bytes=memory_limit_bytes,
        progress=progress,
    )
    made.graph.graph["contrast"] = regions.contrast
    return LightGraph(regions.subset(made.entity_names), made.graph, made._cx, made._domains)
