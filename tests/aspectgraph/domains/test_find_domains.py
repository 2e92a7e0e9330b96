"""Slivers are shrunk to nothing: small complexes cut and labelled by hand, with a least width of 5 steps."""

import numpy as np
import pytest
from solids import HALF, cut_box

from aspectgraph.cells.arrays import cell_centre
from aspectgraph.cells.split import leaves
from aspectgraph.domains.find_domains import Ruler, find_domains, largest_extent, union_has_room

pytestmark = pytest.mark.uncompiled

RULER = Ruler(min_width=5.0, reach=1e6)
A = 1
B = 2
C = 4
D = 8


def plane(axis, level):
    row = np.zeros(4, np.int64)
    row[axis] = 1
    row[3] = level
    return row


def domains_of(planes, label_at, ruler=RULER):
    """Cut the box [-1000, 1000]³, label its cells by their centres; return lists, adjacent lists and the result."""
    cx = cut_box(np.array(planes))
    for c in leaves(cx):
        cx.label[c, 0] = label_at(*cell_centre(cx, c))
    found = find_domains(cx, ruler)
    lists = [domain.label[0] for domain in found.domains]
    return (
        sorted(lists),
        sorted(tuple(sorted((lists[i], lists[j]))) for i, j in found.contacts),
        found,
    )


def test_what_a_sliver_parts_touches():
    lists, adjacent, found = domains_of(
        [plane(2, 0), plane(2, 2)], lambda x, y, z: C if z > 2 else A if z > 0 else B
    )
    assert lists == [B, C]
    assert adjacent == [(B, C)]
    assert found.n_slivers == 1
    assert sum(domain.volume for domain in found.domains) == pytest.approx((2 * HALF) ** 3)
    (contact,) = found.contacts.values()
    assert contact.area == pytest.approx((2 * HALF) ** 2)
    assert set(contact.planes) == {6, 7}


def test_what_a_stack_of_slivers_parts_touches():
    planes = [plane(2, 0), plane(2, 2), plane(2, 4)]
    lists, adjacent, found = domains_of(
        planes, lambda x, y, z: C if z > 4 else A if z > 2 else D if z > 0 else B
    )
    assert lists == [B, C]
    assert adjacent == [(B, C)]
    assert found.n_slivers == 2


def test_sliver_that_sticks_out_of_a_wide_domain_parts_nothing():
    # The layer 0 < z < 2 has the label of what lies above it where x > 0, and reaches on between B and C; it is less
    # than a tenth of the least width.
    planes = [plane(2, 0), plane(2, 2), plane(0, 0)]
    ruler = Ruler(min_width=30.0, reach=1e6)
    lists, adjacent, found = domains_of(
        planes, lambda x, y, z: B if z < 0 else A if x > 0 or z < 2 else C, ruler
    )
    assert lists == [A, B, C]
    assert adjacent == [(A, B), (A, C), (B, C)]
    plain = domains_of(
        [plane(2, 0), plane(0, 0)], lambda x, y, z: B if z < 0 else A if x > 0 else C
    )
    assert adjacent == plain[1]
    areas = [{tuple(p): c.area for p, c in result.contacts.items()} for result in (found, plain[2])]
    assert sum(areas[0].values()) == pytest.approx(sum(areas[1].values()), rel=1e-2)


@pytest.mark.parametrize("cuts", [[], [-800], [-900, -800], [-950, -900, -850, -800, 0]])
def test_thin_end_of_a_wedge_is_the_same_cut_or_uncut(cuts):
    # 0 < 100 z < x + 1100: between B and C lies a wedge 1 to 21 thick, less than 5 wherever it is cut off.
    planes = [plane(2, 0), np.array([1, 0, -100, -1100]), *(plane(0, x) for x in cuts)]
    lists, adjacent, found = domains_of(
        planes, lambda x, y, z: B if z < 0 else A if 100 * z < x + 1100 else C
    )
    assert lists == [A, B, C]
    assert adjacent == [(A, B), (A, C)]
    assert found.n_slivers == 0


def test_tail_joins_nothing():
    # Two wide domains of list A, left and right of a layer 2 thick of the same list.
    planes = [plane(2, 0), plane(2, 2), plane(0, -100), plane(0, 100)]
    lists, _, _ = domains_of(
        planes, lambda x, y, z: A if abs(x) > 100 or 0 < z < 2 else B if z < 0 else C
    )
    assert lists == [A, A, B, C]


def test_sliver_joins_what_it_parts_of_one_list():
    lists, adjacent, found = domains_of(
        [plane(2, 0), plane(2, 2)], lambda x, y, z: A if 0 < z < 2 else B
    )
    assert lists == [B]
    assert not adjacent
    assert found.n_slivers == 1


def test_sliver_of_the_same_list_takes_nothing_away():
    lists, adjacent, found = domains_of(
        [plane(2, 0), plane(2, 2)], lambda x, y, z: A if z > 0 else B
    )
    assert lists == [A, B]
    assert adjacent == [(A, B)]
    assert found.n_slivers == 0


def test_domain_wide_only_as_a_whole_stays():
    planes = [plane(2, 0), plane(2, 4), plane(2, 8)]
    lists, adjacent, found = domains_of(planes, lambda x, y, z: C if z > 8 else A if z > 0 else B)
    assert lists == [A, B, C]
    assert adjacent == [(A, B), (A, C)]
    assert found.n_slivers == 0


def column_in_a_wall(x, y, z):
    """B below; above it A to the left, D to the right, and between them C, a column 8 wide cut in two."""
    return B if z < 0 else A if x < -4 else D if x > 4 else C


@pytest.mark.parametrize("cuts", [[], [0], [-1, 2]])
def test_contact_wide_only_as_a_whole_counts(cuts):
    planes = [plane(2, 0), plane(0, -4), plane(0, 4), *(plane(0, x) for x in cuts)]
    lists, adjacent, _ = domains_of(planes, column_in_a_wall)
    assert lists == [A, B, C, D]
    assert adjacent == [(A, B), (A, C), (B, C), (B, D), (C, D)]


def test_contact_narrower_than_the_least_width_counts_not():
    # A and D meet above B in the plane x = 0; C is a beam of section 7 x 7 along that edge, so it touches each in a
    # strip 7 wide, less than one and a half times 5.
    planes = [plane(2, 0), plane(2, 7), plane(0, -7), plane(0, 0)]
    lists, adjacent, _ = domains_of(
        planes, lambda x, y, z: B if z < 0 else C if -7 < x < 0 and z < 7 else A if x < 0 else D
    )
    assert lists == [A, B, C, D]
    assert adjacent == [(A, B), (A, D), (B, D)]


def test_least_width_zero_keeps_everything():
    zero = Ruler(0.0, 1e6)
    planes = [plane(2, 0), plane(2, 1)]
    lists, adjacent, found = domains_of(
        planes, lambda x, y, z: C if z > 1 else A if z > 0 else B, zero
    )
    assert lists == [A, B, C]
    assert adjacent == [(A, B), (A, C)]
    assert found.n_slivers == 0


def test_sliver_inside_the_solid_belongs_to_no_domain():
    inside = 1 << 63
    planes = [plane(2, 0), plane(2, 2), plane(2, 500)]
    lists, adjacent, found = domains_of(
        planes, lambda x, y, z: B if z > 500 else A if 0 < z < 2 else inside
    )
    assert lists == [B]
    assert not adjacent
    assert (found.of_cell >= 0).sum() == 1


def test_union_of_polygons_holds_what_no_part_holds():
    left = np.array([(0, 0, 0), (4, 0, 0), (4, 100, 0), (0, 100, 0)], float)
    right = left + np.array([4, 0, 0])
    above = left + np.array([4, 0, 50])
    ruler = Ruler(7.0, 1e6)
    assert union_has_room([left, right], ruler)
    assert not union_has_room([left, above], ruler)
    assert not union_has_room([left, right], Ruler(9.0, 1e6))
    # 100 reaches away the least width is a hundred times what it is at the part
    up = np.array([0, 0, 100])
    assert not union_has_room([left + up, right + up], Ruler(7.0, 1.0))


def test_largest_extent_is_the_largest_distance():
    points = np.array([(0, 0, 0), (3, 0, 0), (0, 4, 0), (1, 1, 2)])
    assert largest_extent(points) == pytest.approx(5.0)
