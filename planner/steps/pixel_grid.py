"""Which edges the pixel grid decides about, and how a pose is found for them.

Where the tolerance is less than two pixels, the probability of the paper's density is known to be wrong for one planned
pose, either way. Two kinds of edges are counted on the grid instead: those that the density refuses, and those of which
none of the best poses that it accepts stands on the grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from errors.telling import probability_text
from planner.camera.pose import world_to_cam
from planner.columns.candidates import column_seed, judged_poses
from planner.columns.perturb import perturbed
from planner.executors import in_order
from planner.progress import report
from planner.request.pixel_grid import GRID, GridObjective, lowered, tolerance_px
from planner.setting.sensor_setting import SensorSetting
from planner.steps.run import Run

# the checkpoint after it
COUNTED = "pixel grid"


@dataclass(frozen=True)
class Counting:
    """How hard a pose is looked for that stands on the pixel grid.

    Attributes
    ----------
    best : int
        Of the poses that inspect an edge, so many are counted before the density is mistrusted.
    around : int
        Poses tried around the best one of an edge's own run: the phases of the grid differ from one to the next.
    told : int
        Of those, so many are counted to say how sure the best one is if none suffices.
    looks : int
        Looks at most at what simulation contradicts in the columns found, before the bound is proven.
    pricing : int
        Rounds of column generation after each.
    rounds : int
        Plans made again at most, because simulation contradicts the density in what was chosen.
    """

    best: int = 20
    around: int = 3000
    told: int = 300
    looks: int = 3
    pricing: int = 5
    rounds: int = 3


COUNTING = Counting()


def count_on_grid(run: Run, names: Sequence[str]) -> None:
    """Let the pixel grid decide about these edges: draw poses for them, and around the best ones known.

    Parameters
    ----------
    run : Run
        Its pools get the poses; its reasons are brought up to date.
    names : sequence of str
        The edges.
    """
    if not names:
        return
    run.count_on_grid(names)
    arguments = [(run.shared, name, run.effort.viewpoints, run.seed) for name in names]
    for poses, judged in in_order(run.executor, judged_poses, arguments):
        run.pools.add(poses, judged)
    for k, name in enumerate(names):
        near, own = _poses_around(run, name), run.names.index(name)
        # of no worth is what does not inspect this edge
        run.pools.add(near, run.judge(near, 2.0 * (np.arange(len(run.names)) == own)))
        if run.pool.membership[:, own].any():
            run.uninspectable.pop(name, None)
        else:
            run.uninspectable[name] = _reason_on_grid(run, name, near)
        report(run.progress, k + 1, len(names), COUNTED)


def contradicted(run: Run, settings: Sequence[SensorSetting]) -> list[str]:
    """Return the edges that simulation contradicts in chosen settings and the pixel grid does not yet decide about."""
    names = []
    for setting in settings:
        excess = run.contradicted_in(setting)
        names += [
            name
            for name in excess
            if name not in run.request.on_grid and _is_fine(run, name, setting.cam2world)
        ]
    return [name for name in run.names if name in names]


def decided_on_grid(run: Run) -> list[str]:
    """Return the edges that the pixel grid is to decide about, in the order of the request."""
    found = []
    for i, name in enumerate(run.names):
        poses = _poses_of(run, i)
        if len(poses) and all(_is_fine(run, name, pose) for pose in poses):
            refused = name in run.uninspectable
            if refused or not (frequencies(run, i, poses) >= run.request.probability).any():
                found.append(name)
    return found


def _is_fine(run: Run, name: str, cam2world: NDArray[np.float64]) -> bool:
    """Tell whether the pixel grid may decide about an item seen from a pose: an edge, and its tolerance is small."""
    request, i = run.request, run.names.index(name)
    if i in request.dimensions or (
        request.localisation is not None and request.localisation.model != "rounding"
    ):
        return False
    ends = request.ends[i : i + 1]
    return bool(
        tolerance_px(ends, cam2world[None], request.camera, request.accuracy)[0, 0] < GRID.below_px
    )


def _poses_around(run: Run, name: str) -> NDArray[np.float64]:
    """Return poses around the best one that the run of an edge alone found; none if it found none."""
    outcome = run.memo.get((name,))
    start = run.pool.best_containing(np.isin(run.names, [name]))
    if outcome is not None and outcome.setting is not None:
        pose = outcome.setting.cam2world
    elif start is not None:
        pose = run.pool.poses[start]
    else:
        return np.zeros((0, 4, 4))
    rng = np.random.default_rng(column_seed(run.seed, ["pixel grid", name]))
    many = np.repeat(pose[None], COUNTING.around, axis=0)
    return np.concatenate([pose[None], perturbed(many, run.request.camera.focus_distance_mm, rng)])


def _reason_on_grid(run: Run, name: str, poses: NDArray[np.float64]) -> str:
    """Say how sure an edge is that no pose measures surely enough on the grid either."""
    i = run.names.index(name)
    alone = run.request.of([name])
    feasible = poses[alone.constraints.feasible(poses)][: COUNTING.told] if len(poses) else poses
    best = float(lowered(frequencies(run, i, feasible)).max(initial=0.0))
    required = run.request.probability
    return (
        f"probability too low: the best pose found reaches P = {probability_text(best, required)}, below the required "
        f"{required:g} (counted on the pixel grid, as the tolerance is under two pixels)."
    )


def _poses_of(run: Run, i: int) -> NDArray[np.float64]:
    """Return the best poses that inspect an edge, or the one of its own run if none does."""
    if run.names[i] in run.uninspectable:
        outcome = run.memo.get((run.names[i],))
        none = np.zeros((0, 4, 4))
        return (
            none if outcome is None or outcome.setting is None else outcome.setting.cam2world[None]
        )
    rows = np.flatnonzero(run.pool.membership[:, i])
    return run.pool.poses[rows[np.argsort(-run.pool.quality[rows], kind="stable")[: COUNTING.best]]]


def frequencies(run: Run, i: int, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how often the edge with number i is measured accurately on the pixel grid from poses (n, 4, 4); (n,)."""
    request = run.request
    grid = GridObjective(
        request.objective_of("sum", "joint"),
        np.array([i]),
        request.camera,
        request.pose_uncertainty,
        request.accuracy,
    )
    return grid.frequencies(world_to_cam(request.ends[i], poses))
