"""The linear part of the lower bound on spaces of few poses, which an exact oracle searches."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from scipy.optimize import linprog

from planner.bound.boxes import FOUND, PROVEN, SPENT, UNRESOLVED
from planner.bound.lower_bound import (
    _HARD,
    _MORE_BOXES,
    _SHARE_OF_NEXT,
    LinearBound,
    ProvenBound,
    _Parts,
    limit_for,
    of_all,
    relieved,
)
from planner.bound.pose_space import SearchedPart
from planner.callbacks import Checkpoint
from planner.cover import fractional_cover, min_cover
from planner.plan_file import packed, unpacked

# of 24 entities, a column for every two
PAIRS = np.repeat(np.eye(12, dtype=bool), 2, axis=1)


class FewPoses:
    """A space of known columns (c, e) in parts, each of which takes some boxes to search."""

    def __init__(self, columns, n_parts, rng):
        self.columns = columns
        self.parts = list(range(n_parts))
        self.part = rng.integers(n_parts, size=len(columns))
        self.cost = rng.integers(20, 2000, n_parts)
        self.asked = []
        self.regrown = []

    def grown_for(self):
        return {"y": np.ones(1), "limit": 1.0, "finest": 0.5}

    def regrow(self, grown_for):
        self.regrown.append(grown_for)

    def search(self, y, limit, max_nodes, tick=None, *, parts, most):
        # some known column weighs 1, so that no space is free of what weighs more than less
        assert limit > 1.0
        for k, nodes in zip(parts, np.broadcast_to(max_nodes, len(parts)), strict=True):
            # what gets no box is never decided
            assert nodes >= 1
            own = self.columns[self.part == k]
            heavy = own[own @ y > limit]
            self.asked.append((k, y.copy(), limit, len(heavy)))
            outcome = SPENT if nodes < self.cost[k] else FOUND if len(heavy) else PROVEN
            sets = heavy[:most] if outcome == FOUND else own[:0]
            doubt = own.any(axis=0) if outcome == SPENT else np.zeros(len(y), dtype=bool)
            yield SearchedPart(
                outcome, int(min(nodes, self.cost[k])), np.zeros((len(sets), 4, 4)), sets, doubt
            )


def columns_of(rng, n=300, m=24):
    return np.concatenate([rng.random((n, m)) < rng.uniform(0.1, 0.35), np.eye(m, dtype=bool)])


def test_what_is_proven_is_true_and_mostly_all_that_weights_can_prove():
    """Beginning with a tenth of the poses; the cover of all of them is known."""
    proven = possible = 0
    for seed in range(16):
        rng = np.random.default_rng(seed)
        columns = columns_of(rng)
        relaxation = fractional_cover(columns)[0]
        fewest = len(min_cover(columns).chosen)
        told = []

        def improve(poses, told=told, columns=columns):
            told.append(len(poses))
            return columns[-24:]

        space = FewPoses(columns, 16, rng)
        linear = LinearBound(space, columns[-24:], improve)
        bound = linear.raise_from(1, 24, max_nodes=1_000_000)
        assert 1 <= bound <= fewest
        assert sum(told) <= len(linear.found)
        # the mean of duals, and what is to spare, stay a little below the relaxation
        possible += int(np.ceil(0.93 * relaxation))
        proven += bound
    assert proven >= possible


class Blurred(FewPoses):
    """The same, with boxes too small to tell in one part, for limits below some value."""

    def __init__(self, columns, n_parts, rng, sharp_from):
        super().__init__(columns, n_parts, rng)
        self.sharp_from = sharp_from

    def search(self, y, limit, max_nodes, tick=None, *, parts, most):
        for k, found in zip(
            parts, super().search(y, limit, max_nodes, parts=parts, most=most), strict=True
        ):
            blurred = k == 0 and found.outcome == PROVEN and limit < self.sharp_from
            yield found._replace(outcome=UNRESOLVED) if blurred else found


def test_where_boxes_are_too_small_to_tell_fewer_settings_are_proven():
    """Not none: columns of two entities, of 24, need 12; the part that cannot tell can for 8."""
    sharp = LinearBound(FewPoses(PAIRS, 4, np.random.default_rng(0)), PAIRS)
    assert sharp.raise_from(1, 24, max_nodes=1_000_000) >= 10
    blurred = LinearBound(Blurred(PAIRS, 4, np.random.default_rng(0), 1.5), PAIRS)
    assert blurred.raise_from(1, 24, max_nodes=1_000_000) == 8


class Costly(FewPoses):
    """The same, where every part takes so many boxes, and far more for limits below some value."""

    def __init__(self, columns, boxes, easy_from=0.0):
        super().__init__(columns, 4, np.random.default_rng(0))
        self.boxes = boxes
        self.easy_from = easy_from

    def search(self, y, limit, max_nodes, tick=None, *, parts, most):
        self.cost = np.full(4, self.boxes if limit > self.easy_from else 10**9)
        return super().search(y, limit, max_nodes, parts=parts, most=most)


# Four parts get 8000 boxes each, then 32 000, then 128 000: 672 000 in all.
NEARLY_ALL = 700_000


def test_the_only_number_that_is_left_gets_all_boxes():
    assert LinearBound(Costly(PAIRS, 100_000), PAIRS).raise_from(5, 6, max_nodes=NEARLY_ALL) == 6


def test_a_number_that_is_too_hard_leaves_boxes_for_the_one_below():
    """Weights of 12 in all prove six where no pose weighs 12 / 5, five where none weighs 3."""
    space = Costly(PAIRS, 20_000, easy_from=2.5)
    assert LinearBound(space, PAIRS).raise_from(4, 6, max_nodes=NEARLY_ALL) == 5
    assert {limit < 2.5 for _, _, limit, _ in space.asked} == {True, False}


def test_once_a_number_is_proven_the_next_one_does_not_get_all_boxes():
    """Weights of 12 in all prove eleven where no pose weighs 12 / 10; twelve would take more than there is."""
    linear = LinearBound(Costly(PAIRS, 7000, easy_from=1.15), PAIRS)
    assert linear.raise_from(1, 24, max_nodes=1_000_000) == 11
    assert linear.made <= 1_000_000 * _SHARE_OF_NEXT


class Doubtful(FewPoses):
    """Pairs, where a part takes many boxes to tell that no pose inspects all entities, which it would else be."""

    def __init__(self, boxes):
        super().__init__(PAIRS, 2, np.random.default_rng(0))
        self.cost = np.array([100, boxes])

    def search(self, y, limit, max_nodes, tick=None, *, parts, most):
        for k, found in zip(
            parts, super().search(y, limit, max_nodes, parts=parts, most=most), strict=True
        ):
            everything = np.full(24, k == 1 and found.outcome == SPENT)
            yield found._replace(doubt=everything)


def test_a_doubt_that_would_end_the_proof_is_looked_into():
    """After 128 000 boxes the part counts as hard. With a column of everything one setting would be enough."""
    assert LinearBound(Doubtful(400_000), PAIRS).raise_from(5, 6, max_nodes=2_000_000) == 6
    # where there are too few boxes to tell, it ends
    assert LinearBound(Doubtful(400_000), PAIRS).raise_from(5, 6, max_nodes=300_000) == 5
    assert LinearBound(Doubtful(10**9), PAIRS).raise_from(5, 6, max_nodes=2_000_000) == 5


def test_parts_that_were_proven_wait_until_the_others_are():
    parts = _Parts(3, 100)
    assert parts.next_ones(299) is None
    asked, boxes = parts.next_ones(300)
    assert (asked.tolist(), boxes.tolist()) == ([0, 1, 2], [100, 100, 100])
    hard = parts.learn(asked, np.array([PROVEN, SPENT, PROVEN]), np.array([40, 100, 90]))
    assert not hard.any()
    # what is proven is not asked for again, and what was not gets more boxes
    asked, boxes = parts.next_ones(1000)
    assert (asked.tolist(), boxes.tolist()) == ([1], [100 * _MORE_BOXES])
    parts.renew()
    asked, boxes = parts.next_ones(1000)
    assert asked.tolist() == [1]
    parts.learn(asked, np.array([PROVEN]), boxes)
    # half as many boxes again as it took, but no fewer than at first
    asked, boxes = parts.next_ones(1000)
    assert (asked.tolist(), boxes.tolist()) == ([0, 2], [100, 135])


def test_a_part_is_too_hard_after_so_many_times_as_many_boxes():
    parts = _Parts(2, 100)
    asked = np.arange(2)
    boxes = np.array([_HARD * 100, _HARD * 100 - 1])
    assert parts.learn(asked, np.array([SPENT, SPENT]), boxes).tolist() == [True, False]
    # the weights will keep away from it, so it begins anew
    assert parts.next_ones(10**6)[1].tolist() == [100, _MORE_BOXES * boxes[1]]


def test_too_few_boxes_prove_nothing_wrong():
    rng = np.random.default_rng(1)
    columns = columns_of(rng)
    fewest = len(min_cover(columns).chosen)
    for boxes in (0, 100, 3000, 10_000, 30_000):
        linear = LinearBound(FewPoses(columns, 16, np.random.default_rng(2)), columns[-24:])
        assert 1 <= linear.raise_from(1, 24, max_nodes=boxes) <= fewest
        assert linear.made <= boxes


@pytest.mark.parametrize("seed", range(4))
def test_a_proof_goes_on_from_any_part_where_it_stopped(seed):
    """It searches no part again that was done, and ends the same; what it tells survives being written."""
    columns = columns_of(np.random.default_rng(seed))
    told = []

    def raised(kept=None, keep=None):
        space = FewPoses(columns, 16, np.random.default_rng(7))
        improved = []

        def improve(poses):
            improved.append(len(poses))
            return columns[-24:]

        linear = LinearBound(space, columns[-24:], improve, Checkpoint(kept=kept, keep=keep))
        return (
            linear.raise_from(1, 24, max_nodes=100_000),
            linear.made,
            linear.found,
            space,
            improved,
        )

    bound, made, found, space, improved = raised(
        keep=lambda entries: told.append(json.dumps(packed(entries)))
    )
    assert len(told) == len(space.asked) > 16
    assert improved
    for k in range(0, len(told), 5):
        again = raised(kept=unpacked(json.loads(told[k])))
        assert again[:2] == (bound, made)
        assert np.array_equal(again[2], found)
        assert len(again[3].asked) == len(told) - k - 1
        # of poses found before it stopped, all that were not told yet are told now
        assert again[4] == improved[len(improved) - len(again[4]) :]
        assert again[3].regrown == [{"y": np.ones(1), "limit": 1.0, "finest": 0.5}]
    # poses of an earlier sweep that were still to be told when it stopped come before those found since
    kept = unpacked(json.loads(told[0]))
    kept["linear"]["poses"] = np.zeros((2, 4, 4))
    assert raised(kept)[4] == [improved[0] + 2, *improved[1:]]


def test_relieved_weights_give_up_no_more_than_they_must():
    y = np.array([0.5, 0.4, 0.3, 0.2, 0.1])
    one = np.array([[True, True, True, False, False]])
    after = relieved(y, one, 1.0)
    assert (after <= y).all()
    assert after.sum() == pytest.approx(y.sum() - (1.2 - 0.999))
    # two sets that share an entity: what it gives up helps both, and both need as much
    both = np.array([[True, True, False, False, True], [False, True, True, True, True]])
    after = relieved(y, both, 0.8)
    assert (both @ after).max() <= 0.8
    assert after.sum() == pytest.approx(y.sum() - (1.0 - 0.7992))
    assert relieved(y, one, 2.0).sum() == pytest.approx(y.sum())


@pytest.mark.parametrize(("total", "target"), [(4.6, 5), (17.2, 17), (2.0, 2), (4.0, 6)])
def test_a_limit_leaves_some_of_what_it_proves_to_spare(total, target):
    limit = limit_for(np.full(10, total / 10), target)
    assert limit * (target - 1) < total
    assert limit > 0.985 * total / (target - 1)
    # never the whole of what it is above 1
    assert (limit > 1.0) == (total > target - 1)


# What a bound for all targets says of some of them: known answers, and covers counted one by one.


ALL = np.ones(6, bool)


def kept(*targets):
    found = np.zeros(6, bool)
    found[list(targets)] = True
    return found


def test_without_weights_it_falls_by_one_for_each_target_that_is_not_kept():
    proven = ProvenBound(4, "", ALL)
    assert [proven.for_some(kept(*range(n))) for n in range(7)] == [0, 1, 1, 1, 2, 3, 4]


def test_six_targets_of_which_a_pose_inspects_two():
    """Each weighs a half; three need two settings, where one less for each would leave none."""
    proven = ProvenBound(3, "", ALL, np.full(6, 0.5))
    assert [proven.for_some(kept(*range(n))) for n in range(7)] == [0, 1, 1, 2, 2, 3, 3]


def test_targets_that_were_not_asked_for_change_nothing():
    proven = ProvenBound(2, "", kept(0, 1, 2), of_all(np.array([1.0, 0.5, 0.5]), kept(0, 1, 2)))
    assert proven.for_some(kept(0, 1, 2, 5)) == 2
    assert proven.for_some(kept(0, 5)) == 1
    assert proven.for_some(kept(5)) == 1


def least_cover(columns, targets):
    """How many columns cover some targets, by trying all."""
    for n in itertools.count():
        for some in itertools.combinations(columns, n):
            if np.any(some, axis=0)[targets].all() if n else not targets.any():
                return n


@pytest.mark.parametrize("seed", range(8))
def test_no_cover_is_smaller(seed):
    rng = np.random.default_rng(seed)
    columns = rng.random((7, 6)) < 0.35
    columns[rng.integers(0, 7, 6), np.arange(6)] = True
    dual = linprog(-np.ones(6), A_ub=columns.astype(float), b_ub=np.ones(7), bounds=(0.0, 1.0)).x
    n = int(np.ceil(dual.sum() - 1e-6))
    better = 0
    for chosen in itertools.product([False, True], repeat=6):
        some = np.array(chosen)
        least = least_cover(columns, some)
        plain = ProvenBound(n, "", ALL).for_some(some)
        weighed = ProvenBound(n, "", ALL, dual).for_some(some)
        assert plain <= weighed <= least
        better += weighed > plain
    assert better > 0 or n == 1
