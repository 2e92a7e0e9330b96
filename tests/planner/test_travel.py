from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planner.travel import improved_order, order_by, pose_distances, travel_order


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
