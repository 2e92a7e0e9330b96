"""A second referee of `aspectgraph measure`: path-traced images, matt and metal, with light from face to face.

Needs mitsuba 3.9 or newer, which the project does not install: `pip install mitsuba`. Its fast variant needs LLVM 16 or
newer; name the library in DRJIT_LIBLLVM_PATH where it is not found. Without it, `--variant scalar_rgb` renders, slowly.

Parts deviate and cameras are displaced as in `measured_parts`, as much as stated or more. Lamps are those of the plan;
a plan without lamps gets the best of 17 around the camera. Only bands around edges are rendered with many samples a
pixel; the rest from few rays. Tables pool the readings by material, exposure and condition, see `measured_rows`.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import time

# before numpy: threads of small matrices only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pathlib import Path

import numpy as np
from measured_images import displaced
from measured_parts import CYLINDERS, TILTS, Condition, Model
from measured_rows import Row, rows_of, show, write
from part_images import Optics, PartImages
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter, zoom

from planner import Localisation, MeasureOptions, Registration

BAND_PX = 8
# so far from edges, every so many pixels are rendered
EVERY = 4
# a matt face that the lamp lights frontally has this grey value
BRIGHT = 0.45
BLUR_PX = 0.76
NOISE = 0.008
DARK = 0.04


class PathTracer:
    """Grey values of rays at a mesh under small lamps, by mitsuba."""

    def __init__(self, mi, vertices, triangles, lamps, material: str):
        mesh = mi.Mesh("part", len(triangles) * 3, len(triangles), props=_properties(mi, material))
        corners = vertices[triangles].reshape(-1, 3)
        parameters = mi.traverse(mesh)
        # each triangle has corners of its own: faces are flat
        parameters["vertex_positions"] = corners.ravel().astype(np.float32)
        parameters["faces"] = np.arange(len(corners), dtype=np.uint32)
        parameters.update()
        self._mi = mi
        scene = {"type": "scene", "part": mesh}
        for k, lamp in enumerate(lamps):
            away = np.linalg.norm(lamp - vertices.mean(axis=0))
            radius = 0.02 * away
            # so that a white face at the part's middle has the grey value BRIGHT
            radiance = float(BRIGHT / 0.5 * (away / radius) ** 2) / len(lamps)
            scene[f"lamp{k}"] = {
                "type": "sphere",
                "center": lamp.tolist(),
                "radius": float(radius),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
            }
        self.scene = mi.load_dict(scene)
        self.integrator = mi.load_dict({"type": "path", "max_depth": 4, "hide_emitters": True})

    def grey(self, eye, directions, samples: int, seed: int) -> np.ndarray:
        """Return the mean grey value (n,) of samples of rays (n * samples, 3), those of one pixel in order."""
        mi = self._mi
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, len(directions))
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        ray = mi.RayDifferential3f(
            o=mi.Point3f(*(float(x) for x in eye)),
            d=mi.Vector3f(*(np.ascontiguousarray(c, np.float32) for c in unit.T)),
        )
        colour = self.integrator.sample(self.scene, sampler, ray)[0]
        return np.array(colour[0]).reshape(-1, samples).mean(axis=1)


def _properties(mi, material):
    properties = mi.Properties()
    bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.5}}
    if material == "metal":
        bsdf["bsdf"] = {"type": "roughconductor", "alpha": 0.25, "specular_reflectance": 0.6}
    properties["bsdf"] = mi.load_dict(bsdf)
    return properties


def image_of(tracer, flat, pose, lamps, rng, samples) -> np.ndarray:
    """Return an image without noise, grey values of which 1 is white: many samples near edges, few elsewhere."""
    width, height = flat.optics.size
    v, u = np.mgrid[:height, :width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    shaded = flat._once(pose, pixels, lamps)
    change = maximum_filter(shaded, 3) - minimum_filter(shaded, 3) > 0.008
    band = binary_dilation(change, iterations=BAND_PX).ravel()
    rows, columns = (-(-(n - 1) // EVERY) + 1 for n in (height, width))
    v, u = np.mgrid[:rows, :columns] * EVERY
    few = _traced(tracer, flat, pose, np.stack([u.ravel(), v.ravel()], axis=1), rng, 4)
    few = few.reshape(rows, columns)
    size = (rows - 1) * EVERY + 1, (columns - 1) * EVERY + 1
    grey = zoom(few, np.divide(size, few.shape), order=1)[:height, :width].copy()
    grey.ravel()[band] = _traced(tracer, flat, pose, pixels[band], rng, samples)
    return grey + DARK


def _traced(tracer, flat, pose, pixels, rng, samples) -> np.ndarray:
    places = np.repeat(pixels.astype(float), samples, axis=0)
    places += rng.uniform(-0.5, 0.5, places.shape)
    rays = np.c_[places, np.ones(len(places))] @ np.linalg.inv(flat.optics.matrix).T
    return tracer.grey(pose[:3, 3], rays @ pose[:3, :3].T, samples, int(rng.integers(2**31)))


def taken(grey, exposure, rng) -> np.ndarray:
    """Return an image of 8 bits at an exposure."""
    seen = gaussian_filter(exposure * grey, BLUR_PX, mode="nearest")
    seen = seen + rng.normal(0.0, NOISE, seen.shape)
    return np.clip(np.rint(seen * 255), 0, 255).astype(np.uint8)


def measured_part(model: Model, seed: int, condition: Condition, options, mi) -> list[Row]:
    """Render and measure one part that is drawn, of all materials and exposures."""
    rng = np.random.default_rng(seed)
    plan = model.plan
    part = model.part
    planes = condition.surfaces * options.surfaces_mm
    part.deviate(rng, planes, CYLINDERS * planes, TILTS * planes)
    optics = Optics(plan.camera.matrix, plan.camera.resolution, every=3)
    flat = PartImages(part.vertices, part.triangles, optics)
    sigmas = condition.poses * plan.pose_uncertainty.sigmas
    real = [displaced(np.asarray(one.cam2world), sigmas, rng) for one in plan.settings]
    truth = {where: part.true_value(one) for where, one in model.measured.items()}
    rows = []
    for material in options.materials:
        greys = {}
        for shot in model.shots:
            lamps = model.lamps[shot.name][0]
            places = [lamp.place for lamp in lamps]
            tracer = PathTracer(mi, part.vertices, part.triangles, places, material)
            scene = (tracer, flat, real[shot.setting], lamps)
            greys[shot.name] = image_of(*scene, rng, options.samples)
        for exposure in options.exposures:
            images = {name: taken(grey, exposure, rng) for name, grey in greys.items()}
            for floor in options.floors:
                given = Localisation.gaussian(0.1, floor_px=floor) if floor else None
                how = MeasureOptions(Registration.own_edges(options.surfaces_mm), given)
                label = (
                    f"{material}, exposure {exposure:g}, {condition}, floor {floor or 'of plan'}"
                )
                results = model.measurer.measure(images, how)
                rows += rows_of(results, plan, truth, model.name, seed, label)
    return rows


def main() -> int:
    """Measure path-traced images and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--pair", nargs=2, action="append", required=True, metavar=("PLAN", "PART"), type=Path
    )
    parser.add_argument("--draws", type=int, default=1, help="parts of each model")
    parser.add_argument("--first", type=int, default=1, help="seed of the first")
    parser.add_argument("--samples", type=int, default=32, help="a pixel, near edges")
    parser.add_argument("--materials", nargs="+", default=["matt", "metal"])
    parser.add_argument("--exposures", nargs="+", type=float, default=[1.0, 0.25])
    parser.add_argument("--surfaces-mm", type=float, default=0.03, help="stated deviation")
    parser.add_argument("--surfaces", nargs="+", type=float, default=[1.0], help="times stated")
    parser.add_argument("--poses", nargs="+", type=float, default=[1.0], help="times stated")
    parser.add_argument(
        "--floors", nargs="+", type=float, default=[0.0], help="of the localisation, px; 0: plan's"
    )
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    try:
        import drjit
        import mitsuba as mi
    except ImportError:
        parser.error("mitsuba is not installed: pip install mitsuba")
    mi.set_variant(options.variant)
    drjit.set_thread_count(options.threads)
    conditions = [Condition(*both) for both in itertools.product(options.surfaces, options.poses)]
    rows: list[Row] = []
    for plan, path in options.pair:
        model = Model(path.stem, plan, path)
        seeds = range(options.first, options.first + options.draws)
        for condition, seed in itertools.product(conditions, seeds):
            rows += measured_part(model, seed, condition, options, mi)
            print(
                f"{model.name} {seed} {condition}: {len(model.shots)} images of each material, "
                f"{time.process_time():.0f} s",
                file=sys.stderr,
                flush=True,
            )
            if options.csv:
                write(rows, options.csv)
    show(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
