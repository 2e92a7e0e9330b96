"""Whether a backlight, a dome and coaxial light show on metal what a plan promises: path-traced, measured, counted.

Needs mitsuba, see `real_images`. FOLDER keeps plans and images; a second run only measures. Dimensions of other --kinds
need another one. For each part and light a plan is made for metal. By default it has the poses of a plan without light,
which takes less time. Parts are drawn whose surfaces deviate, cameras are displaced, and the light stands or hangs
where its record says. Exposures are those of the plan. A reading is planned if the plan says that the light shows a
target in a setting. --above takes poses that a person would take: straight above each target, or moved by a share of
the field. Edges are named by what is on their other side, seen from above:

outline   nothing: the ground lies there
hole      a hole that goes through
other     the part goes on, lower down: steps, pockets and blind holes

Holes may be measured at either rim. Dimensions are chosen by geometry alone, so some cannot be measured.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import time

# before numpy: threads of small matrices only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from broken_part import Sizes, solid_of, write_step
from measured_images import displaced
from measured_parts import CYLINDERS, TILTS, Model
from planned_is_read import Planned, kind_of, planned_readings
from real_images import BRIGHT, DARK, Scene, Tracer, light_of, taken

from aspectgraph import read_solid
from aspectgraph.dimensions.tolerances import is_in_hole
from aspectgraph.solid.solid import RayScene
from planner import (
    Camera,
    Dimension,
    Effort,
    Lighting,
    Material,
    MeasureOptions,
    PoseUncertainty,
    Registration,
    plan_inspection,
    read_plan,
)
from planner.inspection import with_light

EFFORT = Effort(viewpoints=16, pricing_rounds=2, refutations=1, bound_nodes=2000)
KINDS = ("outline", "hole", "other")
LIGHTS = {"backlight": "backlight", "dome": "diffuse-dome", "coaxial": "coaxial"}
# as is stated of each metal: of the brushed one, the roughness along the lines of the brush
ROUGHNESS = {"brushed": 0.1, "blasted": 0.4}
# parallel edges are asked for a distance if they share so much of their length
LEAST_OVERLAP = 0.3
# light of the room, as a share of that of the lamp
ROOM = 0.02
# a backlight lies below the part
BELOW_MM = 0.05
# rays start so far before the window of coaxial light, as the beam splitter lets them through
BEFORE_MM = 1e-3
WIDE_MM = 2000.0
# poses above a target are moved by so much of the field
SHIFTS = (0.0, -0.22, 0.22)
# parts of a dome along its meridians and around
_STEPS = 64, 192
# a place is looked at from so far beside an edge, as a share of the part's size, and from above
_OFF = 1e-3
_ON = 1e-6


@dataclass(frozen=True)
class Case:
    """A part, the camera that looks at it, and how far it deviates."""

    path: Path
    camera: Camera
    surfaces_mm: float
    tolerance_mm: float
    uncertainty: PoseUncertainty
    most_of_kind: int = 4
    kinds: tuple[str, ...] = KINDS


def cases_of(folder: Path, parts: Path | None) -> dict[str, Case]:
    """Return the parts by name; those of others are in a folder."""
    plate = folder / "plate.step"
    if not plate.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_step(solid_of(Sizes()), plate)
    pitch = 0.0069, 0.0069
    size = 1224, 1024
    fine = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    near = Camera(16.0, pitch, size, 11.0, 260.0, largest_blur_mm=0.0138)
    cases = {"plate": Case(plate, near, 0.03, 0.15, fine)}
    if parts is None:
        return cases
    far = Camera(16.0, pitch, size, 11.0, 600.0, largest_blur_mm=0.0138)
    coarse = PoseUncertainty.isotropic(translation_mm=0.2, rotation_rad=0.001)
    for name in ("ctc_01", "ctc_02"):
        cases[name] = Case(parts / f"nist_{name}_ap242.stp", far, 0.05, 0.5, coarse)
    # from farther away, walls of its holes are too narrow in the image
    cases["ctc_01_near"] = Case(parts / "nist_ctc_01_ap242.stp", near, 0.05, 0.5, coarse)
    macro = Camera(25.0, pitch, size, 16.0, 150.0, largest_blur_mm=0.0138)
    exact = PoseUncertainty.isotropic(translation_mm=0.02, rotation_rad=0.0005)
    for name in ("1-1-2-2-19", "6-11-11-19"):
        cases[f"mfcad_{name}"] = Case(parts / f"mfcad_{name}.step", macro, 0.01, 0.05, exact)
    return cases


# What is measured.


def dimensions_of(solid, case: Case) -> dict[str, Dimension]:
    """Return dimensions by kind and number, such as "hole 2": those nearest to the part's middle."""
    dimensions: dict[str, Dimension] = {}
    found = {**_diameters(solid, case), **_distances(solid, case)}
    middle = np.mean(solid.bounds, axis=0)[:2]
    for kind in case.kinds:
        own = [(place, one) for (name, place), one in found.items() if name == kind]
        own.sort(key=lambda pair: float(np.linalg.norm(np.subtract(pair[0], middle))))
        for number, (_, dimension) in enumerate(own[: case.most_of_kind]):
            dimensions[f"{kind} {number + 1}"] = dimension
    return dimensions


def _limits(case: Case) -> tuple[float, float]:
    return -case.tolerance_mm, case.tolerance_mm


def _diameters(solid, case: Case) -> dict:
    """Return diameters by kind and place of rims with an axis along z."""
    rims = [rim for rim in solid.rims() if abs(rim.axis[2]) > 1 - _ON and is_in_hole(solid, rim)]
    scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
    low, high = np.asarray(solid.bounds)
    dimensions = {}
    for rim in rims:
        if rim.axis[2] < 0:
            continue
        start = np.array([*rim.centre[:2], high[2] + 1.0])
        is_open = not scene.blocked(start[None], np.array([[0.0, 0.0, low[2] - high[2] - 2.0]]))[0]
        others = [other for other in rims if _is_below(other, rim)]
        if is_open != bool(others):
            continue
        kind = "hole" if is_open else "other"
        dimensions[kind, tuple(rim.centre[:2])] = Dimension(
            "diameter",
            (rim.id,),
            tolerance=_limits(case),
            alternatives=tuple((other.id,) for other in others),
        )
    return dimensions


def _is_below(other, rim) -> bool:
    same = np.allclose(other.centre[:2], rim.centre[:2], atol=_OFF)
    alike = abs(other.radius_mm - rim.radius_mm) < _OFF
    return bool(same and alike and other.axis[2] < 0 and other.centre[2] < rim.centre[2])


def _distances(solid, case: Case) -> dict:
    """Return distances by kind and place of parallel edges of faces that look up, not farther than the field."""
    scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
    low, high = np.asarray(solid.bounds)
    size = float(np.linalg.norm(high - low))
    field = 0.8 * min(case.camera.sensor_size_mm) * case.camera.focus_distance_mm
    field /= case.camera.focal_length_mm
    edges = []
    for edge in solid.edges:
        normals = solid.normals[list(edge.faces)]
        up = normals[:, 2] > 1 - _ON
        ends = solid.vertices[list(edge.vertices)]
        length = np.linalg.norm(ends[1] - ends[0])
        if edge.curved or edge.dihedral_deg < 60 or up.sum() != 1 or length < 0.03 * size:
            continue
        side = normals[~up][0]
        if abs(side[2]) > _ON:
            continue
        kind = "other" if _lies_before_part(scene, ends, side, low[2], size) else "outline"
        edges.append((edge.id, kind, side, ends))
    dimensions = {}
    used: set[int] = set()
    pairs = sorted(itertools.combinations(edges, 2), key=lambda pair: -_overlap(*pair))
    for one, other in pairs:
        across = (other[3].mean(axis=0) - one[3].mean(axis=0)) @ one[2]
        opposite = one[2] @ other[2] < -1 + _ON
        level = abs(one[3][0, 2] - other[3][0, 2]) < _OFF
        within = 0.05 * field < abs(across) < field
        if not (opposite and level and within and _overlap(one, other) > LEAST_OVERLAP):
            continue
        if used & {one[0], other[0]}:
            continue
        used |= {one[0], other[0]}
        place = tuple(np.mean([one[3], other[3]], axis=(0, 1))[:2])
        ids = one[0], other[0]
        kind = "outline" if one[1] == other[1] == "outline" else "other"
        dimensions[kind, place] = Dimension("distance", ids, tolerance=_limits(case))
    return dimensions


def _lies_before_part(scene, ends, side, lowest: float, size: float) -> bool:
    """Tell whether the part is below what is beside an edge, anywhere along it."""
    shares = np.linspace(0.05, 0.95, 7)[:, None]
    starts = ends[0] + shares * (ends[1] - ends[0]) + _OFF * size * side
    starts[:, 2] += _OFF
    down = np.tile([0.0, 0.0, lowest - ends[0, 2] - 1.0], (len(starts), 1))
    return bool(scene.blocked(starts, down).any())


def _overlap(one, other) -> float:
    """Return the length that two edges share along the first, as a share of the longer one's."""
    along = one[3][1] - one[3][0]
    length = float(np.linalg.norm(along))
    places = np.sort((other[3] - one[3][0]) @ along / length)
    shared = min(places[1], length) - max(places[0], 0.0)
    return float(shared / max(length, places[1] - places[0]))


def poses_above(solid, dimensions: dict[str, Dimension], case: Case) -> np.ndarray:
    """Return poses (n, 4, 4) that look straight down at dimensions, some of them beside the middle of the image."""
    middles = {edge.id: solid.vertices[list(edge.vertices)].mean(axis=0) for edge in solid.edges}
    middles |= {rim.id: np.asarray(rim.centre) for rim in solid.rims()}
    distance = case.camera.focus_distance_mm
    field = min(case.camera.sensor_size_mm) * distance / case.camera.focal_length_mm
    poses = []
    for dimension in dimensions.values():
        place = np.mean([middles[name] for name in dimension.entities], axis=0)
        for x, y in itertools.product(SHIFTS, SHIFTS):
            pose = np.diag([1.0, -1.0, -1.0, 1.0])
            pose[:3, 3] = place + np.array([x * field, y * field, distance])
            poses.append(pose)
    return np.array(poses)


# Light.


class LightTracer(Tracer):
    """Light on rays from a camera with a pose, under a light of a plan."""

    def __init__(self, mi, scene: Scene, light, pose):
        self._light = light
        self._pose = pose
        super().__init__(mi, scene)

    def emitters(self, scene: Scene) -> dict:
        """Return the light of the plan, and little light from the room."""
        room = {"type": "constant", "radiance": {"type": "rgb", "value": ROOM}}
        if self._light.kind == "backlight":
            return {"room": room, "panel": self._panel()}
        if self._light.kind == "diffuse-dome":
            return {"room": room, "dome": self._mesh("dome", *self._dome(), shines=True)}
        return {
            "room": room,
            "square": self._mesh("square", *self._square(), shines=True),
            "case": self._mesh("case", *self._case(), shines=False),
        }

    def rays(self, eye, directions):
        """Return rays that start where nothing of the light is in the way any more."""
        if self._light.kind != "coaxial":
            return super().rays(eye, directions)
        mi = self._mi
        share = (self._light.distance_mm - BEFORE_MM) / (directions @ self._pose[:3, 2])
        starts = eye + share[:, None] * directions
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return mi.RayDifferential3f(*(_columns(mi, values) for values in (starts, unit)))

    def _panel(self) -> dict:
        place = np.eye(4)
        place[:3, 0] = self._light.half_width
        place[:3, 1] = self._light.half_height
        place[:3, 2] = np.cross(place[:3, 0], place[:3, 1])
        place[:3, 2] /= np.linalg.norm(place[:3, 2])
        place[:3, 3] = np.array(self._light.centre) - BELOW_MM * place[:3, 2]
        transform = self._mi.ScalarTransform4f(place)
        emitter = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
        return {"type": "rectangle", "to_world": transform, "emitter": emitter}

    def _dome(self):
        """Return points (n, 3) and triangles of a half sphere without the hole at its top, seen from inside."""
        radius = self._light.diameter_mm / 2
        first = np.arcsin(self._light.hole_mm / 2 / radius)
        tilt = np.linspace(first, np.pi / 2, _STEPS[0])
        turn = np.linspace(0, 2 * np.pi, _STEPS[1])
        tilt, turn = np.meshgrid(tilt, turn, indexing="ij")
        local = [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)]
        places = radius * np.stack(local, axis=-1)
        places[..., 2] += self._light.distance_mm
        centre = self._pose[:3, 3] + self._light.distance_mm * self._pose[:3, 2]
        return self._in_world(_grid_mesh(places), lambda middles: centre - middles)

    def _square(self):
        """Return the square of coaxial light: as far behind the window as that is wide."""
        half = self._light.side_mm / 2
        x, y = np.meshgrid([-half, half], [-half, half], indexing="ij")
        z = np.full_like(x, self._light.distance_mm - self._light.side_mm)
        mesh = _grid_mesh(np.stack([x, y, z], axis=-1))
        return self._in_world(mesh, lambda middles: self._pose[:3, 2] + 0 * middles)

    def _case(self):
        """Return the plane around the window of coaxial light."""
        half = self._light.side_mm / 2
        edges = [-WIDE_MM, -half, half, WIDE_MM]
        x, y = np.meshgrid(edges, edges, indexing="ij")
        places = np.stack([x, y, np.full_like(x, self._light.distance_mm)], axis=-1)
        points, triangles = _grid_mesh(places)
        middle = np.abs(points[triangles].mean(axis=1)[:, :2]).max(axis=1) < half
        mesh = points, triangles[~middle]
        return self._in_world(mesh, lambda middles: self._pose[:3, 2] + 0 * middles)

    def _in_world(self, mesh, towards):
        """Return a mesh of the camera's frame in the world, its triangles turned to a side."""
        points, triangles = mesh
        points = points @ self._pose[:3, :3].T + self._pose[:3, 3]
        corners = points[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = (normals * towards(corners.mean(axis=1))).sum(axis=1) < 0
        triangles = triangles.copy()
        triangles[away] = triangles[away][:, ::-1]
        return points, triangles

    def _mesh(self, name: str, points, triangles, *, shines: bool):
        mi = self._mi
        properties = mi.Properties()
        black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
        properties["bsdf"] = mi.load_dict(black)
        if shines:
            radiance = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
            properties["emitter"] = mi.load_dict(radiance)
        mesh = mi.Mesh(name, len(points), len(triangles), props=properties)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = points.ravel().astype(np.float32)
        parameters["faces"] = triangles.ravel().astype(np.uint32)
        parameters.update()
        return mesh


def _columns(mi, values):
    return mi.Vector3f(*(np.ascontiguousarray(column, np.float32) for column in values.T))


def _grid_mesh(places):
    """Return points (n, 3) and triangles of a grid (a, b, 3)."""
    rows, columns = places.shape[:2]
    numbers = np.arange(rows * columns).reshape(rows, columns)
    corner = numbers[:-1, :-1].ravel()
    below = numbers[1:, :-1].ravel()
    across = numbers[1:, 1:].ravel()
    beside = numbers[:-1, 1:].ravel()
    first = np.stack([corner, below, across], axis=1)
    second = np.stack([corner, across, beside], axis=1)
    return places.reshape(-1, 3), np.concatenate([first, second])


# Plans and images.


class Bench:
    """Plans and images, kept in a folder."""

    def __init__(self, folder: Path, mi, samples: int, *, searches: bool, above: bool):
        self._folder = folder
        self._searches = searches or above
        self._is_above = above
        self._mi = mi
        self._samples = samples

    def model(self, name: str, case: Case, light: str, material: str) -> Model:
        """Return a part with its plan under a light."""
        metal = Material("metal", ROUGHNESS[material])
        path = self._folder / f"{name}_{light}_{material}.json"
        if not path.exists():
            lighting = Lighting(LIGHTS[light], material=metal)
            if self._searches:
                plan = self._planned(case, lamps=lighting)
            else:
                bare = self._folder / f"{name}.json"
                if not bare.exists():
                    self._planned(case).write(bare)
                plan = with_light(read_plan(bare), read_solid(case.path), lighting)
            plan.write(path)
        return Model(f"{name} {light}", path, case.path)

    def _planned(self, case: Case, **lamps):
        began = time.process_time()
        solid = read_solid(case.path)
        dimensions = dimensions_of(solid, case)
        if self._is_above:
            lamps["poses"] = poses_above(solid, dimensions, case)
        plan = plan_inspection(
            solid,
            dimensions,
            case.camera,
            case.uncertainty,
            registration=Registration.own_edges(case.surfaces_mm),
            surfaces_mm=case.surfaces_mm,
            effort=EFFORT,
            rng=1,
            **lamps,
        )
        seconds = time.process_time() - began
        print(f"{case.path.stem}: planned in {seconds:.0f} s", file=sys.stderr)
        return plan

    def images(self, model: Model, case: Case, material: str, seed: int) -> dict[str, np.ndarray]:
        """Draw a part and poses, and return its images by name."""
        rng = np.random.default_rng([seed, 0])
        planes = case.surfaces_mm
        model.part.deviate(rng, planes, CYLINDERS * planes, TILTS * planes)
        path = self._folder / "images" / f"{model.plan_path.stem}_{material}_{seed}.npz"
        if path.exists():
            return dict(np.load(path))
        path.parent.mkdir(exist_ok=True)
        plan = model.plan
        sigmas = plan.pose_uncertainty.sigmas
        poses = [displaced(np.asarray(one.cam2world), sigmas, rng) for one in plan.settings]
        images = {}
        for shot in model.shots:
            lit = plan.light.images[shot.setting]
            if not lit:
                continue
            pose = poses[shot.setting]
            part = model.part
            scene = Scene(
                part.vertices, part.triangles, material, np.empty((0, 3)), light_word(plan)
            )
            tracer = LightTracer(self._mi, scene, plan.light.area, pose)
            light, bright = light_of(tracer, pose, rng, self._samples, plan.camera)
            scale = _exposure(light, bright, lit[0].expose_for)
            images[shot.name] = taken(light, scale, "linear", 8, rng)
        np.savez(path, **images)
        return images


def light_word(plan) -> str:
    """Return what `Scene` calls the light of a plan."""
    return plan.light.area.kind


def _exposure(light, bright: float, expose_for) -> float:
    """Return the scale of light that a plan asks for; without a word on it, of the brightest places beside edges."""
    if expose_for is None:
        return (BRIGHT - DARK) / bright
    v, u = np.ogrid[: light.shape[0], : light.shape[1]]
    near = np.hypot(u - expose_for.pixel[0], v - expose_for.pixel[1]) <= expose_for.radius_px
    return (expose_for.share - DARK) / float(light[near].mean())


# Counts.


def show(readings: list[Planned]) -> None:
    """Print a line for each light and kind of edge, for each part, and the reasons of what was not read."""
    print(
        f"{'light':<10}{'edges':<9}{'part':<20}{'planned':>8}{'made':>6}{'share':>7}{'in 2u':>7}"
        f"{'bias':>8}{'rms':>7}{'u':>7}{'worst':>7}   µm; worst in u"
    )
    for light, kind in itertools.product(LIGHTS, KINDS):
        own = [one for one in readings if one.part.split()[1] == light]
        own = [one for one in own if one.name.split()[0] == kind]
        if not own:
            continue
        names = list(dict.fromkeys(one.part.split()[0] for one in own))
        _line(light, kind, "all", own)
        for name in names if len(names) > 1 else []:
            _line("", "", name, [one for one in own if one.part.split()[0] == name])
        reasons = Counter(kind_of(one.reason) for one in own if not one.is_made)
        for reason, n in reasons.most_common(8):
            print(f"    {n:3d}  {reason}")


def _line(light: str, kind: str, part: str, own: list[Planned]) -> None:
    made = [one for one in own if one.is_made]
    known = [one for one in made if np.isfinite(one.error)]
    text = f"{light:<10}{kind:<9}{part:<20}{len(own):>8}{len(made):>6}{len(made) / len(own):>7.2f}"
    if known:
        error = 1000 * np.array([one.error for one in known])
        u = 1000 * np.array([one.u for one in known])
        text += f"{np.mean(np.abs(error) <= 2 * u):>7.2f}{error.mean():>8.1f}"
        text += (
            f"{np.sqrt(np.mean(error**2)):>7.1f}{u.mean():>7.1f}{np.max(np.abs(error) / u):>7.2f}"
        )
    print(text)


def show_plan(model: Model) -> None:
    """Print what a plan shows, and why it leaves out the rest."""
    plan = model.plan
    shown = {name for images in plan.light.images for one in images for name in one.contrast}
    print(f"{model.name}: {len(shown)} of {len(plan.dimensions)} shown, {plan.light.area}")
    reasons = dict(plan.uninspectable)
    for unlit in plan.light.unlit:
        reasons |= {name: text for name, text in unlit.items() if name not in shown}
    for name, reason in reasons.items():
        print(f"    {name}: {reason}")


def parsed() -> argparse.ArgumentParser:
    """Return the parser of the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="keeps plans and images")
    parser.add_argument("--parts", type=Path, help="folder of the STEP files of NIST and MFCAD")
    parser.add_argument("--only", nargs="+", default=["plate"], help="names of parts")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS, help="of edges")
    parser.add_argument("--most", type=int, default=4, help="dimensions of each kind")
    parser.add_argument("--lights", nargs="+", default=list(LIGHTS), choices=list(LIGHTS))
    parser.add_argument("--materials", nargs="+", default=list(ROUGHNESS))
    parser.add_argument("--seeds", nargs="*", type=int, default=[1, 2], help="none: only plan")
    parser.add_argument("--search", action="store_true", help="search poses under the light")
    parser.add_argument("--above", action="store_true", help="choose among poses above the targets")
    parser.add_argument("--samples", type=int, default=32, help="a pixel, near edges")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--readings", action="store_true", help="print each reading")
    return parser


def main() -> int:
    """Plan, trace and measure; print the table."""
    options = parsed().parse_args()
    try:
        import drjit
        import mitsuba as mi
    except ImportError:
        print("mitsuba is not installed: pip install mitsuba", file=sys.stderr)
        return 2
    mi.set_variant(options.variant)
    drjit.set_thread_count(options.threads)
    bench = Bench(options.folder, mi, options.samples, searches=options.search, above=options.above)
    cases = cases_of(options.folder, options.parts)
    readings: list[Planned] = []
    for name, light, material in itertools.product(options.only, options.lights, options.materials):
        case = replace(cases[name], kinds=tuple(options.kinds), most_of_kind=options.most)
        model = bench.model(name, case, light, material)
        print(f"{material}:")
        show_plan(model)
        # what is left of gamma cannot be told from light that is uneven beside edges
        how = MeasureOptions(Registration.own_edges(case.surfaces_mm), response="linear")
        for seed in options.seeds:
            images = bench.images(model, case, material, seed)
            if not images:
                continue
            results = model.measurer.measure(images, how, partial=True)
            own = planned_readings(model, seed, results)
            readings += own
            print(f"{model.name} {material} {seed}: {time.process_time():.0f} s", file=sys.stderr)
            for one in own if options.readings else []:
                text = one.reason or f"{1000 * one.error:8.1f} ± {2000 * one.u:.1f} µm"
                print(f"  {model.name} {material} {seed} {one.setting + 1} {one.name:<12}{text}")
    show(readings)
    return 0


if __name__ == "__main__":
    sys.exit(main())
