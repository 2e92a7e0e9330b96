"""What a setting must satisfy: signed margins, 0 or more is satisfied; the image's own are in `image_constraints`.

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
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from planner.camera.camera import Camera
from planner.camera.pose import world_to_cam
from planner.detectability.conditions import NOT_ASKED, Detectability
from planner.detectability.image_check import MOST_PX, ImageCheck, edges_of, scanned_in
from planner.exceptions import RequestError
from planner.request.camera_limits import NO_RESERVE, FocusReserve, probability_between
from planner.request.image_constraints import (
    FIELD_OF_VIEW,
    FOCUS,
    RESOLUTION,
    Lens,
    cone_slacks,
    image_slacks,
    least_slacks,
)
from planner.request.reach import (
    FEW,
    PoseRegion,
    Reach,
    Space,
    check_reach,
    clearance_slacks,
    distance_to,
    enclosing_sphere,
    reach_margin,
    visibility_slacks,
    workspace_slacks,
)
from planner.request.targets import Target, edge_targets

# Open3D's distances are good to 1e-7 of the part's size; only what is surely farther is not asked for
_SURELY = 1.001
# poses kept to say why they are not reached
_MISSED = 200
# fields of `Requirements`
_NUMBERS = (
    "min_length_px",
    "field_margin_px",
    "focus_margin_mm",
    "stand_off_mm",
    "visibility_radius_mm",
)


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

    min_length_px: float = 20.0
    field_margin_px: float = 0.0
    field_of_view: str = "exact"
    stand_off_mm: float = 50.0
    reach: Reach | None = field(default=None, repr=False)
    visibility_radius_mm: float = 0.0
    focus_margin_mm: float = 0.0
    focus_reserve: FocusReserve = NO_RESERVE
    showing: Detectability = NOT_ASKED
    cell: PoseRegion | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in _NUMBERS:
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
            for name, value in {**{n: getattr(self, n) for n in _NUMBERS}, **image_limits}.items()
        }

    @property
    def border_px(self) -> float:
        """Width of the sensor's edge strip without targets: safety margin plus surround, px."""
        return self.field_margin_px + self.showing.surround_px


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
        if showing.min_corner_deg > 0 and any(target.in_image for target in self.targets):
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
            edges_of(self.space, target.name) if target.in_image else None
            for target in self.targets
        ]
        scanned = [
            ()
            if target.in_image
            else scanned_in(self.space, target.name, target.measurand.geometry)
            for target in self.targets
        ]
        return ImageCheck(self.space.solid, edge_ids, self.ends, self.camera, showing, scanned)

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
        return {name: slacks.min(axis=-1) for name, slacks in self.slacks(cam2world, only).items()}

    def feasible(self, cam2world: np.ndarray) -> np.ndarray:
        """Return which of the poses (n, 4, 4) satisfy every constraint; (n,) bool."""
        image = self._image_slacks(cam2world)
        if not self._exact_field:
            image = image[..., : FIELD_OF_VIEW.start]
        mask = image.min(axis=(1, 2)) >= 0
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
        for name, slacks in self.slacks(cam2world, cheap).items():
            total += self._share_missed(name, slacks.min(axis=-1))
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
