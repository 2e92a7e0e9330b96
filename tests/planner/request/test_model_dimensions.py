"""Dimensions of a model as a request: every feature of a pattern is a characteristic, or has a reason."""

from __future__ import annotations

import csv
import dataclasses
import io
import json

import numpy as np
import pytest
from holed_plate import CAMERA, HEIGHT, QUICK, SIZE, UNCERTAINTY, holed_plate, upper_rims
from plan_examples import plan, planned_dimension

from aspectgraph import ModelDimension
from errors.measurands import Line, Localisation
from planner import (
    Detectability,
    Dimension,
    InspectionOptions,
    InspectionPlan,
    PoseUncertainty,
    RequestError,
    dimensions_to_plan,
    look_at,
    plan_inspection,
    predict,
    read_plan,
)
from planner.report import terminal_tables
from planner.report.page import _figures, _lead, _more
from planner.report.wording import features_cell, verdict
from planner.request.targets import words_of
from planner.request.words import (
    CHARACTERISTICS,
    DIMENSIONS,
    features_text,
    is_characteristic,
    n_not_planned,
)

NO_RIM = "no sharp circular edge bounds this feature"
# mirror images of each other in the planes x = 40 and y = 25
MIRRORED = {
    "a": ((15.0, 15.0), 6.0),
    "b": ((65.0, 15.0), 6.0),
    "c": ((15.0, 35.0), 6.0),
    "d": ((65.0, 35.0), 6.0),
}


def stated(name, features, reasons=None, **more):
    """A diameter with a tolerance, on features given by the entities that measure them."""
    fields = {
        "kind": "diameter",
        "nominal": 12.0,
        "tolerance": (-0.5, 0.5),
        "entities": next((ways[0] for ways in features if ways), None),
        "reason": None,
        "features": features,
        "n_features": len(features),
        "feature_reasons": reasons or (None,) * len(features),
    }
    return ModelDimension(name, **{**fields, **more})


PATTERN = stated("bore", ((("r0",), ("r1",)), (("r2",),), (("r4",),)))
SINGLE = stated("hub", ((("r6",),),))
REFUSED = stated("cone", (), entities=None, reason="no edges measure it", n_features=30)


def test_each_feature_is_a_characteristic_with_its_own_entities():
    wanted, left_out = dimensions_to_plan([PATTERN, SINGLE, REFUSED], share=0.5)
    assert {name: one.entities for name, one in wanted.items()} == {
        "bore [1 of 3]": ("r0",),
        "bore [2 of 3]": ("r2",),
        "bore [3 of 3]": ("r4",),
        "hub": ("r6",),
    }
    assert {(one.tolerance, one.share, one.n_features) for one in wanted.values()} == {
        ((-0.5, 0.5), 0.5, 1)
    }
    assert left_out == {"cone": "no edges measure it"}


def test_reference_dimensions_are_planned_on_request_and_basic_ones_unless_refused():
    for_information = stated("sum", PATTERN.features, tolerance=None, role="reference")
    exact = stated("place", SINGLE.features, tolerance=None, role="basic")
    both = [for_information, exact, SINGLE]
    wanted, left_out = dimensions_to_plan(both)
    assert list(wanted) == ["place", "hub"]
    assert left_out == {"sum": "it is a reference dimension, given for information only"}
    wanted, left_out = dimensions_to_plan(both, reference=True, basic=False)
    assert list(wanted) == ["sum [1 of 3]", "sum [2 of 3]", "sum [3 of 3]", "hub"]
    assert list(left_out) == ["place"]
    assert left_out["place"].startswith("it is a basic dimension, theoretically exact")
    wanted, left_out = dimensions_to_plan(both, reference=True)
    assert (len(wanted), left_out) == (5, {})


def test_one_per_pattern_keeps_the_first_and_counts_the_others():
    wanted, left_out = dimensions_to_plan([PATTERN, SINGLE, REFUSED], one_per_pattern=True)
    found = {name: (one.entities, one.n_features) for name, one in wanted.items()}
    assert found == {"bore": (("r0",), 3), "hub": (("r6",), 1)}
    assert left_out == {"cone": "no edges measure it"}


def test_a_feature_that_nothing_measures_is_named_with_its_reason():
    gap = stated("bore", ((), (("r2",),)), (NO_RIM, None))
    wanted, left_out = dimensions_to_plan([gap])
    assert list(wanted) == ["bore [2 of 2]"]
    assert wanted["bore [2 of 2]"].entities == ("r2",)
    assert left_out == {"bore [1 of 2]": NO_RIM}


def test_names_that_the_model_already_uses_stay_unique():
    wanted, _ = dimensions_to_plan([PATTERN, stated("bore [2 of 3]", ((("r8",),),))])
    assert list(wanted) == ["bore [1 of 3]", "bore [2 of 3]", "bore [3 of 3]", "bore [2 of 3] #2"]
    assert wanted["bore [2 of 3] #2"].entities == ("r8",)


def test_direction_belongs_to_distances_alone():
    along = (0.0, 1.0, 0.0)
    features = (((3, 4),),)
    for kind, direction in (("distance", along), ("centre_to_edge", None)):
        one = stated("width", features, kind=kind, direction=along)
        assert dimensions_to_plan([one])[0]["width"].direction == direction


def test_bad_input_is_one_line():
    with pytest.raises(RequestError, match=r"^stated must be a ModelDimension\. Got 'bore'"):
        dimensions_to_plan(["bore"])
    with pytest.raises(RequestError, match=r"^dimension 'bore': share must be"):
        dimensions_to_plan([PATTERN], share=2.0)


def test_names_of_characteristics():
    assert is_characteristic("Linear Size.11 [3 of 30]")
    assert is_characteristic("bore [2 of 3] #2")
    assert not is_characteristic("bore [front]")
    assert not is_characteristic("3 of 30")


@pytest.fixture(scope="module")
def plate():
    return holed_plate(MIRRORED)


@pytest.fixture(scope="module")
def wanted(plate):
    # the rims on top, in which of the ways each could also be measured from below
    ways = []
    for rim in upper_rims(plate):
        (top,) = (one for one in plate.rims() if one.id == rim)
        below = next(
            one.id
            for one in plate.rims()
            if one.id != rim and np.allclose(one.centre[:2], top.centre[:2])
        )
        ways.append(((rim,), (below,)))
    found, left_out = dimensions_to_plan([stated("bore", tuple(ways))], share=0.3)
    assert left_out == {}
    return found


def test_mirrored_holes_have_equal_probabilities(plate, wanted):
    """Seen from the line in which both planes of symmetry meet, along an axis of the image."""
    middle = np.array([SIZE[0] / 2, SIZE[1] / 2, HEIGHT])
    pose = look_at(middle[None] + [0.0, 0.0, CAMERA.focus_distance_mm], middle)[0]
    # 2 mm of distance in 400 mm are 0.06 mm of the diameter
    vague = PoseUncertainty.isotropic(translation_mm=2.0, rotation_rad=0.001)
    # the lower rims lie beside the upper ones there
    paper = InspectionOptions(showing=Detectability(0.0, 0.0, 0.0))
    found = predict(plate, wanted, pose, CAMERA, vague, options=paper)
    p = [one.probability for one in found.values()]
    assert len(p) == 4
    assert 0.5 < p[0] < 0.99
    assert p == pytest.approx([p[0]] * 4, abs=1e-6)


@pytest.fixture(scope="module")
def planned(plate, wanted):
    options = {"localisation": Localisation.gaussian(0.1), "effort": QUICK, "probability": 0.8}
    return plan_inspection(plate, wanted, CAMERA, UNCERTAINTY, **options)


def test_every_hole_is_planned_in_one_image_of_all(planned):
    """All rims face up and lie 64 mm apart: one view from above shows the four."""
    assert planned.complete
    assert list(planned.inspected) == [f"bore [{k} of 4]" for k in (1, 2, 3, 4)]
    assert (len(planned.settings), planned.lower_bound) == (1, 1)
    assert (planned.n_features, planned.n_features_not_planned) == (4, 0)
    assert len({one.entities for one in planned.dimensions.values()}) == 4


def test_every_output_counts_characteristics(planned):
    text = "4 of 4 characteristics"
    assert text in verdict(planned)
    assert text in _lead(planned) + _more(planned)
    assert ("4 / 4", "characteristics inspected") in _figures(planned)
    assert planned.features_text == ""
    assert "not planned" not in repr(planned)
    rows = planned.rows()
    assert [(row["name"], row["n_features"]) for row in rows] == [
        (f"bore [{k} of 4]", 1) for k in (1, 2, 3, 4)
    ]


def test_the_plan_comes_back_from_its_file(planned, tmp_path):
    planned.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == planned


def test_a_plan_of_one_feature_per_pattern_counts_the_others():
    """It plans a pattern once, under the name of the dimension."""
    line = Line(*np.array(plan().entities["bottom"]))
    sort = {"kind": "length", "geometry": (line,), "permitted_error": 1.0}
    model = Localisation.gaussian(0.1)
    old = plan(
        dimensions={
            "bottom": planned_dimension(
                entities=("bottom",), localisation=model, n_features=30, **sort
            )
        }
    )
    assert InspectionPlan.from_dict(old.to_dict()) == old
    assert (old.n_features, old.n_features_not_planned) == (30, 29)
    dimension = old.dimensions["bottom"]
    assert words_of({"bottom": dimension}) is DIMENSIONS
    assert words_of({"bottom [1 of 2]": dataclasses.replace(dimension, n_features=1)}) is (
        CHARACTERISTICS
    )


def test_a_request_of_a_single_dimension_is_as_before():
    """Its name, entities and tolerance are the model's; nothing is numbered."""
    (one,) = dimensions_to_plan([SINGLE])[0].items()
    assert one == ("hub", Dimension("diameter", ("r6",), tolerance=(-0.5, 0.5)))


# One feature of each pattern is planned, if asked so: every output counts the others as not
# planned.


TEXT = "3 dimensions, 32 characteristics: 29 not planned"


def dimension(name, n_features):
    line = Line(*np.array(plan().entities[name]))
    return planned_dimension(
        "length", (name,), (line,), 1.0, Localisation.gaussian(0.1), n_features=n_features
    )


@pytest.fixture(scope="module")
def patterns():
    """Dimensions on 30, 1 and 1 features: 3 of 32 could be planned, 2 are, as one is not inspectable."""
    counts = {"top front": 30, "top right": 1, "bottom": 1}
    return plan(dimensions={name: dimension(name, n) for name, n in counts.items()})


def test_ctc_04_in_words():
    """Its drawing: diameters on 6, 30, 4, 30 and 1 features, and one distance."""
    assert features_text([1, 6, 30, 4, 30, 1]) == "6 dimensions, 72 characteristics: 66 not planned"
    assert features_text([4]) == "1 dimension, 4 characteristics: 3 not planned"
    assert (features_text([1, 1]), features_text([]), n_not_planned([])) == ("", "", 0)


@pytest.mark.parametrize("value", [0, -1, 1.0, True, "30"])
def test_a_number_of_features_is_whole_and_positive(value):
    with pytest.raises(RequestError, match=r"n_features must be a whole number, 1 or more\. Got"):
        Dimension("diameter", ("r0",), max_error=0.1, n_features=value)


def test_a_plan_counts_them(patterns):
    assert (patterns.n_features, patterns.n_features_not_planned) == (32, 29)
    assert TEXT in repr(patterns)
    assert TEXT in patterns._repr_html_()
    assert TEXT in verdict(patterns)


def test_a_plan_of_single_features_says_nothing_of_them():
    found = plan(dimensions={name: dimension(name, 1) for name in plan().entities})
    assert (found.n_features, found.n_features_not_planned) == (3, 0)
    for text in (
        repr(found),
        found._repr_html_(),
        verdict(found),
        _lead(found),
        str(_figures(found)),
    ):
        assert "feature" not in text
        assert "characteristic" not in text


def test_tables_and_report_name_the_pattern(patterns, capsys):
    terminal_tables.print_plan(patterns)
    printed = capsys.readouterr().out
    assert TEXT in printed
    assert "1 of 30 features" in " ".join(printed.split())
    terminal_tables.print_simulation(patterns, patterns.simulate(20))
    assert TEXT in capsys.readouterr().out
    assert TEXT in _more(patterns)
    assert ("2 / 32", "characteristics inspected") in _figures(patterns)
    assert features_cell(patterns.dimensions["top front"]) == "1 of 30 features"
    assert features_cell(patterns.dimensions["bottom"]) == ""


def test_rows_and_csv_hold_the_number(patterns):
    rows = list(csv.DictReader(io.StringIO(patterns.to_csv())))
    counts = {(row["name"], row["n_features"]) for row in rows}
    assert counts == {("top front", "30"), ("top right", "1"), ("bottom", "1")}
    assert {row["n_features"] for row in plan().rows()} == {1}


def test_the_file_holds_them(patterns, tmp_path):
    path = tmp_path / "plan.json"
    patterns.write(path)
    stored = json.loads(path.read_text())
    assert stored["targets"]["top front"]["n_features"] == 30
    assert read_plan(path) == patterns


@pytest.mark.parametrize(
    ("stated", "got"), [("part.step", "'part.step'"), (5, "5"), (None, "None")]
)
def test_what_is_no_list_of_dimensions_is_refused(stated, got):
    with pytest.raises(RequestError) as info:
        dimensions_to_plan(stated)
    assert info.value.parameter == "stated"
    assert str(info.value) == (
        f"stated must be a list of ModelDimension. Got {got}; read_dimensions returns one."
    )
