"""The space of camera poses cut into boxes, each with the entities that some pose in it may inspect.

The necessary conditions are those of `planner.bound.lower_bound`, which says what they prove.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from planner.bound.boxes.cells import Cells
from planner.bound.boxes.exclusive_groups import exclusive_groups
from planner.bound.excluded_pairs import sensor_tangents
from planner.bound.least_image import least_image_mm

_BATCH = 6000
_EPS = 1e-9


class PoseTree:
    """The leaves of the subdivision and their optimistic sets."""

    def __init__(self, judge, entity_idx: np.ndarray, regions: Cells, conflict: np.ndarray):
        self.conflict = conflict
        self.cells = regions.planes, regions.plane_start, regions.entity_start
        camera, need = judge.camera, judge.requirements
        self.ends = judge.ends[entity_idx]
        self.image_distance = camera.image_distance_mm
        self.min_length = least_image_mm(judge)
        self.near, self.far = camera.depth_of_field_mm
        self.tangents = sensor_tangents(camera, need.field_margin_px)
        self.cone = math.atan(math.hypot(*self.tangents))
        self.reach = self.far / math.cos(self.cone)
        self.lengths = np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)
        self.directions = (self.ends[:, 1] - self.ends[:, 0]) / self.lengths[:, None]
        self._limits = (self.near, self.far, self.reach, self.cone, self.min_length / self.image_distance)
        # how far apart two points can be along the camera's axes: both are on the sensor, and both in focus
        self._room = np.array([*(2 * self.far * np.array(self.tangents)), self.far - self.near])
        self.made = 0
        self._plant(judge.space.workspace)

    def _plant(self, workspace) -> None:
        """Start with one node per face of the cube of directions, all positions, all rolls."""
        low, high = (np.asarray(corner, dtype=float) for corner in workspace)
        points = self.ends.reshape(-1, 3)
        low, high = np.maximum(low, points.min(axis=0) - self.reach), np.minimum(high, points.max(axis=0) + self.reach)
        n = 6
        self.center = np.tile((low + high) / 2, (n, 1))
        self.half = np.tile((high - low) / 2, (n, 1))
        self.face = np.arange(n)
        self.patch = np.tile([-1.0, 1.0, -1.0, 1.0], (n, 1))
        # the sensor is symmetric under half a turn, so rolls of (-pi/2, pi/2) are all
        self.roll = np.tile([0.0, math.pi / 2], (n, 1))
        self.sets = np.ones((n, len(self.ends)), dtype=bool)
        self._evaluate(np.arange(n))

    @property
    def size(self) -> np.ndarray:
        """The largest angle a node's extent causes, rad; (n,)."""
        return self._extents.max(axis=1)

    def split(self, nodes: np.ndarray, sets_first: bool = True) -> None:
        """Replace nodes by their two halves along the coordinate that causes most slack; forget empty ones.

        With ``sets_first``, where entities exclude each other, the set is split and not the poses.
        """
        keep = np.ones(len(self.face), dtype=bool)
        keep[nodes] = False
        first, second = ({name: value[nodes].copy() for name, value in self._fields()} for _ in range(2))
        clash = np.zeros(len(nodes), dtype=bool)
        if sets_first:
            clash = _separate(*self._places(nodes), first["sets"], second["sets"])
        self._halve(first, second, np.where(clash, -1, self._extents[nodes].argmax(axis=1)))
        n_old = int(keep.sum())
        for name, value in self._fields():
            setattr(self, name, np.concatenate([value[keep], first[name], second[name]]))
        self._extents = np.concatenate([self._extents[keep], np.zeros((2 * len(nodes), 3))])
        self.made += 2 * len(nodes)
        self._evaluate(np.arange(n_old, len(self.face)))
        self._drop_empty()

    def weights(self, nodes: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return how much one pose of each node can inspect at most, with weights y (e,) of the entities."""
        return _consistent_weights(*self._places(nodes), self.sets[nodes], y)

    def _places(self, nodes: np.ndarray) -> tuple:
        """Return what the tests for pairs of entities need to know of nodes and request."""
        _, spread, frame = _patch_frames(self.face[nodes], self.patch[nodes], self.roll[nodes, 0])
        # how far each axis of the camera may turn within the node
        turns = np.column_stack([*2 * [math.sqrt(2.0) * spread + self.roll[nodes, 1]], spread])
        radius = np.linalg.norm(self.half[nodes], axis=1)
        axes = np.ascontiguousarray(np.moveaxis(frame, 2, 1))
        return self.center[nodes], radius, axes, turns, self.ends, 2 * self.cone, self._room, self.conflict

    def _fields(self):
        return [(name, getattr(self, name)) for name in ("center", "half", "face", "patch", "roll", "sets")]

    def _halve(self, first: dict, second: dict, kind: np.ndarray) -> None:
        rows = np.flatnonzero(kind == 0)
        axis = first["half"][rows].argmax(axis=1)
        quarter = first["half"][rows, axis] / 2
        for child, sign in ((first, -1.0), (second, 1.0)):
            child["half"][rows, axis] = quarter
            child["center"][rows, axis] += sign * quarter
        rows = np.flatnonzero(kind == 1)
        patch = first["patch"][rows]
        along = np.where(patch[:, 1] - patch[:, 0] >= patch[:, 3] - patch[:, 2], 0, 2)
        middle = (patch[np.arange(len(rows)), along] + patch[np.arange(len(rows)), along + 1]) / 2
        first["patch"][rows, along + 1] = middle
        second["patch"][rows, along] = middle
        rows = np.flatnonzero(kind == 2)
        for child, sign in ((first, -1.0), (second, 1.0)):
            child["roll"][rows, 1] /= 2
            child["roll"][rows, 0] += sign * child["roll"][rows, 1]

    def _drop_empty(self) -> None:
        kept = self.sets.any(axis=1)
        for name, value in self._fields():
            setattr(self, name, value[kept])
        self._extents = self._extents[kept]

    def _evaluate(self, nodes: np.ndarray) -> None:
        """Tighten the optimistic sets of nodes."""
        if len(self.face) != len(getattr(self, "_extents", ())):
            self._extents = np.zeros((len(self.face), 3))
        for start in range(0, len(nodes), _BATCH):
            part = nodes[start : start + _BATCH]
            axis, spread, frame = _patch_frames(self.face[part], self.patch[part], self.roll[part, 0])
            radius = np.linalg.norm(self.half[part], axis=1)
            possible = self.sets[part].copy()
            turned = self.roll[part, 1] * math.sin(self.cone)
            views = self.center[part], radius, axis, spread, frame, turned
            entities = self.ends, self.directions, self.lengths
            _satisfy(views, entities, self._limits, self.tangents, possible)
            _meets(self.center[part], self.half[part], *self.cells, possible)
            self.sets[part] = possible
            typical = 0.5 * (self.near + min(self.far, 4 * self.near))
            self._extents[part] = np.column_stack([radius / typical, 1.4 * spread, turned])


def _patch_frames(face: np.ndarray, patch: np.ndarray, roll: np.ndarray):
    """Return the middle axis (n, 3) of patches, the angle (n,) to their farthest point, and the frame (n, 3, 3).

    Directions on a face of the cube are (u, v, ±1) in its own order of axes. The frame's x axis is the projection of
    the face's u axis, turned by the roll. Between two directions of a patch the frame turns by at most sqrt(2) times
    the angle between them: its twist is |u.a| / sqrt(1 - (u.a)^2) <= 1 per radian.
    """
    u, v = (patch[:, 0] + patch[:, 1]) / 2, (patch[:, 2] + patch[:, 3]) / 2
    axis = _directions(face, u, v)
    corners = [_directions(face, patch[:, i], patch[:, j]) for i in (0, 1) for j in (2, 3)]
    # from the chord, as the arc cosine of a number near 1 is inexact
    chord = np.max([np.linalg.norm(corner - axis, axis=1) for corner in corners], axis=0)
    along = np.zeros_like(axis)
    along[np.arange(len(face)), (face // 2 + 1) % 3] = 1.0
    x = along - np.einsum("ni,ni->n", along, axis)[:, None] * axis
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axis, x)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return axis, 2.0 * np.arcsin(chord / 2.0), np.stack([c * x + s * y, c * y - s * x, axis], axis=-1)


def _directions(face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    rows = np.arange(len(face))
    direction = np.zeros((len(face), 3))
    direction[rows, face // 2] = np.where(face % 2 == 0, 1.0, -1.0)
    direction[rows, (face // 2 + 1) % 3] = u
    direction[rows, (face // 2 + 2) % 3] = v
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


@nb.njit(cache=True)
def _satisfy(nodes, entities, limits, tangents, possible):
    """Clear ``possible[n, e]`` where no pose of node n has entity e in focus, on the sensor, and long enough there."""
    (center, radius, axis, spread, frame, turned), (ends, directions, lengths) = nodes, entities
    frustum, length_ratio = limits[:4], limits[4]
    for n in range(center.shape[0]):
        for e in range(possible.shape[1]):
            if not possible[n, e]:
                continue
            depth = 1.0
            for i in range(2):
                nearest = _nearest_depth(
                    ends[e, i] - center[n],
                    radius[n],
                    axis[n],
                    spread[n],
                    frame[n],
                    turned[n],
                    frustum,
                    tangents,
                )
                if nearest < 0.0:
                    possible[n, e] = False
                    break
                depth *= nearest
            if possible[n, e]:
                # the image's length: eq 16 with ||w x v|| <= ||w|| is d L_w dist(r_v, line) / (z_1 z_2)
                offset, line = center[n] - ends[e, 0], directions[e]
                x = offset[1] * line[2] - offset[2] * line[1]
                y = offset[2] * line[0] - offset[0] * line[2]
                z = offset[0] * line[1] - offset[1] * line[0]
                off_line = math.sqrt(x * x + y * y + z * z) + radius[n]
                possible[n, e] = lengths[e] * off_line >= length_ratio * depth * (1 - _EPS)


@nb.njit(cache=True)
def _nearest_depth(ray, radius, axis, spread, frame, turned, frustum, tangents):
    """Return the least depth at which a node may have a point in focus and on the sensor; -1 if it cannot."""
    near, far, reach, cone = frustum
    distance = math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
    if distance - radius > reach or distance + radius < near:
        return -1.0
    swing = math.asin(radius / distance) if distance > radius else math.pi
    length = max(distance, _EPS)
    # not the arc cosine, which near 0 is wrong by 1e-8
    x, y = ray[1] * axis[2] - ray[2] * axis[1], ray[2] * axis[0] - ray[0] * axis[2]
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
            across = abs(ray[0] * frame[0, i] + ray[1] * frame[1, i] + ray[2] * frame[2, i]) / length
            if (tangents[i] * ahead - across) / math.sqrt(1.0 + tangents[i] ** 2) < lowest:
                return -1.0
    return max(nearest - _EPS, near)


@nb.njit(cache=True)
def _meets(center, half, planes, cell_start, entity_start, possible):
    """Clear ``possible[n, e]`` where box n lies wholly outside some half-space of every cell of entity e."""
    for n in range(center.shape[0]):
        for e in range(possible.shape[1]):
            if not possible[n, e]:
                continue
            met = False
            for cell in range(entity_start[e], entity_start[e + 1]):
                outside = False
                for p in range(cell_start[cell], cell_start[cell + 1]):
                    lowest = planes[p, 3]
                    for i in range(3):
                        lowest += planes[p, i] * center[n, i] - abs(planes[p, i]) * half[n, i]
                    if lowest > 1e-6:
                        outside = True
                        break
                if not outside:
                    met = True
                    break
            possible[n, e] = met


@nb.njit(cache=True)
def _separate(center, radius, axes, turns, ends, angle, room, conflict, first, second):
    """Split sets instead of poses: a pose inspects the most contested entity of a set, or none that it excludes.

    Changes the sets of both halves; returns where it did.
    """
    n = len(first)
    changed = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        members = np.flatnonzero(first[k])
        excludes = _exclusions(members, center[k], radius[k], axes[k], turns[k], ends, angle, room, conflict)
        count = excludes.sum(axis=1)
        if len(members) and count.max() > 0:
            worst = np.argmax(count)
            changed[k] = True
            first[k, members[worst]] = False
            for f in range(len(members)):
                if excludes[worst, f]:
                    second[k, members[f]] = False
    return changed


@nb.njit(cache=True)
def _consistent_weights(center, radius, axes, turns, ends, angle, room, conflict, sets, y):
    """Return for each node a bound on the weight of what one pose of it inspects, with weights y.

    Of entities that all exclude each other, a pose inspects one at most: the heaviest of each such group counts.
    """
    result = np.zeros(len(sets))
    order = np.argsort(-y)
    order = order[y[order] > 0]
    for k in range(len(sets)):
        members = order[sets[k][order]]
        excludes = _exclusions(members, center[k], radius[k], axes[k], turns[k], ends, angle, room, conflict)
        group = np.empty(len(members), np.int64)
        exclusive_groups(np.arange(len(members)), excludes, group)
        n_groups = 0
        for e in range(len(members)):
            if group[e] == n_groups:
                n_groups += 1
                result[k] += y[members[e]]
    return result


@nb.njit(cache=True)
def _exclusions(members, center, radius, axes, turns, ends, angle, room, conflict):
    """Return which of the entities exclude each other in a node, (m, m) bool.

    For good; or from this box of positions: two of their ends are farther apart in angle than the corners of the
    sensor; or for these directions: farther apart along an axis of the camera, which its position does not change, than
    the frustum between the nearest and the farthest sharp plane is wide or deep.
    """
    m = len(members)
    rays = np.empty((m, 2, 3))
    # of each end: half the sensor's angle and what the box's size adds, with its cosine and sine
    wide = np.empty((m, 2, 3))
    for e in range(m):
        for i in range(2):
            ray = ends[members[e], i] - center
            length = math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            rays[e, i] = ray / max(length, 1e-9)
            swing = math.asin(radius / length) if length > radius else math.pi
            half = angle / 2 + swing + 1e-9
            wide[e, i, 0], wide[e, i, 1], wide[e, i, 2] = half, math.cos(half), math.sin(half)
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


@nb.njit(cache=True)
def _too_far(first, second, axes, turns, room):
    """Tell whether an end of one entity is always farther than there is room, along some axis, from one of the other.

    The component of w along an axis that turns by up to t is at least |w| cos(angle + t), the angle being at most pi/2.
    """
    for i in range(2):
        for j in range(2):
            x, y, z = first[i, 0] - second[j, 0], first[i, 1] - second[j, 1], first[i, 2] - second[j, 2]
            squared = x * x + y * y + z * z
            for axis in range(3):
                if squared <= room[axis] ** 2:
                    continue
                along = abs(x * axes[axis, 0] + y * axes[axis, 1] + z * axes[axis, 2])
                if along <= room[axis]:
                    continue
                across = math.sqrt(max(squared - along * along, 0.0))
                if along * math.cos(turns[axis]) - across * math.sin(turns[axis]) > room[axis] + _EPS:
                    return True
    return False


@nb.njit(cache=True)
def _too_wide(first, second, first_wide, second_wide):
    """Tell whether an end of one entity is always farther than an angle from an end of the other."""
    for i in range(2):
        for j in range(2):
            if first_wide[i, 0] + second_wide[j, 0] >= math.pi:
                continue
            limit = first_wide[i, 1] * second_wide[j, 1] - first_wide[i, 2] * second_wide[j, 2]
            cosine = first[i, 0] * second[j, 0] + first[i, 1] * second[j, 1] + first[i, 2] * second[j, 2]
            if cosine < limit - 1e-12:
                return True
    return False
