"""One sensor setting for one set of entities: the paper's genetic search, section 4."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral

import numpy as np

from ga import GAResult, maximize
from planner.camera import Camera
from planner.constraints import Constraints, Requirements
from planner.encoding import PoseEncoding
from planner.exceptions import RequestError
from planner.explain import check_extent, check_observable, check_resolvable, explain_infeasible, explain_positions
from planner.objective import Objective
from planner.pose import PoseUncertainty
from planner.reach import Reach
from planner.refine import refine
from planner.sampling import ViewpointSampler, WorkspaceSampler
from planner.start import draw_start


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
        How many of the last population's best individuals are refined locally; 0 leaves the genetic algorithm's best.
    max_draws : int
        Most poses drawn for the first population before the least violating ones are repaired.
    sampling : {"covering", "workspace"}
        Where positions are drawn and encoded: in the covering domains where the lens can focus, or, for comparison, in
        the whole workspace.

    Raises
    ------
    RequestError
        If `refine_starts`, `max_draws` or `sampling` breaks its rule; the others are checked by `ga`.
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
    max_draws: int = 8192
    sampling: str = "covering"

    def __post_init__(self):
        if self.sampling not in ("covering", "workspace"):
            raise RequestError(f"sampling must be 'covering' or 'workspace'. Got {self.sampling!r}.")
        for name, least in (("refine_starts", 0), ("max_draws", 1)):
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
        }
        return cls(**{**plain, **changes})

    def ga_options(self) -> dict:
        """Return the keyword arguments of `ga.maximize`."""
        own = ("gene_bits", "gray_code", "refine_starts", "max_draws", "sampling")
        return {name: value for name, value in self.__dict__.items() if name not in own}


@dataclass(frozen=True, eq=False)
class SensorSetting:
    """A camera pose from which a set of entities is inspected.

    Attributes
    ----------
    cam2world : array (4, 4)
        Pose in OpenCV axes (x right, y down, z forward), mm, in the part's frame.
    entities : tuple of str
        Names of the inspected entities.
    probability : dict of str to float
        Per entity, the probability P that its measured length is within the accuracy.
    margins : dict of str to float
        Per constraint, the smallest margin over the entities; 0 or more is satisfied. The key ends with the unit.
    fitness : float
        What the search maximised: the sum (or the smallest) of the probabilities.
    nfev : int
        Poses evaluated by the search.
    generations : int
        Generations of the genetic algorithm.
    message : str
        Why the search stopped.
    seed : int or None
        Seed that repeats the run; None if a generator was passed in.
    history : tuple of float
        Best fitness after each generation.
    """

    cam2world: np.ndarray
    entities: tuple[str, ...]
    probability: dict[str, float]
    margins: dict[str, float]
    fitness: float
    nfev: int
    generations: int
    message: str
    seed: int | None = None
    history: tuple[float, ...] = field(default=(), repr=False)

    def __post_init__(self):
        pose = np.array(self.cam2world, dtype=np.float64)
        pose.setflags(write=False)
        object.__setattr__(self, "cam2world", pose)

    @property
    def position(self) -> np.ndarray:
        """Front nodal point (3,), mm."""
        return self.cam2world[:3, 3]

    def to_dict(self) -> dict:
        """Return the fields as plain Python values, ready for JSON."""
        return {
            "cam2world": self.cam2world.tolist(),
            "entities": list(self.entities),
            "probability": dict(self.probability),
            "margins": dict(self.margins),
            "fitness": self.fitness,
            "nfev": self.nfev,
            "generations": self.generations,
            "message": self.message,
            "seed": self.seed,
            "history": list(self.history),
        }

    @classmethod
    def from_dict(cls, data: Mapping) -> SensorSetting:
        """Build from the result of `to_dict`."""
        return cls(**{**data, "entities": tuple(data["entities"]), "history": tuple(data.get("history", ()))})

    def __eq__(self, other) -> bool:
        if not isinstance(other, SensorSetting):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None


def plan_setting(
    space,
    names: Sequence[str],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    *,
    accuracy: float = 0.98,
    rng: int | np.random.Generator | None = 0,
    stand_off_mm: float = 50.0,
    min_length_px: float = 20.0,
    field_margin_px: float | None = None,
    field_of_view: str = "exact",
    reach: Reach | None = None,
    objective: str = "sum",
    model: str = "joint",
    search: Search | None = None,
    callback: Callable | None = None,
) -> SensorSetting:
    """Find the pose from which a set of entities is inspected with the highest probability of success.

    Guarantee: the setting satisfies every constraint, every individual of every population lay in the covering domains,
    and the same arguments with the same integer `rng` give the same setting.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Where the entities are observable from.
    names : sequence of str
        The entities to inspect together.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far the camera's real pose may be from the planned one.
    accuracy : float
        Required accuracy A in (0, 1): an error of the fraction 1 − A of the length is allowed.
    rng : int, numpy.random.Generator or None
        Seed or source of chance; None takes a fresh seed, reported in the setting.
    stand_off_mm, min_length_px, field_of_view, reach
        Constraints, see `Requirements`.
    field_margin_px : float, optional
        Strip along the sensor's sides to keep free. Default: three standard deviations of how far the pose uncertainty
        moves the image of a point on the axis, so that no end leaves the image.
    objective : {"sum", "min"}
        Maximise the sum of the probabilities (the paper) or the smallest.
    model : str
        Error model, see `errors.success_probability`.
    search : Search, optional
        How to search; `Search.paper()` is the paper's plain algorithm.
    callback : callable, optional
        ``callback(ga.Generation)`` after every generation; a true return value stops the search.

    Returns
    -------
    SensorSetting
        The best setting found.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    InfeasibleError
        If no setting can be found that satisfies the constraints; it names constraint, entity and amount.
    """
    names, (rng, seed), search = check_names(space, names), _check_rng(rng), search or Search()
    if field_margin_px is None:
        field_margin_px = pose_margin_px(camera, pose_uncertainty)
    requirements = Requirements(min_length_px, field_margin_px, field_of_view, stand_off_mm, reach)
    constraints = Constraints(space, names, camera, requirements)
    goal = Objective(constraints.ends, camera, pose_uncertainty, accuracy, objective, model)
    check_resolvable(constraints)
    check_extent(constraints)
    cells = check_observable(space, names)
    sampler = ViewpointSampler(cells, constraints.ends, camera)
    if search.sampling == "workspace":
        sampler = WorkspaceSampler(cells, constraints.ends, camera, space.workspace)
    if sampler.empty:
        raise explain_positions(constraints, cells, rng)
    encoding = PoseEncoding(
        sampler.bounds, constraints.sphere_center, camera.half_diagonal_rad, search.gene_bits, search.gray_code
    )
    start = draw_start(search.population, sampler, encoding, constraints, rng, search.max_draws)
    if not len(start.bits):
        if not len(start.tried):
            raise explain_positions(constraints, cells, rng)
        raise explain_infeasible(constraints, encoding, start.tried, rng)
    result = maximize(
        lambda bits: goal.fitness(encoding.decode(bits)),
        encoding.n_bits,
        feasible=lambda bits: constraints.feasible(encoding.decode(bits)),
        initial=np.resize(start.bits, (search.population, encoding.n_bits)),
        rng=rng,
        callback=callback,
        **search.ga_options(),
    )
    pose, fitness, nfev = _refine_best(result, sampler, encoding, goal, constraints, search.refine_starts)
    return _describe(pose, fitness, result, nfev, goal, constraints, seed)


def pose_margin_px(camera: Camera, pose_uncertainty: PoseUncertainty) -> float:
    """Return three standard deviations, in px, of how far the pose uncertainty moves the image of a point.

    The point is on the optical axis at the focus distance; the axis with the finer pitch or larger spread counts.
    """
    d, s = camera.image_distance_mm, camera.focus_distance_mm
    # a camera moved by dx and turned by phi_y about its nodal point moves the image of (0, 0, s) by −d·(dx/s + phi_y)
    rows = np.array([[1 / s, 0, 0, 0, 1, 0], [0, 1 / s, 0, -1, 0, 0]]) * (d / np.array(camera.pixel_pitch_mm))[:, None]
    variances = np.diag(rows @ pose_uncertainty.covariance @ rows.T)
    return 3.0 * math.sqrt(max(variances.max(), 0.0))


def check_names(space, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names as a tuple, or raise `RequestError` if there are none, one is unknown or one comes twice."""
    names = (names,) if isinstance(names, str) else tuple(names)
    if not names:
        raise RequestError("names must hold at least one entity. Got none.")
    for name in names:
        if name not in space.entities:
            raise RequestError(f"names must be entities ({', '.join(map(str, space.entity_names))}). Got {name!r}.")
        if names.count(name) > 1:
            raise RequestError(f"names must be different. Got {name!r} twice.")
    return names


def _check_rng(rng) -> tuple[np.random.Generator, int | None]:
    if isinstance(rng, np.random.Generator):
        return rng, None
    if rng is None:
        rng = int(np.random.SeedSequence().generate_state(1)[0])
    if not isinstance(rng, Integral) or isinstance(rng, bool) or rng < 0:
        raise RequestError(f"rng must be a non-negative integer, a numpy Generator or None. Got {rng!r}.")
    return np.random.default_rng(int(rng)), int(rng)


def _refine_best(
    result: GAResult,
    sampler: ViewpointSampler,
    encoding: PoseEncoding,
    goal: Objective,
    constraints: Constraints,
    starts: int,
) -> tuple[np.ndarray, float, int]:
    """Refine the best individuals of a run; return pose, fitness and the poses evaluated."""
    best, fitness, nfev = encoding.decode(result.x[None])[0], result.fun, result.nfev
    bits = np.vstack([result.x, result.population[np.argsort(-result.fitness, kind="stable")]])
    distinct = np.sort(np.unique(bits, axis=0, return_index=True)[1])[:starts]
    for pose in encoding.decode(bits[distinct]):
        half_spaces = sampler.cell_of(pose[:3, 3])
        if half_spaces is None:
            continue
        refined, value, evaluated = refine(pose, half_spaces, goal, constraints)
        nfev += evaluated
        if value > fitness:
            best, fitness = refined, value
    return best, fitness, nfev


def _describe(
    pose: np.ndarray,
    fitness: float,
    result: GAResult,
    nfev: int,
    goal: Objective,
    constraints: Constraints,
    seed: int | None,
) -> SensorSetting:
    """Gather what is known of a pose (4, 4)."""
    probability = goal.probability(pose[None])[0]
    return SensorSetting(
        cam2world=pose,
        entities=constraints.names,
        probability={name: float(p) for name, p in zip(constraints.names, probability, strict=True)},
        margins={name: float(margin.min()) for name, margin in constraints.margins(pose[None]).items()},
        fitness=float(fitness),
        nfev=int(nfev),
        generations=int(result.nit),
        message=result.message,
        seed=seed,
        history=tuple(result.history.best_so_far.tolist()),
    )
