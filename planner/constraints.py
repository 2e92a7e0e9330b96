"""What a sensor setting must satisfy: signed margins, 0 or more is satisfied.

Every function takes the entities' ends in the camera frame, ``ends_cam`` (n, k, 2, 3): n settings, k entities, two
ends, OpenCV axes, mm; or the positions of the front nodal point (n, 3) in the part's frame. It returns *slacks* (n,
k, s) or (n, 1, s): one smooth number per inequality, in the unit of the constraint. The margin of a constraint is its
smallest slack.

Notation of Yang & Ciarallo (2001), section 4.2: r_v nodal point, v optical axis, r_1 and r_2 the ends of an entity, u
the unit vector between them, L_w its length, d the image distance. In the camera frame r_v = 0 and v = (0, 0, 1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from planner.camera import Camera
from planner.exceptions import RequestError
from planner.pose import world_to_cam
from planner.reach import Reach, SignedDistance, check_reach, reach_margin

_NOT_IMAGED_PX = -1e6

# the axes, and the diagonals of a cube
_DIAGONALS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / math.sqrt(3)
_AROUND = np.vstack([np.eye(3), -np.eye(3), _DIAGONALS])


def resolution_slacks(camera: Camera, ends_cam: np.ndarray, min_length_mm: float) -> np.ndarray:
    """Eq 16: length of each entity's image minus the smallest allowed, mm on the sensor; (n, k, 1).

    An entity that is not wholly in front of the camera has an image of length 0.
    """
    first, second = ends_cam[..., 0, :], ends_cam[..., 1, :]
    z1, z2 = first[..., 2], second[..., 2]
    in_front = (z1 > 0) & (z2 > 0)
    # L_w·[(r1 − r_v) × u] × v has the length of the first two components of r1 × (r2 − r1) = r1 × r2
    turned = first[..., :2] * z2[..., None] - second[..., :2] * z1[..., None]
    length = camera.image_distance_mm * np.hypot(turned[..., 0], turned[..., 1]) / np.where(in_front, z1 * z2, 1.0)
    return (np.where(in_front, length, 0.0) - min_length_mm)[..., None]


def focus_slacks(camera: Camera, ends_cam: np.ndarray) -> np.ndarray:
    """Eqs 17–18: depth of each end minus D_min, and D_max minus that depth, mm; (n, k, 4)."""
    nearest, farthest = camera.depth_of_field_mm
    depth = ends_cam[..., 2]
    return np.concatenate([depth - nearest, farthest - depth], axis=-1)


def field_of_view_slacks(camera: Camera, ends_cam: np.ndarray, margin_px: float) -> np.ndarray:
    """Distance of each end's image from the four sides of the sensor, less a margin, px; (n, k, 8).

    The image of a segment is the segment between the images of its ends, so both ends inside means all of it inside.
    Behind the camera there is no image; the slack is then a large negative number.
    """
    depth = ends_cam[..., 2]
    in_front = depth > 0
    safe = np.where(in_front, depth, 1.0)
    matrix, (width, height) = camera.matrix, camera.resolution
    u = matrix[0, 0] * ends_cam[..., 0] / safe + matrix[0, 2]
    v = matrix[1, 1] * ends_cam[..., 1] / safe + matrix[1, 2]
    # pixel centres are whole numbers, so the sensor's sides are at -0.5 and count - 0.5
    sides = np.concatenate([u + 0.5, width - 0.5 - u, v + 0.5, height - 0.5 - v], axis=-1) - margin_px
    return np.where(np.tile(in_front, 4), sides, _NOT_IMAGED_PX)


def cone_slacks(camera: Camera, center_cam: np.ndarray, radius_mm: float) -> np.ndarray:
    """Eqs 19–20: the sphere around the entities lies in the cone of the smaller sensor side; mm, (n, 1, 1).

    With α = 2·atan(I_min / 2d) and r_k = r_s − (R_s / sin(α/2))·v the slack is (r_k − r_v)·v − ‖r_k − r_v‖·cos(α/2).

    Parameters
    ----------
    camera : Camera
        Gives I_min, the smaller side of the sensor, and d.
    center_cam : array (n, 3)
        Centre r_s of the sphere in the camera frame, mm.
    radius_mm : float
        Its radius R_s.
    """
    half = math.atan(min(camera.sensor_size_mm) / (2 * camera.image_distance_mm))
    apex = center_cam - [0.0, 0.0, radius_mm / math.sin(half)]
    return (apex[..., 2] - np.linalg.norm(apex, axis=-1) * math.cos(half))[:, None, None]


def visibility_slacks(space, positions: np.ndarray, names: Sequence[str], radius_mm: float = 0.0) -> np.ndarray:
    """+1 where an entity is observable from a position and all around it, else -1; (n, k, 1).

    All around it are 14 points at `radius_mm`: along the axes and the diagonals of the part's frame. Outside the
    workspace nothing is observable.
    """
    visible = _observable(space, positions, names)
    rows = np.flatnonzero(visible.any(axis=1))
    if radius_mm > 0 and rows.size:
        # all points in one call: asking costs more than answering
        eyes = positions[rows, None] + radius_mm * _AROUND
        around = _observable(space, eyes.reshape(-1, 3), names)
        visible[rows] &= around.reshape(len(rows), len(_AROUND), -1).all(axis=1)
    return np.where(visible, 1.0, -1.0)[..., None]


def _observable(space, positions: np.ndarray, names: Sequence[str]) -> np.ndarray:
    low, high = (np.asarray(corner, dtype=float) for corner in space.workspace)
    inside = ((positions >= low) & (positions <= high)).all(axis=-1)
    visible = np.zeros((len(positions), len(names)), bool)
    visible[inside] = space.observable(positions[inside], names)
    return visible


def clearance_slacks(distance, positions: np.ndarray, stand_off_mm: float) -> np.ndarray:
    """Signed distance from the part less the stand-off, mm; (n, 1, 1). `distance` maps (n, 3) to (n,)."""
    return (distance(positions) - stand_off_mm)[:, None, None]


def workspace_slacks(workspace, positions: np.ndarray) -> np.ndarray:
    """Distance from the six walls of the workspace box, mm, positive inside; (n, 1, 6)."""
    low, high = (np.asarray(corner, dtype=float) for corner in workspace)
    return np.concatenate([positions - low, high - positions], axis=-1)[:, None, :]


def enclosing_sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius of a sphere around points (m, 3), close to the smallest one.

    The centre walks towards the farthest point by ever smaller steps (Bădoiu & Clarkson 2003); the best one is kept.
    The radius is exact for that centre, so no point is ever outside.
    """
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    best, radius = center, np.inf
    for step in range(2, 300):
        distances = np.linalg.norm(points - center, axis=-1)
        if distances.max() < radius:
            best, radius = center, float(distances.max())
        center = center + (points[np.argmax(distances)] - center) / step
    return best, radius


@dataclass(frozen=True)
class Requirements:
    """What is asked of a sensor setting beside the accuracy.

    Parameters
    ----------
    min_length_px : float
        Shortest image of an entity, in pixels of the larger pitch (L_min of eq 16).
    field_margin_px : float
        Strip along the sensor's sides that no entity's image may enter. Ignored by the cone.
    field_of_view : {"exact", "cone"}
        Both ends inside the rectangular sensor, or the paper's conservative cone.
    stand_off_mm : float
        Smallest distance between the front nodal point and the part.
    reach : Region or callable, optional
        Where the front nodal point may be, see `planner.reach`.
    visibility_radius_mm : float
        Distance around the front nodal point from which the entities must be observable too.

    Raises
    ------
    RequestError
        If a value breaks its rule.
    """

    min_length_px: float = 20.0
    field_margin_px: float = 0.0
    field_of_view: str = "exact"
    stand_off_mm: float = 50.0
    reach: Reach | None = field(default=None, repr=False)
    visibility_radius_mm: float = 0.0

    def __post_init__(self):
        for name in ("min_length_px", "field_margin_px", "stand_off_mm", "visibility_radius_mm"):
            value = getattr(self, name)
            if not (isinstance(value, int | float | np.number) and math.isfinite(value) and value >= 0):
                raise RequestError(f"{name} must be finite and not negative. Got {value!r}.")
        if self.field_of_view not in ("exact", "cone"):
            raise RequestError(f"field_of_view must be 'exact' or 'cone'. Got {self.field_of_view!r}.")
        check_reach(self.reach)


class Constraints:
    """All constraints of one request: which settings satisfy them, and by how much.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Anything with ``solid``, ``entities``, ``workspace`` and ``observable``.
    names : sequence of str
        The entities to be inspected together.
    camera : Camera
        The camera.
    requirements : Requirements
        What is asked.
    """

    def __init__(self, space, names: Sequence[str], camera: Camera, requirements: Requirements):
        self.space, self.names, self.camera, self.requirements = space, tuple(names), camera, requirements
        self.ends = np.array([space.entities[name].endpoints for name in self.names], dtype=np.float64)
        self.sphere_center, self.sphere_radius = enclosing_sphere(self.ends.reshape(-1, 3))
        self.min_length_mm = requirements.min_length_px * max(camera.pixel_pitch_mm)
        self._distance = SignedDistance(space.solid.vertices, space.solid.triangles)
        self._checks = self._build_checks()

    def _build_checks(self) -> dict:
        """Map each constraint to its slacks as a function of (ends_cam, cam2world), cheapest first."""
        camera, need = self.camera, self.requirements
        checks = {
            "resolution_mm": lambda ends, pose: resolution_slacks(camera, ends, self.min_length_mm),
            "focus_mm": lambda ends, pose: focus_slacks(camera, ends),
        }
        if need.field_of_view == "exact":
            checks["field_of_view_px"] = lambda ends, pose: field_of_view_slacks(camera, ends, need.field_margin_px)
        else:
            checks["field_of_view_mm"] = lambda ends, pose: cone_slacks(
                camera, world_to_cam(self.sphere_center, pose), self.sphere_radius
            )
        checks["workspace_mm"] = lambda ends, pose: workspace_slacks(self.space.workspace, pose[:, :3, 3])
        if need.reach is not None:
            checks["reach"] = lambda ends, pose: reach_margin(need.reach, pose[:, :3, 3])[:, None, None]
        checks["clearance_mm"] = lambda ends, pose: clearance_slacks(self._distance, pose[:, :3, 3], need.stand_off_mm)
        checks["visibility"] = lambda ends, pose: visibility_slacks(
            self.space, pose[:, :3, 3], self.names, need.visibility_radius_mm
        )
        return checks

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the constraints; each ends with the unit of its margin."""
        return tuple(self._checks)

    def slacks(self, cam2world: np.ndarray, only: Sequence[str] | None = None) -> dict[str, np.ndarray]:
        """Return the slacks (n, k or 1, s) of poses (n, 4, 4) per constraint."""
        ends_cam = world_to_cam(self.ends, cam2world)
        return {name: self._checks[name](ends_cam, cam2world) for name in (only or self._checks)}

    def margins(self, cam2world: np.ndarray) -> dict[str, np.ndarray]:
        """Return the margin of poses (n, 4, 4) per constraint and entity: (n, k), or (n, 1) where entities share it."""
        return {name: slacks.min(axis=-1) for name, slacks in self.slacks(cam2world).items()}

    def feasible(self, cam2world: np.ndarray) -> np.ndarray:
        """Return which of the poses (n, 4, 4) satisfy every constraint; (n,) bool."""
        # cheap constraints come first, and the costly ones see only what is left
        left = np.arange(len(cam2world))
        ends_cam = world_to_cam(self.ends, cam2world)
        for check in self._checks.values():
            if not len(left):
                break
            left = left[check(ends_cam[left], cam2world[left]).min(axis=(1, 2)) >= 0]
        mask = np.zeros(len(cam2world), dtype=bool)
        mask[left] = True
        return mask

    def scale(self, name: str) -> float:
        """Return a natural size of a constraint's margin, to weigh violations of different units."""
        low, high = (np.asarray(corner, dtype=float) for corner in self.space.workspace)
        diagonal = float(np.linalg.norm(high - low))
        return {
            "resolution_mm": max(self.min_length_mm, 1e-9),
            "focus_mm": self.camera.depth_of_field_mm[0],
            "field_of_view_px": float(max(self.camera.resolution)),
            "field_of_view_mm": max(self.sphere_radius, 1e-9),
            "clearance_mm": max(self.requirements.stand_off_mm, 1.0),
            "workspace_mm": diagonal,
            # a region's margin is a distance, a callable's is +1 or -1
            "reach": diagonal if hasattr(self.requirements.reach, "margin") else 1.0,
            "visibility": 1.0,
        }[name]

    def violation(self, cam2world: np.ndarray) -> np.ndarray:
        """Return how far poses (n, 4, 4) are from feasible: 0 is feasible, else a sum over constraints; (n,)."""
        total = np.zeros(len(cam2world))
        for name, margin in self.margins(cam2world).items():
            total += np.minimum(np.maximum(-margin, 0.0) / self.scale(name), 10.0).sum(axis=1) / margin.shape[1]
        return total
