"""Dimensions with several sets of entities: how they are asked for, which are kept, and what stretches they get."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from holed_plate import BACK, CAMERA, FRONT, HEIGHT, UNCERTAINTY, holed_plate

from aspectgraph import Stretch
from planner import Dimension, Effort, InspectionPlan, plan_inspection
from planner.exceptions import PlanFileError, RequestError
from planner.request.dimension_files import read_wanted
from planner.request.request import choice_for
from planner.request.resolve import resolve_wanted, stretch_ways
from planner.request.targets import EntityRecord, WitnessChoice, kept_witnesses

PLATE = holed_plate()
KINDS = ("distance", "diameter", "length", "angle")
LOWER_FRONT, LOWER_BACK = ([[x, y, 0] for x, y, _ in edge] for edge in (FRONT, BACK))
LEFT, RIGHT = ([[x, 0, 10], [x, 50, 10]] for x in (0, 80))
LOWER_LEFT, LOWER_RIGHT = ([[x, y, 0] for x, y, _ in edge] for edge in (LEFT, RIGHT))
EVERYTHING = WitnessChoice(most=100)


def rims_of(solid, height):
    rims = [rim for rim in solid.rims() if abs(rim.centre[2] - height) < 1e-6]
    return [rim.id for rim in sorted(rims, key=lambda rim: rim.centre[0])]


def test_any_of_joins_dimensions_that_differ_in_their_entities_only():
    one, two, three = (Dimension.diameter(rim, max_error_mm=0.1) for rim in ("r0", "r1", "r2"))
    joined = Dimension.any_of([one, Dimension.any_of([two, three])])
    assert joined.witnesses == (("r0",), ("r1",), ("r2",))
    assert replace(joined, alternatives=()) == one
    with pytest.raises(RequestError, match="must hold at least one dimension"):
        Dimension.any_of([])
    with pytest.raises(RequestError, match="differ only in their entities"):
        Dimension.any_of([one, Dimension.radius("r1", max_error_mm=0.1)])


def test_a_file_names_other_entities(tmp_path):
    path = tmp_path / "wanted.toml"
    path.write_text(
        'bore = { diameter = "r0", any = ["r1", ["r2"]], max_error = 0.1 }\n'
        "width = { distance = [17, 18], any = [[21, 22], [25, 26]], max_error = 0.1 }\n"
    )
    wanted = read_wanted(path, KINDS)
    assert wanted["bore"].witnesses == (("r0",), ("r1",), ("r2",))
    assert wanted["width"].witnesses == ((17, 18), (21, 22), (25, 26))
    path.write_text('bore = { diameter = "r0", any = "r1", max_error = 0.1 }\n')
    with pytest.raises(RequestError, match="'bore': any must be a list of sets of entities"):
        read_wanted(path, KINDS)


def test_witnesses_of_another_value_are_refused():
    left, right = rims_of(PLATE, HEIGHT)
    odd = Dimension.any_of([Dimension.diameter(rim, max_error_mm=0.1) for rim in (left, right)])
    with pytest.raises(RequestError, match=r"'bore': all its sets .* same nominal value, 16"):
        resolve_wanted(PLATE, {"bore": odd}, 0.98, choice=EVERYTHING)


def test_few_witnesses_are_kept_that_lie_far_apart():
    width = Dimension.any_of(
        [
            Dimension.distance(front, back, max_error_mm=0.1)
            for front, back in ((FRONT, BACK), (FRONT, LOWER_BACK), (LOWER_FRONT, LOWER_BACK))
        ]
    )
    # across the plate, seen along its normal, all three are 50 mm; told by their direction
    width = replace(width, direction=(0.0, 1.0, 0.0))
    _, (target,) = resolve_wanted(PLATE, {"width": width}, 0.98, choice=EVERYTHING)
    assert len(target.witnesses) == 3
    assert kept_witnesses(target.witnesses, WitnessChoice(1)) == [0]
    # the middles lie at heights of 10, 5 and 0 mm
    assert kept_witnesses(target.witnesses, WitnessChoice(2)) == [0, 2]
    assert kept_witnesses(target.witnesses, WitnessChoice(3)) == [0, 1, 2]
    # 80 mm by 50 mm are 94.3 mm across, and one more with 10 mm of height: 94.9 mm
    assert kept_witnesses(target.witnesses, WitnessChoice(3, widest_mm=94.5)) == [0, 2]
    # if none fits, the first stays, for a reason to be told
    assert kept_witnesses(target.witnesses, WitnessChoice(3, widest_mm=50.0)) == [0]


def test_a_set_that_contains_another_is_left_out():
    left, _ = rims_of(PLATE, HEIGHT)
    _, (one,) = resolve_wanted(PLATE, {"d": Dimension.diameter(left, max_error_mm=0.1)}, 0.98)
    small = one.witness
    large = replace(small, records=(*small.records, EntityRecord("e5", "edge")))
    assert kept_witnesses([large, small, small], EVERYTHING) == [1]


def test_stretches_of_a_distance_lie_side_by_side():
    wanted = {"d": Dimension.distance(FRONT, BACK, max_error_mm=0.1)}
    entities, _ = resolve_wanted(PLATE, wanted, 0.98)
    way = list(entities.values())
    ways = stretch_ways(PLATE, "distance", way, 20.0)
    assert len(ways) == 4
    for pair in ways:
        assert all(isinstance(one, Stretch) for one in pair)
        middles = []
        for one in pair:
            start, end = PLATE.edge_points(one.edge)
            middles.append(start + float(one.start + one.end) / 2 * (end - start))
        assert middles[0][0] == pytest.approx(middles[1][0], abs=0.01)
        assert abs(middles[0][1] - middles[1][1]) == pytest.approx(50.0)
    # the whole edge is as short as a piece, or all of it is measured
    assert stretch_ways(PLATE, "distance", way, 60.0) == []
    assert stretch_ways(PLATE, "length", way[:1], 20.0) == []


def test_stretches_become_witnesses_that_need_less_of_the_picture():
    wanted = {"d": Dimension.distance(LEFT, RIGHT, max_error_mm=0.1)}
    choice = WitnessChoice(most=4, widest_mm=90.0, stretch_mm=12.5)
    entities, (target,) = resolve_wanted(PLATE, wanted, 0.98, choice=choice)
    # the whole edges are 94.3 mm across and never in one picture
    assert len(target.witnesses) == 4
    assert set(entities) == {name for one in target.witnesses for name in one.entities}
    for witness in target.witnesses:
        assert all("[" in name for name in witness.entities)
        assert witness.measurand.nominal == pytest.approx(80.0)
        ends = witness.segments
        assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == pytest.approx(
            [12.5, 12.5], abs=0.01
        )
    assert choice_for(CAMERA, 3).stretch_mm == pytest.approx(
        min(CAMERA.sensor_size_mm) * 400.0 / CAMERA.image_distance_mm / 4
    )


def test_a_stretch_has_no_length():
    edge = next(iter(resolve_wanted(PLATE, {"x": FRONT}, 0.98)[0].values())).edge_ids[0]
    with pytest.raises(RequestError, match="must be a whole edge"):
        resolve_wanted(PLATE, {"x": Stretch(edge, 0, "1/2")}, 0.98)


@pytest.fixture(scope="module")
def plans():
    """The plate across from above only, along from below only; and both from either side."""
    above = Dimension.distance(LEFT, RIGHT, max_error_mm=0.2)
    below = Dimension.distance(LOWER_FRONT, LOWER_BACK, max_error_mm=0.2)
    either = Dimension.any_of([below, Dimension.distance(FRONT, BACK, max_error_mm=0.2)])
    effort = Effort(viewpoints=20, pricing_rounds=4, refutations=2, bound_nodes=4000)
    return [
        plan_inspection(
            PLATE,
            {"across": above, "along": along},
            CAMERA,
            UNCERTAINTY,
            effort=effort,
            stand_off_mm=50.0,
        )
        for along in (below, either)
    ]


def test_a_choice_saves_a_setting_where_two_exclude_each_other(plans):
    """Opposite edges of the top are seen together from above only, those of the bottom from below only."""
    alone, either = plans
    assert (len(alone.settings), alone.lower_bound) == (2, 2)
    assert (len(either.settings), either.lower_bound) == (1, 1)
    assert alone.complete
    assert either.complete
    (setting,) = either.settings
    used = either.dimensions["along"].choosing(setting.witness["along"])
    assert all(item.p[2] == item.q[2] == HEIGHT for item in used.geometry)
    assert setting.position[2] > HEIGHT
    reasons = setting.passed_over["along"]
    assert "hidden" in reasons.values()


def test_a_plan_with_witnesses_is_read_as_it_was_written(plans, tmp_path):
    either = plans[1]
    path = tmp_path / "plan.json"
    either.write(path)
    read = InspectionPlan.read(path)
    assert read == either
    assert read.settings[0].witness == either.settings[0].witness
    row = next(row for row in read.rows() if row["name"] == "along")
    used = read.dimensions["along"].choosing(read.settings[0].witness["along"])
    assert row["entities"] == ", ".join(used.entities)
    data = either.to_dict()
    data["settings"][0]["witness"]["along"] = 77
    with pytest.raises(PlanFileError, match=r"witness\.along must be below \d+.* Got 77"):
        InspectionPlan.from_dict(data)


def test_simulation_measures_by_the_witness_that_is_used(plans):
    """From above, the lower edges would not be measured as stated: they are elsewhere in the image."""
    either = plans[1]
    result = either.simulate(2000, rng=3)
    assert result.confirmed
