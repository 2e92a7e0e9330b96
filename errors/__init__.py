"""Measurement error of dimensions taken from an image: densities and probabilities."""

from errors.exceptions import (
    BehindLensError,
    CovarianceError,
    DegenerateSegmentError,
    InvalidParameterError,
    InvalidShapeError,
    MeasurementModelError,
)
from errors.expansion import length_expansion
from errors.montecarlo import MonteCarloEstimate, simulate_success
from errors.probability import success_probability
from errors.projection import image_segment, project

__all__ = [
    "BehindLensError",
    "CovarianceError",
    "DegenerateSegmentError",
    "InvalidParameterError",
    "InvalidShapeError",
    "MeasurementModelError",
    "MonteCarloEstimate",
    "image_segment",
    "length_expansion",
    "project",
    "simulate_success",
    "success_probability",
]
