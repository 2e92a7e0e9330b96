"""The space of all camera poses, in boxes about the point looked at, searched part by part for poses worth too much.

Boxes: `planner.bound.windows`. The search of one part: `planner.bound.boxes`. What it is for:
`planner.bound.lower_bound`.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors import SegmentQuantization
from planner.bound.boxes import FOUND, NEARLY, SPENT, Viewpoints, search, viewpoints_for
from planner.bound.view import (
    HALF,
    LOOK,
    SPAN,
    TURN,
    Cells,
    Entities,
    Frustum,
    SearchTask,
    Segments,
    View,
)
from planner.camera.camera import Camera
from planner.executors import THREADS
from planner.request.problem import Problem
from planner.request.reach import AROUND

# number of parts, each searched on its own, several at a time. With enough parts, proofs of one
# part outlast changes of the weights for others.
_PARTS = 256
# seconds between two checks for cancellation during a search
_TICK_S = 0.5
# entities of a pose found then count this share of the limit in its part, so that the next pose
# inspects others
_LESS = 0.999

# How long the image of an item must be at least, whatever the pose and however small its
# uncertainty.
#
# The measured length of an edge is wrong by x = q + e: q the quantization error of both ends, e
# what the displaced pose causes, independent of it. It is measured accurately if x is in [L ln A,
# L ln(2 - A)] (`errors.model`), an interval of width 2h. The density of q is symmetric and falls
# from the middle, so no interval of that width is more probable than [-h, h], and by averaging
# over e (Anderson 1955)
#
# P <= P(|q| <= h),    h = L (ln(2 - A) - ln A) / 2.
#
# With the image in the direction t, q is r_x cos t T_1 + r_y sin t T_2, the T triangular on [-1,
# 1]. So P >= p needs L >= min over t of the p-quantile of |q|, divided by (ln(2 - A) - ln A) / 2.


_STEP = math.pi / 1800
_DIRECTIONS = np.arange(901) * _STEP
_BISECTIONS = 60
# more than is needed: the steps in direction and the error of the probability are allowed for one by one
_SAFETY = 0.99
# of the probability that a request computes, 5e-5, and of the law here
_PROBABILITY_ERROR = 6e-5


def least_images_mm(problem: Problem) -> NDArray[np.float64]:
    """Return the lengths on the sensor below which no image of an item's segment can satisfy a request.

    Parameters
    ----------
    problem : Problem
        The request, of k items.

    Returns
    -------
    array (k,)
        Lengths, mm; 0 asks for none.
    """
    quantile = _SAFETY * quantization_quantile(
        problem.camera.finest_pitch_mm, problem.probability - _PROBABILITY_ERROR
    )
    shortest = problem.constraints.min_length_mm
    return np.array(
        [target.least_image_mm(problem.accuracy, quantile, shortest) for target in problem.targets]
    )


def quantization_quantile(pixel_pitch_mm: tuple[float, float], probability: float) -> float:
    """Return h, mm, such that in no direction a length's quantization error is within less than h so probably.

    The exact law gives the least h of directions a step apart. From any direction up to 45 degrees to the next lower
    one, or from any other to the next higher one, r_x cos t and r_y sin t grow by a factor of 1 + step at most. So does
    |q| (Anderson 1955), and h between the directions is smaller by no more than that.
    """
    law = SegmentQuantization(_DIRECTIONS, pixel_pitch_mm)
    low = np.zeros(len(_DIRECTIONS))
    high = np.full(len(_DIRECTIONS), float(np.sum(pixel_pitch_mm)))
    for _ in range(_BISECTIONS):
        h = (low + high) / 2
        enough = 2.0 * law.cdf(h) - 1.0 >= probability
        low = np.where(enough, low, h)
        high = np.where(enough, h, high)
    return float(low.min()) / (1.0 + _STEP)


# A request as the bound's loops take it: what the camera takes in, and two points of each item to
# be in view.


def sensor_tangents(camera: Camera, margin_px: float) -> NDArray[np.float64]:
    """Return the tangents (2,) of the half angles of view, less a margin at the sides of the sensor.

    Off centre or with distortion the view is as wide to the one side as it is to the other, wider one: more than the
    camera takes in, so what is proven of it holds.
    """
    if not camera.is_centred:
        x_low, y_low, x_high, y_high = camera.field(margin_px).outer
        return np.maximum([max(-x_low, x_high), max(-y_low, y_high)], 0.0)
    half = np.array(camera.sensor_size_mm) / 2 - margin_px * np.array(camera.pixel_pitch_mm)
    return np.maximum(half, 0.0) / camera.image_distance_mm


def frustum_of(problem: Problem) -> Frustum:
    """Return what the camera of a request takes in; the depth of field may have no end.

    The margin of focus that every setting keeps is taken from it, and not the reserve of ends off the axis.
    """
    near, far = problem.camera.depth_of_field_mm
    near = near + problem.requirements.focus_margin_mm
    far = far - problem.requirements.focus_margin_mm
    tan_x, tan_y = sensor_tangents(problem.camera, problem.requirements.border_px).tolist()
    return Frustum(float(near), float(far), tan_x, tan_y, math.atan(math.hypot(tan_x, tan_y)))


def view_of(problem: Problem) -> View:
    """Return what the camera of a request takes in, no deeper than the workspace is wide."""
    low, high = (np.asarray(corner, dtype=float) for corner in problem.space.workspace)
    near, far, tan_x, tan_y, _ = frustum_of(problem)
    # nothing is farther from a viewpoint in the workspace, which holds the part, than its corners are from each other
    far = min(far, max(float(np.linalg.norm(high - low)), 1.01 * near))
    middle = (near + far) / 2
    corners = np.array(
        [
            [x * tan_x * z, y * tan_y * z, z - middle]
            for x in (-1, 1)
            for y in (-1, 1)
            for z in (near, far)
        ]
    )
    return View(near, far, middle, tan_x, tan_y, float(np.linalg.norm(corners, axis=1).max()))


def segments_of(problem: Problem, entity_idx: NDArray[np.int_]) -> Segments:
    """Return the segments of some items of a request, in their order."""
    ends = np.ascontiguousarray(problem.ends[entity_idx])
    ratio = least_images_mm(problem)[entity_idx] / problem.camera.image_distance_mm
    return Segments(ends, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), ratio)


# From witnesses to targets in the proof: a target may be inspected where any of its witnesses may
# be.
#
# The boxes of poses know witnesses only, each with its own region and its own points. A pose that
# inspects targets inspects one witness of each. So nothing is lost if of the witnesses of one
# target only one is counted at a pose: here they *exclude each other*, like entities of which no
# pose inspects two. The weight of a set of witnesses that is counted so is at least that of the
# targets, and a necessary condition is used for a target only if every witness implies it.


class WitnessSets:
    """Which target (k) each witness (w) belongs to.

    Parameters
    ----------
    owner : array of int (w,)
        The target of each witness, ascending; every target has one at least.
    """

    def __init__(self, owner: NDArray[np.int_]):
        self.owner = np.asarray(owner)
        self._first = np.flatnonzero(np.diff(self.owner, prepend=-1))
        self.trivial = len(self._first) == len(self.owner)

    @classmethod
    def of(cls, problem: Problem) -> WitnessSets:
        """Return the witnesses of a request."""
        return cls(problem.owner)

    def of_columns(self, columns: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return columns (c, w) of witnesses for columns (c, k) of targets: all witnesses of what they hold."""
        return np.asarray(columns)[:, self.owner]

    def to_targets(self, sets: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return of which targets sets (n, w) hold a witness; (n, k)."""
        if self.trivial or not len(sets):
            return sets[:, self._first]
        return np.asarray(np.logical_or.reduceat(sets, self._first, axis=1))

    def one_each(self, conflict: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return pairs of witnesses (w, w) that exclude each other, with those of one target."""
        same = self.owner[:, None] == self.owner
        np.fill_diagonal(same, False)
        return np.asarray(conflict | same)

    def targets_apart(self, conflict: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which targets (k, k) exclude each other: by every pair of their witnesses."""
        if self.trivial:
            return conflict
        rows = np.logical_and.reduceat(conflict, self._first, axis=0)
        apart = np.array(np.logical_and.reduceat(rows, self._first, axis=1))
        np.fill_diagonal(apart, False)
        return apart


class SearchedPart(NamedTuple):
    """What comes out of a part of the space of poses.

    Attributes
    ----------
    outcome : int
        See `planner.bound.boxes.search`; FOUND if there is any pose, or any box too small to tell.
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
    problem : Problem
        The request.
    entity_idx : array of int (e,)
        Entities, as columns of the request.
    regions : Cells
        The cells of each entity's region.
    conflict : array of bool (e, e)
        Pairs that exclude each other.
    witnesses : WitnessSets, optional
        Of which targets the entities are; weights and results are of targets then. Default: each is one.
    """

    def __init__(
        self,
        problem: Problem,
        entity_idx: NDArray[np.int_],
        regions: Cells,
        conflict: NDArray[np.bool_],
        witnesses: WitnessSets | None = None,
    ):
        self.witnesses = witnesses or WitnessSets(np.arange(len(entity_idx)))
        self.view = view_of(problem)
        self.conflict = np.ascontiguousarray(conflict)
        segments = segments_of(problem, entity_idx)
        self.entities = entities_of(segments, regions, problem.requirements.visibility_radius_mm)
        points = self.entities.ends.reshape(-1, 3)
        self.nodal_points = np.array(
            [regions.boxes[:, 0].min(axis=0), regions.boxes[:, 1].max(axis=0)]
        )
        # the last tree of viewpoints, and the weights and the limit that it was grown for
        self._grown: tuple[Viewpoints, NDArray[np.float64], float] | None = None
        low = points.min(axis=0) - self.view.radius
        high = points.max(axis=0) + self.view.radius
        root = np.array([(low + high) / 2, (high - low) / 2, np.zeros(3), np.ones(3)])
        parts = _cut(root, _PARTS // 2)
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
    ) -> Generator[SearchedPart, None, None]:
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
        SearchedPart
            What comes out of each part, in their order.
        """
        stop = np.zeros(1, dtype=bool)
        y = y[self.witnesses.owner]
        tree = self._viewpoints(y, limit)

        def look(k: int, max_nodes: int) -> SearchedPart:
            return self._search_part(k, tree, y, limit, max_nodes, most, stop)

        # compiled before the threads need it
        look(0, 0)

        waiting: deque[Future[SearchedPart]] = deque()
        with ThreadPoolExecutor(THREADS) as pool:
            try:
                indices = np.arange(len(self.parts)) if parts is None else np.asarray(parts)
                todo = zip(
                    indices.tolist(), np.broadcast_to(max_nodes, len(indices)).tolist(), strict=True
                )
                waiting.extend(
                    pool.submit(look, *piece) for piece in itertools.islice(todo, 2 * THREADS)
                )
                while waiting:
                    while tick is not None and not wait([waiting[0]], _TICK_S).done:
                        tick()
                    yield waiting.popleft().result()
                    waiting.extend(pool.submit(look, *piece) for piece in itertools.islice(todo, 1))
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
        tree = viewpoints_for(self.nodal_points, self.entities, self.view, y, limit, finest)
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
    ) -> SearchedPart:
        chart, part = self.parts[k]
        y = y.copy()
        made = 0
        poses: list[NDArray[np.float64]] = []
        sets: list[NDArray[np.bool_]] = []
        while True:
            pose = np.eye(4)
            inspected = np.zeros(len(y), dtype=bool)
            order = np.argsort(-y, kind="stable")[: int((y > 0).sum())]
            task = SearchTask(self.conflict, y, limit, max_nodes - made, stop)
            outcome, n = search(
                part, chart, order, self.entities, self.view, tree, task, pose, inspected
            )
            made += n
            # the weights had better keep away from where it is too close to tell, too
            if outcome in (FOUND, NEARLY):
                poses.append(pose)
                sets.append(inspected)
                y[inspected] *= _LESS * limit / y[inspected].sum()
            if outcome not in (FOUND, NEARLY) or len(poses) == most or made >= max_nodes:
                break
        to_targets = self.witnesses.to_targets
        posed = np.array(poses).reshape(-1, 4, 4)
        inspected_sets = to_targets(np.array(sets, dtype=bool).reshape(-1, len(y)))
        doubt = to_targets((inspected & (outcome == SPENT))[None])[0]
        return SearchedPart(FOUND if poses else outcome, made, posed, inspected_sets, doubt)


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
