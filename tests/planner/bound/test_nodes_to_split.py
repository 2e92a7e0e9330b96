"""Which nodes of a tree of poses are split, by hand on trees that are no more than their sets."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from planner.bound.lower_bound import _FINEST_RAD, _above, _proof, _proof_of_clique, _to_split
from planner.cover import columns_of_covers, core_columns, fractional_cover

COARSE = 1.0
FINE = _FINEST_RAD / 2


def tree_of(sets, size=None):
    sets = np.array(sets, dtype=bool)
    size = np.full(len(sets), COARSE) if size is None else np.array(size)
    return SimpleNamespace(sets=sets, size=size, weights=lambda nodes, y: sets[nodes] @ y)


def test_nodes_that_weigh_more_than_their_share_are_split_the_heaviest_first():
    """Weights of 0.4, 0.5 and 0.6 for two settings of at least 0.75 each: {0, 1} and {1, 2} weigh 0.9 and 1.1."""
    y = np.array([0.4, 0.5, 0.6])
    sets = [[1, 1, 0], [1, 0, 0], [0, 1, 1], [0, 1, 1]]
    assert _above(tree_of(sets), y, 3).tolist() == [2, 3, 0]
    # what is fine is not split any more, though it still stands in the way of the proof
    assert _above(tree_of(sets, [COARSE, COARSE, FINE, COARSE]), y, 3).tolist() == [3, 0]
    assert _above(tree_of(sets, [FINE] * 4), y, 3).tolist() == []
    # of one setting each must weigh 1.5: none does, and two settings are proven
    assert _above(tree_of(sets), y, 2) is None


def test_without_a_cover_by_the_sets_there_is_nothing_to_split():
    """Three entities, no two together: two settings do not cover them; with a pair they may."""
    single = np.eye(3, dtype=bool)
    y = np.full(3, 1.0)
    assert _to_split(tree_of(single), y, 3) is None
    pairs = [[1, 1, 0], [0, 0, 1], [0, 1, 0]]
    assert sorted(_to_split(tree_of(pairs), np.full(3, 0.5), 3).tolist()) == [0, 1]
    assert _to_split(tree_of(pairs, [FINE, COARSE, COARSE]), np.full(3, 0.5), 3).tolist() == [1]
    # an entity that is in no set needs no search
    assert _to_split(tree_of([[1, 1, 0]]), np.full(3, 0.5), 3) is None


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (_proof_of_clique(1, "edges"), "Fewer settings than one inspect nothing."),
        (_proof_of_clique(3, "dimensions"), "Of 3 dimensions no two can be inspected together"),
        (_proof(1, 1), "1 box of camera poses was checked"),
        (_proof(5, 0, "dimensions"), "and no pairs of dimensions were found to exclude each other"),
        (_proof(5, 1), "and 1 pair of edges was found"),
    ],
)
def test_what_a_bound_rests_on_is_told(told, words):
    assert words in told


def test_columns_of_small_covers():
    """A triangle of pairs and a single: of covers of two, the single 0 alone cannot be one; of all three it can."""
    membership = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1], [1, 0, 0]], dtype=bool)
    assert fractional_cover(membership[:, :0]) == (0.0, pytest.approx(np.zeros(0)))
    pairs = {0, 1, 2}
    assert pairs <= set(columns_of_covers(membership, 2).tolist())
    assert pairs | {3} == set(columns_of_covers(membership, 3).tolist())
    assert membership[core_columns(membership)].any(axis=0).all()
