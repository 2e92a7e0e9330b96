"""What the compiled loops know of a request: the camera's frustum, the entities, and the cells of their regions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class View(NamedTuple):
    """What the camera takes in: nearest, farthest and middle sharp depth, mm; tangents of the half angles of view.

    ``radius`` is the distance of the farthest point of that frustum from the point looked at, mm; ``length_ratio`` the
    length that images must have at least, over the image distance.
    """

    near: float
    far: float
    middle: float
    tan_x: float
    tan_y: float
    radius: float
    length_ratio: float


class Task(NamedTuple):
    """What a search is for: a pose whose entities weigh more than a limit.

    ``conflict`` (e, e) tells which entities exclude each other anyhow, ``y`` (e,) are the weights. It looks at
    ``max_nodes`` boxes at most, and ends when another thread sets ``stop`` (1,).
    """

    conflict: np.ndarray
    y: np.ndarray
    limit: float
    max_nodes: int
    stop: np.ndarray


class Entities(NamedTuple):
    """Ends (e, 2, 3) and lengths (e,) of the entities, mm, and the cells of their regions, as in `cells.Cells`.

    The normals of the cells' planes have length 1. An entity must be visible from the nodal point and all around it, in
    the ``directions`` (d, 3) at the distance ``around``, mm.
    """

    ends: np.ndarray
    lengths: np.ndarray
    planes: np.ndarray
    plane_start: np.ndarray
    boxes: np.ndarray
    entity_start: np.ndarray
    around: float
    directions: np.ndarray
