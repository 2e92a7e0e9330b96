"""What is asked of a setting: constraints as signed margins, and the probability to maximise.

A margin of 0 or more is a constraint met. Nothing here searches.
"""

from planner.request.constraints import Constraints, Requirements, visibility_slacks
from planner.request.defaults import (
    check_count,
    check_fraction,
    check_seed,
    corner_margin_px,
    default_workspace,
    pose_margin_px,
    position_margin_mm,
)
from planner.request.effort import Effort
from planner.request.objective import Objective
from planner.request.reach import BoxRegion, MeshRegion, Reach, SphereRegion, reach_name
from planner.request.request import Request
from planner.request.space import Space, cells_of

__all__ = [
    "BoxRegion",
    "Constraints",
    "Effort",
    "MeshRegion",
    "Objective",
    "Reach",
    "Request",
    "Requirements",
    "Space",
    "SphereRegion",
    "cells_of",
    "check_count",
    "check_fraction",
    "check_seed",
    "corner_margin_px",
    "default_workspace",
    "pose_margin_px",
    "position_margin_mm",
    "reach_name",
    "visibility_slacks",
]
