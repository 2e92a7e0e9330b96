"""A genetic algorithm for bit-string problems.

`maximize` runs the algorithm; `Chromosome` reads and writes numbers as genes, in plain binary or Gray code. The
operators are functions of whole populations, one kind per module: `ga.selection`, `ga.crossover`, `ga.mutation`.

Reference: C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", Journal of
Robotic Systems 18(1), 1-15, 2001, section 4.
"""

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
