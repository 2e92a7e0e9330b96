"""Dimensions measured in one image: lengths, distances, angles, diameters, and how sure they are.

Lines and circles in the part's frame, a planned pose and its uncertainty go in; the probability of a small error, the
uncertainty and its budget come out. What is found in the image is carried back with the planned pose to planes of the
part, where lines and circles are fitted; a displaced pose moves all of it together.
"""

import errors.measurands.kinds  # noqa: F401  registers them
from errors.exceptions import MeasurandError
from errors.measurands.disc import (
    Bonus,
    decide_deviation,
    decide_position,
    deviation_interval,
    disc_probability,
    position_conformance,
    quadratic_disc_probability,
    quadratic_interval_probability,
)
from errors.measurands.geometry import Circle, Geometry, Line, Localisation
from errors.measurands.measurand import (
    Decision,
    DecisionRule,
    Measurand,
    MeasurandModel,
    Prediction,
    acceptance_limits,
    conformance_probability,
    decide,
    guard_band,
    kind,
    kinds,
    measurand,
    uncertainty_ratio,
)
from errors.measurands.position import Position, PositionFrame, PositionModel
from errors.measurands.split import (
    End,
    SplitModel,
    can_be_split,
    end_groups,
    end_of_value,
    split_model,
)

__all__ = [
    "Bonus",
    "Circle",
    "Decision",
    "DecisionRule",
    "End",
    "Geometry",
    "Line",
    "Localisation",
    "Measurand",
    "MeasurandError",
    "MeasurandModel",
    "Position",
    "PositionFrame",
    "PositionModel",
    "Prediction",
    "SplitModel",
    "acceptance_limits",
    "can_be_split",
    "conformance_probability",
    "decide",
    "decide_deviation",
    "decide_position",
    "deviation_interval",
    "disc_probability",
    "end_groups",
    "end_of_value",
    "guard_band",
    "kind",
    "kinds",
    "measurand",
    "position_conformance",
    "quadratic_disc_probability",
    "quadratic_interval_probability",
    "split_model",
    "uncertainty_ratio",
]
