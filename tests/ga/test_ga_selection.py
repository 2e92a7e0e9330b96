"""Wheels spun by hand, and the statistics of many spins."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from ga.bits import (
    proportional_weights,
    rank_weights,
    roulette,
    spin,
    stochastic_universal,
    window_weights,
)

WEIGHTS = np.array([1.0, 3.0, 0.0, 4.0])  # edges of the slots at 1/8, 4/8, 4/8, 8/8


def shares(weights):
    return weights / weights.sum()


@pytest.mark.parametrize(
    ("position", "slot"),
    [
        (0.0, 0),
        (0.1249, 0),
        (0.125, 1),
        (0.4999, 1),
        (0.5, 3),
        (0.9999, 3),
        (np.nextafter(1.0, 0.0), 3),
    ],
)
def test_spin(position, slot):
    assert spin(WEIGHTS, np.array([position])).tolist() == [slot]


def test_spin_never_meets_an_empty_slot_at_either_end():
    positions = np.array([0.0, np.nextafter(1.0, 0.0)])
    assert spin(np.array([0.0, 0.1, 0.7, 0.0]), positions).tolist() == [1, 2]


def test_proportional_weights_are_the_fitness():
    assert shares(proportional_weights(np.array([1.0, 3.0, 0.0, 4.0]))).tolist() == [
        0.125,
        0.375,
        0.0,
        0.5,
    ]


def test_proportional_weights_of_negative_fitness_are_raised_by_the_lowest():
    assert shares(proportional_weights(np.array([-2.0, -1.0, 1.0]))).tolist() == [0.0, 0.25, 0.75]


@pytest.mark.parametrize("value", [0.0, -3.0])
def test_proportional_weights_without_a_difference_are_even(value):
    assert shares(proportional_weights(np.full(4, value))).tolist() == [0.25] * 4


def test_proportional_weights_of_extreme_fitness_neither_overflow_nor_vanish():
    assert shares(proportional_weights(np.array([1e308, 1e308, 0.0, 0.0]))).tolist() == [
        0.5,
        0.5,
        0.0,
        0.0,
    ]
    assert shares(proportional_weights(np.array([-1e308, 1e308]))).tolist() == [0.0, 1.0]
    assert shares(proportional_weights(np.array([5e-324, 15e-324]))).tolist() == [0.25, 0.75]


def test_window_weights():
    assert shares(window_weights(np.array([10.0, 11.0, 13.0]))).tolist() == [0.0, 0.25, 0.75]
    assert shares(window_weights(np.full(5, 7.0))).tolist() == [0.2] * 5


def test_rank_weights_share_ties():
    assert rank_weights(np.array([5.0, -1.0, 5.0, 9.0, 0.0])).tolist() == [3.5, 1.0, 3.5, 5.0, 2.0]
    assert rank_weights(np.zeros(3)).tolist() == [2.0, 2.0, 2.0]


def test_roulette_follows_the_weights():
    chosen = roulette(WEIGHTS, 40_000, np.random.default_rng(1))
    counts = np.bincount(chosen, minlength=4)
    assert counts[2] == 0
    assert chisquare(counts[[0, 1, 3]], [5_000, 15_000, 20_000]).pvalue > 0.01


def test_roulette_spins_are_independent():
    chosen = roulette(WEIGHTS, 40_000, np.random.default_rng(2)).reshape(-1, 2)
    pairs = np.bincount(4 * chosen[:, 0] + chosen[:, 1], minlength=16)
    expected = 20_000 * np.outer(shares(WEIGHTS), shares(WEIGHTS)).ravel()
    assert chisquare(pairs[expected > 0], expected[expected > 0]).pvalue > 0.01


def test_stochastic_universal_by_hand():
    # Eight pointers an eighth apart meet these slots 1, 3, 0 and 4 times wherever the first one is.
    for seed in range(20):
        chosen = stochastic_universal(WEIGHTS, 8, np.random.default_rng(seed))
        assert np.bincount(chosen, minlength=4).tolist() == [1, 3, 0, 4]


@given(
    weights=st.lists(st.floats(0.0, 10.0), min_size=1, max_size=30).filter(any),
    n=st.integers(1, 60),
    seed=st.integers(0, 2**32 - 1),
)
def test_stochastic_universal_is_within_one_of_the_share(weights, n, seed):
    weights = np.array(weights)
    counts = np.bincount(
        stochastic_universal(weights, n, np.random.default_rng(seed)), minlength=len(weights)
    )
    assert counts.sum() == n
    assert np.abs(counts - n * shares(weights)).max() < 1.0 + 1e-9


def test_one_pointer_is_a_roulette_wheel():
    rng = np.random.default_rng(9)
    chosen = np.concatenate([stochastic_universal(WEIGHTS, 1, rng) for _ in range(8_000)])
    counts = np.bincount(chosen, minlength=4)
    assert chisquare(counts[[0, 1, 3]], [1_000, 3_000, 4_000]).pvalue > 0.01


def test_stochastic_universal_couples_at_random():
    rng = np.random.default_rng(3)
    chosen = np.concatenate(
        [stochastic_universal(np.ones(4), 4, rng)[:2] for _ in range(6_000)]
    ).reshape(-1, 2)
    pairs = np.bincount(4 * chosen[:, 0] + chosen[:, 1], minlength=16).reshape(4, 4)
    assert np.diag(pairs).sum() == 0
    assert chisquare(pairs[~np.eye(4, dtype=bool)]).pvalue > 0.01
