"""Picture of an aspect graph: viewing domains as circles, adjacencies as lines (matplotlib)."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.plot.traces import INK, list_colors, list_text, listed_on, new_axes, text_extent

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.text import Text

    from aspectgraph.graph.aspect_graph import EntityAspectGraph


# Where to draw the nodes of an aspect graph.


# up to so many nodes there is time for more starts, and for distances between all pairs
_FEW = 30
_MANY = 250
_RANDOM_STARTS = 6

# in units of one line
_STEPS = 500
_STILL = 1e-4
_TOUCHING = 1e-9
_NEAR = 0.15


def layout(graph: nx.Graph) -> dict[Hashable, np.ndarray]:
    """Place nodes so that distances in the picture follow those in the graph, the longest lists on top.

    Stress majorization (Gansner, Koren and North 2004) from several starts; the result with the fewest lines that
    cross or run over other nodes is turned upright.

    Returns
    -------
    dict of node to ndarray, shape (2,)
    """
    candidates = list(_placements(graph))
    points = (
        candidates[0]
        if len(candidates) == 1
        else min(candidates, key=lambda p: crossings(graph, p) + hits(graph, p))
    )
    points = points - points.mean(axis=0)
    rank = np.array([_rank(data) for _, data in graph.nodes(data=True)], float)
    up = points.T @ (rank - rank.mean())
    length = np.linalg.norm(up)
    if length > 1e-9:
        up = up / length
        points = points @ np.array([[up[1], up[0]], [-up[0], up[1]]])
    return dict(zip(graph, points, strict=True))


def _placements(graph: nx.Graph) -> Iterator[np.ndarray]:
    if len(graph) > _MANY or not nx.is_connected(graph):
        yield _array(graph, nx.spring_layout(graph, seed=0))
        return
    lengths = dict(nx.all_pairs_shortest_path_length(graph))
    distances = np.array([[lengths[i][j] for j in graph] for i in graph], float)
    starts = [nx.circular_layout(graph)]
    if len(graph) > 2:
        starts.append(nx.spectral_layout(graph))
    if nx.check_planarity(graph)[0]:
        starts.append(nx.planar_layout(graph))
    if len(graph) <= _FEW:
        starts += [nx.random_layout(graph, seed=seed) for seed in range(_RANDOM_STARTS)]
    for start in starts:
        yield least_stress(distances, _array(graph, start))


def _array(graph: nx.Graph, places: dict[str, Any]) -> np.ndarray:
    return np.array([places[node] for node in graph], float).reshape(-1, 2)


def least_stress(distances: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move points in the plane until their distances are as close as they get to those wanted.

    Parameters
    ----------
    distances : ndarray, shape (n, n)
        Wanted; the square of an error counts by the inverse square of the distance.
    points : ndarray, shape (n, 2)
        To start from.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    n = len(points)
    apart = distances > 0
    weights = np.where(apart, 1.0 / np.where(apart, distances, 1.0) ** 2, 0.0)
    # V X' = B(X) X, V singular only for a common shift
    inverse = np.linalg.inv(np.diag(weights.sum(axis=1)) - weights + 1.0 / n)
    for _ in range(_STEPS):
        now = np.linalg.norm(points[:, None] - points[None], axis=2)
        pull = np.where(
            apart & (now > _TOUCHING),
            weights * distances / np.where(now > _TOUCHING, now, 1.0),
            0.0,
        )
        moved = inverse @ (pull.sum(axis=1)[:, None] * points - pull @ points)
        if np.abs(moved - points).max() < _STILL:
            return moved
        points = moved
    return points


def crossings(graph: nx.Graph, points: np.ndarray) -> int:
    """Count the pairs of lines that cross when the nodes lie at (n, 2) points."""
    place = {node: k for k, node in enumerate(graph)}
    pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
    start = points[pairs[:, 0]]
    end = points[pairs[:, 1]]

    def side(q: np.ndarray) -> np.ndarray:
        d = (end - start)[:, None]
        r = q[None] - start[:, None]
        return d[..., 0] * r[..., 1] - d[..., 1] * r[..., 0]

    apart = side(start) * side(end) < 0
    shared = (pairs[:, None, :, None] == pairs[None, :, None, :]).any(axis=(2, 3))
    return int((apart & apart.T & ~shared).sum() // 2)


def hits(graph: nx.Graph, points: np.ndarray) -> int:
    """Count the pairs of a line and a node, not one of its ends, that it runs over or close by."""
    place = {node: k for k, node in enumerate(graph)}
    pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
    start = points[pairs[:, :1]]
    along = points[pairs[:, 1:]] - points[pairs[:, :1]]
    length2 = np.maximum((along**2).sum(axis=2), _TOUCHING)
    share = np.clip(((points[None] - start) * along).sum(axis=2) / length2, 0.0, 1.0)
    distance = np.linalg.norm(points[None] - start - share[..., None] * along, axis=2)
    ends = (pairs[:, :, None] == np.arange(len(points))).any(axis=1)
    return int(((distance < _NEAR) & ~ends).sum())


def _rank(data: dict[str, Any]) -> int:
    listed = listed_on(data)
    return data.get("n_visible", 0) if listed is None else len(listed)


_NODE_POINTS2 = (70.0, 900.0)
_EDGE_POINTS = (0.8, 5.0)
_EDGE_COLOR = "#9aa4b0"
_DASHES = (0, (1.6, 1.0))
_DOTS = (0, (2.2, 1.4))
_GRAPH_PLOT_MANY = 30


@dataclass(frozen=True, repr=False)
class GraphDrawing:
    """The drawing that `plot_graph` made.

    Attributes
    ----------
    ax : Axes
        The axes of the drawing.
    nodes : PathCollection
        Circles, in node order.
    edges : LineCollection
        Lines, in edge order.
    labels : dict of node to Text
        Texts next to the circles. A node without text is missing.
    positions : dict of node to ndarray, shape (2,)
        Position of each node in data coordinates.
    """

    ax: Axes
    nodes: PathCollection
    edges: LineCollection
    labels: dict[Hashable, Text]
    positions: dict[Hashable, np.ndarray]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return (
            f"<GraphDrawing: {len(self.positions)} nodes, {len(self.edges.get_segments())} edges>"
        )


def plot_graph(
    eag: EntityAspectGraph | nx.Graph,
    ax: Axes | None = None,
    *,
    labels: Mapping[Hashable, str] | None = None,
    colors: Mapping[Hashable, str] | None = None,
    legend: bool = True,
) -> GraphDrawing:
    """Draw an aspect graph.

    A circle grows with the logarithm of its domain's volume. Its outline is dashed if the domain
    reaches the boundary of the workspace. A line grows with the logarithm of the shared area. It is
    dashed if all surfaces there are of type B. Domains with the longest lists are at the top.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        The latter from `read_graphml` or `complete_aspect_graph`.
    ax : Axes, optional
        Where to draw. Default: axes in a new pyplot figure.
    labels : mapping of node to str, optional
        Default: the observable lists.
    colors : mapping of node to str, optional
        Default: one colour per list, the same as in `plot_section` and `plot_domains`.
    legend : bool
        Whether to explain the outlines and lines.

    Returns
    -------
    GraphDrawing
        The drawing, so that you can change colours or texts.

    Raises
    ------
    ValueError
        The graph has no nodes, or is not one of those above.
    MissingExtraError
        matplotlib is not installed.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, plot_graph
    >>> from matplotlib.figure import Figure
    >>> drawing = plot_graph(build_aspect_graph(box, {"top": 1, "side": 2}), Figure().subplots())
    >>> drawing
    <GraphDrawing: 4 nodes, 5 edges>
    """
    graph = _checked(eag)
    if ax is None:
        side = float(np.clip(1.7 * np.sqrt(len(graph)), 5.0, 14.0))
        ax = new_axes((1.2 * side, side))
    labels = _lists(graph) if labels is None else labels
    positions = layout(graph)
    _prepare(ax, positions)
    edges = _draw_edges(graph, positions, ax)
    nodes = _draw_nodes(graph, positions, list_colors(graph) if colors is None else colors, ax)
    texts = _draw_labels(graph, positions, labels, nodes, ax)
    if legend:
        _draw_legend(graph, ax)
    return GraphDrawing(ax, nodes, edges, texts, positions)


def _checked(eag: EntityAspectGraph | nx.Graph) -> nx.Graph:
    graph = eag if isinstance(eag, nx.Graph) else eag.graph
    if not len(graph):
        raise ValueError("eag must have at least one node. Got a graph without nodes.")
    missing = [node for node, data in graph.nodes(data=True) if "volume" not in data]
    missing += [edge for *edge, data in graph.edges(data=True) if "area" not in data]
    if missing:
        raise ValueError(
            f"every node must have a volume and every edge an area. Got {missing[0]} without."
        )
    return graph


def _lists(graph: nx.Graph) -> dict[Hashable, str]:
    lists = {node: listed_on(data) for node, data in graph.nodes(data=True)}
    names = graph.graph.get("entities", ())
    return {
        node: "" if None in lists.values() else list_text(listed or (), names)
        for node, listed in lists.items()
    }


def _prepare(ax: Axes, positions: Mapping[Hashable, Any]) -> None:
    points = np.array(list(positions.values()))
    ax.set_axis_off()
    ax.set_aspect("equal", adjustable="datalim")
    low = points.min(axis=0)
    high = points.max(axis=0)
    room = 0.05 * max(float((high - low).max()), 1e-3)
    ax.update_datalim([low - room, high + room])
    ax.margins(0)
    ax.autoscale_view()


def _scaled(values: ArrayLike, smallest: float, largest: float) -> np.ndarray:
    """Map positive values to a range by their logarithm."""
    logs = np.log(np.maximum(np.asarray(values, float), np.finfo(float).tiny))
    if not len(logs) or np.ptp(logs) < 1e-9:
        return np.full(len(logs), 0.5 * (smallest + largest))
    return smallest + (largest - smallest) * (logs - logs.min()) / np.ptp(logs)


def _shrink(graph: nx.Graph) -> float:
    """Return the share of their full area that circles have in a graph of this size."""
    return 1.0 if len(graph) <= _GRAPH_PLOT_MANY else 0.6 * _GRAPH_PLOT_MANY / len(graph)


def _only_type_b(data: dict[str, Any]) -> bool:
    surfaces = data.get("surfaces", ())
    return bool(surfaces) and all(surface.type == "B" for surface in surfaces)


def _draw_edges(graph: nx.Graph, positions: Mapping[Hashable, Any], ax: Axes) -> LineCollection:
    from matplotlib.collections import LineCollection

    rows = list(graph.edges(data=True))
    lines = LineCollection(
        [(positions[i], positions[j]) for i, j, _ in rows],
        linewidths=_shrink(graph) ** 0.5
        * _scaled([data["area"] for *_, data in rows], *_EDGE_POINTS),
        linestyles=[_DASHES if _only_type_b(data) else "solid" for *_, data in rows],
        colors=_EDGE_COLOR,
        zorder=1,
    )
    ax.add_collection(lines)
    return lines


def _draw_nodes(
    graph: nx.Graph, positions: Mapping[Hashable, Any], colors: Any, ax: Axes
) -> PathCollection:
    points = np.array([positions[node] for node in graph])
    open_domain = [data.get("unbounded", False) for _, data in graph.nodes(data=True)]
    return ax.scatter(
        points[:, 0],
        points[:, 1],
        s=_shrink(graph)
        * _scaled([volume for _, volume in graph.nodes(data="volume")], *_NODE_POINTS2),
        c=[colors[node] for node in graph],
        edgecolors=INK,
        linewidths=1.3 if len(graph) <= _GRAPH_PLOT_MANY else 0.8,
        linestyles=[_DOTS if is_open else "solid" for is_open in open_domain],
        zorder=2,
    )


def _draw_labels(
    graph: nx.Graph,
    positions: Mapping[Hashable, Any],
    labels: Mapping[Hashable, str],
    nodes: PathCollection,
    ax: Axes,
) -> dict[Hashable, Text]:
    """Write each label below, above or beside its node, wherever it covers least."""
    from matplotlib.patheffects import withStroke

    size = 10.0 if len(graph) <= _GRAPH_PLOT_MANY else 6.5
    radius = np.sqrt(nodes.get_sizes()) / 2.0
    texts: dict[Hashable, Text] = {}
    halo = [withStroke(linewidth=2.5, foreground="white")]
    spots = _Spots(graph, positions, radius, ax)
    for k, node in enumerate(graph):
        text = labels.get(node, "")
        if text:
            offset, horizontal, vertical = spots.best(k, text, size)
            texts[node] = ax.annotate(
                text,
                positions[node],
                offset,
                textcoords="offset points",
                ha=horizontal,
                va=vertical,
                fontsize=size,
                color=INK,
                linespacing=0.95,
                path_effects=halo,
                zorder=3,
            )
    return texts


class _Spots:
    """Finds room for labels; all in points (1/72 inch)."""

    def __init__(
        self, graph: nx.Graph, positions: Mapping[Hashable, Any], radius: np.ndarray, ax: Axes
    ) -> None:
        scale = 72.0 / ax.figure.dpi
        self._centres = (
            ax.transData.transform(np.array([positions[node] for node in graph])) * scale
        )
        self._radius = radius
        place = {node: k for k, node in enumerate(graph)}
        pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
        share = np.linspace(0.0, 1.0, 41)[:, None, None]
        ends = self._centres[pairs]
        self._on_lines = ((1 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 2)
        self._taken: list[np.ndarray] = []

    def best(self, k: int, text: str, size: float) -> Any:
        """Offset and alignments of the label of node k."""
        half = 0.5 * size * np.array(text_extent(text))
        gap = self._radius[k] + 2.0
        choices = [
            ((0, -gap), "center", "top"),
            ((0, gap), "center", "bottom"),
            ((gap, 0), "left", "center"),
            ((-gap, 0), "right", "center"),
        ]
        boxes = [
            self._centres[k] + np.array(offset) + np.sign(offset) * half for offset, *_ in choices
        ]
        costs = [self._cost(centre, half, k) for centre in boxes]
        chosen = int(np.argmin(costs))
        self._taken.append(np.array([boxes[chosen], half]))
        return choices[chosen]

    def _cost(self, centre: np.ndarray, half: np.ndarray, k: int) -> float:
        lines = (np.abs(self._on_lines - centre) < half).all(axis=1).sum()
        away = np.abs(self._centres - centre) - half - self._radius[:, None]
        circles = (away < 0).all(axis=1).sum() - (away[k] < 0).all()
        labels = sum((np.abs(other - centre) < half + room).all() for other, room in self._taken)
        return float(lines + 20 * circles + 40 * labels)


def _draw_legend(graph: nx.Graph, ax: Axes) -> None:
    from matplotlib.lines import Line2D

    def circle(style: Any, label: str) -> Artist:
        return ax.scatter(
            [], [], s=90, c="white", edgecolors=INK, linewidths=1.3, linestyles=[style], label=label
        )

    reach = {
        bool(data.get("unbounded")) for _, data in graph.nodes(data=True) if "unbounded" in data
    }
    handles = [circle(_DOTS, "open to the workspace's boundary")] if True in reach else []
    handles += [circle("solid", "bounded domain")] if False in reach else []
    types = {_only_type_b(data) for *_, data in graph.edges(data=True) if "surfaces" in data}
    line: dict[str, Any] = {"color": _EDGE_COLOR, "linewidth": 2.5}
    handles += (
        [Line2D([], [], **line, label="boundary with a type A surface")] if False in types else []
    )
    handles += (
        [Line2D([], [], **line, linestyle=_DASHES, label="type B surfaces only")]
        if True in types
        else []
    )
    if handles:
        ax.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(0, 0),
            ncols=2,
            fontsize=8,
            frameon=False,
        )
