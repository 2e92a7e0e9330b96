"""What the lines of a part are, whatever is asked of them: found once per part, as many checks of images need it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.ray_scene import RayScene
from planner.detectability.contours import Contours, contours_of, meeting, relation_to

if TYPE_CHECKING:
    from aspectgraph import Solid

_kept: WeakKeyDictionary[Solid, PartLines] = WeakKeyDictionary()


class PartLines:
    """The lines of a part, and rays that tell what hides them.

    Parameters
    ----------
    solid : Solid
        The part.

    Attributes
    ----------
    contours : Contours
        Of the part.
    at : dict
        See `meeting`.
    scene : RayScene
        Of the part.
    compiled : tuple of array
        Of `contours` vertices (3, v), ends, planes (4, f), faces and kinds, as compiled loops take them: coordinates
        one after the other, so that several points are computed at once, and numbers that cannot be negative.
    bulges : array (m, 3)
        From the middle of each edge of `contours` to that of the arc it is a chord of, mm; 0 for straight ones.
    """

    def __init__(self, solid: Solid) -> None:
        self.contours = contours_of(solid)
        self.at = meeting(self.contours)
        self.scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        one = self.contours
        vertices, planes = (np.array(rows.T, order="C") for rows in (one.vertices, one.planes))
        ends, faces = (rows.astype(np.uint32) for rows in (one.ends, one.faces))
        self.compiled: Any = (vertices, ends, planes, faces, one.kinds)
        self.bulges = _bulges(solid, one)
        self._relations: dict[tuple[tuple[int, ...], float], NDArray[np.uint8]] = {}

    @classmethod
    def of(cls, solid: Solid) -> PartLines:
        """Return the lines of a part; the same ones as long as the part is there."""
        if solid not in _kept:
            _kept[solid] = cls(solid)
        return _kept[solid]

    def relation(self, edge_ids: Sequence[int], radius_mm: float) -> NDArray[np.uint8]:
        """Return `relation_to` an entity's edges."""
        key = tuple(edge_ids), radius_mm
        if key not in self._relations:
            self._relations[key] = relation_to(self.contours, self.at, edge_ids, radius_mm)
        return self._relations[key]


def _bulges(solid: Solid, contours: Contours) -> NDArray[np.float64]:
    """Return how far circles leave their chords, vectors (m, 3); chords of other curves count as straight."""
    bulges = np.zeros((len(contours.ids), 3))
    place = {int(edge): k for k, edge in enumerate(contours.ids)}
    for arc in (*solid.rims(), *solid.arcs()):
        for edge in arc.edge_ids:
            if edge in place:
                off = solid.edge_points(edge).mean(axis=0) - arc.centre
                # a fitted circle may be off the plane of its chords
                off = off - (off @ arc.axis) * arc.axis
                size = float(np.linalg.norm(off))
                if 0.0 < size < arc.radius_mm:
                    bulges[place[edge]] = (arc.radius_mm / size - 1.0) * off
    return bulges
