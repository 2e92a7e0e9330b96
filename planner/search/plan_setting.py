"""One sensor setting for one set of entities: the paper's genetic search, section 4."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from errors.model import Model
from ga import GAResult, maximize
from ga.exceptions import InfeasiblePopulationError
from planner.argument_kinds import ITEMS, check_kinds, check_space, suggests_names
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.detectability.conditions import NOT_ASKED, Detectability
from planner.effort import Search
from planner.exceptions import InfeasibleError, RequestError
from planner.request.camera_limits import (
    check_focus_margin,
    check_showing,
    focus_reach_mm,
    longest_image_mm,
    pose_margin_px,
    position_margin_mm,
    widest_view_mm,
)
from planner.request.constraints import Constraints, FieldOfView, Requirements
from planner.request.problem import Objective, ObjectiveKind, Problem, why_missed
from planner.request.reach import Reach, Space, TargetSpace, cells_of, entity_space
from planner.request.targets import check_is_edge
from planner.search.poses import (
    Ascent,
    PoseEncoding,
    ViewpointSampler,
    WorkspaceSampler,
    best_apart,
    best_around,
    draw_start,
    neighbours,
    turned_views,
)
from planner.sensor_setting import SensorSetting

if TYPE_CHECKING:
    from aspectgraph import CellSet

# Why a request is not met: which constraint, for which entity, by how much.
#
# "Cannot be met" is proven. "No tried pose meets" is the result of a search.


_UNITS = {"mm": "mm", "px": "px", "deg": "degrees"}
_ROUNDS = np.geomspace(0.2, 1e-4, 20)


def _before_light(space: Space) -> str:
    """Return where a light leaves viewpoints, such as " in front of the backlight"; empty if it forbids none."""
    return str(getattr(entity_space(space), "before", ""))


def check_observable(space: Space, names: Sequence[str]) -> CellSet:
    """Return the covering cells of the entities, or raise `InfeasibleError` naming who cannot be seen."""
    cells = cells_of(space, list(names))
    if len(cells):
        return cells
    hidden = [name for name in names if not len(cells_of(space, [name]))]
    before = _before_light(space)
    if hidden:
        raise InfeasibleError(
            f"visibility cannot be met: no viewpoint in the workspace{before} sees all of entity {hidden[0]!r}.",
            constraint="visibility",
            entity=hidden[0],
            margin=-1.0,
            proven=True,
        )
    pair = _pair_never_seen_together(space, names)
    who = f"entities {pair[0]!r} and {pair[1]!r}" if pair else f"entities {', '.join(names)}"
    raise InfeasibleError(
        f"visibility cannot be met: no viewpoint in the workspace{before} sees all of {who}.",
        constraint="visibility",
        entity=pair[1] if pair else "",
        margin=-1.0,
        proven=True,
    )


def _pair_never_seen_together(space: Space, names: Sequence[str]) -> tuple[str, str] | None:
    """Return two entities without a common viewpoint, or None if every two seem to have one.

    Viewpoints drawn for one entity clear most pairs at little cost; a few of the others are looked into exactly.
    """
    if len(names) == 2:
        return names[0], names[1]
    seen = np.array(
        [
            space.observable(cells_of(space, [name]).sample(1000, 0), names).any(axis=0)
            for name in names
        ]
    )
    doubtful = [(names[i], names[j]) for i, j in np.argwhere(~(seen | seen.T)) if i < j]
    return next((pair for pair in doubtful[:5] if not len(cells_of(space, list(pair)))), None)


def check_resolvable(constraints: Constraints) -> None:
    """Raise `InfeasibleError` for an entity too short to be resolved wherever the lens can focus.

    See `planner.request.camera_limits.longest_image_mm`.
    """
    camera = constraints.camera
    nearest = camera.depth_of_field_mm[0]
    segments = constraints.segments
    lengths = np.where(
        constraints.resolved, np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1), np.inf
    )
    worst = int(np.argmin(lengths))
    name = constraints.names[constraints.owner[worst]]
    longest = float(longest_image_mm(camera, lengths)[worst])
    margin = longest - constraints.min_length_mm
    if margin < 0:
        pixel = max(camera.pixel_pitch_mm)
        why = (
            f"it is {lengths[worst]:.6g} mm long. Where the lens focuses (from {nearest:.4g} mm), its image is at most "
            f"{longest / pixel:.4g} px long, but must be at least {constraints.requirements.min_length_px:.4g} px."
        )
        raise InfeasibleError(
            f"resolution_mm cannot be met for entity {name!r}: {why}",
            why=why,
            constraint="resolution_mm",
            entity=name,
            margin=margin,
            proven=True,
        )


def check_extent(constraints: Constraints) -> None:
    """Raise `InfeasibleError` for entities too far apart for one image.

    See `planner.request.camera_limits.widest_view_mm`.
    """
    camera = constraints.camera
    limit = widest_view_mm(constraints.camera)
    ends = constraints.segments.reshape(-1, 3)
    apart = np.linalg.norm(ends[:, None] - ends, axis=-1)
    first, second = np.unravel_index(np.argmax(apart), apart.shape)
    if apart[first, second] > limit:
        names = list(
            dict.fromkeys(constraints.names[constraints.owner[i // 2]] for i in (first, second))
        )
        who = f"entity {names[0]!r}"
        whose = "its"
        if len(names) > 1:
            who = f"entities {names[0]!r} and {names[1]!r}"
            whose = "their"
        why = (
            f"{whose} ends are {apart[first, second]:.5g} mm apart, but where the lens focuses, the image covers at "
            f"most {limit:.5g} mm."
        )
        margin = (
            (limit - apart[first, second])
            * camera.image_distance_mm
            / camera.depth_of_field_mm[1]
            / min(camera.pixel_pitch_mm)
        )
        raise InfeasibleError(
            f"field_of_view_px cannot be met for {who}: {why}",
            why=why,
            constraint="field_of_view_px",
            entity=names[-1],
            margin=float(margin),
            proven=True,
        )


def missing_corners(constraints: Constraints) -> dict[str, InfeasibleError]:
    """Return the edges that run on smoothly in an arc although corners are asked for, and what to say of each."""
    errors = {}
    for k, name in enumerate(constraints.names if "corner_deg" in constraints.shows else ()):
        end = constraints.image.without_corner(k)
        if end is not None:
            # rounding of the model's own arithmetic is no place
            place = ", ".join(f"{round(x, 6) + 0.0:.6g}" for x in end)
            required_deg = constraints.requirements.showing.min_corner_deg
            why = (
                f"at ({place}) mm the edge ends in a tangent arc, so its length is undefined. Distances and angles "
                f"are not affected. To measure its length, require no corner (0 instead of {required_deg:g} degrees)."
            )
            errors[name] = InfeasibleError(
                f"corner_deg cannot be met for entity {name!r}: {why}",
                why=why,
                constraint="corner_deg",
                entity=name,
                margin=-required_deg,
                proven=True,
            )
    return errors


def explain_positions(
    constraints: Constraints, cells: CellSet, rng: np.random.Generator
) -> InfeasibleError:
    """Explain a request whose covering domains hold no viewpoint at a distance where the lens can focus."""
    positions = np.concatenate([cells.sample(4096, rng), *(cell.vertices for cell in cells)])
    distance = np.linalg.norm(positions[:, None, None] - constraints.ends, axis=-1)
    nearest, farthest = focus_reach_mm(constraints.camera)
    slack = np.minimum(distance - nearest, farthest - distance).min(axis=-1)
    best = int(np.argmax(slack.min(axis=1)))
    worst = int(np.argmin(slack[best]))
    return InfeasibleError(
        f"no tried viewpoint meets focus_mm for entity {constraints.names[worst]!r}: its ends must be "
        f"{nearest:.5g} to {farthest:.5g} mm from the camera. From the best of {len(positions)} viewpoints"
        f"{_before_light(constraints.space)} that see the targets, they are "
        f"{distance[best, worst].min():.5g} to {distance[best, worst].max():.5g} mm away.",
        constraint="focus_mm",
        entity=constraints.names[worst],
        margin=float(slack[best, worst]),
    )


def explain_infeasible(
    constraints: Constraints,
    encoding: PoseEncoding,
    tried: np.ndarray,
    rng: np.random.Generator | None,
) -> InfeasibleError:
    """Explain why none of the tried parameters (m, 6), the least violating first, could be made feasible.

    A constraint that fails by itself in every pose, even after a search for its own best margin, is named first;
    else the constraints conflict, and those the least violating pose breaks are named. Without a source of chance there
    is no such search.
    """
    unreached = constraints.explain_reach()
    if unreached:
        who = ", ".join(constraints.names)
        return InfeasibleError(
            f"the robot reaches no tried pose that meets all else for {who}: {unreached}.",
            constraint="robot",
            margin=-1.0,
        )
    margins = constraints.margins(encoding.poses(tried))
    if rng is None:
        return _nearest_misses(margins, constraints)
    for name in sorted(
        margins, key=lambda name: margins[name].min(axis=1).max() / constraints.scale(name)
    ):
        if margins[name].min(axis=1).max() >= 0:
            break
        margin, entity = _best_margin(name, constraints, encoding, tried, rng)
        if margin < 0:
            if name == "visibility" and (why := _dark_reason(constraints, encoding, tried, entity)):
                return InfeasibleError(why, constraint="light", entity=entity, margin=margin)
            # of visibility the margin is only a sign
            best = (
                ""
                if name == "visibility"
                else f": the best margin found is {_quantity(name, margin)}"
            )
            return InfeasibleError(
                f"no tried pose meets {name}{_for(entity)}{best}.",
                constraint=name,
                entity=entity,
                margin=margin,
                why=f"{why_missed(name, -margin)} at the best pose tried.",
            )
    return _nearest_misses(margins, constraints)


# poses that see an entity, from which it is asked why a light does not show it
_FEW_SEEING = 24


def _dark_reason(
    constraints: Constraints, encoding: PoseEncoding, tried: np.ndarray, entity: str
) -> str:
    """Say that poses see an entity which a light with an area does not show; empty if none does."""
    space = constraints.space
    lit: Any = entity_space(space)
    area = getattr(lit, "area", None)
    if area is None:
        return ""
    names = [entity] if entity else list(constraints.names)
    unlit = (
        TargetSpace(lit.regions, space.entities) if isinstance(space, TargetSpace) else lit.regions
    )
    poses = encoding.poses(tried)
    see = np.flatnonzero(unlit.observable(poses[:, :3, 3], names).all(axis=1))
    if not see.size:
        return ""
    # without a name, as the reason of many is said once
    seen = [entity for name in names for entity in _entities_of(space, name)]
    return f"poses see it, but {lit.why_dark(poses[see[:_FEW_SEEING]], seen)}."


def _entities_of(space: Any, name: str) -> tuple[str, ...]:
    """Return the entities that a target is measured on, the first ones of those that do."""
    witnesses = getattr(space.entities[name], "witnesses", None)
    return (name,) if witnesses is None else tuple(witnesses[0])


def _best_margin(
    name: str,
    constraints: Constraints,
    encoding: PoseEncoding,
    tried: np.ndarray,
    rng: np.random.Generator,
) -> tuple[float, str]:
    """Search poses for the largest margin of one constraint; return it and the entity that sets it."""
    pool = tried[:32]
    for step in _ROUNDS:
        pool = np.concatenate([pool, neighbours(pool, 96, step, encoding, rng)])
        margin = constraints.slacks(encoding.poses(pool), [name])[name].min(axis=-1)
        best = np.argsort(-margin.min(axis=1), kind="stable")[:32]
        pool = pool[best]
        margin = margin[best]
    return _worst(margin[0], constraints)


def _worst(margin: np.ndarray, constraints: Constraints) -> tuple[float, str]:
    """Return the smallest of the margins (k,) or (1,), and the entity's name if they belong to entities."""
    index = int(np.argmin(margin))
    shared = len(margin) == 1 and len(constraints.names) > 1
    return float(margin[index]), "" if shared else constraints.names[index]


def _nearest_misses(margins: dict[str, np.ndarray], constraints: Constraints) -> InfeasibleError:
    """Explain by the first pose, which comes nearest: what it still misses."""
    worst = {name: _worst(margin[0], constraints) for name, margin in margins.items()}
    missed = sorted((m / constraints.scale(name), name) for name, (m, _) in worst.items() if m < 0)
    parts = [
        f"{name} by {_quantity(name, -worst[name][0])}{_for(worst[name][1])}" for _, name in missed
    ]
    name = missed[0][1] if missed else ""
    text = f": the nearest pose misses {', '.join(parts)}" if parts else ""
    fault = f"no tried pose meets all constraints for {', '.join(constraints.names)}"
    words = ", ".join(why_missed(name, -worst[name][0]) for _, name in missed)
    return InfeasibleError(
        f"{fault}{text}.",
        constraint=name,
        entity=worst[name][1] if name else "",
        margin=worst[name][0] if name else float("nan"),
        together=True,
        why=f"{fault}: {words} at the nearest one." if words else "",
    )


def _for(entity: str) -> str:
    return f" for entity {entity!r}" if entity else ""


def _quantity(name: str, value: float) -> str:
    return f"{value:.4g} {_UNITS.get(name.rsplit('_', 1)[-1], '')}".rstrip()


# A given pose as a sensor setting: what it inspects, how surely, and with what margins.


def setting_at(
    problem: Problem,
    cam2world: np.ndarray,
    names: Sequence[str],
    message: str,
    seed: int | None = None,
    nfev: int = 1,
) -> SensorSetting:
    """Describe a pose as a setting that inspects some of the entities of a request.

    Parameters
    ----------
    problem : Problem
        What is asked.
    cam2world : array (4, 4)
        The pose.
    names : sequence of str
        The entities it is to inspect.
    message : str
        Where it comes from.
    seed : int, optional
        Seed of the work that found it.
    nfev : int
        Poses evaluated for it.

    Returns
    -------
    SensorSetting
        With the probabilities and margins of these entities; whether they suffice is not asked.
    """
    pose = np.asarray(cam2world)[None]
    request_here = problem.at_pose(pose[0], names)
    # what a request without a choice has made already
    modelled = request_here if problem.has_choice else problem
    idx = [modelled.names.index(name) for name in names]
    mask = np.isin(np.arange(len(modelled.names)), idx)[None]
    probability = modelled.objective.probability_where(pose, mask)
    by_idx = dict(zip(sorted(idx), probability.tolist(), strict=True))
    margins = request_here.constraints.margins(pose)
    return SensorSetting(
        cam2world=cam2world,
        entities=tuple(names),
        probability={name: by_idx[i] for name, i in zip(names, idx, strict=True)},
        margins={name: float(margin.min()) for name, margin in margins.items()},
        fitness=float(sum(by_idx.values())),
        nfev=nfev,
        generations=0,
        message=message,
        seed=seed,
        witness={name: request_here.chosen[name] for name in names if name in request_here.chosen},
        registered=request_here.known_at(pose[0], names),
    )


def without(problem: Problem, setting: SensorSetting, names: Sequence[str]) -> SensorSetting:
    """Return a setting without some of its entities; of the others it states what it stated.

    Parameters
    ----------
    problem : Problem
        What is asked.
    setting : SensorSetting
        The setting.
    names : sequence of str
        The entities it loses.

    Returns
    -------
    SensorSetting
        The same pose; its margins are those of what is left.
    """
    entities = tuple(name for name in setting.entities if name not in names)
    if not entities:
        return replace(setting, entities=(), probability={}, p_all={}, registered=None)
    fewer = setting_at(
        problem, setting.cam2world, entities, setting.message, seed=setting.seed, nfev=setting.nfev
    )
    stated = {name: setting.probability[name] for name in entities}
    counted = {name: setting.p_all[name] for name in entities if name in setting.p_all}
    return replace(
        fewer,
        generations=setting.generations,
        probability=stated,
        p_all=counted,
        # all of them held together, so fewer of them did
        p_all_together=setting.p_all_together,
        p_all_poses=setting.p_all_poses,
    )


# The search for one pose: restricted sampling, the genetic algorithm, local refinement.


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
    more_poses = np.empty((0, 4, 4)) if known is None else known
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
        more_poses,
    )
    feasible = more_poses[constraints.feasible(more_poses)]
    result = _evolve(start.bits, encoding, constraints, objective, search, rng, callback)
    if result is not None:
        outcome = _outcome(result, encoding)
    elif len(feasible):
        # feasible only between the steps of the encoding: what is left is to refine
        message = "No encoded pose is feasible; the known poses were refined."
        outcome = FoundPose(feasible[0], -np.inf, 0, 0, message, ())
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
    )
    ascent.consider(feasible)
    if search.refines and ascent.fitness < ascent.enough:
        ascent.climb(np.concatenate([_starts(result, start.bits, ascent, search, rng), feasible]))
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
) -> GAResult | None:
    """Run the genetic algorithm from feasible chromosomes; too few of them are repeated. None without any."""

    def feasible(population: np.ndarray) -> np.ndarray:
        return constraints.feasible(encoding.decode(population))

    while len(bits):
        initial = np.resize(bits, (search.population, encoding.n_bits))
        try:
            return maximize(
                lambda population: objective.fitness(encoding.decode(population)),
                encoding.n_bits,
                feasible=feasible,
                initial=initial,
                rng=rng,
                callback=callback,
                target=_enough(objective) if search.stop_at_perfect else None,
                **search.ga_options(),
            )
        except InfeasiblePopulationError:
            # light is judged by few rays: one that grazes an edge meets it or not, by the rest of its batch
            refused = np.flatnonzero(~feasible(initial)) % len(bits)
            if not len(refused):
                raise
            bits = np.delete(bits, refused, axis=0)
    return None


def _outcome(result: GAResult, encoding: PoseEncoding) -> FoundPose:
    history = tuple(result.history.best_so_far.tolist())
    pose = encoding.decode(result.x[None])[0]
    return FoundPose(
        pose, float(result.fun), int(result.nfev), int(result.nit), result.message, history
    )


def _enough(objective: Objective) -> float:
    return objective.highest * (1.0 - _PERFECT)


@suggests_names
def plan_setting(
    space: Space,
    names: Sequence[str],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    *,
    accuracy: float = 0.98,
    rng: int | np.random.Generator | None = 0,
    stand_off_mm: float = 50.0,
    min_length_px: float = 20.0,
    field_margin_px: float | None = None,
    field_of_view: FieldOfView = "exact",
    visibility_radius_mm: float | None = None,
    focus_margin_mm: float = 0.0,
    showing: Detectability = NOT_ASKED,
    reach: Reach | None = None,
    objective: ObjectiveKind = "sum",
    model: Model = "joint",
    search: Search | None = None,
    start: ArrayLike | None = None,
    callback: Callable[..., Any] | None = None,
) -> SensorSetting:
    """Find the pose that inspects a set of entities with the highest probability.

    Guarantee: the setting meets every constraint. Every individual of every population lies in the
    covering domains. The same arguments with the same integer `rng` give the same setting.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Viewpoints from which the entities are observable.
    names : sequence of str
        The entities to inspect together.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Uncertainty of the camera's real pose about the planned one.
    accuracy : float
        Required accuracy A in (0, 1). The permitted error is the fraction 1 − A of the length.
    rng : int, numpy.random.Generator or None
        Seed or source of chance; None takes a fresh seed, reported in the setting.

    Returns
    -------
    SensorSetting
        The best setting found.

    Other Parameters
    ----------------
    stand_off_mm : float
        Smallest distance between the front nodal point and the part, mm.
    min_length_px : float
        Smallest length of an entity in the image, in pixels of the larger pitch (L_min of eq 16).
    field_margin_px : float, optional
        Width of the strip along the sensor's edges to keep free, px, so that no end leaves the
        image. Default: three standard deviations of the motion of a point on the axis under the
        pose uncertainty.
    field_of_view : {"exact", "cone"}
        "exact": both ends are inside the rectangular sensor. "cone": the paper's conservative cone.
    visibility_radius_mm : float, optional
        Entities must also be observable from all points up to this distance from the pose, mm, so
        that a displaced camera sees them. Default: three standard deviations of the position.
    focus_margin_mm : float
        Narrow both limits of the depth of field by this distance, mm, so that a displaced camera is
        still in focus. With four standard deviations of its position, blurred images are rare.
        Default: 0.
    showing : Detectability
        Conditions under which software can find edges in the image. Default: none, as in the paper.
    reach : ReachRegion or callable, optional
        Region in which the front nodal point may be. It is a `BoxRegion`, `SphereRegion`,
        `MeshRegion` or another object with a method ``margin``, or ``callable(positions) -> bool``
        of shape (n,). Default: the whole workspace.
    objective : {"sum", "min"}
        Maximise the sum of the probabilities (the paper) or the smallest.
    model : {"joint", "independent", "montecarlo"}
        Error model, see `errors.success_probability`.
    search : Search, optional
        How to search; `Search.paper()` is the paper's plain algorithm.
    start : array (m, 4, 4), optional
        Poses cam2world to start from. The setting is never worse than the best feasible one of
        them.
    callback : callable, optional
        ``callback(ga.Generation)`` after every generation; a true return value stops the search.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    InfeasibleError
        If the search finds no setting that meets the constraints. The error names constraint,
        entity and amount.

    Examples
    --------
    >>> from aspectgraph import compute_regions, read_solid
    >>> from planner import Camera, PoseUncertainty, plan_setting
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> regions = compute_regions(block, {"e1": [[60, 20, 10], [60, 40, 10]], "e2": [[60, 20, 10], [60, 20, 30]]})
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> setting = plan_setting(regions, ["e1", "e2"], camera, uncertainty, accuracy=0.95)
    >>> min(setting.probability.values()) > 0.99, min(setting.margins.values()) >= 0
    (True, True)
    """
    check_kinds(
        names=(names, ITEMS),
        camera=(camera, "Camera"),
        pose_uncertainty=(pose_uncertainty, "PoseUncertainty"),
    )
    check_space(space)
    names = check_names(space, names)
    for name in names:
        check_is_edge(name, space.entities[name])
    if field_margin_px is None:
        field_margin_px = pose_margin_px(camera, pose_uncertainty)
    if visibility_radius_mm is None:
        visibility_radius_mm = position_margin_mm(pose_uncertainty)
    need = Requirements(
        min_length_px=min_length_px,
        field_margin_px=field_margin_px,
        field_of_view=field_of_view,
        stand_off_mm=stand_off_mm,
        reach=reach,
        visibility_radius_mm=visibility_radius_mm,
        focus_margin_mm=check_focus_margin(focus_margin_mm, camera),
        showing=check_showing(showing, camera),
    )
    problem = Problem(space, names, camera, pose_uncertainty, accuracy, requirements=need)
    return best_setting(
        problem,
        rng,
        objective=objective,
        model=model,
        search=search,
        start=start,
        callback=callback,
    )


def best_setting(
    problem: Problem,
    rng: int | np.random.Generator | None,
    *,
    objective: ObjectiveKind = "sum",
    model: Model = "joint",
    search: Search | None = None,
    start: ArrayLike | None = None,
    callback: Callable[..., Any] | None = None,
) -> SensorSetting:
    """Find the best pose for all entities of a request: `plan_setting` for those who have the request.

    Parameters
    ----------
    problem : Problem
        What is asked.
    rng : int, numpy.random.Generator or None
        Seed or source of chance.
    objective, model, search, start, callback
        As in `plan_setting`.

    Returns
    -------
    SensorSetting
        The best setting found.

    Raises
    ------
    RequestError
        If an option breaks its rule.
    InfeasibleError
        If no setting can be found that satisfies the constraints.
    """
    generator, seed = _check_rng(rng)
    constraints = problem.constraints
    goal = problem.objective_of(objective, model)
    check_resolvable(constraints)
    check_extent(constraints)
    for error in missing_corners(constraints).values():
        raise error
    cells = check_observable(problem.space, problem.names)
    outcome = search_pose(
        cells, constraints, goal, search or Search(), generator, _check_poses(start), callback
    )
    pose = outcome.cam2world[None]
    probability = goal.probability(pose)[0]
    return SensorSetting(
        cam2world=outcome.cam2world,
        entities=problem.names,
        probability=dict(zip(problem.names, probability.tolist(), strict=True)),
        margins={name: float(margin.min()) for name, margin in constraints.margins(pose).items()},
        fitness=outcome.fitness,
        nfev=outcome.nfev,
        generations=outcome.generations,
        message=outcome.message,
        seed=seed,
        history=outcome.history,
        witness={name: problem.chosen[name] for name in problem.names if name in problem.chosen},
        registered=problem.known_at(outcome.cam2world, problem.names),
    )


def check_names(space: Space, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names as a tuple, or raise `RequestError` if there are none, one is unknown or one comes twice."""
    names = (names,) if isinstance(names, str) else tuple(str(name) for name in names)
    if not names:
        raise RequestError.of_rule("names", "must hold at least one entity", "none")
    for name in names:
        if name not in space.entities:
            raise RequestError.of_rule(
                "names", f"must be entities ({', '.join(map(str, space.entity_names))})", repr(name)
            )
        if names.count(name) > 1:
            raise RequestError.of_rule("names", "must be different", f"{name!r} twice")
    return names


def _check_rng(rng: object) -> tuple[np.random.Generator, int | None]:
    if isinstance(rng, np.random.Generator):
        return rng, None
    if rng is None:
        rng = int(np.random.SeedSequence().generate_state(1)[0])
    if not isinstance(rng, Integral) or isinstance(rng, bool) or rng < 0:
        raise RequestError.of_rule(
            "rng", "must be a non-negative integer, a numpy Generator or None", repr(rng)
        )
    return np.random.default_rng(int(rng)), int(rng)


def _check_poses(start: ArrayLike | None) -> np.ndarray:
    """Return poses (m, 4, 4) to begin with, or raise `RequestError` if they are not rigid."""
    poses = np.empty((0, 4, 4)) if start is None else np.asarray(start, dtype=np.float64)
    poses = poses[None] if poses.shape == (4, 4) else poses
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise RequestError(f"start must have the shape (m, 4, 4). Got {poses.shape}.")
    rotations = poses[:, :3, :3]
    if not np.allclose(rotations @ np.swapaxes(rotations, 1, 2), np.eye(3), atol=1e-6):
        raise RequestError("start must hold rigid poses. Got a rotation that is not orthonormal.")
    return poses
