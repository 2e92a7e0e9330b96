"""Labels in a picture that cover neither each other nor what is small: on their line, beside it, or around the picture.

A line longer than its label carries it. A shorter one has it close by, with a leader, where nothing else is. What finds
no such place goes to the frame: slots around the picture are matched with lines so that the leaders are shortest in
sum, and therefore do not cross (of two that cross, the exchanged ones were shorter).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
        rest = [n for n in range(len(spots)) if n not in near]
        waiting = len(rest)
        found = LabelLayout(
            *corners, font, {**near, **_matched(spots, rest, slots)}, frozenset(carried)
        )
        if layout is None or len(found.places) > len(layout.places):
            layout = found
        if len(slots) >= len(rest):
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
            kept = points[owner != n]
        else:
            tries = spots[n].middle + font * _AROUND
            kept = points
        inside = ((tries - room / 2 >= corners[0]) & (tries + room / 2 <= corners[1])).all(axis=1)
        place = _first_free(tries[inside], room, taken, kept) if inside.any() else None
        if place is not None:
            places[n] = place
            taken = np.vstack([taken, [*place, *room]])
    return places, carriers & set(places)


def _first_free(tries: _Array, room: _Array, taken: _Array, kept: _Array) -> _Array | None:
    """Return the first place (k, 2) for a box that overlaps no other box (m, 4) and covers no point (p, 2)."""
    reach = tries.min(axis=0) - room / 2, tries.max(axis=0) + room / 2
    kept = kept[np.all((kept > reach[0]) & (kept < reach[1]), axis=1)]
    gaps = np.abs(tries[:, None] - taken[:, :2]) - (room + taken[:, 2:]) / 2
    free = np.flatnonzero(np.all((gaps > 0).any(axis=2), axis=1))
    for k in free:
        covered = np.abs(kept - tries[k]) < room / 2
        if not np.all(covered, axis=1).any():
            return np.asarray(tries[k])
    return None


def _slots(low: _Array, high: _Array, room: _Array, rings: int) -> _Array:
    """Return the centres (n, 2) of boxes that line the picture from inside, in so many rings."""
    found = []
    for ring in range(rings):
        a = low + (ring + 0.5) * room
        b = high - (ring + 0.5) * room
        n_rows, n_columns = (int(max(0, (b[i] - a[i]) // room[i])) for i in (1, 0))
        rows = a[1] + (b[1] - a[1]) * np.arange(n_rows + 1) / max(n_rows, 1)
        # the corners belong to the rows
        columns = (a[0] + (b[0] - a[0]) * np.arange(n_columns + 1) / max(n_columns, 1))[1:-1]
        found += [(x, y) for x in (a[0], b[0]) for y in rows] + [
            (x, y) for y in (a[1], b[1]) for x in columns
        ]
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _matched(spots: Sequence[Spot], rest: Sequence[int], slots: _Array) -> dict[int, _Array]:
    """Return a slot for each of the rest, or as many of them as there are slots: the leaders shortest in sum."""
    if not rest or not len(slots):
        return {}
    middles = np.array([spots[n].middle for n in rest])
    lengths = np.linalg.norm(middles[:, None] - slots[None], axis=2)
    which, slot = linear_sum_assignment(lengths)
    return {rest[i]: slots[j] for i, j in zip(which, slot, strict=True)}
