"""The genetic algorithm as pricer, beside other ways to find poses that improve a cover, at equal evaluations.

``python benchmarks/planning/pricers.py [--parts own-block ...] [--budget 12000] [--seeds 3] [--folder DIR]``

Column generation asks one question again and again: which pose inspects targets whose prices sum up to more than 1? The
prices are the dual of the cover's relaxation over the columns so far, at first those of the planner's first candidate
poses. Each method judges as many poses, and all of them join the columns, less what displaced poses do not show, as in
a plan. Shown is the value of the relaxation afterwards, as a mean over the seeds (the lower the better), its largest
and least value, the highest worth of a pose, and how many seeds had a pose that is worth more than 1.

Prices that stay what they are at first:

* genetic algorithm: a chromosome is a pose, its fitness is the sum of the prices of what it inspects. A run is
  for one target, drawn by price: its first population is drawn where that target is observable and in focus, and
  positions are encoded in the box around that region, as for a single setting. Runs of 1,000 evaluations follow each
  other until the budget is spent. Half of the fitness is a slope: how nearly the constraints of each target are met.
* ... without a slope: the same, and only what is inspected counts.
* ... for three targets: a run is for a target and two others near it. Its first population is drawn where all three are
  observable and in focus.
* CMA-ES: the same fitness, parameters, first draws and length of a run; it begins at the best of its first draws.
* random restarts: the first draws only.
* near known poses: perturbed poses of the pool, as in column generation.
* in focus together: poses drawn by the prices, several targets in focus (`poses_in_focus`), as in column generation.
* half of each: half near known poses and half in focus together.

Prices that are solved for again after each generation, of 2,300 poses at most:

* column generation: the proposals of a plan. A generation is bred from the best poses of the one before, the pool and
  poses that nearly inspect enough, by perturbation; a third is drawn with several targets in focus.
* memetic algorithm: the same parents, and the best for each target survive. Half of the children are crossed from two
  parents that inspect, or nearly do, a target in common: the position is between those of both or beyond, and so is
  the orientation. Half of these are also perturbed. The other half, perturbed, is the local search.
* column generation, crossed: a quarter of the perturbed poses is crossed instead, the rest is as in a plan.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from anytime import CASES, judge_of
from dense_optimum import BLOCK, block_judge
from scipy.spatial.transform import Rotation

from ga import maximize
from planner.cover import fractional_cover
from planner.request.reach import cells_of
from planner.search.columns import (
    ColumnPool,
    Judge,
    Judgement,
    entity_poses,
    perturbed,
    poses_in_focus,
)
from planner.search.evolution import EvolutionStrategy
from planner.search.poses import PoseEncoding, ViewpointSampler

PARTS = (BLOCK, "demo", "mfcad-narrow", "d2mi-default", "mtc-narrow")
# viewpoints drawn for each target, for the first columns
_VIEWPOINTS = 10
# evaluations of a run of the genetic algorithm or of CMA-ES
_RUN = 1_000
_POPULATION = 50
# first standard deviation of CMA-ES, as a share of a parameter's range
_STEP = 0.1
# of a generation: parents of each kind, children of each parent, and targets with poses in focus together
_PARENTS = 32
_CHILDREN = 16
_IN_FOCUS = 64
# poses with the same targets in focus
_EACH = 12
# a target is shared by two parents that meet its constraints to this degree at least (1: fully)
_SHARED = 0.3
# of children, this share is crossed
_CROSSED_SHARE = 0.25


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

    def judged(self, poses: np.ndarray) -> Judgement:
        """Judge poses (n, 4, 4), as many as the budget allows; what they inspect joins the columns."""
        poses = poses[: self.left]
        self.left -= len(poses)
        judged = self.judge(poses)
        self.highest = max(self.highest, float((judged.inspects @ self.prices).max(initial=0.0)))
        self.pool.add(judged.inspects, poses, judged.probability, self.judge.steady)
        return judged

    def worth(self, poses: np.ndarray, slope: float = 0.5) -> np.ndarray:
        """Judge poses (n, 4, 4); return what the search climbs (m,), of which a share is the slope."""
        judged = self.judged(poses)
        mixed = (1.0 - slope) * judged.inspects + slope * judged.promise
        return np.asarray(mixed @ self.prices)

    def renew_prices(self) -> None:
        """Solve for the prices over all columns found so far; the optimal ones differ from time to time."""
        bias = 1.0 + 0.5 * self.rng.random(int(self.covered.sum()))
        membership = self.pool.membership[:, self.covered]
        self.prices[self.covered] = fractional_cover(membership, bias)[1]

    @property
    def relaxation(self) -> float:
        """Value of the relaxation with all that was found, of the targets covered before."""
        return fractional_cover(self.pool.membership[:, self.covered])[0]

    def draw_run(self, n_targets: int = 1) -> tuple[PoseEncoding, np.ndarray]:
        """Draw targets by price; return the encoding of poses for them, and first parameters (n, 6)."""
        single = self.judge.single
        while True:
            own = self._near(
                int(self.rng.choice(len(self.prices), p=self.prices / self.prices.sum())), n_targets
            )
            cells = cells_of(single.space, [single.names[k] for k in own])
            ends = single.ends[own]
            sampler = ViewpointSampler(cells, ends, self.judge.camera)
            positions = sampler.sample(_POPULATION, self.rng, max_proposals=50_000)
            if len(positions):
                break
        encoding = PoseEncoding(
            sampler.bounds, ends.mean(axis=(0, 1)), self.judge.camera.half_diagonal_rad
        )
        return encoding, np.hstack([positions, encoding.draw_turns(len(positions), self.rng)])

    def _near(self, target: int, n: int) -> list[int]:
        """Return a target, and others drawn by price from the dozen nearest."""
        middles = self.judge.single.ends.mean(axis=1)
        nearest = np.argsort(np.linalg.norm(middles - middles[target], axis=1))
        near = [int(k) for k in nearest if k != target and self.prices[k] > 0.0][:12]
        drawn = self.rng.permutation(near)[: n - 1]
        return [target, *drawn.tolist()]


def genetic(problem: Pricing, n_targets: int = 1, slope: float = 0.5) -> None:
    """Run the genetic algorithm for one target, or a few, after the other."""
    while problem.left >= _POPULATION:
        encoding, first = problem.draw_run(n_targets)

        def fitness(bits: np.ndarray, encoding: PoseEncoding = encoding) -> np.ndarray:
            return _padded(problem.worth(encoding.decode(bits), slope), len(bits))

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


def generations(problem: Pricing, crossed_share: float, drawn: int = _IN_FOCUS) -> None:
    """Breed generations from the best poses, prices solved for again before each.

    Parameters
    ----------
    problem : Pricing
    crossed_share : float
        Of the children, the share that is crossed; the others are perturbed.
    drawn : int
        Targets for which poses are drawn with several in focus.
    """
    known = problem.known.poses
    best = known[problem.rng.permutation(len(known))[:_PARENTS]]
    promise = problem.judge(best).promise
    while problem.left > 0:
        problem.renew_prices()
        pool = problem.pool
        by_worth = np.argsort(-(pool.membership @ problem.prices), kind="stable")
        some = problem.rng.integers(len(pool), size=_PARENTS // 2)
        chosen = np.concatenate([by_worth[: _PARENTS // 2], some])
        parents = np.concatenate([best, pool.poses[chosen]])
        met = np.concatenate([promise, pool.membership[chosen]]) > _SHARED
        n = len(parents) * _CHILDREN
        n_crossed = int(crossed_share * n)
        children = [
            perturbed(
                np.repeat(parents, _CHILDREN, axis=0)[problem.rng.permutation(n)[n_crossed:]],
                problem.judge.camera.focus_distance_mm,
                problem.rng,
            ),
            crossed(problem, parents, met, n_crossed),
            poses_in_focus(problem.judge, problem.prices, drawn, _EACH, problem.rng),
        ]
        poses = np.concatenate(children)
        poses = poses[problem.rng.permutation(len(poses))][: problem.left]
        judged = problem.judged(poses)
        kept = np.concatenate([best, poses])
        promise = np.concatenate([promise, judged.promise])
        champions = _champions(promise, problem.prices, problem.rng)
        best = kept[champions]
        promise = promise[champions]


def _champions(promise: np.ndarray, prices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the poses of most promised worth, each for another target; with elitism."""
    worth = promise @ prices
    targets = rng.permutation(np.flatnonzero(prices > 0))[:_PARENTS]
    return np.unique(
        [int(np.argmax(np.where(promise[:, k] > _SHARED, worth, -1.0))) for k in targets]
    )


def crossed(problem: Pricing, parents: np.ndarray, met: np.ndarray, n: int) -> np.ndarray:
    """Cross pairs of parents (p, 4, 4) that share a target of those they meet (p, k); return poses (n, 4, 4)."""
    rng = problem.rng
    worth = met @ problem.prices
    # the better of two
    couple = rng.integers(len(parents), size=(2, n))
    first = np.where(worth[couple[0]] >= worth[couple[1]], *couple)
    shared = (met.astype(float) @ met.T)[first] > 0.0
    shared[np.arange(n), first] = False
    lonely = ~shared.any(axis=1)
    shared[lonely] = True
    second = np.argmax(rng.random((n, len(parents))) * shared, axis=1)
    share = rng.uniform(-0.25, 1.25, n)
    a = parents[first]
    b = parents[second]
    turn = Rotation.from_matrix(np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3]).as_rotvec()
    children = a.copy()
    children[:, :3, 3] += share[:, None] * (b[:, :3, 3] - a[:, :3, 3])
    children[:, :3, :3] = a[:, :3, :3] @ Rotation.from_rotvec(share[:, None] * turn).as_matrix()
    mutated = rng.random(n) < 0.5
    children[mutated] = perturbed(children[mutated], problem.judge.camera.focus_distance_mm, rng)
    return children


METHODS: dict[str, Callable[[Pricing], None]] = {
    "genetic algorithm": genetic,
    "... without a slope": partial(genetic, slope=0.0),
    "... for three targets": partial(genetic, n_targets=3),
    "CMA-ES": cma_es,
    "random restarts": random_restarts,
    "near known poses": near_known,
    "in focus together": in_focus,
    "half of each": half_of_each,
    "memetic algorithm": partial(generations, crossed_share=0.5, drawn=_IN_FOCUS // 4),
    "column generation": partial(generations, crossed_share=0.0),
    "column generation, crossed": partial(generations, crossed_share=_CROSSED_SHARE),
}


def judge_for(part: str, folder: Path) -> Judge:
    """Return the judge of a request, whose part is in the examples or in a folder."""
    return block_judge(folder) if part == BLOCK else judge_of(CASES[part], folder)[0]


def first_columns(judge: Judge, seed: int) -> ColumnPool:
    """Return the columns of the planner's first candidate poses."""
    pool = ColumnPool(len(judge.names))
    for name in judge.names:
        poses = entity_poses(judge, name, _VIEWPOINTS, seed)
        judged = judge(poses)
        pool.add(judged.inspects, poses, judged.probability)
    return pool


def compare(part: str, folder: Path, budget: int, seeds: int, methods: list[str], writer) -> None:
    """Print the table of a request."""
    judge = judge_for(part, folder)
    values = defaultdict(list)
    highest = defaultdict(list)
    seconds = defaultdict(list)
    before = []
    for seed in range(seeds):
        pool = first_columns(judge, seed)
        before.append(fractional_cover(pool.membership[:, pool.inspected])[0])
        for name in methods:
            problem = Pricing(judge, pool, budget, seed)
            start = time.process_time()
            METHODS[name](problem)
            seconds[name].append(time.process_time() - start)
            values[name].append(problem.relaxation)
            highest[name].append(problem.highest)
            row = [part, name, seed, f"{before[-1]:.4f}", f"{values[name][-1]:.4f}"]
            writer.writerow([*row, f"{problem.highest:.4f}", f"{seconds[name][-1]:.2f}"])
    print(f"\n{part}: {len(judge.names)} targets, relaxation before {np.mean(before):.2f}")
    print(
        f"  {'':<28}{'relaxation':>12}{'least':>8}{'most':>8}{'worth':>8}{'above 1':>9}{'seconds':>9}"
    )
    for name in methods:
        better = sum(worth > 1.0 + 1e-6 for worth in highest[name])
        print(
            f"  {name:<28}{np.mean(values[name]):12.2f}{min(values[name]):8.2f}"
            f"{max(values[name]):8.2f}{np.mean(highest[name]):8.2f}"
            f"{better:6d}/{seeds}{np.mean(seconds[name]):9.2f}",
            flush=True,
        )


def main() -> None:
    """Run the comparison that the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
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
            compare(part, given.folder, given.budget, given.seeds, given.methods, writer)
            file.flush()


if __name__ == "__main__":
    main()
