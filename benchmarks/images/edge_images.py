"""Promised against measured: lengths of edges in rendered images from displaced poses, by what the image is like.

    python benchmarks/images/edge_images.py PLAN.json PART [--poses 30] [--seed 0] [--csv FILE]

For every setting and edge of a plan, the camera is displaced, patches of the image are rendered (`rendered_images`:
matt faces, cast shadows, blur 0.8 px, noise 1.5 %) under the lamp that the plan names, or one at the camera, and the
edge is measured as an image program does: a line is fitted to points found along the edge, another one to points along
the line that leaves each end, and the two are intersected. The length may differ from that in the planned image by the
fraction 1 - A; how often it does not is compared with what the plan promises: with the ends as the *fit* gives them,
and *rounded* to whole pixels, as the promise assumes. Of several lines at an end the one is taken that finds the corner
best in the planned image, of those long enough for a fit if any is. Besides, ends are found by OpenCV: as corners by
`cornerSubPix`, and where Canny's trace of the edge ends (`corner_detectors`); no promise is made for these.

What the image is like is found out here, from the triangles and by rays, without `planner.detectability`: whether
another line leaves both ends at 25 degrees (*corner*), whether another visible line is within 5 px (*near line*),
whether 40 px around the ends are in the image (*border*), and the grey step across the edge (*weak* below 5 of 255,
*weak corner* of the line at an end). *Not lit* is what the plan says that no lamp shows. A pair with none of these is
*clean*: what is promised of it must hold.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from corner_detectors import corner_sub_pix, picture, traced_end
from dimension_images import triangles_of
from rendered_images import Lamp, Renderer, found_points
from scipy.spatial.transform import Rotation
from seen_lines import CORNER_DEG, NEAR_PX, Arm, Lines, angle_deg

from aspectgraph import Solid, read_solid, resolve_entities
from planner import InspectionPlan, read_plan
from planner.request.models import Means
from planner.request.problem import Objective

ACCURACIES = (0.98, 0.99, 0.995)
AROUND_PX = 40.0
WEAK = 5.0
ALONG = 24
ARM_PX = (4.0, 28.0)
ARM_POINTS = 12
# blur shows a line much stronger than another one so far beside itself
BLURRED_PX = 1.5
# a line with less for a fit is taken only where no other one leaves the corner
FITTED_PX = 8.0
# noisy images of the planned pose in which the lines at an end are compared
TRIALS = 5
_TOLD = ("promised", "measured", "rounded", "corner", "canny")


@dataclass
class Pair:
    """One edge from one setting: what was promised and measured at each accuracy, and what the image is like."""

    part: str
    setting: int
    name: str
    kind: str
    near_px: float
    step: float
    n: int
    promised: tuple[float, ...]
    measured: tuple[float, ...]
    rounded: tuple[float, ...]
    corner: tuple[float, ...]
    canny: tuple[float, ...]

    @property
    def worst(self) -> float:
        """Largest promise above the frequency of the fit, in standard errors of the promise, at A = .98 and .99."""
        return max(
            (p - m) / np.sqrt(max(p * (1 - p), 1 / self.n) / self.n)
            for p, m in zip(self.promised[:2], self.measured[:2], strict=True)
        )


def fitted(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a point and the direction of a line through points (n, 2); those farther off than the others are left."""
    kept = np.ones(len(points), bool)
    for _ in range(3):
        middle = points[kept].mean(axis=0)
        way = np.linalg.svd(points[kept] - middle)[2][0]
        off = np.abs((points - middle) @ [-way[1], way[0]])
        kept = off <= max(3 * np.median(off), 0.2)
    return middle, way


def crossing(
    one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return where two lines of the image meet."""
    share = np.linalg.solve(np.column_stack([one[1], -other[1]]), other[0] - one[0])
    return one[0] + share[0] * one[1]


def _mixed_px(deg: float) -> float:
    """Return how long a line that leaves another one at an angle is beside it, px: as far as blur shows it there."""
    return float((NEAR_PX + BLURRED_PX) / np.tan(np.radians(max(deg, 1.0))))


def found_ends(
    renderer: Renderer, pose: np.ndarray, ends: np.ndarray, arms: list[Arm], lamp: Lamp, rng
) -> np.ndarray:
    """Return the ends (2, 2) of an edge in px as found in the image from a pose; nan where grey steps are too weak."""
    length = np.linalg.norm(np.diff(renderer.projected(ends, pose), axis=0))
    mixed = [float(np.clip(_mixed_px(one.edge_deg) / length, 0.06, 0.4)) for one in arms]
    line = _line(renderer, pose, ends[0], ends[1], (mixed[0], 1 - mixed[1]), ALONG, lamp, rng)
    corners = np.full((2, 2), np.nan)
    for i, (end, one) in enumerate(zip(ends, arms, strict=True)):
        arm = _line(
            renderer,
            pose,
            end,
            one.tip,
            arm_shares(renderer, pose, end, one),
            ARM_POINTS,
            lamp,
            rng,
        )
        if line is not None and arm is not None:
            corners[i] = crossing(line, arm)
    return corners


def _missed_px(
    renderer: Renderer, pose: np.ndarray, ends: np.ndarray, arm: Arm, lamp: Lamp, rng
) -> float:
    """Return how far from the first end its corner is found with a line, px, in some noisy images; many if it is not.

    One image would choose a line too short for a fit as often as luck has it.
    """
    found = [found_ends(renderer, pose, ends, [arm, arm], lamp, rng)[0] for _ in range(TRIALS)]
    missed = float(np.linalg.norm(found - renderer.projected(ends[:1], pose)[0], axis=1).max())
    return missed if np.isfinite(missed) else 1e6


def arm_step(
    renderer: Renderer, pose: np.ndarray, corner: np.ndarray, arm: Arm, lamp: Lamp, rng
) -> float:
    """Return the grey step across a line that leaves a corner, where it is weakest but for a few points."""
    way = arm.tip - corner
    points = (
        corner + np.linspace(*arm_shares(renderer, pose, corner, arm), ARM_POINTS)[:, None] * way
    )
    tangents = np.tile(way / np.linalg.norm(way), (ARM_POINTS, 1))
    return float(np.quantile(found_points(renderer, pose, points, tangents, lamp, rng)[1], 0.2))


def arm_shares(renderer: Renderer, pose: np.ndarray, corner: np.ndarray, arm: Arm) -> np.ndarray:
    """Return between which shares of its length a line that leaves a corner is looked for."""
    length = np.linalg.norm(np.diff(renderer.projected(np.array([corner, arm.tip]), pose), axis=0))
    first = _mixed_px(arm.fork_deg)
    back = _mixed_px(arm.tip_deg)
    stop = np.clip(length - back, 0.5 * length, 0.9 * length)
    return np.minimum((max(ARM_PX[0], first), ARM_PX[1]), (0.5 * length, stop)) / length


def _fitted_px(renderer: Renderer, pose: np.ndarray, corner: np.ndarray, arm: Arm) -> float:
    """Return how much of a line that leaves a corner there is for a fit, px."""
    length = np.linalg.norm(np.diff(renderer.projected(np.array([corner, arm.tip]), pose), axis=0))
    return float(np.ptp(arm_shares(renderer, pose, corner, arm)) * length)


def detected_ends(
    renderer: Renderer, pose: np.ndarray, ends: np.ndarray, lamp: Lamp, rng
) -> np.ndarray:
    """Return the ends (2, 2, 2) of an edge in px, as corners and as ends of a trace; nan where there is none."""
    image = renderer.projected(ends, pose)
    found = np.empty((2, 2, 2))
    for i in range(2):
        grey, first = picture(renderer, pose, image[i], lamp, rng)
        outward = (image[i] - image[1 - i]) / np.linalg.norm(image[i] - image[1 - i])
        found[:, i] = (
            corner_sub_pix(grey, first, image[i]),
            traced_end(grey, first, image[i], outward),
        )
    return found


def _line(renderer, pose, start, end, shares, n, lamp, rng):
    points = start + np.linspace(*shares, n)[:, None] * (end - start)
    tangents = np.tile((end - start) / np.linalg.norm(end - start), (n, 1))
    pixels, step = found_points(renderer, pose, points, tangents, lamp, rng)
    strong = step >= WEAK
    return fitted(pixels[strong]) if strong.sum() >= n // 2 else None


def pairs(plan: InspectionPlan, solid: Solid, n: int, seed: int, triangles=None) -> Iterator[Pair]:
    """Measure every edge of every setting from n displaced poses; ``triangles`` (vertices, triangles) are rendered."""
    lines = Lines(solid)
    renderer = Renderer(
        *(triangles or (solid.vertices, solid.triangles)),
        plan.camera.matrix,
        samples=4,
        noise=0.015,
    )
    for k, setting in enumerate(plan.settings):
        pose = np.asarray(setting.cam2world)
        for name in setting.entities:
            rng = np.random.default_rng([seed, k, *map(ord, name)])
            ends = np.asarray(plan.entities[name])
            own = set(resolve_entities(solid, {name: ends})[name].edge_ids)
            lamp = Lamp(lamp_place(plan, k, name))
            chosen = []
            kind = "clean"
            for i in range(2):
                arms = lines.arms(pose, renderer, ends[i], ends[1 - i], own)
                wide = [one for one in arms if CORNER_DEG <= one.seen_deg <= 180 - CORNER_DEG]
                if not wide or min(one.seen_deg for one in arms) < CORNER_DEG:
                    kind = "no corner"
                long = [
                    one for one in wide if _fitted_px(renderer, pose, ends[i], one) >= FITTED_PX
                ]
                wide = long or wide
                steps = [arm_step(renderer, pose, ends[i], one, lamp, rng) for one in wide]
                missed = [
                    _missed_px(renderer, pose, ends[[i, 1 - i]], one, lamp, rng) for one in wide
                ]
                chosen.append(
                    wide[int(np.argmin(missed))]
                    if wide
                    else _onward(lines, ends[i], ends[1 - i], own)
                )
                if wide and max(steps) < WEAK and kind == "clean":
                    kind = "weak corner"
            near = lines.nearest_px(renderer, pose, ends, own)
            points = ends[0] + np.linspace(0.1, 0.9, 9)[:, None] * (ends[1] - ends[0])
            tangents = np.tile((ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0]), (9, 1))
            step = float(
                np.quantile(found_points(renderer, pose, points, tangents, lamp, rng)[1], 0.1)
            )
            image = renderer.projected(ends, pose)
            room = min(image.min(), (np.array(plan.camera.resolution) - image).min())
            if kind == "clean":
                if near < NEAR_PX:
                    kind = "near line"
                elif step < WEAK:
                    kind = "weak"
                elif room < AROUND_PX:
                    kind = "border"
            if plan.light is not None and name in plan.light.unlit[k]:
                kind = "not lit"
            yield _measured(
                plan, k, name, (renderer, pose, ends, chosen, lamp, rng), n, (kind, near, step)
            )


def _onward(lines: Lines, end: np.ndarray, inward: np.ndarray, own: set[int]) -> Arm:
    """Return the line that an edge runs on in: what a corner detector would take for the other side."""
    vertex = int(np.linalg.norm(lines.solid.vertices - end, axis=1).argmin())
    others = [
        e for e in np.flatnonzero((lines.ends == vertex).any(axis=1) & lines.line) if e not in own
    ]
    tips = [lines.solid.vertices[lines.ends[e].sum() - vertex] for e in others]
    tip = (
        min(tips, key=lambda tip: abs(angle_deg(tip - end, inward - end) - 90))
        if tips
        else 2 * end - inward
    )
    return Arm(tip, 180.0, 90.0)


def _measured(plan, k, name, how, n, kind) -> Pair:
    renderer, pose, ends, arms, lamp, rng = how
    camera = plan.camera
    sigmas = np.asarray(plan.pose_uncertainty.covariance)
    image = renderer.projected(ends, pose)
    nominal = np.linalg.norm((image[1] - image[0]) * camera.pixel_pitch_mm)
    errors = np.empty((n, 4))
    for i in range(n):
        move = np.eye(4)
        draw = rng.multivariate_normal(np.zeros(6), sigmas)
        move[:3, 3] = draw[:3]
        move[:3, :3] = Rotation.from_rotvec(draw[3:]).as_matrix()
        found = found_ends(renderer, pose @ move, ends, arms, lamp, rng)
        detected = detected_ends(renderer, pose @ move, ends, lamp, rng)
        for j, one in enumerate((found, np.rint(found), *detected)):
            length = np.linalg.norm((one[1] - one[0]) * camera.pixel_pitch_mm)
            errors[i, j] = abs(length / nominal - 1) if np.isfinite(length) else np.inf
    promised = [
        float(
            Objective.of_edges(ends[None], Means(camera, plan.pose_uncertainty, a)).probability(
                pose[None]
            )[0, 0]
        )
        for a in ACCURACIES
    ]
    met = [tuple(float(value) for value in (errors <= 1 - a).mean(axis=0)) for a in ACCURACIES]
    return Pair(
        plan.part, k, name, kind[0], kind[1], kind[2], n, tuple(promised), *zip(*met, strict=True)
    )


def lamp_place(plan: InspectionPlan, k: int, name: str) -> np.ndarray:
    """Return where the lamp of a pair is: the planned one, or beside the camera."""
    for image in plan.light.images[k] if plan.light is not None else ():
        if name in image.contrast:
            return np.asarray(plan.light.lamps[image.lamps[0]])
    pose = np.asarray(plan.settings[k].cam2world)
    return pose[:3, 3] + pose[:3, :3] @ np.array([-150.0, -150.0, 0.0])


def show(found: list[Pair]) -> None:
    """Print a table by class, and the pairs whose promise is too high."""
    head = "".join(f"   A = {a:<5} promised    fit rounded corner  Canny" for a in ACCURACIES)
    print(f"{'class':<12}{'pairs':>6}{'images':>7}{head}")
    for kind in sorted({one.kind for one in found}):
        own = [one for one in found if one.kind == kind]
        means = [
            [np.mean([getattr(one, which)[i] for one in own]) for which in _TOLD] for i in range(3)
        ]
        cells = "".join(f"{p:21.3f}{m:7.3f}{r:8.3f}{c:7.3f}{t:7.3f}" for p, m, r, c, t in means)
        print(f"{kind:<12}{len(own):>6}{sum(one.n for one in own):>7}{cells}")
    for one in found:
        if one.worst > 3:
            told = f"{one.kind}, line at {one.near_px:.1f} px, step {one.step:.0f}"
            print(
                f"promised too much: {one.part} setting {one.setting + 1} {one.name} ({told}):",
                end=" ",
            )
            print(f"{one.promised} against {one.measured}, {one.worst:.1f} standard errors")


def write_csv(path: Path, found: list[Pair], plan: str = "") -> None:
    """Write a row per pair, with a column for each frequency at each accuracy; add to what other plans left there."""
    rows = []
    for one in found:
        row = {"plan": plan, **asdict(one), "setting": one.setting + 1}
        row |= {"near_px": round(one.near_px, 2), "step": round(one.step, 1)}
        told = {
            f"{which} {a}": round(row[which][i], 6)
            for i, a in enumerate(ACCURACIES)
            for which in _TOLD
        }
        rows.append({name: value for name, value in row.items() if name not in _TOLD} | told)
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*rows[0]], lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerows(rows)


def main() -> int:
    """Measure the edges of a plan; 1 if a clean pair was promised more than was measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plan", type=Path)
    parser.add_argument("part", type=Path)
    parser.add_argument("--poses", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--csv", type=Path, help="add a row per pair to this file")
    parser.add_argument("--name", default="", help="what the file calls the plan")
    options = parser.parse_args()
    began = time.time()
    found = []
    fine = (
        triangles_of(options.part)
        if ".st" in options.part.name and ".stl" not in options.part.name
        else None
    )
    for pair in pairs(
        read_plan(options.plan), read_solid(options.part), options.poses, options.seed, fine
    ):
        found.append(pair)
        print(
            f"{pair.setting + 1} {pair.name:<24}{pair.kind:<10}{pair.near_px:6.1f} px step {pair.step:5.1f}",
            end=" ",
        )
        print(
            "  ".join(
                f"{p:.3f}/{m:.3f}" for p, m in zip(pair.promised, pair.measured, strict=True)
            ),
            flush=True,
        )
    show(found)
    print(f"{time.time() - began:.0f} s")
    if options.csv:
        write_csv(options.csv, found, options.name)
    return int(any(one.kind == "clean" and one.worst > 3 for one in found))


if __name__ == "__main__":
    sys.exit(main())
