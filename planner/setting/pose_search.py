"""The search for one pose: restricted sampling, the genetic algorithm, local refinement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ga import GAResult, maximize
from planner.exceptions import RequestError
from planner.request.constraints import Constraints
from planner.request.defaults import check_count
from planner.request.objective import Objective
from planner.setting.first_poses import draw_start
from planner.setting.infeasible import explain_infeasible, explain_positions
from planner.setting.multistart import Ascent, best_apart, best_around, turned_views
from planner.setting.pose_bits import PoseEncoding
from planner.setting.viewpoint_sampling import ViewpointSampler, WorkspaceSampler

if TYPE_CHECKING:
    from aspectgraph import CellSet

# no pose is worth improving that misses the largest fitness there can be by so little, as a share
_PERFECT = 1e-5
_STARTS = ("refine_starts", "spread_starts", "turned_starts")


@dataclass(frozen=True)
class Search:
    """How the pose is searched; see `ga.maximize` for the genetic algorithm's parameters.

    Parameters
    ----------
    population : int
        Individuals in every generation (N).
    crossover : float
        Probability P_c that a couple is crossed.
    mutation : float
        Probability P_m that a bit flips.
    elitism : int
        How many of the best pass unchanged to the next generation.
    selection : {"roulette", "sus"}
        How parents are drawn.
    scaling : {"proportional", "window", "rank"}
        Slots of the wheel.
    attempts : int
        Offspring drawn for a place at most.
    epsilon : float
        Converged when the total fitness changes by less than this in `patience` generations running.
    patience : int
        Generations for `epsilon`.
    max_stall : int, optional
        Also stop when the best fitness has not improved in so many generations.
    max_generations : int
        Cap on generations.
    max_nfev : int, optional
        Cap on the individuals that the genetic algorithm evaluates.
    gene_bits : int
        Bits per gene (M).
    gray_code : bool
        Gray code instead of plain binary.
    refine_starts : int
        How many of the last population's best individuals, apart from each other, to refine from.
    spread_starts : int
        How many of the first population's individuals, the best around positions as far from each other as can be, to
        refine from: they reach optima that the population has left behind.
    turned_starts : int
        How many poses to refine from that are drawn in the covering domains with the view turned, feasible or not.
        Without starts of any kind nothing is refined: the genetic algorithm's best is the outcome.
    max_draws : int
        Most poses drawn for the first population before the least violating ones are repaired.
    stop_at_perfect : bool
        Whether to end when all probabilities are 1 but for 0.001 %, as no pose can be better.
    explain : bool
        Whether to search for what it is that no pose meets, if none meets all; else the nearest pose is told of.
    sampling : {"covering", "workspace"}
        Where positions are drawn and encoded: in the covering domains where the lens can focus, or, for comparison, in
        the whole workspace.

    Raises
    ------
    RequestError
        If a number of starts, `max_draws` or `sampling` breaks its rule; the others are checked by `ga`.

    Examples
    --------
    >>> from planner import Search
    >>> Search(population=50).population
    50
    """

    population: int = 100
    crossover: float = 0.9
    mutation: float = 0.1
    elitism: int = 2
    selection: str = "roulette"
    scaling: str = "window"
    attempts: int = 6
    epsilon: float = 1e-3
    patience: int = 5
    max_stall: int | None = 8
    max_generations: int = 50
    max_nfev: int | None = None
    gene_bits: int = 16
    gray_code: bool = True
    refine_starts: int = 3
    spread_starts: int = 5
    turned_starts: int = 10
    max_draws: int = 8192
    stop_at_perfect: bool = True
    explain: bool = True
    sampling: str = "covering"

    def __post_init__(self) -> None:
        if self.sampling not in ("covering", "workspace"):
            raise RequestError(
                f"sampling must be 'covering' or 'workspace'. Got {self.sampling!r}."
            )
        for name, least in (
            ("refine_starts", 0),
            ("spread_starts", 0),
            ("turned_starts", 0),
            ("max_draws", 1),
        ):
            check_count(name, getattr(self, name), least)

    @classmethod
    def genetic(cls, **changes: Any) -> Search:
        """Choose the default genetic algorithm alone, without refinement.

        Parameters
        ----------
        **changes : int, float, bool or str
            Fields to set otherwise.

        Returns
        -------
        Search
            With no starts of any kind to refine from, unless changed.

        Raises
        ------
        RequestError
            If a field breaks its rule.
        """
        return cls(**{**dict.fromkeys(_STARTS, 0), **changes})

    @classmethod
    def paper(cls, **changes: Any) -> Search:
        """Choose the paper's plain algorithm: raw fitness, plain binary, no elitism, no refinement, no early end.

        Parameters
        ----------
        **changes : int, float, bool or str
            Fields to set otherwise.

        Returns
        -------
        Search
            The paper's choices, unless changed.

        Raises
        ------
        RequestError
            If a field breaks its rule.
        """
        plain = {
            "elitism": 0,
            "scaling": "proportional",
            "max_stall": None,
            "max_generations": 1000,
            "gray_code": False,
            "attempts": 20,
            "stop_at_perfect": False,
        }
        return cls.genetic(**{**plain, **changes})

    @property
    def refines(self) -> bool:
        """Whether there is any local refinement."""
        return any(getattr(self, name) for name in _STARTS)

    def ga_options(self) -> dict[str, Any]:
        """Return the keyword arguments of `ga.maximize`.

        Returns
        -------
        dict
            Those of the fields that `ga.maximize` takes.
        """
        own = (
            "gene_bits",
            "gray_code",
            "max_draws",
            "stop_at_perfect",
            "explain",
            "sampling",
            *_STARTS,
        )
        return {name: value for name, value in self.__dict__.items() if name not in own}


@dataclass(frozen=True)
class FoundPose:
    """The best pose of a search (4, 4), its fitness, and how the search went; see `SensorSetting` for the fields."""

    cam2world: np.ndarray
    fitness: float
    nfev: int
    generations: int
    message: str
    history: tuple[float, ...]


def search_pose(
    cells: CellSet,
    constraints: Constraints,
    objective: Objective,
    search: Search,
    rng: np.random.Generator,
    known: np.ndarray | None = None,
    callback: Callable[..., Any] | None = None,
) -> FoundPose:
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
        sampler = WorkspaceSampler(
            cells, constraints.ends, constraints.camera, constraints.space.workspace
        )
    if sampler.empty:
        raise explain_positions(constraints, cells, rng)
    turn = constraints.camera.half_diagonal_rad
    encoding = PoseEncoding(
        sampler.bounds, constraints.sphere_centre, turn, search.gene_bits, search.gray_code
    )
    start = draw_start(
        search.population, sampler, encoding, constraints, rng, search.max_draws, known
    )
    known = known[constraints.feasible(known)]
    if len(start.bits):
        result = _evolve(start.bits, encoding, constraints, objective, search, rng, callback)
        outcome = _outcome(result, encoding)
    elif len(known):
        # feasible only between the steps of the encoding: what is left is to refine
        result = None
        outcome = FoundPose(
            known[0],
            -np.inf,
            0,
            0,
            "No encoded pose is feasible; the known poses were refined.",
            (),
        )
    else:
        raise (
            explain_infeasible(constraints, encoding, start.tried, rng if search.explain else None)
            if len(start.tried)
            else explain_positions(constraints, cells, rng)
        )
    ascent = Ascent(
        sampler,
        encoding,
        objective,
        constraints,
        _enough(objective),
        outcome.cam2world,
        outcome.fitness,
    )
    ascent.consider(known)
    if search.refines and ascent.fitness < ascent.enough:
        ascent.climb(np.concatenate([_starts(result, start.bits, ascent, search, rng), known]))
        ascent.mirror()
    nfev = outcome.nfev + ascent.nfev
    return replace(outcome, cam2world=ascent.cam2world, fitness=ascent.fitness, nfev=nfev)


def _starts(
    result: GAResult | None,
    first: np.ndarray,
    ascent: Ascent,
    search: Search,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the poses (m, 4, 4) to refine from, given how the genetic algorithm ended and its first chromosomes."""
    encoding = ascent.encoding
    poses = [turned_views(search.turned_starts, ascent.sampler, ascent.encoding, rng)]
    if result is not None:
        bits = np.vstack([result.x, result.population])
        fitness = np.append(result.fun, result.fitness)
        best = best_apart(bits, fitness, encoding, search.refine_starts)
        first = encoding.decode(first)
        poses += [
            encoding.decode(best),
            best_around(first, ascent.objective.fitness(first), search.spread_starts),
        ]
        ascent.nfev += len(first)
    return np.concatenate(poses)


def _evolve(
    bits: np.ndarray,
    encoding: PoseEncoding,
    constraints: Constraints,
    objective: Objective,
    search: Search,
    rng: np.random.Generator,
    callback: Callable[..., Any] | None,
) -> GAResult:
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


def _outcome(result: GAResult, encoding: PoseEncoding) -> FoundPose:
    history = tuple(result.history.best_so_far.tolist())
    pose = encoding.decode(result.x[None])[0]
    return FoundPose(
        pose, float(result.fun), int(result.nfev), int(result.nit), result.message, history
    )


def _enough(objective: Objective) -> float:
    return objective.highest * (1.0 - _PERFECT)
