"""The bound on lamps against all covers, and the spaces of lamps against points drawn in them."""

from itertools import combinations

import numpy as np
import pytest

from aspectgraph.cells.arrays import Cell
from planner.light import plan_light as fewest
from planner.light.lamps import LampBox, LampDome
from planner.light.plan_light import LampSearch


@pytest.mark.parametrize("listed", [14, 0])
@pytest.mark.parametrize("seed", range(40))
def test_the_bound_is_the_least_cover_by_all_places(seed, listed, monkeypatch):
    """Only some places are known at first; ``decide`` finds another, or says truly that there is none."""
    monkeypatch.setattr(fewest, "_MOST_LISTED", listed)
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    places = np.concatenate([rng.random((12, n)) < rng.uniform(0.1, 0.6), np.eye(n, dtype=bool)])
    known = [np.eye(n, dtype=bool)[i] for i in range(n)]

    def decide(jobs):
        able = places[places[:, sorted(jobs)].all(axis=1)]
        known.extend(able[:1])
        return not len(able)

    bound = LampSearch(n, lambda: np.array(known), decide).bound()
    least = next(
        k for k in range(1, n + 1) for some in combinations(places, k) if np.any(some, axis=0).all()
    )
    assert bound == least
    assert any(np.any(some, axis=0).all() for some in combinations(np.unique(known, axis=0), least))


def test_what_stays_open_does_not_raise_the_bound():
    """Nothing is found and nothing refuted: one place might do all."""
    assert LampSearch(5, lambda: np.eye(5, dtype=bool), lambda jobs: False).bound() == 1


@pytest.mark.parametrize("n", [15, 20])
def test_many_jobs(n):
    """A place does jobs whose numbers agree modulo 3: three places for all, and none needs to be known at first."""
    known = list(np.eye(n, dtype=bool))

    def decide(jobs):
        rest = {job % 3 for job in jobs}
        if len(rest) == 1:
            known.append(np.arange(n) % 3 == rest.pop())
        return len(rest) > 1

    assert LampSearch(n, lambda: np.array(known), decide).bound() == 3
    assert len(fewest.min_cover(np.array(known)).chosen) == 3


def test_many_jobs_of_which_all_pairs_but_no_three_go_together():
    """Sixteen jobs in pairs: eight places; no two exclude each other."""
    n = 16
    known = list(np.eye(n, dtype=bool))

    def decide(jobs):
        if len(jobs) > 2:
            return True
        known.append(np.isin(np.arange(n), list(jobs)))
        return False

    assert 2 <= LampSearch(n, lambda: np.array(known), decide).bound() <= 8


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


@pytest.mark.parametrize(
    "space", [LampBox((-1, -1, 0), (1, 0.5, 1)), LampDome((0, 0, 0), 1.0, -0.2)]
)
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
