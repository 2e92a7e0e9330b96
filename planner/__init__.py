"""Planning of sensor settings for active visual inspection.

Names are imported from their modules when they are first used: the command line's ``--help`` should not wait for ray
casters and compilers. A public name stands twice: with the imports for type checkers, and in `_NAMES`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from errors.measurands import Decision as Decision
    from errors.measurands import DecisionRule as DecisionRule
    from errors.measurands import Localisation as Localisation
    from planner.batch.folder_of_parts import plan_folder as plan_folder
    from planner.batch.part_request import PartRequest as PartRequest
    from planner.batch.part_result import PartResult as PartResult
    from planner.camera.camera import Camera as Camera
    from planner.camera.catalogue import camera_names as camera_names
    from planner.camera.distortion import Distortion as Distortion
    from planner.camera.pose import look_at as look_at
    from planner.camera.pose_uncertainty import PoseUncertainty as PoseUncertainty
    from planner.cover.set_cover import Cover as Cover
    from planner.cover.set_cover import is_cover as is_cover
    from planner.cover.set_cover import min_cover as min_cover
    from planner.detectability.conditions import Detectability as Detectability
    from planner.detectability.conditions import Showing as Showing
    from planner.effort.effort import Effort as Effort
    from planner.effort.poses import Search as Search
    from planner.exceptions import CameraError as CameraError
    from planner.exceptions import CoverError as CoverError
    from planner.exceptions import InfeasibleError as InfeasibleError
    from planner.exceptions import OutputError as OutputError
    from planner.exceptions import PlanFileError as PlanFileError
    from planner.exceptions import PlannerError as PlannerError
    from planner.exceptions import RequestError as RequestError
    from planner.exceptions import RobotError as RobotError
    from planner.exceptions import UncertaintyError as UncertaintyError
    from planner.inspection import plan_inspection as plan_inspection
    from planner.inspection_options import InspectionOptions as InspectionOptions
    from planner.light.lamps import LampBox as LampBox
    from planner.light.lamps import LampDome as LampDome
    from planner.light.lamps import LampsTogether as LampsTogether
    from planner.light.light_plan import Exposure as Exposure
    from planner.light.light_plan import LightPlan as LightPlan
    from planner.light.light_plan import LitImage as LitImage
    from planner.light.lighting import Lighting as Lighting
    from planner.light.plan_light import plan_light as plan_light
    from planner.light.ring_space import RingSpace as RingSpace
    from planner.measuring.measurer import MeasureOptions as MeasureOptions
    from planner.measuring.measurer import Measurer as Measurer
    from planner.measuring.measurer import measure as measure
    from planner.measuring.merge import Result as Result
    from planner.measuring.poses.fiducials import Fiducials as Fiducials
    from planner.measuring.poses.registration import Registration as Registration
    from planner.measuring.reading import Reading as Reading
    from planner.measuring.results import MeasurementResults as MeasurementResults
    from planner.motion.arm_uncertainty import ArmUncertainty as ArmUncertainty
    from planner.motion.other_poses.reached_plan import ReachedPlan as ReachedPlan
    from planner.motion.other_poses.reached_plan import (
        with_reached_settings as with_reached_settings,
    )
    from planner.motion.program_file import read_program as read_program
    from planner.motion.program_record import RobotProgram as RobotProgram
    from planner.motion.robot_program import robot_program as robot_program
    from planner.motion.robot_program import (
        robot_program_with_other_poses as robot_program_with_other_poses,
    )
    from planner.optics.proposal import OpticsProposal as OpticsProposal
    from planner.optics.proposal import optics_table as optics_table
    from planner.optics.propose import propose_optics as propose_optics
    from planner.output.measured_report import measured_html as measured_html
    from planner.output.pose_files import write_poses as write_poses
    from planner.output.programs import CameraSignals as CameraSignals
    from planner.output.programs import program_text as program_text
    from planner.output.programs import write_program as write_program
    from planner.plan import InspectionPlan as InspectionPlan
    from planner.plan import read_plan as read_plan
    from planner.pose_prediction import PosePrediction as PosePrediction
    from planner.pose_prediction import predict as predict
    from planner.report.figure import plan_figure as plan_figure
    from planner.report.page import report_html as report_html
    from planner.report.predicted_image import predicted_image as predicted_image
    from planner.request.constraints import Requirements as Requirements
    from planner.request.defaults import default_workspace as default_workspace
    from planner.request.reach import BoxRegion as BoxRegion
    from planner.request.reach import MeshRegion as MeshRegion
    from planner.request.reach import SphereRegion as SphereRegion
    from planner.robot import Box as Box
    from planner.robot import Cell as Cell
    from planner.robot import Fixturing as Fixturing
    from planner.robot import Grip as Grip
    from planner.robot import HeldPartCell as HeldPartCell
    from planner.robot import Reachability as Reachability
    from planner.robot import Robot as Robot
    from planner.robot import propose_placements as propose_placements
    from planner.setting.plan_setting import plan_setting as plan_setting
    from planner.setting.reason import Reason as Reason
    from planner.setting.reason import ReasonKind as ReasonKind
    from planner.setting.sensor_setting import SensorSetting as SensorSetting
    from planner.travel import travel_order as travel_order
    from planner.verify.simulate_plan import SimulationResult as SimulationResult
    from planner.verify.simulate_plan import simulate_plan as simulate_plan
    from planner.verify.simulate_setting import SuccessRate as SuccessRate
    from planner.verify.simulate_setting import simulate_setting as simulate_setting
    from planner.wanted.dimension import Dimension as Dimension
    from planner.wanted.model_dimensions import dimensions_to_plan as dimensions_to_plan
    from planner.wanted.planned import PlannedDimension as PlannedDimension

_NAMES = {
    "errors.measurands": ("Decision", "DecisionRule", "Localisation"),
    "planner.batch.folder_of_parts": ("plan_folder",),
    "planner.batch.part_request": ("PartRequest",),
    "planner.batch.part_result": ("PartResult",),
    "planner.camera.camera": ("Camera",),
    "planner.camera.catalogue": ("camera_names",),
    "planner.camera.distortion": ("Distortion",),
    "planner.camera.pose": ("look_at",),
    "planner.camera.pose_uncertainty": ("PoseUncertainty",),
    "planner.cover.set_cover": ("Cover", "is_cover", "min_cover"),
    "planner.detectability.conditions": ("Detectability", "Showing"),
    "planner.effort.effort": ("Effort",),
    "planner.effort.poses": ("Search",),
    "planner.exceptions": (
        "CameraError",
        "CoverError",
        "InfeasibleError",
        "OutputError",
        "PlanFileError",
        "PlannerError",
        "RequestError",
        "RobotError",
        "UncertaintyError",
    ),
    "planner.inspection": ("plan_inspection",),
    "planner.inspection_options": ("InspectionOptions",),
    "planner.light.lamps": ("LampBox", "LampDome", "LampsTogether"),
    "planner.light.light_plan": ("Exposure", "LightPlan", "LitImage"),
    "planner.light.lighting": ("Lighting",),
    "planner.light.plan_light": ("plan_light",),
    "planner.light.ring_space": ("RingSpace",),
    "planner.motion.arm_uncertainty": ("ArmUncertainty",),
    "planner.motion.other_poses.reached_plan": ("ReachedPlan", "with_reached_settings"),
    "planner.motion.program_file": ("read_program",),
    "planner.motion.program_record": ("RobotProgram",),
    "planner.motion.robot_program": ("robot_program", "robot_program_with_other_poses"),
    "planner.measuring.measurer": ("MeasureOptions", "Measurer", "measure"),
    "planner.measuring.merge": ("Result",),
    "planner.measuring.reading": ("Reading",),
    "planner.measuring.poses.fiducials": ("Fiducials",),
    "planner.measuring.poses.registration": ("Registration",),
    "planner.measuring.results": ("MeasurementResults",),
    "planner.optics.proposal": ("OpticsProposal", "optics_table"),
    "planner.optics.propose": ("propose_optics",),
    "planner.output.measured_report": ("measured_html",),
    "planner.output.pose_files": ("write_poses",),
    "planner.output.programs": ("CameraSignals", "program_text", "write_program"),
    "planner.plan": ("InspectionPlan", "read_plan"),
    "planner.pose_prediction": ("PosePrediction", "predict"),
    "planner.report.figure": ("plan_figure",),
    "planner.report.page": ("report_html",),
    "planner.report.predicted_image": ("predicted_image",),
    "planner.request.constraints": ("Requirements",),
    "planner.request.defaults": ("default_workspace",),
    "planner.request.reach": ("BoxRegion", "MeshRegion", "SphereRegion"),
    "planner.robot": (
        "Box",
        "Cell",
        "Fixturing",
        "Grip",
        "HeldPartCell",
        "Reachability",
        "Robot",
        "propose_placements",
    ),
    "planner.setting.plan_setting": ("plan_setting",),
    "planner.setting.reason": ("Reason", "ReasonKind"),
    "planner.setting.sensor_setting": ("SensorSetting",),
    "planner.travel": ("travel_order",),
    "planner.verify.simulate_plan": ("SimulationResult", "simulate_plan"),
    "planner.verify.simulate_setting": ("SuccessRate", "simulate_setting"),
    "planner.wanted.dimension": ("Dimension",),
    "planner.wanted.model_dimensions": ("dimensions_to_plan",),
    "planner.wanted.planned": ("PlannedDimension",),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}

__all__ = sorted(_HOMES)


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
