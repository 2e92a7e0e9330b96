"""What a setting must satisfy: signed margins, 0 or more is satisfied.

Every function takes the entities' ends in the camera frame, ``ends_cam`` (n, k, 2, 3): n settings, k entities, two
ends, OpenCV axes, mm; or the positions of the front nodal point (n, 3) in the part's frame. It returns *slacks* (n,
k, s) or (n, 1, s): one smooth number per inequality, in the unit of the constraint. The margin of a constraint is its
smallest slack.

Notation of Yang & Ciarallo (2001), section 4.2: r_v nodal point, v optical axis, r_1 and r_2 the ends of an entity, u
the unit vector between them, L_w its length, d the image distance. In the camera frame r_v = 0 and v = (0, 0, 1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from ground.decorators import entry_kernel, kernel
from ground.short_repr import short_repr
from planner.camera.camera import Camera
from planner.camera.pose import world_to_cam
from planner.detectability.conditions import NOT_ASKED, Detectability
from planner.detectability.image_check import MOST_PX, ImageCheck, edges_of, scanned_in
from planner.exceptions import RequestError
from planner.request.camera_limits import NO_RESERVE, FocusReserve, probability_between
from planner.request.reach import (
    FEW,
    PlainReach,
    PoseRegion,
    Reach,
    Space,
    check_reach,
    clearance_slacks,
    distance_to,
    enclosing_sphere,
    entity_space,
    reach_margin,
    visibility_slacks,
    workspace_slacks,
)
from planner.request.targets import Target, edge_targets

# Constraints that the image puts on a pose: long enough, sharp, inside the sensor.
#
# Every function takes the entities' ends in the camera frame, ``ends_cam`` (n, k, 2, 3), and
# returns slacks as `planner.request.constraints` describes them. The three that ask for nothing
# but the ends are computed together in one compiled pass, as a search asks for few poses very
# often: column by column of `image_slacks`,
#
# 0       eq 16: image length minus the smallest allowed, mm; an entity not wholly in front has
#         an image of length 0
# 1–2     eq 17: depth of each end minus D_min, less the reserve of focus, mm
# 3–4     eq 18: D_max minus that depth, less the reserve of focus, mm
# 5–12    each end's image from the left, right, upper and lower side of the sensor, less a margin,
#         px; with distortion undistorted images, and the sides of a rectangle that the sensor
#         surely holds (`Camera.field`)
#
# L_w·[(r1 − r_v) × u] × v of eq 16 has the length of the first two components of r1 × (r2 − r1) =
# r1 × r2.


FieldOfView = Literal["exact", "cone"]
RESOLUTION = slice(0, 1)
FOCUS = slice(1, 5)
FIELD_OF_VIEW = slice(5, 13)

# behind the camera there is no image
_NOT_IMAGED_PX = -1e6


class Lens(NamedTuple):
    """What the slacks depend on beside the ends: lengths in mm on the part's or the sensor's side, the rest in px.

    The reserve of focus of an end is ``focus_margin_mm``, or what ``reserve`` asks for if that is more.
    """

    image_distance_mm: float
    min_length_mm: float
    nearest_mm: float
    farthest_mm: float
    focus_margin_mm: float
    reserve: FocusReserve
    scale_x_px: float
    scale_y_px: float
    centre_x_px: float
    centre_y_px: float
    left_px: float
    top_px: float
    right_px: float
    bottom_px: float
    margin_px: float

    @classmethod
    def of(
        cls,
        camera: Camera,
        min_length_mm: float = 0.0,
        margin_px: float = 0.0,
        focus_margin_mm: float = 0.0,
        reserve: FocusReserve = NO_RESERVE,
    ) -> Lens:
        """Return the numbers of a camera and of what is asked of its image."""
        matrix = camera.matrix
        (width, height) = camera.resolution
        # pixel centres are whole numbers, so the sensor's sides are at -0.5 and count - 0.5
        sides = -0.5, -0.5, width - 0.5, height - 0.5
        if camera.distortion is not None:
            # the margin is counted in pixels of the real image, the sides in those of the undistorted one
            tangents = np.array(camera.field(margin_px).inner).reshape(2, 2)
            margin_px = 0.0
            x_low, y_low, x_high, y_high = (
                (tangents * np.diag(matrix)[:2] + matrix[:2, 2]).ravel().tolist()
            )
            sides = x_low, y_low, x_high, y_high
        scales = float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])
        near, far = map(float, camera.depth_of_field_mm)
        return cls(
            camera.image_distance_mm,
            float(min_length_mm),
            near,
            far,
            float(focus_margin_mm),
            reserve,
            *scales,
            *sides,
            float(margin_px),
        )


def image_slacks(lens: Lens, ends_cam: np.ndarray) -> np.ndarray:
    """Return all slacks (n, k, 13) of ends in the camera frame (n, k, 2, 3), in the columns listed above."""
    out = np.empty((*ends_cam.shape[:2], 13))
    _image_slacks(lens, np.ascontiguousarray(ends_cam, dtype=np.float64), out)
    return out


def least_slacks(slacks: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return the least slacks (n, k, c) of each item over its segments, from those of all segments (n, s, c).

    ``first`` (k,) are the items' first segments.
    """
    out = np.empty((len(slacks), len(first), slacks.shape[2]))
    _least_slacks(slacks, np.append(first, slacks.shape[1]), out)
    return out


def image_margins(
    lens: Lens, segments: np.ndarray, resolved: np.ndarray, first: np.ndarray, cam2world: np.ndarray
) -> np.ndarray:
    """Return the least slacks of resolution, focus and field of view of each item (n, k, 3): what `image_slacks` says.

    A search asks for these most often by far, so they take one compiled pass without arrays in between.

    Parameters
    ----------
    lens : Lens
        What is asked.
    segments : array (s, 2, 3)
        Of all items, mm.
    resolved : array of bool (s,)
        Which of their images must be long enough.
    first : array of int (k,)
        The items' first segments.
    cam2world : array (n, 4, 4)
        Poses.
    """
    out = np.empty((len(cam2world), len(first), 3))
    ends = np.append(first, len(segments))
    # one kind of arrays, so that the pass is compiled once
    poses = np.array(cam2world, dtype=np.float64, order="C").reshape(-1, 4, 4)
    _image_margins(lens, np.array(segments), np.array(resolved), ends, poses, out)
    return out


def resolution_slacks(camera: Camera, ends_cam: np.ndarray, min_length_mm: float) -> np.ndarray:
    """Eq 16: length of each entity's image minus the smallest allowed, mm on the sensor; (n, k, 1)."""
    return image_slacks(Lens.of(camera, min_length_mm=min_length_mm), ends_cam)[..., RESOLUTION]


def focus_slacks(camera: Camera, ends_cam: np.ndarray) -> np.ndarray:
    """Eqs 17–18: depth of each end minus D_min, and D_max minus that depth, mm; (n, k, 4)."""
    return image_slacks(Lens.of(camera), ends_cam)[..., FOCUS]


def field_of_view_slacks(camera: Camera, ends_cam: np.ndarray, margin_px: float) -> np.ndarray:
    """Distance of each end's image from the four sides of the sensor, less a margin, px; (n, k, 8).

    The image of a segment is the segment between the images of its ends, so both ends inside means all of it inside.
    Behind the camera there is no image; the slack is then a large negative number.
    """
    return image_slacks(Lens.of(camera, margin_px=margin_px), ends_cam)[..., FIELD_OF_VIEW]


@kernel(error_model="numpy")
def _focus_margin(least, reserve, x, y):
    """Return the reserve of focus of an end at (x, y) of the camera's frame, mm, as `FocusReserve.margin_mm`."""
    if reserve.sigmas <= 0.0:
        return least
    variance = (
        reserve.along
        + 2.0 * (y * reserve.along_x - x * reserve.along_y)
        + y * y * reserve.turn_x
        + x * x * reserve.turn_y
        - 2.0 * x * y * reserve.turn_xy
    )
    sigma = math.sqrt(max(variance, 0.0))
    ceiling = max(reserve.most_mm, reserve.least_sigmas * sigma)
    return max(least, min(reserve.sigmas * sigma, ceiling))


@entry_kernel(error_model="numpy")
def _image_slacks(lens, ends_cam, out):
    for i in range(ends_cam.shape[0]):
        for j in range(ends_cam.shape[1]):
            _segment_slacks(lens, ends_cam[i, j, 0], ends_cam[i, j, 1], out[i, j])


@kernel(error_model="numpy")
def _segment_slacks(lens, a, b, row):
    length = 0.0
    if a[2] > 0.0 and b[2] > 0.0:
        x = a[0] * b[2] - b[0] * a[2]
        y = a[1] * b[2] - b[1] * a[2]
        length = lens.image_distance_mm * math.hypot(x, y) / (a[2] * b[2])
    row[0] = length - lens.min_length_mm
    for e in range(2):
        x, y, z = a if e == 0 else b
        margin = _focus_margin(lens.focus_margin_mm, lens.reserve, x, y)
        row[1 + e] = z - (lens.nearest_mm + margin)
        row[3 + e] = (lens.farthest_mm - margin) - z
        if z <= 0.0:
            row[5 + e] = row[7 + e] = row[9 + e] = row[11 + e] = _NOT_IMAGED_PX
            continue
        u = lens.scale_x_px * x / z + lens.centre_x_px
        v = lens.scale_y_px * y / z + lens.centre_y_px
        row[5 + e] = u - lens.left_px - lens.margin_px
        row[7 + e] = lens.right_px - u - lens.margin_px
        row[9 + e] = v - lens.top_px - lens.margin_px
        row[11 + e] = lens.bottom_px - v - lens.margin_px


@kernel(error_model="numpy")
def _smaller(smallest, value):
    # what is no number stays none, as numpy has it
    return value if value < smallest or value != value else smallest


@kernel(error_model="numpy")
def _in_camera(pose, point):
    x = point[0] - pose[0, 3]
    y = point[1] - pose[1, 3]
    z = point[2] - pose[2, 3]
    return (
        pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
        pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
        pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
    )


@entry_kernel(error_model="numpy")
def _image_margins(lens, segments, resolved, first, poses, out):
    row = np.empty(13)
    for i in range(len(poses)):
        pose = poses[i]
        for k in range(out.shape[1]):
            length = np.inf
            depth = np.inf
            side = np.inf
            for j in range(first[k], first[k + 1]):
                a = _in_camera(pose, segments[j, 0])
                b = _in_camera(pose, segments[j, 1])
                _segment_slacks(lens, a, b, row)
                if resolved[j]:
                    length = _smaller(length, row[0])
                for c in range(1, 5):
                    depth = _smaller(depth, row[c])
                for c in range(5, 13):
                    side = _smaller(side, row[c])
            out[i, k, 0] = length
            out[i, k, 1] = depth
            out[i, k, 2] = side


@entry_kernel(error_model="numpy")
def _least_slacks(slacks, first, out):
    for i in range(slacks.shape[0]):
        for k in range(out.shape[1]):
            for c in range(slacks.shape[2]):
                smallest = slacks[i, first[k], c]
                for j in range(first[k] + 1, first[k + 1]):
                    smallest = _smaller(smallest, slacks[i, j, c])
                out[i, k, c] = smallest


def cone_slacks(camera: Camera, centre_cam: np.ndarray, radius_mm: float) -> np.ndarray:
    """Eqs 19–20: the sphere around the entities lies in the cone of the smaller sensor side; mm, (n, 1, 1).

    With α = 2·atan(I_min / 2d) and r_k = r_s − (R_s / sin(α/2))·v the slack is (r_k − r_v)·v − ‖r_k − r_v‖·cos(α/2).

    Parameters
    ----------
    camera : Camera
        Gives I_min, the smaller side of the sensor, and d; off centre, the side nearest to the axis counts.
    centre_cam : array (n, 3)
        Centre r_s of the sphere in the camera frame, mm.
    radius_mm : float
        Its radius R_s.
    """
    half = math.atan(min(camera.sensor_size_mm) / (2 * camera.image_distance_mm))
    if not camera.is_centred:
        x_low, y_low, x_high, y_high = camera.field().inner
        half = math.atan(min(-x_low, -y_low, x_high, y_high))
    apex = centre_cam - [0.0, 0.0, radius_mm / math.sin(half)]
    return (apex[..., 2] - np.linalg.norm(apex, axis=-1) * math.cos(half))[:, None, None]


# The requirements of a request, and all constraints together.


# Open3D's distances are good to 1e-7 of the part's size; only what is surely farther is not asked for
_SURELY = 1.001
# poses whose images are looked at together
_AT_ONCE = 8
# poses kept to say why they are not reached
_MISSED = 200


@dataclass(frozen=True)
class Requirements:
    """The constraints that a sensor setting must meet in addition to the accuracy.

    Parameters
    ----------
    min_length_px : float
        Smallest length of an entity in the image, in pixels of the larger pitch (L_min of eq 16).
    field_margin_px : float
        Width of the strip along the sensor's edges to keep free, px. The cone ignores it.
    field_of_view : {"exact", "cone"}
        "exact": both ends are inside the rectangular sensor. "cone": the paper's conservative cone.
    stand_off_mm : float
        Smallest distance between the front nodal point and the part.
    reach : ReachRegion or callable, optional
        Region in which the front nodal point may be, see `planner.request.reach`.
    visibility_radius_mm : float
        Entities must also be observable from all points up to this distance from the front nodal
        point.
    focus_margin_mm : float
        Narrow both limits of the depth of field by this distance, so that a displaced camera is
        still in focus.
    focus_reserve : FocusReserve
        Further narrowing for each end, by its distance from the axis, where this exceeds the
        margin.
    showing : Detectability
        Conditions under which software can find edges in the image.
    cell : PoseRegion, optional
        Poses that a robot reaches, such as a `planner.Cell` with the part in it.

    Raises
    ------
    RequestError
        If a value breaks its rule.

    Examples
    --------
    >>> from planner import Requirements
    >>> Requirements(min_length_px=30.0, stand_off_mm=80.0).stand_off_mm
    80.0
    """

    min_length_px: float = field(
        default=20.0, metadata={"title": "Image of an edge", "sentence": "at least {:g} px long"}
    )
    field_margin_px: float = 0.0
    field_of_view: FieldOfView = "exact"
    stand_off_mm: float = field(
        default=50.0, metadata={"title": "Stand-off", "sentence": "at least {:g} mm from the part"}
    )
    reach: Annotated[Reach | None, PlainReach] = field(default=None, repr=False)
    visibility_radius_mm: float = 0.0
    focus_margin_mm: float = 0.0
    focus_reserve: FocusReserve = NO_RESERVE
    showing: Detectability = NOT_ASKED
    cell: Annotated[PoseRegion | None, PlainReach] = field(default=None, repr=False)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in limit_names():
            value = getattr(self, name)
            if not (
                isinstance(value, int | float | np.number) and math.isfinite(value) and value >= 0
            ):
                raise RequestError.of_rule(name, "must be finite and not negative", repr(value))
        if self.field_of_view not in ("exact", "cone"):
            raise RequestError.of_rule(
                "field_of_view", "must be 'exact' or 'cone'", repr(self.field_of_view)
            )
        check_reach(self.reach)

    def to_dict(self) -> dict[str, float]:
        """Return the numbers as plain values, without the reach.

        Returns
        -------
        dict of str to float
            By field.
        """
        image_limits = {} if self.showing.asks_nothing else asdict(self.showing)
        if self.focus_reserve.sigmas > 0:
            image_limits = {"focus_sigmas": self.focus_reserve.sigmas, **image_limits}
        return {
            name: float(value)
            for name, value in {
                **{n: getattr(self, n) for n in limit_names()},
                **image_limits,
            }.items()
        }

    @property
    def border_px(self) -> float:
        """Width of the sensor's edge strip without targets: safety margin plus surround, px."""
        return self.field_margin_px + self.showing.surround_px


def limit_names() -> tuple[str, ...]:
    """Return the fields of `Requirements` that are numbers: each is an option of plans under the same name."""
    return tuple(field.name for field in fields(Requirements) if field.type == "float")


def limit_sentences(limits: Mapping[str, float]) -> dict[str, str]:
    """Return what reports say of limits whose field has a title and a sentence, by title.

    Parameters
    ----------
    limits : mapping of str to float
        As `Requirements.to_dict` returns them.
    """
    return {
        field.metadata["title"]: field.metadata["sentence"].format(limits[field.name])
        for field in fields(Requirements)
        if "title" in field.metadata and field.name in limits
    }


@dataclass
class ArmTally:
    """Poses that met all other constraints of a request: whether the robot reached one, and some that it did not.

    Attributes
    ----------
    n_asked, n_reached : int
        How many there were.
    missed : list of array (4, 4)
        The first that were not reached.
    """

    n_asked: int = 0
    n_reached: int = 0
    missed: list[np.ndarray] = field(default_factory=list)

    def count(self, cam2world: np.ndarray, reached: np.ndarray) -> None:
        """Take in poses (n, 4, 4), and which were reached (n,)."""
        self.n_asked += len(reached)
        self.n_reached += int(reached.sum())
        if len(self.missed) < _MISSED:
            self.missed.extend(cam2world[~reached][: _MISSED - len(self.missed)])


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
    targets : sequence of Target, optional
        What of them must be in the picture, in the order of the names. Default: both ends of edges.

    Attributes
    ----------
    ends : array (k, 2, 3)
        Two points of each item, mm.
    segments : array (s, 2, 3)
        Pairs of points that must be in the picture and in focus, mm; ``owner`` (s,) tells of which item.
    resolved : array of bool (s,)
        Which of their images must be long enough.
    """

    def __init__(
        self,
        space: Space,
        names: Sequence[str],
        camera: Camera,
        requirements: Requirements,
        targets: Sequence[Target] | None = None,
    ):
        self.space = space
        self.names = tuple(names)
        self.camera = camera
        self.requirements = requirements
        self.targets = targets or edge_targets(space.entities, self.names)
        witnesses = [target.witness for target in self.targets]
        self.ends = np.array([witness.ends for witness in witnesses], dtype=np.float64)
        self.segments = np.concatenate([witness.segments for witness in witnesses])
        self.resolved = np.concatenate([witness.resolved for witness in witnesses])
        sizes = [len(witness.segments) for witness in witnesses]
        self.owner = np.repeat(np.arange(len(witnesses)), sizes)
        self._first = np.cumsum([0, *sizes[:-1]])
        self.min_length_mm = requirements.min_length_px * max(camera.pixel_pitch_mm)
        self._lens = Lens.of(
            camera,
            self.min_length_mm,
            requirements.border_px,
            requirements.focus_margin_mm,
            requirements.focus_reserve,
        )
        self._exact_field = requirements.field_of_view == "exact"
        self._workspace = np.array(space.workspace, dtype=np.float64)
        self._box = np.array(
            [np.min(space.solid.vertices, axis=0), np.max(space.solid.vertices, axis=0)]
        )
        self._distance = distance_to(space.solid)
        # of the image, in columns of `image_slacks`
        self._columns = {"resolution_mm": RESOLUTION, "focus_mm": FOCUS}
        if self._exact_field:
            self._columns["field_of_view_px"] = FIELD_OF_VIEW
        self.arm = ArmTally()
        self._checks = self._build_checks()
        self._shows = self._build_shows()

    def _build_checks(self) -> dict[str, Any]:
        """Map each constraint that is no column of the image to its slacks as a function of cam2world."""
        need = self.requirements
        checks = {}
        if not self._exact_field:
            checks["field_of_view_mm"] = lambda pose: cone_slacks(
                self.camera, world_to_cam(self.sphere_centre, pose), self.sphere_radius
            )
        checks["workspace_mm"] = lambda pose: workspace_slacks(self._workspace, pose[:, :3, 3])
        if (reach := need.reach) is not None:
            checks["reach"] = lambda pose: reach_margin(reach, pose[:, :3, 3])[:, None, None]
        checks["clearance_mm"] = lambda pose: clearance_slacks(
            self._distance, pose[:, :3, 3], need.stand_off_mm
        )
        checks["visibility"] = lambda pose: visibility_slacks(
            self.space, pose[:, :3, 3], self.names, need.visibility_radius_mm
        )
        return checks

    def _build_shows(self) -> dict[str, Any]:
        """Map the conditions on the image that cost most to their slacks; see `Detectability`.

        Of many poses only what they miss matters, so lines that are far enough are not looked at.
        """
        showing = self.requirements.showing
        shows: dict[str, Any] = {}
        if showing.min_corner_deg > 0 and any(target.has_corners for target in self.targets):
            shows["corner_deg"] = lambda pose: self._shown("corner_deg", pose)[..., None]
        if showing.separation_px > 0:
            shows["separation_px"] = lambda pose: self._shown(
                "separation_px", pose, MOST_PX if len(pose) <= FEW else 0.0
            )[..., None]
        return shows

    def _shown(self, name: str, cam2world: np.ndarray, most_px: float = 0.0) -> np.ndarray:
        """Return the margins (n, k) of a condition on the image; of a separation at most so many px are told."""
        everyone = np.ones((len(cam2world), len(self.names)), bool)
        if name == "corner_deg":
            return self.image.corners(cam2world, everyone)
        return self.image.separations(cam2world, everyone, most_px)

    def first_shown(self, cam2world: np.ndarray) -> int | None:
        """Return the number of the first of poses (n, 4, 4) in whose image all entities can be found; None without."""
        for first in range(0, len(cam2world), _AT_ONCE):
            slacks = self.slacks(cam2world[first : first + _AT_ONCE], self.shows)
            # without conditions, the first
            shown = np.all([margins.min(axis=(1, 2)) >= 0 for margins in slacks.values()], axis=0)
            if np.any(shown):
                return first + int(np.argmax(shown))
        return None

    @cached_property
    def _sphere(self) -> tuple[np.ndarray, float]:
        return enclosing_sphere(self.segments.reshape(-1, 3))

    @property
    def sphere_centre(self) -> np.ndarray:
        """Centre (3,) of a sphere around all segments, mm."""
        return self._sphere[0]

    @property
    def sphere_radius(self) -> float:
        """Radius of that sphere, mm."""
        return self._sphere[1]

    @cached_property
    def image(self) -> ImageCheck:
        """Whether edges can be found in the images of poses."""
        return self.image_check(self.requirements.showing)

    def image_check(self, showing: Detectability) -> ImageCheck:
        """Return a check of whether edges can be found in images, under some conditions."""
        edge_ids = [
            edges_of(self.space, target.name) if target.has_corners else None
            for target in self.targets
        ]
        scanned = [
            ()
            if target.has_corners
            else scanned_in(self.space, target.name, target.measurand.geometry)
            for target in self.targets
        ]
        return ImageCheck(
            self.space.solid,
            edge_ids,
            self.ends,
            self.camera,
            showing,
            scanned,
            only_outlines=getattr(entity_space(self.space), "only_outlines", False),
        )

    @property
    def shows(self) -> tuple[str, ...]:
        """Names of those constraints that `image` tells of."""
        return tuple(self._shows)

    @property
    def of_image(self) -> tuple[str, ...]:
        """Names of those constraints that the images of the ends decide; they cost little together."""
        return tuple(self._columns)

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the constraints; each ends with the unit of its margin."""
        return (*self._columns, *self._checks, *self._shows)

    def slacks(
        self, cam2world: np.ndarray, only: Sequence[str] | None = None
    ) -> dict[str, np.ndarray]:
        """Return the slacks (n, k or 1, s) of poses (n, 4, 4) per constraint."""
        names = self.constraint_names if only is None else only
        checks = {**self._checks, **self._shows}
        if any(name in self._columns for name in names):
            image = self._image_slacks(cam2world)
        return {
            name: image[..., self._columns[name]]
            if name in self._columns
            else checks[name](cam2world)
            for name in names
        }

    def focus_probability(self, cam2world: np.ndarray) -> np.ndarray:
        """Return how probable it is that a displaced camera has targets in focus; (n, k) of poses (n, 4, 4).

        That of the least sure end: depth is normal with the standard deviation of `FocusReserve`. It is 1 where the
        request keeps all of its standard deviations from both limits.
        """
        if self._keeps_focus:
            return np.ones((len(cam2world), len(self.names)))
        points = world_to_cam(self.segments, cam2world)
        sigma = self.requirements.focus_reserve.sigma_mm(points)
        near, far = self.camera.depth_of_field_mm
        sure = probability_between(points[..., 2] - near, far - points[..., 2], sigma)
        return np.asarray(np.minimum.reduceat(sure.min(axis=-1), self._first, axis=1))

    @cached_property
    def _keeps_focus(self) -> bool:
        reserve = self.requirements.focus_reserve
        if reserve.sigmas <= 0.0:
            return True
        # the standard deviation is a convex function of the image point, so it is largest in a corner
        far = min(self.camera.depth_of_field_mm[1], 10.0 * self.camera.focus_distance_mm)
        x_low, y_low, x_high, y_high = self.camera.field().outer
        corners = [[x * far, y * far, far] for x in (x_low, x_high) for y in (y_low, y_high)]
        return bool(reserve.most_mm >= reserve.sigmas * reserve.sigma_mm(corners).max())

    def _image_slacks(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the slacks of the image (n, k, c), of each item the smallest over its segments."""
        image = image_slacks(self._lens, world_to_cam(self.segments, cam2world))
        if not self.resolved.all():
            image[:, ~self.resolved, RESOLUTION] = np.inf
        if len(self.segments) == len(self.names):
            return image
        return least_slacks(image, self._first)

    def margins(
        self, cam2world: np.ndarray, only: Sequence[str] | None = None
    ) -> dict[str, np.ndarray]:
        """Return the margin of poses (n, 4, 4) per constraint and entity: (n, k), or (n, 1) where entities share it."""
        names = self.constraint_names if only is None else only
        checks = [name for name in names if name not in self._columns]
        slacks = self.slacks(cam2world, checks)
        margins = {name: slack.min(axis=-1) for name, slack in slacks.items()}
        if len(checks) < len(names):
            image = self._image_margins(cam2world)
            margins.update({name: image[..., k] for k, name in enumerate(self._columns)})
        return {name: margins[name] for name in names}

    def _image_margins(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the margins of the image (n, k, c), in the order of `of_image`."""
        margins = image_margins(self._lens, self.segments, self.resolved, self._first, cam2world)
        return margins[..., : len(self._columns)]

    def feasible(self, cam2world: np.ndarray) -> np.ndarray:
        """Return which of the poses (n, 4, 4) satisfy every constraint; (n,) bool."""
        mask = np.asarray((self._image_margins(cam2world) >= 0).all(axis=(1, 2)))
        # cheap constraints come first, and the costly ones see only what is left
        for name, check in self._checks.items():
            candidates = np.flatnonzero(mask)
            if name == "clearance_mm":
                candidates = candidates[self._may_be_near(cam2world[candidates, :3, 3])]
            if candidates.size:
                mask[candidates] = check(cam2world[candidates]).min(axis=(1, 2)) >= 0
        if self._shows and (candidates := np.flatnonzero(mask)).size:
            mask[candidates] = self.image.show_all(cam2world[candidates])
        if self.requirements.cell is not None and (candidates := np.flatnonzero(mask)).size:
            mask[candidates] = self.is_reached(cam2world[candidates])
        return mask

    def is_reached(self, cam2world: np.ndarray) -> np.ndarray:
        """Return which poses (n, 4, 4) a robot reaches with all targets in sight; all of them without a cell; (n,)."""
        cell = self.requirements.cell
        if cell is None:
            return np.ones(len(cam2world), dtype=bool)
        everyone = np.ones((len(cam2world), len(self.names)), dtype=bool)
        targets = cell.inspectable(cam2world, self.segments, self.owner, everyone)
        seen = np.asarray(targets.all(axis=1))
        self.arm.count(cam2world, seen)
        return seen

    def explain_reach(self) -> str:
        """Return in words why no pose that met all else was reached; empty if one was, or none met all else."""
        cell = self.requirements.cell
        if cell is None or not self.arm.missed or self.arm.n_reached:
            return ""
        return cell.explain(np.array(self.arm.missed), self.segments)

    def _may_be_near(self, positions: np.ndarray) -> np.ndarray:
        """Return which positions (n, 3) are not surely farther from the part than the stand-off: by the part's box."""
        outside = np.maximum(np.maximum(self._box[0] - positions, positions - self._box[1]), 0.0)
        return (outside**2).sum(axis=1) <= (_SURELY * self.requirements.stand_off_mm) ** 2

    def scale(self, name: str) -> float:
        """Return a natural size of a constraint's margin, to weigh violations of different units."""
        low, high = (np.asarray(corner, dtype=float) for corner in self.space.workspace)
        diagonal = float(np.linalg.norm(high - low))
        if name == "field_of_view_mm":
            # it takes long to find, and few requests have a cone
            return max(self.sphere_radius, 1e-9)
        return {
            "resolution_mm": max(self.min_length_mm, 1e-9),
            "focus_mm": self.camera.depth_of_field_mm[0],
            "field_of_view_px": float(max(self.camera.resolution)),
            "clearance_mm": max(self.requirements.stand_off_mm, 1.0),
            "workspace_mm": diagonal,
            # a region's margin is a distance, a callable's is +1 or -1
            "reach": diagonal if hasattr(self.requirements.reach, "margin") else 1.0,
            "visibility": 1.0,
            "separation_px": max(self.requirements.showing.separation_px, 1.0),
            "corner_deg": max(self.requirements.showing.min_corner_deg, 1.0),
        }[name]

    def violation(self, cam2world: np.ndarray, images_only: bool = False) -> np.ndarray:
        """Return how far poses (n, 4, 4) are from feasible: 0 is feasible, else a sum over constraints; (n,).

        With images of the ends only it is no larger, and computed soon.
        """
        total = np.zeros(len(cam2world))
        cheap = (
            self.of_image
            if images_only
            else [name for name in self.constraint_names if name not in self._shows]
        )
        for name, margin in self.margins(cam2world, cheap).items():
            total += self._share_missed(name, margin)
        if images_only:
            total[total > 0.0] += len(self._shows)
            return total
        # what costs most is asked only of poses that miss nothing else; the others miss it as far as it goes
        for name in self._shows:
            met = np.flatnonzero(total == 0.0)
            total[total > 0.0] += 1.0
            if met.size:
                total[met] = self._share_missed(name, self._shown(name, cam2world[met]))
        met = np.flatnonzero(total == 0.0)
        if self.requirements.cell is not None and met.size:
            total[met] = np.where(self.is_reached(cam2world[met]), 0.0, 1.0)
        return total

    def _share_missed(self, name: str, margin: np.ndarray) -> np.ndarray:
        """Return the violation (n,) of one constraint from its margins (n, k or 1)."""
        missed = np.minimum(np.maximum(-margin, 0.0) / self.scale(name), 10.0)
        return np.asarray(missed.sum(axis=1) / margin.shape[1])
