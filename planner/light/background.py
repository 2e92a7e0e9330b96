"""How bright edges are, and what a camera sees beside a silhouette: the ground, or a face of the part farther away.

Two faces have a contrast though hardly any light falls on either. So the step of their grey values must be large
enough, too: as a share of the grey value of a face that the lamp lights frontally, it is the difference of the cosines
of the angles of incidence. This is no plane; it is computed for a lamp at a given place, and takes no part in proofs.

Where the edge of a face is seen in front of another face of the part, it shows only if that one is brighter or darker
by the contrast. This is no wedge: it depends on distances and cast shadows. So it is decided by rays at points along
the edge, for a lamp at a given place, and takes no part in proofs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.entities.entity import Entity
    from aspectgraph.solid.ray_scene import RayScene


Array = NDArray[np.float64]

DEFAULT_STEP = 0.1
"""Twenty grey levels where a face lit frontally has 200: five standard deviations of noise of 1.5 % of 255 levels."""

# points of an edge that are looked beside, and how far: so far that the detector's window is filled
SHARES = np.linspace(0.06, 0.94, 9)
_BESIDE_PX = 3.0
# a ray that ends this share before the point has been stopped by something else: from a lamp a metre away by 0.02 mm,
# a hundred times what rounding makes
_SHORT = 2e-5
# rays at a time
_BLOCK = 500_000


@dataclass(frozen=True)
class Backdrop:
    """A point of a silhouette, and the point of the part that is seen beside it; mm."""

    point: Array
    normal: Array
    behind: Array
    behind_normal: Array

    @property
    def sides(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Place and normal of the silhouette, and of what is behind it."""
        return (self.point, self.normal), (self.behind, self.behind_normal)


def backdrops(
    solid: Solid,
    scene: RayScene,
    eye: Array,
    entity: Entity,
    silhouettes: Mapping[int, int],
    pixel_rad: float,
) -> list[Backdrop]:
    """Return what is behind the silhouettes of an entity, where it is the part.

    Parameters
    ----------
    solid : Solid
        The part.
    scene : RayScene
        Of the part.
    eye : array (3,)
        Place of the camera, mm.
    entity : Entity
        What is looked at.
    silhouettes : mapping of int to int
        Edge to the face that is seen.
    pixel_rad : float
        Angle of a pixel.

    Returns
    -------
    list of Backdrop
        None for points in front of the ground.
    """
    places_behind = []
    for edge_id, face in silhouettes.items():
        edge = solid.edges[edge_id]
        start, end = solid.vertices[list(edge.vertices)]
        hidden = solid.normals[edge.faces[1 - edge.faces.index(face)]]
        points = start + SHARES[:, None] * (end - start)
        places, normals = seen_beside(scene, eye, points, (end - start, hidden), pixel_rad)
        for i in np.flatnonzero(np.isfinite(places[:, 0])):
            places_behind.append(Backdrop(points[i], solid.normals[face], places[i], normals[i]))
    return places_behind


def seen_beside(
    scene: RayScene, eye: Array, points: Array, edge: tuple[Array, Array], pixel_rad: float
) -> tuple[Array, Array]:
    """Return what is seen beside points of a silhouette: places (n, 3), nan for the ground, and normals (n, 3).

    Parameters
    ----------
    scene : RayScene
        Of the part.
    eye : array (3,)
        Place of the camera, mm.
    points : array (n, 3)
        Points of the edge, mm.
    edge : tuple of array (3,)
        Along the edge, and the normal of the face of it that is not seen.
    pixel_rad : float
        Angle of a pixel.
    """
    rays = rays_beside(points - eye, *edge, pixel_rad)
    hit = scene.cast(eye, rays)
    distance = hit["t_hit"].astype(np.float64)
    normals = hit["primitive_normals"].astype(np.float64)
    normals *= np.where((normals * rays).sum(axis=1) > 0, -1.0, 1.0)[:, None]
    met = np.isfinite(distance)
    return np.where(
        met[:, None], eye + np.where(met, distance, 0.0)[:, None] * rays, np.nan
    ), normals


def across(sight: Array, along: Array) -> Array:
    """Return unit vectors (..., 3) that are square to lines of sight (..., 3) and to a direction (3,)."""
    direction = np.cross(sight, along)
    return np.asarray(direction / np.linalg.norm(direction, axis=-1, keepdims=True))


def rays_beside(sight: Array, along: Array, hidden: Array, pixel_rad: float) -> Array:
    """Return rays (..., 3) that pass silhouettes on their outer side.

    Parameters
    ----------
    sight : array (..., 3)
        From the camera to points of an edge, mm.
    along : array (3,)
        Along the edge.
    hidden : array (3,) or (..., 3)
        Normal of the face of it that is not seen. The edge is convex, as this is hidden and the edge is not: so beside
        the face that is seen is before this one.
    pixel_rad : float
        Angle of a pixel.
    """
    aside = across(sight, along)
    aside *= np.where((aside * hidden).sum(axis=-1) < 0, -1.0, 1.0)[..., None]
    return np.asarray(
        sight + _BESIDE_PX * pixel_rad * np.linalg.norm(sight, axis=-1, keepdims=True) * aside
    )


def backdrop_contrasts(
    scene: RayScene, backdrop: tuple[Backdrop, ...], lamps: Array
) -> tuple[Array, Array]:
    """Return least contrast (n,) and step (n,) between silhouettes and what is behind them under lamps (n, 3).

    The two places differ, so that irradiances of a point lamp fall with the square of the distance, those of a large or
    far lamp less. The contrast is the smaller one with and without this, and 0 if they differ in sign.
    """
    contrast = np.ones(len(lamps))
    step = np.ones(len(lamps))
    for place in backdrop:
        (seen, near), (behind, far) = (incidence(*side, lamps) for side in place.sides)
        behind[shadowed(scene, place.behind, lamps)] = 0.0
        contrast = np.minimum(contrast, sure_contrast((seen, near), (behind, far)))
        step = np.minimum(step, np.abs(seen - behind))
    return contrast, step


def sure_contrast(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return the smaller contrast of two places, each with cosine and distance, with the fall of light and without."""
    (seen, near) = one
    (behind, far) = other
    even = _michelson(seen, behind)
    falling = _michelson(seen / near**2, behind / far**2)
    return np.where(even * falling > 0, np.minimum(np.abs(even), np.abs(falling)), 0.0)


def edge_steps(solid: Solid, entity: Entity, lamps: Array, silhouettes: Mapping[int, int]) -> Array:
    """Return the least step (n,) of an entity under lamps (n, 3), at the ends and middles of its edges, [0, 1].

    That of a silhouette is against a dark ground.
    """
    smallest = np.ones(len(lamps))
    for edge in (solid.edges[i] for i in entity.edge_ids):
        start, end = solid.vertices[list(edge.vertices)]
        for point in (start, (start + end) / 2, end):
            first, other = (incidence(point, solid.normals[face], lamps)[0] for face in edge.faces)
            if edge.id in silhouettes:
                step = first if edge.faces[0] == silhouettes[edge.id] else other
            else:
                step = np.abs(first - other)
            smallest = np.minimum(smallest, step)
    return smallest


def incidence(point: Array, normal: Array, lamps: Array) -> tuple[Array, Array]:
    """Return the cosines of the angles of incidence, 0 behind the face, and the distances of lamps, mm; (n,) each."""
    towards = lamps - point
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    return np.maximum(towards @ normal, 0.0) / distance, distance


def _michelson(one: Array, other: Array) -> Array:
    total = one + other
    return (one - other) / np.where(total > 0, total, 1.0)


def shadowed(scene: RayScene, point: Array, lamps: Array) -> NDArray[np.bool_]:
    """Return under which lamps a point is in the shadow of the part; rays from the lamp, but for their last bit."""
    return shadowed_each(scene, np.broadcast_to(point, lamps.shape), lamps)


def shadowed_each(scene: RayScene, points: Array, lamps: Array) -> NDArray[np.bool_]:
    """Return which points (n, 3) are in the shadow of the part, each under its own lamp (n, 3)."""
    hidden = np.zeros(len(lamps), dtype=bool)
    for first in range(0, len(lamps), _BLOCK):
        block = slice(first, first + _BLOCK)
        hidden[block] = (
            scene.cast(lamps[block], points[block] - lamps[block])["t_hit"] < 1.0 - _SHORT
        )
    return hidden
