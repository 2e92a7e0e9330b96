"""Depth-first search of boxes of poses for one pose that inspects more than a given weight. Compiled loops.

A box is dropped when no windows heavier than the limit may meet in it (`planner.stabbing`), and else halved along the
coordinate that most widens the windows or most leaves visibility, or the length of images, in doubt. Where windows
meet, the pose is tried at once: if it satisfies all conditions for more than the limit, the search is over. If it ends
without, no pose does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from planner.posebox import (
    extent,
    farthest,
    is_empty,
    keep_cells,
    most_turn,
    out_of_range,
    rotation,
    seen_from,
    swings,
    too_short,
    window,
)
from planner.stabbing import exclusive_groups, may_exceed, weight_at

PROVEN, FOUND, UNRESOLVED, SPENT = range(4)

# boxes that wait at most: a box has at most two halves waiting for each halving of its six coordinates
_LEVELS = 160
# boxes about the point looked at are first made as small as this share of half the view's width
_LOOK_SHARE = 0.5
# how much the length of s, doubtful visibility and doubtful length of the image count in the choice of the coordinate
_LENGTH_SCORE = 0.3
_DOUBT_SCORE = 1.0
# the most that one image of doubtful length counts
_MOST_SHORT = 4.0
# boxes whose coordinates all do less than this are not halved
_FINEST = 1e-4


class Stack(NamedTuple):
    """Boxes that wait: q0, h, v0, u; where windows met in the box before halving; and what may be inspected.

    ``members[i, :count[i]]`` are entities in descending order of weight; ``sure`` those visible from all of the box;
    the cells in which the nodal point may lie are those of ``cells`` from ``start[i, a]`` to ``start[i, a + 1]``.
    """

    look: np.ndarray
    half: np.ndarray
    turn: np.ndarray
    span: np.ndarray
    met: np.ndarray
    count: np.ndarray
    members: np.ndarray
    sure: np.ndarray
    start: np.ndarray
    cells: np.ndarray


class Work(NamedTuple):
    """Of the box at work: rotation, room, swings, nodal point; windows, weights and groups of members; scores."""

    matrix: np.ndarray
    room: np.ndarray
    swing: np.ndarray
    nodal: np.ndarray
    least: np.ndarray
    y: np.ndarray
    group: np.ndarray
    scores: np.ndarray


@njit(cache=True, nogil=True)
def search(box, chart, order, entities, view, conflict, y, limit, max_nodes, stop, pose, inspected):
    """Search a box of poses.

    Parameters
    ----------
    box : array (4, 3)
        q0, h, v0 and u, see `planner.posebox`.
    chart : int
    order : array of int (m,)
        The entities that count, in descending order of weight.
    entities, view, conflict
        The request; ``conflict`` (e, e) tells which entities exclude each other anyhow.
    y : array (e,)
        Weights.
    limit : float
        What a pose must exceed.
    max_nodes : int
        Boxes looked at, at most.
    stop : array of bool (1,)
        Another thread sets it to end the search.
    pose : array (4, 4)
        The pose found is written here; camera to part.
    inspected : array of bool (e,)
        What it inspects is written here.

    Returns
    -------
    outcome : int
        PROVEN: no pose exceeds the limit. FOUND: one does. UNRESOLVED: none was found, but boxes too small to be halved
        are left. SPENT: more boxes would be needed.
    made : int
        Boxes looked at.
    """
    m = len(y)
    stack = _planted(box, order, entities)
    square, line = np.empty((2, 3, 3)), np.empty((2, 3))
    least, scores = np.empty((m, 6)), np.empty(6)
    work = Work(square[0], line[0], square[1], line[1], least, np.empty(m), np.empty(m, np.int64), scores)
    w, look = np.empty(3), np.empty(3)
    size, made, outcome = 1, 0, PROVEN
    while size > 0:
        if made >= max_nodes or stop[0]:
            return SPENT, made
        size, made = size - 1, made + 1
        total = _tighten(stack, size, chart, entities, view, y, work)
        if total <= limit or not _is_heavy(stack, size, conflict, limit, view, work, w):
            continue
        look[:] = stack.look[size] + work.matrix @ w
        if _try_pose(stack, size, look, work, entities, view, limit, pose, inspected):
            return FOUND, made
        axis, widest = np.argmax(work.scores), np.argmax(stack.half[size])
        wide = stack.half[size, widest] > _LOOK_SHARE * view.tan_x * view.middle
        if size + 2 > _LEVELS or not (wide or work.scores[axis] >= _FINEST * total):
            outcome = UNRESOLVED
            continue
        axis = widest if wide else axis
        _halve(stack, size, axis, look)
        size += 2
    return outcome, made


@njit(cache=True, nogil=True)
def _planted(box, order, entities):
    """Return a stack with one box in which every entity of the order may be inspected."""
    m, n_cells = len(order), 0
    for e in order:
        n_cells += entities.entity_start[e + 1] - entities.entity_start[e]
    point = np.empty((5, _LEVELS, 3))
    stack = Stack(
        point[0],
        point[1],
        point[2],
        point[3],
        point[4],
        np.zeros(_LEVELS, np.int64),
        np.empty((_LEVELS, m), np.int64),
        np.zeros((_LEVELS, m), np.bool_),
        np.zeros((_LEVELS, m + 1), np.int64),
        np.empty((_LEVELS, n_cells), np.int32),
    )
    stack.look[0], stack.half[0], stack.turn[0], stack.span[0] = box[0], box[1], box[2], box[3]
    stack.met[0] = np.inf
    stack.count[0], at = m, 0
    for a in range(m):
        stack.members[0, a], stack.start[0, a] = order[a], at
        for cell in range(entities.entity_start[order[a]], entities.entity_start[order[a] + 1]):
            stack.cells[0, at] = cell
            at += 1
    stack.start[0, m] = at
    return stack


@njit(cache=True, nogil=True)
def _tighten(stack, i, chart, entities, view, y, work):
    """Drop the members that no pose of box i inspects; return the weight of the others. Fills ``work``."""
    q, h, v, u = stack.look[i], stack.half[i], stack.turn[i], stack.span[i]
    n = rotation(chart, v, work.matrix)
    t, nu = most_turn(v, u, n)
    extent(work.matrix, h, t, work.room)
    rest = swings(work.matrix, v, u, n, t, nu, view.middle, work.swing)
    radius = rest + math.sqrt(np.sum(h**2))
    for k in range(3):
        work.nodal[k] = q[k] - view.middle * work.matrix[k, 2]
        radius += math.sqrt(np.sum(work.swing[k] ** 2))
    work.scores[:] = 0.0
    s, far, opened, short = np.empty((2, 3)), np.empty(2), np.empty(2), np.zeros(2)
    deep = (view.far - view.near) / 2
    kept, at, total, doubt = 0, 0, 0.0, 0.0
    for a in range(stack.count[i]):
        e, least = stack.members[i, a], work.least[kept]
        if out_of_range(entities.ends[e], q, h, view.radius):
            continue
        seen_from(entities.ends[e], q, work.matrix, s)
        if too_short(entities.ends[e], entities.lengths[e], work.nodal, radius, view):
            continue
        farthest(s, entities.lengths[e], t, work.room, view, far, opened)
        window(s, far, v, u, n, t, nu, view, work.room, least, y[e], work.scores)
        if is_empty(least, work.room, view):
            continue
        cells = stack.cells[i, stack.start[i, a] : stack.start[i, a + 1]]
        n_cells = -1 if stack.sure[i, a] else keep_cells(entities, cells, work.nodal, h, work.swing, rest)
        if n_cells == 0:
            continue
        stack.members[i, kept], stack.sure[i, kept], stack.start[i, kept] = e, n_cells < 0, at
        # of one that is sure to be visible, one cell is kept: its pose is to be tried
        for c in range(max(n_cells, 1)):
            stack.cells[i, at] = cells[c]
            at += 1
        work.y[kept] = y[e]
        doubt += y[e] if n_cells > 0 else 0.0
        short[0] += y[e] * min(opened[0] / deep, _MOST_SHORT)
        short[1] += y[e] * min(opened[1] / deep, _MOST_SHORT)
        total += y[e]
        kept += 1
    stack.count[i], stack.start[i, kept] = kept, at
    doubt *= _DOUBT_SCORE / (view.tan_x * view.middle)
    for k in range(3):
        work.scores[k] = h[k] * (_LENGTH_SCORE * work.scores[k] + doubt + short[0] / np.sum(h))
        work.scores[3 + k] += doubt * math.sqrt(np.sum(work.swing[k] ** 2)) + short[1] * u[k] / np.sum(u)
    return total


@njit(cache=True, nogil=True)
def _is_heavy(stack, i, conflict, limit, view, work, w):
    """Tell whether windows heavier than the limit may meet in box i; if so, write where."""
    m = stack.count[i]
    exclusive_groups(stack.members[i, :m], conflict, work.group)
    least, group, y = work.least[:m], work.group[:m], work.y[:m]
    if np.isfinite(stack.met[i, 0]):
        # where they met before, they often still do
        w[:] = work.matrix.T @ (stack.met[i] - stack.look[i])
        w[:] = np.minimum(np.maximum(w, -work.room), work.room)
        if weight_at(least, group, y, w, view) > limit:
            return True
    return may_exceed(least, group, y, limit, work.room, view, w)


@njit(cache=True, nogil=True)
def _try_pose(stack, i, look, work, entities, view, limit, pose, inspected):
    """Tell whether the pose that looks at a point with the middle rotation inspects more than the limit; write it."""
    m, total = stack.count[i], 0.0
    nodal = look - view.middle * work.matrix[:, 2]
    zero, still, s = np.zeros(3), np.zeros((3, 3)), np.empty((2, 3))
    far, opened = np.empty(2), np.empty(2)
    one = np.empty(1, np.int32)
    inspected[:] = False
    for a in range(m):
        e = stack.members[i, a]
        if not _in_view(entities.ends[e], look, work.matrix, view):
            continue
        seen_from(entities.ends[e], look, work.matrix, s)
        farthest(s, entities.lengths[e], 0.0, zero, view, far, opened)
        if s[0, 2] + view.middle > far[0] or s[1, 2] + view.middle > far[1]:
            continue
        for c in range(stack.start[i, a], stack.start[i, a + 1]):
            one[0] = stack.cells[i, c]
            if keep_cells(entities, one, nodal, zero, still, 0.0) != 0:
                inspected[e] = True
                total += work.y[a]
                break
    pose[:3, :3], pose[:3, 3] = work.matrix, nodal
    return total > limit


@njit(cache=True, nogil=True)
def _in_view(ends, look, matrix, view):
    """Tell whether both ends are in focus and on the sensor."""
    for i in range(2):
        x, y, z = matrix.T @ (ends[i] - look)
        z += view.middle
        if z < view.near or z > view.far or abs(x) > view.tan_x * z or abs(y) > view.tan_y * z:
            return False
    return True


@njit(cache=True, nogil=True)
def _halve(stack, i, axis, met):
    """Replace box i by its halves in places i and i + 1; the one in which windows met comes on top."""
    for field in (stack.look, stack.half, stack.turn, stack.span):
        field[i + 1] = field[i]
    m = stack.count[i]
    n_cells = stack.start[i, m]
    stack.count[i + 1] = m
    stack.members[i + 1, :m] = stack.members[i, :m]
    stack.sure[i + 1, :m] = stack.sure[i, :m]
    stack.start[i + 1, : m + 1] = stack.start[i, : m + 1]
    stack.cells[i + 1, :n_cells] = stack.cells[i, :n_cells]
    stack.met[i], stack.met[i + 1] = met, met
    middle, size = (stack.look, stack.half) if axis < 3 else (stack.turn, stack.span)
    k = axis % 3
    half = size[i, k] / 2
    size[i, k] = size[i + 1, k] = half
    on_top = 1.0 if axis < 3 and met[k] > stack.look[i, k] else -1.0
    middle[i, k] -= on_top * half
    middle[i + 1, k] += on_top * half
