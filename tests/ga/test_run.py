"""Runs as a whole: guarantees, ends, and problems with known optima."""

import doctest
import importlib
import pickle
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ga import (
    Chromosome,
    FitnessError,
    GAError,
    InfeasiblePopulationError,
    ParameterError,
    maximize,
)
from ga.run import settled

STRONG = {"elitism": 2, "scaling": "rank", "selection": "sus", "mutation": 0.02}


def onemax(bits):
    return bits.sum(axis=1)


def first_or_last(bits):
    return bits[:, 0] | bits[:, -1]


def same(a, b):
    numbers = all(
        np.array_equal(getattr(a.history, name), getattr(b.history, name))
        for name in vars(a.history)
    )
    bits = np.array_equal(a.x, b.x) and np.array_equal(a.population, b.population)
    return (
        numbers and bits and (a.fun, a.nit, a.nfev, a.message) == (b.fun, b.nit, b.nfev, b.message)
    )


@pytest.mark.parametrize("seed", range(5))
def test_onemax_is_solved(seed):
    result = maximize(onemax, 64, rng=seed, max_stall=60, **STRONG)
    assert result.fun == 64.0
    assert result.x.all()


@pytest.mark.parametrize("seed", range(3))
def test_onemax_is_solved_by_the_plain_algorithm(seed):
    result = maximize(onemax, 16, mutation=0.05, rng=seed, max_generations=300)
    assert result.fun == 16.0


@pytest.mark.parametrize("seed", range(5))
def test_rastrigin_is_solved(seed):
    chromosome = Chromosome(4, 12, gray=True)

    def rastrigin(x):
        return 10.0 * x.shape[-1] + (x**2 - 10.0 * np.cos(2.0 * np.pi * x)).sum(axis=-1)

    result = maximize(
        lambda bits: -rastrigin(chromosome.decode(bits, -5.12, 5.12)),
        chromosome.n_bits,
        rng=seed,
        max_stall=120,
        **STRONG,
    )
    # 2**12 values lie symmetrically about 0, half a step 5.12 / 4095 away: the best of the grid.
    assert result.fun == pytest.approx(-rastrigin(np.full(4, 5.12 / 4095)), abs=1e-9)


def test_a_constrained_optimum():
    # At most five ones: the best string has exactly five. Even random bits would hardly ever be feasible.
    result = maximize(
        onemax,
        30,
        feasible=lambda bits: bits.sum(axis=1) <= 5,
        initial=lambda n, rng: rng.random((n, 30)) < 0.1,
        max_generations=50,
    )
    assert result.fun == 5.0
    assert (result.population.sum(axis=1) <= 5).all()
    assert result.history.eliminated.sum() > 0


@pytest.mark.parametrize(
    "options", [{}, STRONG, {"duplicates": False}, {"feasible": first_or_last}]
)
def test_same_seed_same_bits(options):
    first, again, other = (
        maximize(onemax, 40, rng=seed, max_generations=30, **options) for seed in (3, 3, 4)
    )
    assert same(first, again)
    assert not same(first, other)
    assert first.seed == 3


def test_a_generator_is_used_as_it_is():
    a = maximize(onemax, 20, rng=np.random.default_rng(5), max_generations=20)
    b = maximize(onemax, 20, rng=5, max_generations=20)
    assert same(a, b)
    assert (a.seed, b.seed) == (None, 5)


def test_a_fresh_seed_repeats_the_run():
    a = maximize(onemax, 20, rng=None, max_generations=5)
    assert same(a, maximize(onemax, 20, rng=a.seed, max_generations=5))
    assert not same(a, maximize(onemax, 20, rng=None, max_generations=5))


@settings(deadline=None, max_examples=60)
@given(
    n_bits=st.integers(5, 70),
    population=st.integers(2, 15),
    crossover=st.floats(0.0, 1.0),
    mutation=st.floats(0.0, 1.0),
    selection=st.sampled_from(["roulette", "sus"]),
    scaling=st.sampled_from(["proportional", "window", "rank"]),
    elitism=st.integers(0, 1),
    duplicates=st.booleans(),
    offset=st.sampled_from([0.0, -3.0, -1e6]),
    seed=st.integers(0, 2**32 - 1),
)
def test_guarantees(n_bits, population, offset, seed, **options):
    generations = []
    asked = set()
    evaluated = []

    def feasible(bits):
        asked.update(row.tobytes() for row in bits)
        return first_or_last(bits)

    def fitness(bits):
        keys = [row.tobytes() for row in bits]
        assert first_or_last(bits).all()
        assert len(set(keys)) == len(keys)
        assert asked.issuperset(keys)
        if generations:
            assert not set(keys) & {row.tobytes() for row in generations[-1].population}
        evaluated.append(len(keys))
        return onemax(bits) + offset

    result = maximize(
        fitness, n_bits, population, feasible=feasible, rng=seed, max_generations=8, attempts=3,
        callback=generations.append, **options,
    )  # fmt: skip
    for generation in generations:
        assert generation.population.shape == (population, n_bits)
        assert first_or_last(generation.population).all()
        assert np.array_equal(generation.fitness, onemax(generation.population) + offset)
    assert (
        result.fun
        == max(generation.fitness.max() for generation in generations)
        == onemax(result.x[None])[0] + offset
    )
    assert result.nfev == sum(evaluated) == result.history.nfev[-1]
    assert len(evaluated) <= result.nit + 1 == len(generations) == len(result.history.best)


def test_history_matches_the_generations():
    seen = []
    result = maximize(
        onemax, 25, population=7, feasible=first_or_last, max_generations=12, callback=seen.append
    )
    history = result.history
    assert history.best.tolist() == [g.fitness.max() for g in seen]
    assert history.total.tolist() == [g.fitness.sum() for g in seen]
    assert history.mean == pytest.approx(history.total / 7)
    assert history.nfev.tolist() == [g.nfev for g in seen]
    assert history.best_so_far.tolist() == [g.fun for g in seen]
    assert [g.nit for g in seen] == list(range(13))
    assert ((history.drawn - history.eliminated + history.kept)[1:] == 7).all()
    assert np.array_equal(result.population, seen[-1].population)
    assert np.array_equal(result.fitness, seen[-1].fitness)


def test_elitism_never_loses_the_best():
    best = maximize(onemax, 30, mutation=0.3, elitism=1, max_generations=60).history.best
    assert (np.diff(best) >= 0).all()


def test_the_best_is_returned_even_if_it_died():
    result = maximize(onemax, 30, mutation=0.5, max_generations=60)
    assert result.fun == result.history.best.max() > result.history.best[-1]
    assert result.x.sum() == result.fun


def test_callers_cannot_change_a_population():
    def meddle(generation):
        generation.population[0] = True

    with pytest.raises(ValueError, match="read-only"):
        maximize(onemax, 8, callback=meddle)


def test_results_can_be_pickled():
    result = maximize(onemax, 8, max_generations=3)
    assert same(pickle.loads(pickle.dumps(result)), result)


def test_converged():
    result = maximize(lambda bits: np.full(len(bits), 0.5), 8, patience=4)
    assert (result.success, result.reason, result.nit) == (True, "converged", 4)
    assert (
        result.message
        == "The total fitness changed by less than epsilon = 0.001 in 4 generations running."
    )


@pytest.mark.parametrize(
    ("totals", "epsilon", "expected"),
    [
        ([9.0, 1.0, 1.4, 0.95], 0.5, True),  # the last two changes are +0.4 and -0.45
        ([1.0, 1.0, 1.4, 0.85], 0.5, False),  # the last is -0.55
        ([1.0, 1.6, 1.4], 0.5, False),  # the first of the two is +0.6
        ([1.0, 1.25, 1.0], 0.25, False),  # not less than epsilon
        ([1.0, 1.0, 1.0], 0.0, True),  # no change at all
        ([1.0, 1.0], 0.5, False),  # too few generations
    ],
)
def test_settled(totals, epsilon, expected):
    assert settled(totals, epsilon, patience=2) is expected


def test_stalled():
    result = maximize(lambda bits: np.zeros(len(bits)), 8, patience=50, max_stall=7)
    assert (result.success, result.reason, result.nit) == (True, "stalled", 7)


def test_target():
    result = maximize(onemax, 40, target=30.0, elitism=1)
    assert (result.success, result.reason) == (True, "target")
    assert result.history.best_so_far[-1] >= 30.0 > result.history.best_so_far[-2]


def test_cap_on_generations():
    result = maximize(onemax, 40, max_generations=6)
    assert (result.success, result.reason, result.nit) == (False, "max_generations", 6)


def test_cap_on_evaluations():
    result = maximize(onemax, 60, population=20, max_nfev=87)
    assert (result.success, result.reason) == (False, "max_nfev")
    assert 67 < result.nfev <= 87
    assert maximize(onemax, 60, population=20, max_nfev=20).nit == 0
    assert maximize(onemax, 60, population=20, max_nfev=29, elitism=10).nit == 0
    assert maximize(onemax, 60, population=20, max_nfev=30, elitism=10).nit >= 1


def test_callback_stops():
    result = maximize(onemax, 40, callback=lambda generation: generation.nit == 3)
    assert (result.success, result.reason, result.nit) == (False, "callback", 3)


def test_stop_iteration_stops():
    def stop(generation):
        raise StopIteration

    assert maximize(onemax, 40, callback=stop).nit == 0


def test_a_single_bit():
    assert maximize(lambda bits: bits[:, 0] * 2.0, 1, population=2, mutation=0.5, rng=1).fun == 2.0


def test_the_example_of_the_docstring():
    outcome = doctest.testmod(importlib.import_module("ga.run"))
    assert (outcome.attempted, outcome.failed) == (3, 0)


# Each bad input gives one clear error, which is also a ValueError.


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fitness": 3}, "fitness must be callable. Got 3."),
        ({"feasible": "x"}, "feasible must be callable or None. Got 'x'."),
        ({"callback": 1}, "callback must be callable or None. Got 1."),
        ({"n_bits": 0}, "n_bits must be an integer of at least 1. Got 0."),
        ({"n_bits": 8.0}, "n_bits must be an integer of at least 1. Got 8.0."),
        ({"population": 1}, "population must be an integer of at least 2. Got 1."),
        ({"population": True}, "population must be an integer of at least 2. Got True."),
        (
            {"population": 9, "n_bits": 3, "duplicates": False},
            "at most 2**n_bits = 8 without duplicates. Got 9.",
        ),
        ({"crossover": 1.2}, "crossover must be in [0, 1]. Got 1.2."),
        ({"crossover": float("nan")}, "crossover must be in [0, 1]. Got nan."),
        ({"mutation": -0.1}, "mutation must be in [0, 1]. Got -0.1."),
        ({"mutation": "0.1"}, "mutation must be in [0, 1]. Got '0.1'."),
        ({"rng": -1}, "rng must be a non-negative integer, a numpy Generator or None. Got -1."),
        ({"rng": 1.5}, "rng must be a non-negative integer, a numpy Generator or None. Got 1.5."),
        (
            {"selection": "tournament"},
            "selection must be one of 'roulette', 'sus'. Got 'tournament'.",
        ),
        ({"scaling": None}, "scaling must be one of 'proportional', 'window', 'rank'. Got None."),
        ({"elitism": 10}, "elitism must be an integer in [0, 9]. Got 10."),
        ({"duplicates": 1}, "duplicates must be True or False. Got 1."),
        ({"epsilon": -1.0}, "epsilon must be finite and not negative. Got -1.0."),
        ({"epsilon": float("inf")}, "epsilon must be finite and not negative. Got inf."),
        ({"patience": 0}, "patience must be an integer of at least 1. Got 0."),
        ({"target": float("nan")}, "target must be a finite number. Got nan."),
        ({"max_stall": 0}, "max_stall must be an integer of at least 1. Got 0."),
        ({"max_generations": 0}, "max_generations must be an integer of at least 1. Got 0."),
        ({"max_nfev": 9}, "max_nfev must be an integer of at least 10. Got 9."),
        ({"attempts": 0}, "attempts must be an integer of at least 1. Got 0."),
        ({"initial_attempts": 0}, "initial_attempts must be an integer of at least 1. Got 0."),
        (
            {"initial": np.zeros((2, 7))},
            "initial must have 8 bits along its last axis. Got shape (2, 7).",
        ),
        ({"initial": np.zeros(8)}, "initial must have shape (N, 8). Got shape (8,)."),
        (
            {"initial": np.zeros((11, 8))},
            "initial must have at most 10 rows, the population size. Got 11.",
        ),
        ({"initial": np.full((2, 8), 0.5)}, "initial must hold only 0 and 1. Got 0.5."),
        ({"initial": [[0] * 8, [1]]}, "initial must have 8 bits along its last axis."),
        (
            {"initial": lambda n, rng: np.zeros((n, 3))},
            "initial(n, rng) must have 8 bits along its last axis.",
        ),
    ],
)
def test_parameters(options, message):
    arguments = {"fitness": onemax, "n_bits": 8, "population": 10} | options
    with pytest.raises(ParameterError, match=re.escape(message)) as caught:
        maximize(**arguments)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, GAError)


@pytest.mark.parametrize(
    ("fitness", "message"),
    [
        (
            lambda bits: np.where(np.arange(len(bits)) == 4, np.nan, 1.0),
            "fitness must be finite. Got nan for individual 4",
        ),
        (
            lambda bits: np.full(len(bits), -np.inf),
            "fitness must be finite. Got -inf for individual 0",
        ),
        (lambda bits: 1.0, "fitness must return one number per individual"),
        (lambda bits: bits, "fitness must return one number per individual"),
        (lambda bits: None, "fitness must return one number per individual"),
        (lambda bits: [[1.0], [1.0, 2.0]], "fitness must return one number per individual"),
        (
            lambda bits: np.ones(len(bits), dtype=complex),
            "fitness must return one number per individual",
        ),
    ],
)
def test_fitness_values(fitness, message):
    with pytest.raises(FitnessError, match=re.escape(message)):
        maximize(fitness, 30, population=10)


@pytest.mark.parametrize(
    "feasible",
    [
        lambda bits: True,
        lambda bits: np.ones(len(bits)),
        lambda bits: bits,
        lambda bits: np.ones(3, dtype=bool),
    ],
)
def test_feasible_values(feasible):
    with pytest.raises(FitnessError, match="feasible must return one bool per individual, shape"):
        maximize(onemax, 8, population=10, feasible=feasible)


def test_nothing_is_feasible():
    message = "initial population must hold 10 feasible individuals. Got 0 after 30 draws, 30 of them infeasible."
    with pytest.raises(InfeasiblePopulationError, match=re.escape(message)):
        maximize(
            onemax, 8, 10, feasible=lambda bits: np.zeros(len(bits), dtype=bool), initial_attempts=3
        )


def test_given_individuals_are_infeasible():
    message = (
        "initial must hold only feasible individuals. Got 1 infeasible of 2, the first in row 1."
    )
    with pytest.raises(InfeasiblePopulationError, match=re.escape(message)):
        maximize(onemax, 3, 10, initial=[[1, 0, 0], [0, 1, 0]], feasible=lambda bits: bits[:, 0])


def test_a_sampler_that_repeats_itself_cannot_fill_a_distinct_population():
    message = "initial population must hold 10 distinct feasible individuals. Got 1 after 20 draws"
    with pytest.raises(InfeasiblePopulationError, match=re.escape(message)):
        maximize(
            onemax,
            8,
            10,
            initial=lambda n, rng: np.zeros((n, 8)),
            duplicates=False,
            initial_attempts=2,
        )


@pytest.mark.parametrize("value", [0.0, -2.5, 7.0])
def test_a_flat_fitness_of_any_sign_runs_to_convergence(value):
    result = maximize(lambda bits: np.full(len(bits), value), 8, population=10)
    assert (result.fun, result.reason) == (value, "converged")
