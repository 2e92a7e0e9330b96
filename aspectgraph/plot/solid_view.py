"""Interactive 3-D pictures: a part with its entities, and viewing domains around it (plotly)."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.exceptions import AspectGraphError
from aspectgraph.plot.clip import box_around, box_half_spaces, domain_facets
from aspectgraph.plot.style import INK, list_colors, list_text
from aspectgraph.plot.traces import (
    line_trace,
    part_traces,
    point_text,
    scene_figure,
    surface_trace,
    xyz,
)

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from aspectgraph.entities.straight_edges import Entity
    from aspectgraph.graph.aspect_graph import EntityAspectGraph
    from aspectgraph.solid.solid import Solid

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
