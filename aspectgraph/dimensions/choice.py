"""Which of several entities, or pairs of them, to offer first.

Order: those that some direction sees together, judged by their own faces alone; those in one plane; closed circles
before open ones, the longer shorter edge; the lower ids. Nothing is left out: what hides an entity is for the aspect
graph to say.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aspectgraph.dimensions.features import FloatArray
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid

N_DIRECTIONS = 500
"""Directions tried: 10 degrees apart."""


class Sight:
    """From which directions the faces beside an entity let it be seen.

    Parameters
    ----------
    solid : Solid
        The part.
    """

    def __init__(self, solid: Solid):
        self.solid = solid
        self.directions = _directions()
        self._seen: dict[tuple[int, ...], npt.NDArray[np.bool_]] = {}

    def together(self, *entities: int | Arc) -> bool:
        """Return whether some direction sees all of the entities.

        Parameters
        ----------
        *entities : int or Arc
            Ids of edges, rims and arcs.
        """
        return bool(np.all([self._of(one) for one in entities], axis=0).any())

    def length_mm(self, edge_id: int) -> float:
        """Return the length of an edge, rounded so that equal edges are equal.

        Parameters
        ----------
        edge_id : int
            Its id.
        """
        return round(self.solid.edge_length_mm(edge_id), 6)

    def _of(self, entity: int | Arc) -> npt.NDArray[np.bool_]:
        ids = entity.edge_ids if isinstance(entity, Arc) else (entity,)
        if ids not in self._seen:
            self._seen[ids] = np.all([self._of_edge(i) for i in ids], axis=0)
        return self._seen[ids]

    def _of_edge(self, edge_id: int) -> npt.NDArray[np.bool_]:
        edge = self.solid.edges[edge_id]
        front = self.directions @ self.solid.normals[list(edge.faces)].T > 0.0
        # a convex edge shows with either face, a re-entrant one with both
        seen = front.any(axis=1) if edge.dihedral_deg > 0 else front.all(axis=1)
        return np.asarray(seen, dtype=np.bool_)


def arc_order(sight: Sight, arc: Arc) -> tuple[bool, bool, float, int]:
    """Return a key that sorts rims and arcs, the one to be preferred first.

    Parameters
    ----------
    sight : Sight
        Of the solid.
    arc : Arc
        A rim or arc.
    """
    span = round(arc.end_rad - arc.start_rad, 6)
    return not isinstance(arc, Rim), not sight.together(arc), -span, int(arc.id[1:])


def _directions() -> FloatArray:
    """Return unit vectors spread evenly (a Fibonacci lattice), shape (n, 3)."""
    k = np.arange(N_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * k / N_DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
