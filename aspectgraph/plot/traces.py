"""What interactive 3-D pictures are made of (plotly): the part, polylines, surfaces, and the scene around them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph.plot.style import INK, is_feature

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Mesh3d, Scatter3d

    from aspectgraph.plot.clip import Facet
    from aspectgraph.solid.rims import Arc
    from aspectgraph.solid.solid import Solid

_PARTS_OF_CIRCLE = 96
_LIGHT = np.array([0.35, -0.5, 0.8])


def part_traces(solid: Solid) -> list[Any]:
    """Return the faces and the sharp edges of a part."""
    import plotly.graph_objects as go

    # shaded here: what plotly makes of its light depends on the size of the part
    shades = 0.80 + 0.20 * solid.normals[np.asarray(solid.triangle_face)] @ (
        _LIGHT / np.linalg.norm(_LIGHT)
    )
    faces = go.Mesh3d(
        **xyz(solid.vertices),
        **dict(zip("ijk", np.asarray(solid.triangles).T, strict=True)),
        facecolor=[f"rgb({200 * s:.0f},{208 * s:.0f},{218 * s:.0f})" for s in shades],
        flatshading=True,
        lighting={"ambient": 1.0, "diffuse": 0.0, "specular": 0.0},
        hoverinfo="skip",
        name="part",
        showlegend=True,
    )
    return [
        faces,
        line_trace(
            _sharp_lines(solid),
            color=INK,
            width=2.5,
            name="edges",
            hoverinfo="skip",
            showlegend=False,
        ),
    ]


def _sharp_lines(solid: Solid) -> list[np.ndarray]:
    """Return the sharp edges as polylines: circles and arcs as such, not as their chords."""
    sharp = {edge.id: edge for edge in solid.edges if is_feature(solid, edge)}
    lines = []
    for curve in (*solid.rims(), *solid.arcs()):
        # chords that are no features are not drawn, and then the curve is none either
        if all(edge in sharp for edge in curve.edge_ids):
            lines.append(_curve_line(curve))
            for edge in curve.edge_ids:
                del sharp[edge]
    return [*lines, *(solid.edge_points(edge) for edge in sharp)]


def _curve_line(curve: Arc) -> np.ndarray:
    """Return points (n, 3) along a rim or arc, mm."""
    span = curve.end_rad - curve.start_rad
    n = max(len(curve.edge_ids), round(_PARTS_OF_CIRCLE * span / (2 * np.pi)))
    angles = np.linspace(curve.start_rad, curve.end_rad, n + 1)[:, None]
    u = curve.reference
    v = np.cross(curve.axis, u)
    return np.asarray(curve.centre + curve.radius_mm * (np.cos(angles) * u + np.sin(angles) * v))


def line_trace(
    polylines: Iterable[np.ndarray],
    *,
    color: str,
    width: float,
    name: str,
    dash: str = "solid",
    **options: Any,
) -> Scatter3d:
    """Return polylines, shape (n, 3) each, as one trace; each takes n + 1 of its points."""
    import plotly.graph_objects as go

    # a row of nan between two polylines lifts the pen
    rows = [row for points in polylines for row in (*np.asarray(points), (np.nan,) * 3)]
    line = {"color": color, "width": width, "dash": dash}
    return go.Scatter3d(**xyz(rows), mode="lines", line=line, name=name, **options)


def surface_trace(
    facets: Sequence[Facet], *, color: str, opacity: float, name: str, **options: Any
) -> Mesh3d:
    """Return a domain's surface as one translucent mesh."""
    import plotly.graph_objects as go

    triangles = np.concatenate([facet.triangles for facet in facets] or [np.zeros((0, 3, 3))])
    corners, index = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    return go.Mesh3d(
        **xyz(corners),
        **dict(zip("ijk", index.reshape(-1, 3).T, strict=True)),
        color=color,
        opacity=opacity,
        flatshading=True,
        lighting={"ambient": 0.9, "diffuse": 0.2, "specular": 0.0},
        hoverinfo="skip",
        name=name,
        showlegend=True,
        **options,
    )


def scene_figure(traces: list[Any], eye: Sequence[float], title: str = "") -> Figure:
    """Return traces in a scene with axes in mm.

    Parameters
    ----------
    traces : list
    eye : sequence of float, length 3
        Direction towards the viewer.
    title : str
        Above the scene; none takes no room.
    """
    import plotly.graph_objects as go

    axis = {
        "backgroundcolor": "#ffffff",
        "gridcolor": "#e6e9ee",
        "zeroline": False,
        "color": "#6b7480",
    }
    scene = {f"{name}axis": {**axis, "title": {"text": f"{name} (mm)"}} for name in "xyz"}
    figure = go.Figure(traces)
    figure.update_layout(
        title={"text": title, "x": 0.02, "font": {"size": 16}},
        scene={
            **scene,
            "aspectmode": "data",
            "camera": {
                "eye": dict(zip("xyz", eye, strict=True)),
                "projection": {"type": "orthographic"},
            },
        },
        legend={"groupclick": "togglegroup", "itemsizing": "constant"},
        margin={"l": 0, "r": 0, "t": 40 if title else 0, "b": 0},
        paper_bgcolor="#ffffff",
        font={"family": "Helvetica Neue, Helvetica, Arial, sans-serif", "color": INK},
    )
    return figure


def xyz(points: Any) -> dict[str, Any]:
    """Return points, shape (n, 3), as plotly's three coordinates."""
    return dict(zip("xyz", np.asarray(points, float).reshape(-1, 3).T, strict=True))


def point_text(point: Any) -> str:
    """Return a point as ``(x, y, z)``, four digits each."""
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"
