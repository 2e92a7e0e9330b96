"""Boxes of camera poses that wait to be searched (`planner.bound.boxes.search`). Compiled loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from compiled.decorators import kernel, kernel_without_refcounts, put, put_table
from planner.bound.boxes.view import HALF, LOOK, OF_NODAL, OF_TURN, SPAN, TURN

# boxes that wait at most: a box has at most two halves waiting for each halving of its coordinates
LEVELS = 160
_EPS = 1e-9


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
    ``rows``, their right-hand sides and owners are linear sides of windows, see `planner.bound.boxes.linear_sides`;
    ``side`` tells which of the six sides, ``of_side`` lists them by that, and ``apart`` (m, m) which members exclude
    each other.
    """

    matrix: np.ndarray
    room: np.ndarray
    swing: np.ndarray
    nodal: np.ndarray
    least: np.ndarray
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
    least = np.empty((m, 6))
    scores = np.empty(9)
    y = np.empty(m)
    group = np.empty(m, np.int64)
    # of each member both ends on six sides of the view, and the length; and two for each side of two boxes of points
    n_rows = 13 * m + 12
    sides = np.empty((n_rows, 6)), np.empty(n_rows), np.empty(n_rows, np.int64)
    apart = np.zeros((m, m), np.bool_)
    kinds = np.empty(n_rows, np.int64), np.empty((6, n_rows), np.int64)
    return BoxAtWork(
        square[0], line[0], square[1], line[1], least, y, group, scores, *sides, *kinds, apart
    )


@kernel
def keep_members(stack, i, work, live):
    """Drop the members of box i whose bit is not set; return the weight of the others."""
    kept = 0
    at = 0
    total = 0.0
    for a in range(stack.n_members[i]):
        e = stack.members[i, a]
        if not live[e >> 6] >> np.uint64(e & 63) & np.uint64(1):
            continue
        first = stack.start[i, a]
        last = stack.start[i, a + 1]
        stack.members[i, kept] = e
        stack.sure[i, kept] = stack.sure[i, a]
        stack.start[i, kept] = at
        for c in range(first, last):
            stack.cells[i, at] = stack.cells[i, c]
            at += 1
        work.y[kept] = work.y[a]
        put(work.least[kept], work.least[a])
        total += work.y[a]
        kept += 1
    stack.n_members[i] = kept
    stack.start[i, kept] = at
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
