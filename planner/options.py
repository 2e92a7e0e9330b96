"""The keywords of `plan_inspection`: defaults, types, and the requirements made of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from errors.measurands.geometry import Localisation as Localisation
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.detectability.conditions import USUAL, Detectability
from planner.effort import Effort
from planner.exceptions import RequestError
from planner.plan import InspectionPlan
from planner.request.camera_limits import NO_RESERVE, FocusReserve
from planner.request.constraints import Requirements
from planner.request.defaults import (
    check_focus_margin,
    check_showing,
    corner_margin_px,
    position_margin_mm,
)
from planner.request.reach import Reach, Space
from planner.request.targets import GIVEN, RegistrationRecord

if TYPE_CHECKING:
    from planner.light.lighting import Lighting
    from planner.robotcell import Cell


@dataclass(frozen=True)
class InspectionOptions:
    """The options of `plan_inspection` as one value.

    `plan_inspection` takes them as keywords and describes them in full. `predict` and
    `propose_optics` take this value. They judge a pose or a lens by the same constraints, workspace
    and visibility as a plan.

    Parameters
    ----------
    workspace : array_like (2, 3), optional
        Opposite corners of the box the camera may be in, mm. Default: `default_workspace`, which
        extends around the part as far as the lens focuses.
    stand_off_mm : float
        Smallest distance between the front nodal point and the part, mm.
    min_length_px : float
        Smallest length of a measured edge in the image, px.
    field_margin_px : float, optional
        Width of the strip along the sensor's edges to keep free, px. Default: four standard
        deviations of the image's motion.
    visibility_radius_mm : float, optional
        Targets must also be observable from all points up to this distance from the camera, mm.
        Default: three standard deviations.
    focus_margin_mm : float, optional
        Narrow both limits of the depth of field by this distance, mm. Default: three standard
        deviations of each point's depth, see `plan_inspection`.
    showing : Detectability
        Conditions under which software can find edges in the image.
    reach : ReachRegion or callable, optional
        Region in which the front nodal point may be. Default: the whole workspace.
    cell : Cell, optional
        Robot that must reach every setting, and how the part lies before it. Default: no robot.
    lamps : array_like, shape (n, 3), or LampBox, LampDome, "ring" or Lighting, optional
        Lamps that must light the targets. Default: no lamps.
    space : VisibilityRegions or EntityAspectGraph, optional
        Visibility computed before. Default: the program computes it.
    effort : Effort, optional
        How long to search.
    localisation : Localisation, optional
        Model of the errors of image points. Default: ``Localisation.gaussian()`` if there is a
        `Dimension`, otherwise rounding to whole pixels.
    surfaces_mm : float, optional
        Standard deviation of the position of the part's faces along their normals, mm, for
        dimensions. Default: what a `Dimension` states of its own, otherwise 0.02 mm; 0 if points are
        rounded to whole pixels.
    registration : Registration or PoseUncertainty, optional
        How the poses of images are known when values are read. Default: no better than planned.
    time_limit_s : float, optional
        End the planning after this many seconds with the best plan so far. Default: no limit.
    gap : float
        Stop at this gap between the plan and its bound, a share of the settings in [0, 1).
    on_incumbent : callable, optional
        The program calls ``on_incumbent(plan)`` with each better plan.
    state : path, optional
        File that stores results, and from which the planning resumes.
    executor : concurrent.futures.Executor, optional
        Runs the work in parallel.
    progress : callable, optional
        ``progress(done, total, label)``.

    Examples
    --------
    >>> from planner import InspectionOptions
    >>> options = InspectionOptions(stand_off_mm=80.0, min_length_px=30.0)
    >>> options.stand_off_mm, options.focus_margin_mm
    (80.0, None)
    """

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
    space: Space | None = None
    effort: Effort | None = None
    localisation: Localisation | None = None
    surfaces_mm: float | None = None
    registration: Any = None
    time_limit_s: float | None = None
    gap: float = 0.0
    on_incumbent: Callable[[InspectionPlan], object] | None = None
    state: str | os.PathLike[str] | None = None
    executor: Executor | None = None
    progress: Callable[..., Any] | None = None

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
        """How poses are known when values are read, as a request states it; None for no better than planned.

        Raises
        ------
        RequestError
            If it is nothing that a plan can know.
        """
        how = self.registration
        if how is None or isinstance(how, RegistrationRecord):
            return how
        if isinstance(how, PoseUncertainty):
            return RegistrationRecord(GIVEN, None, how)
        if not hasattr(how, "planned"):
            raise RequestError.of_rule(
                "registration",
                "must be Registration.own_edges() or a PoseUncertainty",
                type(how).__name__,
            )
        planned: RegistrationRecord | None = how.planned()
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
        return Requirements(
            min_length_px=self.min_length_px,
            field_margin_px=margin,
            stand_off_mm=self.stand_off_mm,
            reach=self.reach,
            visibility_radius_mm=position_margin_mm(pose_uncertainty) if radius is None else radius,
            focus_margin_mm=focus,
            focus_reserve=reserve,
            showing=check_showing(self.showing, camera),
        )


def _checked_field_margin(margin_px: float, camera: Camera) -> float:
    """Return a margin of the field of view, unless it leaves nothing of the image."""
    side = min(camera.resolution)
    # what is no number is refused with the other numbers
    if isinstance(margin_px, int | float) and 2 * margin_px >= side:
        rule = f"must be less than half the image's smaller side, {side} px"
        raise RequestError.of_rule("field_margin_px", rule, f"{margin_px:g}")
    return margin_px
