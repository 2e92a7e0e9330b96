"""Views of the 3-D figure: everything at first, the part, and what each setting's camera sees.

Plotly's scene is a box about the origin whose sides are the aspect ratios; its camera looks from `eye` to `centre`
with a field of 45 degrees from top to bottom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from planner.camera.pose import world_to_cam

if TYPE_CHECKING:
    from planner.camera.camera import Camera
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting

_Array = NDArray[np.float64]

_TANGENT = math.tan(math.radians(22.5))
# share of the picture's height that what is shown may take
_FILLED = 0.86
_DIAGONAL = 2.0
EVERYTHING = (1.1, -1.3, 0.75)
"""Direction from which everything is shown at first."""


@dataclass(frozen=True)
class SceneFrame:
    """How points of the part's frame lie in the scene.

    Attributes
    ----------
    box : ndarray, shape (2, 3)
        Corners of what is shown, mm.
    """

    box: _Array

    @property
    def per_mm(self) -> float:
        """Units of the scene to the mm."""
        return float(_DIAGONAL / np.linalg.norm(self.box[1] - self.box[0]))

    @property
    def layout(self) -> dict[str, Any]:
        """Ranges and aspect of plotly's scene."""
        axes = {f"{name}axis": {"range": self.box[:, i].tolist()} for i, name in enumerate("xyz")}
        sides = (self.per_mm * (self.box[1] - self.box[0])).tolist()
        return {**axes, "aspectmode": "manual", "aspectratio": dict(zip("xyz", sides, strict=True))}

    def placed(self, points: Any) -> _Array:
        """Return points (n, 3) in mm as the scene has them."""
        return np.asarray(
            self.per_mm * (np.asarray(points, dtype=np.float64) - self.box.mean(axis=0))
        )

    def camera(
        self, points: Any, direction: Sequence[float] | _Array, up: Sequence[float] | _Array
    ) -> dict[str, Any]:
        """Return plotly's camera that shows points (n, 3), mm, as large as the picture's height allows.

        `direction` leads from them towards the viewer.
        """
        placed = self.placed(points)
        towards = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
        right = np.cross(up, towards)
        if np.linalg.norm(right) < 1e-9:
            right = np.cross([0.0, 1.0, 0.0], towards)
        right /= np.linalg.norm(right)
        axes = np.array([right, np.cross(towards, right), towards])
        inside = placed @ axes.T
        centre = (inside.min(axis=0) + inside.max(axis=0)) / 2
        aside = np.abs(inside - centre)[:, :2].max(axis=1)
        distance = float((inside[:, 2] - centre[2] + aside / (_TANGENT * _FILLED)).max())
        middle = centre @ axes
        eye = middle + distance * towards
        return {key: dict(zip("xyz", v.tolist(), strict=True)) for key, v in
                (("eye", eye), ("center", middle), ("up", axes[1]))}  # fmt: skip

    def eye_of(self, setting: SensorSetting, camera: Camera, depth: float) -> dict[str, Any]:
        """Return plotly's camera that stands where a setting's camera does, and looks along its axis.

        ``field`` holds the tangents of the largest angles to the axis that the sensor sees, across (x) and upwards (y):
        the page sets the field of plotly's camera to these. The page cannot draw the lens distortion.

        Parameters
        ----------
        setting : SensorSetting
            Gives the pose.
        camera : Camera
            Gives the field.
        depth : float
            Where the axis meets what is measured, mm; the view turns about this point.
        """
        rotation = setting.cam2world[:3, :3]
        ahead = setting.position + depth * rotation[:, 2]
        eye, centre = self.placed([setting.position, ahead])
        left, top, right, bottom = camera.field().outer
        lines = (("eye", eye), ("center", centre), ("up", -rotation[:, 1]))
        view: dict[str, Any] = {key: dict(zip("xyz", v.tolist(), strict=True)) for key, v in lines}
        view["field"] = {"x": max(-left, right), "y": max(-top, bottom)}
        return view


def plan_views(
    plan: InspectionPlan, frame: SceneFrame, part: _Array, shown: _Array
) -> dict[str, dict[str, Any]]:
    """Return plotly's cameras by name: ``everything``, ``part`` and ``setting-1`` and so on.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the settings.
    frame : SceneFrame
        How the scene is laid out.
    part : ndarray, shape (n, 3)
        Points around the part, mm.
    shown : ndarray, shape (n, 3)
        Points around everything, mm.
    """
    views = {
        "everything": frame.camera(shown, EVERYTHING, (0, 0, 1)),
        "part": frame.camera(part, EVERYTHING, (0, 0, 1)),
    }
    for k, setting in enumerate(plan.settings, start=1):
        measured = np.concatenate([np.asarray(plan.entities[name]) for name in setting.entities])
        depth = float(world_to_cam(measured, setting.cam2world)[:, 2].mean())
        views[f"setting-{k}"] = frame.eye_of(setting, plan.camera, depth)
    return views


def box_around(points: _Array, limits: _Array, air: float = 0.08) -> _Array:
    """Return the box (2, 3) around points with some air, which is cut off at the limits; points never are."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    more = air * float(np.linalg.norm(high - low))
    return np.array(
        [
            np.minimum(low, np.maximum(low - more, limits[0])),
            np.maximum(high, np.minimum(high + more, limits[1])),
        ]
    )


def view_buttons(views: Mapping[str, Any]) -> str:
    """Return a button for each view."""
    labels = {"everything": "Everything", "part": "Part"}
    return "".join(
        f'<button data-view="{name}">{labels.get(name, name.replace("setting-", "As setting ") + " sees it")}</button>'
        for name in views
    )
