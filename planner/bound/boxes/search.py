"""Depth-first search of boxes of poses for one pose that inspects more than a given weight. Compiled loops.

A box is a box of points looked at, a box of turns and a box of nodal points; the first and the last one shrink to where
they agree. It is dropped when entities heavier than the limit are nowhere visible together
(`planner.bound.boxes.viewpoint_tree`), or no windows heavier than the limit may meet in it: with windows made larger by
all that the turn can do (`planner.bound.boxes.shifted_windows`), or, where the turn is small, with windows that move
with it (`planner.bound.boxes.linear_windows`). Where they meet, the pose is tried at once: if it satisfies all
conditions for more than the limit, the search is over. Else the box is halved: along the coordinate that most widens
the windows or most leaves visibility, or the length of images, in doubt; where the turn is small, the box of nodal
points is, or the turn if that blurs more. If it ends without, no pose does.
"""

from __future__ import annotations

import math

import numpy as np

from compiled.decorators import entry_kernel, kernel, kernel_without_refcounts
from planner.bound.boxes.box_conditions import ends_out_of_focus, too_short
from planner.bound.boxes.exclusive_groups import exclusive_groups
from planner.bound.boxes.linear_windows import NO, YES
from planner.bound.boxes.shifted_windows import may_exceed, weight_at
from planner.bound.boxes.small_turns import is_small, may_see, nodal_or_turn
from planner.bound.boxes.stack import LEVELS, agree, halve, keep_members, new_work, planted
from planner.bound.boxes.trial import Trial, try_pose
from planner.bound.boxes.view import OF_LOOK, OF_NODAL, OF_TURN
from planner.bound.boxes.viewpoint_tree import Asked, PosesBox, heavy_members
from planner.bound.boxes.visibility import hidden_around, keep_cells, out_of_range
from planner.bound.boxes.windows import (
    Turn,
    extent,
    farthest,
    is_empty,
    most_turn,
    rotation,
    seen_from,
    swings,
    turned_back,
    window,
)

PROVEN, FOUND, UNRESOLVED, SPENT, NEARLY = range(5)

# for rounding, and no zero to divide by
_EPS = 1e-12


@entry_kernel(nogil=True)
def search(box, chart, order, entities, view, tree, task, pose, inspected):
    """Search a box of poses.

    Parameters
    ----------
    box : array (4, 3)
        q0, h, v0 and u, see `planner.bound.boxes.windows`.
    chart : int
    order : array of int (m,)
        The entities that count, in descending order of weight.
    entities, view : Entities, View
        The request.
    tree : Viewpoints
        What may be inspected from where.
    task : SearchTask
        Which pose is looked for, and for how long.
    pose : array (4, 4)
        The pose found is written here; camera to part.
    inspected : array of bool (e,)
        What it inspects is written here.

    Returns
    -------
    outcome : int
        PROVEN: no pose exceeds the limit. FOUND: one does. NEARLY: all that may be inspected from a box too small to be
        halved does. UNRESOLVED: none was found, but boxes not to be halved further are left. SPENT: more
        boxes would be needed; ``inspected`` is what may be inspected from the one to come.
    made : int
        Boxes looked at; those with parts count for several.
    """
    y = task.y
    limit = task.limit
    max_nodes = task.max_nodes
    stop = task.stop
    effort = task.effort
    halving = effort.halving
    asking = effort.asking
    stack = planted(box, order, entities, tree.boxes[0])
    m = len(y)
    work = new_work(m)
    look = np.empty(3)
    x = np.zeros(6)
    meets = np.ones(m, np.bool_)
    trial = Trial(pose, inspected, np.zeros(3), look)
    thin = view.far - view.near < asking.thin * 2.0 * view.tan_x * view.middle
    size = 1
    made = 0
    outcome = PROVEN
    while size > 0:
        if made >= max_nodes or stop[0]:
            _write_members(stack, size - 1, inspected)
            return SPENT, made
        size = size - 1
        made = made + 1
        i = size
        total, rest, doubt, short = _tighten(stack, i, chart, entities, view, y, work, halving)
        if total <= limit:
            continue
        total, seen = _drop_unseen(stack, i, task, tree, work, rest)
        if total <= limit:
            continue
        small = thin and is_small(stack, i, effort.small_turns)
        if small:
            answer, n_parts = may_see(stack, i, entities, view, task, work, rest, x, meets)
            made += n_parts // asking.parts_per_box
        else:
            answer = _may_see(stack, i, task, view, work, x, meets)
        if answer == NO:
            continue
        if try_pose(stack, i, chart, x, meets, entities, view, work, trial) > limit:
            return FOUND, made
        if small:
            axis = nodal_or_turn(stack, i, rest, answer, trial.lost, effort.small_turns)
            if axis < 0:
                _write_members(stack, i, inspected)
                return NEARLY, made
        else:
            _score(stack, i, work, rest, doubt, short, seen, entities.around, halving)
            axis = _axis_to_halve(stack, i, work, total, view, halving)
        if size + 2 > LEVELS or axis < 0:
            outcome = UNRESOLVED
            continue
        halve(stack, i, axis, look, x[3:], pose[:3, 3])
        size += 2
    return outcome, made


@kernel
def _tighten(stack, i, chart, entities, view, y, work, halving):
    """Drop the members that no pose of box i inspects; return the weight of the others. Fills ``work``.

    Also returns the remainder of the swings, the weight of which visibility is in doubt, and of which the length is, as
    far as only the points looked at and only the turn are to blame.
    """
    q = stack.look[i]
    h = stack.half[i]
    v = stack.turn[i]
    u = stack.span[i]
    eye = stack.eye[i]
    n = rotation(chart, v, work.matrix)
    t, nu = most_turn(v, u, n)
    turn = Turn(v, u, n, t, nu)
    rest = swings(work.matrix, v, u, n, t, nu, view.middle, work.swing)
    s = np.empty((2, 3))
    far = np.empty(2)
    opened = np.empty(2)
    short = np.zeros(2)
    if not agree(stack, i, work, rest, view.middle):
        return 0.0, rest, 0.0, short
    extent(work.matrix, h, t, work.room)
    work.scores[:] = 0.0
    deep = (view.far - view.near) / 2
    kept = 0
    at = 0
    total = 0.0
    doubt = 0.0
    middle = (eye[0] + eye[1]) / 2
    radius = math.sqrt(np.sum((eye[1] - eye[0]) ** 2)) / 2
    for a in range(stack.n_members[i]):
        e = stack.members[i, a]
        least = work.least[kept]
        ends = entities.ends[e]
        length = entities.lengths[e]
        ratio = entities.length_ratio[e]
        if out_of_range(ends, q, h, view.radius) or ends_out_of_focus(ends, eye, view):
            continue
        if too_short(ends, length, ratio, middle, radius, view):
            continue
        seen_from(ends, q, work.matrix, s)
        farthest(s, length, ratio, t, work.room, view, far, opened)
        window(s, far, turn, view, work.room, least, y[e], work.scores)
        if is_empty(least, work.room, view):
            continue
        cells = stack.cells[i, stack.start[i, a] : stack.start[i, a + 1]]
        n_cells = -1
        if not stack.sure[i, a]:
            n_cells = keep_cells(entities, cells, work.nodal, h, work.swing, rest, eye)
        if n_cells == 0 or (n_cells > 0 and hidden_around(entities, cells[:n_cells], eye)):
            continue
        at = _put_member(stack, i, kept, at, e, cells, n_cells)
        work.y[kept] = y[e]
        doubt += y[e] if n_cells > 0 else 0.0
        short[0] += y[e] * min(opened[0] / deep, halving.most_short)
        short[1] += y[e] * min(opened[1] / deep, halving.most_short)
        total += y[e]
        kept += 1
    stack.n_members[i] = kept
    stack.start[i, kept] = at
    doubt *= halving.doubt_score / (view.tan_x * view.middle)
    return total, rest, doubt, short


@kernel
def _put_member(stack, i, kept, at, e, cells, n_cells):
    """Write a member of box i and its cells, from place ``at``; return the place after them."""
    stack.members[i, kept] = e
    stack.sure[i, kept] = n_cells < 0
    stack.start[i, kept] = at
    # of one that is sure to be visible, one cell is kept: its pose is to be tried
    for c in range(max(n_cells, 1)):
        stack.cells[i, at] = cells[c]
        at += 1
    return at


@kernel
def _drop_unseen(stack, i, task, tree, work, rest):
    """Drop members that are nowhere visible with more than the limit; return the weight left and the share seen."""
    m = stack.n_members[i]
    if stack.pause[i] > 0:
        stack.pause[i] -= 1
        return work.y[:m].sum(), 1.0
    exclusive_groups(stack.members[i, :m], task.conflict, work.group)
    live = np.zeros(tree.sets.shape[1], np.uint64)
    asked = Asked(stack.members[i, :m], work.y[:m], work.group[:m], task.limit)
    box = PosesBox(work.nodal, work.matrix, stack.half[i], work.swing, rest)
    seen = heavy_members(tree, box, stack.eye[i], asked, live, task.effort.growth)
    if seen > task.effort.asking.much_seen:
        stack.pause[i] = task.effort.asking.pause
    return keep_members(stack, i, work, live), seen


@kernel_without_refcounts
def _write_members(stack, i, inspected):
    """Write all that may be inspected from box i."""
    inspected[:] = False
    for e in stack.members[i, : stack.n_members[i]]:
        inspected[e] = True


@kernel
def _may_see(stack, i, task, view, work, x, meets):
    """Answer whether windows heavier than the limit may meet in box i; if so, write where, with the middle rotation."""
    m = stack.n_members[i]
    limit = task.limit
    w = x[:3]
    x[3:] = 0.0
    meets[:m] = True
    exclusive_groups(stack.members[i, :m], task.conflict, work.group)
    least = work.least[:m]
    group = work.group[:m]
    y = work.y[:m]
    if np.isfinite(stack.met[i, 0]):
        # where they met before, they often still do
        away = stack.met[i] - stack.look[i]
        w[0], w[1], w[2] = turned_back(work.matrix, away[0], away[1], away[2])
        for k in range(3):
            w[k] = min(max(w[k], -work.room[k]), work.room[k])
        if weight_at(least, group, y, w, view) > limit:
            return YES
    meeting = task.effort.meeting
    return YES if may_exceed(least, group, y, limit, work.room, view, w, meeting) else NO


@kernel
def _score(stack, i, work, rest, doubt, short, seen, around, halving):
    """Add to the scores what each coordinate of box i leaves open of lengths and of visibility."""
    h = stack.half[i]
    u = stack.span[i]
    eye = stack.eye[i]
    for k in range(3):
        work.scores[OF_LOOK + k] = h[k] * (
            halving.length_score * work.scores[OF_LOOK + k] + short[0] / max(np.sum(h), _EPS)
        )
        work.scores[OF_TURN + k] += short[1] * u[k] / np.sum(u)
    for axis in range(3):
        reach = h[axis] + np.abs(work.swing[:, axis]).sum() + rest
        half = (eye[1, axis] - eye[0, axis]) / 2
        few = seen < halving.most_seen or half < halving.near_sides * around
        if few and halving.eye_share * reach < half < 0.99 * reach:
            work.scores[OF_NODAL + axis] += doubt * half
            continue
        # the nodal point is known better than that
        part = doubt * min(1.0, half / max(reach, _EPS))
        work.scores[OF_LOOK + axis] += part * h[axis]
        for k in range(3):
            work.scores[OF_TURN + k] += part * abs(work.swing[k, axis])


@kernel_without_refcounts
def _axis_to_halve(stack, i, work, total, view, halving):
    """Return along which coordinate box i is to be halved; -1 if it is too small for that."""
    axis = np.argmax(work.scores)
    widest = np.argmax(stack.half[i])
    if stack.half[i, widest] > halving.look_share * view.tan_x * view.middle:
        return OF_LOOK + widest
    if work.scores[axis] >= halving.finest * total:
        return axis
    widest = np.argmax(stack.span[i])
    return OF_TURN + widest if stack.span[i, widest] > halving.wide_turn else -1
