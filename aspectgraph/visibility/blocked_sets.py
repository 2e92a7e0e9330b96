"""Blocked sets: from where a convex piece of surface hides part of an entity.

Notation
--------
ab   the entity, a closed segment between two vertices of the solid, or between two points of an edge (see `cuts`)
O    a convex piece of a face, P its plane with the outward side positive; O hides something only from points p of ab
     in front of P, because every blocked line of sight enters the solid somewhere
B    {q + t (q - p) : q in O, p in ab in front of P, t >= 0}, the blocked set of O, convex and unbounded

B is cut out by P and by every plane that separates O from ab, touches both, and passes through

* an edge of O and an end of ab in front of P (type B, or A where it is a face next to the entity), or
* ab and a vertex of O (likewise).

Where P separates a from b, the part of ab in front of P ends on P, and the planes through that end and an edge of O
are P itself. So every bounding plane passes through vertices of the solid and ends of ab: quadrics (type C) never bound
a domain of whole-edge observability. Nothing here asks ab to be a whole edge, so it holds for stretches too.

The faces next to the entity block by themselves: from behind both of them at a convex edge, from behind either at a
re-entrant one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

from aspectgraph.exact.planes import side_of
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.casting import Jobs, cast_all, in_the_way
from aspectgraph.visibility.deadline import check_deadline
from aspectgraph.visibility.free_discs import free_disc
from aspectgraph.visibility.scene import Scene, chords, end_resolution, entity_ends, line_ends
from aspectgraph.visibility.united_sets import Blockers, united
from compiled.decorators import entry_kernel

if TYPE_CHECKING:
    from aspectgraph.entities.straight_edges import Entity


class Unblocked(Protocol):
    """What is left of the viewpoints after the faces next to an entity, so that others need not be looked at."""

    def sides(self, planes: np.ndarray) -> np.ndarray:
        """Return, for planes (n, 4), whether viewpoints are left on the positive and the negative side: (n, 2) bool."""


def blockers(
    scene: Scene,
    solid: Solid,
    entity: Entity,
    deadline: float = math.inf,
    unblocked: Unblocked | None = None,
) -> Blockers:
    """Blocked sets of one entity whose union are all: first the faces next to it, then other pieces in its way.

    Those of a rim or arc are the blocked sets of all its chords, for a viewpoint that misses a part of one misses a
    part of the whole. Of a rim with a free disc they are the blocked sets of the disc (see `free_discs`).

    Parameters
    ----------
    scene, solid
        The solid on its grid, and itself.
    entity : Entity
    deadline : float
        Time (`time.time`) by which to end.
    unblocked : Unblocked, optional
        What the faces next to the entity leave; sets that miss it may be missing.

    Raises
    ------
    DeadlineError
        If they are not complete by then.
    """
    disc = free_disc(scene, solid, entity)
    matters = _behind_which_some_are_left(scene, unblocked)
    if disc is not None:
        on_side = np.ones(2, bool) if unblocked is None else unblocked.sides(disc.plane[None])[0]
        by_disc = (disc.certified | ~on_side).all(axis=1)
        if by_disc.any():
            check_deadline(deadline)
            return _disc_blockers(scene, solid, entity, disc.corners, by_disc, matters)
    parts = []
    for chord in chords(entity):
        check_deadline(deadline)
        settle_thin = entity.kind != "edge" or entity.part is not None
        parts.append(_chord_blockers(scene, solid, chord, matters, settle_thin))
    return parts[0] if len(parts) == 1 else united(parts)


def wedge_blockers(scene: Scene, solid: Solid, entity: Entity) -> Blockers:
    """Blocked sets of the faces next to an entity alone."""
    none = np.empty(0, np.int64)
    return cast_all(scene, _wedge(scene, solid, entity), Jobs(none, np.zeros(1, int), none), True)


def _behind_which_some_are_left(scene: Scene, unblocked: Unblocked | None) -> np.ndarray:
    """Whether viewpoints are left behind each piece, (n,) bool; it blocks no others."""
    if unblocked is None:
        return np.ones(len(scene.pieces.face), bool)
    sides = unblocked.sides(scene.planes)
    behind = (scene.side_of_face[scene.pieces.face] > 0).astype(int)
    return np.asarray(sides[scene.plane_of_face[scene.pieces.face], behind])


def _disc_blockers(
    scene: Scene,
    solid: Solid,
    entity: Entity,
    corners: np.ndarray,
    by_disc: np.ndarray,
    matters: np.ndarray,
) -> Blockers:
    """Blocked sets of a rim with a free disc: those of its faces, then one per piece and, where need be, chord.

    `by_disc`: for which shells the disc does.
    """
    wedge = _wedge(scene, solid, entity)
    order = in_the_way(scene, corners, *_behind_disc(scene, corners, *wedge))
    by_piece = by_disc[solid.face_shell[scene.pieces.face]]
    jobs = Jobs(*_disc_jobs(scene, order[matters[order]], corners, by_piece))
    return cast_all(scene, wedge, jobs, True)


def _behind_disc(
    scene: Scene, corners: np.ndarray, first: np.ndarray, plane: np.ndarray, side: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those sets of a wedge of which every plane has the whole disc on its other side, or on it."""
    beyond = _beyond(scene, corners, plane, side)
    kept = [k for k in range(len(first) - 1) if beyond[first[k] : first[k + 1]].all()]
    rows = [np.arange(first[k], first[k + 1]) for k in kept]
    flat = np.concatenate(rows) if rows else np.empty(0, int)
    return np.cumsum([0] + [len(row) for row in rows]), plane[flat], side[flat]


@entry_kernel
def _beyond(scene, corners, plane, side):
    """Whether no corner is on the given side of each plane."""
    result = np.ones(len(plane), np.bool_)
    for j in range(len(plane)):
        for v in corners:
            if side[j] * side_of(scene.planes[plane[j]], scene.points[v], scene.resolution) > 0:
                result[j] = False
    return result


@entry_kernel
def _disc_jobs(scene, order, corners, by_disc):
    """Hulls to cast sets for: of each piece the part of the disc in front of it, and chords that cross its plane.

    A hull ends at corners, so what is in front of the piece between the last one and its plane is left to the chord.
    """
    m = len(corners)
    piece = [np.int64(0) for _ in range(0)]
    first = [np.int64(0)]
    hulls = [np.int64(0) for _ in range(0)]
    place = np.empty(m, np.int64)
    for k in order:
        face = scene.pieces.face[k]
        plane = scene.planes[scene.plane_of_face[face]]
        behind = -1
        for j in range(m):
            place[j] = scene.side_of_face[face] * side_of(
                plane, scene.points[corners[j]], scene.resolution
            )
            if place[j] < 0:
                behind = j
        as_polygon = by_disc[k] and (place >= 0).sum() > 2
        if as_polygon:
            # in order around the disc, from behind the plane if it crosses
            for i in range(m):
                j = (behind + 1 + i) % m
                if place[j] >= 0:
                    hulls.append(np.int64(corners[j]))
            piece.append(k)
            first.append(len(hulls))
        for j in range(m):
            i = (j + 1) % m
            if (place[i] > 0 or place[j] > 0) and (not as_polygon or place[i] < 0 or place[j] < 0):
                hulls.append(np.int64(corners[j]))
                hulls.append(np.int64(corners[i]))
                piece.append(k)
                first.append(len(hulls))
    return np.array(piece), np.array(first), np.array(hulls)


def _chord_blockers(
    scene: Scene, solid: Solid, entity: Entity, matters: np.ndarray, settle_thin: bool
) -> Blockers:
    """All blocked sets of one straight entity.

    `settle_thin`: where an end is so little in front of a far piece that the plane through it and an edge of the piece
    is the piece's own to within the resolution, take the exact sides. Chords, of which there are many at all angles,
    meet this; an edge's sets stay as they always were, open to that side.
    """
    scene = scene._replace(resolution=end_resolution(scene, solid, entity))
    ends = np.array(entity_ends(scene, solid, entity))
    wedge = _wedge(scene, solid, entity)
    order = in_the_way(scene, ends, *wedge)
    order = order[matters[order]]
    hulls = np.tile(ends, len(order))
    jobs = Jobs(order, np.arange(0, len(hulls) + 1, len(ends)), hulls)
    return cast_all(scene, wedge, jobs, settle_thin, line_ends(scene, solid, entity))


def _wedge(scene: Scene, solid: Solid, entity: Entity) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The blocked sets of the faces next to the entity, as first, plane, side."""
    sets: set[tuple[tuple[int, int], ...]] = set()
    for edge_id in entity.edge_ids:
        edge = solid.edges[edge_id]
        behind = [(int(scene.plane_of_face[f]), -int(scene.side_of_face[f])) for f in edge.faces]
        sets |= {tuple(sorted(behind))} if edge.dihedral_deg > 0 else {(half,) for half in behind}
    ordered = sorted(sets)
    first = np.cumsum([0] + [len(halves) for halves in ordered])
    flat = np.array([half for halves in ordered for half in halves])
    return first, flat[:, 0].copy(), flat[:, 1].copy()
