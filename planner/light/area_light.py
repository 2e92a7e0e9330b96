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

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity import Entity
from aspectgraph.exact.grid import as_points
from aspectgraph.solid.solid import RayScene
from ground.short_repr import count
from planner.camera.camera import Camera, tangents_of
from planner.light.corner_light import (
    BESIDE_PX,
    SHARES,
    across,
    corner_lines_of,
    points_of_arm,
)
from planner.light.reflection import Places
from planner.request.part_entities import parts_of
from planner.request.reach import AROUND, Space, observable_where
from planner.request.reads import Reads
from planner.request.targets import MeasuredPart, targets_of
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
# how much of a target lies in an opening, which differs from pose to pose


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


def ways_beside(
    sight: Sight, edges: EdgePoints, eyes: Array, beside_px: float = BESIDE_PX
) -> Array:
    """Return rays (2, n, m, 3) from cameras at eyes (n, 3) to both sides of points (m) of edges, so far beside them."""
    lines = edges.points - eyes[:, None]
    aside = np.stack([across(lines[:, k], edges.along[k]) for k in range(lines.shape[1])], axis=1)
    off = beside_px * sight.pixel_rad * np.linalg.norm(lines, axis=-1, keepdims=True) * aside
    return np.stack([lines + off, lines - off])


def places_seen(scene: RayScene, eyes: Array, ways: Array) -> tuple[Places, Bools]:
    """Return the places that rays (..., 3) from eyes meet, and which rays (...) meet one."""
    hit = scene.cast(eyes, ways)
    depth = hit["t_hit"].astype(np.float64)
    met = np.isfinite(depth)
    sight = ways[met]
    points = np.broadcast_to(eyes, ways.shape)[met] + depth[met, None] * sight
    normals = hit["primitive_normals"][met].astype(np.float64)
    normals *= np.where((normals * sight).sum(axis=1) > 0, -1.0, 1.0)[:, None]
    views = -sight / np.linalg.norm(sight, axis=1, keepdims=True)
    return Places(points, normals, views), met


def spoken(kind: str) -> str:
    """Return what a sentence calls a kind of light: "coaxial light" for "coaxial"."""
    return {"coaxial": "coaxial light"}.get(kind, kind.replace("-", " "))


class Misplaced(NamedTuple):
    """Why light and camera cannot show a target where they are: what is so, and of how much of it."""

    text: str
    part: str = ""

    def __str__(self) -> str:
        """Return the reason without a full stop."""
        return f"{self.part} {self.text}".strip()

    @property
    def of_a_part(self) -> Misplaced:
        """The same reason where only the text counts, not how large the part is."""
        return self._replace(part=self.part and "only a part of it")


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

    @property
    def on_metal(self) -> bool:
        """Whether the part is metal, so that light is uneven next to edges."""

    @property
    def square_on(self) -> bool:
        """Whether it shows faces at right angles to the optical axis, so that the search tries such poses."""

    def check_part(self, solid: Solid) -> None:
        """Raise RequestError if the light cannot stand where it is, because of the part."""

    def held(self, cam2world: Array) -> StandingLight:
        """Return the light as it stands when a camera has a pose (4, 4): itself, unless the camera carries it."""

    def misplaced(self, scene: RayScene, cam2world: Array, points: Array) -> Misplaced | None:
        """Return why light and camera cannot show points (n, 3) at all where they are; None if they can."""

    def in_front(self, cells: CellSet) -> CellSet:
        """Return cells without those from which the light shows nothing of any part."""

    def contrasts(self, sight: Sight, edges: EdgePoints, eyes: Array) -> tuple[Array, Array]:
        """Return contrast and step (n, m), not negative, of points of edges (m) for cameras at eyes (n, 3).

        The points are taken as visible. 0 is for what does not show.
        """

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return how bright (n,) a camera at a place (3,) sees what rays (n, 3) meet; any unit, linear."""


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
    area: AreaLight,
    plan: Planned,
    solid: Solid,
    scene: RayScene,
    limits: tuple[float, float],
    reads: Reads | None = None,
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
    reads : Reads, optional
        What measuring will find.

    Raises
    ------
    RequestError
        If the part lacks an edge, rim or arc of the plan.
    """
    sight = Sight.of(solid, plan.camera, scene)
    radius = plan.requirements.get("visibility_radius_mm", 0.0)
    parts: dict[MeasuredPart, tuple[Entity, ...]] = {}
    pairs = []
    edge_ids: list[tuple[int, ...]] = []
    parts_of_pairs = []
    values = []
    silhouettes = []
    for k, setting in enumerate(plan.settings):
        eye = np.asarray(setting.cam2world, dtype=np.float64)[:3, 3]
        eyes = np.vstack([eye, eye + radius * AROUND]) if radius > 0 else eye[None]
        targets = targets_of(plan.targets, setting)
        light = area.held(np.asarray(setting.cam2world, dtype=np.float64))
        for name in setting.entities:
            key = MeasuredPart.of(name, setting)
            if key not in parts:
                parts[key] = parts_of(targets[name], solid, name)
            shown = [entity_shown(light, sight, part.edge_ids, eyes) for part in parts[key]]
            values.append(
                [min(value.min() for value in column) for column in zip(*shown, strict=True)]
            )
            silhouettes.append(any(_is_silhouette(solid, part, eye) for part in parts[key]))
            pairs.append((k, name))
            parts_of_pairs.append(parts[key])
            edge_ids.append(parts[key][0].edge_ids if targets[name].has_corners else ())
    shows = (np.reshape(values, (-1, 2)) >= limits).all(axis=1)
    shows &= _ends_show(area, plan, sight, pairs, edge_ids, limits)
    reasons = _unread(
        area, plan, [pair for pair, is_shown in zip(pairs, shows, strict=True) if is_shown], reads
    )
    result = []
    for k in range(len(plan.settings)):
        of_setting = [i for i, pair in enumerate(pairs) if pair[0] == k]
        lit = [i for i in of_setting if shows[i] and pairs[i] not in reasons]
        result.append(
            AreaShown(
                {pairs[i][1]: float(values[i][0]) for i in lit},
                tuple(pairs[i][1] for i in lit if silhouettes[i]),
                {
                    pairs[i][1]: reasons.get(pairs[i])
                    or _why_dark(area, sight, solid, plan.settings[k].cam2world, parts_of_pairs[i])
                    for i in of_setting
                    if i not in lit
                },
            )
        )
    return result


def _why_dark(
    area: AreaLight, sight: Sight, solid: Solid, pose: Array, parts: Sequence[Entity]
) -> str:
    """Say why a light does not show a target: where the light is, or how it falls."""
    cam2world = np.asarray(pose, dtype=np.float64)
    for part in parts:
        points = EdgePoints.of(solid, part.edge_ids).points
        if misplaced := area.misplaced(sight.scene, cam2world, points):
            return f"{misplaced}."
    return f"it {area.reason}."


def _unread(
    area: AreaLight, plan: Planned, pairs: Sequence[tuple[int, str]], reads: Reads | None
) -> dict[tuple[int, str], str]:
    """Return of which pairs of setting and target, that show, measuring will not find enough, and why."""
    reasons: dict[tuple[int, str], str] = {}
    if reads is None:
        return reasons
    for k, name in pairs:
        setting = plan.settings[k]
        target = targets_of(plan.targets, setting)[name]
        pose = np.asarray(setting.cam2world, dtype=np.float64)
        text = reads.unread(pose, plan.camera, target, area)
        if text:
            reasons[k, name] = f"{text}."
    return reasons


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


class LitSpace:
    """What spaces of viewpoints under a light take from the regions that they narrow.

    Parameters
    ----------
    regions : Space
        From where the entities are visible.
    """

    def __init__(self, regions: Space) -> None:
        self.regions = regions

    @property
    def solid(self) -> Solid:
        """The part."""
        return self.regions.solid

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


class AreaSpace(LitSpace):
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
        super().__init__(regions)
        self.camera = camera
        self.area = area
        self.limits = limits
        self._sight: Sight | None = None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        size = count(len(self.entities), "entity", "entities")
        return f"<AreaSpace of {self.solid.name!r}: {size}, {self.area}>"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the rays' scene behind: it cannot cross a process boundary."""
        return {**self.__dict__, "_sight": None}

    @property
    def nearby(self) -> Space:
        """The space that is asked of the points around a viewpoint, see `planner.request.reach.nearby_space`."""
        return self if self.area.only_outlines else self.regions

    @property
    def only_outlines(self) -> bool:
        """Whether only outlines make lines in the image."""
        return self.area.only_outlines

    @property
    def before(self) -> str:
        """Where viewpoints are left, in words."""
        return f" in front of the {self.area.kind}" if self.area.only_outlines else ""

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
        eyes = as_points(points)
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

    def why_dark(self, cam2world: Array, names: Sequence[str]) -> str:
        """Say why the light does not show entities that are visible: the most frequent reason, and how often it is.

        Parameters
        ----------
        cam2world : array (n, 4, 4)
            Poses from where they are visible.
        names : sequence of str
            The entities.
        """
        scene = self._looked().scene
        edge_ids = [i for name in names for i in self.entities[name].edge_ids]
        points = EdgePoints.of(self.solid, edge_ids).points
        answers = (self.area.misplaced(scene, pose, points) for pose in cam2world)
        # its share differs from pose to pose
        reasons = Counter(misplaced and misplaced.of_a_part for misplaced in answers)
        ((reason, n),) = reasons.most_common(1)
        often = "" if n == len(cam2world) else f" (from {n} of {len(cam2world)} of these poses)"
        return f"{reason or f'under {self.area} it {self.area.reason}'}{often}"

    def _looked(self) -> Sight:
        if self._sight is None:
            self._sight = Sight.of(self.solid, self.camera)
        return self._sight

    def _showing(self, eyes: Array, names: Sequence[str], visible: Bools) -> Bools:
        sight = self._looked()
        for k, name in enumerate(names):
            rows = np.flatnonzero(visible[:, k])
            if len(rows):
                shown = entity_shown(self.area, sight, self.entities[name].edge_ids, eyes[rows])
                visible[rows, k] = (np.transpose(shown) >= self.limits).all(axis=1)
        return visible
