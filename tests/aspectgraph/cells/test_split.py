"""The cell complex: it tiles its box, stays conforming, and does not care in which order planes come."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import HALF, cut_box, random_planes
from solids import cut_box as cut_cube

from aspectgraph.cells.arrays import (
    CROSSED,
    EDGE_CHILD,
    EDGE_LIST,
    ENDS,
    FACE_CHILD,
    FACE_FIRST,
    FACE_LIST,
    FACE_PLANE,
    FACE_SIZE,
    INSIDE,
    N_CELLS,
    N_FACES,
    N_LIST,
    SIDES,
    RoomFullError,
    allocate,
    bytes_in_use,
    cell_centre,
    cell_sizes,
    cell_triangles,
    cut_further,
    interfaces,
    with_room,
)
from aspectgraph.cells.split import (
    _push_edge_leaves,
    _push_face_leaves,
    at_limits,
    cell_side,
    crop,
    leaves,
    split_cell,
)
from aspectgraph.exceptions import MemoryLimitError

pytestmark = pytest.mark.uncompiled


@pytest.mark.parametrize("degenerate", [False, True])
def test_cells_tile_the_box(degenerate):
    cx = cut_box(random_planes(12, 3, degenerate))
    assert cell_sizes(cx, leaves(cx))[:, 0].sum() == pytest.approx((2 * HALF) ** 3, rel=1e-9)


def test_planes_in_general_position_make_the_number_of_cells_theory_gives():
    """n planes of which all triples meet inside a ball cut it into 1 + n + C(n, 2) + C(n, 3) parts (Schlaefli)."""
    rng = np.random.default_rng(0)
    normals = rng.integers(-(2**18), 2**18, (6, 3))
    planes = np.column_stack([normals, rng.integers(-4, 5, 6)])
    assert len(leaves(cut_box(planes))) == 1 + 6 + 15 + 20


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 10**6), st.integers(1, 9), st.booleans())
def test_any_planes_cut_cells_that_tile_the_box_and_share_every_face(seed, n, degenerate):
    cx = cut_box(random_planes(n, seed, degenerate))
    cells = leaves(cx)
    sizes = cell_sizes(cx, cells)[:, 0]
    assert sizes.min() > 0
    assert sizes.sum() == pytest.approx((2 * HALF) ** 3, rel=1e-9)
    assert count_closed_polyhedra(cx) == len(cells)
    # every face inside the box lies between two cells, none on its walls does
    for f in range(cx.count[N_FACES]):
        beside = cx.face[f, SIDES : SIDES + 2]
        if cx.face[f, FACE_CHILD] < 0:
            inside = {int(c) for c in beside if c >= 0}
            assert len(inside) == (1 if cx.face[f, FACE_PLANE] < 6 else 2)
            assert inside <= set(cells.tolist())


@pytest.mark.parametrize("degenerate", [False, True])
def test_every_cell_is_a_closed_polyhedron(degenerate):
    cx = cut_box(random_planes(10, 5, degenerate))
    assert count_closed_polyhedra(cx) == len(leaves(cx)) > 20


def count_closed_polyhedra(cx):
    """Count the cells of whose faces each side is shared by two, and which keep Euler's formula."""
    closed = 0
    for c in leaves(cx):
        faces = [
            f
            for f in range(cx.count[N_FACES])
            if c in cx.face[f, SIDES : SIDES + 2] and cx.face[f, FACE_CHILD] < 0
        ]
        edges = {}
        for f in faces:
            for e in cx.lists[
                EDGE_LIST, cx.face[f, FACE_FIRST] : cx.face[f, FACE_FIRST] + cx.face[f, FACE_SIZE]
            ]:
                edges[int(e)] = edges.get(int(e), 0) + 1
        corners = {int(v) for e in edges for v in cx.edge[e, ENDS : ENDS + 2]}
        shared = set(edges.values()) == {2}
        closed += shared and len(corners) - len(edges) + len(faces) == 2
    return closed


def test_cells_lie_on_the_side_their_number_tells():
    cx = cut_box(random_planes(8, 1))
    sides, sizes = interfaces(cx)
    assert len(sides)
    assert (sizes[:, 0] > 0).all()
    for positive, negative, h, _ in sides:
        a, b, c, d = cx.planes[h].astype(float)
        for cell, expected in ((positive, 1), (negative, -1)):
            x, y, z = cell_centre(cx, cell)
            assert np.sign(a * x + b * y + c * z - d) == expected


@pytest.mark.parametrize("degenerate", [False, True])
def test_order_of_planes_changes_nothing(degenerate):
    planes = random_planes(9, 7, degenerate)
    orders = [list(range(9)), list(range(9))[::-1], [4, 0, 7, 2, 8, 1, 3, 6, 5]]
    complexes = [cut_box(planes[order]) for order in orders]
    volumes = [np.sort(cell_sizes(cx, leaves(cx))[:, 0]) for cx in complexes]
    assert volumes[1] == pytest.approx(volumes[0], rel=1e-9)
    assert volumes[2] == pytest.approx(volumes[0], rel=1e-9)


def test_room_grows_until_it_suffices():
    planes = random_planes(12, 3)
    asked = []

    def build(n_cells):
        asked.append(n_cells)
        return cut_box(planes, n_cells)

    assert with_room(build, n_cells=8).count[N_CELLS] == cut_box(planes).count[N_CELLS]
    assert len(asked) > 1
    with pytest.raises(MemoryLimitError, match=r"must have at most 32 cells. Got more"):
        with_room(build, n_cells=8, limit=32)


def test_cutting_further_leaves_the_complex_and_makes_room():
    planes = random_planes(12, 3)
    whole = cut_box(planes)
    begun = cut_box(planes[:4], 64)
    begun = begun._replace(planes=whole.planes)
    before = begun.count.copy()
    rooms = []

    def cut(cx):
        rooms.append(len(cx.cell))
        for h in range(10, 18):
            for c in leaves(cx):
                if cell_side(cx, c, h) == CROSSED:
                    split_cell(cx, c, h)

    found = cut_further(begun, cut, 1)
    assert len(rooms) > 1
    assert (begun.count == before).all()
    assert found.count[N_CELLS] == whole.count[N_CELLS]
    assert np.sort(cell_sizes(found, leaves(found))[:, 0]) == pytest.approx(
        np.sort(cell_sizes(whole, leaves(whole))[:, 0]), rel=1e-9
    )


def test_room_shrinks_where_the_process_gets_no_memory():
    planes = random_planes(12, 3)
    asked = []

    def build(n_cells):
        asked.append(n_cells)
        if n_cells > 4096:
            # what NumPy says, in a class of its own
            raise type("ArrayMemoryError", (MemoryError,), {})("Unable to allocate 1. EiB")
        return cut_box(planes, n_cells)

    assert with_room(build, n_cells=1 << 14).count[N_CELLS] == cut_box(planes).count[N_CELLS]
    assert asked == [1 << 14, 1 << 13, 1 << 12]
    with pytest.raises(MemoryLimitError, match="gets no memory for more than"):
        with_room(
            lambda n_cells: (_ for _ in ()).throw(MemoryError("Unable to allocate")), n_cells=8
        )


def test_bytes_in_use_are_those_of_the_rows_in_use():
    cx = cut_box(random_planes(12, 3))
    counts = cx.count.tolist()
    rows = dict(
        zip(
            ("vertices", "coordinates", "vertex", "edge", "face", "cell", "label"),
            [0, 0, 0, 1, 2, 3, 3],
            strict=True,
        )
    )
    of_rows = sum(getattr(cx, name)[: counts[k]].nbytes for name, k in rows.items())
    assert bytes_in_use(cx) == of_rows + sum(
        row[:n].nbytes for row, n in zip(cx.lists, counts[5:], strict=True)
    )


# Parts of split edges and faces: listed in the order of their tree, however deep, and as long as
# there is room.


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


# Cropping: cells inside the box stay and fill it, cells outside are flagged, cells at its sides
# are known.


# the box [-600, 500] x [-400, 300] x [-200, 700], and one turned about z by atan(3/4)
STRAIGHT = np.array(
    [
        [1, 0, 0, -600],
        [1, 0, 0, 500],
        [0, 1, 0, -400],
        [0, 1, 0, 300],
        [0, 0, 1, -200],
        [0, 0, 1, 700],
    ]
)
TURNED = np.array(
    [
        [4, 3, 0, -3000],
        [4, 3, 0, 2500],
        [-3, 4, 0, -2000],
        [-3, 4, 0, 1500],
        [0, 0, 1, -200],
        [0, 0, 1, 700],
    ]
)
VOLUME = 1100 * 700 * 900


def cropped(limits):
    """Cut the cube by the first planes, label all cells with 1, and crop it by the limits, which have cut nothing."""
    planes = random_planes(8, 2)
    cx = cut_cube(planes)
    table = np.concatenate([cx.planes, limits])
    cx = cx._replace(planes=table)
    cx.label[:] = 1
    crop(cx, len(table) - 6)
    return cx, len(table) - 6


@pytest.mark.parametrize("limits", [STRAIGHT, TURNED], ids=["straight", "turned"])
def test_cells_inside_fill_the_box_and_the_rest_is_flagged(limits):
    cx, _ = cropped(limits)
    present = leaves(cx)
    inside = cx.label[present, 0] == 1
    assert (cx.label[present[~inside], 0] == INSIDE).all()
    sizes = cell_sizes(cx, present)[:, 0]
    assert sizes[inside].sum() == pytest.approx(VOLUME, rel=1e-9)
    assert sizes.sum() == pytest.approx((2 * HALF) ** 3, rel=1e-9)
    for c, is_inside in zip(present, inside, strict=True):
        heights = limits[:, :3] @ cell_centre(cx, c) - limits[:, 3]
        assert is_inside == ((heights[::2] > 0).all() and (heights[1::2] < 0).all())


@pytest.mark.parametrize("limits", [STRAIGHT, TURNED], ids=["straight", "turned"])
def test_cells_at_the_sides_of_the_box(limits):
    cx, first = cropped(limits)
    on_limit = at_limits(cx, first)
    for c in leaves(cx)[cx.label[leaves(cx), 0] == 1]:
        corners = corners_of(cx, c)
        heights = (corners @ limits[:, :3].T - limits[:, 3]) / np.linalg.norm(limits[:, :3], axis=1)
        assert on_limit[c] == ((np.abs(heights) < 1e-6).sum(axis=0) >= 3).any()


def corners_of(cx, c):

    return np.unique(cell_triangles(cx, c).reshape(-1, 3).round(6), axis=0)
