"""Rounds of a planar arm: what is driven is free at a fine step, and as short as brute force."""

import itertools
from itertools import pairwise, permutations, product

import numpy as np
import pytest
from planar_arm import PlanarArm

from planner.robotprogram.moves import (
    DetourEffort,
    Detours,
    TourChecker,
    check_move,
    check_path,
    straight_costs,
)
from planner.robotprogram.program import JointRates, move_times

RATES = JointRates(np.array([1.0, 2.0]), np.array([3.0, 3.0]))
HOME = np.array([0.0, 2.5])
BRANCHES = [
    np.array([[1.2, 0.3], [1.5, -0.3]]),
    np.array([[-1.2, 0.3]]),
    np.array([[2.4, 0.5], [-2.4, 0.5]]),
]
NEEDLE = [[[460.0, 60.0], [660.0, 90.0]]]


def run(obstacles, penalties=0.0, effort=None, branches=BRANCHES):
    arm = PlanarArm(obstacles, keep=2.0)
    detours = Detours(arm, RATES, effort)
    most = max(len(group) for group in branches)
    extra = np.broadcast_to(penalties, (len(branches), most))
    return arm, TourChecker(detours, HOME, branches, extra).run()


def assert_driven(arm, tour, branches=BRANCHES):
    places = [HOME]
    places += [branches[k][b] for k, b in zip(tour.order, tour.branches, strict=True)]
    places.append(HOME)
    for move, (start, end) in zip(tour.moves, pairwise(places), strict=True):
        assert np.array_equal(move.joints[0], start)
        assert np.array_equal(move.joints[-1], end)
        legs = move_times(move.joints[:-1], move.joints[1:], RATES)
        assert move.seconds == pytest.approx(legs.sum())
        for first, last in pairwise(move.joints):
            line = first + np.linspace(0, 1, 400)[:, None] * (last - first)
            assert (arm.distances(line) > 2.0).all()


def test_without_obstacles_it_is_the_shortest_of_all():
    arm, tour = run([[[2000.0, 0.0], [2000.0, 1.0]]])
    assert_driven(arm, tour)
    assert tour.dropped == ()
    costs = straight_costs(HOME, BRANCHES, RATES)
    lengths = []
    for order in permutations(range(3)):
        for chosen in product(*(range(len(BRANCHES[k])) for k in order)):
            steps = [(0, 0), *((k + 1, b) for k, b in zip(order, chosen, strict=True)), (0, 0)]
            lengths.append(sum(costs[i, j, a, c] for (i, a), (j, c) in pairwise(steps)))
    assert sum(move.seconds for move in tour.moves) == pytest.approx(min(lengths))


def test_blocked_moves_go_around():
    arm, tour = run(NEEDLE)
    assert_driven(arm, tour)
    assert sorted(tour.order) == [0, 1, 2]
    _, free = run([[[2000.0, 0.0], [2000.0, 1.0]]])
    assert sum(m.seconds for m in tour.moves) >= sum(m.seconds for m in free.moves)


def test_a_setting_behind_walls_is_dropped():
    """The stretched arm stands between two needles that reach down to 10 mm from its shoulder."""
    cage = [[[10 * c, 10 * s], [900 * c, 900 * s]] for c, s in ((0.0, 1.0), (-0.5, 0.8))]
    branches = [*BRANCHES[:2], np.array([[1.8, 0.0]])]
    effort = DetourEffort(trials=30)
    branches[0] = np.array([[0.9, 0.3]])
    arm, tour = run(cage, effort=effort, branches=branches)
    assert tour.dropped == (2,)
    assert sorted(tour.order) == [0, 1]
    assert_driven(arm, tour, branches)


class CountedDetours(Detours):
    """Counts how often a way is sought."""

    sought = 0

    def find(self, start, end, seed=0, **options):
        self.sought += 1
        return super().find(start, end, seed, **options)


def test_what_is_cut_off_is_not_tried_from_everywhere():
    cage = [[[10 * c, 10 * s], [900 * c, 900 * s]] for c, s in ((0.0, 1.0), (-0.5, 0.8))]
    outside = [np.array([[angle, 0.3]]) for angle in (0.2, 0.4, 0.6, -0.4, -0.6, -0.8, -1.0)]
    inside = np.array([[1.8, 0.0], [1.8, 0.01], [1.81, 0.0]])
    detours = CountedDetours(PlanarArm(cage, keep=2.0), RATES, DetourEffort(trials=20))
    tour = TourChecker(detours, HOME, [*outside, inside], np.zeros((8, 3))).run()
    assert tour.dropped == (7,)
    assert sorted(tour.order) == list(range(7))
    # two for each of its branches, and its two moves in the round once more before it is dropped
    assert detours.sought <= 6 + 2


def test_home_may_be_cut_off_too():
    cage = [[[10 * c, 10 * s], [900 * c, 900 * s]] for c, s in ((0.0, 1.0), (-0.5, 0.8))]
    outside = [
        np.array([[angle, 0.3], [angle, 0.4]]) for angle in (0.2, 0.4, 0.6, -0.4, -0.6, -1.0)
    ]
    detours = CountedDetours(PlanarArm(cage, keep=2.0), RATES, DetourEffort(trials=10))
    tour = TourChecker(detours, np.array([1.8, 0.0]), outside, np.zeros((6, 2))).run()
    assert tour.dropped == tuple(range(6))
    assert detours.sought <= 12


def test_a_penalty_decides_between_branches_alike():
    alike = [np.array([[1.0, 0.5], [1.0, 0.5]])]
    far = [[[2000.0, 0.0], [2000.0, 1.0]]]
    for worse in (0, 1):
        penalties = np.zeros((1, 2))
        penalties[0, worse] = 0.1
        _, tour = run(far, penalties, branches=alike)
        assert tour.branches == (1 - worse,)


def test_no_settings():
    detours = Detours(PlanarArm(NEEDLE), RATES)
    tour = TourChecker(detours, HOME, [], np.zeros((0, 1))).run()
    assert tour.order == ()


# Thin obstacles that checks at steps miss, and lines whose distance is known in closed form.


RATES_FREE_MOVE = JointRates(np.full(2, 1.0), np.full(2, 2.0))


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
    detours = Detours(arm, RATES_FREE_MOVE)
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
    detours = Detours(arm, RATES_FREE_MOVE)
    assert np.array_equal(detours.find(start, end, seed=1), detours.find(start, end, seed=1))


def test_later_ways_use_what_earlier_ones_found():
    """Ways between other ends on both sides of the needle: most of the way is known after the first."""
    arm, start, end = blocked_sweep()
    detours = Detours(arm, RATES_FREE_MOVE)
    shifts = np.array([[0.05, 0.02], [0.03, 0.04]])
    ends = [(start + k * shifts[0], end - k * shifts[1]) for k in range(6)]
    asked = []
    for k, (first, last) in enumerate(ends):
        before = arm.asked
        way = detours.find(first, last, seed=k)
        asked.append(arm.asked - before)
        assert np.array_equal(way[[0, -1]], [first, last])
        assert check_path(arm, way).free
    alone = []
    for k, (first, last) in enumerate(ends):
        before = arm.asked
        Detours(arm, RATES_FREE_MOVE).find(first, last, seed=k)
        alone.append(arm.asked - before)
    assert asked[0] == alone[0]
    assert sum(asked[1:]) < 0.8 * sum(alone[1:])


def test_a_setting_is_not_dropped_before_its_moves_are_sought_thoroughly():
    """With 20 trials no way around the needle is found, with twelve times as many there is one."""
    arm, start, end = blocked_sweep()
    effort = DetourEffort(trials=20, spare=0)
    detours = CountedDetours(arm, RATES_FREE_MOVE, effort)
    assert detours.find(start, end, seed=[0, 0, 0, 1, 0]) is None
    detours = CountedDetours(arm, RATES_FREE_MOVE, effort)
    tour = TourChecker(detours, start, [end[None]], np.zeros((1, 1))).run()
    assert tour.dropped == ()
    for move in tour.moves:
        assert check_path(arm, move.joints).free


def test_spare_trials_are_taken_until_they_are_used_up():
    arm, start, end = blocked_sweep()
    spared = Detours(arm, RATES_FREE_MOVE, DetourEffort(trials=20, spare=220))
    way = spared.find(start, end, seed=[0, 0, 0, 1, 0])
    assert check_path(arm, way).free
    assert 0 < spared._spare < 220
    caged = PlanarArm([needle(0.5, 0.5, 900.0), needle(-0.5, 0.5, 900.0)])
    detours = Detours(caged, RATES_FREE_MOVE, DetourEffort(trials=5, spare=80))
    # eleven times five for the first one, then what is left
    for spare in (25, 0, 0):
        assert detours.find(np.zeros(2), np.array([2.0, 0.0])) is None
        assert detours._spare == spare


def test_no_way_out_of_a_cage():
    """Needles in all directions but one sector, through which nothing can leave."""
    arm = PlanarArm([needle(0.5, 0.5, 900.0), needle(-0.5, 0.5, 900.0)])
    detours = Detours(arm, RATES_FREE_MOVE)
    assert detours.find(np.zeros(2), np.array([2.0, 0.0])) is None
