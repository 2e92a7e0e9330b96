"""The margin step: as far from the limits as it can be, at no cost in probability that was not agreed to."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace

from ground.shared import Shared
from planner import Camera, PoseUncertainty, look_at
from planner.camera.pose import world_to_cam
from planner.effort import Effort
from planner.request.constraints import Requirements
from planner.request.problem import Problem
from planner.search import evolution
from planner.search import realise_column as centre_column
from planner.search.columns import Judge
from planner.search.evolution import (
    Centring,
    Schedule,
    centred,
    evolve,
    least_share,
    triangular_factor,
)
from planner.search.plan_setting import setting_at
from planner.search.realise_column import centre_setting

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
BOX = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], ("+z-y", "+z+x"))
# in a corner of the picture, and turned away
START = look_at([[60.0, -280.0, 380.0]], [-80.0, 40.0, 60.0])[0]
EFFORT = Centring.of(Effort())


def request_of(*names, **more):
    need = Requirements(field_margin_px=10.0, **more)
    return Problem(BOX, names, CAMERA, UNCERTAINTY, 0.98, 0.9, need)


def pixels(request, pose):
    local = world_to_cam(request.ends, pose)
    return (local / local[..., 2:]) @ CAMERA.matrix.T


def test_a_single_edge_comes_to_the_middle_of_the_picture():
    """By symmetry: of the four sides none is nearer than the opposite one at the optimum."""
    request = request_of("+z-y")
    before = least_share(request, START)
    after = least_share(request, centred(request, START, EFFORT, 3))
    assert before.condition == "field_of_view_px"
    assert before.share < 0.3
    assert after.share > 0.6
    image = pixels(request, centred(request, START, EFFORT, 3))[0, :, :2]
    middle = np.array(CAMERA.resolution) / 2 - 0.5
    sides = np.minimum(image, np.array(CAMERA.resolution) - 1 - image).min(axis=0)
    # the ends lie opposite each other about the middle, as far as the other shares leave it to them
    assert np.abs(image.mean(axis=0) - middle).max() < 0.2 * min(CAMERA.resolution)
    assert sides.min() > 0.3 * min(CAMERA.resolution) / 2


@pytest.mark.parametrize("names", [("+z-y",), ("+z-y", "+z+x")])
@pytest.mark.parametrize("seed", range(4))
def test_no_share_is_lost_and_no_probability_beyond_what_is_given_up(names, seed):
    request = request_of(*names)
    rng = np.random.default_rng(seed)
    eye = np.array([60.0, -250.0, 380.0]) + rng.uniform(-60, 60, 3)
    start = look_at(eye[None], np.array([60.0, 40.0, 60.0]) + rng.uniform(-60, 60, 3))[0]
    before = least_share(request, start)
    pose = centred(request, start, EFFORT, seed)
    if before is None:
        assert (pose == start).all()
        return
    assert request.constraints.feasible(pose[None]).all()
    assert least_share(request, pose).share >= before.share
    was, now = (request.objective.probability(one[None])[0] for one in (start, pose))
    assert (now >= np.maximum(request.probability, was - EFFORT.give_up) - 1e-12).all()


def test_the_same_seed_gives_the_same_pose_and_nothing_given_up_none():
    request = request_of("+z-y")
    poses = [centred(request, START, EFFORT, 7) for _ in range(2)]
    assert (poses[0] == poses[1]).all()
    assert (centred(request, START, EFFORT._replace(give_up=0.0), 7) == START).all()


def test_the_part_comes_into_the_picture_where_nothing_else_binds(monkeypatch):
    """The box has a diagonal of 156 mm and the field at 400 mm is 350 mm wide: all of it fits."""
    request = request_of("+z-y")
    # the far side of the box is above the picture
    start = look_at([[60.0, -280.0, 380.0]], [60.0, -150.0, 60.0])[0]
    poses = []
    for weight in (1.0, 0.0):
        monkeypatch.setattr(evolution, "_OUTLINE", weight)
        poses.append(centred(request, start, EFFORT, 3))
    weighed, without = poses

    def outside(pose):
        local = world_to_cam(BOX.solid.vertices, pose)
        image = (local / local[..., 2:] @ CAMERA.matrix.T)[:, :2]
        return int(((image < -0.5) | (image > np.array(CAMERA.resolution) - 0.5)).any(axis=1).sum())

    assert outside(weighed) == 0
    assert outside(weighed) <= outside(without)
    assert outside(start) > 0


def test_a_pose_that_breaks_a_condition_is_left_alone():
    request = request_of("+z-y")
    away = look_at([[60.0, -150.0, 300.0]], [60.0, -900.0, 60.0])[0]
    assert least_share(request, away) is None
    assert (centred(request, away, EFFORT, 0) == away).all()


# The evolution strategy finds optima that are known by hand.


LONG = Schedule(population=16, generations=400, patience=400)


def stretched(points):
    """Largest at 1 in every coordinate; its widths differ by a factor of 300."""
    return -(np.logspace(0, 5, 6) * (points - 1.0) ** 2).sum(axis=1)


def rosenbrock(points):
    """Largest, 0, at 1 in every coordinate, at the end of a bent valley."""
    steps = points[:, 1:] - points[:, :-1] ** 2
    return -(100.0 * steps**2 + (1.0 - points[:, :-1]) ** 2).sum(axis=1)


@pytest.mark.parametrize("function", [stretched, rosenbrock])
def test_the_known_optimum_is_found(function):
    point, value = evolve(function, np.zeros(6), 0.3, np.random.default_rng(1), LONG)
    np.testing.assert_allclose(point, 1.0, atol=1e-3)
    assert -1e-4 < value <= 0.0


def test_the_start_is_returned_where_nothing_is_better():
    """Of a function that is largest at the start."""
    start = np.array([0.3, -0.2])
    point, value = evolve(
        lambda points: -np.abs(points - start).sum(axis=1),
        start,
        0.1,
        np.random.default_rng(0),
        LONG,
    )
    assert (point == start).all()
    assert value == 0.0


def test_what_is_not_confirmed_is_not_returned():
    """Beyond 0.5 the value is a mirage, which only the confirmation knows."""
    point, _ = evolve(
        lambda points: points[:, 0],
        np.zeros(2),
        0.2,
        np.random.default_rng(0),
        LONG,
        confirm=lambda points: points[:, 0] <= 0.5,
    )
    assert 0.2 < point[0] <= 0.5


def test_the_same_seed_gives_the_same_point():
    runs = [
        evolve(rosenbrock, np.zeros(4), 0.3, np.random.default_rng(5), LONG)[0] for _ in range(2)
    ]
    assert (runs[0] == runs[1]).all()


def test_the_factor_is_that_of_the_covariance_and_spans_what_has_spread():
    """L Lᵀ = C, also where C has no full rank; LAPACK is the referee."""
    mixing = np.random.default_rng(3).normal(size=(6, 6))
    full = mixing @ mixing.T
    np.testing.assert_allclose(triangular_factor(full), np.linalg.cholesky(full), rtol=1e-9)
    flat = np.diag([4.0, 0.0, 9.0])
    np.testing.assert_array_equal(triangular_factor(flat), np.diag([2.0, 0.0, 3.0]))


# A setting is moved off its limits as far as nothing is measured less often from there.


NAME = "+z-y"
SPACE = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], EDGES)
REQUEST = Problem(SPACE, (NAME,), CAMERA, UNCERTAINTY, 0.98, 0.9)
# the edge is near to a side of the picture from the one, and in its middle from the other
START_CENTRE_COLUMN = look_at([[160.0, 0.0, 460.0]], [160.0, 0.0, 60.0])[0]
MIDDLE = look_at([[60.0, 0.0, 460.0]], [60.0, 0.0, 60.0])[0]


def moved_to(furthest_mm, monkeypatch, better=(MIDDLE,)):
    """Move the setting where poses farther from it than so much measure less often."""
    poses = itertools.chain(better, itertools.repeat(START_CENTRE_COLUMN))
    monkeypatch.setattr(centre_column, "centred", lambda *arguments: next(poses))

    def losses(judge, before, seed, give_up):
        def is_far(after):
            return bool(np.linalg.norm((after.cam2world - before.cam2world)[:3, 3]) > furthest_mm)

        return is_far

    monkeypatch.setattr(centre_column, "_Losses", losses)
    given = setting_at(REQUEST, START_CENTRE_COLUMN, (NAME,), "given")
    return centre_setting(Shared(Judge(REQUEST, Effort())), given, 0, 1000, Centring.of(Effort()))


@pytest.mark.parametrize(
    ("furthest_mm", "way_mm"), [(1000, 100.0), (60, 50.0), (49, 25.0), (20, 12.5), (5, 0.0)]
)
def test_it_goes_as_far_as_nothing_is_lost(furthest_mm, way_mm, monkeypatch):
    """All of the 100 mm, or a half, a quarter, an eighth of them, or it stays."""
    setting = moved_to(furthest_mm, monkeypatch)
    assert START_CENTRE_COLUMN[0, 3] - setting.cam2world[0, 3] == pytest.approx(way_mm)
    shares = [least_share(REQUEST, pose).share for pose in (START_CENTRE_COLUMN, setting.cam2world)]
    assert (shares[1] > shares[0]) == (way_mm > 0)
    assert set(setting.p_all) == {NAME}


@pytest.mark.parametrize(("furthest_mm", "way_mm"), [(15, 12.5), (10, 8.0), (5, 0.0)])
def test_a_search_nearby_comes_last(furthest_mm, way_mm, monkeypatch):
    near = look_at([[152.0, 0.0, 460.0]], [152.0, 0.0, 60.0])[0]
    setting = moved_to(furthest_mm, monkeypatch, (MIDDLE, near))
    assert START_CENTRE_COLUMN[0, 3] - setting.cam2world[0, 3] == pytest.approx(way_mm)


def test_a_setting_whose_time_is_up_stays_and_is_not_counted_again(monkeypatch):
    """The search for a better pose takes all of the time, so there is none to find out what that pose promises."""
    clock = itertools.count()
    monkeypatch.setattr(centre_column.time, "time", lambda: next(clock))
    monkeypatch.setattr(centre_column, "centred", lambda *arguments: MIDDLE)
    bare = setting_at(REQUEST, START_CENTRE_COLUMN, (NAME,), "given")
    # what is counted is below, so another count would show
    counted = replace(bare, p_all={NAME: 0.5}, p_all_together=0.5, p_all_poses=1000)
    judge = Shared(Judge(REQUEST, Effort()))
    assert centre_setting(judge, counted, 0, 1000, Centring.of(Effort()), until=1.5) == counted
    clock = itertools.count()
    stays = centre_setting(judge, bare, 0, 1000, Centring.of(Effort()), until=1.5)
    assert np.array_equal(stays.cam2world, START_CENTRE_COLUMN)
    assert stays.p_all[NAME] > 0.5
