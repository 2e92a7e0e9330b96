"""The keywords of `plan_setting`: defaults, types, and the requirements made of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypedDict

from numpy.typing import ArrayLike

from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.request.constraints import Requirements
from planner.request.defaults import (
    check_focus_margin,
    check_showing,
    pose_margin_px,
    position_margin_mm,
)
from planner.request.reach import Reach
from planner.setting.pose_search import Search
from planner.showing.showing import NOT_ASKED, Showing


@dataclass(frozen=True)
class SettingOptions:
    """Options of `plan_setting`, which describes them."""

    stand_off_mm: float = 50.0
    min_length_px: float = 20.0
    field_margin_px: float | None = None
    field_of_view: str = "exact"
    visibility_radius_mm: float | None = None
    focus_margin_mm: float = 0.0
    showing: Showing = NOT_ASKED
    reach: Reach | None = None
    objective: str = "sum"
    model: str = "joint"
    search: Search | None = None
    start: ArrayLike | None = None
    callback: Callable[..., Any] | None = None

    def requirements(self, camera: Camera, pose_uncertainty: PoseUncertainty) -> Requirements:
        """Return the limits; where nothing is said, those that suit the pose uncertainty."""
        margin = self.field_margin_px
        radius = self.visibility_radius_mm
        return Requirements(
            min_length_px=self.min_length_px,
            field_margin_px=pose_margin_px(camera, pose_uncertainty) if margin is None else margin,
            field_of_view=self.field_of_view,
            stand_off_mm=self.stand_off_mm,
            reach=self.reach,
            visibility_radius_mm=position_margin_mm(pose_uncertainty) if radius is None else radius,
            focus_margin_mm=check_focus_margin(self.focus_margin_mm, camera),
            showing=check_showing(self.showing, camera),
        )


class SettingKeywords(TypedDict, total=False):
    """The same for type checkers."""

    stand_off_mm: float
    min_length_px: float
    field_margin_px: float | None
    field_of_view: str
    visibility_radius_mm: float | None
    focus_margin_mm: float
    showing: Showing
    reach: Reach | None
    objective: str
    model: str
    search: Search | None
    start: ArrayLike | None
    callback: Callable[..., Any] | None
