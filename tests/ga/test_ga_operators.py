"""Crossover and mutation on hand-made parents, then a whole offspring step against its exact distribution."""

import itertools

import numpy as np
import pytest
from scipy.stats import chisquare

from ga.bits import (
    Breeding,
    breed,
    draw_cuts,
    exchange_tails,
    flip_bits,
    one_point,
    proportional_weights,
    roulette,
)


def rows(*strings):
    return np.array([[c == "1" for c in string] for string in strings])


def test_exchange_tails():
    first = rows("11111", "11111", "10101", "11111")
    second = rows("00000", "00000", "01010", "00000")
    left, right = exchange_tails(first, second, np.array([1, 4, 2, 5]))
    assert np.array_equal(left, rows("10000", "11110", "10010", "11111"))
    assert np.array_equal(right, rows("01111", "00001", "01101", "00000"))


def test_one_point_interleaves_the_children_of_each_couple():
    first = rows("1111", "1100")
    second = rows("0000", "0011")
    children = one_point(first, second, 0.0, np.random.default_rng(0))
    assert np.array_equal(children, rows("1111", "0000", "1100", "0011"))


def test_a_certain_crossover_cuts_everywhere_alike_but_never_at_the_ends():
    cuts = draw_cuts(36_000, 10, 1.0, np.random.default_rng(4))
    counts = np.bincount(cuts, minlength=11)
    assert counts[[0, 10]].tolist() == [0, 0]
    assert chisquare(counts[1:10]).pvalue > 0.01


def test_crossover_happens_with_its_probability():
    cuts = draw_cuts(20_000, 10, 0.7, np.random.default_rng(5))
    crossed = int((cuts < 10).sum())
    assert chisquare([crossed, 20_000 - crossed], [14_000, 6_000]).pvalue > 0.01


def test_one_bit_cannot_be_cut():
    assert np.array_equal(
        one_point(rows("1"), rows("0"), 1.0, np.random.default_rng(0)), rows("1", "0")
    )


@pytest.mark.parametrize("seed", range(5))
def test_crossover_keeps_the_bits_of_every_place(seed):
    rng = np.random.default_rng(seed)
    parents = rng.random((2, 50, 13)) < 0.5
    children = one_point(*parents, 0.9, rng).reshape(50, 2, 13)
    assert np.array_equal(children.sum(axis=1), parents.sum(axis=0))


def test_mutation_at_its_ends():
    bits = rows("1010", "0000")
    assert np.array_equal(flip_bits(bits, 0.0, np.random.default_rng(0)), bits)
    assert np.array_equal(flip_bits(bits, 1.0, np.random.default_rng(0)), rows("0101", "1111"))
    assert np.array_equal(bits, rows("1010", "0000"))


def test_every_bit_mutates_alike_and_by_itself():
    flipped = flip_bits(np.zeros((30_000, 3), dtype=bool), 0.2, np.random.default_rng(6))
    counts = np.bincount(flipped @ [4, 2, 1], minlength=8)
    expected = [30_000 * 0.2**k * 0.8 ** (3 - k) for k in (0, 1, 1, 2, 1, 2, 2, 3)]
    assert chisquare(counts, expected).pvalue > 0.01


def exact_offspring_distribution(population, fitness, crossover, mutation):
    """Chance of every bit string as first child, by summing over parents, cuts and mutation masks."""
    n_bits = population.shape[1]
    chance = dict.fromkeys(itertools.product([False, True], repeat=n_bits), 0.0)
    share = fitness / fitness.sum()
    ways = [(n_bits, 1.0 - crossover)] + [
        (cut, crossover / (n_bits - 1)) for cut in range(1, n_bits)
    ]
    for (i, a), (j, b), (cut, way) in itertools.product(
        enumerate(population), enumerate(population), ways
    ):
        child = [*a[:cut], *b[cut:]]
        for mask in itertools.product([False, True], repeat=n_bits):
            mutated = tuple(bool(bit) != flip for bit, flip in zip(child, mask, strict=True))
            flips = sum(mask)
            chance[mutated] += (
                share[i] * share[j] * way * mutation**flips * (1 - mutation) ** (n_bits - flips)
            )
    return np.array([chance[key] for key in sorted(chance)])


@pytest.mark.parametrize(
    ("crossover", "mutation"), [(0.9, 0.1), (0.5, 0.5), (0.3, 0.02), (1.0, 0.0)]
)
def test_offspring_have_the_exact_distribution(crossover, mutation):
    population = rows("1110", "0110", "0001", "1000")
    fitness = np.array([4.0, 2.0, 1.0, 1.0])
    how = Breeding(crossover, mutation, proportional_weights, roulette, 0, True, 1, None)
    children, parents = breed(population, how.weigh(fitness), 40_000, how, np.random.default_rng(7))
    counts = np.bincount(children[0::2] @ [8, 4, 2, 1], minlength=16)
    expected = 20_000 * exact_offspring_distribution(population, fitness, crossover, mutation)
    possible = expected > 0
    assert counts[~possible].sum() == 0
    assert chisquare(counts[possible], expected[possible]).pvalue > 0.01
    assert chisquare(np.bincount(parents, minlength=4), 5_000 * fitness).pvalue > 0.01


def test_an_odd_number_of_offspring():
    how = Breeding(1.0, 0.0, proportional_weights, roulette, 0, True, 1, None)
    children, parents = breed(
        rows("11", "00"), np.array([1.0, 0.0]), 3, how, np.random.default_rng(0)
    )
    assert np.array_equal(children, rows("11", "11", "11"))
    assert parents.tolist() == [0, 0, 0]
