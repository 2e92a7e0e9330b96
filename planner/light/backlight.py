"""A backlight: a bright rectangle behind a part, which shows outlines, and holes that the camera looks through.

A matt part is dark before it, but for walls next to its edges. Metal mirrors it: there, rays tell how bright each face
is, as under the lights that the camera carries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.solid import RayScene
from ground.convert import STATED, Meta
from planner.argument_kinds import POSITIVE, check_number
from planner.exceptions import RequestError
from planner.light.area_light import (
    EdgePoints,
    Misplaced,
    Sight,
    StandingLight,
    places_seen,
    ways_beside,
)
from planner.light.corner_light import BESIDE_PX, rays_beside
from planner.light.reflection import BOUNCES, RAYS, Material, Rectangle, brightness

if TYPE_CHECKING:
    from aspectgraph import CellSet, Solid

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# rays at a time
_RAYS = 500_000
# what ends so near to a plane, as a share of the distances, is in it
_FLAT = 1e-6
# a bright wall beside an edge moves its image by less than this if it is not wider
_THIN_PX = 0.05
# a face looks at the rectangle if part of this is higher over it than so much of its distance
_LOOKS = 0.02
# light that a matt wall has next to a rectangle, half of which it sees, as a share of the rectangle's; its albedo is .5
_WALL = 0.25
# a backlight reaches so far beyond what the height of the part asks for: detection windows look beside edges
_BEYOND_MM = 10.0
# on metal, edges are looked at so far beside them, and each side must be as bright at both places, to this
_OFFSETS_PX = (0.5, BESIDE_PX)
_EVEN = 0.15
# what is met there is a face of the edge if the cosine of their normals is above this: faces of rims are facets
_SAME_FACE = 0.9
# rays by the number of places, as of lights that the camera carries
_MANY = 2000
_PICTURE = 20_000
_FEW_RAYS = 64
_PICTURE_RAYS = 16
# the search asks for many cameras: so many points of an entity
_SEARCH_POINTS = 12
# light of a metal wall next to the rectangle, as the search takes it: rays give 0.15 to 0.8
_LIT = 0.5


_Triple = Annotated[
    tuple[float, float, float], Meta(title="must be three finite numbers in mm, x, y and z")
]


@dataclass(frozen=True)
class Backlight:
    """A bright rectangle behind a part.

    An edge shows in front of it where one side of the edge is the part, and the ray next to it passes the part and
    meets the rectangle. So only outlines show, and holes that the camera looks through.

    A wall that the camera sees next to the edge reflects the rectangle. On a matt part it is dim, and moves the edge
    unless it is at least three pixels wide. On metal it is bright. Then the upper rim of a hole shows if the wall is
    wide: there the dark top of the part meets it.

    Parameters
    ----------
    centre : tuple of float
        Centre of the rectangle (3,), mm.
    half_width, half_height : tuple of float
        From the centre to the middles of two sides (3,), mm, at right angles. It shines to where their cross product
        points.
    name : str
        Name in the catalogue, or empty.
    material : Material
        Of the part.

    Raises
    ------
    RequestError
        If a number is not finite, or the two are not at right angles, or have no length.

    Examples
    --------
    >>> from planner import Backlight
    >>> print(Backlight.horizontal((40, 25, 0), 200, 160))
    a backlight of 200 x 160 mm at (40, 25, 0) mm
    """

    kind: Annotated[Literal["backlight"], STATED] = field(default="backlight", init=False)
    centre: _Triple
    half_width: _Triple
    half_height: _Triple
    name: str = ""
    material: Material = field(default_factory=Material)

    def __post_init__(self) -> None:
        for name in ("centre", "half_width", "half_height"):
            object.__setattr__(self, name, _triple(name, getattr(self, name)))
        lengths = self.half_lengths
        if not lengths.min() > 0:
            raise RequestError.of_rule(
                "half_width", "and half_height must have a length", f"{lengths.min():g} mm"
            )
        cosine = np.dot(self.half_width, self.half_height) / lengths.prod()
        if abs(cosine) > _FLAT:
            got = f"{np.degrees(np.arccos(cosine)):g} degrees"
            raise RequestError.of_rule("half_width", "must be at right angles to half_height", got)

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        return self.description

    @classmethod
    def horizontal(
        cls, centre: Sequence[float], width_mm: float, height_mm: float, name: str = ""
    ) -> Self:
        """Return a rectangle that lies and shines upwards (+z).

        Parameters
        ----------
        centre : sequence of float
            Its centre (3,), mm.
        width_mm, height_mm : float
            Its sizes in x and y.
        name : str
            Name in the catalogue, or empty.

        Raises
        ------
        RequestError
            If a size is not positive.
        """
        width, height = (
            check_number(word, value, POSITIVE) / 2
            for word, value in (("width_mm", width_mm), ("height_mm", height_mm))
        )
        return cls(_triple("centre", centre), (width, 0.0, 0.0), (0.0, height, 0.0), name)

    @classmethod
    def under(cls, solid: Solid) -> Self:
        """Return the rectangle that a part lies on, in the plane of its lowest point.

        It is larger than the part on each side by the part's height and 10 mm. So cameras that look at an edge
        by up to 45 degrees from above still see the rectangle next to it.

        Parameters
        ----------
        solid : Solid
            The part; z is up.
        """
        low, high = (np.asarray(corner, dtype=np.float64) for corner in solid.bounds)
        centre = (low + high) / 2
        room = 2 * (high[2] - low[2] + _BEYOND_MM)
        # whole millimetres, as it is bought
        width, height = np.ceil(high[:2] - low[:2] + room).tolist()
        return cls.horizontal((*centre[:2].tolist(), float(low[2])), width, height)

    @property
    def half_lengths(self) -> Array:
        """Half of its width and height (2,), mm."""
        return np.linalg.norm([self.half_width, self.half_height], axis=1)

    @property
    def normal(self) -> Array:
        """Unit vector (3,) to where it shines."""
        cross = np.cross(self.half_width, self.half_height)
        return np.asarray(cross / np.linalg.norm(cross))

    @property
    def emitter(self) -> Rectangle:
        """The rectangle, as rays meet it."""
        axes = np.array([self.half_width, self.half_height]) / self.half_lengths[:, None]
        return Rectangle(np.array(self.centre), np.vstack([axes, self.normal]), self.half_lengths)

    @property
    def outline(self) -> Array:
        """Its corners (4, 3), mm."""
        width, height = np.array([self.half_width, self.half_height])
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return np.array([np.array(self.centre) + a * width + b * height for a, b in signs])

    @property
    def description(self) -> str:
        """What a sentence calls it."""
        width, height = 2 * self.half_lengths
        place = ", ".join(f"{round(x, 3) + 0.0:g}" for x in self.centre)
        named = f" {self.name}" if self.name else ""
        return f"a backlight{named} of {width:g} x {height:g} mm at ({place}) mm"

    @property
    def reason(self) -> str:
        """Why a target is not shown."""
        return (
            "is not the outline of the part in front of the backlight, with a line at each end and clear of narrow "
            "walls that reflect it"
        )

    @property
    def only_outlines(self) -> bool:
        """True: the part is dark in front of it."""
        return True

    @property
    def on_metal(self) -> bool:
        """Whether the part is metal."""
        return self.material.kind == "metal"

    @property
    def square_on(self) -> bool:
        """False: faces of any tilt are dark before it."""
        return False

    def in_front(self, cells: CellSet) -> CellSet:
        """Return the cells that reach in front of the rectangle's plane.

        Parameters
        ----------
        cells : CellSet
            Where cameras may be.

        Returns
        -------
        CellSet
            Without the cells behind the plane.
        """
        return cells.in_front_of(np.array(self.centre), self.normal)

    def misplaced(self, scene: RayScene, cam2world: Array, points: Array) -> Misplaced | None:
        """Say whether a camera is behind the rectangle.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        cam2world : array (4, 4)
            Pose of the camera.
        points : array (n, 3)
            Points of the target, mm.

        Returns
        -------
        Misplaced or None
            The reason; None if the camera is in front of the rectangle.
        """
        height = float(self.heights_of(cam2world[None, :3, 3])[0])
        if height > 0:
            return None
        text = f"the camera is behind the backlight, which shines away from it ({-height:.0f} mm behind)"
        return Misplaced(text)

    def check_part(self, solid: Solid) -> None:
        """Refuse a rectangle that the part is in the way of, or that does not shine at it.

        Parameters
        ----------
        solid : Solid
            The part.

        Raises
        ------
        RequestError
            If the rectangle passes through the part, or does not shine at it.
        """
        heights, places = self._local(solid.vertices)
        flat = _FLAT * float(np.abs(solid.bounds).max() + self.half_lengths.max())
        if heights.max() <= flat:
            raise RequestError.of_rule(
                "lamps", "must shine at the part", f"{self}, which shines away from it"
            )
        below = heights < -flat
        ends = np.array([edge.vertices for edge in solid.edges])
        crossing = ends[below[ends[:, 0]] != below[ends[:, 1]]]
        share = heights[crossing[:, 0]] / (heights[crossing[:, 0]] - heights[crossing[:, 1]])
        met = places[crossing[:, 0]] + share[:, None] * np.subtract(*places[crossing[:, ::-1].T])
        inside = (np.abs(met) < self.half_lengths - flat).all(axis=1).any()
        if inside or self._border_inside(solid, flat):
            raise RequestError.of_rule("lamps", "must be outside the part", f"{self}, inside it")

    def held(self, cam2world: Array) -> StandingLight:
        """Return itself, as it stands wherever the camera is; on metal, the light that is computed in full.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.

        Returns
        -------
        StandingLight
            What answers for this pose.
        """
        return LightOnMetal(self) if self.on_metal else self

    def _border_inside(self, solid: Solid, flat: float) -> bool:
        """Tell whether the border meets the part, or the centre is inside; a part that lies on it does neither."""
        # float32: what lies in the plane is well above the place that is tested
        lowered = self.outline - 100 * flat * self.normal
        scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        starts = np.roll(lowered, 1, axis=0)
        met = scene.cast(starts, lowered - starts)["t_hit"] <= 1.0
        centre = lowered.mean(axis=0)
        return bool(met.any() or scene.signed_distance(centre[None])[0] < 0)

    def contrasts(self, sight: Sight, edges: EdgePoints, eyes: Array) -> tuple[Array, Array]:
        """Return contrast and step (n, m) of points of edges that show in front of the rectangle, and 0 of others.

        Both are 1 next to a face that no light reaches.

        Parameters
        ----------
        sight : Sight
            The part and the camera.
        edges : EdgePoints
            Points of edges.
        eyes : array (n, 3)
            Positions of cameras, mm.

        Returns
        -------
        tuple of array (n, m)
            Contrasts and steps, not negative.
        """
        if self.on_metal:
            return _searched(self, sight, edges, eyes)
        lit = np.ones((len(eyes), len(edges.points)))
        size = max(1, _RAYS // max(1, len(edges.points)))
        for first in range(0, len(eyes), size):
            block = slice(first, first + size)
            lit[block] = self._beside(sight, edges, eyes[block])
        return (1 - lit) / (1 + lit), 1 - lit

    def _beside(self, sight: Sight, edges: EdgePoints, eyes: Array) -> Array:
        """Return the light (n, m) of the part next to edges that show, as a share of the rectangle's; 1 of others."""
        lit = np.ones((len(eyes), len(edges.points)))
        towards = eyes[:, None] - edges.points
        front = np.einsum("nmi,mfi->nmf", towards, edges.normals) > 0
        shows = front[..., 0] != front[..., 1]
        row, column = np.nonzero(shows)
        hidden = edges.normals[column, front[row, column, 0].astype(int)]
        outside = rays_beside(-towards[row, column], edges.along[column], hidden, sight.pixel_rad)
        seen = self.sees(sight.scene, eyes[row], outside)
        # the other side, as far from the edge, is the part
        inside = -2 * towards[row, column] - outside
        part = np.zeros(len(row), dtype=bool)
        part[seen] = sight.scene.blocked(eyes[row[seen]], inside[seen], np.inf)
        row = row[part]
        column = column[part]
        visible = edges.normals[column, front[row, column, 1].astype(int)]
        # from the edge to the side of the part, by a pixel
        pixel = -(outside[part] + towards[row, column]) / BESIDE_PX
        lit[row, column] = self._wall(sight.scene, eyes[row], edges.points[column], visible, pixel)
        return lit

    def _wall(
        self, scene: RayScene, eyes: Array, points: Array, normals: Array, pixel: Array
    ) -> Array:
        """Return the light (n,) of the faces that cameras see next to edges, 1 where it hides or moves the edge.

        Edges are given by points and the normals of these faces (n, 3); a pixel (n, 3) is a way to their side.
        """
        lit = np.zeros(len(points))
        rows = np.flatnonzero(self.is_looked_at(points, normals))
        edges = points[rows] - eyes[rows]
        # where the wall is thin, what is next to it counts
        thick = self.meets_bright(scene, eyes[rows], edges + _THIN_PX * pixel[rows])
        wide = self.meets_bright(scene, eyes[rows], edges + BESIDE_PX * pixel[rows])
        lit[rows] = np.where(thick, 1.0, 0.0)
        lit[rows[thick & wide]] = _WALL
        return lit

    def meets_bright(self, scene: RayScene, eyes: Array, rays: Array) -> Bools:
        """Return which rays (n, 3) from eyes (n, 3) meet a face that some of the rectangle is in front of.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        eyes, rays : array (n, 3)
            Starts and directions, mm.

        Returns
        -------
        array of bool (n,)
            Whether they do.
        """
        hit = scene.cast(eyes, rays)
        depth = hit["t_hit"].astype(np.float64)
        met = np.isfinite(depth)
        normals = hit["primitive_normals"][met].astype(np.float64)
        normals *= np.where((normals * rays[met]).sum(axis=1) > 0, -1.0, 1.0)[:, None]
        bright = np.zeros(len(rays), dtype=bool)
        bright[met] = self.is_looked_at(eyes[met] + depth[met, None] * rays[met], normals)
        return bright

    def is_looked_at(self, points: Array, normals: Array) -> Bools:
        """Return which faces some of the rectangle is in front of.

        Parameters
        ----------
        points, normals : array (n, 3)
            Points of the faces, mm, and unit normals.

        Returns
        -------
        array of bool (n,)
            Whether it is.
        """
        ways = self.outline - points[:, None]
        heights = np.einsum("nki,ni->nk", ways, normals) / np.linalg.norm(ways, axis=2)
        return np.asarray((heights > _LOOKS).any(axis=1))

    def sees(self, scene: RayScene, eyes: Array, rays: Array) -> Bools:
        """Return which rays (n, 3) from eyes (n, 3) meet the bright side of the rectangle, and no part before it.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        eyes, rays : array (n, 3)
            Starts and directions, mm.

        Returns
        -------
        array of bool (n,)
            Whether they do.
        """
        heights, places = self._local(eyes)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = -heights / (rays @ self.normal)
        _, along = self._local(rays, vectors=True)
        met = np.isfinite(reach) & (reach > 0) & (heights > 0)
        ends = places[met] + reach[met, None] * along[met]
        met[met] = (np.abs(ends) <= self.half_lengths).all(axis=1)
        # rays that go on to the plane: their length is the way to it
        rows = np.flatnonzero(met)
        met[rows] = ~scene.blocked(eyes[rows], rays[rows] * reach[rows, None])
        return met

    def heights_of(self, points: Array) -> Array:
        """Return how far points are in front of the rectangle's plane.

        Parameters
        ----------
        points : (n, 3) array
            Points, mm.

        Returns
        -------
        (n,) array
            Heights, mm; negative behind the plane.
        """
        return self._local(points)[0]

    def _local(self, points: Array, *, vectors: bool = False) -> tuple[Array, Array]:
        """Return heights (n,) over the plane and coordinates (n, 2) along width and height of points or vectors, mm."""
        axes = np.array([self.half_width, self.half_height]) / self.half_lengths[:, None]
        local = points if vectors else points - np.array(self.centre)
        return local @ self.normal, local @ axes.T

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return 1 for rays that meet the rectangle, and 0 for others; on metal, what these meet is seen in its light.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        eye : array (3,)
            Position of the camera, mm.
        rays : array (..., 3)
            Rays of pixels.

        Returns
        -------
        array (...)
            Brightness.
        """
        if self.on_metal:
            n = rays.size // 3
            rays_of_picture = _FEW_RAYS if n <= _PICTURE else _PICTURE_RAYS
            count = RAYS if n <= _MANY else rays_of_picture
            return _on_metal(self, scene, eye, rays, _Paths(count, 1))
        flat = rays.reshape(-1, 3)
        seen = self.sees(scene, np.broadcast_to(eye, flat.shape), flat)
        return seen.astype(np.float64).reshape(rays.shape[:-1])


def _triple(name: str, values: Any) -> tuple[float, float, float]:
    """Return three finite numbers."""
    try:
        x, y, z = (float(value) for value in values)
    except (TypeError, ValueError):
        raise RequestError.of_rule(
            name, "must be three finite numbers in mm", repr(values)
        ) from None
    if not np.isfinite([x, y, z]).all():
        raise RequestError.of_rule(name, "must be three finite numbers in mm", repr(values))
    return x, y, z


# Metal in front of a backlight.


@dataclass(frozen=True, eq=False)
class LightOnMetal:
    """A backlight of which a metal part reflects the light, computed in full.

    Attributes
    ----------
    light : Backlight
        The light.
    """

    light: Backlight

    def contrasts(self, sight: Sight, edges: EdgePoints, eyes: Array) -> tuple[Array, Array]:
        """Return contrast and step (n, m) of points of edges for cameras at eyes (n, 3).

        Parameters
        ----------
        sight : Sight
            The part and the camera.
        edges : EdgePoints
            Points of edges.
        eyes : array (n, 3)
            Positions of cameras, mm.

        Returns
        -------
        tuple of array (n, m)
            Contrast and step, not negative.
        """
        if len(eyes) * len(edges.points) > _MANY:
            return _shown_on_metal(self.light, sight, edges, eyes, _Paths(_FEW_RAYS, 1))
        return _shown_on_metal(self.light, sight, edges, eyes, _Paths(RAYS, BOUNCES))

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return how bright a camera sees what rays meet, as `Backlight.brightness` does.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        eye : array (3,)
            Position of the camera, mm.
        rays : array (..., 3)
            Rays of pixels.

        Returns
        -------
        array (...)
            The rectangle is 1.
        """
        return self.light.brightness(scene, eye, rays)


class _Paths(NamedTuple):
    """How many rays leave each place, and how many faces may hand on light."""

    rays: int
    bounces: int


def _searched(
    light: Backlight, sight: Sight, edges: EdgePoints, eyes: Array
) -> tuple[Array, Array]:
    """Return contrast and step (n, m) for many cameras, by few points of edges."""
    chosen = np.unique(np.linspace(0, len(edges.points) - 1, _SEARCH_POINTS).astype(int))
    nearest = np.abs(np.arange(len(edges.points))[:, None] - chosen).argmin(axis=1)
    points = EdgePoints(*(values[chosen] for values in edges))
    contrast, step = _shown_on_metal(light, sight, points, eyes, None)
    return contrast[:, nearest], step[:, nearest]


def _shown_on_metal(
    light: Backlight, sight: Sight, edges: EdgePoints, eyes: Array, paths: _Paths | None
) -> tuple[Array, Array]:
    """Return contrast and step (n, m) of points of edges on metal, 0 where a narrow bright wall would move the edge.

    Without paths, as the search asks, all faces that look at the rectangle are taken to be alike.
    """
    scene = sight.scene
    front = np.einsum("nmi,mfi->nmf", eyes[:, None] - edges.points, edges.normals) > 0
    ways = [ways_beside(sight, edges, eyes, off) for off in _OFFSETS_PX]
    bright = np.stack([_on_metal(light, scene, eyes[:, None], way, paths) for way in ways])
    step = np.abs(bright[:, 0] - bright[:, 1]).min(axis=0)
    contrast = step / np.maximum(bright.sum(axis=1).max(axis=0), 1e-9)
    shows = (np.abs(bright[0] - bright[1]) <= _EVEN).all(axis=0) & front.any(axis=2)
    # from behind, the rectangle hides the part
    shows &= light.heights_of(eyes)[:, None] > 0
    # of a crease, both faces are seen next to the edge
    crease = front.all(axis=2)
    shows &= ~crease | _borders_both(scene, eyes, edges, ways[0])
    # of a silhouette, no bright wall is too narrow for these places
    row, column = np.nonzero(shows & ~crease)
    thin = ways_beside(sight, edges, eyes, _THIN_PX)
    for side in (0, 1):
        narrow = light.meets_bright(scene, eyes[row], thin[side, row, column])
        wall = narrow & ~light.meets_bright(scene, eyes[row], ways[0][side, row, column])
        shows[row[wall], column[wall]] = False
    return np.where(shows, contrast, 0.0), np.where(shows, step, 0.0)


def _on_metal(
    light: Backlight, scene: RayScene, eyes: Array, ways: Array, paths: _Paths | None
) -> Array:
    """Return how bright (...) what is seen along ways (..., 3) is; the ground is dark."""
    seen, met = places_seen(scene, eyes, ways)
    bright = np.zeros(ways.shape[:-1])
    if paths is None:
        bright[met] = np.where(light.is_looked_at(seen.points, seen.normals), _LIT, 0.0)
    else:
        bright[met] = brightness(
            scene, light.emitter, seen, light.material, paths.rays, paths.bounces
        )
    starts = np.broadcast_to(eyes, ways.shape)[~met]
    bright[~met] = light.sees(scene, starts, ways[~met])
    return bright


def _borders_both(scene: RayScene, eyes: Array, edges: EdgePoints, ways: Array) -> Bools:
    """Return where (n, m) rays to both sides of edges (2, n, m, 3) meet both of their faces."""
    normals = scene.cast(eyes[:, None], ways)["primitive_normals"].astype(np.float64)
    alike = np.abs(np.einsum("snmi,mfi->snmf", normals, edges.normals)) > _SAME_FACE
    return np.asarray((alike[0, ..., 0] & alike[1, ..., 1]) | (alike[0, ..., 1] & alike[1, ..., 0]))
