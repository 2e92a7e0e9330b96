"""The linear relaxation of the set cover, its duals, and the columns they leave."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from planner.cover import (
    columns_of_covers,
    core_columns,
    fractional_cover,
    is_cover,
    maximal_columns,
    mean_dual,
    min_cover,
)


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
