"""The referee of `aspectgraph measure`: images of parts that deviate, from poses that deviate, against the truth.

For each part that is drawn (surfaces off by normal deviations, see `part_images`) and each setting of a plan an image
is rendered from a displaced pose, under the lamp, of 17 around the camera, under which the weakest points are
strongest. `planner.measure` reads all dimensions. A table tells by kind, and by how the poses were known, the bias of
the readings, their root mean square error, the mean stated u, the share of errors within 2 u, how many were measured,
and false finds: readings that are off by more than a pixel and 3 u. The last lines tell how deviations were
recovered, and the processor time of an image.

With ``--responses`` each image goes through responses of cameras to grey values of several depths, poses are from own
edges, and a table tells bias, root mean square, u and coverage by response.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from dimension_images import witnesses_of
from measured_rows import truth_of
from part_images import DeviatingPart, Optics, PartImages
from rendered_images import Lamp, Renderer, found_points
from scipy.spatial.transform import Rotation

from aspectgraph import read_solid
from planner import Localisation, MeasureOptions, Measurer, PoseUncertainty, Registration, read_plan

METHODS = ("planned", "own edges", "given")


@dataclass
class Row:
    """One reading: values are deviations from nominal, mm or degrees."""

    seed: int
    method: str
    name: str
    kind: str
    truth: float
    read: float
    u: float
    pixel: float
    reason: str


def tried_lamps(renderer: Renderer, pose, measured, rng) -> list[tuple[float, Lamp]]:
    """Return 17 lamps around the camera, the best first, each with the step that nine of ten points exceed."""
    places = [own for one in measured for own in one.points(8)]
    points, tangents = (np.concatenate(own) for own in zip(*places, strict=True))
    centre = points.mean(axis=0)
    away = np.linalg.norm(pose[:3, 3] - centre)
    found = []
    turns = [(0.0, 0.0)] + [(tilt, k * np.pi / 4) for tilt in (0.6, 1.1) for k in range(8)]
    for tilt, turn in turns:
        way = [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)]
        lamp = Lamp(centre + 1.3 * away * pose[:3, :3] @ way)
        step = np.quantile(found_points(renderer, pose, points, tangents, lamp, rng)[1], 0.1)
        found.append((float(step), lamp))
    return sorted(found, key=lambda one: -one[0])


def best_lamp(renderer: Renderer, pose, measured, rng) -> Lamp:
    """Return the lamp under which the tenth weakest point of all dimensions of a setting is strongest."""
    return tried_lamps(renderer, pose, measured, rng)[0][1]


def displaced(pose, sigmas, rng):
    """Return where the camera really is."""
    move = np.eye(4)
    draw = rng.normal(size=6) * sigmas
    move[:3, :3] = Rotation.from_rotvec(draw[3:]).as_matrix()
    move[:3, 3] = draw[:3]
    return pose @ move


def rows_of(options) -> list[Row]:
    """Measure all parts that are drawn."""
    plan = read_plan(options.plan)
    sigmas = plan.pose_uncertainty.sigmas * options.sigma
    plan = replace(plan, pose_uncertainty=PoseUncertainty(np.diag(sigmas**2)))
    part = DeviatingPart(options.part)
    measurer = Measurer(plan, read_solid(options.part))
    measured = witnesses_of(plan)
    matrix = plan.camera.matrix
    draw = np.random.default_rng(99)
    renderer = Renderer(part.vertices, part.triangles, matrix, samples=2)
    poses = [np.asarray(setting.cam2world) for setting in plan.settings]
    lamps = [
        best_lamp(renderer, pose, [one for (own, _), one in measured.items() if own == k], draw)
        for k, pose in enumerate(poses)
    ]
    optics = Optics.of(plan.camera, exposure=options.exposure, gloss=options.gloss)
    floor = None
    if options.floor is not None:
        floor = Localisation.gaussian(0.1, floor_px=options.floor)
    rows = []
    spent = dict.fromkeys(METHODS, 0.0)
    for seed in range(options.first, options.first + options.parts):
        rng = np.random.default_rng(seed)
        part.deviate(rng, options.planes, options.cylinders, options.planes / 2)
        images = PartImages(part.vertices, part.triangles, optics)
        real = [displaced(pose, sigmas, rng) for pose in poses]
        taken = {
            k + 1: images.image(pose, [lamp], rng)
            for k, (pose, lamp) in enumerate(zip(real, lamps, strict=True))
        }
        truth = {where: part.true_value(one) for where, one in measured.items()}
        exact = Registration.given(
            {k + 1: pose for k, pose in enumerate(real)}, np.diag([1e-8] * 3 + [1e-12] * 3)
        )
        for method, how in zip(
            METHODS, (Registration.none(), Registration.own_edges(), exact), strict=True
        ):
            began = time.process_time()
            results = measurer.measure(taken, MeasureOptions(how, floor))
            spent[method] += time.process_time() - began
            known = {one.name: truth_of(one, truth) for one in results}
            rows += [
                _row(plan, seed, method, one, known[one.name])
                for one in results
                if known[one.name] is not None
            ]
        print(f"part {seed}", end=" ", file=sys.stderr, flush=True)
    for method, seconds in spent.items():
        print(f"{method}: {seconds / options.parts / len(poses):.2f} s of processor time an image")
    return rows


def encoded(light, response: str) -> np.ndarray:
    """Return levels in [0, 1] of light by a response: "linear", "srgb", "video", or a gamma."""
    light = np.clip(light, 0.0, 1.0)
    if response == "linear":
        return light
    if response == "video":
        return (16 + 219 * light ** (1 / 2.2)) / 255
    if response == "srgb":
        # IEC 61966-2-1
        return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return light ** (1 / float(response))


def show_responses(options) -> None:
    """Measure parts in images of several responses and depths, and print a line for each of these."""
    plan = read_plan(options.plan)
    part = DeviatingPart(options.part)
    measurer = Measurer(plan, read_solid(options.part))
    measured = witnesses_of(plan)
    renderer = Renderer(part.vertices, part.triangles, plan.camera.matrix, samples=2)
    poses = [np.asarray(setting.cam2world) for setting in plan.settings]
    draw = np.random.default_rng(99)
    lamps = [
        best_lamp(renderer, pose, [own for (place, _), own in measured.items() if place == k], draw)
        for k, pose in enumerate(poses)
    ]
    optics = Optics.of(plan.camera, exposure=options.exposure, noise=0.004, every=2)
    cells = {(response, bits): [] for response in options.responses for bits in options.bits}
    for seed in range(options.first, options.first + options.parts):
        rng = np.random.default_rng(seed)
        part.deviate(rng, options.planes, options.cylinders, options.planes / 2)
        images = PartImages(part.vertices, part.triangles, optics)
        light = {
            k + 1: images.light(displaced(pose, plan.pose_uncertainty.sigmas, rng), [lamp], rng)
            for k, (pose, lamp) in enumerate(zip(poses, lamps, strict=True))
        }
        truth = {place: part.true_value(target) for place, target in measured.items()}
        for (response, bits), rows in cells.items():
            most = 2**bits - 1
            kind = np.uint8 if bits == 8 else np.uint16
            taken = {
                k: np.rint(encoded(image, response) * most).astype(kind)
                for k, image in light.items()
            }
            stated = {"response": response} if options.stated else {}
            how = MeasureOptions(Registration.own_edges(), white_level=most, **stated)
            results = measurer.measure(taken, how)
            for result in results:
                value = truth_of(result, truth)
                if value is not None:
                    rows.append(_row(plan, seed, "own edges", result, value))
            print(f"part {seed}, {response}, {bits} bits:", *results.notes, file=sys.stderr)
    print(
        f"{'response':<10}{'bits':>4}{'n':>5}{'read':>6}{'bias':>8}{'rms/u':>7}{'u':>7}{'in 2u':>7}   µm"
    )
    for (response, bits), rows in cells.items():
        good = [row for row in rows if not row.reason]
        error = 1000 * np.array([row.read - row.truth for row in good])
        u = 1000 * np.array([row.u for row in good])
        print(
            f"{response:<10}{bits:>4}{len(rows):>5}{len(good):>6}{error.mean():8.1f}"
            f"{np.sqrt(((error / u) ** 2).mean()):7.2f}{u.mean():7.1f}"
            f"{np.mean(np.abs(error) <= 2 * u):7.3f}"
        )


def _row(plan, seed, method, result, truth) -> Row:
    target = plan.dimensions[result.name]
    pixel = np.nan
    if result.readings and target.unit == "mm":
        pose = plan.settings[result.readings[0].setting].cam2world
        pixel = target.permitted_error / target.permitted_error_px(pose, plan.camera)
    return Row(
        seed,
        method,
        result.name,
        result.kind,
        truth,
        result.deviation,
        result.standard_uncertainty,
        pixel,
        result.reason,
    )


def show(rows: list[Row]) -> None:
    """Print the table."""
    print(
        f"{'poses':<11}{'kind':<17}{'n':>5}{'read':>6}{'bias':>8}{'rms':>8}{'u':>8}"
        f"{'in 2u':>7}{'false':>6}   µm, mdeg"
    )
    for method in METHODS:
        for kind in dict.fromkeys(row.kind for row in rows):
            own = [row for row in rows if row.method == method and row.kind == kind]
            good = [row for row in own if not row.reason]
            if not good:
                print(f"{method:<11}{kind:<17}{len(own):>5}{0:>6}")
                continue
            error = np.array([row.read - row.truth for row in good]) * 1000
            u = np.array([row.u for row in good]) * 1000
            pixel = np.array([row.pixel for row in good]) * 1000
            wrong = int(np.sum((np.abs(error) > pixel) & (np.abs(error) > 3 * u)))
            print(
                f"{method:<11}{kind:<17}{len(own):>5}{len(good):>6}{error.mean():8.1f}"
                f"{np.sqrt((error**2).mean()):8.1f}{u.mean():8.1f}"
                f"{np.mean(np.abs(error) <= 2 * u):7.3f}{wrong:>6}"
            )
        good = [row for row in rows if row.method == method and not row.reason]
        sized = [row for row in good if row.kind == "diameter" and row.truth != 0]
        if len(sized) > 2:
            truth = np.array([row.truth for row in sized])
            read = np.array([row.read for row in sized])
            slope, offset = np.polyfit(truth, read, 1)
            print(
                f"{method}: deviations of diameters {truth.min() * 1000:.0f} to "
                f"{truth.max() * 1000:.0f} µm read with slope {slope:.3f}, "
                f"offset {offset * 1000:.1f} µm"
            )


def main() -> int:
    """Measure, print the table, write the readings."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plan", type=Path)
    parser.add_argument("part", type=Path)
    parser.add_argument("--parts", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--sigma", type=float, default=1.0, help="times the plan's, also stated")
    parser.add_argument("--planes", type=float, default=0.02, help="deviations, mm")
    parser.add_argument("--cylinders", type=float, default=0.03, help="deviations, mm")
    parser.add_argument("--exposure", type=float, default=1.0)
    parser.add_argument("--gloss", type=float, default=0.0)
    parser.add_argument("--floor", type=float, help="of the localisation, px")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--responses", nargs="+", help="linear, srgb, video, or a gamma")
    parser.add_argument("--bits", nargs="+", type=int, default=[8])
    parser.add_argument("--stated", action="store_true", help="the responses, when measuring")
    options = parser.parse_args()
    if options.responses:
        show_responses(options)
        return 0
    rows = rows_of(options)
    show(rows)
    if options.csv:
        with options.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(asdict(rows[0])))
            writer.writeheader()
            writer.writerows(map(asdict, rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
