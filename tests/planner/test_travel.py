"""Orders of poses, and rounds with branches, against brute force and against shapes whose shortest way is known."""

from itertools import pairwise, permutations, product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planner import RequestError
from planner.travel import (
    best_branches,
    exact_order,
    improved_order,
    order_by,
    pose_distances,
    shortest_tour,
    travel_order,
)


def poses_at(positions, rotation_vectors=None):
    positions = np.asarray(positions, dtype=float)
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    if rotation_vectors is not None:
        poses[:, :3, :3] = Rotation.from_rotvec(rotation_vectors).as_matrix()
    return poses


def random_poses(n, seed=0):
    rng = np.random.default_rng(seed)
    return poses_at(rng.uniform(-500, 500, (n, 3)), rng.normal(size=(n, 3)))


def path_length(distances, order):
    path = list(order)
    return distances[path[:-1], path[1:]].sum()


def improved_path(distances):
    """What is done beyond twelve poses: a round whose home is near all of them."""
    costs = np.pad(distances, ((1, 0), (1, 0)))[:, :, None, None]
    return [place - 1 for place in improved_order(costs)]


def test_distance_adds_travel_and_turn():
    poses = poses_at([(0, 0, 0), (3, 4, 0)], [(0, 0, 0), (0, 0, np.pi / 2)])
    assert pose_distances(poses, radian_mm=10.0)[0, 1] == pytest.approx(5.0 + 10.0 * np.pi / 2)


def test_distances_are_a_metric():
    d = pose_distances(random_poses(9))
    assert np.array_equal(d, d.T)
    assert np.all(np.diag(d) == 0)
    assert np.all(d[:, None, :] <= d[:, :, None] + d[None, :, :] + 1e-9)


def test_points_on_a_line_are_visited_along_it():
    assert travel_order(poses_at([(5, 0, 0), (1, 0, 0), (9, 0, 0), (3, 0, 0)])) == (1, 3, 0, 2)


def test_orientation_alone_decides_where_positions_agree():
    turns = [(0, 0, 0), (0, 0, 1.2), (0, 0, 0.4), (0, 0, 0.8)]
    assert travel_order(poses_at(np.zeros((4, 3)), turns)) == (0, 2, 3, 1)


@pytest.mark.parametrize("seed", range(4))
def test_shortest_path_equals_exhaustive_search(seed):
    d = pose_distances(random_poses(7, seed))
    best = min(path_length(d, order) for order in permutations(range(7)))
    assert path_length(d, order_by(d)) == pytest.approx(best)


@pytest.mark.parametrize("seed", range(3))
def test_improved_path_is_close_to_the_shortest(seed):
    d = pose_distances(random_poses(11, seed))
    exact = path_length(d, order_by(d))
    assert exact - 1e-9 <= path_length(d, improved_path(d)) <= 1.05 * exact


@pytest.mark.parametrize("n", [0, 1, 2, 3, 12, 20])
def test_every_pose_is_visited_once(n):
    assert sorted(travel_order(random_poses(n))) == list(range(n))


def test_many_poses_beat_the_given_order():
    d = pose_distances(random_poses(25))
    order = travel_order(random_poses(25))
    assert path_length(d, order) < 0.7 * path_length(d, range(25))


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


@pytest.mark.parametrize("shape", [(4,), (16,), (2, 3), (3, 4), (2, 2, 4, 4)])
def test_poses_of_another_shape_are_refused(shape):
    with pytest.raises(RequestError) as caught:
        travel_order(np.zeros(shape))
    assert str(caught.value) == f"cam2worlds must have the shape (n, 4, 4). Got {shape}."
    assert travel_order([]) == ()
