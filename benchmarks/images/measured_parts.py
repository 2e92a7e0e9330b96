"""The referee of `aspectgraph measure` on several part models: coverage of 2 u, with right and with wrong priors.

For each pair of a plan and its part, parts are drawn whose surfaces deviate, and cameras are displaced. A condition
says how many times more than stated both are. One image is rendered for each that the plan takes: under the lamps of it
if it has some, else under a lamp drawn from those of 17 around the camera that show nearly all of what is measured.
`planner.measure` reads all dimensions, once for each floor. A table pools all readings, see `measured_rows`.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import time

# before numpy: threads of small matrices only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from dimension_images import witnesses_of
from measured_images import displaced, tried_lamps
from measured_rows import Row, rows_of, show, write
from part_images import DeviatingPart, Optics, PartImages
from rendered_images import Lamp, Renderer

from aspectgraph import read_solid
from planner import Localisation, MeasureOptions, Measurer, Registration, read_plan
from planner.measuring.images import shots_of

# lamps of which the weakest tenth of points has at least this share of the best lamp's step are drawn from
GOOD_LAMP = 0.6
# deviations of cylinders in those of planes; priors have three
CYLINDERS = 1.5
# a plane's tilts at its extent in its offset, as in priors
TILTS = 0.5
# finer than for looks: chords lie inside of rims, which makes diameters smaller by 1.3 of it
CHORD_MM = 0.001
TURN_RAD = 0.2


@dataclass
class Model:
    """A plan, its part, and lamps for each image by name."""

    name: str
    plan_path: Path
    part_path: Path
    lamps: dict[str, list[list[Lamp]]] = field(default_factory=dict)

    def __post_init__(self):
        self.plan = read_plan(self.plan_path)
        self.part = DeviatingPart(self.part_path, CHORD_MM, TURN_RAD)
        self.measurer = Measurer(self.plan, read_solid(self.part_path))
        self.measured = witnesses_of(self.plan)
        self.shots = shots_of(self.plan)
        if self.plan.light is None:
            self._try_lamps()
        else:
            self._planned_lamps()

    def pose(self, shot) -> np.ndarray:
        """The planned pose of an image."""
        return np.asarray(self.plan.settings[shot.setting].cam2world)

    def _planned_lamps(self) -> None:
        light = self.plan.light
        for shot in self.shots:
            own = [one for one in self.shots if one.setting == shot.setting]
            lit = light.images[shot.setting]
            places = [light.lamps[i] for i in lit[own.index(shot)].lamps] if lit else []
            if not places:
                # nothing is lit: any lamp shows the image
                places = [self.pose(shot)[:3, 3]]
            self.lamps[shot.name] = [[Lamp(np.asarray(place)) for place in places]]

    def _try_lamps(self) -> None:
        rng = np.random.default_rng(99)
        renderer = Renderer(self.part.vertices, self.part.triangles, self.plan.camera.matrix, 2)
        for shot in self.shots:
            asked = ((shot.setting, name) for name in shot.targets)
            measured = [self.measured[one] for one in asked if one in self.measured]
            if not measured:
                self.lamps[shot.name] = [[Lamp(self.pose(shot)[:3, 3])]]
                continue
            tried = tried_lamps(renderer, self.pose(shot), measured, rng)
            self.lamps[shot.name] = [
                [lamp] for step, lamp in tried if step >= GOOD_LAMP * tried[0][0]
            ]


@dataclass
class Condition:
    """How many times more than stated surfaces and poses deviate."""

    surfaces: float = 1.0
    poses: float = 1.0

    def __str__(self):
        return f"surfaces x{self.surfaces:g}, poses x{self.poses:g}"


def rendered(model: Model, seed: int, condition: Condition, options) -> dict[str, np.ndarray]:
    """Draw a part and poses, and return its images by name: rendered, or kept from an earlier run."""
    rng = np.random.default_rng(seed)
    planes = condition.surfaces * options.surfaces_mm
    model.part.deviate(rng, planes, CYLINDERS * planes, TILTS * planes)
    plan = model.plan
    optics = Optics.of(
        plan.camera, exposure=options.exposure, gloss=options.gloss, samples=3, every=3
    )
    scene = PartImages(model.part.vertices, model.part.triangles, optics)
    sigmas = condition.poses * plan.pose_uncertainty.sigmas
    real = [displaced(np.asarray(one.cam2world), sigmas, rng) for one in plan.settings]
    kept = options.keep and options.keep / f"{model.plan_path.parent.name} {seed} {condition}.npz"
    if kept and kept.exists():
        return dict(np.load(kept))
    images = {}
    for shot in model.shots:
        lamps = model.lamps[shot.name]
        chosen = lamps[rng.integers(len(lamps))]
        images[shot.name] = scene.image(real[shot.setting], chosen, rng)
    if kept:
        options.keep.mkdir(parents=True, exist_ok=True)
        np.savez(kept, **images)
    return images


def measured_part(model: Model, seed: int, condition: Condition, options) -> list[Row]:
    """Render and measure one part that is drawn."""
    began = time.process_time()
    images = rendered(model, seed, condition, options)
    spent = time.process_time() - began
    plan = model.plan
    truth = {where: model.part.true_value(one) for where, one in model.measured.items()}
    how = Registration.own_edges(options.surfaces_mm)
    rows = []
    for floor in options.floors:
        given = None if floor is None else Localisation.gaussian(0.1, floor_px=floor)
        started = time.process_time()
        results = model.measurer.measure(images, MeasureOptions(how, given))
        seconds = (time.process_time() - started) / len(images)
        label = f"{condition}, floor {'of plan' if floor is None else floor}"
        rows += rows_of(results, plan, truth, model.name, seed, label)
        for name, one in results.images.items():
            for note in one.warnings:
                print(f"{model.name} {seed} {label} {name}: {note}", file=sys.stderr)
    print(
        f"{model.name} {seed} {condition}: {len(images)} images, "
        f"{spent / len(images):.1f} s to render, {seconds:.2f} s to measure one",
        file=sys.stderr,
        flush=True,
    )
    return rows


def main() -> int:
    """Measure all parts, print the table, write the readings."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--pair", nargs=2, action="append", required=True, metavar=("PLAN", "PART"), type=Path
    )
    parser.add_argument("--draws", type=int, default=2, help="parts of each model")
    parser.add_argument("--first", type=int, default=1, help="seed of the first")
    parser.add_argument("--surfaces-mm", type=float, default=0.03, help="stated deviation")
    parser.add_argument("--surfaces", nargs="+", type=float, default=[1.0], help="times stated")
    parser.add_argument("--poses", nargs="+", type=float, default=[1.0], help="times stated")
    parser.add_argument(
        "--floors", nargs="+", type=float, default=[0.01], help="of the localisation, px; 0: plan's"
    )
    parser.add_argument("--exposure", type=float, default=1.0)
    parser.add_argument("--gloss", type=float, default=0.0)
    parser.add_argument("--keep", type=Path, help="folder of images to use again")
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    options.floors = [floor or None for floor in options.floors]
    conditions = [Condition(*both) for both in itertools.product(options.surfaces, options.poses)]
    rows: list[Row] = []
    for plan, part in options.pair:
        model = Model(part.stem, plan, part)
        print(f"{model.name}: {len(model.shots)} images", file=sys.stderr, flush=True)
        for condition in conditions:
            for seed in range(options.first, options.first + options.draws):
                rows += measured_part(model, seed, condition, options)
                if options.csv:
                    write(rows, options.csv)
    show(rows, by_part=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
