"""The genetic algorithm as pricer, beside other ways to find poses that improve a cover, at equal evaluations.

``python benchmarks/planning/pricers.py [--parts own-block ...] [--budget 12000] [--seeds 3] [--folder DIR]``

Column generation asks one question again and again: which pose inspects targets whose prices sum up to more than 1? The
prices are the dual of the cover's relaxation over the columns so far; here these are of the planner's first candidate
poses, and stay what they are. Each method judges as many poses, and all of them join the columns. Shown is the value of
the relaxation afterwards, as a mean over the seeds (the lower the better), the highest worth of a pose, and how many
seeds had a pose that is worth more than 1.

* genetic algorithm (`ga`): a chromosome is a pose, its fitness is the sum of the prices of what it inspects. A run is
  for one target, drawn by price: its first population is drawn where that target is observable and in focus, and
  positions are encoded in the box around that region, as for a single setting. Runs of 1,000 evaluations follow each
  other until the budget is spent. Where nothing is inspected, half of the fitness is a slope: how nearly the
  constraints of each target are met.
* CMA-ES: the same fitness, parameters, first draws and length of a run; it begins at the best of its first draws.
* random restarts: the first draws only.
* near known poses: perturbed poses of the pool, as in column generation.
* in focus together: poses drawn by the prices, several targets in focus (`poses_in_focus`), as in column generation.
* half of each: half near known poses and half in focus together.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
from anytime import CASES, judge_of
from dense_optimum import BLOCK, block_judge

from ga import maximize
from planner.cover import fractional_cover
from planner.request.reach import cells_of
from planner.search.columns import ColumnPool, Judge, entity_poses, perturbed, poses_in_focus
from planner.search.evolution import EvolutionStrategy
from planner.search.poses import PoseEncoding, ViewpointSampler

PARTS = (BLOCK, "demo", "mfcad-default", "mfcad-narrow", "d2mi-default")
# viewpoints drawn for each target, for the first columns
_VIEWPOINTS = 10
# evaluations of a run of the genetic algorithm or of CMA-ES
_RUN = 1_000
_POPULATION = 50
# first standard deviation of CMA-ES, as a share of a parameter's range
_STEP = 0.1


class Pricing:
    """One pricing problem: judges poses, counts them, and joins them to the columns.

    Parameters
    ----------
    judge : Judge
    pool : ColumnPool
        The first columns; they are not changed.
    budget : int
        Poses that a method may have judged.
    seed : int
    """

    def __init__(self, judge: Judge, pool: ColumnPool, budget: int, seed: int):
        self.judge = judge
        self.known = pool
        self.pool = ColumnPool.from_dict(pool.to_dict())
        self.covered = pool.inspected
        self.left = budget
        self.rng = np.random.default_rng(seed)
        self.prices = np.zeros(len(self.covered))
        self.prices[self.covered] = fractional_cover(pool.membership[:, self.covered])[1]
        self.highest = 0.0

    def worth(self, poses: np.ndarray) -> np.ndarray:
        """Judge poses (n, 4, 4); return what the search climbs (n,)."""
        poses = poses[: self.left]
        self.left -= len(poses)
        judged = self.judge(poses)
        worth = judged.inspects @ self.prices
        self.highest = max(self.highest, float(worth.max(initial=0.0)))
        self.pool.add(judged.inspects, poses, judged.probability)
        return np.asarray(worth + judged.promise @ self.prices) / 2

    @property
    def relaxation(self) -> float:
        """Value of the relaxation with all that was found, of the targets covered before."""
        return fractional_cover(self.pool.membership[:, self.covered])[0]

    def draw_run(self) -> tuple[PoseEncoding, np.ndarray]:
        """Draw a target by its price; return the encoding of poses for it, and first parameters (n, 6)."""
        while True:
            k = int(self.rng.choice(len(self.prices), p=self.prices / self.prices.sum()))
            single = self.judge.single
            ends = single.ends[k : k + 1]
            cells = cells_of(single.space, [single.names[k]])
            sampler = ViewpointSampler(cells, ends, self.judge.camera)
            positions = sampler.sample(_POPULATION, self.rng, max_proposals=50_000)
            if len(positions):
                break
        encoding = PoseEncoding(
            sampler.bounds, ends[0].mean(axis=0), self.judge.camera.half_diagonal_rad
        )
        return encoding, np.hstack([positions, encoding.draw_turns(len(positions), self.rng)])


def genetic(problem: Pricing) -> None:
    """Run the genetic algorithm for one target after the other."""
    while problem.left >= _POPULATION:
        encoding, first = problem.draw_run()

        def fitness(bits: np.ndarray, encoding: PoseEncoding = encoding) -> np.ndarray:
            return _padded(problem.worth(encoding.decode(bits)), len(bits))

        maximize(
            fitness,
            encoding.n_bits,
            population=_POPULATION,
            initial=np.resize(encoding.encode(first), (_POPULATION, encoding.n_bits)),
            rng=problem.rng,
            scaling="window",
            elitism=2,
            max_nfev=min(_RUN, problem.left),
        )


def cma_es(problem: Pricing) -> None:
    """Run CMA-ES for one target after the other."""
    while problem.left >= _POPULATION:
        encoding, first = problem.draw_run()
        span = encoding.high - encoding.low
        values = problem.worth(encoding.poses(first))
        start = (first[int(np.argmax(values))] - encoding.low) / span
        strategy = EvolutionStrategy(start, _STEP, 24, problem.rng)
        for _ in range((_RUN - len(first)) // 24):
            points = strategy.ask()
            poses = encoding.poses(encoding.low + np.clip(points, 0.0, 1.0) * span)
            strategy.tell(points, _padded(problem.worth(poses), len(points)))


def _padded(values: np.ndarray, n: int) -> np.ndarray:
    """Return values (n,): those beyond the budget are 0."""
    return np.concatenate([values, np.zeros(n - len(values))])


def random_restarts(problem: Pricing) -> None:
    """Judge first draws only."""
    while problem.left > 0:
        encoding, first = problem.draw_run()
        problem.worth(encoding.poses(first))


def near_known(problem: Pricing) -> None:
    """Judge poses near those of the pool, the most worthy twice as often."""
    by_worth = np.argsort(-(problem.known.membership @ problem.prices), kind="stable")
    parents = problem.known.poses[np.concatenate([by_worth, by_worth[: len(by_worth) // 2]])]
    chosen = parents[problem.rng.integers(len(parents), size=problem.left)]
    problem.worth(perturbed(chosen, problem.judge.camera.focus_distance_mm, problem.rng))


def in_focus(problem: Pricing) -> None:
    """Judge poses with several targets in focus."""
    n = -(-problem.left // 12)
    problem.worth(poses_in_focus(problem.judge, problem.prices, n, 12, problem.rng))


def half_of_each(problem: Pricing) -> None:
    """Judge half near known poses, half with several targets in focus."""
    half = problem.left // 2
    problem.left -= half
    near_known(problem)
    problem.left = half
    in_focus(problem)


METHODS: dict[str, Callable[[Pricing], None]] = {
    "genetic algorithm": genetic,
    "CMA-ES": cma_es,
    "random restarts": random_restarts,
    "near known poses": near_known,
    "in focus together": in_focus,
    "half of each": half_of_each,
}


def first_columns(judge: Judge, seed: int) -> ColumnPool:
    """Return the columns of the planner's first candidate poses."""
    pool = ColumnPool(len(judge.names))
    for name in judge.names:
        poses = entity_poses(judge, name, _VIEWPOINTS, seed)
        judged = judge(poses)
        pool.add(judged.inspects, poses, judged.probability)
    return pool


def compare(part: str, folder: Path, budget: int, seeds: int, writer) -> None:
    """Print the table of a request."""
    judge = block_judge(folder) if part == BLOCK else judge_of(CASES[part], folder)[0]
    values = defaultdict(list)
    highest = defaultdict(list)
    seconds = defaultdict(list)
    before = []
    for seed in range(seeds):
        pool = first_columns(judge, seed)
        before.append(fractional_cover(pool.membership[:, pool.inspected])[0])
        for name, method in METHODS.items():
            problem = Pricing(judge, pool, budget, seed)
            start = time.process_time()
            method(problem)
            seconds[name].append(time.process_time() - start)
            values[name].append(problem.relaxation)
            highest[name].append(problem.highest)
            row = [part, name, seed, f"{before[-1]:.4f}", f"{values[name][-1]:.4f}"]
            writer.writerow([*row, f"{problem.highest:.4f}", f"{seconds[name][-1]:.2f}"])
    print(f"\n{part}: {len(judge.names)} targets, relaxation before {np.mean(before):.2f}")
    print(f"  {'':<22}{'relaxation':>12}{'worth':>8}{'above 1':>9}{'seconds':>9}")
    for name in METHODS:
        better = sum(worth > 1.0 + 1e-6 for worth in highest[name])
        print(
            f"  {name:<22}{np.mean(values[name]):12.2f}{np.mean(highest[name]):8.2f}"
            f"{better:6d}/{seeds}{np.mean(seconds[name]):9.2f}",
            flush=True,
        )


def main() -> None:
    """Run the comparison that the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--budget", type=int, default=12_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=Path(), help="of the parts")
    parser.add_argument("--csv", default=os.devnull, help="write every run to this file")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with open(given.csv, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["part", "method", "seed", "before", "relaxation", "worth", "seconds"])
        for part in given.parts:
            compare(part, given.folder, given.budget, given.seeds, writer)
            file.flush()


if __name__ == "__main__":
    main()
