"""What the compiled loops know of a request: the camera's frustum, the entities, and the cells of their regions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.effort.boxes import BoxEffort

# rows of a box of poses (4, 3): the middle point looked at and the half sizes, the middle turn and its spans
LOOK, HALF, TURN, SPAN = range(4)
# the first coordinate along which a box of poses is halved: of the point looked at, of the turn, of the nodal point
OF_LOOK = 0
OF_TURN = 3
OF_NODAL = 6
# sides of the view, in the order of windows and their linear sides
RIGHT, LEFT, BOTTOM, TOP, NEAR, FAR = range(6)


class Frustum(NamedTuple):
    """What the camera takes in: nearest and farthest sharp depth, mm; tangents of the half angles of view.

    ``cone`` is the angle between the axis and a corner, rad. ``far`` may be infinite.
    """

    near: float
    far: float
    tan_x: float
    tan_y: float
    cone: float


class View(NamedTuple):
    """What the camera takes in: nearest, farthest and middle sharp depth, mm; tangents of the half angles of view.

    ``far`` is finite: no more than the workspace is wide. ``radius`` is the distance of the farthest point of that
    frustum from the point looked at, mm.
    """

    near: float
    far: float
    middle: float
    tan_x: float
    tan_y: float
    radius: float


class SearchTask(NamedTuple):
    """What a search is for: a pose whose entities weigh more than a limit.

    ``conflict`` (e, e) tells which entities exclude each other anyhow, ``y`` (e,) are the weights. It looks at
    ``max_nodes`` boxes at most, and ends when another thread sets ``stop`` (1,). ``effort`` says how closely it looks.
    """

    conflict: np.ndarray
    y: np.ndarray
    limit: float
    max_nodes: int
    stop: np.ndarray
    effort: BoxEffort


class Segments(NamedTuple):
    """Two points of each item that must both be in the image and in focus: ends (e, 2, 3) and their distance (e,), mm.

    ``length_ratio`` (e,) is the length that the image of the segment must have at least, over the image distance; 0
    where nothing is known of that. An item may be an edge, whose ends they are, or a dimension.
    """

    ends: np.ndarray
    lengths: np.ndarray
    length_ratio: np.ndarray


class Entities(NamedTuple):
    """The `Segments` of the items, and the cells of their regions as in `cells.Cells`.

    The normals of the cells' planes have length 1. An entity must be visible from the nodal point and all around it, in
    the ``directions`` (d, 3) at the distance ``around``, mm.
    """

    ends: np.ndarray
    lengths: np.ndarray
    length_ratio: np.ndarray
    planes: np.ndarray
    plane_start: np.ndarray
    boxes: np.ndarray
    entity_start: np.ndarray
    around: float
    directions: np.ndarray
