"""The evolution strategy finds optima that are known by hand."""

import numpy as np
import pytest

from planner.search.evolution import Schedule, evolve, triangular_factor

LONG = Schedule(population=16, generations=400, patience=400)


def stretched(points):
    """Largest at 1 in every coordinate; its widths differ by a factor of 300."""
    return -(np.logspace(0, 5, 6) * (points - 1.0) ** 2).sum(axis=1)


def rosenbrock(points):
    """Largest, 0, at 1 in every coordinate, at the end of a bent valley."""
    steps = points[:, 1:] - points[:, :-1] ** 2
    return -(100.0 * steps**2 + (1.0 - points[:, :-1]) ** 2).sum(axis=1)


@pytest.mark.parametrize("function", [stretched, rosenbrock])
def test_the_known_optimum_is_found(function):
    point, value = evolve(function, np.zeros(6), 0.3, np.random.default_rng(1), LONG)
    np.testing.assert_allclose(point, 1.0, atol=1e-3)
    assert -1e-4 < value <= 0.0


def test_the_start_is_returned_where_nothing_is_better():
    """Of a function that is largest at the start."""
    start = np.array([0.3, -0.2])
    point, value = evolve(
        lambda points: -np.abs(points - start).sum(axis=1),
        start,
        0.1,
        np.random.default_rng(0),
        LONG,
    )
    assert (point == start).all()
    assert value == 0.0


def test_what_is_not_confirmed_is_not_returned():
    """Beyond 0.5 the value is a mirage, which only the confirmation knows."""
    point, _ = evolve(
        lambda points: points[:, 0],
        np.zeros(2),
        0.2,
        np.random.default_rng(0),
        LONG,
        confirm=lambda points: points[:, 0] <= 0.5,
    )
    assert 0.2 < point[0] <= 0.5


def test_the_same_seed_gives_the_same_point():
    runs = [
        evolve(rosenbrock, np.zeros(4), 0.3, np.random.default_rng(5), LONG)[0] for _ in range(2)
    ]
    assert (runs[0] == runs[1]).all()


def test_the_factor_is_that_of_the_covariance_and_spans_what_has_spread():
    """L Lᵀ = C, also where C has no full rank; LAPACK is the referee."""
    mixing = np.random.default_rng(3).normal(size=(6, 6))
    full = mixing @ mixing.T
    np.testing.assert_allclose(triangular_factor(full), np.linalg.cholesky(full), rtol=1e-9)
    flat = np.diag([4.0, 0.0, 9.0])
    np.testing.assert_array_equal(triangular_factor(flat), np.diag([2.0, 0.0, 3.0]))
