"""Ways to plan a whole inspection: settings needed, entities left out, worst probability, time.

``python benchmarks/planning/planners.py [--parts block slotted ctc] [--seeds 3] [--csv FILE]``

The notebook comparisons shows such a file.

* generate and test, one dome: viewpoints on a geodesic dome around the part, looking at its middle (HEAVEN: S. Sakane,
  T. Sato, M. Kakikura, 1987), each rolled to four positions; every pose is tested; then the minimum cover of what they
  inspect. The dome is as close as its camera can focus on all of the part, or on its middle if it never can.
* generate and test, dome per entity: the same around the middle of every entity, at the focus distance.
* constraint-weighted synthesis: for a given set of entities maximise the weighted sum of the constraints' margins by a
  local optimiser from several starts (C. K. Cowan, P. D. Kovesi, 1988; MVP: K. A. Tarabanis, R. Y. Tsai, P. K. Allen,
  1995). Neither says how to divide the entities: here a set grows by the nearest entity left while that succeeds.
* greedy cover: the planner's own first candidates, without column generation, and always the pose that inspects most
  of what is left.
* plan_inspection: ours, with the proven lower bound.

All are judged alike: same constraints, same exact visibility, same threshold of the probability. "worst P" is over the
inspected entities, each in its best setting.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from dataclasses import astuple, dataclass, fields

import numpy as np
from cases import SETUPS, regions
from scipy.optimize import minimize

from planner.camera.pose import look_at
from planner.cover import greedy_cover, min_cover
from planner.detectability.conditions import NOT_ASKED
from planner.inspection import plan_inspection
from planner.request.camera_limits import position_margin_mm
from planner.request.constraints import Constraints, Requirements
from planner.request.problem import Problem
from planner.search.columns import Judge, entity_poses
from planner.search.poses import PoseEncoding, ViewpointSampler

THRESHOLD = 0.9
_ROLLS = 4
_STARTS = 4
_SYNTHESIS_STEP = 1e-4


@dataclass(frozen=True)
class Outcome:
    """Settings of a plan, entities nobody inspects, worst probability, proven lower bound (or None), processor time."""

    settings: int
    missing: int
    worst: float
    bound: int | None
    poses: int
    seconds: float


def icosphere(subdivisions: int) -> np.ndarray:
    """Return the directions (n, 3) of a geodesic dome: an icosahedron whose triangles are cut in four repeatedly."""
    golden = (1 + 5**0.5) / 2
    corners = [np.roll([0.0, s, t * golden], k) for k in range(3) for s in (-1, 1) for t in (-1, 1)]
    points = np.array(corners) / np.hypot(1.0, golden)
    edge = 2.0 / np.hypot(1.0, golden)
    for _ in range(subdivisions):
        distance = np.linalg.norm(points[:, None] - points[None], axis=2)
        # edges bulge by at most 1.25 times; the next distance is more than 1.5 times as long
        i, j = np.nonzero(np.triu((distance > 0) & (distance < 1.3 * edge)))
        middles = points[i] + points[j]
        points = np.vstack([points, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        edge /= 2
    return points


def dome_poses(centre: np.ndarray, radius: float, subdivisions: int) -> np.ndarray:
    """Return poses (n, 4, 4) on a dome, looking at its centre, each in `_ROLLS` rolls of less than half a turn."""
    positions = np.repeat(centre + radius * icosphere(subdivisions), _ROLLS, axis=0)
    return look_at(
        positions,
        centre,
        roll=np.tile(np.arange(_ROLLS) * np.pi / _ROLLS, len(positions) // _ROLLS),
    )


def one_dome(judge: Judge, seed: int) -> tuple[np.ndarray, int]:
    """Poses on one dome around the part that a minimum cover chooses."""
    low, high = judge.space.solid.bounds
    nearest, farthest = judge.camera.depth_of_field_mm
    radius = np.linalg.norm(high - low) / 2
    distance = (
        nearest + radius if nearest + 2 * radius <= farthest else judge.camera.focus_distance_mm
    )
    return _cover(judge, dome_poses((low + high) / 2, distance, 3))


def entity_domes(judge: Judge, seed: int) -> tuple[np.ndarray, int]:
    """Poses on a dome around every entity that a minimum cover chooses."""
    domes = [
        dome_poses(ends.mean(axis=0), judge.camera.focus_distance_mm, 3) for ends in judge.ends
    ]
    return _cover(judge, np.concatenate(domes))


def _cover(judge: Judge, poses: np.ndarray, greedy: bool = False) -> tuple[np.ndarray, int]:
    """Return the poses of a cover of all that the poses inspect, and how many were tested."""
    low, high = judge.space.workspace
    inside = ((poses[:, :3, 3] >= low) & (poses[:, :3, 3] <= high)).all(axis=1)
    judged = judge(poses[inside])
    tested = len(poses)
    poses = poses[inside]
    membership = judged.inspects[:, judged.inspects.any(axis=0)]
    if not membership.size:
        return poses[:0], tested
    if greedy:
        return poses[greedy_cover(membership)], tested
    quality = np.where(judged.inspects, judged.probability, 1.0).min(axis=1)
    distinct = _best_of_each(membership, quality)
    return poses[distinct[list(min_cover(membership[distinct], quality[distinct]).chosen)]], tested


def _best_of_each(membership: np.ndarray, quality: np.ndarray) -> np.ndarray:
    """Return the rows with the best quality among equal rows."""
    order = np.argsort(-quality, kind="stable")
    return order[np.unique(membership[order], axis=0, return_index=True)[1]]


def greedy(judge: Judge, seed: int) -> tuple[np.ndarray, int]:
    """Poses chosen greedily from the planner's own first candidates."""
    return _cover(
        judge,
        np.concatenate([entity_poses(judge, name, 100, seed) for name in judge.names]),
        greedy=True,
    )


def synthesis(judge: Judge, seed: int) -> tuple[np.ndarray, int]:
    """Poses of the constraint-weighted synthesis for sets that grow by the nearest entity left."""
    rng = np.random.default_rng(seed)
    middles = judge.ends.mean(axis=1)
    left = list(range(len(judge.names)))
    chosen = []
    tested = 0
    while left:
        group = [left[0]]
        pose = None
        by_distance = sorted(left, key=lambda k: np.linalg.norm(middles[k] - middles[left[0]]))
        for k in by_distance:
            wanted = group if k == left[0] else [*group, k]
            found, n = synthesise(judge, wanted, rng)
            tested += n
            if found is None and k == left[0]:
                break
            if found is not None:
                group = wanted
                pose = found
        if pose is not None:
            chosen.append(pose)
        left = [k for k in left if k not in group]
    return np.array(chosen).reshape(-1, 4, 4), tested


def synthesise(judge: Judge, idx, rng) -> tuple[np.ndarray | None, int]:
    """Maximise the weighted sum of margins for a set of entities; return a pose (4, 4) that inspects it, or None.

    Weights: each margin over its natural size. A margin counts up to 1 only, and a violation ten times: else a large
    margin would pay for a missed one.
    """
    names = [judge.names[k] for k in idx]
    constraints = Constraints(judge.space, names, judge.camera, judge.requirements)
    sampler = ViewpointSampler(judge.space.covering_cells(names), constraints.ends, judge.camera)
    positions = sampler.sample(_STARTS, rng)
    if not len(positions):
        return None, 0
    encoding = PoseEncoding(
        sampler.bounds, constraints.sphere_centre, judge.camera.half_diagonal_rad
    )
    low = encoding.low
    span = encoding.high - encoding.low
    around = np.vstack([np.zeros(6), _SYNTHESIS_STEP * np.eye(6), -_SYNTHESIS_STEP * np.eye(6)])
    tested = 0

    def negative_sum(x):
        nonlocal tested
        poses = encoding.poses(low + (x + around) * span)
        tested += len(poses)
        total = np.zeros(len(poses))
        for name, margin in constraints.margins(poses).items():
            scaled = np.clip(margin / constraints.scale(name), -10.0, 1.0)
            total += np.where(scaled < 0, 10 * scaled, scaled).mean(axis=1)
        return -total[0], -(total[1:7] - total[7:]) / (2 * _SYNTHESIS_STEP)

    starts = np.hstack(
        [positions, np.zeros((len(positions), 2)), rng.uniform(-np.pi, np.pi, (len(positions), 1))]
    )
    ends = [
        minimize(
            negative_sum, (s - low) / span, jac=True, bounds=[(0.0, 1.0)] * 6, method="SLSQP"
        ).x
        for s in starts
    ]
    poses = encoding.poses(low + np.array(ends) * span)
    low_corner, high_corner = judge.space.workspace
    poses = poses[((poses[:, :3, 3] >= low_corner) & (poses[:, :3, 3] <= high_corner)).all(axis=1)]
    judged = judge(poses)
    good = judged.inspects[:, idx].all(axis=1)
    if not good.any():
        return None, tested
    worst = judged.probability[:, idx].min(axis=1)
    return poses[np.argmax(np.where(good, worst, -1.0))], tested


PLANNERS = {
    "generate and test, one dome": one_dome,
    "generate and test, dome per entity": entity_domes,
    "constraint-weighted synthesis": synthesis,
    "greedy cover of candidates": greedy,
}


def measure(judge: Judge, planner, seed: int) -> Outcome:
    """Run a rival and judge its poses."""
    start = time.process_time()
    poses, tested = planner(judge, seed)
    seconds = time.process_time() - start
    return _outcome(judge, poses, None, tested, seconds)


def measure_ours(judge: Judge, setup: str, seed: int) -> Outcome:
    """Run plan_inspection and judge its poses like those of a rival."""
    chosen = SETUPS[setup]
    space = judge.space
    start = time.process_time()
    plan = plan_inspection(
        space.solid,
        {name: space.entities[name] for name in space.entity_names},
        judge.camera,
        chosen.pose_uncertainty,
        accuracy=chosen.accuracy,
        probability=THRESHOLD,
        rng=seed,
        field_margin_px=chosen.field_margin_px,
        space=space,
        showing=NOT_ASKED,
        focus_margin_mm=0.0,
    )
    seconds = time.process_time() - start
    poses = np.array([setting.cam2world for setting in plan.settings]).reshape(-1, 4, 4)
    return _outcome(judge, poses, plan.lower_bound, 0, seconds)


def _outcome(
    judge: Judge, poses: np.ndarray, bound: int | None, tested: int, seconds: float
) -> Outcome:
    if not len(poses):
        return Outcome(0, len(judge.names), np.nan, bound, tested, seconds)
    judged = judge(poses)
    best = np.where(judged.inspects, judged.probability, 0.0).max(axis=0)
    inspected = best > 0
    worst = float(best[inspected].min()) if inspected.any() else np.nan
    return Outcome(len(poses), int((~inspected).sum()), worst, bound, tested, seconds)


def main() -> None:
    """Print a table per part; write every run to a file if one is named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=list(SETUPS), default=list(SETUPS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--csv", default=os.devnull, help="write every run to this file")
    arguments = parser.parse_args()
    with open(arguments.csv, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["part", "planner", "seed", *(field.name for field in fields(Outcome))])
        for setup in arguments.parts:
            for name, seed, outcome in compare(setup, arguments.seeds):
                writer.writerow([setup, name, seed, *astuple(outcome)])
                file.flush()


def compare(setup: str, seeds: int):
    """Print a part's table and yield (planner, seed, `Outcome`) of every run."""
    chosen = SETUPS[setup]
    space = regions(setup)
    need = Requirements(
        field_margin_px=chosen.field_margin_px,
        visibility_radius_mm=position_margin_mm(chosen.pose_uncertainty),
    )
    judge = Judge(
        Problem(
            space,
            space.entity_names,
            chosen.camera(),
            chosen.pose_uncertainty,
            chosen.accuracy,
            THRESHOLD,
            need,
        )
    )
    print(
        f"\n{chosen.part}: {len(judge.names)} entities, P >= {THRESHOLD} for an accuracy of {chosen.accuracy}"
    )
    print(
        f"  {'':<36}{'seed':>5}{'settings':>10}{'left out':>10}{'worst P':>9}{'poses':>9}{'seconds':>9}"
    )
    synthesise(judge, [0], np.random.default_rng(0))
    for seed in range(seeds):
        for name, planner in PLANNERS.items():
            outcome = measure(judge, planner, seed)
            print(_row(name, seed, outcome), flush=True)
            yield name, seed, outcome
        outcome = measure_ours(judge, setup, seed)
        print(_row("plan_inspection", seed, outcome), flush=True)
        yield "plan_inspection", seed, outcome


def _row(name: str, seed: int, outcome: Outcome) -> str:
    poses = str(outcome.poses) if outcome.poses else "-"
    bound = "" if outcome.bound is None else f"  proven: at least {outcome.bound}"
    return (
        f"  {name:<36}{seed:5d}{outcome.settings:10d}{outcome.missing:10d}{outcome.worst:9.3f}{poses:>9}"
        f"{outcome.seconds:9.2f}{bound}"
    )


if __name__ == "__main__":
    main()
