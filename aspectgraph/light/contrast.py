"""Contrast of an edge between the two faces next to it, under a lamp at a point.

Notation
--------
p        the lamp; x  any point of the edge
n₁, n₂   outward unit normals of the two faces
I        irradiance of a face at the edge, n·(p − x) / |p − x|³ in front of it, 0 behind it (Lambert 1760)
contrast (I₁ − I₂) / (I₁ + I₂), in [−1, 1]. The distance cancels, so it is the same for every point of the edge.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.entities.straight_edges import Entity, resolve_entities
from aspectgraph.exceptions import LightError
from aspectgraph.solid.ray_scene import RayScene
from aspectgraph.solid.solid import Solid

# rays are float32: a lamp so little inside, as a share of the part's diagonal, may lie on the surface
_ON_SURFACE = 1e-5

NONE: Mapping[int, int] = MappingProxyType({})
"""No silhouettes: all edges are creases."""


def contrast(solid: Solid, edge: int | Entity, lamps: ArrayLike) -> np.ndarray:
    """Return the contrast (I₁ − I₂) / (I₁ + I₂) of an edge under lamps, without shadows.

    Both faces are matt, of one albedo, and lit by the lamp alone. `LightRegions.showing` also
    checks whether the lamp lights the whole edge.

    Parameters
    ----------
    solid : Solid
        The part.
    edge : int or Entity
        Edge id, or an entity. For the edges of a chain, rim or arc, the result is the value nearest
        to 0.
    lamps : array_like, shape (n, 3)
        Positions of the lamps in mm.

    Returns
    -------
    ndarray of float64, shape (n,)
        In [-1, 1]. It is positive where ``faces[0]`` of the edge is brighter, and 0 where both
        faces are dark.

    Raises
    ------
    EntityError
        If there is no such edge, or it is not sharp or straight.
    LightError
        If a lamp is not finite or lies inside the part.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import contrast, resolve_entities
    >>> edge = resolve_entities(box, {"top": [[0, 0, 20], [40, 0, 20]]})["top"]
    >>> abs(contrast(box, edge, [[20, -100, 120], [20, -200, 120]])).round(3).tolist()
    [0.0, 0.333]
    """
    entity = edge if isinstance(edge, Entity) else resolve_entities(solid, [edge])[f"e{edge}"]
    return face_contrast(solid, entity, check_lamps(solid, lamps))


def silhouettes_from(solid: Solid, entity: Entity, viewpoint: ArrayLike) -> dict[int, int]:
    """Return the edges of an entity that are silhouettes from a viewpoint: those of which it sees one face only.

    The others are creases: both faces are seen, and their shading decides. A silhouette shows against what is behind
    it, where the seen face is lit.

    Parameters
    ----------
    solid : Solid
        The part.
    entity : Entity
        Observable from there.
    viewpoint : array_like, shape (3,)
        In mm.

    Returns
    -------
    dict of int to int
        Edge id to the number of the face that is seen.
    """
    found = {}
    for edge in (solid.edges[i] for i in entity.edge_ids):
        towards = np.asarray(viewpoint, float) - solid.vertices[edge.vertices[0]]
        heights = solid.normals[list(edge.faces)] @ towards
        if heights.min() <= 0.0:
            found[edge.id] = edge.faces[int(heights.argmax())]
    return found


def face_contrast(
    solid: Solid, entity: Entity, lamps: np.ndarray, silhouettes: Mapping[int, int] = NONE
) -> np.ndarray:
    """Return the contrast (n,) of an entity under lamps (n, 3) in mm that were checked; see `contrast`.

    That of a silhouette is against a dark ground: 1 where the face that is seen is lit, else 0.
    """
    edges = [solid.edges[i] for i in entity.edge_ids]
    start = solid.vertices[[edge.vertices[0] for edge in edges]]
    normals = solid.normals[[edge.faces for edge in edges]]
    irradiance = np.maximum(np.einsum("efk,nek->nef", normals, lamps[:, None] - start), 0.0)
    total = irradiance.sum(axis=2)
    values = np.subtract(*np.moveaxis(irradiance, 2, 0)) / np.where(total > 0.0, total, 1.0)
    for k, edge in enumerate(edges):
        if edge.id in silhouettes:
            values[:, k] = irradiance[:, k, edge.faces.index(silhouettes[edge.id])] > 0.0
    return values[np.arange(len(lamps)), np.abs(values).argmin(axis=1)]


def check_contrast(value: float) -> float:
    """Return a least contrast as a float.

    Parameters
    ----------
    value : float
        Share of (I₁ + I₂), strictly between 0 and 1.

    Returns
    -------
    float
        The same.

    Raises
    ------
    LightError
        If it is not strictly between 0 and 1.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float | np.number)
        or not 0.0 < value < 1.0
    ):
        raise LightError.of_rule("contrast", "must lie strictly between 0 and 1", repr(value))
    return float(value)


def check_lamps(solid: Solid, lamps: ArrayLike) -> np.ndarray:
    """Return places of lamps as (n, 3) float64, all finite and outside the part.

    Raises
    ------
    LightError
        If a place is not finite or lies inside the part; the message names the first.
    """
    try:
        places = np.asarray(lamps, float)
    except (TypeError, ValueError) as error:
        raise LightError.of_rule(
            "lamps", "must be places, shape (n, 3), in mm", repr(lamps)
        ) from error
    places = places[None] if places.shape == (3,) else places
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise LightError.of_rule(
            "lamps", "must be finite places, shape (n, 3), in mm", str(places.tolist())
        )
    low, high = solid.bounds
    near = np.flatnonzero(((places > low) & (places < high)).all(axis=1))
    depth = (
        -RayScene(solid.vertices, solid.triangles).signed_distance(places[near])
        if len(near)
        else np.empty(0)
    )
    inside = near[depth > _ON_SURFACE * float(np.linalg.norm(high - low))]
    if len(inside):
        raise LightError.of_rule(
            "lamps", "must lie outside the part", f"{places[inside[0]].tolist()} mm inside it"
        )
    return places
