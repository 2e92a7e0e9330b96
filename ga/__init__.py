"""A genetic algorithm for bit-string problems.

`maximize` runs the algorithm; `Chromosome` reads and writes numbers as genes, in plain binary or Gray code. The
operators are public too, so that each can be studied on its own.

Reference: C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", Journal of
Robotic Systems 18(1), 1-15, 2001, section 4.
"""

from ga.chromosome import Chromosome, binary_from_gray, gray_from_binary
from ga.crossover import exchange_tails, one_point
from ga.exceptions import FitnessError, GAError, InfeasiblePopulationError, ParameterError
from ga.mutation import flip_bits
from ga.result import GAResult, Generation, History
from ga.run import maximize
from ga.selection import (
    proportional_weights,
    rank_weights,
    roulette,
    stochastic_universal,
    window_weights,
)

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
    "exchange_tails",
    "flip_bits",
    "gray_from_binary",
    "maximize",
    "one_point",
    "proportional_weights",
    "rank_weights",
    "roulette",
    "stochastic_universal",
    "window_weights",
]
