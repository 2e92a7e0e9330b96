"""The planner's search against other optimisers on the same objective, constraints and budget.

``python benchmarks/planning/optimisers.py``  six cases; every rival may evaluate as many poses as the plan did
``... --optimum``                             twenty cases; rivals may evaluate 20 times as many, random search 10⁵
``... --genetic``                             twenty cases; the plan with one generation, and without refinement
``... --sampling``                            first poses from the covering domains against the whole workspace

Shown is the *shortfall*: by how many per cent the fitness (sum of the entities' probabilities) is below the best that
any method found on the case in this run. `--csv FILE` also writes every run; the notebook comparisons shows these
files. The methods are described in rivals.py.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from collections import defaultdict

import numpy as np
from cases import CASES, FEW, case_name
from rivals import OURS, RIVALS, Problem, run, samples

from planner import InfeasibleError, Search
from planner.search.plan_setting import search_pose
from planner.search.poses import WorkspaceSampler

_PLAN = "plan_setting"
_DRAWS = 8192
_CLOSE = 0.999


def compare(seeds: int, writer) -> None:
    """Print the comparison at equal budgets, case by case and over all cases."""
    shortfalls = defaultdict(list)
    rows = defaultdict(list)
    for case in FEW:
        problem = Problem(*case)
        runs = defaultdict(list)
        for seed in range(seeds):
            plan = run(problem, OURS, seed)
            runs[_PLAN].append(plan)
            for name, method in RIVALS.items():
                runs[name].append(run(problem, method, seed, plan.evaluated))
        best = max(r.fitness for group in runs.values() for r in group)
        print(f"\n{case_name(case)}: best fitness {best:.4f}\n{_header()}")
        for name, group in runs.items():
            lost = [_shortfall(r.fitness, best) for r in group]
            shortfalls[name] += lost
            rows[name] += group
            print(_row(name, lost, group))
            for seed, r in enumerate(group):
                writer.writerow(
                    [case_name(case), name, seed, r.fitness, r.evaluated, r.tried, r.seconds]
                )
    print(f"\nall {len(FEW)} cases, {seeds} seeds each\n{_header()}")
    for name, group in rows.items():
        print(_row(name, shortfalls[name], group))


def _shortfall(fitness: float, best: float) -> float:
    """Per cent below the best; 100 where no feasible pose was found."""
    return 100.0 * (1.0 - max(fitness, 0.0) / best)


def _header() -> str:
    columns = ("median %", "worst %", "s.d. %", "evaluated", "tried", "seconds")
    return f"  {'':<24}" + "".join(f"{title:>11}" for title in columns)


def _row(name: str, lost, group) -> str:
    evaluated, tried, seconds = (
        np.mean([getattr(r, key) for r in group]) for key in ("evaluated", "tried", "seconds")
    )
    return (
        f"  {name:<24}{np.median(lost):11.4f}{max(lost):11.4f}{np.std(lost):11.4f}"
        f"{evaluated:11.0f}{tried:11.0f}{seconds:11.2f}"
    )


def optimum(writer, times: float = 20.0) -> None:
    """Print, per case, how far the plan is below the best of the rivals with many times its evaluations."""
    names = ("differential evolution", "CMA-ES", "random search")
    print(
        f"{'case':<52}{'plan':>8}{'evaluated':>10}"
        + "".join(f"{name:>24}" for name in names)
        + f"{'below %':>10}"
    )
    worst = -np.inf
    for case in CASES:
        problem = Problem(*case)
        plan = run(problem, OURS, 0)
        rivals = [
            run(problem, samples, 1)
            if name == "random search"
            else run(problem, RIVALS[name], 1, times * plan.evaluated)
            for name in names
        ]
        below = 100.0 * (1.0 - plan.fitness / max(r.fitness for r in rivals))
        worst = max(worst, below)
        figures = "".join(f"{r.fitness:14.4f} ({r.evaluated:7d})" for r in rivals)
        print(
            f"{case_name(case)[:51]:<52}{plan.fitness:8.4f}{plan.evaluated:10d}{figures}{below:10.4f}",
            flush=True,
        )
        for name, r in zip((_PLAN, *names), (plan, *rivals), strict=True):
            writer.writerow([case_name(case), name, 0, r.fitness, r.evaluated, r.tried, r.seconds])
    verdict = "within" if worst <= 0.5 else "NOT within"
    print(
        f"The plan is {verdict} 0.5 % of the best of any rival on all {len(CASES)} cases (worst {worst:.4f} %)."
    )


def genetic(seeds: int) -> None:
    """Print what the genetic algorithm brings beside the refinement: shortfalls and seconds over all cases."""
    searches = {
        "plan_setting": Search(),
        "one generation, refined": Search(max_generations=1),
        "genetic algorithm alone": Search.genetic(),
    }
    lost = defaultdict(list)
    seconds = defaultdict(list)
    for case in CASES:
        problem = Problem(*case)
        problem.begin()
        fitness = {
            name: [_searched(problem, search, seed) for seed in range(seeds)]
            for name, search in searches.items()
        }
        best = max(value for runs in fitness.values() for value, _ in runs)
        for name, runs in fitness.items():
            lost[name] += [_shortfall(value, best) for value, _ in runs]
            seconds[name] += [taken for _, taken in runs]
    print(f"{'':<26}{'median %':>10}{'worst %':>10}{'above .01 %':>13}{'seconds':>9}")
    for name, values in lost.items():
        above = sum(value > 0.01 for value in values)
        print(
            f"{name:<26}{np.median(values):10.4f}{max(values):10.4f}{above:7d} of {len(values):<3d}"
            f"{np.mean(seconds[name]):8.3f}"
        )


def _searched(problem: Problem, search: Search, seed: int) -> tuple[float, float]:
    """Return the fitness of a search, 0 if it finds nothing, and its seconds."""
    start = time.process_time()
    rng = np.random.default_rng(seed)
    try:
        outcome = search_pose(problem.cells, problem.constraints, problem.goal, search, rng)
    except InfeasibleError:
        return 0.0, time.process_time() - start
    return outcome.fitness, time.process_time() - start


def sampling(seeds: int) -> None:
    """Print what the restriction to the covering domains brings."""
    print(
        "Feasible: share of poses drawn for the first population that satisfy all constraints. Generations and\n"
        "evaluations until the best pose is within 0.1 % of the best fitness known (median over the seeds, - never).\n"
        "Where draws hardly ever fit, the planner repairs the least violating ones; else they would find none.\n"
    )
    print(
        f"{'case':<52}{'sampling':>10}{'feasible':>10}{'generations':>13}{'evaluated':>11}"
        f"{'reached':>9}{'lost %':>9}{'s':>7}"
    )
    for case in FEW:
        problem = Problem(*case)
        runs = {
            where: [_converge(problem, where, s) for s in range(seeds)]
            for where in ("covering", "workspace")
        }
        # the references are refined, so they come first and stay out of the table
        best = max(run(problem, OURS, seed).fitness for seed in range(2))
        for where, outcomes in runs.items():
            reached = [_when(outcome, nfev, _CLOSE * best) for outcome, nfev, _ in outcomes]
            nits, nfevs = zip(*reached, strict=True)
            fitness = [outcome.fitness if outcome else 0.0 for outcome, _, _ in outcomes]
            print(
                f"{case_name(case)[:51]:<52}{where:>10}{_feasible_share(problem, where):10.4%}"
                f"{_or_dash(np.median(nits)):>13}{_or_dash(np.median(nfevs)):>11}"
                f"{np.isfinite(nits).sum():6d}/{seeds}{_shortfall(np.median(fitness), best):9.3f}"
                f"{np.median([seconds for _, _, seconds in outcomes]):7.2f}",
                flush=True,
            )


def _converge(problem: Problem, where: str, seed: int):
    """Run the genetic algorithm alone.

    Returns
    -------
    outcome : Outcome or None
        None if no feasible pose was found.
    nfev : list of int
        Evaluations until each generation.
    seconds : float
    """
    search = Search.genetic(sampling=where, max_stall=None, max_generations=150)
    problem.begin()
    nfev = []
    begin = time.process_time()
    try:
        outcome = search_pose(
            problem.cells,
            problem.constraints,
            problem.goal,
            search,
            np.random.default_rng(seed),
            callback=lambda generation: nfev.append(generation.nfev),
        )
    except InfeasibleError:
        outcome = None
    return outcome, nfev, time.process_time() - begin


def _when(outcome, nfev, wanted: float) -> tuple[float, float]:
    """Return the generation, and the evaluations until then, in which a fitness was reached; inf if never."""
    reached = np.flatnonzero(np.array(outcome.history if outcome else ()) >= wanted)
    return (float(reached[0]), float(nfev[reached[0]])) if reached.size else (np.inf, np.inf)


def _feasible_share(problem: Problem, where: str) -> float:
    """Return the share of feasible poses among draws before any repair."""
    sampler = problem.sampler
    if where == "workspace":
        sampler = WorkspaceSampler(
            problem.cells,
            problem.constraints.ends,
            problem.camera,
            problem.constraints.space.workspace,
        )
    rng = np.random.default_rng(0)
    positions = sampler.sample(_DRAWS, rng)
    turns = problem.encoding.draw_turns(len(positions), rng)
    return float(problem.feasible(problem.encoding.poses(np.hstack([positions, turns]))).mean())


def _or_dash(value: float) -> str:
    return f"{value:.0f}" if np.isfinite(value) else "-"


def main() -> None:
    """Run the comparison that the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--optimum", action="store_true", help="is the plan's optimum real?")
    parser.add_argument("--genetic", action="store_true", help="what the genetic algorithm brings")
    parser.add_argument("--sampling", action="store_true", help="what restricted sampling brings")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--csv", default=os.devnull, help="write every run to this file")
    arguments = parser.parse_args()
    with open(arguments.csv, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["case", "method", "seed", "fitness", "evaluated", "tried", "seconds"])
        if arguments.optimum:
            optimum(writer)
        elif arguments.genetic:
            genetic(arguments.seeds)
        elif arguments.sampling:
            sampling(arguments.seeds)
        else:
            compare(arguments.seeds, writer)


if __name__ == "__main__":
    main()
