"""A genetic algorithm for bit-string problems.

`maximize` runs the algorithm; `Chromosome` reads and writes numbers as genes, in plain binary or Gray code. The
operators are functions of whole populations, one kind per module: `ga.selection`, `ga.crossover`, `ga.mutation`.

Reference: C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", Journal of
Robotic Systems 18(1), 1-15, 2001, section 4.
"""

from typing import TYPE_CHECKING, Any

from ga.chromosome import Chromosome, binary_from_gray, gray_from_binary
from ga.exceptions import FitnessError, GAError, InfeasiblePopulationError, ParameterError
from ga.result import GAResult, Generation, History
from ga.run import maximize

__all__ = [
    "Chromosome",
    "FitnessError",
    "GAError",
    "GAResult",
    "Generation",
    "History",
    "InfeasiblePopulationError",
    "ParameterError",
    "binary_from_gray",
    "gray_from_binary",
    "maximize",
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
