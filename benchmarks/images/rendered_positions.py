"""Positions of holes in rendered images of plates that deviate: slope, and how often the 95 % ellipse holds the truth.

Each image shows a plate whose two holes are off their places and sizes. Both positions are measured against two edges.
Run with the number of images: ``python benchmarks/images/rendered_positions.py 100``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "planner" / "helpers"), str(ROOT / "benchmarks" / "images")]

import holed_plate as plates  # noqa: E402
import measured_plate as plate  # noqa: E402

from planner import Dimension, Measurer, Registration  # noqa: E402
from planner.measuring.measurer import MeasureOptions  # noqa: E402
from planner.request.resolve import resolve_wanted  # noqa: E402

LARGEST_MM = 0.3
"""Largest deviation along each axis, and of the radius a tenth of it."""
SURFACES_MM = 0.02
"""Standard deviation of the height of the top, as the plan states it."""
IN_ELLIPSE = 5.991
"""Quantile of a squared deviation of two components, 95 %."""
IN_2U_ELLIPSE = 4.0
"""Squared deviation on the ellipse of two standard uncertainties, which holds 86.5 %."""


def datum_edges(solid):
    """Return the edges of the top along x and y."""
    middles = [[40.0, 0.0, plate.TOP], [0.0, 25.0, plate.TOP]]
    ends = [solid.edge_points(k).mean(axis=0) for k in range(len(solid.edges))]
    return [int(np.argmin(np.linalg.norm(ends - np.array(middle), axis=1))) for middle in middles]


def main() -> None:
    """Render, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("images", type=int, nargs="?", default=100)
    n_images = parser.parse_args().images
    solid = plate.thick_plate()
    datums = datum_edges(solid)
    wanted = {
        name: Dimension.position(rim, datums, 1.0, share=0.5, material="M", size=(-0.1, 0.1))
        for name, rim in zip(plates.HOLES, plate.upper_rims(solid), strict=True)
    }
    _, targets = resolve_wanted(solid, wanted, 0.99)
    plan = plate.measured_plan(
        solid, tuple(wanted), 1, dimensions={one.name: one for one in targets}
    )
    measurer = Measurer(plan, solid)
    pose = plate.POSES[0]
    given = Registration.given({1: pose}, np.diag([1e-8] * 3 + [1e-12] * 3))
    options = MeasureOptions(registration=given, edge_break_mm=(0.0, 0.0))
    rng = np.random.default_rng(5)
    designed = dict(plates.HOLES)
    rows = []
    for number in range(n_images):
        moves = rng.uniform(-LARGEST_MM, LARGEST_MM, (2, 2))
        larger = 0.1 * rng.uniform(-LARGEST_MM, LARGEST_MM, 2)
        for (name, (centre, radius)), move in zip(designed.items(), moves, strict=True):
            plates.HOLES[name] = (tuple(np.add(centre, move)), radius)
        height = SURFACES_MM * rng.standard_normal()
        mesh = plate.fine_plate(left=larger[0], right=larger[1], height=height)
        plates.HOLES.update(designed)
        images = plate.photograph(mesh, [pose], seed=number, samples=4)
        results = measurer.measure(images, options)
        for name, move, more in zip(wanted, moves, larger, strict=True):
            reading = results[name].readings[0]
            if reading.measured:
                off = np.array(reading.deviation_mm) - move
                covariance = np.array(reading.covariance_mm2)
                squared = off @ np.linalg.solve(covariance[:2, :2], off)
                size_off = reading.size_mm - plan.targets[name].measurand.size_mm - 2 * more
                rows.append((*move, *reading.deviation_mm, squared, size_off))
    table = np.array(rows)
    print(f"{len(table)} of {2 * n_images} positions measured")
    slope, offset = np.polyfit(table[:, :2].ravel(), table[:, 2:4].ravel(), 1)
    print(f"slope of e {slope:.4f}, offset {1e3 * offset:+.2f} um")
    print(f"rms of e {1e3 * np.sqrt(np.mean((table[:, 2:4] - table[:, :2]) ** 2)):.2f} um")
    print(f"in the 95 % ellipse {np.mean(table[:, 4] <= IN_ELLIPSE):.3f}")
    print(f"in the 2u ellipse {np.mean(table[:, 4] <= IN_2U_ELLIPSE):.3f}")
    print(f"rms of the diameter {1e3 * np.sqrt(np.mean(table[:, 5] ** 2)):.2f} um")


if __name__ == "__main__":
    main()
