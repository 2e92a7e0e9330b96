"""Pictures of a part with the ids of its edges, rims and arcs: a PNG of four views, or an HTML page to turn about."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.exceptions import EntityError, MissingExtraError, PictureError
from aspectgraph.files import replacing
from aspectgraph.plot.hidden_lines import ParallelView, view_axes
from aspectgraph.plot.style import is_feature
from aspectgraph.plot.traces import line_trace, part_traces, scene_figure, xyz
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from plotly.graph_objects import Figure, Scatter3d

VIEWS = {
    "from the right, front and above": (0.6, -0.8, 0.7),
    "from the left, back and above": (-0.6, 0.8, 0.7),
    "from the right, back and below": (0.6, 0.8, -0.7),
    "from the left, front and below": (-0.6, -0.8, -0.7),
}
"""The four views of the PNG: name and direction from the part towards the viewer."""

_PALETTE = ("#c0392b", "#1f618d", "#1e8449", "#af601a", "#6c3483", "#117a65", "#b7950b", "#2e4053")
_SAMPLES = np.linspace(0.01, 0.99, 50)
_FONT_PT = 8.0
# places for a label around an edge's middle, near ones first, in font sizes
_AROUND = np.array([(r * np.cos(a), r * np.sin(a)) for r in range(2, 16) for a in np.arange(0, 2 * np.pi, np.pi / 12)])


class _Item(NamedTuple):
    """What is named in a picture: its id, its polyline (k, 3), its edges, and what is said of it."""

    id: str
    line: np.ndarray
    edge_ids: tuple[int, ...]
    text: str


def write_edge_picture(
    solid: Solid,
    path: str | Path,
    edge_ids: Iterable[int] | None = None,
    curve_ids: Iterable[str] | None = None,
) -> Path:
    """Draw a part with the ids of its edges, rims and arcs; the file appears whole or not at all.

    Parameters
    ----------
    solid : Solid
        The part.
    path : str or Path
        Ends in .png (needs matplotlib) or .html (opens offline).
    edge_ids : iterable of int, optional
        The edges to name. Default: all of ``solid.straight_edges()``.
    curve_ids : iterable of str, optional
        The rims and arcs to name. Default: all of ``solid.rims()`` and ``solid.arcs()``, but none if `edge_ids` are
        chosen.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    PictureError
        The path ends otherwise.
    EntityError
        There is no such edge, rim or arc.
    MissingExtraError
        matplotlib is not installed.
    OutputError
        The folder does not exist, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".png", ".html"):
        raise PictureError(f"path of a picture must end in .png or .html. Got {str(path)!r}.")
    with replacing(path) as beside:
        if suffix == ".html":
            edge_figure(solid, edge_ids, curve_ids).write_html(beside, include_plotlyjs=True)
        else:
            _write_png(solid, beside, edge_ids, curve_ids)
    return path


def edge_figure(solid: Solid, edge_ids: Iterable[int] | None = None, curve_ids: Iterable[str] | None = None) -> Figure:
    """Return an interactive 3-D picture; pointing at an edge shows its id, length, angle and ends.

    Pointing at a rim or arc shows its id, diameter or radius, centre and axis.

    Parameters
    ----------
    solid : Solid
        The part.
    edge_ids : iterable of int, optional
        The edges to name. Default: all of ``solid.straight_edges()``.
    curve_ids : iterable of str, optional
        The rims and arcs to name. Default: all of ``solid.rims()`` and ``solid.arcs()``, but none if `edge_ids` are
        chosen.

    Returns
    -------
    plotly.graph_objects.Figure
        The part, the named edges and their ids.

    Raises
    ------
    EntityError
        There is no such edge, rim or arc.
    """
    import plotly.graph_objects as go

    items = _items(solid, edge_ids, curve_ids)
    lines = [_line(item, n) for n, item in enumerate(items)]
    labels = go.Scatter3d(
        **xyz([_middle(item) for item in items]),
        mode="text",
        text=[item.id for item in items],
        hoverinfo="skip",
        name="ids",
    )
    figure = scene_figure([*part_traces(solid), *lines, labels], next(iter(VIEWS.values())), title=_title(solid, items))
    return figure.update_layout(showlegend=False)


def _title(solid: Solid, items: list[_Item]) -> str:
    n_rims, n_arcs = (sum(item.id.startswith(letter) for item in items) for letter in "ra")
    curves = f", {n_rims} rims, {n_arcs} arcs" if n_rims + n_arcs else ""
    return f"{solid.name}: {len(items) - n_rims - n_arcs} straight edges{curves}"


def _line(item: _Item, n: int) -> Scatter3d:
    points = np.linspace(item.line[0], item.line[1], 9) if len(item.line) == 2 else item.line
    name = f"edge {item.id}" if item.id.isdecimal() else item.id
    text = item.text + "<extra></extra>"
    return line_trace([points], color=_PALETTE[n % len(_PALETTE)], width=6, name=name, hovertemplate=text)


def _middle(item: _Item) -> np.ndarray:
    """Return where the label of a line goes: the middle of an edge, a vertex in the middle of a chain of chords."""
    return item.line.mean(axis=0) if len(item.line) == 2 else item.line[len(item.line) // 2]


def _items(solid: Solid, edge_ids: Iterable[int] | None, curve_ids: Iterable[str] | None) -> list[_Item]:
    """Return what shall be named, edges first."""
    curves = {curve.id: curve for curve in (*solid.rims(), *solid.arcs())}
    if curve_ids is None:
        curve_ids = list(curves) if edge_ids is None else []
    chosen = list(curve_ids)
    bad = [name for name in chosen if name not in curves]
    if bad:
        raise EntityError(
            f"a curve id must be that of a rim or arc, {', '.join(curves) or 'none here'}. Got {bad[0]!r}."
        )
    edges = [_edge_item(solid, edge_id) for edge_id in _checked_ids(solid, edge_ids)]
    return edges + [_curve_item(solid, curves[name]) for name in chosen]


def _edge_item(solid: Solid, edge_id: int) -> _Item:
    line = solid.edge_points(edge_id)
    text = (
        f"edge {edge_id}<br>length {solid.edge_length_mm(edge_id):.6g} mm<br>"
        f"angle {solid.edges[edge_id].dihedral_deg:.4g}°<br>{_point(line[0])} to {_point(line[1])}<br>"
        f"ends: {', '.join(end.text for end in solid.edge_ends(edge_id))}"
    )
    return _Item(str(edge_id), line, (edge_id,), text)


def _curve_item(solid: Solid, curve: Arc) -> _Item:
    closed = isinstance(curve, Rim)
    line = solid.vertices[list(curve.vertices + curve.vertices[:1] if closed else curve.vertices)]
    size = f"diameter {2 * curve.radius_mm:.6g}" if closed else f"radius {curve.radius_mm:.6g}"
    text = (
        f"{'rim' if closed else 'arc'} {curve.id}<br>{size} mm<br>centre {_point(curve.centre)}<br>"
        f"axis {_point(curve.axis)}"
    )
    return _Item(curve.id, line, curve.edge_ids, text)


def _point(point: np.ndarray) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in point) + ")"


def _checked_ids(solid: Solid, edge_ids: Iterable[int] | None) -> list[int]:
    if edge_ids is None:
        return [edge.id for edge in solid.straight_edges()]
    ids = [int(edge_id) for edge_id in edge_ids]
    bad = [edge_id for edge_id in ids if not 0 <= edge_id < len(solid.edges)]
    if bad:
        raise EntityError(f"an edge id must be in 0..{len(solid.edges) - 1}. Got {bad[0]}.")
    return ids


def _write_png(solid: Solid, path: Path, edge_ids: Iterable[int] | None, curve_ids: Iterable[str] | None) -> None:
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError(
            f"PNG pictures need the package matplotlib. Got {error}; install it with: pip install aspectgraph[plot]"
        ) from error
    items = _items(solid, edge_ids, curve_ids)
    figure = Figure(figsize=(22, 17), dpi=100)
    FigureCanvasAgg(figure)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.94, wspace=0.02, hspace=0.05)
    for ax, (title, direction) in zip(figure.subplots(2, 2).ravel(), VIEWS.items(), strict=True):
        _draw_items(solid, items, direction, ax)
        ax.set_title(title)
    curves = "" if all(item.id.isdecimal() for item in items) else ", rims, arcs"
    figure.suptitle(f"{solid.name}: straight edges{curves} and their ids", fontsize=16)
    figure.savefig(path, format="png", dpi="figure")


def draw_edges(
    solid: Solid,
    edge_ids: Iterable[int] | None,
    direction: ArrayLike,
    *,
    ax: Axes,
    curve_ids: Iterable[str] | None = None,
) -> Axes:
    """Draw one parallel view with the ids of the edges, rims and arcs seen in it.

    Parameters
    ----------
    solid : Solid
        The part.
    edge_ids : iterable of int or None
        The edges to name; None: all of ``solid.straight_edges()``.
    direction : array_like, shape (3,)
        From the part towards the viewer.
    ax : matplotlib Axes
        Where to draw.
    curve_ids : iterable of str, optional
        The rims and arcs to name. Default: as for `edge_figure`.

    Returns
    -------
    Axes
        `ax`.
    """
    return _draw_items(solid, _items(solid, edge_ids, curve_ids), direction, ax)


def _draw_items(solid: Solid, items: list[_Item], direction: ArrayLike, ax: Axes) -> Axes:
    from matplotlib.collections import LineCollection

    axes = view_axes(direction)
    points = solid.vertices @ axes.T
    front = solid.normals[solid.triangle_face] @ axes[2]
    towards = np.flatnonzero(front > 1e-9)
    view = ParallelView(points[solid.triangles[towards]])
    image, extent = view.render(0.62 + 0.33 * front[towards])
    ax.imshow(image, cmap="gray", vmin=0.0, vmax=1.0, extent=extent, origin="lower", interpolation="nearest")
    _draw_outlines(solid, points, view, {e for item in items for e in item.edge_ids}, ax)
    spots = []
    for n, item in enumerate(items):
        samples = _sampled(item.line @ axes.T)
        seen = view.is_seen(samples)
        pieces = _seen_pieces(samples, seen)
        if pieces:
            colour = _PALETTE[n % len(_PALETTE)]
            ax.add_collection(LineCollection(pieces, colors=colour, linewidths=2.0))
            spots.append((item.id, colour, samples[seen][:, :2]))
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.set_axis_off()
    _place_labels(spots, ax)
    return ax


def _sampled(run: np.ndarray) -> np.ndarray:
    """Return points along a polyline (k, 3): of an edge a little inside its ends, of a chain four to a chord."""
    if len(run) == 2:
        return run[0] + _SAMPLES[:, None] * (run[1] - run[0])
    share = np.arange(4)[:, None] / 4.0
    return np.vstack([*(a + share * (b - a) for a, b in pairwise(run)), run[-1]])


def _seen_pieces(samples: np.ndarray, seen: np.ndarray) -> list[np.ndarray]:
    """Return the stretches of an edge between samples that are both seen, shape (2, 2) each."""
    both = seen[:-1] & seen[1:]
    return [samples[k : k + 2, :2] for k in np.flatnonzero(both)]


def _draw_outlines(solid: Solid, points: np.ndarray, view: ParallelView, named: set[int], ax: Axes) -> None:
    """Draw the feature edges that are not named, where seen at their middle, in grey."""
    from matplotlib.collections import LineCollection

    rest = [e for e in solid.edges if e.id not in named and is_feature(solid, e)]
    if rest:
        runs = points[np.array([e.vertices for e in rest])]
        seen = view.is_seen(runs.mean(axis=1))
        ax.add_collection(LineCollection(runs[seen][:, :, :2], colors="dimgrey", linewidths=0.6))


def _place_labels(spots: list[tuple[str, str, np.ndarray]], ax: Axes) -> None:
    """Write each id where it covers no other: on its edge, else beside it with a line to the edge's middle.

    The shortest edges come first, for they have the fewest places.
    """
    low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
    figure: Any = ax.figure
    size_pt = 72.0 * np.array(ax.get_position().size) * figure.get_size_inches()
    unit_per_pt = float(((high - low) / size_pt).max())
    box = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
    taken = np.empty((0, 4))
    for edge_id, colour, samples in sorted(spots, key=lambda spot: float(np.ptp(spot[2], axis=0).max())):
        room = unit_per_pt * _FONT_PT * np.array([0.65 * len(edge_id) + 0.35, 1.35])
        middle = samples[len(samples) // 2]
        on_edge = samples[np.argsort(np.abs(np.arange(len(samples)) - len(samples) // 2), kind="stable")]
        places = np.vstack([on_edge, middle + unit_per_pt * _FONT_PT * _AROUND])
        gaps = np.abs(places[:, None] - taken[:, :2]) - (room + taken[:, 2:]) / 2
        free = np.all((gaps > 0).any(axis=2), axis=1)
        k = int(np.argmax(free))
        x, y = places[k]
        taken = np.vstack([taken, [x, y, *room]])
        if k >= len(on_edge):
            ax.plot(*zip(middle, (x, y), strict=True), color=colour, linewidth=0.6)
        ax.text(x, y, edge_id, color=colour, fontsize=_FONT_PT, ha="center", va="center", bbox=box)
