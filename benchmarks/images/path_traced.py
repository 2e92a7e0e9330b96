"""A second referee of `aspectgraph measure`: path-traced images, matt and metal, with light from face to face.

Needs mitsuba 3.9 or newer, which the project does not install: `pip install mitsuba`. Its fast variant needs LLVM 16 or
newer; name the library in DRJIT_LIBLLVM_PATH where it is not found. Without it, `--variant scalar_rgb` renders, slowly.

Parts deviate and cameras are displaced as in `measured_images`. Only bands around edges are rendered with many samples
a pixel; what is farther from them gets one. The table has bias, rms error, mean u, the share of errors within 2 u, how
many were read, and false finds, by material and exposure.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from dimension_images import as_measured
from measured_images import best_lamp, displaced
from part_images import DeviatingPart, Optics, PartImages
from rendered_images import Renderer
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter

from aspectgraph import read_solid
from planner import Localisation, MeasureOptions, Measurer, Registration, read_plan

BAND_PX = 13
# a matt face that the lamp lights frontally has this grey value
BRIGHT = 0.45
BLUR_PX = 0.76
NOISE = 0.008
DARK = 0.04


class PathTracer:
    """Grey values of rays at a mesh under a small lamp, by mitsuba."""

    def __init__(self, mi, vertices, triangles, lamp, material: str, distance: float):
        mesh = mi.Mesh("part", len(triangles) * 3, len(triangles), props=_properties(mi, material))
        corners = vertices[triangles].reshape(-1, 3)
        parameters = mi.traverse(mesh)
        # each triangle has corners of its own: faces are flat
        parameters["vertex_positions"] = corners.ravel().astype(np.float32)
        parameters["faces"] = np.arange(len(corners), dtype=np.uint32)
        parameters.update()
        away = np.linalg.norm(lamp - vertices.mean(axis=0))
        radius = 0.02 * distance
        # so that a white face at the part's middle has the grey value BRIGHT
        radiance = float(BRIGHT / 0.5 * (away / radius) ** 2)
        self._mi = mi
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "part": mesh,
                "lamp": {
                    "type": "sphere",
                    "center": lamp.tolist(),
                    "radius": float(radius),
                    "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
                },
            }
        )
        self.integrator = mi.load_dict({"type": "path", "max_depth": 4})

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


def image_of(tracer, flat, pose, lamp, rng, samples) -> np.ndarray:
    """Return an image without noise, grey values of which 1 is white: many samples near edges, one elsewhere."""
    width, height = flat.optics.size
    v, u = np.mgrid[:height, :width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    shaded = flat._grey(pose, pixels, [lamp]).reshape(height, width)
    change = maximum_filter(shaded, 3) - minimum_filter(shaded, 3) > 0.008
    band = binary_dilation(change, iterations=BAND_PX).ravel()
    grey = np.empty(len(pixels))
    for chosen, n in ((~band, 1), (band, samples)):
        places = np.repeat(pixels[chosen], n, axis=0)
        places += rng.uniform(-0.5, 0.5, places.shape)
        rays = np.c_[places, np.ones(len(places))] @ np.linalg.inv(flat.optics.matrix).T
        rays = rays @ pose[:3, :3].T
        grey[chosen] = tracer.grey(pose[:3, 3], rays, n, int(rng.integers(2**31)))
    return grey.reshape(height, width) + DARK


def taken(grey, exposure, rng) -> np.ndarray:
    """Return an image of 8 bits at an exposure."""
    seen = gaussian_filter(exposure * grey, BLUR_PX, mode="nearest")
    seen = seen + rng.normal(0.0, NOISE, seen.shape)
    return np.clip(np.rint(seen * 255), 0, 255).astype(np.uint8)


def rows_of(options, mi) -> list[tuple]:
    """Render and measure all parts."""
    plan = read_plan(options.plan)
    matrix = plan.camera.matrix
    part = DeviatingPart(options.part, 0.01, 0.05)
    measurer = Measurer(plan, read_solid(options.part))
    measured = {name: as_measured(one) for name, one in plan.dimensions.items()}
    renderer = Renderer(part.vertices, part.triangles, matrix, samples=2)
    poses = [np.asarray(setting.cam2world) for setting in plan.settings]
    draw = np.random.default_rng(99)
    lamps = [
        best_lamp(renderer, pose, [measured[name] for name in setting.entities], draw)
        for pose, setting in zip(poses, plan.settings, strict=True)
    ]
    floor = None if options.floor is None else Localisation.gaussian(floor_px=options.floor)
    how = MeasureOptions(Registration.own_edges(), floor)
    rows = []
    for seed in range(options.first, options.first + options.parts):
        rng = np.random.default_rng(seed)
        part.deviate(rng, 0.02, 0.03, 0.01)
        flat = PartImages(part.vertices, part.triangles, Optics(matrix, plan.camera.resolution))
        real = [displaced(pose, plan.pose_uncertainty.sigmas, rng) for pose in poses]
        truth = {name: part.true_value(one) for name, one in measured.items()}
        for material in options.materials:
            greys = []
            for pose, lamp in zip(real, lamps, strict=True):
                place = (part.vertices, part.triangles, lamp.place, material)
                tracer = PathTracer(mi, *place, np.linalg.norm(pose[:3, 3] - lamp.place))
                greys.append(image_of(tracer, flat, pose, lamp, rng, options.samples))
            for exposure in options.exposures:
                images = {k + 1: taken(grey, exposure, rng) for k, grey in enumerate(greys)}
                for one in measurer.measure(images, how):
                    error = one.deviation - truth[one.name]
                    kind = (material, exposure, one.kind)
                    rows.append((*kind, error, one.standard_uncertainty, one.reason, one.name))
        print(f"part {seed}: {time.process_time():.0f} s", file=sys.stderr, flush=True)
    return rows


def show(rows, pixel_um: float) -> None:
    """Print the table."""
    print(
        f"{'material':<9}{'exposure':>9} {'kind':<12}{'n':>5}{'read':>6}{'bias':>8}{'rms':>8}{'u':>8}"
        f"{'in 2u':>7}{'false':>6}   µm"
    )
    for key in dict.fromkeys(row[:3] for row in rows):
        own = [row for row in rows if row[:3] == key]
        good = [row for row in own if not row[5]]
        line = f"{key[0]:<9}{key[1]:9.2f} {key[2]:<12}{len(own):5d}{len(good):6d}"
        if good:
            error = np.array([row[3] for row in good]) * 1000
            u = np.array([row[4] for row in good]) * 1000
            false = int(np.sum((np.abs(error) > pixel_um) & (np.abs(error) > 3 * u)))
            line += (
                f"{error.mean():8.1f}{np.sqrt((error**2).mean()):8.1f}{u.mean():8.1f}"
                f"{np.mean(np.abs(error) <= 2 * u):7.2f}{false:6d}"
            )
        print(line)


def main() -> int:
    """Measure path-traced images and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plan", type=Path)
    parser.add_argument("part", type=Path)
    parser.add_argument("--parts", type=int, default=5)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--samples", type=int, default=32, help="a pixel, near edges")
    parser.add_argument("--materials", nargs="+", default=["matt", "metal"])
    parser.add_argument("--exposures", nargs="+", type=float, default=[1.0, 0.25])
    parser.add_argument("--floor", type=float, help="of the localisation, px")
    parser.add_argument("--pixel-um", type=float, default=500.0, help="on the part")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    options = parser.parse_args()
    try:
        import mitsuba as mi
    except ImportError:
        parser.error("mitsuba is not installed: pip install mitsuba")
    mi.set_variant(options.variant)
    show(rows_of(options, mi), options.pixel_um)
    return 0


if __name__ == "__main__":
    sys.exit(main())
