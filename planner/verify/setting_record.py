"""A setting in a plan file, with what follows from plan and pose: how sure dimensions are, and where to look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from errors.checks import below_one
from errors.measurands import Prediction
from ground.convert import Meta, field_name, shown
from planner.camera.camera import Camera, image_of
from planner.camera.pose import PoseUncertainty, world_to_cam
from planner.detectability.conditions import asks_of_images
from planner.exceptions import PlanFileError
from planner.plan_file import Amount
from planner.request.camera_limits import NO_RESERVE, FocusReserve, probability_share, rooms, shares
from planner.request.registration import means_at
from planner.request.targets import Target, targets_of

# How far from its prediction a line may be in the image: where a detector has to look for it.


Array = NDArray[np.float64]

SIGMAS = 3.0
"""Half the width of a search window, in standard deviations of the image's shift."""

# difference quotients of the lens's distortion
_STEP = 1e-6


def search_window_px(
    cam2world: Array,
    points: Array,
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    sigmas: float = SIGMAS,
) -> float:
    """Return within how many pixels of its prediction an image is found, if the pose is as uncertain as is said.

    A camera moved by t and turned by φ, both in its own axes, images the point x at P(x − t − φ × x) to first order,
    with the projection P(x) = (x/z, y/z). With its Jacobian J = [1/z, 0, −x/z²; 0, 1/z, −y/z²] the shift has the
    covariance J [−1, [x]×] Σ [−1, [x]×]ᵀ Jᵀ, in units of slope; scale and distortion of the camera make it pixels. The
    window is the largest standard deviation in any direction, at the point that moves farthest, times `sigmas`.

    Parameters
    ----------
    cam2world : array (4, 4)
        Planned pose.
    points : array (n, 3)
        Of an edge both ends; of other things points of all their entities. Part's frame, mm.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    sigmas : float
        Standard deviations.

    Returns
    -------
    float
        Pixels, to either side.
    """
    local = world_to_cam(
        np.asarray(points, dtype=np.float64), np.asarray(cam2world, dtype=np.float64)
    )
    x, y, z = np.moveaxis(local, -1, 0)
    moved = np.zeros((len(local), 3, 6))
    moved[:, :, :3] = -np.eye(3)
    # −φ × x = x × φ
    moved[:, 0, 4] = -z
    moved[:, 0, 5] = y
    moved[:, 1, 3] = z
    moved[:, 1, 5] = -x
    moved[:, 2, 3] = -y
    moved[:, 2, 4] = x
    projected = np.zeros((len(local), 2, 3))
    projected[:, 0, 0] = projected[:, 1, 1] = 1.0 / z
    projected[:, 0, 2] = -x / z**2
    projected[:, 1, 2] = -y / z**2
    jacobian = _pixels_per_slope(camera, local / z[:, None]) @ projected @ moved
    covariance = jacobian @ pose_uncertainty.covariance @ np.swapaxes(jacobian, 1, 2)
    return sigmas * float(np.sqrt(max(np.linalg.eigvalsh(covariance).max(), 0.0)))


def _pixels_per_slope(camera: Camera, directions: Array) -> Array:
    """Return how pixels change with the slopes x/z and y/z of directions (n, 3); (n, 2, 2)."""
    if camera.distortion is None:
        return np.broadcast_to(np.diag(np.diag(camera.matrix)[:2]), (len(directions), 2, 2))
    columns = []
    for axis in range(2):
        step = np.zeros(3)
        step[axis] = _STEP
        columns.append(
            (image_of(camera, directions + step) - image_of(camera, directions - step))
            / (2 * _STEP)
        )
    return np.stack(columns, axis=-1)


# How sure each dimension of a setting is measured, and what limits it: computed from the plan
# alone.


@dataclass(frozen=True)
class Measurement:
    """How sure a dimension is measured from a setting.

    Attributes
    ----------
    standard_uncertainty, expanded_uncertainty : float
        u, and U with k = 2, mm (angles: degrees); of a short arc from quantiles, see `errors.measurands.Prediction`.
    bias : float
        Mean error, mm (angles: degrees).
    budget : dict of str to float
        Variance by "translation", "rotation", "localisation", "localisation_floor", "surfaces" and "edge_state",
        mm² (angles: degrees²).
    permitted_error_px : float or None
        The permitted error times the image's scale d / (z r), with the mean depth z of the entities and the larger
        pixel pitch r; None of an angle.
    binding : str
        What has the smallest share of its room left (`planner.request.camera_limits`): "probability", "focus" or
        "field of view".
    """

    standard_uncertainty: Amount
    expanded_uncertainty: Amount
    bias: float
    budget: dict[str, float]
    permitted_error_px: Annotated[float, Meta(gt=0, title="must be positive")] | None
    binding: Annotated[
        str,
        Meta(
            pattern="^(probability|focus|field of view)$",
            title="must be probability, focus or field of view",
        ),
    ]


@dataclass(frozen=True)
class _Kept:
    """What was computed of the settings of a plan; each page and table of a report asks for it again."""

    described: dict[tuple[int, str], Prediction] = field(default_factory=dict)
    measured: dict[int, dict[str, Measurement]] = field(default_factory=dict)
    # so that no other setting gets the number of one of these
    settings: list[Any] = field(default_factory=list)


class Same:
    """A value that is only equal to itself, whatever it holds: a key for what was computed from it.

    Parameters
    ----------
    value : Any
        The value.
    """

    def __init__(self, value: Any) -> None:
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self.value is other.value


# of one plan, so that no other is kept in memory
@lru_cache(maxsize=1)
def _kept_of(_plan: Same) -> _Kept:
    return _Kept()


def described(plan: Any, setting: Any) -> dict[str, Prediction]:
    """Return how accurately a setting measures each of its targets.

    Parameters
    ----------
    plan : InspectionPlan
        Gives targets, camera and pose uncertainty.
    setting : Any
        One of its settings.

    Returns
    -------
    dict of str to Prediction
        By name, in the setting's order.
    """
    predictions = _kept_of(Same(plan)).described
    missing = [name for name in setting.entities if (id(setting), name) not in predictions]
    if missing:
        _kept_of(Same(plan)).settings.append(setting)
        targets = targets_of(plan.targets, setting)
        means = plan.means
        for name in missing:
            here = means_at(means, setting, name)
            predictions[id(setting), name] = targets[name].describe(setting.cam2world, here)
    return {name: predictions[id(setting), name] for name in setting.entities}


def measurements(plan: Any, setting: Any) -> dict[str, Measurement]:
    """Return how sure each dimension that a setting inspects is measured.

    Parameters
    ----------
    plan : InspectionPlan
        Gives dimensions, camera and pose uncertainty.
    setting : Any
        One of its settings.

    Returns
    -------
    dict of str to Measurement
        By name, in the setting's order; nothing of edges.
    """
    by_setting = _kept_of(Same(plan)).measured
    if id(setting) not in by_setting:
        predictions = described(plan, setting)
        targets = targets_of(plan.targets, setting)
        dimensions = plan.dimensions
        by_setting[id(setting)] = {
            name: _measurement(plan, setting, targets[name], predictions[name])
            for name in setting.entities
            if name in dimensions
        }
        _kept_of(Same(plan)).settings.append(setting)
    return dict(by_setting[id(setting)])


def measurements_dict(plan: Any, setting: Any) -> dict[str, dict[str, Any]]:
    """Return the same as plain values for a plan file.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    setting : Any
        One of its settings.

    Returns
    -------
    dict
        Fields of each `Measurement` by name.
    """
    return {name: asdict(measurement) for name, measurement in measurements(plan, setting).items()}


def _measurement(plan: Any, setting: Any, target: Target, predicted: Prediction) -> Measurement:
    points = world_to_cam(target.points, setting.cam2world)
    margins = {
        "probability": float(probability_share(setting.promise[target.name], plan.probability)),
        **_image_shares(plan, points),
    }
    return Measurement(
        predicted.standard_uncertainty,
        predicted.expanded_uncertainty,
        predicted.bias,
        dict(predicted.budget),
        target.permitted_error_px(setting.cam2world, plan.camera),
        min(margins, key=lambda key: margins[key]),
    )


def _image_shares(plan: Any, points: NDArray[np.float64]) -> dict[str, float]:
    """Return the shares of focus and field of view that are left for points (n, 3) in the camera frame."""
    camera = plan.camera
    need = plan.requirements
    reserve = NO_RESERVE
    if need.get("focus_sigmas", 0.0) > 0.0:
        reserve = FocusReserve.of(camera, plan.pose_uncertainty)
    room = rooms(camera, plan.workspace, need, reserve.on_axis_mm)
    near, far = camera.depth_of_field_mm
    depth = points[:, 2]
    margin = np.maximum(reserve.margin_mm(points), need.get("focus_margin_mm", 0.0))
    focus = np.minimum(depth - near, far - depth) - margin
    pixels = image_of(camera, points / depth[:, None])
    sides = np.minimum(pixels + 0.5, np.array(camera.resolution) - 0.5 - pixels)
    border = need.get("field_margin_px", 0.0) + need.get("surround_px", 0.0)
    margins = {"focus_mm": focus.min(), "field_of_view_px": sides.min() - border}
    by_condition = shares(margins, room)
    return {
        name: float(by_condition[key])
        for key, name in (("focus_mm", "focus"), ("field_of_view_px", "field of view"))
        if key in by_condition
    }


# a plan may be read on another machine, whose last digits differ
_SAME = 1e-6
# earlier programs had another definition; the schema says what it may be
_DEFINED_ANEW = ("binding",)
_FOLLOWS = ("measurements", "search_window_px")
# sources of variance that earlier programs did not know
_LATER = ("localisation_floor", "surfaces", "edge_state")


def search_windows_px(plan: Any, setting: Any) -> dict[str, float]:
    """Return within how many pixels of its prediction each item of a setting is found in the image.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the points, the camera and the pose uncertainty.
    setting : SensorSetting
        One of its settings.

    Returns
    -------
    dict of str to float
        Three standard deviations of the image's shift by name, px, see `planner.verify.setting_record`.
    """
    targets = targets_of(plan.targets, setting)
    return {
        name: search_window_px(
            setting.cam2world, targets[name].points, plan.camera, plan.pose_uncertainty
        )
        for name in setting.entities
    }


def setting_dict(plan: Any, setting: Any) -> dict[str, Any]:
    """Return a setting as plain values for a plan file.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    setting : SensorSetting
        One of its settings.

    Returns
    -------
    dict
        Its fields; in plans of dimensions `measurements`, and where edges must be found in images `search_window_px`.
    """
    fields = setting.to_dict()
    fields["probability"] = {name: below_one(p) for name, p in fields["probability"].items()}
    return {**fields, **_what_follows(plan, setting)}


def own_fields(setting: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a setting in a file holds beside what follows from the plan.

    Parameters
    ----------
    setting : mapping
        As read.
    """
    return {name: value for name, value in setting.items() if name not in _FOLLOWS}


def check_settings(plan: Any, settings: Sequence[Mapping[str, Any]]) -> None:
    """Refuse values in a file that are not those that follow from the plan.

    Parameters
    ----------
    plan : InspectionPlan
        What was read.
    settings : sequence of mapping
        The file's settings; what is missing is left alone.

    Raises
    ------
    PlanFileError
        Names the first wrong field by its path.
    """
    for k, (setting, data) in enumerate(zip(plan.settings, settings, strict=True)):
        names = [name for name in _FOLLOWS if name in data]
        follows = _what_follows(plan, setting) if names else {}
        for name in names:
            place = field_name("settings", k, name)
            if name not in follows:
                rule = "must only be given where requirements ask that edges are found in images"
                raise PlanFileError(f"{place} {rule}. Got {shown(data[name])}.")
            _check_same(place, data[name], follows[name])


def _what_follows(plan: Any, setting: Any) -> dict[str, Any]:
    values: dict[str, Any] = {}
    if plan.dimensions:
        ...  # joined

        values["measurements"] = measurements_dict(plan, setting)
    if asks_of_images(plan.requirements):
        values["search_window_px"] = search_windows_px(plan, setting)
    return values


def _check_same(where: str, given: Any, computed: Any) -> None:
    if isinstance(computed, dict) and isinstance(given, Mapping):
        for name in [*computed, *given]:
            if name in _DEFINED_ANEW and name in given:
                continue
            if name in _LATER and name not in given and computed[name] == 0.0:
                continue
            if name not in computed or name not in given:
                rule = (
                    "must be given. Got none."
                    if name in computed
                    else "must be of an item of the setting."
                )
                raise PlanFileError(f"{where}.{name} {rule}")
            _check_same(f"{where}.{name}", given[name], computed[name])
        return
    if isinstance(computed, float) and isinstance(given, int | float):
        same = bool(abs(given - computed) <= _SAME * max(abs(computed), _SAME))
    else:
        same = given == computed
    if not same:
        raise PlanFileError(
            f"{where} must be that of the pose, {shown(computed)}. Got {shown(given)}."
        )
