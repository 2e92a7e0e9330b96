"""Render the images of `examples/measured`: one part that deviates, from displaced poses, and print its true values."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from dimension_images import as_measured
from measured_images import best_lamp, displaced
from part_images import DeviatingPart, Optics, PartImages
from PIL import Image
from rendered_images import Renderer

from planner import read_plan

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "measured"
SEED = 7
# one level: the files stay small
NOISE = 0.004


def main() -> int:
    """Write the images."""
    plan = read_plan(FOLDER / "plan.json")
    rng = np.random.default_rng(SEED)
    part = DeviatingPart(ROOT / "examples" / "nist_ctc_01_ap242.stp")
    renderer = Renderer(part.vertices, part.triangles, plan.camera.matrix, samples=2)
    measured = {name: as_measured(one) for name, one in plan.dimensions.items()}
    poses = [np.asarray(setting.cam2world) for setting in plan.settings]
    lamps = [
        best_lamp(renderer, pose, [measured[name] for name in setting.entities], rng)
        for pose, setting in zip(poses, plan.settings, strict=True)
    ]
    part.deviate(rng, 0.02, 0.05, 0.01)
    optics = Optics.of(plan.camera, noise=NOISE, exposure=0.9)
    images = PartImages(part.vertices, part.triangles, optics)
    (FOLDER / "images").mkdir(exist_ok=True)
    for k, (pose, lamp) in enumerate(zip(poses, lamps, strict=True)):
        real = displaced(pose, plan.pose_uncertainty.sigmas, rng)
        image = Image.fromarray(images.image(real, [lamp], rng))
        image.save(FOLDER / "images" / f"setting_{k + 1:02d}.png", optimize=True)
    for name, one in measured.items():
        print(f"{name}: {plan.dimensions[name].nominal + part.true_value(one):.4f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
