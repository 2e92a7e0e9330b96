"""Which edges and surfaces of a part a target is about."""

import dataclasses

import numpy as np
import pytest
from measured_plate import measured_plan, thick_plate
from plan_examples import witness

from errors.measurands import Line, MeasuredCircle
from planner import RequestError
from planner.measuring.samples import PartModel, _holds


class HalfCircle:
    """An arc from 90 to 270 degrees about z."""

    axis = np.array([0.0, 0.0, 1.0])
    reference = np.array([1.0, 0.0, 0.0])
    start_rad = np.pi / 2
    end_rad = 3 * np.pi / 2


@pytest.mark.parametrize(
    ("start", "span", "held"),
    [
        ([0.0, 1.0, 0.0], np.pi, True),
        ([-1.0, 0.0, 0.0], 1.0, True),
        ([0.0, -1.0, 0.0], np.pi, False),
        ([0.0, 1.0, 0.0], 4.0, False),
    ],
    ids=["the same", "a part of it", "the other half", "more"],
)
def test_one_circle_may_carry_several_arcs(start, span, held):
    geometry = MeasuredCircle([5.0, 5, 0], [0, 0, 1], 2.0, np.array(start), span)
    assert _holds(HalfCircle(), geometry) is held


def test_surfaces_that_a_target_measures_are_free():
    solid = thick_plate()
    model = PartModel(solid, measured_plan(solid, ["left", "width"]).targets)
    free = [model.carriers.surfaces[k] for k in model.free]
    (cylinder,) = [one for one in free if not one.is_plane]
    assert cylinder.radius_mm == pytest.approx(8.0)
    normals = {tuple(one.axis.round(9).tolist()) for one in free if one.is_plane}
    # the faces in front and at the back, and not the top
    assert normals == {(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)}


def test_facets_of_a_hole_are_no_edges():
    solid = thick_plate()
    model = PartModel(solid, measured_plan(solid).targets)
    kinds = [edge.name[0] for edge in model.edges.edges]
    assert (kinds.count("e"), kinds.count("r")) == (12, 4)


def test_a_part_without_the_rim_is_refused():
    solid = thick_plate()
    plan = measured_plan(solid, ["left"])
    other = thick_plate({"left": ((20.0, 25.0), 7.0), "right": ((60.0, 25.0), 6.0)})
    with pytest.raises(RequestError, match="Got one without the rim or arc of 'left'"):
        PartModel(other, plan.targets)


def test_a_target_may_be_on_a_part_of_an_edge():
    """Plans measure on the part of an edge that is seen: it lies on the edge, and is not its whole."""
    solid = thick_plate()
    target = measured_plan(solid, ["width"]).targets["width"]
    first, second = target.geometry
    part = Line(first.p + 0.25 * (first.q - first.p), first.middle)

    def along(first):
        ways = (witness("distance", target.entities, (first, second)),)
        return {"width": dataclasses.replace(target, witnesses=ways)}

    model = PartModel(solid, along(part))
    found, _ = model.measured["width"]
    whole, _ = PartModel(solid, {"width": target}).measured["width"]
    assert found.edge_ids == whole.edge_ids
    assert found.geometry is part
    down = np.array([0.0, 0.0, -1.0])
    beside = Line(part.p + down, part.q + down)
    with pytest.raises(RequestError, match="must be the one that was planned"):
        PartModel(solid, along(beside))
