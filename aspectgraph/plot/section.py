"""Picture of a cross-section: the viewing domains and the partition surfaces that bound them (matplotlib)."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from aspectgraph.exceptions import WorkspaceError
from aspectgraph.plot.clip import (
    box_around,
    polygon_parts,
    polygon_union,
    section_axes,
    section_polygons,
)
from aspectgraph.plot.style import INK, list_colors, list_text, new_axes, text_extent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection

    from aspectgraph.graph.aspect_graph import EntityAspectGraph

_TYPE_STYLE = {"A": ("#20262d", "solid", 1.5), "B": ("#b3122f", (0, (5, 2)), 1.5)}
_NUDGE = 1e-7
_FONT_POINTS = (9.5, 8.0, 6.5)


@dataclass(frozen=True, repr=False)
class SectionDrawing:
    """The drawing that `plot_section` made.

    Attributes
    ----------
    ax : Axes
        The axes of the drawing.
    domains : dict of node to shapely geometry
        Cross-section of each domain inside the window, in mm; nodes outside it are missing.
    solid : shapely geometry
        Cross-section of the part.
    surfaces : dict of str to LineCollection
        Boundaries between domains, by type ``"A"`` and ``"B"``; ``"A"`` where both lie on one plane.
    """

    ax: Axes
    domains: dict[Hashable, shapely.Geometry]
    solid: shapely.Geometry
    surfaces: dict[str, LineCollection]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<SectionDrawing: {len(self.domains)} domains in the window>"


def plot_section(
    eag: EntityAspectGraph,
    ax: Axes | None = None,
    *,
    axis: str = "z",
    at: float | None = None,
    box: ArrayLike | None = None,
) -> SectionDrawing:
    """Draw the viewing domains in a cross-section.

    Parameters
    ----------
    eag : EntityAspectGraph
        The graph whose domains are drawn.
    ax : Axes, optional
        Where to draw. Default: axes in a new pyplot figure.
    axis : str
        The coordinate that is constant in the section: ``"x"``, ``"y"`` or ``"z"``.
    at : float, optional
        Its value in mm; the section is taken just above it. Default: the middle of the part.
    box : array_like, shape (2, 3), optional
        Lowest and highest corner of the drawing, in mm. Default: the part with a margin as large as
        the part.

    Returns
    -------
    SectionDrawing
        The drawing, and its geometry in mm.

    Raises
    ------
    ValueError
        The axis is not one of these.
    WorkspaceError
        The section misses the workspace.
    MissingExtraError
        matplotlib is not installed.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, plot_section
    >>> from matplotlib.figure import Figure
    >>> drawing = plot_section(build_aspect_graph(box, {"top": 1, "side": 2}), Figure().subplots())
    >>> drawing
    <SectionDrawing: 3 domains in the window>
    """
    if axis not in ("x", "y", "z"):
        raise ValueError(f"axis must be 'x', 'y' or 'z'. Got {axis!r}.")
    k = "xyz".index(axis)
    u, v = section_axes(k)
    corners = box_around(eag.solid, eag.workspace, box)
    at = float(eag.solid.bounds[:, k].mean()) if at is None else float(at)
    if not eag.workspace[0, k] <= at <= eag.workspace[1, k]:
        low, high = eag.workspace[:, k]
        raise WorkspaceError(f"at must be in the workspace, {low:g} to {high:g} mm. Got {at:g}.")
    window = corners[:, [u, v]]
    size = float(np.ptp(window, axis=0).max())
    domains = section_domains(eag, k, at, window)
    free = polygon_union(list(domains.values()), _NUDGE * size)
    solid = shapely.MultiPolygon(polygon_parts(shapely.box(*window.ravel()).difference(free)))
    ax = new_axes((8.5, 6.0)) if ax is None else ax
    _fill(eag, domains, solid, ax)
    surfaces = _draw_surfaces(eag, domains, k, at, window, ax)
    _draw_entities(eag, k, at, window, ax)
    ax.set(
        xlim=window[:, 0],
        ylim=window[:, 1],
        aspect="equal",
        xlabel=f"{'xyz'[u]} (mm)",
        ylabel=f"{'xyz'[v]} (mm)",
    )
    _label(eag, domains, window, ax)
    drawn = [lines for lines in surfaces.values() if lines.get_segments()]
    ax.legend(
        handles=drawn, loc="lower left", bbox_to_anchor=(0, 1), ncols=2, fontsize=8, frameon=False
    )
    return SectionDrawing(ax, domains, solid, surfaces)


def section_domains(
    eag: EntityAspectGraph, axis: int, at: float, window: np.ndarray
) -> dict[Hashable, Any]:
    """Return the cross-section of each domain that has one inside a window (2, 2), as shapely geometry by node."""
    size = float(np.ptp(window, axis=0).max())
    # a section through a wall between cells would show both of them
    above = at + _NUDGE * size
    domains = {}
    for node in eag.graph:
        pieces = section_polygons(eag.cells(node), axis, above, window)
        polygons = [shapely.Polygon(piece) for piece in pieces if len(piece) > 2]
        union = polygon_union(polygons, 0.1 * _NUDGE * size)
        if union.area > (1e-4 * size) ** 2:
            domains[node] = union
    return domains


def _fill(eag: EntityAspectGraph, domains: dict[Hashable, Any], solid: Any, ax: Axes) -> None:
    from matplotlib.patches import PathPatch

    colors = list_colors(eag.graph)
    for node, geometry in domains.items():
        ax.add_patch(PathPatch(_path(geometry), facecolor=colors[node], alpha=0.55, linewidth=0))
    if not solid.is_empty:
        ax.add_patch(
            PathPatch(_path(solid), facecolor="#8b949f", edgecolor=INK, linewidth=1.2, zorder=2)
        )


def _path(geometry: Any) -> Any:
    from matplotlib.path import Path

    polygons = [
        part for part in getattr(geometry, "geoms", [geometry]) if part.geom_type == "Polygon"
    ]
    rings = [
        ring
        for part in map(shapely.geometry.polygon.orient, polygons)
        for ring in (part.exterior, *part.interiors)
    ]
    return Path.make_compound_path(*(Path(np.asarray(ring.coords), closed=True) for ring in rings))


def _draw_surfaces(
    eag: EntityAspectGraph,
    domains: dict[Hashable, Any],
    axis: int,
    at: float,
    window: np.ndarray,
    ax: Axes,
) -> dict[str, Any]:
    from matplotlib.collections import LineCollection

    lines: dict[str, list[Any]] = {"A": [], "B": []}
    for i, j, surfaces in eag.graph.edges(data="surfaces"):
        if i in domains and j in domains:
            types: dict[tuple[Any, ...], str] = {}
            for surface in surfaces:
                types[surface.plane] = min(surface.type, types.get(surface.plane, "B"))
            for plane, kind in types.items():
                lines[kind] += _shared_lines(domains[i], domains[j], plane, axis, at, window)
    drawn = {}
    for kind, segments in lines.items():
        color, style, width = _TYPE_STYLE[kind]
        drawn[kind] = LineCollection(
            segments,
            colors=color,
            linestyles=[style],
            linewidths=width,
            label=f"partition surface, type {kind}",
            zorder=3,
        )
        ax.add_collection(drawn[kind])
    return drawn


def _shared_lines(
    one: Any, other: Any, plane: tuple[float, ...], axis: int, at: float, window: np.ndarray
) -> list[np.ndarray]:
    """Return the stretches of a plane's trace that run between two cross-sections."""
    u, v = section_axes(axis)
    normal = np.array([plane[u], plane[v]])
    offset = plane[3] - plane[axis] * at
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        return []
    size = float(np.ptp(window, axis=0).max())
    centre = window.mean(axis=0)
    foot = centre + (offset - normal @ centre) / length**2 * normal
    along = 2 * size * np.array([-normal[1], normal[0]]) / length
    near = 10 * _NUDGE * size
    shared = (
        shapely.LineString([foot - along, foot + along])
        .intersection(one.buffer(near))
        .intersection(other.buffer(near))
    )
    parts = getattr(shared, "geoms", [shared])
    return [
        np.asarray(part.coords)
        for part in parts
        if part.geom_type == "LineString" and part.length > 100 * near
    ]


def _draw_entities(
    eag: EntityAspectGraph, axis: int, at: float, window: np.ndarray, ax: Axes
) -> None:
    """Mark where entities pierce the section."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white")]
    u, v = section_axes(axis)
    for name, a, b in (
        (name, *ends) for name, e in eag.entities.items() for ends in pairwise(e.outline)
    ):
        if (a[axis] - at) * (b[axis] - at) > 0 or a[axis] == b[axis]:
            continue
        x, y = (a + (at - a[axis]) / (b[axis] - a[axis]) * (b - a))[[u, v]]
        if (window[0] <= (x, y)).all() and ((x, y) <= window[1]).all():
            ax.plot(x, y, "o", color="white", markeredgecolor=INK, markersize=7, zorder=4)
            style: dict[str, Any] = {
                "ha": "center",
                "va": "top",
                "weight": "bold",
                "color": INK,
                "path_effects": halo,
                "zorder": 5,
            }
            ax.annotate(name, (x, y), (0, -6), textcoords="offset points", fontsize=9, **style)


def _label(
    eag: EntityAspectGraph, domains: dict[Hashable, Any], window: np.ndarray, ax: Axes
) -> None:
    """Write each list into every piece of its domain that has room for it."""
    size = float(np.ptp(window, axis=0).max())
    extent = ax.get_window_extent()
    mm_per_point = (
        ax.figure.dpi / 72.0 / np.min([extent.width, extent.height] / np.ptp(window, axis=0))
    )
    for node, geometry in domains.items():
        text = list_text(eag.graph.nodes[node][eag.regions.listed_as], eag.entity_names, width=8)
        for part in geometry.geoms:
            x, y = shapely.maximum_inscribed_circle(part, tolerance=0.002 * size).coords[0]
            for points in _FONT_POINTS:
                half = 0.5 * points * mm_per_point * np.array(text_extent(text))
                if part.contains(shapely.box(x - half[0], y - half[1], x + half[0], y + half[1])):
                    style: dict[str, Any] = {
                        "ha": "center",
                        "va": "center",
                        "linespacing": 0.95,
                        "zorder": 4,
                        "color": INK,
                    }
                    ax.text(x, y, text, fontsize=points, **style)
                    break
