"""Covers of which simulation supports what they count on: as small as any, and no pose is tried twice."""

from collections import Counter
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from planner.callbacks import NOBODY
from planner.effort import Effort
from planner.search import incumbents as supported_columns
from planner.search.columns import ColumnPool
from planner.search.incumbents import SupportedColumns

N_ENTITIES = 7


class World:
    """Columns as judged, and what of them simulation supports; a stand-in for a run that counts what is tried."""

    def __init__(self, promised, supported, monkeypatch):
        self.callbacks = NOBODY
        self.effort = Effort()
        self.promised = np.array(promised, dtype=bool)
        self.truth = np.array(supported, dtype=bool)
        self.names = [f"e{i}" for i in range(self.promised.shape[1])]
        self.tries = Counter()
        self.pool = ColumnPool(len(self.names))
        self.pool.membership = self.promised
        self.pool.poses = np.tile(np.eye(4), (len(self.promised), 1, 1))
        # tells the columns apart
        self.pool.poses[:, 0, 3] = np.arange(len(self.promised))
        monkeypatch.setattr(
            supported_columns, "candidate_settings", lambda run, pool, columns: list(columns)
        )
        monkeypatch.setattr(supported_columns, "as_simulated", self.simulated)

    def rng(self, purpose):
        return np.random.default_rng(0)

    def names_of(self, column):
        return tuple(np.array(self.names)[column].tolist())

    def simulate(self, columns):
        # what is found beforehand is taken from here by `simulated`
        return iter(columns)

    def simulated(self, run, columns):
        (c,) = columns
        self.tries[c] += 1
        names = self.names_of(self.truth[c])
        return [SimpleNamespace(entities=names)] if names else []


def random_world(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    promised = rng.random((12, N_ENTITIES)) < 0.35
    promised = promised[promised.any(axis=1)]
    supported = promised & (rng.random(promised.shape) < 0.7)
    return World(promised, supported, monkeypatch)


def fewest(columns):
    """The size of the smallest cover of all that columns contain, by trying all."""
    covered = columns.any(axis=0)
    for n in range(1, len(columns) + 1):
        if any(
            columns[list(some)].any(axis=0)[covered].all()
            for some in combinations(range(len(columns)), n)
        ):
            return n
    return 0


def reached(found):
    return {name for setting in found for name in setting.entities}


@pytest.mark.parametrize("seed", range(30))
def test_the_cover_is_as_small_as_any_of_what_is_supported(seed, monkeypatch):
    # so that nothing is given up, and no cover is the last one
    monkeypatch.setattr(supported_columns, "_EXCHANGES", 300)
    monkeypatch.setattr(supported_columns, "_IN_VAIN", 99)
    world = random_world(seed, monkeypatch)
    found = SupportedColumns().cover(world, world.pool, (0, 0), covers=99)
    assert reached(found) == set(world.names_of(world.truth.any(axis=0)))
    assert len(found) == fewest(world.truth)
    assert set(world.tries.values()) == {1}


@pytest.mark.parametrize("seed", range(10))
def test_what_was_tried_once_is_known(seed, monkeypatch):
    world = random_world(seed, monkeypatch)
    columns = SupportedColumns()
    first = columns.cover(world, world.pool, (0, 0))
    tries = dict(world.tries)
    worth = (len(reached(first)), -len(first))
    # no better one is there, and that is known
    assert columns.cover(world, world.pool, worth) is None
    assert world.tries == tries
    again = columns.cover(world, world.pool, (worth[0], worth[1] - 1))
    assert (len(reached(again)), len(again)) == (worth[0], -worth[1])
    assert set(world.tries.values()) == {1}


def test_where_all_is_supported_not_a_column_more_is_tried(monkeypatch):
    world = World(np.eye(5), np.eye(5), monkeypatch)
    assert len(SupportedColumns().cover(world, world.pool, (0, 0))) == 5
    assert world.tries == dict.fromkeys(range(5), 1)


def test_one_cover_is_cut_to_what_is_supported(monkeypatch):
    """The large column promises all; it keeps one, and no other column was tried."""
    promised = np.vstack([np.ones((1, 4)), np.eye(4)])
    world = World(promised, np.vstack([np.eye(4)[:1], np.eye(4)]), monkeypatch)
    found = SupportedColumns().cover(world, world.pool, (0, 0), covers=1)
    assert reached(found) == {"e0"}
    assert world.tries == {0: 1}
    assert reached(SupportedColumns().cover(world, world.pool, (0, 0))) == {"e0", "e1", "e2", "e3"}


def test_what_is_promised_in_vain_is_given_up(monkeypatch):
    promised = [[1, 0]] * 10 + [[0, 1]]
    world = World(promised, [[0, 0]] * 10 + [[0, 1]], monkeypatch)
    assert reached(SupportedColumns().cover(world, world.pool, (0, 0), covers=99)) == {"e1"}
    assert sum(world.tries[c] for c in range(10)) == supported_columns._IN_VAIN


def test_what_some_pose_keeps_is_not_given_up_however_many_promise_it_in_vain(monkeypatch):
    """A column of e0 and another edge each, of which only that of e1 keeps e0; the others cannot be done without."""
    promised = np.hstack([np.ones((8, 1)), np.eye(8)])
    truth = promised.copy()
    truth[1:, 0] = 0
    world = World(promised, truth, monkeypatch)
    assert reached(SupportedColumns().cover(world, world.pool, (0, 0))) == set(world.names)


def test_nothing_supported_is_no_plan(monkeypatch):
    world = World(np.ones((3, 2)), np.zeros((3, 2)), monkeypatch)
    assert SupportedColumns().cover(world, world.pool, (0, 0)) is None
