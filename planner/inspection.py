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
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from errors.measurands.geometry import Localisation
from planner.argument_kinds import ITEMS, check_kinds
from planner.callbacks import Callbacks, Deadline
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.detectability.conditions import USUAL, Detectability
from planner.effort import Effort
from planner.exceptions import RequestError
from planner.identity import InspectionRequest
from planner.light.background import DEFAULT_STEP
from planner.light.lighting import Lighting, RingSpace
from planner.light.plan_light import chosen_lamps
from planner.measuring.planned_edges import registered_request
from planner.options import InspectionOptions
from planner.plan import InspectionPlan
from planner.progress import TimeIsUpError, labelled
from planner.request.reach import Reach, Space, TargetSpace
from planner.request.request import Request
from planner.resolve_request import Promise, ResolvedRequest, resolve_request
from planner.resume import PlanningState
from planner.search.incumbents import Incumbents, Run, needed, with_late_targets
from planner.search.stages import run_stages, settle_early

if TYPE_CHECKING:
    from aspectgraph import Solid, VisibilityRegions
    from aspectgraph.visibility.visibility_regions import RegionStore
    from planner.progress import Progress
    from planner.robotcell import Cell


def plan_inspection(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    *,
    accuracy: float = 0.98,
    probability: float = 0.9,
    rng: int | np.random.Generator = 0,
    workspace: ArrayLike | None = None,
    stand_off_mm: float = 50.0,
    min_length_px: float = 20.0,
    field_margin_px: float | None = None,
    visibility_radius_mm: float | None = None,
    focus_margin_mm: float | None = None,
    showing: Detectability = USUAL,
    reach: Reach | None = None,
    cell: Cell | None = None,
    lamps: Any = None,
    space: Space | None = None,
    effort: Effort | None = None,
    localisation: Localisation | None = None,
    surfaces_mm: float | None = None,
    registration: Any = None,
    time_limit_s: float | None = None,
    gap: float = 0.0,
    on_incumbent: Callable[[InspectionPlan], object] | None = None,
    state: str | os.PathLike[str] | None = None,
    executor: Executor | None = None,
    progress: Callable[..., Any] | None = None,
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
        Name to an edge, a rim, an arc or a `Dimension`. An edge is an id or two end points. The
        plan measures the length of an edge, the diameter of a rim (``"r3"``) and the radius of an
        arc (``"a0"``). The permitted error is 1 − A of the value. Ids without names, such as
        `select_entities` returns, are named ``"e<id>"``, ``"r<n>"`` or ``"a<n>"``.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Uncertainty of its real pose about the planned one.
    accuracy : float
        Required accuracy A in (0, 1).
    probability : float
        Required probability, in (0, 1), that a measurement is accurate.
    rng : int or numpy.random.Generator
        Seed. From a generator, the program draws a seed.

    Returns
    -------
    InspectionPlan
        Settings, lower bound, and the entities that cannot be inspected.

    Other Parameters
    ----------------
    workspace : array_like (2, 3), optional
        Opposite corners of the box the camera may be in, mm. Default: `default_workspace`, which
        extends around the part as far as the lens focuses.
    stand_off_mm, min_length_px : float
        Constraints, see `Requirements`.
    field_margin_px : float, optional
        Width of the strip along the sensor's edges to keep free, px. Default: four standard
        deviations of an image point's motion under the pose uncertainty. They are those of the
        corner where the motion is largest. The default is at most a quarter of the smaller side.
    visibility_radius_mm : float, optional
        As in `plan_setting`.
    focus_margin_mm : float, optional
        Narrow both limits of the depth of field by this distance, mm, so that a displaced camera is
        still in focus. Default: three standard deviations of the depth of each end of an edge, as
        the camera moves and turns. The default is at most an eighth of the depth of field, but
        never less than 1.645 standard deviations.
    showing : Detectability
        Conditions under which software can find edges in the image. With a corner condition, the
        plan does not inspect edges that end in a tangent arc. ``Detectability(0, 0, 0)`` sets no
        conditions, as in the paper. Default: ``Detectability()``.
    reach : ReachRegion or callable, optional
        As in `plan_setting`. With ``state`` it needs a permanent name. A lambda, a nested function
        or an object that cannot be pickled needs an attribute ``state_name``, which describes what
        it permits.
    cell : Cell, optional
        Robot that must reach every setting, and how the part lies before it. Each setting of the
        plan then has a ``fixturing`` and ``joints``. The cell only forbids poses, so the lower
        bound is proven without it, and holds.
    lamps : array_like, shape (n, 3), or LampBox, LampDome, "ring" or Lighting, optional
        Lamps that must light the targets, as in `plan_light`. The plan then has its ``light``. If
        no lamp lights a target in any setting, the program searches for other poses. With "ring",
        the search is restricted to viewpoints where the ring light makes edges visible.
    space : VisibilityRegions or EntityAspectGraph, optional
        Visibility computed before, for these entities and this workspace. With a `RingSpace`, an
        edge counts as observable only where a ring light on the camera makes it visible. Default:
        the program computes the visibility.
    effort : Effort, optional
        How long to search. Default: ``Effort()``, or ``Effort.for_dimensions()`` for dimensions.
    localisation : Localisation, optional
        Model of the errors of image points. Default: ``Localisation.gaussian()`` if there is a
        `Dimension`, otherwise rounding to whole pixels, as in the paper.
    surfaces_mm : float, optional
        Standard deviation of the position of the part's faces along their normals, mm, for
        dimensions. Points of the image are carried back to these faces. Default: what a
        `Dimension` states of its own, otherwise 0.02 mm; 0 if points are rounded to whole pixels.
    registration : Registration or PoseUncertainty, optional
        How the poses of images are known when values are read. With ``Registration.own_edges()``,
        `measure` will register each image to the part's own edges, and P is that of these values.
        The program predicts it from what each pose shows of the part. A `PoseUncertainty` is that
        of poses that something else measures. Where the camera may be while it takes the images,
        remains ``pose_uncertainty``. Default: values are read with the planned poses.
    time_limit_s : float, optional
        End the planning after this many seconds with the best plan so far, which is then
        ``unfinished``. Visibility may take half of them. The plan omits a target whose visibility
        is not complete by then, with the reason. Planning does not end before the first plan, nor
        during a run of the genetic algorithm in this process. Default: no limit.
    gap : float
        Stop improving the plan and its bound at this gap, in [0, 1). The gap is the share of the
        settings that the bound does not prove to be needed. Default: improve both as far as the
        effort allows.
    on_incumbent : callable, optional
        The program calls ``on_incumbent(plan)`` with the best plan so far, whenever the plan or its
        bound improves. The last call gets the plan that is returned. An exception it raises cancels
        the work.
    state : path, optional
        File that stores results during the planning. If it exists, the planning resumes from it.
        The file remains when the plan is done, and the same call then returns the plan at once.
        Delete it after you have written the plan. If the program can no longer save it, it warns
        and continues.
    executor : concurrent.futures.Executor, optional
        Runs the per-entity and per-column work.
    progress : callable, optional
        The program calls ``progress(done, total, label)``. An exception it raises cancels the work.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
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
    _check_kinds(solid, entities, camera, pose_uncertainty)
    options = InspectionOptions(
        workspace=workspace,
        stand_off_mm=stand_off_mm,
        min_length_px=min_length_px,
        field_margin_px=field_margin_px,
        visibility_radius_mm=visibility_radius_mm,
        focus_margin_mm=focus_margin_mm,
        showing=showing,
        reach=reach,
        cell=cell,
        lamps=lamps,
        space=space,
        effort=effort,
        localisation=localisation,
        surfaces_mm=surfaces_mm,
        registration=registration,
        time_limit_s=time_limit_s,
        gap=gap,
        on_incumbent=on_incumbent,
        state=state,
        executor=executor,
        progress=progress,
    )
    promise = Promise(accuracy, probability, rng)
    return plan_by_options(solid, entities, camera, pose_uncertainty, promise, options)


def _check_kinds(solid: Any, entities: Any, camera: Any, pose_uncertainty: Any) -> None:
    """Refuse arguments of the wrong kind."""
    check_kinds(
        solid=(solid, "Solid"),
        entities=(entities, ITEMS),
        camera=(camera, "Camera"),
        pose_uncertainty=(pose_uncertainty, "PoseUncertainty"),
    )


def plan_by_options(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    promise: Promise,
    options: InspectionOptions,
) -> InspectionPlan:
    """Plan the inspection of entities of a part, like `plan_inspection`, with one options value.

    Parameters
    ----------
    solid, entities, camera, pose_uncertainty
        As `plan_inspection` takes them.
    promise : Promise
        Accuracy, probability and seed.
    options : InspectionOptions
        All other options.

    Returns
    -------
    InspectionPlan
        Settings, lower bound, and the entities that cannot be inspected.

    Raises
    ------
    RequestError, PlanFileError, OutputError
        As `plan_inspection`.
    """
    deadline = Deadline(options.time_limit_s, options.gap)
    lighting = options.lighting
    if not entities:
        raise RequestError.of_rule("entities", "must hold at least one entity", "none")
    if lighting is not None:
        lighting.check_part(solid)
    resolved = resolve_request(solid, entities, camera, pose_uncertainty, promise, options)
    asked = resolved.request
    if options.state is not None:
        asked.check_lasting()
    request = _request(solid, resolved, options, deadline)
    completed = partial(with_late_targets, targets=resolved.targets, means=request.means)
    late = len(request.names) < len(resolved.targets)
    # the state of a search belongs to all targets
    memo = PlanningState(asked.identity(), None if late else options.state)
    callbacks = Callbacks(
        on_best=_after(completed, options.on_incumbent),
        progress=options.progress,
        deadline=deadline,
    )
    incumbents = Incumbents(callbacks)
    if memo.plan is None:
        run = Run(
            request,
            asked.seed,
            asked.effort,
            memo,
            executor=options.executor,
            callbacks=callbacks,
        )
        try:
            memo.finish(run_stages(run, incumbents, lighting))
        except TimeIsUpError:
            ended = settle_early(run, incumbents.latest, incumbents.proven)
            incumbents.publish(ended)
            return completed(_lit(ended, solid, lighting))
        finally:
            memo.save()
    assert memo.plan is not None
    incumbents.publish(memo.plan)
    return completed(memo.plan)


def _after(
    completed: Callable[[InspectionPlan], InspectionPlan],
    on_incumbent: Callable[[InspectionPlan], object] | None,
) -> Callable[[InspectionPlan], object] | None:
    """Return a callable that takes in plans as ``completed`` returns them."""
    if on_incumbent is None:
        return None
    return lambda plan: on_incumbent(completed(plan))


def _request(
    solid: Solid, resolved: ResolvedRequest, options: InspectionOptions, deadline: Deadline
) -> Request:
    """Return the request with where its targets are observable, without those whose region was late."""
    asked, entities, targets = resolved
    rest = (
        asked.camera,
        asked.pose_uncertainty,
        asked.accuracy,
        asked.probability,
        asked.requirements,
    )
    space = options.space
    if space is None:
        regions = visible_regions(
            solid,
            entities,
            asked,
            executor=options.executor,
            progress=options.progress,
            deadline=deadline.of_regions(),
        )
        space = space_of(asked, regions)
    missing = {name for name in entities if name not in space.entities}
    if missing and not deadline.limited:
        raise RequestError.of_rule(
            "space", "must hold all entities that are wanted", f"no {min(missing)!r}"
        )
    targets = tuple(target for target in targets if not missing.intersection(needed(target)))
    if not targets:
        raise RequestError.of_rule(
            "time_limit_s",
            "must be long enough to compute from where one target is observable",
            f"{options.time_limit_s:g}",
        )
    joined = TargetSpace.of(space, targets)
    found_by = asked.localisation, asked.surfaces_mm
    request = Request(joined, joined.entity_names, *rest, targets, *found_by)
    return registered_request(request, asked.registration)


def visible_regions(
    solid: Solid,
    entities: Mapping[str, Any],
    request: InspectionRequest,
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
    request : InspectionRequest
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


def space_of(request: InspectionRequest, regions: VisibilityRegions) -> Space:
    """Return the space that is planned in: with a ring light, where edges show to the camera."""
    from aspectgraph import LightRegions

    if request.ring is None or not isinstance(regions, LightRegions):
        return regions
    step = DEFAULT_STEP if request.ring.step is None else request.ring.step
    return RingSpace(regions, request.camera, step)


def _lit(plan: InspectionPlan, solid: Solid, lighting: Lighting | None) -> InspectionPlan:
    """Return a plan that was ended early, with lamps for the settings it has."""
    return plan if lighting is None else replace(plan, light=chosen_lamps(lighting, plan, solid))
