"""The keywords of `plan_inspection`: defaults, types, and the requirements made of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict

from numpy.typing import ArrayLike

from errors.measurands.localisation import Localisation
from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.plan import InspectionPlan
from planner.request.constraints import Requirements
from planner.request.defaults import (
    check_focus_margin,
    check_showing,
    corner_margin_px,
    focus_reserve_mm,
    position_margin_mm,
)
from planner.request.effort import Effort
from planner.request.reach import Reach
from planner.request.space import Space
from planner.showing.showing import USUAL, Showing

if TYPE_CHECKING:
    from planner.light.lighting import Lighting


@dataclass(frozen=True)
class InspectionOptions:
    """Options of `plan_inspection`, which describes them."""

    workspace: ArrayLike | None = None
    stand_off_mm: float = 50.0
    min_length_px: float = 20.0
    field_margin_px: float | None = None
    visibility_radius_mm: float | None = None
    focus_margin_mm: float | None = None
    showing: Showing = USUAL
    reach: Reach | None = None
    lamps: Any = None
    space: Space | None = None
    effort: Effort | None = None
    localisation: Localisation | None = None
    time_limit_s: float | None = None
    gap: float = 0.0
    on_incumbent: Callable[[InspectionPlan], object] | None = None
    state: str | os.PathLike[str] | None = None
    executor: Executor | None = None
    progress: Callable[..., Any] | None = None

    @property
    def lighting(self) -> Lighting | None:
        """What is asked of lamps, if any are."""
        from planner.light.lighting import Lighting

        return (
            self.lamps
            if self.lamps is None or isinstance(self.lamps, Lighting)
            else Lighting(self.lamps)
        )

    def requirements(self, camera: Camera, pose_uncertainty: PoseUncertainty) -> Requirements:
        """Return the limits; where nothing is said, those that suit the pose uncertainty."""
        margin, radius, focus = (
            self.field_margin_px,
            self.visibility_radius_mm,
            self.focus_margin_mm,
        )
        return Requirements(
            min_length_px=self.min_length_px,
            field_margin_px=corner_margin_px(camera, pose_uncertainty)
            if margin is None
            else margin,
            stand_off_mm=self.stand_off_mm,
            reach=self.reach,
            visibility_radius_mm=position_margin_mm(pose_uncertainty) if radius is None else radius,
            focus_margin_mm=(
                focus_reserve_mm(camera, pose_uncertainty)
                if focus is None
                else check_focus_margin(focus, camera)
            ),
            showing=check_showing(self.showing, camera),
        )


class InspectionKeywords(TypedDict, total=False):
    """The same for type checkers."""

    workspace: ArrayLike | None
    stand_off_mm: float
    min_length_px: float
    field_margin_px: float | None
    visibility_radius_mm: float | None
    focus_margin_mm: float | None
    showing: Showing
    reach: Reach | None
    lamps: Any
    space: Space | None
    effort: Effort | None
    localisation: Localisation | None
    time_limit_s: float | None
    gap: float
    on_incumbent: Callable[[InspectionPlan], object] | None
    state: str | os.PathLike[str] | None
    executor: Executor | None
    progress: Callable[..., Any] | None
