"""Genes, integers and Gray code against tables written by hand."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from ga import Chromosome, ParameterError, binary_from_gray, gray_from_binary
from ga.bits import (
    Breeding,
    breed,
    draw_cuts,
    evaluate,
    exchange_tails,
    first_seen,
    flip_bits,
    initial_population,
    next_generation,
    one_point,
    proportional_weights,
    rank_weights,
    roulette,
    spin,
    stochastic_universal,
    window_weights,
)

BINARY = ["000", "001", "010", "011", "100", "101", "110", "111"]
GRAY = ["000", "001", "011", "010", "110", "111", "101", "100"]


def rows_of(strings):
    return np.array([[c == "1" for c in string] for string in strings])


def test_gray_code_table():
    assert np.array_equal(gray_from_binary(rows_of(BINARY)), rows_of(GRAY))
    assert np.array_equal(binary_from_gray(rows_of(GRAY)), rows_of(BINARY))


def test_gray_neighbours_differ_in_one_bit():
    chromosome = Chromosome(1, 10, gray=True)
    bits = chromosome.bits_from_integers(np.arange(1024)[:, None])
    assert np.array_equal((bits[1:] != bits[:-1]).sum(axis=1), np.ones(1023))


def test_genes_are_read_most_significant_bit_first():
    bits = rows_of(["011100", "110001"])
    assert Chromosome(2, 3).integers(bits).tolist() == [[3, 4], [6, 1]]
    assert Chromosome(3, 2).integers(bits).tolist() == [[1, 3, 0], [3, 0, 1]]
    assert Chromosome(2, 3, gray=True).integers(bits).tolist() == [[2, 7], [4, 1]]
    assert Chromosome(2, 3).genes(bits)[1].astype(int).tolist() == [[1, 1, 0], [0, 0, 1]]


def test_a_single_chromosome_needs_no_population_axis():
    assert Chromosome(2, 3).integers(rows_of(["011100"])[0]).tolist() == [3, 4]


def test_fractions_reach_both_ends():
    assert Chromosome(2, 3).fractions(rows_of(["000111", "001100"])).tolist() == [
        [0.0, 1.0],
        [1 / 7, 4 / 7],
    ]


def test_decode_returns_the_ends_exactly():
    low = np.array([-0.1, 0.3])
    high = np.array([0.7, 1e9])
    decoded = Chromosome(2, 5).decode(rows_of(["0000011111", "1111100000"]), low, high)
    assert decoded.tolist() == [[-0.1, 1e9], [0.7, 0.3]]


def test_decode_with_one_range_for_all_genes():
    assert Chromosome(2, 2).decode(rows_of(["0110"]), 0.0, 3.0) == pytest.approx(
        np.array([[1.0, 2.0]])
    )


def test_longest_gene_is_exact():
    chromosome = Chromosome(1, 53)
    top = np.array([[2**53 - 1], [2**52 + 1]])
    assert np.array_equal(chromosome.integers(chromosome.bits_from_integers(top)), top)


@given(
    n_genes=st.integers(1, 6),
    bits_per_gene=st.integers(1, 20),
    gray=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_encoding_and_decoding_are_inverse(n_genes, bits_per_gene, gray, seed):
    chromosome = Chromosome(n_genes, bits_per_gene, gray)
    rng = np.random.default_rng(seed)
    bits = rng.random((7, chromosome.n_bits)) < 0.5
    assert np.array_equal(chromosome.bits_from_integers(chromosome.integers(bits)), bits)
    assert np.array_equal(chromosome.encode(chromosome.fractions(bits)), bits)
    t = rng.random((7, n_genes))
    assert (
        np.abs(chromosome.fractions(chromosome.encode(t)) - t).max()
        <= 0.5 / (2**bits_per_gene - 1) + 1e-15
    )


def test_every_integer_once():
    chromosome = Chromosome(2, 2, gray=True)
    bits = np.array(list(itertools.product([False, True], repeat=4)))
    assert sorted(map(tuple, chromosome.integers(bits).tolist())) == list(
        itertools.product(range(4), repeat=2)
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Chromosome(0, 4), r"n_genes must be an integer of at least 1\. Got 0\."),
        (lambda: Chromosome(2, 54), r"bits_per_gene must be an integer in \[1, 53\]\. Got 54\."),
        (lambda: Chromosome(2, 4, gray="yes"), r"gray must be True or False\. Got 'yes'\."),
        (
            lambda: Chromosome(2, 4).integers(np.zeros((3, 7))),
            r"bits must have 8 bits .* Got shape \(3, 7\)\.",
        ),
        (lambda: Chromosome(1, 2).integers([[0, 2]]), r"bits must hold only 0 and 1\. Got 2\."),
        (
            lambda: Chromosome(1, 2).integers([["0", "1"]]),
            r"bits must hold only 0 and 1\. Got an array of <U1\.",
        ),
        (
            lambda: gray_from_binary(1),
            r"bits must have bits along its last axis\. Got shape \(\)\.",
        ),
        (lambda: binary_from_gray([0, 3]), r"bits must hold only 0 and 1\. Got 3\."),
        (lambda: Chromosome(1, 2).encode([1.5]), r"fractions must be in \[0, 1\]\. Got 1\.5\."),
        (lambda: Chromosome(1, 2).encode([np.nan]), r"fractions must be in \[0, 1\]\. Got nan\."),
        (
            lambda: Chromosome(2, 2).encode([0.5]),
            r"fractions must have 2 genes .* Got shape \(1,\)\.",
        ),
        (
            lambda: Chromosome(1, 2).bits_from_integers([4]),
            r"integers must be integers in \[0, 3\]\. Got 4\.",
        ),
        (
            lambda: Chromosome(1, 2).bits_from_integers([0.5]),
            r"integers in \[0, 3\]\. Got an array of float64\.",
        ),
        (
            lambda: Chromosome(1, 2).decode([0, 1], 0.0, np.inf),
            r"high must be one finite number.*Got inf\.",
        ),
        (
            lambda: Chromosome(1, 2).decode([0, 1], 2.0, 1.0),
            r"low must not be above high\. Got 2\.0 and 1\.0\.",
        ),
        (
            lambda: Chromosome(2, 1).decode([0, 1], [0.0, 0.0, 0.0], 1.0),
            r"low must be one .* each of 2 genes",
        ),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


# Crossover and mutation on hand-made parents, then a whole offspring step against its exact
# distribution.


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


# Wheels spun by hand, and the statistics of many spins.


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


# Elites, elimination, replacement, and what is evaluated.


COPY = Breeding(0.0, 0.0, proportional_weights, roulette, 0, True, 5, None)
FLIP = replace(COPY, mutation=1.0)


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
