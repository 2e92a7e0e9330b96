"""Parts of split edges and faces: listed in the order of their tree, however deep, and as long as there is room."""

import numpy as np
import pytest

from aspectgraph.cells.arrays import (
    EDGE_CHILD,
    EDGE_LIST,
    FACE_CHILD,
    FACE_LIST,
    N_LIST,
    RoomFullError,
    allocate,
)
from aspectgraph.cells.split import _push_edge_leaves, _push_face_leaves

pytestmark = pytest.mark.uncompiled
KINDS = {
    "edge": (_push_edge_leaves, EDGE_CHILD, EDGE_LIST),
    "face": (_push_face_leaves, FACE_CHILD, FACE_LIST),
}


def split_at_random(table, column, n_splits, rng):
    """Split row 0 of a table, and then parts of it; a negative choice always splits the newest part."""
    table[:, column] = -1
    parts = [0]
    n_rows = 1
    for _ in range(n_splits):
        split = parts.pop(rng.integers(len(parts)) if rng else -1)
        table[split, column : column + 2] = [n_rows, n_rows + 1]
        parts += [n_rows, n_rows + 1]
        n_rows += 2


def leaves_of(table, column, row):
    if table[row, column] < 0:
        return [row]
    first, second = (int(part) for part in table[row, column : column + 2])
    return leaves_of(table, column, first) + leaves_of(table, column, second)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [None, 1, 2, 3])
def test_parts_are_listed_as_their_tree_has_them_and_fill_the_room_exactly(kind, seed):
    push, column, row = KINDS[kind]
    n_splits = 60
    whole = allocate(np.zeros((1, 4), np.int64), 64)
    table = getattr(whole, kind)
    split_at_random(table, column, n_splits, None if seed is None else np.random.default_rng(seed))
    whole.face[0, 6] = whole.cell[0, 4] = 0
    for room in (n_splits + 1, n_splits + 9):
        cx = whole._replace(lists=np.full((3, room), -1, np.int32))
        cx.count[:] = 0
        push(cx, 0, 0)
        assert cx.count[N_LIST + row] == n_splits + 1
        assert cx.lists[row, : n_splits + 1].tolist() == leaves_of(table, column, 0)
    cx = whole._replace(lists=np.full((3, n_splits), -1, np.int32))
    cx.count[:] = 0
    with pytest.raises(RoomFullError):
        push(cx, 0, 0)
