"""A plan for others to use: its folder, pose files of other programs, tables for a terminal, JSON.

Nothing here changes a plan or judges it anew.
"""

from planner.output.plan_folder import Written, rescue, write_outputs
from planner.output.pose_files import write_poses
from planner.report.page import report_html

__all__ = [
    "Written",
    "report_html",
    "rescue",
    "write_outputs",
    "write_poses",
]
