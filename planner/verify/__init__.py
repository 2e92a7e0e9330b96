"""What a setting or a plan promises, checked by doing it: displaced poses, pixels, measured lengths.

Poses are displaced, points projected and image coordinates rounded without the error model that made the promise.
"""

from planner.verify.simulate_plan import SimulationResult, simulate_plan
from planner.verify.simulate_setting import SuccessRate, simulate_setting

__all__ = [
    "SimulationResult",
    "SuccessRate",
    "simulate_plan",
    "simulate_setting",
]
