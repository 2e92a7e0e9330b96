"""Lights of some extent that the camera carries: a diffuse dome, coaxial light, a ring; and what edges show under them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ground.convert import Meta, check_fields
from planner.exceptions import RequestError
from planner.light.corner_light import SHARES, across
from planner.light.reflection import (
    Annulus,
    AreaEmitter,
    Cap,
    Material,
    Places,
    Window,
    brightness,
)

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.entities.entity import Entity
    from aspectgraph.solid.solid import RayScene
    from planner.camera.camera import Camera

Array = NDArray[np.float64]

Positive = Annotated[float, Meta(gt=0, title="must be finite and positive")]
_WORKING = Meta(ge=0, title="must be finite and not negative")

# places of the light that must be clear of the part, and by how much, mm
_BODY = 12
_CLEAR_MM = 1.0
# an edge is looked at three pixels from it, as under lamps
BESIDE_PX = 3.0
# of a rim or arc of many edges, each is looked at in its middle
_MANY_EDGES = 9
# so much of an edge must show: `measure` reads it if 80 % is found
SHOWN_SHARE = 0.85
# and no more than this share of a rim in one piece may be missing: `measure` wants points in each twelfth
_LONGEST_GAP = 1 / 12
# places nearer than this to each other in the image are on the same side of a thin wall
_MIDDLE = np.array([0.5])


@dataclass(frozen=True)
class DiffuseDome:
    """A dome around the optical axis that shines evenly inside; the camera looks through a hole in its top.

    Parameters
    ----------
    diameter_mm : float
        Inner diameter of the half sphere at its rim.
    hole_mm : float
        Diameter of the hole.
    working_mm : float
        Distance of its rim from the plane in focus.
    name : str
        Its name in the catalogue.

    Raises
    ------
    RequestError
        If a length breaks its rule, or the hole is not smaller than the dome.

    Examples
    --------
    >>> from planner import DiffuseDome
    >>> str(DiffuseDome(200, 30))
    'a diffuse dome of 200 mm with a hole of 30 mm, 30 mm above the plane in focus'
    """

    diameter_mm: Positive
    hole_mm: Positive
    working_mm: Annotated[float, _WORKING] = 30.0
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, RequestError)
        if not self.hole_mm < self.diameter_mm:
            rule = f"must be below diameter_mm, {self.diameter_mm:g}"
            raise RequestError.of_rule("hole_mm", rule, f"{self.hole_mm:g}")

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        size = f"of {self.diameter_mm:g} mm with a hole of {self.hole_mm:g} mm"
        return f"{_called('a diffuse dome', self.name)} {size}, {_above(self.working_mm)}"

    @property
    def kind(self) -> str:
        """Its word on the command line."""
        return "diffuse-dome"

    def emitter(self, cam2world: Array, focus_mm: float) -> AreaEmitter:
        """Return the shining surface of a camera with a pose (4, 4) that is focused at a distance, mm."""
        place, axis = _on_axis(cam2world, focus_mm - self.working_mm)
        return Cap(place, -axis, self.diameter_mm / 2, 0.0, self.hole_mm / 2)

    def looks_through(self, local: Array, focus_mm: float) -> NDArray[np.bool_]:
        """Return which points (n, 3) of the camera's frame, mm, are seen through it."""
        radius = self.hole_mm / 2
        height = np.sqrt((self.diameter_mm / 2) ** 2 - radius**2)
        return _within(local, focus_mm - self.working_mm - height, radius)


@dataclass(frozen=True)
class CoaxialLight:
    """A diffuse square that shines along the optical axis, by a beam splitter before the lens.

    The light comes from as far above the window as the window is wide, and through the window.

    Parameters
    ----------
    side_mm : float
        Side of the window towards the part.
    working_mm : float
        Distance of the window from the plane in focus.
    name : str
        Its name in the catalogue.

    Raises
    ------
    RequestError
        If a length breaks its rule.

    Examples
    --------
    >>> from planner import CoaxialLight
    >>> str(CoaxialLight(50))
    'coaxial light with a window of 50 mm, 50 mm above the plane in focus'
    """

    side_mm: Positive
    working_mm: Annotated[float, _WORKING] = 50.0
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, RequestError)

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        size = f"with a window of {self.side_mm:g} mm"
        return f"{_called('coaxial light', self.name)} {size}, {_above(self.working_mm)}"

    @property
    def kind(self) -> str:
        """Its word on the command line."""
        return "coaxial"

    def emitter(self, cam2world: Array, focus_mm: float) -> AreaEmitter:
        """Return the shining surface of a camera with a pose (4, 4) that is focused at a distance, mm."""
        window = focus_mm - self.working_mm
        place, _ = _on_axis(cam2world, window - self.side_mm)
        return Window(place, cam2world[:3, :3].T, self.side_mm, self.side_mm)

    def looks_through(self, local: Array, focus_mm: float) -> NDArray[np.bool_]:
        """Return which points (n, 3) of the camera's frame, mm, are seen through its window."""
        plane = focus_mm - self.working_mm
        at = plane * np.abs(local[:, :2]) / np.maximum(local[:, 2:], 1e-9)
        return np.asarray((at.max(axis=1) <= self.side_mm / 2) & (local[:, 2] > plane))


@dataclass(frozen=True)
class RingLight:
    """A flat ring around the optical axis that shines evenly towards the part.

    Parameters
    ----------
    inner_mm, outer_mm : float
        Diameters of the ring.
    working_mm : float
        Distance of the ring from the plane in focus.
    name : str
        Its name in the catalogue.

    Raises
    ------
    RequestError
        If a length breaks its rule, or the inner diameter is not below the outer one.

    Examples
    --------
    >>> from planner import RingLight
    >>> str(RingLight(60, 100, 150))
    'a ring light of 60 to 100 mm, 150 mm above the plane in focus'
    """

    inner_mm: Positive
    outer_mm: Positive
    working_mm: Annotated[float, _WORKING] = 100.0
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, RequestError)
        if not self.inner_mm < self.outer_mm:
            rule = f"must be below outer_mm, {self.outer_mm:g}"
            raise RequestError.of_rule("inner_mm", rule, f"{self.inner_mm:g}")

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        size = f"of {self.inner_mm:g} to {self.outer_mm:g} mm"
        return f"{_called('a ring light', self.name)} {size}, {_above(self.working_mm)}"

    @property
    def kind(self) -> str:
        """Its word on the command line."""
        return "ring-light"

    def emitter(self, cam2world: Array, focus_mm: float) -> AreaEmitter:
        """Return the shining surface of a camera with a pose (4, 4) that is focused at a distance, mm."""
        place, axis = _on_axis(cam2world, focus_mm - self.working_mm)
        return Annulus(place, axis, self.inner_mm / 2, self.outer_mm / 2)

    def looks_through(self, local: Array, focus_mm: float) -> NDArray[np.bool_]:
        """Return which points (n, 3) of the camera's frame, mm, are seen through it."""
        return _within(local, focus_mm - self.working_mm, self.inner_mm / 2)


MountedLight = DiffuseDome | CoaxialLight | RingLight
"""A light that the camera carries."""


def _called(kind: str, name: str) -> str:
    return f"{kind} {name}" if name else kind


def _above(working_mm: float) -> str:
    return f"{working_mm:g} mm above the plane in focus"


def _on_axis(cam2world: Array, distance_mm: float) -> tuple[Array, Array]:
    """Return a place on the optical axis and the axis."""
    axis = cam2world[:3, 2]
    return cam2world[:3, 3] + distance_mm * axis, axis


def _within(local: Array, plane_mm: float, radius_mm: float) -> NDArray[np.bool_]:
    """Return which points (n, 3) are seen through a round hole before the camera, and lie beyond it."""
    at = plane_mm * np.linalg.norm(local[:, :2], axis=1) / np.maximum(local[:, 2], 1e-9)
    return np.asarray((at <= radius_mm) & (local[:, 2] > plane_mm))


def check_fits(light: MountedLight, camera: Camera) -> None:
    """Refuse a light that does not fit between a camera and the plane in focus.

    Raises
    ------
    RequestError
        If the camera is focused at infinity, or nearer than the light is high.
    """
    focus = camera.focus_distance_mm
    heights = {"diffuse-dome": getattr(light, "diameter_mm", 0.0) / 2}
    needed = light.working_mm + heights.get(light.kind, getattr(light, "side_mm", 0.0))
    if not np.isfinite(focus) or needed >= focus:
        rule = f"must fit before the camera, which is focused at {focus:g} mm: {needed:g} mm needed"
        raise RequestError.of_rule("light", rule, str(light))


def touches(light: MountedLight, camera: Camera, cam2world: Array, scene: RayScene) -> bool:
    """Return whether the light would touch the part, at places spread over it."""
    u, v = np.meshgrid((np.arange(_BODY) + 0.5) / _BODY, (np.arange(2 * _BODY) + 0.5) / (2 * _BODY))
    numbers = np.column_stack([u.ravel(), v.ravel()])
    body = light.emitter(cam2world, camera.focus_distance_mm).points(numbers)
    if isinstance(light, CoaxialLight):
        body = np.concatenate([body, body + light.side_mm * cam2world[:3, 2]])
    return bool((scene.signed_distance(body) < _CLEAR_MM).any())


# What edges show.


class EdgeImage(NamedTuple):
    """What a camera sees beside edges of a target: points (n, 3), and places on both sides, nan for the ground.

    Attributes
    ----------
    points : array (n, 3)
        Points of the edges, mm, in order.
    places, normals : array (2, n, 3)
        On either side: places, mm, and unit normals towards the camera.
    closed : bool
        Whether the last point is beside the first one.
    """

    points: Array
    places: Array
    normals: Array
    closed: bool


def edge_image(
    solid: Solid, scene: RayScene, eye: Array, entity: Entity, pixel_rad: float
) -> EdgeImage:
    """Return what a camera sees beside the edges of an entity.

    Parameters
    ----------
    solid : Solid
        The part.
    scene : RayScene
        Of the part.
    eye : array (3,)
        Place of the camera, mm.
    entity : Entity
        An edge, rim or arc.
    pixel_rad : float
        Angle of a pixel.
    """
    shares = _MIDDLE if len(entity.edge_ids) >= _MANY_EDGES else SHARES
    points = []
    asides = []
    for edge in (solid.edges[i] for i in entity.edge_ids):
        start, end = solid.vertices[list(edge.vertices)]
        some = start + shares[:, None] * (end - start)
        points.append(some)
        asides.append(across(some - eye, end - start))
    joined = np.concatenate(points)
    sight = joined - eye
    off = (
        BESIDE_PX
        * pixel_rad
        * np.linalg.norm(sight, axis=1, keepdims=True)
        * _same_side(np.concatenate(asides), sight)
    )
    rays = np.stack([sight + off, sight - off])
    hit = scene.cast(eye, rays)
    depth = hit["t_hit"].astype(np.float64)
    met = np.isfinite(depth)
    normals = hit["primitive_normals"].astype(np.float64)
    normals *= np.where((normals * rays).sum(axis=-1) > 0, -1.0, 1.0)[..., None]
    places = np.where(met[..., None], eye + np.where(met, depth, 0.0)[..., None] * rays, np.nan)
    closed = len(entity.edge_ids) >= _MANY_EDGES and _is_closed(solid, entity)
    return EdgeImage(joined, places, normals, closed)


def _same_side(asides: Array, sight: Array) -> Array:
    """Return directions across edges that are all on the same side of a line of edges: away from its middle."""
    middle = sight.mean(axis=0)
    outward = ((sight - middle) * asides).sum(axis=1)
    straight = np.abs(outward).max() < 1e-6 * np.linalg.norm(middle)
    if straight:
        return np.asarray(asides * np.where(asides @ asides[0] < 0, -1.0, 1.0)[:, None])
    return np.asarray(asides * np.where(outward < 0, -1.0, 1.0)[:, None])


def _is_closed(solid: Solid, entity: Entity) -> bool:
    ends = np.array([solid.edges[i].vertices for i in entity.edge_ids]).ravel()
    return bool((np.unique(ends, return_counts=True)[1] == 2).all())


class Showing(NamedTuple):
    """How an edge, or all edges of a target, show under a light.

    Attributes
    ----------
    contrast : float
        Contrast that 85 % of the points have, with one sign; 0 if they do not show.
    step : float
        Difference of brightness that 85 % of the points have.
    brightest : float
        Of places beside the edges.
    pixel_place : array (3,)
        That place, mm; nan without one.
    """

    contrast: float
    step: float
    brightest: float
    pixel_place: Array


NOTHING = Showing(0.0, 0.0, 0.0, np.full(3, np.nan))


def showing(image: EdgeImage, bright: Array) -> Showing:
    """Return how an edge shows.

    Parameters
    ----------
    image : EdgeImage
        What is beside it.
    bright : array (2, n)
        Brightness of both sides, 0 for the ground.
    """
    step = bright[0] - bright[1]
    total = bright.sum(axis=0)
    contrast = step / np.where(total > 0, total, 1.0)
    sign = 1.0 if step.sum() >= 0 else -1.0
    at = int(np.argmax(bright))
    place = image.places.reshape(-1, 3)[at]
    sure = _sure(sign * contrast, image.closed)
    if sure <= 0:
        return Showing(0.0, 0.0, float(bright.max()), place)
    return Showing(sure, max(_sure(sign * step, image.closed), 0.0), float(bright.max()), place)


def _sure(values: Array, closed: bool) -> float:
    """Return the largest level that enough of the points reach, without too long a gap."""
    n = len(values)
    level = float(np.sort(values)[int((1 - SHOWN_SHARE) * n)])
    longest = max(1, int(_LONGEST_GAP * n))
    # the best of each run that is one longer than a gap may be: all of them must hold
    around = np.concatenate([values, values[:longest]]) if closed else values
    if len(around) > longest:
        runs = np.lib.stride_tricks.sliding_window_view(around, longest + 1).max(axis=1)
        level = min(level, float(runs.min()))
    return level


def shown_in(
    light: MountedLight,
    material: Material,
    solid: Solid,
    scene: RayScene,
    camera: Camera,
    cam2world: Array,
    entities: Mapping[str, Sequence[Entity]],
) -> dict[str, Showing]:
    """Return how targets show in one pose of a camera under the light that it carries.

    Parameters
    ----------
    light : MountedLight
        The light.
    material : Material
        Of the part.
    solid : Solid
        The part.
    scene : RayScene
        Of the part.
    camera : Camera
        The camera.
    cam2world : array (4, 4)
        Its pose.
    entities : mapping of str to sequence of Entity
        Edges, rims and arcs of each target.

    Returns
    -------
    dict of str to Showing
        The weakest of each target's entities; `NOTHING` if the camera does not see all of it
        through the light, or the light would touch the part.
    """
    if touches(light, camera, cam2world, scene):
        return dict.fromkeys(entities, NOTHING)
    eye = cam2world[:3, 3]
    pixel = max(camera.pixel_pitch_mm) / camera.image_distance_mm
    names = [name for name, items in entities.items() for _ in items]
    images = [
        edge_image(solid, scene, eye, item, pixel) for items in entities.values() for item in items
    ]
    bright = _brightness_of(
        light.emitter(cam2world, camera.focus_distance_mm), images, eye, scene, material
    )
    shown: dict[str, Showing] = {}
    for name, image, values in zip(names, images, bright, strict=True):
        local = (image.points - eye) @ cam2world[:3, :3]
        item = NOTHING
        if light.looks_through(local, camera.focus_distance_mm).all():
            item = showing(image, values)
        shown[name] = _weaker(shown[name], item) if name in shown else item
    return shown


def _brightness_of(
    emitter: AreaEmitter,
    images: Sequence[EdgeImage],
    eye: Array,
    scene: RayScene,
    material: Material,
) -> list[Array]:
    """Return the brightness (2, n) of both sides of each image; all in one call."""
    places = np.concatenate([image.places.reshape(-1, 3) for image in images])
    normals = np.concatenate([image.normals.reshape(-1, 3) for image in images])
    met = np.isfinite(places[:, 0])
    views = eye - places[met]
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    bright = np.zeros(len(places))
    bright[met] = brightness(scene, emitter, Places(places[met], normals[met], views), material)
    ends = np.cumsum([2 * len(image.points) for image in images])[:-1]
    return [part.reshape(2, -1) for part in np.split(bright, ends)]


def _weaker(one: Showing, other: Showing) -> Showing:
    weak = min(one, other, key=lambda item: item.contrast)
    bright = max(one, other, key=lambda item: item.brightest)
    step = min(one.step, other.step)
    return Showing(weak.contrast, step, bright.brightest, bright.pixel_place)
