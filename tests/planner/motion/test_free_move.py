"""Thin obstacles that checks at steps miss, and lines whose distance is known in closed form."""

import itertools

import numpy as np
import pytest
from planar_arm import PlanarArm

from planner.robotprogram.moves import Detours, check_move, check_path
from planner.robotprogram.program import JointRates

RATES = JointRates(np.full(2, 1.0), np.full(2, 2.0))


def needle(angle, near=650.0, far=690.0):
    """An obstacle without thickness in the direction of an angle."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    return [near * direction, far * direction]


def at_steps(arm, start, end, step=0.05):
    n = int(np.ceil(np.abs(end - start).max() / step)) + 1
    joints = start + np.linspace(0, 1, n)[:, None] * (end - start)
    return (arm.distances(joints) > 0).all()


def test_a_needle_between_two_steps_is_found():
    """The stretched arm sweeps over a needle: no step of 0.05 rad touches it, but the move does."""
    arm = PlanarArm([needle(0.525)])
    start = np.zeros(2)
    end = np.array([1.0, 0.0])
    assert at_steps(arm, start, end)
    found = check_move(arm, start, end)
    assert not found.free
    assert found.blocked_at == pytest.approx(0.525, abs=0.02)


@pytest.mark.parametrize(("keep", "free"), [(0.0, True), (9.9, True), (10.1, False)])
def test_the_distance_that_is_kept(keep, free):
    """The tip of the stretched arm turns on a circle of 700 mm; the point stands at 710 mm."""
    arm = PlanarArm([[[0.0, 710.0], [0.0, 711.0]]], keep=keep)
    found = check_move(arm, np.array([0.5, 0.0]), np.array([2.5, 0.0]))
    assert found.free is free


def test_proven_moves_are_free_at_a_much_finer_step():
    rng = np.random.default_rng(1)
    arm = PlanarArm(rng.uniform(-600, 600, (6, 1, 2)) + rng.uniform(-60, 60, (6, 2, 2)))
    n_free = 0
    for _ in range(40):
        start, end = rng.uniform(-np.pi, np.pi, (2, 2))
        proven = check_move(arm, start, end).free
        line = start + np.linspace(0, 1, 1500)[:, None] * (end - start)
        if proven:
            n_free += 1
            assert (arm.distances(line) > 0).all()
        else:
            assert (arm.distances(line) < 3.0).any()
    assert 3 <= n_free <= 37


def test_no_motion_is_one_pose():
    arm = PlanarArm([needle(2.0)])
    assert check_move(arm, np.zeros(2), np.zeros(2)) == (
        True,
        1,
        pytest.approx(np.nan, nan_ok=True),
    )


def blocked_sweep():
    arm = PlanarArm([needle(0.5, 500.0, 900.0)], keep=5.0)
    return arm, np.array([0.0, 0.0]), np.array([1.0, 0.0])


def test_a_detour_goes_around():
    """The arm must fold to under 500 mm to pass: both joints and the distance are checked apart."""
    arm, start, end = blocked_sweep()
    detours = Detours(arm, RATES)
    assert not detours.is_free(start, end)
    way = detours.find(start, end, seed=3)
    assert np.array_equal(way[0], start)
    assert np.array_equal(way[-1], end)
    for first, last in itertools.pairwise(way):
        line = first + np.linspace(0, 1, 500)[:, None] * (last - first)
        assert (arm.distances(line) > 5.0).all()
    tips = np.concatenate(
        [
            arm.points(first + np.linspace(0, 1, 200)[:, None] * (last - first))
            for first, last in itertools.pairwise(way)
        ]
    )
    radius = np.linalg.norm(tips[:, 2], axis=1)
    assert radius.min() < 500.0
    assert check_path(arm, way).free


def test_the_same_seed_gives_the_same_way():
    arm, start, end = blocked_sweep()
    detours = Detours(arm, RATES)
    assert np.array_equal(detours.find(start, end, seed=1), detours.find(start, end, seed=1))


def test_no_way_out_of_a_cage():
    """Needles in all directions but one sector, through which nothing can leave."""
    arm = PlanarArm([needle(0.5, 0.5, 900.0), needle(-0.5, 0.5, 900.0)])
    detours = Detours(arm, RATES)
    assert detours.find(np.zeros(2), np.array([2.0, 0.0])) is None
