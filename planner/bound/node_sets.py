"""What may be inspected from nodes of the tree of poses (`planner.bound.pose_tree`). Compiled loops.

A node's set loses what no pose of the node inspects; and some entities exclude each other there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.decorators import entry_kernel, kernel, kernel_without_refcounts, put
from planner.bound.boxes.box_conditions import out_of_focus, outside, too_short_at
from planner.bound.boxes.exclusive_groups import exclusive_groups

_EPS = 1e-9
# of unit vectors' products
_EPS_COSINE = 1e-12
# of an end in a node: half the sensor's angle and what the box's size adds, with its cosine and sine
_ANGLE, _COSINE, _SINE = range(3)


class Nodes(NamedTuple):
    """Nodes (n): balls of positions and cones of directions around what is in the middle.

    Attributes
    ----------
    centre, radius : array (n, 3), (n,)
        Of the ball, mm.
    axis, spread : array (n, 3), (n,)
        Of the cone, rad.
    frame : array (n, 3, 3)
        Camera to part, with the middle roll.
    turned : array (n,)
        How far the rolls may turn a point at the sensor's corner, rad.
    """

    centre: NDArray[np.float64]
    radius: NDArray[np.float64]
    axis: NDArray[np.float64]
    spread: NDArray[np.float64]
    frame: NDArray[np.float64]
    turned: NDArray[np.float64]


class Places(NamedTuple):
    """What the tests for pairs of entities need to know of nodes (n).

    Attributes
    ----------
    centre, radius : array (n, 3), (n,)
        Of the ball of positions, mm.
    axes : array (n, 3, 3)
        The camera's axes, one in each row, in the middle of the node.
    turns : array (n, 3)
        How far each of them may turn within the node, rad.
    """

    centre: NDArray[np.float64]
    radius: NDArray[np.float64]
    axes: NDArray[np.float64]
    turns: NDArray[np.float64]


class Pairs(NamedTuple):
    """What the tests for pairs of entities need to know of the request.

    Attributes
    ----------
    ends : array (e, 2, 3)
        Of the entities' segments, mm.
    angle : float
        Between opposite corners of the sensor, rad.
    room : array (3,)
        How far apart two points in view can be along the camera's axes, mm.
    conflict : array of bool (e, e)
        Pairs that exclude each other anyhow.
    """

    ends: NDArray[np.float64]
    angle: float
    room: NDArray[np.float64]
    conflict: NDArray[np.bool_]


@entry_kernel
def clear_unsatisfied(nodes, segments, frustum, possible):
    """Clear ``possible[n, e]`` where no pose of node n has entity e in focus, on the sensor, and long enough there."""
    ends, lengths, length_ratio = segments
    for n in range(len(nodes.centre)):
        for e in range(possible.shape[1]):
            if not possible[n, e]:
                continue
            depths = 1.0
            for i in range(2):
                nearest = _nearest_depth(ends[e, i] - nodes.centre[n], nodes, n, frustum)
                if nearest < 0.0:
                    possible[n, e] = False
                    break
                depths *= nearest
            if possible[n, e]:
                centre = nodes.centre[n]
                radius = nodes.radius[n]
                possible[n, e] = not too_short_at(
                    ends[e], lengths[e], length_ratio[e], centre, radius, depths
                )


@kernel_without_refcounts
def _nearest_depth(ray, nodes, n, frustum):
    """Return the least depth at which node n may have a point in focus and on the sensor; -1 if it cannot.

    ``ray`` leads from the middle of its positions to the point.
    """
    radius = nodes.radius[n]
    axis = nodes.axis[n]
    spread = nodes.spread[n]
    frame = nodes.frame[n]
    turned = nodes.turned[n]
    near, far, tan_x, tan_y, cone = frustum
    distance = math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
    if out_of_focus(distance, radius, frustum):
        return -1.0
    swing = math.asin(radius / distance) if distance > radius else math.pi
    length = max(distance, _EPS)
    # not the arc cosine, which near 0 is wrong by 1e-8
    x = ray[1] * axis[2] - ray[2] * axis[1]
    y = ray[2] * axis[0] - ray[0] * axis[2]
    z = ray[0] * axis[1] - ray[1] * axis[0]
    along = ray[0] * axis[0] + ray[1] * axis[1] + ray[2] * axis[2]
    angle = math.atan2(math.sqrt(x * x + y * y + z * z), along)
    if angle > cone + swing + spread + _EPS:
        return -1.0
    nearest = distance * math.cos(min(angle + spread, math.pi)) - radius
    farthest = distance * math.cos(max(angle - spread, 0.0)) + radius
    if farthest < near - _EPS or nearest > far + _EPS:
        return -1.0
    slack = swing + math.sqrt(2.0) * spread + turned
    if slack < math.pi / 2:
        lowest = -math.sin(slack + _EPS) - _EPS
        ahead = (ray[0] * frame[0, 2] + ray[1] * frame[1, 2] + ray[2] * frame[2, 2]) / length
        for i in range(2):
            across = (
                abs(ray[0] * frame[0, i] + ray[1] * frame[1, i] + ray[2] * frame[2, i]) / length
            )
            tangent = tan_x if i == 0 else tan_y
            if (tangent * ahead - across) / math.sqrt(1.0 + tangent**2) < lowest:
                return -1.0
    return max(nearest - _EPS, near)


@entry_kernel
def clear_unmet(centre, half, planes, cell_start, entity_start, possible):
    """Clear ``possible[n, e]`` where box n lies wholly outside some half-space of every cell of entity e."""
    for n in range(centre.shape[0]):
        for e in range(possible.shape[1]):
            if not possible[n, e]:
                continue
            met = False
            for cell in range(entity_start[e], entity_start[e + 1]):
                if not outside(planes, cell_start[cell], cell_start[cell + 1], centre[n], half[n]):
                    met = True
                    break
            possible[n, e] = met


@entry_kernel
def separate(places, pairs, first, second):
    """Split sets instead of poses: a pose inspects the most contested entity of a set, or none that it excludes.

    Changes the sets of both halves; returns where it did.
    """
    n = len(first)
    changed = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        members = np.flatnonzero(first[k])
        excludes = _exclusions(members, places, k, pairs)
        worst = 0
        most = 0
        for e in range(len(members)):
            count = 0
            for f in range(len(members)):
                count += excludes[e, f]
            if count > most:
                worst = e
                most = count
        if most > 0:
            changed[k] = True
            first[k, members[worst]] = False
            for f in range(len(members)):
                if excludes[worst, f]:
                    second[k, members[f]] = False
    return changed


@entry_kernel
def consistent_weights(places, pairs, sets, y, order):
    """Return for each node a bound on the weight of what one pose of it inspects, with weights y.

    Of entities that all exclude each other, a pose inspects one at most: the heaviest of each such group counts.
    ``order``: the entities with weights above 0, the heaviest first.
    """
    result = np.zeros(len(sets))
    for k in range(len(sets)):
        members = order[sets[k][order]]
        excludes = _exclusions(members, places, k, pairs)
        group = np.empty(len(members), np.int64)
        exclusive_groups(np.arange(len(members)), excludes, group)
        n_groups = 0
        for e in range(len(members)):
            if group[e] == n_groups:
                n_groups += 1
                result[k] += y[members[e]]
    return result


@kernel
def _exclusions(members, places, k, pairs):
    """Return which of the entities exclude each other in node k, (m, m) bool.

    For good; or from this box of positions: two of their ends are farther apart in angle than the corners of the
    sensor; or for these directions: farther apart along an axis of the camera, which its position does not change, than
    the frustum between the nearest and the farthest sharp plane is wide or deep.
    """
    ends, angle, room, conflict = pairs
    centre = places.centre[k]
    radius = places.radius[k]
    axes = places.axes[k]
    turns = places.turns[k]
    m = len(members)
    rays = np.empty((m, 2, 3))
    wide = np.empty((m, 2, 3))
    for e in range(m):
        for i in range(2):
            ray = ends[members[e], i] - centre
            length = math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            put(rays[e, i], ray / max(length, _EPS))
            swing = math.asin(radius / length) if length > radius else math.pi
            half = angle / 2 + swing + _EPS
            wide[e, i, _ANGLE] = half
            wide[e, i, _COSINE] = math.cos(half)
            wide[e, i, _SINE] = math.sin(half)
    excludes = np.zeros((m, m), dtype=np.bool_)
    for e in range(m):
        for f in range(e + 1, m):
            if (
                conflict[members[e], members[f]]
                or _too_wide(rays[e], rays[f], wide[e], wide[f])
                or _too_far(ends[members[e]], ends[members[f]], axes, turns, room)
            ):
                excludes[e, f] = excludes[f, e] = True
    return excludes


@kernel_without_refcounts
def _too_far(first, second, axes, turns, room):
    """Tell whether an end of one entity is always farther than there is room, along some axis, from one of the other.

    The component of w along an axis that turns by up to t is at least |w| cos(angle + t), the angle being at most pi/2.
    """
    for i in range(2):
        for j in range(2):
            x = first[i, 0] - second[j, 0]
            y = first[i, 1] - second[j, 1]
            z = first[i, 2] - second[j, 2]
            squared = x * x + y * y + z * z
            for axis in range(3):
                if squared <= room[axis] ** 2:
                    continue
                along = abs(x * axes[axis, 0] + y * axes[axis, 1] + z * axes[axis, 2])
                if along <= room[axis]:
                    continue
                across = math.sqrt(max(squared - along * along, 0.0))
                if (
                    along * math.cos(turns[axis]) - across * math.sin(turns[axis])
                    > room[axis] + _EPS
                ):
                    return True
    return False


@kernel_without_refcounts
def _too_wide(first, second, first_wide, second_wide):
    """Tell whether an end of one entity is always farther than an angle from an end of the other."""
    for i in range(2):
        for j in range(2):
            if first_wide[i, _ANGLE] + second_wide[j, _ANGLE] >= math.pi:
                continue
            limit = (
                first_wide[i, _COSINE] * second_wide[j, _COSINE]
                - first_wide[i, _SINE] * second_wide[j, _SINE]
            )
            cosine = (
                first[i, 0] * second[j, 0] + first[i, 1] * second[j, 1] + first[i, 2] * second[j, 2]
            )
            if cosine < limit - _EPS_COSINE:
                return True
    return False
