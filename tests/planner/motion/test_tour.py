"""Orders and branches against brute force, and against rounds whose shortest form is known."""

from itertools import pairwise, permutations, product

import numpy as np
import pytest

from planner.travel import best_branches, exact_order, improved_order, shortest_tour


def costs_of(points, home):
    """Distances between places; each has several branches, which are points; `home` has one."""
    most = max(len(group) for group in points)
    n = len(points) + 1
    places = np.full((n, most, len(home)), np.nan)
    places[0, 0] = home
    for i, group in enumerate(points, 1):
        places[i, : len(group)] = group
    gaps = np.abs(places[:, None, :, None] - places[None, :, None, :]).max(axis=-1)
    return np.where(np.isnan(gaps), np.inf, gaps)


def random_costs(n, seed, most=3):
    rng = np.random.default_rng(seed)
    points = [rng.uniform(-1, 1, (rng.integers(1, most + 1), 3)) for _ in range(n)]
    return costs_of(points, np.zeros(3))


def tour_length(costs, order, branches):
    steps = [(0, 0), *((i + 1, a) for i, a in zip(order, branches, strict=True)), (0, 0)]
    return sum(costs[i, j, a, c] for (i, a), (j, c) in pairwise(steps))


def brute_force(costs):
    n = len(costs) - 1
    branches = [np.flatnonzero(np.isfinite(costs[0, i + 1, 0])) for i in range(n)]
    return min(
        tour_length(costs, order, chosen)
        for order in permutations(range(n))
        for chosen in product(*(branches[i] for i in order))
    )


@pytest.mark.parametrize("seed", range(4))
def test_shortest_over_all_orders_and_branches(seed):
    costs = random_costs(5, seed)
    tour = shortest_tour(costs)
    assert tour.seconds == pytest.approx(brute_force(costs))
    assert tour_length(costs, tour.order, tour.branches) == pytest.approx(tour.seconds)
    assert sorted(tour.order) == list(range(5))


def test_order_and_branch_depend_on_each_other():
    """The branch nearest to home is the wrong one here: the second lies on the way to the others."""
    costs = costs_of([[[-1.0], [2.0]], [[2.1]], [[2.2]]], [0.0])
    tour = shortest_tour(costs)
    assert tour.branches[tour.order.index(0)] == 1
    assert tour.seconds == pytest.approx(4.4)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_settings(n):
    costs = random_costs(n, 3) if n else np.zeros((1, 1, 1, 1))
    tour = shortest_tour(costs)
    assert sorted(tour.order) == list(range(n))
    if n == 1:
        assert tour.seconds == pytest.approx(2 * np.nanmin(costs[0, 1]))


@pytest.mark.parametrize("seed", range(3))
def test_local_search_is_close_to_the_shortest(seed):
    costs = random_costs(9, seed)
    exact = best_branches(costs, exact_order(costs)).seconds
    found = best_branches(costs, improved_order(costs)).seconds
    assert exact - 1e-9 <= found <= 1.05 * exact


def test_places_on_a_circle_are_visited_around_it():
    angles = np.random.default_rng(0).permutation(24) * 2 * np.pi / 24
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    costs = np.zeros((25, 25, 1, 1))
    costs[1:, 1:, 0, 0] = gaps
    costs[0, 1:, 0, 0] = costs[1:, 0, 0, 0] = 1.0
    tour = shortest_tour(costs)
    # home is as far from all: 23 sides of the polygon, and out and back
    assert tour.seconds == pytest.approx(2 + 23 * 2 * np.sin(np.pi / 24))


def neighbours(order):
    n = len(order)
    for i in range(n):
        for j in range(i + 2, n + 1):
            yield order[:i] + order[i:j][::-1] + order[j:]
    for i in range(n):
        for size in (1, 2, 3):
            piece = order[i : i + size]
            rest = order[:i] + order[i + size :]
            for k in range(len(rest) + 1):
                yield rest[:k] + piece + rest[k:]
                yield rest[:k] + piece[::-1] + rest[k:]


def test_no_neighbour_of_a_long_tour_is_shorter():
    costs = random_costs(14, 8)
    order = improved_order(costs)
    length = best_branches(costs, order).seconds
    assert all(best_branches(costs, other).seconds >= length - 1e-9 for other in neighbours(order))


def test_twice_the_same():
    costs = random_costs(15, 2)
    assert shortest_tour(costs) == shortest_tour(costs)


def test_a_setting_out_of_reach_costs_infinitely():
    costs = random_costs(4, 1)
    costs[2] = np.inf
    costs[:, 2] = np.inf
    assert shortest_tour(costs).seconds == np.inf
