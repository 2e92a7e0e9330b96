"""The convex cells of entities' regions in flat arrays, as compiled loops take them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.executors import Shared
from planner.request.space import cells_of

if TYPE_CHECKING:
    from aspectgraph.cells import Cell


class CellArrays(NamedTuple):
    """The arrays of `Cells`."""

    planes: NDArray[np.float64]
    plane_start: NDArray[np.int_]
    corners: NDArray[np.float64]
    corner_start: NDArray[np.int_]
    boxes: NDArray[np.float64]
    entity_start: NDArray[np.int_]


class Cells:
    """The convex cells of several entities' regions in flat arrays, for compiled loops.

    Parameters
    ----------
    cell_sets : sequence of CellSet
        One per entity.

    Attributes
    ----------
    planes : array (p, 4)
        Half-spaces of all cells; of cell c those from ``plane_start[c]`` to ``plane_start[c + 1]``.
    corners : array (v, 3)
        Corners likewise, by ``corner_start``.
    boxes : array (c, 2, 3)
        Bounding boxes.
    entity_start : array (e + 1,)
        The cells of entity e are those from ``entity_start[e]`` to ``entity_start[e + 1]``.
    """

    def __init__(self, cell_sets: Iterable[Iterable[Cell]]):
        # any iterable will do, and only one of the sets need exist at a time
        cells = [
            [(np.asarray(c.half_spaces, float), np.asarray(c.vertices, float)) for c in cs]
            for cs in cell_sets
        ]
        flat = [cell for group in cells for cell in group]
        self.planes = np.concatenate([np.zeros((0, 4)), *(planes for planes, _ in flat)])
        self.corners = np.concatenate([np.zeros((0, 3)), *(corners for _, corners in flat)])
        self.plane_start = _starts(len(planes) for planes, _ in flat)
        self.corner_start = _starts(len(corners) for _, corners in flat)
        self.entity_start = _starts(map(len, cells))
        boxes = [(corners.min(axis=0), corners.max(axis=0)) for _, corners in flat]
        self.boxes = np.array(boxes).reshape(-1, 2, 3)

    @classmethod
    def joined(cls, parts: Iterable[Cells]) -> Cells:
        """Return the cells of several groups of entities, of one after the other."""
        given = list(parts)
        whole = cls(())
        for name in ("planes", "corners", "boxes"):
            setattr(
                whole,
                name,
                np.concatenate([getattr(whole, name), *(getattr(part, name) for part in given)]),
            )
        for name in ("plane_start", "corner_start", "entity_start"):
            setattr(
                whole,
                name,
                _starts(size for part in given for size in np.diff(getattr(part, name))),
            )
        return whole

    @property
    def arrays(self) -> CellArrays:
        """All arrays, as the compiled functions take them."""
        return CellArrays(
            self.planes,
            self.plane_start,
            self.corners,
            self.corner_start,
            self.boxes,
            self.entity_start,
        )


def _starts(sizes: Iterable[int]) -> NDArray[np.int_]:
    return np.cumsum([0, *sizes])


def entity_cells(shared: Shared, name: str) -> Cells:
    """Return the cells of an entity's region, as a task; ``shared`` holds the request."""
    return Cells([cells_of(shared.value.space, [name])])
