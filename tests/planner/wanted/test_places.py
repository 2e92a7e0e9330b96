"""A distance asked for at several places along its edges: their stretches and names, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from holed_plate import BACK, CAMERA, FRONT, LEFT, UNCERTAINTY, holed_plate, upper_rims

from aspectgraph import Solid
from planner import Dimension, Effort, InspectionPlan, plan_inspection
from planner.exceptions import RequestError
from planner.request.dimension_files import read_wanted
from planner.request.resolve import resolve_wanted, with_places
from planner.request.targets import WitnessChoice

PLATE = holed_plate()
KINDS = ("distance", "diameter")
LOWER_FRONT, LOWER_BACK = ([[x, y, 0] for x, y, _ in edge] for edge in (FRONT, BACK))
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
    choice = WitnessChoice(most=5, stretch_mm=5.0)
    _, targets = resolve_wanted(solid, asked, 0.98, choice=choice)
    for k, target in enumerate(targets):
        value = target.witnesses[0].measurand.nominal
        # perpendicular to the mean direction: the cosine of half the angle differs from 1 by 3e-9
        assert value == pytest.approx(30 + lean * (2 * k + 1) / 6, abs=1e-6)
        assert all(
            one.measurand.nominal == pytest.approx(value, abs=1e-3) for one in target.witnesses
        )


def test_a_place_offers_shorter_stretches_of_its_own():
    choice = WitnessChoice(most=3, stretch_mm=9.0)
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
    assert read_wanted(path, KINDS) == {
        "width": Dimension.distance(17, 18, max_error_mm=0.1, places=3)
    }
    path = tmp_path / "wanted.json"
    path.write_text('{"width": {"distance": [17, 18], "places": 3, "max_error": 0.1}}')
    assert read_wanted(path, KINDS)["width"].places == 3


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
        read_wanted(path, KINDS)
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
            "'width': any must hold edges beside a place of the first ones. Got edges",
        ),
        (lambda: width(999, 1), "'width': an edge id must be in"),
    ],
)
def test_what_has_no_places_is_refused(make, said):
    with pytest.raises(RequestError) as caught:
        with_places(PLATE, {"width": make()})
    assert said in str(caught.value)


def test_a_name_of_a_place_must_be_free():
    with pytest.raises(RequestError, match=r"of a place of 'width' must be free"):
        with_places(PLATE, {"width": width(), NAMES[1]: FRONT})


@pytest.fixture(scope="module")
def plan():
    effort = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000, witnesses=1)
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
