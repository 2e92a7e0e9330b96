"""The search for one pose: restricted sampling, the genetic algorithm, local refinement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral

import numpy as np

from ga import GAResult, maximize
from planner.constraints import Constraints
from planner.encoding import PoseEncoding
from planner.exceptions import RequestError
from planner.explain import explain_infeasible, explain_positions
from planner.objective import Objective
from planner.refine import refine
from planner.sampling import ViewpointSampler, WorkspaceSampler
from planner.start import draw_start

_APART = 0.1
_ONWARD_STARTS = 3
_ONWARD_SHARE = 0.99
_ONWARD_ROUNDS = 5
_ONWARD_GAIN = 1e-6
# no pose is worth improving that misses the largest fitness there can be by so little, as a share
_PERFECT = 1e-5


@dataclass(frozen=True)
class Search:
    """How the pose is searched; see `ga.maximize` for the genetic algorithm's parameters.

    Parameters
    ----------
    population, crossover, mutation, elitism, selection, scaling
        Passed to `ga.maximize`, which describes them.
    epsilon, patience, max_stall, max_generations, max_nfev
        When to stop; also passed on.
    gene_bits : int
        Bits per gene (M).
    gray_code : bool
        Gray code instead of plain binary.
    refine_starts : int
        How many of the last population's best individuals, apart from each other, are refined locally; 0 leaves the
        genetic algorithm's best.
    spread_starts : int
        How many of the first population's individuals, the best around positions as far from each other as can be, are
        refined too: they reach optima that the population has left behind.
    max_draws : int
        Most poses drawn for the first population before the least violating ones are repaired.
    stop_at_perfect : bool
        Whether to end when all probabilities are 1 but for 0.001 %, as no pose can be better.
    sampling : {"covering", "workspace"}
        Where positions are drawn and encoded: in the covering domains where the lens can focus, or, for comparison, in
        the whole workspace.

    Raises
    ------
    RequestError
        If `refine_starts`, `spread_starts`, `max_draws` or `sampling` breaks its rule; the others are checked by `ga`.
    """

    population: int = 100
    crossover: float = 0.9
    mutation: float = 0.1
    elitism: int = 2
    selection: str = "roulette"
    scaling: str = "window"
    epsilon: float = 1e-3
    patience: int = 5
    max_stall: int | None = 15
    max_generations: int = 100
    max_nfev: int | None = None
    gene_bits: int = 16
    gray_code: bool = True
    refine_starts: int = 3
    spread_starts: int = 8
    max_draws: int = 8192
    stop_at_perfect: bool = True
    sampling: str = "covering"

    def __post_init__(self):
        if self.sampling not in ("covering", "workspace"):
            raise RequestError(f"sampling must be 'covering' or 'workspace'. Got {self.sampling!r}.")
        for name, least in (("refine_starts", 0), ("spread_starts", 0), ("max_draws", 1)):
            if not isinstance(getattr(self, name), Integral) or getattr(self, name) < least:
                raise RequestError(f"{name} must be an integer of at least {least}. Got {getattr(self, name)!r}.")

    @classmethod
    def paper(cls, **changes) -> Search:
        """Return the paper's plain algorithm: raw fitness, plain binary, no elitism, no refinement, no early end."""
        plain = {
            "elitism": 0,
            "scaling": "proportional",
            "max_stall": None,
            "max_generations": 1000,
            "gray_code": False,
            "refine_starts": 0,
            "spread_starts": 0,
            "stop_at_perfect": False,
        }
        return cls(**{**plain, **changes})

    def ga_options(self) -> dict:
        """Return the keyword arguments of `ga.maximize`."""
        own = ("gene_bits", "gray_code", "refine_starts", "spread_starts", "max_draws", "stop_at_perfect", "sampling")
        return {name: value for name, value in self.__dict__.items() if name not in own}


@dataclass(frozen=True)
class Outcome:
    """The best pose of a search (4, 4), its fitness, and how the search went; see `SensorSetting` for the fields."""

    cam2world: np.ndarray
    fitness: float
    nfev: int
    generations: int
    message: str
    history: tuple[float, ...]


def search_pose(
    cells,
    constraints: Constraints,
    objective: Objective,
    search: Search,
    rng: np.random.Generator,
    known: np.ndarray | None = None,
    callback: Callable | None = None,
) -> Outcome:
    """Search the best pose in the covering domains.

    Parameters
    ----------
    cells : CellSet
        The covering domains.
    constraints, objective : Constraints, Objective
        What must hold, and what is maximised.
    search : Search
        How to search.
    rng : numpy.random.Generator
        Source of chance.
    known : array (m, 4, 4), optional
        Poses to begin with; the outcome is never worse than the best feasible one of them.
    callback : callable, optional
        See `ga.maximize`.

    Raises
    ------
    InfeasibleError
        If no feasible pose is found; it says why.
    """
    known = np.empty((0, 4, 4)) if known is None else known
    sampler = ViewpointSampler(cells, constraints.ends, constraints.camera)
    if search.sampling == "workspace":
        sampler = WorkspaceSampler(cells, constraints.ends, constraints.camera, constraints.space.workspace)
    if sampler.empty:
        raise explain_positions(constraints, cells, rng)
    turn = constraints.camera.half_diagonal_rad
    encoding = PoseEncoding(sampler.bounds, constraints.sphere_center, turn, search.gene_bits, search.gray_code)
    start = draw_start(search.population, sampler, encoding, constraints, rng, search.max_draws, known)
    known = known[constraints.feasible(known)]
    if len(start.bits):
        result = _evolve(start.bits, encoding, constraints, objective, search, rng, callback)
        outcome = _outcome(result, encoding)
        best = encoding.decode(_best_apart(result, encoding, search.refine_starts))
        first = encoding.decode(start.bits)
        poses = np.concatenate([best, _spread(first, objective.fitness(first), search.spread_starts), known])
    elif len(known):
        # feasible only between the steps of the encoding: what is left is to refine
        outcome = Outcome(known[0], -np.inf, 0, 0, "No encoded pose is feasible; the known poses were refined.", ())
        poses = known
    else:
        raise (
            explain_infeasible(constraints, encoding, start.tried, rng)
            if len(start.tried)
            else explain_positions(constraints, cells, rng)
        )
    return _refine_all(
        outcome, poses, sampler, objective, constraints, refining=search.refine_starts + search.spread_starts > 0
    )


def _evolve(bits, encoding, constraints, objective, search: Search, rng, callback) -> GAResult:
    """Run the genetic algorithm from feasible chromosomes; too few of them are repeated."""
    return maximize(
        lambda population: objective.fitness(encoding.decode(population)),
        encoding.n_bits,
        feasible=lambda population: constraints.feasible(encoding.decode(population)),
        initial=np.resize(bits, (search.population, encoding.n_bits)),
        rng=rng,
        callback=callback,
        target=_enough(objective) if search.stop_at_perfect else None,
        **search.ga_options(),
    )


def _outcome(result: GAResult, encoding: PoseEncoding) -> Outcome:
    history = tuple(result.history.best_so_far.tolist())
    pose = encoding.decode(result.x[None])[0]
    return Outcome(pose, float(result.fun), int(result.nfev), int(result.nit), result.message, history)


def _best_apart(result: GAResult, encoding: PoseEncoding, n: int) -> np.ndarray:
    """Return the best bits ever and the best of the last population that are apart from each other; up to n rows.

    Apart means by a tenth of some parameter's range: neighbours would be refined to the same optimum.
    """
    bits = np.vstack([result.x, result.population[np.argsort(-result.fitness, kind="stable")]])
    places = encoding.parameters(bits) / np.where(encoding.high > encoding.low, encoding.high - encoding.low, 1.0)
    chosen: list[int] = []
    for i in range(len(bits)):
        if len(chosen) < n and np.all(np.abs(places[chosen] - places[i]).max(axis=1, initial=0.0) > _APART):
            chosen.append(i)
    return bits[chosen]


def _spread(poses: np.ndarray, fitness: np.ndarray, n: int) -> np.ndarray:
    """Return up to n of the poses (m, 4, 4): the best of each group around positions as far apart as can be."""
    positions = poses[:, :3, 3]
    centers = [int(fitness.argmax())][:n]
    distance = np.linalg.norm(positions - positions[centers].sum(axis=0), axis=1)
    group = np.zeros(len(poses), dtype=int)
    while len(centers) < n and distance.max() > 0:
        centers.append(int(distance.argmax()))
        to_new = np.linalg.norm(positions - positions[centers[-1]], axis=1)
        group[to_new < distance] = len(centers) - 1
        distance = np.minimum(distance, to_new)
    members = [np.flatnonzero(group == g) for g in range(len(centers))]
    return poses[[own[fitness[own].argmax()] for own in members]]


def _enough(objective: Objective) -> float:
    return objective.highest * (1.0 - _PERFECT)


def _refine_all(outcome: Outcome, poses, sampler, objective, constraints, refining: bool) -> Outcome:
    """Refine poses (m, 4, 4) and return the outcome with the best pose of all."""
    best, fitness, nfev = outcome.cam2world, outcome.fitness, outcome.nfev + len(poses)
    values = objective.fitness(poses)
    if len(poses) and values.max() > fitness:
        best, fitness = poses[values.argmax()], float(values.max())
    enough = _enough(objective)
    refined = [(fitness, best)]
    for pose in poses if refining else ():
        half_spaces = sampler.cell_of(pose[:3, 3])
        if fitness < enough and half_spaces is not None:
            pose, value, evaluated = refine(pose, half_spaces, objective, constraints)
            nfev += evaluated
            refined.append((value, pose))
            fitness = max(fitness, value)
    # on into neighbouring cells: without walls, as far along the way as all constraints hold
    for value, pose in _different(refined, constraints) if refining and fitness < enough else ():
        value, pose, evaluated = _onward(value, pose, objective, constraints)
        nfev += evaluated
        refined.append((value, pose))
    fitness, best = max(refined, key=lambda found: found[0])
    return Outcome(best, fitness, nfev, outcome.generations, outcome.message, outcome.history)


def _different(refined: list, constraints: Constraints) -> list:
    """Return the best few of (fitness, pose), nearly equally good and with positions apart."""
    chosen: list = []
    ranked = sorted(refined, key=lambda found: -found[0])
    for value, pose in ranked:
        if value < _ONWARD_SHARE * ranked[0][0]:
            break
        far = _APART * np.linalg.norm(pose[:3, 3] - constraints.sphere_center)
        if len(chosen) < _ONWARD_STARTS and all(np.linalg.norm(pose[:3, 3] - p[:3, 3]) > far for _, p in chosen):
            chosen.append((value, pose))
    return chosen


def _onward(fitness: float, best, objective, constraints) -> tuple[float, np.ndarray, int]:
    """Refine a pose again and again while it gains; return fitness, pose and poses evaluated."""
    nfev = 0
    for _ in range(_ONWARD_ROUNDS):
        pose, value, evaluated = refine(best, np.empty((0, 4)), objective, constraints)
        nfev += evaluated
        if value <= fitness * (1.0 + _ONWARD_GAIN):
            break
        best, fitness = pose, value
    return fitness, best, nfev
