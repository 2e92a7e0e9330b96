"""A digital twin that measures dimensions in rendered images; it shares no code with planner or errors.

Matt shading with cast shadows by Open3D rays, several per pixel, blurred and noisy. Points are found on the image of an
edge as the steepest place of the grey values across it, to a fraction of a pixel; they are carried back with the
planned pose to the plane of the entity, and lines and circles are fitted there.

Only what is looked at is rendered: a patch of pixels around each point that is searched for. Where a patch lies, the
exact image tells (the image is taken as registered); what is measured in it, only its grey values tell.
"""

from dataclasses import dataclass, field

import numpy as np
import open3d as o3d
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

# pixels to either side of a point that are rendered, and that are searched for the steepest place
_PATCH, _SEARCH = 9, 4.0
# profiles are sampled so finely, px, and averaged over so many pixels along the edge to either side
_STEP, _ALONG = 0.1, 1.5
_DARK = 0.04


@dataclass
class Lamp:
    """A point lamp at a place (3,), mm, with some light from everywhere."""

    place: np.ndarray
    ambient: float = 0.12


@dataclass
class Renderer:
    """Grey values of patches of an image of triangles (t, 3) over vertices (v, 3) in mm; ``matrix`` (3, 3) in px."""

    vertices: np.ndarray
    triangles: np.ndarray
    matrix: np.ndarray
    samples: int = 4
    blur_px: float = 0.8
    noise: float = 0.01
    _scene: object = field(init=False, repr=False)

    def __post_init__(self):
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        vertices, triangles = np.asarray(self.vertices, np.float32), np.asarray(self.triangles, np.uint32)
        self._scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(triangles))

    def patches(self, cam2world: np.ndarray, corners: np.ndarray, lamp: Lamp, rng) -> np.ndarray:
        """Return patches (m, s, s) of grey values in [0, 1]; ``corners`` (m, 2) are whole px of their first ones."""
        margin = int(np.ceil(3 * self.blur_px))
        size = 2 * _PATCH + 1 + 2 * margin
        fine = (np.arange(size * self.samples) + 0.5) / self.samples - 0.5 - margin
        u, v = np.meshgrid(fine, fine)
        pixels = (
            np.stack([u, v, np.ones_like(u)], axis=-1)[None]
            + np.append(corners, np.zeros((len(corners), 1)), 1)[:, None, None]
        )
        grey = self._grey(cam2world, pixels.reshape(-1, 3) @ np.linalg.inv(self.matrix).T, lamp)
        grey = grey.reshape(len(corners), size * self.samples, size * self.samples)
        grey = gaussian_filter(grey, (0, self.blur_px * self.samples, self.blur_px * self.samples), mode="nearest")
        grey = grey.reshape(len(corners), size, self.samples, size, self.samples).mean(axis=(2, 4))
        grey = grey[:, margin:-margin, margin:-margin]
        grey = grey + rng.normal(0.0, self.noise, grey.shape)
        return np.clip(np.rint(grey * 255) / 255, 0, 1)

    def _grey(self, cam2world: np.ndarray, directions: np.ndarray, lamp: Lamp) -> np.ndarray:
        turned = directions @ cam2world[:3, :3].T
        rays = np.concatenate([np.broadcast_to(cam2world[:3, 3], turned.shape), turned], axis=1).astype(np.float32)
        hit = self._scene.cast_rays(o3d.core.Tensor(rays))
        depth, normal = hit["t_hit"].numpy().astype(float), hit["primitive_normals"].numpy().astype(float)
        seen = np.isfinite(depth)
        grey = np.full(len(rays), _DARK)
        points = cam2world[:3, 3] + depth[seen, None] * turned[seen]
        normal = normal[seen] * -np.sign((normal[seen] * turned[seen]).sum(axis=1, keepdims=True))
        to_lamp = lamp.place - points
        to_lamp /= np.linalg.norm(to_lamp, axis=1, keepdims=True)
        facing = np.maximum((normal * to_lamp).sum(axis=1), 0.0)
        start = points + 2e-3 * normal
        shadow = self._scene.test_occlusions(
            o3d.core.Tensor(np.concatenate([start, to_lamp], axis=1).astype(np.float32))
        )
        grey[seen] = lamp.ambient + (0.9 - lamp.ambient) * facing * ~shadow.numpy()
        return grey

    def projected(self, points: np.ndarray, cam2world: np.ndarray) -> np.ndarray:
        """Return the images (n, 2) in px of points (n, 3) in mm."""
        local = (points - cam2world[:3, 3]) @ cam2world[:3, :3]
        image = local @ self.matrix.T
        return image[:, :2] / image[:, 2:]


def found_points(renderer: Renderer, cam2world: np.ndarray, points: np.ndarray, tangents: np.ndarray, lamp: Lamp, rng):
    """Look for an edge at points (m, 3) with tangents (m, 3) in the image from a pose; px (m, 2), and grey steps (m,).

    A point at which the image runs lengthwise has no normal; the caller sees it by its step of 0.
    """
    image = renderer.projected(points, cam2world)
    along = renderer.projected(points + 1e-3 * tangents, cam2world) - image
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    corners = np.rint(image).astype(int) - _PATCH
    patches = renderer.patches(cam2world, corners, lamp, rng)
    t = np.arange(-_SEARCH - 1, _SEARCH + 1 + _STEP / 2, _STEP)
    s = np.linspace(-_ALONG, _ALONG, 7)
    # whole pixels are what is known beforehand; the rest of the place is for the image to tell
    centre = np.rint(image)[:, None, None]
    places = centre + t[:, None, None] * across[:, None, None] + s[:, None] * along[:, None, None]
    profile = _bilinear(patches, places - corners[:, None, None]).mean(axis=2)
    slope = gaussian_filter(profile, (0, 0.7 / _STEP), order=(0, 1), mode="nearest") / _STEP
    strength = np.abs(slope)
    strength[:, np.abs(t) > _SEARCH] = 0
    best = np.argmax(strength, axis=1)
    rows = np.arange(len(points))
    left, middle, right = (strength[rows, np.clip(best + k, 0, len(t) - 1)] for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    shift = np.where(bend < 0, (left - right) / (2 * np.where(bend < 0, bend, -1)), 0.0)
    return np.rint(image) + (t[best] + np.clip(shift, -1, 1) * _STEP)[:, None] * across, middle


def _bilinear(patches: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return grey values of patches (m, s, s) at places (m, ..., 2) in px from their first pixel."""
    size = patches.shape[1]
    x, y = np.clip(places[..., 0], 0, size - 1.001), np.clip(places[..., 1], 0, size - 1.001)
    i, j = x.astype(int), y.astype(int)
    a, b = x - i, y - j
    k = np.arange(len(patches)).reshape(-1, *[1] * (places.ndim - 2))
    upper = (1 - a) * patches[k, j, i] + a * patches[k, j, i + 1]
    return (1 - b) * upper + b * ((1 - a) * patches[k, j + 1, i] + a * patches[k, j + 1, i + 1])


def carried_back(pixels: np.ndarray, matrix: np.ndarray, cam2world: np.ndarray, plane) -> np.ndarray:
    """Return where rays through pixels (n, 2) from a pose meet a plane (point (3,), normal (3,)); (n, 3) mm."""
    point, normal = plane
    rays = np.append(pixels, np.ones((len(pixels), 1)), axis=1) @ np.linalg.inv(matrix).T @ cam2world[:3, :3].T
    depth = ((point - cam2world[:3, 3]) @ normal) / (rays @ normal)
    return cam2world[:3, 3] + depth[:, None] * rays


def fitted_circle(points: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius of the circle nearest to points (n, 3) of a plane with the normal ``axis``."""
    u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    u /= np.linalg.norm(u)
    basis = np.stack([u, np.cross(axis, u)])
    middle = points.mean(axis=0)
    flat = (points - middle) @ basis.T
    found = least_squares(
        lambda p: np.hypot(flat[:, 0] - p[0], flat[:, 1] - p[1]) - p[2],
        [0.0, 0.0, np.linalg.norm(flat, axis=1).mean()],
        method="lm",
    ).x
    return middle + found[:2] @ basis, abs(float(found[2]))


def fitted_line(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a point (3,) and the unit direction (3,) of the line nearest to points (n, 3)."""
    middle = points.mean(axis=0)
    return middle, np.linalg.svd(points - middle)[2][0]
