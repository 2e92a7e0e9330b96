"""Rounds of a planar arm: what is driven is free at a fine step, and as short as brute force."""

from itertools import pairwise, permutations, product

import numpy as np
import pytest
from planar_arm import PlanarArm

from planner.robotprogram.moves import DetourEffort, Detours, TourChecker, straight_costs
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

    def find(self, start, end, seed=0):
        self.sought += 1
        return super().find(start, end, seed)


def test_what_is_cut_off_is_not_tried_from_everywhere():
    cage = [[[10 * c, 10 * s], [900 * c, 900 * s]] for c, s in ((0.0, 1.0), (-0.5, 0.8))]
    outside = [np.array([[angle, 0.3]]) for angle in (0.2, 0.4, 0.6, -0.4, -0.6, -0.8, -1.0)]
    inside = np.array([[1.8, 0.0], [1.8, 0.01], [1.81, 0.0]])
    detours = CountedDetours(PlanarArm(cage, keep=2.0), RATES, DetourEffort(trials=20))
    tour = TourChecker(detours, HOME, [*outside, inside], np.zeros((8, 3))).run()
    assert tour.dropped == (7,)
    assert sorted(tour.order) == list(range(7))
    # two for each of its branches
    assert detours.sought <= 6


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
