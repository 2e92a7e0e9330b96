"""Facets and lines of parts and cells, as traces of 3-D figures."""

from __future__ import annotations

import colorsys
import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import networkx as nx
import numpy as np
import shapely
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import Cell
from aspectgraph.exceptions import MissingExtraError, WorkspaceError, how_to_install
from aspectgraph.solid.rims import CURVED_FEATURE_DEG, FEATURE_DEG
from aspectgraph.solid.solid import Solid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from plotly.graph_objects import Figure, Mesh3d, Scatter3d

    from aspectgraph.solid.rims import Arc
    from aspectgraph.solid.topology import Edge

# Cut convex cells and viewing domains down to a window or a box, for pictures only: in doubles.


# heights over a plane and parts of a normal below this are rounding
_ON = 1e-9
# grid on which polygons are united, as a share of the size
_SNAP = 1e-7
# largest lack to 1 of the cosine between parallel normals
_PARALLEL = 1e-10
# bounds the memory that cells of many sides take
_CELLS_AT_ONCE = 256
# a half-space that holds every point
_EVERYTHING = np.array([0.0, 0.0, 0.0, -1.0])


class Facet(NamedTuple):
    """A planar piece of a domain's surface.

    Attributes
    ----------
    outlines : list of ndarray, shape (n, 3)
        Closed rings.
    triangles : ndarray, shape (t, 3, 3)
    """

    outlines: list[np.ndarray]
    triangles: np.ndarray


def clip_polygons(polygons: np.ndarray, half_spaces: np.ndarray) -> list[np.ndarray]:
    """Cut convex polygons down to half-spaces of their own (Sutherland and Hodgman 1974).

    Parameters
    ----------
    polygons : ndarray, shape (f, n, d)
        Corners of each, in order; d is 2 or 3.
    half_spaces : ndarray, shape (f, k, d + 1)
        Rows (a, b) of each polygon with a·x + b <= 0 inside.

    Returns
    -------
    list of ndarray, shape (m, d)
        One per polygon, without rows if nothing is left.
    """
    # a polygon with fewer corners than others repeats its first one, which also closes it
    corners = np.array(polygons, float)
    n = np.full(len(corners), corners.shape[1])
    for row in np.moveaxis(half_spaces, 1, 0):
        height = _heights(corners, row)
        cut = np.flatnonzero((n > 0) & (height > 0).any(axis=1))
        if not len(cut):
            continue
        pieces, n[cut] = _clip_once(corners[cut], n[cut], height[cut])
        missing = pieces.shape[1] - corners.shape[1]
        if missing > 0:
            corners = np.concatenate([corners, corners[:, :1].repeat(missing, axis=1)], axis=1)
        corners[cut, : pieces.shape[1]] = pieces
        corners[cut, pieces.shape[1] :] = pieces[:, :1]
    return [polygon[:count] for polygon, count in zip(corners, n.tolist(), strict=True)]


def _heights(corners: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the heights (f, n) of corners over a plane per polygon; 0 where they are rounding."""
    height = (corners @ row[:, :-1, None])[..., 0] + row[:, None, -1]
    height[np.abs(height) < _ON] = 0.0
    return height


def _clip_once(
    corners: np.ndarray, n: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons with n corners each at height 0; return their new corners and numbers."""
    after = np.roll(corners, -1, axis=1)
    height_after = np.roll(height, -1, axis=1)
    crossed = height * height_after < 0
    share = np.where(crossed, height / np.where(crossed, height - height_after, 1.0), 0.0)
    size, width, d = corners.shape
    both = np.empty((size, 2 * width, d))
    inside = np.empty((size, 2 * width), bool)
    both[:, ::2] = corners
    both[:, 1::2] = corners + share[..., None] * (after - corners)
    inside[:, ::2] = (height <= 0) & (np.arange(width) < n[:, None])
    inside[:, 1::2] = crossed
    n_left = inside.sum(axis=1)
    order = np.argsort(~inside, axis=1, kind="stable")[:, : max(n_left.max(), 1)]
    polygons = np.take_along_axis(both, order[..., None], axis=1)
    missing = np.arange(polygons.shape[1]) >= n_left[:, None]
    return np.where(missing[..., None], polygons[:, :1], polygons), n_left


def _stacked(half_spaces: Sequence[np.ndarray]) -> np.ndarray:
    """Return sets of half-spaces as one array (f, k, d + 1), filled up with some that hold all."""
    n_rows = max(map(len, half_spaces))
    everything = np.zeros(half_spaces[0].shape[1])
    everything[-1] = -1.0
    rows = np.tile(everything, (len(half_spaces), n_rows, 1))
    for k, sides in enumerate(half_spaces):
        rows[k, : len(sides)] = sides
    return rows


def box_half_spaces(box: np.ndarray) -> np.ndarray:
    """Rows (a, b) with a·x + b <= 0 inside a box given by its two corners, shape (2 d, d + 1)."""
    low, high = np.asarray(box, float)
    unit = np.eye(len(low))
    return np.vstack([np.column_stack([unit, -high]), np.column_stack([-unit, low])])


def clipped_facets(
    cells: Sequence[np.ndarray], box: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the facets of convex cells cut down to a box.

    Parameters
    ----------
    cells : sequence of ndarray, shape (k, 4)
        Half-spaces of each cell.
    box : ndarray, shape (2, 3)

    Returns
    -------
    list of tuple of ndarray
        The half-space (4,) that a facet lies on, and its corners (n, 3).
    """
    return [
        facet
        for start in range(0, len(cells), _CELLS_AT_ONCE)
        for facet in _some_facets(cells[start : start + _CELLS_AT_ONCE], box)
    ]


def _some_facets(
    cells: Sequence[np.ndarray], box: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the facets of so few cells that they are cut down together."""
    sides = box_half_spaces(box)
    all_rows = _stacked([np.vstack([cell, sides]) for cell in cells])
    n_rows = [len(cell) + len(sides) for cell in cells]
    cell = np.repeat(np.arange(len(cells)), n_rows)
    on = np.concatenate([np.arange(count) for count in n_rows])
    row = all_rows[cell, on]
    others = all_rows[cell]
    # a facet lies on its own half-space, which must not cut it
    others[np.arange(len(on)), on] = _EVERYTHING
    corners = clip_polygons(_squares(row, box), others)
    return [(plane, facet) for plane, facet in zip(row, corners, strict=True) if len(facet) > 2]


def _squares(rows: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return squares (f, 4, 3) in planes (f, 4), each larger than the box."""
    centre = box.mean(axis=0)
    reach = 2.0 * float(np.linalg.norm(np.ptp(box, axis=0)))
    axes = np.array([plane_axes(row[:3]) for row in rows])
    u = axes[:, 0]
    v = axes[:, 1]
    foot = centre - (rows[:, :3] @ centre + rows[:, 3])[:, None] * rows[:, :3]
    return foot[:, None] + reach * np.stack([-u - v, u - v, u + v, v - u], axis=1)


def plane_axes(normal: np.ndarray) -> np.ndarray:
    """Return two orthonormal vectors in the plane with a normal, shape (2, 3)."""
    a, b, c = np.asarray(normal, float) / np.linalg.norm(normal)
    # the cross product with the axis that is farthest from the normal, written out for speed
    u = ((0.0, c, -b), (-c, 0.0, a), (b, -a, 0.0))[int(np.argmin(np.abs((a, b, c))))]
    x, y, z = np.array(u) / np.linalg.norm(u)
    return np.array([(x, y, z), (b * z - c * y, c * x - a * z, a * y - b * x)])


def domain_facets(cells: Iterable[Cell], solid: Solid, box: np.ndarray) -> list[Facet]:
    """Return the surface of a union of cells inside a box, without walls between cells and on the solid.

    Parameters
    ----------
    cells : iterable of Cell
    solid : Solid
    box : ndarray, shape (2, 3)

    Returns
    -------
    list of Facet
    """
    size = float(np.ptp(box, axis=0).max())
    grid = _SNAP * size
    if solid not in _PLANES:
        _PLANES[solid] = _FacePlanes(solid)
    planes = _PLANES[solid]
    facets = []
    for key, (behind, before) in _sides(cells, box).items():
        wall = polygon_union(behind, grid).symmetric_difference(
            polygon_union(before, grid), grid_size=grid
        )
        wall = shapely.MultiPolygon(polygon_parts(wall))
        wall = wall.difference(planes.union(key, size), grid_size=grid)
        facets += [
            _lifted(part, key) for part in polygon_parts(wall) if part.area > (1e-4 * size) ** 2
        ]
    return facets


def _sides(
    cells: Iterable[Cell], box: np.ndarray
) -> dict[tuple[float, ...], tuple[list[Any], list[Any]]]:
    """Return the facets of cells by their plane, in its axes: those behind it and those before."""
    sides: dict[tuple[float, ...], tuple[list[Any], list[Any]]] = {}
    axes: dict[tuple[float, ...], np.ndarray] = {}
    for row, corners in clipped_facets([cell.half_spaces for cell in cells], box):
        key, sign = _plane_key(row)
        if key not in sides:
            sides[key] = ([], [])
            axes[key] = plane_axes(np.array(key[:3])).T
        sides[key][sign].append(corners @ axes[key])
    return {key: (_polygons(behind), _polygons(before)) for key, (behind, before) in sides.items()}


def _polygons(rings: Sequence[np.ndarray]) -> list[Any]:
    """Return rings (n, 2) as polygons."""
    if not rings:
        return []
    index = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    return list(shapely.polygons(shapely.linearrings(np.concatenate(rings), indices=index)))


def section_polygons(
    cells: Iterable[Cell], axis: int, at: float, window: np.ndarray
) -> list[np.ndarray]:
    """Cut cells by the plane on which one coordinate has a value.

    Parameters
    ----------
    cells : iterable of Cell
    axis : int
        The coordinate.
    at : float
        Its value, mm.
    window : ndarray, shape (2, 2)
        What is kept of the plane.

    Returns
    -------
    list of ndarray, shape (n, 2)
        The corners of each cell's section; none of a cell that the plane misses.
    """
    u, v = section_axes(axis)
    rows = [
        np.column_stack(
            [cell.half_spaces[:, [u, v]], cell.half_spaces[:, axis] * at + cell.half_spaces[:, 3]]
        )
        for cell in cells
    ]
    if not rows:
        return []
    (x0, y0), (x1, y1) = window
    squares = np.tile(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float), (len(rows), 1, 1))
    return clip_polygons(squares, _stacked(rows))


def section_axes(axis: int) -> tuple[int, int]:
    """Return the coordinates drawn to the right and upwards in a section."""
    return ((1, 2), (0, 2), (0, 1))[axis]


def box_around(
    solid: Solid, workspace: np.ndarray, box: ArrayLike | None = None, margin: float = 0.6
) -> np.ndarray:
    """Return a box inside the workspace, the given one or one around the part; shape (2, 3).

    Raises
    ------
    WorkspaceError
        If the box is none, or has no room in common with the workspace.
    """
    if box is None:
        room = margin * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
        box = solid.bounds + np.array([[-room], [room]])
    corners = np.asarray(box, float)
    if corners.shape != (2, 3) or not np.isfinite(corners).all():
        raise WorkspaceError(
            f"box must be two finite corners, shape (2, 3). Got {np.asarray(box).tolist()}."
        )
    corners = np.array([np.maximum(corners[0], workspace[0]), np.minimum(corners[1], workspace[1])])
    if (corners[0] >= corners[1]).any():
        raise WorkspaceError(
            f"box must overlap the workspace, lower corner first. Got {np.asarray(box).tolist()}."
        )
    return corners


def _plane_key(row: np.ndarray) -> tuple[tuple[float, ...], int]:
    """Name a plane by its rounded coefficients, and say on which side of it the half-space lies."""
    sign = 1 if row[np.argmax(np.abs(row[:3]) > _ON)] > 0 else -1
    return tuple((np.round(sign * row, 9) + 0.0).tolist()), (sign + 1) // 2


def polygon_union(polygons: list[Any], grid: float) -> shapely.Geometry:
    """Return the union of polygons on a grid, without the lines that the thinnest of them collapse to there."""
    return shapely.MultiPolygon(polygon_parts(shapely.union_all(polygons, grid_size=grid)))


def polygon_parts(geometry: shapely.Geometry) -> list[Any]:
    """Return the polygons in a geometry."""
    return [
        part
        for part in getattr(geometry, "geoms", [geometry])
        if part.geom_type == "Polygon" and not part.is_empty
    ]


class _FacePlanes:
    """The solid's faces by the plane they lie in: each union is made once, for all domains.

    Parameters
    ----------
    solid : Solid
    """

    def __init__(self, solid: Solid) -> None:
        # no reference to the solid, which is a weak key of these
        self._normals = solid.normals
        self._first = solid.vertices[[face.outer[0] for face in solid.faces]]
        self._corners = [solid.vertices[triangles] for triangles in solid.face_triangles]
        self._unions: dict[tuple[tuple[float, ...], float], shapely.Geometry] = {}

    def union(self, key: tuple[float, ...], size: float) -> shapely.Geometry:
        """Return the union of the faces in a plane, in the plane's axes."""
        if (key, size) not in self._unions:
            self._unions[key, size] = self._united(key, size)
        return self._unions[key, size]

    def _united(self, key: tuple[float, ...], size: float) -> shapely.Geometry:
        normal = np.array(key[:3])
        height = np.abs(self._first @ normal + key[3])
        parallel = np.abs(np.abs(self._normals @ normal) - 1.0) < _PARALLEL
        in_plane = np.flatnonzero(parallel & (height < 10 * _SNAP * size))
        if not len(in_plane):
            return shapely.MultiPolygon()
        corners = np.concatenate([self._corners[face] for face in in_plane])
        return polygon_union(_polygons(list(corners @ plane_axes(normal).T)), _SNAP * size)


_PLANES: WeakKeyDictionary[Solid, _FacePlanes] = WeakKeyDictionary()


def _lifted(polygon: shapely.Polygon, key: tuple[float, ...]) -> Facet:
    normal = np.array(key[:3])
    axes = plane_axes(normal)
    foot = -key[3] * normal / (normal @ normal)

    def lift(ring: Any) -> Any:
        return foot + np.asarray(ring.coords)[:, :2] @ axes

    pieces = shapely.constrained_delaunay_triangles(polygon)
    triangles = [lift(piece.exterior)[:3] for piece in pieces.geoms]
    return Facet(
        [lift(ring) for ring in (polygon.exterior, *polygon.interiors)],
        np.array(triangles).reshape(-1, 3, 3),
    )


# What interactive 3-D pictures are made of (plotly): the part, polylines, surfaces, and the scene
# around them.


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
    from aspectgraph.plot.still import Figure as StillFigure

    axis = {
        "backgroundcolor": "#ffffff",
        "gridcolor": "#e6e9ee",
        "zeroline": False,
        "color": "#6b7480",
    }
    scene = {f"{name}axis": {**axis, "title": {"text": f"{name} (mm)"}} for name in "xyz"}
    figure = StillFigure(traces)
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
