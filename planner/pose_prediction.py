"""How sure is it from here? What a given pose inspects, without planning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from planner.argument_kinds import MAPPING, check_fraction, check_kinds
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty, world_to_cam
from planner.exceptions import RequestError
from planner.options import InspectionOptions
from planner.request.problem import Problem
from planner.request.reach import Space
from planner.request.registration import OWN_EDGES
from planner.request.targets import Target
from planner.resolve_request import problem_on, resolve_request
from planner.verify.p_all import DisplacedChecks

if TYPE_CHECKING:
    from aspectgraph import Solid
    from errors.measurands import Localisation


# displaced poses for P_all
_POSES = 2000


@dataclass(frozen=True)
class PosePrediction:
    """The predicted measurement of one target from a pose: whether and how accurately.

    Two things can fail. The image may not show the target; see ``missed``. Or its value may be too
    uncertain; see ``conditional_probability``. ``probability`` is a number where the target is
    inspected.

    Attributes
    ----------
    nominal : float
        Nominal value, mm (angles: degrees). All values except the margins have this unit.
    unit : str
        "mm" or "deg".
    permitted_error : float
        Largest error that counts as accurate.
    observable : bool
        Whether each of its entities is observable as a whole from the pose.
    probability : float
        P(error at most the permitted one). It is nan if the target is not ``inspected``, because
        the image may not show it. ``probability >= 0.9`` is then false.
    standard_uncertainty, expanded_uncertainty : float
        u, and U with k = 2.
    budget : dict of str to float
        Variance by "translation", "rotation", "localisation", "localisation_floor" and "surfaces".
    margins : dict of str to float
        Margin of every constraint, in the unit its name ends with. A negative margin fails.
    p_all : float
        Probability that the displaced camera has the target in the picture, in focus, unhidden and
        apart from other lines, and that the error is at most the permitted one. It is a lower bound
        with 99.9 % confidence over 2000 displaced poses, see `planner.verify.p_all`, and nan if the
        target is not ``inspected``.
    conditional_probability : float
        P(error at most the permitted one) for a target found in the image, even if it breaks a
        constraint. It is nan if a point of the target is behind the camera.
    missed : dict of str to float
        Every constraint that fails and the amount, in the unit its name ends with. The amount is 1
        for a constraint without a unit, such as "visibility". Empty if all are met.
    """

    nominal: float
    unit: str
    permitted_error: float
    observable: bool
    probability: float
    standard_uncertainty: float
    expanded_uncertainty: float
    budget: dict[str, float]
    margins: dict[str, float]
    conditional_probability: float
    missed: dict[str, float]
    p_all: float = math.nan

    @property
    def inspected(self) -> bool:
        """Whether the target is observable as a whole and every constraint is met."""
        return self.observable and not self.missed


def predict(
    solid: Solid,
    wanted: Mapping[str, Any],
    cam2world: ArrayLike,
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    *,
    accuracy: float = 0.98,
    localisation: Localisation | None = None,
    options: InspectionOptions | None = None,
) -> dict[str, PosePrediction]:
    """Predict how accurately each target is measured from a given pose.

    Parameters
    ----------
    solid : Solid
        The part.
    wanted : mapping
        Name to `Dimension`, or to an edge, rim or arc, as in `plan_inspection`: its length, diameter
        or radius is measured. The length of an edge needs a corner at each end in the image.
    cam2world : array_like (4, 4)
        Planned pose of the camera.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Uncertainty of its real pose about the planned one.
    accuracy : float
        Required accuracy A in (0, 1) of targets without a requirement of their own.
    localisation : Localisation, optional
        Model of the errors of image points. Default: that of `options`, otherwise
        ``Localisation.gaussian()`` if there is a `Dimension` and rounding to whole pixels if not.
    options : InspectionOptions, optional
        Constraints, workspace and effort, as in `plan_inspection`. The effort says how many witnesses
        of a dimension are offered. Default: ``InspectionOptions()``.

    Returns
    -------
    dict of str to PosePrediction
        By name, in the given order. Its ``missed`` says why the pose does not inspect a target.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    EntityError
        If an entity is not one of the part's.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Camera, Dimension, PoseUncertainty, look_at, predict
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> step = Dimension.distance([[50, 20, 10], [50, 40, 10]], [[60, 20, 10], [60, 40, 10]], max_error_mm=0.05)
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> pose = look_at([[310, 30, 168]], [55, 30, 10])[0]
    >>> found = predict(block, {"step": step}, pose, camera, uncertainty)["step"]
    >>> found.nominal, found.unit, found.inspected
    (10.0, 'mm', True)

    Nothing is promised of an image that is too short, and the prediction says what is missing:

    >>> from planner import InspectionOptions
    >>> strict = InspectionOptions(min_length_px=300)
    >>> found = predict(block, {"step": step}, pose, camera, uncertainty, options=strict)["step"]
    >>> found.inspected, found.probability, {name: round(mm, 2) for name, mm in found.missed.items()}
    (False, nan, {'resolution_mm': 0.49})
    """
    from aspectgraph import compute_regions

    check_kinds(
        solid=(solid, "Solid"),
        wanted=(wanted, MAPPING),
        camera=(camera, "Camera"),
        pose_uncertainty=(pose_uncertainty, "PoseUncertainty"),
    )
    check_fraction("accuracy", accuracy)
    if not wanted:
        raise RequestError.of_rule("wanted", "must hold at least one item", "none")
    pose = np.asarray(cam2world, dtype=np.float64)
    if pose.shape != (4, 4):
        raise RequestError.of_rule("cam2world", "must have the shape (4, 4)", str(pose.shape))
    settings = replace(options or InspectionOptions(), accuracy=accuracy)
    if localisation is not None:
        settings = replace(settings, localisation=localisation)
    registered = _registered(settings)
    resolved = resolve_request(solid, wanted, camera, pose_uncertainty, settings)
    posed = resolved.request
    regions = settings.space or compute_regions(
        solid, resolved.entities, workspace=posed.workspace, executor=settings.executor
    )
    request = problem_on(posed, regions, posed.targets, registered)
    seen = _observable(request.space, pose[:3, 3])
    return {
        target.name: _prediction(request, target, pose, bool(observable))
        for target, observable in zip(request.targets, seen, strict=True)
    }


def _registered(options: InspectionOptions) -> PoseUncertainty | None:
    """Return how well the pose is known when values are read, if registration says so."""
    record = options.registration_record
    if record is not None and record.method == OWN_EDGES:
        rule = "must be a PoseUncertainty for one pose"
        raise RequestError.of_rule("registration", rule, "Registration.own_edges()")
    return None if record is None else record.pose_uncertainty


def _prediction(
    request: Problem, target: Target, cam2world: np.ndarray, observable: bool
) -> PosePrediction:
    """Say how sure a target is measured, and what keeps it from being measured."""
    request = request.at_pose(cam2world, [target.name])
    (target,) = request.targets
    described = target.description(request.means).describe(np.linalg.inv(cam2world))
    constraints = request.constraints
    margins = {
        name: float(margin.min()) for name, margin in constraints.margins(cam2world[None]).items()
    }
    missed = {name: -margin for name, margin in margins.items() if margin < 0}
    # as the plan's settings state it: of a bare edge, by the density of its image's length
    if_found = float(request.objective.probability(cam2world[None])[0, 0])
    probability = if_found if observable and not missed else math.nan
    p_all = math.nan
    if not math.isnan(probability):
        counts = DisplacedChecks(request, [target.name]).count(cam2world, _POSES, seed=0)
        p_all = min(counts.lower[target.name], probability)
    return PosePrediction(
        nominal=described.nominal,
        unit=target.measurand.unit,
        permitted_error=described.permitted_error,
        observable=observable,
        probability=probability,
        standard_uncertainty=described.standard_uncertainty,
        expanded_uncertainty=described.expanded_uncertainty,
        budget=described.budget,
        margins=margins,
        conditional_probability=_if_found(if_found, target, cam2world),
        missed=missed,
        p_all=p_all,
    )


def _if_found(probability: float, target: Target, cam2world: np.ndarray) -> float:
    """Return a probability, or nan where a point of the target has no image."""
    in_front = world_to_cam(target.witness.segments, cam2world)[..., 2] > 0
    return probability if in_front.all() else math.nan


def _observable(space: Space, position: np.ndarray) -> np.ndarray:
    """Return which targets are observable from a position; nothing is from outside of the workspace."""
    low, high = np.asarray(space.workspace, dtype=np.float64)
    if not ((position >= low) & (position <= high)).all():
        return np.zeros(len(space.entity_names), dtype=bool)
    return np.asarray(space.observable(position[None])[0])
