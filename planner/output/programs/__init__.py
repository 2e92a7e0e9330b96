"""Robot programs in the languages of controllers.

**Guarantee.** All formats hold the same joints, in the same order. A pose target would leave the
branch to the controller, so there is none. A program of a controller stops at its start unless the
robot stands at home, because only moves from there are checked. Who lets it go on answers for the way
to home, which is driven slowly.
"""

from planner.output.programs.driving import CameraSignals, check_program_speed
from planner.output.programs.write import FORMATS, program_text, write_program

__all__ = ["FORMATS", "CameraSignals", "check_program_speed", "program_text", "write_program"]
