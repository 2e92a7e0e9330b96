"""Requests drawn at random on given parts, as options of ``aspectgraph plan``, one a line.

    python benchmarks/planning/random_requests.py part.step [more parts] [--seed 44] [--edges 12]

For each part: edges of at least a twentieth of its box's diagonal, a lens that shows about the whole part at its focus
distance, the required accuracy, and the uncertainty of the pose. `margins.py` and `promise_referee.py` judge the plans.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from aspectgraph import read_solid

# focal length in mm, pixel pitch in mm, and pixels
CAMERAS = (
    (8.0, 0.00345, (2448, 2048)),
    (12.0, 0.00345, (2448, 2048)),
    (25.0, 0.0024, (5472, 3648)),
)
ACCURACIES = (0.95, 0.97, 0.98)
# standard deviations of the pose: mm and rad
UNCERTAINTIES = ((0.02, 0.0005), (0.05, 0.001), (0.1, 0.001))
NEAREST_MM = 120.0


def camera_text(focal_mm, pitch_mm, resolution, focus_mm):
    """Return a camera file."""
    return (
        f'name = "lens of {focal_mm:g} mm"\nfocal_length_mm = {focal_mm}\n'
        f"pixel_pitch_mm = [{pitch_mm}, {pitch_mm}]\nresolution = {list(resolution)}\n"
        f"f_number = 8.0\nfocus_distance_mm = {focus_mm:.0f}\n"
    )


def main(argv=None):
    """Print one request for each part, and write its camera."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="+")
    parser.add_argument("--seed", type=int, default=44)
    parser.add_argument("--edges", type=int, default=12)
    parser.add_argument("--cameras", default=".", help="folder for the camera files")
    args = parser.parse_args(argv)
    for k, part in enumerate(args.parts):
        rng = np.random.default_rng([args.seed, k])
        solid = read_solid(part)
        lowest, highest = solid.bounds
        size = float(np.linalg.norm(highest - lowest))
        edges = [e.id for e in solid.straight_edges() if solid.edge_length_mm(e.id) > size / 20]
        chosen = np.sort(rng.choice(edges, min(args.edges, len(edges)), replace=False))
        focal_mm, pitch_mm, resolution = CAMERAS[rng.integers(len(CAMERAS))]
        field = min(resolution) * pitch_mm / focal_mm
        focus = max(NEAREST_MM, 6.0 * focal_mm, size * rng.uniform(0.7, 1.3) / field)
        camera = Path(args.cameras) / f"camera-{args.seed}-{k}.toml"
        camera.write_text(camera_text(focal_mm, pitch_mm, resolution, focus))
        sigma_mm, sigma_rad = UNCERTAINTIES[rng.integers(len(UNCERTAINTIES))]
        print(
            f"{part} --entities {','.join(map(str, chosen))} --camera {camera} "
            f"--accuracy {rng.choice(ACCURACIES)} --probability 0.9 "
            f"--sigma-mm {sigma_mm} --sigma-rad {sigma_rad}"
        )


if __name__ == "__main__":
    sys.exit(main())
