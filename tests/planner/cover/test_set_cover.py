from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner import cover as set_cover
from planner.cover import (
    cover_within,
    distinct_rows,
    fractional_cover,
    greedy_cover,
    is_cover,
    maximal_columns,
    min_cover,
)
from planner.exceptions import CoverError

pytestmark = pytest.mark.uncompiled

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
@given(
    arrays(bool, st.tuples(st.integers(1, 7), st.integers(1, 6))), st.randoms(use_true_random=False)
)
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
@given(
    arrays(
        bool,
        st.tuples(st.integers(0, 12), st.sampled_from([1, 5, 8, 64, 65, 130])),
        elements=st.booleans(),
    )
)
def test_distinct_rows_are_those_of_numpy(membership):
    first, kind = distinct_rows(membership)
    assert np.array_equal(membership[first][kind], membership)
    assert len(first) == len({row.tobytes() for row in membership})
    assert all((membership[:i] != membership[i]).any(axis=1).all() for i in first)


@pytest.mark.parametrize(
    ("cost", "count"),
    [(0.3, 1), (1.0, 1), (2.4, 2), (2.4 + 1e-10, 2), (2.41, 3), (np.inf, 1), (None, 1)],
)
def test_a_bound_on_the_cost_bounds_the_count(cost, count):
    # of four entities, k columns cost at most k + 0.5 * 4 / 5
    assert set_cover._bound_on_count(cost, 4) == count


def test_a_cover_within_a_number_is_found_or_shown_not_to_exist():
    # greedy needs three, so the solver must find the two
    chosen, decided = cover_within(GREEDY_TRAP, 2, node_limit=100)
    assert decided
    assert chosen.tolist() == [1, 2]
    assert cover_within(GREEDY_TRAP, 1, node_limit=100) == (None, True)
    # of a triangle one and a half columns suffice by fractions only, and greedy's own two are taken as they are
    assert cover_within(TRIANGLE, 1, node_limit=100) == (None, True)
    assert is_cover(TRIANGLE, cover_within(TRIANGLE, 2, node_limit=0)[0])


def lines_of_space():
    """Which of the 27 points of the affine space over three elements are on each of its 117 lines, (27, 117)."""
    points = np.array(list(product(range(3), repeat=3)))
    directions = [d for d in points if d.any() and d[np.flatnonzero(d)[0]] == 1]
    lines = {
        frozenset(tuple((p + k * d) % 3) for k in range(3)) for p in points for d in directions
    }
    ordered = sorted(sorted(line) for line in lines)
    return np.array([[tuple(p) in line for line in ordered] for p in points.tolist()])


def test_a_search_that_is_stopped_claims_nothing_wrong():
    """At most 9 points of that space hold no whole line (the largest cap), so 18 points meet all lines, not 17."""
    membership = lines_of_space()
    assert membership.shape == (27, 117)
    assert cover_within(membership, 17, node_limit=0) == (None, False)
    stopped = min_cover(membership, node_limit=0)
    assert is_cover(membership, stopped.chosen)
    assert stopped.lower_bound <= 18 <= len(stopped.chosen)
    assert not stopped.optimal


def test_a_solver_that_is_stopped_at_once_leaves_no_spare_column():
    """Greedy's answer stands in for the solver's; its first column is within the other two."""
    stopped = min_cover(GREEDY_TRAP, time_limit_s=0.0)
    assert stopped.chosen == (1, 2)
    # the solver proved nothing, and a cover has at least one column
    assert stopped.lower_bound == 1
    # where either of two columns may go, the less preferred one goes
    either = np.array([[1, 1, 0], [0, 0, 1], [1, 1, 0]], dtype=bool)
    for preference, kept in (([0.1, 0.5, 0.9], [1, 2]), ([0.9, 0.5, 0.1], [0, 1])):
        assert set_cover._without_spare(either, [0, 1, 2], preference).tolist() == kept
