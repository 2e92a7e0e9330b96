"""Tails: cells too thin to count that a wide cell of their list runs out into."""

from __future__ import annotations

import numpy as np

from aspectgraph.cells.arrays import Complex
from aspectgraph.cells.measure import half_spaces, inner_balls
from aspectgraph.domains.width import Ruler, has_room

# Slivers that snapping leaves are thinner, as a share of the least width, than nearly all thin ends of wide domains.
_TAIL_SHARE = 0.1


def find_tails(
    cx: Complex,
    sides: np.ndarray,
    areas: np.ndarray,
    label: np.ndarray,
    is_thin: np.ndarray,
    ruler: Ruler,
) -> np.ndarray:
    """The wide cell, or the tail before it, that each tail carries on: one, so that no tail joins what others part.

    A tail is a thin cell that holds a ball a tenth as wide as the least width at its place, and shares a face with a
    wide cell or another tail of its list; it carries on the one it shares the largest face with.

    Parameters
    ----------
    cx : Complex
    sides : ndarray of int64, shape (k, 4)
        Faces between cells (`measure.interfaces`).
    areas : ndarray, shape (k,)
        Their areas, in squared grid steps.
    label : ndarray of int, shape (n,)
    is_thin : ndarray of bool, shape (n,)
    ruler : Ruler

    Returns
    -------
    ndarray of int, shape (n,)
        A cell, -1 for all cells that are no tails.
    """
    carried_on = np.full(len(is_thin), -1)
    alike = (label[sides[:, 0]] == label[sides[:, 1]]) & is_thin[sides[:, :2]].any(axis=1)
    order = np.flatnonzero(alike)[np.argsort(-areas[alike], kind="stable")]
    pairs = sides[order, :2]
    is_counted = ~is_thin
    is_tried = ~is_thin
    while True:
        rows = np.flatnonzero(is_counted[pairs].sum(axis=1) == 1)
        column = is_counted[pairs[rows, 0]].astype(int)
        cells, first = np.unique(pairs[rows, column], return_index=True)
        fresh = ~is_tried[cells]
        if not fresh.any():
            return carried_on
        cells = cells[fresh]
        first = first[fresh]
        is_tried[cells] = True
        is_tail = _have_room(cx, cells, ruler._replace(min_width=_TAIL_SHARE * ruler.min_width))
        carried_on[cells[is_tail]] = pairs[rows[first], 1 - column[first]][is_tail]
        is_counted[cells[is_tail]] = True


def _have_room(cx: Complex, cells: np.ndarray, ruler: Ruler) -> np.ndarray:
    """Whether each cell holds a ball as wide as the least width at its place."""
    balls = inner_balls(cx, cells)
    roomy = 2.0 * balls[:, 3] >= ruler.least_width(np.linalg.norm(balls[:, :3], axis=1))
    for k in np.flatnonzero(~roomy).tolist():
        roomy[k] = has_room(half_spaces(cx, cells[k]), ruler)
    return roomy
