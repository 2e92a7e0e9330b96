"""Depth-first search of boxes of poses for one pose that inspects more than a given weight. Compiled loops.

A box is a box of points looked at, a box of turns and a box of nodal points; the first and the last one shrink to where
they agree. It is dropped when entities heavier than the limit are nowhere visible together (`planner.viewpoints`), or
no windows heavier than the limit may meet in it: with windows made larger by all that the turn can do
(`planner.stabbing`), or, where the turn is small, with windows that move with it (`planner.meeting`). Where they meet,
the pose is tried at once: if it satisfies all conditions for more than the limit, the search is over. Else the box is
halved: along the coordinate that most widens the windows or most leaves visibility, or the length of images, in doubt;
where the turn is small, the box of nodal points is, or the turn if that blurs more. If it ends without, no pose does.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planner.linearsides import linear_sides
from planner.meeting import NO, YES, may_meet
from planner.posebox import (
    extent,
    farthest,
    hidden_around,
    is_empty,
    keep_cells,
    most_turn,
    out_of_focus,
    out_of_range,
    rotation,
    seen_from,
    swings,
    too_short,
    window,
)
from planner.posestack import LEVELS, agree, halve, keep_members, new_work, planted
from planner.posetrial import LENGTH, SIGHT, VIEW, try_pose
from planner.stabbing import exclusive_groups, may_exceed, weight_at
from planner.viewpoints import heavy_members

PROVEN, FOUND, UNRESOLVED, SPENT, NEARLY = range(5)

# boxes about the point looked at are first made as small as this share of half the view's width
_LOOK_SHARE = 0.5
# how much the length of s, doubtful visibility and doubtful length of the image count in the choice of the coordinate
_LENGTH_SCORE = 0.3
_DOUBT_SCORE = 1.0
# the most that one image of doubtful length counts
_MOST_SHORT = 4.0
_EPS = 1e-12
# boxes whose coordinates all do less than this are not halved, unless the turn is larger than that
_FINEST = 1e-4
_WIDE_TURN = 1e-2
# of the share of the nodal points from where enough is visible: up to this much they are halved themselves
_MOST_SEEN = 0.3
# nor do they need to be so few where they are as near to the sides of cells, in radii of visibility
_NEAR_SIDES = 8.0
# but not below this share of what points looked at and turn leave open
_EYE_SHARE = 0.2
# where more than this share sees enough, it is not asked again for so many halvings: little would be learnt
_MUCH_SEEN, _PAUSE = 0.6, 3
# where the depth in focus is less than this share of the view's width, the turn is what loses: windows are linear in it
# up to so much, rad of half the angle
_THIN, _SMALL_TURN = 0.15, 0.1
# parts of such a box looked at, at most, and how many cost as much as a box
_MOST_PARTS, _PARTS_PER_BOX = 64, 25
# smaller boxes of these are not halved further: turn, in its coordinates, and nodal points, mm
_LEAST_TURN, _LEAST_MM = 1e-5, 1e-3


@njit(cache=True, nogil=True)
def search(box, chart, order, entities, view, conflict, tree, y, limit, max_nodes, stop, pose, inspected):
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
    tree : Viewpoints
        What may be inspected from where.
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
        PROVEN: no pose exceeds the limit. FOUND: one does. NEARLY: all that may be inspected from a box too small to be
        halved does. UNRESOLVED: none was found, but boxes not to be halved further are left. SPENT: more
        boxes would be needed.
    made : int
        Boxes looked at; those with parts count for several.
    """
    stack = planted(box, order, entities, tree.boxes[0])
    m = len(y)
    work, look, x, meets = new_work(m), np.empty(3), np.zeros(6), np.ones(m, np.bool_)
    trial = pose, inspected, np.zeros(3), look
    thin = view.far - view.near < _THIN * 2.0 * view.tan_x * view.middle
    size, made, outcome = 1, 0, PROVEN
    while size > 0:
        if made >= max_nodes or stop[0]:
            return SPENT, made
        size, made = size - 1, made + 1
        i = size
        total, rest, doubt, short = _tighten(stack, i, chart, entities, view, y, work)
        if total <= limit:
            continue
        total, seen = _drop_unseen(stack, i, conflict, limit, tree, work, rest)
        if total <= limit:
            continue
        exclusive_groups(stack.members[i, : stack.count[i]], conflict, work.group)
        small, answer = thin and _is_small(stack, i), YES
        if small:
            made += _MOST_PARTS // _PARTS_PER_BOX
            answer = _may_meet(stack, i, entities, view, limit, work, rest, x, meets[: stack.count[i]])
        elif not _is_heavy(stack, i, limit, view, work, x, meets):
            answer = NO
        if answer == NO:
            continue
        if try_pose(stack, i, chart, x, meets, entities, view, work, trial) > limit:
            return FOUND, made
        if small:
            axis = _nodal_or_turn(stack, i, rest, answer, trial[2])
            if axis < 0:
                # too small to be halved
                inspected[:] = False
                for e in stack.members[i, : stack.count[i]]:
                    inspected[e] = True
                return NEARLY, made
        else:
            _score(stack, i, work, rest, doubt, short, seen, entities.around)
            axis = _axis_to_halve(stack, i, work, total, view)
        if size + 2 > LEVELS or axis < 0:
            outcome = UNRESOLVED
            continue
        halve(stack, i, axis, look, x[3:], pose[:3, 3])
        size += 2
    return outcome, made


@njit(cache=True, nogil=True)
def _tighten(stack, i, chart, entities, view, y, work):
    """Drop the members that no pose of box i inspects; return the weight of the others. Fills ``work``.

    Also returns the remainder of the swings, the weight of which visibility is in doubt, and of which the length is, as
    far as only the points looked at and only the turn are to blame.
    """
    q, h, v, u, eye = stack.look[i], stack.half[i], stack.turn[i], stack.span[i], stack.eye[i]
    n = rotation(chart, v, work.matrix)
    t, nu = most_turn(v, u, n)
    rest = swings(work.matrix, v, u, n, t, nu, view.middle, work.swing)
    s, far, opened, short = np.empty((2, 3)), np.empty(2), np.empty(2), np.zeros(2)
    if not agree(stack, i, work, rest, view.middle):
        return 0.0, rest, 0.0, short
    extent(work.matrix, h, t, work.room)
    work.scores[:] = 0.0
    deep = (view.far - view.near) / 2
    kept, at, total, doubt = 0, 0, 0.0, 0.0
    middle, radius = (eye[0] + eye[1]) / 2, math.sqrt(np.sum((eye[1] - eye[0]) ** 2)) / 2
    for a in range(stack.count[i]):
        e, least = stack.members[i, a], work.least[kept]
        ends, length = entities.ends[e], entities.lengths[e]
        if out_of_range(ends, q, h, view.radius) or out_of_focus(ends, eye, view):
            continue
        if too_short(ends, length, middle, radius, view):
            continue
        seen_from(ends, q, work.matrix, s)
        farthest(s, length, t, work.room, view, far, opened)
        window(s, far, v, u, n, t, nu, view, work.room, least, y[e], work.scores)
        if is_empty(least, work.room, view):
            continue
        cells = stack.cells[i, stack.start[i, a] : stack.start[i, a + 1]]
        n_cells = -1 if stack.sure[i, a] else keep_cells(entities, cells, work.nodal, h, work.swing, rest, eye)
        if n_cells == 0 or (n_cells > 0 and hidden_around(entities, cells[:n_cells], eye)):
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
    return total, rest, doubt, short


@njit(cache=True, nogil=True)
def _drop_unseen(stack, i, conflict, limit, tree, work, rest):
    """Drop members that are nowhere visible with more than the limit; return the weight left and the share seen."""
    m = stack.count[i]
    if stack.pause[i] > 0:
        stack.pause[i] -= 1
        return work.y[:m].sum(), 1.0
    exclusive_groups(stack.members[i, :m], conflict, work.group)
    live = np.zeros(tree.sets.shape[1], np.uint64)
    request = stack.members[i, :m], work.y[:m], work.group[:m], limit
    box = work.nodal, work.matrix, stack.half[i], work.swing, rest
    seen = heavy_members(tree, box, stack.eye[i], request, live)
    if seen > _MUCH_SEEN:
        stack.pause[i] = _PAUSE
    return keep_members(stack, i, work, live), seen


@njit(cache=True, nogil=True)
def _is_small(stack, i):
    """Tell whether the turns of box i are small enough for linear windows."""
    v = stack.turn[i]
    return most_turn(v, stack.span[i], 1.0 + np.sum(v * v))[0] <= _SMALL_TURN


@njit(cache=True, nogil=True)
def _is_heavy(stack, i, limit, view, work, x, meets):
    """Tell whether windows heavier than the limit may meet in box i; if so, write where, with the middle rotation."""
    m, w = stack.count[i], x[:3]
    x[3:], meets[:m] = 0.0, True
    least, group, y = work.least[:m], work.group[:m], work.y[:m]
    if np.isfinite(stack.met[i, 0]):
        # where they met before, they often still do
        w[:] = work.matrix.T @ (stack.met[i] - stack.look[i])
        w[:] = np.minimum(np.maximum(w, -work.room), work.room)
        if weight_at(least, group, y, w, view) > limit:
            return True
    return may_exceed(least, group, y, limit, work.room, view, w)


@njit(cache=True, nogil=True)
def _score(stack, i, work, rest, doubt, short, seen, around):
    """Add to the scores what each coordinate of box i leaves open of lengths and of visibility."""
    h, u, eye = stack.half[i], stack.span[i], stack.eye[i]
    for k in range(3):
        work.scores[k] = h[k] * (_LENGTH_SCORE * work.scores[k] + short[0] / max(np.sum(h), _EPS))
        work.scores[3 + k] += short[1] * u[k] / np.sum(u)
    for axis in range(3):
        reach = h[axis] + np.abs(work.swing[:, axis]).sum() + rest
        half = (eye[1, axis] - eye[0, axis]) / 2
        few = seen < _MOST_SEEN or half < _NEAR_SIDES * around
        if few and _EYE_SHARE * reach < half < 0.99 * reach:
            work.scores[6 + axis] += doubt * half
            continue
        # the nodal point is known better than that
        part = doubt * min(1.0, half / max(reach, _EPS))
        work.scores[axis] += part * h[axis]
        for k in range(3):
            work.scores[3 + k] += part * abs(work.swing[k, axis])


@njit(cache=True, nogil=True)
def _axis_to_halve(stack, i, work, total, view):
    """Return along which coordinate box i is to be halved; -1 if it is too small for that."""
    axis, widest = np.argmax(work.scores), np.argmax(stack.half[i])
    if stack.half[i, widest] > _LOOK_SHARE * view.tan_x * view.middle:
        return widest
    if work.scores[axis] >= _FINEST * total:
        return axis
    widest = np.argmax(stack.span[i])
    return 3 + widest if stack.span[i, widest] > _WIDE_TURN else -1


@njit(cache=True, nogil=True)
def _may_meet(stack, i, entities, view, limit, work, rest, x, meets):
    """Answer whether windows heavier than the limit may meet in box i, of small turns; see `planner.meeting`."""
    m, u, eye = stack.count[i], stack.span[i], stack.eye[i]
    n = linear_sides(stack, i, entities, view, work, rest)
    sides, members = (work.rows[:n], work.rhs[:n], work.owner[:n]), (work.group[:m], work.y[:m])
    low, high, slope = np.empty(6), np.empty(6), np.zeros((3, 3))
    low[:3], low[3:], high[:3], high[3:] = -work.room, -u, work.room, u
    # with a turn, w is tried such that the nodal point stays in the middle
    for j in range(3):
        for k in range(3):
            for c in range(3):
                slope[j, k] += work.matrix[c, j] * work.swing[k, c] / u[k]
    seat = work.matrix.T @ ((eye[0] + eye[1]) / 2 - work.nodal), slope
    return may_meet(sides, members, limit, (low, high), seat, _MOST_PARTS, x, meets)


@njit(cache=True, nogil=True)
def _nodal_or_turn(stack, i, rest, answer, lost):
    """Return along which coordinate a box of small turns is to be halved; -1 if it is too small for that.

    The nodal points decide visibility and length, and tie the points looked at to the turn. What the turn makes
    uncertain of that should not be more than there is of them.
    """
    u, half = stack.span[i], (stack.eye[i, 1] - stack.eye[i, 0]) / 2
    if rest > half.max() or (answer == YES and lost[VIEW] > max(lost[SIGHT], lost[LENGTH])):
        return 3 + np.argmax(u) if u.max() > _LEAST_TURN else -1
    return 6 + np.argmax(half) if half.max() > _LEAST_MM else -1
