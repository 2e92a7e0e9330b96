"""Planning of sensor settings for active visual inspection."""

from planner.camera import Camera, camera_names
from planner.exceptions import CameraError, InfeasibleError, PlannerError, RequestError, UncertaintyError
from planner.pose import PoseUncertainty, look_at
from planner.reach import BoxRegion, MeshRegion, SphereRegion
from planner.search import Search
from planner.setting import SensorSetting, plan_setting
from planner.simulate import SuccessRate, simulate_setting

__all__ = [
    "BoxRegion",
    "Camera",
    "CameraError",
    "InfeasibleError",
    "MeshRegion",
    "PlannerError",
    "PoseUncertainty",
    "RequestError",
    "Search",
    "SensorSetting",
    "SphereRegion",
    "SuccessRate",
    "UncertaintyError",
    "camera_names",
    "look_at",
    "plan_setting",
    "simulate_setting",
]
