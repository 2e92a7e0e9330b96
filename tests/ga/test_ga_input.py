"""Each bad input gives one clear error, which is also a ValueError."""

import re

import numpy as np
import pytest

from ga import FitnessError, GAError, InfeasiblePopulationError, ParameterError, maximize


def onemax(bits):
    return bits.sum(axis=1)


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
