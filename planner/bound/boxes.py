"""Depth-first search of boxes of poses for one pose that inspects more than a given weight. Compiled loops.

A box is a box of points looked at, a box of turns and a box of nodal points; the first and the last one shrink to where
they agree. It is dropped when entities heavier than the limit are nowhere visible together
(`planner.bound.boxes`), or no windows heavier than the limit may meet in it: with windows made larger by
all that the turn can do (`planner.bound.windows`), or, where the turn is small, with windows that move
with it (`planner.bound.windows`). Where they meet, the pose is tried at once: if it satisfies all
conditions for more than the limit, the search is over. Else the box is halved: along the coordinate that most widens
the windows or most leaves visibility, or the length of images, in doubt; where the turn is small, the box of nodal
points is, or the turn if that blurs more. If it ends without, no pose does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ground.decorators import entry_kernel, kernel, kernel_without_refcounts, put, put_table
from planner.bound.view import (
    HALF,
    LOOK,
    OF_LOOK,
    OF_NODAL,
    OF_TURN,
    SPAN,
    TURN,
    Entities,
    View,
    ends_out_of_focus,
    exclusive_groups,
    hidden_around,
    holds_point,
    keep_cells,
    out_of_range,
    too_short,
)
from planner.bound.windows import (
    NO,
    YES,
    Members,
    Seat,
    Sides,
    Turn,
    extent,
    farthest,
    find_apart,
    is_empty,
    linear_sides,
    may_exceed,
    may_meet,
    most_turn,
    rotation,
    seen_from,
    swings,
    turned_back,
    weight_at,
    window,
)

# What may be inspected from where, whatever the direction: a tree of boxes of viewpoints.
# Compiled loops.
#
# A box of viewpoints gets the entities that may be visible from it and all around, in focus, and
# long enough. It is halved where they weigh more than some limit and visibility is in doubt. The
# sets hold for any weights; the weights only say where to look closely.


# largest number of waiting boxes: one for each halving
_DEPTH = 64
# grow the tree again with boxes half as large until it has this many
_ENOUGH_BOXES = 25_000
# largest number of boxes. It limits the memory.
_MOST_BOXES = 400_000
# width of the smallest boxes at first, as a share of the whole
_COARSE = 2.0**-4
# smallest width of these boxes later, as a share of the whole
_FINE = 2.0**-10
# largest number of boxes that one query may halve. Its gain must not take longer than the
# search.
_HALVED = 1024

# for rounding, mm
_EPS = 1e-9


class Viewpoints(NamedTuple):
    """A tree of boxes in preorder, the first half of each coming right after it.

    Attributes
    ----------
    boxes : array (n, 2, 3)
        Lowest and highest coordinates.
    second : array of int (n,)
        Where the second half is; 0: not halved.
    sets : array of uint64 (n, w)
        Entities that may be inspected from there, one bit each.
    finest : float
        Boxes as wide as this, mm, are not halved.
    """

    boxes: np.ndarray
    second: np.ndarray
    sets: np.ndarray
    finest: float


class PosesBox(NamedTuple):
    """A box of poses: nodal point and rotation in the middle, half size of the points looked at, swings, remainder."""

    nodal: np.ndarray
    matrix: np.ndarray
    half: np.ndarray
    swing: np.ndarray
    turn: float


class Asked(NamedTuple):
    """What is asked for: members (m,), their weights and groups of which one counts, and the limit."""

    members: np.ndarray
    y: np.ndarray
    group: np.ndarray
    limit: float


def viewpoints_for(
    root: np.ndarray,
    entities: Entities,
    view: View,
    y: np.ndarray,
    limit: float,
    finest: float | None = None,
) -> Viewpoints:
    """Grow a tree in a box that is fine enough where entities of more weight than a limit may be inspected.

    Parameters
    ----------
    root : array (2, 3)
        Lowest and highest coordinates, mm.
    entities, view
        The request.
    y : array (e,)
        Weights.
    limit : float
    finest : float, optional
        Width of boxes to start with that are not halved further, mm.
    """
    whole = float((root[1] - root[0]).max())
    finest = finest or _COARSE * whole
    while True:
        boxes, second, sets = _grow(root, entities, view, y, limit, finest)
        if len(second) >= _ENOUGH_BOXES or finest < _FINE * whole:
            return Viewpoints(boxes, second, sets, finest)
        finest /= 2


# threads run it side by side
@entry_kernel(nogil=True)
def _grow(root, entities, view, y, limit, finest):
    """Return boxes, second halves and sets of a tree."""
    m = len(entities.ends)
    n_cells = entities.entity_start[-1]
    boxes = np.empty((_MOST_BOXES, 2, 3))
    second = np.zeros(_MOST_BOXES, np.int32)
    sets = np.zeros((_MOST_BOXES, m // 64 + 1), np.uint64)
    place = np.empty((_DEPTH, 2, 3))
    parent = np.full(_DEPTH, -1)
    count = np.zeros(_DEPTH, np.int64)
    members = np.empty((_DEPTH, m), np.int64)
    sure = np.zeros((_DEPTH, m), np.bool_)
    start = np.zeros((_DEPTH, m + 1), np.int64)
    cells = np.empty((_DEPTH, n_cells), np.int32)
    put_table(place[0], root)
    count[0] = m
    put(members[0], np.arange(m))
    put(start[0], entities.entity_start)
    put(cells[0], np.arange(n_cells))
    size = 1
    made = 0
    while size > 0:
        size -= 1
        i = size
        count[i], doubt = _keep(
            place[i], members[i, : count[i]], sure[i], start[i], cells[i], entities, view
        )
        total = 0.0
        for e in members[i, : count[i]]:
            sets[made, e // 64] |= np.uint64(1) << np.uint64(e % 64)
            total += y[e]
        put_table(boxes[made], place[i])
        if parent[i] >= 0:
            second[parent[i]] = made
        width = place[i, 1] - place[i, 0]
        axis = np.argmax(width)
        if (
            doubt
            and total > limit
            and width[axis] > finest
            and size + 2 <= _DEPTH
            and made + size + 2 < _MOST_BOXES
        ):
            n = count[i]
            at = start[i, count[i]]
            count[i + 1] = n
            put(members[i + 1], members[i, :n])
            put(sure[i + 1], sure[i, :n])
            put(start[i + 1], start[i, : n + 1])
            put(cells[i + 1], cells[i, :at])
            put_table(place[i + 1], place[i])
            place[i + 1, 1, axis] = place[i, 0, axis] = (place[i, 0, axis] + place[i, 1, axis]) / 2
            parent[i] = made
            parent[i + 1] = -1
            size += 2
        made += 1
    return boxes[:made].copy(), second[:made].copy(), sets[:made].copy()


@kernel
def _keep(box, members, sure, start, cells, entities, view):
    """Keep the members that may be inspected from a box; return how many, and whether any may also be hidden."""
    still = np.zeros((3, 3))
    middle = (box[0] + box[1]) / 2
    half = (box[1] - box[0]) / 2
    radius = math.sqrt(np.sum(half**2))
    n_live = 0
    at = 0
    doubt = False
    for a in range(len(members)):
        e = members[a]
        ends = entities.ends[e]
        if ends_out_of_focus(ends, box, view):
            continue
        if too_short(ends, entities.lengths[e], entities.length_ratio[e], middle, radius, view):
            continue
        own_cells = cells[start[a] : start[a + 1]]
        n = -1 if sure[a] else keep_cells(entities, own_cells, middle, half, still, 0.0, box)
        if n == 0 or (n > 0 and hidden_around(entities, own_cells[:n], box)):
            continue
        members[n_live] = e
        sure[n_live] = n < 0
        start[n_live] = at
        for k in range(max(n, 1)):
            cells[at] = own_cells[k]
            at += 1
        doubt = doubt or n > 0
        n_live += 1
    start[n_live] = at
    return n_live, doubt


@kernel
def heavy_members(tree, box, eye, asked, live):
    """Find from where members heavier than a limit may be inspected.

    Parameters
    ----------
    tree : Viewpoints
    box : PosesBox
    eye : array (2, 3)
        Where the nodal point may be; shrunk to from where so much may be inspected.
    asked : Asked
    live : array of uint64 (w,)
        Is set to the bits of the members inspected from there.

    Returns
    -------
    float
        The share of that volume from where so much may be inspected.
    """
    boxes = tree.boxes
    sets = tree.sets
    nodes = np.empty(_HALVED + _DEPTH, np.int64)
    hull = np.empty((2, 3))
    volume = 0.0
    hull[0] = np.inf
    hull[1] = -np.inf
    for i in range(_heavy_nodes(tree, box, eye, asked, nodes)):
        node = nodes[i]
        part = 1.0
        for word in range(len(live)):
            live[word] |= sets[node, word]
        for k in range(3):
            low = max(eye[0, k], boxes[node, 0, k])
            high = min(eye[1, k], boxes[node, 1, k])
            part *= high - low
            hull[0, k] = min(hull[0, k], low)
            hull[1, k] = max(hull[1, k], high)
        volume += part
    if hull[0, 0] <= hull[1, 0]:
        put_table(eye, hull)
    return volume / max(np.prod(eye[1] - eye[0]), _EPS)


@kernel
def _heavy_nodes(tree, box, eye, asked, nodes):
    """Write the nodes, not halved further, from where enough may be inspected in a box; return how many."""
    members, y, group, limit = asked
    # arrays by their own names, and no calls: else most of the time goes into counting references
    boxes = tree.boxes
    sets = tree.sets
    second = tree.second
    c = box.nodal
    matrix = box.matrix
    across = _extents(box)
    m = len(members)
    # of a member and all after it
    after = np.zeros(m + 1)
    for a in range(m - 1, -1, -1):
        after[a] = after[a + 1] + y[a]
    todo = np.zeros(_DEPTH, np.int64)
    seen = np.zeros(m, np.int64)
    size = 1
    looked = 0
    n = 0
    while size > 0:
        size -= 1
        node = todo[size]
        # whether its box meets the other one, and may meet the nodal points
        apart = False
        for i in range(3):
            off = 0.0
            reach = across[i]
            for k in range(3):
                off += matrix[k, i] * ((boxes[node, 0, k] + boxes[node, 1, k]) / 2 - c[k])
                reach += abs(matrix[k, i]) * (boxes[node, 1, k] - boxes[node, 0, k]) / 2
            outside = boxes[node, 0, i] > eye[1, i] or boxes[node, 1, i] < eye[0, i]
            apart = apart or outside or abs(off) > reach
        if apart:
            continue
        looked += 1
        total = 0.0
        for a in range(m):
            if total > limit or total + after[a] <= limit:
                break
            e = members[a]
            if sets[node, e >> 6] >> np.uint64(e & 63) & np.uint64(1) and seen[group[a]] != looked:
                seen[group[a]] = looked
                total += y[a]
        if total <= limit:
            continue
        if second[node] > 0 and looked < _HALVED:
            todo[size] = second[node]
            todo[size + 1] = node + 1
            size += 2
            continue
        nodes[n] = node
        n += 1
    return n


@kernel
def _extents(box):
    """Return how far along the camera's axes the nodal points of a box of poses are from the middle one; (3,)."""
    _, matrix, h, swing, remainder = box
    across = np.full(3, remainder + _EPS)
    for i in range(3):
        for k in range(3):
            across[i] += h[k] * abs(matrix[k, i])
            across[i] += abs(
                swing[k, 0] * matrix[0, i] + swing[k, 1] * matrix[1, i] + swing[k, 2] * matrix[2, i]
            )
    return across


# Depth-first search of boxes of poses for one pose that inspects more than a given weight.
# Compiled loops.
#
# A box is a box of points looked at, a box of turns and a box of nodal points; the first and the
# last one shrink to where they agree. It is dropped when entities heavier than the limit are
# nowhere visible together (`planner.bound.boxes`), or no windows heavier than the
# limit may meet in it: with windows made larger by all that the turn can do
# (`planner.bound.windows`), or, where the turn is small, with windows that move with it
# (`planner.bound.windows`). Where they meet, the pose is tried at once: if it satisfies all
# conditions for more than the limit, the search is over. Else the box is halved: along the
# coordinate that most widens the windows or most leaves visibility, or the length of images, in
# doubt; where the turn is small, the box of nodal points is, or the turn if that blurs more. If
# it ends without, no pose does.


# boxes of look points first shrink to this share of half the view's width. Larger ones cut
# hardly any window.
_LOOK_SHARE = 0.5
# weight of the length of s in the choice of the coordinate, relative to the width of windows
_LENGTH_SCORE = 0.3
# weight of doubtful visibility in the choice of the coordinate
_DOUBT_SCORE = 1.0
# largest weight of one image of doubtful length, as a multiple of half the depth of field
_MOST_SHORT = 4.0
# boxes are not halved if all coordinates contribute less than this share of the weight
_FINEST_SHARE = 1e-4
# they are halved anyway if the turn, in its own coordinates, is wider than this
_WIDE_TURN = 1e-2
# halve the box of nodal points itself, if at most this share of them sees enough. The halving
# then decides much.
_MOST_SEEN = 0.3
# the same without this condition for a box at most this many radii of visibility wide, because
# it is near the boundary of cells
_NEAR_SIDES = 8.0
# but do not halve it below this share of the uncertainty from look points and turn, which must
# follow
_EYE_SHARE = 0.2
# if more than this share of the nodal points sees enough, pause the check, because it would gain
# little
_MUCH_SEEN = 0.6
# number of halvings of this pause
_PAUSE = 3
# if the depth in focus is less than this share of the view's width, windows are linear in the
# turn. The turn then causes most of the loss.
_THIN = 0.15
# this many parts of a box of small turns cost as much as a box and count as one
_PARTS_PER_BOX = 25
# tangent of half the largest angle of a small turn. Windows that are linear in it omit its
# square, a hundredth.
_SMALL_TURN = 0.1
# largest number of parts of a box to check before the box itself is halved
_PARTS = 64
# halve the turn if its second-order uncertainty of the nodal point exceeds this share of the
# nodal points' box. Otherwise halve the nodal points.
_TURN_SHARE = 0.25
# boxes of turns, in their own coordinates, at most this wide are not halved. No camera is aimed
# more finely.
_LEAST_TURN = 2e-3
# the same for boxes of nodal points, mm
_LEAST_MM = 0.05

# Poses of a box that are tried. Compiled loops.


# what a member that should be inspected is lost for
SIGHT, LENGTH, VIEW = range(3)


class Trial(NamedTuple):
    """What comes out when a pose is tried.

    Attributes
    ----------
    pose : array (4, 4)
        Camera to part.
    inspected : array of bool (e,)
        What it inspects.
    lost : array (3,)
        The weight of the members that are not visible, whose image is too short, or that are out of view: SIGHT,
        LENGTH, VIEW.
    look : array (3,)
        The point it looks at.
    """

    pose: np.ndarray
    inspected: np.ndarray
    lost: np.ndarray
    look: np.ndarray


@kernel
def try_pose(stack, i, chart, x, meets, entities, view, work, trial):
    """Try the pose of box i at x = (w, d), see `planner.bound.windows`.

    Its nodal point is moved into the box if it is not there. Of the members only those are asked that should meet.

    Parameters
    ----------
    trial : Trial
        Is written to.

    Returns
    -------
    float
        The weight of what it inspects.
    """
    pose, inspected, lost, look = trial
    matrix = np.empty((3, 3))
    zero = np.zeros(3)
    s = np.empty((2, 3))
    far = np.empty(2)
    opened = np.empty(2)
    rotation(chart, stack.turn[i] + x[3:], matrix)
    for k in range(3):
        look[k] = stack.look[i, k] + (
            matrix[k, 0] * x[0] + matrix[k, 1] * x[1] + matrix[k, 2] * x[2]
        )
    eye = np.empty((2, 3))
    at = np.minimum(np.maximum(look - view.middle * matrix[:, 2], stack.eye[i, 0]), stack.eye[i, 1])
    put(eye[0], at)
    put(eye[1], at)
    put(look, at + view.middle * matrix[:, 2])
    put_table(pose, matrix)
    put(pose[:3, 3], at)
    inspected[:] = False
    lost[:] = 0.0
    total = 0.0
    # of members that exclude each other one counts, as of the witnesses of a target
    counted = np.zeros(stack.n_members[i], np.bool_)
    for a in range(stack.n_members[i]):
        if not meets[a]:
            continue
        e = stack.members[i, a]
        if not _in_view(entities.ends[e], look, matrix, view):
            lost[VIEW] += work.y[a]
            continue
        seen_from(entities.ends[e], look, matrix, s)
        farthest(s, entities.lengths[e], entities.length_ratio[e], 0.0, zero, view, far, opened)
        if s[0, 2] + view.middle > far[0] or s[1, 2] + view.middle > far[1]:
            lost[LENGTH] += work.y[a]
        elif _sees(
            entities,
            stack.cells[i, stack.start[i, a] : stack.start[i, a + 1]],
            eye,
            stack.sure[i, a],
        ):
            inspected[e] = True
            total += 0.0 if counted[work.group[a]] else work.y[a]
            counted[work.group[a]] = True
        else:
            lost[SIGHT] += work.y[a]
    return total


@kernel_without_refcounts
def _sees(entities, cells, eye, sure):
    """Tell whether a nodal point lies in one of the cells, and all points around it do."""
    if sure:
        return True
    for cell in cells:
        if holds_point(entities, cell, eye[0]):
            return not hidden_around(entities, cells, eye)
    return False


@kernel
def _in_view(ends, look, matrix, view):
    """Tell whether both ends are in focus and on the sensor."""
    for i in range(2):
        x, y, z = turned_back(
            matrix, ends[i, 0] - look[0], ends[i, 1] - look[1], ends[i, 2] - look[2]
        )
        z += view.middle
        if z < view.near or z > view.far or abs(x) > view.tan_x * z or abs(y) > view.tan_y * z:
            return False
    return True


# Boxes of poses whose turns are small: whether heavy windows meet there, and how such a box is
# halved. Compiled loops.
#
# The windows are linear in the point looked at and the turn together
# (`planner.bound.windows`).


@kernel
def is_small(stack, i):
    """Tell whether the turns of box i are small enough for linear windows."""
    v = stack.turn[i]
    return most_turn(v, stack.span[i], 1.0 + np.sum(v * v))[0] <= _SMALL_TURN


@kernel
def may_see(stack, i, entities, view, task, work, rest, x, meets):
    """Answer whether windows heavier than the limit may meet in box i, and where; see `linear_windows.may_meet`."""
    m = stack.n_members[i]
    u = stack.span[i]
    eye = stack.eye[i]
    n = linear_sides(stack, i, entities, view, work, rest)
    apart = work.apart[:m, :m]
    for a in range(m):
        for b in range(m):
            apart[a, b] = task.conflict[stack.members[i, a], stack.members[i, b]]
    find_apart(work, n, u, apart)
    exclusive_groups(np.arange(m), apart, work.group[:m])
    sides = Sides(work.rows[:n], work.rhs[:n], work.owner[:n])
    members = Members(work.group[:m], work.y[:m])
    low = np.empty(6)
    high = np.empty(6)
    slope = np.zeros((3, 3))
    # with a turn, w is tried such that the nodal point stays in the middle
    for j in range(3):
        high[j] = work.room[j]
        high[3 + j] = u[j]
        low[j] = -work.room[j]
        low[3 + j] = -u[j]
        for k in range(3):
            for c in range(3):
                slope[j, k] += work.matrix[c, j] * work.swing[k, c] / u[k]
    point = np.empty(3)
    away = (eye[0] + eye[1]) / 2 - work.nodal
    point[0], point[1], point[2] = turned_back(work.matrix, away[0], away[1], away[2])
    seat = Seat(point, slope)
    return may_meet(sides, members, task.limit, (low, high), seat, _PARTS, x, meets[:m])


@kernel
def nodal_or_turn(stack, i, rest, answer, lost):
    """Return along which coordinate box i is to be halved; -1 if it is too small for that.

    The nodal points decide visibility and length, and tie the points looked at to the turn. What the turn makes
    uncertain of that should not be more than there is of them.
    """
    u = stack.span[i]
    half = (stack.eye[i, 1] - stack.eye[i, 0]) / 2
    if rest > _TURN_SHARE * half.max() or (
        answer == YES and lost[VIEW] > max(lost[SIGHT], lost[LENGTH])
    ):
        return OF_TURN + np.argmax(u) if u.max() > _LEAST_TURN else -1
    return OF_NODAL + np.argmax(half) if half.max() > _LEAST_MM else -1


# Boxes of camera poses that wait to be searched (`planner.bound.boxes`). Compiled loops.


# boxes that wait at most: a box has at most two halves waiting for each halving of its coordinates
LEVELS = 160


class Stack(NamedTuple):
    """Boxes that wait: q0, h, v0, u; where windows met in the box before halving; and what may be inspected.

    ``eye`` (2, 3) are the lowest and highest coordinates that the nodal point may have; for so many halvings as
    ``pause`` says it is not asked what is visible from there.
    ``members[i, :n_members[i]]`` are entities in descending order of weight; ``sure`` those visible from all of the
    box; the cells in which the nodal point may lie are those of ``cells`` from ``start[i, a]`` to ``start[i, a + 1]``.
    """

    look: np.ndarray
    half: np.ndarray
    turn: np.ndarray
    span: np.ndarray
    met: np.ndarray
    n_members: np.ndarray
    members: np.ndarray
    sure: np.ndarray
    start: np.ndarray
    cells: np.ndarray
    eye: np.ndarray
    pause: np.ndarray


class BoxAtWork(NamedTuple):
    """Of the box at work: rotation, room, swings, nodal point; windows, weights and groups of members.

    ``scores`` (9,) tell how much is gained by halving along each coordinate of q, v and the nodal point.
    ``rows``, their right-hand sides and owners are linear sides of windows, see `planner.bound.windows`;
    ``side`` tells which of the six sides, ``of_side`` lists them by that, and ``apart`` (m, m) which members exclude
    each other.
    """

    matrix: np.ndarray
    room: np.ndarray
    swing: np.ndarray
    nodal: np.ndarray
    lowest: np.ndarray
    y: np.ndarray
    group: np.ndarray
    scores: np.ndarray
    rows: np.ndarray
    rhs: np.ndarray
    owner: np.ndarray
    side: np.ndarray
    of_side: np.ndarray
    apart: np.ndarray


@kernel
def planted(box, order, entities, eye):
    """Return a stack with one box in which every entity of the order may be inspected, from an eye in (2, 3)."""
    m = len(order)
    n_cells = 0
    for e in order:
        n_cells += entities.entity_start[e + 1] - entities.entity_start[e]
    point = np.empty((5, LEVELS, 3))
    stack = Stack(
        point[0],
        point[1],
        point[2],
        point[3],
        point[4],
        np.zeros(LEVELS, np.int64),
        np.empty((LEVELS, m), np.int64),
        np.zeros((LEVELS, m), np.bool_),
        np.zeros((LEVELS, m + 1), np.int64),
        np.empty((LEVELS, n_cells), np.int32),
        np.empty((LEVELS, 2, 3)),
        np.zeros(LEVELS, np.int64),
    )
    put(stack.look[0], box[LOOK])
    put(stack.half[0], box[HALF])
    put(stack.turn[0], box[TURN])
    put(stack.span[0], box[SPAN])
    stack.met[0] = np.inf
    put_table(stack.eye[0], eye)
    stack.n_members[0] = m
    at = 0
    for a in range(m):
        stack.members[0, a] = order[a]
        stack.start[0, a] = at
        for cell in range(entities.entity_start[order[a]], entities.entity_start[order[a] + 1]):
            stack.cells[0, at] = cell
            at += 1
    stack.start[0, m] = at
    return stack


@kernel
def new_work(m):
    """Return room for the work on boxes with up to m members."""
    square = np.empty((2, 3, 3))
    line = np.empty((2, 3))
    lowest = np.empty((m, 6))
    scores = np.empty(9)
    y = np.empty(m)
    group = np.empty(m, np.int64)
    # of each member both ends on six sides of the view, and the length; and two for each side of two boxes of points
    n_rows = 13 * m + 12
    sides = np.empty((n_rows, 6)), np.empty(n_rows), np.empty(n_rows, np.int64)
    apart = np.zeros((m, m), np.bool_)
    kinds = np.empty(n_rows, np.int64), np.empty((6, n_rows), np.int64)
    return BoxAtWork(
        square[0], line[0], square[1], line[1], lowest, y, group, scores, *sides, *kinds, apart
    )


@kernel
def keep_members(stack, i, work, live):
    """Drop the members of box i whose bit is not set; return the weight of the others."""
    n_live = 0
    at = 0
    total = 0.0
    for a in range(stack.n_members[i]):
        e = stack.members[i, a]
        if not live[e >> 6] >> np.uint64(e & 63) & np.uint64(1):
            continue
        first = stack.start[i, a]
        last = stack.start[i, a + 1]
        stack.members[i, n_live] = e
        stack.sure[i, n_live] = stack.sure[i, a]
        stack.start[i, n_live] = at
        for c in range(first, last):
            stack.cells[i, at] = stack.cells[i, c]
            at += 1
        work.y[n_live] = work.y[a]
        put(work.lowest[n_live], work.lowest[a])
        total += work.y[a]
        n_live += 1
    stack.n_members[i] = n_live
    stack.start[i, n_live] = at
    return total


@kernel_without_refcounts
def agree(stack, i, work, rest, middle):
    """Shrink the points looked at and the nodal points of box i to where the ones go with the others; false if none do.

    c = q - z0 a, and a differs from the middle rotation's by the swings and the rest.
    """
    q = stack.look[i]
    h = stack.half[i]
    eye = stack.eye[i]
    for k in range(3):
        arm = middle * work.matrix[k, 2]
        swing = abs(work.swing[0, k]) + abs(work.swing[1, k]) + abs(work.swing[2, k]) + rest + _EPS
        low = max(q[k] - h[k], eye[0, k] + arm - swing)
        high = min(q[k] + h[k], eye[1, k] + arm + swing)
        eye[0, k] = max(eye[0, k], low - arm - swing)
        eye[1, k] = min(eye[1, k], high - arm + swing)
        if low > high or eye[0, k] > eye[1, k]:
            return False
        q[k] = (low + high) / 2
        h[k] = (high - low) / 2
        work.nodal[k] = q[k] - arm
    return True


@kernel
def halve(stack, i, axis, met, turn, nodal):
    """Replace box i by its halves in places i and i + 1; the one of a pose that was tried comes on top.

    The axes are those of the point looked at, of the turn, and of the nodal point; of that pose they are ``met``,
    ``turn`` (from the middle rotation) and ``nodal``.
    """
    for field in (stack.look, stack.half, stack.turn, stack.span):
        put(field[i + 1], field[i])
    m = stack.n_members[i]
    n_cells = stack.start[i, m]
    stack.n_members[i + 1] = m
    put(stack.members[i + 1], stack.members[i, :m])
    put(stack.sure[i + 1], stack.sure[i, :m])
    put(stack.start[i + 1], stack.start[i, : m + 1])
    put(stack.cells[i + 1], stack.cells[i, :n_cells])
    put(stack.met[i], met)
    put(stack.met[i + 1], met)
    put_table(stack.eye[i + 1], stack.eye[i])
    stack.pause[i + 1] = stack.pause[i]
    if axis >= OF_NODAL:
        k = axis - OF_NODAL
        middle = (stack.eye[i, 0, k] + stack.eye[i, 1, k]) / 2
        low, high = (i, i + 1) if nodal[k] > middle else (i + 1, i)
        stack.eye[low, 1, k] = stack.eye[high, 0, k] = middle
        return
    boxes, size = (stack.look, stack.half) if axis < OF_TURN else (stack.turn, stack.span)
    k = axis % 3
    half = size[i, k] / 2
    size[i, k] = size[i + 1, k] = half
    above = met[k] > stack.look[i, k] if axis < OF_TURN else turn[k] > 0.0
    on_top = 1.0 if above else -1.0
    boxes[i, k] -= on_top * half
    boxes[i + 1, k] += on_top * half


PROVEN, FOUND, UNRESOLVED, SPENT, NEARLY = range(5)

# for rounding, and no zero to divide by
_SEARCH_EPS = 1e-12


@entry_kernel(nogil=True)
def search(box, chart, order, entities, view, tree, task, pose, inspected):
    """Search a box of poses.

    Parameters
    ----------
    box : array (4, 3)
        q0, h, v0 and u, see `planner.bound.windows`.
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
    stack = planted(box, order, entities, tree.boxes[0])
    m = len(y)
    work = new_work(m)
    look = np.empty(3)
    x = np.zeros(6)
    meets = np.ones(m, np.bool_)
    trial = Trial(pose, inspected, np.zeros(3), look)
    thin = view.far - view.near < _THIN * 2.0 * view.tan_x * view.middle
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
        total, remainder, doubt, short = _tighten(stack, i, chart, entities, view, y, work)
        if total <= limit:
            continue
        total, seen = _drop_unseen(stack, i, task, tree, work, remainder)
        if total <= limit:
            continue
        small = thin and is_small(stack, i)
        if small:
            answer, n_parts = may_see(stack, i, entities, view, task, work, remainder, x, meets)
            made += n_parts // _PARTS_PER_BOX
        else:
            answer = _may_see(stack, i, task, view, work, x, meets)
        if answer == NO:
            continue
        if try_pose(stack, i, chart, x, meets, entities, view, work, trial) > limit:
            return FOUND, made
        if small:
            axis = nodal_or_turn(stack, i, remainder, answer, trial.lost)
            if axis < 0:
                _write_members(stack, i, inspected)
                return NEARLY, made
        else:
            _score(stack, i, work, remainder, doubt, short, seen, entities.around)
            axis = _axis_to_halve(stack, i, work, total, view)
        if size + 2 > LEVELS or axis < 0:
            outcome = UNRESOLVED
            continue
        halve(stack, i, axis, look, x[3:], pose[:3, 3])
        size += 2
    return outcome, made


@kernel
def _tighten(stack, i, chart, entities, view, y, work):
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
    remainder = swings(work.matrix, v, u, n, t, nu, view.middle, work.swing)
    s = np.empty((2, 3))
    far = np.empty(2)
    opened = np.empty(2)
    short = np.zeros(2)
    if not agree(stack, i, work, remainder, view.middle):
        return 0.0, remainder, 0.0, short
    extent(work.matrix, h, t, work.room)
    work.scores[:] = 0.0
    deep = (view.far - view.near) / 2
    n_live = 0
    at = 0
    total = 0.0
    doubt = 0.0
    middle = (eye[0] + eye[1]) / 2
    radius = math.sqrt(np.sum((eye[1] - eye[0]) ** 2)) / 2
    for a in range(stack.n_members[i]):
        e = stack.members[i, a]
        lowest = work.lowest[n_live]
        ends = entities.ends[e]
        length = entities.lengths[e]
        ratio = entities.length_ratio[e]
        if out_of_range(ends, q, h, view.radius) or ends_out_of_focus(ends, eye, view):
            continue
        if too_short(ends, length, ratio, middle, radius, view):
            continue
        seen_from(ends, q, work.matrix, s)
        farthest(s, length, ratio, t, work.room, view, far, opened)
        window(s, far, turn, view, work.room, lowest, y[e], work.scores)
        if is_empty(lowest, work.room, view):
            continue
        cells = stack.cells[i, stack.start[i, a] : stack.start[i, a + 1]]
        n_cells = -1
        if not stack.sure[i, a]:
            n_cells = keep_cells(entities, cells, work.nodal, h, work.swing, remainder, eye)
        if n_cells == 0 or (n_cells > 0 and hidden_around(entities, cells[:n_cells], eye)):
            continue
        at = _put_member(stack, i, n_live, at, e, cells, n_cells)
        work.y[n_live] = y[e]
        doubt += y[e] if n_cells > 0 else 0.0
        short[0] += y[e] * min(opened[0] / deep, _MOST_SHORT)
        short[1] += y[e] * min(opened[1] / deep, _MOST_SHORT)
        total += y[e]
        n_live += 1
    stack.n_members[i] = n_live
    stack.start[i, n_live] = at
    doubt *= _DOUBT_SCORE / (view.tan_x * view.middle)
    return total, remainder, doubt, short


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
    members = Asked(stack.members[i, :m], work.y[:m], work.group[:m], task.limit)
    box = PosesBox(work.nodal, work.matrix, stack.half[i], work.swing, rest)
    seen = heavy_members(tree, box, stack.eye[i], members, live)
    if seen > _MUCH_SEEN:
        stack.pause[i] = _PAUSE
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
    lowest = work.lowest[:m]
    group = work.group[:m]
    y = work.y[:m]
    if np.isfinite(stack.met[i, 0]):
        # where they met before, they often still do
        away = stack.met[i] - stack.look[i]
        w[0], w[1], w[2] = turned_back(work.matrix, away[0], away[1], away[2])
        for k in range(3):
            w[k] = min(max(w[k], -work.room[k]), work.room[k])
        if weight_at(lowest, group, y, w, view) > limit:
            return YES
    return YES if may_exceed(lowest, group, y, limit, work.room, view, w) else NO


@kernel
def _score(stack, i, work, rest, doubt, short, seen, around):
    """Add to the scores what each coordinate of box i leaves open of lengths and of visibility."""
    h = stack.half[i]
    u = stack.span[i]
    eye = stack.eye[i]
    for k in range(3):
        work.scores[OF_LOOK + k] = h[k] * (
            _LENGTH_SCORE * work.scores[OF_LOOK + k] + short[0] / max(np.sum(h), _SEARCH_EPS)
        )
        work.scores[OF_TURN + k] += short[1] * u[k] / np.sum(u)
    for axis in range(3):
        reach = h[axis] + np.abs(work.swing[:, axis]).sum() + rest
        half = (eye[1, axis] - eye[0, axis]) / 2
        few = seen < _MOST_SEEN or half < _NEAR_SIDES * around
        if few and _EYE_SHARE * reach < half < 0.99 * reach:
            work.scores[OF_NODAL + axis] += doubt * half
            continue
        # the nodal point is known better than that
        part = doubt * min(1.0, half / max(reach, _SEARCH_EPS))
        work.scores[OF_LOOK + axis] += part * h[axis]
        for k in range(3):
            work.scores[OF_TURN + k] += part * abs(work.swing[k, axis])


@kernel_without_refcounts
def _axis_to_halve(stack, i, work, total, view):
    """Return along which coordinate box i is to be halved; -1 if it is too small for that."""
    axis = np.argmax(work.scores)
    widest = np.argmax(stack.half[i])
    if stack.half[i, widest] > _LOOK_SHARE * view.tan_x * view.middle:
        return OF_LOOK + widest
    if work.scores[axis] >= _FINEST_SHARE * total:
        return axis
    widest = np.argmax(stack.span[i])
    return OF_TURN + widest if stack.span[i, widest] > _WIDE_TURN else -1
