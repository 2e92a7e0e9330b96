"""How bright places of a part are under a light of some extent: matt or metal, with shadows and light between faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import log2
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ground.convert import Meta
from planner.argument_kinds import NumberRule, check_number
from planner.exceptions import RequestError

if TYPE_CHECKING:
    from aspectgraph.solid.solid import RayScene

# Notation. A place p with unit normal n is seen along the unit vector v, from p to the camera. Light of radiance L
# comes to it along l, from p to the light. The place then has the radiance
#
#     B(p) = ∫ f(n, v, l) L(p, l) (n·l) dl
#
# over the half sphere above n. L is 1 where l meets the light and nothing is between, otherwise it is what the face
# that l meets reflects. So B is 1 for a matt face that sees nothing but the light. It is the same for metal.
#
# The integral is a mean over directions of two kinds (Veach, Robust Monte Carlo Methods, 1997, section 9.2.4, the
# balance heuristic): to points of the light, and as the surface scatters. Directions follow a Sobol sequence, the same
# for each place, so there is no random number.

Array = NDArray[np.float64]

ROUGHNESS = 0.3
"""Roughness of milled or blasted metal."""

_ROUGHNESS_RULE = NumberRule("must be in [0.02, 1]", lambda number: 0.02 <= number <= 1)
_KINDS = ("matt", "metal")
# what a face reflects of the light of another face: painted or blasted parts, and steel or aluminium
_REFLECTANCE = {"matt": 0.5, "metal": 0.7}
# of the light and of the surface, two numbers each
_NUMBERS = 4
# a ray starts this share of its way to the camera above the face
_LIFT = 1e-5
# a point of the light is reached if nothing is met before this share of the way
_NEARLY = 1 - 1e-4
# paths at a time, whose numbers stay in the cache of a core
_BLOCK = 20_000
_TINY = 1e-12

RAYS = 256
"""Directions of each kind from a place: B is then within 0.02 of its limit, see the tests."""

BOUNCES = 2
"""Light that more faces than these hand on is left out; 2 leave out 3 % in a bore as deep as wide, of metal."""


@dataclass(frozen=True)
class Material:
    """How a part reflects light.

    Parameters
    ----------
    kind : str
        "matt": light leaves a face alike in all directions (Lambert). "metal": it leaves around the
        direction of the mirror image.
    roughness : float
        Of metal, from 0.02 (nearly a mirror) to 1: the parameter alpha of the GGX distribution of
        Walter et al. (2007). It is the ``alpha`` of mitsuba's ``roughconductor``, and the square of
        what many rendering programs call roughness.

    Raises
    ------
    RequestError
        If the kind is unknown, or the roughness is out of its range.

    Examples
    --------
    >>> from planner.light.reflection import Material
    >>> str(Material("metal", 0.2))
    'metal of roughness 0.2'
    """

    kind: Annotated[Literal["matt", "metal"], Meta(title="must be matt or metal")] = "matt"
    roughness: float = ROUGHNESS

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise RequestError.of_rule("material", "must be matt or metal", repr(self.kind))
        check_number("roughness", self.roughness, _ROUGHNESS_RULE)

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        return self.kind if self.kind == "matt" else f"metal of roughness {self.roughness:g}"

    @property
    def reflectance(self) -> float:
        """Share of the light of other faces that a face hands on."""
        return _REFLECTANCE[self.kind]

    def scattered(self, normals: Array, views: Array, ways: Array) -> tuple[Array, Array]:
        """Return how much light of a direction leaves to the viewer.

        Parameters
        ----------
        normals, views, ways : array (n, 3)
            Unit vectors n, v and l.

        Returns
        -------
        tuple of array (n,)
            f (n·l), 1/sr, and the density with which `drawn` draws l, 1/sr.
        """
        cosine = np.maximum(_dots(normals, ways), 0.0)
        if self.kind == "matt":
            return cosine / np.pi, cosine / np.pi
        seen = np.maximum(_dots(normals, views), _TINY)
        half = views + ways
        half /= np.maximum(_lengths(half)[:, None], _TINY)
        facets = self._facets(_dots(normals, half))
        density = np.where(cosine > 0, facets * self._uncovered(seen) / (4 * seen), 0.0)
        return density * self._uncovered(np.maximum(cosine, _TINY)), density

    def drawn(self, normals: Array, views: Array, numbers: Array) -> tuple[Array, Array]:
        """Return directions of light as the surface scatters it.

        Parameters
        ----------
        normals, views : array (n, 3)
            Unit vectors n and v.
        numbers : array (n, 2)
            In [0, 1).

        Returns
        -------
        tuple of array
            Unit vectors l (n, 3), and f (n·l) over their density (n,), 0 below the face.
        """
        first, second = _tangents(normals)
        if self.kind == "matt":
            radius = np.sqrt(numbers[:, 0])
            local = np.column_stack([radius, radius, np.sqrt(1 - numbers[:, 0])])
            local[:, 0] *= np.cos(2 * np.pi * numbers[:, 1])
            local[:, 1] *= np.sin(2 * np.pi * numbers[:, 1])
            factor = np.ones(len(local))
            return _combined(local, first, second, normals), factor
        local_views = np.stack([_dots(axis, views) for axis in (first, second, normals)], 1)
        facets = _combined(
            _visible_facets(local_views, self.roughness, numbers), first, second, normals
        )
        ways = 2 * _dots(views, facets)[:, None] * facets - views
        cosine = _dots(ways, normals)
        return ways, np.where(cosine > 0, self._uncovered(np.maximum(cosine, _TINY)), 0.0)

    def _facets(self, cosine: Array) -> Array:
        """Return how many facets have an angle to the normal: D of GGX, 1/sr (Walter et al. 2007, equation 33)."""
        square = self.roughness**2
        return np.where(cosine > 0, square / (np.pi * (cosine**2 * (square - 1) + 1) ** 2), 0.0)

    def _uncovered(self, cosine: Array) -> Array:
        """Return the share of facets that others do not cover, G1 of Smith for GGX (the same, equation 34)."""
        tangent2 = np.maximum(1 / cosine**2 - 1, 0.0)
        return 2 / (1 + np.sqrt(1 + self.roughness**2 * tangent2))


# sums along an axis of three numbers take numpy several times as long as three products
def _dots(first: Array, second: Array) -> Array:
    """Return the products of vectors (n, 3), (n,)."""
    return np.asarray(
        first[:, 0] * second[:, 0] + first[:, 1] * second[:, 1] + first[:, 2] * second[:, 2]
    )


def _lengths(vectors: Array) -> Array:
    """Return the lengths of vectors (n, 3), (n,)."""
    return np.sqrt(_dots(vectors, vectors))


def _tangents(normals: Array) -> tuple[Array, Array]:
    """Return two unit vectors at right angles to normals (Duff et al., Orthonormal Basis, Revisited, 2017)."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x**2 * a, sign * b, -sign * x], axis=1)
    return first, np.stack([b, sign + y**2 * a, -y], axis=1)


def _combined(local: Array, first: Array, second: Array, normals: Array) -> Array:
    return local[:, :1] * first + local[:, 1:2] * second + local[:, 2:] * normals


def _visible_facets(views: Array, roughness: float, numbers: Array) -> Array:
    """Return normals of facets (n, 3) as the viewer sees them; views are in the frame of the face.

    Heitz, Sampling the GGX Distribution of Visible Normals (2018).
    """
    stretched = views * np.array([roughness, roughness, 1.0])
    stretched /= _lengths(stretched)[:, None]
    flat = stretched[:, 0] ** 2 + stretched[:, 1] ** 2
    length = np.sqrt(np.maximum(flat, _TINY))
    along = flat > _TINY
    first = np.zeros_like(views)
    first[:, 0] = np.where(along, -stretched[:, 1] / length, 1.0)
    first[:, 1] = np.where(along, stretched[:, 0] / length, 0.0)
    second = np.cross(stretched, first)
    radius = np.sqrt(numbers[:, 0])
    x = radius * np.cos(2 * np.pi * numbers[:, 1])
    y = radius * np.sin(2 * np.pi * numbers[:, 1])
    # the half of the disc that lies away from the viewer is seen shortened
    share = 0.5 * (1 + stretched[:, 2])
    y = (1 - share) * np.sqrt(np.maximum(1 - x**2, 0.0)) + share * y
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0.0))
    facets = _combined(np.stack([x, y, z], axis=1), first, second, stretched)
    facets[:, :2] *= roughness
    facets[:, 2] = np.maximum(facets[:, 2], 0.0)
    return np.asarray(facets / _lengths(facets)[:, None])


class AreaEmitter(Protocol):
    """A surface in space that shines with radiance 1."""

    @property
    def area_mm2(self) -> float:
        """Area that `points` are spread over."""

    def points(self, numbers: Array) -> Array:
        """Return points (n, 3), mm, spread evenly by numbers (n, 2) in [0, 1)."""

    def met(self, origins: Array, ways: Array) -> tuple[Array, Array]:
        """Return where rays meet it, mm, inf if they do not, and the cosine to its normal, 0 where it is dark; (n,).

        Parameters
        ----------
        origins, ways : array (n, 3)
            Starts of rays, mm, and unit vectors.
        """


@dataclass(frozen=True)
class CarriedEmitter:
    """A light that several cameras carry: each point or ray has to do with that of one camera.

    Parameters
    ----------
    emitter : AreaEmitter
        In the camera's frame.
    poses : array (n, 4, 4)
        Pose of the camera of each, camera to world.
    """

    emitter: AreaEmitter
    poses: Array

    @property
    def area_mm2(self) -> float:
        """Area that `points` are spread over."""
        return self.emitter.area_mm2

    def of(self, which: NDArray[np.int_]) -> CarriedEmitter:
        """Return the lights of some of the cameras (k,), in that order."""
        return CarriedEmitter(self.emitter, self.poses[which])

    def placed(self, local: Array) -> Array:
        """Return where points (n, 3) of the camera's frame are, mm."""
        turned = np.einsum("nij,nj->ni", self.poses[:, :3, :3], local)
        return np.asarray(self.poses[:, :3, 3] + turned)

    def met(self, origins: Array, ways: Array) -> tuple[Array, Array]:
        """Return where rays (n, 3) meet the light, and the cosine there."""
        turns = self.poses[:, :3, :3]
        local = np.einsum("nji,nj->ni", turns, origins - self.poses[:, :3, 3])
        return self.emitter.met(local, np.einsum("nji,nj->ni", turns, ways))


def _light_of(
    light: AreaEmitter | CarriedEmitter, places: NDArray[np.int_]
) -> AreaEmitter | CarriedEmitter:
    """Return the light of places with these numbers."""
    return light.of(places) if isinstance(light, CarriedEmitter) else light


def _points_of(light: AreaEmitter | CarriedEmitter, numbers: Array, row: NDArray[np.int_]) -> Array:
    """Return a point (n, 3) of the light for each row (n,) of numbers (k, 2), mm; many share a row."""
    if isinstance(light, CarriedEmitter):
        return light.placed(light.emitter.points(numbers)[row])
    return light.points(numbers)[row]


class Places(NamedTuple):
    """Places of faces (n, 3), mm, their unit normals towards the camera, and unit vectors to the camera."""

    points: Array
    normals: Array
    views: Array


def brightness(
    scene: RayScene,
    light: AreaEmitter | CarriedEmitter,
    places: Places,
    material: Material,
    rays: int = RAYS,
    bounces: int = BOUNCES,
) -> Array:
    """Return how bright places look to the camera, as a share of the light's own brightness.

    The ground beside the part reflects nothing, and faces of the part lose nothing at the first
    reflection: a matt face that sees nothing but the light has 1.

    Parameters
    ----------
    scene : RayScene
        Of the part.
    light : AreaEmitter or CarriedEmitter
        The light, or the n lights of as many cameras.
    places : Places
        n places.
    material : Material
        Of the part.
    rays : int
        Directions from each place: rounded up to a power of 2.
    bounces : int
        How many faces may hand light on before.

    Returns
    -------
    array, shape (n,)
        The same for the same arguments.
    """
    total = np.zeros(len(places.points))
    if not len(total):
        return total
    numbers = _numbers(rays, bounces)
    first_row = np.zeros(1, np.int_)
    middle = _points_of(_light_of(light, first_row), np.full((1, 2), 0.5), first_row)
    lift = _LIFT * float(np.linalg.norm(middle - places.points[:1]))
    size = max(1, _BLOCK // len(numbers))
    for first in range(0, len(total), size):
        block = slice(first, first + size)
        part = Places(*(values[block] for values in places))
        of_block = _light_of(light, np.arange(len(total))[block])
        total[block] = _brightness(scene, of_block, part, material, numbers, lift)
    return total


@cache
def _numbers(rays: int, bounces: int) -> Array:
    """Return rows of numbers in [0, 1), `_NUMBERS` for each reflection: points of a Sobol sequence."""
    power = max(0, int(np.ceil(log2(rays))))
    # takes longer to load than all else of a small plan, and few need it
    from scipy.stats import qmc

    sobol = qmc.Sobol(_NUMBERS * (bounces + 1), scramble=False).random_base2(power)
    return np.asarray((sobol + 0.5 / 2**power) % 1.0, dtype=np.float64)


@dataclass
class _Paths:
    """Paths of light, from the camera backwards: where each is, and what share of the light there it hands on."""

    points: Array
    normals: Array
    views: Array
    share: Array
    owner: NDArray[np.int_]
    row: NDArray[np.int_]

    def some(self, which: NDArray[np.bool_]) -> _Paths:
        return _Paths(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def _brightness(
    scene: RayScene,
    light: AreaEmitter | CarriedEmitter,
    places: Places,
    material: Material,
    numbers: Array,
    lift: float,
) -> Array:
    n = len(places.points)
    rows = len(numbers)
    paths = _Paths(
        np.repeat(places.points, rows, axis=0),
        np.repeat(places.normals, rows, axis=0),
        np.repeat(places.views, rows, axis=0),
        np.full(n * rows, 1 / rows),
        np.repeat(np.arange(n), rows),
        np.tile(np.arange(rows), n),
    )
    total = np.zeros(n)
    for depth in range(numbers.shape[1] // _NUMBERS):
        to_light, on_surface = np.split(
            numbers[:, _NUMBERS * depth : _NUMBERS * (depth + 1)], [2], 1
        )
        starts = paths.points + lift * paths.normals
        near = _light_of(light, paths.owner)
        direct = _to_light(scene, near, paths, starts, material, to_light)
        scattered, paths_on = _scattered(scene, near, paths, starts, material, on_surface)
        total += np.bincount(paths.owner, paths.share * (direct + scattered), minlength=n)
        paths = paths_on
    return total


def _to_light(
    scene: RayScene,
    light: AreaEmitter | CarriedEmitter,
    paths: _Paths,
    starts: Array,
    material: Material,
    numbers: Array,
) -> Array:
    """Return what points of the light give each path, (n,)."""
    way = _points_of(light, numbers, paths.row) - starts
    way /= np.maximum(_lengths(way)[:, None], _TINY)
    distance, shining = light.met(starts, way)
    value, density = material.scattered(paths.normals, paths.views, way)
    useful = np.flatnonzero((value > 0) & (shining > 0))
    radiance = np.zeros(len(starts))
    reach = distance[useful, None] * way[useful]
    free = ~scene.blocked(starts[useful], reach, _NEARLY)
    useful = useful[free]
    of_light = distance[useful] ** 2 / (light.area_mm2 * shining[useful])
    radiance[useful] = value[useful] / (of_light + density[useful])
    return radiance


def _scattered(
    scene: RayScene,
    light: AreaEmitter | CarriedEmitter,
    paths: _Paths,
    starts: Array,
    material: Material,
    numbers: Array,
) -> tuple[Array, _Paths]:
    """Return what the light gives each path (n,) along the way that the surface scatters, and the paths that go on."""
    way, factor = material.drawn(paths.normals, paths.views, numbers[paths.row])
    hit = scene.cast(starts, way)
    depth = hit["t_hit"].astype(np.float64)
    distance, shining = light.met(starts, way)
    lit = (factor > 0) & (shining > 0) & (distance < depth)
    density = material.scattered(paths.normals, paths.views, way)[1]
    of_light = np.zeros(len(starts))
    of_light[lit] = distance[lit] ** 2 / (light.area_mm2 * shining[lit])
    radiance = np.where(lit, factor * density / np.maximum(of_light + density, _TINY), 0.0)
    on = (factor > 0) & np.isfinite(depth) & (depth < distance)
    following = paths.some(on)
    following.points = starts[on] + depth[on, None] * way[on]
    normals = hit["primitive_normals"][on].astype(np.float64)
    normals *= np.where(_dots(normals, way[on]) > 0, -1.0, 1.0)[:, None]
    following.normals = normals
    following.views = -way[on]
    following.share = paths.share[on] * factor[on] * material.reflectance
    return radiance, following


# Small lamps on metal.


@dataclass(frozen=True)
class Glare:
    """Places of metal beside edges, where a camera may see the mirror images of lamps.

    Attributes
    ----------
    places : Places
        n places.
    owner : array (n,)
        Number of what each belongs to.
    roughness : float
        Of the metal.
    """

    places: Places
    owner: NDArray[np.int_]
    roughness: float

    def meets(self, lamps: Array, n_owners: int) -> NDArray[np.bool_]:
        """Return beside what (k, n_owners) the image of a lamp lies, of lamps at places (k, 3), mm.

        The image is as wide as the lobe: facets half way between camera and lamp are at least a quarter
        as frequent as those along the face. For GGX, their angle to the normal has a tangent up to alpha.
        Nothing is taken to be between lamp and face.
        """
        met = np.zeros((len(lamps), n_owners), dtype=bool)
        for point, normal, view, owner in zip(*self.places, self.owner, strict=True):
            way = lamps - point
            way /= np.maximum(_lengths(way)[:, None], _TINY)
            half = way + view
            cosine = half @ normal / np.maximum(np.linalg.norm(half, axis=1), _TINY)
            near = cosine > 1 / np.hypot(1.0, self.roughness)
            met[:, owner] |= near & (way @ normal > 0)
        return met


# Surfaces that shine.


@dataclass(frozen=True)
class Cap:
    """The inside of a sphere on one side of a plane, with a round dark hole at its top.

    Parameters
    ----------
    centre, axis : array (3,)
        Centre of the sphere, mm, and unit vector to its top.
    radius_mm : float
        Its radius.
    lowest_sine : float
        Sine of the elevation, seen from the centre, at which it ends.
    hole_mm : float
        Radius of the hole.
    """

    centre: Array
    axis: Array
    radius_mm: float
    lowest_sine: float
    hole_mm: float

    @property
    def area_mm2(self) -> float:
        """Area of the cap; the hole is drawn, too."""
        return float(2 * np.pi * self.radius_mm**2 * (1 - self.lowest_sine))

    def points(self, numbers: Array) -> Array:
        """Return points (n, 3), mm: heights over the plane are spread evenly (Archimedes)."""
        height = self.lowest_sine + (1 - self.lowest_sine) * numbers[:, 0]
        flat = np.sqrt(np.maximum(1 - height**2, 0.0))
        turn = 2 * np.pi * numbers[:, 1]
        local = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
        first, second = _tangents(self.axis[None])
        return self.centre + self.radius_mm * _combined(local, first, second, self.axis[None])

    def met(self, origins: Array, ways: Array) -> tuple[Array, Array]:
        """Return where rays leave the sphere, inf if its outside or nothing is in the way, and the cosine there."""
        local = (origins - self.centre) / self.radius_mm
        along = _dots(local, ways)
        root = along**2 - _dots(local, local) + 1
        half = np.sqrt(np.maximum(root, 0.0))
        far = half - along
        near = -half - along
        end = local + far[:, None] * ways
        height = end @ self.axis
        entry = (local + near[:, None] * ways) @ self.axis
        covered = (near > 0) & (entry > self.lowest_sine)
        meets = (root > 0) & (far > 0) & (height > self.lowest_sine) & ~covered
        beside = np.sqrt(np.maximum(1 - height**2, 0.0))
        hole = (height > 0) & (beside < self.hole_mm / self.radius_mm)
        distance = np.where(meets, far * self.radius_mm, np.inf)
        return distance, np.where(meets & ~hole, half, 0.0)


@dataclass(frozen=True)
class Window:
    """A square that shines to one side, behind a window of the same size.

    Parameters
    ----------
    centre : array (3,)
        Of the square, mm.
    axes : array (3, 3)
        Rows: unit vectors along its sides, and to where it shines.
    side_mm : float
        Length of its sides.
    depth_mm : float
        Distance of the window before it.
    """

    centre: Array
    axes: Array
    side_mm: float
    depth_mm: float

    @property
    def area_mm2(self) -> float:
        """Area of the square."""
        return self.side_mm**2

    def points(self, numbers: Array) -> Array:
        """Return points (n, 3), mm."""
        return np.asarray(self.centre + self.side_mm * (numbers - 0.5) @ self.axes[:2])

    def met(self, origins: Array, ways: Array) -> tuple[Array, Array]:
        """Return where rays meet the square through its window."""
        local = (origins - self.centre) @ self.axes.T
        slope = ways @ self.axes.T
        back = np.minimum(slope[:, 2], -_TINY)
        distance = -local[:, 2] / back
        ends = local[:, :2] + distance[:, None] * slope[:, :2]
        passed = local[:, :2] + (distance + self.depth_mm / back)[:, None] * slope[:, :2]
        widest = np.maximum(np.abs(ends), np.abs(passed)).max(axis=1)
        meets = (slope[:, 2] < 0) & (local[:, 2] > self.depth_mm) & (widest <= self.side_mm / 2)
        return np.where(meets, distance, np.inf), np.where(meets, -slope[:, 2], 0.0)


@dataclass(frozen=True)
class Rectangle:
    """A rectangle that shines to one side.

    Parameters
    ----------
    centre : array (3,)
        Its centre, mm.
    axes : array (3, 3)
        Rows: unit vectors along its sides, and to where it shines.
    half_mm : array (2,)
        Half of its sides' lengths.
    """

    centre: Array
    axes: Array
    half_mm: Array

    @property
    def area_mm2(self) -> float:
        """Area of the rectangle."""
        return float(4 * self.half_mm.prod())

    def points(self, numbers: Array) -> Array:
        """Return points (n, 3), mm."""
        return np.asarray(self.centre + (2 * numbers - 1) * self.half_mm @ self.axes[:2])

    def met(self, origins: Array, ways: Array) -> tuple[Array, Array]:
        """Return where rays meet the rectangle from before it."""
        local = (origins - self.centre) @ self.axes.T
        slope = ways @ self.axes.T
        distance = -local[:, 2] / np.minimum(slope[:, 2], -_TINY)
        ends = np.abs(local[:, :2] + distance[:, None] * slope[:, :2])
        meets = (slope[:, 2] < 0) & (local[:, 2] > 0) & (ends <= self.half_mm).all(axis=1)
        return np.where(meets, distance, np.inf), np.where(meets, -slope[:, 2], 0.0)


@dataclass(frozen=True)
class Annulus:
    """A flat ring that shines to one side.

    Parameters
    ----------
    centre, axis : array (3,)
        Its centre, mm, and unit vector to where it shines.
    inner_mm, outer_mm : float
        Its radii.
    """

    centre: Array
    axis: Array
    inner_mm: float
    outer_mm: float

    @property
    def area_mm2(self) -> float:
        """Area of the ring."""
        return float(np.pi * (self.outer_mm**2 - self.inner_mm**2))

    def points(self, numbers: Array) -> Array:
        """Return points (n, 3), mm."""
        square = self.inner_mm**2 + numbers[:, 0] * (self.outer_mm**2 - self.inner_mm**2)
        turn = 2 * np.pi * numbers[:, 1]
        first, second = _tangents(self.axis[None])
        flat = np.sqrt(square)[:, None]
        return np.asarray(
            self.centre + flat * (np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second)
        )

    def met(self, origins: Array, ways: Array) -> tuple[Array, Array]:
        """Return where rays meet the ring from before it."""
        cosine = -(ways @ self.axis)
        local = origins - self.centre
        height = local @ self.axis
        distance = height / np.maximum(cosine, _TINY)
        ends = local + distance[:, None] * ways
        radius = _lengths(ends)
        meets = (cosine > 0) & (height > 0) & (radius >= self.inner_mm) & (radius <= self.outer_mm)
        return np.where(meets, distance, np.inf), np.where(meets, cosine, 0.0)
