"""What to expose an image for: the brightest place beside the edges of its targets, for a matt part of one albedo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera
from planner.camera.imaging import image_of, tangents_of
from planner.camera.pose import world_to_cam

if TYPE_CHECKING:
    from aspectgraph.solid.ray_scene import RayScene

Array = NDArray[np.float64]

WHITE_SHARE = 0.8
"""Share of white that the brightest place beside an edge should have."""

_BESIDE_PX = 3.0
_WAYS = 8
# rays to lamps start this far above a face, as a share of the way from the camera
_LIFT = 1e-5


class Exposure(NamedTuple):
    """What one image is exposed for.

    Attributes
    ----------
    target : str
        The target beside which the brightest place is.
    pixel : (int, int)
        That place, px: u and v.
    dimmest : str
        The target whose edges get least light.
    times : float
        How many times less.
    """

    target: str
    pixel: tuple[int, int]
    dimmest: str
    times: float


def exposure(
    scene: RayScene,
    cam2world: Array,
    camera: Camera,
    points: Mapping[str, Array],
    lamps: Array,
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
    lamps : array (k, 3)
        The lamps that are on, mm.

    Returns
    -------
    Exposure or None
        None if no lamp lights any of it.
    """
    brightest: dict[str, tuple[float, Array]] = {}
    dimmest: dict[str, float] = {}
    turns = 2 * np.pi * np.arange(_WAYS) / _WAYS
    ring = _BESIDE_PX * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    for name, own in points.items():
        local = world_to_cam(own, cam2world)
        own_pixels = image_of(camera, local[local[:, 2] > 0] / local[local[:, 2] > 0][:, 2:])
        pixels = own_pixels[:, None] + ring
        light = irradiance(scene, cam2world, camera, pixels.reshape(-1, 2), lamps)
        beside = light.reshape(len(own_pixels), -1)
        if not beside.size or not beside.max() > 0:
            continue
        at = np.unravel_index(int(np.argmax(beside)), beside.shape)
        brightest[name] = (float(beside.max()), pixels[at])
        # what hides an edge is not lit like it: half of its points are sure
        dimmest[name] = float(np.median(beside.max(axis=1)))
    if not brightest:
        return None
    target = max(brightest, key=lambda name: brightest[name][0])
    most, pixel = brightest[target]
    weakest = min(dimmest, key=lambda name: dimmest[name])
    u, v = np.rint(pixel).astype(int).tolist()
    times = most / dimmest[weakest] if dimmest[weakest] > 0 else np.inf
    return Exposure(target, (u, v), weakest, times)


def irradiance(
    scene: RayScene, cam2world: Array, camera: Camera, pixels: Array, lamps: Array
) -> Array:
    """Return the light (n,) on what pixels show: cosine over squared distance of all lamps, 1/mm²; 0 off the part."""
    tangents = tangents_of(camera, pixels)
    rays = np.concatenate([tangents, np.ones((len(tangents), 1))], axis=1) @ cam2world[:3, :3].T
    eye = cam2world[:3, 3]
    hit = scene.cast(eye, rays)
    depth = hit["t_hit"].astype(np.float64)
    met = np.isfinite(depth) & np.isfinite(rays).all(axis=1)
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
