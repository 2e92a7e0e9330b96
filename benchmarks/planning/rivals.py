"""The planner's search and its rivals on one and the same problem: best pose for a set of entities.

Every method sees the unit cube of the planner's own six parameters (position in the box around the covering domains,
pan, tilt, roll), begins from the same kind of poses (drawn in the covering domains, half of them looking straight
at the entities), and has its evaluations counted in the same place. Constraints:

* genetic algorithm: infeasible offspring are eliminated before they are evaluated, as in the paper;
* differential evolution, CMA-ES, random search: a feasible pose costs −fitness, an infeasible one the sum of its scaled
  violations, which is never below 0. So feasible is always better (K. Deb, 2000), and, as for the genetic algorithm, an
  infeasible pose uses up none of the budget of fitness evaluations. It does count as tried, and a method that tries
  20 times its budget is stopped;
* SLSQP: −fitness + μ · violation, μ = 1 and then 100, from random starts: the paper's "traditional nonlinear
  programming". Here infeasible poses are evaluated, and count.
"""

from __future__ import annotations

import time
import warnings
from contextlib import suppress
from dataclasses import dataclass

import cma
import numpy as np
from cases import SETUPS, regions
from scipy.optimize import differential_evolution, minimize

from planner import Search
from planner.request.camera_limits import position_margin_mm
from planner.request.constraints import Constraints, Requirements
from planner.request.models import Means
from planner.request.problem import Objective
from planner.search.plan_setting import search_pose
from planner.search.poses import PoseEncoding, ViewpointSampler, draw_start

_TRIES_PER_EVALUATION = 20
_STEP = 1e-4


class BudgetSpent(Exception):
    """Raised inside a method when it has used its evaluations."""


@dataclass(frozen=True)
class Run:
    """Best fitness, fitness evaluations, poses tried (constraints checked) and seconds of processor time of one run."""

    fitness: float
    evaluated: int
    tried: int
    seconds: float


class Problem:
    """One set of entities as an optimisation problem, with counters.

    Parameters
    ----------
    setup : str
        Key of `cases.SETUPS`.
    names : tuple of str
        The entities.
    """

    def __init__(self, setup: str, names):
        chosen = SETUPS[setup]
        self.space = regions(setup)
        self.camera = SETUPS[setup].camera()
        need = Requirements(
            field_margin_px=chosen.field_margin_px,
            visibility_radius_mm=position_margin_mm(chosen.pose_uncertainty),
        )
        self.constraints = Constraints(self.space, names, self.camera, need)
        self.goal = Objective(
            self.constraints.targets,
            Means(self.camera, chosen.pose_uncertainty, chosen.accuracy),
        )
        self.cells = self.space.covering_cells(names)
        self.sampler = ViewpointSampler(self.cells, self.constraints.ends, self.camera)
        self.encoding = PoseEncoding(
            self.sampler.bounds, self.constraints.sphere_centre, self.camera.half_diagonal_rad
        )
        self._fitness = self.goal.fitness
        self._feasible = self.constraints.feasible
        # the planner's own search goes through the same two counters as its rivals
        self.goal.fitness = self.fitness
        self.constraints.feasible = self.feasible
        self.begin()

    def begin(self, budget: float = np.inf) -> None:
        """Set the counters back; a rival may evaluate `budget` poses."""
        self.budget = budget
        self.evaluated = 0
        self.tried = 0
        self.best = -np.inf

    def fitness(self, poses: np.ndarray) -> np.ndarray:
        """Return and count the fitness of poses (n, 4, 4)."""
        self.evaluated += len(poses)
        return self._fitness(poses)

    def feasible(self, poses: np.ndarray) -> np.ndarray:
        """Return which poses are feasible, and count them as tried."""
        self.tried += len(poses)
        return self._feasible(poses)

    def poses(self, x: np.ndarray) -> np.ndarray:
        """Return the poses of points (n, 6) of the unit cube."""
        low = self.encoding.low
        high = self.encoding.high
        return self.encoding.poses(low + np.clip(x, 0.0, 1.0) * (high - low))

    def draw(self, n: int, rng) -> np.ndarray:
        """Draw points (n, 6) in the covering domains, feasible or not."""
        positions = self.sampler.sample(n, rng)
        parameters = np.hstack([positions, self.encoding.draw_turns(len(positions), rng)])
        return (parameters - self.encoding.low) / (self.encoding.high - self.encoding.low)

    def start(self, n: int, rng) -> np.ndarray:
        """Draw n feasible points (n, 6), the same way as the planner's first population."""
        bits = draw_start(n, self.sampler, self.encoding, self.constraints, rng).bits
        return self.encoding.chromosome.decode(np.resize(bits, (n, self.encoding.n_bits)), 0.0, 1.0)

    def cost(self, x: np.ndarray) -> np.ndarray:
        """Return −fitness of feasible points and the violation of others; (n,)."""
        self._stop_if_spent()
        poses = self.poses(np.atleast_2d(x))
        inside = self.feasible(poses)
        cost = np.empty(len(poses))
        within = np.flatnonzero(inside)[: int(min(self.budget - self.evaluated, len(poses)))]
        cost[inside] = 0.0
        cost[within] = -self.fitness(poses[within]) if len(within) else 0.0
        self.best = max(self.best, -cost[within].min(initial=np.inf))
        if not inside.all():
            cost[~inside] = self.constraints.violation(poses[~inside])
        return cost

    def penalised(self, x: np.ndarray, weight: float) -> np.ndarray:
        """Return −fitness + weight · violation of points (n, 6); (n,)."""
        self._stop_if_spent()
        poses = self.poses(x)
        violation = self.constraints.violation(poses)
        inside = self.feasible(poses)
        fitness = np.zeros(len(poses))
        # seen from its end an entity has no image, and no probability of measuring it
        slacks = self.constraints.slacks(poses, ["resolution_mm"])["resolution_mm"]
        imaged = (slacks > -0.999 * self.constraints.min_length_mm).all(axis=(1, 2))
        self.evaluated += int((~imaged).sum())
        fitness[imaged] = self.fitness(poses[imaged]) if imaged.any() else 0.0
        self.best = max(self.best, fitness[inside].max(initial=-np.inf))
        return weight * violation - fitness

    def _stop_if_spent(self) -> None:
        if self.evaluated >= self.budget or self.tried >= _TRIES_PER_EVALUATION * self.budget:
            raise BudgetSpent


def genetic(search: Search):
    """Return a method that runs the planner's search; `budget` caps its genetic algorithm if it is finite."""

    def method(problem: Problem, rng, budget):
        options = (
            search if np.isinf(budget) else Search(**{**search.__dict__, "max_nfev": int(budget)})
        )
        problem.best = search_pose(
            problem.cells, problem.constraints, problem.goal, options, rng
        ).fitness

    return method


def random_search(problem: Problem, rng, budget):
    """Draw in the covering domains."""
    while True:
        problem.cost(problem.draw(512, rng))


def samples(problem: Problem, rng, budget):
    """Draw 10⁵ poses in the covering domains, whatever the budget."""
    for _ in range(50):
        problem.cost(problem.draw(2000, rng))


def evolution(problem: Problem, rng, budget):
    """Differential evolution of SciPy, anew from other poses when the population has settled."""
    while True:
        differential_evolution(
            lambda x: problem.cost(x.T),
            [(0.0, 1.0)] * 6,
            init=problem.start(60, rng),
            maxiter=10**6,
            tol=1e-7,
            polish=False,
            vectorized=True,
            updating="deferred",
            seed=rng,
        )


def cma_es(problem: Problem, rng, budget):
    """CMA-ES from a feasible pose; anew from another one with up to eight times the population when it has settled."""
    restart = 0
    while True:
        options = {
            "bounds": [0.0, 1.0],
            "popsize": 16 * 2 ** (restart % 4),
            "seed": int(rng.integers(1, 2**31)),
            "verbose": -9,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            strategy = cma.CMAEvolutionStrategy(problem.start(1, rng)[0], 0.15, options)
            while not strategy.stop():
                points = strategy.ask()
                strategy.tell(points, problem.cost(np.array(points)).tolist())
        restart += 1


def penalty_slsqp(problem: Problem, rng, budget):
    """Penalty method: SLSQP with a light and then a heavy penalty, from one random pose after the other."""
    around = np.vstack([np.zeros(6), _STEP * np.eye(6), -_STEP * np.eye(6)])

    def with_gradient(x, weight):
        values = problem.penalised(x + around, weight)
        return values[0], (values[1:7] - values[7:]) / (2 * _STEP)

    while True:
        x = np.clip(problem.draw(1, rng)[0], 0.0, 1.0)
        for weight in (1.0, 100.0):
            x = minimize(
                with_gradient, x, (weight,), jac=True, bounds=[(0.0, 1.0)] * 6, method="SLSQP"
            ).x


def run(problem: Problem, method, seed: int, budget: float = np.inf) -> Run:
    """Run a method once and return what it reached."""
    problem.begin(budget)
    start = time.process_time()
    with suppress(BudgetSpent):
        method(problem, np.random.default_rng(seed), budget)
    return Run(problem.best, problem.evaluated, problem.tried, time.process_time() - start)


_UNLIMITED = {"max_stall": None, "epsilon": 0.0, "max_generations": 10**6}

OURS = genetic(Search())
RIVALS = {
    "GA without refinement": genetic(Search.genetic(**_UNLIMITED)),
    "GA, paper-plain": genetic(Search.paper(**_UNLIMITED)),
    "differential evolution": evolution,
    "CMA-ES": cma_es,
    "SLSQP with penalty": penalty_slsqp,
    "random search": random_search,
}
