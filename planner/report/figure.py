"""The interactive 3-D figure of a plan (plotly): the part, the entities, the cameras and where they may be."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aspectgraph.plot.traces import (
    domain_facets,
    line_trace,
    part_traces,
    point_text,
    scene_figure,
    surface_trace,
    xyz,
)
from errors.formatting import probability_text
from errors.measurands import Geometry, MeasuredCircle
from planner.camera.pose import world_to_cam
from planner.progress import TimeLeft
from planner.request.reach import TargetSpace
from planner.request.targets import targets_of
from planner.sensor_setting import SensorSetting

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from markupsafe import Markup

    from aspectgraph import Arc, Solid
    from planner.camera.camera import Camera
    from planner.light.light_plan import LightPlan
    from planner.plan import InspectionPlan
    from planner.request.reach import Space


# Views of the 3-D figure: everything at first, the part, and what each setting's camera sees.
#
# Plotly's scene is a box about the origin whose sides are the aspect ratios; its camera looks
# from `eye` to `centre` with a field of 45 degrees from top to bottom.


_Array = NDArray[np.float64]

_TANGENT = math.tan(math.radians(22.5))
# share of the picture's height that what is shown may take
_FILLED = 0.86
_DIAGONAL = 2.0
EVERYTHING = (1.1, -1.3, 0.75)
"""Direction from which everything is shown at first."""


@dataclass(frozen=True)
class SceneFrame:
    """How points of the part's frame lie in the scene.

    Attributes
    ----------
    box : ndarray, shape (2, 3)
        Corners of what is shown, mm.
    """

    box: _Array

    @property
    def per_mm(self) -> float:
        """Units of the scene to the mm."""
        return float(_DIAGONAL / np.linalg.norm(self.box[1] - self.box[0]))

    @property
    def layout(self) -> dict[str, Any]:
        """Ranges and aspect of plotly's scene."""
        axes = {f"{name}axis": {"range": self.box[:, i].tolist()} for i, name in enumerate("xyz")}
        sides = (self.per_mm * (self.box[1] - self.box[0])).tolist()
        return {**axes, "aspectmode": "manual", "aspectratio": dict(zip("xyz", sides, strict=True))}

    def placed(self, points: Any) -> _Array:
        """Return points (n, 3) in mm as the scene has them."""
        return np.asarray(
            self.per_mm * (np.asarray(points, dtype=np.float64) - self.box.mean(axis=0))
        )

    def camera(
        self, points: Any, direction: Sequence[float] | _Array, up: Sequence[float] | _Array
    ) -> dict[str, Any]:
        """Return plotly's camera that shows points (n, 3), mm, as large as the picture's height allows.

        `direction` leads from them towards the viewer.
        """
        placed = self.placed(points)
        towards = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
        right = np.cross(up, towards)
        if np.linalg.norm(right) < 1e-9:
            right = np.cross([0.0, 1.0, 0.0], towards)
        right /= np.linalg.norm(right)
        axes = np.array([right, np.cross(towards, right), towards])
        inside = placed @ axes.T
        centre = (inside.min(axis=0) + inside.max(axis=0)) / 2
        aside = np.abs(inside - centre)[:, :2].max(axis=1)
        distance = float((inside[:, 2] - centre[2] + aside / (_TANGENT * _FILLED)).max())
        middle = centre @ axes
        eye = middle + distance * towards
        return {key: dict(zip("xyz", v.tolist(), strict=True)) for key, v in
                (("eye", eye), ("center", middle), ("up", axes[1]))}  # fmt: skip

    def eye_of(self, setting: SensorSetting, camera: Camera, depth: float) -> dict[str, Any]:
        """Return plotly's camera that stands where a setting's camera does, and looks along its axis.

        ``field`` holds the tangents of the largest angles to the axis that the sensor sees, across (x) and upwards (y):
        the page sets the field of plotly's camera to these. The page cannot draw the lens distortion.

        Parameters
        ----------
        setting : SensorSetting
            Gives the pose.
        camera : Camera
            Gives the field.
        depth : float
            Where the axis meets what is measured, mm; the view turns about this point.
        """
        rotation = setting.cam2world[:3, :3]
        ahead = setting.position + depth * rotation[:, 2]
        eye, centre = self.placed([setting.position, ahead])
        x_low, y_low, x_high, y_high = camera.field().outer
        lines = (("eye", eye), ("center", centre), ("up", -rotation[:, 1]))
        view: dict[str, Any] = {key: dict(zip("xyz", v.tolist(), strict=True)) for key, v in lines}
        view["field"] = {"x": max(-x_low, x_high), "y": max(-y_low, y_high)}
        return view


def plan_views(
    plan: InspectionPlan, frame: SceneFrame, part: _Array, shown: _Array
) -> dict[str, dict[str, Any]]:
    """Return plotly's cameras by name: ``everything``, ``part`` and ``setting-1`` and so on.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the settings.
    frame : SceneFrame
        How the scene is laid out.
    part : ndarray, shape (n, 3)
        Points around the part, mm.
    shown : ndarray, shape (n, 3)
        Points around everything, mm.
    """
    views = {
        "everything": frame.camera(shown, EVERYTHING, (0, 0, 1)),
        "part": frame.camera(part, EVERYTHING, (0, 0, 1)),
    }
    for k, setting in enumerate(plan.settings, start=1):
        measured = np.concatenate([np.asarray(plan.entities[name]) for name in setting.entities])
        depth = float(world_to_cam(measured, setting.cam2world)[:, 2].mean())
        views[f"setting-{k}"] = frame.eye_of(setting, plan.camera, depth)
    return views


def box_around(points: _Array, limits: _Array, air: float = 0.08) -> _Array:
    """Return the box (2, 3) around points with some air, which is cut off at the limits; points never are."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    more = air * float(np.linalg.norm(high - low))
    return np.array(
        [
            np.minimum(low, np.maximum(low - more, limits[0])),
            np.maximum(high, np.minimum(high + more, limits[1])),
        ]
    )


def figure_html(figure: go.Figure, name: str, height: str, **config: object) -> Markup:
    """Return a figure for a page that has plotly.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        The figure.
    name, height : str
        Identifier and height of its element.
    **config : object
        Further configuration of plotly.
    """
    from markupsafe import Markup

    html = figure.to_html(
        full_html=False,
        include_plotlyjs=False,
        div_id=name,
        default_height=height,
        config={"displaylogo": False, "responsive": True, **config},
    )
    return Markup(html)


# Lines of pictures: edges of the part, its circles, and the lines and circles that a plan
# measures.


_PARTS_OF_CIRCLE = 96


def polylines(
    plan: InspectionPlan, name: str, setting: SensorSetting | None = None
) -> list[NDArray[np.float64]]:
    """Return one polyline (n, 3) per edge, line or circle of what is measured, mm.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    name : str
        One of its entities or dimensions.
    setting : SensorSetting, optional
        Measures it. Default: the first that does.

    Returns
    -------
    list of array (n, 3)
        Two points of a line, a fine polygon of a circle or arc.
    """
    if setting is None:
        setting = next((view for view in plan.settings if name in view.entities), None)
    targets = plan.targets if setting is None else targets_of(plan.targets, setting)
    return lines_of(targets[name].geometry)


def lines_of(geometry: Iterable[Geometry]) -> list[NDArray[np.float64]]:
    """Return one polyline (n, 3) per line or circle, mm.

    Parameters
    ----------
    geometry : iterable of Line or MeasuredCircle
        What is measured.
    """
    polygons = []
    for curve in geometry:
        if isinstance(curve, MeasuredCircle):
            n = max(2, round(_PARTS_OF_CIRCLE * curve.span_rad / (2 * np.pi)))
            polygons.append(curve.points(np.linspace(0.0, curve.span_rad, n + 1)))
        else:
            polygons.append(np.array([curve.p, curve.q]))
    return polygons


def drawn(
    plan: InspectionPlan, names: Iterable[str], setting: SensorSetting | None = None
) -> dict[str, NDArray[np.float64]]:
    """Return what a picture highlights by name: ends of an edge (2, 3), segments of a dimension (s, 2, 3), mm.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    names : iterable of str
        Some of its entities and dimensions.
    setting : SensorSetting, optional
        Measures them. Default: of each the first that does.

    Returns
    -------
    dict of str to array
        In the order given.
    """
    pieces = {}
    for name in names:
        lines = polylines(plan, name, setting)
        pairs = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
        # the ends of an edge are marked
        pieces[name] = lines[0] if plan.targets[name].in_image else np.concatenate(pairs)
    return pieces


def chord_circles(solid: Solid) -> dict[int, Arc]:
    """Return the rim or arc of each chord, by the number of the edge in ``solid.edges``.

    Parameters
    ----------
    solid : Solid
        The part.
    """
    number = {edge.id: k for k, edge in enumerate(solid.edges)}
    curves = (*solid.rims(), *solid.arcs())
    return {number[edge]: curve for curve in curves for edge in curve.edge_ids}


def on_circle(
    points_cam: NDArray[np.float64], circle: Arc, cam2world: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move points along the radius of a circle onto it.

    Parameters
    ----------
    points_cam : ndarray, shape (n, 3)
        Points in the camera's frame, mm.
    circle : Arc
        A rim or arc of the part.
    cam2world : ndarray, shape (4, 4)
        Pose of the camera.

    Returns
    -------
    ndarray, shape (n, 3)
        Points in the part's frame, mm.
    """
    from_centre = points_cam @ cam2world[:3, :3].T + cam2world[:3, 3] - circle.centre
    across = from_centre - np.outer(from_centre @ circle.axis, circle.axis)
    distance = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(circle.centre + circle.radius_mm * across / np.maximum(distance, 1e-300))


# after Okabe and Ito (2008), and Tol (2021): told apart with any colour vision
COLORS = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9",
    "#882255", "#44aa99", "#332288", "#999933", "#aa4499", "#117733",
)  # fmt: skip
_RED = "#c0152f"
_YELLOW = "#f0c800"


def color_of(setting_idx: int) -> str:
    """Return the colour of a setting, the same in every picture."""
    return COLORS[setting_idx % len(COLORS)]


def plan_figure(
    plan: InspectionPlan,
    solid: Solid | None = None,
    space: Space | None = None,
    *,
    until: float = math.inf,
) -> go.Figure:
    """Draw a plan in 3-D: part, entities, camera frusta, the robot's path and domains.

    The covering domains are hidden until you click them in the legend.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid, optional
        Its part. Without it, the figure shows only the targets, cameras and path.
    space : VisibilityRegions or EntityAspectGraph, optional
        Gives the domains. Without it, the figure shows none.
    until : float
        Time, as `time.time` gives it, after which the figure omits the domains. Default: never.

    Returns
    -------
    plotly.graph_objects.Figure
        A notebook shows it; ``write_html`` saves it.

    Examples
    --------
    >>> from planner import plan_figure, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> from aspectgraph import read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> figure = plan_figure(plan, block)
    >>> sorted(trace.name for trace in figure.data if trace.name and "setting" in trace.name)
    ['setting 1']
    """
    traces = [] if solid is None else part_traces(solid)
    for k, setting in enumerate(plan.settings):
        group = f"setting {k + 1}"
        lines = [
            (name, line) for name in setting.entities for line in polylines(plan, name, setting)
        ]
        traces.append(_entity_trace(lines, color_of(k), group))
        traces.append(_frustum_trace(setting, plan.camera, k, group))
    hidden = [line for name in plan.uninspectable for line in polylines(plan, name)]
    if hidden:
        traces.append(line_trace(hidden, color=_RED, width=7, name="not inspected", dash="dot"))
    traces.append(_path_trace(plan))
    if plan.light is not None and _lamps(plan):
        traces.append(_lamp_trace(plan.light))
    frame = scene_frame(plan, solid)
    if space is not None and solid is not None:
        time_left = TimeLeft(until)
        for k, setting in enumerate(plan.settings):
            if not time_left.fits_another():
                break
            chosen = space.choosing(setting.witness) if isinstance(space, TargetSpace) else space
            facets = domain_facets(chosen.covering_cells(list(setting.entities)), solid, frame.box)
            name = f"domains of setting {k + 1}"
            traces.append(
                surface_trace(
                    facets, color=color_of(k), opacity=0.16, name=name, visible="legendonly"
                )
            )
    figure = scene_figure(traces, eye=EVERYTHING)
    camera = {
        **figure_views(plan, solid, frame)["everything"],
        "projection": {"type": "perspective"},
    }
    figure.update_scenes({**frame.layout, "camera": camera})
    return figure.update_layout(
        legend={"y": 0.93, "bgcolor": "rgba(255,255,255,0.8)"}, uirevision="plan"
    )


def _entity_trace(lines: Sequence[tuple[str, np.ndarray]], color: str, group: str) -> go.Scatter3d:
    hover = [name for name, line in lines for _ in range(len(line) + 1)]
    return line_trace(
        [line for _, line in lines],
        color=color,
        width=9,
        name=group,
        legendgroup=group,
        hovertext=hover,
        hoverinfo="text",
    )


def _frustum_trace(setting: SensorSetting, camera: Camera, k: int, group: str) -> go.Scatter3d:
    """Draw the pyramid from the nodal point to the plane in focus, and the number of the setting."""
    corners = _corners(setting, camera)
    apex = setting.position
    pieces = [(apex, c) for c in corners] + list(
        zip(corners, np.roll(corners, -1, axis=0), strict=True)
    )
    probabilities = "<br>".join(
        f"{name}: P = {probability_text(p)}" for name, p in setting.probability.items()
    )
    return line_trace(
        pieces,
        color=color_of(k),
        width=2,
        name=f"camera {k + 1}",
        legendgroup=group,
        showlegend=False,
        hovertext=f"setting {k + 1}, camera at {point_text(apex)} mm<br>{probabilities}",
        hoverinfo="text",
    )


def _corners(setting: SensorSetting, camera: Camera) -> np.ndarray:
    """Return the corners (4, 3) of what the camera sees in the plane in focus, mm."""
    x_low, y_low, x_high, y_high = camera.field().inner
    tangents = [
        [x_low, y_low, 1.0],
        [x_high, y_low, 1.0],
        [x_high, y_high, 1.0],
        [x_low, y_high, 1.0],
    ]
    corners = camera.focus_distance_mm * np.array(tangents)
    return np.asarray(corners @ setting.cam2world[:3, :3].T + setting.position)


def _path_trace(plan: InspectionPlan) -> go.Scatter3d:
    import plotly.graph_objects as go

    positions = np.array([setting.position for setting in plan.settings])
    return go.Scatter3d(
        **xyz(positions),
        mode="lines+markers+text",
        line={"color": "#9aa3ae", "width": 2, "dash": "dash"},
        marker={"size": 5, "color": [color_of(k) for k in range(len(positions))]},
        text=[str(k + 1) for k in range(len(positions))],
        textposition="top center",
        textfont={"size": 14},
        name="order of travel",
        hoverinfo="skip",
    )


def _lamp_trace(light: LightPlan) -> go.Scatter3d:
    """Draw the lamps with their numbers; what each shows is told when it is pointed at."""
    import plotly.graph_objects as go

    shown = [
        "<br>".join(
            f"setting {k + 1}: {', '.join(image.contrast)}"
            for k, images in enumerate(light.images)
            for image in images
            if lamp in image.lamps
        )
        for lamp in range(len(light.lamps))
    ]
    return go.Scatter3d(
        **xyz(light.lamps),
        mode="markers+text",
        marker={
            "size": 8,
            "symbol": "diamond",
            "color": _YELLOW,
            "line": {"color": "#333", "width": 1},
        },
        text=[f"lamp {lamp + 1}" for lamp in range(len(light.lamps))],
        textposition="top center",
        hovertext=[
            f"lamp at {point_text(place)} mm<br>{text}"
            for place, text in zip(light.lamps, shown, strict=True)
        ],
        hoverinfo="text",
        name="lamps",
    )


def scene_frame(plan: InspectionPlan, solid: Solid | None) -> SceneFrame:
    """Return how the figure is laid out: part, cameras and what they see, with some air inside the workspace."""
    limits = np.asarray(plan.workspace, dtype=np.float64)
    return SceneFrame(box_around(_shown(plan, solid), limits))


def figure_views(
    plan: InspectionPlan, solid: Solid | None, frame: SceneFrame | None = None
) -> dict[str, dict[str, Any]]:
    """Return plotly's cameras by name: everything, the part, and each setting's view of it."""
    corners = _part_corners(plan, solid)
    return plan_views(plan, frame or scene_frame(plan, solid), corners, _shown(plan, solid))


def _part_corners(plan: InspectionPlan, solid: Solid | None) -> np.ndarray:
    """Return the corners (8, 3) of the box of the part, or of what is measured, mm."""
    if solid is not None:
        bounds = np.asarray(solid.bounds)
    else:
        points = np.concatenate([np.asarray(ends) for ends in plan.entities.values()])
        bounds = np.array([points.min(axis=0), points.max(axis=0)])
    return np.array(list(product(*bounds.T)))


def _shown(plan: InspectionPlan, solid: Solid | None) -> np.ndarray:
    """Return points (n, 3) around all that is shown at first, mm."""
    corners = _part_corners(plan, solid)
    pyramids = [
        point
        for setting in plan.settings
        for point in (setting.position, *_corners(setting, plan.camera))
    ]
    return np.vstack([corners, *pyramids, *_lamps(plan)])


def _lamps(plan: InspectionPlan) -> Sequence[np.ndarray]:
    """Return the places of lamps that have places of their own, mm."""
    return () if plan.light is None or plan.light.kind == "ring" else tuple(plan.light.lamps)
