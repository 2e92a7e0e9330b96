"""Elites, elimination, replacement, and what is evaluated."""

from dataclasses import replace

import numpy as np
import pytest

from ga.bits import (
    Breeding,
    evaluate,
    first_seen,
    initial_population,
    next_generation,
    proportional_weights,
    roulette,
)

COPY = Breeding(0.0, 0.0, proportional_weights, roulette, 0, True, 5, None)
FLIP = replace(COPY, mutation=1.0)


def rows(*strings):
    return np.array([[c == "1" for c in string] for string in strings])


POPULATION = rows("1110", "0110", "0001", "1000")


def test_only_parents_with_weight_are_copied():
    brood = next_generation(
        POPULATION, np.array([0.0, 3.0, 0.0, 0.0]), COPY, np.random.default_rng(0)
    )
    assert np.array_equal(brood.population, rows("0110", "0110", "0110", "0110"))
    assert (brood.drawn, brood.eliminated, brood.kept) == (4, 0, 0)


def test_elites_come_first_best_first_and_unchanged():
    how = replace(FLIP, elitism=2)
    brood = next_generation(
        POPULATION, np.array([0.0, 0.0, 0.0, 3.0]), how, np.random.default_rng(0)
    )
    assert np.array_equal(brood.population, rows("1000", "1110", "0111", "0111"))
    assert brood.drawn == 2


def test_an_eliminated_place_draws_again():
    # Certain mutation turns 1110 into 0001 and 0110 into 1001: only the second child is let live.
    how = replace(FLIP, attempts=200, feasible=lambda bits: bits[:, 0])
    brood = next_generation(
        POPULATION, np.array([1.0, 1.0, 0.0, 0.0]), how, np.random.default_rng(0)
    )
    assert np.array_equal(brood.population, rows("1001", "1001", "1001", "1001"))
    assert brood.kept == 0
    assert brood.drawn == brood.eliminated + 4
    assert brood.eliminated > 0


def test_a_place_that_draws_in_vain_goes_to_a_parent():
    calls = []

    def feasible(bits):
        calls.append(len(bits))
        return np.zeros(len(bits), dtype=bool)

    how = replace(FLIP, feasible=feasible)
    brood = next_generation(
        POPULATION, np.array([0.0, 1.0, 1.0, 0.0]), how, np.random.default_rng(1)
    )
    assert calls == [4] * 5
    assert (brood.drawn, brood.eliminated, brood.kept) == (20, 20, 4)
    assert all(
        any(np.array_equal(row, parent) for parent in POPULATION[1:3]) for row in brood.population
    )


def test_without_duplicates_all_rows_differ():
    how = replace(COPY, mutation=0.2, duplicates=False, attempts=1000, elitism=1)
    for seed in range(20):
        brood = next_generation(POPULATION, np.arange(4.0), how, np.random.default_rng(seed))
        assert len({row.tobytes() for row in brood.population}) == 4
        assert brood.population[0].tolist() == POPULATION[3].tolist()
        assert brood.eliminated == 0


def test_equal_rows_are_recognised():
    bits = np.zeros((4, 70), dtype=bool)
    bits[[1, 3], 69] = True  # beyond the last full byte
    assert first_seen(bits).tolist() == [0, 1, 0, 1]


def test_only_new_rows_are_evaluated():
    seen = []

    def fitness(bits):
        seen.extend("".join("01"[bit] for bit in row) for row in bits.astype(int))
        return bits.sum(axis=1)

    bits = rows("1111", "0001", "1000", "1111", "1110")
    values, nfev = evaluate(fitness, bits, POPULATION, np.array([30.0, 20.0, 10.0, 11.0]))
    assert values.tolist() == [4.0, 10.0, 11.0, 4.0, 30.0]
    assert (nfev, seen) == (1, ["1111"])


def test_nothing_new_is_no_call():
    values, nfev = evaluate(None, POPULATION[::-1], POPULATION, np.arange(4.0))
    assert values.tolist() == [3.0, 2.0, 1.0, 0.0]
    assert nfev == 0


def test_initial_rows_come_first_then_draws():
    brood = initial_population(
        [[1, 0, 1], [0, 0, 0]], (6, 3), None, 10, False, np.random.default_rng(0)
    )
    assert brood.population.shape == (6, 3)
    assert brood.population[:2].astype(int).tolist() == [[1, 0, 1], [0, 0, 0]]


def test_even_random_bits_by_default():
    brood = initial_population(None, (10_000, 4), None, 1, False, np.random.default_rng(8))
    # Five standard deviations of a binomial count.
    assert np.abs(brood.population.sum(axis=0) - 5_000).max() < 250


def test_a_sampler_is_filtered_and_asked_again():
    asked = []

    def sampler(n, rng):
        asked.append(n)
        return rng.integers(0, 2, (3, 5))

    brood = initial_population(
        sampler, (8, 5), lambda bits: bits[:, 2], 100, False, np.random.default_rng(0)
    )
    assert brood.population[:, 2].all()
    assert set(asked) == {8}
    assert brood.drawn == 3 * len(asked)
    assert brood.drawn - brood.eliminated >= 8


def test_a_distinct_initial_population():
    given = rows("000", "000", "111")
    brood = initial_population(given, (8, 3), None, 100, True, np.random.default_rng(0))
    assert sorted((brood.population @ [4, 2, 1]).tolist()) == list(range(8))
    assert np.array_equal(brood.population[:2], rows("000", "111"))


@pytest.mark.parametrize("seed", range(3))
def test_no_population_is_changed_in_place(seed):
    before = POPULATION.copy()
    next_generation(
        POPULATION, np.ones(4), replace(FLIP, crossover=0.9), np.random.default_rng(seed)
    )
    assert np.array_equal(POPULATION, before)
