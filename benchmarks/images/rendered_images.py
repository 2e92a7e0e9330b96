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
PATCH = 7
_SEARCH = 4.0
# profiles are sampled so finely, px, and averaged over so many pixels along the edge to either side
_STEP = 0.1
_ALONG = 1.5
_DARK = 0.04
# grey values are compared so many px to either side of a found point
_BESIDE = 2.5


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
    samples: int = 3
    blur_px: float = 0.8
    noise: float = 0.01
    _scene: object = field(init=False, repr=False)

    def __post_init__(self):
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        vertices = np.asarray(self.vertices, np.float32)
        triangles = np.asarray(self.triangles, np.uint32)
        self._scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(triangles))

    def patches(self, cam2world: np.ndarray, corners: np.ndarray, lamp: Lamp, rng) -> np.ndarray:
        """Return patches (m, s, s) of grey values in [0, 1]; ``corners`` (m, 2) are whole px of their first ones."""
        margin = int(np.ceil(3 * self.blur_px))
        size = 2 * PATCH + 1 + 2 * margin
        fine = (np.arange(size * self.samples) + 0.5) / self.samples - 0.5 - margin
        lattice = np.stack(np.meshgrid(fine, fine), axis=-1)
        to_rays = np.linalg.inv(self.matrix).T
        grey = np.empty((len(corners), *lattice.shape[:2]))
        # one after the other: arrays that fit the processor's cache take a fraction of the time
        for shade, corner in zip(grey, corners, strict=True):
            # a place at random in each part of a pixel: on a lattice, edges along its rows would move by steps
            grid = lattice + rng.uniform(-0.5, 0.5, lattice.shape) / self.samples
            pixels = np.concatenate([grid + corner, np.ones((*grid.shape[:2], 1))], axis=-1)
            shade[:] = self._grey(cam2world, pixels.reshape(-1, 3) @ to_rays, lamp).reshape(
                shade.shape
            )
        grey = gaussian_filter(
            grey, (0, self.blur_px * self.samples, self.blur_px * self.samples), mode="nearest"
        )
        grey = grey.reshape(len(corners), size, self.samples, size, self.samples).mean(axis=(2, 4))
        grey = grey[:, margin:-margin, margin:-margin]
        grey = grey + rng.normal(0.0, self.noise, grey.shape)
        return np.clip(np.rint(grey * 255) / 255, 0, 1)

    def _grey(self, cam2world: np.ndarray, directions: np.ndarray, lamp: Lamp) -> np.ndarray:
        turned = directions @ cam2world[:3, :3].T
        rays = np.concatenate(
            [np.broadcast_to(cam2world[:3, 3], turned.shape), turned], axis=1
        ).astype(np.float32)
        hit = self._scene.cast_rays(o3d.core.Tensor(rays))
        depth = hit["t_hit"].numpy().astype(float)
        normal = hit["primitive_normals"].numpy().astype(float)
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


def found_points(
    renderer: Renderer,
    cam2world: np.ndarray,
    points: np.ndarray,
    tangents: np.ndarray,
    lamp: Lamp,
    rng,
):
    """Look for an edge at points (m, 3) with tangents (m, 3) in the image from a pose; px (m, 2), and grey steps (m,).

    The step is the difference of the grey values, of 255, a little to either side of the point.
    """
    image = renderer.projected(points, cam2world)
    along = renderer.projected(points + 1e-3 * tangents, cam2world) - image
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    corners = np.rint(image).astype(int) - PATCH
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
    beside = round(_BESIDE / _STEP)
    low, high = (profile[rows, np.clip(best + k, 0, len(t) - 1)] for k in (-beside, beside))
    return np.rint(image) + (t[best] + np.clip(shift, -1, 1) * _STEP)[
        :, None
    ] * across, 255 * np.abs(high - low)


def _bilinear(patches: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return grey values of patches (m, s, s) at places (m, ..., 2) in px from their first pixel."""
    size = patches.shape[1]
    x = np.clip(places[..., 0], 0, size - 1.001)
    y = np.clip(places[..., 1], 0, size - 1.001)
    i = x.astype(int)
    j = y.astype(int)
    a = x - i
    b = y - j
    k = np.arange(len(patches)).reshape(-1, *[1] * (places.ndim - 2))
    upper = (1 - a) * patches[k, j, i] + a * patches[k, j, i + 1]
    return (1 - b) * upper + b * ((1 - a) * patches[k, j + 1, i] + a * patches[k, j + 1, i + 1])


def carried_back(
    pixels: np.ndarray, matrix: np.ndarray, cam2world: np.ndarray, plane
) -> np.ndarray:
    """Return where rays through pixels (n, 2) from a pose meet a plane (point (3,), normal (3,)); (n, 3) mm."""
    point, normal = plane
    rays = (
        np.append(pixels, np.ones((len(pixels), 1)), axis=1)
        @ np.linalg.inv(matrix).T
        @ cam2world[:3, :3].T
    )
    depth = ((point - cam2world[:3, 3]) @ normal) / (rays @ normal)
    return cam2world[:3, 3] + depth[:, None] * rays


def fitted_circle(points: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius of the circle nearest to points (n, 3) of a plane with the normal ``axis``."""
    u = _across(axis)
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


@dataclass
class Measured:
    """One dimension, as it is measured: lines are pairs of ends (2, 3), circles (centre, axis, radius); mm.

    ``arcs`` holds for each circle the unit vector to its start and its angle in rad, None for a whole one.
    """

    kind: str
    lines: list
    circles: list
    arcs: list
    direction: np.ndarray | None = None

    def points(self, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return points (n, 3) and tangents (n, 3) on each entity: circles first, at the middles of n equal parts."""
        found = []
        shares = (np.arange(n) + 0.5) / n
        for (centre, axis, radius), arc in zip(self.circles, self.arcs, strict=True):
            start, span = arc or (_across(axis), 2 * np.pi)
            angle = (shares * span)[:, None]
            out = np.cos(angle) * start + np.sin(angle) * np.cross(axis, start)
            found.append((centre + radius * out, np.cross(axis, out)))
        for p, q in self.lines:
            along = (q - p) / np.linalg.norm(q - p)
            found.append((p + shares[:, None] * (q - p), np.tile(along, (n, 1))))
        return found

    def planes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return a point and the unit normal of the plane that each entity is carried back to."""
        found = [(centre, axis) for centre, axis, _ in self.circles]
        middles = [(p + q) / 2 for p, q in self.lines]
        if self.kind == "centre_to_edge":
            normal = self.circles[0][1]
        elif self.kind == "angle":
            normal = np.cross(*(q - p for p, q in self.lines))
        elif self.kind == "distance":
            normal = np.cross(self._way(), self.lines[0][1] - self.lines[0][0])
        else:
            return found
        return [*found, *((middle, normal / np.linalg.norm(normal)) for middle in middles)]

    def value(self, points: list[np.ndarray]) -> float:
        """Return the value, mm (angles: degrees), from points (n, 3) that were carried back, of each entity."""
        circles = [
            fitted_circle(own, axis)
            for own, (_, axis, _) in zip(points, self.circles, strict=False)
        ]
        lines = [fitted_line(own) for own in points[len(circles) :]]
        if self.kind in ("diameter", "radius"):
            return circles[0][1] * (2 if self.kind == "diameter" else 1)
        if self.kind == "centre_distance":
            return float(
                np.linalg.norm(np.cross(circles[1][0] - circles[0][0], self.circles[0][1]))
            )
        if self.kind == "centre_to_edge":
            off = circles[0][0] - lines[0][0]
            across = np.cross(self.circles[0][1], lines[0][1])
            return float(abs(off @ across) / np.linalg.norm(across))
        if self.kind == "angle":
            return float(np.degrees(np.arccos(abs(lines[0][1] @ lines[1][1]))))
        if self.kind != "distance":
            raise ValueError(f"kind must be one that is measured here. Got {self.kind!r}.")
        p, q = self.lines[0]
        along = (q - p) / np.linalg.norm(q - p)
        half_way = np.mean(self.lines, axis=(0, 1))
        at = [m + d * (((half_way - m) @ along) / (d @ along)) for m, d in lines]
        return float(abs((at[1] - at[0]) @ self._way()))

    def _way(self) -> np.ndarray:
        """Return the unit vector along which a distance is taken, perpendicular to both lines."""
        (p, q), (r, s) = self.lines
        along = (q - p) / np.linalg.norm(q - p)
        way = (r + s - p - q) if self.direction is None else self.direction
        way = way - (way @ along) * along
        return way / np.linalg.norm(way)


def _across(axis: np.ndarray) -> np.ndarray:
    """Return a unit vector perpendicular to an axis."""
    way = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return way / np.linalg.norm(way)
