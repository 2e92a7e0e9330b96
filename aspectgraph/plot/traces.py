"""What interactive 3-D pictures are made of (plotly): the part, polylines, surfaces, and the scene around them."""

from __future__ import annotations

import colorsys
import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import networkx as nx
import numpy as np

from aspectgraph.exceptions import MissingExtraError, how_to_install
from aspectgraph.solid.rims import CURVED_FEATURE_DEG, FEATURE_DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from plotly.graph_objects import Figure, Mesh3d, Scatter3d

    from aspectgraph.plot.clip import Facet
    from aspectgraph.solid.rims import Arc
    from aspectgraph.solid.solid import Solid
    from aspectgraph.solid.topology import Edge


# What the pictures of an aspect graph share: colours, short names of lists, the way to
# matplotlib.


# told apart with any colour vision in this order, after Okabe and Ito (2008) and Tol (2021)
_PALETTE = (
    "#4477aa", "#ee9944", "#44aa77", "#cc6688", "#ddcc55", "#66bbdd",
    "#884466", "#88bb55", "#5555aa", "#bb5533", "#339999", "#aa77cc",
)  # fmt: skip
NOTHING = "#dfe3e8"
INK = "#2b3138"

# the golden angle, as a share of the circle: hues that follow each other are far apart
_NEXT_HUE = 0.381966
_RUN = 3


def is_feature(solid: Solid, edge: Edge) -> bool:
    """Whether an edge is drawn: it turns enough, and more than facets of one curved face do."""
    inside_curve = all(solid.faces[face].curved for face in edge.faces)
    return abs(edge.dihedral_deg) >= (CURVED_FEATURE_DEG if inside_curve else FEATURE_DEG)


def listed_on(data: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Return the list of a node by its attributes: what is observable, of lamps what shows, or None."""
    return data.get("observable", data.get("showing"))


def list_colors(graph: nx.Graph) -> dict[Hashable, str]:
    """Return the colour of each viewing domain; those with the same observable list have the same.

    Parameters
    ----------
    graph : networkx.Graph
        As of `EntityAspectGraph.graph` or `read_graphml`.

    Returns
    -------
    dict of node to str
        ``#rrggbb``; a pale grey where nothing is observable.
    """
    lists = [frozenset(listed_on(data) or ()) for _, data in graph.nodes(data=True)]
    distinct = [listed for listed in dict.fromkeys(lists) if listed]
    colors = {listed: _color(k) for k, listed in enumerate(distinct)}
    return {node: colors.get(listed, NOTHING) for node, listed in zip(graph, lists, strict=True)}


def _color(k: int) -> str:
    if k < len(_PALETTE):
        return _PALETTE[k]
    rgb = colorsys.hls_to_rgb(k * _NEXT_HUE % 1.0, (0.45, 0.65, 0.55)[k % 3], 0.5)
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)


def list_text(
    listed: Sequence[str], names: Sequence[str], width: int = 12, newline: str = "\n"
) -> str:
    """Return an observable list as a label, three or more names numbered in turn shortened: ``e1–e4 e6``.

    Parameters
    ----------
    listed : sequence of str
        The list.
    names : sequence of str
        All entities, in the order to name them.
    width : int
        A line is broken before the word that makes it longer.
    newline : str
        Between lines.
    """
    if not listed:
        return "none"
    runs: list[list[str]] = []
    for name in sorted(listed, key=list(names).index):
        if runs and _follows(runs[-1][-1], name):
            runs[-1].append(name)
        else:
            runs.append([name])
    lines = [""]
    for word in (
        word for run in runs for word in ([f"{run[0]}–{run[-1]}"] if len(run) >= _RUN else run)
    ):
        if lines[-1] and len(lines[-1]) + 1 + len(word) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".lstrip()
    return newline.join(lines)


def _follows(name: str, other: str) -> bool:
    """Whether two names are alike but for a last number, which is one higher in the other."""
    (stem, number), (other_stem, other_number) = (
        re.findall(r"(?s)\A(.*?)(\d*)\Z", text)[0] for text in (name, other)
    )
    return bool(
        stem == other_stem and number and other_number and int(number) + 1 == int(other_number)
    )


def text_extent(text: str) -> tuple[float, float]:
    """Return the rough width and height of a text in units of its font size."""
    lines = text.split("\n")
    return 0.58 * max(map(len, lines)), 1.2 * len(lines)


def new_axes(figsize: tuple[float, float]) -> Axes:
    """Return matplotlib axes in a new pyplot figure.

    Raises
    ------
    MissingExtraError
        matplotlib is not installed.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise MissingExtraError(
            f"this picture needs the package matplotlib. Got {error}; {how_to_install('plot')}"
        ) from error
    return plt.subplots(figsize=figsize, layout="constrained")[1]


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
