"""Pictures of a part with the ids of its edges, rims and arcs: a PNG of four views, or an HTML page to pick from."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.exceptions import MissingExtraError, PictureError, how_to_install
from aspectgraph.files import replacing
from aspectgraph.plot.callouts import Spot, draw_labels
from aspectgraph.plot.hidden_lines import ParallelView, view_axes
from aspectgraph.plot.named_items import NamedItem, counts_text, named_items
from aspectgraph.plot.picker import picker_html
from aspectgraph.plot.style import is_feature
from aspectgraph.plot.traces import line_trace, part_traces, scene_figure, xyz
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


def write_edge_picture(
    solid: Solid,
    path: str | Path,
    edge_ids: Iterable[int] | None = None,
    curve_ids: Iterable[str] | None = None,
) -> Path:
    """Draw a part with the ids of its edges, rims and arcs, to a file.

    The file appears whole or not at all.

    Parameters
    ----------
    solid : Solid
        The part.
    path : str or Path
        Ends in .png (needs matplotlib) or .html (opens offline; collects entities for ``--entities``).
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
        The path has another ending.
    EntityError
        There is no such edge, rim or arc.
    MissingExtraError
        matplotlib is not installed.
    OutputError
        The folder does not exist, or the file cannot be written.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> import tempfile
    >>> from pathlib import Path
    >>> from aspectgraph import write_edge_picture
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_edge_picture(box, Path(folder) / "edges.html").name
    'edges.html'
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".png", ".html"):
        raise PictureError.of_rule("path", "must end in .png or .html", repr(str(path)))
    with replacing(path) as beside:
        if suffix == ".html":
            beside.write_text(picker_html(solid, edge_ids, curve_ids), encoding="utf-8")
        else:
            _write_png(solid, beside, edge_ids, curve_ids)
    return path


def edge_figure(
    solid: Solid, edge_ids: Iterable[int] | None = None, curve_ids: Iterable[str] | None = None
) -> Figure:
    """Return an interactive 3-D picture of a part with the ids of its edges.

    Pointing at an edge shows its id, length, angle and ends.

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

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import edge_figure
    >>> type(edge_figure(box)).__name__
    'Figure'
    """
    import plotly.graph_objects as go

    items = named_items(solid, edge_ids, curve_ids)
    lines = [_line(item, n) for n, item in enumerate(items)]
    labels = go.Scatter3d(
        **xyz([item.middle for item in items]),
        mode="text",
        text=[item.id for item in items],
        hoverinfo="skip",
        name="ids",
    )
    eye = next(iter(VIEWS.values()))
    figure = scene_figure(
        [*part_traces(solid), *lines, labels], eye, title=f"{solid.name}: {counts_text(items)}"
    )
    return figure.update_layout(showlegend=False)


def _line(item: NamedItem, n: int) -> Scatter3d:
    points = np.linspace(item.line[0], item.line[1], 9) if len(item.line) == 2 else item.line
    name = f"edge {item.id}" if item.kind == "edge" else item.id
    text = "<br>".join(item.rows) + "<extra></extra>"
    return line_trace(
        [points], color=_PALETTE[n % len(_PALETTE)], width=6, name=name, hovertemplate=text
    )


def _write_png(
    solid: Solid, path: Path, edge_ids: Iterable[int] | None, curve_ids: Iterable[str] | None
) -> None:
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError(
            f"PNG pictures need the package matplotlib. Got {error}; {how_to_install('plot')}"
        ) from error
    items = named_items(solid, edge_ids, curve_ids)
    figure = Figure(figsize=(22, 17), dpi=100)
    FigureCanvasAgg(figure)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.94, wspace=0.02, hspace=0.05)
    for ax, (title, direction) in zip(figure.subplots(2, 2).ravel(), VIEWS.items(), strict=True):
        missing = _draw_items(solid, items, direction, ax)
        ax.set_title(f"{title} ({missing} more without room for their ids)" if missing else title)
    curves = "" if all(item.kind == "edge" for item in items) else ", rims, arcs"
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
    _draw_items(solid, named_items(solid, edge_ids, curve_ids), direction, ax)
    return ax


def _draw_items(solid: Solid, items: list[NamedItem], direction: ArrayLike, ax: Axes) -> int:
    """Draw one view; return how many labels had no room."""
    from matplotlib.collections import LineCollection

    axes = view_axes(direction)
    points = solid.vertices @ axes.T
    front = solid.normals[solid.triangle_face] @ axes[2]
    towards = np.flatnonzero(front > 1e-9)
    view = ParallelView(points[solid.triangles[towards]])
    image, extent = view.render(0.62 + 0.33 * front[towards])
    ax.imshow(
        image,
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        extent=extent,
        origin="lower",
        interpolation="nearest",
    )
    _draw_outlines(solid, points, view, {e for item in items for e in item.edge_ids}, ax)
    spots = []
    for n, item in enumerate(items):
        samples = _sampled(item.line @ axes.T)
        seen = view.is_seen(samples)
        pieces = _seen_pieces(samples, seen)
        if pieces:
            colour = _PALETTE[n % len(_PALETTE)]
            ax.add_collection(LineCollection(pieces, colors=colour, linewidths=2.0))
            spots.append(Spot(item.id, colour, samples[seen][:, :2]))
    ax.set_aspect("equal")
    ax.set_axis_off()
    low = points[:, :2].min(axis=0)
    high = points[:, :2].max(axis=0)
    return draw_labels(spots, low, high, ax)


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


def _draw_outlines(
    solid: Solid, points: np.ndarray, view: ParallelView, named: set[int], ax: Axes
) -> None:
    """Draw the feature edges that are not named, where seen at their middle, in grey."""
    from matplotlib.collections import LineCollection

    rest = [e for e in solid.edges if e.id not in named and is_feature(solid, e)]
    if rest:
        runs = points[np.array([e.vertices for e in rest])]
        seen = view.is_seen(runs.mean(axis=1))
        ax.add_collection(LineCollection(runs[seen][:, :, :2], colors="dimgrey", linewidths=0.6))
