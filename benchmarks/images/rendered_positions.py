"""Positions of holes in rendered images of plates that deviate: slope, ellipses, and decisions near the limit.

Each image shows a plate with eight holes. Each hole is off its place by about the limit of its zone, in any direction,
and larger or smaller. Half of them have the maximum material condition. All positions are measured against two edges.

Run with the number of images: ``python benchmarks/images/rendered_positions.py 30 --seed 1``. With ``--known``, the
measurement knows what holds for these images: the response is linear, and the detector has no error of its own
(``response`` and ``localisation`` of `planner.MeasureOptions`). With ``--own-edges`` the pose is not given. With
``--drawn``, too, the camera and the sides that are the datums are off as the plan states, which u counts with.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "planner" / "helpers"), str(ROOT / "benchmarks" / "images")]

import holed_plate as plates  # noqa: E402
import measured_plate as plate  # noqa: E402
from part_images import Optics, PartImages  # noqa: E402
from plan_examples import plan_with  # noqa: E402
from rendered_images import Lamp  # noqa: E402

from errors.measurands import Decision, Localisation  # noqa: E402
from planner import Dimension, Measurer, Registration, SensorSetting  # noqa: E402
from planner.identity import PartRecord  # noqa: E402
from planner.measuring.measure_options import MeasureOptions  # noqa: E402
from planner.measuring.registered import displaced  # noqa: E402
from planner.request.resolve import resolve_wanted  # noqa: E402

RADIUS_MM = 4.0
HOLES = {
    f"hole {k + 1}": ((x, y), RADIUS_MM)
    for k, (x, y) in enumerate((x, y) for y in (14.0, 36.0) for x in (14.0, 32.0, 50.0, 68.0))
}
LAMP = Lamp(np.array([-70.0, 260.0, 340.0]))
"""It lights no wall that the camera sees, so rims show all around."""
ZONE_MM = 0.4
SIZE_MM = (-0.1, 0.1)
"""Limits of the diameter."""
NEAR_MM = 0.06
"""True positions are at most so far inside and outside of their limits, evenly over the area."""
SURFACES_MM = 0.005
"""Standard deviation of the height of the top, as the plan states it."""
IN_ELLIPSE = 5.991
"""Quantile of a squared deviation of two components, 95 %."""


def datum_edges(solid):
    """Return the edges of the top along x and y."""
    middles = [[40.0, 0.0, plate.TOP], [0.0, 25.0, plate.TOP]]
    ends = [solid.edge_points(k).mean(axis=0) for k in range(len(solid.edges))]
    return [int(np.argmin(np.linalg.norm(ends - np.array(middle), axis=1))) for middle in middles]


def rim_at(solid, centre):
    """Return the id of the rim on the top about a centre."""
    places = {rim.id: rim.centre for rim in solid.rims() if abs(rim.centre[2] - plate.TOP) < 1e-6}
    return min(places, key=lambda name: math.dist(places[name][:2], centre))


def plan_of(solid):
    """Return a plan of one setting that measures all positions."""
    datums = datum_edges(solid)
    wanted = {}
    for k, (name, (centre, _)) in enumerate(HOLES.items()):
        condition = {"material": "M", "size": SIZE_MM} if k % 2 else {}
        wanted[name] = Dimension.position(
            rim_at(solid, centre), datums, ZONE_MM, share=0.5, **condition
        )
    _, targets = resolve_wanted(solid, wanted, 0.99)
    setting = SensorSetting(
        plate.POSES[0],
        tuple(wanted),
        dict.fromkeys(wanted, 0.95),
        {"focus_mm": 1.0},
        1.0,
        1,
        1,
        "by hand",
    )
    return plan_with(
        settings=[setting],
        lower_bound=1,
        uninspectable={},
        camera=plate.CAMERA,
        pose_uncertainty=plate.UNCERTAINTY,
        accuracy=0.99,
        workspace=np.array([[-500.0] * 3, [500.0] * 3]),
        localisation=Localisation.gaussian(0.1),
        surfaces_mm=SURFACES_MM,
        part=PartRecord("plate", PartRecord.of(solid).digest),
        targets=tuple(replace(one, name=name) for name, one in zip(wanted, targets, strict=True)),
    )


def drawn(rng):
    """Return how each hole is off: moves (8, 2), diameters (8) and half of each widened zone (8)."""
    larger = rng.uniform(*SIZE_MM, len(HOLES))
    bonus = np.where(np.arange(len(HOLES)) % 2, larger - SIZE_MM[0], 0.0)
    limit = 0.5 * (ZONE_MM + bonus)
    squares = rng.uniform((limit - NEAR_MM) ** 2, (limit + NEAR_MM) ** 2)
    turn = rng.uniform(0.0, 2.0 * math.pi, len(HOLES))
    moves = np.sqrt(squares)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return moves, larger, limit


def photograph(moves, larger, height, pose, seed, sides=(0.0, 0.0)):
    """Return the image of a plate that deviates, whose sides at x = 0 and y = 0 are moved."""
    holes = {
        name: (tuple(np.add(centre, move)), radius + 0.5 * more)
        for (name, (centre, radius)), move, more in zip(HOLES.items(), moves, larger, strict=True)
    }
    chords = plates.N
    plates.N = 240
    try:
        solid = plate.thick_plate(holes)
    finally:
        plates.N = chords
    vertices = solid.vertices.copy()
    vertices[vertices[:, 2] > 5, 2] += height
    for axis, side in enumerate(sides):
        vertices[vertices[:, axis] < 1, axis] += side
    optics = Optics(
        matrix=plate.CAMERA.matrix, size=plate.CAMERA.resolution, noise=0.005, samples=4
    )
    images = PartImages(vertices, solid.triangles, optics)
    return {1: images.image(pose, [LAMP], np.random.default_rng(seed))}


def main() -> None:
    """Render, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("images", type=int, nargs="?", default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--known", action="store_true")
    parser.add_argument("--own-edges", action="store_true")
    parser.add_argument("--drawn", action="store_true")
    parser.add_argument("--rows", type=Path, help="file of numbers that rows are added to")
    args = parser.parse_args()
    if args.drawn and not args.own_edges:
        parser.error("--drawn needs --own-edges")
    solid = plate.thick_plate(HOLES)
    plan = plan_of(solid)
    measurer = Measurer(plan, solid)
    pose = plate.POSES[0]
    given = Registration.given({1: pose}, np.diag([1e-8] * 3 + [1e-12] * 3))
    options = MeasureOptions(
        Registration.own_edges() if args.own_edges else given, edge_break_mm=(0.0, 0.0)
    )
    if args.known:
        options = replace(
            options, response="linear", localisation=Localisation.gaussian(0.1, floor_px=0.0)
        )
    rng = np.random.default_rng(args.seed)
    root = np.linalg.cholesky(plate.UNCERTAINTY.covariance)
    rows = []
    for number in range(args.images):
        moves, larger, limit = drawn(rng)
        height = SURFACES_MM * rng.standard_normal()
        sides = np.zeros(2)
        camera = pose
        if args.drawn:
            sides = SURFACES_MM * rng.standard_normal(2)
            camera = displaced(pose, root @ rng.standard_normal(6))[0]
        images = photograph(moves, larger, height, camera, 1000 * args.seed + number, sides)
        results = measurer.measure(images, options)
        # a position counts from the datums
        for name, move, more, radius in zip(HOLES, moves - sides, larger, limit, strict=True):
            rows.append(row_of(results[name], move, more, radius))
    table = np.array([row for row in rows if row])
    if args.rows is not None:
        if args.rows.exists():
            table = np.concatenate([np.loadtxt(args.rows), table])
        np.savetxt(args.rows, table)
    print(f"{len(table)} positions measured, of {len(rows)} in this run")
    summarise(table)


def row_of(result, move, more, limit):
    """Return the numbers of one position; empty if it was not measured."""
    reading = result.readings[0]
    if not reading.measured:
        return []
    off = np.array(reading.deviation_mm) - move
    covariance = np.array(reading.covariance_mm2)[:2, :2]
    squared = off @ np.linalg.solve(covariance, off)
    along = move / np.linalg.norm(move)
    u = math.sqrt(along @ covariance @ along)
    decision = list(Decision).index(result.decision)
    inside = float(np.linalg.norm(move) <= limit)
    return [*move, *reading.deviation_mm, squared, off @ along, u, inside, decision]


def summarise(table):
    """Print slope, ellipses and decisions."""
    moves = table[:, :2]
    measured = table[:, 2:4]
    slope, offset = np.polyfit(moves.ravel(), measured.ravel(), 1)
    squared = table[:, 4]
    print(f"slope of e {slope:.4f}, offset {1e3 * offset:+.2f} um")
    mean = 1e3 * (measured - moves).mean(axis=0)
    print(f"mean error of the distances to the two edges {mean[0]:+.2f}, {mean[1]:+.2f} um")
    print(f"rms of e {1e3 * np.sqrt(np.mean((measured - moves) ** 2)):.2f} um, each component")
    print(f"error / u, along e: {np.sqrt(np.mean((table[:, 5] / table[:, 6]) ** 2)):.3f}")
    print(f"in the 95 % ellipse {np.mean(squared <= IN_ELLIPSE):.3f}")
    wanted = {Decision.CONFORMS: 1.0, Decision.DOES_NOT_CONFORM: 0.0}
    counts = Counter()
    for inside, number in table[:, 7:9]:
        decision = list(Decision)[int(number)]
        if decision in wanted:
            counts[decision, wanted[decision] == inside] += 1
        else:
            counts[decision, True] += 1
    for decision in Decision:
        right = counts[decision, True]
        total = right + counts[decision, False]
        if decision in wanted and total:
            print(f"{decision.value}: {total}, {right / total:.3f} of them right")
        elif total:
            print(f"{decision.value}: {total}")


if __name__ == "__main__":
    main()
