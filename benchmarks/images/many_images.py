"""One posterior over many images: scatter of values against their u, and what it costs.

``scatter`` draws plates that deviate, renders two images of each from displaced poses, and measures them. Edges are
stated as sharp, then also the camera's response, then also a detector without a floor. With ``--drawn`` all faces
deviate as the plan states. ``cost`` compares the time of ten images of 5 megapixels together with that of
ten single ones.

    python benchmarks/images/many_images.py scatter --parts 60
    python benchmarks/images/many_images.py scatter --parts 52 --drawn
    python benchmarks/images/many_images.py cost
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "planner" / "helpers"))

from measured_plate import (  # noqa: E402
    CAMERA,
    POSES,
    UNCERTAINTY,
    fine_plate,
    measured_plan,
    photograph,
    thick_plate,
)

from errors.measurands.geometry import Localisation  # noqa: E402
from planner import MeasureOptions, Measurer, Registration, measure  # noqa: E402
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


def scatter(n_parts, seed, *, drawn):
    """Print errors and u of four values of many plates."""
    rng = np.random.default_rng(seed)
    solid = thick_plate()
    plan = measured_plan(solid)
    measurer = Measurer(plan, solid)
    own = Registration.own_edges()
    without_floor = Localisation.gaussian(0.1, floor_px=0.0)
    ways = {
        "edges stated as sharp": MeasureOptions(own, edge_break_mm=SHARP),
        "and the response": MeasureOptions(own, edge_break_mm=SHARP, response="linear"),
        "and no floor": MeasureOptions(own, without_floor, edge_break_mm=SHARP, response="linear"),
    }
    lines = {label: [] for label in ways}
    for k in range(n_parts):
        number = 1000 * seed + k
        if drawn:
            images, truth = rehearsed(plan, solid, number)
        else:
            images, truth = deviating(plan, solid, rng, number)
        for label, options in ways.items():
            for result in measurer.measure(images, options):
                if result.measured:
                    error = result.value - truth[result.name]
                    lines[label].append((error, result.standard_uncertainty))
    for label, rows in lines.items():
        errors, u = np.array(rows).T
        z = errors / u
        print(
            f"{label}: {len(rows)} readings, rms error {np.sqrt((errors**2).mean()):.4f} mm, "
            f"rms u {np.sqrt((u**2).mean()):.4f} mm, rms of error / u {np.sqrt((z**2).mean()):.2f}, "
            f"within 2 u {np.mean(np.abs(z) <= 2):.3f}"
        )


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
    parser.add_argument("what", choices=("scatter", "cost"))
    parser.add_argument("--parts", type=int, default=60)
    parser.add_argument("--drawn", action="store_true")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--finer", type=int, default=FINER)
    arguments = parser.parse_args()
    if arguments.what == "cost":
        cost(arguments.finer)
    else:
        scatter(arguments.parts, arguments.seed, drawn=arguments.drawn)


if __name__ == "__main__":
    main()
