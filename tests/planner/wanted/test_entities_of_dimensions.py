"""Entities that dimensions stand for, what of them cannot be measured, and how plans state them: a plate with holes."""

import numpy as np
import pytest
from holed_plate import BACK, FRONT, HOLES, LEFT, holed_plate

from planner import Dimension, RequestError
from planner.exceptions import PlanFileError
from planner.identity import plain_value, restored_value
from planner.request.resolve import resolve_wanted
from planner.request.targets import Target

PLATE = holed_plate()
UPPER = [rim.id for rim in PLATE.rims() if rim.centre[2] == 10.0]


def planned(dimension, name="it"):
    _, (target,) = resolve_wanted(PLATE, {name: dimension}, 0.98)
    return target


def test_an_item_with_the_name_of_an_id_is_not_taken_for_it():
    """The front edge is called as a rim is: the rim gets another name, and the bore is still of the rim."""
    wanted = {UPPER[0]: FRONT, "bore": Dimension.diameter(UPPER[0], max_error_mm=0.5)}
    entities, (edge, bore) = resolve_wanted(PLATE, wanted, 0.98)
    assert list(entities) == [UPPER[0], f"{UPPER[0]} (2)"]
    assert entities[UPPER[0]].kind == "edge"
    assert entities[f"{UPPER[0]} (2)"].kind == "rim"
    assert edge.witness.entities == (UPPER[0],)
    assert bore.witness.entities == (f"{UPPER[0]} (2)",)
    assert bore.measurand.nominal in [pytest.approx(2 * radius) for _, radius in HOLES.values()]


def test_an_edge_that_two_items_need_is_one_entity():
    wanted = {"front": FRONT, "depth": Dimension.distance(FRONT[::-1], BACK, max_error_mm=0.5)}
    entities, (_, depth) = resolve_wanted(PLATE, wanted, 0.98)
    assert len(entities) == 2
    assert depth.witness.entities[0] == "front"
    assert depth.witness.entities[1] == "edge from (0, 50, 10) to (80, 50, 10)"
    assert depth.measurand.nominal == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("dimension", "message"),
    [
        (Dimension.diameter("r99", max_error_mm=0.5), r"^dimension 'it': .*r99"),
        (
            Dimension.distance(FRONT, LEFT, max_error_mm=0.5),
            r"^dimension 'it': .*must be parallel\. Got 90 degrees",
        ),
        (
            Dimension.length(FRONT, max_error_mm=90.0),
            r"^dimension 'it': .*smaller than its nominal value 80",
        ),
        (
            Dimension.diameter(UPPER[0], max_error_mm=1e-3),
            r"must have at least \d+ chords, because a mesh.* Got 24,",
        ),
    ],
)
def test_what_cannot_be_measured_is_named(dimension, message):
    with pytest.raises(RequestError, match=message):
        resolve_wanted(PLATE, {"it": dimension}, 0.98)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"nominal": 50.1}, r"targets.it.nominal must be that of the geometry, 50\. Got 50\.1"),
        ({"kind": "diameter"}, r"targets.it must be one that can be measured\. Got: "),
        ({"geometry": [{"p": [0, 0, 0], "q": [0, 0, 0]}] * 2}, r"one that can be measured\. Got: .*twice"),
        ({"direction": [1.0, 0.0, 0.0]}, r"must be one that can be measured\. Got: direction must not run"),
    ],
)  # fmt: skip
def test_a_plan_s_dimension_comes_back_unless_its_fields_contradict_each_other(changes, message):
    one = planned(Dimension.distance(FRONT, BACK, tolerance_mm=(-0.5, 0.5)))
    data = plain_value(one)
    again = restored_value(Target, data)
    assert again == one
    assert plain_value(again) == data
    assert one != planned(Dimension.distance(FRONT, BACK, tolerance_mm=(-0.5, 0.4)))
    assert np.isclose(data["nominal"], 50.0)
    changes = dict(changes)
    if "geometry" in changes:
        changes["witnesses"] = [{**data["witnesses"][0], "geometry": changes.pop("geometry")}]
    with pytest.raises(PlanFileError, match=message):
        restored_value(Target, {**data, **changes})
