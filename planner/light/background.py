"""What a camera sees beside a silhouette, on its other side: the ground, or a face of the part farther away.

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
    from aspectgraph.entities.straight_edges import Entity
    from aspectgraph.solid.ray_scene import RayScene

Array = NDArray[np.float64]

# points of an edge that are looked beside, and how far: so far that the detector's window is filled
_SHARES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
_BESIDE_PX = 3.0
# a ray that ends this share before the point has been stopped by something else
_SHORT = 1e-3
# rays at a time
_BLOCK = 500_000


@dataclass(frozen=True)
class Backdrop:
    """A point of a silhouette, and the point of the part that is seen beside it; mm."""

    point: Array
    normal: Array
    behind: Array
    behind_normal: Array


def backdrops(
    solid: Solid, scene: RayScene, eye: Array, entity: Entity, silhouettes: Mapping[int, int], pixel_rad: float
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
    found = []
    for edge_id, face in silhouettes.items():
        edge = solid.edges[edge_id]
        start, end = solid.vertices[list(edge.vertices)]
        hidden = solid.normals[edge.faces[1 - edge.faces.index(face)]]
        points = start + _SHARES[:, None] * (end - start)
        sight = points - eye
        # the edge is convex, as one face of it is hidden and it is not: outside of the seen face is before the other
        across = np.cross(sight, end - start)
        across *= np.where(across @ hidden < 0, -1.0, 1.0)[:, None] / np.linalg.norm(across, axis=1, keepdims=True)
        rays = sight + _BESIDE_PX * pixel_rad * np.linalg.norm(sight, axis=1, keepdims=True) * across
        hit = scene.cast(eye, rays)
        for i in np.flatnonzero(np.isfinite(hit["t_hit"])):
            normal = hit["primitive_normals"][i].astype(np.float64)
            normal *= -np.sign(normal @ rays[i]) or 1.0
            found.append(Backdrop(points[i], solid.normals[face], eye + float(hit["t_hit"][i]) * rays[i], normal))
    return found


def backdrop_contrasts(scene: RayScene, backdrop: tuple[Backdrop, ...], lamps: Array) -> Array:
    """Return the least contrast (n,) between silhouettes and what is behind them under lamps (n, 3), in [0, 1].

    Irradiances go with the square of the distance here, as the two points differ; where both are dark it is 0.
    """
    least = np.ones(len(lamps))
    for one in backdrop:
        seen = _irradiance(one.point, one.normal, lamps)
        behind = _irradiance(one.behind, one.behind_normal, lamps)
        behind[_shadowed(scene, one.behind, lamps)] = 0.0
        total = seen + behind
        least = np.minimum(least, np.abs(seen - behind) / np.where(total > 0, total, 1.0))
    return least


def _irradiance(point: Array, normal: Array, lamps: Array) -> Array:
    towards = lamps - point
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    return np.asarray(np.maximum(towards @ normal, 0.0) / distance**3)


def _shadowed(scene: RayScene, point: Array, lamps: Array) -> NDArray[np.bool_]:
    """Return under which lamps a point is in the shadow of the part; rays from the lamp, but for their last bit."""
    found = np.zeros(len(lamps), dtype=bool)
    for first in range(0, len(lamps), _BLOCK):
        some = lamps[first : first + _BLOCK]
        found[first : first + _BLOCK] = scene.cast(some, point - some)["t_hit"] < 1.0 - _SHORT
    return found
