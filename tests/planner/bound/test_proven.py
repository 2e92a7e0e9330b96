"""What a bound for all targets says of some of them: known answers, and covers counted one by one."""

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog

from planner.bound.lower_bound import ProvenBound, of_all

ALL = np.ones(6, bool)


def kept(*targets):
    found = np.zeros(6, bool)
    found[list(targets)] = True
    return found


def test_without_weights_it_falls_by_one_for_each_target_that_is_not_kept():
    proven = ProvenBound(4, "", ALL)
    assert [proven.for_some(kept(*range(n))) for n in range(7)] == [0, 1, 1, 1, 2, 3, 4]


def test_six_targets_of_which_a_pose_inspects_two():
    """Each weighs a half; three need two settings, where one less for each would leave none."""
    proven = ProvenBound(3, "", ALL, np.full(6, 0.5))
    assert [proven.for_some(kept(*range(n))) for n in range(7)] == [0, 1, 1, 2, 2, 3, 3]


def test_targets_that_were_not_asked_for_change_nothing():
    proven = ProvenBound(2, "", kept(0, 1, 2), of_all(np.array([1.0, 0.5, 0.5]), kept(0, 1, 2)))
    assert proven.for_some(kept(0, 1, 2, 5)) == 2
    assert proven.for_some(kept(0, 5)) == 1
    assert proven.for_some(kept(5)) == 1


def least_cover(columns, targets):
    """How many columns cover some targets, by trying all."""
    for n in itertools.count():
        for some in itertools.combinations(columns, n):
            if np.any(some, axis=0)[targets].all() if n else not targets.any():
                return n


@pytest.mark.parametrize("seed", range(8))
def test_no_cover_is_smaller(seed):
    rng = np.random.default_rng(seed)
    columns = rng.random((7, 6)) < 0.35
    columns[rng.integers(0, 7, 6), np.arange(6)] = True
    dual = linprog(-np.ones(6), A_ub=columns.astype(float), b_ub=np.ones(7), bounds=(0.0, 1.0)).x
    n = int(np.ceil(dual.sum() - 1e-6))
    better = 0
    for chosen in itertools.product([False, True], repeat=6):
        some = np.array(chosen)
        least = least_cover(columns, some)
        plain = ProvenBound(n, "", ALL).for_some(some)
        weighed = ProvenBound(n, "", ALL, dual).for_some(some)
        assert plain <= weighed <= least
        better += weighed > plain
    assert better > 0 or n == 1
