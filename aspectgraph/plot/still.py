"""Figures in 3-D that also have a still picture: pages that notebooks are exported to draw no plotly."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go
import plotly.io as pio
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw
from scipy.ndimage import maximum_filter

from aspectgraph.solid.solid import PLOTLY, RayScene

Array = NDArray[np.float64]

PNG = "image/png"
SIZE_PX = (760, 480)
"""Width and height of a still picture."""
# rays for each pixel and side: edges of faces look smooth
_FINER = 2
# plotly's cameras see so much of the height, degrees
_FIELD_DEG = 45.0
# a view without perspective is so much wider than what it shows
_AIR = 1.08
# a line on a face is in front of it by rounding, as a share of the depth
_ON_FACE = 0.004
# steps of a line that may be hidden one by one, pixels
_STEP_PX = 3.0
# lines of plotly are drawn as wide, and what is thinner vanishes when the picture is made small
_LEAST_WIDTH = 1.0


class Figure(go.Figure):  # type: ignore[misc, unused-ignore]
    """A figure of plotly that shows a still picture where a page knows no plotly."""

    def _repr_mimebundle_(self, *args: Any, **options: Any) -> dict[str, Any]:
        bundle: dict[str, Any] = dict(super()._repr_mimebundle_(*args, **options) or {})
        if bundle.keys() == {PLOTLY}:
            bundle[PNG] = still_picture(self)
            bundle["text/plain"] = "A figure in 3-D"
        return bundle

    def _ipython_display_(self) -> None:
        bundle = self._repr_mimebundle_() if pio.renderers.render_on_display else {}
        if PNG not in bundle:
            # what the user has chosen to draw figures with
            super()._ipython_display_()
            return
        from IPython.display import display

        display(bundle, raw=True)  # type: ignore[no-untyped-call, unused-ignore]


def still_picture(figure: go.Figure) -> str:
    """Return what a figure shows at first, as PNG in base64: faces, lines and texts, without axes.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        Its traces are of type mesh3d or scatter3d.
    """
    traces = [trace.to_plotly_json() for trace in figure.data if trace.visible in (True, None)]
    view = _View.of(figure.layout.scene.to_plotly_json(), traces)
    width, height = (_FINER * n for n in SIZE_PX)
    shades = np.full((height, width, 3), 255.0)
    depths = np.full((height, width), np.inf)
    meshes = [trace for trace in traces if trace["type"] == "mesh3d"]
    # what shines through is laid over the others
    for trace in sorted(meshes, key=lambda trace: -trace.get("opacity", 1.0)):
        _draw_faces(trace, view, shades, depths)
    image = Image.fromarray(shades.round().astype(np.uint8))
    pen = ImageDraw.Draw(image)
    # the outline of a face lies half outside it
    depths = maximum_filter(depths, 2 * _FINER + 1)
    for trace in traces:
        if trace["type"] == "scatter3d":
            _draw_lines(trace, view, pen, depths)
            _draw_marks(trace, view, pen)
    file = io.BytesIO()
    image.resize(SIZE_PX, Image.Resampling.LANCZOS).save(file, "PNG", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


def _array(values: Any) -> NDArray[Any]:
    """Return the values of a property; plotly 6 packs those of arrays."""
    if not isinstance(values, dict):
        return np.asarray(values)
    return np.frombuffer(base64.b64decode(values["bdata"]), dtype=values["dtype"])


class _View(NamedTuple):
    """Plotly's box about the origin, and its camera: rows of `axes` are to the right, up and ahead."""

    middle: Array
    scale: Array
    eye: Array
    axes: Array
    distance: float
    parallel: bool

    @classmethod
    def of(cls, scene: dict[str, Any], traces: list[dict[str, Any]]) -> _View:
        points = np.vstack([_points(trace) for trace in traces])
        low = np.nanmin(points, axis=0)
        high = np.nanmax(points, axis=0)
        for k, name in enumerate("xyz"):
            low[k], high[k] = scene[f"{name}axis"].get("range") or (low[k], high[k])
        extent = np.maximum(high - low, 1e-9)
        # as aspectmode "data" does
        sides = extent / np.cbrt(extent.prod())
        if "aspectratio" in scene:
            sides = _vector(scene["aspectratio"])
        camera = scene["camera"]
        eye = _vector(camera["eye"])
        ahead = _vector(camera.get("center", {"x": 0.0, "y": 0.0, "z": 0.0})) - eye
        distance = float(np.linalg.norm(ahead))
        ahead /= distance
        right = np.cross(ahead, _vector(camera.get("up", {"x": 0.0, "y": 0.0, "z": 1.0})))
        right /= np.linalg.norm(right)
        axes = np.array([right, np.cross(right, ahead), ahead])
        view = cls((low + high) / 2, sides / extent, eye, axes, distance, parallel=False)
        if camera.get("projection", {}).get("type") != "orthographic":
            return view
        # without perspective a view has no natural size: all of it fits, seen from outside the box
        center = eye + distance * ahead
        x, y, _ = np.abs((view.boxed(points) - center) @ axes.T).T
        width, height = SIZE_PX
        reach = max(np.nanmax(y), np.nanmax(x) * height / width)
        distance = _AIR * reach / np.tan(np.radians(_FIELD_DEG / 2))
        away = float(np.linalg.norm(sides)) + distance
        return view._replace(eye=center - away * ahead, distance=distance, parallel=True)

    def boxed(self, points: Array) -> Array:
        """Return points (n, 3) in plotly's box."""
        return (points - self.middle) * self.scale

    def seen(self, points: Array) -> Array:
        """Return columns, rows and depths (n, 3) of points (n, 3), in pixels and in lengths of the box."""
        x, y, depth = ((self.boxed(points) - self.eye) @ self.axes.T).T
        away = np.full_like(depth, self.distance) if self.parallel else np.maximum(depth, 1e-6)
        width, height = (_FINER * n for n in SIZE_PX)
        zoom = height / 2 / np.tan(np.radians(_FIELD_DEG / 2)) / away
        return np.column_stack([width / 2 + zoom * x, height / 2 - zoom * y, depth])

    def rays(self) -> tuple[Array, Array]:
        """Return where the rays of pixels (h, w, 3) start, and where they go; their unit is depth."""
        width, height = (_FINER * n for n in SIZE_PX)
        slope = np.tan(np.radians(_FIELD_DEG / 2)) / (height / 2)
        rows, columns = np.mgrid[:height, :width] + 0.5
        x = slope * (columns - width / 2)
        y = slope * (height / 2 - rows)
        aside = x[..., None] * self.axes[0] + y[..., None] * self.axes[1]
        if self.parallel:
            return self.eye + self.distance * aside, np.broadcast_to(self.axes[2], aside.shape)
        return np.broadcast_to(self.eye, aside.shape), aside + self.axes[2]


def _vector(values: dict[str, float]) -> Array:
    return np.array([values[name] for name in "xyz"], dtype=np.float64)


def _points(trace: dict[str, Any]) -> Array:
    return np.column_stack([_array(trace[name]).astype(np.float64) for name in "xyz"])


def _draw_faces(trace: dict[str, Any], view: _View, shades: Array, depths: Array) -> None:
    triangles = np.column_stack([_array(trace[name]) for name in "ijk"])
    if not len(triangles):
        return
    hits = RayScene(view.boxed(_points(trace)), triangles).cast(*view.rays())
    met = hits["t_hit"] < depths
    if "facecolor" in trace:
        colors = np.array([ImageColor.getrgb(text) for text in trace["facecolor"]], dtype=float)
        drawn = colors[hits["primitive_ids"][met]]
    else:
        drawn = np.array(ImageColor.getrgb(trace.get("color", "#c8d0da"))[:3], dtype=float)
    share = trace.get("opacity", 1.0)
    shades[met] = share * drawn + (1 - share) * shades[met]
    if share == 1.0:
        depths[met] = hits["t_hit"][met]


def _steps(line: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the ends of short steps along a line (n, 3) in the picture; not a number lifts the pen."""
    for start, end in pairwise(line):
        length = np.hypot(*(end - start)[:2])
        if not np.isfinite(length):
            continue
        n_steps = int(np.clip(length / (_FINER * _STEP_PX), 1, max(SIZE_PX)))
        points = start + np.linspace(0.0, 1.0, n_steps + 1)[:, None] * (end - start)
        yield from pairwise(points)


def _draw_lines(
    trace: dict[str, Any], view: _View, pen: ImageDraw.ImageDraw, depths: Array
) -> None:
    """Draw what is not behind faces of the lines of a trace."""
    if "lines" not in trace.get("mode", "lines"):
        return
    style = trace.get("line", {})
    width = round(_FINER * max(style.get("width", 2.0) / 2, _LEAST_WIDTH))
    height, breadth = depths.shape
    for n, (start, end) in enumerate(_steps(view.seen(_points(trace)))):
        column, row, depth = (start + end) / 2
        inside = 0 <= column < breadth and 0 <= row < height
        behind = inside and depth > depths[int(row), int(column)] + _ON_FACE * view.distance
        gap = style.get("dash", "solid") != "solid" and n % 4 > 1
        if not behind and not gap:
            pen.line([*start[:2], *end[:2]], fill=style.get("color", "#20262d"), width=width)


def _draw_marks(trace: dict[str, Any], view: _View, pen: ImageDraw.ImageDraw) -> None:
    """Draw markers and texts, which nothing hides."""
    mode = trace.get("mode", "lines")
    marker = trace.get("marker", {})
    radius = _FINER * marker.get("size", 6) / 2
    for n, (column, row, _) in enumerate(view.seen(_points(trace))):
        color = marker.get("color", "#20262d")
        color = color if isinstance(color, str) else color[n]
        if "markers" in mode:
            pen.ellipse([column - radius, row - radius, column + radius, row + radius], fill=color)
        if "text" in mode:
            size = _FINER * trace.get("textfont", {}).get("size", 12)
            above = (column, row - radius - size / 4)
            words = trace["text"] if isinstance(trace["text"], str) else trace["text"][n]
            pen.text(above, words, fill="#20262d", font_size=size, anchor="ms")
