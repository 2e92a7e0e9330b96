"""Exact signs against Python's own integers, on generic, degenerate and largest possible input."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from aspectgraph.exact.grid import LIMBS, POINT_BITS, meet, sign_at_point, sign_at_vertex

pytestmark = pytest.mark.uncompiled

SMALL = st.tuples(*[st.integers(-2, 2)] * 3, st.integers(-3, 3))
LARGE = st.tuples(*[st.integers(-(2**42), 2**42)] * 3, st.integers(-(2**62), 2**62))
PLANES = st.lists(st.one_of(SMALL, LARGE), min_size=4, max_size=4)


def determinant(rows):
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def common_point(planes):
    w = determinant([plane[:3] for plane in planes])
    if w == 0:
        return None
    columns = [
        [[p[3] if k == axis else p[k] for k in range(3)] for p in planes] for axis in range(3)
    ]
    return [Fraction(determinant(rows), w) for rows in columns]


def sign(x):
    return (x > 0) - (x < 0)


@settings(max_examples=300, deadline=None)
@given(PLANES)
def test_vertex_and_plane_agree_with_integers(planes):
    table = np.array(planes, np.int64)
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    point = common_point(planes[:3])
    assert meet(table, 0, 1, 2, vertices, coordinates, 0) == (point is not None)
    if point is not None:
        assert coordinates[0] == pytest.approx([float(x) for x in point], rel=1e-14, abs=0)
        for h, plane in enumerate(planes):
            expected = sign(sum(n * x for n, x in zip(plane[:3], point, strict=True)) - plane[3])
            assert sign_at_vertex(table, h, vertices, coordinates, 0) == expected


@settings(max_examples=300, deadline=None)
@given(
    st.one_of(SMALL, LARGE),
    st.lists(st.integers(-(2**45), 2**45), min_size=3, max_size=3),
    st.booleans(),
)
def test_point_and_plane_agree_with_integers(plane, point, on_grid):
    if on_grid:
        point = [(x >> 24) << POINT_BITS for x in point]
    exact = sum(n * x for n, x in zip(plane[:3], point, strict=True)) - (plane[3] << POINT_BITS)
    assert sign_at_point(np.array([plane], np.int64), 0, np.array(point, np.int64)) == sign(exact)


def test_every_degenerate_case_of_a_pencil():
    """All planes through one line, and points on that line: rounding alone would decide at random."""
    pencil = [(k, 7 - k, 0, 0) for k in range(8)] + [(0, 0, 1, 12345)]
    table = np.array(pencil, np.int64)
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    assert meet(table, 0, 3, 8, vertices, coordinates, 0)
    assert [sign_at_vertex(table, h, vertices, coordinates, 0) for h in range(9)] == [0] * 9


@settings(max_examples=200, deadline=None)
@given(
    st.tuples(*[st.integers(-(2**42), 2**42)] * 3),
    st.tuples(*[st.integers(-(2**18), 2**18)] * 3),
    st.integers(-1, 1),
)
@example((4124765444479, 2168393462016, 112740016985), (113628, 213988, 146529), 0)
@example((4124765444479, 2168393462016, 112740016985), (113628, 213988, 146529), -1)
def test_a_plane_that_passes_by_one_unit_is_on_the_right_side(normal, point, past):
    """Terms of 60 bits that cancel but for one unit, which doubles round away: their error bound must not."""
    level = sum(n * x for n, x in zip(normal, point, strict=True)) + past
    planes = np.array(
        [(1, 0, 0, point[0]), (0, 1, 0, point[1]), (0, 0, 1, point[2]), (*normal, level)], np.int64
    )
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    assert meet(planes, 0, 1, 2, vertices, coordinates, 0)
    assert sign_at_vertex(planes, 3, vertices, coordinates, 0) == -past
    assert sign_at_point(planes, 3, np.array(point, np.int64) << POINT_BITS) == -past


def test_parallel_planes_have_no_common_point():
    planes = np.array([(1, 2, 3, 4), (1, 2, 3, 5), (0, 0, 1, 0), (-2, -4, -6, 8)], np.int64)
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    assert not meet(planes, 0, 1, 2, vertices, coordinates, 0)
    assert not meet(planes, 0, 2, 3, vertices, coordinates, 0)
