"""What a pose, and what a lens, would promise, without planning."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import probability_text
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from ground.short_repr import short_repr
from planner.argument_kinds import (
    MAPPING,
    POSES,
    check_accuracy,
    check_fraction,
    check_kinds,
    check_list,
    kind_shown,
    suggests_names,
)
from planner.camera.camera import Camera, camera_parts, check_bodies
from planner.camera.pose import (
    GivenPose,
    HoldsPoses,
    PoseUncertainty,
    checked_poses,
    look_at,
    world_to_cam,
)
from planner.detectability.conditions import NOT_ASKED
from planner.effort import NORMAL
from planner.exceptions import RequestError
from planner.measuring.planned_edges import registered_problem
from planner.options import InspectionOptions, options_or_default
from planner.progress import labelled, report
from planner.request.camera_limits import position_margin_mm
from planner.request.constraints import RESOLUTION, Constraints, Lens, Requirements, image_slacks
from planner.request.dimension_files import surfaces_or_default
from planner.request.edge_state import EdgeState
from planner.request.models import Means
from planner.request.problem import OF_SHOWING, Problem, unjudged, why_missed
from planner.request.reach import Space, TargetSpace
from planner.request.targets import Target, knowledge_of
from planner.resolve_request import problem_on, resolve_request, resolve_targets
from planner.search.realise_column import poses_stated
from planner.text_table import Column, Table, count
from planner.verify.joint_counts import MOST_REQUIRED, DisplacedChecks, poses_needed

if TYPE_CHECKING:
    from aspectgraph import Solid
    from errors.measurands import Localisation

# How sure is it from here? What a given pose inspects, without planning.


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
        Variance by "translation", "rotation", "localisation", "localisation_floor", "surfaces" and
        "edge_state".
    margins : dict of str to float
        Margin of every constraint, in the unit its name ends with. A negative margin fails.
    p_all : float
        Probability that the displaced camera has the target in the picture, in focus, unhidden and
        apart from other lines, and that the error is at most the permitted one. It is a lower bound
        with 99.9 % confidence, as in a plan (`planner.verify.simulate_setting`), and nan if the
        target is not ``inspected``.
    p_all_poses : int
        Displaced poses of which it was counted: 20,000, and fewer where more than 20 measurements
        are predicted together. 0 if the target is not ``inspected``.
    conditional_probability : float
        P(error at most the permitted one) for a target found in the image, even if it breaks a
        constraint. It is nan if a point of the target is behind the camera.
    missed : dict of str to float
        Every constraint that fails and the amount, in the unit its name ends with. The amount is 1
        for a constraint without a unit, such as "visibility". The worst is first. Empty if all are
        met. From outside of the workspace, nobody knows what is visible, so these constraints are
        left out.
    worst_share : float
        How far the worst constraint is missed, as a share of a natural size; 0 if all are met. It
        orders misses.
    nominal_text : str
        The nominal value with its unit; of a position its zone and datums, as drawings write it.
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
    p_all_poses: int = 0
    worst_share: float = field(default=0.0, repr=False)
    nominal_text: str = field(default="", repr=False)

    __repr__ = short_repr

    @property
    def inspected(self) -> bool:
        """Whether the target is observable as a whole and every constraint is met."""
        return self.observable and not self.missed

    def is_sure(self, required: float) -> bool:
        """Return whether the target is inspected with a required P_all.

        Parameters
        ----------
        required : float
            The probability.

        Returns
        -------
        bool
            Whether `p_all` is at least as large.
        """
        return self.inspected and self.p_all >= min(required, MOST_REQUIRED)

    def reason(self, required: float) -> str:
        """Return why the pose does not inspect the target as surely as required.

        Parameters
        ----------
        required : float
            Required P_all.

        Returns
        -------
        str
            In words, the worst first; empty if the pose inspects the target.
        """
        if self.is_sure(required):
            return ""
        if math.isnan(self.conditional_probability):
            return "behind the camera"
        if self.missed:
            # the image of what is hidden says nothing
            said = [
                name
                for name in self.missed
                if "visibility" not in self.missed or name not in OF_SHOWING
            ]
            return ", ".join(why_missed(name, self.missed[name]) for name in said)
        if not self.observable:
            return "outside the workspace"
        if self.probability < required:
            return f"P is {self.probability:.4f}, below the required {required:g}"
        return f"P_all is {self.p_all:.4f}, below the required {required:g}"


@suggests_names
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
    cam2world : array_like (4, 4) or GivenPose
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
    check_kinds(
        solid=(solid, "Solid"),
        wanted=(wanted, MAPPING),
        cam2world=(cam2world, POSES),
        camera=(camera, "Camera"),
        pose_uncertainty=(pose_uncertainty, "PoseUncertainty"),
    )
    check_accuracy(accuracy)
    if not wanted:
        raise RequestError.of_rule("wanted", "must hold at least one item", "none")
    pose = _one_pose(cam2world)
    predicted = predict_poses(
        solid,
        wanted,
        [GivenPose("pose", pose)],
        camera,
        pose_uncertainty,
        accuracy=accuracy,
        localisation=localisation,
        options=options,
    )
    return predicted.predictions[0]


def _one_pose(cam2world: Any) -> NDArray[np.float64]:
    """Return a pose (4, 4), or raise `RequestError`."""
    try:
        pose = np.asarray(getattr(cam2world, "cam2world", cam2world), dtype=np.float64)
    except (TypeError, ValueError):
        hint = "predict_poses takes several"
        got = kind_shown(cam2world)
        raise RequestError.of_rule("cam2world", "must be an array (4, 4)", got, hint=hint) from None
    if pose.shape != (4, 4):
        raise RequestError.of_rule("cam2world", "must have the shape (4, 4)", str(pose.shape))
    return pose


@dataclass(frozen=True, eq=False)
class PosesPrediction(ShownInNotebook):
    """What each pose measures and how surely, and which targets none of them inspects.

    Attributes
    ----------
    poses : tuple of GivenPose
        The poses, in their order.
    predictions : tuple of dict of str to PosePrediction
        Of each pose, every target by name.
    required : float
        The required probability.

    Examples
    --------
    >>> from planner import PosesPrediction
    >>> PosesPrediction((), (), 0.9).missed
    {}
    """

    poses: tuple[GivenPose, ...]
    predictions: tuple[dict[str, PosePrediction], ...]
    required: float

    __repr__ = short_repr

    def _notebook_view(self) -> NotebookView:
        rows = []
        for pose, targets in zip(self.poses, self.predictions, strict=True):
            for name, target in targets.items():
                if target.is_sure(self.required):
                    u = f"{target.expanded_uncertainty:.3g} {target.unit}"
                    nominal = target.nominal_text
                    sure = (probability_text(target.probability), probability_text(target.p_all))
                    rows.append((pose.name, name, nominal, u, *sure))
        n = len(self.predictions[0]) if self.predictions else 0
        missed = self.missed
        verdict = Toned(f"The poses inspect {n - len(missed)} of {count(n, 'target')}.", "good")
        if missed:
            verdict = replace(verdict, tone="bad")
        table = NotebookTable(
            ("pose", "target", "nominal", "U", "P", "P_all"), rows, right=(2, 3, 4, 5)
        )
        return NotebookView(count(len(self.poses), "pose"), (verdict,), table, missed)

    def inspecting(self, name: str) -> tuple[str, ...]:
        """Return the poses that inspect a target as surely as required.

        Parameters
        ----------
        name : str
            The target.

        Returns
        -------
        tuple of str
            Names of poses, in their order.
        """
        return tuple(
            pose.name
            for pose, predicted in zip(self.poses, self.predictions, strict=True)
            if predicted[name].is_sure(self.required)
        )

    @property
    def missed(self) -> dict[str, str]:
        """By target that no pose inspects, the nearest miss: the pose, and why it does not."""
        names = self.predictions[0] if self.predictions else {}
        return {name: self._nearest(name) for name in names if not self.inspecting(name)}

    def _nearest(self, name: str) -> str:
        near = [predicted[name] for predicted in self.predictions]
        order = sorted(
            range(len(near)), key=lambda k: (near[k].worst_share, -_or_zero(near[k].p_all))
        )
        best = order[0]
        return f"{self.poses[best].name} is nearest: {near[best].reason(self.required)}"


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value


@suggests_names
def predict_poses(
    solid: Solid,
    wanted: Mapping[str, Any],
    poses: Sequence[GivenPose] | HoldsPoses | ArrayLike,
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    *,
    accuracy: float = 0.98,
    localisation: Localisation | None = None,
    options: InspectionOptions | None = None,
) -> PosesPrediction:
    """Predict how accurately each target is measured from each of some poses, such as those of a file.

    With registration in the options, P and U are those of values that are read from registered
    images, as in a plan.

    Parameters
    ----------
    solid : Solid
        The part.
    wanted : mapping
        Name to `Dimension`, or to an edge, rim or arc, as `predict` takes it.
    poses : sequence of GivenPose, PoseFile, or array_like (n, 4, 4)
        The poses, or what `read_poses` returns. An array gets the names pose_01, pose_02, and so on.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Uncertainty of its real pose about each of the poses.
    accuracy : float
        Required accuracy A in (0, 1) of targets without a requirement of their own.
    localisation : Localisation, optional
        Model of the errors of image points, see `predict`.
    options : InspectionOptions, optional
        Constraints, workspace, registration and effort, as in `plan_inspection`.

    Returns
    -------
    PosesPrediction
        Of every pose and target.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    EntityError
        If an entity is not one of the part's.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Camera, PoseUncertainty, predict_poses, read_poses
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> poses = read_poses("examples/two_pocket_block_plan.json").poses
    >>> wanted = {"rim": [[60, 20, 10], [60, 40, 10]]}
    >>> predicted = predict_poses(block, wanted, poses, camera, uncertainty, accuracy=0.95)
    >>> predicted.inspecting("rim"), predicted.missed
    (('setting_01',), {})
    """
    from aspectgraph import compute_regions

    check_kinds(
        solid=(solid, "Solid"),
        wanted=(wanted, MAPPING),
        poses=(poses, POSES),
        camera=(camera, "Camera"),
        pose_uncertainty=(pose_uncertainty, "PoseUncertainty"),
    )
    check_accuracy(accuracy)
    if not wanted:
        raise RequestError.of_rule("wanted", "must hold at least one item", "none")
    poses = checked_poses(poses)
    settings = replace(options_or_default(options), accuracy=accuracy)
    if localisation is not None:
        settings = replace(settings, localisation=localisation)
    resolved = resolve_request(solid, wanted, camera, pose_uncertainty, settings)
    request = resolved.request
    regions = settings.space or compute_regions(
        solid,
        resolved.entities,
        workspace=request.workspace,
        executor=settings.executor,
        progress=labelled(settings.progress, "visible regions"),
    )
    problem = registered_problem(
        problem_on(request, regions, request.targets), request.registration
    )
    uncounted = [_predictions(problem, pose.cam2world) for pose in poses]
    inspected = sum(len(_with_value(targets)) for targets in uncounted)
    predictions = []
    for k, (pose, targets) in enumerate(zip(poses, uncounted, strict=True)):
        predictions.append(_counted(problem, targets, pose.cam2world, poses_stated(inspected)))
        report(settings.progress, k + 1, len(poses), "poses")
    return PosesPrediction(tuple(poses), tuple(predictions), request.probability)


def _predictions(problem: Problem, cam2world: np.ndarray) -> dict[str, PosePrediction]:
    """Say how sure each target is measured from a pose, and what keeps it from being measured; P_all is left open."""
    seen = _observable(problem.space, cam2world[:3, 3])
    # a request without a choice keeps what it has made
    here = problem.at_pose(cam2world, problem.names) if problem.has_choice else problem
    n = len(here.names)
    margins = {
        name: np.broadcast_to(margin[0], (n,))
        for name, margin in here.constraints.margins(cam2world[None]).items()
    }
    if_found = here.objective.probability(cam2world[None])[0]
    unknown = unjudged(margins)
    met = np.all([margin >= 0 for margin in margins.values()], axis=0) & seen
    scales = {name: here.constraints.scale(name) for name in margins}
    predictions = {}
    for k, target in enumerate(here.targets):
        probability = float(if_found[k])
        knowledge = here.known_at(cam2world, [target.name])
        means = here.means if knowledge is None else knowledge.of_target(here.means, target.name)
        described = target.description(means).describe(np.linalg.inv(cam2world))
        own_margins = {name: float(margin[k]) for name, margin in margins.items()}
        relative = {name: margin / scales[name] for name, margin in own_margins.items()}
        missed = {
            name: -own_margins[name]
            for name in sorted(relative, key=relative.__getitem__)
            if own_margins[name] < 0 and name not in unknown
        }
        shares = [amount / scales[name] for name, amount in missed.items()]
        predictions[target.name] = PosePrediction(
            nominal=described.nominal,
            nominal_text=target.nominal_text,
            unit=target.measurand.unit,
            permitted_error=described.permitted_error,
            observable=bool(seen[k]),
            probability=probability if met[k] else math.nan,
            standard_uncertainty=described.standard_uncertainty,
            expanded_uncertainty=described.expanded_uncertainty,
            budget=described.budget,
            margins=own_margins,
            conditional_probability=_if_found(probability, target, cam2world),
            missed=missed,
            worst_share=max(shares, default=0.0 if seen[k] else 1.0),
        )
    return predictions


def _with_value(targets: dict[str, PosePrediction]) -> list[str]:
    return [name for name, target in targets.items() if not math.isnan(target.probability)]


def _counted(
    problem: Problem, targets: dict[str, PosePrediction], cam2world: np.ndarray, at_least: int
) -> dict[str, PosePrediction]:
    """Return predictions at a pose with their lower bounds of P_all, as a plan counts them."""
    names = _with_value(targets)
    if not names:
        return targets
    here = problem.at_pose(cam2world, problem.names) if problem.has_choice else problem
    n = poses_needed(min(here.probability, MOST_REQUIRED), at_least)
    lower = DisplacedChecks(here, names).count(cam2world, n, seed=0).lower
    counted = {
        name: replace(
            targets[name], p_all=min(lower[name], targets[name].probability), p_all_poses=n
        )
        for name in names
    }
    return {**targets, **counted}


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


# Which body, lens, working distance and aperture of the catalogue can measure what is wanted, and
# how well.


# A proposal of optics, and a table of several.


@dataclass(frozen=True, repr=False)
class OpticsProposal:
    """A camera with a lens and its settings, and how well it measures each target.

    The values are those of the best pose tried for each target.

    Attributes
    ----------
    body, lens : str
        Names of camera and lens in the catalogue.
    camera : Camera
        Both together, with the aperture set and the focus at the working distance.
    required : float
        The required probability.
    probability : dict of str to float
        Per target, P(error at most the permitted one). It is 0 if no pose tried meets every
        constraint.
    share : dict of str to float
        Ratio of the expanded uncertainty U (k = 2) to the permitted error, per target with a pose.
    poses : dict of str to array (4, 4)
        Those poses, cam2world, mm.
    """

    body: str
    lens: str
    camera: Camera
    required: float
    probability: dict[str, float]
    share: dict[str, float]
    poses: dict[str, NDArray[np.float64]] = field(compare=False)

    def __repr__(self) -> str:
        """Show the optics and how many targets they measure as required."""
        setup = f"f/{self.camera.f_number:g} at {self.working_distance_mm:g} mm"
        targets = count(len(self.probability), "target")
        return f"<OpticsProposal: {self.camera.name}, {setup}: {len(self.able)} of {targets}>"

    @property
    def working_distance_mm(self) -> float:
        """Distance from the front nodal point to the plane in focus."""
        return self.camera.focus_distance_mm

    @property
    def able(self) -> tuple[str, ...]:
        """Targets measured with the required probability."""
        return tuple(name for name, p in self.probability.items() if p >= self.required)

    @property
    def worst_share(self) -> float:
        """Largest ratio of U to the permitted error among `able`; inf without any."""
        return max((self.share[name] for name in self.able), default=float("inf"))

    @property
    def field_mm(self) -> tuple[float, float]:
        """Width and height of the field of view at the working distance."""
        x_low, y_low, x_high, y_high = self.camera.field().inner
        return (x_high - x_low) * self.working_distance_mm, (
            y_high - y_low
        ) * self.working_distance_mm

    def to_dict(self) -> dict[str, Any]:
        """Return the proposal as plain values, without the poses.

        Returns
        -------
        dict
            Ready for JSON.
        """
        return {
            "body": self.body,
            "lens": self.lens,
            "camera": self.camera.to_dict(),
            "able": list(self.able),
            "probability": dict(self.probability),
            "share": dict(self.share),
        }


@suggests_names
def optics_table(proposals: Sequence[OpticsProposal], most: int = 10) -> str:
    """Return proposals as a table of plain text.

    Parameters
    ----------
    proposals : sequence of OpticsProposal
        In the order of `propose_optics`: the best first.
    most : int
        Largest number of rows.

    Returns
    -------
    str
        A heading, and a line per proposal: camera, lens, f-number, working distance, depth of field
        and field of view. Then follow how many targets it measures as required, and the largest
        ratio of U to the permitted error among them.

    Examples
    --------
    >>> from planner import Camera, OpticsProposal, optics_table
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> able = OpticsProposal("a body", "a lens", camera, 0.9, {"rim": 0.97}, {"rim": 0.8}, {})
    >>> heading, _, row = optics_table([able]).splitlines()
    >>> print(heading)
    body    lens    f/  distance  sharp (mm)  field (mm)  targets  U / permitted
    >>> print(row)
    a body  a lens   8    300 mm  266 to 343   308 x 258      1/1           80 %
    """
    check_list("proposals", proposals, "OpticsProposal", "propose_optics returns one")
    return "\n".join(Table(OPTICS_COLUMNS, optics_rows(proposals, most)).lines(None))


OPTICS_COLUMNS = (
    Column("body"),
    Column("lens"),
    Column("f/", right=True),
    Column("distance", right=True),
    Column("sharp (mm)", right=True),
    Column("field (mm)", right=True),
    Column("targets", right=True),
    Column("U / permitted", right=True),
)
"""Columns of the table of proposals."""


def optics_rows(proposals: Sequence[OpticsProposal], most: int) -> list[tuple[str, ...]]:
    """Return a row per proposal, in the columns of `OPTICS_COLUMNS`.

    Parameters
    ----------
    proposals : sequence of OpticsProposal
        In the order of `propose_optics`.
    most : int
        Largest number of rows.
    """
    rows: list[tuple[str, ...]] = []
    for proposal in proposals[:most]:
        width, height = proposal.field_mm
        row = (
            proposal.body,
            proposal.lens,
            f"{proposal.camera.f_number:g}",
            f"{proposal.working_distance_mm:g} mm",
            proposal.camera.depth_of_field_text,
            f"{width:.0f} x {height:.0f}",
            f"{len(proposal.able)}/{len(proposal.probability)}",
            f"{100 * proposal.worst_share:.0f} %" if proposal.able else "-",
        )
        rows.append(row)
    return rows


# Which optics can do it: bodies and lenses of the catalogue, tried at several working distances.
#
# Every item that is wanted is looked at from fixed directions, its middle in focus, with the
# sensor level and on end. What a pose must satisfy beside the image does not depend on the camera
# and is asked once. The aperture is not searched for: depth of field grows as it closes, until
# diffraction blurs as much as is allowed. An Airy disk has the diameter 2.44 λ N d / f at the
# image distance d (Born and Wolf, Principles of Optics, 8.5.2). Three standard deviations of the
# camera's position are kept from the ends of the depth of field: close up it can be less than a
# robot's error.


@dataclass(frozen=True)
class OpticsRule:
    """What is tried.

    Attributes
    ----------
    wavelength_mm : float
        Of the light: green.
    blur_px : float
        Largest blur that counts as sharp, of defocus and of diffraction each, in pixels of the smaller pitch.
    stops : tuple of float
        F-numbers.
    directions : int
        Viewing directions on a sphere, beside the axes and the diagonals of the part's frame.
    """

    wavelength_mm: float = 0.00055
    blur_px: float = 2.0
    stops: tuple[float, ...] = (1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0)
    directions: int = 48


RULE = OpticsRule()
# steps of about 1.6, as of preferred numbers
DISTANCES_MM = (100.0, 160.0, 250.0, 400.0, 630.0, 1000.0, 1600.0)
# for what does not depend on the camera
_STAND_IN = Camera(25.0, (0.005, 0.005), (2000, 2000), 8.0, 400.0)
_OF_IMAGE = ("resolution_mm", "focus_mm", "field_of_view_px")


@suggests_names
def propose_optics(
    solid: Solid,
    wanted: Mapping[str, Any],
    pose_uncertainty: PoseUncertainty,
    *,
    bodies: Sequence[str] | None = None,
    accuracy: float = 0.98,
    probability: float = 0.9,
    distances_mm: Sequence[float] = DISTANCES_MM,
    options: InspectionOptions | None = None,
) -> tuple[OpticsProposal, ...]:
    """Rank cameras and lenses of the catalogue by how well they measure the targets.

    Parameters
    ----------
    solid : Solid
        The part.
    wanted : mapping
        Name to `Dimension`, or to an edge, rim or arc, as in `plan_inspection`: its length, diameter
        or radius is measured. The length of an edge needs a corner at each end in the image.
    pose_uncertainty : PoseUncertainty
        Uncertainty of the camera's real pose about the planned one.
    bodies : sequence of str, optional
        Names of cameras in the catalogue. Default: all.
    accuracy : float
        Required accuracy A in (0, 1) of targets without a requirement of their own.
    probability : float
        Required probability, in (0, 1), that a measurement is accurate.
    distances_mm : sequence of float
        Working distances to try, mm, from the front nodal point to the middle of a target.
    options : InspectionOptions, optional
        Constraints, workspace, localisation, surfaces and registration, as in `plan_inspection`.

    Returns
    -------
    tuple of OpticsProposal
        The best working distance of each camera and lens that fit each other. The first proposal
        measures most targets as required. Among equals, the largest ratio of U to the permitted
        error is smallest. Poses that were not tried may measure further targets.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    EntityError
        If an entity is not one of the part's.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import PoseUncertainty, propose_optics
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> sigma = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> rim = {"rim": [[60, 20, 10], [60, 40, 10]]}
    >>> best = propose_optics(block, rim, sigma, bodies=["basler-acA2440-20gm"], distances_mm=[250.0])[0]
    >>> best.able
    ('rim',)
    """
    check_kinds(
        solid=(solid, "Solid"),
        wanted=(wanted, MAPPING),
        pose_uncertainty=(pose_uncertainty, "PoseUncertainty"),
    )
    check_accuracy(accuracy)
    check_fraction("probability", probability)
    if not wanted:
        raise RequestError.of_rule("wanted", "must hold at least one item", "none")
    distances = _checked(distances_mm)
    fitting = _fitting(bodies)
    options = options_or_default(options)
    # only the preferred witness of each is looked at, and that is the same for every camera
    effort = replace(options.effort or NORMAL, witnesses=1)
    options = replace(options, effort=effort, accuracy=accuracy, probability=probability)
    entities, targets, localisation = resolve_targets(solid, wanted, _STAND_IN, options)
    options = replace(options, localisation=localisation)
    space = _space(solid, entities, targets, max(distances), options)
    views = _views(space, targets, distances, _limits(options, pose_uncertainty))
    best: dict[tuple[str, str], OpticsProposal] = {}
    for (body, lens), distance in itertools.product(fitting, distances):
        camera = _set(body, lens, distance)
        if camera is None:
            continue
        proposal = _judged((body, lens), camera, views, pose_uncertainty, options, space)
        if (body, lens) not in best or _rank(proposal) < _rank(best[body, lens]):
            best[body, lens] = proposal
    return tuple(sorted(best.values(), key=_rank))


def _checked(distances_mm: Sequence[float]) -> list[float]:
    distances = [float(distance) for distance in distances_mm]
    if not distances or not all(
        math.isfinite(distance_mm) and distance_mm > 0 for distance_mm in distances
    ):
        raise RequestError.of_rule(
            "distances_mm", "must be finite and positive, at least one", repr(distances_mm)
        )
    return distances


def _fitting(bodies: Sequence[str] | None) -> list[tuple[str, str]]:
    """Return the pairs of body and lens whose image circle covers the sensor."""
    parts = camera_parts()
    chosen = list(parts["body"]) if bodies is None else list(bodies)
    check_bodies(chosen)
    return [
        (body, lens)
        for body, lens in itertools.product(chosen, parts["lens"])
        if _diagonal_mm(parts["body"][body]) <= parts["lens"][lens]["image_circle_mm"]
    ]


def _diagonal_mm(body: Mapping[str, Any]) -> float:
    return math.hypot(
        *(n * pitch for n, pitch in zip(body["resolution"], body["pixel_pitch_mm"], strict=True))
    )


def _set(body: str, lens: str, distance: float) -> Camera | None:
    """Return a body and a lens focused at a distance, as far closed as diffraction allows; None if it is too close."""
    parts = camera_parts()
    sensor = parts["body"][body]
    glass = parts["lens"][lens]
    f = glass["focal_length_mm"]
    if distance < glass["closest_object_mm"]:
        return None
    blur = RULE.blur_px * min(sensor["pixel_pitch_mm"])
    # d / f = s / (s - f)
    limit = blur * (distance - f) / (2.44 * RULE.wavelength_mm * distance)
    widest = glass["widest_f_number"]
    narrowest = glass["narrowest_f_number"]
    sharp = [stop for stop in RULE.stops if widest <= stop <= min(narrowest, limit)]
    return Camera(
        focal_length_mm=f,
        pixel_pitch_mm=tuple(sensor["pixel_pitch_mm"]),
        resolution=tuple(sensor["resolution"]),
        f_number=max(sharp, default=widest),
        focus_distance_mm=distance,
        largest_blur_mm=blur,
        name=f"{body} with {lens}",
    )


def _space(
    solid: Solid,
    entities: Mapping[str, Any],
    targets: Sequence[Target],
    farthest: float,
    options: InspectionOptions,
) -> TargetSpace:
    from aspectgraph import compute_regions

    size = float(np.linalg.norm(solid.bounds[1] - solid.bounds[0]))
    box = solid.bounds + np.array([[-1.0], [1.0]]) * (farthest + size)
    regions = options.space or compute_regions(
        solid,
        entities,
        workspace=box if options.workspace is None else options.workspace,
        executor=options.executor,
    )
    return TargetSpace.of(regions, targets)


def _limits(options: InspectionOptions, pose_uncertainty: PoseUncertainty) -> Requirements:
    """Return the limits that do not depend on the camera; it stands in for all."""
    of_every_camera = replace(options, field_margin_px=0.0, focus_margin_mm=None, showing=NOT_ASKED)
    return of_every_camera.requirements(_STAND_IN, pose_uncertainty)


@dataclass(frozen=True)
class _View:
    """An item, what of it must be in the picture, and by distance the poses that see it."""

    target: Target
    constraints: Constraints
    poses: dict[float, NDArray[np.float64]]


def _views(
    space: TargetSpace, targets: Sequence[Target], distances: Sequence[float], need: Requirements
) -> list[_View]:
    views = []
    for target in targets:
        constraints = Constraints(space, [target.name], _STAND_IN, need, [target])
        others = [name for name in constraints.constraint_names if name not in _OF_IMAGE]
        poses = {}
        for distance in distances:
            tried = _around(constraints.sphere_centre, distance)
            slacks = constraints.slacks(tried, others)
            poses[distance] = tried[
                np.all([margins.min(axis=(1, 2)) >= 0 for margins in slacks.values()], axis=0)
            ]
        views.append(_View(target, constraints, poses))
    return views


def _around(centre: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) that look at a point from a distance: the sensor level, and a quarter turned."""
    k = np.arange(RULE.directions) + 0.5
    # Fibonacci's lattice: equal steps of height, turned by the golden angle
    z = 1.0 - 2.0 * k / RULE.directions
    turn = math.pi * (3.0 - math.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    lattice = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=-1)
    diagonals = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) / math.sqrt(3.0)
    eyes = centre + distance * np.concatenate([np.eye(3), -np.eye(3), diagonals, lattice])
    return np.concatenate([look_at(eyes, centre, roll=roll) for roll in (0.0, math.pi / 2)])


def _judged(
    names: tuple[str, str],
    camera: Camera,
    views: Sequence[_View],
    pose_uncertainty: PoseUncertainty,
    options: InspectionOptions,
    space: TargetSpace,
) -> OpticsProposal:
    required = options.probability
    near, far = camera.depth_of_field_mm
    margin = max(options.focus_margin_mm or 0.0, position_margin_mm(pose_uncertainty))
    if 2 * margin >= far - near:
        nothing = {view.target.name: 0.0 for view in views}
        return OpticsProposal(*names, camera, required, nothing, {}, {})
    # what is said holds for all points; otherwise each keeps more the farther it is from the axis
    reserve = options.requirements(camera, pose_uncertainty).focus_reserve
    need = replace(options, focus_margin_mm=margin).requirements(camera, pose_uncertainty)
    lens = Lens.of(
        camera,
        need.min_length_px * max(camera.pixel_pitch_mm),
        need.border_px,
        need.focus_margin_mm,
        reserve,
    )
    seen = {view.target.name: _in_image(view, lens, camera) for view in views}
    means = None
    probability = {}
    share = {}
    poses = {}
    for view in views:
        name = view.target.name
        best = None
        if len(seen[name]):
            # what registration will tell takes longest, so it is asked where some pose needs it
            means = means or _means(camera, views, pose_uncertainty, options, space)
            shows = Constraints(space, [name], camera, need, [view.target])
            best = _best(view, seen[name], means, shows)
        probability[name] = 0.0 if best is None else best[0]
        if best is not None:
            _, share[name], poses[name] = best
    return OpticsProposal(*names, camera, required, probability, share, poses)


def _in_image(view: _View, lens: Lens, camera: Camera) -> NDArray[np.float64]:
    """Return the poses (n, 4, 4) whose image holds what must be in the picture."""
    tried = view.poses[camera.focus_distance_mm]
    slacks = image_slacks(lens, world_to_cam(view.constraints.segments, tried))
    slacks[:, ~view.constraints.resolved, RESOLUTION] = np.inf
    return tried[slacks.min(axis=(1, 2), initial=np.inf) >= 0]


def _means(
    camera: Camera,
    views: Sequence[_View],
    pose_uncertainty: PoseUncertainty,
    options: InspectionOptions,
    space: TargetSpace,
) -> Means:
    """Return what a camera measures targets with, and how its images will be registered."""
    targets = tuple(view.target for view in views)
    problem = Problem(
        space,
        tuple(target.name for target in targets),
        camera,
        pose_uncertainty,
        options.accuracy,
        options.probability,
        targets=targets,
        localisation=options.localisation,
        surfaces_mm=surfaces_or_default(options.surfaces_mm, options.localisation),
        edges=EdgeState.planned(options.edge_break_mm),
    )
    return registered_problem(problem, options.registration_record).means


def _best(
    view: _View, poses: NDArray[np.float64], means: Means, shows: Constraints
) -> tuple[float, float, NDArray[np.float64]] | None:
    """Return the probability, U over the permitted error and the pose of what measures an item best.

    None if the item cannot be found in the image of any of the poses.
    """
    probability = view.target.probability(poses, means)
    order = np.argsort(-probability, kind="stable")
    first = shows.first_shown(poses[order])
    if first is None:
        return None
    best = int(order[first])
    if means.own_edges is not None:
        # as a setting of a plan states it
        knowledge = knowledge_of([view.target], means, poses[best])
        means = knowledge.of_target(means, view.target.name)
    described = view.target.description(means).describe(np.linalg.inv(poses[best]))
    return (
        float(probability[best]),
        described.expanded_uncertainty / described.permitted_error,
        poses[best],
    )


def _rank(proposal: OpticsProposal) -> tuple[Any, ...]:
    smallest = min(proposal.probability.values())
    return (
        -len(proposal.able),
        proposal.worst_share,
        -smallest,
        proposal.working_distance_mm,
        proposal.body,
        proposal.lens,
    )
