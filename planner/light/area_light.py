"""Lights with an area, such as a backlight: what they show of a part to a camera, and from where.

An *area light* needs no choice of places. It stands in the frame of the part, or comes with the camera. It answers two
questions, both by rays: with which contrast points of edges show to a camera, and how bright the image is. All else is
the same for every area light: what it shows of an entity (`entity_shown`), of a plan (`shown_of_plan`), and where the
search may look for poses (`AreaSpace`).

Notation
--------
n camera places (*eyes*), m points of edges. A contrast is that of the two sides of an edge in the image, as
`aspectgraph.contrast` has it; a step is their difference as a share of the brightest grey value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NamedTuple,
    Protocol,
    Self,
)

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity import Entity
from aspectgraph.solid.solid import RayScene
from ground.convert import STATED, Meta
from planner.argument_kinds import POSITIVE, check_number
from planner.camera.camera import Camera, tangents_of
from planner.exceptions import RequestError
from planner.light.corner_light import (
    BESIDE_PX,
    SHARES,
    corner_lines_of,
    parts_of,
    points_of_arm,
    rays_beside,
)
from planner.request.reach import AROUND, Space, observable_where
from planner.request.targets import targets_of
from planner.verify.simulate_setting import Planned

if TYPE_CHECKING:
    from aspectgraph import CellSet, Solid

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

COVERAGE = 0.9
"""Share of an entity that must show: more than the 80 % that a measurement needs, for what noise takes."""

SECTORS = 12
"""Each of so many parts of an entity must show somewhere, as a measurement of a rim needs it."""

# an entity of more edges is looked at in the middle of each, others at nine points
_FEW_EDGES = 8
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


class Sight(NamedTuple):
    """A part as a camera looks at it.

    Attributes
    ----------
    solid : Solid
        The part.
    scene : RayScene
        Of the part.
    pixel_rad : float
        Angle of a pixel.
    """

    solid: Solid
    scene: RayScene
    pixel_rad: float

    @classmethod
    def of(cls, solid: Solid, camera: Camera, scene: RayScene | None = None) -> Sight:
        """Return the sight of a part by a camera."""
        if scene is None:
            scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        return cls(solid, scene, max(camera.pixel_pitch_mm) / camera.image_distance_mm)


class EdgePoints(NamedTuple):
    """Points of edges of a part.

    Attributes
    ----------
    points : array (m, 3)
        In mm.
    along : array (m, 3)
        Along the edge; not of unit length.
    normals : array (m, 2, 3)
        Outward unit normals of the two faces that meet there.
    """

    points: Array
    along: Array
    normals: Array

    @classmethod
    def of(cls, solid: Solid, edge_ids: Sequence[int]) -> EdgePoints:
        """Return nine points of each edge, or the middles of many edges, in order."""
        shares = SHARES if len(edge_ids) <= _FEW_EDGES else np.array([0.5])
        edges = [solid.edges[i] for i in edge_ids]
        ends = solid.vertices[[edge.vertices for edge in edges]]
        along = ends[:, 1] - ends[:, 0]
        points = ends[:, :1] + shares[:, None] * along[:, None]
        normals = solid.normals[[edge.faces for edge in edges]]
        return cls(
            points.reshape(-1, 3),
            np.repeat(along, len(shares), axis=0),
            np.repeat(normals, len(shares), axis=0),
        )


class StandingLight(Protocol):
    """A light with an area that stands: it answers by rays."""

    def contrasts(self, sight: Sight, edges: EdgePoints, eyes: Array) -> tuple[Array, Array]:
        """Return contrast and step (n, m) of points of edges, as `AreaLight` does."""

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return how bright a camera sees what rays meet, as `AreaLight` does."""


class AreaLight(Protocol):
    """What every light with an area is: a frozen record that files hold, which answers by rays."""

    @property
    def kind(self) -> str:
        """What files and `LightPlan.kind` call it, such as "backlight"; in files it tells the records apart."""

    @property
    def description(self) -> str:
        """What a sentence calls it, with its size and place: "a backlight of 200 × 160 mm at (40, 25, 0)"."""

    @property
    def reason(self) -> str:
        """Why a target is not shown, as a sentence without its subject."""

    @property
    def outline(self) -> Array:
        """Corners (k, 3) of the polygon that pictures draw, mm; (0, 3) where there is nothing to draw."""

    @property
    def only_outlines(self) -> bool:
        """Whether only outlines make lines in the image, so that other edges nearby do not matter."""

    def check_part(self, solid: Solid) -> None:
        """Raise RequestError if the light cannot stand where it is, because of the part."""

    def held(self, cam2world: Array) -> StandingLight:
        """Return the light as it stands when a camera has a pose (4, 4): itself, unless the camera carries it."""

    def in_front(self, cells: CellSet) -> CellSet:
        """Return cells without those from which the light shows nothing of any part."""

    def contrasts(self, sight: Sight, edges: EdgePoints, eyes: Array) -> tuple[Array, Array]:
        """Return contrast and step (n, m), not negative, of points of edges (m) for cameras at eyes (n, 3).

        The points are taken as visible. 0 is for what does not show.
        """

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return how bright (n,) a camera at a place (3,) sees what rays (n, 3) meet; any unit, linear."""


# The light that stands behind a part.


_Triple = Annotated[
    tuple[float, float, float], Meta(title="must be three finite numbers in mm, x, y and z")
]


@dataclass(frozen=True)
class Backlight:
    """A bright rectangle behind a part.

    An edge shows in front of it where one side of the edge is the part, and the ray next to it passes the part and
    meets the rectangle. So only outlines show, and holes that the camera looks through.

    A wall that the camera sees next to the edge reflects the rectangle. On metal it may be as bright as the
    rectangle, so the edge does not show. On a matt part it is dim, and moves the edge unless it is at least three
    pixels wide.

    Parameters
    ----------
    centre : tuple of float
        Centre of the rectangle (3,), mm.
    half_width, half_height : tuple of float
        From the centre to the middles of two sides (3,), mm, at right angles. It shines to where their cross product
        points.
    name : str
        Name in the catalogue, or empty.
    metal : bool
        Whether faces of the part are metal.

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
    metal: bool = False

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
    def outline(self) -> Array:
        """Its corners (4, 3), mm."""
        width, height = np.array([self.half_width, self.half_height])
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return np.array([np.array(self.centre) + a * width + b * height for a, b in signs])

    @property
    def description(self) -> str:
        """What a sentence calls it."""
        width, height = 2 * self.half_lengths
        place = ", ".join(f"{x:g}" for x in self.centre)
        named = f" {self.name}" if self.name else ""
        return f"a backlight{named} of {width:g} x {height:g} mm at ({place}) mm"

    @property
    def reason(self) -> str:
        """Why a target is not shown."""
        return (
            "is not the outline of the part in front of the backlight, at the camera or nearby, or an end of it has no "
            "other line in front of the backlight, or a wall next to it reflects the backlight"
        )

    @property
    def only_outlines(self) -> bool:
        """True: the part is dark in front of it."""
        return True

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

    def held(self, cam2world: Array) -> Self:
        """Return itself: it stands wherever the camera is.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.

        Returns
        -------
        Backlight
            The same.
        """
        return self

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
            Contrasts and steps, which are the same here.
        """
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
        seen = self._seen(sight.scene, eyes[row], outside)
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
        rows = np.flatnonzero(self._is_looked_at(points, normals))
        edges = points[rows] - eyes[rows]
        # where the wall is thin, what is next to it counts
        thick = self._meets_bright(scene, eyes[rows], edges + _THIN_PX * pixel[rows])
        wide = self._meets_bright(scene, eyes[rows], edges + BESIDE_PX * pixel[rows])
        lit[rows] = np.where(thick, 1.0, 0.0)
        if not self.metal:
            lit[rows[thick & wide]] = _WALL
        return lit

    def _meets_bright(self, scene: RayScene, eyes: Array, rays: Array) -> Bools:
        """Return which rays (n, 3) from eyes (n, 3) meet a face that some of the rectangle is in front of."""
        hit = scene.cast(eyes, rays)
        depth = hit["t_hit"].astype(np.float64)
        met = np.isfinite(depth)
        normals = hit["primitive_normals"][met].astype(np.float64)
        normals *= np.where((normals * rays[met]).sum(axis=1) > 0, -1.0, 1.0)[:, None]
        bright = np.zeros(len(rays), dtype=bool)
        bright[met] = self._is_looked_at(eyes[met] + depth[met, None] * rays[met], normals)
        return bright

    def _is_looked_at(self, points: Array, normals: Array) -> Bools:
        """Return which faces at points, with normals (n, 3), some of the rectangle is in front of."""
        ways = self.outline - points[:, None]
        heights = np.einsum("nki,ni->nk", ways, normals) / np.linalg.norm(ways, axis=2)
        return np.asarray((heights > _LOOKS).any(axis=1))

    def _seen(self, scene: RayScene, eyes: Array, rays: Array) -> Bools:
        """Return which rays (n, 3) from eyes (n, 3) meet the bright side of the rectangle, and no part before it."""
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

    def _local(self, points: Array, *, vectors: bool = False) -> tuple[Array, Array]:
        """Return heights (n,) over the plane and coordinates (n, 2) along width and height of points or vectors, mm."""
        axes = np.array([self.half_width, self.half_height]) / self.half_lengths[:, None]
        local = points if vectors else points - np.array(self.centre)
        return local @ self.normal, local @ axes.T

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return 1 for rays (n, 3) that meet the rectangle, 0 for others.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        eye : array (3,)
            Position of the camera, mm.
        rays : array (n, 3)
            Rays of pixels.

        Returns
        -------
        array (n,)
            Brightness.
        """
        flat = rays.reshape(-1, 3)
        seen = self._seen(scene, np.broadcast_to(eye, flat.shape), flat)
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


# What an area light shows: of an entity from places of the camera, of a plan, and where to search.


def entity_shown(
    area: StandingLight, sight: Sight, edge_ids: Sequence[int], eyes: Array
) -> tuple[Array, Array]:
    """Return contrast and step (n,) of an entity for cameras at eyes (n, 3).

    They are those that `COVERAGE` of its points reach, and that one point in each of `SECTORS` parts of it reaches.

    Parameters
    ----------
    area : AreaLight
        The light.
    sight : Sight
        The part and the camera.
    edge_ids : sequence of int
        Edges of the entity, in order.
    eyes : array (n, 3)
        Places of cameras, mm.
    """
    edges = EdgePoints.of(sight.solid, edge_ids)
    contrast, step = area.contrasts(sight, edges, eyes)
    return _covered(contrast), _covered(step)


def _covered(values: Array) -> Array:
    n_points = values.shape[1]
    missing = int((1 - COVERAGE) * n_points)
    enough = np.partition(values, missing, axis=1)[:, missing]
    borders = np.linspace(0, n_points, min(SECTORS, n_points) + 1).astype(int)
    for first, last in pairwise(borders.tolist()):
        enough = np.minimum(enough, values[:, first:last].max(axis=1))
    return enough


@dataclass(frozen=True)
class AreaShown:
    """What an area light shows of the targets of one setting.

    Attributes
    ----------
    contrast : dict of str to float
        Of each target that it shows.
    silhouettes : tuple of str
        Those of which an edge is a silhouette.
    unlit : dict of str to str
        Why it does not show the others.
    """

    contrast: Mapping[str, float]
    silhouettes: tuple[str, ...]
    unlit: Mapping[str, str]


def shown_of_plan(
    area: AreaLight, plan: Planned, solid: Solid, scene: RayScene, limits: tuple[float, float]
) -> list[AreaShown]:
    """Return what an area light shows of each setting of a plan, also where the camera is displaced.

    Parameters
    ----------
    area : AreaLight
        The light.
    plan : Planned
        Settings and their targets.
    solid : Solid
        The part.
    scene : RayScene
        Of the part.
    limits : tuple of float
        Least contrast and step.

    Raises
    ------
    RequestError
        If the part lacks an edge, rim or arc of the plan.
    """
    sight = Sight.of(solid, plan.camera, scene)
    radius = plan.requirements.get("visibility_radius_mm", 0.0)
    parts: dict[tuple[str, int], tuple[Entity, ...]] = {}
    pairs = []
    edge_ids: list[tuple[int, ...]] = []
    values = []
    silhouettes = []
    for k, setting in enumerate(plan.settings):
        eye = np.asarray(setting.cam2world, dtype=np.float64)[:3, 3]
        eyes = np.vstack([eye, eye + radius * AROUND]) if radius > 0 else eye[None]
        targets = targets_of(plan.targets, setting)
        light = area.held(np.asarray(setting.cam2world, dtype=np.float64))
        for name in setting.entities:
            key = name, id(targets[name])
            if key not in parts:
                parts[key] = parts_of(targets[name], solid, name)
            shown = [entity_shown(light, sight, part.edge_ids, eyes) for part in parts[key]]
            values.append(
                [min(value.min() for value in column) for column in zip(*shown, strict=True)]
            )
            silhouettes.append(any(_is_silhouette(solid, part, eye) for part in parts[key]))
            pairs.append((k, name))
            edge_ids.append(parts[key][0].edge_ids if targets[name].in_image else ())
    shows = (np.reshape(values, (-1, 2)) >= limits).all(axis=1)
    shows &= _ends_show(area, plan, sight, pairs, edge_ids, limits)
    result = []
    for k in range(len(plan.settings)):
        of_setting = [i for i, pair in enumerate(pairs) if pair[0] == k]
        lit = [i for i in of_setting if shows[i]]
        result.append(
            AreaShown(
                {pairs[i][1]: float(values[i][0]) for i in lit},
                tuple(pairs[i][1] for i in lit if silhouettes[i]),
                {pairs[i][1]: f"it {area.reason}." for i in of_setting if not shows[i]},
            )
        )
    return result


def _is_silhouette(solid: Solid, entity: Entity, eye: Array) -> bool:
    """Tell whether a camera sees one face only of an edge of an entity."""
    edges = EdgePoints.of(solid, entity.edge_ids)
    front = np.einsum("mi,mfi->mf", eye - edges.points, edges.normals) > 0
    return bool((front[:, 0] != front[:, 1]).any())


def _ends_show(
    area: AreaLight,
    plan: Planned,
    sight: Sight,
    pairs: Sequence[tuple[int, str]],
    edge_ids: Sequence[Sequence[int]],
    limits: tuple[float, float],
) -> Bools:
    """Return at which targets (n,) another line shows at each end, as a plan asks it of lengths."""
    shows = np.ones(len(pairs), dtype=bool)
    ends: dict[int, list[bool]] = {}
    pair_of: dict[int, int] = {}
    for line in corner_lines_of(
        plan, sight.solid, pairs, edge_ids, only_outlines=area.only_outlines
    ):
        points = points_of_arm(line.corner, line.tip, line.eye, sight.pixel_rad)
        edge = sight.solid.edges[line.edge_id]
        edges = EdgePoints(
            points,
            np.broadcast_to(line.tip - line.corner, points.shape),
            np.broadcast_to(sight.solid.normals[list(edge.faces)], (len(points), 2, 3)),
        )
        pose = np.asarray(plan.settings[pairs[line.pair][0]].cam2world, dtype=np.float64)
        contrast, step = area.held(pose).contrasts(sight, edges, line.eye[None])
        is_shown = bool((contrast >= limits[0]).all() and (step >= limits[1]).all())
        ends.setdefault(line.end, []).append(is_shown)
        pair_of[line.end] = line.pair
    for end, are_shown in ends.items():
        shows[pair_of[end]] &= any(are_shown)
    return shows


def area_brightness(
    area: AreaLight, scene: RayScene, cam2world: Array, camera: Camera, pixels: Array
) -> Array:
    """Return how bright pixels (n, 2) are, 0 off the sensor; any unit, linear.

    Parameters
    ----------
    area : AreaLight
        The light.
    scene : RayScene
        Of the part.
    cam2world : array (4, 4)
        Pose of the camera.
    camera : Camera
        The camera.
    pixels : array (n, 2)
        In px.
    """
    tangents = tangents_of(camera, pixels)
    right, down, forward = cam2world[:3, :3].T
    rays = tangents[:, :1] * right + tangents[:, 1:] * down + forward
    last = np.array(camera.resolution) - 1
    seen = ((pixels >= 0) & (pixels <= last)).all(axis=1) & np.isfinite(rays).all(axis=1)
    light = np.zeros(len(pixels))
    light[seen] = area.held(cam2world).brightness(scene, cam2world[:3, 3], rays[seen])
    return light


class AreaSpace:
    """Viewpoints from which a camera sees entities, and an area light makes them show: a space for planning.

    The covering cells are those of the regions, without those from which the light shows nothing. So a lower bound
    proven with them stays valid.

    Parameters
    ----------
    regions : Space
        From where the entities are visible.
    camera : Camera
        The camera.
    area : AreaLight
        The light.
    limits : tuple of float
        Least contrast and step.
    """

    def __init__(
        self, regions: Space, camera: Camera, area: AreaLight, limits: tuple[float, float]
    ) -> None:
        self.regions = regions
        self.camera = camera
        self.area = area
        self.limits = limits
        self._sight: Sight | None = None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<AreaSpace of {self.solid.name!r}: {len(self.entities)} entities, {self.area}>"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the rays' scene behind: it cannot cross a process boundary."""
        return {**self.__dict__, "_sight": None}

    @property
    def solid(self) -> Solid:
        """The part."""
        return self.regions.solid

    @property
    def only_outlines(self) -> bool:
        """Whether only outlines make lines in the image."""
        return self.area.only_outlines

    @property
    def workspace(self) -> Array:
        """Lowest and highest corner (2, 3) of the box the camera may be in, mm."""
        return self.regions.workspace

    @property
    def entities(self) -> Mapping[str, Any]:
        """The entities by name."""
        return self.regions.entities

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the entities, in order."""
        return self.regions.entity_names

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Return the viewpoints in front of the light from where all named entities are visible.

        Parameters
        ----------
        names : sequence of str
            Names of entities, at least one.
        """
        return self.area.in_front(self.regions.covering_cells(names))

    def subset(self, names: Sequence[str]) -> AreaSpace:
        """Return the space of some of the entities.

        Parameters
        ----------
        names : sequence of str
            Their names.
        """
        regions: Any = self.regions
        smaller = regions.subset(names) if hasattr(regions, "subset") else regions
        space = AreaSpace(smaller, self.camera, self.area, self.limits)
        space._sight = self._sight
        return space

    def observable(self, points: Array, names: Sequence[str] | None = None) -> Bools:
        """Whether entities are visible and show from viewpoints.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm, inside the workspace.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name.
        """
        names = self.entity_names if names is None else names
        eyes = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        return self._showing(eyes, names, np.array(self.regions.observable(eyes, names)))

    def observable_where(self, points: Array, names: Sequence[str], wanted: Bools) -> Bools:
        """Return which of the wanted pairs (n, k) hold, as `observable` finds it.

        Parameters
        ----------
        points : array (n, 3)
            Viewpoints in mm.
        names : sequence of str
            The entities.
        wanted : array of bool (n, k)
            Pairs that are asked for.
        """
        return self._showing(points, names, observable_where(self.regions, points, names, wanted))

    def _showing(self, eyes: Array, names: Sequence[str], visible: Bools) -> Bools:
        if self._sight is None:
            self._sight = Sight.of(self.solid, self.camera)
        for k, name in enumerate(names):
            rows = np.flatnonzero(visible[:, k])
            if len(rows):
                shown = entity_shown(
                    self.area, self._sight, self.entities[name].edge_ids, eyes[rows]
                )
                visible[rows, k] = (np.transpose(shown) >= self.limits).all(axis=1)
        return visible
