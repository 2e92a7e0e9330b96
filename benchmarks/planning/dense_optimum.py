"""Where the gap is: plans beside the smallest cover over a dense pool of poses, and beside the proven bound.

``python benchmarks/planning/dense_optimum.py [--parts own-block ...] [--poses 200000] [--folder DIR] [--json FILE]``

A plan is a few settings, and its bound says that fewer than some number can never do. Which of the two is far from what
is possible? For each request, many poses are judged. The first twentieth looks from anywhere at the part, as many have
entities in focus, and all others are near the best known ones: near those of the pool, and near those that nearly
inspect a set that would improve the cover. These are judged with prices, the dual of the relaxation over the columns so
far: only of poses worth more than 1 is all asked. Columns that displaced poses do not show are cut as in the search.
Of all these columns and those of the plan, an integer program (HiGHS) chooses the fewest that inspect what the
plan inspects. It also states how many are needed at least *of this pool*, and the relaxation's value.

The pool is optimistic: a plan counts everything over displaced poses before it states it. So the smallest cover is
chosen again and again, and its columns are counted, until all of one hold as counted (row generation). Where a column
is short of a target, a pose nearby of which a count shows more is looked for, as the search does.

If that cover is smaller than the plan, the plan is not the best one. If it is as large and far above the bound, the
bound is weak there, or poses exist that no draw has met.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from anytime import CASES, PROBABILITY, UNCERTAINTY, Case, judge_of, narrow, solid_of
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import csr_matrix

from aspectgraph import compute_regions
from planner import Camera, Effort, InspectionPlan, PoseUncertainty
from planner.camera.pose import look_at
from planner.cover import fractional_cover
from planner.inspection import plan_inspection
from planner.options import InspectionOptions
from planner.request.camera_limits import default_workspace
from planner.request.problem import Problem
from planner.search.columns import ColumnPool, Judge, Pools, perturbed, poses_in_focus
from planner.search.realise_column import shortfalls
from planner.search.surer_poses import surer_pose

# a block of 14 faces, 30 x 20 x 15 mm, and ten of its edges
BLOCK = "own-block"
BLOCK_FILE = "own_block.step"
BLOCK_EDGES = (2, 5, 10, 12, 13, 20, 28, 33, 34, 35)
BLOCK_CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 11.0, 250.0)
BLOCK_UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
# beside those of the comparison
OTHERS = {
    "mfcad-4-default": Case("mfcad_4-5-5-6-9-23.step", narrow(120.0), 0.98, by_default=True),
    "mfcad-6-default": Case("mfcad_6-11-11-19.step", narrow(120.0), 0.98, by_default=True),
}
REQUESTS = {**CASES, **OTHERS}
PARTS = (*CASES, BLOCK, *OTHERS)
# poses judged at a time; the columns kept of them are where the next ones are drawn
_ROUND = 2_000
# of the displaced poses of counts
_SEED = 7
# of all poses, this share looks from anywhere, and as many have entities in focus
_DRAWN = 0.05


@dataclass(frozen=True)
class Gap:
    """What is known of one request.

    Attributes
    ----------
    part, effort : str
        The request, and the preset of the plan.
    asked, targets : int
        Targets of the request, and those of them that the plan inspects.
    plan, bound : int
        Settings of the plan, and its proven bound.
    poses, columns : int
        Poses judged for the pool, and its columns that no other one contains.
    optimum : int
        Columns of the smallest cover that the integer program found, as judged.
    at_least : int
        Columns that a cover of this pool needs, as judged.
    counted : int
        Columns of the smallest cover found of which each was counted.
    relaxation : float
        Value of the linear relaxation of the cover over this pool.
    plan_seconds, pool_seconds : float
        Processor time of the plan after its regions, and of pool and integer program, threads added up.
    """

    part: str
    effort: str
    asked: int
    targets: int
    plan: int
    bound: int
    poses: int
    columns: int
    optimum: int
    at_least: int
    counted: int
    relaxation: float
    plan_seconds: float = 0.0
    pool_seconds: float = 0.0


def judge_for(part: str, folder: Path) -> Judge:
    """Return the judge of a request."""
    return block_judge(folder) if part == BLOCK else judge_of(REQUESTS[part], folder)[0]


def planned(
    part: str, judge: Judge, effort: Effort, limit_s: float | None, seed: int
) -> InspectionPlan:
    """Return the plan."""
    how = {"space": judge.space, "effort": effort, "time_limit_s": limit_s, "rng": seed}
    if part == BLOCK:
        options = InspectionOptions(**how)
        uncertainty = BLOCK_UNCERTAINTY
    else:
        options = REQUESTS[part].options(**how)
        uncertainty = UNCERTAINTY
    space = judge.space
    return plan_inspection(
        space.solid,
        {name: space.entities[name] for name in space.entity_names},
        judge.camera,
        uncertainty,
        options,
        accuracy=judge.accuracy,
        probability=PROBABILITY,
    )


def block_judge(folder: Path) -> Judge:
    """Return the judge of the block."""
    solid = solid_of(BLOCK_FILE, folder)
    wanted = {f"e{k}": k for k in BLOCK_EDGES}
    workspace = default_workspace(solid, BLOCK_CAMERA)
    space = compute_regions(solid, wanted, workspace=workspace)
    options = InspectionOptions()
    need = options.requirements(BLOCK_CAMERA, BLOCK_UNCERTAINTY)
    return Judge(
        Problem(
            space,
            space.entity_names,
            BLOCK_CAMERA,
            BLOCK_UNCERTAINTY,
            options.accuracy,
            PROBABILITY,
            need,
        )
    )


def anywhere(judge: Judge, n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw poses (n, 4, 4) that look from anywhere, at any distance in focus, at points between two targets."""
    middles = judge.ends.mean(axis=1)
    one, other = middles[rng.integers(len(middles), size=(2, n))]
    targets = one + rng.random((n, 1)) * (other - one)
    nearest, farthest = judge.camera.depth_of_field_mm
    away = rng.normal(size=(n, 3))
    distance = rng.uniform(nearest, min(farthest, 10 * nearest), n)
    away *= (distance / np.linalg.norm(away, axis=1))[:, None]
    return look_at(targets + away, targets, roll=rng.uniform(-np.pi, np.pi, n))


def dense_pool(judge: Judge, known: np.ndarray, n: int, seed: int) -> ColumnPool:
    """Return the columns of n judged poses and of some known ones (m, 4, 4)."""
    rng = np.random.default_rng(seed)
    pools = Pools(*(ColumnPool(len(judge.names)) for _ in Pools._fields))
    same_worth = np.ones(len(judge.names))
    pools.add(known, judge(known), judge.steady)
    rounds = -(-n // _ROUND)
    for k in range(rounds):
        if k < _DRAWN * rounds:
            poses = anywhere(judge, _ROUND, rng)
        elif k < 2 * _DRAWN * rounds:
            poses = poses_in_focus(judge, same_worth, _ROUND // 10, 10, rng)
        else:
            prices = priced(pools.realised, rng)
            parents = _parents(pools, known, prices, rng)
            near = perturbed(parents, judge.camera.focus_distance_mm, rng)
            poses = _in_workspace(judge, near)
            pools.add(poses, judge(poses, prices), judge.steady)
            continue
        poses = _in_workspace(judge, poses)
        pools.add(poses, judge(poses), judge.steady)
    return pools.realised


def priced(pool: ColumnPool, rng: np.random.Generator) -> np.ndarray:
    """Return prices (k,): a dual of the relaxation over the columns, other ones every time; 1 of what is in none."""
    covered = pool.inspected
    prices = np.ones(len(covered))
    bias = 1.0 + 0.5 * rng.random(int(covered.sum()))
    prices[covered] = fractional_cover(pool.membership[:, covered], bias)[1]
    return prices


def _parents(
    pools: Pools, known: np.ndarray, prices: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return a round's parents: half of them would improve the cover if they were put right."""
    near = pools.near
    misses = near.poses[near.membership @ prices > 1.0]
    others = np.concatenate([known, pools.realised.poses])
    chosen = others[rng.integers(len(others), size=_ROUND // 2)]
    hopeful = misses if len(misses) else others
    return np.concatenate([chosen, hopeful[rng.integers(len(hopeful), size=_ROUND // 2)]])


def _in_workspace(judge: Judge, poses: np.ndarray) -> np.ndarray:
    low, high = np.asarray(judge.space.workspace, dtype=float)
    positions = poses[:, :3, 3]
    return poses[((positions >= low) & (positions <= high)).all(axis=1)]


def smallest_cover(membership: np.ndarray, seconds: float) -> tuple[np.ndarray, int, float]:
    """Return a smallest cover found (c,), how many columns are needed at least, and the relaxation's value."""
    contains = csr_matrix(membership.T.astype(float))
    cost = np.ones(len(membership))
    relaxed = linprog(cost, A_ub=-contains, b_ub=-np.ones(contains.shape[0]))
    whole = milp(
        cost,
        integrality=cost,
        bounds=Bounds(0, 1),
        constraints=LinearConstraint(contains, lb=1.0),
        options={"time_limit": seconds},
    )
    at_least = int(np.ceil(max(whole.mip_dual_bound, relaxed.fun) - 1e-6))
    return np.flatnonzero(whole.x > 0.5), at_least, float(relaxed.fun)


def counted_cover(
    judge: Judge, pool: ColumnPool, settings: np.ndarray, wanted: np.ndarray, seconds: float
) -> int:
    """Return how many columns the smallest cover takes that was found of counted ones.

    Parameters
    ----------
    judge : Judge
        Holds the request.
    pool : ColumnPool
        Columns as judged.
    settings : array of bool (s, k)
        Columns of the plan, which are counted.
    wanted : array of bool (k,)
        What is to be covered.
    seconds : float
        For each integer program.
    """
    judged = pool.membership
    poses = pool.poses
    counted = settings
    while True:
        cover, _, _ = smallest_cover(np.concatenate([judged, counted])[:, wanted], seconds)
        new = cover[cover < len(judged)]
        if not new.size:
            return len(cover)
        held = [_as_counted(judge, poses[c], judged[c] & wanted) for c in new]
        counted = np.concatenate([counted, *held])
        judged = np.delete(judged, new, axis=0)
        poses = np.delete(poses, new, axis=0)


def _as_counted(judge: Judge, pose: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return what counts show of a column, at its pose and at a surer one nearby; (1 or 2, k)."""
    names = tuple(np.array(judge.names)[column].tolist())
    here = np.isin(judge.names, names) & ~_short(judge, pose, names)
    if (here == column).all():
        return here[None]
    stated = dict(zip(judge.names, judge(pose[None]).probability[0].tolist(), strict=True))
    surer = surer_pose(judge, pose, {name: stated[name] for name in names}, _SEED)
    if surer is None:
        return here[None]
    return np.stack([here, column & ~_short(judge, surer, names)])


def _short(judge: Judge, pose: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    return np.isin(judge.names, list(shortfalls(judge, pose, names, _SEED)))


def gap(
    part: str, effort: str, judge: Judge, plan: InspectionPlan, n_poses: int, seconds: float
) -> Gap:
    """Measure one request; the integer program may take so many seconds."""
    known = np.array([setting.cam2world for setting in plan.settings])
    pool = dense_pool(judge, known, n_poses, 0)
    inspected = np.isin(judge.names, list(plan.inspected))
    # what the plan promises is a column, whatever the judge says without displaced poses
    settings = np.array([np.isin(judge.names, setting.entities) for setting in plan.settings])
    columns = np.concatenate([pool.membership, settings])[:, inspected]
    optimum, at_least, relaxation = smallest_cover(columns, seconds)
    counted = counted_cover(judge, pool, settings, inspected, seconds)
    return Gap(
        part,
        effort,
        len(judge.names),
        columns.shape[1],
        len(plan.settings),
        plan.lower_bound,
        n_poses,
        len(pool),
        len(optimum),
        at_least,
        counted,
        relaxation,
    )


def measured(part: str, given: argparse.Namespace) -> Gap:
    """Plan and measure one request, with the options of the command line."""
    judge = judge_for(part, given.folder)
    start = time.process_time()
    effort = Effort.named(given.effort)
    plan = planned(part, judge, effort, given.limit, given.seed)
    between = time.process_time()
    row = gap(part, given.effort, judge, plan, given.poses, given.seconds)
    pool_seconds = time.process_time() - between
    return replace(row, plan_seconds=between - start, pool_seconds=pool_seconds)


def main() -> None:
    """Print a row per request; add it to a file if one is named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--poses", type=int, default=200_000)
    parser.add_argument("--effort", default="quick", choices=("quick", "standard", "thorough"))
    parser.add_argument("--limit", type=float, help="seconds for the plan, wall time")
    parser.add_argument("--seed", type=int, default=0, help="of the plan")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each integer program")
    parser.add_argument("--folder", type=Path, default=Path(), help="of the parts, at any depth")
    parser.add_argument("--json", type=Path, help="add every row to this file")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    print("".join(f"{entry.name:>16}" for entry in fields(Gap)), flush=True)
    for part in given.parts:
        row = {
            k: round(v, 2) if isinstance(v, float) else v
            for k, v in asdict(measured(part, given)).items()
        }
        print("".join(f"{value:>16}" for value in row.values()), flush=True)
        if given.json is not None:
            rows = json.loads(given.json.read_text()) if given.json.exists() else []
            given.json.write_text(json.dumps([*rows, row], indent=1) + "\n")


if __name__ == "__main__":
    main()
