"""One sensor setting for one set of entities: the paper's genetic search, section 4."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.argument_kinds import ITEMS, check_kinds
from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.detectability.conditions import NOT_ASKED, Detectability
from planner.effort.poses import Search
from planner.exceptions import RequestError
from planner.request.constraints import Requirements
from planner.request.defaults import (
    check_focus_margin,
    check_showing,
    pose_margin_px,
    position_margin_mm,
)
from planner.request.reach import Reach
from planner.request.request import Request
from planner.request.space import Space
from planner.setting.infeasible import (
    check_extent,
    check_observable,
    check_resolvable,
    missing_corners,
)
from planner.setting.pose_search import search_pose
from planner.setting.sensor_setting import SensorSetting
from planner.wanted.targets import check_is_edge


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
    field_of_view: str = "exact",
    visibility_radius_mm: float | None = None,
    focus_margin_mm: float = 0.0,
    showing: Detectability = NOT_ASKED,
    reach: Reach | None = None,
    objective: str = "sum",
    model: str = "joint",
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
    request = Request(space, names, camera, pose_uncertainty, accuracy, requirements=need)
    return best_setting(
        request,
        rng,
        objective=objective,
        model=model,
        search=search,
        start=start,
        callback=callback,
    )


def best_setting(
    request: Request,
    rng: int | np.random.Generator | None,
    *,
    objective: str = "sum",
    model: str = "joint",
    search: Search | None = None,
    start: ArrayLike | None = None,
    callback: Callable[..., Any] | None = None,
) -> SensorSetting:
    """Find the best pose for all entities of a request: `plan_setting` for those who have the request.

    Parameters
    ----------
    request : Request
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
    constraints = request.constraints
    goal = request.objective_of(objective, model)
    check_resolvable(constraints)
    check_extent(constraints)
    for error in missing_corners(constraints).values():
        raise error
    cells = check_observable(request.space, request.names)
    outcome = search_pose(
        cells, constraints, goal, search or Search(), generator, _check_poses(start), callback
    )
    pose = outcome.cam2world[None]
    probability = goal.probability(pose)[0]
    return SensorSetting(
        cam2world=outcome.cam2world,
        entities=request.names,
        probability=dict(zip(request.names, probability.tolist(), strict=True)),
        margins={name: float(margin.min()) for name, margin in constraints.margins(pose).items()},
        fitness=outcome.fitness,
        nfev=outcome.nfev,
        generations=outcome.generations,
        message=outcome.message,
        seed=seed,
        history=outcome.history,
        witness={name: request.chosen[name] for name in request.names if name in request.chosen},
        registered=request.known_at(outcome.cam2world, request.names),
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
