"""Time of the genetic algorithm itself: a run whose fitness costs next to nothing.

Run ``python benchmarks/genetic/ga_overhead.py``. Shown is the median time of one generation over repeated runs.
"""

import time

import numpy as np

from ga import maximize

OPTIONS = {
    "paper": {},
    "SUS, rank, elitism 2": {"selection": "sus", "scaling": "rank", "elitism": 2},
    "half infeasible": {"feasible": lambda bits: bits[:, 0] ^ bits[:, 1]},
    "no duplicates": {"duplicates": False},
}


def milliseconds_per_generation(population, n_bits, options, generations=50, repeats=9):
    """Return the median over the repeats of the time, ms, that one generation takes."""
    times = []
    for seed in range(repeats):
        start = time.perf_counter()
        result = maximize(
            lambda bits: bits.sum(axis=1),
            n_bits,
            population,
            rng=seed,
            epsilon=0.0,
            max_generations=generations,
            **options,
        )
        times.append(1e3 * (time.perf_counter() - start) / result.nit)
    return float(np.median(times))


def main() -> None:
    """Print a row per set of options, a column per size."""
    sizes = [(20, 72), (100, 72), (1000, 72), (10_000, 72), (100, 720)]
    print(
        f"{'ms per generation':<24}" + "".join(f"{f'{n} x {bits} bits':>18}" for n, bits in sizes)
    )
    for name, options in OPTIONS.items():
        cells = (milliseconds_per_generation(n, bits, options) for n, bits in sizes)
        print(f"{name:<24}" + "".join(f"{cell:18.3f}" for cell in cells))


if __name__ == "__main__":
    main()
