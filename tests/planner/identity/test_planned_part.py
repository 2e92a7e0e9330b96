"""A plan knows its part by a digest, and no other part is taken for it."""

from pathlib import Path

import pytest
from holed_plate import HOLES
from measured_plate import measured_plan, thick_plate

from aspectgraph import read_solid
from planner import read_plan

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.mark.parametrize(("shift", "more"), [(1.0, 0.0), (0.0, 1.0)])
def test_a_hole_that_moved_or_grew_by_1_mm(shift, more):
    request = measured_plan(thick_plate()).request
    assert request.other_part(thick_plate()) == ""
    holes = {
        name: ((centre[0] + shift, centre[1]), radius + more)
        for name, (centre, radius) in HOLES.items()
    }
    assert request.other_part(thick_plate(holes)) == "which has another shape"


def test_a_part_from_a_file():
    request = read_plan(EXAMPLES / "measured/plan.json").request
    assert request.other_part(read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")) == ""
    assert request.other_part(read_solid(EXAMPLES / "two_pocket_block.off")) != ""
