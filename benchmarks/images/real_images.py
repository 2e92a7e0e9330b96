"""A referee of `aspectgraph measure` on images as cameras take them, of edges as machines leave them.

Needs mitsuba 3.9 or newer, which the project does not install: `pip install mitsuba`. Its fast variant needs LLVM 16 or
newer; name the library in DRJIT_LIBLLVM_PATH where it is not found. mitsuba 3.9.1 stops with LLVM 16 ("cannot select
fminimum"), 3.9.0 does not. The part (`broken_part`) has sizes that deviate,
and sharp, chamfered or rounded edges. Light goes from face to face. The images are blurred, noisy, and go through a
response of the camera to whole grey values. Nothing is shared with what measures them.

FOLDER keeps plans and rendered light, so a second run measures only. Each combination of --edges, --materials,
--lights, --responses, --bits and --states is a line of the table. The measurement gets what a state names. Lamps and
ring are planned; dome and backlight take the poses of a plan without light.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import os
import sys
import time

# before numpy: threads of small matrices only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from broken_part import Sizes, dimensions_of, mesh_of, solid_of, write_step
from measured_images import displaced
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter, zoom

from aspectgraph import read_solid
from planner import (
    Camera,
    Effort,
    LampDome,
    MeasureOptions,
    Measurer,
    PoseUncertainty,
    Registration,
    plan_inspection,
    read_plan,
)
from planner.light.lighting import Lighting
from planner.light.plan_light import chosen_lamps
from planner.measuring.images import shots_of

SURFACES_MM = 0.03
TOLERANCE_MM = 0.15
SHARE = 0.4
CAMERA = Camera(16.0, (0.0069, 0.0069), (1224, 1024), 11.0, 215.0, largest_blur_mm=0.0138)
WORKSPACE_MM = [[-60, -120, -25], [140, 180, 330]]
LOWEST_CAMERA_MM = 60.0
DOME = LampDome((40.0, 30.0, 10.0), 350.0, 60.0)

BAND_PX = 8
# so far from edges, every so many pixels are traced
EVERY = 4
FEW = 8
BLUR_PX = 0.76
# noise of a black pixel, and variance by light: full wells of 12,000 electrons
READ_NOISE = 0.002
SHOT_VARIANCE = 1 / 12_000
DARK = 0.02
# the place beside edges that only one in a hundred exceeds has this share of white
BRIGHT = 0.8
BRIGHT_QUANTILE = 0.99
# change of a normal, or share of a distance, from which on two pixels see different places
_TURN = 0.03
_JUMP = 0.004

RING_MM = 35.0
RING_LAMPS = 24
BACKLIGHT_MM = 160.0
BELOW_MM = 10.0

LIGHTS = ("lamps", "ring", "dome", "backlight")
MATERIALS = ("matt", "plastic", "brushed", "blasted")


def surface_of(material: str) -> dict:
    """Return what mitsuba takes for a material."""
    metal = {"type": "roughconductor", "material": "Al", "distribution": "ggx"}
    surfaces = {
        "matt": {"type": "diffuse", "reflectance": 0.5},
        "plastic": {"type": "roughplastic", "diffuse_reflectance": 0.4, "alpha": 0.15},
        # lines of the brush lie across the rougher direction
        "brushed": {**metal, "alpha_u": 0.1, "alpha_v": 0.35},
        "blasted": {**metal, "alpha": 0.4},
    }
    return {"type": "twosided", "bsdf": surfaces[material]}


@dataclass(frozen=True)
class Scene:
    """A part, its material, and its light.

    ``lamps`` are the places of small lamps (k, 3), mm. ``area`` is "dome", "backlight" or empty.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    material: str
    lamps: np.ndarray
    area: str


class Tracer:
    """Light on rays from a camera, by mitsuba."""

    def __init__(self, mi, scene: Scene):
        self._mi = mi
        self._lamps = scene.lamps
        part = self._part(scene)
        self.scene = mi.load_dict({"type": "scene", "part": part, **self.emitters(scene)})
        self._bare = mi.load_dict({"type": "scene", "part": part})
        hide = scene.area != "backlight"
        self._path = mi.load_dict({"type": "path", "max_depth": 5, "hide_emitters": hide})

    def emitters(self, scene: Scene) -> dict:
        """Return what shines, and what else is around the part, as mitsuba takes it."""
        return self._area(scene) if scene.area else self._points(scene)

    def _part(self, scene: Scene):
        mi = self._mi
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(surface_of(scene.material))
        count = len(scene.triangles)
        mesh = mi.Mesh("part", 3 * count, count, has_vertex_texcoords=True, props=properties)
        corners = scene.vertices[scene.triangles].reshape(-1, 3)
        parameters = mi.traverse(mesh)
        parameters["vertex_texcoords"] = _brush(scene).ravel().astype(np.float32)
        # each triangle has corners of its own: faces are flat
        parameters["vertex_positions"] = corners.ravel().astype(np.float32)
        parameters["faces"] = np.arange(len(corners), dtype=np.uint32)
        parameters.update()
        return mesh

    def _points(self, scene: Scene) -> dict:
        middle = scene.vertices.mean(axis=0)
        emitters = {}
        for k, lamp in enumerate(scene.lamps):
            away = float(np.linalg.norm(lamp - middle))
            radius = 0.02 * away
            radiance = (away / radius) ** 2 / len(scene.lamps)
            emitters[f"lamp{k}"] = {
                "type": "sphere",
                "center": lamp.tolist(),
                "radius": radius,
                "emitter": _emitter("area", radiance),
            }
        return emitters

    def _area(self, scene: Scene) -> dict:
        mi = self._mi
        low = scene.vertices.min(axis=0)
        middle = (low + scene.vertices.max(axis=0)) / 2
        turn = mi.ScalarTransform4f()
        if scene.area == "dome":
            place = turn.translate([*middle[:2], low[2] - 0.5]).scale(10 * BACKLIGHT_MM)
            table = {"type": "diffuse", "reflectance": 0.05}
            floor = {"type": "rectangle", "to_world": place, "bsdf": table}
            return {"sky": _emitter("constant", 1.0), "floor": floor}
        place = turn.translate([*middle[:2], low[2] - BELOW_MM]).scale(BACKLIGHT_MM)
        panel = {"type": "rectangle", "to_world": place, "emitter": _emitter("area", 1.0)}
        return {"room": _emitter("constant", 0.02), "panel": panel}

    def light(self, eye, directions, samples: int, seed: int) -> np.ndarray:
        """Return the mean light (n,) of samples of rays (n * samples, 3), those of one pixel in order."""
        mi = self._mi
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, len(directions))
        colour = self._path.sample(self.scene, sampler, self.rays(eye, directions))[0]
        grey = np.mean([np.array(channel) for channel in colour], axis=0)
        return grey.reshape(-1, samples).mean(axis=1)

    def rays(self, eye, directions):
        """Return rays (n,) from an eye (3,) along directions (n, 3)."""
        mi = self._mi
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return mi.RayDifferential3f(
            o=mi.Point3f(*(float(x) for x in eye)),
            d=mi.Vector3f(*(np.ascontiguousarray(c, np.float32) for c in unit.T)),
        )

    def places(self, eye, directions) -> np.ndarray:
        """Return distance, normal and lamps that are hidden of what rays (n, 3) meet (n, 4 + k)."""
        mi = self._mi
        hit = self._bare.ray_intersect(self.rays(eye, directions))
        seen = np.array(hit.is_valid())
        depth = np.where(seen, np.array(hit.t), 1e4)
        columns = [np.log(depth) / _JUMP * _TURN]
        columns += [np.where(seen, np.array(axis), 0.0) for axis in hit.n]
        for lamp in self._lamps:
            place = mi.Point3f(*(float(x) for x in lamp))
            shadow = self._bare.ray_test(hit.spawn_ray_to(place))
            columns.append(np.where(seen, np.array(shadow), 0.0))
        return np.stack(columns, axis=1)


def _brush(scene: Scene) -> np.ndarray:
    """Return coordinates (3 t, 2) on faces that go along x, or y where a face is square to x: lines of a brush do."""
    corners = scene.vertices[scene.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axes = np.array([[1, 2], [0, 2], [0, 1]])[np.abs(normals).argmax(axis=1)]
    return np.take_along_axis(corners, axes[:, None], axis=2).reshape(-1, 2)


def _emitter(kind: str, radiance: float) -> dict:
    return {"type": kind, "radiance": {"type": "rgb", "value": float(radiance)}}


def light_of(
    tracer: Tracer, pose, rng, samples: int, camera: Camera = CAMERA
) -> tuple[np.ndarray, float]:
    """Return an image (h, w) of light, and how bright the brightest places beside edges are."""
    width, height = camera.resolution
    v, u = np.mgrid[:height, :width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    places = tracer.places(pose[:3, 3], _directions(pixels, pose, camera))
    change = np.zeros((height, width), bool)
    for column in places.T:
        layer = column.reshape(height, width)
        change |= maximum_filter(layer, 3) - minimum_filter(layer, 3) > _TURN
    band = binary_dilation(change, iterations=BAND_PX).ravel()
    rows, columns = (-(-(n - 1) // EVERY) + 1 for n in (height, width))
    v, u = np.mgrid[:rows, :columns] * EVERY
    coarse = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    few = _traced(tracer, pose, coarse, rng, FEW, camera).reshape(rows, columns)
    size = (rows - 1) * EVERY + 1, (columns - 1) * EVERY + 1
    image = zoom(few, np.divide(size, few.shape), order=1)[:height, :width].copy()
    near = _traced(tracer, pose, pixels[band], rng, samples, camera)
    image.ravel()[band] = near
    return image.astype(np.float32), float(np.quantile(near, BRIGHT_QUANTILE))


def _directions(pixels, pose, camera: Camera) -> np.ndarray:
    rays = np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(camera.matrix).T
    return rays @ pose[:3, :3].T


def _traced(tracer: Tracer, pose, pixels, rng, samples: int, camera: Camera) -> np.ndarray:
    places = np.repeat(pixels, samples, axis=0)
    places = places + rng.uniform(-0.5, 0.5, places.shape)
    seed = int(rng.integers(2**31))
    return tracer.light(pose[:3, 3], _directions(places, pose, camera), samples, seed)


def encoded(light, response: str) -> np.ndarray:
    """Return levels in [0, 1] of light in [0, 1] by a response: "linear", "srgb", "video" or a gamma."""
    if response == "linear":
        return light
    if response == "video":
        return (16 + 219 * light ** (1 / 2.2)) / 255
    if response == "srgb":
        # IEC 61966-2-1
        return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return light ** (1 / float(response))


def taken(light, scale: float, response: str, bits: int, rng) -> np.ndarray:
    """Return an image of whole grey values of light that is scaled to a share of white."""
    seen = gaussian_filter(scale * light.astype(float) + DARK, BLUR_PX, mode="nearest")
    sigma = np.sqrt(READ_NOISE**2 + SHOT_VARIANCE * np.maximum(seen, 0.0))
    seen = np.clip(seen + sigma * rng.normal(size=seen.shape), 0.0, 1.0)
    levels = np.rint(encoded(seen, response) * (2**bits - 1))
    return levels.astype(np.uint8 if bits == 8 else np.uint16)


@dataclass(frozen=True)
class Condition:
    """How a part is made and its images are taken. ``edges`` is "sharp", or such as "radius 0.2"."""

    edges: str
    material: str
    light: str
    response: str
    bits: int
    state: str

    @property
    def broken(self) -> tuple[str, float]:
        """How its edges are broken, and by how much, mm."""
        kind, _, size = self.edges.partition(" ")
        return kind, float(size or 0.0)

    def __str__(self) -> str:
        return (
            f"{self.edges}, {self.material}, {self.light}, {self.response}, {self.bits} bits, "
            f"{self.state}"
        )


@dataclass
class Row:
    """A reading, and whether the plan promises it with its light; lengths in mm."""

    seed: int
    edges: str
    material: str
    light: str
    response: str
    bits: int
    state: str
    image: str
    name: str
    promised: int
    nominal: float
    truth: float
    value: float
    u: float
    decision: str
    reason: str
    notes: str
    image_notes: str

    @property
    def is_read(self) -> bool:
        """Whether there is a value."""
        return not self.reason

    @property
    def error(self) -> float:
        """Value less truth."""
        return self.value - self.truth

    @property
    def is_wrong(self) -> bool:
        """Whether it is decided that the part conforms and it does not, or the reverse."""
        wide = 2 if self.name in ("length", "step", "thickness") else 1
        conforms = abs(self.truth - self.nominal) <= wide * TOLERANCE_MM
        return self.decision == ("does not conform" if conforms else "conforms")


class Bench:
    """Plans, parts and light, kept in a folder."""

    def __init__(self, folder: Path, mi, samples: int):
        self._mi = mi
        self._samples = samples
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.part_path = folder / "plate.step"
        if not self.part_path.exists():
            write_step(solid_of(Sizes()), self.part_path)
        self.solid = read_solid(self.part_path)
        self._measurers: dict[str, Measurer] = {}

    def measurer(self, light: str) -> Measurer:
        """Return what measures images in a light, by its plan."""
        if light not in self._measurers:
            self._measurers[light] = Measurer(self._plan(light), self.solid)
        return self._measurers[light]

    def promised(self, light: str) -> set[str]:
        """Return the targets that a plan shows with its light; all of them without light."""
        plan = self.measurer(light).plan
        if plan.light is None:
            return set(plan.inspected)
        return {name for images in plan.light.images for image in images for name in image.contrast}

    def _plan(self, light: str):
        path = self._folder / f"plan_{light}.json"
        if not path.exists():
            plan = self._bare_plan()
            if light in ("lamps", "ring"):
                places = DOME if light == "lamps" else "ring"
                # by contrast alone, as the readings show what else keeps a target from being read
                lamps = chosen_lamps(Lighting(places), plan, self.solid)
                plan = replace(plan, light=lamps)
            plan.write(path)
        return read_plan(path)

    def _bare_plan(self):
        path = self._folder / "plan.json"
        if not path.exists():
            plan_inspection(
                self.solid,
                dimensions_of(self.solid, TOLERANCE_MM, SHARE),
                CAMERA,
                PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001),
                workspace=WORKSPACE_MM,
                reach=above_the_table,
                registration=Registration.own_edges(SURFACES_MM),
                surfaces_mm=SURFACES_MM,
                effort=Effort.named("quick"),
                rng=1,
            ).write(path)
        return read_plan(path)

    def light(self, condition: Condition, seed: int) -> dict[str, tuple[np.ndarray, float]]:
        """Return the light of each image, and its scale to a share of white."""
        names = seed, condition.edges, condition.material, condition.light
        path = self._folder / "light" / f"{'_'.join(map(str, names)).replace(' ', '_')}.npz"
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            np.savez(path, **self._traced(condition, seed))
        with np.load(path) as kept:
            names = [name for name in kept.files if not name.endswith(" scale")]
            return {name: (kept[name], float(kept[f"{name} scale"])) for name in names}

    def sizes(self, seed: int) -> Sizes:
        """Return the sizes of a part."""
        return Sizes.drawn(np.random.default_rng([seed, 0]), SURFACES_MM, 1.5 * SURFACES_MM)

    def _traced(self, condition: Condition, seed: int) -> dict[str, np.ndarray | float]:
        plan = self.measurer(condition.light).plan
        vertices, triangles = mesh_of(solid_of(self.sizes(seed), *condition.broken))
        rng = np.random.default_rng([seed, 1])
        sigmas = plan.pose_uncertainty.sigmas
        poses = [displaced(np.asarray(setting.cam2world), sigmas, rng) for setting in plan.settings]
        traced: dict[str, np.ndarray | float] = {}
        for shot in shots_of(plan):
            pose = poses[shot.setting]
            lamps, area = self._lamps(plan, shot, pose, condition.light)
            scene = Scene(vertices, triangles, condition.material, lamps, area)
            # light from everywhere needs more rays
            samples = self._samples * (4 if area == "dome" else 1)
            light, bright = light_of(Tracer(self._mi, scene), pose, rng, samples)
            traced[shot.name] = light
            full = 1.0 if area == "backlight" else bright
            traced[f"{shot.name} scale"] = (BRIGHT - DARK) / full
        return traced

    def _lamps(self, plan, shot, pose, light: str) -> tuple[np.ndarray, str]:
        """Return the places of small lamps, and the area that is bright."""
        if light in ("dome", "backlight"):
            return np.empty((0, 3)), light
        if light == "ring":
            turn = 2 * np.pi * np.arange(RING_LAMPS) / RING_LAMPS
            around = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
            return pose[:3, 3] + RING_MM * around @ pose[:3, :3].T, ""
        images = plan.light.images[shot.setting]
        shots = [other.name for other in shots_of(plan) if other.setting == shot.setting]
        if not images:
            return pose[None, :3, 3], ""
        return plan.light.lamps[list(images[shots.index(shot.name)].lamps)], ""

    def rows(self, condition: Condition, seed: int) -> list[Row]:
        """Render and measure one part under one condition."""
        measurer = self.measurer(condition.light)
        rng = np.random.default_rng([seed, 2])
        images = {
            name: taken(light, scale, condition.response, condition.bits, rng)
            for name, (light, scale) in self.light(condition, seed).items()
        }
        results = measurer.measure(images, options_of(condition))
        truth = self.sizes(seed).values
        promised = self.promised(condition.light)
        rows = []
        wider = {}
        if condition.state == UNSEEN and results.unseen is not None:
            wider = results.unseen.uncertainties
        for result in results:
            if not result.readings:
                # not planned
                continue
            rows.append(
                Row(
                    seed,
                    **{field.name: getattr(condition, field.name) for field in fields(condition)},
                    image=result.readings[0].image,
                    name=result.name,
                    promised=int(result.name in promised),
                    nominal=result.nominal,
                    truth=truth[result.name],
                    value=result.value,
                    u=wider.get(result.name, 2 * result.standard_uncertainty) / 2,
                    decision=result.decision.value,
                    reason=result.reason,
                    notes="; ".join(result.notes),
                    image_notes="; ".join(results.notes),
                )
            )
        return rows


def above_the_table(places) -> np.ndarray:
    """Return how far cameras (n, 3) are above the least height, mm."""
    return places[:, 2] - LOWEST_CAMERA_MM


def options_of(condition: Condition) -> MeasureOptions:
    """Return how a condition is measured: the measurement gets what the condition states."""
    stated = condition.state.split("+")
    options: dict = {}
    kind, size = condition.broken
    if "edges" in stated:
        options["edge_break_mm"] = (0.0, 0.02) if kind == "sharp" else (0.5 * size, 1.5 * size)
    if "sharp" in stated:
        options["edge_break_mm"] = (0.0, 0.0)
    if "response" in stated and condition.response != "video":
        options["response"] = condition.response
    if "white" in stated:
        options["white_level"] = 2**condition.bits - 1
    return MeasureOptions(Registration.own_edges(SURFACES_MM), **options)


UNSEEN = "unseen"
HEAD = (
    f"{'n':>4}{'read':>5}{'bias':>8}{'rms':>8}{'u':>7}{'worst e/u':>10}{'in 2u':>7}{'>3u':>5}"
    f"{'silent':>7}{'wrong':>6}"
)


def line(rows: list[Row]) -> str:
    """Return the numbers of some rows, as `HEAD` names them; µm."""
    good = [row for row in rows if row.is_read]
    text = f"{len(rows):4d}{len(good):5d}"
    if not good:
        return text
    error = 1000 * np.array([row.error for row in good])
    u = 1000 * np.array([row.u for row in good])
    far = np.abs(error) > 3 * u
    silent = [
        off and not row.notes and not row.image_notes for off, row in zip(far, good, strict=True)
    ]
    return (
        f"{text}{error.mean():8.1f}{np.sqrt((error**2).mean()):8.1f}{u.mean():7.1f}"
        f"{np.abs(error / u).max():10.1f}{np.mean(np.abs(error) <= 2 * u):7.2f}{far.sum():5d}"
        f"{sum(silent):7d}{sum(row.is_wrong for row in good):6d}"
    )


def show(rows: list[Row], by_kind: bool = True) -> None:
    """Print a line for each condition, and for diameters and distances of it."""
    names = [field.name for field in fields(Condition)]
    conditions = [Condition(**{name: getattr(row, name) for name in names}) for row in rows]
    width = max(len(str(condition)) for condition in conditions) + 2
    print(f"{'condition':<{width}}{'of':<10}{HEAD}   µm")
    for condition in dict.fromkeys(conditions):
        own = [row for row, its in zip(rows, conditions, strict=True) if its == condition]
        print(f"{condition!s:<{width}}{'all':<10}{line(own)}")
        if by_kind:
            round_rows = [row for row in own if row.name.startswith("diameter")]
            print(f"{'':<{width}}{'diameters':<10}{line(round_rows)}")
            others = [row for row in own if not row.name.startswith("diameter")]
            print(f"{'':<{width}}{'others':<10}{line(others)}")


def write(rows: list[Row], path: Path) -> None:
    """Write rows to a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])))
        writer.writeheader()
        writer.writerows(map(asdict, rows))


def parsed() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="keeps plans and light")
    parser.add_argument(
        "--edges", nargs="+", default=["sharp", "chamfer 0.2", "radius 0.2"], help="and size, mm"
    )
    parser.add_argument("--materials", nargs="+", default=["matt"], choices=MATERIALS)
    parser.add_argument("--lights", nargs="+", default=["lamps"], choices=LIGHTS)
    parser.add_argument(
        "--responses", nargs="+", default=["linear", "2.2"], help="linear, srgb, video, or a gamma"
    )
    parser.add_argument("--bits", nargs="+", type=int, default=[8])
    parser.add_argument(
        "--states",
        nargs="+",
        default=["nothing"],
        help="such as edges+response+white, or sharp; unseen: nothing, and u with breaks that images do not show",
    )
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--samples", type=int, default=32, help="a pixel, near edges")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--readings", action="store_true", help="print each reading")
    return parser.parse_args()


def main() -> int:
    """Measure all conditions, print the table, write the readings."""
    options = parsed()
    try:
        import drjit
        import mitsuba as mi
    except ImportError:
        print("mitsuba is not installed: pip install mitsuba", file=sys.stderr)
        return 2
    mi.set_variant(options.variant)
    drjit.set_thread_count(options.threads)
    bench = Bench(options.folder, mi, options.samples)
    rows: list[Row] = []
    cells = itertools.product(
        options.edges,
        options.materials,
        options.lights,
        options.responses,
        options.bits,
        options.states,
    )
    for cell, seed in itertools.product(cells, options.seeds):
        condition = Condition(*cell)
        own = bench.rows(condition, seed)
        rows += own
        print(f"{condition} {seed}: {time.process_time():.0f} s", file=sys.stderr, flush=True)
        for row in own if options.readings else []:
            text = row.reason or f"{1000 * row.error:8.1f} ± {2000 * row.u:.1f} µm {row.notes}"
            print(f"  {row.name:<18}{text}")
        if options.csv:
            write(rows, options.csv)
    show(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
