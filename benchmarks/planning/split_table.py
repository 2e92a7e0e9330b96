"""What plans gain if two settings may measure the two entities of a distance.

    python benchmarks/planning/split_table.py part.stp [more parts] [--cameras NAME ...] [--known planned own-edges]

For each part, the request holds its longest distances and its largest diameters, at most six characteristics, each with
a permitted error of 0.1 mm. Parts without dimensions get distances of parallel edges. Every request is planned with
``split="never"`` and with the default, for poses as planned and for images that are registered to the part's edges.
A plan is ended after ``--time-limit`` seconds. Seconds are of processor time. Each row is printed when it is done.
"""

from __future__ import annotations

import argparse
import time
from itertools import combinations
from pathlib import Path

import numpy as np

from aspectgraph import read_dimensions, read_solid, select_entities
from planner import (
    Camera,
    Dimension,
    Effort,
    PoseUncertainty,
    Registration,
    dimensions_to_plan,
    plan_inspection,
)

CAMERAS = (
    "basler-acA2440-20gm-8mm",
    "basler-acA2440-20gm-25mm",
    "basler-acA2440-20gm-35mm",
)
KNOWN = ("planned", "own-edges")
SPLIT = ("never", "auto")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0003)
PROBABILITY = 0.9
ERROR_MM = 0.1
DISTANCES = 4
DIAMETERS = 2
APART_MM = 5.0


def stated(path, solid):
    """Return the characteristics that a model states, as dimensions with the permitted error of this table."""
    try:
        wanted, _ = dimensions_to_plan(read_dimensions(path, solid))
    except Exception:
        return {}
    kinds = ("distance", "centre_distance", "centre_to_edge", "diameter")
    return {
        name: Dimension(item.kind, item.entities, max_error=ERROR_MM, direction=item.direction)
        for name, item in wanted.items()
        if item.kind in kinds
    }


def made(solid):
    """Return distances of parallel edges of a part that states none, each of other edges, and diameters of rims."""
    edges = select_entities(solid, f"length > {APART_MM:g}")
    pairs = []
    for first, second in combinations(edges, 2):
        a, b = (np.asarray(solid.edge_points(edge), dtype=float) for edge in (first, second))
        along = (a[1] - a[0]) / np.linalg.norm(a[1] - a[0])
        other = (b[1] - b[0]) / np.linalg.norm(b[1] - b[0])
        if abs(along @ other) < 1 - 1e-9:
            continue
        apart = b.mean(axis=0) - a.mean(axis=0)
        across = float(np.linalg.norm(apart - (apart @ along) * along))
        pairs.append((across, first, second))
    pairs.sort(reverse=True)
    wanted = {}
    used = set()
    for across, first, second in pairs:
        if across < APART_MM or used & {first, second}:
            continue
        used |= {first, second}
        wanted[f"width {first} {second}"] = Dimension.distance(first, second, max_error_mm=ERROR_MM)
        if len(wanted) == DISTANCES:
            break
    for rim in solid.rims():
        wanted[f"diameter {rim.id}"] = Dimension.diameter(rim.id, max_error_mm=ERROR_MM)
    return wanted


def nominal(solid, item):
    """Return about how large a distance is, mm."""
    from planner.options import InspectionOptions
    from planner.resolve_request import resolve_targets

    camera = Camera.named(CAMERAS[0])
    return resolve_targets(solid, {"x": item}, camera, InspectionOptions()).targets[0].nominal


def request(path, solid):
    """Return the characteristics that are planned."""
    wanted = stated(path, solid)
    if all(item.kind == "diameter" for item in wanted.values()):
        wanted = {**made(solid), **wanted}
    sizes = {name: nominal(solid, item) for name, item in wanted.items()}
    order = sorted(wanted, key=lambda name: -sizes[name])
    distances = [name for name in order if wanted[name].kind != "diameter"][:DISTANCES]
    diameters = [name for name in order if wanted[name].kind == "diameter"][:DIAMETERS]
    return {name: wanted[name] for name in (*distances, *diameters)}


def main(argv=None):
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="+")
    parser.add_argument("--cameras", nargs="+", default=CAMERAS)
    parser.add_argument("--known", nargs="+", choices=KNOWN, default=KNOWN)
    parser.add_argument("--split", nargs="+", choices=SPLIT, default=SPLIT)
    parser.add_argument("--time-limit", type=float, metavar="SECONDS")
    args = parser.parse_args(argv)
    print(
        "part, lens, poses: inspected / settings / bound, never → default; split; seconds; * ended by the limit"
    )
    for path in args.parts:
        solid = read_solid(path)
        wanted = request(path, solid)
        for name in args.cameras:
            for known in args.known:
                cells = []
                seconds = []
                split = ()
                for word in args.split:
                    began = time.process_time()
                    plan = plan_inspection(
                        solid,
                        wanted,
                        Camera.named(name),
                        UNCERTAINTY,
                        probability=PROBABILITY,
                        effort=Effort.named("quick"),
                        registration=None if known == "planned" else Registration.own_edges(),
                        split=word,
                        time_limit_s=args.time_limit,
                    )
                    seconds.append(time.process_time() - began)
                    n = f"{len(plan.inspected)} of {len(plan.targets)}"
                    cells.append(
                        f"{n} / {len(plan.settings)} / {plan.lower_bound}{'*' * plan.unfinished}"
                    )
                    split = tuple(plan.split)
                lens = name.rpartition("-")[2]
                times = " → ".join(f"{s:.0f}" for s in seconds)
                print(
                    f"{Path(path).name}, {lens}, {known}: {' → '.join(cells)}; {len(split)}; {times} s",
                    flush=True,
                )


if __name__ == "__main__":
    main()
