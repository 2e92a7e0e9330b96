"""The linear part of the lower bound: weights that no single pose exceeds.

The entities get weights y >= 0. If no pose inspects more than W of them, sum(y) / W settings are needed at least
(linear programming duality). The space of poses, in boxes about the point looked at (`planner.posebox`), is searched
for a pose that inspects more than the next number of settings allows (`planner.posesearch`). If there is none, that
number is proven. If there is one, what it inspects is added to the columns that the weights come from, and they are
computed anew. They are the mean of several optimal duals of the cover by these columns: a single one rests on few
entities, so that a box either holds one more of them or does not, where with the mean every bit that it is smaller
tells.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import closing

import numpy as np

from planner.columns import Judge
from planner.conflicts import Cells, sensor_tangents
from planner.cover import maximal_columns, mean_dual
from planner.necessary import least_image_mm
from planner.posebox import Entities, View
from planner.posesearch import FOUND, PROVEN, search
from planner.progress import report
from planner.tasks import THREADS

_DUALS = 8
# duals are looked for that maximise the weights times factors from 1 to this
_BIAS = 1.5
_LEAST_WEIGHT = 1e-3
_SLACK = 1e-6
# the space of poses is searched in so many parts, some at a time
_PARTS = 256
_TICK_S = 0.5


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


def spread_weights(columns: np.ndarray) -> np.ndarray:
    """Return weights (e,) of entities, the heaviest of the columns (c, e) weighing 1; small ones are made 0."""
    columns = columns[maximal_columns(columns)]
    y = mean_dual(columns, _BIAS, _DUALS)
    y[y < _LEAST_WEIGHT] = 0.0
    return y / (columns @ y).max()


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
        self.entities = entities_of(judge.ends[entity_idx], regions)
        points = self.entities.ends.reshape(-1, 3)
        low, high = points.min(axis=0) - self.view.radius, points.max(axis=0) + self.view.radius
        root = np.array([(low + high) / 2, (high - low) / 2, np.zeros(3), np.ones(3)])
        self.parts = [(chart, part) for chart in (0, 1) for part in _cut(root, _PARTS // 2)]

    def search(
        self, y: np.ndarray, limit: float, max_nodes: int, tick: Callable[[], None] | None = None
    ) -> Iterator[tuple[int, int, np.ndarray]]:
        """Search part after part for a pose that inspects a weight above a limit.

        Parameters
        ----------
        y : array (e,)
            Weights.
        limit : float
        max_nodes : int
            Boxes looked at in a part, at most.
        tick : callable, optional
            Called about twice a second; an exception it raises ends the search.

        Yields
        ------
        outcome : int
            See `planner.posesearch.search`.
        made : int
            Boxes looked at in this part.
        inspected : array of bool (e,)
            What the pose found inspects.
        """
        order = np.argsort(-y, kind="stable")[: int((y > 0).sum())]
        stop = np.zeros(1, dtype=bool)

        def look(chart, part, most=max_nodes):
            pose, inspected = np.empty((4, 4)), np.zeros(len(y), dtype=bool)
            request = self.entities, self.view, self.conflict, y, limit, most
            return *search(part, chart, order, *request, stop, pose, inspected), inspected

        # compiled before the threads need it
        look(*self.parts[0], most=0)

        waiting: deque[Future] = deque()
        with ThreadPoolExecutor(THREADS) as pool:
            try:
                parts = iter(self.parts)
                waiting.extend(pool.submit(look, *part) for part in itertools.islice(parts, 2 * THREADS))
                while waiting:
                    while tick is not None and not wait([waiting[0]], _TICK_S).done:
                        tick()
                    yield waiting.popleft().result()
                    waiting.extend(pool.submit(look, *part) for part in itertools.islice(parts, 1))
            finally:
                stop[0] = True

    def begin_with(self, part: int) -> None:
        """Search a part first from now on: where one pose was too heavy, others are likely to be."""
        self.parts.insert(0, self.parts.pop(part))


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


def entities_of(ends: np.ndarray, regions: Cells) -> Entities:
    """Return entities (ends: (e, 2, 3), mm) with the cells of their regions, for compiled loops."""
    planes = regions.planes / np.linalg.norm(regions.planes[:, :3], axis=1, keepdims=True)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return Entities(
        np.ascontiguousarray(ends), lengths, planes, regions.plane_start, regions.boxes, regions.entity_start
    )


class LinearBound:
    """A lower bound that is raised by weights, as far as the boxes of poses allowed suffice.

    Parameters
    ----------
    space : PoseSpace
    columns : array of bool (c, e)
        Columns known to be realisable; the weights start from them.
    """

    def __init__(self, space: PoseSpace, columns: np.ndarray):
        self.space, self.columns = space, np.asarray(columns, dtype=bool)
        self.made = 0

    def raise_from(self, bound: int, n_settings: int, *, max_nodes: int, progress=None) -> int:
        """Return what is proven, given what is proven already; at most ``n_settings``.

        Looks at ``max_nodes`` boxes of poses at most in any part of the space of poses, and begins no other part once
        that many were looked at in all.
        """
        y = spread_weights(self.columns)
        while bound < n_settings and self.made < max_nodes:
            limit = float(y.sum()) / bound - _SLACK
            if limit <= 1.0:
                # sum(y) is all that weights can prove
                break
            outcome, part, inspected = self._sweep(y, limit, max_nodes, progress)
            if outcome == PROVEN and part + 1 == len(self.space.parts):
                bound += 1
            elif outcome == FOUND:
                self.space.begin_with(part)
                self.columns = np.concatenate([self.columns, inspected[None]])
                y = spread_weights(self.columns)
            else:
                break
        return bound

    def _sweep(self, y: np.ndarray, limit: float, max_nodes: int, progress) -> tuple[int, int, np.ndarray]:
        """Search part after part until something else than a proof comes out; return the last part's outcome."""
        done = []

        def tick() -> None:
            report(progress, min(self.made, max_nodes), max_nodes, "lower bound")

        with closing(self.space.search(y, limit, max_nodes - self.made, tick)) as results:
            for result in results:
                done.append(result)
                self.made += result[1]
                tick()
                if result[0] != PROVEN or self.made >= max_nodes:
                    break
        return done[-1][0], len(done) - 1, done[-1][2]
