"""What of a drawing is covered: requirements, those that edges show, characteristics inspected, settings, bound.

    python benchmarks/planning/drawing_table.py part.stp [more parts] [--camera NAME] [--register]
        [--time-limit 120] [--count] [--json rows.json]

With ``--count`` nothing is planned, with ``--register`` images are registered to the part's edges. A plan that its time
limit ended is marked with a plus. ``--json`` adds the rows to a file, as docs/tables.py reads them.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from aspectgraph import read_requirements, read_solid
from planner import (
    Camera,
    Effort,
    PoseUncertainty,
    Registration,
    dimensions_to_plan,
    plan_inspection,
)
from planner.request.dimension import POSITIONS

UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.0005)


def counts(stated, wanted):
    """Return the cells of what is asked, and of what edges show of it."""
    n_geometric = sum(one.reason is None for one in stated.tolerances)
    n_positions = sum(one.kind in POSITIONS for one in wanted.values())
    return [
        len(stated),
        len(stated.dimensions),
        len(stated.tolerances),
        stated.n_measurable,
        n_geometric,
        len(wanted),
        n_positions,
    ]


def planned(solid, wanted, camera, limit, registration):
    """Return the cells of a plan: characteristics and positions inspected, settings, bound."""
    plan = plan_inspection(
        solid,
        wanted,
        camera,
        UNCERTAINTY,
        probability=0.95,
        effort=Effort.named("quick"),
        time_limit_s=limit,
        registration=registration,
    )
    n_positions = sum(plan.targets[name].kind in POSITIONS for name in plan.inspected)
    mark = "+" if plan.unfinished else ""
    return [len(plan.inspected), n_positions, f"{len(plan.settings)}{mark}", plan.lower_bound]


def main(argv=None):
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="+")
    parser.add_argument("--camera", default="basler-acA2440-20gm-8mm")
    parser.add_argument("--time-limit", type=float)
    parser.add_argument("--count", action="store_true")
    parser.add_argument("--register", action="store_true")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(argv)
    heads = ["part", "requirements", "dimensions", "geometric", "measurable", "of them geometric"]
    heads += ["characteristics", "positions"]
    if not args.count:
        heads += ["inspected", "positions inspected", "settings", "bound"]
    print("|", " | ".join(heads), "|")
    print("|", " | ".join("---" for _ in heads), "|", flush=True)
    for part in args.parts:
        solid = read_solid(part)
        stated = read_requirements(part, solid)
        wanted, _ = dimensions_to_plan(stated)
        cells = [Path(part).name.partition(".")[0], *counts(stated, wanted)]
        if not args.count:
            registration = Registration.own_edges() if args.register else None
            camera = Camera.named(args.camera)
            cells += planned(solid, wanted, camera, args.time_limit, registration)
        print("|", " | ".join(map(str, cells)), "|", flush=True)
        if args.json is not None:
            rows = json.loads(args.json.read_text()) if args.json.exists() else []
            args.json.write_text(
                json.dumps([*rows, dict(zip(heads, cells, strict=True))], indent=1)
            )


if __name__ == "__main__":
    main()
