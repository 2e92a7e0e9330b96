"""The linear part of the lower bound: weights that no single pose exceeds.

The entities get weights y >= 0. If no pose inspects more than W of them, sum(y) / W settings are needed at least
(linear programming duality). Poses are subdivided into boxes about the point looked at (`planner.posebox`), heaviest
first, until none may weigh more than the next number of settings allows. The weights are the mean of several optimal
duals of the cover by the columns that are known: a single one rests on few entities, so that a box either holds one
more of them or does not, where with the mean every bit that it is smaller tells.
"""

from __future__ import annotations

import numpy as np

from planner.columns import Judge
from planner.conflicts import Cells, sensor_tangents
from planner.cover import fractional_cover, maximal_columns
from planner.necessary import least_image_mm
from planner.posebox import Boxes, Entities, View, evaluate, heaviest
from planner.progress import report

_DUALS = 8
# duals are looked for that maximise the weights times factors from 1 to this
_BIAS = 1.5
_LEAST_WEIGHT = 1e-3
_BATCH = 2000
# boxes smaller than this, in v and as a share of the middle depth, are not split further
_FINEST = 1e-4
_SLACK = 1e-6


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
    rng = np.random.default_rng(0)
    columns = columns[maximal_columns(columns)]
    biases = 1.0 + (_BIAS - 1.0) * rng.random((_DUALS, columns.shape[1]))
    y = np.mean([fractional_cover(columns, bias)[1] for bias in biases], axis=0)
    y[y < _LEAST_WEIGHT] = 0.0
    return y / (columns @ y).max()


class LookTree:
    """Boxes of poses that together hold all poses, without those that cannot weigh too much for any target."""

    def __init__(self, judge: Judge, entity_idx: np.ndarray, regions: Cells, conflict: np.ndarray, y: np.ndarray):
        # in descending order of weights, as the compiled loops want them; the others do not count
        order = np.argsort(-y, kind="stable")[: int((y > 0).sum())]
        self.y, self.total, self.view = y[order], float(y.sum()), view_of(judge)
        self.conflict = np.ascontiguousarray(conflict[np.ix_(order, order)])
        self.entities = _entities(judge.ends[entity_idx][order], regions, order)
        points = self.entities.ends.reshape(-1, 3)
        low, high = points.min(axis=0) - self.view.radius, points.max(axis=0) + self.view.radius
        self.boxes = Boxes(
            np.tile((low + high) / 2, (2, 1)),
            np.tile((high - low) / 2, (2, 1)),
            np.arange(2),
            np.zeros((2, 3)),
            np.ones((2, 3)),
        )
        self.possible = np.ones((2, len(order)), dtype=bool)
        self.scores = np.zeros((2, 6))
        # infinite where not known yet
        self.weight, self._limit = np.full(2, np.inf), np.inf
        self.made = 2
        evaluate(self.boxes, self.entities, self.view, self.possible, self.scores)

    def heavy(self, limit: float) -> np.ndarray:
        """Return the boxes that may weigh more than a limit, the heaviest first."""
        if limit != self._limit:
            # so far only known not to weigh more than the limit before
            self.weight[self.weight > limit] = np.inf
            self._limit = limit
        todo = np.flatnonzero(np.isinf(self.weight))
        found = np.empty(len(todo))
        rows = Boxes(*(field[todo] for field in self.boxes))
        heaviest(rows, self.entities, self.view, self.conflict, self.possible[todo], self.y, limit, found)
        self.weight[todo] = found
        above = np.flatnonzero(self.weight > limit)
        return above[np.argsort(-self.weight[above], kind="stable")]

    def is_finest(self, nodes: np.ndarray) -> np.ndarray:
        """Tell which boxes are too small to be split."""
        small = self.boxes.half[nodes].max(axis=1) < _FINEST * self.view.middle
        return small & (self.boxes.span[nodes].max(axis=1) < _FINEST)

    def split(self, nodes: np.ndarray, light: float) -> None:
        """Halve boxes along the coordinate that does most; forget boxes known to weigh no more than ``light``."""
        keep = self.weight > light
        keep[nodes] = False
        rows = np.concatenate([nodes, nodes])
        new = Boxes(*(field[rows] for field in self.boxes))
        side = np.repeat([-1.0, 1.0], len(nodes))
        axis = self.scores[rows].argmax(axis=1)
        for middle, size, place in ((new.look, new.half, axis), (new.turn, new.span, axis - 3)):
            own = np.flatnonzero((place >= 0) & (place < 3))
            size[own, place[own]] /= 2
            middle[own, place[own]] += side[own] * size[own, place[own]]
        possible, scores = self.possible[rows], np.zeros((len(rows), 6))
        evaluate(new, self.entities, self.view, possible, scores)
        self.boxes = Boxes(*(np.concatenate([old[keep], field]) for old, field in zip(self.boxes, new, strict=True)))
        self.possible = np.concatenate([self.possible[keep], possible])
        self.scores = np.concatenate([self.scores[keep], scores])
        self.weight = np.concatenate([self.weight[keep], np.full(len(rows), np.inf)])
        self.made += len(rows)


def _entities(ends: np.ndarray, regions: Cells, order: np.ndarray) -> Entities:
    """Return some of the entities, in this order, with the cells of their regions."""
    cells = [np.arange(regions.entity_start[e], regions.entity_start[e + 1]) for e in order]
    flat = np.concatenate([np.zeros(0, int), *cells])
    planes = [np.arange(regions.plane_start[c], regions.plane_start[c + 1]) for c in flat]
    return Entities(
        np.ascontiguousarray(ends),
        np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1),
        regions.planes[np.concatenate([np.zeros(0, int), *planes])],
        np.cumsum([0, *map(len, planes)]),
        regions.boxes[flat],
        np.cumsum([0, *map(len, cells)]),
    )


def raise_bound(
    judge, entity_idx, regions, conflict, columns, bound: int, n_settings: int, *, max_nodes: int, progress
):
    """Raise a lower bound as far as so many boxes of poses allow.

    Parameters
    ----------
    judge, entity_idx, columns, n_settings, max_nodes, progress
        As in `planner.bound.lower_bound`.
    regions : Cells
        The cells of each entity's region.
    conflict : array of bool (e, e)
        Pairs that exclude each other.
    bound : int
        What is proven already.

    Returns
    -------
    bound : int
        No plan for these entities has fewer settings.
    made : int
        Boxes of poses looked at.
    """
    y = spread_weights(np.asarray(columns, dtype=bool))
    tree = LookTree(judge, np.asarray(entity_idx), regions, conflict, y)
    lightest = tree.total / (n_settings - 1) - _SLACK
    while bound < n_settings and tree.made < max_nodes:
        heavy = tree.heavy(tree.total / bound - _SLACK)
        if not heavy.size:
            bound += 1
            continue
        heavy = heavy[: min(max(_BATCH, len(heavy) // 4), max(1, (max_nodes - tree.made) // 2))]
        if tree.is_finest(heavy).any():
            break
        tree.split(heavy, lightest)
        report(progress, min(tree.made, max_nodes), max_nodes, "lower bound")
    return bound, tree.made
