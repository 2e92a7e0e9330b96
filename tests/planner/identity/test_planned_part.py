"""A plan without a digest of its part tells other parts by the edges and circles that it measures."""

import pytest
from holed_plate import HOLES
from measured_plate import measured_plan, thick_plate

from planner.identity.planned_part import other_part


def plan():
    return measured_plan(thick_plate(), request={})


def test_the_part_of_the_plan():
    assert other_part(plan(), thick_plate()) == ""


@pytest.mark.parametrize(("shift", "more"), [(1.0, 0.0), (0.0, 1.0)])
def test_a_hole_that_moved_or_grew_by_1_mm(shift, more):
    holes = {
        name: ((centre[0] + shift, centre[1]), radius + more)
        for name, (centre, radius) in HOLES.items()
    }
    assert other_part(plan(), thick_plate(holes)) == "which has no edge at 'left'"
