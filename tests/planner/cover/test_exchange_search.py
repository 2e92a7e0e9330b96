from importlib import import_module
from itertools import combinations

import numpy as np
import pytest

from planner.cover import (
    bound_columns,
    exchange_columns,
    few_columns,
    is_cover,
    maximal_columns,
    min_cover,
    sets_to_realise,
)
from planner.exceptions import CoverError


def rng():
    return np.random.default_rng(0)


def sets(rows, n):
    return np.array([np.isin(np.arange(n), row) for row in rows]).reshape(-1, n)


def small(seed):
    random = np.random.default_rng(seed)
    membership = random.random((9, 7)) < 0.4
    membership[0] |= ~membership.any(axis=0)
    return membership


def windows(seed):
    """Which of random points are in windows at random, as entities are in what a camera sees sharply; or alone."""
    random = np.random.default_rng(seed)
    points = random.random((150, 3))
    corners = random.random((3000, 3)) * 1.4 - 0.4
    inside = (points >= corners[:, None]) & (points <= corners[:, None] + 0.4)
    membership = np.vstack([inside.all(axis=2), np.eye(150, dtype=bool)])
    return membership[maximal_columns(membership)]


def least_missing(membership, size, also=False):
    chosen = combinations(range(len(membership)), size)
    return min(int((~(membership[list(c)].any(axis=0) | also)).sum()) for c in chosen)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("size", [1, 2, 3])
def test_as_few_are_missing_as_with_any_columns_of_that_number(seed, size):
    membership = small(seed)
    found = exchange_columns(membership, size, steps=300, rng=seed)
    assert found.missing == least_missing(membership, size)
    assert (~membership[found.chosen].any(axis=0)).sum() == found.missing


@pytest.mark.parametrize("seed", range(20))
def test_no_cover_goes_below_the_bound(seed):
    membership = small(seed)
    assert 1 <= bound_columns(membership) <= len(min_cover(membership).chosen)


def test_bounds_known_by_hand():
    """Of windows that overlap on a line, the first, the third and the last entity share no column."""
    assert bound_columns(sets([[0, 1], [1, 2], [2, 3], [3, 4]], 5)) == 3
    assert bound_columns(np.ones((2, 5), dtype=bool)) == 1
    assert bound_columns(np.eye(4, dtype=bool)) == 4
    assert bound_columns(np.zeros((3, 0), dtype=bool)) == 0
    # any two of three share a column, but no column contains all
    assert bound_columns(~np.eye(3, dtype=bool)) == 2


def test_what_the_bound_excludes_is_not_searched_for(monkeypatch):
    def search(*_, **__):
        raise AssertionError

    def ring(n):
        return np.eye(n, dtype=bool) | np.roll(np.eye(n, dtype=bool), 1, axis=1)

    monkeypatch.setattr(import_module("planner.cover"), "exchange_columns", search)
    assert len(few_columns(ring(6), 1000, rng())) == 3
    # of five in a ring two share no column, and three columns are needed
    with pytest.raises(AssertionError):
        few_columns(ring(5), 1000, rng())


@pytest.mark.parametrize("seed", range(20))
def test_with_any_wanted_set_one_entity_fewer_is_missing(seed):
    membership = small(seed)
    found = exchange_columns(membership, 2, steps=300, rng=seed)
    assert len(found.wanted) > 0 or found.missing == 0
    for wanted in found.wanted:
        assert least_missing(membership, 1, wanted) <= found.missing - 1


@pytest.mark.parametrize("seed", range(2))
def test_cover_is_found_where_there_is_one(seed):
    membership = windows(seed)
    smallest = len(min_cover(membership).chosen)
    found = exchange_columns(membership, smallest, steps=1000, rng=seed)
    assert found.missing == 0
    assert is_cover(membership, found.chosen)
    assert not len(found.wanted)
    assert exchange_columns(membership, smallest - 1, steps=1000, rng=seed).missing > 0


def test_same_seed_gives_the_same_result():
    membership = windows(3)
    one, other = (exchange_columns(membership, 12, steps=200, rng=5) for _ in range(2))
    assert one.missing == other.missing > 0
    assert np.array_equal(one.chosen, other.chosen)
    assert np.array_equal(one.wanted, other.wanted)


def test_one_column_may_be_all_that_is_allowed():
    membership = sets([[0, 1], [1, 2]], 3)
    found = exchange_columns(membership, 1, steps=10)
    assert found.missing == 1
    assert {tuple(np.flatnonzero(one)) for one in found.wanted} == {(0, 1, 2)}


def test_entity_in_no_column_is_refused():
    with pytest.raises(CoverError, match=r"Entities \[1\] are in none"):
        exchange_columns(sets([[0], [2]], 3), 2, steps=1)


@pytest.mark.parametrize("seed", range(2))
def test_few_columns_are_as_few_as_can_be_where_the_solver_is_stopped_at_once(seed):
    membership = windows(seed)
    chosen = few_columns(membership, 1, rng())
    assert is_cover(membership, chosen)
    assert len(chosen) == len(min_cover(membership).chosen)


def test_of_equally_few_columns_the_better_ones_are_chosen():
    membership = sets([[0, 1], [0, 1], [2, 3], [2, 3]], 4)
    assert few_columns(membership, 100, rng(), np.array([0.2, 0.9, 0.8, 0.1])).tolist() == [1, 2]


def test_set_that_would_save_a_column_is_realised_if_it_nearly_is():
    realised = sets([[0, 1], [2], [3]], 4)
    none = sets([], 4)
    (wanted,) = sets_to_realise(realised, sets([[1, 2, 3]], 4), none, 3, 100, rng())
    assert np.flatnonzero(wanted).tolist() == [2, 3]
    assert sets_to_realise(realised, sets([[1, 2]], 4), none, 3, 100, rng()) == []


def test_what_contains_a_refuted_set_is_not_realised():
    realised = sets([[0, 1], [2], [3]], 4)
    near = sets([[1, 2, 3]], 4)
    assert sets_to_realise(realised, near, sets([[2, 3]], 4), 3, 100, rng()) == []


def test_several_sets_are_realised_where_one_would_not_do():
    """Two columns instead of four: both must be optimistic ones."""
    realised = sets([[0], [1], [2], [3]], 4)
    near = sets([[0, 1], [2, 3]], 4)
    wanted = sets_to_realise(realised, near, sets([], 4), 3, 100, rng())
    assert {tuple(np.flatnonzero(one)) for one in wanted} <= {(0, 1), (2, 3)}
    assert len(wanted) == 2


def test_of_a_smaller_cover_with_optimistic_columns_each_gets_its_share():
    """Four columns of three, crossed by three others: each of these saves nothing, all together are the one cover."""
    realised = sets([[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]], 12)
    near = sets([[0, 3, 6, 9], [1, 4, 7, 10], [2, 5, 8, 11]], 12)
    wanted = sets_to_realise(realised, near, sets([], 12), 4, 100, rng())
    assert sorted(np.flatnonzero(one).tolist() for one in wanted) == [
        [0, 3, 6, 9],
        [1, 4, 7, 10],
        [2, 5, 8, 11],
    ]
    # where two overlap, none is asked for the same entity twice
    near[1, 0] = True
    wanted = sets_to_realise(realised, near, sets([], 12), 4, 100, rng())
    assert np.sum(wanted, axis=0).tolist() == [1] * 12
    # and without one of the three there is no hope
    assert sets_to_realise(realised, near[:2], sets([], 12), 4, 100, rng()) == []


def test_one_column_that_covers_everything_leaves_nothing_to_realise():
    assert sets_to_realise(sets([[0, 1]], 2), sets([[0, 1]], 2), sets([], 2), 1, 100, rng()) == []
