from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner.cover import (
    columns_of_covers,
    core_columns,
    distinct_rows,
    fractional_cover,
    greedy_cover,
    is_cover,
    maximal_columns,
    mean_dual,
    min_cover,
)
from planner.exceptions import CoverError

# the textbook case where greedy takes three sets and two suffice
GREEDY_TRAP = np.array([[1, 1, 1, 1, 0, 0], [1, 1, 0, 0, 1, 0], [0, 0, 1, 1, 0, 1]], dtype=bool)
# a triangle: every two entities share a column, so 1.5 columns fractionally, 2 in truth
TRIANGLE = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]], dtype=bool)


def smallest_by_trying(membership):
    for size in range(membership.shape[1] + 1):
        for chosen in combinations(range(len(membership)), size):
            if is_cover(membership, chosen):
                return size
    raise AssertionError


def test_greedy_takes_one_more_than_the_minimum():
    cover = min_cover(GREEDY_TRAP)
    assert cover.chosen == (1, 2)
    assert cover.lower_bound == 2
    assert cover.optimal
    assert len(greedy_cover(GREEDY_TRAP)) == 3


def test_integer_optimum_exceeds_the_fractional_one():
    value, weights = fractional_cover(TRIANGLE)
    assert value == pytest.approx(1.5)
    assert weights == pytest.approx([0.5, 0.5, 0.5])
    assert len(min_cover(TRIANGLE).chosen) == 2


def test_no_entities_need_no_columns():
    cover = min_cover(np.zeros((3, 0), dtype=bool))
    assert cover.chosen == ()
    assert cover.optimal


def test_preference_decides_between_covers_of_equal_size_only():
    membership = np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]], dtype=bool)
    assert min_cover(membership, [0.2, 0.9, 0.0, 1.0, 1.0]).chosen == (1, 2)


@settings(max_examples=40, deadline=None)
@given(arrays(bool, st.tuples(st.integers(1, 7), st.integers(1, 6))), st.randoms(use_true_random=False))
def test_minimum_equals_exhaustive_search(membership, random):
    membership[random.randrange(len(membership)), ~membership.any(axis=0)] = True
    cover = min_cover(membership, [random.random() for _ in membership])
    assert is_cover(membership, cover.chosen)
    assert len(cover.chosen) == cover.lower_bound == smallest_by_trying(membership)
    assert fractional_cover(membership)[0] <= cover.lower_bound + 1e-9


@settings(max_examples=40, deadline=None)
@given(arrays(bool, st.tuples(st.integers(1, 8), st.integers(1, 5))))
def test_maximal_columns_are_exactly_the_undominated_ones(membership):
    kept = maximal_columns(membership)
    sets = [frozenset(np.flatnonzero(row)) for row in membership]
    maximal = {s for s in sets if s and not any(s < other for other in sets)}
    assert [sets[i] for i in kept] == list(dict.fromkeys(sets[i] for i in kept))
    assert {sets[i] for i in kept} == maximal


def test_entity_in_no_column_is_named():
    with pytest.raises(CoverError, match=r"Entities \[2\] are in none"):
        min_cover(np.array([[1, 1, 0]], dtype=bool))


def test_wrong_shape_is_refused():
    with pytest.raises(CoverError, match=r"shape \(columns, entities\). Got \(3,\)"):
        min_cover([True, False, True])


def test_checker_rejects_what_misses_an_entity():
    assert is_cover(GREEDY_TRAP, (1, 2))
    assert not is_cover(GREEDY_TRAP, (0, 1))


@settings(max_examples=40, deadline=None)
@given(arrays(bool, st.tuples(st.integers(0, 12), st.sampled_from([1, 5, 8, 64, 65, 130])), elements=st.booleans()))
def test_distinct_rows_are_those_of_numpy(membership):
    first, kind = distinct_rows(membership)
    assert np.array_equal(membership[first][kind], membership)
    assert len(first) == len({row.tobytes() for row in membership})
    assert all((membership[:i] != membership[i]).any(axis=1).all() for i in first)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000))
def test_every_small_cover_uses_only_columns_of_covers(seed):
    rng = np.random.default_rng(seed)
    membership = rng.random((9, 7)) < 0.4
    membership[0] |= ~membership.any(axis=0)
    smallest = len(min_cover(membership).chosen)
    for size in (smallest - 1, smallest, smallest + 1):
        usable = set(columns_of_covers(membership, size).tolist())
        for chosen in combinations(range(len(membership)), size):
            if size > 0 and is_cover(membership, chosen):
                assert usable.issuperset(chosen)


def test_columns_of_no_cover_are_left_out():
    """Four entities in two pairs, and one of each alone: two columns suffice only if both are pairs."""
    membership = np.vstack([[1, 1, 0, 0], [0, 0, 1, 1], np.eye(4)]).astype(bool)
    assert columns_of_covers(membership, 2).tolist() == [0, 1]
    assert not columns_of_covers(membership, 1).any()


@pytest.mark.parametrize("seed", range(5))
def test_core_columns_cover_with_as_few_as_all_columns(seed):
    """On windows of random points in the plane, as views of a flat part are."""
    rng = np.random.default_rng(seed)
    points, corners = rng.random((60, 2)), rng.random((1500, 2)) * 1.2 - 0.2
    inside = (points >= corners[:, None]) & (points <= corners[:, None] + 0.3)
    membership = inside.all(axis=2)
    membership = np.vstack([membership, np.eye(60, dtype=bool)])
    membership = membership[maximal_columns(membership)]
    core = core_columns(membership)
    assert membership[core].any(axis=0).all()
    assert len(core) < len(membership)
    assert len(min_cover(membership[core]).chosen) == len(min_cover(membership).chosen)


def test_the_mean_dual_is_a_dual_and_no_single_corner():
    """A ring of six entities seen in neighbouring pairs: the symmetric dual is one half each."""
    ring = np.eye(6, dtype=bool) | np.roll(np.eye(6, dtype=bool), 1, axis=1)
    y = mean_dual(ring, 1.0, 3)
    assert y.sum() == pytest.approx(3.0)
    assert (ring @ mean_dual(ring, 2.0, 6)).max() <= 1.0 + 1e-9


def test_the_mean_dual_of_many_columns_is_that_of_linear_programs_over_all_of_them():
    """Random factors leave one optimum each; constraint generation must find it."""
    rng = np.random.default_rng(3)
    columns = rng.random((2500, 20)) < 0.3
    factors = 1.0 + 0.5 * np.random.default_rng(0).random((5, 20))
    expected = np.mean([fractional_cover(columns, factor)[1] for factor in factors], axis=0)
    assert mean_dual(columns, 1.5, 5) == pytest.approx(expected, abs=1e-6)
    assert mean_dual(columns[:, :0], 1.5, 5).shape == (0,)
