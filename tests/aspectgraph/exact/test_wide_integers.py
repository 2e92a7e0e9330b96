"""The 256-bit instructions, compiled anew, against Python's integers, limb by limb: what stands in must be the same."""

import numba as nb
import numpy as np
import pytest
import wide_integers
from hypothesis import given, settings
from hypothesis import strategies as st

from aspectgraph.exact.grid import LIMBS, _meet, _sign_at_point_exact, _sign_at_vertex_exact

pytestmark = pytest.mark.skipif(bool(nb.config.DISABLE_JIT), reason="nothing is compiled")

PLANE = st.tuples(*[st.integers(-(2**42), 2**42)] * 3, st.integers(-(2**62), 2**62))
POINT = st.tuples(*[st.integers(-(2**45), 2**45)] * 3)


@nb.njit
def compiled(planes, point, vertices):
    met = _meet(planes, 0, 1, 2, vertices, 0)
    at_point = _sign_at_point_exact(planes, 3, point[0], point[1], point[2])
    return met, _sign_at_vertex_exact(planes, 3, vertices, 0), at_point


@settings(max_examples=200, deadline=None)
@given(st.lists(PLANE, min_size=4, max_size=4), POINT)
def test_instructions_do_what_integers_do(planes, point):
    table = np.array(planes, np.int64)
    made, expected = np.zeros((2, 1, 4, LIMBS), np.int64)
    found = compiled(table, np.array(point, np.int64), made)
    met = wide_integers._meet(table, 0, 1, 2, expected, 0)
    at_vertex = wide_integers._sign_at_vertex_exact(table, 3, expected, 0)
    assert found == (met, at_vertex, wide_integers._sign_at_point_exact(table, 3, *point))
    np.testing.assert_array_equal(made, expected)


@pytest.mark.parametrize(
    "value", [0, 1, -1, 2**63, -(2**63), 2**64, -(2**64), 2**200, -(2**255), 2**255 - 1]
)
def test_limbs_there_and_back(value):
    assert wide_integers.value_of(wide_integers.limbs(value)) == value
