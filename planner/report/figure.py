"""Figures of a plan: settings around the part, the graph they come from, and the arm that reaches them."""

from __future__ import annotations

import base64
import heapq
import json
import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from aspectgraph.plot.traces import (
    domain_facets,
    line_trace,
    part_traces,
    point_text,
    scene_figure,
    surface_trace,
    xyz,
)
from aspectgraph.plot.views import layout
from errors.checks import relation_text
from errors.measurands import Circle, Geometry
from ground.templates import render
from planner.argument_kinds import check_kinds, suggests_names
from planner.camera.pose import world_to_cam
from planner.progress import TimeLeft, report
from planner.request.reach import TargetSpace
from planner.request.targets import targets_of
from planner.sensor_setting import SensorSetting

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from markupsafe import Markup

    from aspectgraph import EntityAspectGraph, Solid
    from planner.camera.camera import Camera
    from planner.light.light_plan import LightPlan
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.request.reach import Space
    from planner.robotcell import Cell

# The interactive 3-D figure of a plan (plotly): the part, the entities, the cameras and where
# they may be.


# Views of the 3-D figure: everything at first, the part, and what each setting's camera sees.
#
# Plotly's scene is a box about the origin whose sides are the aspect ratios; its camera looks
# from `eye` to `centre` with a field of 45 degrees from top to bottom.


_Array = NDArray[np.float64]

# of zlib: the highest takes several times as long, for a hundredth of a page
_LEVEL = 6
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
    def size(self) -> float:
        """Diagonal of what is shown, mm."""
        return float(np.linalg.norm(self.box[1] - self.box[0]))

    @property
    def per_mm(self) -> float:
        """Units of the scene to the mm."""
        return _DIAGONAL / self.size

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


def packed(text: str) -> str:
    """Return a text compressed with zlib, in base64: `unpackedText` in ``figures.js`` reads it."""
    return base64.b64encode(zlib.compress(text.encode(), _LEVEL)).decode()


def figure_html(
    figure: go.Figure, name: str, height: str, size: float | None = None, **config: object
) -> Markup:
    """Return a figure for a page that draws it with plotly.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        The figure.
    name, height : str
        Identifier and height of its element.
    size : float, optional
        Diagonal of what the figure shows: coordinates are rounded to what can be seen of it. Default: they are kept.
    **config : object
        Further configuration of plotly.
    """
    from markupsafe import Markup

    drawn = json.loads(figure.to_json())
    if size is not None:
        decimals = _decimals(size)
        for trace, short in zip(figure.data, drawn["data"], strict=True):
            short |= {axis: _short(trace[axis], decimals) for axis in "xyz" if axis in short}
    drawn["config"] = {"displaylogo": False, "responsive": True, **config}
    text = packed(json.dumps(drawn, separators=(",", ":")))
    return Markup(
        f'<div id="{name}" style="height:{height}; width:100%"></div>\n'
        f'<script type="text/plain" data-figure="{name}">{text}</script>'
    )


def _decimals(size: float) -> int:
    """Return how many decimals of coordinates can be seen in a figure whose diagonal has a size."""
    return _DIGITS - math.floor(math.log10(size))


def _short(coordinates: Sequence[float], decimals: int) -> list[float | None]:
    """Return rounded coordinates as JSON has them: null lifts the pen."""
    rounded = np.round(np.asarray(coordinates, dtype=np.float64), decimals) + 0.0
    values = rounded.astype(object)
    values[np.isnan(rounded)] = None
    return list(values)


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
    geometry : iterable of Line or Circle
        What is measured.
    """
    polygons = []
    for curve in geometry:
        if isinstance(curve, Circle):
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


class Circles(NamedTuple):
    """Circles of a part.

    Attributes
    ----------
    centre : ndarray, shape (n, 3)
        In mm.
    axis : ndarray, shape (n, 3)
        Unit normal of its plane.
    radius_mm : ndarray, shape (n,)
    """

    centre: NDArray[np.float64]
    axis: NDArray[np.float64]
    radius_mm: NDArray[np.float64]


def chord_circles(solid: Solid) -> tuple[NDArray[np.int64], Circles]:
    """Return which circle each edge is a chord of, and the circles.

    Parameters
    ----------
    solid : Solid
        The part.

    Returns
    -------
    number : ndarray, shape (edges,)
        Of each edge's circle; -1 for those that are no chords.
    circles : Circles
        Of all rims and arcs.
    """
    position = {edge.id: k for k, edge in enumerate(solid.edges)}
    curves = (*solid.rims(), *solid.arcs())
    number = np.full(len(solid.edges), -1)
    for k, curve in enumerate(curves):
        number[[position[edge_id] for edge_id in curve.edge_ids]] = k
    return number, Circles(
        np.array([curve.centre for curve in curves]).reshape(-1, 3),
        np.array([curve.axis for curve in curves]).reshape(-1, 3),
        np.array([curve.radius_mm for curve in curves]),
    )


def on_circles(
    points_cam: NDArray[np.float64], circles: Circles, cam2world: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move points along the radius of a circle onto it.

    Parameters
    ----------
    points_cam : ndarray, shape (n, 3)
        Points in the camera's frame, mm.
    circles : Circles
        The circle of each point, of the part.
    cam2world : ndarray, shape (4, 4)
        Pose of the camera.

    Returns
    -------
    ndarray, shape (n, 3)
        Points in the part's frame, mm.
    """
    from_centre = points_cam @ cam2world[:3, :3].T + cam2world[:3, 3] - circles.centre
    height = np.einsum("ni,ni->n", from_centre, circles.axis)
    across = from_centre - height[:, None] * circles.axis
    distance = np.linalg.norm(across, axis=1, keepdims=True)
    onto = circles.radius_mm[:, None] * across / np.maximum(distance, 1e-300)
    return np.asarray(circles.centre + onto)


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


@suggests_names
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
    kinds: dict[str, tuple[object, str]] = {"plan": (plan, "InspectionPlan")}
    if solid is not None:
        kinds["solid"] = (solid, "Solid")
    check_kinds(**kinds)
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
    if plan.light is not None and plan.light.area is None and _lamps(plan):
        traces.append(_lamp_trace(plan.light))
    if plan.light is not None and plan.light.area is not None:
        corners = plan.light.area.outline
        if len(corners):
            line = np.vstack([corners, corners[:1]])
            traces.append(line_trace([line], color=_YELLOW, width=5, name=plan.light.kind))
    frame = scene_frame(plan, solid)
    if space is not None and solid is not None:
        time_left = TimeLeft(until)
        for k, setting in enumerate(plan.settings):
            if not time_left.fits_another():
                break
            chosen = TargetSpace.of_plan(space, plan).choosing(setting.witness)
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
        f"{name}: P {relation_text(p)}" for name, p in setting.probability.items()
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
    if plan.light is None or plan.light.kind == "ring":
        return ()
    area = plan.light.area
    return tuple(plan.light.lamps) if area is None else tuple(area.outline)


# The aspect graph as a picture beside the plan in 3-D: viewing domains to click on, and the
# surface of each.
#
# Of a large graph the domains that matter most to the plan are drawn, never more than
# `MOST_DOMAINS`.


MOST_DOMAINS = 48
"""More circles are no picture any more, and each takes about 0.04 s."""

MOST_CELLS = 3000
"""Cells of all domains whose surfaces are computed; each takes about 2 ms."""

_NOTHING: dict[str, Any] = {key: [] for key in "xyzijk"}
_WIDTH = 420.0
_HEIGHT = 560.0
_AIR = 26.0
_RADII = (6.0, 15.0)
_PLAIN = "#c3cbd4"
# digits kept of the size of what is shown
_DIGITS = 4


class GraphPicture(NamedTuple):
    """An aspect graph for a page.

    Attributes
    ----------
    svg : Markup
        The picture; its circles are in groups with the attribute ``data-domain``.
    n_drawn, n : int
        Number of its circles, and of all domains.
    domains : dict
        What is shown of a domain that is clicked on: by number of the domain its ``text``, its ``color`` and its
        surface: coordinates ``x``, ``y``, ``z`` in mm of the corners of triangles ``i``, ``j``, ``k``.
    """

    svg: Markup
    n_drawn: int
    n: int
    domains: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class _Shown:
    """Domains that are drawn, and what the plan has to do with each."""

    nodes: list[int]
    standing: dict[int, list[int]]
    covering: dict[int, list[int]]

    def setting(self, node: int) -> int | None:
        """Return the setting whose colour a domain has: one whose camera is in it, or one it would do for."""
        return next(iter([*self.standing.get(node, ()), *self.covering.get(node, ())]), None)


def graph_picture(
    plan: InspectionPlan,
    graph: EntityAspectGraph,
    box: NDArray[np.float64],
    colors: Sequence[str],
    progress: Progress | None = None,
    *,
    until: float = math.inf,
) -> GraphPicture:
    """Draw the aspect graph that a plan rests on.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the settings.
    graph : EntityAspectGraph
        Of the entities that the plan needs.
    box : ndarray, shape (2, 3)
        What the picture in 3-D shows, mm; domains are cut off there.
    colors : sequence of str
        One for each setting.
    progress : callable, optional
        ``progress(done, total, label)``.
    until : float
        Time, as `time.time` gives it, after which no more surfaces are computed.

    Returns
    -------
    GraphPicture
        The picture and what belongs to it.
    """
    shown = _chosen(plan, graph, box)
    surfaces, unseen = _surfaces(graph, shown, box, progress, TimeLeft(until))
    domains = {
        str(node): {
            "text": _text(plan, graph, node, shown) + unseen.get(node, ""),
            "color": _color(shown, node, colors),
            **surfaces.get(node, _NOTHING),
        }
        for node in shown.nodes
    }
    return GraphPicture(_svg(graph, shown, colors), len(shown.nodes), len(graph.graph), domains)


def needed_entities(plan: InspectionPlan, setting: SensorSetting) -> list[str]:
    """Return the entities that a setting must see: of a dimension all that it is measured from.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the dimensions.
    setting : SensorSetting
        One of its settings.
    """
    targets = targets_of(plan.targets, setting)
    lists = (targets[name].entities for name in setting.entities)
    return list(dict.fromkeys(entity for names in lists for entity in names))


def _chosen(plan: InspectionPlan, graph: EntityAspectGraph, box: NDArray[np.float64]) -> _Shown:
    """Choose what is drawn: the domains with cameras, shortest ways between them, and the largest around these."""
    standing: dict[int, list[int]] = {}
    covering: dict[int, list[int]] = {}
    for k, setting in enumerate(plan.settings):
        (node,) = graph.domain_of(setting.position).tolist()
        if node >= 0:
            standing.setdefault(node, []).append(k)
        for node in graph.covering(needed_entities(plan, setting)):
            covering.setdefault(node, []).append(k)
    inside = [node for node, data in graph.graph.nodes(data=True) if _is_inside(data, box)]
    seen = graph.graph.subgraph([*inside, *standing])
    chosen = _ways(seen, list(standing) or inside[:1])[:MOST_DOMAINS]
    half = (MOST_DOMAINS + len(chosen)) // 2
    chosen = _grown(seen.subgraph([*chosen, *covering]), chosen, half)
    return _Shown(sorted(_grown(seen, chosen, MOST_DOMAINS)), standing, covering)


def _ways(graph: nx.Graph, ends: Sequence[int]) -> list[int]:
    """Return nodes, and those on a shortest way from the first to each of the others; the nodes first."""
    nodes = dict.fromkeys(ends)
    for node in ends[1:]:
        if nx.has_path(graph, ends[0], node):
            nodes.update(dict.fromkeys(nx.shortest_path(graph, ends[0], node)))
    return list(nodes)


def _grown(graph: nx.Graph, nodes: Sequence[int], limit: int) -> list[int]:
    """Return nodes and their neighbours, the largest first, and the neighbours of these, up to a number."""
    grown = dict.fromkeys(nodes)
    waiting = [(-graph.nodes[other]["volume"], other) for node in nodes for other in graph[node]]
    heapq.heapify(waiting)
    while waiting and len(grown) < limit:
        _, node = heapq.heappop(waiting)
        if node not in grown:
            grown[node] = None
            for other in graph[node]:
                heapq.heappush(waiting, (-graph.nodes[other]["volume"], other))
    return list(grown)


def _is_inside(data: dict[str, Any], box: NDArray[np.float64]) -> bool:
    """Say if something of a domain may lie in the box."""
    return bool(
        (np.array(data["bbox_max"]) > box[0]).all() and (np.array(data["bbox_min"]) < box[1]).all()
    )


def _surfaces(
    graph: EntityAspectGraph,
    shown: _Shown,
    box: NDArray[np.float64],
    progress: Progress | None,
    time_left: TimeLeft,
) -> tuple[dict[int, dict[str, Any]], dict[int, str]]:
    """Return surfaces by domain, simple ones and those with cameras first, and why nothing is shown of a domain."""
    cells = dict(graph.graph.nodes(data="n_cells"))
    surfaces: dict[int, dict[str, Any]] = {}
    unseen: dict[int, str] = {}
    taken = 0
    order = sorted(shown.nodes, key=lambda node: (node not in shown.standing, cells[node], node))
    for k, node in enumerate(order):
        report(progress, k, len(order), "picture of the graph")
        taken += cells[node]
        if taken > MOST_CELLS:
            unseen[node] = " It has too many cells to be drawn."
        elif not time_left.fits_another():
            unseen[node] = " It is not drawn: the time limit ended."
        else:
            surfaces[node] = _surface(graph, node, box)
            if not surfaces[node]["i"]:
                unseen[node] = " It lies outside the picture."
    report(progress, len(order), len(order), "picture of the graph")
    return surfaces, unseen


def _surface(graph: EntityAspectGraph, node: int, box: NDArray[np.float64]) -> dict[str, Any]:
    """Return the surface of a domain as plotly takes it, rounded to what can be seen."""
    facets = domain_facets(graph.cells(node), graph.solid, box)
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(facet.triangles for facet in facets)])
    decimals = _decimals(float(np.linalg.norm(box[1] - box[0])))
    corners, index = np.unique(
        triangles.reshape(-1, 3).round(decimals) + 0.0, axis=0, return_inverse=True
    )
    index = index.reshape(-1, 3)
    return {
        **{name: corners[:, i].round(decimals).tolist() for i, name in enumerate("xyz")},
        **{name: index[:, i].tolist() for i, name in enumerate("ijk")},
    }


def _text(plan: InspectionPlan, graph: EntityAspectGraph, node: int, shown: _Shown) -> str:
    """Say what is seen from a domain, how large it is, and what the plan has to do with it."""
    data = graph.graph.nodes[node]
    listed = data[graph.regions.listed_as]
    names = ", ".join(listed) if listed else "no target"
    place = ", ".join(f"{c:.4g}" for c in data["viewpoint"])
    wall = " and reaches the wall of the workspace" if data["unbounded"] else ""
    text = (
        f"Domain {node} sees {len(listed)} of {len(graph.entity_names)}: {names}. It has {_volume(data['volume'])}"
        f"{wall}. Its widest point is ({place}) mm, {data['clearance']:.3g} mm from its nearest side."
    )
    inside = shown.standing.get(node, [])
    if inside:
        text += f" Camera{'s' if len(inside) > 1 else ''} in it: {_numbers(inside)}."
    others = [k for k in shown.covering.get(node, []) if k not in inside]
    if not others:
        return text
    several = "settings" if len(others) > 1 else "setting"
    return f"{text} All targets of {several} {_numbers(others)} are visible from here."


def _volume(mm3: float) -> str:
    for unit, size in (("m³", 1e9), ("dm³", 1e6), ("cm³", 1e3)):
        if mm3 >= size:
            return f"{mm3 / size:.3g} {unit}"
    return f"{mm3:.3g} mm³"


def _numbers(settings: Sequence[int]) -> str:
    return ", ".join(str(k + 1) for k in settings)


def _color(shown: _Shown, node: int, colors: Sequence[str]) -> str:
    k = shown.setting(node)
    return _PLAIN if k is None else colors[k]


class _Circle(NamedTuple):
    """A domain in the picture, and the numbers of the cameras in it."""

    node: int
    x: float
    y: float
    radius: float
    color: str
    title: str
    cameras: str


def _svg(graph: EntityAspectGraph, shown: _Shown, colors: Sequence[str]) -> Markup:
    drawn = graph.graph.subgraph(shown.nodes)
    places = _places(drawn)
    radius = _radii(drawn)
    circles = []
    # small ones are not covered by large ones
    for node in sorted(shown.nodes, key=lambda node: (-radius[node], node)):
        x, y = places[node]
        cameras = _numbers(shown.standing.get(node, []))
        room = 5 + 2.6 * len(cameras) if cameras else 0.0
        listed = ", ".join(graph.graph.nodes[node][graph.regions.listed_as])
        title = f"domain {node}: {listed or 'nothing'}"
        color = _color(shown, node, colors)
        circles.append(_Circle(node, x, y, max(radius[node], room), color, title, cameras))
    return render(
        "planner",
        "report/templates/graph.svg",
        size=(_WIDTH, _HEIGHT),
        lines=[(places[a], places[b]) for a, b in sorted(map(sorted, drawn.edges))],
        circles=circles,
    )


def _places(drawn: nx.Graph) -> dict[int, NDArray[np.float64]]:
    """Return where the circles are in the picture, y down, filling it."""
    if not len(drawn):
        return {}
    layout_places = layout(drawn)
    points = np.array([layout_places[node] for node in drawn]) * [1, -1]
    low = points.min(axis=0)
    size = np.ptp(points, axis=0)
    share = np.where(size > 1e-9, (points - low) / np.where(size > 1e-9, size, 1.0), 0.5)
    return dict(zip(drawn, _AIR + share * (np.array([_WIDTH, _HEIGHT]) - 2 * _AIR), strict=True))


def _radii(drawn: nx.Graph) -> dict[int, float]:
    """Return radii that grow with the logarithm of the volume."""
    logs = {node: math.log(max(volume, 1e-300)) for node, volume in drawn.nodes(data="volume")}
    low = min(logs.values(), default=0.0)
    span = max(np.ptp(list(logs.values())), 1e-9) if logs else 1.0
    return {
        node: _RADII[0] + (_RADII[1] - _RADII[0]) * (value - low) / span
        for node, value in logs.items()
    }


# The robot at each setting as an interactive 3-D figure (plotly): one slider, no moves in
# between.


# a part of more triangles is drawn as its convex hull: the figure shows the arm
_MOST_TRIANGLES = 4000
_ARM = "#e0862b"
_CAMERA = "#26547c"
_PART = "#9aa7b5"
_LIGHT = "#f2d13c"
_OBSTACLE = "#cfd3d8"
_TEXT = "#1f2733"


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
        meshes = _traces(shapes, visible=number == 0)
        traces += meshes
        shown += [{number}] * len(meshes)
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
    return figure_html(arm_figure(stands, solid, cell), "arm3d", "560px")


def _slider(stands: Sequence[Stand], shown: Sequence[set[int]]) -> dict[str, Any]:
    steps = [
        {
            "label": f"{stand.label}, {stand.fixturing}",
            "method": "restyle",
            "args": [{"visible": [number in places for places in shown]}],
        }
        for number, stand in enumerate(stands)
    ]
    # labels below the ticks would overlap, so only the current one above the slider is shown
    return {
        "active": 0,
        "steps": steps,
        "pad": {"t": 10},
        "font": {"color": "rgba(0, 0, 0, 0)"},
        "currentvalue": {"font": {"color": _TEXT}},
    }


def _traces(
    shapes: Sequence[tuple[str, bool, np.ndarray, np.ndarray]], *, visible: bool
) -> list[Any]:
    """Return the arm, the camera, the light and the obstacles as one mesh each."""
    groups: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for name, is_moving, corners, triangles in shapes:
        if name == "part":
            continue
        others = "robot" if is_moving else "obstacles"
        group = name if name in ("camera", "light") else others
        groups.setdefault(group, []).append(_coarse(corners, triangles))
    colors = {"robot": _ARM, "camera": _CAMERA, "light": _LIGHT, "obstacles": _OBSTACLE}
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
    used, triangles = np.unique(ConvexHull(points).simplices, return_inverse=True)
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
