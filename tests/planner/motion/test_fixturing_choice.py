"""Fewest fixturings against all subsets, then the time against all assignments."""

from itertools import combinations, product

import numpy as np
import pytest

from planner.robotprogram.robot_program import choose_fixturings


def no_time(fixturing, settings):
    return 0.0


def test_one_fixturing_is_enough():
    reached = np.array([[1, 0, 1], [0, 1, 1], [1, 0, 1]], dtype=bool)
    found = choose_fixturings(reached, no_time)
    assert found.of_setting == (2, 2, 2)
    assert found.coverage == (3,)


def test_coverage_says_what_each_further_fixturing_adds():
    reached = np.array(
        [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]], dtype=bool
    )
    found = choose_fixturings(reached, no_time)
    assert found.coverage == (3, 5, 6)
    assert found.of_setting == (0, 0, 1, 1, 0, 2)


def test_settings_that_nothing_reaches():
    reached = np.array([[0, 0], [0, 1]], dtype=bool)
    assert choose_fixturings(reached, no_time) == (
        (-1, 1),
        (1,),
    )
    assert choose_fixturings(reached & False, no_time).of_setting == (-1, -1)


@pytest.mark.parametrize("seed", range(6))
def test_as_all_subsets_and_assignments(seed):
    rng = np.random.default_rng(seed)
    reached = rng.random((5, 4)) < 0.4
    weights = rng.uniform(1, 2, (4, 5))

    def seconds(fixturing, settings):
        # additive, so that moving one setting at a time finds the least
        return float(sum(weights[fixturing, k] for k in settings))

    found = choose_fixturings(reached, seconds)
    most = reached.any(axis=1).sum()
    used = sorted(set(found.of_setting) - {-1})
    assert sum(f >= 0 for f in found.of_setting) == most
    assert all(f < 0 or reached[k, f] for k, f in enumerate(found.of_setting))
    for size in range(len(used)):
        for chosen in combinations(range(4), size):
            assert reached[:, chosen].any(axis=1).sum() < most
    best = min(
        sum(weights[f, k] for k, f in enumerate(assignment) if f >= 0)
        for assignment in product(
            *([f for f in range(4) if reached[k, f]] or [-1] for k in range(5))
        )
        if len(set(assignment) - {-1}) <= max(len(used), 0)
    )
    time = sum(weights[f, k] for k, f in enumerate(found.of_setting) if f >= 0)
    assert time == pytest.approx(best)
