"""Dimensions with several sets of entities: how they are asked for, which are kept, and what stretches they get."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from holed_plate import (
    BACK,
    CAMERA,
    FRONT,
    HEIGHT,
    HOLES,
    LEFT,
    QUICK,
    UNCERTAINTY,
    holed_plate,
    upper_rims,
)
from plan_examples import BRIEF
from solids import prism, ring

from aspectgraph import (
    Solid,
    Stretch,
    compute_regions,
    read_solid,
    resolve_entities,
    select_entities,
)
from errors.measurands import Localisation
from planner import (
    Dimension,
    Effort,
    InspectionPlan,
    RequestError,
    look_at,
    plan_inspection,
    plan_setting,
    predict,
)
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE
from planner.exceptions import PlanFileError
from planner.plan import read_plan
from planner.request.dimension_files import read_wanted
from planner.request.models import Means
from planner.request.problem import Objective, choice_for
from planner.request.reach import Seen, TargetSpace
from planner.request.resolve import is_circle, resolve_wanted, stretch_ways, with_places
from planner.request.target_records import plain_target, target_from
from planner.request.targets import (
    EdgeTarget,
    EntityRecord,
    PlannedDimension,
    WitnessChoice,
    kept_witnesses,
)

PLATE = holed_plate()
KINDS = ("distance", "diameter", "length", "angle")
LOWER_FRONT, LOWER_BACK = ([[x, y, 0] for x, y, _ in edge] for edge in (FRONT, BACK))
LEFT_ANY_WITNESS, RIGHT = ([[x, 0, 10], [x, 50, 10]] for x in (0, 80))
LOWER_LEFT, LOWER_RIGHT = ([[x, y, 0] for x, y, _ in edge] for edge in (LEFT_ANY_WITNESS, RIGHT))
EVERYTHING = WitnessChoice(n_witnesses=100)


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
    wanted = {"d": Dimension.distance(LEFT_ANY_WITNESS, RIGHT, max_error_mm=0.1)}
    choice = WitnessChoice(n_witnesses=4, widest_mm=90.0, stretch_mm=12.5)
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
    above = Dimension.distance(LEFT_ANY_WITNESS, RIGHT, max_error_mm=0.2)
    below = Dimension.distance(LOWER_FRONT, LOWER_BACK, max_error_mm=0.2)
    either = Dimension.any_of([below, Dimension.distance(FRONT, BACK, max_error_mm=0.2)])
    effort = Effort(
        viewpoints=20, pricing_rounds=4, refutations=2, bound_nodes=4000, margin_generations=3
    )
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
    assert not any("= >" in reason for reason in reasons.values())


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


# A target owns its model and its witnesses: any of them gives its value, each as a set of
# entities seen together.


MEANS = Means(CAMERA, UNCERTAINTY, 0.98, Localisation.gaussian(0.1))
BORE, _ = upper_rims(PLATE)


def space_of(seen: dict[str, list[bool]]):
    """Return a space whose entities are seen from viewpoints 0, 1, ... as stated, whatever their coordinates."""

    def observable(points, names):
        rows = np.asarray(points)[:, 0].astype(int)
        return np.array([seen[name] for name in names]).T[rows]

    return SimpleNamespace(observable=observable)


def test_a_target_is_observable_where_all_entities_of_any_witness_are():
    seen = {
        "a": [True, True, False, False, True],
        "b": [True, False, False, True, True],
        "c": [False, False, True, False, True],
    }
    ends = np.eye(3)[:2]
    space = TargetSpace(
        space_of(seen), {"width": Seen([("a", "b"), ("c",)], ends), "c": Seen([("c",)], ends)}
    )
    points = np.arange(5)[:, None] * [1.0, 0.0, 0.0]
    either = [(a and b) or c for a, b, c in zip(*seen.values(), strict=True)]
    assert space.observable(points).T.tolist() == [either, seen["c"]]
    assert space.observable(points, ["c"]).T.tolist() == [seen["c"]]
    assert space.entities_of(["width", "c"]) == ["a", "b", "c"]


def test_the_objective_asks_each_target_for_its_own_model():
    """Edges and dimensions in any order: column by column what the target says alone."""
    wanted = {
        "front": FRONT,
        "bore": Dimension.diameter(BORE, max_error_mm=0.1),
        "length": Dimension.length(FRONT, max_error_mm=0.1),
        "side": [[0, 0, 10], [0, 50, 10]],
    }
    _, targets = resolve_wanted(PLATE, wanted, 0.98)
    rng = np.random.default_rng(3)
    poses = look_at(rng.uniform([-80, -80, 300], [140, 130, 450], (50, 3)), [40.0, 25.0, 10.0])
    whole = Objective(targets, MEANS).probability(poses)
    alone = np.stack([target.probability(poses, MEANS) for target in targets], axis=1)
    assert whole == pytest.approx(alone, abs=1e-12)
    assert (whole.max(axis=0) > 0.5).all()
    some = rng.random(whole.shape) < 0.5
    assert Objective(targets, MEANS).probability_where(poses, some) == pytest.approx(whole[some])


def test_what_is_necessary_is_the_target_s_own():
    """The image of an edge has a least length. Of two points of a rim nothing is known."""
    wanted = {"front": FRONT, "bore": Dimension.diameter(BORE, max_error_mm=0.1)}
    _, (edge, bore) = resolve_wanted(PLATE, wanted, 0.98)
    # half of ln(1.02 / 0.98) is 0.020003
    assert edge.least_image_mm(0.98, 0.01, 0.1) == pytest.approx(0.01 / 0.020003, rel=1e-4)
    assert edge.least_image_mm(0.98, 0.01, 1.0) == 1.0
    assert bore.least_image_mm(0.98, 0.01, 1.0) == 0.0


def test_a_plan_keeps_an_edge_as_it_keeps_a_dimension():
    wanted = {"front": FRONT, "bore": Dimension.diameter(BORE, max_error_mm=0.1)}
    _, targets = resolve_wanted(PLATE, wanted, 0.98)
    edge, bore = (target.measured_with(MEANS) for target in targets)
    assert isinstance(edge, EdgeTarget)
    assert isinstance(bore, PlannedDimension)
    assert (edge.kind, edge.unit, bore.kind, bore.unit) == ("length", "mm", "diameter", "mm")
    assert edge.nominal == pytest.approx(80.0)
    assert edge.permitted_error == pytest.approx(0.02 * 80.0)
    assert bore.nominal in [pytest.approx(2 * radius) for _, radius in HOLES.values()]
    pose = look_at([[40.0, 25.0, 410.0]], [40.0, 25.0, 10.0])[0]
    # square on at 400 mm, a share of the image's length is the permitted error times the scale
    scale = CAMERA.image_distance_mm / (400.0 * CAMERA.pixel_pitch_mm[0])
    assert edge.permitted_error_px(pose, CAMERA) == pytest.approx(0.02 * 80.0 * scale)
    assert bore.permitted_error_px(pose, CAMERA) == pytest.approx(0.1 * scale)
    # the localisation of the plan is the dimension's; an edge's ends are on whole pixels
    assert bore.localisation == MEANS.localisation
    assert edge.localisation.model == "rounding"
    for target in (edge, bore):
        described = target.describe(pose, MEANS)
        assert described.nominal == pytest.approx(target.nominal)
        assert described.standard_uncertainty > 0


# A distance asked for at several places along its edges: their stretches and names, and what is
# refused.


KINDS_PLACES = ("distance", "diameter")
NAMES = [f"width [{k} of 3 places]" for k in (1, 2, 3)]


def width(front=FRONT, back=BACK, n=3):
    return Dimension.distance(front, back, max_error_mm=0.1, places=n)


def spans(solid, dimension, axis=0):
    """From where to where each stretch of a dimension reaches along an axis, mm."""
    found = []
    for one in dimension.entities:
        start, end = solid.edge_points(one.edge)[:, axis]
        found.append(sorted(start + float(share) * (end - start) for share in (one.start, one.end)))
    return found


def block(top):
    """A block 80 mm long and 20 mm high whose upper face has these corners, in x and y."""
    corners = [(*p, z) for z in (0.0, 20.0) for p in top]
    faces = [(3, 2, 1, 0), (4, 5, 6, 7)]
    faces += [(i, (i + 1) % 4, (i + 1) % 4 + 4, i + 4) for i in range(4)]
    return Solid(np.array(corners, dtype=float), faces, name="block")


def test_three_places_are_thirds_of_both_edges():
    found = with_places(PLATE, {"bore": "r0", "width": width(), "front": FRONT})
    assert list(found) == ["bore", *NAMES, "front"]
    for k, name in enumerate(NAMES):
        assert found[name].places == 1
        assert all(one.share == pytest.approx(1 / 3) for one in found[name].entities)
        for low, high in spans(PLATE, found[name]):
            assert (low, high) == pytest.approx((80 * k / 3, 80 * (k + 1) / 3))
    texts = {str(one) for name in NAMES for one in found[name].entities}
    assert len(texts) == 6
    assert all(text.split("[")[1] in ("0:1/3]", "1/3:2/3]", "2/3:1]") for text in texts)


def test_places_lie_where_the_edges_face_each_other():
    # the front edge has 80 mm, and the back edge the 40 mm from 20 to 60
    solid = block([(0, 0), (80, 0), (60, 30), (20, 30)])
    front = [[0, 0, 20], [80, 0, 20]]
    back = [[20, 30, 20], [60, 30, 20]]
    found = with_places(solid, {"width": width(front, back, 4)})
    for k, dimension in enumerate(found.values()):
        for span in spans(solid, dimension):
            assert span == pytest.approx((20 + 10 * k, 30 + 10 * k), abs=1e-9)


@pytest.mark.parametrize("lean", [0.0, 0.012])
def test_each_place_has_its_own_value(lean):
    """The back face leans by 12 µm over 80 mm: 0.009 degrees. At the middles of thirds that is 1, 3 and 5 sixths."""
    solid = block([(0, 0), (80, 0), (80, 30 + lean), (0, 30)])
    back = [[0, 30, 20], [80, 30 + lean, 20]]
    asked = {"width": Dimension.distance([[0, 0, 20], [80, 0, 20]], back, accuracy=0.99, places=3)}
    choice = WitnessChoice(n_witnesses=5, stretch_mm=5.0)
    _, targets = resolve_wanted(solid, asked, 0.98, choice=choice)
    for k, target in enumerate(targets):
        value = target.witnesses[0].measurand.nominal
        # perpendicular to the mean direction: the cosine of half the angle differs from 1 by 3e-9
        assert value == pytest.approx(30 + lean * (2 * k + 1) / 6, abs=1e-6)
        assert all(
            one.measurand.nominal == pytest.approx(value, abs=1e-3) for one in target.witnesses
        )


def test_a_place_offers_shorter_stretches_of_its_own():
    choice = WitnessChoice(n_witnesses=3, stretch_mm=9.0)
    entities, targets = resolve_wanted(PLATE, {"width": width()}, 0.98, choice=choice)
    for k, target in enumerate(targets):
        assert len(target.witnesses) == 3
        for witness in target.witnesses:
            x = witness.segments[..., 0]
            assert 80 * k / 3 - 1e-6 <= x.min() < x.max() <= 80 * (k + 1) / 3 + 1e-6
    assert {one.kind for one in entities.values()} == {"edge"}


def test_other_edges_serve_the_places_that_they_reach():
    both = Dimension.any_of([width(), width(LOWER_FRONT, LOWER_BACK)])
    found = with_places(PLATE, {"width": both})
    for k, dimension in enumerate(found.values()):
        (lower,) = dimension.alternatives
        for one in lower:
            start, end = PLATE.edge_points(one.edge)
            assert start[2] == end[2] == 0
            at = sorted(start[0] + float(s) * (end[0] - start[0]) for s in (one.start, one.end))
            assert at == pytest.approx((80 * k / 3, 80 * (k + 1) / 3))


def test_files_state_places(tmp_path):
    path = tmp_path / "wanted.toml"
    path.write_text("width = { distance = [17, 18], places = 3, max_error = 0.1 }\n")
    assert read_wanted(path, KINDS_PLACES) == {
        "width": Dimension.distance(17, 18, max_error_mm=0.1, places=3)
    }
    path = tmp_path / "wanted.json"
    path.write_text('{"width": {"distance": [17, 18], "places": 3, "max_error": 0.1}}')
    assert read_wanted(path, KINDS_PLACES)["width"].places == 3


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("0", "'width': places must be an integer of at least 1. Got 0"),
        ("-2", "places must be an integer of at least 1. Got -2"),
        ("2.5", "places must be an integer of at least 1. Got 2.5"),
        ("true", "places must be an integer of at least 1. Got True"),
        ('"3"', "places must be an integer of at least 1. Got '3'"),
        ("101", "places must be at most 100. Got 101"),
    ],
)
def test_a_number_of_places_that_is_none_is_refused(tmp_path, value, said):
    path = tmp_path / "wanted.toml"
    path.write_text(f"width = {{ distance = [17, 18], places = {value}, max_error = 0.1 }}\n")
    with pytest.raises(RequestError) as caught:
        read_wanted(path, KINDS_PLACES)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: Dimension("diameter", ("r0",), accuracy=0.9, places=2),
            "places must be 1 unless it is a distance of two edges. Got 2 for a diameter",
        ),
        (
            lambda: width(FRONT, upper_rims(PLATE)[0]),
            "'width': places must be 1 unless both entities are edges. Got a rim",
        ),
        (
            lambda: width(FRONT, LEFT),
            "'width': places must be 1 unless two edges face each other for so many stretches. Got 3",
        ),
        (
            lambda: Dimension.any_of([width(), width(LEFT, [[80, 0, 10], [80, 50, 10]])]),
            "'width': any must hold edges next to a position of the first ones. Got edges",
        ),
        (lambda: width(999, 1), "'width': an edge id must be in"),
    ],
)
def test_what_has_no_places_is_refused(make, said):
    with pytest.raises(RequestError) as caught:
        with_places(PLATE, {"width": make()})
    assert said in str(caught.value)


def test_a_name_of_a_place_must_be_free():
    with pytest.raises(RequestError, match=r"of a position of 'width' must be free"):
        with_places(PLATE, {"width": width(), NAMES[1]: FRONT})


@pytest.fixture(scope="module")
def plan():
    effort = replace(BRIEF, witnesses=1)
    wanted = {"width": Dimension.distance(FRONT, BACK, max_error_mm=0.2, places=3)}
    return plan_inspection(PLATE, wanted, CAMERA, UNCERTAINTY, effort=effort)


def test_a_plan_measures_each_place_on_its_own_stretch(plan, tmp_path):
    assert list(plan.dimensions) == NAMES
    assert plan.complete
    assert set(plan.inspected) == set(NAMES)
    assert plan.n_features == 3
    middles = [
        np.mean([(line.p + line.q) / 2 for line in plan.dimensions[name].geometry], axis=0)
        for name in NAMES
    ]
    assert np.array(middles) == pytest.approx(
        np.array([(80 * (2 * k + 1) / 6, 25, 10) for k in range(3)])
    )
    assert all(plan.dimensions[name].nominal == pytest.approx(50.0) for name in NAMES)
    path = tmp_path / "plan.json"
    plan.write(path)
    assert InspectionPlan.read(path) == plan
    # it is asked for again from what the plan stores
    stored = InspectionPlan.read(path).targets
    assert list(stored) == NAMES


# Entities that dimensions stand for, what of them cannot be measured, and how plans state them: a
# plate with holes.


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
        ({"geometry": [{"p": [0, 0, 0], "q": [0, 0, 0]}] * 2}, r"geometry\[0\]: a line must have .*twice"),
        ({"direction": [1.0, 0.0, 0.0]}, r"must be one that can be measured\. Got: direction must not run"),
    ],
)  # fmt: skip
def test_a_plan_s_dimension_comes_back_unless_its_fields_contradict_each_other(changes, message):
    one = planned(Dimension.distance(FRONT, BACK, tolerance_mm=(-0.5, 0.5)))
    data = plain_target(one)
    again = target_from(data)
    assert again == one
    assert plain_target(again) == data
    assert one != planned(Dimension.distance(FRONT, BACK, tolerance_mm=(-0.5, 0.4)))
    assert np.isclose(data["nominal"], 50.0)
    changes = dict(changes)
    if "geometry" in changes:
        changes["witnesses"] = [{**data["witnesses"][0], "geometry": changes.pop("geometry")}]
    with pytest.raises(PlanFileError, match=message):
        target_from({**data, **changes})


# Rims and arcs that are asked for as entities: their diameter or radius is measured, at the
# call's accuracy.


# 24 chords are up to 0.07 mm off these circles of 16 and 12 mm, and 5 % of these are 0.8 and 0.6 mm
ACCURACY = 0.95
LEFT_RIM, RIGHT_RIM = upper_rims(PLATE)
CLI = ["--camera", "basler-acA2440-20gm-8mm", "--sigma-mm", "0.05", "--sigma-rad", "0.001"]
CLI += ["--accuracy", "0.95", "--effort", "quick", "--jobs", "1", "--simulate", "500"]


def planned_circles_as_entities(wanted, **options):
    return plan_inspection(
        PLATE, wanted, CAMERA, UNCERTAINTY, accuracy=ACCURACY, effort=QUICK, **options
    )


def plate_file(path):
    """Write the plate as an OFF file, its upper side towards +z."""
    lines = ["OFF", f"{len(PLATE.vertices)} {len(PLATE.triangles)} 0"]
    lines += [" ".join(map(repr, row)) for row in PLATE.vertices.tolist()]
    lines += ["3 " + " ".join(map(str, row)) for row in PLATE.triangles.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def rounded_corner(n=12, radius=20.0):
    """A block with one rounded upright corner: its upper arc is a quarter of a circle."""
    turns = np.linspace(0.0, math.pi / 2, n + 1)
    corner = [(40.0 + radius * math.cos(t), 20.0 + radius * math.sin(t)) for t in turns]
    outline = [(0.0, 0.0), (60.0, 0.0), *corner, (0.0, 40.0)]
    size = len(outline)
    vertices = [(x, y, z) for z in (0.0, 15.0) for x, y in outline]
    faces = [list(range(size))[::-1], list(range(size, 2 * size))]
    faces += [[k, (k + 1) % size, size + (k + 1) % size, size + k] for k in range(size)]
    return Solid(vertices, faces)


def test_a_rim_is_its_diameter_and_an_edge_is_as_before():
    wanted = {"bore": LEFT_RIM, "front": FRONT}
    entities, (bore, front) = resolve_wanted(PLATE, wanted, ACCURACY)
    assert list(entities) == ["bore", "front"]
    assert (bore.kind, bore.permitted_error) == ("diameter", (1 - ACCURACY) * bore.nominal)
    diameter = 2 * HOLES["left"][1]
    assert bore.measurand.nominal == pytest.approx(diameter)
    assert bore.error_at(ACCURACY) == pytest.approx(0.05 * diameter)
    assert isinstance(front, EdgeTarget)
    assert front.measurand.nominal == pytest.approx(80.0)
    assert front.error_at(ACCURACY) == pytest.approx(0.05 * 80.0)


@pytest.mark.parametrize("stands_for", ["id", "rim", "entity"])
def test_everything_that_stands_for_a_rim_is_one(stands_for):
    rim = next(rim for rim in PLATE.rims() if rim.id == LEFT_RIM)
    entity = resolve_entities(PLATE, {"x": LEFT_RIM})["x"]
    item = {"id": LEFT_RIM, "rim": rim, "entity": entity}[stands_for]
    assert is_circle(item)
    _, (target,) = resolve_wanted(PLATE, {"bore": item}, ACCURACY)
    assert target.measurand.nominal == pytest.approx(2 * HOLES["left"][1])


def test_an_arc_is_its_radius():
    solid = rounded_corner()
    arc = next(arc for arc in solid.arcs() if arc.centre[2] == pytest.approx(15.0))
    _, (target,) = resolve_wanted(solid, {"corner": arc.id}, 0.9)
    assert target.measurand.kind == "radius"
    assert target.measurand.nominal == pytest.approx(20.0)
    assert target.error_at(0.9) == pytest.approx(2.0)
    assert not is_circle(17)
    assert not is_circle(FRONT)
    assert not is_circle(Dimension.radius(arc.id))


def test_a_plan_of_rims_is_that_of_their_diameters():
    """As dimensions of the same permitted errors, beside an edge, whose density stays the paper's."""
    bore = Dimension.diameter(LEFT_RIM, accuracy=ACCURACY)
    # what is assumed of dimensions, where nothing is said, is not assumed of rims
    how = {"localisation": Localisation.rounding()}
    found = planned_circles_as_entities({LEFT_RIM: LEFT_RIM, "front": FRONT}, **how)
    assert found == planned_circles_as_entities({LEFT_RIM: bore, "front": FRONT}, **how)
    assert found.complete
    assert list(found.dimensions) == [LEFT_RIM]
    assert found.simulate(2000, rng=1).confirmed
    # with regions of its own names, too
    named = {"left": LEFT_RIM}
    space = compute_regions(PLATE, named, workspace=found.workspace)
    assert planned_circles_as_entities(named, space=space, workspace=found.workspace).complete


def test_what_is_selected_may_hold_rims():
    ids = select_entities(PLATE, "kind = rim and face = top")
    assert ids == [LEFT_RIM, RIGHT_RIM]
    found = planned_circles_as_entities(ids)
    assert set(found.inspected) == set(ids)


def test_a_rim_in_a_file_and_in_a_prediction(tmp_path):
    path = tmp_path / "wanted.toml"
    path.write_text(f'bore = "{LEFT_RIM}"\n')
    wanted = read_wanted(path, ("diameter",))
    assert wanted == {"bore": LEFT_RIM}
    plan = planned_circles_as_entities(wanted)
    pose = plan.settings[0].cam2world
    prediction = predict(PLATE, wanted, pose, CAMERA, UNCERTAINTY, accuracy=ACCURACY)["bore"]
    assert prediction.probability == pytest.approx(plan.settings[0].probability["bore"], abs=1e-3)


def test_a_rim_of_too_few_chords_is_refused_before_the_regions(monkeypatch):
    monkeypatch.setattr(
        "planner.inspection.visible_regions", lambda *_, **__: pytest.fail("work has begun")
    )
    with pytest.raises(
        RequestError, match=r"^dimension 'bore': rim r0 must have at least \d+ chords"
    ):
        plan_inspection(PLATE, {"bore": "r0"}, CAMERA, UNCERTAINTY, accuracy=0.998)


def test_one_setting_measures_edges_only():
    space = compute_regions(PLATE, {"bore": LEFT_RIM})
    with pytest.raises(RequestError, match=r"must be edges, .* Got 'bore', which is a rim"):
        plan_setting(space, ["bore"], CAMERA, UNCERTAINTY)


def test_the_command_line_plans_rims(tmp_path, capsys):
    part = plate_file(tmp_path / "plate.off")
    out = tmp_path / "rims"
    rule = "kind = rim and face = top and radius > 7"
    assert main(["plan", part, "--select", rule, *CLI, "--out", str(out)]) == DONE
    assert "1 of 1 dimension inspected" in capsys.readouterr().out
    wanted = tmp_path / "wanted.toml"
    (rim,) = select_entities(read_solid(part), rule)
    wanted.write_text(f'{rim} = {{ diameter = "{rim}", accuracy = 0.95 }}\n')
    same = tmp_path / "same"
    command = ["plan", part, "--dimensions", str(wanted), "--localisation", "rounding", *CLI]
    assert main([*command, "--out", str(same)]) == DONE
    assert read_plan(out / "plan.json") == read_plan(same / "plan.json")


def test_the_command_line_refuses_at_once_and_leaves_nothing(tmp_path, capsys):
    part = plate_file(tmp_path / "plate.off")
    out = tmp_path / "out"
    command = ["plan", part, "--select", "kind = rim", *CLI, "--accuracy", "0.998"]
    assert main([*command, "--out", str(out)]) == BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("aspectgraph: --select: dimension 'r0': rim r0 must have ")
    assert error.count("\n") == 1
    assert not out.exists()
    batch = ["batch", str(tmp_path), "--select", "kind = rim", *CLI[:-2], "--accuracy", "0.998"]
    main([*batch, "--out", str(out), "--quiet"])
    assert "plate.off is refused: dimension 'r0': rim r0 must have" in capsys.readouterr().out
    assert not list(out.rglob("planning-*"))


# Tolerance classes in a request: resolved on the part, and refused for the wrong kind of feature.


LEFT_CLASS_DIMENSIONS, RIGHT_CLASS_DIMENSIONS = upper_rims(PLATE)


def test_a_class_becomes_the_limits_of_the_feature_it_is_asked_of():
    """IT13 is 270 µm over 10 to 18 mm; E begins 32 µm above the nominal size there (ISO 286-1)."""
    wanted = {
        "left": Dimension.diameter(LEFT_CLASS_DIMENSIONS, tolerance="H13", share=1.0),
        "right": Dimension.diameter(RIGHT_CLASS_DIMENSIONS, tolerance="E13", share=0.6),
    }
    _, (left, right) = resolve_wanted(PLATE, wanted, 0.98)
    assert left.tolerance == (0.0, 0.27)
    assert left.permitted_error == pytest.approx(0.135)
    assert right.tolerance == (0.032, 0.302)
    assert right.permitted_error == pytest.approx(0.6 * 0.135)
    assert right.share == 0.6


def test_the_class_of_a_shaft_is_refused_for_a_hole():
    with pytest.raises(
        RequestError,
        match=f"dimension 'left': tolerance must be a class of holes, in capitals, because {LEFT_CLASS_DIMENSIONS} is "
        "the rim of a hole. Got 'h13'",
    ):
        resolve_wanted(
            PLATE, {"left": Dimension.diameter(LEFT_CLASS_DIMENSIONS, tolerance="h13")}, 0.98
        )


def test_the_class_of_a_hole_is_refused_for_a_shaft():
    pin = prism(ring(8.0, 24), 10.0)
    rim = pin.rims()[0].id
    _, (target,) = resolve_wanted(
        pin, {"pin": Dimension.diameter(rim, tolerance="js14", share=1.0)}, 0.98
    )
    # IT14 is 430 µm over 10 to 18 mm
    assert target.tolerance == (-0.215, 0.215)
    with pytest.raises(
        RequestError,
        match=f"tolerance must be a class of shafts, in small letters, because {rim} is the rim of a shaft",
    ):
        resolve_wanted(pin, {"pin": Dimension.diameter(rim, tolerance="JS14")}, 0.98)


def test_a_distance_has_a_class_of_either_kind():
    """The plate is 50 mm deep: IT9 is 62 µm over 30 to 50 mm."""
    edges = {"front": [[0, 0, 10], [80, 0, 10]], "back": [[0, 50, 10], [80, 50, 10]]}
    for name, limits in (("H9", (0.0, 0.062)), ("h9", (-0.062, 0.0))):
        depth = Dimension.distance(*edges.values(), tolerance=name)
        _, (target,) = resolve_wanted(PLATE, {"depth": depth}, 0.98)
        assert target.tolerance == limits
        assert target.permitted_error == pytest.approx(0.062 / 8)


def test_an_edge_of_a_dimension_is_named_as_tables_show_it():
    assert (
        Dimension.distance("e25", 27) == Dimension.distance(25, "e27") == Dimension.distance(25, 27)
    )
    solid = prism(((0.0, 0.0), (60.0, 0.0), (60.0, 30.0), (0.0, 30.0)), 20.0)
    first, second = (edge.id for edge in solid.straight_edges()[:2])
    # the name of an item is no id
    wanted = {f"e{second}": f"e{first}", "other": f"e{second}"}
    entities, targets = resolve_wanted(solid, wanted, 0.98, as_lengths=True)
    assert [entity.edge_ids for entity in entities.values()] == [(first,), (second,)]
    assert [target.name for target in targets] == list(wanted)
