"""From where a lamp makes edges show: the whole edge lit, and enough contrast between the two faces next to it.

Matt faces of one albedo, point lamps, no light from other faces. Then the light domain of an edge is its region with
the lamp as viewpoint, without one wedge through the edge's line: planes only, and all exact, as for viewpoints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from fractions import Fraction
from functools import partial
from math import isqrt
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import CellSet
from aspectgraph.entities.entity import Entity, resolve_entities
from aspectgraph.exact.grid import Grid, plane_through
from aspectgraph.exceptions import LightError
from aspectgraph.graph.aspect_graph import EntityAspectGraph
from aspectgraph.graph.build_graph import graph_of
from aspectgraph.solid.solid import RayScene, Solid
from aspectgraph.visibility.blocked_sets import blockers
from aspectgraph.visibility.entity_region import Region, carved_region
from aspectgraph.visibility.scene import (
    CONTRAST,
    FACE,
    Blockers,
    Scene,
    check_deadline,
    chords,
    line_ends,
    united,
)
from aspectgraph.visibility.visibility_regions import (
    Progress,
    VisibilityRegions,
    laid_out,
    regions_of,
)
from ground.short_repr import count

# Light domains of entities: where a lamp lights all of an edge with enough contrast, exactly.


# Contrast of an edge between the two faces next to it, under a lamp at a point.
#
# Notation
# --------
# p        the lamp; x  any point of the edge
# n₁, n₂   outward unit normals of the two faces
# I        irradiance of a face at the edge, n·(p − x) / |p − x|³ in front of it, 0 behind it (Lambert 1760)
# contrast (I₁ − I₂) / (I₁ + I₂), in [−1, 1]. The distance cancels, so it is the same for every point of the edge.


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
    face_of_edge = {}
    for edge in (solid.edges[i] for i in entity.edge_ids):
        towards = np.asarray(viewpoint, float) - solid.vertices[edge.vertices[0]]
        heights = solid.normals[list(edge.faces)] @ towards
        if heights.min() <= 0.0:
            face_of_edge[edge.id] = edge.faces[int(heights.argmax())]
    return face_of_edge


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


def check_lamps(solid: Solid, lamps: ArrayLike, *, may_touch: bool = True) -> np.ndarray:
    """Return places of lamps as (n, 3) float64, all finite and outside the part.

    Parameters
    ----------
    solid : Solid
        The part.
    lamps : array_like, shape (n, 3)
        Places in mm.
    may_touch : bool
        Whether a lamp may lie on the surface of the part.

    Raises
    ------
    LightError
        If a place is not finite or lies inside the part; the message names the first.
    """
    try:
        places = np.asarray(lamps, float)
    except (TypeError, ValueError) as error:
        raise LightError.of_rule(
            "lamps", "must be points, shape (n, 3), in mm", repr(lamps)
        ) from error
    places = places[None] if places.shape == (3,) else places
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise LightError.of_rule(
            "lamps", "must be finite points, shape (n, 3), in mm", str(places.tolist())
        )
    low, high = solid.bounds
    near = np.flatnonzero(((places >= low) & (places <= high)).all(axis=1))
    depth = (
        -RayScene(solid.vertices, solid.triangles).signed_distance(places[near])
        if len(near)
        else np.empty(0)
    )
    noise = _ON_SURFACE * float(np.linalg.norm(high - low))
    inside = near[depth > noise]
    if len(inside):
        raise LightError.of_rule(
            "lamps", "must lie outside the part", f"{places[inside[0]].tolist()} mm inside it"
        )
    touching = near[depth >= -noise]
    if len(touching) and not may_touch:
        raise LightError.of_rule(
            "lamps",
            "must lie outside the part",
            f"{places[touching[0]].tolist()} mm on its surface",
        )
    return places


# The wedge of lamp positions around the bisector of an edge's two faces from which its contrast
# is too small.
#
# For p - x = v and a least contrast c, the contrast is below c while a face is lit exactly where
#
#     [(1 - c) n₁ - (1 + c) n₂]·v < 0  and  [(1 - c) n₂ - (1 + c) n₁]·v < 0.
#
# Both together imply n₁·v > 0 and n₂·v > 0: with k = (1 + c) / (1 - c) > 1 they say n₁·v < k n₂·v
# and n₂·v < k n₁·v, so n₁·v < k² n₁·v, which is wrong unless n₁·v > 0; likewise for n₂. So the
# wedge is one convex set, bounded by two planes through the edge's line, and is blocked like the
# shadow of an occluder.
#
# On the grid, face normals are integer triples N of length |N|, and the first plane is q N₁ - p
# N₂ with p / q for k |N₁| / |N₂|. Where that ratio is rational with terms up to 2²⁰, as between
# faces along the axes for a contrast of few digits, p / q is that ratio and the plane is exact.
# Else the larger of p / q and q / p is the nearest such fraction; or, where the coefficients
# leave no room or snapping displaced the edge from its face's plane, the plane goes through the
# edge's ends and the nearest grid point 2²⁰ steps away. It then leans by less than 10⁻⁶ rad from
# where it should, on a grid of equal steps, and always holds the ends exactly. Whatever plane was
# taken, everything after is decided exactly by its integers.


_REACH_BITS = 20
# least room that exact signs need, see `predicates`
_COEFFICIENT_BITS = 42
_OFFSET_BITS = 62


def light_sets(
    scene: Scene,
    grid: Grid,
    solid: Solid,
    entity: Entity,
    contrast: float,
    silhouettes: Mapping[int, int] = NONE,
) -> Blockers:
    """Return the sets of lamp positions from which an entity is not lit as a whole or has too little contrast.

    Parameters
    ----------
    scene, grid, solid
        The solid on its grid, the grid, and itself.
    entity : Entity
        A rim or arc has as many wedges as chords, each with the flat faces next to it.
    contrast : float
        Least contrast, strictly between 0 and 1.
    silhouettes : mapping of int to int
        Edges of the entity that are seen as silhouettes, and the face that is seen: it must be lit, no more.
    """
    sets = [blockers(scene, solid, entity)]
    for chord in chords(entity):
        sets += _wedges(scene, grid, solid, chord, contrast, silhouettes)
        sets += [
            _behind(scene, silhouettes[edge_id])
            for edge_id in chord.edge_ids
            if edge_id in silhouettes
        ]
    return united(sets)


def _behind(scene: Scene, face: int) -> Blockers:
    """Everything behind a face."""
    number = scene.plane_of_face[face]
    return Blockers(
        np.array([0, 1], np.int32),
        np.zeros(1, np.int32),
        np.array([-scene.side_of_face[face]], np.int8),
        scene.planes[[number]],
        np.array([[FACE, face, -1, -1]], np.int32),
    )


def _wedges(
    scene: Scene,
    grid: Grid,
    solid: Solid,
    chord: Entity,
    contrast: float,
    silhouettes: Mapping[int, int],
) -> list[Blockers]:
    """One set for each pair of face planes next to a straight entity that is seen as a crease."""
    ends = line_ends(scene, solid, chord)
    wedges: dict[frozenset[int], Blockers] = {}
    for edge_id in (e for e in chord.edge_ids if e not in silhouettes):
        face, other = solid.edges[edge_id].faces
        pair = frozenset((int(scene.plane_of_face[face]), int(scene.plane_of_face[other])))
        if pair not in wedges:
            planes = [
                contrast_plane(scene, grid, ends, (f, g), contrast)
                for f, g in ((face, other), (other, face))
            ]
            origin = [[CONTRAST, *ends, f] for f in (face, other)]
            wedges[pair] = Blockers(
                np.array([0, 2], np.int32),
                np.array([0, 1], np.int32),
                np.array([-1, -1], np.int8),
                np.array(planes, np.int64),
                np.array(origin, np.int32),
            )
    return list(wedges.values())


def contrast_plane(
    scene: Scene, grid: Grid, ends: tuple[int, int], faces: tuple[int, int], contrast: float
) -> np.ndarray:
    """Return the plane (a, b, c, d) through an edge where its first face has just the contrast, positive side bright.

    Parameters
    ----------
    scene, grid
        The solid on its grid, and the grid.
    ends : tuple of int
        Vertices of the edge.
    faces : tuple of int
        Brighter and darker face.
    contrast : float
        Least contrast.
    """
    # Python integers, which do not overflow
    first_plane, other = (
        [int(c) * int(scene.side_of_face[f]) for c in scene.planes[scene.plane_of_face[f]]]
        for f in faces
    )
    exact_contrast = Fraction(repr(contrast))
    ratio = (
        (1 + exact_contrast)
        / (1 - exact_contrast)
        * _length_ratio(first_plane[:3], other[:3], grid.scale)
    )
    # of the larger of ratio and reciprocal, so that the error is relative
    if ratio < 1:
        ratio = 1 / (1 / ratio).limit_denominator(1 << _REACH_BITS)
    else:
        ratio = ratio.limit_denominator(1 << _REACH_BITS)
    points = [[int(x) for x in scene.points[v]] for v in ends]
    if all(
        sum(a * x for a, x in zip(plane, p, strict=False)) == plane[3]
        for plane in (first_plane, other)
        for p in points
    ):
        combined = [
            ratio.denominator * a - ratio.numerator * b
            for a, b in zip(first_plane, other, strict=True)
        ]
        divisor = int(np.gcd.reduce([abs(c) for c in combined[:3]]))
        combined = [c // divisor for c in combined]
        if (
            max(map(abs, combined[:3])) < 1 << _COEFFICIENT_BITS
            and abs(combined[3]) < 1 << _OFFSET_BITS
        ):
            return np.array(combined, np.int64)
    return _through_ends(scene.points[list(ends)], (first_plane, other), float(ratio), grid.scale)


def _length_ratio(vector: list[int], other: list[int], scale: np.ndarray) -> Fraction:
    """|N₁| / |N₂| of two plane normals, exact where it is rational and the grid's steps are equal."""
    if (scale == 1.0).all():
        square = Fraction(sum(c * c for c in vector), sum(c * c for c in other))
        root = Fraction(isqrt(square.numerator), isqrt(square.denominator))
        if root * root == square:
            return root
    lengths = [float(np.linalg.norm(np.array(normal, float) / scale)) for normal in (vector, other)]
    return Fraction(lengths[0] / lengths[1])


def _through_ends(
    ends: np.ndarray, planes: tuple[list[int], list[int]], ratio: float, scale: np.ndarray
) -> np.ndarray:
    """Return the plane through both ends and the grid point nearest to where the exact one is, far from the edge."""
    first_plane, other = (np.array(plane[:3], float) / scale for plane in planes)
    normal = first_plane - ratio * other
    across = np.cross((ends[1] - ends[0]) * scale, normal / np.abs(normal).max()) / scale
    away = np.rint(across / np.abs(across).max() * (1 << _REACH_BITS)).astype(np.int64)
    plane = plane_through(ends[0], ends[1], ends[0] + away)
    return plane if (plane[:3] / scale) @ normal > 0 else -plane


_Task = tuple[Entity, Mapping[int, int]]

DEFAULT_CONTRAST = 0.1
"""A fifth of the brighter face's grey value: 20 of 255 grey levels where that one has 110, far above noise of 1.5 %."""


class LightRegions(VisibilityRegions):
    """The exact regions of lamp positions that light each entity as a whole with contrast.

    `compute_light` makes it. Its methods are those of `VisibilityRegions`, with lamps instead of
    viewpoints and *is lit* instead of *is observable*. A lit entity has at least the least
    contrast.

    Parameters
    ----------
    scene : Scene
        The solid on its grid.
    regions : mapping of str to Region
        The region of each entity, on the same grid.
    contrast : float
        Least contrast.
    silhouettes : mapping of str to mapping, optional
        See `compute_light`.

    Attributes
    ----------
    solid : Solid
        The part.
    workspace : ndarray, shape (2, 3)
        Lowest and highest corner of the space of lamps in mm.
    entities : dict of str to Entity
        By name, in the order given.
    grid : Grid
        Integer grid of all geometry.
    contrast : float
        Least contrast.
    silhouettes : dict of str to mapping
        Per entity, its edges that the camera sees as silhouettes, and the visible face of each.
    listed_as : str
        Name of a graph's attribute for the list of a domain.
    """

    listed_as: ClassVar[str] = "showing"

    def __init__(
        self,
        solid: Solid,
        workspace: np.ndarray,
        entities: dict[str, Entity],
        grid: Grid,
        scene: Scene,
        regions: Mapping[str, Region],
        contrast: float,
        silhouettes: Mapping[str, Mapping[int, int]] | None = None,
    ) -> None:
        super().__init__(solid, workspace, entities, grid, scene, regions)
        self.contrast = contrast
        self.silhouettes = dict(silhouettes or {})

    def __repr__(self) -> str:
        """Return a one-line summary."""
        size = count(len(self.entities), "entity", "entities")
        return f"<LightRegions of {self.solid.name!r}: {size}, contrast {self.contrast:g}>"

    def showing(self, lamps: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Whether lamps, each alone, light entities as a whole with the least contrast.

        Parameters
        ----------
        lamps : array_like, shape (n, 3)
            Positions of the lamps in mm, inside the workspace. They are rounded as viewpoints are.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name; False inside the solid.

        Raises
        ------
        WorkspaceError
            If a lamp lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        return self.observable(lamps, names)

    def contrasts(self, lamps: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Contrast of entities under lamps, each alone.

        It is 0 if a piece of the entity is in shadow or dark.

        Parameters
        ----------
        lamps : array_like, shape (n, 3)
            Positions of the lamps in mm, inside the workspace.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of float64, shape (n, k)
            In [-1, 1]; see `contrast`. Values below the least contrast are also 0.

        Raises
        ------
        LightError
            If a lamp lies inside the part.
        WorkspaceError
            If a lamp lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        names = self.check_names(self.entity_names if names is None else names)
        places = check_lamps(self.solid, lamps)
        values = [self._values(name, places) for name in names]
        return np.where(
            self.showing(places, names), np.reshape(values, (len(names), len(places))).T, 0.0
        )

    def _sets(self, entity: Entity) -> Blockers:
        seen = next(
            (
                self.silhouettes.get(n, NONE)
                for n, candidate in self.entities.items()
                if candidate is entity
            ),
            NONE,
        )
        return light_sets(self._scene, self.grid, self.solid, entity, self.contrast, seen)

    def _values(self, name: str, places: np.ndarray) -> np.ndarray:
        return face_contrast(
            self.solid, self.entities[name], places, self.silhouettes.get(name, NONE)
        )

    def _holds_besides(self, points: np.ndarray) -> np.ndarray:
        values = np.array([self._values(name, points) for name in self.entities])
        return self.contrast <= np.abs(values).T


def compute_light(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    contrast: float = DEFAULT_CONTRAST,
    workspace: ArrayLike | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    silhouettes: Mapping[str, Mapping[int, int]] | None = None,
    deadline: float = math.inf,
) -> LightRegions:
    """Compute the lamp positions that light each entity with contrast.

    The model assumes a matt part of one albedo, point lamps, and no light between faces.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping of str to edge id, id of a rim or arc, or pair of points, or sequence of ids
        See `resolve_entities`. Resolved entities are used without change.
    contrast : float
        Least contrast (absolute value of `contrast`) between the two faces of an edge, strictly between 0 and 1.
    workspace : array_like, shape (2, 3), optional
        Corners of the space of lamps in mm. Default: the part's box,
        extended by ten diagonals in all directions.
    executor : concurrent.futures.Executor, optional
        Computes entities in parallel. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total, label)`` after each of the entities; the label is the name of the entity.
    silhouettes : mapping of str to mapping of int to int, optional
        Per entity, ids of its edges that a camera sees as silhouettes, and the face it sees
        (`silhouettes_from`). A silhouette is visible against a dark background where that face is
        lit. Default: all edges are creases.
    deadline : float
        Time, as `time.time` gives it, at which the computation ends. Default: never.

    Returns
    -------
    LightRegions
        In the order of the entities. Entities whose region is not complete by the deadline are
        missing.

    Raises
    ------
    LightError
        If the contrast is out of range.
    EntityError
        If an entity is not a sharp straight edge, rim or arc.
    WorkspaceError
        If the workspace is not a box around the part.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import compute_light
    >>> light = compute_light(box, {"top": [[0, 0, 20], [40, 0, 20]]}, contrast=0.2)
    >>> light.showing([[20, -100, 120], [20, -300, 120]]).tolist()
    [[False], [True]]
    """
    contrast = check_contrast(contrast)
    layout = laid_out(solid, entities, workspace)
    solid, box_mm, resolved, grid, scene = layout
    seen = silhouettes or {}
    box = grid.cube_planes(box_mm)
    make = partial(_lamp_region, scene, grid, solid, contrast, box, deadline)
    tasks: dict[str, _Task] = {
        name: (entity, seen.get(name, {})) for name, entity in resolved.items()
    }
    regions = regions_of(tasks, make, executor, progress, deadline=deadline)
    complete = {name: entity for name, entity in resolved.items() if name in regions}
    return LightRegions(solid, box_mm, complete, grid, scene, regions, contrast, seen)


def light_region(
    solid: Solid, edge: Any, contrast: float = DEFAULT_CONTRAST, workspace: ArrayLike | None = None
) -> CellSet:
    """Return all lamp positions that light one edge with contrast, as convex cells.

    Parameters
    ----------
    solid : Solid
        The part.
    edge : int, str, pair of points, or Entity
        The edge, as an entity of `resolve_entities`.
    contrast : float
        Least contrast, strictly between 0 and 1; see `compute_light`.
    workspace : array_like, shape (2, 3), optional
        Corners of the space of lamps in mm. Default: the part's box,
        extended by ten diagonals in all directions.

    Returns
    -------
    CellSet
        Empty if there are none.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import light_region
    >>> region = light_region(box, [[0, 0, 20], [40, 0, 20]], contrast=0.2)
    >>> region.contains([[20, -100, 120], [20, -300, 120]]).tolist()
    [False, True]
    """
    return compute_light(solid, {"edge": edge}, contrast, workspace).covering_cells(["edge"])


def _lamp_region(
    scene: Scene,
    grid: Grid,
    solid: Solid,
    contrast: float,
    box: np.ndarray,
    deadline: float,
    task: _Task,
) -> Region:
    entity, silhouettes = task
    check_deadline(deadline)
    sets = light_sets(scene, grid, solid, entity, contrast, silhouettes)
    return carved_region(sets, box, deadline)


# The aspect graph of lamp positions: domains under whose lamps the same entities show.


class LightGraph(EntityAspectGraph):
    """The aspect graph of lamp positions. `build_light_graph` makes it.

    All methods of `EntityAspectGraph` apply to lamps instead of cameras. `domain_of` takes lamp
    positions. `covering`, `cells` and `sample` return domains, cells and positions that light all
    names.

    Parameters
    ----------
    cx : Complex
        The convex cells that the space of lamps is cut into.
    domains : Domains
        Which of these cells form which node.

    Attributes
    ----------
    graph : networkx.Graph
        As in `EntityAspectGraph`, except that nodes list lit entities in ``showing`` instead of
        ``observable``. The graph has the attribute ``contrast``, and surfaces may be of type
        ``"L"``.
    regions : LightRegions
        The regions of the entities.
    """

    regions: LightRegions

    _title = "Light graph"

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<LightGraph of {self.solid.name!r}: {self._size}>"

    @property
    def contrast(self) -> float:
        """Least contrast."""
        return self.regions.contrast

    def showing(self, lamps: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Whether lamps, each alone, light entities with contrast; see `LightRegions.showing`.

        Parameters
        ----------
        lamps : array_like, shape (n, 3)
            Positions of the lamps in mm, inside the workspace.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name; False inside the solid.

        Raises
        ------
        WorkspaceError
            If a lamp lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        return self.regions.showing(lamps, names)


def build_light_graph(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    contrast: float = DEFAULT_CONTRAST,
    workspace: ArrayLike | None = None,
    executor: Executor | None = None,
    *,
    min_width_mm: float | None = None,
) -> LightGraph:
    """Build the aspect graph of lamp positions.

    Parameters
    ----------
    solid : Solid
        The part: matt, of one albedo.
    entities : mapping of str to edge id, id of a rim or arc, or pair of points
        The entities to light; see `resolve_entities`.
    contrast : float
        Least contrast (absolute value of `contrast`) between the two faces of an edge, strictly between 0 and 1.
    workspace : array_like, shape (2, 3), optional
        Corners of the space of lamps in mm. Default: the part's box,
        extended by ten diagonals in all directions.
    executor : concurrent.futures.Executor, optional
        Computes the entities' regions in parallel.
    min_width_mm : float, optional
        As in `build_aspect_graph`.

    Returns
    -------
    LightGraph
        Every lamp position outside the solid and off the partition surfaces lies in exactly one
        domain. Its list names exactly the lit entities. Merged slivers are the exception.

    Raises
    ------
    LightError, EntityError, WorkspaceError, WidthError
        For bad input.
    ContradictionError
        If ray casting and exact arbitration refute a domain's list.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid, build_light_graph
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> light = build_light_graph(box, {"top": 1, "side": 2}, contrast=0.2)
    >>> light.graph.nodes[0]["showing"]
    ('top', 'side')
    """
    return light_graph_of(
        compute_light(solid, entities, contrast, workspace, executor), min_width_mm=min_width_mm
    )


def light_graph_of(
    regions: LightRegions,
    names: Sequence[str] | None = None,
    *,
    min_width_mm: float | None = None,
    memory_limit_bytes: float | None = None,
    progress: Progress | None = None,
) -> LightGraph:
    """Build the graph of some entities from light regions already computed; see `build_light_graph`.

    Parameters
    ----------
    regions : LightRegions
        From `compute_light`.
    names : sequence of str, optional
        Names of the entities. Default: all.
    min_width_mm, memory_limit_bytes : float, optional
        As in `build_aspect_graph`.
    progress : callable, optional
        ``progress(done, total, "joint graph")`` after each of the entities.

    Returns
    -------
    LightGraph
        With the guarantee of `build_light_graph`.

    Raises
    ------
    EntityError
        If a name is unknown.
    WidthError
        If `min_width_mm` is out of range.
    MemoryLimitError
        If the graph takes more memory than it may.
    ContradictionError
        If ray casting and exact arbitration refute a domain's list.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import compute_light, light_graph_of
    >>> light = light_graph_of(compute_light(box, {"top": 1, "side": 2}, contrast=0.2))
    >>> light.graph.nodes[0]["showing"]
    ('top', 'side')
    """
    made = graph_of(
        regions,
        names,
        min_width_mm=min_width_mm,
        memory_limit_bytes=memory_limit_bytes,
        progress=progress,
    )
    made.graph.graph["contrast"] = regions.contrast
    return LightGraph(regions.subset(made.entity_names), made.graph, made._cx, made._domains)
