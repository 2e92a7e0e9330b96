"""The search for one pose: restricted sampling, the genetic algorithm, local refinement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ga import GAResult, maximize
from planner.effort.poses import Search
from planner.request.constraints import Constraints
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
    sampler = _sampler(cells, constraints, search)
    if sampler.empty:
        raise explain_positions(constraints, cells, rng)
    turn = constraints.camera.half_diagonal_rad
    encoding = PoseEncoding(
        sampler.bounds, constraints.sphere_centre, turn, search.gene_bits, search.gray_code
    )
    start = draw_start(
        search.population,
        sampler,
        encoding,
        constraints,
        rng,
        search.max_draws,
        known,
        search.repair,
    )
    known = known[constraints.feasible(known)]
    if len(start.bits):
        result = _evolve(start.bits, encoding, constraints, objective, search, rng, callback)
        outcome = _outcome(result, encoding)
    elif len(known):
        # feasible only between the steps of the encoding: what is left is to refine
        result = None
        message = "No encoded pose is feasible; the known poses were refined."
        outcome = FoundPose(known[0], -np.inf, 0, 0, message, ())
    else:
        if not len(start.tried):
            raise explain_positions(constraints, cells, rng)
        source = rng if search.explain else None
        raise explain_infeasible(constraints, encoding, start.tried, source)
    ascent = Ascent(
        sampler,
        encoding,
        objective,
        constraints,
        _enough(objective),
        outcome.cam2world,
        outcome.fitness,
        search=search,
    )
    ascent.consider(known)
    if search.refines and ascent.fitness < ascent.enough:
        ascent.climb(np.concatenate([_starts(result, start.bits, ascent, search, rng), known]))
        ascent.mirror()
    nfev = outcome.nfev + ascent.nfev
    return replace(outcome, cam2world=ascent.cam2world, fitness=ascent.fitness, nfev=nfev)


def _sampler(cells: CellSet, constraints: Constraints, search: Search) -> ViewpointSampler:
    """Return where positions are drawn."""
    if search.sampling != "workspace":
        return ViewpointSampler(cells, constraints.ends, constraints.camera)
    workspace = constraints.space.workspace
    return WorkspaceSampler(cells, constraints.ends, constraints.camera, workspace)


def _starts(
    result: GAResult | None,
    first: np.ndarray,
    ascent: Ascent,
    search: Search,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the poses (m, 4, 4) to refine from, given how the genetic algorithm ended and its first chromosomes."""
    encoding = ascent.encoding
    poses = [
        turned_views(search.turned_starts, ascent.sampler, ascent.encoding, rng, search.starts)
    ]
    if result is not None:
        bits = np.vstack([result.x, result.population])
        fitness = np.append(result.fun, result.fitness)
        best = best_apart(bits, fitness, encoding, search.refine_starts, search.starts)
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
