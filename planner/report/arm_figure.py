"""The robot at each setting as an interactive 3-D figure (plotly): one slider, no moves in between."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from aspectgraph.plot.traces import scene_figure

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.robot import Cell

# a part of more triangles is drawn as its convex hull: the figure shows the arm
_MOST_TRIANGLES = 4000
_ARM = "#e0862b"
_CAMERA = "#26547c"
_PART = "#9aa7b5"
_OBSTACLE = "#cfd3d8"


class Stand(NamedTuple):
    """The robot at one setting.

    Attributes
    ----------
    label : str
        What the slider says.
    fixturing : str
        Which way the part lies.
    joints : tuple of float
        Six, rad, and behind them the angle of a turntable if there is one.
    """

    label: str
    fixturing: str
    joints: tuple[float, ...]


def stands_of(plan: InspectionPlan) -> list[Stand]:
    """Return how the robot stands at the settings of a plan for a cell; none of another plan.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    return [
        Stand(f"setting {k}", setting.fixturing, setting.axes)
        for k, setting in enumerate(plan.settings, start=1)
        if setting.fixturing and setting.joints
    ]


def arm_figure(stands: Sequence[Stand], solid: Solid, cell: Cell) -> go.Figure:
    """Draw the arm, the camera, the part and obstacles at each setting, in the base of the robot.

    Parameters
    ----------
    stands : sequence of Stand
        At least one.
    solid : Solid
        The part.
    cell : Cell
        The cell; it need not know the part.

    Returns
    -------
    plotly.graph_objects.Figure
        With a slider if there are several settings. Coordinates are rounded to mm.
    """
    traces: list[Any] = []
    # settings at which each trace is shown
    shown: list[set[int]] = []
    moving = []
    for number, stand in enumerate(stands):
        shapes = cell.shapes(np.asarray(stand.joints), stand.fixturing)
        moving += [corners for _, is_moving, corners, _ in shapes if is_moving]
        own = _traces(shapes, visible=number == 0)
        traces += own
        shown += [{number}] * len(own)
    lies = [cell.part_at(np.asarray(stand.joints), stand.fixturing) for stand in stands]
    for key in dict.fromkeys(place.tobytes() for place in lies):
        own_stands = {k for k, place in enumerate(lies) if place.tobytes() == key}
        part2base = lies[min(own_stands)]
        part = np.asarray(solid.vertices) @ part2base[:3, :3].T + part2base[:3, 3]
        moving.append(part)
        traces.append(_part_trace(part, solid, visible=0 in own_stands))
        shown.append(own_stands)
    figure = scene_figure(traces, eye=(1.5, 1.5, 0.9))
    low = np.min([points.min(axis=0) for points in moving], axis=0)
    high = np.max([points.max(axis=0) for points in moving], axis=0)
    ranges = {
        f"{axis}axis": {"range": [float(low[k]) - 50.0, float(high[k]) + 50.0]}
        for k, axis in enumerate("xyz")
    }
    figure.update_scenes(**ranges, aspectmode="data")
    if len(stands) > 1:
        figure.update_layout(
            sliders=[_slider(stands, shown)], margin={"l": 60, "r": 60, "t": 0, "b": 60}
        )
    return figure


def arm_section(plan: InspectionPlan, solid: Solid, cell: Cell | None) -> str:
    """Return the figure as HTML for a page that has plotly; nothing without a cell or its settings.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    cell : Cell or None
        The cell that it was made for.
    """
    stands = stands_of(plan)
    if cell is None or not stands:
        return ""
    figure = arm_figure(stands, solid, cell)
    return figure.to_html(
        full_html=False,
        include_plotlyjs=False,
        div_id="arm3d",
        default_height="560px",
        config={"displaylogo": False, "responsive": True},
    )


def _slider(stands: Sequence[Stand], shown: Sequence[set[int]]) -> dict[str, Any]:
    steps = [
        {
            "label": f"{stand.label}, {stand.fixturing}",
            "method": "restyle",
            "args": [{"visible": [number in places for places in shown]}],
        }
        for number, stand in enumerate(stands)
    ]
    return {"active": 0, "steps": steps, "pad": {"t": 10}}


def _traces(
    shapes: Sequence[tuple[str, bool, np.ndarray, np.ndarray]], *, visible: bool
) -> list[Any]:
    """Return the arm, the camera and the obstacles as one mesh each."""
    groups: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for name, is_moving, corners, triangles in shapes:
        if name == "part":
            continue
        others = "robot" if is_moving else "obstacles"
        group = "camera" if name == "camera" else others
        groups.setdefault(group, []).append(_coarse(corners, triangles))
    colors = {"robot": _ARM, "camera": _CAMERA, "obstacles": _OBSTACLE}
    return [
        _mesh(*_joined(groups[name]), name=name, color=color, visible=visible)
        for name, color in colors.items()
        if name in groups
    ]


def _coarse(corners: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a hull with few corners: the farthest ones in directions that are spread evenly."""
    if len(corners) <= len(_DIRECTIONS):
        return corners, triangles
    return _hull(corners[np.unique((corners @ _DIRECTIONS.T).argmax(axis=0))])


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = ConvexHull(points)
    used, triangles = np.unique(found.simplices, return_inverse=True)
    return points[used], triangles.reshape(-1, 3)


def _spread(n: int) -> np.ndarray:
    """Return n directions (n, 3) along a spiral on the sphere."""
    heights = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angles = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n)
    radii = np.sqrt(1.0 - heights**2)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=1)


_DIRECTIONS = _spread(60)


def _joined(pieces: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Return several meshes as one."""
    starts = np.cumsum([0, *(len(corners) for corners, _ in pieces[:-1])])
    corners = np.concatenate([corners for corners, _ in pieces])
    triangles = [faces + start for (_, faces), start in zip(pieces, starts, strict=True)]
    return corners, np.concatenate(triangles)


def _part_trace(corners: np.ndarray, solid: Solid, *, visible: bool) -> Any:
    triangles = np.asarray(solid.triangles)
    if len(triangles) > _MOST_TRIANGLES:
        corners, triangles = _hull(corners)
    return _mesh(corners, triangles, name="part", color=_PART, visible=visible)


def _mesh(
    corners: np.ndarray, triangles: np.ndarray, *, name: str, color: str, visible: bool
) -> Any:
    import plotly.graph_objects as go

    # lists, since plotly would write arrays as base64 of eight bytes a number
    rounded = np.round(corners).astype(int).T.tolist()
    return go.Mesh3d(
        **dict(zip("xyz", rounded, strict=True)),
        **dict(zip("ijk", np.asarray(triangles).T.tolist(), strict=True)),
        color=color,
        opacity=0.35 if name == "obstacles" else 1.0,
        flatshading=True,
        name=name,
        hoverinfo="name",
        showlegend=False,
        visible=visible,
    )
