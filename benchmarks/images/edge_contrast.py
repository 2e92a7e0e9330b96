"""Contrast of edges in rendered images against the formula that light domains rest on.

    python benchmarks/images/edge_contrast.py [--triples 100] [--seed 0] [--csv FILE] [PART ...]
    python benchmarks/images/edge_contrast.py --plan plan.json PART

Triples are drawn: an edge, a lamp from which it is lit as a whole, and a camera that sees both faces next to it.
Patches of the image at points along the edge are rendered (`rendered_images`, which shares no code with `aspectgraph`:
matt faces, cast shadows, blur, noise), and the grey values are averaged on either side, 3 to 4.5 pixels from the edge.
Their contrast, above the light from everywhere, is compared with `aspectgraph.contrast`. Left out are points beside
which something else is seen: that is a matter of separation, not of light.

Without noise the two differ by what the formula leaves out: the place beside the edge is under another angle to the
lamp than the edge itself. This is computed from the places that the pixels show, and told apart (``beside``).

With a plan of edges, the grey steps along its edges are told: under the lamps of the plan, or lamps planned here in a
box around the part, and under a lamp at the camera. A pair is weak if a quarter of the places along it have under five
levels.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from rendered_images import PATCH, Lamp, Renderer

from aspectgraph import Solid, compute_regions, contrast, read_solid
from aspectgraph.solid.solid import RayScene
from planner import LampBox, look_at, read_plan
from planner.light.lighting import Lighting
from planner.light.plan_light import chosen_lamps

EXAMPLES = Path(__file__).parents[2] / "examples"
PARTS = ("nist_ctc_01_ap242.stp", "nist_ctc_03_ap242.stp.gz", "mfcad_4-5-5-6-9-23.step")
LEVELS = 255
NOISE = 0.01
AMBIENT = 0.12
BRIGHTEST = 0.9
BESIDE_PX = (3.0, 4.5)
POINTS = 7
# what is so far from the edge must be on the face as well: blur carries it over
CLEAR_PX = 7.5
FOCAL_PX = 4000.0
MATRIX = np.array([[FOCAL_PX, 0.0, 1000.0], [0.0, FOCAL_PX, 1000.0], [0.0, 0.0, 1.0]])
# least cosine under which both faces are seen, so that what lies beside the edge is not squeezed
FACING = 0.25


@dataclass
class Triple:
    """What the formula says of an edge under a lamp, and what an image shows; grey values of 255, standard errors."""

    part: str
    edge: int
    predicted: float
    beside: float
    measured: float
    error: float
    grey: float
    points: int


def triples(
    solid: Solid, n: int, seed: int = 0, n_edges: int = 40, wrong_lamp: bool = False
) -> list[Triple]:
    """Draw, render and measure n triples of some edges; with ``wrong_lamp`` the formula is told of another lamp."""
    rng = np.random.default_rng(seed)
    found = []
    scene = RayScene(solid.vertices, solid.triangles)
    renderer = Renderer(solid.vertices, solid.triangles, MATRIX)
    renderer.noise = NOISE
    edges = [edge for edge in solid.straight_edges() if solid.edge_length_mm(edge.id) > 3]
    edges = [edges[i] for i in np.sort(rng.permutation(len(edges))[:n_edges])]
    regions = compute_regions(solid, {f"e{edge.id}": edge for edge in edges})
    tries = 0
    while len(found) < n:
        tries += 1
        if tries > 400 * n:
            raise RuntimeError(
                f"triples must be found in {400 * n} draws. Got {len(found)} of {n}."
            )
        edge = edges[rng.integers(len(edges))]
        places = _places(rng, solid, regions, edge)
        if places is None:
            continue
        one = _measured(solid, scene, renderer, edge, places, rng)
        if one is None:
            continue
        if wrong_lamp:
            other = None
            while other is None:
                other = _places(rng, solid, regions, edge)
            one.predicted = one.beside = _formula(solid, edge, other[1])
        found.append(one)
    return found


def _formula(solid, edge, lamp):
    return float(contrast(solid, edge.id, [lamp])[0])


def _places(rng, solid, regions, edge):
    """Draw a camera that sees both faces well, and a lamp; None if they do not see the whole edge."""
    ends = solid.edge_points(edge.id)
    middle = ends.mean(axis=0)
    length = np.linalg.norm(ends[1] - ends[0])
    size = float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    ways = rng.normal(size=(2, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    # so far that the edge is about 200 px long
    eye, lamp = middle + ways * np.array([[FOCAL_PX * length / 200], [size * rng.uniform(1, 4)]])
    if (solid.normals[list(edge.faces)] @ ways[0]).min() < FACING:
        return None
    low, high = regions.workspace
    if not (((eye > low) & (eye < high)).all() and ((lamp > low) & (lamp < high)).all()):
        return None
    return (eye, lamp) if regions.observable([eye, lamp], [f"e{edge.id}"]).all() else None


def _measured(solid, scene, renderer, edge, places, rng) -> Triple | None:
    """Render an edge and measure the contrast beside it; None if something else is seen beside all its points."""
    (eye, lamp) = places
    ends = solid.edge_points(edge.id)
    points = ends[0] + np.linspace(0.2, 0.8, POINTS)[:, None] * (ends[1] - ends[0])
    pose = look_at([eye], ends.mean(axis=0), roll=rng.uniform(-np.pi, np.pi))[0]
    image = renderer.projected(np.vstack([points, ends]), pose)
    corners = np.rint(image[:POINTS]).astype(int) - PATCH
    along = image[-1] - image[-2]
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    grid = np.stack(np.meshgrid(*[np.arange(2 * PATCH + 1)] * 2), axis=-1) + corners[:, None, None]
    off = (grid - image[:POINTS, None, None]) @ across
    first = _first_side(
        solid, edge, renderer, pose, points[POINTS // 2], image[POINTS // 2], across
    )
    sides = [
        (sign * off >= BESIDE_PX[0]) & (sign * off <= BESIDE_PX[1]) for sign in (first, -first)
    ]
    seen = _seen(scene, pose, grid)
    faces = solid.normals[list(edge.faces)]
    good = np.ones(POINTS, bool)
    for side, normal in zip(sides, faces, strict=True):
        near = (off * np.sign(off[side][0]) > 0) & (np.abs(off) <= CLEAR_PX)
        on = (seen[1] @ normal > 1 - 1e-6) & (np.abs((seen[0] - points[0]) @ normal) < 1e-3)
        clear = _reached(scene, seen[0], lamp) | (
            np.einsum("...i,i->...", lamp - seen[0], normal) <= 0
        )
        good &= ((on & clear) | ~near | (np.abs(off) < 1)).all(axis=(1, 2))
    if good.sum() < 3:
        return None
    patches = renderer.patches(pose, corners[good], Lamp(lamp, AMBIENT), rng)
    greys = []
    ideal = []
    counts = []
    for side, normal in zip(sides, faces, strict=True):
        chosen = side[good]
        towards = lamp - seen[0][good][chosen]
        ideal.append(np.maximum(towards @ normal, 0) / np.linalg.norm(towards, axis=1))
        greys.append(float(patches[chosen].mean()) - AMBIENT)
        counts.append(int(chosen.sum()))
    ideal = [float(one.mean()) for one in ideal]
    total = (BRIGHTEST - AMBIENT) * sum(ideal)
    # of both means, by noise and rounding to whole levels; the derivatives of the contrast
    sigma = (
        np.sqrt(NOISE**2 + 1 / 12 / LEVELS**2)
        / np.sqrt(counts)
        * (BRIGHTEST - AMBIENT)
        * np.array(ideal[::-1])
    )
    if total * LEVELS < 10:
        return None
    return Triple(
        solid.name,
        edge.id,
        _formula(solid, edge, lamp),
        (ideal[0] - ideal[1]) / sum(ideal),
        (greys[0] - greys[1]) / sum(greys),
        float(2 * np.linalg.norm(sigma) / total**2),
        LEVELS * total / 2,
        int(good.sum()),
    )


def _first_side(solid, edge, renderer, pose, point, pixel, across) -> int:
    """Return on which side of the edge's image, +1 or -1, its first face lies."""
    start, end = solid.edge_points(edge.id)
    one, other = solid.normals[list(edge.faces)]
    inward = np.cross(one, end - start)
    # into the face: behind the other one at a convex edge, before it at a reentrant one
    inward *= -np.sign(inward @ other) * np.sign(edge.dihedral_deg)
    step = inward / np.linalg.norm(inward) * 1e-2 * np.linalg.norm(end - start)
    return int(np.sign((renderer.projected((point + step)[None], pose)[0] - pixel) @ across))


def _seen(scene, pose, grid):
    """Return the places and normals that pixels (..., 2) show."""
    rays = (
        np.concatenate([grid, np.ones((*grid.shape[:-1], 1))], axis=-1)
        @ np.linalg.inv(MATRIX).T
        @ pose[:3, :3].T
    )
    hit = scene.cast(pose[:3, 3], rays)
    depth = np.where(np.isfinite(hit["t_hit"]), hit["t_hit"], 0.0)
    return pose[:3, 3] + depth[..., None] * rays, hit["primitive_normals"].astype(float)


def _reached(scene, places, lamp):
    """Return which places a lamp reaches, past all other faces."""
    return scene.cast(lamp, places - lamp)["t_hit"] > 1 - 1e-4


def steps_under(solid: Solid, plan, lamp_of, n: int = 9) -> dict[tuple[int, str], np.ndarray]:
    """Return grey steps (n,), of 255, along each straight edge of a plan's settings; ``lamp_of(setting, name)`` (3,).

    Noise is left out; the light from everywhere stays. Steps are told 2 to 4 px beside the edge.
    """
    middle = np.mean(solid.bounds, axis=0)
    matrix = np.vstack([plan.camera.matrix[:2], [0.0, 0, 1]])
    # about the middle: rays are float32
    renderer = Renderer(solid.vertices - middle, solid.triangles, matrix, noise=0.0)
    found = {}
    for k, setting in enumerate(plan.settings):
        pose = np.array(setting.cam2world)
        pose[:3, 3] -= middle
        for name in setting.entities:
            lamp = lamp_of(k, name)
            if lamp is None:
                continue
            ends = plan.entities[name] - middle
            points = ends[0] + np.linspace(0.08, 0.92, n)[:, None] * (ends[1] - ends[0])
            image = renderer.projected(np.vstack([points, ends]), pose)
            along = image[-1] - image[-2]
            across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
            corners = np.rint(image[:n]).astype(int) - PATCH
            grid = (
                np.stack(np.meshgrid(*[np.arange(2 * PATCH + 1)] * 2), axis=-1)
                + corners[:, None, None]
            )
            off = (grid - image[:n, None, None]) @ across
            patches = renderer.patches(
                pose, corners, Lamp(lamp - middle, AMBIENT), np.random.default_rng(0)
            )
            sides = [
                np.array(
                    [
                        patches[i][(sign * off[i] >= 2) & (sign * off[i] <= 4)].mean()
                        for i in range(n)
                    ]
                )
                for sign in (1, -1)
            ]
            found[k, name] = LEVELS * np.abs(sides[0] - sides[1])
    return found


def print_table(rows: list[Triple]) -> None:
    """Print per part how far the image is from the formula."""
    print(
        f"{'part':24} triples  |C| < .1  max |diff|  rms diff  rms z  |z| > 3  sign wrong  > 10⁻³ beside"
    )
    for part in dict.fromkeys(row.part for row in rows):
        own = [row for row in rows if row.part == part]
        predicted, beside, measured, error = (
            np.array([getattr(row, name) for row in own])
            for name in ("predicted", "beside", "measured", "error")
        )
        diff = measured - predicted
        z = (measured - beside) / error
        wrong = (np.sign(measured) != np.sign(predicted)) & (np.abs(beside) > 3 * error)
        print(
            f"{part:24} {len(own):7} {(np.abs(predicted) < 0.1).sum():9} {np.abs(diff).max():11.4f} "
            f"{np.sqrt((diff**2).mean()):9.4f} {np.sqrt((z**2).mean()):6.2f} {(np.abs(z) > 3).sum():8} "
            f"{wrong.sum():11} {(np.abs(beside - predicted) > 1e-3).sum():14}"
        )


def weak(steps: dict[tuple[int, str], np.ndarray]) -> list[tuple[int, str]]:
    """Return the pairs of which a quarter has less than five grey levels."""
    return [pair for pair, own in steps.items() if np.mean(own < 5) > 0.25]


def print_plan(solid: Solid, plan) -> None:
    """Print which pairs of a plan are weak under its lamps, and under a lamp at the camera."""
    low, high = solid.bounds
    room = float(np.linalg.norm(high - low))
    light = plan.light
    if light is None:
        box = LampBox(tuple(low - room), tuple(high + room))
        # by contrast alone, whatever `measure` would find
        light = chosen_lamps(Lighting(box), plan, solid)
    print(light)
    lamps = lamps_of(light)
    for name, lamp_of in (
        ("planned lamps", lambda k, name: lamps.get((k, name))),
        ("at the camera", lambda k, name: plan.settings[k].position),
    ):
        steps = steps_under(solid, plan, lamp_of)
        print(f"{name}: {len(weak(steps))} of {len(steps)} pairs are weak: {weak(steps)}")


def lamps_of(light) -> dict[tuple[int, str], np.ndarray]:
    """Return the lamp of each pair of setting and name."""
    return {
        (k, name): light.lamps[image.lamps[0]]
        for k, images in enumerate(light.images)
        for image in images
        for name in image.contrast
    }


def main() -> int:
    """Measure all parts and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts", nargs="*", default=[str(EXAMPLES / name) for name in PARTS], metavar="PART"
    )
    parser.add_argument("--triples", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--csv", metavar="FILE")
    parser.add_argument("--plan", metavar="FILE")
    options = parser.parse_args()
    if options.plan:
        print_plan(read_solid(options.parts[0]), read_plan(options.plan))
        return 0
    rows = []
    begun = time.perf_counter()
    for part in options.parts:
        rows += triples(read_solid(part), options.triples, options.seed)
    print_table(rows)
    print(f"{time.perf_counter() - begun:.0f} s")
    if options.csv:
        with Path(options.csv).open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([field.name for field in fields(Triple)])
            writer.writerows(map(astuple, rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
