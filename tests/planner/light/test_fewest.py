"""The bound on lamps against all covers, and the spaces of lamps against points drawn in them."""

from itertools import combinations

import numpy as np
import pytest

from aspectgraph.cells.cell_set import Cell
from planner.light.fewest import Search
from planner.light.lamps import LampBox, LampDome


@pytest.mark.parametrize("seed", range(40))
def test_the_bound_is_the_least_cover_by_all_places(seed):
    """Only some places are known at first; ``decide`` finds another, or says truly that there is none."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    places = np.concatenate([rng.random((12, n)) < rng.uniform(0.1, 0.6), np.eye(n, dtype=bool)])
    known = [np.eye(n, dtype=bool)[i] for i in range(n)]

    def decide(jobs):
        able = places[places[:, sorted(jobs)].all(axis=1)]
        known.extend(able[:1])
        return not len(able)

    bound = Search(n, lambda: np.array(known), decide).bound()
    least = next(k for k in range(1, n + 1) for some in combinations(places, k) if np.any(some, axis=0).all())
    assert bound == least
    assert any(np.any(some, axis=0).all() for some in combinations(np.unique(known, axis=0), least))


def test_what_stays_open_does_not_raise_the_bound():
    """Nothing is found and nothing refuted: one place might do all."""
    assert Search(5, lambda: np.eye(5, dtype=bool), lambda jobs: False).bound() == 1


@pytest.mark.parametrize("n", [15, 20])
def test_of_many_jobs_those_that_exclude_each_other_count(n):
    """Jobs exclude each other unless their numbers agree modulo 3."""

    def refuted(jobs):
        i, j = jobs
        return i % 3 != j % 3

    assert Search(n, lambda: np.eye(n, dtype=bool), refuted).bound() == 3


def random_cell(rng):
    """A tetrahedron about a random place."""
    corners = rng.normal(size=(4, 3)) * rng.uniform(0.1, 2) + rng.normal(size=3)
    rows = []
    for k in range(4):
        a, b, c = np.delete(corners, k, axis=0)
        normal = np.cross(b - a, c - a)
        normal *= -np.sign(normal @ (corners[k] - a)) / np.linalg.norm(normal)
        rows.append([*normal, -normal @ a])
    return Cell(np.array(rows), corners, 1.0)


def inside(cell, points):
    return (points @ cell.half_spaces[:, :3].T + cell.half_spaces[:, 3] <= 0).all(axis=1)


@pytest.mark.parametrize("space", [LampBox((-1, -1, 0), (1, 0.5, 1)), LampDome((0, 0, 0), 1.0, -0.2)])
def test_a_cell_that_is_said_to_miss_holds_no_place(space):
    rng = np.random.default_rng(5)
    places = space.places(4000)
    low, high = space.bounds
    assert ((places >= low - 1e-9) & (places <= high + 1e-9)).all()
    missed = met = 0
    for _ in range(300):
        cell = random_cell(rng)
        if space.misses(cell):
            assert not inside(cell, places).any()
            missed += 1
        found = space.places_in(cell)
        assert inside(cell, found).all()
        if len(found):
            met += 1
            assert ((found >= low - 1e-9) & (found <= high + 1e-9)).all()
        else:
            assert inside(cell, places).mean() < 0.005
    assert missed > 60
    assert met > 60


def test_a_dome_is_spread_evenly_and_not_below_its_height():
    dome = LampDome((1, 2, 3), 10.0, 5.0)
    places = dome.places(1000) - [1, 2, 3]
    assert np.linalg.norm(places, axis=1) == pytest.approx(10.0)
    assert places[:, 2].min() >= 5.0
    # the area above a height goes with the height
    assert (places[:, 2] > 7.5).mean() == pytest.approx(0.5, abs=0.01)
    assert np.abs(places[:, :2].mean(axis=0)).max() < 0.1
