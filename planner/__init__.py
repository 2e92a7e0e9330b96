"""Planning of sensor settings for active visual inspection."""

from planner.camera import Camera, camera_names
from planner.exceptions import CameraError, InfeasibleError, PlannerError, RequestError, UncertaintyError
from planner.pose import PoseUncertainty, look_at
from planner.setting import SensorSetting

__all__ = [
    "Camera",
    "CameraError",
    "InfeasibleError",
    "PlannerError",
    "PoseUncertainty",
    "RequestError",
    "SensorSetting",
    "UncertaintyError",
    "camera_names",
    "look_at",
]
