"""How often an image is registered that must not be: wrong parts, turned and exchanged images, poses that are off.

Images of deviating parts are rendered from poses near the plan's. Each is registered many times, from planned poses
that are displaced from the real one by 1 to 64 standard deviations of the stated uncertainty; and as what it is not:
turned, mirrored, that of another setting, or that of another part. A registration is right if all edges that it used
are within a pixel of where the real camera images them, and false if it is accepted otherwise. A table counts right,
false and refused ones by case.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dimension_images import as_measured
from measured_images import best_lamp, displaced
from part_images import DeviatingPart, Optics, PartImages
from rendered_images import Renderer

from aspectgraph import read_solid
from errors.measurands.geometry import FLOOR_PX
from planner import read_plan
from planner.measuring.images import Picture
from planner.measuring.register import bias_of, register_as_shown
from planner.measuring.samples import PartModel
from planner.measuring.task import NotRegisteredError

SCALES = (1, 1, 1, 2, 4, 8, 16, 32, 64)
OFF_PX = 1.0
# stated deviation of faces
SURFACES_MM = 0.02
# cosine of the angle from which on a mesh edge is sharp
SHARP = 0.9


@dataclass
class Scene:
    """A real pose with its image."""

    setting: int
    pose: np.ndarray
    image: np.ndarray


def taken(part, plan, lamps, rng, near, scale=(1.0, 1.0, 1.0)) -> list[Scene]:
    """Render an image for each setting of a part that deviates, from a pose near the planned one."""
    part.deviate(rng, 0.02, 0.03, 0.01)
    optics = Optics.of(plan.camera, samples=2)
    middle = part.vertices.mean(axis=0)
    images = PartImages(middle + (part.vertices - middle) * scale, part.triangles, optics)
    scenes = []
    for k, (setting, lamp) in enumerate(zip(plan.settings, lamps, strict=True)):
        pose = displaced(np.asarray(setting.cam2world), near, rng)
        scenes.append(Scene(k, pose, images.image(pose, [lamp], rng)))
    return scenes


class Outline:
    """The sharp edges of a part as it is."""

    def __init__(self, part: DeviatingPart):
        self.part = part
        triangles = part.unique[part.triangles]
        a, b, c = (part.nominal[triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        ends = np.sort(
            np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        )
        owner = np.tile(np.arange(len(triangles)), 3)
        order = np.lexsort(ends.T)
        ends = ends[order]
        owner = owner[order]
        same = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
        folds = np.einsum("ij,ij->i", normals[owner[same]], normals[owner[same + 1]]) < SHARP
        self.pairs = ends[same[folds]]

    def worst_px(self, matrix, pose, found) -> float:
        """Return how far found samples are from the real outline, px: that of which 2 % are farther."""
        local = (self.part.moved - pose[:3, 3]) @ pose[:3, :3]
        image = local @ matrix.T
        ends = (image[:, :2] / image[:, 2:])[self.pairs]
        starts = ends[:, 0]
        steps = ends[:, 1] - starts
        lengths = np.maximum((steps**2).sum(axis=1), 1e-12)
        samples = found.samples[found.samples["state"] == 0][::3]
        off = []
        for place in np.c_[samples["u"], samples["v"]]:
            along = np.clip(((place - starts) * steps).sum(axis=1) / lengths, 0, 1)
            away = starts + along[:, None] * steps - place
            off.append(np.sqrt((away**2).sum(axis=1).min()))
        return float(np.quantile(off, 0.98))


def tried(model, image, pose, stated, camera):
    """Return the registration, or None if it is refused."""
    try:
        pictures = [Picture.of("image", image, camera)]
        return register_as_shown(model, pictures, pose, *stated, bias_of(FLOOR_PX))
    except NotRegisteredError:
        return None


def count_finds(options) -> dict[str, Counter]:
    """Register all images in all ways."""
    plan = read_plan(options.plan)
    camera = plan.camera
    rng = np.random.default_rng(options.seed)
    part = DeviatingPart(options.part)
    solid = read_solid(options.part)
    model = PartModel(solid, {name: plan.targets[name] for name in plan.inspected})
    stated = plan.pose_uncertainty.covariance, SURFACES_MM
    sigmas = plan.pose_uncertainty.sigmas
    measured = {name: as_measured(one) for name, one in plan.dimensions.items()}
    renderer = Renderer(part.vertices, part.triangles, camera.matrix, samples=2)
    lamps = [
        best_lamp(renderer, np.asarray(one.cam2world), [measured[n] for n in one.entities], rng)
        for one in plan.settings
    ]
    poses = [np.asarray(one.cam2world) for one in plan.settings]
    outline = Outline(part)
    counts: dict[str, Counter] = {}
    begun = time.process_time()
    n = 0
    while n < options.n:
        scenes = taken(part, plan, lamps, rng, 0.5 * sigmas)
        for scene in scenes:
            for scale in SCALES:
                pose = displaced(scene.pose, scale * sigmas, rng)
                found = tried(model, scene.image, pose, stated, camera)
                name = f"{scale:2d} standard deviations off"
                if found is None:
                    verdict = "refused"
                else:
                    off = outline.worst_px(camera.matrix, scene.pose, found)
                    verdict = "right" if off <= OFF_PX else "false"
                    if verdict == "false":
                        print(name, _words(found, off), file=sys.stderr)
                counts.setdefault(name, Counter())[verdict] += 1
                n += 1
            wrong = {
                "turned by 180 degrees": (scene.image[::-1, ::-1], scene.setting),
                "mirrored": (scene.image[:, ::-1], scene.setting),
            }
            for k in range(len(poses)):
                if k != scene.setting:
                    wrong[f"exchanged {k}"] = (scene.image, k)
            n += _wrong(counts, model, wrong, poses, stated, camera)
        total = sum(counts.values(), Counter())
        print(f"{n}: {dict(total)}", file=sys.stderr, flush=True)
        # a part of the same family, smaller by 3 to 15 % in each direction
        others = taken(part, plan, lamps, rng, 0.5 * sigmas, 1 - rng.uniform(0.03, 0.15, 3))
        wrong = {f"another part {one.setting}": (one.image, one.setting) for one in others}
        n += _wrong(counts, model, wrong, poses, stated, camera)
    print(f"{(time.process_time() - begun) / n:.2f} s of processor time each, with rendering")
    return counts


def _wrong(counts, model, images, poses, stated, camera) -> int:
    """Register images of something else; return their number."""
    for name, (image, k) in images.items():
        found = tried(model, np.ascontiguousarray(image), poses[k], stated, camera)
        key = name.rstrip("0123456789 ") if not name.startswith("turned") else name
        counts.setdefault(key, Counter())["refused" if found is None else "false"] += 1
        if found is not None:
            print(name, _words(found, np.nan), file=sys.stderr)
    return len(images)


def _words(found, off) -> str:
    return (
        f"false: {off:.1f} px off, {found.used} of {found.offered} samples agree, "
        f"chi2 {found.chi2:.1f}, misfit {found.misfit_px:.3f} px"
    )


def main() -> int:
    """Count and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plan", type=Path)
    parser.add_argument("part", type=Path)
    parser.add_argument("-n", type=int, default=1000, help="registrations, at least")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts = count_finds(options)
    print(f"{'image':<28}{'right':>7}{'false':>7}{'refused':>9}")
    total = sum(counts.values(), Counter())
    for name, own in counts.items():
        print(f"{name:<28}{own['right']:7d}{own['false']:7d}{own['refused']:9d}")
    print(f"{'all':<28}{total['right']:7d}{total['false']:7d}{total['refused']:9d}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
