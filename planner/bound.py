"""A proven lower bound on the number of sensor settings, by subdividing the space of poses.

Notation
--------
node       a box of positions (centre c, half sizes h) times a patch of viewing directions times an interval of rolls
S(node)    its optimistic set: every entity that *may* be inspected by *some* pose of the node; where S contains two
           entities that exclude each other (`planner.conflicts`), the node is split into two with the same poses, one
           without the first entity, one without all that it excludes
y          weights of the entities, y >= 0

Every pose lies in some leaf of the subdivision, so what it inspects is part of that leaf's S. If no leaf's S weighs
more than W, no setting inspects more than W, and at least sum(y) / W settings are needed (linear programming
duality). Leaves that weigh too much are split, which tightens S; the weights are solved anew for the leaves there
are. Where the linear bound falls short of the next whole number, the integer cover over the leaves' sets closes the
gap; only leaves of weight at least 1 - (K - sum(y)) can be in a cover of K columns (reduced-cost fixing).

S(node) uses necessary conditions only: visibility (the box meets a cell of the entity's region), distance and depth
(focus), the rectangle of the sensor, the resolution. All slack that a node's size causes is added. So the bound holds
whatever the error model says, and for any search.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from planner.conflicts import Cells, find_conflicts, sensor_tangents
from planner.cover import distinct_rows, maximal_columns, min_cover
from planner.progress import report

_BATCH = 6000
_MAX_INTEGER_COLUMNS = 4000
# nodes smaller than this angle (seen from the camera, rad) are not split further
_FINEST_RAD = 2e-3
_EPS = 1e-9


def lower_bound(judge, entity_idx, n_settings: int, columns, *, max_nodes: int, progress=None) -> tuple[int, str]:
    """Prove how many settings are needed at least.

    Parameters
    ----------
    judge : Judge
        The request: visibility, camera and constraints.
    entity_idx : array of int (e,)
        The entities to be covered, as columns of the judge.
    n_settings : int
        Size of the cover that is known; the proof stops when it gets there.
    columns : array of bool (c, e)
        Columns known to be realisable; they start the weights.
    max_nodes : int
        Nodes of the subdivision at most.
    progress : callable, optional

    Returns
    -------
    bound : int
        No plan for these entities has fewer settings.
    proof : str
        What it rests on, in one sentence.
    """
    if n_settings <= 1:
        return n_settings, "Fewer settings than one inspect nothing."
    entity_idx = np.asarray(entity_idx)
    regions = Cells([judge.space.covering_cells([judge.names[i]]) for i in entity_idx])
    conflict = find_conflicts(judge, entity_idx, columns, regions)
    tree = _Tree(judge, entity_idx, regions, conflict)
    weights = _Weights(np.asarray(columns, dtype=bool))
    target = 2
    while target <= n_settings and tree.made < max_nodes:
        y = weights.solve(tree.sets)
        heavy = _to_split(tree, y, target)
        if heavy is None:
            target += 1
            continue
        if not heavy.size:
            break
        tree.split(heavy)
        report(progress, min(tree.made, max_nodes), max_nodes, "lower bound")
    report(progress, max_nodes, max_nodes, "lower bound")
    return target - 1, (
        f"Covering by optimistic columns: {tree.made} boxes of camera poses were checked against necessary conditions "
        f"(visibility, focus, sensor size, resolution), and {int(conflict.sum()) // 2} pairs of edges were found to "
        "exclude each other."
    )


def _to_split(tree: _Tree, y: np.ndarray, target: int) -> np.ndarray | None:
    """Choose the nodes to split to prove ``target``; none if nothing is left to split, None if it is proven."""
    weight = tree.sets @ y
    splittable = tree.size > _FINEST_RAD
    # what a cover with fewer settings may waste
    spare = target - 1 - float(y.sum())
    if spare < -1e-6:
        return None
    usable = np.flatnonzero(weight >= 1.0 - spare - 1e-6)
    first, of_distinct = distinct_rows(tree.sets[usable])
    distinct = tree.sets[usable[first]]
    heaviest = np.argsort(-(distinct @ y), kind="stable")[: 4 * _MAX_INTEGER_COLUMNS]
    kept = heaviest[maximal_columns(distinct[heaviest])][:_MAX_INTEGER_COLUMNS]
    exhaustive = len(distinct) <= 4 * _MAX_INTEGER_COLUMNS and len(kept) < _MAX_INTEGER_COLUMNS
    if not distinct[kept].any(axis=0).all():
        return None if exhaustive else _heaviest(usable[splittable[usable]], weight)
    cover = min_cover(distinct[kept], time_limit_s=20.0)
    if exhaustive and cover.lower_bound >= target:
        return None
    if len(cover.chosen) >= target:
        return _heaviest(usable[splittable[usable]], weight)
    nodes = usable[np.isin(of_distinct, kept[list(cover.chosen)])]
    return nodes[splittable[nodes]][:_BATCH]


def _heaviest(nodes: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return nodes[np.argsort(-weight[nodes], kind="stable")[:_BATCH]]


class _Weights:
    """The dual of the fractional cover over all leaves, by constraint generation."""

    def __init__(self, columns: np.ndarray):
        self.rows = columns[distinct_rows(columns)[0]]

    def solve(self, sets: np.ndarray) -> np.ndarray:
        """Return the weights y (e,) of largest sum such that no leaf and no known column weighs more than 1."""
        for _ in range(60):
            y = self._solve()
            weight = sets @ y
            violated = np.flatnonzero(weight > 1.0 + 1e-7)
            if not violated.size:
                break
            worst = violated[np.argsort(-weight[violated], kind="stable")[:2000]]
            new = sets[worst[distinct_rows(sets[worst])[0]]]
            new = new[np.argsort(-(new @ y), kind="stable")[:150]]
            rows = np.concatenate([self.rows, new])
            self.rows = rows[distinct_rows(rows)[0]]
        self._forget(y)
        return y / max(1.0, float((sets @ y).max(initial=0.0)))

    def _solve(self) -> np.ndarray:
        result = linprog(
            -np.ones(self.rows.shape[1]),
            A_ub=csr_matrix(self.rows.astype(float)),
            b_ub=np.ones(len(self.rows)),
            bounds=(0.0, 1.0),
        )
        return np.clip(result.x, 0.0, None)

    def _forget(self, y: np.ndarray) -> None:
        """Drop constraints that are far from tight; leaves that were split since no longer cause them."""
        self.rows = self.rows[self.rows @ y > 0.5]


class _Tree:
    """The leaves of the subdivision and their optimistic sets."""

    def __init__(self, judge, entity_idx: np.ndarray, regions: Cells, conflict: np.ndarray):
        self.conflict = conflict
        self.cells = regions.planes, regions.plane_start, regions.entity_start
        camera, need = judge.camera, judge.requirements
        self.ends = judge.ends[entity_idx]
        self.image_distance = camera.image_distance_mm
        self.min_length = judge.constraints.min_length_mm
        self.near, self.far = camera.depth_of_field_mm
        self.tangents = sensor_tangents(camera, need.field_margin_px)
        self.cone = math.atan(math.hypot(*self.tangents))
        self.reach = self.far / math.cos(self.cone)
        self.lengths = np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)
        self.directions = (self.ends[:, 1] - self.ends[:, 0]) / self.lengths[:, None]
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

    def split(self, nodes: np.ndarray) -> None:
        """Replace nodes by their two halves along the coordinate that causes most slack; forget empty ones."""
        keep = np.ones(len(self.face), dtype=bool)
        keep[nodes] = False
        first, second = ({name: value[nodes].copy() for name, value in self._fields()} for _ in range(2))
        radius = np.linalg.norm(self.half[nodes], axis=1)
        clash = _separate(
            self.center[nodes], radius, self.ends, 2 * self.cone, self.conflict, first["sets"], second["sets"]
        )
        self._halve(first, second, np.where(clash, -1, self._extents[nodes].argmax(axis=1)))
        n_old = int(keep.sum())
        for name, value in self._fields():
            setattr(self, name, np.concatenate([value[keep], first[name], second[name]]))
        self._extents = np.concatenate([self._extents[keep], np.zeros((2 * len(nodes), 3))])
        self.made += 2 * len(nodes)
        self._evaluate(np.arange(n_old, len(self.face)))
        self._drop_empty()

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
            possible = self.sets[part] & self._conditions(
                self.center[part], radius, axis, spread, frame, self.roll[part, 1]
            )
            _meets(self.center[part], self.half[part], *self.cells, possible)
            self.sets[part] = possible
            typical = 0.5 * (self.near + min(self.far, 4 * self.near))
            turned = self.roll[part, 1] * math.sin(self.cone)
            self._extents[part] = np.column_stack([radius / typical, 1.4 * spread, turned])

    def _conditions(self, center, radius, axis, spread, frame, roll_half) -> np.ndarray:
        """Return which entities may satisfy focus, sensor and resolution from some pose of each node; (n, e) bool."""
        rays = self.ends[None] - center[:, None, None]
        distance = np.linalg.norm(rays, axis=-1)
        radius, spread = radius[:, None, None], spread[:, None, None]
        possible = (distance - radius <= self.reach) & (distance + radius >= self.near)
        swing = np.where(distance > radius, np.arcsin(np.minimum(radius / np.maximum(distance, _EPS), 1.0)), math.pi)
        angle = np.arccos(np.clip(np.einsum("neij,nj->nei", rays, axis) / np.maximum(distance, _EPS), -1.0, 1.0))
        possible &= angle <= self.cone + swing + spread + _EPS
        nearest = distance * np.cos(np.minimum(angle + spread, math.pi)) - radius
        farthest = distance * np.cos(np.maximum(angle - spread, 0.0)) + radius
        possible &= (farthest >= self.near - _EPS) & (nearest <= self.far + _EPS)
        slack = swing + math.sqrt(2.0) * spread + (roll_half * math.sin(self.cone))[:, None, None]
        local = np.einsum("neij,njk->neik", rays, frame) / np.maximum(distance, _EPS)[..., None]
        possible &= self._in_rectangle(local, slack)
        return possible.all(axis=-1) & self._resolved(center, radius[..., 0], nearest)

    def _in_rectangle(self, local: np.ndarray, slack: np.ndarray) -> np.ndarray:
        """Tell which unit rays (..., 3) in the camera frame may be turned by ``slack`` into the sensor's pyramid."""
        inside = np.ones(slack.shape, dtype=bool)
        for i, tangent in enumerate(self.tangents):
            norm = math.hypot(1.0, tangent)
            for sign in (1.0, -1.0):
                height = (tangent * local[..., 2] - sign * local[..., i]) / norm
                inside &= np.arcsin(np.clip(height, -1.0, 1.0)) >= -slack - _EPS
        return inside

    def _resolved(self, center, radius, nearest) -> np.ndarray:
        """Bound the image's length: eq 16 with ||w x v|| <= ||w|| is d L_w dist(r_v, line) / (z_1 z_2)."""
        offset = center[:, None] - self.ends[None, :, 0]
        off_line = np.linalg.norm(np.cross(offset, self.directions[None]), axis=-1) + radius
        depth = np.maximum(nearest, self.near).prod(axis=-1)
        return self.image_distance * self.lengths * off_line >= self.min_length * depth * (1 - _EPS)


def _patch_frames(face: np.ndarray, patch: np.ndarray, roll: np.ndarray):
    """Return the middle axis (n, 3) of patches, the angle (n,) to their farthest point, and the frame (n, 3, 3).

    Directions on a face of the cube are (u, v, ±1) in its own order of axes. The frame's x axis is the projection of
    the face's u axis, turned by the roll. Between two directions of a patch the frame turns by at most sqrt(2) times
    the angle between them: its twist is |u.a| / sqrt(1 - (u.a)^2) <= 1 per radian.
    """
    u, v = (patch[:, 0] + patch[:, 1]) / 2, (patch[:, 2] + patch[:, 3]) / 2
    axis = _directions(face, u, v)
    corners = [_directions(face, patch[:, i], patch[:, j]) for i in (0, 1) for j in (2, 3)]
    cosine = np.min([np.einsum("ni,ni->n", axis, corner) for corner in corners], axis=0)
    along = np.zeros_like(axis)
    along[np.arange(len(face)), (face // 2 + 1) % 3] = 1.0
    x = along - np.einsum("ni,ni->n", along, axis)[:, None] * axis
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axis, x)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return axis, np.arccos(np.clip(cosine, -1.0, 1.0)), np.stack([c * x + s * y, c * y - s * x, axis], axis=-1)


def _directions(face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    rows = np.arange(len(face))
    direction = np.zeros((len(face), 3))
    direction[rows, face // 2] = np.where(face % 2 == 0, 1.0, -1.0)
    direction[rows, (face // 2 + 1) % 3] = u
    direction[rows, (face // 2 + 2) % 3] = v
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


@njit(cache=True)
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


@njit(cache=True)
def _separate(center, radius, ends, angle, conflict, first, second):
    """Split sets instead of poses: a pose inspects the most contested entity of a set, or none that it excludes.

    Entities exclude each other for good, or from this box of positions: two of their ends are farther apart in angle
    than the corners of the sensor. Changes the sets of both halves; returns where it did.
    """
    n, n_entities = first.shape
    changed = np.zeros(n, dtype=np.bool_)
    rays = np.empty((n_entities, 2, 3))
    swing = np.empty((n_entities, 2))
    for k in range(n):
        for e in range(n_entities):
            for i in range(2):
                ray = ends[e, i] - center[k]
                length = math.sqrt(np.sum(ray**2))
                rays[e, i] = ray / max(length, 1e-9)
                swing[e, i] = math.asin(radius[k] / length) if length > radius[k] else math.pi
        excludes = np.zeros((n_entities, n_entities), dtype=np.bool_)
        for e in range(n_entities):
            for f in range(e + 1, n_entities):
                if first[k, e] and first[k, f]:
                    clash = conflict[e, f] or _too_wide(rays[e], rays[f], swing[e], swing[f], angle)
                    excludes[e, f] = excludes[f, e] = clash
        count = excludes.sum(axis=1)
        worst = np.argmax(count)
        if count[worst] > 0:
            changed[k] = True
            first[k, worst] = False
            for f in range(n_entities):
                if excludes[worst, f]:
                    second[k, f] = False
    return changed


@njit(cache=True)
def _too_wide(first, second, first_swing, second_swing, angle):
    """Tell whether an end of one entity is always farther than an angle from an end of the other."""
    for i in range(2):
        for j in range(2):
            allowed = angle + first_swing[i] + second_swing[j] + 1e-9
            if allowed < math.pi and np.sum(first[i] * second[j]) < math.cos(allowed):
                return True
    return False
