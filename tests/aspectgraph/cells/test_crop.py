"""Cropping: cells inside the box stay and fill it, cells outside are flagged, cells at its sides are known."""

import numpy as np
import pytest
from cut_boxes import HALF, random_planes
from cut_boxes import cut_box as cut_cube

from aspectgraph.cells.arrays import INSIDE, cell_centre, cell_sizes, cell_triangles
from aspectgraph.cells.split import at_limits, crop, leaves

pytestmark = pytest.mark.uncompiled

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
