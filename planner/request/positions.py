"""Where the front nodal point may be: which entities are visible from there, and how far part and walls are.

Positions (n, 3) are in the part's frame, mm; what is returned are slacks as `planner.request.constraints` describes
them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from planner.request.space import Space, observable_where

# the axes, and the diagonals of a cube: around a position, an entity must be visible in these directions
_DIAGONALS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / math.sqrt(3)
AROUND = np.vstack([np.eye(3), -np.eye(3), _DIAGONALS])
_AND_HERE = np.vstack([np.zeros(3), AROUND])
# up to so many poses, one question for them and the points around them is cheaper than two
FEW = 40
# pairs of viewpoint and entity that are asked for at a time
_PAIRS = 10_000_000


def visibility_slacks(
    space: Space, positions: np.ndarray, names: Sequence[str], radius_mm: float = 0.0
) -> np.ndarray:
    """+1 where an entity is observable from a position and all around it, else -1; (n, k, 1).

    All around it are 14 points at `radius_mm`: along the axes and the diagonals of the part's frame. Outside the
    workspace nothing is observable.
    """
    if radius_mm > 0 and len(positions) <= FEW:
        return np.where(
            _observable_around(space, positions, names, radius_mm, _AND_HERE), 1.0, -1.0
        )[..., None]
    visible = _observable(space, positions, names)
    rows = np.flatnonzero(visible.any(axis=1))
    if radius_mm > 0 and rows.size:
        visible[rows] &= _observable_around(space, positions[rows], names, radius_mm, AROUND)
    return np.where(visible, 1.0, -1.0)[..., None]


def _observable_around(
    space: Space, positions: np.ndarray, names: Sequence[str], radius_mm: float, around: np.ndarray
) -> np.ndarray:
    """Return which entities are observable from all points around positions; (n, k)."""
    # all points in one call: asking costs more than answering
    eyes = positions[:, None] + radius_mm * around
    visible = _observable(space, eyes.reshape(-1, 3), names).reshape(
        len(positions), len(around), -1
    )
    return np.asarray(visible.all(axis=1))


def _observable(space: Space, positions: np.ndarray, names: Sequence[str]) -> np.ndarray:
    low, high = (np.asarray(corner, dtype=float) for corner in space.workspace)
    inside = ((positions >= low) & (positions <= high)).all(axis=-1)
    visible = np.zeros((len(positions), len(names)), bool)
    visible[inside] = space.observable(positions[inside], names)
    return visible


def visible_where(
    space: Space,
    positions: np.ndarray,
    names: Sequence[str],
    wanted: np.ndarray,
    radius_mm: float = 0.0,
) -> np.ndarray:
    """Return which of the wanted pairs (n, k) are observable, also from all around, as `visibility_slacks` finds it."""
    visible = _observable_where(space, positions, names, wanted)
    rows = np.flatnonzero(visible.any(axis=1)) if radius_mm > 0 else np.zeros(0, np.intp)
    # so many rows at a time, for the memory
    size = max(1, _PAIRS // (len(AROUND) * max(1, len(names))))
    for first in range(0, len(rows), size):
        some = rows[first : first + size]
        eyes = (positions[some, None] + radius_mm * AROUND).reshape(-1, 3)
        asked = np.repeat(visible[some], len(AROUND), axis=0)
        around = _observable_where(space, eyes, names, asked)
        visible[some] = around.reshape(len(some), len(AROUND), -1).all(axis=1)
    return visible


def _observable_where(
    space: Space, positions: np.ndarray, names: Sequence[str], wanted: np.ndarray
) -> np.ndarray:
    low, high = (np.asarray(corner, dtype=float) for corner in space.workspace)
    inside = ((positions >= low) & (positions <= high)).all(axis=-1)
    rows = np.flatnonzero(inside & wanted.any(axis=1))
    visible = np.zeros(wanted.shape, bool)
    visible[rows] = observable_where(space, positions[rows], names, wanted[rows])
    return visible


def clearance_slacks(
    distance: Callable[[np.ndarray], np.ndarray], positions: np.ndarray, stand_off_mm: float
) -> np.ndarray:
    """Signed distance from the part less the stand-off, mm; (n, 1, 1). `distance` maps (n, 3) to (n,)."""
    return (distance(positions) - stand_off_mm)[:, None, None]


def workspace_slacks(workspace: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Distance from the six walls of the workspace box, mm, positive inside; (n, 1, 6)."""
    low, high = (np.asarray(corner, dtype=float) for corner in workspace)
    return np.concatenate([positions - low, high - positions], axis=-1)[:, None, :]


def enclosing_sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius of a sphere around points (m, 3), close to the smallest one.

    The centre walks towards the farthest point by ever smaller steps (Bădoiu & Clarkson 2003); the best one is kept.
    The radius is exact for that centre, so no point is ever outside.
    """
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    best = centre
    radius = np.inf
    for step in range(2, 300):
        distances = np.linalg.norm(points - centre, axis=-1)
        if distances.max() < radius:
            best = centre
            radius = float(distances.max())
        centre = centre + (points[np.argmax(distances)] - centre) / step
    return best, radius
