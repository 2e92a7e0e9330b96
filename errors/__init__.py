"""Measurement error of dimensions taken from an image: densities and probabilities.

Arrays of numbers in millimetres and radians go in, densities and probabilities come out. `success_probability` is the
one call a planner needs, `SuccessModel` the same for an optimiser that asks often; the laws of the paper's equations
are `AxisQuantization` (1-2), `SegmentQuantization` (3), `displacement_terms` (8-9), `point_displacement` (10-11),
`AxisDisplacement` (12-13), `SegmentDisplacement` (14) and `SegmentError` (15).
"""

from typing import TYPE_CHECKING, Any

from errors.displacement import DisplacementTerms, displace, displacement_terms, point_displacement
from errors.exceptions import (
    BehindLensError,
    CovarianceError,
    DegenerateSegmentError,
    InvalidParameterError,
    InvalidShapeError,
    MeasurementModelError,
)
from errors.expansion import length_expansion
from errors.model import SuccessModel
from errors.probability import success_probability
from errors.projection import image_segment, project
from errors.quantization import AxisQuantization, SegmentQuantization
from errors.ratio import NormalRatio
from errors.referee.montecarlo import MonteCarloEstimate, binomial_interval, simulate_success
from errors.referee.pixels import coverage_image, measure_lengths
from errors.referee.twin import simulate_measurement
from errors.segment import AxisDisplacement, SegmentDisplacement, SegmentError

__all__ = [
    "AxisDisplacement",
    "AxisQuantization",
    "BehindLensError",
    "CovarianceError",
    "DegenerateSegmentError",
    "DisplacementTerms",
    "InvalidParameterError",
    "InvalidShapeError",
    "MeasurementModelError",
    "MonteCarloEstimate",
    "NormalRatio",
    "SegmentDisplacement",
    "SegmentError",
    "SegmentQuantization",
    "SuccessModel",
    "binomial_interval",
    "coverage_image",
    "displace",
    "displacement_terms",
    "image_segment",
    "length_expansion",
    "measure_lengths",
    "point_displacement",
    "project",
    "simulate_measurement",
    "simulate_success",
    "success_probability",
]


if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> Any:
        """Look up the version, which is stated in the project's metadata only."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("aspectgraph")
        except PackageNotFoundError:
            # run from its source without being installed
            return "unknown"


def __dir__() -> list[str]:
    """List the public names only."""
    return sorted([*__all__, *_OWN_NAMES])


_OWN_NAMES = ("__all__", "__doc__", "__file__", "__name__", "__path__", "__version__")
