"""The sides of all windows of a box of small turns, linear in the point looked at and the turn. Compiled loops.

With a turn all windows move together. `planner.bound.boxes.windows` makes each of them larger by all that the turn can
do to it; here only by what is of second order. In the notation there, with x = (w, d):

view       n.w - (2/N) W'(n x s).d <= n.s + k + the rest
length     the image of two ends a and b as seen from c is |(X.e1, X.e2)| / (z1 z2) long, with X = (c - a) x (b - a) and
           the camera's axes e1, e2, e3. With A = sqrt(|X|^2 - (X.e3)^2) and D the most that z1 and z2 can differ by,
           z1 z2 <= A / ratio, so z1 + z2 <= sqrt(4 A / ratio + D^2)
nodal      c = q - z0 a is in the box of nodal points, and q in the box of points looked at

Opposite sides of two members, added, have little of x left: where even that cannot be satisfied, the two exclude each
other in all of the box.
"""

from __future__ import annotations

import math

import numpy as np

from compiled.decorators import kernel, kernel_without_refcounts, put
from planner.bound.boxes.view import FAR
from planner.bound.boxes.windows import Turn, farthest, form, most_turn, seen_from

_EPS = 1e-9
# of rounding a few products and sums
_RELATIVE = 1e-12


@kernel
def linear_sides(stack, i, entities, view, work, rest):
    """Write the sides of box i, given the remainder of the swings, to ``work``; return how many."""
    q = stack.look[i]
    v = stack.turn[i]
    u = stack.span[i]
    n = 1.0 + v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    t, nu = most_turn(v, u, n)
    turn = Turn(v, u, n, t, nu)
    s = np.empty((2, 3))
    far = np.empty(2)
    opened = np.empty(2)
    at = _of_nodal_points(stack, i, work, t, rest)
    for a in range(stack.n_members[i]):
        e = stack.members[i, a]
        first = at
        seen_from(entities.ends[e], q, work.matrix, s)
        farthest(s, entities.lengths[e], entities.length_ratio[e], t, work.room, view, far, opened)
        at += _of_view(s, far, turn, view, work.room, work.rows[at:], work.rhs[at:], work.side[at:])
        work.side[at] = FAR
        segment = entities.ends[e], entities.length_ratio[e], s
        at += _of_length(
            segment, stack.eye[i], turn, view, work.matrix, work.rows[at:], work.rhs[at:]
        )
        work.owner[first:at] = a
    return at


@kernel_without_refcounts
def _of_nodal_points(stack, i, work, t, rest):
    """Write the sides of the points looked at and of the nodal points; return how many."""
    h = stack.half[i]
    u = stack.span[i]
    eye = stack.eye[i]
    # R(t)w is w but for this
    more = min(2.0 * t, 2.0) * math.sqrt(h[0] ** 2 + h[1] ** 2 + h[2] ** 2) + _EPS
    at = 0
    for k in range(3):
        for sign in (-1.0, 1.0):
            for j in range(3):
                work.rows[at, j] = work.rows[at + 1, j] = sign * work.matrix[k, j]
                work.rows[at, 3 + j] = 0.0
                work.rows[at + 1, 3 + j] = -sign * work.swing[j, k] / u[j]
            to_side = eye[1, k] - work.nodal[k] if sign > 0.0 else work.nodal[k] - eye[0, k]
            work.rhs[at] = h[k] + more
            work.rhs[at + 1] = to_side + rest + more
            at += 2
    work.owner[:at] = -1
    return at


@kernel_without_refcounts
def _moved(n0, n1, n2, s, v, n):
    """Return n x s, and (2/N) W'(n x s): how n.R(t)'s changes with d."""
    g0 = n1 * s[2] - n2 * s[1]
    g1 = n2 * s[0] - n0 * s[2]
    g2 = n0 * s[1] - n1 * s[0]
    across = math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    f = 2.0 / n
    return (
        across,
        f * (g0 + v[1] * g2 - v[2] * g1),
        f * (g1 + v[2] * g0 - v[0] * g2),
        f * (g2 + v[0] * g1 - v[1] * g0),
    )


@kernel_without_refcounts
def _rest(along, whole, across, t, nu):
    """Return by how much n.R(t)'s may exceed what is linear in d."""
    return min(t * t * (whole - along) + 2.0 * t * (t * t + nu) * across, 2.0 * whole) + _EPS


@kernel_without_refcounts
def _of_view(s, far, turn, view, room, rows, rhs, side):
    """Write the sides of the view that some point of the box breaks; return how many."""
    v, u, n, t, nu = turn
    kept = 0
    for c in range(6):
        n0, n1, n2, k, _, _ = form(c, view, room)
        size = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        for i in range(2):
            across, d0, d1, d2 = _moved(n0, n1, n2, s[i], v, n)
            along = n0 * s[i, 0] + n1 * s[i, 1] + n2 * s[i, 2]
            whole = size * math.sqrt(s[i, 0] ** 2 + s[i, 1] ** 2 + s[i, 2] ** 2)
            most = abs(n0) * room[0] + abs(n1) * room[1] + abs(n2) * room[2]
            most += abs(d0) * u[0] + abs(d1) * u[1] + abs(d2) * u[2]
            right = (
                (far[i] - view.middle if c == FAR else k)
                + along
                + _rest(along, whole, across, t, nu)
            )
            if most <= right:
                continue
            row = rows[kept]
            row[0] = n0
            row[1] = n1
            row[2] = n2
            row[3] = -d0
            row[4] = -d1
            row[5] = -d2
            rhs[kept] = right
            side[kept] = c
            kept += 1
    return kept


@kernel_without_refcounts
def _of_length(segment, eye, turn, view, matrix, rows, rhs):
    """Write the side that keeps the image long enough, for nodal points in a box (2, 3); return how many: 0 or 1.

    Of the segment: its ends, its least length over the image distance, and s.
    """
    ends, ratio, s = segment
    if ratio <= 0.0:
        return 0
    v, _, n, t, nu = turn
    e0 = ends[1, 0] - ends[0, 0]
    e1 = ends[1, 1] - ends[0, 1]
    e2 = ends[1, 2] - ends[0, 2]
    o0 = (eye[0, 0] + eye[1, 0]) / 2 - ends[0, 0]
    o1 = (eye[0, 1] + eye[1, 1]) / 2 - ends[0, 1]
    o2 = (eye[0, 2] + eye[1, 2]) / 2 - ends[0, 2]
    x0 = o1 * e2 - o2 * e1
    x1 = o2 * e0 - o0 * e2
    x2 = o0 * e1 - o1 * e0
    radius = (
        math.sqrt(
            (eye[1, 0] - eye[0, 0]) ** 2
            + (eye[1, 1] - eye[0, 1]) ** 2
            + (eye[1, 2] - eye[0, 2]) ** 2
        )
        / 2
    )
    length = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    most = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2) + radius * length
    axial = (
        abs(x0 * matrix[0, 2] + x1 * matrix[1, 2] + x2 * matrix[2, 2])
        - radius * length
        - min(2.0 * t, 2.0) * most
    )
    # both are wrong by less than this; where they are nearly equal, that tells in what is left of their squares
    wide = _EPS * length + _RELATIVE * most
    most = most + wide
    axial = max(axial - wide, 0.0)
    area = math.sqrt((most - axial) * (most + axial))
    deep = min(view.far - view.near, length)
    both = math.sqrt(4.0 * area / ratio * (1.0 + _EPS) + deep * deep)
    if both >= 2.0 * view.far:
        return 0
    row = rows[0]
    row[:] = 0.0
    row[2] = -2.0
    right = both - 2.0 * view.middle
    for i in range(2):
        across, d0, d1, d2 = _moved(0.0, 0.0, 1.0, s[i], v, n)
        row[3] += d0
        row[4] += d1
        row[5] += d2
        whole = math.sqrt(s[i, 0] ** 2 + s[i, 1] ** 2 + s[i, 2] ** 2)
        right += _rest(-s[i, 2], whole, across, t, nu) - s[i, 2]
    row *= 0.5
    rhs[0] = right / 2.0
    return 1


@kernel
def find_apart(work, n, u, apart):
    """Add to ``apart`` (m, m) the members of which opposite sides, of n sides, leave no pose of a box for both."""
    count = np.zeros(6, np.int64)
    for r in range(n):
        if work.owner[r] >= 0:
            work.of_side[work.side[r], count[work.side[r]]] = r
            count[work.side[r]] += 1
    half = np.empty(6)
    put(half, work.room)
    put(half[3:], u)
    for c in range(0, 6, 2):
        for r in work.of_side[c, : count[c]]:
            for k in work.of_side[c + 1, : count[c + 1]]:
                a = work.owner[r]
                b = work.owner[k]
                if apart[a, b] or a == b:
                    continue
                room = work.rhs[r] + work.rhs[k]
                for j in range(6):
                    room += abs(work.rows[r, j] + work.rows[k, j]) * half[j]
                if room < 0.0:
                    apart[a, b] = apart[b, a] = True
