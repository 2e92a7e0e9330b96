"""How long presets of the effort take, and what they find: wall time and processor time of whole requests.

    python benchmarks/planning/efforts.py mfcad-default --folder PARTS --efforts quick standard

The requests are those of `benchmarks/planning/anytime.py`. Visible regions are there beforehand, and plans on the way
are asked for, as the command line does. Each request is planned by as many processes as are named.
"""

from __future__ import annotations

import argparse
import os
import time

# before numpy: threads of small matrices only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from anytime import CASES, PROBABILITY, UNCERTAINTY, judge_of
from witness_table import processor_seconds

from planner import Effort
from planner.inspection import plan_inspection


def planned(name: str, folder: Path, effort: str, jobs: int) -> str:
    """Plan a request, and return a line of a table."""
    case = CASES[name]
    judge, _ = judge_of(case, folder)
    space = judge.space
    processor = processor_seconds()
    wall = time.monotonic()
    with ProcessPoolExecutor(jobs) as executor:
        plan = plan_inspection(
            space.solid,
            {one: space.entities[one] for one in space.entity_names},
            judge.camera,
            UNCERTAINTY,
            case.options(
                space=space,
                on_incumbent=lambda _: None,
                executor=executor,
                effort=Effort.named(effort),
            ),
            accuracy=judge.accuracy,
            probability=PROBABILITY,
        )
    wall = time.monotonic() - wall
    return (
        f"{name:16}{effort:10}{len(plan.inspected):>5} of {len(space.entity_names):<6}"
        f"{len(plan.settings):>9}{plan.lower_bound:>7}{wall:>9.1f}{processor_seconds() - processor:>12.1f}"
    )


def main() -> None:
    """Print a line for each request and effort."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="+", choices=list(CASES))
    parser.add_argument(
        "--folder", type=Path, default=Path(), help="of parts that are not among the examples"
    )
    parser.add_argument("--efforts", nargs="+", default=["quick"])
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    print(
        f"{'request':16}{'effort':10}{'inspected':>14}{'settings':>9}{'bound':>7}{'wall s':>9}{'processor s':>12}"
    )
    for name in options.cases:
        for effort in options.efforts:
            print(planned(name, options.folder, effort, options.jobs), flush=True)


if __name__ == "__main__":
    main()
