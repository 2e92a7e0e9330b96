"""Planning of sensor settings for active visual inspection.

Names are imported from their modules when they are first used: the command line's ``--help`` should not wait for ray
casters and compilers.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.camera import Camera, camera_names
    from planner.cover import Cover, is_cover, min_cover
    from planner.defaults import default_workspace
    from planner.exceptions import (
        CameraError,
        CoverError,
        InfeasibleError,
        OutputError,
        PlanFileError,
        PlannerError,
        RequestError,
        UncertaintyError,
    )
    from planner.export import write_poses
    from planner.inspection import Effort, plan_inspection
    from planner.plan import InspectionPlan, read_plan
    from planner.pose import PoseUncertainty, look_at
    from planner.reach import BoxRegion, MeshRegion, SphereRegion
    from planner.report import report_html
    from planner.search import Search
    from planner.setting import SensorSetting, plan_setting
    from planner.simulate import SuccessRate, simulate_setting
    from planner.tour import travel_order
    from planner.verification import SimulationResult, simulate_plan

_NAMES = {
    "planner.camera": (
        "Camera",
        "camera_names",
    ),
    "planner.cover": (
        "Cover",
        "is_cover",
        "min_cover",
    ),
    "planner.defaults": ("default_workspace",),
    "planner.exceptions": (
        "CameraError",
        "CoverError",
        "InfeasibleError",
        "OutputError",
        "PlanFileError",
        "PlannerError",
        "RequestError",
        "UncertaintyError",
    ),
    "planner.export": ("write_poses",),
    "planner.inspection": (
        "Effort",
        "plan_inspection",
    ),
    "planner.plan": (
        "InspectionPlan",
        "read_plan",
    ),
    "planner.pose": (
        "PoseUncertainty",
        "look_at",
    ),
    "planner.reach": (
        "BoxRegion",
        "MeshRegion",
        "SphereRegion",
    ),
    "planner.report": ("report_html",),
    "planner.search": ("Search",),
    "planner.setting": (
        "Search",
        "SensorSetting",
        "plan_setting",
    ),
    "planner.simulate": (
        "SuccessRate",
        "simulate_setting",
    ),
    "planner.tour": ("travel_order",),
    "planner.verification": (
        "SimulationResult",
        "simulate_plan",
    ),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}

__all__ = [
    "BoxRegion",
    "Camera",
    "CameraError",
    "Cover",
    "CoverError",
    "Effort",
    "InfeasibleError",
    "InspectionPlan",
    "MeshRegion",
    "OutputError",
    "PlanFileError",
    "PlannerError",
    "PoseUncertainty",
    "RequestError",
    "Search",
    "SensorSetting",
    "SimulationResult",
    "SphereRegion",
    "SuccessRate",
    "UncertaintyError",
    "camera_names",
    "default_workspace",
    "is_cover",
    "look_at",
    "min_cover",
    "plan_inspection",
    "plan_setting",
    "read_plan",
    "report_html",
    "simulate_plan",
    "simulate_setting",
    "travel_order",
    "write_poses",
]


def __getattr__(name: str):
    """Import a public name from its module."""
    if name not in _HOMES:
        raise AttributeError(f"module 'planner' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names beside what is loaded."""
    return sorted({*globals(), *_HOMES})
