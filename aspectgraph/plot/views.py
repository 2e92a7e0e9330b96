"""Figures of solids, sections, domains and graphs."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import networkx as nx
import numpy as np
import shapely
from numpy.typing import ArrayLike

from aspectgraph.exceptions import AspectGraphError, SolidError, WorkspaceError
from aspectgraph.graph.aspect_graph import EntityAspectGraph, check_eag, plain_graph
from aspectgraph.plot.traces import (
    INK,
    box_around,
    box_half_spaces,
    domain_facets,
    line_trace,
    list_colors,
    list_text,
    listed_on,
    new_axes,
    part_traces,
    point_text,
    polygon_parts,
    polygon_union,
    scene_figure,
    section_axes,
    section_polygons,
    surface_trace,
    text_extent,
    xyz,
)
from aspectgraph.solid.solid import Solid, kind_text

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.text import Text
    from plotly.graph_objects import Figure

    from aspectgraph.entities.entity import Entity

# Interactive 3-D pictures: a part with its entities, and viewing domains around it (plotly).


# Picture of a cross-section: the viewing domains and the partition surfaces that bound them
# (matplotlib).


_TYPE_STYLE = {"A": ("#20262d", "solid", 1.5), "B": ("#b3122f", (0, (5, 2)), 1.5)}
_NUDGE = 1e-7
_FONT_POINTS = (9.5, 8.0, 6.5)


@dataclass(frozen=True, repr=False)
class SectionDrawing:
    """The drawing that `plot_section` made.

    Attributes
    ----------
    ax : Axes
        The axes of the drawing.
    domains : dict of node to shapely geometry
        Cross-section of each domain inside the window, in mm; nodes outside it are missing.
    solid : shapely geometry
        Cross-section of the part.
    surfaces : dict of str to LineCollection
        Boundaries between domains, by type ``"A"`` and ``"B"``; ``"A"`` where both lie on one plane.
    """

    ax: Axes
    domains: dict[Hashable, shapely.Geometry]
    solid: shapely.Geometry
    surfaces: dict[str, LineCollection]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<SectionDrawing: {len(self.domains)} domains in the window>"


def plot_section(
    eag: EntityAspectGraph,
    ax: Axes | None = None,
    *,
    axis: Literal["x", "y", "z"] = "z",
    at: float | None = None,
    box: ArrayLike | None = None,
) -> SectionDrawing:
    """Draw the viewing domains in a cross-section.

    Parameters
    ----------
    eag : EntityAspectGraph
        The graph whose domains are drawn.
    ax : Axes, optional
        Where to draw. Default: axes in a new pyplot figure.
    axis : str
        The coordinate that is constant in the section: ``"x"``, ``"y"`` or ``"z"``.
    at : float, optional
        Its value in mm; the section is taken just above it. Default: the middle of the part.
    box : array_like, shape (2, 3), optional
        Lowest and highest corner of the drawing, in mm. Default: the part with a margin as large as
        the part.

    Returns
    -------
    SectionDrawing
        The drawing, and its geometry in mm.

    Raises
    ------
    EntityError
        What is given is no `EntityAspectGraph`.
    ValueError
        The axis is not one of these.
    WorkspaceError
        The section misses the workspace.
    MissingExtraError
        matplotlib is not installed.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, plot_section
    >>> from matplotlib.figure import Figure
    >>> drawing = plot_section(build_aspect_graph(box, {"top": 1, "side": 2}), Figure().subplots())
    >>> drawing
    <SectionDrawing: 3 domains in the window>
    """
    check_eag(eag)
    if axis not in ("x", "y", "z"):
        raise ValueError(f"axis must be 'x', 'y' or 'z'. Got {axis!r}.")
    k = "xyz".index(axis)
    u, v = section_axes(k)
    corners = box_around(eag.solid, eag.workspace, box)
    at = float(eag.solid.bounds[:, k].mean()) if at is None else float(at)
    if not eag.workspace[0, k] <= at <= eag.workspace[1, k]:
        low, high = eag.workspace[:, k]
        raise WorkspaceError(f"at must be in the workspace, {low:g} to {high:g} mm. Got {at:g}.")
    window = corners[:, [u, v]]
    size = float(np.ptp(window, axis=0).max())
    domains = section_domains(eag, k, at, window)
    free = polygon_union(list(domains.values()), _NUDGE * size)
    solid = shapely.MultiPolygon(polygon_parts(shapely.box(*window.ravel()).difference(free)))
    ax = new_axes((8.5, 6.0)) if ax is None else ax
    _fill(eag, domains, solid, ax)
    surfaces = _draw_surfaces(eag, domains, k, at, window, ax)
    _draw_entities(eag, k, at, window, ax)
    ax.set(
        xlim=window[:, 0],
        ylim=window[:, 1],
        aspect="equal",
        xlabel=f"{'xyz'[u]} (mm)",
        ylabel=f"{'xyz'[v]} (mm)",
    )
    _label(eag, domains, window, ax)
    drawn = [lines for lines in surfaces.values() if lines.get_segments()]
    ax.legend(
        handles=drawn, loc="lower left", bbox_to_anchor=(0, 1), ncols=2, fontsize=8, frameon=False
    )
    return SectionDrawing(ax, domains, solid, surfaces)


def section_domains(
    eag: EntityAspectGraph, axis: int, at: float, window: np.ndarray
) -> dict[Hashable, Any]:
    """Return the cross-section of each domain that has one inside a window (2, 2), as shapely geometry by node."""
    size = float(np.ptp(window, axis=0).max())
    # a section through a wall between cells would show both of them
    above = at + _NUDGE * size
    domains = {}
    for node in eag.graph:
        pieces = section_polygons(eag.cells(node), axis, above, window)
        polygons = [shapely.Polygon(piece) for piece in pieces if len(piece) > 2]
        union = polygon_union(polygons, 0.1 * _NUDGE * size)
        if union.area > (1e-4 * size) ** 2:
            domains[node] = union
    return domains


def _fill(eag: EntityAspectGraph, domains: dict[Hashable, Any], solid: Any, ax: Axes) -> None:
    from matplotlib.patches import PathPatch

    colors = list_colors(eag.graph)
    for node, geometry in domains.items():
        ax.add_patch(PathPatch(_path(geometry), facecolor=colors[node], alpha=0.55, linewidth=0))
    if not solid.is_empty:
        ax.add_patch(
            PathPatch(_path(solid), facecolor="#8b949f", edgecolor=INK, linewidth=1.2, zorder=2)
        )


def _path(geometry: Any) -> Any:
    from matplotlib.path import Path

    polygons = [
        part for part in getattr(geometry, "geoms", [geometry]) if part.geom_type == "Polygon"
    ]
    rings = [
        ring
        for part in map(shapely.geometry.polygon.orient, polygons)
        for ring in (part.exterior, *part.interiors)
    ]
    return Path.make_compound_path(*(Path(np.asarray(ring.coords), closed=True) for ring in rings))


def _draw_surfaces(
    eag: EntityAspectGraph,
    domains: dict[Hashable, Any],
    axis: int,
    at: float,
    window: np.ndarray,
    ax: Axes,
) -> dict[str, Any]:
    from matplotlib.collections import LineCollection

    lines: dict[str, list[Any]] = {"A": [], "B": []}
    for i, j, surfaces in eag.graph.edges(data="surfaces"):
        if i in domains and j in domains:
            types: dict[tuple[Any, ...], str] = {}
            for surface in surfaces:
                types[surface.plane] = min(surface.type, types.get(surface.plane, "B"))
            for plane, kind in types.items():
                lines[kind] += _shared_lines(domains[i], domains[j], plane, axis, at, window)
    drawn = {}
    for kind, segments in lines.items():
        color, style, width = _TYPE_STYLE[kind]
        drawn[kind] = LineCollection(
            segments,
            colors=color,
            linestyles=[style],
            linewidths=width,
            label=f"partition surface, type {kind}",
            zorder=3,
        )
        ax.add_collection(drawn[kind])
    return drawn


def _shared_lines(
    section: Any, other: Any, plane: tuple[float, ...], axis: int, at: float, window: np.ndarray
) -> list[np.ndarray]:
    """Return the stretches of a plane's trace that run between two cross-sections."""
    u, v = section_axes(axis)
    normal = np.array([plane[u], plane[v]])
    offset = plane[3] - plane[axis] * at
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        return []
    size = float(np.ptp(window, axis=0).max())
    centre = window.mean(axis=0)
    foot = centre + (offset - normal @ centre) / length**2 * normal
    along = 2 * size * np.array([-normal[1], normal[0]]) / length
    near = 10 * _NUDGE * size
    shared = (
        shapely.LineString([foot - along, foot + along])
        .intersection(section.buffer(near))
        .intersection(other.buffer(near))
    )
    parts = getattr(shared, "geoms", [shared])
    return [
        np.asarray(part.coords)
        for part in parts
        if part.geom_type == "LineString" and part.length > 100 * near
    ]


def _draw_entities(
    eag: EntityAspectGraph, axis: int, at: float, window: np.ndarray, ax: Axes
) -> None:
    """Mark where entities pierce the section."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white")]
    u, v = section_axes(axis)
    for name, a, b in (
        (name, *ends) for name, e in eag.entities.items() for ends in pairwise(e.outline)
    ):
        if (a[axis] - at) * (b[axis] - at) > 0 or a[axis] == b[axis]:
            continue
        x, y = (a + (at - a[axis]) / (b[axis] - a[axis]) * (b - a))[[u, v]]
        if (window[0] <= (x, y)).all() and ((x, y) <= window[1]).all():
            ax.plot(x, y, "o", color="white", markeredgecolor=INK, markersize=7, zorder=4)
            style: dict[str, Any] = {
                "ha": "center",
                "va": "top",
                "weight": "bold",
                "color": INK,
                "path_effects": halo,
                "zorder": 5,
            }
            ax.annotate(name, (x, y), (0, -6), textcoords="offset points", fontsize=9, **style)


def _label(
    eag: EntityAspectGraph, domains: dict[Hashable, Any], window: np.ndarray, ax: Axes
) -> None:
    """Write each list into every piece of its domain that has room for it."""
    size = float(np.ptp(window, axis=0).max())
    extent = ax.get_window_extent()
    mm_per_point = (
        ax.figure.dpi / 72.0 / np.min([extent.width, extent.height] / np.ptp(window, axis=0))
    )
    for node, geometry in domains.items():
        text = list_text(eag.graph.nodes[node][eag.regions.listed_as], eag.entity_names, width=8)
        for part in geometry.geoms:
            x, y = shapely.maximum_inscribed_circle(part, tolerance=0.002 * size).coords[0]
            for points in _FONT_POINTS:
                half = 0.5 * points * mm_per_point * np.array(text_extent(text))
                if part.contains(shapely.box(x - half[0], y - half[1], x + half[0], y + half[1])):
                    style: dict[str, Any] = {
                        "ha": "center",
                        "va": "center",
                        "linespacing": 0.95,
                        "zorder": 4,
                        "color": INK,
                    }
                    ax.text(x, y, text, fontsize=points, **style)
                    break


_ENTITY = "#c0152f"
_VIEWS = [
    (x, y, z) for z in (0.7, -0.7) for x, y in ((0.9, -1.1), (0.9, 1.1), (-0.9, -1.1), (-0.9, 1.1))
]
_MOST_VISIBLE = 3
# air around the part, in its diagonals
_MARGIN = 0.4


def plot_solid(part: Any, entities: Mapping[str, Entity] | None = None) -> Figure:
    """Draw a part with its named entities. Pointing at one shows its length and ends.

    Parameters
    ----------
    part : Solid, EntityAspectGraph or VisibilityRegions
        The latter two bring their entities.
    entities : mapping of str to Entity, optional
        Default: those of `part`.

    Returns
    -------
    plotly.graph_objects.Figure
        The part and the entities.

    Raises
    ------
    SolidError
        `part` is none of these.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import plot_solid
    >>> type(plot_solid(box)).__name__
    'Figure'
    """
    solid = getattr(part, "solid", part)
    if not isinstance(solid, Solid):
        rule = "must be a Solid, an EntityAspectGraph or VisibilityRegions"
        hint = "read_solid reads a Solid from a file"
        raise SolidError.of_rule("part", rule, kind_text(part), hint=hint)
    if entities is None:
        entities = getattr(part, "entities", {})
    return _figure(
        [*part_traces(solid), *entity_traces(solid, entities)], solid, entities, legend=""
    )


def plot_domains(
    eag: EntityAspectGraph,
    nodes: Iterable[Hashable] | None = None,
    *,
    box: ArrayLike | None = None,
    opacity: float = 0.22,
) -> Figure:
    """Draw viewing domains around a part, clipped to a box.

    Each domain shows its surface, without the walls between its cells. It also shows one viewpoint
    with its sight lines to the ends of the observable entities. This is the graph's viewpoint if
    that is in the box, otherwise the deepest one in the box. A click on a name in the legend shows
    or hides a domain.

    Parameters
    ----------
    eag : EntityAspectGraph
        The graph whose domains are drawn.
    nodes : iterable of int, optional
        The domains. Default: all in the legend, those with the longest lists shown.
    box : array_like, shape (2, 3), optional
        Lowest and highest corner of the drawing, in mm. Default: the part with a margin around it.
    opacity : float
        Opacity of the domains, in (0, 1].

    Returns
    -------
    plotly.graph_objects.Figure
        The part, the entities and the domains.

    Raises
    ------
    EntityError
        What is given is no `EntityAspectGraph`.
    AspectGraphError
        A node is not in the graph.
    WorkspaceError
        The box does not overlap the workspace.
    ValueError
        The opacity is out of range.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, plot_domains
    >>> type(plot_domains(build_aspect_graph(box, {"top": 1, "side": 2}), [0])).__name__
    'Figure'
    """
    check_eag(eag)
    if not 0 < opacity <= 1:
        raise ValueError(f"opacity must be in (0, 1]. Got {opacity}.")
    chosen = list(eag.graph) if nodes is None else list(nodes)
    unknown = [node for node in chosen if node not in eag.graph]
    if unknown:
        raise AspectGraphError(
            f"nodes must be in the graph, 0 to {len(eag.graph) - 1}. Got {unknown[0]!r}."
        )
    corners = box_around(eag.solid, eag.workspace, box, margin=_MARGIN)
    colors = list_colors(eag.graph)
    traces = [*part_traces(eag.solid), *entity_traces(eag.solid, eag.entities)]
    for k, node in enumerate(chosen):
        shown = nodes is not None or k < _MOST_VISIBLE
        traces += _domain_traces(eag, node, corners, colors[node], opacity, shown)
    return _figure(traces, eag.solid, eag.entities, legend="viewing domains")


def entity_traces(solid: Solid, entities: Mapping[str, Entity]) -> list[Any]:
    """Return entities as plotly traces: a thick line each, and the names."""
    import plotly.graph_objects as go

    if not entities:
        return []
    points = [_polyline(entity) for entity in entities.values()]
    texts = [_entity_text(entity) for entity in entities.values()]
    hover = [
        text for text, row in zip(texts, points, strict=True) for text in [text] * (len(row) + 1)
    ]
    style: dict[str, Any] = {
        "color": _ENTITY,
        "width": 9,
        "name": "entities",
        "legendgroup": "entities",
    }
    lines = line_trace(points, hovertext=hover, hoverinfo="text", **style)
    away = 0.03 * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    outwards = [_normals(solid, entity).sum(axis=0) for entity in entities.values()]
    places = [
        row[len(row) // 2] + away * n / max(np.linalg.norm(n), 1e-9)
        for row, n in zip(points, outwards, strict=True)
    ]
    names = go.Scatter3d(
        **xyz(np.array(places)),
        mode="text",
        text=[f"<b>{name}</b>" for name in entities],
        textfont={"size": 15, "color": "#000000"},
        textposition="middle center",
        hoverinfo="skip",
        legendgroup="entities",
        showlegend=False,
        name="names",
    )
    return [lines, names]


def _polyline(entity: Entity) -> np.ndarray:
    """Return the line to draw: nine points of an edge, the chords of a rim or arc."""
    return (
        np.linspace(entity.endpoints[0], entity.endpoints[1], 9)
        if entity.kind == "edge"
        else entity.outline
    )


def _normals(solid: Solid, entity: Entity) -> np.ndarray:
    """Return the normals of the two faces at an entity (of a rim or arc, at its middle chord), shape (2, 3)."""
    edge_id = entity.edge_ids[0 if entity.kind == "edge" else len(entity.edge_ids) // 2]
    return solid.normals[list(solid.edges[edge_id].faces)]


def best_view(solid: Solid, entities: Mapping[str, Entity]) -> tuple[float, float, float]:
    """Return the standard direction of view that faces most entities: one face at a convex edge, both at another."""

    def n_facing(direction: tuple[float, float, float]) -> int:
        towards = [_normals(solid, entity) @ direction > 0 for entity in entities.values()]
        convex = [solid.edges[entity.edge_ids[0]].dihedral_deg > 0 for entity in entities.values()]
        return sum(any(t) if c else all(t) for t, c in zip(towards, convex, strict=True))

    return max(_VIEWS, key=n_facing)


def _entity_text(entity: Entity) -> str:
    if entity.circle is not None:
        circle = entity.circle
        size = (
            f"diameter {2 * circle.radius_mm:.6g}"
            if entity.kind == "rim"
            else f"radius {circle.radius_mm:.6g}"
        )
        return f"<b>{entity.name}</b><br>{size} mm<br>centre {point_text(circle.centre)} mm"
    ends = " to ".join(point_text(end) for end in entity.endpoints)
    return f"<b>{entity.name}</b><br>{np.linalg.norm(np.ptp(entity.endpoints, axis=0)):.6g} mm<br>{ends} mm"


def _domain_traces(
    eag: EntityAspectGraph, node: Any, box: np.ndarray, color: str, opacity: float, shown: bool
) -> list[Any]:
    listed = eag.graph.nodes[node][eag.regions.listed_as]
    cells = list(eag.cells(node))
    facets = domain_facets(cells, eag.solid, box)
    title = f"{node}: {list_text(listed, eag.entity_names, width=30, newline='<br>')}"
    together: dict[str, Any] = {
        "legendgroup": f"domain {node}",
        "visible": True if shown else "legendonly",
    }
    if not facets:
        title += " (not in this picture)"
    surface = surface_trace(facets, color=color, opacity=opacity, name=title, **together)
    rings = [ring for facet in facets for ring in facet.outlines]
    outline = line_trace(
        rings, color=color, width=2, name=title, hoverinfo="skip", showlegend=False, **together
    )
    if not facets:
        return [surface]
    return [surface, outline, *_viewpoint_traces(eag, node, cells, box, color, together)]


def _viewpoint_traces(
    eag: EntityAspectGraph,
    node: Any,
    cells: Any,
    box: np.ndarray,
    color: str,
    together: dict[str, Any],
) -> list[Any]:
    import plotly.graph_objects as go

    data = eag.graph.nodes[node]
    viewpoint = np.array(data["viewpoint"])
    if not ((viewpoint >= box[0]) & (viewpoint <= box[1])).all():
        viewpoint = _deepest(cells, box)
    listed_as = eag.regions.listed_as
    ends = [end for name in data[listed_as] for end in eag.entities[name].endpoints]
    text = (
        f"<b>domain {node}</b><br>{listed_as}: {', '.join(data[listed_as]) or 'nothing'}<br>"
        f"volume {data['volume']:.4g} mm³{', open to the workspace boundary' if data['unbounded'] else ''}<br>"
        f"graph's viewpoint {point_text(data['viewpoint'])} mm, clearance {data['clearance']:.4g} mm<br>"
        f"{data['n_cells']} convex cells, neighbours {', '.join(map(str, sorted(eag.graph[node])))}"
    )
    marker = go.Scatter3d(
        **xyz(viewpoint[None]),
        mode="markers+text",
        marker={"size": 6, "color": color, "line": {"color": INK, "width": 2}},
        text=[f"{node}"],
        textposition="top center",
        textfont={"size": 13, "color": INK},
        hovertext=[text],
        hoverinfo="text",
        name=f"viewpoint {node}",
        showlegend=False,
        **together,
    )
    sight = line_trace(
        [np.array([viewpoint, end]) for end in ends],
        color=color,
        width=1.5,
        name=f"sight lines {node}",
        hoverinfo="skip",
        showlegend=False,
        **together,
    )
    return [marker, sight]


def _deepest(cells: Any, box: np.ndarray) -> np.ndarray:
    """Return the centre of the largest ball in one of the cells and the box."""
    from scipy.optimize import linprog

    best = box.mean(axis=0)
    radius = -np.inf
    for cell in cells:
        rows = np.vstack([cell.half_spaces, box_half_spaces(box)])
        ball = linprog([0, 0, 0, -1], A_ub=np.column_stack([rows[:, :3], np.ones(len(rows))]), b_ub=-rows[:, 3],
                       bounds=[(None, None)] * 4)  # fmt: skip
        if ball.status == 0 and ball.x[3] > radius:
            best = ball.x[:3]
            radius = ball.x[3]
    return best


def _figure(traces: list[Any], solid: Solid, entities: Mapping[str, Entity], legend: str) -> Figure:
    figure = scene_figure(traces, best_view(solid, entities), title=solid.name)
    return figure.update_layout(legend={"title": {"text": legend}}, uirevision="domains")


# Picture of an aspect graph: viewing domains as circles, adjacencies as lines (matplotlib).


# Where to draw the nodes of an aspect graph.


# up to so many nodes there is time for more starts, and for distances between all pairs
_FEW = 30
_MANY = 250
_RANDOM_STARTS = 6

# in units of one line
_STEPS = 500
_STILL = 1e-4
_TOUCHING = 1e-9
_NEAR = 0.15


def layout(graph: nx.Graph) -> dict[Hashable, np.ndarray]:
    """Place nodes so that distances in the picture follow those in the graph, the longest lists on top.

    Stress majorization (Gansner, Koren and North 2004) from several starts; the result with the fewest lines that
    cross or run over other nodes is turned upright.

    Returns
    -------
    dict of node to ndarray, shape (2,)
    """
    candidates = list(_placements(graph))
    points = (
        candidates[0]
        if len(candidates) == 1
        else min(candidates, key=lambda p: crossings(graph, p) + hits(graph, p))
    )
    points = points - points.mean(axis=0)
    rank = np.array([_rank(data) for _, data in graph.nodes(data=True)], float)
    up = points.T @ (rank - rank.mean())
    length = np.linalg.norm(up)
    if length > 1e-9:
        up = up / length
        points = points @ np.array([[up[1], up[0]], [-up[0], up[1]]])
    return dict(zip(graph, points, strict=True))


def _placements(graph: nx.Graph) -> Iterator[np.ndarray]:
    if len(graph) > _MANY or not nx.is_connected(graph):
        yield _array(graph, nx.spring_layout(graph, seed=0))
        return
    lengths = dict(nx.all_pairs_shortest_path_length(graph))
    distances = np.array([[lengths[i][j] for j in graph] for i in graph], float)
    starts = [nx.circular_layout(graph)]
    if len(graph) > 2:
        starts.append(nx.spectral_layout(graph))
    if nx.check_planarity(graph)[0]:
        starts.append(nx.planar_layout(graph))
    if len(graph) <= _FEW:
        starts += [nx.random_layout(graph, seed=seed) for seed in range(_RANDOM_STARTS)]
    for start in starts:
        yield least_stress(distances, _array(graph, start))


def _array(graph: nx.Graph, places: dict[str, Any]) -> np.ndarray:
    return np.array([places[node] for node in graph], float).reshape(-1, 2)


def least_stress(distances: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move points in the plane until their distances are as close as they get to those wanted.

    Parameters
    ----------
    distances : ndarray, shape (n, n)
        Wanted; the square of an error counts by the inverse square of the distance.
    points : ndarray, shape (n, 2)
        To start from.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    n = len(points)
    apart = distances > 0
    weights = np.where(apart, 1.0 / np.where(apart, distances, 1.0) ** 2, 0.0)
    # V X' = B(X) X, V singular only for a common shift
    inverse = np.linalg.inv(np.diag(weights.sum(axis=1)) - weights + 1.0 / n)
    for _ in range(_STEPS):
        now = np.linalg.norm(points[:, None] - points[None], axis=2)
        pull = np.where(
            apart & (now > _TOUCHING),
            weights * distances / np.where(now > _TOUCHING, now, 1.0),
            0.0,
        )
        moved = inverse @ (pull.sum(axis=1)[:, None] * points - pull @ points)
        if np.abs(moved - points).max() < _STILL:
            return moved
        points = moved
    return points


def crossings(graph: nx.Graph, points: np.ndarray) -> int:
    """Count the pairs of lines that cross when the nodes lie at (n, 2) points."""
    place = {node: k for k, node in enumerate(graph)}
    pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
    start = points[pairs[:, 0]]
    end = points[pairs[:, 1]]

    def side(q: np.ndarray) -> np.ndarray:
        d = (end - start)[:, None]
        r = q[None] - start[:, None]
        return d[..., 0] * r[..., 1] - d[..., 1] * r[..., 0]

    apart = side(start) * side(end) < 0
    shared = (pairs[:, None, :, None] == pairs[None, :, None, :]).any(axis=(2, 3))
    return int((apart & apart.T & ~shared).sum() // 2)


def hits(graph: nx.Graph, points: np.ndarray) -> int:
    """Count the pairs of a line and a node, not one of its ends, that it runs over or close by."""
    place = {node: k for k, node in enumerate(graph)}
    pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
    start = points[pairs[:, :1]]
    along = points[pairs[:, 1:]] - points[pairs[:, :1]]
    length2 = np.maximum((along**2).sum(axis=2), _TOUCHING)
    share = np.clip(((points[None] - start) * along).sum(axis=2) / length2, 0.0, 1.0)
    distance = np.linalg.norm(points[None] - start - share[..., None] * along, axis=2)
    ends = (pairs[:, :, None] == np.arange(len(points))).any(axis=1)
    return int(((distance < _NEAR) & ~ends).sum())


def _rank(data: dict[str, Any]) -> int:
    listed = listed_on(data)
    return data.get("n_visible", 0) if listed is None else len(listed)


_NODE_POINTS2 = (70.0, 900.0)
_EDGE_POINTS = (0.8, 5.0)
_EDGE_COLOR = "#9aa4b0"
_DASHES = (0, (1.6, 1.0))
_DOTS = (0, (2.2, 1.4))
_GRAPH_PLOT_MANY = 30


@dataclass(frozen=True, repr=False)
class GraphDrawing:
    """The drawing that `plot_graph` made.

    Attributes
    ----------
    ax : Axes
        The axes of the drawing.
    nodes : PathCollection
        Circles, in node order.
    edges : LineCollection
        Lines, in edge order.
    labels : dict of node to Text
        Texts next to the circles. A node without text is missing.
    positions : dict of node to ndarray, shape (2,)
        Position of each node in data coordinates.
    """

    ax: Axes
    nodes: PathCollection
    edges: LineCollection
    labels: dict[Hashable, Text]
    positions: dict[Hashable, np.ndarray]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return (
            f"<GraphDrawing: {len(self.positions)} nodes, {len(self.edges.get_segments())} edges>"
        )


def plot_graph(
    eag: EntityAspectGraph | nx.Graph,
    ax: Axes | None = None,
    *,
    labels: Mapping[Hashable, str] | None = None,
    colors: Mapping[Hashable, str] | None = None,
    legend: bool = True,
) -> GraphDrawing:
    """Draw an aspect graph.

    A circle grows with the logarithm of its domain's volume. Its outline is dashed if the domain
    reaches the boundary of the workspace. A line grows with the logarithm of the shared area. It is
    dashed if all surfaces there are of type B. Domains with the longest lists are at the top.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        The latter from `read_graphml` or `complete_aspect_graph`.
    ax : Axes, optional
        Where to draw. Default: axes in a new pyplot figure.
    labels : mapping of node to str, optional
        Default: the observable lists.
    colors : mapping of node to str, optional
        Default: one colour per list, the same as in `plot_section` and `plot_domains`.
    legend : bool
        Whether to explain the outlines and lines.

    Returns
    -------
    GraphDrawing
        The drawing, so that you can change colours or texts.

    Raises
    ------
    ValueError
        The graph has no nodes, or is not one of those above.
    MissingExtraError
        matplotlib is not installed.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, plot_graph
    >>> from matplotlib.figure import Figure
    >>> drawing = plot_graph(build_aspect_graph(box, {"top": 1, "side": 2}), Figure().subplots())
    >>> drawing
    <GraphDrawing: 4 nodes, 5 edges>
    """
    graph = _checked(eag)
    if ax is None:
        side = float(np.clip(1.7 * np.sqrt(len(graph)), 5.0, 14.0))
        ax = new_axes((1.2 * side, side))
    labels = _lists(graph) if labels is None else labels
    positions = layout(graph)
    _prepare(ax, positions)
    edges = _draw_edges(graph, positions, ax)
    nodes = _draw_nodes(graph, positions, list_colors(graph) if colors is None else colors, ax)
    texts = _draw_labels(graph, positions, labels, nodes, ax)
    if legend:
        _draw_legend(graph, ax)
    return GraphDrawing(ax, nodes, edges, texts, positions)


def _checked(eag: EntityAspectGraph | nx.Graph) -> nx.Graph:
    graph = plain_graph(eag)
    if not len(graph):
        raise ValueError("eag must have at least one node. Got a graph without nodes.")
    missing = [node for node, data in graph.nodes(data=True) if "volume" not in data]
    missing += [edge for *edge, data in graph.edges(data=True) if "area" not in data]
    if missing:
        raise ValueError(
            f"every node must have a volume and every edge an area. Got {missing[0]} without."
        )
    return graph


def _lists(graph: nx.Graph) -> dict[Hashable, str]:
    lists = {node: listed_on(data) for node, data in graph.nodes(data=True)}
    names = graph.graph.get("entities", ())
    return {
        node: "" if None in lists.values() else list_text(listed or (), names)
        for node, listed in lists.items()
    }


def _prepare(ax: Axes, positions: Mapping[Hashable, Any]) -> None:
    points = np.array(list(positions.values()))
    ax.set_axis_off()
    ax.set_aspect("equal", adjustable="datalim")
    low = points.min(axis=0)
    high = points.max(axis=0)
    room = 0.05 * max(float((high - low).max()), 1e-3)
    ax.update_datalim([low - room, high + room])
    ax.margins(0)
    ax.autoscale_view()


def _scaled(values: ArrayLike, smallest: float, largest: float) -> np.ndarray:
    """Map positive values to a range by their logarithm."""
    logs = np.log(np.maximum(np.asarray(values, float), np.finfo(float).tiny))
    if not len(logs) or np.ptp(logs) < 1e-9:
        return np.full(len(logs), 0.5 * (smallest + largest))
    return smallest + (largest - smallest) * (logs - logs.min()) / np.ptp(logs)


def _shrink(graph: nx.Graph) -> float:
    """Return the share of their full area that circles have in a graph of this size."""
    return 1.0 if len(graph) <= _GRAPH_PLOT_MANY else 0.6 * _GRAPH_PLOT_MANY / len(graph)


def _only_type_b(data: dict[str, Any]) -> bool:
    surfaces = data.get("surfaces", ())
    return bool(surfaces) and all(surface.type == "B" for surface in surfaces)


def _draw_edges(graph: nx.Graph, positions: Mapping[Hashable, Any], ax: Axes) -> LineCollection:
    from matplotlib.collections import LineCollection

    rows = list(graph.edges(data=True))
    lines = LineCollection(
        [(positions[i], positions[j]) for i, j, _ in rows],
        linewidths=_shrink(graph) ** 0.5
        * _scaled([data["area"] for *_, data in rows], *_EDGE_POINTS),
        linestyles=[_DASHES if _only_type_b(data) else "solid" for *_, data in rows],
        colors=_EDGE_COLOR,
        zorder=1,
    )
    ax.add_collection(lines)
    return lines


def _draw_nodes(
    graph: nx.Graph, positions: Mapping[Hashable, Any], colors: Any, ax: Axes
) -> PathCollection:
    points = np.array([positions[node] for node in graph])
    open_domain = [data.get("unbounded", False) for _, data in graph.nodes(data=True)]
    return ax.scatter(
        points[:, 0],
        points[:, 1],
        s=_shrink(graph)
        * _scaled([volume for _, volume in graph.nodes(data="volume")], *_NODE_POINTS2),
        c=[colors[node] for node in graph],
        edgecolors=INK,
        linewidths=1.3 if len(graph) <= _GRAPH_PLOT_MANY else 0.8,
        linestyles=[_DOTS if is_open else "solid" for is_open in open_domain],
        zorder=2,
    )


def _draw_labels(
    graph: nx.Graph,
    positions: Mapping[Hashable, Any],
    labels: Mapping[Hashable, str],
    nodes: PathCollection,
    ax: Axes,
) -> dict[Hashable, Text]:
    """Write each label below, above or beside its node, wherever it covers least."""
    from matplotlib.patheffects import withStroke

    size = 10.0 if len(graph) <= _GRAPH_PLOT_MANY else 6.5
    radius = np.sqrt(nodes.get_sizes()) / 2.0
    texts: dict[Hashable, Text] = {}
    halo = [withStroke(linewidth=2.5, foreground="white")]
    spots = _Spots(graph, positions, radius, ax)
    for k, node in enumerate(graph):
        text = labels.get(node, "")
        if text:
            offset, horizontal, vertical = spots.best(k, text, size)
            texts[node] = ax.annotate(
                text,
                positions[node],
                offset,
                textcoords="offset points",
                ha=horizontal,
                va=vertical,
                fontsize=size,
                color=INK,
                linespacing=0.95,
                path_effects=halo,
                zorder=3,
            )
    return texts


class _Spots:
    """Finds room for labels; all in points (1/72 inch)."""

    def __init__(
        self, graph: nx.Graph, positions: Mapping[Hashable, Any], radius: np.ndarray, ax: Axes
    ) -> None:
        scale = 72.0 / ax.figure.dpi
        self._centres = (
            ax.transData.transform(np.array([positions[node] for node in graph])) * scale
        )
        self._radius = radius
        place = {node: k for k, node in enumerate(graph)}
        pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
        share = np.linspace(0.0, 1.0, 41)[:, None, None]
        ends = self._centres[pairs]
        self._on_lines = ((1 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 2)
        self._taken: list[np.ndarray] = []

    def best(self, k: int, text: str, size: float) -> Any:
        """Offset and alignments of the label of node k."""
        half = 0.5 * size * np.array(text_extent(text))
        gap = self._radius[k] + 2.0
        choices = [
            ((0, -gap), "center", "top"),
            ((0, gap), "center", "bottom"),
            ((gap, 0), "left", "center"),
            ((-gap, 0), "right", "center"),
        ]
        boxes = [
            self._centres[k] + np.array(offset) + np.sign(offset) * half for offset, *_ in choices
        ]
        costs = [self._cost(centre, half, k) for centre in boxes]
        chosen = int(np.argmin(costs))
        self._taken.append(np.array([boxes[chosen], half]))
        return choices[chosen]

    def _cost(self, centre: np.ndarray, half: np.ndarray, k: int) -> float:
        lines = (np.abs(self._on_lines - centre) < half).all(axis=1).sum()
        away = np.abs(self._centres - centre) - half - self._radius[:, None]
        circles = (away < 0).all(axis=1).sum() - (away[k] < 0).all()
        labels = sum((np.abs(other - centre) < half + room).all() for other, room in self._taken)
        return float(lines + 20 * circles + 40 * labels)


def _draw_legend(graph: nx.Graph, ax: Axes) -> None:
    from matplotlib.lines import Line2D

    def circle(style: Any, label: str) -> Artist:
        return ax.scatter(
            [], [], s=90, c="white", edgecolors=INK, linewidths=1.3, linestyles=[style], label=label
        )

    reach = {
        bool(data.get("unbounded")) for _, data in graph.nodes(data=True) if "unbounded" in data
    }
    handles = [circle(_DOTS, "open to the workspace's boundary")] if True in reach else []
    handles += [circle("solid", "bounded domain")] if False in reach else []
    types = {_only_type_b(data) for *_, data in graph.edges(data=True) if "surfaces" in data}
    line: dict[str, Any] = {"color": _EDGE_COLOR, "linewidth": 2.5}
    handles += (
        [Line2D([], [], **line, label="boundary with a type A surface")] if False in types else []
    )
    handles += (
        [Line2D([], [], **line, linestyle=_DASHES, label="type B surfaces only")]
        if True in types
        else []
    )
    if handles:
        ax.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(0, 0),
            ncols=2,
            fontsize=8,
            frameon=False,
        )
