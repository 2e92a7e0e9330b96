"""The whole inspection: as few sensor settings as possible, every entity measured with the required probability.

The way
-------
1. Candidate poses are drawn from the domains and improved (`planner.search.columns`). Each gives a column: what it
   inspects; and an optimistic one: what it nearly inspects.
2. A lower bound is proven (`planner.bound.lower_bound`). On the way it meets poses that inspect more than the
   candidates do; they join them.
3. Sets of entities that would save a setting, and that some pose nearly inspects, are chosen
   (`planner.cover`). The genetic algorithm tries to realise them; one that misses is refuted, with
   everything that contains it, and replaced by the largest part it reached. Choose again, until none is left or enough
   were tried.
4. Every chosen column gets its own run of the genetic algorithm, for the best probabilities.
5. If lamps are asked for, they are chosen (`planner.light`). What none of them shows is looked for from other poses.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from concurrent.futures import Executor
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from ground.blas import with_one_thread
from planner.argument_kinds import (
    ITEMS,
    OF_MODEL,
    check_keywords,
    check_kinds,
    kind_of_model,
    show_keywords,
    shown,
    with_article,
)
from planner.callbacks import (
    FORESEEN_SHARE,
    LAMPS_SHARE,
    LIT_SEARCH_SHARE,
    Callbacks,
    Deadline,
)
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.exceptions import RequestError
from planner.executors import checked_by
from planner.identity import Request
from planner.light.area_light import AreaSpace
from planner.light.corner_light import DEFAULT_STEP
from planner.light.lighting import Lighting, RingSpace
from planner.lights import readable_light
from planner.measuring.foreseen import foreseen_in_time
from planner.measuring.planned_edges import registered_problem
from planner.options import (
    InspectionKeywords,
    InspectionOptions,
    RunOptions,
    options_or_default,
)
from planner.plan import InspectionPlan
from planner.progress import TimeIsUpError, labelled
from planner.request.dimension import Dimension
from planner.request.problem import Problem
from planner.request.reach import Space
from planner.resolve_request import ResolvedRequest, problem_on, resolve_request
from planner.resume import PlanningState
from planner.search.given import plan_of_given
from planner.search.incumbents import Incumbents, SearchRun, needed
from planner.search.lit_poses import unlit_witnesses, with_lamps_in_time
from planner.search.split_plan import with_split
from planner.search.stages import run_stages, settle_early
from planner.sensor_setting import Reason, ReasonKind, SensorSetting

if TYPE_CHECKING:
    from aspectgraph import Solid, VisibilityRegions
    from aspectgraph.visibility.visibility_regions import RegionStore
    from planner.progress import Progress


def plan_inspection(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    options: InspectionOptions | None = None,
    **keywords: Unpack[InspectionKeywords],
) -> InspectionPlan:
    """Plan the inspection of entities of a part.

    **Guarantee.** One of the settings inspects each entity with at least ``probability`` and meets
    all constraints. Otherwise ``uninspectable`` lists the entity with the reason. ``lower_bound``
    is a proven lower bound of the number of settings. The plan depends on the request and the seed,
    not on the executor or on interruptions.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping or sequence
        Name to an edge, a rim, an arc or a `Dimension`. An edge is an id (17 or "e17") or two end points. The
        plan measures the length of an edge, the diameter of a rim (``"r3"``) and the radius of an
        arc (``"a0"``). The permitted error is 1 − A of the value. Ids without names, such as
        `select_entities` returns, are named ``"e<id>"``, ``"r<n>"`` or ``"a<n>"``. They may also be
        an array or a set, which is sorted.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Uncertainty of its real pose about the planned one.
    options : InspectionOptions, optional
        Required accuracy and probability, constraints and effort, as one value. Default:
        ``InspectionOptions()``.
    **keywords
        Fields of `InspectionOptions`, such as ``accuracy``, ``probability``, ``rng``,
        ``workspace``, ``lamps``, ``effort`` or ``state``; each replaces that of ``options``.

    Returns
    -------
    InspectionPlan
        Settings, lower bound, and the entities that cannot be inspected.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    TypeError
        If a keyword is not known.
    RobotError
        If a fixturing puts the part through something, or the robot's home is not free.
    PlanFileError
        If the state file belongs to another request, or another version of the program.
    OutputError
        If the state file cannot be written.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Camera, Effort, PoseUncertainty, plan_inspection
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> rims = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> effort = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000)
    >>> plan = plan_inspection(block, rims, camera, uncertainty, accuracy=0.95, effort=effort)
    >>> plan.complete, len(plan.settings), plan.lower_bound
    (True, 1, 1)
    """
    entities = _items(entities)
    check_kinds(
        solid=(solid, "Solid"),
        entities=(entities, ITEMS),
        camera=(camera, "Camera"),
        pose_uncertainty=(pose_uncertainty, "PoseUncertainty"),
    )
    options = options_or_default(options)
    check_keywords("plan_inspection", keywords, [item.name for item in fields(InspectionOptions)])
    options = replace(options, **keywords)
    # before the work: limits that cannot be kept, and a part that hides the lamps
    deadline = Deadline(options.time_limit_s, options.gap)
    if not entities:
        raise RequestError.of_rule("entities", "must hold at least one entity", "none")
    if options.lighting is not None:
        options.lighting.check_part(solid)
    resolved = resolve_request(solid, entities, camera, pose_uncertainty, options)

    lighting = options.lighting

    def completed(plan: InspectionPlan) -> InspectionPlan:
        lit = with_light(plan, solid, lighting, options.progress, options.executor)
        return foreseen_in_time(lit, solid, deadline.time_left(FORESEEN_SHARE))[0]

    search = deadline
    if lighting is not None:
        search = deadline.of_search(deadline.gap, LIT_SEARCH_SHARE)
    return plan_request(
        solid,
        resolved,
        options,
        deadline=search,
        completed=completed,
        lamps_until=deadline.at(LAMPS_SHARE),
    )


show_keywords(
    plan_inspection,
    InspectionKeywords,
    {item.name: item.default for item in fields(InspectionOptions)},
)


@with_one_thread
def plan_request(
    solid: Solid,
    resolved: ResolvedRequest,
    options: RunOptions,
    deadline: Deadline | None = None,
    completed: Callable[[InspectionPlan], InspectionPlan] | None = None,
    lamps_until: float = math.inf,
) -> InspectionPlan:
    """Plan what was asked.

    Parameters
    ----------
    solid : Solid
        The part.
    resolved : ResolvedRequest
        The request, with its entities on this part.
    options : RunOptions
        How the plan is computed.
    deadline : Deadline, optional
        When the search ends. Default: by the time limit of the options, from now.
    completed : callable, optional
        Returns a plan with what it lacks when the search ends; ``on_incumbent`` gets it last.
    lamps_until : float
        When no more lamps are sought for a plan that the deadline ended, as `time.time` counts. It may then lack them.

    Returns
    -------
    InspectionPlan
        Settings, lower bound, and the entities that cannot be inspected.

    Raises
    ------
    RequestError, PlanFileError, OutputError
        As `plan_inspection`.
    """
    request = resolved.request
    deadline = deadline or Deadline(options.time_limit_s, request.gap)
    if options.state is not None:
        request.check_lasting()
    problem = _problem(solid, resolved, options, deadline)
    late = len(problem.names) < len(request.targets)
    # the state of a search belongs to all targets
    memo = PlanningState(request.identity(), None if late else options.state)
    callbacks = Callbacks(
        on_best=options.on_incumbent,
        progress=options.progress,
        deadline=deadline,
    )
    incumbents = Incumbents(callbacks)
    early = None
    if memo.plan is None:
        run = SearchRun(problem, request, memo, executor=options.executor, callbacks=callbacks)
        check_now = deadline.check_now if deadline.limited else None
        try:
            if request.poses is None:
                with checked_by(check_now):
                    plan = with_split(run, run_stages(run, incumbents, request.lighting))
                memo.finish(with_light(shown_only(plan, run.bound_of), solid, request.lighting))
            else:
                memo.finish(shown_only(plan_of_given(run, request.lighting)))
        except TimeIsUpError:
            early = settle_early(run, incumbents.latest(run), incumbents.proven)
        finally:
            memo.save()
    if early is not None and request.lighting is not None:
        # lamps take time, in which somebody may interrupt
        incumbents.publish(early)
        early = shown_only(with_lamps_in_time(run, request.lighting, early, lamps_until))
    result = early or memo.plan
    assert result is not None
    if completed is not None:
        result = completed(result)
    incumbents.publish(result)
    return result


def _items(entities: Any) -> Any:
    """Return entities of an array or a set as a list; dimensions without names are refused."""
    is_array = isinstance(entities, np.ndarray) and entities.ndim > 0
    is_set = isinstance(entities, AbstractSet)
    if not (is_array or is_set or isinstance(entities, list | tuple)):
        return entities
    for item in entities:
        _check_item(item, type(entities).__name__)
    if not (is_array or is_set):
        return entities
    from aspectgraph.entities.entity import unnamed_entities

    return unnamed_entities(entities)


def _check_item(item: Any, container: str) -> None:
    """Refuse an item of a sequence that only a mapping can hold, or that is no request yet."""
    is_pair = isinstance(item, tuple) and any(isinstance(part, Dimension) for part in item)
    if is_pair or isinstance(item, Dimension):
        rule = "must name each dimension"
        got = f"a {container} with {shown(item)}"
        hint = 'write {"name": Dimension(...)}'
        raise RequestError.of_rule("entities", rule, got, hint=hint)
    if isinstance(item, Mapping) or kind_of_model(item):
        rule = "must be one mapping, or a sequence of edges, rims and arcs"
        got = f"a {container} with {with_article(type(item).__name__)}"
        raise RequestError.of_rule("entities", rule, got, hint=OF_MODEL)


def _problem(
    solid: Solid, resolved: ResolvedRequest, options: RunOptions, deadline: Deadline
) -> Problem:
    """Return the problem: where the targets are observable, without those whose region was late."""
    request, entities = resolved
    space = options.space
    if space is None:
        regions = visible_regions(
            solid,
            entities,
            request,
            executor=options.executor,
            progress=options.progress,
            deadline=deadline.of_regions(),
        )
        space = space_of(request, regions)
    else:
        space = in_area_light(request, space)
    missing = {name for name in entities if name not in space.entities}
    if missing and not deadline.limited:
        raise RequestError.of_rule(
            "space", "must hold all entities that are wanted", f"no {min(missing)!r}"
        )
    targets = tuple(t for t in request.targets if not missing.intersection(needed(t)))
    if not targets:
        raise RequestError.of_rule(
            "time_limit_s",
            "must be long enough to compute from where one target is observable",
            f"{options.time_limit_s:g}",
        )
    problem = registered_problem(problem_on(request, space, targets), request.registration)
    return replace(problem, unlit=unlit_witnesses(problem, request.lighting))


def visible_regions(
    solid: Solid,
    entities: Mapping[str, Any],
    request: Request,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    kept: RegionStore | None = None,
    deadline: float = math.inf,
) -> VisibilityRegions:
    """Compute from where a camera observes the entities of a request.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping of str to Entity
        Its entities.
    request : Request
        Gives the workspace. With a ring light, the entities must show in it as well.
    executor, progress, kept, deadline
        As `aspectgraph.compute_regions` takes them. Regions with a ring light are not kept.

    Returns
    -------
    VisibilityRegions
        Without the entities whose region was not complete by the deadline.
    """
    from aspectgraph import compute_light, compute_regions

    shown = labelled(progress, "visible regions")
    box = request.workspace
    if request.ring is not None:
        return compute_light(
            solid, entities, request.ring.contrast, box, executor, shown, deadline=deadline
        )
    return compute_regions(
        solid,
        entities,
        workspace=box,
        executor=executor,
        progress=shown,
        kept=kept,
        deadline=deadline,
    )


def space_of(request: Request, regions: Space) -> Space:
    """Return the space that is planned in: with a ring or an area light, where edges show to the camera."""
    from aspectgraph import LightRegions

    if request.ring is None or not isinstance(regions, LightRegions):
        return in_area_light(request, regions)
    step = DEFAULT_STEP if request.ring.step is None else request.ring.step
    return RingSpace(regions, request.camera, step)


def in_area_light(request: Request, space: Space) -> Space:
    """Return a space with what a light with an area shows in it; the same if the request has none."""
    lighting = request.lighting
    if lighting is None or lighting.area is None or isinstance(space, AreaSpace):
        return space
    return AreaSpace(space, request.camera, lighting.area, lighting.limits)


def with_light(
    plan: InspectionPlan,
    solid: Solid,
    lighting: Lighting | None,
    progress: Progress | None = None,
    executor: Executor | None = None,
    deadline: float = math.inf,
) -> InspectionPlan:
    """Return a plan with the lamps asked for, if it has none yet: one that was ended early has not.

    It stays without, if the light of its targets is not known by the deadline, as `time.time` counts.
    """
    if lighting is None or plan.light is not None:
        return plan
    try:
        light = readable_light(lighting, plan, solid, progress, executor, deadline)
    except TimeIsUpError:
        return plan
    return shown_only(replace(plan, light=light))


def shown_only(
    plan: InspectionPlan, bound_of: Callable[[Sequence[str]], int] | None = None
) -> InspectionPlan:
    """Return a plan that states in each setting only what its light shows there, without settings that add nothing.

    No robot drives to where a camera sees nothing, and no probability is stated of an edge in the dark. Targets that
    no setting shows become ``uninspectable``, for the reason that the light has.

    Parameters
    ----------
    plan : InspectionPlan
        With light or without.
    bound_of : callable, optional
        Returns how many settings some targets need at least. Default: what the bound of the plan implies. A plan
        for fewer targets and one setting for each of the others is a plan for all.
    """
    if plan.light is None or plan.light.complete:
        return plan
    dark = plan.unlit
    reasons = {
        name: Reason.of(ReasonKind.NOT_SHOWN, next(u[name] for u in plan.light.unlit if name in u))
        for name in dark
    }
    settings = [
        setting.without({*dark, *unlit})
        for setting, unlit in zip(plan.settings, plan.light.unlit, strict=True)
    ]
    rows = _needed_rows(settings)
    images = tuple(plan.light.images[k] for k in rows)
    light = replace(plan.light, images=images, unlit=tuple({} for _ in rows)).numbered_by_use()
    shown = [name for name in plan.promises if name not in reasons]
    bounds = [plan.lower_bound - len(dark), int(bool(shown))]
    if bound_of is not None:
        bounds.append(bound_of(shown))
    bound = min(max(bounds), len(rows))
    proof = plan.bound_proof
    if bound < plan.lower_bound:
        targets = f"target{'s' * (len(dark) > 1)} that the light does not show"
        remain = "remains" if bound == 1 else "remain"
        proof += f" Without {len(dark)} {targets}, at least {bound} of {plan.lower_bound} {remain}."
    whole_bound = plan.whole_bound - len(dark)
    return replace(
        plan,
        settings=tuple(settings[k] for k in rows),
        light=light,
        lower_bound=bound,
        bound_proof=proof if rows else "",
        whole_bound=whole_bound if whole_bound > bound else 0,
        uninspectable={**plan.uninspectable, **reasons},
        split={name: value for name, value in plan.split.items() if name not in reasons},
    )


def _needed_rows(settings: Sequence[SensorSetting]) -> list[int]:
    """Return the indices of settings without those that state nothing that the others do not, the smallest first."""
    counts = Counter(name for setting in settings for name in setting.entities)
    needed_rows = set(range(len(settings)))
    for k in sorted(needed_rows, key=lambda k: len(settings[k].entities)):
        names = settings[k].entities
        if not settings[k].ends and all(counts[name] > 1 for name in names):
            needed_rows.remove(k)
            counts.subtract(names)
    return sorted(needed_rows)
