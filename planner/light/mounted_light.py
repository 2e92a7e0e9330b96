"""Lights with an area that the camera carries: a diffuse dome, coaxial light, a ring; on matt parts and on metal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import ceil, hypot
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ground.convert import STATED, Meta, check_fields
from planner.exceptions import RequestError
from planner.light.area_light import (
    COVERAGE,
    EdgePoints,
    Misplaced,
    places_seen,
    spoken,
    ways_beside,
)
from planner.light.reflection import (
    BOUNCES,
    RAYS,
    Annulus,
    AreaEmitter,
    Cap,
    CarriedEmitter,
    Material,
    Places,
    Window,
    brightness,
)

if TYPE_CHECKING:
    from aspectgraph import CellSet, Solid
    from aspectgraph.solid.solid import RayScene
    from planner.camera.camera import Camera
    from planner.light.area_light import Sight

# A light moves with the camera, so where it shines from is known with the pose: `held`. The search looks for viewpoints
# before it turns the camera. There, the camera is taken to look at the middle of the part.
#
# An edge shows if the places that are seen three pixels beside it, on both sides, differ in brightness. Rays find them:
# faces of the edge, what is behind a silhouette, or the ground, which is dark.

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_Positive = Annotated[float, Meta(gt=0, title="must be finite and positive")]

# places of the light that must be clear of the part, along it and around it, and by how much, mm
_BODY = 12
_CLEAR_MM = 1.0
# tilts of a face at which the brightest one is looked for
_TILTS_DEG = np.arange(0.0, 61.0, 10.0)
# rays by the number of places: pictures have a place for each pixel
_MANY = 2000
_PICTURE = 20_000
_FEW_RAYS = 64
_PICTURE_RAYS = 16
# the search asks for many cameras: points of an entity, rays, and cameras at a time
_SEARCH_POINTS = 8
_SEARCH_RAYS = 8
_SEARCH_EYES = 200
# default sizes: rim of a dome and window of coaxial light above the plane in focus, and a ring before the lens, mm
DOME_WORKING_MM = 30.0
COAXIAL_WORKING_MM = 50.0
_RING_MM = 30.0
_RING_INNER_MM = 50.0
_RING_WIDTH_MM = 20.0
# radius of a dome, in widths of what the camera sees
_DOME_SHARE = 1.5
# holes and windows are larger than the field by this share
_MARGIN = 1.1
# length of the mean of a face's unit normals from which on it is flat
_FLAT = 0.999
_TINY = 1e-9


class _Carried:
    """What all lights have in common that the camera carries."""

    # of the records that inherit
    kind: str
    name: str
    material: Material
    distance_mm: float

    def emitter(self, cam2world: Array) -> AreaEmitter:
        """Return the shining surface for a camera with a pose.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.

        Returns
        -------
        AreaEmitter
            In the world.
        """
        return self._surface(np.asarray(cam2world, dtype=np.float64))

    def _surface(self, cam2world: Array) -> AreaEmitter:
        raise NotImplementedError

    def looks_through(self, local: Array) -> Bools:
        """Return which points are seen through the light, and beyond it.

        Parameters
        ----------
        local : array (n, 3)
            In the camera's frame, mm.

        Returns
        -------
        array of bool (n,)
            Whether it is.
        """
        raise NotImplementedError

    def body(self, cam2world: Array) -> Array:
        """Return points of its surface, which must be clear of the part.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.

        Returns
        -------
        array (n, 3)
            In mm.
        """
        return self.emitter(cam2world).points(_grid())

    @property
    def description(self) -> str:
        """What a sentence calls it."""
        raise NotImplementedError

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        return self.description

    @property
    def reason(self) -> str:
        """Why a target is not shown where the light is not `misplaced`."""
        return f"has too little contrast or light under the {spoken(self.kind)}, at the camera or nearby"

    @property
    def outline(self) -> Array:
        """No corners (0, 3): pictures draw nothing, as the light moves."""
        return np.empty((0, 3))

    @property
    def only_outlines(self) -> bool:
        """False: edges between faces show, too."""
        return False

    @property
    def on_metal(self) -> bool:
        """Whether the part is metal."""
        return self.material.kind == "metal"

    @property
    def square_on(self) -> bool:
        """Whether only faces at right angles to the optical axis are bright."""
        return False

    def check_part(self, solid: Solid) -> None:
        """Accept any part: whether the light touches it depends on the pose.

        Parameters
        ----------
        solid : Solid
            The part.
        """

    def in_front(self, cells: CellSet) -> CellSet:
        """Return all cells: the camera carries the light.

        Parameters
        ----------
        cells : CellSet
            Cells of viewpoints.

        Returns
        -------
        CellSet
            The same.
        """
        return cells

    def held(self, cam2world: Array) -> HeldLight:
        """Return the light as a camera with a pose carries it.

        Parameters
        ----------
        cam2world : array (4, 4)
            The pose.

        Returns
        -------
        HeldLight
            Which answers for this pose and those near it.
        """
        return HeldLight(self, np.asarray(cam2world, dtype=np.float64))

    def misplaced(self, scene: RayScene, cam2world: Array, points: Array) -> Misplaced | None:
        """Say why the light cannot show a target where its camera is.

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
            The reason. None if the light is clear of the part, and at least as many points lie in its
            opening, and beyond it, as must show.
        """
        if self.held(cam2world).touches(scene):
            return Misplaced(f"the {spoken(self.kind)} would touch the part")
        local = (points - cam2world[:3, 3]) @ cam2world[:3, :3]
        through = float(self.looks_through(local).mean())
        if through < COVERAGE:
            kind = spoken(self.kind)
            text = f"lies in the opening of the {kind}, on the side away from the camera"
            return Misplaced(text, f"only {100 * through:.0f} % of it")
        return None

    def brightest(self, distance_mm: float) -> float:
        """Return how bright a face on the axis is, tilted as is best.

        Parameters
        ----------
        distance_mm : float
            From the camera.

        Returns
        -------
        float
            The light itself is 1.
        """
        # the search asks at many distances that differ little
        return _brightest(self, float(f"{distance_mm:.3g}"))

    def contrasts(self, sight: Sight, edges: EdgePoints, eyes: Array) -> tuple[Array, Array]:
        """Return contrast and step of points of edges for cameras that look where it is likely, see `likely_poses`.

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
        chosen = np.unique(np.linspace(0, len(edges.points) - 1, _SEARCH_POINTS).astype(int))
        nearest = np.abs(np.arange(len(edges.points))[:, None] - chosen).argmin(axis=1)
        few = EdgePoints(*(values[chosen] for values in edges))
        poses = self.likely_poses(sight, edges, eyes)
        contrast = np.empty((len(eyes), len(edges.points)))
        step = np.empty_like(contrast)
        for first in range(0, len(eyes), _SEARCH_EYES):
            block = slice(first, first + _SEARCH_EYES)
            shown = self._shown_quickly(sight, few, eyes[block], poses[block])
            contrast[block], step[block] = (values[:, nearest] for values in shown)
        return contrast, step

    def likely_poses(self, sight: Sight, edges: EdgePoints, eyes: Array) -> Array:
        """Return poses (n, 4, 4) of cameras at eyes (n, 3), before the search turns them: they look at the part.

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
        array (n, 4, 4)
            Camera to world.
        """
        return looking_at(eyes, np.mean(sight.solid.bounds, axis=0))

    def _shown_quickly(
        self, sight: Sight, edges: EdgePoints, eyes: Array, poses: Array
    ) -> tuple[Array, Array]:
        """Return contrast and step (n, m) for cameras with poses (n, 4, 4), by few rays."""
        ways = ways_beside(sight, edges, eyes)
        seen, met = places_seen(sight.scene, eyes[:, None], ways)
        of_eye = np.broadcast_to(np.arange(len(eyes))[:, None], ways.shape[:-1])[met]
        bright = np.zeros(ways.shape[:-1])
        if len(of_eye):
            light = CarriedEmitter(self.emitter(np.eye(4)), poses[of_eye])
            bright[met] = brightness(sight.scene, light, seen, self.material, _SEARCH_RAYS, 1)
        local = np.einsum("nji,nmj->nmi", poses[:, :3, :3], edges.points - eyes[:, None])
        reference = self.brightest(float(np.median(local[..., 2])))
        through = self.looks_through(local.reshape(-1, 3)).reshape(local.shape[:2])
        return _contrast_and_step(bright, through, reference)

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return how bright a camera sees what rays meet, if it looks along their mean.

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
            The light itself is 1.
        """
        ahead = eye + rays.reshape(-1, 3).mean(axis=0)
        return self.held(looking_at(eye[None], ahead)[0]).brightness(scene, eye, rays)


@lru_cache(maxsize=1000)
def _brightest(light: _Carried, distance_mm: float) -> float:
    """Return how bright the brightest face on the axis is at a distance from the camera; there is no part."""
    axis = np.array([0.0, 0.0, 1.0])
    tilts = np.radians(_TILTS_DEG)[:, None]
    normals = -np.cos(tilts) * axis + np.sin(tilts) * np.array([1.0, 0.0, 0.0])
    places = Places(
        np.broadcast_to(distance_mm * axis, normals.shape),
        normals,
        np.broadcast_to(-axis, normals.shape),
    )
    bright = brightness(_NOTHING, light.emitter(np.eye(4)), places, light.material, RAYS, 0)
    return max(float(bright.max()), _TINY)


def _grid() -> Array:
    """Return numbers (n, 2) in [0, 1) that are spread evenly."""
    u = (np.arange(_BODY) + 0.5) / _BODY
    v = (np.arange(2 * _BODY) + 0.5) / (2 * _BODY)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def flat_normals(edges: EdgePoints) -> Array:
    """Return the unit normals (k, 3) of the flat faces beside points of edges, at most two."""
    means = edges.normals.mean(axis=0)
    lengths = np.linalg.norm(means, axis=1, keepdims=True)
    return np.asarray((means / np.maximum(lengths, _TINY))[lengths[:, 0] > _FLAT])


def looking_at(eyes: Array, point: Array) -> Array:
    """Return poses (n, 4, 4) of cameras at places (n, 3) that look at a point (3,), mm."""
    axis = point - eyes
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), _TINY)
    right = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(eyes), 1, 1))
    poses[:, :3, :3] = np.stack([right, np.cross(axis, right), axis], axis=-1)
    poses[:, :3, 3] = eyes
    return poses


def _contrast_and_step(bright: Array, through: Bools, reference: float) -> tuple[Array, Array]:
    """Return contrast and step (n, m) of brightness (2, n, m); 0 for points that are not seen through the light."""
    step = np.abs(bright[0] - bright[1])
    total = bright.sum(axis=0)
    contrast = np.where(through, step / np.where(total > 0, total, 1.0), 0.0)
    return contrast, np.where(through, np.minimum(step / reference, 1.0), 0.0)


@dataclass(frozen=True, eq=False)
class HeldLight:
    """A light as a camera with a pose carries it: an area light that stands.

    Attributes
    ----------
    light : MountedLight
        The light.
    cam2world : array (4, 4)
        Pose of the camera.
    """

    light: Any
    cam2world: Array

    def contrasts(self, sight: Sight, edges: EdgePoints, eyes: Array) -> tuple[Array, Array]:
        """Return contrast and step (n, m) of points of edges for cameras at eyes (n, 3), near the pose.

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
        if self.touches(sight.scene):
            zero = np.zeros((len(eyes), len(edges.points)))
            return zero, zero.copy()
        if len(eyes) * len(edges.points) > _MANY:
            return self.shown(sight, edges, eyes, _FEW_RAYS, 1)
        return self.shown(sight, edges, eyes, RAYS, BOUNCES)

    def touches(self, scene: RayScene) -> bool:
        """Return whether the light would touch the part."""
        return bool((scene.signed_distance(self.light.body(self.cam2world)) < _CLEAR_MM).any())

    def shown(
        self, sight: Sight, edges: EdgePoints, eyes: Array, rays: int, bounces: int
    ) -> tuple[Array, Array]:
        """Return contrast and step, by so many rays and reflections; see `contrasts`."""
        ways = ways_beside(sight, edges, eyes)
        bright = self._seen(sight.scene, eyes[:, None], ways, rays, bounces)
        local = (edges.points - self.cam2world[:3, 3]) @ self.cam2world[:3, :3]
        reference = self.light.brightest(float(np.median(local[:, 2])))
        return _contrast_and_step(bright, self.light.looks_through(local), reference)

    def brightness(self, scene: RayScene, eye: Array, rays: Array) -> Array:
        """Return how bright a camera sees what rays meet.

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
            The light itself is 1.
        """
        n = rays.size // 3
        if n <= _MANY:
            return self._seen(scene, eye, rays, RAYS, BOUNCES)
        few = _FEW_RAYS if n <= _PICTURE else _PICTURE_RAYS
        return self._seen(scene, eye, rays, few, 1)

    def _seen(self, scene: RayScene, eyes: Array, ways: Array, rays: int, bounces: int) -> Array:
        """Return how bright (...) what is seen along rays (..., 3) is; the ground is dark."""
        seen, met = places_seen(scene, eyes, ways)
        bright = np.zeros(ways.shape[:-1])
        emitter = self.light.emitter(self.cam2world)
        bright[met] = brightness(scene, emitter, seen, self.light.material, rays, bounces)
        return bright


class _Nothing:
    """A scene without a part."""

    def cast(self, origins: Array, directions: Array) -> dict[str, Array]:
        """Return that no ray meets anything."""
        shape = directions.shape
        return {"t_hit": np.full(shape[:-1], np.inf), "primitive_normals": np.zeros(shape)}

    def blocked(self, origins: Array, directions: Array, up_to: float = 1.0) -> Bools:
        """Return that nothing is in the way."""
        return np.zeros(directions.shape[:-1], dtype=bool)


_NOTHING: Any = _Nothing()


@dataclass(frozen=True)
class DiffuseDome(_Carried):
    """A dome around the optical axis that shines evenly inside; the camera looks through a hole in its top.

    Parameters
    ----------
    diameter_mm : float
        Diameter of the half sphere at its rim.
    hole_mm : float
        Diameter of the hole.
    distance_mm : float
        Distance of the rim from the camera's front nodal point, along the axis.
    material : Material
        Of the part.
    name : str
        Name in the catalogue, or empty.

    Raises
    ------
    RequestError
        If a length breaks its rule, or the hole is not smaller than the dome, or the dome is higher than the camera.

    Examples
    --------
    >>> from planner import DiffuseDome
    >>> print(DiffuseDome(200, 60, 270))
    a diffuse dome of 200 mm with a hole of 60 mm, its rim 270 mm before the camera
    """

    kind: Annotated[Literal["diffuse-dome"], STATED] = field(default="diffuse-dome", init=False)
    diameter_mm: _Positive
    hole_mm: _Positive
    distance_mm: _Positive
    material: Material = field(default_factory=Material)
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, RequestError)
        if not self.hole_mm < self.diameter_mm:
            rule = f"must be below diameter_mm, {self.diameter_mm:g}"
            raise RequestError.of_rule("hole_mm", rule, f"{self.hole_mm:g}")
        if not self.diameter_mm / 2 < self.distance_mm:
            rule = f"must be above half of diameter_mm, {self.diameter_mm / 2:g}"
            raise RequestError.of_rule("distance_mm", rule, f"{self.distance_mm:g}")

    @classmethod
    def on(cls, camera: Camera, material: Material | None = None, part_mm: float = np.inf) -> Self:
        """Return a dome for a camera: its rim 30 mm above the plane in focus, three times as wide as field or part.

        Parameters
        ----------
        camera : Camera
            The camera.
        material : Material, optional
            Of the part. Default: matt.
        part_mm : float
            Diagonal of the part. A ring does not depend on it.
        """
        distance = distance_before(camera, DOME_WORKING_MM, "a diffuse dome")
        width = min(_field_mm(camera, distance), part_mm)
        radius = min(ceil(_DOME_SHARE * width), 0.8 * distance)
        radius = max(radius, min(50.0, 0.5 * distance))
        share = (distance - radius) / distance
        hole = min(ceil(_MARGIN * share * width), 1.8 * radius)
        return cls(2 * radius, hole, distance, material or Material())

    @property
    def description(self) -> str:
        """What a sentence calls it."""
        size = f"of {self.diameter_mm:g} mm with a hole of {self.hole_mm:g} mm"
        return f"{_called('a diffuse dome', self.name)} {size}, its rim {_ahead(self.distance_mm)}"

    def _surface(self, cam2world: Array) -> AreaEmitter:
        place, axis = _on_axis(cam2world, self.distance_mm)
        return Cap(place, -axis, self.diameter_mm / 2, 0.0, self.hole_mm / 2)

    def looks_through(self, local: Array) -> Bools:
        """Return which points are seen through the hole.

        Parameters
        ----------
        local : array (n, 3)
            In the camera's frame, mm.

        Returns
        -------
        array of bool (n,)
            Whether it is.
        """
        height = np.sqrt((self.diameter_mm / 2) ** 2 - (self.hole_mm / 2) ** 2)
        return _within(local, self.distance_mm - height, self.hole_mm / 2)


@dataclass(frozen=True)
class CoaxialLight(_Carried):
    """A diffuse square that shines along the optical axis, by a beam splitter before the lens.

    The light comes from as far above the window as the window is wide, and through the window.

    Parameters
    ----------
    side_mm : float
        Side of the window towards the part.
    distance_mm : float
        Distance of the window from the camera's front nodal point, along the axis.
    material : Material
        Of the part.
    name : str
        Name in the catalogue, or empty.

    Raises
    ------
    RequestError
        If a length breaks its rule.

    Examples
    --------
    >>> from planner import CoaxialLight
    >>> print(CoaxialLight(50, 150))
    coaxial light with a window of 50 mm, 150 mm before the camera
    """

    kind: Annotated[Literal["coaxial"], STATED] = field(default="coaxial", init=False)
    side_mm: _Positive
    distance_mm: _Positive
    material: Material = field(default_factory=Material)
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, RequestError)

    @classmethod
    def on(cls, camera: Camera, material: Material | None = None, part_mm: float = np.inf) -> Self:
        """Return a light for a camera: its window 50 mm above the plane in focus, as wide as field or part.

        Parameters
        ----------
        camera : Camera
            The camera.
        material : Material, optional
            Of the part. Default: matt.
        part_mm : float
            Diagonal of the part. A ring does not depend on it.
        """
        distance = distance_before(camera, COAXIAL_WORKING_MM, "coaxial light")
        sides = [side * distance / camera.image_distance_mm for side in camera.sensor_size_mm]
        side = ceil(_MARGIN * min(max(sides), part_mm))
        return cls(side, distance, material or Material())

    @property
    def description(self) -> str:
        """What a sentence calls it."""
        size = f"with a window of {self.side_mm:g} mm"
        return f"{_called('coaxial light', self.name)} {size}, {_ahead(self.distance_mm)}"

    def _surface(self, cam2world: Array) -> AreaEmitter:
        place, _ = _on_axis(cam2world, self.distance_mm - self.side_mm)
        return Window(place, cam2world[:3, :3].T, self.side_mm, self.side_mm)

    @property
    def square_on(self) -> bool:
        """True on metal: the light comes along the optical axis, and metal mirrors it."""
        return self.on_metal

    def likely_poses(self, sight: Sight, edges: EdgePoints, eyes: Array) -> Array:
        """Return poses (n, 4, 4) of cameras at eyes (n, 3); on metal, they look square at a flat face of the edges.

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
        array (n, 4, 4)
            Camera to world.
        """
        normals = flat_normals(edges)
        if not self.square_on or not len(normals):
            return super().likely_poses(sight, edges, eyes)
        facing = (eyes - edges.points.mean(axis=0)) @ normals.T
        chosen = normals[facing.argmax(axis=1)]
        poses = looking_at(chosen, np.zeros(3))
        poses[:, :3, 3] = eyes
        return poses

    def body(self, cam2world: Array) -> Array:
        """Return points of its case: the square where the light comes from, and the window.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.

        Returns
        -------
        array (n, 3)
            In mm.
        """
        square = self.emitter(cam2world).points(_grid())
        return np.concatenate([square, square + self.side_mm * cam2world[:3, 2]])

    def looks_through(self, local: Array) -> Bools:
        """Return which points are seen through the window.

        Parameters
        ----------
        local : array (n, 3)
            In the camera's frame, mm.

        Returns
        -------
        array of bool (n,)
            Whether it is.
        """
        share = self.distance_mm / np.maximum(local[:, 2], _TINY)
        within = np.abs(local[:, :2]).max(axis=1) * share <= self.side_mm / 2
        return np.asarray(within & (local[:, 2] > self.distance_mm))


@dataclass(frozen=True)
class RingLight(_Carried):
    """A flat ring around the optical axis that shines evenly towards the part.

    Parameters
    ----------
    inner_mm, outer_mm : float
        Diameters of the ring.
    distance_mm : float
        Distance of the ring from the camera's front nodal point, along the axis.
    material : Material
        Of the part.
    name : str
        Name in the catalogue, or empty.

    Raises
    ------
    RequestError
        If a length breaks its rule, or the inner diameter is not below the outer one.

    Examples
    --------
    >>> from planner import RingLight
    >>> print(RingLight(60, 100, 50))
    a ring light of 60 to 100 mm, 50 mm before the camera
    """

    kind: Annotated[Literal["ring-light"], STATED] = field(default="ring-light", init=False)
    inner_mm: _Positive
    outer_mm: _Positive
    distance_mm: _Positive
    material: Material = field(default_factory=Material)
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, RequestError)
        if not self.inner_mm < self.outer_mm:
            rule = f"must be below outer_mm, {self.outer_mm:g}"
            raise RequestError.of_rule("inner_mm", rule, f"{self.inner_mm:g}")

    @classmethod
    def on(cls, camera: Camera, material: Material | None = None, part_mm: float = np.inf) -> Self:
        """Return a ring for a camera: 30 mm before it, of at least 50 to 90 mm.

        Parameters
        ----------
        camera : Camera
            The camera.
        material : Material, optional
            Of the part. Default: matt.
        part_mm : float
            Diagonal of the part. A ring does not depend on it.
        """
        inner = max(_RING_INNER_MM, ceil(_MARGIN * _field_mm(camera, _RING_MM)))
        return cls(inner, inner + 2 * _RING_WIDTH_MM, _RING_MM, material or Material())

    @property
    def description(self) -> str:
        """What a sentence calls it."""
        size = f"of {self.inner_mm:g} to {self.outer_mm:g} mm"
        return f"{_called('a ring light', self.name)} {size}, {_ahead(self.distance_mm)}"

    def _surface(self, cam2world: Array) -> AreaEmitter:
        place, axis = _on_axis(cam2world, self.distance_mm)
        return Annulus(place, axis, self.inner_mm / 2, self.outer_mm / 2)

    def looks_through(self, local: Array) -> Bools:
        """Return which points are seen through the ring.

        Parameters
        ----------
        local : array (n, 3)
            In the camera's frame, mm.

        Returns
        -------
        array of bool (n,)
            Whether it is.
        """
        return _within(local, self.distance_mm, self.inner_mm / 2)


MountedLight: TypeAlias = DiffuseDome | CoaxialLight | RingLight
"""A light that the camera carries."""

MOUNTED: dict[str, Callable[[Camera, Material | None, float], MountedLight]] = {
    "diffuse-dome": DiffuseDome.on,
    "coaxial": CoaxialLight.on,
    "ring-light": RingLight.on,
}
"""What makes each kind for a camera."""


def of_material(light: MountedLight, material: Material) -> MountedLight:
    """Return the same light on a part of another material."""
    return replace(light, material=material)


def _called(kind: str, name: str) -> str:
    return f"{kind} {name}" if name else kind


def _ahead(distance_mm: float) -> str:
    return f"{distance_mm:g} mm before the camera"


def _field_mm(camera: Camera, distance_mm: float) -> float:
    """Return the diagonal of the field at a distance."""
    return hypot(*camera.sensor_size_mm) * distance_mm / camera.image_distance_mm


def distance_before(camera: Camera, working_mm: float, what: str) -> float:
    """Return the distance from a camera to a plane above the plane in focus, at least half of that one's.

    Raises
    ------
    RequestError
        If the camera is focused at infinity.
    """
    focus = camera.focus_distance_mm
    if not np.isfinite(focus):
        rule = f"must be finite for {what}, which hangs above the plane in focus"
        raise RequestError.of_rule("focus_distance_mm", rule, f"{focus}")
    return max(focus - working_mm, focus / 2)


def _on_axis(cam2world: Array, distance_mm: float) -> tuple[Array, Array]:
    """Return a place on the optical axis and the axis."""
    axis = cam2world[:3, 2]
    return cam2world[:3, 3] + distance_mm * axis, axis


def _within(local: Array, plane_mm: float, radius_mm: float) -> Bools:
    """Return which points (n, 3) are seen through a round hole before the camera, and lie beyond it."""
    at = plane_mm * np.linalg.norm(local[:, :2], axis=1) / np.maximum(local[:, 2], _TINY)
    return np.asarray((at <= radius_mm) & (local[:, 2] > plane_mm))
