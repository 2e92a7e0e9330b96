"""How true and how fast the error model of dimensions is, against a program that measures from displaced poses.

    python benchmarks/models/dimension_model.py [--views 40] [--draws 131072]

The measuring program (tests/errors/helpers/measured_exactly.py) shares no code with the model: exact rotations, its
own projection, carrying back, fits and values. Cameras are 200 to 450 mm away, tilted by up to 60 degrees; covariances
are correlated at random, 0.1 mm along every axis; the permitted error is a random quantile of the error, .3 to .97.
Poses are drawn as scrambled Sobol points, which leaves a noise of about 0.0005 in P where they matter
more than localisation does. Printed are

* per kind and rotation s.d.: the largest difference in P, and the largest relative one in the standard uncertainty;
* predictions per second on one core;
* per kind and localisation model: the largest difference in P, with poses known well enough that it matters; a
  pixel grid lies
  anywhere in every draw, but all points of an entity are on the same one. With gaussian errors all
  points of an entity share a floor, and faces are off by SURFACES_MM: entities in one plane by the same.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "errors" / "helpers"))

from dimension_examples import EXAMPLES, PITCH, F, correlated, geometry_of, isotropic
from measured_exactly import displacements, measure, points_of, random_view

from errors.measurands import Localisation, MeasurandModel
from errors.measurands.measurand import measurand

ROTATIONS = (0.003, 0.01, 0.03, 0.055)
LIMITS = (0.002, 0.002, 0.006, 0.012)
SPEED_POSES = 20000
SURFACES_MM = 0.05


def model_of(example, covariance, localisation, permitted, surfaces_mm=0.0):
    """Return the error model of an example: its kind, plain geometry and direction of measuring."""
    kind, plain, direction = example
    return MeasurandModel(
        measurand(kind, geometry_of(plain), direction),
        image_distance_mm=F,
        pixel_pitch_mm=PITCH,
        pose_covariance=covariance,
        localisation=localisation,
        permitted_error=permitted,
        surfaces_mm=surfaces_mm,
    )


def common_errors(example, localisation, n, rng):
    """Return what the points of an entity have in common (n draws), as `measured_exactly.measure` takes it."""
    kind, plain, direction = example
    floor = localisation.floor_px
    if kind == "length":
        return {
            "ends_px": rng.normal(0.0, floor, (n, 2)),
            "places": rng.normal(0.0, SURFACES_MM, (n, 2)),
        }
    surface, _ = measurand(kind, geometry_of(plain), direction).surfaces
    return {
        "floor_px": rng.normal(0.0, floor, (n, len(plain))),
        "surfaces_mm": rng.normal(0.0, SURFACES_MM, (n, len(plain)))[:, surface],
    }


def differences(example, views, draws, rng, rotation):
    """Return the differences in P and the relative ones in u (views,) of a kind."""
    kind, plain, direction = example
    nominal = measurand(kind, geometry_of(plain), direction).nominal
    localisation = Localisation.gaussian(0.05, floor_px=0.0)
    result = []
    while len(result) < views:
        covariance = correlated(rng, 0.1, rotation)
        pose = random_view(rng)
        moves = displacements(covariance, draws, int(rng.integers(1 << 30)))
        sigma = tuple(localisation.sigma_px * pitch for pitch in PITCH)
        error = measure(kind, plain, pose, moves, f=F, sigma_mm=sigma, rng=rng, direction=direction)
        permitted = float(np.nanquantile(np.abs(error), rng.uniform(0.3, 0.97)))
        if permitted >= nominal:
            continue
        found = model_of(example, covariance, localisation, permitted).describe(pose)
        result.append(
            (
                found.probability - np.mean(np.abs(error) <= permitted),
                found.standard_uncertainty / np.nanstd(error) - 1,
            )
        )
    return np.array(result).T


def speed(example, rng):
    """Return predictions per second of processor time."""
    model = model_of(example, isotropic(0.05, 0.001), Localisation.gaussian(0.1), 0.03)
    poses = np.array([random_view(rng) for _ in range(SPEED_POSES)])
    model.probability(poses[:10])
    times = []
    for _ in range(3):
        start = time.process_time()
        model.probability(poses)
        times.append(time.process_time() - start)
    return SPEED_POSES / min(times)


def found_points(one, localisation, pose):
    """Return how many independent points a fit finds on an entity: length of its image over the correlation length."""
    if localisation.model != "fit":
        return localisation.points
    seen = points_of(one, 400) @ pose[:3, :3].T + pose[:3, 3]
    image = F * seen[:, :2] / seen[:, 2:] / max(PITCH)
    along = np.linalg.norm(np.diff(image, axis=0), axis=1).sum() * 400 / 399
    count = max(3, round(along / localisation.correlation_px))
    return min(count, max(3, round((localisation.sigma_px / localisation.floor_px) ** 2)))


def localisation_differences(example, localisation, views, draws, rng):
    """Return the differences in P (views,) where localisation counts as much as the pose."""
    kind, plain, direction = example
    covariance = isotropic(0.005, 0.00005)
    result = []
    for _ in range(views):
        pose = random_view(rng)
        moves = displacements(covariance, draws, int(rng.integers(1 << 30)))
        points = [found_points(one, localisation, pose) for one in plain]
        how = {"pixel": np.array(PITCH), "rng": rng} if localisation.model == "rounding" else {}
        off = 0.0
        if localisation.model == "gaussian":
            off = SURFACES_MM
            how = {"common": common_errors(example, localisation, len(moves), rng), "pitch": PITCH}
        if localisation.model != "rounding":
            how |= {"sigma_mm": tuple(localisation.sigma_px * pitch for pitch in PITCH), "rng": rng}
        error = measure(kind, plain, pose, moves, f=F, direction=direction, points=points, **how)
        permitted = float(np.quantile(np.abs(error), rng.uniform(0.3, 0.97)))
        model = model_of(example, covariance, localisation, permitted, off)
        found = model.probability(pose[None])[0]
        result.append(found - np.mean(np.abs(error) <= permitted))
    return np.array(result)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--views", type=int, default=40)
    parser.add_argument("--draws", type=int, default=1 << 17)
    given = parser.parse_args()
    rng = np.random.default_rng(8)
    missed = []
    print(
        f"{'largest |dP| (|du|/u)':24s}"
        + "".join(f"{r:>10g} rad" + " " * 6 for r in ROTATIONS)
        + "per second"
    )
    for name, example in EXAMPLES.items():
        line = f"{name:24s}"
        for rotation, limit in zip(ROTATIONS, LIMITS, strict=True):
            of_p, of_u = differences(example, given.views, given.draws, rng, rotation)
            line += f"  {np.abs(of_p).max():.4f} ({np.abs(of_u).max():.3f})  "
            if np.abs(of_p).max() > limit:
                missed.append(f"{name} at {rotation} rad: {np.abs(of_p).max():.4f} > {limit}")
        print(line + f"{speed(example, rng):12,.0f}", flush=True)
    models = Localisation.gaussian(0.1), Localisation.fit(), Localisation.rounding()
    print(f"\n{'largest |dP| (mean dP)':24s}" + "".join(f"{one.model:>20s}" for one in models))
    for name, example in EXAMPLES.items():
        line = f"{name:24s}"
        for localisation in models:
            of_p = localisation_differences(
                example, localisation, given.views, given.draws // 8, rng
            )
            line += f"    {np.abs(of_p).max():.4f} ({of_p.mean():+.4f})"
        print(line, flush=True)
    print("\nlimits missed: " + ("; ".join(missed) or "none"))
    if missed:
        sys.exit(1)


if __name__ == "__main__":
    main()
