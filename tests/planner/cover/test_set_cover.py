"""The linear relaxation of the set cover, its duals, and the columns they leave."""

from importlib import import_module
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linprog

from planner import cover as set_cover
from planner.cover import (
    bound_columns,
    columns_of_covers,
    core_columns,
    cover_within,
    distinct_rows,
    exchange_columns,
    few_columns,
    fractional_cover,
    greedy_cover,
    is_cover,
    maximal_columns,
    mean_dual,
    min_cover,
    sets_to_realise,
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


@pytest.mark.uncompiled
def test_greedy_takes_one_more_than_the_minimum():
    cover = min_cover(GREEDY_TRAP)
    assert cover.chosen == (1, 2)
    assert cover.lower_bound == 2
    assert cover.optimal
    assert len(greedy_cover(GREEDY_TRAP)) == 3


@pytest.mark.uncompiled
def test_integer_optimum_exceeds_the_fractional_one():
    value, weights = fractional_cover(TRIANGLE)
    assert value == pytest.approx(1.5)
    assert weights == pytest.approx([0.5, 0.5, 0.5])
    assert len(min_cover(TRIANGLE).chosen) == 2


@pytest.mark.uncompiled
def test_no_entities_need_no_columns():
    cover = min_cover(np.zeros((3, 0), dtype=bool))
    assert cover.chosen == ()
    assert cover.optimal


@pytest.mark.uncompiled
def test_preference_decides_between_covers_of_equal_size_only():
    membership = np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]], dtype=bool)
    assert min_cover(membership, [0.2, 0.9, 0.0, 1.0, 1.0]).chosen == (1, 2)


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
@settings(max_examples=40, deadline=None)
@given(arrays(bool, st.tuples(st.integers(1, 8), st.integers(1, 5))))
def test_maximal_columns_are_exactly_the_undominated_ones(membership):
    kept = maximal_columns(membership)
    sets = [frozenset(np.flatnonzero(row)) for row in membership]
    maximal = {s for s in sets if s and not any(s < other for other in sets)}
    assert [sets[i] for i in kept] == list(dict.fromkeys(sets[i] for i in kept))
    assert {sets[i] for i in kept} == maximal


@pytest.mark.uncompiled
def test_entity_in_no_column_is_named():
    with pytest.raises(CoverError, match=r"Entities \[2\] are in none"):
        min_cover(np.array([[1, 1, 0]], dtype=bool))


@pytest.mark.uncompiled
def test_wrong_shape_is_refused():
    with pytest.raises(CoverError, match=r"shape \(columns, entities\). Got \(3,\)"):
        min_cover([True, False, True])


@pytest.mark.uncompiled
def test_checker_rejects_what_misses_an_entity():
    assert is_cover(GREEDY_TRAP, (1, 2))
    assert not is_cover(GREEDY_TRAP, (0, 1))


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
@pytest.mark.parametrize(
    ("cost", "count"),
    [(0.3, 1), (1.0, 1), (2.4, 2), (2.4 + 1e-10, 2), (2.41, 3), (np.inf, 1), (None, 1)],
)
def test_a_bound_on_the_cost_bounds_the_count(cost, count):
    # of four entities, k columns cost at most k + 0.5 * 4 / 5
    assert set_cover._bound_on_count(cost, 4) == count


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
def test_a_search_that_is_stopped_claims_nothing_wrong():
    """At most 9 points of that space hold no whole line (the largest cap), so 18 points meet all lines, not 17."""
    membership = lines_of_space()
    assert membership.shape == (27, 117)
    assert cover_within(membership, 17, node_limit=0) == (None, False)
    stopped = min_cover(membership, node_limit=0)
    assert is_cover(membership, stopped.chosen)
    assert stopped.lower_bound <= 18 <= len(stopped.chosen)
    assert not stopped.optimal


@pytest.mark.uncompiled
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


# The linear relaxation of the set cover, its duals, and the columns they leave.


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
    points = rng.random((60, 2))
    corners = rng.random((1500, 2)) * 1.2 - 0.2
    inside = (points >= corners[:, None]) & (points <= corners[:, None] + 0.3)
    membership = inside.all(axis=2)
    membership = np.vstack([membership, np.eye(60, dtype=bool)])
    membership = membership[maximal_columns(membership)]
    core = core_columns(membership)
    assert membership[core].any(axis=0).all()
    assert len(core) < len(membership)
    assert len(min_cover(membership[core]).chosen) == len(min_cover(membership).chosen)


def test_columns_of_no_reduced_cost_stay_however_many():
    """Two settings must be taken, of twenty equally good ones each: any may be in a smallest cover."""
    alike = np.repeat([[1, 1, 0, 0], [0, 0, 1, 1]], 20, axis=0).astype(bool)
    assert core_columns(alike).tolist() == list(range(40))
    # one of each, fewer than there are entities, weighs 1
    assert fractional_cover(alike[[0, 20]])[0] == pytest.approx(2.0)


def test_the_mean_dual_is_a_dual_and_no_single_corner():
    """A ring of six entities seen in neighbouring pairs: the symmetric dual is one half each."""
    ring = np.eye(6, dtype=bool) | np.roll(np.eye(6, dtype=bool), 1, axis=1)
    y = mean_dual(ring, 1.0, 3)
    assert y.sum() == pytest.approx(3.0)
    assert (ring @ mean_dual(ring, 2.0, 6)).max() <= 1.0 + 1e-9


def test_one_entity_weighs_one_and_none_weigh_nothing():
    value, weights = fractional_cover(np.ones((2, 1), dtype=bool))
    assert (value, weights.tolist()) == (pytest.approx(1.0), [pytest.approx(1.0)])
    value, weights = fractional_cover(np.zeros((2, 0), dtype=bool))
    assert (value, weights.shape) == (0.0, (0,))


def dual_of_all(columns, factor):
    """By one linear program."""
    return linprog(-factor, A_ub=columns.astype(float), b_ub=np.ones(len(columns)), bounds=(0, 1)).x


@pytest.mark.parametrize("seed", range(3))
def test_a_guess_does_not_change_the_dual(seed):
    """Random factors leave one optimum; a good guess, a wrong one, and none at all must find it."""
    rng = np.random.default_rng(seed)
    columns = rng.random((2500, 20)) < 0.3
    factor = 1.0 + 0.5 * rng.random(20)
    expected = dual_of_all(columns, factor)
    for guess in (None, expected, 1.0 - expected, np.zeros(20)):
        value, y = fractional_cover(columns, factor, guess)
        assert y == pytest.approx(expected, abs=1e-6)
        assert value == pytest.approx(expected.sum())


def test_the_mean_dual_of_many_columns_is_that_of_linear_programs_over_all_of_them():
    """Random factors leave one optimum each; constraint generation must find it."""
    rng = np.random.default_rng(3)
    columns = rng.random((2500, 20)) < 0.3
    factors = 1.0 + 0.5 * np.random.default_rng(0).random((5, 20))
    expected = np.mean([dual_of_all(columns, factor) for factor in factors], axis=0)
    assert mean_dual(columns, 1.5, 5) == pytest.approx(expected, abs=1e-6)
    assert mean_dual(columns[:, :0], 1.5, 5).shape == (0,)


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
    assert len(found.missing_sets) > 0 or found.missing == 0
    for wanted in found.missing_sets:
        assert least_missing(membership, 1, wanted) <= found.missing - 1


@pytest.mark.parametrize("seed", range(2))
def test_cover_is_found_where_there_is_one(seed):
    membership = windows(seed)
    smallest = len(min_cover(membership).chosen)
    found = exchange_columns(membership, smallest, steps=1000, rng=seed)
    assert found.missing == 0
    assert is_cover(membership, found.chosen)
    assert not len(found.missing_sets)
    assert exchange_columns(membership, smallest - 1, steps=1000, rng=seed).missing > 0


def test_same_seed_gives_the_same_result():
    membership = windows(3)
    one, other = (exchange_columns(membership, 12, steps=200, rng=5) for _ in range(2))
    assert one.missing == other.missing > 0
    assert np.array_equal(one.chosen, other.chosen)
    assert np.array_equal(one.missing_sets, other.missing_sets)


def test_one_column_may_be_all_that_is_allowed():
    membership = sets([[0, 1], [1, 2]], 3)
    found = exchange_columns(membership, 1, steps=10)
    assert found.missing == 1
    assert {tuple(np.flatnonzero(one)) for one in found.missing_sets} == {(0, 1, 2)}


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
