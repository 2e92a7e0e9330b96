"""The aspect graph as a picture beside the plan in 3-D: viewing domains to click on, and the surface of each.

Of a large graph the domains that matter most to the plan are drawn, never more than `MOST_DOMAINS`.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from aspectgraph.plot.graph_plot import layout
from aspectgraph.plot.traces import domain_facets, scene_figure
from ground.templates import render
from planner.progress import TimeLeft, report
from planner.report.figure import figure_html
from planner.request.targets import targets_of

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from markupsafe import Markup

    from aspectgraph import EntityAspectGraph, Solid
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.robotcell import Cell
    from planner.sensor_setting import SensorSetting


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
    decimals = _DIGITS - math.floor(math.log10(float(np.linalg.norm(box[1] - box[0]))))
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
