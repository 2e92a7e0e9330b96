"""What a choice of witnesses gives: characteristics inspected, settings, bound and time, without and with it.

    python benchmarks/planning/witness_table.py part.stp [more parts] [--cameras NAME ...] [--time-limit 600]

Every characteristic of every part is asked for with each camera, twice in one run: by the preferred set of whole
entities (``witnesses=1``), and by any of the sets and stretches that the effort considers. Seconds are of processor
time, of this process and its children. A plan that its time limit ended is marked with a plus.
"""

from __future__ import annotations

import argparse
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

from aspectgraph import read_dimensions, read_solid
from planner import Camera, Effort, PoseUncertainty, dimensions_to_plan, plan_inspection

CAMERAS = (
    "basler-acA2440-20gm-8mm",
    "basler-acA2440-20gm-25mm",
    "basler-acA2440-20gm-35mm",
)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.0005)


def processor_seconds():
    """Return the processor time of this process and of its children that ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def planned(solid, wanted, camera, effort, limit):
    """Return a plan and the seconds that it took."""
    began = processor_seconds()
    with ProcessPoolExecutor(2) as executor:
        plan = plan_inspection(
            solid,
            wanted,
            camera,
            UNCERTAINTY,
            probability=0.95,
            effort=effort,
            time_limit_s=limit,
            executor=executor,
        )
    return plan, processor_seconds() - began


def main(argv=None):
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="+")
    parser.add_argument("--cameras", nargs="+", default=CAMERAS)
    parser.add_argument("--effort", default="quick")
    parser.add_argument("--time-limit", type=float)
    parser.add_argument("--only", choices=("before", "after"))
    args = parser.parse_args(argv)
    effort = Effort.named(args.effort)
    efforts = {"before": replace(effort, witnesses=1), "after": effort}
    print(
        f"{'part':24} {'camera':26} {'':6} {'inspected':>9} {'settings':>8} {'bound':>5} {'s':>6}"
    )
    for path in args.parts:
        solid = read_solid(path)
        wanted, _ = dimensions_to_plan(read_dimensions(path, solid))
        for name in args.cameras:
            for label, own in efforts.items():
                if args.only not in (None, label):
                    continue
                plan, seconds = planned(solid, wanted, Camera.named(name), own, args.time_limit)
                mark = "+" if plan.unfinished else ""
                print(
                    f"{solid.name[:24]:24} {name[:26]:26} {label:6} "
                    f"{len(plan.inspected):4}/{len(wanted):<4} {len(plan.settings):8} "
                    f"{plan.lower_bound:5} {seconds:6.0f}{mark}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
