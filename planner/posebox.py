"""Boxes of camera poses: what some pose of a box may inspect, and how much of it at once. Compiled loops.

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

    n.s + k + (2/N) |W'(n x s)|.u + 2 |n| |s| (t^2 + t nu)        t = max |t|,  nu = max |v0.d| / N

(R(-t)s - s - 2 s x t is at most 2 t^2 |s|, and t - W d / N at most t nu). The forms depend on w in the same way for all
points, so each entity has a *window* of w, a frustum upside down, and what one pose inspects has windows that meet: the
most is found by stabbing. Only the turn makes the windows larger than they are; how large the box of q is matters for
visibility alone. That the camera turns about what it looks at, and not about itself, keeps s and so the turn's effect
small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

_EPS = 1e-9
# a cell that a nodal point may enter by less is not met
_TOUCH_MM = 1e-6
_TURN_UNBOUNDED = 1e3
# of the coordinates' scores: the most that one window counts, and what an entity of doubtful visibility does
_MOST_SCORE = 4.0
_DOUBT_SCORE = 0.5


class View(NamedTuple):
    """What the camera takes in: nearest, farthest and middle sharp depth, mm; tangents of the half angles of view.

    ``radius`` is the distance of the farthest point of that frustum from the point looked at, mm; ``length_ratio`` the
    length that images must have at least, over the image distance.
    """

    near: float
    far: float
    middle: float
    tan_x: float
    tan_y: float
    radius: float
    length_ratio: float


class Boxes(NamedTuple):
    """Boxes of poses: q0 (n, 3) and h (n, 3), mm; chart (n,), v0 (n, 3) and u (n, 3)."""

    look: np.ndarray
    half: np.ndarray
    chart: np.ndarray
    turn: np.ndarray
    span: np.ndarray


class Entities(NamedTuple):
    """Ends (e, 2, 3) and lengths (e,) of the entities, mm, and the cells of their regions, as in `conflicts.Cells`."""

    ends: np.ndarray
    lengths: np.ndarray
    planes: np.ndarray
    plane_start: np.ndarray
    boxes: np.ndarray
    entity_start: np.ndarray


@njit(cache=True)
def rotation(chart, v, matrix):
    """Write the rotation R of a chart and a vector v; return N."""
    n = 1.0 + v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    x, y, z = v[0], v[1], v[2]
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1 + x * x - y * y - z * z, 2 * (x * y - z), 2 * (x * z + y)
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2 * (x * y + z), 1 - x * x + y * y - z * z, 2 * (y * z - x)
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2 * (x * z - y), 2 * (y * z + x), 1 - x * x - y * y + z * z
    for i in range(3):
        sign = -1.0 if chart == 1 and i > 0 else 1.0
        for j in range(3):
            matrix[i, j] *= sign / n
    return n


@njit(cache=True)
def most_turn(v, u, n):
    """Return the largest |t| and the largest |v0.d| / N of a box."""
    nu = (abs(v[0]) * u[0] + abs(v[1]) * u[1] + abs(v[2]) * u[2]) / n
    if nu >= 0.99:
        return _TURN_UNBOUNDED, nu
    return math.sqrt((u[0] ** 2 + u[1] ** 2 + u[2] ** 2) / n) / (1.0 - nu), nu


@njit(cache=True)
def extent(matrix, h, t, room):
    """Write how far each coordinate of w may be from 0."""
    more = min(2.0 * t, 2.0) * math.sqrt(h[0] ** 2 + h[1] ** 2 + h[2] ** 2)
    for i in range(3):
        room[i] = abs(matrix[0, i]) * h[0] + abs(matrix[1, i]) * h[1] + abs(matrix[2, i]) * h[2] + more


@njit(cache=True)
def window(ends, q, v, u, matrix, n, t, nu, view, least, scores):
    """Write the least values (6,) of the forms -n.w that both ends of an entity allow.

    In the order of w's coordinates: x - tan_x z and -x - tan_x z, the same for y, then -z and z. Add to ``scores`` (6,)
    what each coordinate of the box does, as a share of the room there is.
    """
    for c in range(6):
        least[c] = -np.inf
    for i in range(2):
        d0, d1, d2 = ends[i, 0] - q[0], ends[i, 1] - q[1], ends[i, 2] - q[2]
        s0 = matrix[0, 0] * d0 + matrix[1, 0] * d1 + matrix[2, 0] * d2
        s1 = matrix[0, 1] * d0 + matrix[1, 1] * d1 + matrix[2, 1] * d2
        s2 = matrix[0, 2] * d0 + matrix[1, 2] * d1 + matrix[2, 2] * d2
        second = min(2.0 * (t * t + t * nu), 2.0) * math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
        for c in range(6):
            sign = -1.0 if c % 2 == 0 else 1.0
            if c < 2:
                n0, n1, n2, size, room = sign, 0.0, view.tan_x, math.sqrt(1 + view.tan_x**2), view.tan_x * view.middle
                k = room
            elif c < 4:
                n0, n1, n2, size, room = 0.0, sign, view.tan_y, math.sqrt(1 + view.tan_y**2), view.tan_y * view.middle
                k = room
            else:
                n0, n1, n2, size, room = 0.0, 0.0, -sign, 1.0, (view.far - view.near) / 2
                k = view.middle - view.near if c == 4 else view.far - view.middle
            g0, g1, g2 = n1 * s2 - n2 * s1, n2 * s0 - n0 * s2, n0 * s1 - n1 * s0
            p0 = 2.0 / n * abs(g0 + v[1] * g2 - v[2] * g1) * u[0]
            p1 = 2.0 / n * abs(g1 + v[2] * g0 - v[0] * g2) * u[1]
            p2 = 2.0 / n * abs(g2 + v[0] * g1 - v[1] * g0) * u[2]
            slack = p0 + p1 + p2 + size * second + _EPS
            least[c] = max(least[c], -(k + n0 * s0 + n1 * s1 + n2 * s2) - slack)
            share = size * second / (u[0] + u[1] + u[2])
            scores[3] += min((p0 + share * u[0]) / room, _MOST_SCORE)
            scores[4] += min((p1 + share * u[1]) / room, _MOST_SCORE)
            scores[5] += min((p2 + share * u[2]) / room, _MOST_SCORE)
            if t < 0.5:
                # a smaller box of q has smaller s
                for j in range(3):
                    scores[j] += 2.0 * t * size / room


@njit(cache=True)
def is_empty(least, room, view):
    """Tell whether a window lies outside the box; it is widest at the least depth of the point looked at."""
    z = max(least[5], -room[2])
    return (
        z > min(-least[4], room[2])
        or max(least[0] + view.tan_x * z, -room[0]) > min(-least[1] - view.tan_x * z, room[0])
        or max(least[2] + view.tan_y * z, -room[1]) > min(-least[3] - view.tan_y * z, room[1])
    )


@njit(cache=True)
def swings(matrix, v, u, n, t, nu, middle, swing):
    """Write how each coordinate of the turn moves the nodal point, (3, 3); return the remainder of second order."""
    w = np.empty(3)
    for k in range(3):
        w[k], w[(k + 1) % 3], w[(k + 2) % 3] = 1.0, -v[(k + 2) % 3], v[(k + 1) % 3]
        for i in range(3):
            swing[k, i] = 2.0 / n * middle * u[k] * (matrix[i, 0] * w[1] - matrix[i, 1] * w[0])
    return middle * min(2.0 * (t * t + t * nu), 2.0)


@njit(cache=True)
def _too_short(ends, length, c, radius, view):
    """Tell whether an image is too short from every nodal point within a radius: eq 16, depth >= distance cos(cone)."""
    w0, w1, w2 = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1], ends[1, 2] - ends[0, 2]
    o0, o1, o2 = c[0] - ends[0, 0], c[1] - ends[0, 1], c[2] - ends[0, 2]
    area = math.sqrt((o1 * w2 - o2 * w1) ** 2 + (o2 * w0 - o0 * w2) ** 2 + (o0 * w1 - o1 * w0) ** 2)
    depth = 1.0
    for i in range(2):
        distance = math.sqrt((ends[i, 0] - c[0]) ** 2 + (ends[i, 1] - c[1]) ** 2 + (ends[i, 2] - c[2]) ** 2)
        depth *= max(view.near, (distance - radius) / math.sqrt(1.0 + view.tan_x**2 + view.tan_y**2))
    return area + radius * length < view.length_ratio * depth * (1.0 - _EPS)


@njit(cache=True)
def _visibility(entities, e, c, h, swing, rest):
    """Return 0 if no nodal point of a box lies in a cell of entity e, 2 if all lie in one cell, else 1."""
    found = 0
    for cell in range(entities.entity_start[e], entities.entity_start[e + 1]):
        apart = False
        for k in range(3):
            reach = h[k] + rest + abs(swing[0, k]) + abs(swing[1, k]) + abs(swing[2, k])
            if entities.boxes[cell, 0, k] > c[k] + reach or entities.boxes[cell, 1, k] < c[k] - reach:
                apart = True
        inside = True
        for p in range(entities.plane_start[cell], entities.plane_start[cell + 1]):
            if apart:
                break
            p0, p1, p2 = entities.planes[p, 0], entities.planes[p, 1], entities.planes[p, 2]
            value = entities.planes[p, 3] + p0 * c[0] + p1 * c[1] + p2 * c[2]
            slack = abs(p0) * h[0] + abs(p1) * h[1] + abs(p2) * h[2]
            for k in range(3):
                slack += abs(p0 * swing[k, 0] + p1 * swing[k, 1] + p2 * swing[k, 2])
            slack += rest * math.sqrt(p0 * p0 + p1 * p1 + p2 * p2)
            apart = value - slack > _TOUCH_MM
            inside = inside and value + slack <= 0.0
        if not apart:
            if inside:
                return 2
            found = 1
    return found


@njit(cache=True)
def _out_of_range(ends, q, h, radius):
    """Tell whether an end is farther from the whole box of q than any point in view is from the point looked at."""
    for i in range(2):
        square = 0.0
        for k in range(3):
            square += max(abs(ends[i, k] - q[k]) - h[k], 0.0) ** 2
        if square > radius * radius:
            return True
    return False


@njit(cache=True)
def evaluate(boxes, entities, view, possible, scores):
    """Clear ``possible[b, e]`` (n, e) where no pose of box b may inspect entity e.

    Write into ``scores`` (n, 6) how much each coordinate of the box, q then v, does to what is undecided.
    """
    matrix, room, least, swing, c = np.empty((3, 3)), np.empty(3), np.empty(6), np.empty((3, 3)), np.empty(3)
    for b in range(len(boxes.look)):
        q, h, v, u, score = boxes.look[b], boxes.half[b], boxes.turn[b], boxes.span[b], scores[b]
        n = rotation(boxes.chart[b], v, matrix)
        t, nu = most_turn(v, u, n)
        extent(matrix, h, t, room)
        rest = swings(matrix, v, u, n, t, nu, view.middle, swing)
        radius = rest + math.sqrt(np.sum(h**2))
        for k in range(3):
            c[k] = q[k] - view.middle * matrix[k, 2]
            radius += math.sqrt(np.sum(swing[k] ** 2))
        score[:] = 0.0
        doubtful = 0
        for e in range(possible.shape[1]):
            if not possible[b, e]:
                continue
            possible[b, e] = False
            if _out_of_range(entities.ends[e], q, h, view.radius):
                continue
            window(entities.ends[e], q, v, u, matrix, n, t, nu, view, least, score)
            if is_empty(least, room, view) or _too_short(entities.ends[e], entities.lengths[e], c, radius, view):
                continue
            found = _visibility(entities, e, c, h, swing, rest)
            possible[b, e] = found > 0
            doubtful += found == 1
        doubt = _DOUBT_SCORE * doubtful / (view.tan_x * view.middle)
        for k in range(3):
            score[k] = h[k] * (score[k] + doubt)
            score[3 + k] += doubt * math.sqrt(np.sum(swing[k] ** 2))


@njit(cache=True)
def heaviest(boxes, entities, view, conflict, possible, y, limit, weight):
    """Write a bound (n,) on the weight of what one pose of each box inspects, or the limit if it is not above that.

    ``y`` (e,) are weights in descending order, ``conflict`` (e, e) tells which entities exclude each other anyhow.
    """
    members = np.empty(len(y), np.int64)
    for b in range(len(weight)):
        total, m = 0.0, 0
        for e in range(len(y)):
            if possible[b, e]:
                members[m] = e
                m += 1
                total += y[e]
        weight[b] = total
        if total > limit:
            weight[b] = _stab(boxes, b, entities, view, conflict, members[:m], y, limit)


@njit(cache=True)
def _stab(boxes, b, entities, view, conflict, members, y, limit):
    """Return the weight of the heaviest members whose windows meet in the box, or the limit if it is not above.

    If windows meet, they do so at the least z that all allow, which is that of one of them; there they are rectangles,
    and those that meet do so at the left side of one of them.
    """
    m = len(members)
    y = y[members]
    group = _cliques(members, conflict)
    live, within = np.ones(m, np.bool_), np.empty(m, np.bool_)
    if _weight(live, group, y) <= limit:
        return limit
    matrix, room, spare = np.empty((3, 3)), np.empty(3), np.empty(6)
    n = rotation(boxes.chart[b], boxes.turn[b], matrix)
    t, nu = most_turn(boxes.turn[b], boxes.span[b], n)
    extent(matrix, boxes.half[b], t, room)
    least = np.empty((m, 6))
    for a in range(m):
        ends = entities.ends[members[a]]
        window(ends, boxes.look[b], boxes.turn[b], boxes.span[b], matrix, n, t, nu, view, least[a], spare)
    by_x, by_low, by_high = np.argsort(least[:, 0]), np.argsort(least[:, 2]), np.argsort(-least[:, 3])
    best = limit
    for deepest in range(m):
        z = max(least[deepest, 5], -room[2])
        if z > min(-least[deepest, 4], room[2]):
            continue
        for a in range(m):
            live[a] = (
                least[a, 5] <= z <= -least[a, 4]
                and least[a, 0] + view.tan_x * z <= min(-least[a, 1] - view.tan_x * z, room[0])
                and -least[a, 1] - view.tan_x * z >= -room[0]
                and least[a, 2] + view.tan_y * z <= min(-least[a, 3] - view.tan_y * z, room[1])
                and -least[a, 3] - view.tan_y * z >= -room[1]
            )
        if not live[deepest] or _weight(live, group, y) <= best:
            continue
        for left in by_x:
            if not live[left]:
                continue
            x = max(least[left, 0] + view.tan_x * z, -room[0])
            for a in range(m):
                within[a] = live[a] and least[a, 0] + view.tan_x * z <= x <= -least[a, 1] - view.tan_x * z
            if within[deepest] and _weight(within, group, y) > best:
                best = _sweep(least, view.tan_y * z, room[1], within, by_low, by_high, group, y, best)
    return best


@njit(cache=True)
def _sweep(least, shift, room, within, by_low, by_high, group, y, best):
    """Return the weight of the heaviest of the intervals of y that meet, or ``best`` if it is not above."""
    now = np.zeros(len(y), np.bool_)
    weight, j = 0.0, 0
    for a in by_low:
        if not within[a]:
            continue
        low = max(least[a, 2] + shift, -room)
        while j < len(y) and -least[by_high[j], 3] - shift < low:
            if now[by_high[j]]:
                now[by_high[j]] = False
                weight -= y[by_high[j]]
            j += 1
        now[a] = True
        weight += y[a]
        if weight > best:
            best = max(best, _weight(now, group, y))
    return best


@njit(cache=True)
def _cliques(members, conflict):
    """Return a group for each member such that those of one group all exclude each other; numbered from 0."""
    m = len(members)
    group = np.empty(m, np.int64)
    n_groups = 0
    for a in range(m):
        group[a] = n_groups
        for g in range(n_groups):
            fits = True
            for b in range(a):
                if group[b] == g and not conflict[members[a], members[b]]:
                    fits = False
                    break
            if fits:
                group[a] = g
                break
        if group[a] == n_groups:
            n_groups += 1
    return group


@njit(cache=True)
def _weight(active, group, y):
    """Return the weight of the active members, of each group only the heaviest; y descends."""
    seen = np.zeros(len(y), np.bool_)
    total = 0.0
    for a in range(len(y)):
        if active[a] and not seen[group[a]]:
            seen[group[a]] = True
            total += y[a]
    return total
