"""Windows: where a pose of a box must look to have an entity in focus and on the sensor. Compiled loops.

Notation
--------
q, c      the point looked at, at the middle depth z0 on the camera's axis; the nodal point c = q - z0 a, a the axis
R         camera to part: the rotation of the quaternion (1, v), or of that followed by half a turn about the part's x
          axis. These two charts, |v_i| <= 1, are all rotations but for half a turn about the camera's axis, under which
          the sensor is symmetric.
box       q in q0 +- h and v in v0 +- u. With R0 the middle rotation, d = v - v0 and N = 1 + |v0|^2, R = R0 R(t), t
          being the Rodrigues vector W d / (N + v0.d), W d = d - v0 x d
s, w      of a point p: s = R0'(p - q0); and of the point looked at, w = R(t)' R0'(q - q0)

From a pose of the box, p is at R(t)'s - w from the point looked at, in the camera's axes. It is in focus and on the
sensor if six forms n.(R(t)'s - w) + k are not negative: so n.w may be at most n.R(t)'s + k, which is at most

    n.s + k + (2/N) |W'(n x s)|.u + t^2 (|n| |s| - n.s) + 2 t (t^2 + nu) |n x s|       t = max |t|,  nu = max |v0.d| / N

((1 + t^2) R(-t)s = (1 + t^2) s + 2 s x t + 2 t x (t x s), where n.(t x (t x s)) = (n.t)(t.s) - t^2 n.s is at most
t^2 (|n| |s| - n.s) / 2; and t - W d / N is at most t nu). The forms depend on w in the same way for all points, so each
entity has a *window* of w, a frustum upside down. What one pose inspects has windows that meet
(`planner.bound.windows`). How far a point may be at most is the lens's limit or, if that is nearer, where
the image of its entity would be too short (`farthest`). Only the turn makes the windows larger than they are; how large
the box of q is matters for visibility, for the length of images, and for the length of s. That the camera turns about
what it looks at, and not about itself, keeps s and so the turn's effect small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ground.decorators import kernel, kernel_without_refcounts, put
from planner.bound.view import BOTTOM, FAR, LEFT, NEAR, RIGHT, TOP

# largest number of waiting parts: one for each halving
_LEVELS = 64
# check a part again if shrinking left less than this share of a coordinate. A smaller reduction
# is not worth it.
_MUCH = 0.8
# largest number of halvings of the range. Ten along each axis leave a thousandth of its width.
_DEEPEST = 30
# number of undecided parts of that size that the search skips before the answer is yes
_DOUBTFUL = 8

_EPS = 1e-9
# t of a box in which |v0.d| / N may be nearly 1
_TURN_UNBOUNDED = 1e3
# the most that one side of one window counts in a coordinate's score
_MOST_SCORE = 4.0
# of the turn, rad: while it may be larger, a smaller box of q does not make windows smaller for certain
_MUCH_TURN = 0.5


class Turn(NamedTuple):
    """The turns of a box: v0, u, N, and the largest t and nu."""

    v: np.ndarray
    u: np.ndarray
    n: float
    t: float
    nu: float


@kernel_without_refcounts
def rotation(chart, v, matrix):
    """Write the rotation R of a chart and a vector v; return N."""
    n = 1.0 + v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    x = v[0]
    y = v[1]
    z = v[2]
    matrix[0, 0] = 1 + x * x - y * y - z * z
    matrix[0, 1] = 2 * (x * y - z)
    matrix[0, 2] = 2 * (x * z + y)
    matrix[1, 0] = 2 * (x * y + z)
    matrix[1, 1] = 1 - x * x + y * y - z * z
    matrix[1, 2] = 2 * (y * z - x)
    matrix[2, 0] = 2 * (x * z - y)
    matrix[2, 1] = 2 * (y * z + x)
    matrix[2, 2] = 1 - x * x - y * y + z * z
    for i in range(3):
        sign = -1.0 if chart == 1 and i > 0 else 1.0
        for j in range(3):
            matrix[i, j] *= sign / n
    return n


@kernel_without_refcounts
def turned_back(matrix, x, y, z):
    """Return R' (x, y, z), in an order of sums that does not depend on the machine."""
    return (
        matrix[0, 0] * x + matrix[1, 0] * y + matrix[2, 0] * z,
        matrix[0, 1] * x + matrix[1, 1] * y + matrix[2, 1] * z,
        matrix[0, 2] * x + matrix[1, 2] * y + matrix[2, 2] * z,
    )


@kernel_without_refcounts
def most_turn(v, u, n):
    """Return the largest |t| and the largest |v0.d| / N of a box."""
    nu = (abs(v[0]) * u[0] + abs(v[1]) * u[1] + abs(v[2]) * u[2]) / n
    if nu >= 0.99:
        return _TURN_UNBOUNDED, nu
    return math.sqrt((u[0] ** 2 + u[1] ** 2 + u[2] ** 2) / n) / (1.0 - nu), nu


@kernel_without_refcounts
def extent(matrix, h, t, room):
    """Write how far each coordinate of w may be from 0."""
    more = min(2.0 * t, 2.0) * math.sqrt(h[0] ** 2 + h[1] ** 2 + h[2] ** 2)
    for i in range(3):
        room[i] = (
            abs(matrix[0, i]) * h[0] + abs(matrix[1, i]) * h[1] + abs(matrix[2, i]) * h[2] + more
        )


@kernel_without_refcounts
def seen_from(ends, q, matrix, s):
    """Write s (2, 3) for the ends of an entity."""
    for i in range(2):
        for j in range(3):
            s[i, j] = 0.0
            for k in range(3):
                s[i, j] += matrix[k, j] * (ends[i, k] - q[k])


@kernel_without_refcounts
def window(s, far, turn, view, room, least, weight, scores):
    """Write the least values (6,) of the forms -n.w that both ends of an entity, as deep as ``far`` (2,), allow.

    In the order of w's coordinates: x - tan_x z and -x - tan_x z, the same for y, then -z and z; that is RIGHT, LEFT,
    BOTTOM, TOP, NEAR, FAR of the view. To ``scores`` (6,) is added, times the weight, what each coordinate of the box
    does to the sides of the window that cut the room, as a share of how wide the view is.
    """
    v, u, n, t, nu = turn
    of_0 = math.sqrt(s[0, 0] ** 2 + s[0, 1] ** 2 + s[0, 2] ** 2)
    of_1 = math.sqrt(s[1, 0] ** 2 + s[1, 1] ** 2 + s[1, 2] ** 2)
    most_0 = most_1 = most_2 = 0.0
    spans = u[0] + u[1] + u[2]
    for c in range(6):
        n0, n1, n2, k, width, outside = form(c, view, room)
        size = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        least[c] = -np.inf
        for i in range(2):
            g0 = n1 * s[i, 2] - n2 * s[i, 1]
            g1 = n2 * s[i, 0] - n0 * s[i, 2]
            g2 = n0 * s[i, 1] - n1 * s[i, 0]
            first_0 = 2.0 / n * abs(g0 + v[1] * g2 - v[2] * g1) * u[0]
            first_1 = 2.0 / n * abs(g1 + v[2] * g0 - v[0] * g2) * u[1]
            first_2 = 2.0 / n * abs(g2 + v[0] * g1 - v[1] * g0) * u[2]
            along = n0 * s[i, 0] + n1 * s[i, 1] + n2 * s[i, 2]
            whole = size * (of_0 if i == 0 else of_1)
            across = math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
            remainder = min(t * t * (whole - along) + 2.0 * t * (t * t + nu) * across, 2.0 * whole)
            k_end = far[i] - view.middle if c == FAR else k
            value = -(k_end + along)
            value -= first_0 + first_1 + first_2 + remainder + _EPS
            if value > least[c]:
                least[c] = value
                most_0 = first_0 + remainder * u[0] / spans
                most_1 = first_1 + remainder * u[1] / spans
                most_2 = first_2 + remainder * u[2] / spans
        if least[c] > outside:
            scores[3] += weight * min(most_0 / width, _MOST_SCORE)
            scores[4] += weight * min(most_1 / width, _MOST_SCORE)
            scores[5] += weight * min(most_2 / width, _MOST_SCORE)
            for j in range(3):
                # a smaller box of q has smaller s; but that says nothing while the turn is large
                scores[j] += weight * 2.0 * t * size / width if t < _MUCH_TURN else 0.0


@kernel_without_refcounts
def form(c, view, room):
    """Return the form n.(R(t)'s - w) + k of a side of the view: n, k; half the width; the least -n.w there is."""
    sign = -1.0 if c % 2 == 0 else 1.0
    if c in (RIGHT, LEFT):
        width = view.tan_x * view.middle
        return sign, 0.0, view.tan_x, width, width, -room[0] - view.tan_x * room[2]
    if c in (BOTTOM, TOP):
        width = view.tan_y * view.middle
        return 0.0, sign, view.tan_y, width, width, -room[1] - view.tan_y * room[2]
    k = view.middle - view.near if c == NEAR else view.far - view.middle
    return 0.0, 0.0, -sign, k, (view.far - view.near) / 2, -room[2]


@kernel_without_refcounts
def is_empty(least, room, view):
    """Tell whether a window lies outside the box; it is widest at the least depth of the point looked at."""
    z = max(least[FAR], -room[2])
    return (
        z > min(-least[NEAR], room[2])
        or max(least[RIGHT] + view.tan_x * z, -room[0])
        > min(-least[LEFT] - view.tan_x * z, room[0])
        or max(least[BOTTOM] + view.tan_y * z, -room[1])
        > min(-least[TOP] - view.tan_y * z, room[1])
    )


@kernel
def swings(matrix, v, u, n, t, nu, middle, swing):
    """Write how each coordinate of the turn moves the nodal point, (3, 3); return the remainder of second order."""
    w = np.empty(3)
    for k in range(3):
        w[k] = 1.0
        w[(k + 1) % 3] = -v[(k + 2) % 3]
        w[(k + 2) % 3] = v[(k + 1) % 3]
        for i in range(3):
            swing[k, i] = 2.0 / n * middle * u[k] * (matrix[i, 0] * w[1] - matrix[i, 1] * w[0])
    return middle * min(2.0 * (t * t + t * nu), 2.0)


@kernel_without_refcounts
def farthest(s, length, ratio, t, room, view, far, opened):
    """Write how deep each end (2,) may be from any pose of a box for the image of the entity to be long enough.

    With e from the one end to the other in the camera's axes, p the image of the first and z the depth of the second
    end, the image is |e_xy - p e_z| / z long (equal to eq 16). Either end may be the first. ``opened`` (2,) becomes
    how much of these depths is there only because the point looked at is not known, and only because the turn is not.
    ``ratio`` is the least length over the image distance; where it is 0, only the lens limits the depth.
    """
    turn = min(2.0 * t, 2.0)
    required = ratio * (1.0 - _EPS)
    opened[:] = 0.0
    if required <= 0.0:
        far[:] = view.far
        return
    for i in range(2):
        a = s[i]
        b = s[1 - i]
        moved = turn * math.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2)
        middle = a[2] + view.middle
        depth = max(view.near, middle - room[2] - moved)
        deepest = max(depth, min(view.far, middle + room[2] + moved))
        x_low, x_high = _directions(a[0], room[0] + moved, depth, deepest, view.tan_x)
        low, high = _directions(a[1], room[1] + moved, depth, deepest, view.tan_y)
        e_x = b[0] - a[0]
        e_y = b[1] - a[1]
        e_z = b[2] - a[2]
        x = max(abs(e_x - x_low * e_z), abs(e_x - x_high * e_z))
        y = max(abs(e_y - low * e_z), abs(e_y - high * e_z))
        across = math.sqrt(x * x + y * y)
        # e is turned by so much, and is never longer
        whole = length * math.sqrt(
            1.0 + max(x_low * x_low, x_high * x_high) + max(low * low, high * high)
        )
        spread = max(min(turn * whole, whole - across), 0.0)
        far[1 - i] = min(view.far, (across + spread) / required)
        if far[1 - i] < view.far:
            x = e_x - 0.5 * (x_low + x_high) * e_z
            y = e_y - 0.5 * (low + high) * e_z
            opened[0] = max(opened[0], (across - math.sqrt(x * x + y * y)) / required)
            opened[1] = max(opened[1], spread / required)


@kernel_without_refcounts
def _directions(x, slack, depth, deepest, tangent):
    """Return between which tangents a point at x, give or take the slack, is seen on the sensor from these depths."""
    low = x - slack
    high = x + slack
    smallest = low / (depth if low < 0.0 else deepest)
    largest = high / (depth if high > 0.0 else deepest)
    return max(smallest, -tangent), min(largest, tangent)


# Whether windows that are linear in all six coordinates of a small box of poses meet. Compiled
# loops.
#
# The sides of the windows (`planner.bound.windows`) are rows . x <= rhs. The box of x
# is halved. Sides that no point of a part breaks are not looked at again there. Members without
# which the weight would not exceed the limit are needed: their sides shrink the part.


NO, YES, UNDECIDED = range(3)


# for rounding, as a share of the room there is
_LINEAR_WINDOWS_EPS = 1e-12


class Sides(NamedTuple):
    """Sides rows . x <= rhs: rows (r, 6), right-hand sides (r,), and owners (r,), the member whose side it is.

    The owner -1 stands for all: every pose satisfies such a side.
    """

    rows: np.ndarray
    rhs: np.ndarray
    owner: np.ndarray


class Members(NamedTuple):
    """Groups (m,) of which one member counts, and weights (m,) in descending order."""

    group: np.ndarray
    y: np.ndarray


class Seat(NamedTuple):
    """Where w is tried, given d: a point (3,) and slopes (3, 3)."""

    point: np.ndarray
    slope: np.ndarray


@kernel
def may_meet(sides, members, limit, box, seat, parts, x, meets):
    """Tell whether members heavier than a limit may have all their sides satisfied at one point of a box.

    Parameters
    ----------
    sides : Sides
    members : Members
    limit : float
    box : tuple
        Lowest and highest coordinates, (6,) each.
    seat : Seat
    parts : int
        Largest number of parts of the box to check.
    x : array (6,)
        The heaviest point that was tried is written here.
    meets : array of bool (m,)
        Becomes whose sides are all satisfied there.

    Returns
    -------
    answer : int
        NO is a proof. YES: they meet at x. UNDECIDED: more parts would be needed.
    made : int
        Parts looked at.
    """
    group, y = members
    m = len(y)
    n_rows = len(sides.rhs)
    low = np.empty((_LEVELS, 6))
    high = np.empty((_LEVELS, 6))
    live = np.empty((_LEVELS, n_rows), np.int32)
    n_live = np.zeros(_LEVELS, np.int64)
    alive = np.ones((_LEVELS, m), np.bool_)
    put(low[0], box[0])
    put(high[0], box[1])
    put(live[0], np.arange(n_rows))
    n_live[0] = n_rows
    put(x, (box[0] + box[1]) / 2)
    meets[:] = False
    tried = np.empty(6)
    there = np.zeros(m, np.bool_)
    best = -1.0
    loss = np.empty(m)
    scores = np.empty(6)
    first = np.empty(m, np.int64)
    size = 1
    made = 0
    answer = NO
    while size > 0:
        size -= 1
        i = size
        again = True
        while again:
            made += 1
            if made > parts:
                return UNDECIDED, made
            n_live[i] = _keep(sides, live[i], n_live[i], alive[i], low[i], high[i], y, scores)
            rows = live[i, : n_live[i]]
            total = _weight(alive[i], group, y, first, loss) if n_live[i] >= 0 else 0.0
            if total <= limit:
                break
            again = _shrink(sides, rows, alive[i], loss, total - limit, low[i], high[i])
        if total <= limit:
            continue
        _try(sides, live[i, : n_live[i]], alive[i], low[i], high[i], seat, tried, there)
        here = _weight(there, group, y, first, loss)
        if here > best:
            best = here
            put(x, tried)
            put(meets, there)
        if here > limit:
            return YES, made
        axis = np.argmax(scores)
        if size + 2 > _LEVELS:
            answer = UNDECIDED
            continue
        for field in (low, high):
            put(field[i + 1], field[i])
        put(alive[i + 1], alive[i])
        n_live[i + 1] = n_live[i]
        put(live[i + 1], live[i, : n_live[i]])
        low[i + 1, axis] = high[i, axis] = (low[i, axis] + high[i, axis]) / 2
        size += 2
    return answer, made


@kernel_without_refcounts
def _keep(sides, live, n_live, alive, low, high, y, scores):
    """Drop the members that a part excludes and the sides that all of it satisfies; return how many sides are left.

    -1 if there can be no pose. ``scores`` (6,) become how much each coordinate leaves open.
    """
    rows, rhs, owner = sides
    scores[:] = 0.0
    n_rows = 0
    for k in range(n_live):
        r = live[k]
        e = owner[r]
        if e >= 0 and not alive[e]:
            continue
        value = -rhs[r]
        spread = 0.0
        for j in range(6):
            value += rows[r, j] * (low[j] + high[j]) / 2
            spread += abs(rows[r, j]) * (high[j] - low[j]) / 2
        if value > spread:
            if e < 0:
                return -1
            alive[e] = False
            continue
        if value > -spread:
            live[n_rows] = r
            n_rows += 1
            weight = y[max(e, 0)] / spread
            for j in range(6):
                scores[j] += weight * abs(rows[r, j]) * (high[j] - low[j])
    return n_rows


@kernel_without_refcounts
def _weight(alive, group, y, first, loss):
    """Return the weight alive, of each group the first; write what would be lost with each member."""
    total = 0.0
    first[:] = -1
    for a in range(len(y)):
        loss[a] = 0.0
        if not alive[a]:
            continue
        b = first[group[a]]
        if b < 0:
            first[group[a]] = a
            loss[a] = y[a]
            total += y[a]
        elif loss[b] == y[b]:
            # this one would take its place
            loss[b] -= y[a]
    return total


@kernel_without_refcounts
def _shrink(sides, live, alive, loss, spare, low, high):
    """Shrink a part to where the sides of needed members can be satisfied; tell whether by much.

    Where they cannot, it is left such that the next look at it drops the member.
    """
    rows, rhs, owner = sides
    much = False
    for r in live:
        e = owner[r]
        if e >= 0 and (not alive[e] or loss[e] < spare):
            continue
        room = rhs[r]
        for j in range(6):
            room -= rows[r, j] * (low[j] if rows[r, j] > 0.0 else high[j])
        if room < 0.0:
            return True
        for j in range(6):
            a = rows[r, j]
            wide = high[j] - low[j]
            if abs(a) * wide <= room * (1.0 + _LINEAR_WINDOWS_EPS):
                continue
            if a > 0.0:
                high[j] = low[j] + room / a * (1.0 + _LINEAR_WINDOWS_EPS)
            else:
                low[j] = high[j] + room / a * (1.0 + _LINEAR_WINDOWS_EPS)
            much = much or high[j] - low[j] < _MUCH * wide
    return much


@kernel
def _try(sides, live, alive, low, high, seat, tried, there):
    """Choose a point of a part and write which members have all sides satisfied there; none, if it is no pose."""
    rows, rhs, owner = sides
    for j in range(3):
        tried[3 + j] = (low[3 + j] + high[3 + j]) / 2
    for j in range(3):
        at = seat.point[j]
        for k in range(3):
            at += seat.slope[j, k] * tried[3 + k]
        tried[j] = min(max(at, low[j]), high[j])
    put(there, alive)
    for r in live:
        e = owner[r]
        value = -rhs[r]
        for j in range(6):
            value += rows[r, j] * tried[j]
        if value > 0.0 and e < 0:
            there[:] = False
            return
        if value > 0.0:
            there[e] = False


# The sides of all windows of a box of small turns, linear in the point looked at and the turn.
# Compiled loops.
#
# With a turn all windows move together. `planner.bound.windows` makes each of them larger
# by all that the turn can do to it; here only by what is of second order. In the notation there,
# with x = (w, d):
#
# view       n.w - (2/N) W'(n x s).d <= n.s + k + the rest
# length     the image of two ends a and b as seen from c is |(X.e1, X.e2)| / (z1 z2) long, with X
# = (c - a) x (b - a) and
#            the camera's axes e1, e2, e3. With A = sqrt(|X|^2 - (X.e3)^2) and D the most that z1
#            and z2 can differ by,
#            z1 z2 <= A / ratio, so z1 + z2 <= sqrt(4 A / ratio + D^2)
# nodal      c = q - z0 a is in the box of nodal points, and q in the box of points looked at
#
# Opposite sides of two members, added, have little of x left: where even that cannot be
# satisfied, the two exclude each other in all of the box.


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
    n_rows = 0
    for c in range(6):
        n0, n1, n2, k, _, _ = form(c, view, room)
        size = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        for i in range(2):
            across, d0, d1, d2 = _moved(n0, n1, n2, s[i], v, n)
            along = n0 * s[i, 0] + n1 * s[i, 1] + n2 * s[i, 2]
            whole = size * math.sqrt(s[i, 0] ** 2 + s[i, 1] ** 2 + s[i, 2] ** 2)
            reach = abs(n0) * room[0] + abs(n1) * room[1] + abs(n2) * room[2]
            reach += abs(d0) * u[0] + abs(d1) * u[1] + abs(d2) * u[2]
            right = (
                (far[i] - view.middle if c == FAR else k)
                + along
                + _rest(along, whole, across, t, nu)
            )
            if reach <= right:
                continue
            row = rows[n_rows]
            row[0] = n0
            row[1] = n1
            row[2] = n2
            row[3] = -d0
            row[4] = -d1
            row[5] = -d2
            rhs[n_rows] = right
            side[n_rows] = c
            n_rows += 1
    return n_rows


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
    reach = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2) + radius * length
    axial = (
        abs(x0 * matrix[0, 2] + x1 * matrix[1, 2] + x2 * matrix[2, 2])
        - radius * length
        - min(2.0 * t, 2.0) * reach
    )
    # both are wrong by less than this; where they are nearly equal, that tells in what is left of their squares
    wide = _EPS * length + _RELATIVE * reach
    reach = reach + wide
    axial = max(axial - wide, 0.0)
    area = math.sqrt((reach - axial) * (reach + axial))
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


# How much the windows of a box of poses weigh where they meet. Compiled loops.
#
# A window (`planner.bound.windows`) is given by the least values (6,) of x - tan_x z, -x -
# tan_x z, y - tan_y z, -y
# - tan_y z, -z and z. The room is the box |w_i| <= room_i in which they are asked to meet. It is
# halved where a heavy
# enough set of windows remains, the sides that most of them cut first.


@kernel
def weight_at(least, group, y, w, view):
    """Return the weight of the windows (m, 6) that contain w, of each group only the first one's."""
    total = 0.0
    x_z = view.tan_x * w[2]
    y_z = view.tan_y * w[2]
    seen = np.zeros(len(y), np.bool_)
    for a in range(len(y)):
        if (
            not seen[group[a]]
            and least[a, FAR] <= w[2] <= -least[a, NEAR]
            and least[a, RIGHT] + x_z <= w[0] <= -least[a, LEFT] - x_z
            and least[a, BOTTOM] + y_z <= w[1] <= -least[a, TOP] - y_z
        ):
            seen[group[a]] = True
            total += y[a]
    return total


@kernel
def may_exceed(least, group, y, limit, room, view, w):
    """Tell whether windows (m, 6) heavier than a limit may meet in the room; if so, write where into ``w`` (3,).

    ``y`` (m,) descends; of each group only the first window counts. The answer no is a proof; with the answer yes they
    meet at w, or nearly.
    """
    m = len(y)
    low = np.empty((_DEEPEST + 2, 3))
    high = np.empty((_DEEPEST + 2, 3))
    live = np.empty((_DEEPEST + 2, m), np.int16)
    n_live = np.empty(_DEEPEST + 2, np.int64)
    level = np.zeros(_DEEPEST + 2, np.int64)
    stamp = np.zeros(m, np.int64)
    cuts = np.empty(3)
    n_live[0] = m
    for k in range(3):
        low[0, k] = -room[k]
        high[0, k] = room[k]
    for a in range(m):
        live[0, a] = a
    size = 1
    n_seen = 0
    n_doubtful = 0
    middle = np.empty(3)
    while size > 0:
        size -= 1
        n_seen += 1
        n_live[size], total = _meeting(
            (least, group, y),
            live[size],
            n_live[size],
            low[size],
            high[size],
            view,
            stamp,
            n_seen,
            cuts,
        )
        if total <= limit:
            continue
        for k in range(3):
            middle[k] = (low[size, k] + high[size, k]) / 2
        if cuts.max() <= 0.0 or weight_at(least, group, y, middle, view) > limit:
            put(w, middle)
            return True
        if level[size] >= _DEEPEST:
            put(w, middle)
            n_doubtful += 1
            if n_doubtful == _DOUBTFUL:
                return True
            continue
        axis = np.argmax(cuts)
        for field in (low, high):
            put(field[size + 1], field[size])
        n_live[size + 1] = n_live[size]
        put(live[size + 1], live[size, : n_live[size]])
        low[size, axis] = high[size + 1, axis] = middle[axis]
        level[size] += 1
        level[size + 1] = level[size]
        size += 2
    return n_doubtful > 0


@kernel_without_refcounts
def _meeting(windows, live, n_live, low, high, view, stamp, n_seen, cuts):
    """Keep the live windows that meet a part of the room; return how many, and their weight.

    ``cuts`` (3,) becomes how many sides of windows cut the part across each axis, times its width.
    """
    lowest, group, y = windows
    n_meeting = 0
    total = 0.0
    cuts[:] = 0.0
    for i in range(n_live):
        a = live[i]
        # the window is widest at its least z
        z = max(lowest[a, FAR], low[2])
        x = view.tan_x * z
        y_ = view.tan_y * z
        if (
            z > min(-lowest[a, NEAR], high[2])
            or max(lowest[a, RIGHT] + x, low[0]) > min(-lowest[a, LEFT] - x, high[0])
            or max(lowest[a, BOTTOM] + y_, low[1]) > min(-lowest[a, TOP] - y_, high[1])
        ):
            continue
        live[n_meeting] = a
        n_meeting += 1
        if stamp[group[a]] < n_seen:
            stamp[group[a]] = n_seen
            total += y[a]
        x = view.tan_x * high[2]
        y_ = view.tan_y * high[2]
        cuts[0] += lowest[a, RIGHT] + x > low[0] or -lowest[a, LEFT] - x < high[0]
        cuts[1] += lowest[a, BOTTOM] + y_ > low[1] or -lowest[a, TOP] - y_ < high[1]
        cuts[2] += lowest[a, FAR] > low[2] or -lowest[a, NEAR] < high[2]
    cuts[0] *= (high[0] - low[0]) / (view.tan_x * view.middle)
    cuts[1] *= (high[1] - low[1]) / (view.tan_y * view.middle)
    cuts[2] *= (high[2] - low[2]) / ((view.far - view.near) / 2)
    return n_meeting, total
