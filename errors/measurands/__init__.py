"""Dimensions measured in one image: lengths, distances, angles, diameters, and how sure they are.

Lines and circles in the part's frame, a planned pose and its uncertainty go in; the probability of a small error, the
uncertainty and its budget come out. What is found in the image is carried back with the planned pose to planes of the
part, where lines and circles are fitted; a displaced pose moves all of it together.
"""

import errors.measurands.kinds  # noqa: F401  registers them
from errors.exceptions import MeasurandError
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
from errors.measurands.split import End, SplitModel

__all__ = [
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
    "Prediction",
    "SplitModel",
    "acceptance_limits",
    "conformance_probability",
    "decide",
    "guard_band",
    "kind",
    "kinds",
    "measurand",
    "uncertainty_ratio",
]
