"""The space of camera poses cut into boxes, each with the entities that some pose in it may inspect.

The necessary conditions are those of `planner.bound.lower_bound`, which says what they prove.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ground.decorators import entry_kernel, kernel, kernel_without_refcounts, put
from planner.bound.pose_space import WitnessSets, frustum_of, segments_of, sensor_tangents
from planner.bound.view import (
    TOUCH_MM,
    Cells,
    Segments,
    exclusive_groups,
    focus_reach,
    out_of_focus,
    outside,
    too_short,
    too_short_at,
)
from planner.camera.camera import Camera
from planner.executors import THREADS
from planner.request.problem import Problem

# What may be inspected from nodes of the tree of poses (`planner.bound.pose_tree`). Compiled
# loops.
#
# A node's set loses what no pose of the node inspects; and some entities exclude each other
# there.


# boxes with a smaller half size are not halved. The pair then counts as served.
_FINEST_MM = 0.5
# largest number of boxes for two cells. After that the pair counts as served.
_PAIR_BOXES = 200_000
# largest number of waiting boxes: one for each halving
_WAITING = 256

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
        largest = 0
        for e in range(len(members)):
            count = 0
            for f in range(len(members)):
                count += excludes[e, f]
            if count > largest:
                worst = e
                largest = count
        if largest > 0:
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


# Pairs of entities that no setting can inspect together, each for a reason that is a proof.
#
# * They do not fit: two of their ends are farther apart than any two points of the frustum
#   between the nearest and the
#   farthest sharp plane.
# * No viewpoint serves both. Space is subdivided into boxes; a box is discarded when it is
#   outside the one's or the
#   other's region, when an end in it cannot be at a distance the lens can focus on, when two ends
#   are farther apart in
#   angle than the corners of the sensor, or when an image is too short
#   (`planner.bound.pose_space`). The pair excludes
#   each other if no box is left.
#
# The second test stops at boxes of half a millimetre, so it may miss a conflict, but it never
# invents one.


# of angles, rad
_EPS_RAD = 1e-7
# places of a box in the stack
_MIDDLE, _HALF = range(2)


def find_conflicts(
    problem: Problem,
    entity_idx: NDArray[np.int_],
    columns: ArrayLike,
    regions: Cells,
) -> NDArray[np.bool_]:
    """Find the pairs of entities that exclude each other.

    Parameters
    ----------
    problem : Problem
        The request.
    entity_idx : array of int (e,)
        Entities, as columns of the request.
    columns : array of bool (c, e)
        Sets known to be inspected by some pose; their pairs need no test.
    regions : Cells
        The cells of each entity's region.

    Returns
    -------
    array of bool (e, e)
        Symmetric, false on the diagonal.
    """
    inspected = np.asarray(columns, dtype=bool)
    segments = segments_of(problem, entity_idx)
    frustum = frustum_of(problem)
    cells = regions.arrays
    together = inspected.T.astype(int) @ inspected.astype(int) > 0
    tangents = sensor_tangents(problem.camera, problem.requirements.border_px)
    conflict = too_far_apart(problem.camera, segments.ends, tangents) & ~together

    def excludes(pair: NDArray[np.int_]) -> bool:
        a, b = pair
        both = Segments(*(values[pair] for values in segments))
        return not _share_viewpoint(a, b, cells, both, frustum)

    pairs = np.argwhere(np.triu(~conflict & ~together, k=1))
    with ThreadPoolExecutor(THREADS) as pool:
        excluded = pairs[np.fromiter(pool.map(excludes, pairs), bool, len(pairs))]
    conflict[excluded[:, 0], excluded[:, 1]] = conflict[excluded[:, 1], excluded[:, 0]] = True
    return conflict


def too_far_apart(
    camera: Camera, ends: NDArray[np.float64], tangents: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which pairs of entities (ends: (e, 2, 3), mm) do not fit into the frustum together; (e, e) bool."""
    near, far = camera.depth_of_field_mm
    if not np.isfinite(far):
        return np.zeros((len(ends), len(ends)), dtype=bool)
    corners = np.array([[x, y, 1.0] for x in (-1, 1) for y in (-1, 1)]) * [*tangents, 1.0]
    corners = np.concatenate([near * corners, far * corners])
    # the two farthest points of a convex polytope are two of its corners
    diameter = np.linalg.norm(corners[:, None] - corners, axis=-1).max()
    distance = np.linalg.norm(ends[:, None, :, None] - ends[None, :, None], axis=-1).max(
        axis=(2, 3)
    )
    result = distance > diameter
    np.fill_diagonal(result, False)
    return result


# threads run it side by side
@entry_kernel(nogil=True)
def _share_viewpoint(a, b, cells, pair, frustum):
    """Tell whether some cell of entity a may meet some cell of entity b where the lens can take both at once.

    ``pair`` are the segments of the two.
    """
    planes = cells.planes
    plane_start = cells.plane_start
    entity_start = cells.entity_start
    stack = np.empty((_WAITING, 2, 3))
    for i in range(entity_start[a], entity_start[a + 1]):
        for j in range(entity_start[b], entity_start[b + 1]):
            if not _overlap(cells.boxes, i, j, stack[0]):
                continue
            if _apart(i, j, cells) or _apart(j, i, cells):
                continue
            if _search(stack, i, j, planes, plane_start, pair, frustum):
                return True
    return False


@kernel_without_refcounts
def _overlap(boxes, i, j, common):
    """Tell whether boxes i and j meet; write the centre and half size of what they share."""
    for k in range(3):
        low = max(boxes[i, 0, k], boxes[j, 0, k])
        high = min(boxes[i, 1, k], boxes[j, 1, k])
        if high - low < -TOUCH_MM:
            return False
        common[_MIDDLE, k] = (low + high) / 2
        common[_HALF, k] = (high - low) / 2
    return True


@kernel
def _search(stack, i, j, planes, plane_start, pair, frustum):
    """Subdivide the box on the stack; true when a viewpoint is found or the effort is spent."""
    size = 1
    for _ in range(_PAIR_BOXES):
        if size == 0:
            return False
        size -= 1
        centre = stack[size, _MIDDLE].copy()
        half = stack[size, _HALF].copy()
        if not _in_both(centre, half, i, j, planes, plane_start):
            continue
        if not _in_view(centre, math.sqrt(np.sum(half**2)), pair, frustum):
            continue
        axis = np.argmax(half)
        if half[axis] < _FINEST_MM or size + 2 > _WAITING:
            return True
        point = np.zeros(3)
        if _in_both(centre, point, i, j, planes, plane_start) and _in_view(
            centre, 0.0, pair, frustum
        ):
            return True
        half[axis] /= 2
        for sign in (-1.0, 1.0):
            put(stack[size, _MIDDLE], centre)
            put(stack[size, _HALF], half)
            stack[size, _MIDDLE, axis] += sign * half[axis]
            size += 1
    return True


@kernel_without_refcounts
def _in_both(centre, half, i, j, planes, plane_start):
    """Tell whether a box may meet both cells."""
    return not (
        outside(planes, plane_start[i], plane_start[i + 1], centre, half)
        or outside(planes, plane_start[j], plane_start[j + 1], centre, half)
    )


@kernel
def _in_view(centre, radius, pair, frustum):
    """Tell whether some viewpoint of a ball may have all ends in focus, within the sensor, and long enough images."""
    points = pair.ends.reshape(-1, 3)
    n = len(points)
    for k in range(n):
        if out_of_focus(_distance(points[k], centre), radius, frustum):
            return False
    away = np.empty(n)
    deep = frustum.far - frustum.near + TOUCH_MM
    for k in range(n):
        away[k] = _from_axis(_distance(points[k], centre), radius, frustum)
    for k in range(n):
        for m in range(k + 1, n):
            if _apart_in_view(points[k], points[m], centre, away[k] + away[m]):
                return False
            if _one_behind_the_other(points[k], points[m], centre, deep, away[k]):
                return False
            if _one_behind_the_other(points[m], points[k], centre, deep, away[m]):
                return False
    for e in range(2):
        if too_short(pair.ends[e], pair.lengths[e], pair.length_ratio[e], centre, radius, frustum):
            return False
    return True


@kernel_without_refcounts
def _from_axis(distance, radius, frustum):
    """Return how far off the axis, rad, a point may be seen, given its distance from the middle of a ball of eyes.

    The angle is that at the middle. A point is no farther off than a corner of the sensor, and than where its depth,
    which is its distance times the cosine, falls below the nearest sharp one.
    """
    if radius >= distance:
        return math.pi
    off = math.acos(min(1.0, (frustum.near - TOUCH_MM) / (distance + radius)))
    return min(frustum.cone, off) + math.asin(radius / distance)


@kernel_without_refcounts
def _apart_in_view(point, other, centre, most):
    """Tell whether two points are seen farther apart than an angle, rad."""
    cosine = 0.0
    for c in range(3):
        cosine += (point[c] - centre[c]) * (other[c] - centre[c])
    cosine /= max(_distance(point, centre) * _distance(other, centre), TOUCH_MM)
    return math.acos(min(1.0, max(-1.0, cosine))) > most + _EPS_RAD


@kernel_without_refcounts
def _one_behind_the_other(point, other, centre, deep, off):
    """Tell whether no axis that is at most ``off`` the first point, rad, has both within a depth of ``deep``, mm.

    Such an axis is nearly square to the line through both.
    """
    between = _distance(point, other)
    if between <= deep:
        return False
    square = 0.0
    for c in range(3):
        square += (point[c] - centre[c]) * (other[c] - point[c])
    first = _distance(point, centre)
    if first <= TOUCH_MM:
        return False
    slant = math.asin(deep / between)
    turned = math.asin(min(1.0, abs(square) / (first * between)))
    return turned > slant + off + _EPS_RAD


@kernel_without_refcounts
def _distance(point, other):
    x = point[0] - other[0]
    y = point[1] - other[1]
    z = point[2] - other[2]
    return math.sqrt(x * x + y * y + z * z)


@kernel_without_refcounts
def _apart(i, j, cells):
    """Tell whether a plane of cell i has all corners of cell j outside."""
    planes = cells.planes
    corners = cells.corners
    for p in range(cells.plane_start[i], cells.plane_start[i + 1]):
        separates = True
        for v in range(cells.corner_start[j], cells.corner_start[j + 1]):
            height = planes[p, 3]
            for k in range(3):
                height += planes[p, k] * corners[v, k]
            if height < TOUCH_MM:
                separates = False
                break
        if separates:
            return True
    return False


# nodes evaluated at a time; bounds the memory
_BATCH = 6000
# along which a node is split
_BY_POSITION = 0
_BY_DIRECTION = 1
_BY_ROLL = 2
_BY_SET = -1


class PoseTree:
    """The leaves of the subdivision and their optimistic sets.

    Parameters
    ----------
    problem : Problem
        The request.
    entity_idx : array of int (e,)
        Entities, as columns of the request.
    regions : Cells
        The cells of each entity's region.
    conflict : array of bool (e, e)
        Pairs that exclude each other.
    one_each : array of bool (e, e), optional
        Pairs of which only one counts in `weights`: these, and the witnesses of one target.
    """

    def __init__(
        self,
        problem: Problem,
        entity_idx: NDArray[np.int_],
        regions: Cells,
        conflict: NDArray[np.bool_],
        one_each: NDArray[np.bool_] | None = None,
    ):
        self.cells = regions.planes, regions.plane_start, regions.entity_start
        self.segments = segments_of(problem, entity_idx)
        self.frustum = frustum_of(problem)
        near, far, tan_x, tan_y, cone = self.frustum
        self.reach = focus_reach(self.frustum)
        # two points in view: both are on the sensor, and both in focus
        room = np.array([2 * far * tan_x, 2 * far * tan_y, far - near])
        self._pairs = Pairs(self.segments.ends, 2 * cone, room, conflict)
        # sets are not split between the witnesses of a target: both parts would hold it
        counted = conflict if one_each is None else one_each
        self._counted = self._pairs._replace(conflict=counted)
        self.made = 0
        self._plant(problem.space.workspace)

    def _plant(self, workspace: ArrayLike) -> None:
        """Start with one node per face of the cube of directions, all positions, all rolls."""
        low, high = np.asarray(workspace, dtype=float)
        points = self.segments.ends.reshape(-1, 3)
        low = np.maximum(low, points.min(axis=0) - self.reach)
        high = np.minimum(high, points.max(axis=0) + self.reach)
        n = 6
        self.centre = np.tile((low + high) / 2, (n, 1))
        self.half = np.tile((high - low) / 2, (n, 1))
        self.face = np.arange(n)
        self.patch = np.tile([-1.0, 1.0, -1.0, 1.0], (n, 1))
        # the sensor is symmetric under half a turn, so rolls of (-pi/2, pi/2) are all
        self.roll = np.tile([0.0, math.pi / 2], (n, 1))
        self.sets = np.ones((n, len(self.segments.ends)), dtype=bool)
        self._extents = np.zeros((n, 3))
        self._evaluate(np.arange(n))

    @property
    def size(self) -> NDArray[np.float64]:
        """The largest angle a node's extent causes, rad; (n,)."""
        return self._extents.max(axis=1)

    def to_dict(self) -> dict[str, Any]:
        """Return the leaves, for `regrow`; the arrays do not change any more."""
        return {**dict(self._fields()), "extents": self._extents, "made": self.made}

    def regrow(self, leaves: Mapping[str, Any]) -> None:
        """Go on from leaves of the same request."""
        for name, _ in self._fields():
            setattr(self, name, leaves[name])
        self._extents = leaves["extents"]
        self.made = leaves["made"]

    def split(self, nodes: NDArray[np.int_], sets_first: bool = True) -> None:
        """Replace nodes by their two halves along the coordinate that causes most slack; forget empty ones.

        With ``sets_first``, where entities exclude each other, the set is split and not the poses.
        """
        keep = np.ones(len(self.face), dtype=bool)
        keep[nodes] = False
        first, second = (
            {name: value[nodes].copy() for name, value in self._fields()} for _ in range(2)
        )
        clash = np.zeros(len(nodes), dtype=bool)
        if sets_first:
            clash = separate(self._places(nodes), self._pairs, first["sets"], second["sets"])
        self._halve(first, second, np.where(clash, _BY_SET, self._extents[nodes].argmax(axis=1)))
        n_old = int(keep.sum())
        for name, value in self._fields():
            setattr(self, name, np.concatenate([value[keep], first[name], second[name]]))
        self._extents = np.concatenate([self._extents[keep], np.zeros((2 * len(nodes), 3))])
        self.made += 2 * len(nodes)
        self._evaluate(np.arange(n_old, len(self.face)))
        self._drop_empty()

    def weights(self, nodes: NDArray[np.int_], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much one pose of each node can inspect at most, with weights y (e,) of the entities."""
        order = np.argsort(-y, kind="stable")
        return consistent_weights(
            self._places(nodes), self._counted, self.sets[nodes], y, order[y[order] > 0]
        )

    def _places(self, nodes: NDArray[np.int_]) -> Places:
        """Return what the tests for pairs of entities need to know of nodes."""
        _, spread, frame = _patch_frames(self.face[nodes], self.patch[nodes], self.roll[nodes, 0])
        # how far each axis of the camera may turn within the node
        turns = np.column_stack([*2 * [math.sqrt(2.0) * spread + self.roll[nodes, 1]], spread])
        radius = np.linalg.norm(self.half[nodes], axis=1)
        axes = np.ascontiguousarray(np.moveaxis(frame, 2, 1))
        return Places(self.centre[nodes], radius, axes, turns)

    def _fields(self) -> list[tuple[str, NDArray[Any]]]:
        return [
            (name, getattr(self, name))
            for name in ("centre", "half", "face", "patch", "roll", "sets")
        ]

    def _halve(
        self,
        first: dict[str, NDArray[Any]],
        second: dict[str, NDArray[Any]],
        kind: NDArray[np.int_],
    ) -> None:
        rows = np.flatnonzero(kind == _BY_POSITION)
        axis = first["half"][rows].argmax(axis=1)
        quarter = first["half"][rows, axis] / 2
        for child, sign in ((first, -1.0), (second, 1.0)):
            child["half"][rows, axis] = quarter
            child["centre"][rows, axis] += sign * quarter
        rows = np.flatnonzero(kind == _BY_DIRECTION)
        patch = first["patch"][rows]
        along = np.where(patch[:, 1] - patch[:, 0] >= patch[:, 3] - patch[:, 2], 0, 2)
        middle = (patch[np.arange(len(rows)), along] + patch[np.arange(len(rows)), along + 1]) / 2
        first["patch"][rows, along + 1] = middle
        second["patch"][rows, along] = middle
        rows = np.flatnonzero(kind == _BY_ROLL)
        for child, sign in ((first, -1.0), (second, 1.0)):
            child["roll"][rows, 1] /= 2
            child["roll"][rows, 0] += sign * child["roll"][rows, 1]

    def _drop_empty(self) -> None:
        nonempty = self.sets.any(axis=1)
        for name, value in self._fields():
            setattr(self, name, value[nonempty])
        self._extents = self._extents[nonempty]

    def _evaluate(self, nodes: NDArray[np.int_]) -> None:
        """Tighten the optimistic sets of nodes."""
        for start in range(0, len(nodes), _BATCH):
            part = nodes[start : start + _BATCH]
            axis, spread, frame = _patch_frames(
                self.face[part], self.patch[part], self.roll[part, 0]
            )
            radius = np.linalg.norm(self.half[part], axis=1)
            possible = self.sets[part].copy()
            turned = self.roll[part, 1] * math.sin(self.frustum.cone)
            views = Nodes(self.centre[part], radius, axis, spread, frame, turned)
            clear_unsatisfied(views, self.segments, self.frustum, possible)
            clear_unmet(self.centre[part], self.half[part], *self.cells, possible)
            self.sets[part] = possible
            typical = 0.5 * (self.frustum.near + min(self.frustum.far, 4 * self.frustum.near))
            self._extents[part] = np.column_stack([radius / typical, 1.4 * spread, turned])


class TargetLeaves:
    """The leaves of a tree of poses, whose sets are told as targets.

    Parameters
    ----------
    tree : PoseTree
        Its sets hold witnesses.
    witnesses : WitnessSets
        Of which targets they are.
    """

    def __init__(self, tree: PoseTree, witnesses: WitnessSets):
        self._tree = tree
        self._witnesses = witnesses
        self._sets: NDArray[np.bool_] | None = None

    @property
    def sets(self) -> NDArray[np.bool_]:
        """The targets (n, k) of each leaf."""
        if self._sets is None:
            self._sets = self._witnesses.to_targets(self._tree.sets)
        return self._sets

    @property
    def made(self) -> int:
        """Nodes made so far."""
        return self._tree.made

    @property
    def size(self) -> NDArray[np.float64]:
        """See `PoseTree.size`."""
        return self._tree.size

    def split(self, nodes: NDArray[np.int_], sets_first: bool = True) -> None:
        """See `PoseTree.split`."""
        self._tree.split(nodes, sets_first)
        self._sets = None

    def weights(self, nodes: NDArray[np.int_], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much one pose of each node can inspect at most, with weights y (k,) of the targets."""
        return self._tree.weights(nodes, y[self._witnesses.owner])

    def to_dict(self) -> dict[str, Any]:
        """Return the leaves, for `regrow`."""
        return self._tree.to_dict()

    def regrow(self, leaves: Mapping[str, Any]) -> None:
        """Go on from leaves of the same request."""
        self._tree.regrow(leaves)
        self._sets = None


def _patch_frames(
    face: NDArray[np.int_], patch: NDArray[np.float64], roll: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle axis (n, 3) of patches, the angle (n,) to their farthest point, and the frame (n, 3, 3).

    Directions on a face of the cube are (u, v, ±1) in its own order of axes. The frame's x axis is the projection of
    the face's u axis, turned by the roll. Between two directions of a patch the frame turns by at most sqrt(2) times
    the angle between them: its twist is |u.a| / sqrt(1 - (u.a)^2) <= 1 per radian.
    """
    u = (patch[:, 0] + patch[:, 1]) / 2
    v = (patch[:, 2] + patch[:, 3]) / 2
    axis = _directions(face, u, v)
    corners = [_directions(face, patch[:, i], patch[:, j]) for i in (0, 1) for j in (2, 3)]
    # from the chord, as the arc cosine of a number near 1 is inexact
    chord = np.max([np.linalg.norm(corner - axis, axis=1) for corner in corners], axis=0)
    along = np.zeros_like(axis)
    along[np.arange(len(face)), (face // 2 + 1) % 3] = 1.0
    x = along - np.einsum("ni,ni->n", along, axis)[:, None] * axis
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axis, x)
    c = np.cos(roll)[:, None]
    s = np.sin(roll)[:, None]
    return (
        axis,
        2.0 * np.arcsin(chord / 2.0),
        np.stack([c * x + s * y, c * y - s * x, axis], axis=-1),
    )


def _directions(
    face: NDArray[np.int_], u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    rows = np.arange(len(face))
    direction = np.zeros((len(face), 3))
    direction[rows, face // 2] = np.where(face % 2 == 0, 1.0, -1.0)
    direction[rows, (face // 2 + 1) % 3] = u
    direction[rows, (face // 2 + 2) % 3] = v
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)
