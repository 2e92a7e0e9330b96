"""Robot cells: where an arm with a camera in its hand can be without touching anything.

**Guarantee.** Joints that are told as reaching a pose bring the camera there, within their limits, and keep the
clearance. What is told as not reached was refused by a reason in words; only "beyond the arm's reach" is a proof.
"""

from planner.robot.arm import Joint, Robot
from planner.robot.bodies import Box
from planner.robot.cell import Cell
from planner.robot.collisions import Closeness
from planner.robot.held.held_part_cell import HeldPartCell
from planner.robot.placement import Placement, propose_placements
from planner.robot.pose_reach import PoseReach
from planner.robot.reachability import Reachability
from planner.robot.standing import Fixturing, Grip

__all__ = [
    "Box",
    "Cell",
    "Closeness",
    "Fixturing",
    "Grip",
    "HeldPartCell",
    "Joint",
    "Placement",
    "PoseReach",
    "Reachability",
    "Robot",
    "propose_placements",
]
