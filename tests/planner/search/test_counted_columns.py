"""Columns counted where covers use them: the fewest of what holds, by trying all; and no plan is beaten at random."""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from box_requests import UNCERTAINTY
from grid_box import EDGES, BoxSpace

from planner import Camera, Effort, is_cover, look_at, min_cover, plan_inspection
from planner.callbacks import NOBODY, Checkpoint
from planner.cover import few_columns
from planner.request.problem import Problem
from planner.search import counted_columns
from planner.search.columns import ColumnPool, Judge, Judgement
from planner.search.counted_columns import CountedColumns
from planner.search.incumbents import empty_pools

N_TARGETS = 7


class World:
    """Columns as judged, and what of them a count supports; a stand-in for a run that notes what is counted."""

    def __init__(self, promised, truth, monkeypatch):
        self.callbacks = NOBODY
        self.seed = 0
        self.executor = None
        self.shared = None
        self.problem = None
        self.truth = np.array(truth, dtype=bool)
        self.names = [f"e{i}" for i in range(self.truth.shape[1])]
        self.counts = Counter()
        self.pools = empty_pools(len(self.names))
        self.pool = self.pools.realised
        self.pool.membership = np.array(promised, dtype=bool)
        self.pool.poses = poses_at(np.arange(len(promised)))
        self.pool.quality = np.ones(len(promised))
        self.promises = SimpleNamespace(contradicted_in=self.short)
        monkeypatch.setattr(counted_columns, "candidate_settings", self.settings)
        monkeypatch.setattr(counted_columns, "surer_pose_near", lambda *_: None)

    def nodes(self, share=1.0):
        return 100

    def rng(self, purpose):
        return np.random.default_rng(0)

    def simulate(self, settings):
        return iter(settings)

    def settings(self, run, pool, columns):
        return [self.setting(pool.poses[c], pool.membership[c]) for c in columns]

    def setting(self, pose, column):
        names = tuple(np.array(self.names)[column].tolist())
        return SimpleNamespace(
            cam2world=pose, entities=names, probability=dict.fromkeys(names, 1), seed=0
        )

    def short(self, setting):
        place = float(setting.cam2world[0, 3])
        self.counts[place] += 1
        holds = self.truth[int(place)]
        return {name: 0.1 for name in setting.entities if not holds[self.names.index(name)]}


def poses_at(places):
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, 0, 3] = places
    return poses


def random_world(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    promised = np.vstack([rng.random((12, N_TARGETS)) < 0.35, np.eye(N_TARGETS, dtype=bool)])
    promised = promised[promised.any(axis=1)]
    return World(promised, promised & (rng.random(promised.shape) < 0.7), monkeypatch)


def fewest(columns):
    """The size of the smallest cover of all that columns contain, by trying all."""
    covered = columns.any(axis=0)
    for n in range(1, len(columns) + 1):
        for some in combinations(range(len(columns)), n):
            if columns[list(some)].any(axis=0)[covered].all():
                return n
    return 0


@pytest.mark.parametrize("seed", range(6))
def test_the_cover_is_as_small_as_any_of_what_holds(seed, monkeypatch):
    world = random_world(seed, monkeypatch)
    wanted = np.ones(N_TARGETS, dtype=bool)
    columns = CountedColumns(world, wanted)
    needed = columns.count_cover()
    held = world.truth.any(axis=0)
    assert needed == fewest(world.truth) + (~held).sum()
    assert np.array_equal(columns.counted.inspected, held)
    # what was counted holds, and was counted once
    for pose, column in zip(columns.counted.poses, columns.counted.membership, strict=True):
        assert not (column & ~world.truth[int(pose[0, 3])]).any()
    assert set(world.counts.values()) == {1}
    # the pool of the search stays as it is
    assert len(world.pool) == len(world.truth)


def test_columns_that_no_cover_uses_are_not_counted(monkeypatch):
    promised = [[1, 1, 1, 0], [0, 0, 0, 1], [1, 1, 0, 0], [0, 1, 1, 0]]
    world = World(promised, promised, monkeypatch)
    assert CountedColumns(world, np.ones(4, dtype=bool)).count_cover() == 2
    assert set(world.counts) == {0.0, 1.0}


def test_columns_are_searched_until_covers_get_no_shorter(monkeypatch):
    """Each search finds the next larger column; what the third one finds is as little as may be needed."""
    world = World(np.eye(4), np.eye(4), monkeypatch)
    world.truth = np.vstack([np.zeros((1, 4), dtype=bool), world.truth[1:]])
    found = []

    def price(shared, pools, seed, rounds, executor, callbacks, warm_start):
        found.append(rounds)
        row = np.arange(4) <= len(found)
        world.truth = np.vstack([world.truth, row])
        pools.add(
            poses_at([len(world.truth) - 1]),
            Judgement(row[None], row[None], row[None], 1.0 * row[None], 1.0 * row[None]),
        )

    monkeypatch.setattr(counted_columns, "price_poses", price)
    kept = []
    columns = CountedColumns(world, np.ones(4, dtype=bool))
    columns.search(95, 1, Checkpoint({}, lambda entries: kept.append(entries["counted"])))
    assert found == [10, 10, 10]
    assert columns.count_cover() == 1
    # what goes on after the second search ends the same
    again = CountedColumns.resumed(world, np.ones(4, dtype=bool), kept[1])
    found[2:] = []
    world.truth = world.truth[:6]
    again.search(95, 1, Checkpoint())
    assert again.entry()["turn"] == columns.entry()["turn"] == 3
    assert np.array_equal(again.counted.membership, columns.counted.membership)


@pytest.mark.parametrize("seed", range(6))
def test_no_cover_is_larger_than_one_of_the_columns_as_judged(seed, monkeypatch):
    """Better poses support of each judged column what they will; what is in none of them needs a setting of its own."""
    world = random_world(seed, monkeypatch)
    supported = world.truth | (np.random.default_rng(seed).random(world.truth.shape) < 0.6)
    supported &= world.pool.membership
    repaired = []

    def better(run, settings):
        for setting in settings:
            repaired.append(int(setting.cam2world[0, 3]))
            holds = supported[repaired[-1]]
            yield setting, frozenset(np.array(run.names)[holds].tolist())

    chosen = []

    def few(membership, *others):
        chosen.append(few_columns(membership, *others))
        return chosen[-1]

    monkeypatch.setattr(counted_columns, "supported_settings", better)
    wanted = np.ones(N_TARGETS, dtype=bool)
    columns = CountedColumns(world, wanted)
    before = columns.count_cover()
    whole = (columns.counted.membership[:, None] >= world.pool.membership).all(axis=2).any(axis=0)
    monkeypatch.setattr(counted_columns, "few_columns", few)
    columns.search(0, 1, Checkpoint())
    after = columns.count_cover()
    assert after <= before
    judged = fewest(world.pool.membership)
    # the first choice counts the cover again, the second is the cover as judged
    cover = chosen[1] if before > judged and before > 1 else np.zeros(0, dtype=int)
    # those that counts show as a whole are there already
    assert sorted(repaired) == sorted(c for c in cover if not whole[c])
    if cover.size:
        assert len(cover) == judged
        there = supported[repaired].any(axis=0) | world.pool.membership[cover[whole[cover]]].any(
            axis=0
        )
        assert after <= judged + (~there).sum()


def test_where_nothing_is_short_nothing_is_searched(monkeypatch):
    monkeypatch.setattr(counted_columns, "price_poses", None)
    columns = CountedColumns(World(np.eye(3), np.eye(3), monkeypatch), np.ones(3, dtype=bool))
    columns.search(100, 1, Checkpoint())
    assert len(columns.counted) == 3


def test_what_is_short_of_little_is_counted_where_it_is_surer(monkeypatch):
    """One column holds all but one target; nearby all of them hold, and one setting is enough."""
    world = World([[1, 1, 1], [0, 0, 1]], [[1, 1, 0], [0, 0, 1], [1, 1, 1]], monkeypatch)
    there = poses_at([2])[0]
    monkeypatch.setattr(counted_columns, "surer_pose_near", lambda *_: there)
    monkeypatch.setattr(
        counted_columns,
        "setting_at",
        lambda _, pose, names, *__: world.setting(pose, np.isin(world.names, names)),
    )
    columns = CountedColumns(world, np.ones(3, dtype=bool))
    assert columns.count_cover() == 1
    assert world.counts[2.0] == 1
    assert columns.counted.membership.all(axis=1).any()
    far = World([[1, 1, 1], [0, 0, 1]], [[1, 1, 0], [0, 0, 1]], monkeypatch)
    far.promises.contradicted_in = lambda setting: {
        name: 5.0 * missing for name, missing in far.short(setting).items()
    }
    # what is short of much is not looked for nearby
    monkeypatch.setattr(counted_columns, "surer_pose_near", None)
    assert CountedColumns(far, np.ones(3, dtype=bool)).count_cover() == 2


def test_a_plan_is_not_beaten_by_poses_drawn_at_random():
    """Poses that look at a box from anywhere, and the smallest cover of all that they inspect."""
    camera = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 250.0)
    space = BoxSpace((45.0, 30.0, 24.0), [[-600.0] * 3, [700.0] * 3], list(EDGES))
    plan = plan_inspection(
        space.solid, space.entities, camera, UNCERTAINTY, space=space, effort=Effort.named("quick")
    )
    judge = Judge(
        Problem(space, tuple(space.entities), camera, UNCERTAINTY, plan.accuracy, plan.probability)
    )
    rng = np.random.default_rng(1)
    pool = ColumnPool(len(judge.names))
    for _ in range(8):
        targets = rng.random((2500, 3)) * [45.0, 30.0, 24.0]
        away = rng.normal(size=targets.shape)
        away *= (rng.uniform(200.0, 300.0, 2500) / np.linalg.norm(away, axis=1))[:, None]
        poses = look_at(targets + away, targets, roll=rng.uniform(-np.pi, np.pi, 2500))
        judged = judge(poses)
        pool.add(judged.inspects, poses, judged.probability)
    inspected = np.isin(judge.names, list(plan.inspected))
    columns = pool.membership[:, inspected]
    assert columns.any(axis=0).all()
    cover = min_cover(columns)
    assert is_cover(columns, cover.chosen)
    assert len(plan.settings) <= len(cover.chosen)
    assert inspected.sum() >= pool.inspected.sum()
