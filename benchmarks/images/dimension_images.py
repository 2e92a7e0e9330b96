"""Promised against measured: dimensions of real parts in rendered images from displaced poses.

For each dimension a viewpoint from which its entities are observable, and the lamp, of several, under which the step of
grey values across them is largest. From displaced poses patches of the image are rendered (`rendered_images`), points
are found in them, carried back with the planned pose and fitted. How often the error is permitted, is compared with
what `errors.measurands` promises, for each model of localisation:

rounding    found points on whole pixels
gaussian    found points as they are, 0.1 px promised, and 0.05 px that all points of an entity share
fit         the same points; promised is what the length of the image gives

"exact" is the same fit without an image: points projected from the same poses, with the errors that the model states.
Where it agrees with the promise and the image does not, it is the image that differs, not the arithmetic. The geometry
that is rendered is read and triangulated here.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from rendered_images import Lamp, Measured, Renderer, carried_back, found_points
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from aspectgraph import compute_regions, read_dimensions, read_solid
from errors.measurands import Localisation, MeasurandModel, MeasuredCircle
from planner import Camera, PoseUncertainty, look_at
from planner.request.dimension import Dimension
from planner.request.resolve import resolve_wanted
from planner.request.targets import PlannedDimension, targets_of

POINTS = 16
WEAK = 5.0  # grey levels
MODELS = {
    "rounding": Localisation.rounding(),
    "gaussian": Localisation.gaussian(0.1, floor_px=0.05),
    "fit": Localisation.fit(),
}
TRANSLATION = 0.05
ROTATION = 0.0007
TARGETS = (0.6, 0.75, 0.85, 0.92, 0.97)
CTC_01 = (
    "distance 1", "distance 2", "Angular Size.1", "Linear Size.1", "Linear Size.3", "Linear Size.7", "Linear Size.9",
)  # fmt: skip
D2MI = (
    "Perpendicular Dimension (205)", "Perpendicular Dimension (174)", "Perpendicular Dimension (227)",
    "Perpendicular Dimension (184)", "Diameter Dimension (68)", "Hole Dimension (192)", "Hole Dimension (193)",
    "Diameter Dimension (130)",
)  # fmt: skip


@dataclass
class Setting:
    """One dimension from one pose (4, 4), cam to world, under one lamp."""

    part: str
    name: str
    planned: PlannedDimension
    measured: Measured
    pose: np.ndarray
    lamp: Lamp
    camera: Camera


@dataclass
class Outcome:
    """Errors, mm or degrees, by model (n,): in images, and of exact points; and what was found in the images."""

    image: dict = field(default_factory=lambda: {name: [] for name in MODELS})
    exact: dict = field(default_factory=lambda: {name: [] for name in MODELS})
    weak: list = field(default_factory=list)
    off: list = field(default_factory=list)  # px across the edge


def triangles_of(path: Path, chord_mm: float = 0.005, turn_rad: float = 0.02):
    """Return vertices (v, 3), mm, and triangles (t, 3) of the solids of a STEP file; no point is shared."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    reader = STEPControl_Reader()
    with tempfile.TemporaryDirectory() as folder:
        plain = path
        if path.suffix == ".gz":
            plain = Path(folder) / path.stem
            plain.write_bytes(gzip.decompress(path.read_bytes()))
        reader.ReadFile(str(plain))
        reader.TransferRoots()
    solids = TopExp_Explorer(reader.OneShape(), TopAbs_ShapeEnum.TopAbs_SOLID)
    vertices = []
    triangles = []
    count = 0
    while solids.More():
        BRepMesh_IncrementalMesh(solids.Current(), chord_mm, False, turn_rad, False)
        faces = TopExp_Explorer(solids.Current(), TopAbs_ShapeEnum.TopAbs_FACE)
        while faces.More():
            place = TopLoc_Location()
            mesh = BRep_Tool.Triangulation_s(TopoDS.Face(faces.Current()), place)
            move = place.Transformation()
            nodes = [mesh.Node(i + 1).Transformed(move) for i in range(mesh.NbNodes())]
            vertices.append([(node.X(), node.Y(), node.Z()) for node in nodes])
            corners = [mesh.Triangle(i + 1) for i in range(mesh.NbTriangles())]
            triangles.append(
                np.array([[t.Value(k) for k in (1, 2, 3)] for t in corners]) - 1 + count
            )
            count += len(nodes)
            faces.Next()
        solids.Next()
    return np.concatenate(vertices), np.concatenate(triangles)


def as_measured(planned: PlannedDimension) -> Measured:
    """Return a dimension as the images are measured, in plain numbers."""
    circles = [one for one in planned.geometry if isinstance(one, MeasuredCircle)]
    lines = [(one.p, one.q) for one in planned.geometry if not isinstance(one, MeasuredCircle)]
    arcs = [None if one.is_closed else (one.start, one.span_rad) for one in circles]
    way = None if planned.direction is None else np.array(planned.direction)
    return Measured(
        planned.kind, lines, [(one.centre, one.axis, one.radius_mm) for one in circles], arcs, way
    )


def witnesses_of(plan) -> dict[tuple[int, str], Measured]:
    """Return what each setting measures for each dimension, by their numbers and names.

    Of a part of an edge the mesh has no vertices, so its true value is not known.
    """
    found = {}
    for number, setting in enumerate(plan.settings):
        targets = targets_of(plan.targets, setting)
        for name in setting.entities:
            one = targets[name]
            if name in plan.dimensions and not any("[" in entity for entity in one.entities):
                found[number, name] = as_measured(one)
    return found


def view(
    regions, planned: PlannedDimension, measured: Measured, camera: Camera, rng
) -> np.ndarray | None:
    """Return a pose that sees all entities as wholes, some 20 degrees off the normal of their plane if there is one."""
    points = np.concatenate([own for own, _ in measured.points(POINTS)])
    centre = points.mean(axis=0)
    normal = measured.planes()[0][1]
    reach = np.linalg.norm(points - centre, axis=1).max()
    distance = max(
        150.0, 1.25 * reach * camera.image_distance_mm / (min(camera.sensor_size_mm) / 2)
    )
    ways = rng.normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    seen = regions.observable(centre + distance * ways, planned.entities).all(axis=1)
    if not seen.any():
        return None
    slant = np.degrees(np.arccos(np.minimum(np.abs(ways @ normal), 1)))
    order = np.argsort(np.where(seen, np.abs(slant - 20), np.inf))
    return look_at(centre + distance * ways[order[:1]], centre)[0]


def best_lamp(renderer: Renderer, pose: np.ndarray, measured: Measured, rng) -> Lamp:
    """Return the lamp, of 17 around the camera, under which the tenth weakest of a hundred points is strongest."""
    points, tangents = (np.concatenate(own) for own in zip(*measured.points(POINTS), strict=True))
    centre = points.mean(axis=0)
    best = (-1.0, None)
    away = np.linalg.norm(pose[:3, 3] - centre)
    turns = [(0.0, 0.0)] + [(tilt, k * np.pi / 4) for tilt in (0.6, 1.1) for k in range(8)]
    for tilt, turn in turns:
        way = [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)]
        lamp = Lamp(centre + 1.3 * away * pose[:3, :3] @ way)
        step = np.quantile(found_points(renderer, pose, points, tangents, lamp, rng)[1], 0.1)
        best = max(best, (step, lamp), key=lambda pair: pair[0])
    return best[1]


def permitted_for(planned: PlannedDimension, pose, camera, covariance, target: float) -> float:
    """Return the permitted error that is promised to be met with a probability, under gaussian errors."""
    low = 0.0
    high = 0.5 * planned.nominal
    for _ in range(40):
        middle = (low + high) / 2
        enough = promised(planned, pose, camera, covariance, MODELS["gaussian"], middle) >= target
        low, high = (low, middle) if enough else (middle, high)
    return high


def promised(planned, pose, camera, covariance, localisation, permitted) -> float:
    """Return the probability that is promised."""
    model = MeasurandModel(
        planned.measurand, image_distance_mm=camera.image_distance_mm, pixel_pitch_mm=camera.pixel_pitch_mm,
        pose_covariance=covariance, localisation=localisation, permitted_error=permitted,
    )  # fmt: skip
    return float(model.probability(np.linalg.inv(pose)[None])[0])


def displaced(pose: np.ndarray, rng) -> np.ndarray:
    """Return where the camera really is."""
    move = np.eye(4)
    move[:3, :3] = Rotation.from_rotvec(rng.normal(0, ROTATION, 3)).as_matrix()
    move[:3, 3] = rng.normal(0, TRANSLATION, 3)
    return pose @ move


def measure(setting: Setting, renderer: Renderer, n: int, seed: int) -> Outcome:
    """Measure a dimension in n images."""
    rng = np.random.default_rng(seed)
    outcome = Outcome()
    one = setting.measured
    entities = one.points(POINTS)
    planes = one.planes()
    sigmas = _sigmas(setting, renderer)
    for _ in range(n):
        real = displaced(setting.pose, rng)
        found = []
        exact = []
        strong = []
        off = []
        for points, tangents in entities:
            pixels, step = found_points(renderer, real, points, tangents, setting.lamp, rng)
            found.append(pixels)
            exact.append(renderer.projected(points, real))
            strong.append(step >= WEAK)
            along = renderer.projected(points + 1e-3 * tangents, real) - exact[-1]
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            off.append(
                np.abs(
                    along[:, 0] * (pixels - exact[-1])[:, 1]
                    - along[:, 1] * (pixels - exact[-1])[:, 0]
                )
            )
        outcome.weak.append(1 - np.mean(strong))
        outcome.off.append(off)
        enough = min(map(np.count_nonzero, strong)) >= POINTS // 2
        for name, widths in sigmas.items():
            whole = name == "rounding"
            seen = [np.rint(own) if whole else own for own in found]
            noisy = [
                np.rint(own) if whole else own + rng.normal(0, width, own.shape)
                for own, width in zip(exact, widths, strict=True)
            ]
            outcome.image[name].append(_error(setting, planes, seen, strong) if enough else np.inf)
            outcome.exact[name].append(_error(setting, planes, noisy, None))
    return outcome


def _sigmas(setting: Setting, renderer: Renderer) -> dict[str, list[float]]:
    """Return by model the error of each of our points, px, that an entity's points together state."""
    lengths = [
        np.linalg.norm(np.diff(renderer.projected(points, setting.pose), axis=0), axis=1).mean()
        * POINTS
        for points, _ in setting.measured.points(POINTS)
    ]
    how = MODELS["fit"]
    together = [
        max(how.sigma_px / np.sqrt(length / how.correlation_px), how.floor_px) for length in lengths
    ]
    return {
        "rounding": [0.0] * len(lengths),
        "gaussian": [MODELS["gaussian"].sigma_px] * len(lengths),
        "fit": [value * np.sqrt(POINTS) for value in together],
    }


def _error(setting: Setting, planes, pixels, strong) -> float:
    """Return the error of one measurement; points without contrast are left out."""
    kept = pixels if strong is None else [own[use] for own, use in zip(pixels, strong, strict=True)]
    matrix = setting.camera.matrix
    back = [
        carried_back(own, matrix, setting.pose, plane)
        for own, plane in zip(kept, planes, strict=True)
    ]
    return setting.measured.value(back) - setting.planned.nominal


@cache
def part(path: str, names: tuple[str, ...]):
    """Return a part's dimensions as planned, by name, the regions of their entities, and its triangles."""
    solid = read_solid(path)
    wanted = {
        one.name: Dimension(
            one.kind,
            one.entities,
            accuracy=0.999,
            direction=one.direction if one.kind == "distance" else None,
        )
        for one in read_dimensions(path, solid)
        if one.name in names and one.entities is not None
    }
    entities, targets = resolve_wanted(solid, wanted, 0.999)
    planned = {target.name: PlannedDimension.of(target, MODELS["gaussian"]) for target in targets}
    return (
        planned,
        compute_regions(solid, entities),
        triangles_of(Path(path), turn_rad=0.02 if "ctc" in path else 0.04),
    )


def row(path: str, names: tuple[str, ...], name: str, n: int, seed: int) -> list[dict]:
    """Return a line of the table for each model of one dimension."""
    began = time.time()
    rng = np.random.default_rng(seed)
    camera = Camera.named("basler-acA2440-20gm-8mm")
    covariance = PoseUncertainty.isotropic(
        translation_mm=TRANSLATION, rotation_rad=ROTATION
    ).covariance
    dimensions, regions, (vertices, triangles) = part(path, names)
    planned = dimensions[name]
    measured = as_measured(planned)
    renderer = Renderer(vertices, triangles, camera.matrix)
    pose = view(regions, planned, measured, camera, rng)
    if pose is None:
        print(f"{name}: seen as a whole from none of the viewpoints tried", flush=True)
        return []
    lamp = best_lamp(renderer, pose, measured, rng)
    target = TARGETS[names.index(name) % len(TARGETS)]
    permitted = permitted_for(planned, pose, camera, covariance, target)
    outcome = measure(
        Setting(Path(path).stem, name, planned, measured, pose, lamp, camera), renderer, n, seed + 1
    )
    off = np.array(outcome.off)
    rows = []
    for model, how in MODELS.items():
        error = np.array(outcome.image[model])
        exact = np.array(outcome.exact[model])
        met = int((np.abs(error) <= permitted).sum())
        interval = binomtest(met, n).proportion_ci(0.95)
        promise = promised(planned, pose, camera, covariance, how, permitted)
        sound = np.isfinite(error)
        rows.append(
            {
                "part": Path(path).name.split(".")[0], "dimension": name, "kind": planned.kind,
                "nominal": planned.nominal, "permitted": permitted, "model": model, "promised": promise,
                "measured": met / n, "low": interval.low, "high": interval.high,
                "exact": float((np.abs(exact) <= permitted).mean()),
                "bias": float(error[sound].mean()) if sound.any() else np.nan,
                "sd": float(error[sound].std()) if sound.any() else np.nan,
                "sd_exact": float(exact.std()), "point_px": float(np.sqrt(np.median((off**2).mean(axis=(1, 2))))),
                "astray": float((off > 1).mean()), "weak": float(np.mean(outcome.weak)), "refused": int((~sound).sum()),
                "seconds": time.time() - began,
            }
        )  # fmt: skip
    return rows


def show(rows: list[dict]) -> None:
    """Print a line per model; a star where the promise lies outside the interval."""
    for r in rows:
        inside = r["low"] <= r["promised"] <= r["high"]
        print(
            f"{r['part'][:14]:<15}{r['dimension'][:30]:<31}{r['kind']:<15}{r['nominal']:9.3f}{r['permitted']:9.4f} "
            f"{r['model']:<9}{r['promised']:6.3f}{r['measured']:7.3f} [{r['low']:.3f}, {r['high']:.3f}]"
            f"{' ' if inside else '*'}{r['exact']:7.3f}  bias {r['bias']:+.4f} sd {r['sd']:.4f}/{r['sd_exact']:.4f} "
            f"point {r['point_px']:.3f} px, astray {100 * r['astray']:.1f} %, weak {100 * r['weak']:.1f} %, "
            f"refused {r['refused']}, {r['seconds']:.0f} s",
            flush=True,
        )


def main():
    """Measure the dimensions of both parts and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("ctc_01")
    parser.add_argument("d2mi")
    parser.add_argument("-n", type=int, default=300, help="displaced poses for each dimension")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args()
    jobs = [(chosen.ctc_01, CTC_01, name) for name in CTC_01] + [
        (chosen.d2mi, D2MI, name) for name in D2MI
    ]
    rows = []
    with ProcessPoolExecutor(chosen.processes) as pool:
        waiting = [
            pool.submit(row, path, names, name, chosen.n, 100 * k)
            for k, (path, names, name) in enumerate(jobs)
        ]
        for job in waiting:
            rows += job.result()
            show(rows[-len(MODELS) :])
    if chosen.csv and rows:
        with open(chosen.csv, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
