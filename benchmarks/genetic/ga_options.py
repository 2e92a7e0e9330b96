"""What each option of the genetic algorithm brings, on problems whose optimum is known.

Run ``python benchmarks/genetic/ga_options.py [--seeds 20] [--budget 10000]``. Every variant has the same number of
evaluations; shown are the shortfall from the optimum over the seeds (median, worst), how many seeds came within 0.5 %
of the optimum, the median number of evaluations until then, and the time per run.
"""

import argparse
import time
from dataclasses import dataclass
from functools import partial

import numpy as np

from ga import Chromosome, maximize


@dataclass(frozen=True)
class Problem:
    """A function of bits with values in [0, 1], 1 being the optimum."""

    name: str
    n_bits: int
    fitness: object


def onemax(bits):
    """Share of ones."""
    return bits.mean(axis=1)


def trap(bits, size=4):
    """Deceptive blocks: all ones is best, but from anywhere else fewer ones look better (K. Deb, D. Goldberg 1993)."""
    ones = bits.reshape(len(bits), -1, size).sum(axis=2)
    return np.where(ones == size, size, size - 1 - ones).mean(axis=1) / size


def rastrigin(chromosome, bits):
    """Many local peaks on a lattice, the best of them in the middle."""
    x = chromosome.decode(bits, -5.12, 5.12)
    return 1.0 - (10.0 + x**2 - 10.0 * np.cos(2.0 * np.pi * x)).mean(axis=1) / 45.0


def ridge(chromosome, bits):
    """A smooth peak in six coupled variables that saturates below 1, as a probability of success does."""
    x = chromosome.fractions(bits) - np.array([0.31, 0.62, 0.47, 0.55, 0.28, 0.71])
    turned = x + 0.8 * np.roll(x, 1, axis=1)
    return 1.0 / (1.0 + 30.0 * (turned**2).sum(axis=1))


PROBLEMS = [
    Problem("onemax 72", 72, onemax),
    Problem("trap 10 x 4", 40, trap),
    *(
        Problem(
            f"{function.__name__} {'gray' if gray else 'binary'}",
            72,
            partial(function, Chromosome(6, 12, gray)),
        )
        for function in (rastrigin, ridge)
        for gray in (False, True)
    ),
]

LOW = {"mutation": 0.02}
ELITE = LOW | {"elitism": 2}
VARIANTS = {
    "paper, P_m 0.1": {},
    "paper, P_m 0.02": LOW,
    "+ SUS": LOW | {"selection": "sus"},
    "+ elitism": ELITE,
    "+ elitism, window": ELITE | {"scaling": "window"},
    "+ elitism, rank": ELITE | {"scaling": "rank"},
    "+ elitism, rank, SUS": ELITE | {"scaling": "rank", "selection": "sus"},
    "  the same, all distinct": ELITE
    | {"scaling": "rank", "selection": "sus", "duplicates": False},
    "  the same, P_m 0.1": ELITE | {"scaling": "rank", "selection": "sus", "mutation": 0.1},
}


def run(problem, options, seed, budget):
    """Return best fitness, evaluations until within 0.5 % (inf if never) and seconds of one run."""
    start = time.perf_counter()
    result = maximize(
        problem.fitness,
        problem.n_bits,
        rng=seed,
        epsilon=0.0,
        max_generations=10**6,
        max_nfev=budget,
        **options,
    )
    seconds = time.perf_counter() - start
    reached = np.flatnonzero(result.history.best_so_far >= 0.995)
    return result.fun, result.history.nfev[reached[0]] if reached.size else np.inf, seconds


def random_search(problem, seed, budget):
    """Return the same for as many even random bit strings."""
    start = time.perf_counter()
    values = problem.fitness(np.random.default_rng(seed).random((budget, problem.n_bits)) < 0.5)
    reached = np.flatnonzero(values >= 0.995)
    return values.max(), reached[0] + 1 if reached.size else np.inf, time.perf_counter() - start


def report(name, runs):
    """Print one row of the table."""
    best, evaluations, seconds = np.array(runs).T
    median = (
        f"{np.median(evaluations):9.0f}" if np.isfinite(np.median(evaluations)) else "        -"
    )
    print(
        f"  {name:<26} {1 - np.median(best):9.5f} {1 - best.min():9.5f} "
        f"{np.isfinite(evaluations).sum():4d}/{len(runs)} {median} {1e3 * np.median(seconds):8.1f}"
    )


def main() -> None:
    """Print a table per problem."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--budget", type=int, default=10_000)
    arguments = parser.parse_args()
    for problem in PROBLEMS:
        print(
            f"\n{problem.name}\n  {'':<26} {'median':>9} {'worst':>9} {'within':>7} {'nfev':>9} {'ms':>8}"
        )
        report(
            "random search",
            [random_search(problem, seed, arguments.budget) for seed in range(arguments.seeds)],
        )
        for name, options in VARIANTS.items():
            report(
                name,
                [run(problem, options, seed, arguments.budget) for seed in range(arguments.seeds)],
            )


if __name__ == "__main__":
    main()
