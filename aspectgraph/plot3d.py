"""Interactive 3-D pictures: a part with its entities, and viewing domains around it (plotly)."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from .clip import box_around, box_half_spaces, domain_facets
from .exceptions import AspectGraphError
from .plot_style import INK, list_colors, list_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from .entities import Entity
    from .graph import EntityAspectGraph
    from .solid import Solid

_ENTITY = "#c0152f"
_LIGHT = np.array([0.35, -0.5, 0.8])
_VIEWS = [(x, y, z) for z in (0.7, -0.7) for x, y in ((0.9, -1.1), (0.9, 1.1), (-0.9, -1.1), (-0.9, 1.1))]
_MOST_VISIBLE = 3
# air around the part, in its diagonals
_MARGIN = 0.4
_FEATURE_DEG, _CURVED_FEATURE_DEG = 15.0, 40.0


def plot_solid(part, entities: Mapping[str, Entity] | None = None) -> Figure:
    """Draw a part with its named entities; pointing at one shows its length and ends.

    Parameters
    ----------
    part : Solid, EntityAspectGraph or VisibilityRegions
        The latter two bring their entities.
    entities : mapping of str to Entity, optional
        Default: those of `part`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    solid = getattr(part, "solid", part)
    if entities is None:
        entities = getattr(part, "entities", {})
    return _figure([*part_traces(solid), *entity_traces(solid, entities)], solid, entities)


def plot_domains(
    eag: EntityAspectGraph, nodes: Iterable[Hashable] | None = None, *, box=None, opacity: float = 0.22
) -> Figure:
    """Draw viewing domains around a part, cut down to a box.

    Each domain shows its surface, without the walls between its cells, and one viewpoint with its sight lines to the
    ends of what it observes: the graph's viewpoint where that is in the box, else the deepest one in the box. A click
    on a name in the legend shows or hides a domain.

    Parameters
    ----------
    eag : EntityAspectGraph
    nodes : iterable of int, optional
        The domains. Default: all in the legend, those with the longest lists shown.
    box : array_like, shape (2, 3), optional
        Lowest and highest corner of what is shown, in mm. Default: the part with some air around it.
    opacity : float
        Of the domains, in (0, 1].

    Returns
    -------
    plotly.graph_objects.Figure

    Raises
    ------
    AspectGraphError
        A node is not in the graph.
    WorkspaceError
        The box does not overlap the workspace.
    ValueError
        The opacity is out of range.
    """
    if not 0 < opacity <= 1:
        raise ValueError(f"opacity must be in (0, 1]. Got {opacity}.")
    chosen = list(eag.graph) if nodes is None else list(nodes)
    unknown = [node for node in chosen if node not in eag.graph]
    if unknown:
        raise AspectGraphError(f"nodes must be in the graph, 0 to {len(eag.graph) - 1}. Got {unknown[0]!r}.")
    corners = box_around(eag.solid, eag.workspace, box, margin=_MARGIN)
    colors = list_colors(eag.graph)
    traces = [*part_traces(eag.solid), *entity_traces(eag.solid, eag.entities)]
    for k, node in enumerate(chosen):
        shown = nodes is not None or k < _MOST_VISIBLE
        traces += _domain_traces(eag, node, corners, colors[node], opacity, shown)
    return _figure(traces, eag.solid, eag.entities)


def part_traces(solid: Solid) -> list:
    """Return the faces and the sharp edges of a part as plotly traces."""
    import plotly.graph_objects as go

    # shaded here: what plotly makes of its light depends on the size of the part
    shades = 0.80 + 0.20 * solid.normals[np.asarray(solid.triangle_face)] @ (_LIGHT / np.linalg.norm(_LIGHT))
    faces = go.Mesh3d(
        **_xyz(solid.vertices),
        **dict(zip("ijk", np.asarray(solid.triangles).T, strict=True)),
        facecolor=[f"rgb({200 * s:.0f},{208 * s:.0f},{218 * s:.0f})" for s in shades],
        flatshading=True,
        lighting={"ambient": 1.0, "diffuse": 0.0, "specular": 0.0},
        hoverinfo="skip",
        name="part",
        showlegend=True,
    )
    sharp = [solid.edge_points(edge.id) for edge in solid.edges if _is_feature(solid, edge)]
    return [faces, _lines(sharp, color=INK, width=2.5, name="edges", hoverinfo="skip", showlegend=False)]


def entity_traces(solid: Solid, entities: Mapping[str, Entity]) -> list:
    """Return entities as plotly traces: a thick line each, and the names."""
    import plotly.graph_objects as go

    if not entities:
        return []
    points = [np.linspace(*entity.endpoints, 9) for entity in entities.values()]
    hover = [text for entity in entities.values() for text in [_entity_text(entity)] * 10]
    style = {"color": _ENTITY, "width": 9, "name": "entities", "legendgroup": "entities"}
    lines = _lines(points, hovertext=hover, hoverinfo="text", **style)
    away = 0.03 * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    outwards = [_normals(solid, entity).sum(axis=0) for entity in entities.values()]
    places = [row[4] + away * n / max(np.linalg.norm(n), 1e-9) for row, n in zip(points, outwards, strict=True)]
    names = go.Scatter3d(
        **_xyz(np.array(places)),
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


def _normals(solid: Solid, entity: Entity) -> np.ndarray:
    """Return the normals of the two faces at an entity, shape (2, 3)."""
    return solid.normals[list(solid.edges[entity.edge_ids[0]].faces)]


def best_view(solid: Solid, entities: Mapping[str, Entity]) -> tuple[float, float, float]:
    """Return the standard direction of view that faces most entities: one face at a convex edge, both at another."""

    def n_facing(direction) -> int:
        towards = [_normals(solid, entity) @ direction > 0 for entity in entities.values()]
        convex = [solid.edges[entity.edge_ids[0]].dihedral_deg > 0 for entity in entities.values()]
        return sum(any(t) if c else all(t) for t, c in zip(towards, convex, strict=True))

    return max(_VIEWS, key=n_facing)


def _entity_text(entity: Entity) -> str:
    ends = " to ".join(_point(end) for end in entity.endpoints)
    return f"<b>{entity.name}</b><br>{np.linalg.norm(np.ptp(entity.endpoints, axis=0)):.6g} mm<br>{ends} mm"


def _domain_traces(eag: EntityAspectGraph, node, box: np.ndarray, color: str, opacity: float, shown: bool) -> list:
    import plotly.graph_objects as go

    data = eag.graph.nodes[node]
    cells = list(eag.cells(node))
    facets = domain_facets(cells, eag.solid, box)
    title = f"{node}: {list_text(data['observable'], eag.entity_names, width=30, newline='<br>')}"
    together = {"legendgroup": f"domain {node}", "visible": True if shown else "legendonly"}
    if not facets:
        title += " (not in this picture)"
    triangles = np.concatenate([facet.triangles for facet in facets] or [np.zeros((0, 3, 3))])
    corners, index = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    surface = go.Mesh3d(
        **_xyz(corners),
        **dict(zip("ijk", index.reshape(-1, 3).T, strict=True)),
        color=color,
        opacity=opacity,
        flatshading=True,
        lighting={"ambient": 0.9, "diffuse": 0.2, "specular": 0.0},
        hoverinfo="skip",
        name=title,
        showlegend=True,
        **together,
    )
    rings = [ring for facet in facets for ring in facet.outlines]
    outline = _lines(rings, color=color, width=2, name=title, hoverinfo="skip", showlegend=False, **together)
    if not facets:
        return [surface]
    return [surface, outline, *_viewpoint_traces(eag, node, cells, box, color, together)]


def _viewpoint_traces(eag: EntityAspectGraph, node, cells, box: np.ndarray, color: str, together: dict) -> list:
    import plotly.graph_objects as go

    data = eag.graph.nodes[node]
    viewpoint = np.array(data["viewpoint"])
    if not ((viewpoint >= box[0]) & (viewpoint <= box[1])).all():
        viewpoint = _deepest(cells, box)
    ends = [end for name in data["observable"] for end in eag.entities[name].endpoints]
    text = (
        f"<b>domain {node}</b><br>observable: {', '.join(data['observable']) or 'nothing'}<br>"
        f"volume {data['volume']:.4g} mm³{', open to the workspace boundary' if data['unbounded'] else ''}<br>"
        f"graph's viewpoint {_point(data['viewpoint'])} mm, clearance {data['clearance']:.4g} mm<br>"
        f"{data['n_cells']} convex cells, neighbours {', '.join(map(str, sorted(eag.graph[node])))}"
    )
    marker = go.Scatter3d(
        **_xyz(viewpoint[None]),
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
    sight = _lines(
        [np.array([viewpoint, end]) for end in ends],
        color=color,
        width=1.5,
        name=f"sight lines {node}",
        hoverinfo="skip",
        showlegend=False,
        **together,
    )
    return [marker, sight]


def _deepest(cells, box: np.ndarray) -> np.ndarray:
    """Return the centre of the largest ball in one of the cells and the box."""
    from scipy.optimize import linprog

    best, radius = box.mean(axis=0), -np.inf
    for cell in cells:
        rows = np.vstack([cell.half_spaces, box_half_spaces(box)])
        ball = linprog([0, 0, 0, -1], A_ub=np.column_stack([rows[:, :3], np.ones(len(rows))]), b_ub=-rows[:, 3],
                       bounds=[(None, None)] * 4)  # fmt: skip
        if ball.status == 0 and ball.x[3] > radius:
            best, radius = ball.x[:3], ball.x[3]
    return best


def _is_feature(solid: Solid, edge) -> bool:
    inside_curve = all(solid.faces[face].curved for face in edge.faces)
    return abs(edge.dihedral_deg) >= (_CURVED_FEATURE_DEG if inside_curve else _FEATURE_DEG)


def _lines(segments, *, color: str, width: float, name: str, **options):
    import plotly.graph_objects as go

    # a row of nan between two stretches lifts the pen
    rows = [row for segment in segments for row in (*np.asarray(segment), (np.nan,) * 3)]
    line = {"color": color, "width": width}
    return go.Scatter3d(**_xyz(np.array(rows).reshape(-1, 3)), mode="lines", line=line, name=name, **options)


def _xyz(points: np.ndarray) -> dict:
    return dict(zip("xyz", np.asarray(points, float).reshape(-1, 3).T, strict=True))


def _point(point) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"


def _figure(traces: list, solid: Solid, entities: Mapping[str, Entity]):
    import plotly.graph_objects as go

    axis = {"backgroundcolor": "#ffffff", "gridcolor": "#e6e9ee", "zeroline": False, "color": "#6b7480"}
    scene = {f"{name}axis": {**axis, "title": {"text": f"{name} (mm)"}} for name in "xyz"}
    eye = dict(zip("xyz", best_view(solid, entities), strict=True))
    figure = go.Figure(traces)
    figure.update_layout(
        title={"text": solid.name, "x": 0.02, "font": {"size": 16}},
        scene={
            **scene,
            "aspectmode": "data",
            "camera": {"eye": eye, "projection": {"type": "orthographic"}},
        },
        legend={"groupclick": "togglegroup", "itemsizing": "constant", "title": {"text": "viewing domains"}},
        margin={"l": 0, "r": 0, "t": 40, "b": 0},
        paper_bgcolor="#ffffff",
        font={"family": "Helvetica Neue, Helvetica, Arial, sans-serif", "color": INK},
        uirevision="domains",
    )
    return figure
