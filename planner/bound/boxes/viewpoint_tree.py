"""What may be inspected from where, whatever the direction: a tree of boxes of viewpoints. Compiled loops.

A box of viewpoints gets the entities that may be visible from it and all around, in focus, and long enough. It is
halved where they weigh more than some limit and visibility is in doubt. The sets hold for any weights; the weights only
say where to look closely.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ground.decorators import entry_kernel, kernel, put, put_table
from planner.bound.boxes.conditions import ends_out_of_focus, hidden_around, keep_cells, too_short
from planner.bound.boxes.view import Entities, View

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
    rest: float


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
    kept = 0
    at = 0
    doubt = False
    for a in range(len(members)):
        e = members[a]
        ends = entities.ends[e]
        if ends_out_of_focus(ends, box, view):
            continue
        if too_short(ends, entities.lengths[e], entities.length_ratio[e], middle, radius, view):
            continue
        own = cells[start[a] : start[a + 1]]
        n = -1 if sure[a] else keep_cells(entities, own, middle, half, still, 0.0, box)
        if n == 0 or (n > 0 and hidden_around(entities, own[:n], box)):
            continue
        members[kept] = e
        sure[kept] = n < 0
        start[kept] = at
        for k in range(max(n, 1)):
            cells[at] = own[k]
            at += 1
        doubt = doubt or n > 0
        kept += 1
    start[kept] = at
    return kept, doubt


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
    _, matrix, h, swing, rest = box
    across = np.full(3, rest + _EPS)
    for i in range(3):
        for k in range(3):
            across[i] += h[k] * abs(matrix[k, i])
            across[i] += abs(
                swing[k, 0] * matrix[0, i] + swing[k, 1] * matrix[1, i] + swing[k, 2] * matrix[2, i]
            )
    return across
