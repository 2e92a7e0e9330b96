"""Planning of sensor settings for active visual inspection.

Names are imported from their modules when they are first used: the command line's ``--help`` should not wait for ray
casters and compilers.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from errors.measurands import Localisation
    from planner.batch.folder_of_parts import plan_folder
    from planner.batch.part_request import PartRequest
    from planner.batch.part_result import PartResult
    from planner.camera.camera import Camera
    from planner.camera.catalogue import camera_names
    from planner.camera.distortion import Distortion
    from planner.camera.pose import look_at
    from planner.camera.pose_uncertainty import PoseUncertainty
    from planner.cover.set_cover import Cover, is_cover, min_cover
    from planner.detectability.conditions import Detectability, Showing
    from planner.effort.effort import Effort
    from planner.effort.poses import Search
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
    from planner.inspection import plan_inspection
    from planner.inspection_options import InspectionOptions
    from planner.light.lamps import LampBox, LampDome, LampsTogether
    from planner.light.light_plan import LightPlan, LitImage
    from planner.light.lighting import Lighting
    from planner.light.plan_light import plan_light
    from planner.light.ring_space import RingSpace
    from planner.optics.proposal import OpticsProposal, optics_table
    from planner.optics.propose import propose_optics
    from planner.output.pose_files import write_poses
    from planner.plan import InspectionPlan, read_plan
    from planner.pose_prediction import PosePrediction, predict
    from planner.report.figure import plan_figure
    from planner.report.page import report_html
    from planner.report.predicted_image import predicted_image
    from planner.request.constraints import Requirements
    from planner.request.defaults import default_workspace
    from planner.request.reach import BoxRegion, MeshRegion, SphereRegion
    from planner.setting.plan_setting import plan_setting
    from planner.setting.reason import Reason, ReasonKind
    from planner.setting.sensor_setting import SensorSetting
    from planner.travel import travel_order
    from planner.verify.simulate_plan import SimulationResult, simulate_plan
    from planner.verify.simulate_setting import SuccessRate, simulate_setting
    from planner.wanted.dimension import Dimension
    from planner.wanted.planned import PlannedDimension

_NAMES = {
    "planner.batch.part_request": ("PartRequest",),
    "planner.batch.part_result": ("PartResult",),
    "planner.batch.folder_of_parts": ("plan_folder",),
    "errors.measurands": ("Localisation",),
    "planner.pose_prediction": ("PosePrediction", "predict"),
    "planner.wanted.dimension": ("Dimension",),
    "planner.wanted.planned": ("PlannedDimension",),
    "planner.camera.camera": ("Camera",),
    "planner.camera.catalogue": ("camera_names",),
    "planner.camera.distortion": ("Distortion",),
    "planner.optics.proposal": (
        "OpticsProposal",
        "optics_table",
    ),
    "planner.optics.propose": ("propose_optics",),
    "planner.camera.pose": ("look_at",),
    "planner.camera.pose_uncertainty": ("PoseUncertainty",),
    "planner.cover.set_cover": (
        "Cover",
        "is_cover",
        "min_cover",
    ),
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
    "planner.inspection": ("plan_inspection",),
    "planner.inspection_options": ("InspectionOptions",),
    "planner.light.lamps": (
        "LampBox",
        "LampDome",
        "LampsTogether",
    ),
    "planner.light.light_plan": (
        "LightPlan",
        "LitImage",
    ),
    "planner.light.lighting": ("Lighting",),
    "planner.light.plan_light": ("plan_light",),
    "planner.light.ring_space": ("RingSpace",),
    "planner.report.figure": ("plan_figure",),
    "planner.output.pose_files": ("write_poses",),
    "planner.report.predicted_image": ("predicted_image",),
    "planner.report.page": ("report_html",),
    "planner.plan": (
        "InspectionPlan",
        "read_plan",
    ),
    "planner.request.constraints": ("Requirements",),
    "planner.request.defaults": ("default_workspace",),
    "planner.effort.effort": ("Effort",),
    "planner.request.reach": (
        "BoxRegion",
        "MeshRegion",
        "SphereRegion",
    ),
    "planner.setting.plan_setting": ("plan_setting",),
    "planner.detectability.conditions": ("Detectability", "Showing"),
    "planner.effort.poses": ("Search",),
    "planner.setting.reason": ("Reason", "ReasonKind"),
    "planner.setting.sensor_setting": ("SensorSetting",),
    "planner.travel": ("travel_order",),
    "planner.verify.simulate_plan": (
        "SimulationResult",
        "simulate_plan",
    ),
    "planner.verify.simulate_setting": (
        "SuccessRate",
        "simulate_setting",
    ),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}

__all__ = [
    "BoxRegion",
    "Camera",
    "CameraError",
    "Cover",
    "CoverError",
    "Detectability",
    "Dimension",
    "Distortion",
    "Effort",
    "InfeasibleError",
    "InspectionOptions",
    "InspectionPlan",
    "LampBox",
    "LampDome",
    "LampsTogether",
    "LightPlan",
    "Lighting",
    "LitImage",
    "Localisation",
    "MeshRegion",
    "OpticsProposal",
    "OutputError",
    "PartRequest",
    "PartResult",
    "PlanFileError",
    "PlannedDimension",
    "PlannerError",
    "PosePrediction",
    "PoseUncertainty",
    "Reason",
    "ReasonKind",
    "RequestError",
    "Requirements",
    "RingSpace",
    "Search",
    "SensorSetting",
    "Showing",
    "SimulationResult",
    "SphereRegion",
    "SuccessRate",
    "UncertaintyError",
    "camera_names",
    "default_workspace",
    "is_cover",
    "look_at",
    "min_cover",
    "optics_table",
    "plan_figure",
    "plan_folder",
    "plan_inspection",
    "plan_light",
    "plan_setting",
    "predict",
    "predicted_image",
    "propose_optics",
    "read_plan",
    "report_html",
    "simulate_plan",
    "simulate_setting",
    "travel_order",
    "write_poses",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module; look up the version, which stands in pyproject.toml only."""
    if name == "__version__":
        return import_module("planner.identity.program").program_version()
    if name not in _HOMES:
        raise AttributeError(f"module 'planner' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names only."""
    return sorted([*__all__, *_OWN_NAMES])


_OWN_NAMES = ("__all__", "__doc__", "__file__", "__name__", "__path__", "__version__")
