"""The floor and surfaces in the simulation of dimensions: answers in closed form, and the model's uncertainty."""

import math

import numpy as np
import pytest
from plan_examples import planned_dimension

from errors.measurands import Circle, Line, Localisation
from planner import Camera, PoseUncertainty, look_at
from planner.request.models import Means
from planner.verify.simulate_setting import displaced_poses, measured_errors

CAMERA = Camera(25.0, (0.004, 0.005), (2000, 1600), 8.0, 300.0)
Z = 300.0
OVERHEAD = look_at([[0.0, 0.0, Z]], [0, 0, 0])[0]
SLANTED = look_at([[130.0, -70.0, 240.0]], [5.0, -3, 2])[0]
S = 0.05
FLOOR = Localisation.gaussian(0.0, floor_px=S)
EXACT = Localisation.gaussian(0.0, floor_px=0.0)
DRAWS = 4000
RIM = Circle((4.0, -3.0, 0.0), (0, 0, 1), 12.0)
KINDS = {
    "diameter": (RIM,),
    "length": (Line((-15, 2, 0), (15, 6, 4)),),
    "distance": (Line((-15, -10, 0), (15, -10, 0)), Line((-12, 9, 5), (14, 9, 5))),
    "angle": (Line((-10, 0, 0), (10, 0, 0)), Line((-10, -10, 0), (10, 10, 0))),
    "centre_distance": (RIM, Circle((-20, 8, 6), (0, 0, 1), 5.0)),
    "centre_to_edge": (RIM, Line((-15, 20, 3), (15, 24, 3))),
}


def dimension(kind, how, surfaces_mm=0.0, direction=None):
    return planned_dimension(
        kind, ("a",), KINDS[kind], 0.05, how, direction=direction, surfaces_mm=surfaces_mm
    )


def errors_of(one, pose, poses=None, seed=3):
    still = np.tile(pose, (DRAWS, 1, 1)) if poses is None else poses
    found, outside = measured_errors(one, pose, still, CAMERA, np.random.default_rng(seed))
    assert not outside.any()
    return found


def test_the_floor_of_a_rim_is_that_of_its_whole_size():
    square = Camera(25.0, (0.005, 0.005), (2000, 1600), 8.0, 300.0)
    found, _ = measured_errors(
        planned_dimension("diameter", ("a",), (Circle((0, 0, 0), (0, 0, 1), 12.0),), 0.05, FLOOR),
        OVERHEAD,
        np.tile(OVERHEAD, (DRAWS, 1, 1)),
        square,
        np.random.default_rng(0),
    )
    step = S * 0.005 * Z / square.image_distance_mm
    assert found.std() == pytest.approx(2 * step, rel=0.04)
    # a normal law, and not an average over points
    assert np.mean(np.abs(found) <= 2 * step) == pytest.approx(math.erf(1 / math.sqrt(2)), abs=0.03)


def test_a_face_that_is_off_scales_a_rim():
    found = errors_of(dimension("diameter", EXACT, 0.1), OVERHEAD)
    assert found.std() == pytest.approx(24.0 * 0.1 / Z, rel=0.04)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pose", [OVERHEAD, SLANTED], ids=["overhead", "slanted"])
@pytest.mark.parametrize(
    ("how", "surfaces_mm"), [(FLOOR, 0.0), (EXACT, 0.1)], ids=["floor", "surfaces"]
)
def test_each_common_error_alone_is_that_of_the_model(kind, pose, how, surfaces_mm):
    one = dimension(kind, how, surfaces_mm, (0, 1, 0) if kind == "distance" else None)
    still = Means(CAMERA, PoseUncertainty(np.zeros((6, 6))))
    told = one.describe(pose, still).standard_uncertainty
    found = errors_of(one, pose)
    assert found.std() == pytest.approx(told, rel=0.05, abs=1e-9)
    assert abs(found.mean()) <= 4 * told / math.sqrt(DRAWS) + 1e-5


@pytest.mark.parametrize("kind", ["diameter", "distance", "centre_to_edge", "length"])
def test_u_covers_what_is_simulated_with_everything(kind):
    one = dimension(
        kind, Localisation.gaussian(0.1), 0.05, (0, 1, 0) if kind == "distance" else None
    )
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.02, rotation_rad=0.0003)
    told = one.describe(SLANTED, Means(CAMERA, uncertainty))
    assert min(told.budget.values()) > 0
    poses = displaced_poses(SLANTED, uncertainty, DRAWS, np.random.default_rng(4))
    found = errors_of(one, SLANTED, poses)
    held = np.mean(np.abs(found) <= told.expanded_uncertainty)
    # 2 standard deviations of a normal law, and four of the count
    assert held == pytest.approx(math.erf(math.sqrt(2)), abs=4 * math.sqrt(0.0455 / DRAWS))


def test_without_common_errors_the_same_numbers_are_drawn_as_before():
    how = Localisation.gaussian(0.1, floor_px=0.0)
    one = dimension("diameter", how)
    rng = np.random.default_rng(3)
    errors_of(one, OVERHEAD)
    found, _ = measured_errors(one, OVERHEAD, OVERHEAD[None], CAMERA, rng)
    # one normal number for each coordinate of each point, and no other
    other = np.random.default_rng(3)
    other.normal(0.0, 0.1, (1, how.points, 2))
    assert rng.random() == other.random()
    assert np.isfinite(found).all()
