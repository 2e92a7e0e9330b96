"""The space of all camera poses, in boxes about the point looked at, searched part by part for poses worth too much.

Boxes: `planner.bound.boxes.windows`. The search of one part: `planner.bound.boxes.search`. What it is for:
`planner.bound.dual_bound`.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import NamedTuple

import numpy as np

from planner.bound.boxes.cells import Cells
from planner.bound.boxes.search import FOUND, NEARLY, SPENT, search
from planner.bound.boxes.view import Entities, Task, View
from planner.bound.boxes.viewpoint_tree import Viewpoints, viewpoints_for
from planner.bound.excluded_pairs import sensor_tangents
from planner.bound.least_image import least_image_mm
from planner.columns.judge import Judge
from planner.executors import THREADS
from planner.request.constraints import AROUND

# the space of poses is searched in so many parts, some at a time
_PARTS = 256
_TICK_S = 0.5
# what a pose found inspects counts this share of the limit from then on
_LESS = 0.999


def view_of(judge: Judge) -> View:
    """Return what the camera of a request takes in."""
    camera = judge.camera
    low, high = (np.asarray(corner, dtype=float) for corner in judge.space.workspace)
    near, far = camera.depth_of_field_mm
    # nothing is farther from a viewpoint in the workspace, which holds the part, than its corners are from each other
    far = min(far, max(float(np.linalg.norm(high - low)), 1.01 * near))
    tan_x, tan_y = sensor_tangents(camera, judge.requirements.field_margin_px)
    middle = (near + far) / 2
    corners = np.array(
        [[x * tan_x * z, y * tan_y * z, z - middle] for x in (-1, 1) for y in (-1, 1) for z in (near, far)]
    )
    radius = np.linalg.norm(corners, axis=1).max()
    ratio = least_image_mm(judge) / camera.image_distance_mm
    return View(*map(float, (near, far, middle, tan_x, tan_y, radius, ratio)))


class Found(NamedTuple):
    """What comes out of a part of the space of poses.

    Attributes
    ----------
    outcome : int
        See `planner.bound.boxes.search.search`; FOUND if there is any pose, or any box too small to tell.
    made : int
        Boxes looked at.
    poses : array (f, 4, 4)
        Poses that inspect more than the limit, or are from such a box, camera to part.
    sets : array of bool (f, e)
        What they inspect; of such a box all that may be inspected from there.
    doubt : array of bool (e,)
        Where more boxes would be needed, what may be inspected from the one to come.
    """

    outcome: int
    made: int
    poses: np.ndarray
    sets: np.ndarray
    doubt: np.ndarray


class PoseSpace:
    """The space of all poses of a request, to be searched for one that inspects more than it may.

    Parameters
    ----------
    judge : Judge
        The request.
    entity_idx : array of int (e,)
        Entities, as columns of the judge.
    regions : Cells
        The cells of each entity's region.
    conflict : array of bool (e, e)
        Pairs that exclude each other.
    """

    def __init__(self, judge: Judge, entity_idx: np.ndarray, regions: Cells, conflict: np.ndarray):
        self.view, self.conflict = view_of(judge), np.ascontiguousarray(conflict)
        self.entities = entities_of(judge.ends[entity_idx], regions, judge.requirements.visibility_radius_mm)
        points = self.entities.ends.reshape(-1, 3)
        self.nodal_points = np.array([regions.boxes[:, 0].min(axis=0), regions.boxes[:, 1].max(axis=0)])
        self._grown: Viewpoints | None = None
        self._grown_for: tuple[np.ndarray, float] | None = None
        low, high = points.min(axis=0) - self.view.radius, points.max(axis=0) + self.view.radius
        root = np.array([(low + high) / 2, (high - low) / 2, np.zeros(3), np.ones(3)])
        self.parts = [(chart, part) for chart in (0, 1) for part in _cut(root, _PARTS // 2)]

    def search(
        self, y: np.ndarray, limit: float, max_nodes, tick: Callable[[], None] | None = None, *, parts=None, most=1
    ) -> Iterator[Found]:
        """Search part after part for poses that inspect a weight above a limit.

        Parameters
        ----------
        y : array (e,)
            Weights.
        limit : float
        max_nodes : int or array of int
            Boxes looked at in a part, at most; for all parts searched or each of them.
        tick : callable, optional
            Called about twice a second; an exception it raises ends the search.
        parts : sequence of int, optional
            The parts to be searched, as indices of ``parts``. Default: all.
        most : int
            Poses to be found in a part, at most. Once one is found, what it inspects counts less in this part, so that
            the next one inspects something else.

        Yields
        ------
        Found
            What comes out of each part, in their order.
        """
        stop = np.zeros(1, dtype=bool)
        tree = self._viewpoints(y, limit)

        def look(k, max_nodes):
            return self._search_part(k, tree, y, limit, max_nodes, most, stop)

        # compiled before the threads need it
        look(0, 0)

        waiting: deque[Future] = deque()
        with ThreadPoolExecutor(THREADS) as pool:
            try:
                asked = range(len(self.parts)) if parts is None else parts
                todo = zip(asked, np.broadcast_to(max_nodes, len(asked)).tolist(), strict=True)
                waiting.extend(pool.submit(look, *one) for one in itertools.islice(todo, 2 * THREADS))
                while waiting:
                    while tick is not None and not wait([waiting[0]], _TICK_S).done:
                        tick()
                    yield waiting.popleft().result()
                    waiting.extend(pool.submit(look, *one) for one in itertools.islice(todo, 1))
            finally:
                stop[0] = True

    def _viewpoints(self, y: np.ndarray, limit: float) -> Viewpoints:
        """Return what may be inspected from where; the last answer again if it is fine enough for these weights."""
        if self._grown is None or limit < self._grown_for[1] or not np.array_equal(y, self._grown_for[0]):
            finest = None if self._grown is None else self._grown.finest
            self._grown = viewpoints_for(self.nodal_points, self.entities, self.view, y, limit, finest)
            self._grown_for = y.copy(), limit
        return self._grown

    def grown_for(self) -> dict | None:
        """Return what `regrow` needs: the weights, the limit and the finest boxes of the tree of viewpoints, if any."""
        if self._grown is None:
            return None
        return {"y": self._grown_for[0], "limit": self._grown_for[1], "finest": self._grown.finest}

    def regrow(self, grown_for: dict | None) -> None:
        """Grow the tree of viewpoints that `grown_for` described; later ones depend on how fine it is."""
        if grown_for is not None:
            y, limit, finest = (grown_for[name] for name in ("y", "limit", "finest"))
            self._grown = viewpoints_for(self.nodal_points, self.entities, self.view, y, limit, finest)
            self._grown_for = y, limit

    def _search_part(
        self, k: int, tree: Viewpoints, y: np.ndarray, limit: float, max_nodes: int, most: int, stop
    ) -> Found:
        chart, part = self.parts[k]
        y, made = y.copy(), 0
        poses, sets = [], []
        while True:
            pose, inspected = np.eye(4), np.zeros(len(y), dtype=bool)
            order = np.argsort(-y, kind="stable")[: int((y > 0).sum())]
            task = Task(self.conflict, y, limit, max_nodes - made, stop)
            outcome, n = search(part, chart, order, self.entities, self.view, tree, task, pose, inspected)
            made += n
            # the weights had better keep away from where it is too close to tell, too
            if outcome in (FOUND, NEARLY):
                poses.append(pose)
                sets.append(inspected)
                y[inspected] *= _LESS * limit / y[inspected].sum()
            if outcome not in (FOUND, NEARLY) or len(poses) == most or made >= max_nodes:
                break
        sets = np.array(sets, dtype=bool).reshape(-1, len(y))
        doubt = inspected & (outcome == SPENT)
        return Found(FOUND if poses else outcome, made, np.array(poses).reshape(-1, 4, 4), sets, doubt)


def _cut(root: np.ndarray, n: int) -> list[np.ndarray]:
    """Halve a box (4, 3) until there are so many, by turns along all six coordinates."""
    parts, k = [root], 0
    while len(parts) < n:
        middle, size, axis = (0, 1, k % 3) if k % 6 < 3 else (2, 3, k % 3)
        halves = []
        for part, side in itertools.product(parts, (-1.0, 1.0)):
            half = part.copy()
            half[size, axis] /= 2
            half[middle, axis] += side * half[size, axis]
            halves.append(half)
        parts, k = halves, k + 1
    return parts


def entities_of(ends: np.ndarray, regions: Cells, around: float) -> Entities:
    """Return entities (ends: (e, 2, 3), mm), visible ``around``, mm, with their regions' cells, for compiled loops."""
    planes = regions.planes / np.linalg.norm(regions.planes[:, :3], axis=1, keepdims=True)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    arrays = planes, regions.plane_start, regions.boxes, regions.entity_start
    return Entities(np.ascontiguousarray(ends), lengths, *arrays, float(around), AROUND)
