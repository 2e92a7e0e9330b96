"""A plan for others to use: pose files of other programs, the report, tables and words.

Nothing here changes a plan or judges it anew.
"""

from planner.output.plan_folder import Written, rescue, write_outputs
from planner.output.pose_files import write_poses
from planner.output.report import report_html

__all__ = [
    "Written",
    "report_html",
    "rescue",
    "write_outputs",
    "write_poses",
]
