"""How broken edges move measured values, and whether U says so: a plate with chamfers or radii, rendered by rays.

Each row is a kind and a mean size of breaks (mm along each face), stated to the program or not. If nothing is stated,
another row has u with breaks that images do not show. The breaks of a plate are half to one and a half times as large.
A plate with random deviations is measured in images from two displaced poses. The lamp is another one for each seed.
Prints bias, rms error and mean u in µm, and the share of readings within 2 u and 3 u. Shares no code with the model of
breaks: the mesh has true chamfers and radii.

    PYTHONPATH=. python benchmarks/images/broken_edges.py --kinds chamfer radius --sizes 0.05 0.1 0.2 0.5 --seeds 6
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from planner import Camera, MeasureOptions, Measurer, Registration
from planner.request.edge_state import UNSTATED_MM

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "planner" / "helpers"))
import measured_plate as plate
from part_images import Optics, PartImages
from rendered_images import Lamp

# .083 mm are a pixel
CAMERA = Camera(25.0, (0.0069, 0.0069), (1280, 1024), 8.0, 300.0)
LAMPS = (
    [150.0, 260.0, 340.0],
    [-150.0, 200.0, 340.0],
    [40.0, 25.0, 420.0],
    [200.0, -150.0, 380.0],
    [-100.0, -200.0, 300.0],
)
DEVIATION_MM = 0.02
WITH_UNSEEN = "nothing, with unseen breaks"
GROUPS = {"diameter": ("left", "right"), "centre distance": ("apart",), "distance": ("width",)}


def profile(kind: str, size: float) -> list[tuple[float, float]]:
    """How far from the edge points of a break are, along the top and along the sides, mm."""
    if kind == "chamfer":
        return [(size, 0.0), (0.0, size)]
    turns = np.linspace(0.0, np.pi / 2, 9)
    return [(size * (1 - np.sin(turn)), size * (1 - np.cos(turn))) for turn in turns]


def displaced(pose, rng):
    """A pose that the robot reaches within .1 mm and 2 mrad."""
    move = np.eye(4)
    move[:3, :3] = Rotation.from_rotvec(rng.normal(size=3) * 0.002).as_matrix()
    move[:3, 3] = rng.normal(size=3) * 0.1
    return pose @ move


def readings(measurer, kind, size, seed, states):
    """Yield state, target, reading, true value and standard uncertainty."""
    rng = np.random.default_rng(seed)
    names = ("left", "right", "height", "width")
    size *= rng.uniform(0.5, 1.5)
    off = dict(zip(names, rng.normal(size=4) * DEVIATION_MM, strict=True))
    mesh = (
        plate.fine_plate(**off)
        if kind == "sharp"
        else plate.broken_plate(profile(kind, size), **off)
    )
    optics = Optics(CAMERA.matrix, CAMERA.resolution, noise=0.005, samples=4, every=3)
    images = PartImages(*mesh, optics)
    lamp = Lamp(np.array(LAMPS[seed % len(LAMPS)]))
    shots = {
        k + 1: images.image(displaced(pose, rng), [lamp], rng) for k, pose in enumerate(plate.POSES)
    }
    true = {"left": 2 * off["left"], "right": 2 * off["right"], "apart": 0.0, "width": off["width"]}
    for state, limits in states.items():
        options = MeasureOptions(Registration.own_edges(DEVIATION_MM), edge_break_mm=limits)
        results = measurer.measure(shots, options)
        for result in results:
            for reading in result.readings:
                truth = result.nominal + true[result.name]
                yield state, result.name, reading, truth, reading.standard_uncertainty
                if results.unseen is not None:
                    wider = with_unseen(reading, results.unseen.limit_mm)
                    yield WITH_UNSEEN, result.name, reading, truth, wider


def with_unseen(reading, limit_mm):
    """Standard uncertainty of a reading with breaks that images do not show, as `measure` states it of values."""
    times = (limit_mm / UNSTATED_MM) ** 2
    variance = reading.budget.get("edge state", 0.0)
    return np.sqrt(reading.standard_uncertainty**2 + (times - 1) * variance)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--kinds", nargs="+", default=["chamfer", "radius"])
    parser.add_argument("--sizes", nargs="+", type=float, default=[0.05, 0.1, 0.2, 0.5])
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    solid = plate.thick_plate()
    measurer = Measurer(plate.measured_plan(solid, camera=CAMERA), solid)
    print("| break | stated | value | readings | bias | rms | u | within 2 u | within 3 u |")
    print("|---|---|---|---|---|---|---|---|---|")
    cases = [
        (kind, size) for kind in given.kinds for size in ([0.0] if kind == "sharp" else given.sizes)
    ]
    for kind, size in cases:
        states = {"nothing": None}
        if kind == "sharp":
            states["0"] = (0.0, 0.0)
        else:
            states[f"{0.5 * size:g} to {1.5 * size:g}"] = (0.5 * size, 1.5 * size)
        rows = [
            row
            for seed in range(given.seeds)
            for row in readings(measurer, kind, size, seed, states)
        ]
        for state in dict.fromkeys(row[0] for row in rows):
            for group, names in GROUPS.items():
                every = [row for row in rows if row[0] == state and row[1] in names]
                good = [row for row in every if row[2].measured]
                label = f"| {kind} {size:g} | {state} | {group} | {len(good)} of {len(every)} "
                if not good:
                    print(label + "| | | | | |")
                    continue
                error = 1e3 * np.array([row[2].value - row[3] for row in good])
                u = 1e3 * np.array([row[4] for row in good])
                within = [np.mean(np.abs(error) <= k * u) for k in (2, 3)]
                print(
                    f"{label}| {error.mean():.0f} | {np.sqrt((error**2).mean()):.0f} | {u.mean():.0f} "
                    f"| {within[0]:.2f} | {within[1]:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
