"""What lamps must show besides the faces of an edge: the lines at its corners, and the background behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, islice
from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity import Entity
from planner.detectability.conditions import Detectability
from planner.detectability.corners import FITTED_PX
from planner.detectability.image_check import ImageCheck
from planner.request.part_entities import parts_of
from planner.request.targets import MeasuredPart, targets_of
from planner.verify.simulate_setting import Planned

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.light import LightRegions
    from aspectgraph.solid.solid import RayScene

# How bright edges are, and what a camera sees beside a silhouette: the ground, or a face of the
# part farther away.
#
# Two faces have a contrast though hardly any light falls on either. So the step of their grey
# values must be large enough, too: as a share of the grey value of a face that the lamp lights
# frontally, it is the difference of the cosines of the angles of incidence. This is no plane; it
# is computed for a lamp at a given place, and takes no part in proofs.
#
# Where the edge of a face is seen in front of another face of the part, it shows only if that one
# is brighter or darker by the contrast. This is no wedge: it depends on distances and cast
# shadows. So it is decided by rays at points along the edge, for a lamp at a given place, and
# takes no part in proofs.


Array = NDArray[np.float64]

DEFAULT_STEP = 0.1
"""Twenty grey levels where a face lit frontally has 200: five standard deviations of noise of 1.5 % of 255 levels."""

# points of an edge that are looked beside, and how far: so far that the detector's window is filled
SHARES = np.linspace(0.06, 0.94, 9)
BESIDE_PX = 3.0
# a ray that ends this share before the point has been stopped by something else: from a lamp a metre away by 0.02 mm,
# a hundred times what rounding makes
_SHORT = 2e-5
# rays at a time
_BACKGROUND_BLOCK = 500_000


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
    # nan of what is seen along the direction
    with np.errstate(invalid="ignore"):
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
        sight + BESIDE_PX * pixel_rad * np.linalg.norm(sight, axis=-1, keepdims=True) * aside
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
    for first in range(0, len(lamps), _BACKGROUND_BLOCK):
        block = slice(first, first + _BACKGROUND_BLOCK)
        hidden[block] = (
            scene.cast(lamps[block], points[block] - lamps[block])["t_hit"] < 1.0 - _SHORT
        )
    return hidden


# Which lamps show the other line at each end of an edge, and let no shadow end beside the edge or
# that line.
#
# Where a plan asks for corners, another visible line leaves each end of an edge at an angle. At
# least one such line per end must differ in brightness on its two sides where it leaves. Where it
# asks for separation, no border of a shadow may run beside the edge or that line
# (`planner.light.corner_light`). This is computed for lamps at given places, at points of each
# line with the shadows that rays find, and takes no part in proofs.


# What each setting of a plan asks of its lamp: which edges must show there, and whether as
# creases or silhouettes.


Silhouettes = dict[int, int]


@dataclass(frozen=True)
class Pair:
    """What one setting measures: the light regions that must hold its lamp, and what is behind its silhouettes.

    Attributes
    ----------
    setting : int
        Number of the setting.
    name : str
        What it measures.
    regions : tuple of str
        Names of light regions.
    silhouette : bool
        Whether an edge of it is a silhouette.
    backdrops : tuple of Backdrop
        Behind them, where that is a face of the part.
    """

    setting: int
    name: str
    regions: tuple[str, ...]
    silhouette: bool = False
    backdrops: tuple[Backdrop, ...] = ()


@dataclass
class Demands:
    """All pairs of settings and what they measure, the regions they name, and the edges of those that are lengths."""

    pairs: list[Pair] = field(default_factory=list)
    entities: dict[str, Entity] = field(default_factory=dict)
    silhouettes: dict[str, Silhouettes] = field(default_factory=dict)
    edge_ids: list[tuple[int, ...]] = field(default_factory=list)

    def region(self, name: str, entity: Entity, silhouettes: Silhouettes) -> str:
        """Return the name of a light region, a new one if it was not asked for before."""
        for key, other in self.entities.items():
            if other.edge_ids == entity.edge_ids and self.silhouettes[key] == silhouettes:
                return key
        label = f"{name} {len(self.entities)}"
        # an entity of its own, as a region is found by it
        self.entities[label] = replace(entity, name=label)
        self.silhouettes[label] = silhouettes
        return label


def demands_of(plan: Planned, solid: Solid, scene: RayScene, ground: str) -> Demands:
    """Return what a plan asks of its lamps.

    Parameters
    ----------
    plan : Planned
        The plan.
    solid : Solid
        Its part.
    scene : RayScene
        Of the part.
    ground : str
        "dark" or "bright".

    Returns
    -------
    Demands
        Pairs in the order of the settings.

    Raises
    ------
    RequestError
        If the part lacks an edge, rim or arc of the plan.
    """
    entities: dict[MeasuredPart, tuple[Entity, ...]] = {}
    radius = plan.requirements.get("visibility_radius_mm", 0.0)
    pixel = max(plan.camera.pixel_pitch_mm) / plan.camera.image_distance_mm
    demands = Demands()
    for k, setting in enumerate(plan.settings):
        eye = np.asarray(setting.cam2world, dtype=np.float64)[:3, 3]
        targets = targets_of(plan.targets, setting)
        for name in setting.entities:
            key = MeasuredPart.of(name, setting)
            if key not in entities:
                entities[key] = parts_of(targets[name], solid, name)
            parts = entities[key]
            regions = []
            behind = []
            has_silhouette = False
            for entity in parts:
                for seen in seen_as(solid, entity, eye, radius):
                    surroundings = backdrops(solid, scene, eye, entity, seen, pixel)
                    has_silhouette |= bool(seen)
                    if (
                        seen
                        and ground == "bright"
                        and not surroundings
                        and set(seen) == set(entity.edge_ids)
                    ):
                        # all of it in front of the back light
                        continue
                    behind += surroundings
                    regions.append(demands.region(name, entity, seen))
            demands.pairs.append(
                Pair(k, name, tuple(dict.fromkeys(regions)), has_silhouette, tuple(behind))
            )
            demands.edge_ids.append(parts[0].edge_ids if targets[name].has_corners else ())
    return demands


def seen_as(
    solid: Solid, entity: Entity, eye: NDArray[np.float64], radius_mm: float
) -> Iterator[Silhouettes]:
    """Yield the silhouettes of an entity, once or twice: edge to the face that is seen, from around a camera's place.

    Where the plane of a face passes by the camera within the radius, an edge is taken as a crease and as a silhouette.
    """
    sure: Silhouettes = {}
    open_ones: Silhouettes = {}
    for edge in (solid.edges[i] for i in entity.edge_ids):
        heights = solid.normals[list(edge.faces)] @ (eye - solid.vertices[edge.vertices[0]])
        front = edge.faces[int(heights.argmax())]
        if heights.min() <= -radius_mm:
            sure[edge.id] = front
        elif heights.min() <= radius_mm:
            open_ones[edge.id] = front
    yield sure
    if open_ones:
        yield sure | open_ones


# Under which lamps a border of a shadow runs beside a line in the image, where a detector may
# take it for the line.
#
# A line is found by the strongest grey step within some pixels of where it should be. A part that
# casts a shadow onto the face beside an edge makes another step there, often a stronger one. So
# the surface beside a line is looked at, by rays from the camera, at places up to as many pixels
# away as other lines have to keep: on each side all places must be lit, or none. This is computed
# for lamps at given places and takes no part in proofs.


# places on each side of a point of a line, as shares of how far the last one is: a shadow less than a pixel wide beside
# a line moves its strongest step by as much as that. The first one is a tenth of a pixel away: a lit strip of 0.16 px
# between an edge and a shadow moved the edge by 0.16 px. Rays of lamps at the camera still tell places from the edge
_PLACES = np.array([0.02, 0.07, 0.2, 0.4, 0.6, 0.8, 1.0])
# the place that says which face is meant: nearer ones may be on a face that is seen from its edge
_FACE = 2
# a place on a face that is turned by more, or off the tangent plane by more, is beyond another line of the part
_TURN_DEG = 20.0
_ROUNDING = 1e-5


class SeenLine(NamedTuple):
    """A line in an image: from where it is seen, points of it (n, 3) and its direction (3,); mm."""

    eye: Array
    points: Array
    along: Array


@dataclass(frozen=True)
class Beside:
    """Places on the surface beside lines.

    Attributes
    ----------
    places, normals : array (n, 3)
        In mm, and unit normals towards the camera.
    strip : array of int (n,)
        Number of the strip, from a point of a line to one side, in rising order; all its places are to be alike.
    line : array of int (n,)
        Number of the line, in rising order.
    n_lines : int
        Number of lines.
    """

    places: Array
    normals: Array
    strip: NDArray[np.int_]
    line: NDArray[np.int_]
    n_lines: int

    def clear(self, scene: RayScene, lamps: Array, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return under which lamps (l, n_lines) no shadow ends beside a line; True where that is not wanted.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        lamps : array (l, 3)
            Places of lamps, mm.
        wanted : array of bool (l, n_lines)
            What is asked for.
        """
        is_clear = np.ones((len(lamps), self.n_lines), dtype=bool)
        begin = np.searchsorted(self.line, np.arange(self.n_lines + 1))
        for line in range(self.n_lines):
            of_line = slice(begin[line], begin[line + 1])
            rows = np.flatnonzero(wanted[:, line])
            if rows.size and of_line.stop > of_line.start:
                lit = self._lit(scene, lamps[rows], of_line)
                starts = np.flatnonzero(np.diff(self.strip[of_line], prepend=-1))
                every = np.logical_and.reduceat(lit, starts, axis=1)
                any_lit = np.logical_or.reduceat(lit, starts, axis=1)
                is_clear[rows, line] = (every == any_lit).all(axis=1)
        return is_clear

    def _lit(self, scene: RayScene, lamps: Array, of_line: slice) -> NDArray[np.bool_]:
        places = self.places[of_line]
        normals = self.normals[of_line]
        lit = np.einsum("lpi,pi->lp", lamps[:, None] - places, normals) > 0
        lamp, place = np.nonzero(lit)
        lit[lamp, place] = ~shadowed_each(scene, places[place], lamps[lamp])
        return lit


def beside_lines(
    scene: RayScene, lines: Sequence[SeenLine], reach_px: float, pixel_rad: float
) -> Beside:
    """Return places on the surface beside lines in images.

    Parameters
    ----------
    scene : RayScene
        Of the part.
    lines : sequence of SeenLine
        The lines.
    reach_px : float
        How far beside the line the last place is, px; without it there are none.
    pixel_rad : float
        Angle of a pixel.

    Returns
    -------
    Beside
        Of each strip those that are on the surface next to the line; without those in front of the ground.
    """
    strips_found: list[tuple[Array, Array, NDArray[np.int_]]] = []
    owner: list[NDArray[np.int_]] = []
    strips = 0
    for number, line in enumerate(lines if reach_px > 0 else ()):
        places, normals, strip = _strips(scene, line, reach_px * pixel_rad)
        strips_found.append((places, normals, strip + strips))
        owner.append(np.full(len(places), number))
        strips += 2 * len(line.points)
    if not strips_found:
        return Beside(
            np.empty((0, 3)), np.empty((0, 3)), np.empty(0, int), np.empty(0, int), len(lines)
        )
    places, normals, strip = (np.concatenate(parts) for parts in zip(*strips_found, strict=True))
    return Beside(places, normals, strip, np.concatenate(owner), len(lines))


def _strips(
    scene: RayScene, line: SeenLine, reach_rad: float
) -> tuple[Array, Array, NDArray[np.int_]]:
    """Return places (n, 3), normals (n, 3) and strips (n,) beside a line."""
    sight = line.points - line.eye
    aside = across(sight, line.along) * np.linalg.norm(sight, axis=1, keepdims=True)
    off = reach_rad * _PLACES
    # (points, sides, places, 3)
    rays = (
        sight[:, None, None]
        + np.array([1.0, -1.0])[:, None, None] * off[:, None] * aside[:, None, None]
    )
    hit = scene.cast(line.eye, rays)
    t_hit = hit["t_hit"].astype(np.float64)
    met = np.isfinite(t_hit)
    places = line.eye + np.where(met, t_hit, 1.0)[..., None] * rays
    normals = hit["primitive_normals"].astype(np.float64)
    normals *= np.where((normals * rays).sum(axis=-1) > 0, -1.0, 1.0)[..., None]
    first = normals[:, :, _FACE, None]
    way = places - places[:, :, _FACE, None]
    height = np.abs((way * first).sum(axis=-1))
    distance = np.linalg.norm(way, axis=-1)
    turn = np.radians(_TURN_DEG)
    flat = (
        height <= np.sin(turn) * distance + _ROUNDING * np.linalg.norm(sight, axis=1)[:, None, None]
    )
    same = met & met[:, :, _FACE, None] & flat & ((normals * first).sum(axis=-1) >= np.cos(turn))
    strip = np.broadcast_to(np.arange(2 * len(sight)).reshape(-1, 2, 1), same.shape)
    return places[same], normals[same], strip[same]


# Lamps that are on at the same time: what a set of them makes show, and the fewest that show all
# of a plan.
#
# Under several lamps, irradiances add up. The contrast of an edge is then the mean of those under
# each lamp, weighted by how bright it makes the edge, so it changes along the edge and is no
# wedge. It is computed at nine points of every edge, with the shadows that rays find, for lamps
# of one strength: once with the fall of light with distance, once without, and the smaller one
# counts.
#
# The mean is never larger than the largest of its parts. So an edge that no lamp gives the
# contrast asked for cannot have it under all of them.


Besides = Callable[[Array, NDArray[np.int_]], NDArray[np.bool_]]

# sets that are tried, of one size after the other
_MOST_SETS = 60_000
# numbers (sets x sites) at a time
_BLOCK = 4_000_000


@dataclass(frozen=True)
class Sites:
    """Places of faces (n, 3) with normals that light falls on, and which two of them are compared for which pair.

    Attributes
    ----------
    points, normals : array (n, 3)
        Places, mm, and outward unit normals.
    compared : array of int (m, 2)
        Numbers of the two sites; the second is -1 for the dark ground.
    pair : array of int (m,)
        For which pair, in rising order.
    n_pairs : int
        Number of pairs; those without a comparison show under any lamps.
    """

    points: Array
    normals: Array
    compared: NDArray[np.int_]
    pair: NDArray[np.int_]
    n_pairs: int


def sites_of(light: LightRegions | None, pairs: Sequence[Pair]) -> Sites:
    """Return what is compared so that pairs show: both faces of a crease, or what is beside a silhouette.

    Parameters
    ----------
    light : LightRegions or None
        Has the regions that the pairs name; None if they name none.
    pairs : sequence of Pair
        Of a plan.

    Returns
    -------
    Sites
        Every site once.
    """
    numbers: dict[bytes, int] = {}
    places: list[Array] = []
    compared = []
    owner = []

    def number(point: Array, normal: Array) -> int:
        site = np.concatenate([point, normal])
        index = numbers.setdefault(site.tobytes(), len(places))
        if index == len(places):
            places.append(site)
        return index

    for k, pair in enumerate(pairs):
        both = (
            [side for name in pair.regions for side in _sides(light, name)]
            if light is not None
            else []
        )
        both += [first.sides for first in pair.backdrops]
        for first, other in both:
            compared.append((number(*first), -1 if other is None else number(*other)))
            owner.append(k)
    sides = np.array(places).reshape(-1, 6)
    return Sites(
        sides[:, :3],
        sides[:, 3:],
        np.array(compared, int).reshape(-1, 2),
        np.array(owner, int),
        len(pairs),
    )


_Side = tuple[Array, Array]


def _sides(light: LightRegions, name: str) -> Iterator[tuple[_Side, _Side | None]]:
    solid = light.solid
    silhouettes = light.silhouettes.get(name, {})
    for edge in (solid.edges[i] for i in light.entities[name].edge_ids):
        start, end = solid.vertices[list(edge.vertices)]
        for point in start + SHARES[:, None] * (end - start):
            if edge.id in silhouettes:
                yield (point, solid.normals[silhouettes[edge.id]]), None
            else:
                first, other = edge.faces
                yield (point, solid.normals[first]), (point, solid.normals[other])


class LampSets:
    """Sets of lamps, all on, over some places.

    Parameters
    ----------
    scene : RayScene
        Of the part.
    sites : Sites
        What is compared.
    places : array (n, 3)
        Of the lamps, mm.
    offsets : array (k, 3)
        Places of a lamp relative to where it should be, mm; each may be at any of them.
    besides : callable, optional
        ``besides(places, sets)`` returns which pairs (n, pairs) meet what else is asked of them.
    """

    def __init__(
        self,
        scene: RayScene,
        sites: Sites,
        places: Array,
        offsets: Array,
        besides: Besides | None = None,
    ) -> None:
        self._sites = sites
        self.n = len(places)
        self._places = places
        self._besides = besides
        # (with the fall of light and without, lamps, sites), at least and at most
        self._low = self._high = np.stack(_irradiances(scene, sites, places + offsets[0]))
        for off in offsets[1:]:
            now = np.stack(_irradiances(scene, sites, places + off))
            self._low = np.minimum(self._low, now)
            self._high = np.maximum(self._high, now)
        self.n_pairs = sites.n_pairs

    def shown(self, sets: NDArray[np.int_]) -> tuple[Array, Array]:
        """Return least contrast and step (n, pairs) under sets (n, size) of lamps that are on together.

        The step is a share of the grey value of a face that all of them light frontally, falls of light aside.
        """
        n, size = sets.shape
        contrast, step = np.ones((2, n, self.n_pairs))
        block = max(1, _BLOCK // max(1, size * len(self._sites.compared)))
        for first in range(0, n, block):
            block_of_sets = slice(first, first + block)
            contrast[block_of_sets], step[block_of_sets] = self._shown(sets[block_of_sets])
        if self._besides is not None:
            rows = np.flatnonzero((contrast > 0).any(axis=1))
            contrast[rows] *= self._besides(self._places, sets[rows])
        return contrast, step

    def _shown(self, sets: NDArray[np.int_]) -> tuple[Array, Array]:
        sites = self._sites
        contrast, step = np.ones((2, len(sets), sites.n_pairs))
        if not len(sites.compared):
            return contrast, step
        values = [_compared(low, high, sites.compared) for low, high in self._sums(sets)]
        (falling, _), (even, steps) = values
        same = falling * even > 0
        weaker = np.where(same, np.minimum(np.abs(falling), np.abs(even)), 0.0)
        owners, starts = np.unique(sites.pair, return_index=True)
        contrast[:, owners] = np.minimum.reduceat(weaker, starts, axis=1)
        step[:, owners] = np.minimum.reduceat(steps / sets.shape[1], starts, axis=1)
        return contrast, step

    def _sums(self, sets: NDArray[np.int_]) -> Iterator[tuple[Array, Array]]:
        for low, high in zip(self._low, self._high, strict=True):
            yield low[sets].sum(axis=1), high[sets].sum(axis=1)


def _irradiances(scene: RayScene, sites: Sites, places: Array) -> tuple[Array, Array]:
    """Return irradiances (lamps, sites) with the fall of light, and cosines without it; 0 in the shadow."""
    cosine, falling = np.zeros((2, len(places), len(sites.points)))
    for k, (point, normal) in enumerate(zip(sites.points, sites.normals, strict=True)):
        cosine[:, k], distance = incidence(point, normal, places)
        lit = np.flatnonzero(cosine[:, k])
        cosine[lit[shadowed(scene, point, places[lit])], k] = 0.0
        falling[:, k] = cosine[:, k] / distance**2
    return falling, cosine


def _compared(low: Array, high: Array, compared: NDArray[np.int_]) -> tuple[Array, Array]:
    """Return contrasts (n, m), with a sign, and differences of two sites, both the nearest to 0 between the limits.

    (a - b) / (a + b) rises with a and falls with b.
    """
    first, other = compared.T
    dark = other < 0
    a = low[:, first]
    a_most = high[:, first]
    b = np.where(dark, 0.0, low[:, other])
    b_most = np.where(dark, 0.0, high[:, other])
    brighter = a > b_most
    darker = a_most < b
    near = np.where(brighter, a - b_most, np.where(darker, a_most - b, 0.0))
    total = np.where(brighter, a + b_most, a_most + b)
    return near / np.where(total > 0, total, 1.0), np.abs(near)


@dataclass(frozen=True)
class Fewest:
    """The fewest lamps that show the most.

    Attributes
    ----------
    chosen : tuple of int
        Numbers of the lamps.
    contrast : array (pairs,)
        0 for what they do not show.
    listed : int
        All sets of up to so many lamps were tried.
    """

    chosen: tuple[int, ...]
    contrast: Array
    listed: int


def fewest_together(sets: LampSets, least: float, least_step: float) -> Fewest:
    """Return the fewest lamps that make the most pairs show at once; among those, the ones with the largest step.

    Sets of one size after the other are tried, all of them while there are few enough; after that, the best ones of a
    size are made larger by each lamp in turn.

    Parameters
    ----------
    sets : LampSets
        The lamps.
    least, least_step : float
        Contrast and step that are needed to show.

    Returns
    -------
    Fewest
        The same for the same arguments.
    """
    n_pairs = sets.n_pairs
    best = Fewest((), np.zeros(n_pairs), 0)
    most_shown = 0
    listed = 0
    wide: list[tuple[int, ...]] = [()]
    for size in range(1, sets.n + 1):
        if listed == size - 1 and comb(sets.n, size) <= _MOST_SETS:
            tried = np.array(list(combinations(range(sets.n), size)))
            listed = size
        else:
            larger = sorted(
                {
                    tuple(sorted((*members, k)))
                    for members in wide
                    for k in range(sets.n)
                    if k not in members
                }
            )
            tried = np.array(list(islice(larger, _MOST_SETS)))
        contrast, step = sets.shown(tried)
        shows = (contrast >= least) & (step >= least_step)
        n_shown = shows.sum(axis=1)
        margin = np.where(shows, step, 1.0).min(axis=1, initial=1.0)
        order = np.lexsort((-margin, -n_shown))
        top = int(order[0])
        if n_shown[top] > most_shown:
            most_shown = int(n_shown[top])
            best = Fewest(
                tuple(map(int, tried[top])), np.where(shows[top], contrast[top], 0.0), listed
            )
        if most_shown == n_pairs:
            break
        wide = [tuple(map(int, tried[i])) for i in order[: max(1, _MOST_SETS // (10 * sets.n))]]
    return Fewest(best.chosen, best.contrast, listed)


# a line is looked at from so near to the corner, px, to no farther than this share of it
_FROM_PX = 4.0
_SHARE = 0.9
# every 3 px: shadows of a few pixels end beside a corner
_POINTS = 9


@dataclass(frozen=True)
class Corners:
    """Lines that leave the ends of what is measured.

    Attributes
    ----------
    sites : Sites
        Both sides of each line, whose number takes the place of the pair's.
    end : array of int (a,)
        For each line, the number of the end that it leaves.
    pair : array of int (e,)
        For each end, the pair it belongs to.
    beside : Beside, optional
        Places beside these lines.
    beside_edges : Beside, optional
        Places beside the edges of each pair.
    """

    sites: Sites
    end: NDArray[np.int_]
    pair: NDArray[np.int_]
    beside: Beside | None = None
    beside_edges: Beside | None = None

    def shown(
        self,
        scene: RayScene,
        places: Array,
        sets: NDArray[np.int_],
        limits: tuple[float, float],
        wanted: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Return which of the wanted pairs (sets, n) have lines that show at both ends, and no shadow beside them.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        places : array (p, 3)
            Of lamps, mm.
        sets : array of int (s, size)
            Numbers of the lamps that are on.
        limits : tuple of float
            Least contrast and step.
        wanted : array of bool (s, n)
            Pairs that are asked for.
        """
        shown = wanted.copy()
        if self.beside_edges is not None:
            shown &= _clear(self.beside_edges, scene, places, sets, shown)
        if not len(self.pair):
            return shown
        contrast, step = LampSets(scene, self.sites, places, np.zeros((1, 3))).shown(sets)
        shows = (contrast >= limits[0]) & (step >= limits[1]) & shown[:, self.pair[self.end]]
        if self.beside is not None:
            shows &= _clear(self.beside, scene, places, sets, shows)
        ends = np.zeros((len(sets), len(self.pair)), dtype=bool)
        for line, end in enumerate(self.end.tolist()):
            ends[:, end] |= shows[:, line]
        for end, pair in enumerate(self.pair.tolist()):
            shown[:, pair] &= ends[:, end]
        return shown


def _clear(
    beside: Beside,
    scene: RayScene,
    places: Array,
    sets: NDArray[np.int_],
    wanted: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return whether no lamp of a set (sets, lines) ends a shadow beside lines, for those that are wanted."""
    asked_of_lamps = np.zeros((len(places), beside.n_lines), dtype=bool)
    for lamps in sets.T:
        np.logical_or.at(asked_of_lamps, lamps, wanted)
    return np.asarray(beside.clear(scene, places, asked_of_lamps)[sets].all(axis=1))


def corners_of(
    plan: Planned,
    solid: Solid,
    scene: RayScene,
    names: Sequence[tuple[int, str]],
    edge_ids: Sequence[Sequence[int]],
) -> Corners:
    """Return the lines that leave the ends of edges in the images of a plan, and what is beside lines and edges.

    Parameters
    ----------
    plan : Planned
        The plan; if it asks for neither corners nor separation, there is nothing.
    solid : Solid
        Its part.
    scene : RayScene
        Of the part.
    names : sequence of (int, str)
        Setting and name of each pair.
    edge_ids : sequence of (sequence of int)
        The edges of each pair; none where it has no ends.

    Returns
    -------
    Corners
        With the lines that a corner may be fitted with; an end that has none is left out.
    """
    separation = plan.requirements.get("separation_px", 0.0)
    poses = _poses_of(plan)
    pixel = max(plan.camera.pixel_pitch_mm) / plan.camera.image_distance_mm
    edges = _seen_edges(solid, poses, names, edge_ids, separation > 0)
    beside_edges = beside_lines(scene, edges, separation, pixel)
    at_ends = corner_lines_of(plan, solid, names, edge_ids)
    sites = []
    lines = []
    for line in at_ends:
        points = points_of_arm(line.corner, line.tip, line.eye, pixel)
        sites.append(_compared_of_corner_light(solid, scene, line.edge_id, points, line.eye, pixel))
        lines.append(SeenLine(line.eye, points, line.tip - line.corner))
    beside = beside_lines(scene, lines, separation, pixel)
    used, end = np.unique([line.end for line in at_ends], return_inverse=True)
    pair_of = {line.end: line.pair for line in at_ends}
    pair = np.array([pair_of[number] for number in used.tolist()], dtype=int)
    return Corners(_joined(sites), end, pair, beside, beside_edges)


class CornerLine(NamedTuple):
    """A line in an image that leaves an end of a length.

    Attributes
    ----------
    pair : int
        Number of the length among those that were asked about.
    end : int
        Number of the end, a different one for each end of each length.
    edge_id : int
        The edge of the line.
    corner, tip : array (3,)
        From where to where it is seen, mm.
    eye : array (3,)
        Place of the camera, mm.
    """

    pair: int
    end: int
    edge_id: int
    corner: Array
    tip: Array
    eye: Array


def corner_lines_of(
    plan: Planned,
    solid: Solid,
    names: Sequence[tuple[int, str]],
    edge_ids: Sequence[Sequence[int]],
    *,
    only_outlines: bool = False,
) -> list[CornerLine]:
    """Return the lines that leave the ends of lengths in the images of a plan; none if it asks for no corners.

    Parameters
    ----------
    plan, solid, names, edge_ids
        As `corners_of` takes them.
    only_outlines : bool
        See `PartLines`.
    """
    required = plan.requirements
    required_deg = required.get("min_corner_deg", 0.0)
    poses = _poses_of(plan)
    numbers = np.flatnonzero([bool(ids) and required_deg > 0 for ids in edge_ids])
    ends = np.array([plan.targets[names[k][1]].ends for k in numbers.tolist()], np.float64).reshape(
        -1, 2, 3
    )
    image = ImageCheck(
        solid,
        [edge_ids[k] for k in numbers.tolist()],
        ends,
        plan.camera,
        Detectability(required.get("separation_px", 0.0), 0.0, required_deg),
        only_outlines=only_outlines,
    )
    pairs = np.array([(names[k][0], i) for i, k in enumerate(numbers.tolist())], np.int64).reshape(
        -1, 2
    )
    seen = image.corner_lines(poses, pairs)
    arms = image.arms
    lines = []
    for a, end in zip(seen.arm.tolist(), seen.of.tolist(), strict=True):
        setting, number = pairs[end // 2].tolist()
        edge_id = int(image.contours.ids[arms.contour[a]])
        eye = poses[setting, :3, 3]
        lines.append(
            CornerLine(int(numbers[number]), end, edge_id, arms.corner[a], arms.tip[a], eye)
        )
    return lines


def _poses_of(plan: Planned) -> Array:
    """Return the poses of a plan (n, 4, 4)."""
    poses = [np.asarray(setting.cam2world) for setting in plan.settings]
    return np.array(poses, np.float64).reshape(-1, 4, 4)


def _seen_edges(
    solid: Solid,
    poses: Array,
    names: Sequence[tuple[int, str]],
    edge_ids: Sequence[Sequence[int]],
    asked: bool,
) -> list[SeenLine]:
    """Return a line for each pair, all of whose edges are in one line; without points where there is none."""
    lines = []
    for (setting, _), edges in zip(names, edge_ids, strict=True):
        points = np.empty((0, 3))
        along = np.array([1.0, 0.0, 0.0])
        for edge in edges if asked else ():
            start, end = solid.vertices[list(solid.edges[edge].vertices)]
            points = np.concatenate([points, start + SHARES[:, None] * (end - start)])
            along = end - start
        lines.append(SeenLine(poses[setting, :3, 3], points, along))
    return lines


_Pair = tuple[tuple[Array, Array], tuple[Array, Array] | None]


def points_of_arm(corner: Array, tip: Array, eye: Array, pixel_rad: float) -> Array:
    """Return points (n, 3) of a line near a corner."""
    length = float(np.linalg.norm(tip - corner))
    pixel = float(np.linalg.norm(corner - eye)) * pixel_rad
    last = min(FITTED_PX * pixel, _SHARE * length)
    steps = np.linspace(min(_FROM_PX * pixel, last / 2), last, _POINTS)
    return np.asarray(corner + steps[:, None] * (tip - corner) / length)


def _compared_of_corner_light(
    solid: Solid, scene: RayScene, edge_id: int, points: Array, eye: Array, pixel_rad: float
) -> list[_Pair]:
    """Return what is compared at points of a line: both faces, or the seen one with what is behind."""
    edge = solid.edges[edge_id]
    normals = solid.normals[list(edge.faces)]
    front = normals @ (eye - points[0]) > 0
    if front.all():
        return [((point, normals[0]), (point, normals[1])) for point in points]
    along = np.subtract(*solid.vertices[list(edge.vertices)])
    seen = int(front.argmax())
    places, behind = seen_beside(scene, eye, points, (along, normals[1 - seen]), pixel_rad)
    met = np.isfinite(places[:, 0])
    return [
        ((points[i], normals[seen]), (places[i], behind[i]) if met[i] else None)
        for i in range(len(points))
    ]


def _joined(arms: Sequence[Sequence[_Pair]]) -> Sites:
    places: list[Array] = []
    compared = []
    owner = []
    for k, arm in enumerate(arms):
        for first_side, second_side in arm:
            first = len(places)
            places.append(np.concatenate(first_side))
            if second_side is not None:
                places.append(np.concatenate(second_side))
            compared.append((first, -1 if second_side is None else first + 1))
            owner.append(k)
    sides = np.array(places).reshape(-1, 6)
    return Sites(
        sides[:, :3],
        sides[:, 3:],
        np.array(compared, int).reshape(-1, 2),
        np.array(owner, int),
        len(arms),
    )
