"""The keywords of `plan_inspection`: defaults, types, and the requirements made of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from errors.measurands.geometry import Localisation as Localisation
from ground.short_repr import short_repr
from planner.argument_kinds import check_callable, check_kinds, check_space, kind_shown, names_meant
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.detectability.conditions import USUAL, Detectability
from planner.effort import Effort
from planner.exceptions import PlanFileError, RequestError
from planner.identity import Request
from planner.plan import InspectionPlan
from planner.request.camera_limits import (
    NO_RESERVE,
    FocusReserve,
    check_focus_margin,
    check_showing,
    corner_margin_px,
    position_margin_mm,
)
from planner.request.constraints import Requirements, limit_names
from planner.request.reach import Reach, Space, StatedRegion
from planner.request.registration import GIVEN, RegistrationRecord

if TYPE_CHECKING:
    from planner.light.lighting import Lighting
    from planner.robotcell import Cell


@dataclass(frozen=True)
class RunOptions:
    """How a plan is computed, see `InspectionOptions`: what the plan itself does not depend on."""

    time_limit_s: float | None = None
    on_incumbent: Callable[[InspectionPlan], object] | None = None
    state: str | os.PathLike[str] | None = None
    executor: Executor | None = None
    progress: Callable[..., Any] | None = None
    space: Space | None = None

    def __post_init__(self) -> None:
        check_callable("on_incumbent", self.on_incumbent)
        check_callable("progress", self.progress)
        if self.executor is not None and not hasattr(self.executor, "submit"):
            rule = "must be a concurrent.futures.Executor"
            raise RequestError.of_rule("executor", rule, kind_shown(self.executor))
        if self.space is not None:
            check_space(self.space)


@names_meant
@dataclass(frozen=True)
class InspectionOptions(RunOptions):
    """The options of `plan_inspection`, also as one value.

    `predict` and `propose_optics` take this value. They judge a pose or a lens by the same
    constraints, workspace and visibility as a plan.

    Parameters
    ----------
    time_limit_s : float, optional
        End the planning after this many seconds with the best plan so far, which is then
        ``unfinished``. Visibility may take half of them. The plan omits a target whose visibility
        is not complete by then, with the reason. Planning does not end before the first plan, nor
        during a run of the genetic algorithm in this process. With lamps, the search has 65 % of them,
        and the choice of lamps ends at 90 %. Default: no limit.
    on_incumbent : callable, optional
        The program calls ``on_incumbent(plan)`` with the best plan so far, whenever the plan or its
        bound improves. The last call gets the plan that is returned. An exception it raises cancels
        the work.
    state : path, optional
        File that stores results during the planning. If it exists, the planning resumes from it.
        The file remains when the plan is done, and the same call then returns the plan at once.
        Delete it after you have written the plan. If the program can no longer save it, it warns
        and continues.
    executor : concurrent.futures.Executor, optional
        Runs the per-entity and per-column work.
    progress : callable, optional
        The program calls ``progress(done, total, label)``. An exception it raises cancels the work.
    space : VisibilityRegions or EntityAspectGraph, optional
        Visibility computed before, for these entities and this workspace. With a `RingSpace`, an
        edge counts as observable only where a ring light on the camera makes it visible. Default:
        the program computes the visibility.
    accuracy : float
        Required accuracy A in (0, 1).
    probability : float
        Required probability, in (0, 1), that a measurement is accurate.
    rng : int or numpy.random.Generator
        Seed. From a generator, the program draws a seed.
    workspace : array_like (2, 3), optional
        Opposite corners of the box the camera may be in, mm. Default: `default_workspace`, which
        extends around the part as far as the lens focuses.
    stand_off_mm, min_length_px : float
        Constraints, see `Requirements`.
    field_margin_px : float, optional
        Width of the strip along the sensor's edges to keep free, px. Default: four standard
        deviations of an image point's motion under the pose uncertainty. They are those of the
        corner where the motion is largest. The default is at most a quarter of the smaller side.
    visibility_radius_mm : float, optional
        Targets must also be observable from all points up to this distance from the camera, mm.
        Default: three standard deviations of its position, where it is least certain.
    focus_margin_mm : float, optional
        Narrow both limits of the depth of field by this distance, mm, so that a displaced camera is
        still in focus. Default: three standard deviations of the depth of each end of an edge, as
        the camera moves and turns. The default is at most an eighth of the depth of field, but
        never less than 1.645 standard deviations.
    showing : Detectability
        Conditions under which software can find edges in the image. With a corner condition, the
        plan does not inspect edges that end in a tangent arc. ``Detectability(0, 0, 0)`` sets no
        conditions, as in the paper. Default: ``Detectability()``.
    reach : ReachRegion or callable, optional
        Region in which the front nodal point may be. Default: the whole workspace. With ``state``
        it needs a permanent name. A lambda, a nested function or an object that cannot be pickled
        needs an attribute ``state_name``, which describes what it permits.
    cell : Cell, optional
        Robot that must reach every setting, and how the part lies before it. Each setting of the
        plan then has a ``fixturing`` and ``joints``. The cell only forbids poses, so the lower
        bound is proven without it, and holds.
    lamps : array_like, shape (n, 3), LampBox, LampDome, light with an area, str or Lighting, optional
        Lamps that must light the targets, as in `plan_light`; a `Lighting` also holds its options.
        The plan then has its ``light``. Lights with an area are `Backlight`, `DiffuseDome`,
        `CoaxialLight` and `RingLight`. Texts are "ring", "backlight", "diffuse-dome", "coaxial",
        "ring-light", and names of the catalogue such as "coaxial:NAME", see `light_names`. If no
        lamp lights a target in any setting, the program searches for other poses. With "ring" or
        a light with an area, the search is restricted to viewpoints where the light makes edges
        visible.
    effort : Effort, optional
        How long to search. Default: ``Effort()``, or ``Effort.for_dimensions()`` for dimensions.
    localisation : Localisation, optional
        Model of the errors of image points. Default: ``Localisation.gaussian()`` if there is a
        `Dimension`, otherwise rounding to whole pixels, as in the paper.
    surfaces_mm : float, optional
        Standard deviation of the position of the part's faces along their normals, mm, for
        dimensions. Points of the image are carried back to these faces. Default: what a
        `Dimension` states of its own, otherwise 0.02 mm; 0 if points are rounded to whole pixels.
    registration : Registration or PoseUncertainty, optional
        How the poses of images are known when values are read. With ``Registration.own_edges()``,
        `measure` will register each image to the part's own edges, and P is that of these values.
        The program predicts it from what each pose shows of the part. A `PoseUncertainty` is that
        of poses that something else measures. Where the camera may be while it takes the images,
        remains ``pose_uncertainty``. With ``Registration.none()`` values are read with the planned
        poses, and lamps need not show what registration takes. Default: the same, but lamps do.
    edge_break_mm : (float, float), optional
        By how much the part's edges are broken along their faces, least and most, mm, such as
        (0.1, 0.3). A `Dimension` may state its own. The camera sees a broken edge next to the edge
        of the model, and P and U of dimensions contain this. Default: edges are planned as sharp.
    split : {"auto", "never"}
        Whether two settings may measure the ends of a distance or angle, or a hole and its datums.
        With "auto", they do where that inspects more or saves a setting. With "never", one image
        shows all entities of a target. `measure` reads such values from all images together.
    poses : sequence of GivenPose, PoseFile, or array_like (n, 4, 4), optional
        Poses that exist, such as `read_poses` returns. The plan chooses the fewest of them, and its
        bound is that of these poses. Nothing is searched or moved. Default: poses are searched.
    gap : float
        Stop improving the plan and its bound at this gap, in [0, 1). The gap is the share of the
        settings that the bound does not prove to be needed. Default: improve both as far as the
        effort allows.

    Examples
    --------
    >>> from planner import InspectionOptions
    >>> options = InspectionOptions(stand_off_mm=80.0, min_length_px=30.0)
    >>> options.stand_off_mm, options.focus_margin_mm
    (80.0, None)
    """

    accuracy: float = 0.98
    probability: float = 0.9
    rng: int | np.random.Generator = 0
    workspace: ArrayLike | None = None
    stand_off_mm: float = 50.0
    min_length_px: float = 20.0
    field_margin_px: float | None = None
    visibility_radius_mm: float | None = None
    focus_margin_mm: float | None = None
    showing: Detectability = USUAL
    reach: Reach | None = None
    cell: Cell | None = None
    lamps: Any = None
    effort: Effort | None = None
    localisation: Localisation | None = None
    surfaces_mm: float | None = None
    registration: Any = None
    edge_break_mm: tuple[float, float] | None = None
    split: Literal["auto", "never"] = "auto"
    poses: Any = None
    gap: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.effort is not None:
            check_kinds(effort=(self.effort, "Effort"))
        if self.localisation is not None:
            check_kinds(localisation=(self.localisation, "Localisation"))

    @classmethod
    def of_request(cls, request: Request) -> InspectionOptions:
        """Return the options that make a request again.

        Parameters
        ----------
        request : Request
            Such as that of a plan.

        Returns
        -------
        InspectionOptions
            For `plan_inspection`, with the camera, the pose uncertainty and the targets of the request.

        Raises
        ------
        PlanFileError
            If it has a reach that no file can hold.
        """
        need = request.requirements
        if isinstance(need.reach, StatedRegion):
            raise PlanFileError(f"request.requirements: {need.reach.rule}.")
        values: dict[str, Any] = {
            field.name: getattr(record, field.name)
            for record in (need, request)
            for field in fields(cls)
            if hasattr(record, field.name)
        }
        if need.focus_reserve.sigmas > 0:
            # the reserve of each point stands for a margin that was not given
            values["focus_margin_mm"] = None
        if any(getattr(target, "surfaces_from", "") for target in request.targets):
            # tolerances of the model count only where no value was given
            values["surfaces_mm"] = None
        return cls(**{**values, "lamps": request.lighting, "rng": request.seed})

    @property
    def lighting(self) -> Lighting | None:
        """The options of the lamps, or None without lamps."""
        from planner.light.lighting import Lighting

        return (
            self.lamps
            if self.lamps is None or isinstance(self.lamps, Lighting)
            else Lighting(self.lamps)
        )

    @property
    def registration_record(self) -> RegistrationRecord | None:
        """How poses are known when values are read, as a request states it; None if it is not stated.

        Raises
        ------
        RequestError
            If it is nothing that a plan can know.
        """
        registration = self.registration
        if registration is None or isinstance(registration, RegistrationRecord):
            return registration
        if isinstance(registration, PoseUncertainty):
            return RegistrationRecord(GIVEN, None, registration)
        if not hasattr(registration, "planned"):
            raise RequestError.of_rule(
                "registration",
                "must be Registration.own_edges(), Registration.none() or a PoseUncertainty",
                kind_shown(registration),
            )
        planned: RegistrationRecord = registration.planned()
        return planned

    def requirements(self, camera: Camera, pose_uncertainty: PoseUncertainty) -> Requirements:
        """Return the constraints, with defaults that suit the pose uncertainty.

        Parameters
        ----------
        camera : Camera
            Gives the depth of field and the image.
        pose_uncertainty : PoseUncertainty
            Gives the safety margins.

        Returns
        -------
        Requirements
            The constraints that every setting must meet.

        Raises
        ------
        RequestError
            If a value breaks its rule.
        """
        margin = corner_margin_px(camera, pose_uncertainty)
        if self.field_margin_px is not None:
            margin = _checked_field_margin(self.field_margin_px, camera)
        radius = self.visibility_radius_mm
        if self.focus_margin_mm is None:
            reserve = FocusReserve.of(camera, pose_uncertainty)
            focus = reserve.on_axis_mm
        else:
            reserve = NO_RESERVE
            focus = check_focus_margin(self.focus_margin_mm, camera)
        with_defaults = {
            "field_margin_px": margin,
            "visibility_radius_mm": position_margin_mm(pose_uncertainty)
            if radius is None
            else radius,
            "focus_margin_mm": focus,
        }
        limits = {name: getattr(self, name) for name in limit_names()}
        return Requirements(
            **{**limits, **with_defaults},
            reach=self.reach,
            focus_reserve=reserve,
            showing=check_showing(self.showing, camera),
        )


class InspectionKeywords(TypedDict, total=False):
    """The keywords of `plan_inspection`, for type checkers: the fields of `InspectionOptions`, which states them."""

    time_limit_s: float | None
    on_incumbent: Callable[[InspectionPlan], object] | None
    state: str | os.PathLike[str] | None
    executor: Executor | None
    progress: Callable[..., Any] | None
    space: Space | None
    accuracy: float
    probability: float
    rng: int | np.random.Generator
    workspace: ArrayLike | None
    stand_off_mm: float
    min_length_px: float
    field_margin_px: float | None
    visibility_radius_mm: float | None
    focus_margin_mm: float | None
    showing: Detectability
    reach: Reach | None
    cell: Cell | None
    lamps: Any
    effort: Effort | None
    localisation: Localisation | None
    surfaces_mm: float | None
    registration: Any
    edge_break_mm: tuple[float, float] | None
    split: Literal["auto", "never"]
    poses: Any
    gap: float


def options_or_default(options: InspectionOptions | None) -> InspectionOptions:
    """Return options, the default ones for None; refuse what is none, such as a dictionary.

    Parameters
    ----------
    options : InspectionOptions, optional
        What the caller states.

    Raises
    ------
    RequestError
        If it is something else.
    """
    if options is None:
        return InspectionOptions()
    check_kinds(options=(options, "InspectionOptions"))
    return options


def _checked_field_margin(margin_px: float, camera: Camera) -> float:
    """Return a margin of the field of view, unless it leaves nothing of the image."""
    side = min(camera.resolution)
    # what is no number is refused with the other numbers
    if isinstance(margin_px, int | float) and 2 * margin_px >= side:
        rule = f"must be less than half the image's smaller side, {side} px"
        raise RequestError.of_rule("field_margin_px", rule, f"{margin_px:g}")
    return margin_px
