"""The lamps of a plan: where they are, and which one shows what in which setting."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from ground.convert import STATED, Meta, NullIs, Shape, from_plain, to_plain
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from ground.short_repr import count, short_repr
from planner.camera.camera import Camera, image_of, tangents_of
from planner.camera.pose import world_to_cam
from planner.exceptions import PlanFileError
from planner.light.area_light import AreaLight, area_brightness
from planner.light.area_lights import AreaRecord
from planner.plan_file import Amount, Coordinates, Count, Fraction, Reasons, Share
from planner.request.targets import targets_of

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.solid.solid import RayScene
    from planner.verify.simulate_setting import Planned


_Pixel = Annotated[int, Meta(ge=0, title="must be an integer from 0")]


class Exposure(NamedTuple):
    """What one image is exposed for.

    Attributes
    ----------
    target : str
        The brightest point at an edge is next to this target.
    pixel : (int, int)
        Middle of the region to look at, px: u and v.
    dimmest : str
        The target whose edges get least light.
    times : float
        How many times less; infinite if most of its edges get none.
    radius_px : int
        Radius of the region; 0 for the pixel alone.
    share : float
        Share of white that the mean of the region should have. The brightest point next to an edge then has 80 %, or
        less where much of the image would be overexposed, see `white_share`.
    """

    target: str
    pixel: Annotated[tuple[_Pixel, _Pixel], Meta(title="must be two integers from 0, u and v")]
    dimmest: str
    times: Annotated[float, NullIs(math.inf), Meta(ge=1, title="must be a number from 1, or null")]
    radius_px: _Pixel = 0
    share: Annotated[float, Meta(gt=0, le=1, title="must be a number in (0, 1]")] = 0.8


@dataclass(frozen=True)
class LitImage:
    """One image to take in a setting, with its lamps.

    Attributes
    ----------
    lamps : tuple of int
        Numbers of the lamps that are on, in ascending order.
    contrast : dict of str to float
        Per target, the least contrast of its edges, see `aspectgraph.contrast`. Of a silhouette, it
        is the contrast with the background.
    silhouettes : tuple of str
        Names of targets with at least one edge that the camera sees as a silhouette.
    expose_for : Exposure or None
        The region to look at, for a matt part of one albedo. None if its light was not computed, as
        in plans of earlier programs.
    """

    lamps: Annotated[tuple[Count, ...], Meta(title="must be an array of numbers of lamps")]
    contrast: Annotated[
        Mapping[str, Share], Meta(min_length=1, title="must map at least one name to a contrast")
    ]
    silhouettes: Annotated[
        tuple[str, ...],
        STATED,
        Meta(
            title="must be an array of names, all different",
            extra_json_schema={"uniqueItems": True},
        ),
    ] = ()
    expose_for: Exposure | None = None

    __repr__ = short_repr

    def exposure_dict(self) -> dict[str, Any] | None:
        """Return what the image is exposed for as plain values, ready for JSON.

        Returns
        -------
        dict or None
            An infinite ratio is None.
        """
        return None if self.expose_for is None else to_plain(self.expose_for, defaults=True)


@dataclass(frozen=True)
class LitSetting:
    """The images of a setting and its unlit targets, as files hold them."""

    images: Annotated[tuple[LitImage, ...], Meta(title="must be an array of images")]
    unlit: Reasons


@dataclass(frozen=True, eq=False)
class LightRecord:
    """Lamps that make what is measured show, in every setting, as files hold them."""

    kind: Literal["fixed", "ring", "placed", "backlight", "diffuse-dome", "coaxial", "ring-light"]
    contrast: Fraction
    step: Amount
    ground: Literal["dark", "bright"]
    together: bool
    lamps: Annotated[NDArray[np.float64], Shape(None, 3), Coordinates]
    lower_bound: Count
    bound_proof: str
    settings: Annotated[
        tuple[LitSetting, ...], Meta(title="must be an array with one object per setting")
    ]
    area: AreaRecord | None = None

    @property
    def light(self) -> LightPlan:
        """The light plan."""
        return LightPlan(
            **{name: getattr(self, name) for name in _SHARED},
            images=tuple(setting.images for setting in self.settings),
            unlit=tuple(setting.unlit for setting in self.settings),
        )


# fields that a file holds as they are
_SHARED = tuple(item.name for item in fields(LightRecord) if item.name != "settings")


@dataclass(frozen=True, eq=False, repr=False)
class LightPlan(ShownInNotebook):
    """Lamps that light the targets of a plan.

    Attributes
    ----------
    kind : str
        "fixed", "ring" or "placed", or the kind of a light with an area, such as "backlight".
    contrast : float
        Least contrast.
    step : float
        Least step of grey values, as a share of the value of a face lit frontally.
    ground : str
        "dark", or "bright" for a back light.
    lamps : array (n, 3)
        Positions of the lamps in use, mm. One is on at a time, or all are. None of a light with an
        area.
    images : tuple of tuple of LitImage
        Per setting, the images to take. There is one, unless no single lamp lights all targets.
    unlit : tuple of dict of str to str
        Per setting, the unlit targets and the reasons.
    lower_bound : int
        Proven lower bound of the number of lamps.
    bound_proof : str
        How the bound was proven.
    together : bool
        Whether all lamps are on in every image.
    area : Backlight, DiffuseDome, CoaxialLight, RingLight or None
        The light with an area, which is on in every image.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import plan_light, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> light = plan_light(plan, read_solid("examples/two_pocket_block.off"), "ring")
    >>> light.complete, len(light.lamps), sorted(light.unlit[0])
    (False, 1, ['e1', 'e4'])
    """

    kind: str
    contrast: float
    step: float
    ground: str
    lamps: NDArray[np.float64]
    images: tuple[tuple[LitImage, ...], ...]
    unlit: tuple[Mapping[str, str], ...]
    lower_bound: int
    bound_proof: str = field(default="")
    together: bool = False
    area: AreaLight | None = None

    def __post_init__(self) -> None:
        places = np.array(self.lamps, dtype=np.float64).reshape(-1, 3)
        places.setflags(write=False)
        object.__setattr__(self, "lamps", places)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        dark = sum(map(len, self.unlit))
        images = count(sum(map(len, self.images)), "image")
        return f"<LightPlan: {self._source}, contrast {self.contrast:g}, {images}, {dark} unlit>"

    @property
    def _source(self) -> str:
        """What lights the images."""
        if self.area is not None:
            return str(self.area)
        lamps = count(len(self.lamps), f"{self.kind} lamp")
        return f"{lamps} (at least {self.lower_bound} needed)"

    def _notebook_view(self) -> NotebookView:
        rows: list[tuple[Any, ...]] = []
        for number, images in enumerate(self.images, start=1):
            for image in images:
                places = [", ".join(f"{c:.1f}" for c in self.lamps[lamp]) for lamp in image.lamps]
                lamps = ", ".join(f"{lamp + 1}" for lamp in image.lamps)
                weakest = f"{min(image.contrast.values()):.2f}"
                which = () if self.area is not None else (lamps, "; ".join(places))
                rows.append((number, *which, ", ".join(image.contrast), weakest))
        headings = ["setting", "lamp", "at (mm)", "shows", "smallest contrast"]
        right = [0, 1, 4]
        if self.area is not None:
            # its place is that of the camera, or known
            headings[1:3] = []
            right = [0, 2]
        lines = (
            self._verdict(),
            f"{self._source}, "
            f"{count(len(rows), 'image')}, {self.ground} background, contrast ≥ {self.contrast:g}",
        )
        unlit = {
            f"{name} in setting {number}": reason
            for number, reasons in enumerate(self.unlit, start=1)
            for name, reason in reasons.items()
        }
        title = "Lamps" if self.area is None else "Light"
        return NotebookView(title, lines, NotebookTable(headings, rows, right=right), unlit)

    def _verdict(self) -> Toned:
        if not self.complete:
            n = sum(map(len, self.unlit))
            return Toned(f"{count(n, 'target is', 'targets are')} not lit.", "bad")
        if self.area is not None:
            return Toned("Every target of the settings is lit.", "good")
        if not self.minimal:
            return Toned("Every target of the settings is lit; fewer lamps may be enough.", "open")
        return Toned("Every target of the settings is lit; fewer lamps are not enough.", "good")

    @property
    def complete(self) -> bool:
        """Whether all targets are lit in every setting."""
        return not any(self.unlit)

    @property
    def minimal(self) -> bool:
        """Whether the bound proves that fewer lamps are not enough."""
        return bool(len(self.lamps)) and len(self.lamps) == self.lower_bound

    def numbered_by_use(self) -> LightPlan:
        """Return the plan with lamps that it placed in the order in which images use them first, unused ones last.

        Given lamps keep their order.

        Returns
        -------
        LightPlan
            The same lamps and images under other numbers.
        """
        if self.kind != "placed":
            return self
        images = [image for lit_images in self.images for image in lit_images]
        order = list(dict.fromkeys(lamp for image in images for lamp in image.lamps))
        order += [lamp for lamp in range(len(self.lamps)) if lamp not in order]
        number = {lamp: k for k, lamp in enumerate(order)}

        def renumbered(image: LitImage) -> LitImage:
            return replace(image, lamps=tuple(sorted(number[lamp] for lamp in image.lamps)))

        numbered_images = tuple(tuple(map(renumbered, lit_images)) for lit_images in self.images)
        places = self.lamps[np.array(order, dtype=int)]
        return replace(self, lamps=places, images=numbered_images)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON.

        Returns
        -------
        dict
            Lists, texts and numbers.
        """
        settings = tuple(map(LitSetting, self.images, self.unlit))
        shared = {name: getattr(self, name) for name in _SHARED}
        return to_plain(LightRecord(**shared, settings=settings))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> LightPlan:
        """Build from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        LightPlan
            Equal to the one written.
        """
        return from_plain(LightRecord, data, PlanFileError).light

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LightPlan):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]


# What to expose an image for: the brightest place beside the edges of its targets, for a matt
# part of one albedo.
#
# The real camera is displaced, so the pixel that shows this place may show another face. A region
# is named that is evenly lit, also around it, as far as the displacement may move the image. How
# much brighter the place beside edges is than this region, is computed.


Array = NDArray[np.float64]

WHITE_SHARE = 0.8
"""Share of white that the brightest place beside an edge should have."""

_BESIDE_PX = 3.0
# in eight directions
_RING = _BESIDE_PX * np.array(
    [(1, 0), (np.sqrt(0.5), np.sqrt(0.5)), (0, 1), (-np.sqrt(0.5), np.sqrt(0.5))]
)
_RING = np.concatenate([_RING, -_RING])
# between the ends of an edge
_ALONG = 17
# of places whose light is the same to this share the first is named, on every machine
_SAME = 1e-3
# digits of a ratio
_DIGITS = 3
# radius of a region, px
_REGION_PX = 10
# an evenly lit region, with what is around it: its darkest place has this share of the light of the brightest
_EVEN = 0.9
# one that is less even says little of the light next to targets
_LEAST_EVEN = 0.7
# a region with less of the brightest light is too dark to be exposed for
_LEAST_OF_BRIGHTEST = 0.1
# a region's share of white is at most this, so that it is not overexposed itself
_MOST_WHITE = 0.9
# where more of what is lit would be overexposed, there is less light, down to this share
_MOST_OVEREXPOSED = 0.05
_LEAST_LIGHT = 1 / 3
# the same is then nearly white, but for a twentieth of it
_NEARLY_WHITE = 0.95
# less than this share of the brightest light next to targets is no light of lamps
_LEAST_LIT = 0.1
# pixels that are looked at for this
_FEW_PIXELS = 2_000
# pixels that are looked at in an image, and so many within reach of one
_MOST_PIXELS = 20_000
_WITHIN = 3
# a displacement of the image in two directions is within so many standard deviations in 99 of 100 images
_SPREADS = math.sqrt(-2 * math.log(0.01))
# a reach without a lit region is halved so often
_HALVINGS = 3
# rays to lamps start this far above a face, as a share of the way from the camera
_LIFT = 1e-5


def exposure(
    scene: RayScene,
    cam2world: Array,
    camera: Camera,
    points: Mapping[str, Array],
    lamps: Array | AreaLight,
    spread_px: float = 0.0,
) -> Exposure | None:
    """Return what to expose an image for.

    Parameters
    ----------
    scene : RayScene
        Of the part.
    cam2world : array (4, 4)
        Pose of the camera.
    camera : Camera
        The camera.
    points : mapping of str to array (n, 3)
        Points on the edges of each target, mm.
    lamps : array (k, 3) or AreaLight
        The lamps that are on, mm, or a light with an area.
    spread_px : float
        How far the image may be displaced, px. The pixel is named for one that is not.

    Returns
    -------
    Exposure or None
        None if no lamp lights any of it.
    """
    brightest: dict[str, tuple[float, Array]] = {}
    dimmest: dict[str, float] = {}
    for name, of_entity in points.items():
        pixels = beside(camera, cam2world, of_entity)
        light = irradiance(scene, cam2world, camera, pixels.reshape(-1, 2), lamps)
        brightest_light = light.max(initial=0.0)
        if not brightest_light > 0:
            continue
        at = int(np.argmax(light >= (1 - _SAME) * brightest_light))
        brightest[name] = (float(brightest_light), pixels.reshape(-1, 2)[at])
        # what hides an edge is not lit like it: half of its points are sure
        dimmest[name] = float(np.median(light.reshape(pixels.shape[:2]).max(axis=1)))
    if not brightest:
        return None
    brightest_light = max(value for value, _ in brightest.values())
    target = next(
        name for name, (value, _) in brightest.items() if value >= (1 - _SAME) * brightest_light
    )
    darkest = min(dimmest.values())
    weakest = next(name for name, value in dimmest.items() if value <= (1 + _SAME) * darkest)
    u, v = np.rint(brightest[target][1]).astype(int).tolist()
    times = brightest_light / darkest if darkest > 0 else np.inf

    def light_at(pixels: Array) -> Array:
        return irradiance(scene, cam2world, camera, pixels, lamps) / brightest_light

    _, few = _grid(camera, _FEW_PIXELS)
    white = white_share(light_at(few.reshape(-1, 2)))
    exposed = Exposure(target, (u, v), weakest, float(f"{times:.{_DIGITS}g}"), share=white)
    if spread_px <= 0:
        return exposed
    best = None
    reach = _REGION_PX + spread_px
    for _ in range(_HALVINGS):
        region = _even_region(light_at, camera, reach)
        if region is not None and (best is None or region.evenness > best.evenness):
            best = region
        if best is not None and best.evenness >= _EVEN:
            break
        reach /= 2
    if best is None or best.evenness < _LEAST_EVEN:
        return exposed
    radius = min(_REGION_PX, int(best.reach))
    return exposed._replace(
        pixel=best.pixel, radius_px=radius, share=float(f"{best.share * white:.2g}")
    )


def white_share(light: Array) -> float:
    """Return the share of white that the brightest place next to targets should have.

    It is 80 %, or less where the light next to them is so weak that more than 5 % of what is lit would be overexposed.
    The edges there are needed to register the image. It is not less than a third of 80 %, so that the targets are seen.

    Parameters
    ----------
    light : array (...)
        Light of places all over the image, in that of the brightest place next to targets.
    """
    lit = light[light > _LEAST_LIT]
    if not len(lit) or np.mean(WHITE_SHARE * lit > 1) <= _MOST_OVEREXPOSED:
        return WHITE_SHARE
    bright = float(np.quantile(lit, _NEARLY_WHITE))
    return float(f"{max(WHITE_SHARE * _LEAST_LIGHT, min(WHITE_SHARE, _NEARLY_WHITE / bright)):.2g}")


def _grid(camera: Camera, n_pixels: int, least_step: float = 1.0) -> tuple[float, Array]:
    """Return the step, px, and pixels (h, w, 2) all over an image, at most about so many."""
    width, height = camera.resolution
    step = max(least_step, math.sqrt(width * height / n_pixels))
    u = np.arange(step / 2, width - 1, step)
    v = np.arange(step / 2, height - 1, step)
    return step, np.stack(np.meshgrid(u, v), axis=-1)


class _Region(NamedTuple):
    """A region of an image: its middle, px, its darkest place as a share of the brightest light next to targets.

    And that place as a share of its own brightest one, all of it up to a reach around the middle, px.
    """

    pixel: tuple[int, int]
    share: float
    evenness: float
    reach: float


def _even_region(
    light_at: Callable[[Array], Array], camera: Camera, reach: float
) -> _Region | None:
    """Return a region that is lit up to a reach around it, px; None if there is none.

    Of evenly lit ones it is the brightest, otherwise the evenest.
    """
    step, grid = _grid(camera, _MOST_PIXELS, reach / _WITHIN)
    light = light_at(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    size = 2 * math.ceil(reach / step) + 1
    low = minimum_filter(light, size, mode="constant", cval=0.0)
    high = maximum_filter(light, size, mode="constant", cval=0.0)
    is_lit = (low >= _LEAST_OF_BRIGHTEST) & (WHITE_SHARE * high <= _MOST_WHITE)
    if not is_lit.any():
        return None
    even = np.where(is_lit, low / np.where(is_lit, high, 1.0), 0.0)
    worth = np.where(even >= _EVEN, 1.0 + low, even)
    at = int(np.argmax(np.round(worth / _SAME).ravel()))
    pixel = np.rint(grid.reshape(-1, 2)[at]).astype(int).tolist()
    # the darkest place around it counts, so that nothing beside edges is overexposed
    return _Region((pixel[0], pixel[1]), float(low.ravel()[at]), float(even.ravel()[at]), reach)


def spread_px(plan: Planned, cam2world: Array, points: Array) -> float:
    """Return how far the image of points (n, 3) is displaced in 99 of 100 images, px.

    A camera that is displaced by t and turned by a small vector w has points p in its frame at p - t - w x p.
    """
    local = world_to_cam(points, cam2world)
    x, y, z = local[local[:, 2] > 0].T
    zero = np.zeros_like(z)
    # by t and w, of each coordinate of p
    by_x = -np.stack([zero + 1, zero, zero, zero, z, -y])
    by_y = -np.stack([zero, zero + 1, zero, -z, zero, x])
    by_z = -np.stack([zero, zero, zero + 1, y, -x, zero])
    focal = plan.camera.matrix.diagonal()[:2]
    rows = np.stack([focal[0] * (by_x - x / z * by_z) / z, focal[1] * (by_y - y / z * by_z) / z])
    spread = np.einsum("aik,ij,bjk->kab", rows, plan.pose_uncertainty.covariance, rows)
    return _SPREADS * math.sqrt(float(np.linalg.eigvalsh(spread)[:, -1].max(initial=0.0)))


def beside(camera: Camera, cam2world: Array, points: Array) -> Array:
    """Return pixels (n, 8, 2) around the images of points (m, 3), n <= m in front of the camera; of two, also between.

    Parameters
    ----------
    camera : Camera
        The camera.
    cam2world : array (4, 4)
        Its pose.
    points : array (m, 3)
        Points on edges, or the two ends of one, mm.
    """
    if len(points) == 2:
        share = np.linspace(0.0, 1.0, _ALONG)[:, None]
        points = (1 - share) * points[0] + share * points[1]
    local = world_to_cam(points, cam2world)
    local = local[local[:, 2] > 0]
    return image_of(camera, local / local[:, 2:])[:, None] + _RING


def with_exposures(light: LightPlan, plan: Planned, scene: RayScene) -> LightPlan:
    """Return lamps whose images say what to expose them for.

    Parameters
    ----------
    light : LightPlan
        The lamps.
    plan : Planned
        The settings that they are for.
    scene : RayScene
        Of the part.
    """
    images = tuple(
        tuple(
            replace(image, expose_for=exposure_of(image, light, plan, k, scene))
            for image in lit_images
        )
        for k, lit_images in enumerate(light.images)
    )
    return replace(light, images=images)


def exposure_of(
    image: LitImage, light: LightPlan, plan: Planned, k: int, scene: RayScene
) -> Exposure | None:
    """Return what an image of the k-th setting is exposed for, None if no lamp lights any of it.

    Parameters
    ----------
    image : LitImage
        The image.
    light : LightPlan
        Its lamps.
    plan : Planned
        Its plan.
    k : int
        Number of its setting, from 0.
    scene : RayScene
        Of the part.
    """
    setting = plan.settings[k]
    targets = targets_of(plan.targets, setting)
    points = {name: targets[name].points for name in image.contrast}
    lamps = light.area or light.lamps[list(image.lamps)]
    pose = np.asarray(setting.cam2world)
    spread = spread_px(plan, pose, np.concatenate(list(points.values())))
    return exposure(scene, pose, plan.camera, points, lamps, spread)


def irradiance(
    scene: RayScene, cam2world: Array, camera: Camera, pixels: Array, lamps: Array | AreaLight
) -> Array:
    """Return the light (n,) on what pixels show: cosine over squared distance of all lamps, 1/mm².

    It is 0 off the part and off the sensor. Of a light with an area, it is the brightness of the image.
    """
    if not isinstance(lamps, np.ndarray):
        return area_brightness(lamps, scene, cam2world, camera, pixels)
    tangents = tangents_of(camera, pixels)
    right, down, forward = cam2world[:3, :3].T
    rays = tangents[:, :1] * right + tangents[:, 1:] * down + forward
    last = np.array(camera.resolution) - 1
    seen = ((pixels >= 0) & (pixels <= last)).all(axis=1)
    eye = cam2world[:3, 3]
    hit = scene.cast(eye, rays)
    depth = hit["t_hit"].astype(np.float64)
    met = seen & np.isfinite(depth) & np.isfinite(rays).all(axis=1)
    rays = rays[met]
    places = eye + depth[met, None] * rays
    normals = hit["primitive_normals"][met].astype(np.float64)
    normals *= np.where((normals * rays).sum(axis=1) > 0, -1.0, 1.0)[:, None]
    places += _LIFT * depth[met, None] * normals
    total = np.zeros(len(places))
    for lamp in np.atleast_2d(lamps):
        way = lamp - places
        distance = np.linalg.norm(way, axis=1)
        cosine = np.maximum((normals * way).sum(axis=1) / distance, 0.0)
        total += np.where(scene.blocked(places, way), 0.0, cosine / distance**2)
    light = np.zeros(len(pixels))
    light[met] = total
    return light


# Where the cameras are, and where a placed lamp would be in their way.


CAMERA_CLEARANCE_MM = 50.0
"""Distance that placed lamps keep from the axis of a camera: half the width of lens and housing, with a reserve."""

CAMERA_LENGTH_MM = 150.0
"""How far lens and housing reach behind the front nodal point."""


@dataclass(frozen=True)
class CameraWays:
    """Bodies of the cameras of a plan, and what they look through before the part.

    Attributes
    ----------
    cam2world : array (n, 4, 4)
        Poses of the settings.
    matrix : array (3, 3)
        Camera matrix, px.
    resolution : (int, int)
        Pixels.
    nearest_mm : array (n,)
        Depth at which the box around the part begins.
    """

    cam2world: Array
    matrix: Array
    resolution: tuple[int, int]
    nearest_mm: Array

    @classmethod
    def of(cls, plan: Planned, solid: Solid) -> CameraWays:
        """Return those of a plan on its part."""
        poses = np.array([setting.cam2world for setting in plan.settings], dtype=np.float64)
        poses = poses.reshape(-1, 4, 4)
        low, high = solid.bounds
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
        depths = (corners - poses[:, None, :3, 3]) @ poses[:, :3, 2, None]
        nearest = depths[..., 0].min(axis=1)
        return cls(poses, plan.camera.matrix, plan.camera.resolution, nearest)

    def meet(self, places: Array) -> NDArray[np.bool_]:
        """Return which places (m, 3) are in a camera, or hide part of an image."""
        inside = np.zeros(len(places), bool)
        for pose, nearest in zip(self.cam2world, self.nearest_mm.tolist(), strict=True):
            x, y, depth = ((places - pose[:3, 3]) @ pose[:3, :3]).T
            behind = np.clip(depth, -CAMERA_LENGTH_MM, 0.0)
            inside |= np.sqrt(x**2 + y**2 + (depth - behind) ** 2) < CAMERA_CLEARANCE_MM
            before = (depth > 0.0) & (depth < nearest)
            ahead = np.where(before, depth, 1.0)
            u = self.matrix[0, 0] * x / ahead + self.matrix[0, 2]
            v = self.matrix[1, 1] * y / ahead + self.matrix[1, 2]
            width, height = self.resolution
            inside |= (
                before
                & (np.abs(2 * u + 1 - width) <= width)
                & (np.abs(2 * v + 1 - height) <= height)
            )
        return inside


def eyes_of(plan: Planned) -> NDArray[np.float64]:
    """Return where the cameras of a plan are (n, 3), mm."""
    return np.array([np.asarray(setting.cam2world)[:3, 3] for setting in plan.settings]).reshape(
        -1, 3
    )
