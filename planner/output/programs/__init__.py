"""Robot programs in the languages of controllers.

**Guarantee.** All formats hold the same joints, in the same order. A pose target would leave the
branch to the controller, so there is none. A program stops at its start unless the robot stands at
home, because only moves from there are checked.
"""

from planner.output.programs.driving import CameraSignals
from planner.output.programs.write import FORMATS, program_text, write_program

__all__ = ["FORMATS", "CameraSignals", "program_text", "write_program"]
