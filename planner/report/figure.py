"""The interactive 3-D figure of a plan (plotly): the part, the entities, the cameras and where they may be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph.plot.clip import domain_facets
from aspectgraph.plot.traces import (
    line_trace,
    part_traces,
    point_text,
    scene_figure,
    surface_trace,
    xyz,
)
from errors.formatting import probability_text
from planner.progress.time_left import TimeLeft
from planner.report.outlines import polylines
from planner.report.views import EVERYTHING, SceneFrame, box_around, plan_views
from planner.request.target_space import TargetSpace

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from aspectgraph import Solid
    from planner.camera.camera import Camera
    from planner.light.light_plan import LightPlan
    from planner.plan import InspectionPlan
    from planner.request.space import Space
from planner.setting.sensor_setting import SensorSetting

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
            own = space.choosing(setting.witness) if isinstance(space, TargetSpace) else space
            facets = domain_facets(own.covering_cells(list(setting.entities)), solid, frame.box)
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
    left, top, right, bottom = camera.field().inner
    tangents = [[left, top, 1.0], [right, top, 1.0], [right, bottom, 1.0], [left, bottom, 1.0]]
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
            f"lamp at {point_text(place)} mm<br>{told}"
            for place, told in zip(light.lamps, shown, strict=True)
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
