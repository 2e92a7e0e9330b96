"""The picker: a page on which the edges, rims and arcs of a part are pointed at, filtered and collected.

One file that asks the network for nothing. Its TOML is what ``--entities`` or ``--dimensions`` reads. The
depth buffer of the browser decides which edges are visible; this serves looking only.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from itertools import pairwise, product
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from aspectgraph.dimensions.tolerances import class_tables
from aspectgraph.exceptions import EntityError, MissingExtraError, PictureError, how_to_install
from aspectgraph.files import replacing
from aspectgraph.plot.traces import is_feature, line_trace, part_traces, scene_figure, xyz
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import RayScene, Solid, check_solid, kind_text
from ground.templates import asset, render

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes
    from plotly.graph_objects import Figure, Scatter3d


# Labels in a picture that cover neither each other nor what is small: on their line, beside it,
# or around the picture.
#
# A line longer than its label carries it. A shorter one has it close by, with a leader, where
# nothing else is. What finds no such place goes to the frame: slots around the picture are
# matched with lines so that the leaders are shortest in sum, and therefore do not cross (of two
# that cross, the exchanged ones were shorter).


_Array = NDArray[np.float64]

_FONTS_PT = (8.0, 7.0, 6.0, 5.0, 4.0, 3.0)
_MOST_RINGS = 4
# a line carries its label if it is so many times as long
_CARRIES = 1.6
# places beside a short line, in font sizes from its middle, near ones first
_AROUND = np.array(
    [
        (r * np.cos(a), r * np.sin(a))
        for r in (2, 3, 4, 5)
        for a in np.arange(0, 2 * np.pi, np.pi / 12)
    ]
)
# room left free inside the frame, pt
_AIR_PT = 6.0


class Spot(NamedTuple):
    """What gets a label: its text, its colour, and points (n, 2) along it where it is seen."""

    text: str
    colour: str
    samples: _Array

    @property
    def extent(self) -> float:
        """The diagonal of the box around it."""
        return float(np.linalg.norm(np.ptp(self.samples, axis=0)))

    @property
    def middle(self) -> _Array:
        """A point in the middle of it."""
        return np.asarray(self.samples[len(self.samples) // 2])


class LabelLayout(NamedTuple):
    """Where labels go: corners of the picture, font, and centre (2,) of each label placed, by number of its spot."""

    low: _Array
    high: _Array
    font_pt: float
    places: dict[int, _Array]
    carried: frozenset[int]


def draw_labels(spots: Sequence[Spot], low: _Array, high: _Array, ax: Axes) -> int:
    """Write each label where it covers no other, and set the limits of the axes so that all are inside.

    Parameters
    ----------
    spots : sequence of Spot
        What to name.
    low, high : ndarray, shape (2,)
        Corners of the box around all that is drawn.
    ax : matplotlib Axes
        Where to draw; its aspect is 1.

    Returns
    -------
    int
        How many labels had no room.
    """
    layout = label_layout(spots, low, high, _size_pt(ax))
    ax.set_xlim(layout.low[0], layout.high[0])
    ax.set_ylim(layout.low[1], layout.high[1])
    box = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    for n, (x, y) in layout.places.items():
        text = spots[n].text
        colour = spots[n].colour
        if n not in layout.carried:
            middle = spots[n].middle
            ax.plot([middle[0], x], [middle[1], y], color=colour, linewidth=0.5, zorder=2.5)
            ax.plot(*middle, ".", color=colour, markersize=2.5, zorder=2.5)
        ax.text(
            x,
            y,
            text,
            color=colour,
            fontsize=layout.font_pt,
            ha="center",
            va="center",
            bbox=box,
            zorder=3,
        )
    return len(spots) - len(layout.places)


def _size_pt(ax: Axes) -> _Array:
    figure: Any = ax.figure
    return (
        72.0 * np.array(ax.get_position(original=True).size) * np.asarray(figure.get_size_inches())
    )


def _room(text: str) -> _Array:
    """Return width and height of a label in font sizes."""
    return np.array([0.65 * len(text) + 0.45, 1.4])


def label_layout(spots: Sequence[Spot], low: _Array, high: _Array, size_pt: _Array) -> LabelLayout:
    """Take the largest font, and then the fewest rings of slots around the picture, that have room for all."""
    layout = None
    waiting = 0
    for font, rings in product(_FONTS_PT, range(_MOST_RINGS + 1)):
        widest = font * np.max([_room(spot.text) for spot in spots] or [np.ones(2)], axis=0)
        drawn_pt = size_pt - 2 * rings * widest - 2 * _AIR_PT
        if rings and (drawn_pt < 0.5 * size_pt).any():
            continue
        unit_per_pt = float(((high - low) / np.maximum(drawn_pt, 1.0)).max())
        half = size_pt * unit_per_pt / 2
        corners = (low + high) / 2 - half, (low + high) / 2 + half
        slots = _slots(*corners, widest * unit_per_pt, rings)
        # with more rings the picture is smaller, and no fewer wait
        if rings and len(slots) < waiting and font > _FONTS_PT[-1]:
            continue
        # the frame is for callouts alone
        frame = (rings * widest + 1.0) * unit_per_pt
        near, carried = _near(spots, font * unit_per_pt, (corners[0] + frame, corners[1] - frame))
        labels = [n for n in range(len(spots)) if n not in near]
        waiting = len(labels)
        candidate = LabelLayout(
            *corners, font, {**near, **_matched(spots, labels, slots)}, frozenset(carried)
        )
        if layout is None or len(candidate.places) > len(layout.places):
            layout = candidate
        if len(slots) >= len(labels):
            break
    assert layout is not None
    return layout


def _near(
    spots: Sequence[Spot], font: float, corners: tuple[_Array, _Array]
) -> tuple[dict[int, _Array], set[int]]:
    """Return the labels on their lines or close by, inside a box, and which are on them; `font` in picture units.

    The longest lines come first among those that carry their labels, then the short ones, shortest first.
    """
    places: dict[int, _Array] = {}
    extents = [spot.extent for spot in spots]
    carriers = {
        n for n, spot in enumerate(spots) if extents[n] >= _CARRIES * font * _room(spot.text)[0]
    }
    points = np.concatenate([spot.samples for spot in spots] or [np.empty((0, 2))])
    owner = np.repeat(np.arange(len(spots)), [len(spot.samples) for spot in spots])
    taken = np.empty((0, 4))
    order = sorted(carriers, key=lambda n: -extents[n])
    order += sorted(set(range(len(spots))) - carriers, key=lambda n: extents[n])
    for n in order:
        samples = spots[n].samples
        room = font * _room(spots[n].text)
        if n in carriers:
            middle_first = np.argsort(
                np.abs(np.arange(len(samples)) - len(samples) // 2), kind="stable"
            )
            tries = samples[middle_first[: max(1, 2 * len(samples) // 3)]]
            marks = points[owner != n]
        else:
            tries = spots[n].middle + font * _AROUND
            marks = points
        inside = ((tries - room / 2 >= corners[0]) & (tries + room / 2 <= corners[1])).all(axis=1)
        place = _first_free(tries[inside], room, taken, marks) if inside.any() else None
        if place is not None:
            places[n] = place
            taken = np.vstack([taken, [*place, *room]])
    return places, carriers & set(places)


# boxes that are compared with all points together
_AT_A_TIME = 16


def _first_free(tries: _Array, room: _Array, taken: _Array, marks: _Array) -> _Array | None:
    """Return the first place (k, 2) for a box that overlaps no other box (m, 4) and covers no point (p, 2)."""
    reach = tries.min(axis=0) - room / 2, tries.max(axis=0) + room / 2
    marks = marks[np.all((marks > reach[0]) & (marks < reach[1]), axis=1)]
    gaps = np.abs(tries[:, None] - taken[:, :2]) - (room + taken[:, 2:]) / 2
    free = np.flatnonzero(np.all((gaps > 0).any(axis=2), axis=1))
    for first in range(0, len(free), _AT_A_TIME):
        batch = tries[free[first : first + _AT_A_TIME]]
        # one coordinate after the other: a last axis of two is slow
        covers = np.abs(marks[:, 0] - batch[:, :1]) < room[0] / 2
        covers &= np.abs(marks[:, 1] - batch[:, 1:]) < room[1] / 2
        clear = np.flatnonzero(~covers.any(axis=1))
        if len(clear):
            return np.asarray(batch[clear[0]])
    return None


def _slots(low: _Array, high: _Array, room: _Array, rings: int) -> _Array:
    """Return the centres (n, 2) of boxes that line the picture from inside, in so many rings."""
    centres = []
    for ring in range(rings):
        a = low + (ring + 0.5) * room
        b = high - (ring + 0.5) * room
        n_rows, n_columns = (int(max(0, (b[i] - a[i]) // room[i])) for i in (1, 0))
        rows = a[1] + (b[1] - a[1]) * np.arange(n_rows + 1) / max(n_rows, 1)
        # the corners belong to the rows
        columns = (a[0] + (b[0] - a[0]) * np.arange(n_columns + 1) / max(n_columns, 1))[1:-1]
        centres += [(x, y) for x in (a[0], b[0]) for y in rows] + [
            (x, y) for y in (a[1], b[1]) for x in columns
        ]
    return np.array(centres, dtype=np.float64).reshape(-1, 2)


def _matched(spots: Sequence[Spot], labels: Sequence[int], slots: _Array) -> dict[int, _Array]:
    """Return a slot for each of the rest, or as many of them as there are slots: the leaders shortest in sum."""
    if not labels or not len(slots):
        return {}
    middles = np.array([spots[n].middle for n in labels])
    lengths = np.linalg.norm(middles[:, None] - slots[None], axis=2)
    which, slot = linear_sum_assignment(lengths)
    return {labels[i]: slots[j] for i, j in zip(which, slot, strict=True)}


# Parallel views of a part by casting rays: its triangles as an image, and which points they do
# not hide.


_PIXELS = 800
# what hides a point by less than this share of the picture's size is the surface the point lies on
_ON_SURFACE = 1e-4


class ParallelView:
    """Triangles seen by a viewer far up the third axis.

    Parameters
    ----------
    corners : ndarray, shape (t, 3, 3)
        Triangles that face the viewer, counter-clockwise in the picture, in view coordinates.
    """

    def __init__(self, corners: np.ndarray) -> None:
        points = corners.reshape(-1, 3)
        self._low = points.min(axis=0)
        self._high = points.max(axis=0)
        self._scene = RayScene(points, np.arange(len(points)).reshape(-1, 3))

    def render(self, shades: np.ndarray) -> tuple[np.ndarray, tuple[float, float, float, float]]:
        """Paint the triangles into an image, the nearest on top.

        Parameters
        ----------
        shades : ndarray, shape (t,)
            Grey of each triangle.

        Returns
        -------
        image : ndarray, shape (h, w)
            White where there is nothing; the first row is the lowest.
        extent : tuple of float
            Left, right, bottom and top of the image in view coordinates.
        """
        low = self._low[:2]
        high = self._high[:2]
        pixel = float((high - low).max()) / _PIXELS
        low = low - 2 * pixel
        high = high + 2 * pixel
        width, height = np.ceil((high - low) / pixel).astype(int)
        x, y = np.meshgrid(
            low[0] + (np.arange(width) + 0.5) * pixel, low[1] + (np.arange(height) + 0.5) * pixel
        )
        above = np.full_like(x, self._high[2] + _PIXELS * pixel)
        downwards = np.broadcast_to([0.0, 0.0, -1.0], (*x.shape, 3))
        hit = self._scene.cast(np.stack([x, y, above], axis=-1), downwards)
        image = np.append(shades, 1.0)[np.minimum(hit["primitive_ids"], len(shades))]
        return image, (low[0], low[0] + width * pixel, low[1], low[1] + height * pixel)

    def is_seen(self, points: np.ndarray) -> np.ndarray:
        """Return which points, shape (n, 3) in view coordinates, no triangle hides; (n,) bool."""
        lift = _ON_SURFACE * float((self._high - self._low).max())
        upwards = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        return np.isinf(self._scene.cast(points + lift * upwards, upwards)["t_hit"])


def view_axes(direction: ArrayLike) -> np.ndarray:
    """Return the picture's right, up and towards-the-viewer axes as rows, shape (3, 3); z points up if it can."""
    towards = np.asarray(direction, dtype=np.float64)
    towards = towards / np.linalg.norm(towards)
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


# What is named in pictures of a part: edges, rims and arcs, each with its line and what is said
# of it.


class NamedItem(NamedTuple):
    """What is named in a picture.

    Attributes
    ----------
    id : str
        Its id.
    kind : str
        ``"edge"``, ``"rim"`` or ``"arc"``.
    line : ndarray, shape (k, 3)
        Its polyline, mm; that of a rim ends where it starts.
    edge_ids : tuple of int
        Its edges in the solid.
    size_mm : float
        Length of an edge, diameter of a rim, radius of an arc.
    rows : tuple of str
        What is said of it, a line each.
    """

    id: str
    kind: str
    line: NDArray[np.float64]
    edge_ids: tuple[int, ...]
    size_mm: float
    rows: tuple[str, ...]

    @property
    def label(self) -> str:
        """Its id in pictures, where that of an edge has an e."""
        if self.kind == "edge":
            return f"e{self.id}"
        return self.id

    @property
    def middle(self) -> NDArray[np.float64]:
        """Where its label goes, shape (3,): the middle of an edge, a vertex in the middle of a chain of chords."""
        return np.asarray(
            self.line.mean(axis=0) if len(self.line) == 2 else self.line[len(self.line) // 2]
        )


def named_items(
    solid: Solid, edge_ids: Iterable[int] | None, curve_ids: Iterable[str] | None
) -> list[NamedItem]:
    """Return what shall be named, edges first.

    Parameters
    ----------
    solid : Solid
        The part.
    edge_ids : iterable of int or None
        The edges; None: all of ``solid.straight_edges()``.
    curve_ids : iterable of str or None
        The rims and arcs; None: all, but none if `edge_ids` are chosen.

    Raises
    ------
    EntityError
        There is no such edge, rim or arc.
    """
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


def counts_text(items: Iterable[NamedItem]) -> str:
    """Return how many of each kind there are: ``3 straight edges, 1 rim, 0 arcs``; curves only if there are any."""
    kinds = [item.kind for item in items]
    n_edges, n_rims, n_arcs = (kinds.count(kind) for kind in ("edge", "rim", "arc"))
    curves = f", {n_rims} rims, {n_arcs} arcs" if n_rims + n_arcs else ""
    return f"{n_edges} straight edges{curves}"


def item_faces(solid: Solid, item: NamedItem) -> list[int]:
    """Return the faces on both sides of an item, each once."""
    return sorted({face for edge_id in item.edge_ids for face in solid.edges[edge_id].faces})


def normal_text(solid: Solid, face: int) -> str:
    """Return where a face looks: ``+z``, or the components of its normal."""
    normal = solid.normals[face]
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) > 1 - 1e-9:
        return f"{'+' if normal[axis] > 0 else '-'}{'xyz'[axis]}"
    return "(" + ", ".join(f"{c + 0.0:.3g}" for c in normal) + ")"


def _edge_item(solid: Solid, edge_id: int) -> NamedItem:
    line = np.asarray(solid.edge_points(edge_id), dtype=np.float64)
    edge = solid.edges[edge_id]
    length = float(solid.edge_length_mm(edge_id))
    rows = (
        f"edge {edge_id}",
        f"length {length:.6g} mm",
        _turn(edge.turn_deg),
        _faces(solid, (edge_id,)),
        f"{_point(line[0])} to {_point(line[1])}",
        f"ends: {', '.join(end.text for end in solid.edge_ends(edge_id))}",
    )
    return NamedItem(str(edge_id), "edge", line, (edge_id,), length, rows)


def _curve_item(solid: Solid, curve: Arc) -> NamedItem:
    closed = isinstance(curve, Rim)
    line = solid.vertices[list(curve.vertices + curve.vertices[:1] if closed else curve.vertices)]
    kind = "rim" if closed else "arc"
    size = f"diameter {2 * curve.radius_mm:.6g}" if closed else f"radius {curve.radius_mm:.6g}"
    rows = (
        f"{kind} {curve.id}",
        f"{size} mm",
        _turn(solid.edges[curve.edge_ids[0]].turn_deg),
        _faces(solid, curve.edge_ids),
        f"centre {_point(curve.centre)}",
        f"axis {_point(curve.axis)}",
    )
    # drawings give the diameter of a whole circle
    size_mm = float(2 * curve.radius_mm if closed else curve.radius_mm)
    return NamedItem(curve.id, kind, np.asarray(line, np.float64), curve.edge_ids, size_mm, rows)


def _turn(dihedral_deg: float) -> str:
    return f"angle {dihedral_deg:.4g}°, {'convex' if dihedral_deg > 0 else 're-entrant'}"


def _faces(solid: Solid, edge_ids: Iterable[int]) -> str:
    """Name the faces on both sides; facets of curved ones together."""
    faces = dict.fromkeys(face for edge_id in edge_ids for face in solid.edges[edge_id].faces)
    flat = [
        f"{face} ({normal_text(solid, face)})" for face in faces if not solid.faces[face].curved
    ]
    if len(flat) < len(faces):
        flat.append("a curved one")
    return f"{'face' if len(flat) == 1 else 'faces'} {' and '.join(flat)}"


def _point(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in point) + ")"


def _checked_ids(solid: Solid, edge_ids: Iterable[int] | None) -> list[int]:
    if edge_ids is None:
        return [edge.id for edge in solid.straight_edges()]
    ids = [int(edge_id) for edge_id in edge_ids]
    bad = [edge_id for edge_id in ids if not 0 <= edge_id < len(solid.edges)]
    if bad:
        raise EntityError(f"an edge id must be in 0..{len(solid.edges) - 1}. Got {bad[0]}.")
    return ids


_SCRIPTS = (
    "scene.js",
    "labels.js",
    "pairs.js",
    "positions.js",
    "classes.js",
    "choice.js",
    "pointer.js",
    "picker.js",
)
# room around the part in depth, so that nothing of it is cut off
_AIR = 1.05


def picker_html(
    solid: Solid, edge_ids: Iterable[int] | None = None, curve_ids: Iterable[str] | None = None
) -> str:
    """Return a page on which edges, rims and arcs are collected into a file for a plan.

    The file is one for ``--entities``, or one for ``--dimensions`` with tolerances.

    Parameters
    ----------
    solid : Solid
        The part.
    edge_ids : iterable of int, optional
        The edges on offer. Default: all of ``solid.straight_edges()``.
    curve_ids : iterable of str, optional
        The rims and arcs on offer. Default: all of ``solid.rims()`` and ``solid.arcs()``, but none if `edge_ids` are
        chosen.

    Returns
    -------
    str
        HTML without references to anything outside it. The same part gives the same page.

    Raises
    ------
    EntityError
        There is no such edge, rim or arc.
    """
    items = named_items(solid, edge_ids, curve_ids)
    name = solid.name or "part"
    page = render(
        "aspectgraph",
        "plot/page/picker.html",
        part=name,
        counts=counts_text(items),
        stem=_stem(name),
        data=_data(solid, items, name),
        style=_asset("picker.css"),
        scripts=list(map(_asset, _SCRIPTS)),
    )
    return str(page)


def _asset(name: str) -> Markup:
    return asset("aspectgraph.plot", f"page/{name}")


def _stem(name: str) -> str:
    """Return a part's name as a file name."""
    stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in name.split(".")[0])
    return stem.strip("_") or "part"


def _data(solid: Solid, items: list[NamedItem], name: str) -> dict[str, Any]:
    """Return what the page shows; points about the centre of the part's box."""
    low, high = np.asarray(solid.bounds, dtype=np.float64)
    centre = (low + high) / 2
    named = {edge_id for item in items for edge_id in item.edge_ids}
    curves = {curve.id: curve for curve in (*solid.rims(), *solid.arcs())}
    outline_ids = [
        edge.id for edge in solid.edges if edge.id not in named and is_feature(solid, edge)
    ]
    return {
        "part": name,
        "stem": _stem(name),
        "radius": float(_AIR * np.linalg.norm(high - low) / 2),
        "vertices": _packed(solid.vertices - centre, "<f4"),
        "triangles": _packed(solid.triangles, "<u4"),
        "face_of": _packed(solid.triangle_face, "<u4"),
        "normals": _packed(solid.normals, "<f4"),
        "outlines": [_rounded(solid.edge_points(edge_id) - centre) for edge_id in outline_ids],
        "faces": [_face_rows(solid, face) for face in range(len(solid.faces))],
        "classes": class_tables(),
        "items": [_record(solid, item, centre, curves.get(item.id)) for item in items],
    }


def _record(
    solid: Solid, item: NamedItem, centre: NDArray[np.float64], curve: Arc | None
) -> dict[str, Any]:
    symbol = {"edge": "", "rim": "⌀ ", "arc": "R "}[item.kind]
    return {
        "id": item.id,
        "kind": item.kind,
        "size": item.size_mm,
        "told": f"{symbol}{item.size_mm:.5g} mm",
        # a mesh states no circle: how far its chords are off the one fitted to them
        "chords": {
            "n": len(item.edge_ids),
            "off": 0.0 if curve is None or not curve.fitted else float(curve.chord_mm),
        },
        "smooth": curve is None
        and any(end.kind == "tangent" for end in solid.edge_ends(item.edge_ids[0])),
        "turn": float(solid.edges[item.edge_ids[0]].turn_deg),
        "faces": item_faces(solid, item),
        "rows": item.rows,
        "line": _rounded(item.line - centre),
        # in full, for the file
        "ends": item.line.tolist() if item.kind == "edge" else None,
        "circle": None
        if curve is None
        else {
            "centre": curve.centre.tolist(),
            "axis": curve.axis.tolist(),
            "radius": float(curve.radius_mm),
        },
    }


def _face_rows(solid: Solid, face: int) -> list[str]:
    if solid.faces[face].curved:
        return [f"face {face}", "facet of a curved face"]
    return [f"face {face}", f"looks to {normal_text(solid, face)}", "double-click for its edges"]


def _packed(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _rounded(points: NDArray[np.float64]) -> list[list[float]]:
    """Return points with the seven digits that the browser draws with."""
    return [[float(f"{c:.7g}") for c in point] for point in points]


# Pictures of a part with the ids of its edges, rims and arcs: a PNG of four views, or an HTML
# page to pick from.


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
    SolidError
        It is no solid, or the two arguments are exchanged.
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
    check_solid(solid, path, "solid, path")
    if not isinstance(path, str | PathLike):
        raise PictureError.of_rule("path", "must be a path", kind_text(path))
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
    SolidError
        It is no solid.
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

    check_solid(solid)
    items = named_items(solid, edge_ids, curve_ids)
    lines = [_line(item, n) for n, item in enumerate(items)]
    labels = go.Scatter3d(
        **xyz([item.middle for item in items]),
        mode="text",
        text=[item.label for item in items],
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
            spots.append(Spot(item.label, colour, samples[seen][:, :2]))
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

    outlines = [e for e in solid.edges if e.id not in named and is_feature(solid, e)]
    if outlines:
        runs = points[np.array([e.vertices for e in outlines])]
        seen = view.is_seen(runs.mean(axis=1))
        ax.add_collection(LineCollection(runs[seen][:, :, :2], colors="dimgrey", linewidths=0.6))
