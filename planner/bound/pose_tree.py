"""The space of camera poses cut into boxes, each with the entities that some pose in it may inspect.

The necessary conditions are those of `planner.bound.lower_bound`, which says what they prove.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.bound.boxes.conditions import focus_reach
from planner.bound.boxes.view import Cells
from planner.bound.node_sets import (
    Nodes,
    Pairs,
    Places,
    clear_unmet,
    clear_unsatisfied,
    consistent_weights,
    separate,
)
from planner.bound.pose_space import WitnessSets, frustum_of, segments_of
from planner.request.request import Request

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
    request : Request
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
        request: Request,
        entity_idx: NDArray[np.int_],
        regions: Cells,
        conflict: NDArray[np.bool_],
        one_each: NDArray[np.bool_] | None = None,
    ):
        self.cells = regions.planes, regions.plane_start, regions.entity_start
        self.segments = segments_of(request, entity_idx)
        self.frustum = frustum_of(request)
        near, far, tan_x, tan_y, cone = self.frustum
        self.reach = focus_reach(self.frustum)
        # two points in view: both are on the sensor, and both in focus
        room = np.array([2 * far * tan_x, 2 * far * tan_y, far - near])
        self._pairs = Pairs(self.segments.ends, 2 * cone, room, conflict)
        # sets are not split between the witnesses of a target: both parts would hold it
        counted = conflict if one_each is None else one_each
        self._counted = self._pairs._replace(conflict=counted)
        self.made = 0
        self._plant(request.space.workspace)

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
        kept = self.sets.any(axis=1)
        for name, value in self._fields():
            setattr(self, name, value[kept])
        self._extents = self._extents[kept]

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
