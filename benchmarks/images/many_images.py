"""One posterior over many images: scatter of values against their u, and what it costs.

``scatter`` draws plates that deviate, renders two images of each from displaced poses, and measures them. Edges are
stated as sharp, then also the camera's response, then also a detector without a floor. With ``--drawn`` all faces
deviate as the plan states. ``split`` plans a part that is larger than the field of a 35 mm lens, renders it with all
faces off, and measures values whose entities are in different images. ``exact`` shows the biases of edges alone: the
plate is as designed and the poses are known. ``cost`` compares the time of ten images of 5 megapixels together with
that of ten single ones.

    python benchmarks/images/many_images.py scatter --parts 60
    python benchmarks/images/many_images.py scatter --parts 52 --drawn
    python benchmarks/images/many_images.py exact
    python benchmarks/images/many_images.py split --part nist_d2mi_827-9999-904.stp.gz --parts 10 --coarser 4
    python benchmarks/images/many_images.py cost
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import ndtr

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests" / "planner" / "helpers"), str(ROOT / "benchmarks" / "planning")]

import split_table  # noqa: E402
from measured_plate import (  # noqa: E402
    CAMERA,
    POSES,
    UNCERTAINTY,
    fine_plate,
    measured_plan,
    photograph,
    thick_plate,
)

from aspectgraph import read_solid  # noqa: E402
from errors.measurands.geometry import Localisation  # noqa: E402
from planner import (  # noqa: E402
    Camera,
    Effort,
    MeasureOptions,
    Measurer,
    Registration,
    measure,
    plan_inspection,
)
from planner.measuring.registered import displaced  # noqa: E402
from planner.measuring.rehearsal import Rehearsal  # noqa: E402

NAMES = ("left", "right", "apart", "width")
# edges of rendered parts are sharp; 0 is no break that can be stated
SHARP = (0.0, 1e-4)
FINER = 4
IMAGES = 10


def rehearsed(plan, solid, seed):
    """Return images of a plate whose faces all deviate as the plan states, and its true values."""
    rehearsal = Rehearsal(plan, solid, seed=seed)
    images = {rendered.shot.name: rendered.grey for rendered in rehearsal.images()}
    truth = {}
    for values in rehearsal.truth.values.values():
        truth.update(values)
    return images, truth


def deviating(plan, solid, rng, seed):
    """Return images of a plate with other radii, width and height, and its true values."""
    root = np.linalg.cholesky(UNCERTAINTY.covariance)
    left, right = rng.normal(0, 0.04, 2)
    width = rng.normal(0, 0.05)
    height = rng.normal(0, 0.02)
    poses = [displaced(pose, root @ rng.normal(size=6))[0] for pose in POSES]
    mesh = fine_plate(left=left, right=right, width=width, height=height)
    off = {"left": 2 * left, "right": 2 * right, "apart": 0.0, "width": width}
    truth = {name: plan.targets[name].nominal + more for name, more in off.items()}
    return photograph(mesh, poses, seed=seed), truth


def ways_of():
    """Return the options of each way to measure, by what is stated."""
    own = Registration.own_edges()
    without_floor = Localisation.gaussian(0.1, floor_px=0.0)
    return {
        "edges stated as sharp": MeasureOptions(own, edge_break_mm=SHARP),
        "and the response": MeasureOptions(own, edge_break_mm=SHARP, response="linear"),
        "and no floor": MeasureOptions(own, without_floor, edge_break_mm=SHARP, response="linear"),
    }


def rows_of(measurer, images, truth, options):
    """Return (name, error, u) of all values that are measured and known."""
    return [
        (result.name, result.value - truth[result.name], result.standard_uncertainty)
        for result in measurer.measure(images, options)
        if result.measured and result.name in truth
    ]


def summarise(label, rows):
    """Print errors and u of many values together, and of each target."""
    errors, u = np.array([row[1:] for row in rows]).T
    z = errors / u
    print(
        f"{label}: {len(rows)} readings, rms error {np.sqrt((errors**2).mean()):.4f} mm, "
        f"rms u {np.sqrt((u**2).mean()):.4f} mm, rms of error / u {np.sqrt((z**2).mean()):.2f}, "
        f"within 2 u {np.mean(np.abs(z) <= 2):.3f}"
    )
    names = np.array([name for name, _, _ in rows])
    expected = np.empty(len(rows))
    for name in dict.fromkeys(names):
        of_target = names == name
        mean = errors[of_target].mean()
        spread = max(errors[of_target].std(), 1e-9)
        limit = 2 * u[of_target]
        expected[of_target] = ndtr((limit - mean) / spread) - ndtr((-limit - mean) / spread)
        print(
            f"  {name}: {of_target.sum()} readings, mean error {1e3 * mean:+.1f} um, scatter {1e3 * spread:.1f} um, "
            f"u {1e3 * np.sqrt((u[of_target] ** 2).mean()):.1f} um, within 2 u {np.mean(np.abs(z[of_target]) <= 2):.3f}"
        )
    print(f"  expected of normal errors with these means and scatters: {expected.mean():.3f}")


def scatter(n_parts, seed, *, drawn):
    """Print errors and u of four values of many plates."""
    rng = np.random.default_rng(seed)
    solid = thick_plate()
    plan = measured_plan(solid)
    measurer = Measurer(plan, solid)
    ways = ways_of()
    lines = {label: [] for label in ways}
    for k in range(n_parts):
        number = 1000 * seed + k
        if drawn:
            images, truth = rehearsed(plan, solid, number)
        else:
            images, truth = deviating(plan, solid, rng, number)
        for label, options in ways.items():
            lines[label] += rows_of(measurer, images, truth, options)
    for label, rows in lines.items():
        summarise(label, rows)


def exact():
    """Print errors of a plate that is as designed, from poses that are exactly known: biases of edges are left."""
    solid = thick_plate()
    plan = measured_plan(solid, surfaces_mm=1e-6)
    rehearsal = Rehearsal(plan, solid, surfaces_mm=0.0, seed=1, exact_poses=True)
    images = {rendered.shot.name: rendered.grey for rendered in rehearsal.images()}
    known = Registration.given(dict(enumerate(POSES, 1)), np.diag([1e-10] * 3 + [1e-14] * 3))
    options = MeasureOptions(known, edge_break_mm=SHARP, response="linear")
    for result in Measurer(plan, solid).measure(images, options):
        off = [1e3 * (reading.value - result.nominal) for reading in result.readings]
        print(f"{result.name}: {off[0]:+.1f}, {off[1]:+.1f} um in the two images")


def split(path, n_parts, seed, coarser, limit_s):
    """Print errors and u of a part larger than the field, whose targets are split over settings."""
    solid = read_solid(path)
    camera = Camera.named("basler-acA2440-20gm-35mm")
    camera = replace(
        camera,
        pixel_pitch_mm=tuple(pitch * coarser for pitch in camera.pixel_pitch_mm),
        resolution=tuple(n // coarser for n in camera.resolution),
    )
    plan = plan_inspection(
        solid,
        split_table.request(path, solid),
        camera,
        split_table.UNCERTAINTY,
        probability=split_table.PROBABILITY,
        effort=Effort.named("quick"),
        registration=Registration.own_edges(),
        time_limit_s=limit_s,
    )
    print(
        f"{len(plan.inspected)} inspected, {len(plan.split)} split, {len(plan.settings)} settings"
    )
    measurer = Measurer(plan, solid)
    options = ways_of()["and the response"]
    rows = []
    for k in range(n_parts):
        images, truth = rehearsed(plan, solid, 1000 * seed + k)
        found = rows_of(measurer, images, truth, options)
        rows += found
        # a long run shows what it has
        print(
            k,
            " ".join(f"{name}:{1e3 * error:+.1f}/{1e3 * u:.1f}" for name, error, u in found),
            flush=True,
        )
    summarise("whole", [row for row in rows if row[0] not in plan.split])
    summarise("split", [row for row in rows if row[0] in plan.split])


def cost(finer):
    """Print the time of ten images together, and of each alone, with so many pixels in place of one along each side."""
    import measured_plate

    camera = replace(
        CAMERA,
        pixel_pitch_mm=tuple(pitch / finer for pitch in CAMERA.pixel_pitch_mm),
        resolution=tuple(finer * n for n in CAMERA.resolution),
    )
    measured_plate.CAMERA = camera
    solid = thick_plate()
    shown = photograph(fine_plate(left=0.03, width=0.05), POSES)
    names = list(NAMES)
    pair = measured_plan(solid, names, camera=camera)
    many = replace(pair, settings=pair.settings * (IMAGES // 2))
    rng = np.random.default_rng(0)
    # the same image twice would be refused
    images = {
        k + 1: np.clip(shown[k % 2 + 1] + rng.normal(0, 0.3, shown[1].shape), 0, 255).astype(
            np.uint8
        )
        for k in range(IMAGES)
    }
    measure(many, solid, images)
    start = time.process_time()
    measure(many, solid, images)
    together = time.process_time() - start
    alone = 0.0
    for k in (1, 2):
        single = replace(pair, settings=pair.settings[k - 1 : k])
        start = time.process_time()
        measure(single, solid, {1: shown[k]})
        alone += (time.process_time() - start) * IMAGES / 2
    megapixels = np.prod(camera.resolution) / 1e6
    print(
        f"{IMAGES} images of {megapixels:.1f} Mpx: {together:.1f} s together, {alone:.1f} s alone, "
        f"{together / alone:.2f} times"
    )


def main():
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("scatter", "exact", "split", "cost"))
    parser.add_argument("--part", help="STEP file of split")
    parser.add_argument("--coarser", type=int, default=1, help="pixels so many times as large")
    parser.add_argument("--time-limit", type=float, default=120.0, help="seconds of planning")
    parser.add_argument("--parts", type=int, default=60)
    parser.add_argument("--drawn", action="store_true")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--finer", type=int, default=FINER)
    arguments = parser.parse_args()
    if arguments.what == "cost":
        cost(arguments.finer)
    elif arguments.what == "exact":
        exact()
    elif arguments.what == "split":
        given = (arguments.coarser, arguments.time_limit)
        split(arguments.part, arguments.parts, arguments.seed, *given)
    else:
        scatter(arguments.parts, arguments.seed, drawn=arguments.drawn)


if __name__ == "__main__":
    main()
