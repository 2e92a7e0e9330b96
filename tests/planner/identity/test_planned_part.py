"""A plan without a digest of its part tells other parts by the edges and circles that it measures."""

from dataclasses import replace
from pathlib import Path

import pytest
from holed_plate import HOLES
from measured_plate import measured_plan, thick_plate

from aspectgraph import read_solid
from planner import read_plan
from planner.identity import other_part

EXAMPLES = Path(__file__).parents[3] / "examples"


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


def test_coarse_chords_of_a_real_part_are_its_circles():
    """The smallest bore of this part has 12 chords, which are 3.4 % of the radius off its circle."""
    of_file = read_plan(EXAMPLES / "measured/plan.json")
    bare = replace(of_file, request={})
    assert other_part(bare, read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")) == ""
    assert other_part(bare, read_solid(EXAMPLES / "two_pocket_block.off")) != ""
