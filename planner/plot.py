"""The interactive 3-D figure of a plan (plotly): the part, the entities, the cameras and where they may be."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

# after Okabe and Ito (2008), and Tol (2021): told apart with any colour vision
COLORS = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9",
    "#882255", "#44aa99", "#332288", "#999933", "#aa4499", "#117733",
)  # fmt: skip
_GREY, _INK, _RED = "#ccd2da", "#5b6470", "#c0152f"
_MOST_CELLS = 60
# no triangle is too thin to have a normal: long thin ones are common in triangulated CAD faces
_LIGHT = {"ambient": 0.62, "diffuse": 0.55, "specular": 0.05, "facenormalsepsilon": 0.0, "vertexnormalsepsilon": 0.0}


def color_of(setting_idx: int) -> str:
    """Return the colour of a setting, the same in every picture."""
    return COLORS[setting_idx % len(COLORS)]


def plan_figure(plan, solid, space=None):
    """Draw a plan: part, entities, camera frusta, the robot's path and (hidden until asked for) covering domains.

    Parameters
    ----------
    plan : InspectionPlan
    solid : Solid
    space : VisibilityRegions or EntityAspectGraph, optional
        Gives the domains.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    traces = part_traces(solid)
    for k, setting in enumerate(plan.settings):
        group = f"setting {k + 1}"
        ends = [plan.entities[name] for name in setting.entities]
        traces.append(_entity_trace(ends, setting.entities, color_of(k), group))
        traces.append(_frustum_trace(setting, plan.camera, k, group))
    hidden = [plan.entities[name] for name in plan.uninspectable]
    if hidden:
        traces.append(_lines(hidden, color=_RED, width=7, name="not inspected", dash="dot"))
    traces.append(_path_trace(plan))
    if space is not None:
        box = _scene_box(plan, solid)
        traces += [_domain_trace(space.covering_cells(list(s.entities)), box, k) for k, s in enumerate(plan.settings)]
    return _figure(traces)


def part_traces(solid) -> list:
    """Return the faces and the feature edges of a part as plotly traces."""
    import plotly.graph_objects as go

    vertices, triangles = solid.vertices, solid.triangles
    faces = go.Mesh3d(
        **dict(zip("xyz", vertices.T, strict=True)),
        **dict(zip("ijk", triangles.T, strict=True)),
        color=_GREY,
        flatshading=True,
        lighting=_LIGHT,
        lightposition={"x": 1e4, "y": -2e4, "z": 3e4},
        hoverinfo="skip",
        name="part",
        showlegend=True,
    )
    sharp = [solid.edge_points(edge.id) for edge in solid.edges if _is_feature(solid, edge)]
    return [faces, _lines(sharp, color=_INK, width=1.5, name="edges", hoverinfo="skip", showlegend=False)]


def _is_feature(solid, edge) -> bool:
    inside_curve = all(solid.faces[f].curved for f in edge.faces)
    return abs(edge.dihedral_deg) >= (40.0 if inside_curve else 20.0)


def _figure(traces):
    import plotly.graph_objects as go

    figure = go.Figure(traces)
    axis = {"showbackground": False, "gridcolor": "#e3e7ec", "zeroline": False, "color": "#6b7480", "ticksuffix": ""}
    figure.update_layout(
        scene={
            "aspectmode": "data",
            "xaxis": {**axis, "title": "x (mm)"},
            "yaxis": {**axis, "title": "y (mm)"},
            "zaxis": {**axis, "title": "z (mm)"},
            "camera": {"eye": {"x": 1.1, "y": -1.3, "z": 0.75}},
        },
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"y": 0.93, "groupclick": "togglegroup", "itemsizing": "constant", "bgcolor": "rgba(255,255,255,0.8)"},
        paper_bgcolor="#ffffff",
        font={"family": "Helvetica Neue, Helvetica, Arial, sans-serif", "size": 12, "color": "#1c2128"},
        uirevision="plan",
    )
    return figure


def _lines(segments, *, color, width, name, dash="solid", **options):
    import plotly.graph_objects as go

    # a row of nan between two segments lifts the pen
    rows = [row for segment in segments for row in (*np.asarray(segment), (np.nan,) * 3)]
    x, y, z = np.array(rows).T if rows else np.zeros((3, 0))
    line = {"color": color, "width": width, "dash": dash}
    return go.Scatter3d(x=x, y=y, z=z, mode="lines", line=line, name=name, **options)


def _entity_trace(ends, names, color, group):
    hover = [name for name in names for _ in range(3)]
    return _lines(ends, color=color, width=9, name=group, legendgroup=group, hovertext=hover, hoverinfo="text")


def _frustum_trace(setting, camera, k, group):
    """Draw the pyramid from the nodal point to the plane in focus, and the number of the setting."""
    half = np.array(camera.sensor_size_mm) / 2 / camera.image_distance_mm * camera.focus_distance_mm
    corners = np.array([[x, y, camera.focus_distance_mm] for x, y in half * [[-1, -1], [1, -1], [1, 1], [-1, 1]]])
    corners = corners @ setting.cam2world[:3, :3].T + setting.position
    apex = setting.position
    pieces = [(apex, c) for c in corners] + list(zip(corners, np.roll(corners, -1, axis=0), strict=True))
    probabilities = "<br>".join(f"{name}: P = {p:.4f}" for name, p in setting.probability.items())
    return _lines(
        pieces,
        color=color_of(k),
        width=2,
        name=f"camera {k + 1}",
        legendgroup=group,
        showlegend=False,
        hovertext=f"setting {k + 1}, camera at {_point(apex)} mm<br>{probabilities}",
        hoverinfo="text",
    )


def _path_trace(plan):
    import plotly.graph_objects as go

    positions = np.array([setting.position for setting in plan.settings]).reshape(-1, 3)
    return go.Scatter3d(
        **dict(zip("xyz", positions.T, strict=True)),
        mode="lines+markers+text",
        line={"color": "#9aa3ae", "width": 2, "dash": "dash"},
        marker={"size": 5, "color": [color_of(k) for k in range(len(positions))]},
        text=[str(k + 1) for k in range(len(positions))],
        textposition="top center",
        textfont={"size": 14},
        name="order of travel",
        hoverinfo="skip",
    )


def _scene_box(plan, solid) -> np.ndarray:
    """Return the box (2, 3) that is worth showing: part and cameras with some air, inside the workspace."""
    points = np.vstack([solid.bounds, *(setting.position for setting in plan.settings)])
    low, high = points.min(axis=0), points.max(axis=0)
    air = 0.15 * np.linalg.norm(high - low)
    return np.array([np.maximum(low - air, plan.workspace[0]), np.minimum(high + air, plan.workspace[1])])


def _domain_trace(cells, box, k):
    """Draw the cells of covering domains, cut off at the box, as one translucent mesh."""
    import plotly.graph_objects as go

    vertices, triangles, n = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=int)], 0
    largest = np.argsort(-np.asarray(cells.volumes), kind="stable")[:_MOST_CELLS]
    for i, cell in enumerate(cells):
        corners = clipped_corners(cell.half_spaces, box) if i in largest else None
        if corners is not None:
            hull = ConvexHull(corners)
            vertices.append(corners)
            triangles.append(hull.simplices + n)
            n += len(corners)
    return go.Mesh3d(
        **dict(zip("xyz", np.concatenate(vertices).T, strict=True)),
        **dict(zip("ijk", np.concatenate(triangles).T, strict=True)),
        color=color_of(k),
        opacity=0.16,
        flatshading=True,
        hoverinfo="skip",
        name=f"domains of setting {k + 1}",
        visible="legendonly",
        showlegend=True,
    )


def clipped_corners(half_spaces, box) -> np.ndarray | None:
    """Return the corners (v, 3) of a convex cell cut off at a box (2, 3), or None if nothing solid is left.

    Parameters
    ----------
    half_spaces : array (s, 4)
        Rows (a, b) with a.x + b <= 0.
    box : array (2, 3)
    """
    low, high = box
    walls = np.vstack([np.column_stack([np.eye(3), -high]), np.column_stack([-np.eye(3), low])])
    rows = np.vstack([np.asarray(half_spaces, dtype=float), walls])
    norms = np.linalg.norm(rows[:, :3], axis=1)
    # the deepest point: maximise the distance to the nearest plane
    deepest = linprog(
        [0, 0, 0, -1],
        A_ub=np.column_stack([rows[:, :3], norms]),
        b_ub=-rows[:, 3],
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    if deepest.status != 0 or deepest.x[3] < 1e-3:
        return None
    try:
        corners = HalfspaceIntersection(rows, deepest.x[:3]).intersections
        return np.unique(np.round(corners, 6), axis=0)
    except QhullError:
        return None


def _point(point) -> str:
    return "(" + ", ".join(f"{value:.1f}" for value in point) + ")"
