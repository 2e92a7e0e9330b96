"""What the pictures of an aspect graph share: colours, short names of lists, the way to matplotlib."""

from __future__ import annotations

import colorsys
import re
from collections.abc import Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import networkx as nx

from aspectgraph.exceptions import MissingExtraError, how_to_install
from aspectgraph.solid.edge_ends import CURVED_FEATURE_DEG, FEATURE_DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from aspectgraph.solid.solid import Solid
    from aspectgraph.solid.topology import Edge

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
