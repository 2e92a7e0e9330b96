"""How long counts over displaced poses take, with and without looking at lines that are far from the edge.

``python benchmarks/planning/count_speed.py mfcad-default --folder PARTS``

A count looks at the images of displaced poses near each other. Lines of the part that show near the edge in none of
them are left out beforehand (`planner.detectability.vicinity.Vicinity`). The counts are the same, which
is checked. Shown is the processor time of a few counts, each way in turn.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

# before numpy: threads of small matrices only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from anytime import CASES, judge_of

from planner.detectability import image_check
from planner.search.columns import Judge, entity_poses
from planner.search.realise_column import joint_counts

# counts, and poses drawn for every third target, of which some are counted
_COUNTS = 25
_VIEWPOINTS = 6
_NEVER = 1_000_000


def inspecting(judge: Judge) -> list[tuple[np.ndarray, list[str]]]:
    """Return poses that inspect something, and what."""
    poses = np.concatenate([entity_poses(judge, name, _VIEWPOINTS, 1) for name in judge.names[::3]])
    inspects = judge(poses).inspects
    rows = np.flatnonzero(inspects.any(axis=1))
    rows = rows[:: max(1, len(rows) // _COUNTS)][:_COUNTS]
    return [(poses[row], np.array(judge.names)[inspects[row]].tolist()) for row in rows]


def counted(
    judge: Judge, seen: list[tuple[np.ndarray, list[str]]], least: int
) -> tuple[list, float]:
    """Return the counts, and their seconds, if lines are left out from so many poses on."""
    image_check._MANY_NEAR = least
    start = time.process_time()
    counts = [joint_counts(judge, pose, names, 5) for pose, names in seen]
    return counts, time.process_time() - start


def main() -> None:
    """Print a line for each round."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("case", choices=list(CASES))
    parser.add_argument("--folder", type=Path, default=Path(), help="of parts not in the examples")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    judge, _ = judge_of(CASES[given.case], given.folder)
    seen = inspecting(judge)
    least = image_check._MANY_NEAR
    counted(judge, seen, least)
    for _ in range(given.rounds):
        plain, plain_s = counted(judge, seen, _NEVER)
        fewer, fewer_s = counted(judge, seen, least)
        assert plain == fewer
        print(
            f"all lines {plain_s:.3f} s, near ones {fewer_s:.3f} s, ratio {fewer_s / plain_s:.2f}"
        )


if __name__ == "__main__":
    main()
