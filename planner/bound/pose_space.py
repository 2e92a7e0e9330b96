"""The space of all camera poses, in boxes about the point looked at, searched part by part for poses worth too much.

Boxes: `planner.bound.boxes.windows`. The search of one part: `planner.bound.boxes.search`. What it is for:
`planner.bound.dual_bound`.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.bound.boxes.cells import Cells
from planner.bound.boxes.search import FOUND, NEARLY, SPENT, search
from planner.bound.boxes.view import HALF, LOOK, SPAN, TURN, Entities, SearchTask, Segments
from planner.bound.boxes.viewpoint_tree import Viewpoints, viewpoints_for
from planner.bound.segments import segments_of, view_of
from planner.bound.witness_sets import WitnessSets
from planner.effort.effort import NORMAL, Effort
from planner.executors import THREADS
from planner.request.positions import AROUND
from planner.request.request import Request


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
    poses: NDArray[np.float64]
    sets: NDArray[np.bool_]
    doubt: NDArray[np.bool_]


class PoseSpace:
    """The space of all poses of a request, to be searched for one that inspects more than it may.

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
    effort : Effort
        How the space is divided, and how closely boxes are looked at.
    witnesses : WitnessSets, optional
        Of which targets the entities are; weights and results are of targets then. Default: each is one.
    """

    def __init__(
        self,
        request: Request,
        entity_idx: NDArray[np.int_],
        regions: Cells,
        conflict: NDArray[np.bool_],
        effort: Effort = NORMAL,
        witnesses: WitnessSets | None = None,
    ):
        self.effort = effort.bound
        self.witnesses = witnesses or WitnessSets(np.arange(len(entity_idx)))
        self.view = view_of(request)
        self.conflict = np.ascontiguousarray(conflict)
        segments = segments_of(request, entity_idx)
        self.entities = entities_of(segments, regions, request.requirements.visibility_radius_mm)
        points = self.entities.ends.reshape(-1, 3)
        self.nodal_points = np.array(
            [regions.boxes[:, 0].min(axis=0), regions.boxes[:, 1].max(axis=0)]
        )
        # the last tree of viewpoints, and the weights and the limit that it was grown for
        self._grown: tuple[Viewpoints, NDArray[np.float64], float] | None = None
        low = points.min(axis=0) - self.view.radius
        high = points.max(axis=0) + self.view.radius
        root = np.array([(low + high) / 2, (high - low) / 2, np.zeros(3), np.ones(3)])
        parts = _cut(root, self.effort.division.parts // 2)
        self.parts = [(chart, part) for chart in (0, 1) for part in parts]

    def search(
        self,
        y: NDArray[np.float64],
        limit: float,
        max_nodes: int | NDArray[np.int_],
        tick: Callable[[], None] | None = None,
        *,
        parts: Sequence[int] | NDArray[np.int_] | None = None,
        most: int = 1,
    ) -> Generator[Found, None, None]:
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
        tick_s = self.effort.division.tick_s
        y = y[self.witnesses.owner]
        tree = self._viewpoints(y, limit)

        def look(k: int, max_nodes: int) -> Found:
            return self._search_part(k, tree, y, limit, max_nodes, most, stop)

        # compiled before the threads need it
        look(0, 0)

        waiting: deque[Future[Found]] = deque()
        with ThreadPoolExecutor(THREADS) as pool:
            try:
                asked = np.arange(len(self.parts)) if parts is None else np.asarray(parts)
                todo = zip(
                    asked.tolist(), np.broadcast_to(max_nodes, len(asked)).tolist(), strict=True
                )
                waiting.extend(
                    pool.submit(look, *one) for one in itertools.islice(todo, 2 * THREADS)
                )
                while waiting:
                    while tick is not None and not wait([waiting[0]], tick_s).done:
                        tick()
                    yield waiting.popleft().result()
                    waiting.extend(pool.submit(look, *one) for one in itertools.islice(todo, 1))
            finally:
                stop[0] = True

    def _viewpoints(self, y: NDArray[np.float64], limit: float) -> Viewpoints:
        """Return what may be inspected from where; the last answer again if it is fine enough for these weights."""
        finest = None
        if self._grown is not None:
            tree, grown_y, grown_limit = self._grown
            if limit >= grown_limit and np.array_equal(y, grown_y):
                return tree
            finest = tree.finest
        return self._grow(y.copy(), limit, finest)

    def _grow(self, y: NDArray[np.float64], limit: float, finest: float | None) -> Viewpoints:
        growth = self.effort.boxes.growth
        tree = viewpoints_for(
            self.nodal_points, self.entities, self.view, y, limit, finest, growth=growth
        )
        self._grown = tree, y, limit
        return tree

    def grown_for(self) -> dict[str, Any] | None:
        """Return what `regrow` needs: the weights, the limit and the finest boxes of the tree of viewpoints, if any."""
        if self._grown is None:
            return None
        tree, y, limit = self._grown
        return {"y": y, "limit": limit, "finest": tree.finest}

    def regrow(self, grown_for: dict[str, Any] | None) -> None:
        """Grow the tree of viewpoints that `grown_for` described; later ones depend on how fine it is."""
        if grown_for is not None:
            self._grow(grown_for["y"], grown_for["limit"], grown_for["finest"])

    def _search_part(
        self,
        k: int,
        tree: Viewpoints,
        y: NDArray[np.float64],
        limit: float,
        max_nodes: int,
        most: int,
        stop: NDArray[np.bool_],
    ) -> Found:
        chart, part = self.parts[k]
        y = y.copy()
        made = 0
        poses: list[NDArray[np.float64]] = []
        sets: list[NDArray[np.bool_]] = []
        while True:
            pose = np.eye(4)
            inspected = np.zeros(len(y), dtype=bool)
            order = np.argsort(-y, kind="stable")[: int((y > 0).sum())]
            task = SearchTask(self.conflict, y, limit, max_nodes - made, stop, self.effort.boxes)
            outcome, n = search(
                part, chart, order, self.entities, self.view, tree, task, pose, inspected
            )
            made += n
            # the weights had better keep away from where it is too close to tell, too
            if outcome in (FOUND, NEARLY):
                poses.append(pose)
                sets.append(inspected)
                y[inspected] *= self.effort.division.less * limit / y[inspected].sum()
            if outcome not in (FOUND, NEARLY) or len(poses) == most or made >= max_nodes:
                break
        to_targets = self.witnesses.to_targets
        posed = np.array(poses).reshape(-1, 4, 4)
        found = to_targets(np.array(sets, dtype=bool).reshape(-1, len(y)))
        doubt = to_targets((inspected & (outcome == SPENT))[None])[0]
        return Found(FOUND if poses else outcome, made, posed, found, doubt)


def _cut(root: NDArray[np.float64], n: int) -> list[NDArray[np.float64]]:
    """Halve a box (4, 3) until there are so many, by turns along all six coordinates."""
    parts = [root]
    k = 0
    while len(parts) < n:
        middle, size, axis = (LOOK, HALF, k % 3) if k % 6 < 3 else (TURN, SPAN, k % 3)
        halves = []
        for part, side in itertools.product(parts, (-1.0, 1.0)):
            half = part.copy()
            half[size, axis] /= 2
            half[middle, axis] += side * half[size, axis]
            halves.append(half)
        parts = halves
        k = k + 1
    return parts


def entities_of(segments: Segments, regions: Cells, around: float) -> Entities:
    """Return entities, visible ``around``, mm, with their regions' cells, for compiled loops."""
    planes = regions.planes / np.linalg.norm(regions.planes[:, :3], axis=1, keepdims=True)
    arrays = planes, regions.plane_start, regions.boxes, regions.entity_start
    return Entities(*segments, *arrays, float(around), AROUND)
