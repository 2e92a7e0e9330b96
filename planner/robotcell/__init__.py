"""Robot cells: where an arm with a camera in its hand can be without touching anything.

**Guarantee.** Joints that are told as reaching a pose bring the camera there, within their limits, and keep the
clearance. What is told as not reached was refused by a reason in words; only "beyond the arm's reach" is a proof.
"""

from planner.robotcell.arm import Joint, Robot
from planner.robotcell.bodies import Box, Fixturing, Grip
from planner.robotcell.camera_body import CableCapsule, CameraBody
from planner.robotcell.cell import Cell, HeldPartCell
from planner.robotcell.cell_light import CarriedLight, LightBox
from planner.robotcell.collisions import Closeness
from planner.robotcell.laying import LaidPart, Laying, propose_layings
from planner.robotcell.placement import Placement, propose_placements
from planner.robotcell.reachability import PoseReach, Reachability

__all__ = [
    "Box",
    "CableCapsule",
    "CameraBody",
    "CarriedLight",
    "Cell",
    "Closeness",
    "Fixturing",
    "Grip",
    "HeldPartCell",
    "Joint",
    "LaidPart",
    "Laying",
    "LightBox",
    "Placement",
    "PoseReach",
    "Reachability",
    "Robot",
    "propose_layings",
    "propose_placements",
]
