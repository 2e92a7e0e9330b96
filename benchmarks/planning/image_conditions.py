"""What separation, corners and surroundings take from poses: how many entities a pose inspects with and without each.

    python benchmarks/planning/image_conditions.py [--part mfcad-default] [--folder DIR] [--near 60]

The poses are those of the greedy cover without these conditions, and others drawn near them: poses that inspect many
entities, as the lower bound counts. It knows none of these conditions, so the table tells how much they could raise it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from anytime import CASES, PROBABILITY, UNCERTAINTY, Case, judge_of
from planners import PLANNERS
from scipy.spatial.transform import Rotation

from planner.detectability.conditions import NOT_ASKED, USUAL, Detectability
from planner.request.problem import Problem
from planner.search.columns import Judge

# standard deviations of the poses drawn, mm and rad
SHIFT_MM = 1.0
TURN_RAD = 0.02
BATCH = 500
CONDITIONS = {
    "none": NOT_ASKED,
    "surroundings": replace(NOT_ASKED, surround_px=USUAL.surround_px),
    "corners": replace(NOT_ASKED, min_corner_deg=USUAL.min_corner_deg),
    "separation": replace(NOT_ASKED, separation_px=USUAL.separation_px),
    "all three": USUAL,
}


def judge_for(case: Case, first: Judge, showing: Detectability) -> Judge:
    """Return a judge of the same request with other conditions on the image."""
    need = replace(case, by_default=True).options(showing=showing)
    wanted = need.requirements(first.camera, UNCERTAINTY)
    promise = (case.accuracy, PROBABILITY)
    return Judge(Problem(first.space, first.names, first.camera, UNCERTAINTY, *promise, wanted))


def poses_near(poses: np.ndarray, each: int) -> np.ndarray:
    """Return poses (n * each, 4, 4) drawn near poses (n, 4, 4)."""
    rng = np.random.default_rng(1)
    drawn = np.repeat(poses, each, axis=0)
    turns = Rotation.from_rotvec(rng.normal(0.0, TURN_RAD, (len(drawn), 3))).as_matrix()
    drawn[:, :3, :3] = drawn[:, :3, :3] @ turns
    drawn[:, :3, 3] += rng.normal(0.0, SHIFT_MM, (len(drawn), 3))
    return drawn


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", default="mfcad-default", choices=CASES)
    parser.add_argument("--folder", type=Path, default=Path())
    parser.add_argument("--near", type=int, default=60, help="poses drawn near each one")
    given = parser.parse_args()
    case = CASES[given.part]
    first, _ = judge_of(case, given.folder)
    (greedy,) = (plan for name, plan in PLANNERS.items() if name.startswith("greedy"))
    poses = poses_near(greedy(judge_for(case, first, NOT_ASKED), 0)[0], given.near)
    print(f"{len(poses)} poses\n{'conditions':14}{'mean':>8}{'99 %':>6}{'most':>6}{'any':>7}")
    for name, showing in CONDITIONS.items():
        judge = judge_for(case, first, showing)
        batches = [poses[k : k + BATCH] for k in range(0, len(poses), BATCH)]
        n = np.concatenate([judge(batch).inspects.sum(axis=1) for batch in batches])
        print(
            f"{name:14}{n.mean():8.2f}{np.quantile(n, 0.99):6.0f}{n.max():6}{np.mean(n > 0):7.2f}"
        )


if __name__ == "__main__":
    main()
