"""QIF 3.0: files are valid by a schema, and their values are the results'.

The schema is `qif_written.xsd`, which states requirements of QIF 3.0 for what is written, and is stricter.
"""

import csv
import dataclasses
import hashlib
import io
import json
import re
import uuid
import xml.etree.ElementTree as ET
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest
import xmlschema
from measured_plate import (
    CAMERA,
    LAMP,
    POSES,
    TOP,
    dimension,
    fine_plate,
    measured_plan,
    photograph,
    thick_plate,
)
from PIL import Image
from plan_examples import changed, witness
from scipy.ndimage import map_coordinates

from errors.measurands import Decision, DecisionRule, Line
from ground.faces import program_name
from planner import (
    LightPlan,
    LitImage,
    MeasureOptions,
    Measurer,
    PoseUncertainty,
    Registration,
    RequestError,
    measure,
)
from planner.camera.camera import undistorted_px
from planner.measuring import register
from planner.measuring.images import Picture
from planner.measuring.reading import Reading
from planner.measuring.registered import displaced
from planner.measuring.results import (
    CHARACTERISTICS,
    COLUMNS,
    NAMESPACE,
    MeasurementResults,
    Result,
    Source,
    decimals_of,
    qif_text,
    results_schema,
    value_texts,
)
from planner.measuring.task import NotRegisteredError
from planner.report.measured_report import image_notes, measured_html

SCHEMA = xmlschema.XMLSchema11(Path(__file__).with_name("qif_written.xsd"))


def result(name, kind, decision, value=np.nan, u=np.nan, tolerance=(-0.1, 0.1), reason=""):
    reading = Reading(name, "setting_01", 0, value, u, reason=reason)
    unit = "deg" if kind == "angle" else "mm"
    return Result(name, kind, unit, 10.0, tolerance, value, u, decision, np.nan, reason, (reading,))


def measured(rule=None, serial="N1"):
    every = [
        result(f"a {kind}", kind, Decision.CONFORMS, 10.00001234, 1.5e-5)
        for kind in CHARACTERISTICS
    ]
    every += [
        result("bad", "diameter", Decision.DOES_NOT_CONFORM, 12.0, 0.01),
        result("open", "distance", Decision.UNDECIDED, 10.1, 0.01),
        result("lost", "radius", Decision.NOT_MEASURED, reason="only 3 % < 80 % was\x07found"),
        result("free", "angle", Decision.NO_TOLERANCE, 9.5, 0.01, tolerance=None),
    ]
    source = Source("1", "plate", "ab", {"setting_01": "f0"})
    return MeasurementResults(
        {one.name: one for one in every},
        {},
        {},
        rule or DecisionRule.iso14253(),
        serial,
        np.eye(len(every) - 1),
        source,
    )


def tag(element):
    namespace, name = element.tag[1:].split("}")
    assert namespace == NAMESPACE
    return name


def by_tag(root, name):
    return list(root.iter(f"{{{NAMESPACE}}}{name}"))


@pytest.fixture(scope="module")
def root():
    return ET.fromstring(qif_text(measured()))


def faults(document):
    """Return what the schema says of a document."""
    return [error.reason for error in SCHEMA.iter_errors(document)]


def replaced(every, **fields):
    """Return results whose every target has other fields."""
    results = {name: dataclasses.replace(one, **fields) for name, one in every.results.items()}
    return dataclasses.replace(every, results=results)


def named(*names):
    one = result("x", "diameter", Decision.CONFORMS, 10.0, 0.01)
    results = {name: dataclasses.replace(one, name=name) for name in names}
    return dataclasses.replace(measured(serial=names[0]), results=results)


CASES = {
    "all kinds and decisions": measured(),
    "simple rule, without a serial number": measured(DecisionRule.simple(), ""),
    "guard band": measured(DecisionRule.guard()),
    "upper deviation only": replaced(measured(), tolerance=(0.0, 0.1)),
    "lower deviation only": replaced(measured(), tolerance=(-0.1, 0.0)),
    "upper limit only": replaced(measured(), tolerance=(-np.inf, 0.1)),
    "lower limit only": replaced(measured(), tolerance=(-0.1, np.inf)),
    "no tolerance": replaced(measured(), tolerance=None),
    "nothing measured": replaced(
        measured(),
        value=np.nan,
        standard_uncertainty=np.nan,
        decision=Decision.NOT_MEASURED,
        reason="overexposed",
    ),
    "tiny and huge": replaced(
        measured(), nominal=-1e6, value=1e-9, standard_uncertainty=1e-12, tolerance=(-1e5, 1e-7)
    ),
    "names": named("a & b < c > d", "\"'", "Größe ⌀ 12 №3 漢字 😀", " two  spaces ", "a\x07\ud800"),
    "no images": dataclasses.replace(measured(), source=Source("1", "", "ab", {})),
    "images of several lamps": dataclasses.replace(
        measured(), source=Source("1", "plate", "ab", {"setting_01_1": "f0", "setting_01_2": "f1"})
    ),
}


@pytest.mark.parametrize("results", CASES.values(), ids=list(CASES))
def test_documents_are_valid(results):
    assert faults(qif_text(results)) == []


@pytest.mark.parametrize(
    ("tolerance", "stated", "missing"),
    [((-np.inf, 0.1), "MaxValue", "MinValue"), ((-0.1, np.inf), "MinValue", "MaxValue")],
)
def test_a_tolerance_with_one_limit_states_only_that(tolerance, stated, missing):
    root = ET.fromstring(qif_text(replaced(measured(), tolerance=tolerance)))
    assert by_tag(root, stated)
    assert not by_tag(root, missing)


def test_documents_of_several_parts_are_valid_and_differ_in_their_ids():
    texts = [qif_text(measured(serial=name)) for name in ("N1", "N2", "N<3>")]
    assert [faults(text) for text in texts] == [[]] * 3
    assert len({ET.fromstring(text)[0].text for text in texts}) == 3


def first(root, name):
    return by_tag(root, name)[0]


def without(parent, child):
    """Remove the first element of a name from where it is."""

    def change(root):
        found = first(root, parent)
        found.remove(found.find(f"{{{NAMESPACE}}}{child}"))

    return change


def swapped(parent, i=0):
    """Exchange a child with the next."""

    def change(root):
        found = first(root, parent)
        found[i], found[i + 1] = found[i + 1], found[i]

    return change


def text(name, value):
    """Write another text in the first element of a name."""

    def change(root):
        first(root, name).text = value

    return change


def attribute(name, which, value):
    """Write another attribute of the first element of a name, or none."""

    def change(root):
        found = first(root, name)
        found.attrib.pop(which)
        if value is not None:
            found.set(which, value)

    return change


def swapped_items(root):
    """Let two measurements of other kinds refer to each other's items: both ids exist."""
    one, two = (
        first(root, f"{kind}CharacteristicMeasurement").find(f"{{{NAMESPACE}}}CharacteristicItemId")
        for kind in ("Diameter", "AngleBetween")
    )
    one.text, two.text = two.text, one.text


MUTANTS = {
    "no identity": (without("QIFDocument", "QPId"), "QPId"),
    "no standard": (without("QIFDocument", "StandardsDefinitions"), "StandardsDefinitions"),
    "no status": (without("DiameterCharacteristicMeasurement", "Status"), "Status|assertion"),
    "no item": (
        without("DiameterCharacteristicMeasurement", "CharacteristicItemId"),
        "CharacteristicItemId",
    ),
    "no definition of limits": (without("Tolerance", "DefinedAsLimit"), "DefinedAsLimit"),
    "no description of a file": (without("ExternalFileReference", "Description"), "Description"),
    "no mode of a distance": (
        without("DistanceBetweenCharacteristicNominal", "AnalysisMode"),
        "AnalysisMode",
    ),
    "no definition": (
        without("RadiusCharacteristicNominal", "CharacteristicDefinitionId"),
        "CharacteristicDefinitionId",
    ),
    "no inspection status": (without("MeasurementResults", "InspectionStatus"), "InspectionStatus"),
    "no unit of length": (without("PrimaryUnits", "LinearUnit"), "LinearUnit"),
    "length before angle": (swapped("PrimaryUnits"), "LinearUnit"),
    "results first": (swapped("QIFDocument", 4), "Results"),
    "lower limit first": (swapped("Tolerance"), "MaxValue"),
    "item before status": (swapped("DiameterCharacteristicMeasurement"), "CharacteristicItemId"),
    "serial number after status": (swapped("ActualComponent"), "SerialNumber"),
    "a word for a status": (text("CharacteristicStatusEnum", "GOOD"), "enumeration|must be one of"),
    "an exponent": (text("TargetValue", "1e-5"), "decimal"),
    "not a number": (text("Value", "nan"), "decimal|ordinary"),
    "inches": (text("SIUnitName", "degree"), "fixed|radian"),
    "half an identity": (text("QPId", "6f1c3f0e-6f3b"), "pattern"),
    "a component that is not there": (text("ActualComponentId", "999"), "q:component"),
    "a standard that is not there": (text("FormalStandardId", "999"), "q:standard"),
    "a definition that is not there": (
        text("CharacteristicDefinitionId", "999"),
        "q:diameter-definition",
    ),
    "a nominal that is not there": (text("CharacteristicNominalId", "999"), "q:diameter-nominal"),
    "an item that is not there": (text("CharacteristicItemId", "999"), "q:diameter-item"),
    "items of another kind": (swapped_items, "q:(diameter|angle)-item"),
    "an id twice": (attribute("Standard", "id", "2"), "ids"),
    "an id with a zero": (attribute("Standard", "id", "01"), "pattern"),
    "another largest id": (attribute("QIFDocument", "idMax", "7"), "assertion"),
    "another length of a list": (attribute("CharacteristicItems", "n", "3"), "assertion"),
    "an uncertainty without an error": (attribute("Value", "meanError", None), "meanError"),
    "a negative uncertainty": (
        attribute("Value", "combinedUncertainty", "-0.1"),
        "greater or equal",
    ),
    "another version": (attribute("QIFDocument", "versionQIF", "2.1.0"), "fixed|3.0.0"),
}


@pytest.mark.parametrize(("change", "word"), MUTANTS.values(), ids=list(MUTANTS))
def test_the_schema_refuses_a_change(change, word):
    root = ET.fromstring(qif_text(CASES["all kinds and decisions"]))
    change(root)
    (reason, *_) = faults(ET.tostring(root, encoding="unicode"))
    assert re.search(word, reason), reason


def test_values_are_read_back(root):
    names = {
        one.get("id"): one.find(f"{{{NAMESPACE}}}Name").text
        for one in root.iter()
        if tag(one).endswith("CharacteristicItem")
    }
    found = {}
    for one in by_tag(root, "CharacteristicMeasurements")[0]:
        fields = {tag(child): child for child in one}
        found[names[fields["CharacteristicItemId"].text]] = fields
    expected = {one.name: one for one in measured()}
    assert found.keys() == expected.keys()
    for name, one in expected.items():
        fields = found[name]
        if not one.measured:
            assert "Value" not in fields
            assert fields["Status"][0].text == "NOT_ANALYZED"
            assert fields["Attributes"][0].get("value") == "only 3 % < 80 % was\ufffdfound"
            continue
        # ten decimals are written
        assert float(fields["Value"].text) == pytest.approx(one.value, abs=5.1e-11)
        accuracy = float(fields["Value"].get("combinedUncertainty"))
        assert accuracy == pytest.approx(one.standard_uncertainty, abs=5.1e-11)
        assert fields["Value"].get("meanError") == "0"
    assert [found[name]["Status"][0].text for name in ("bad", "open", "free", "a angle")] == [
        *("FAIL", "INDETERMINATE", "UNDEFINED", "PASS")
    ]


def test_the_part_fails_if_one_of_its_characteristics_does(root):
    assert [one.text for one in by_tag(root, "InspectionStatusEnum")] == ["FAIL", "FAIL"]
    assert by_tag(root, "SerialNumber")[0].text == "N1"
    every = measured()
    names = [name for name, one in every.results.items() if one.decision is Decision.CONFORMS]
    good = dataclasses.replace(every, results={name: every[name] for name in names})
    statuses = by_tag(ET.fromstring(qif_text(good)), "InspectionStatusEnum")
    assert statuses[0].text == "PASS"
    lost = dataclasses.replace(every, results={"lost": every["lost"]})
    statuses = by_tag(ET.fromstring(qif_text(lost)), "InspectionStatusEnum")
    assert statuses[0].text == "UNDEFINED"


def test_characteristics_of_two_parts_have_the_same_uuids():
    first, second = (ET.fromstring(qif_text(measured(serial=name))) for name in ("N1", "N2"))
    assert [one.text for one in by_tag(first, "UUID")] == [
        one.text for one in by_tag(second, "UUID")
    ]
    assert first[0].text != second[0].text
    for one in by_tag(first, "UUID"):
        assert str(uuid.UUID(one.text)) == one.text
    assert len({one.text for one in by_tag(first, "UUID")}) == len(measured())


def test_the_same_results_give_the_same_bytes(tmp_path):
    path = measured().qif(tmp_path / "results.qif")
    assert path.read_text(encoding="utf-8") == qif_text(measured())


@pytest.mark.parametrize(
    ("rule", "standard"),
    [
        (DecisionRule.iso14253(), "14253-1"),
        (DecisionRule.simple(), "IEC Guide 98-4"),
        (DecisionRule.guard(), "IEC Guide 98-4"),
    ],
    ids=["iso", "simple", "guard"],
)
def test_the_standard_is_that_of_the_rule(rule, standard):
    root = ET.fromstring(qif_text(measured(rule)))
    assert by_tag(root, "Standard")[0][1].text == standard


# From rendered images of a deviating plate to values: the ray renderer shares no code with what
# measures.


MADE = {"left": 0.05, "right": 0.0, "width": 0.08}
TRUE = {"left": 0.1, "right": 0.0, "apart": 0.0, "width": 0.08}


@pytest.fixture(scope="module")
def solid():
    return thick_plate()


@pytest.fixture(scope="module")
def images():
    return photograph(fine_plate(**MADE), POSES)


@pytest.fixture(scope="module")
def exact():
    return Registration.given(
        {k + 1: pose for k, pose in enumerate(POSES)}, np.diag([1e-8] * 3 + [1e-12] * 3)
    )


@pytest.fixture(scope="module")
def results(solid, images, exact):
    return measure(measured_plan(solid), solid, images, registration=exact)


def test_the_length_of_an_edge_is_a_dimension(solid, images, exact):
    """The plate is 80 mm long, as made."""
    line = Line([0.0, 0.0, TOP], [80.0, 0.0, TOP])
    long = dimension("length", ("front",), (line,), (-0.3, 0.3))
    plan = measured_plan(
        solid, ("long",), dimensions={"long": long}, entities={"long": np.array([line.p, line.q])}
    )
    one = measure(plan, solid, images, registration=exact)["long"]
    assert one.measured, one.reason
    assert abs(one.deviation) < 3 * one.standard_uncertainty


@pytest.mark.parametrize("name", list(TRUE))
def test_a_deviation_is_read_within_its_uncertainty(results, name):
    one = results[name]
    assert one.measured, one.reason
    assert abs(one.deviation - TRUE[name]) < one.expanded_uncertainty
    # a twentieth of a pixel, whatever the uncertainty says
    assert abs(one.deviation - TRUE[name]) < 0.012


def test_a_dimension_may_be_the_length_of_an_edge(solid, images, exact):
    """The plate is as long as drawn: only its bores and its width were made otherwise."""
    one = measure(measured_plan(solid, ("long",)), solid, images, registration=exact)["long"]
    assert one.measured, one.reason
    assert one.nominal == pytest.approx(80.0)
    assert abs(one.deviation) < one.expanded_uncertainty


def test_a_setting_measures_by_its_own_witness(solid, images, exact):
    """The plan lists the lower rim first, which no pose shows, and its settings use the upper one."""
    plan = measured_plan(solid, ("left",))
    upper = plan.dimensions["left"]
    (rim,) = (
        one
        for one in solid.rims()
        if abs(one.centre[2]) < 1e-6 and abs(one.centre[0] - upper.geometry[0].centre[0]) < 1e-6
    )
    circle = dataclasses.replace(upper.geometry[0], centre=rim.centre)
    lower = dataclasses.replace(
        upper, witnesses=(witness("diameter", (rim.id,), (circle,)), *upper.witnesses)
    )
    settings = [dataclasses.replace(one, witness={"left": 1}) for one in plan.settings]
    plan = changed(plan, settings=tuple(settings), targets=(lower,))
    results = measure(plan, solid, images, registration=exact)
    assert results["left"].measured, results["left"].reason
    assert abs(results["left"].deviation - TRUE["left"]) < 0.012


def test_measured_values_are_valid_qif(results, tmp_path):
    schema = xmlschema.XMLSchema11(Path(__file__).with_name("qif_written.xsd"))
    assert schema.is_valid(results.qif(tmp_path / "results.qif"))


def test_budget_sums_to_the_variance(results):
    for readings in results.readings.values():
        for one in readings:
            if one.measured:
                total = sum(one.budget.values())
                assert total == pytest.approx(one.standard_uncertainty**2, rel=1e-9)


def test_the_uncertainty_of_a_planned_pose_is_that_of_the_plan(solid, images):
    """What pose and surfaces add is computed by differences here, and by the model of the plan there."""
    plan = measured_plan(solid)
    results = measure(plan, solid, images, registration=Registration.none())
    for name in ("right", "width"):
        (reading, *_) = [one for one in results[name].readings if one.measured]
        pose = np.asarray(plan.settings[reading.setting].cam2world)
        budget = plan.dimensions[name].describe(pose, plan.means).budget
        by_pose = budget["translation"] + budget["rotation"]
        assert reading.budget["pose"] == pytest.approx(by_pose, rel=0.05)
        # the plan knows no tilts of faces
        assert 0.9 < reading.budget["surfaces"] / budget["surfaces"] < 3


def test_points_have_states_and_places(results):
    for reading in results["width"].readings:
        for points in reading.points:
            found = points[points["state"] == 0]
            assert np.isfinite(found["residual_px"]).all()
            assert (np.abs(found["residual_px"]) < 1).all()
            assert set(points.dtype.names) >= {"u", "v", "x", "y", "z", "state"}


def test_results_are_valid_and_written_whole(results, tmp_path):
    path = results.write(tmp_path / "results.json")
    data = json.loads(path.read_text())
    jsonschema.Draft202012Validator(results_schema()).validate(data)
    rows = results.write_csv(tmp_path / "results.csv").read_text().splitlines()
    heading = rows[0].split(",")
    # the same for parts with and without angles: each row has its unit
    assert heading == list(COLUMNS)
    assert {row["unit"] for row in csv.DictReader(rows)} == {"mm"}
    assert len(rows) == 1 + len(results)
    matrix = np.array(data["correlation"])
    assert np.linalg.eigvalsh((matrix + matrix.T) / 2).min() > -1e-9


def test_the_table_has_the_digits_of_the_report(results):
    """Values with two digits of U; what is accepted is rounded inwards."""
    rows = csv.DictReader(io.StringIO(results.to_csv()))
    for row, result in zip(rows, results, strict=True):
        assert float(row["value"]) == float(value_texts(result)[0])
        assert float(row["U"]) == float(value_texts(result)[1])
        low, high = result.accepted
        step = 10.0 ** -decimals_of(result.expanded_uncertainty)
        assert low <= float(row["accepted_from"]) < low + step
        assert high - step < float(row["accepted_to"]) <= high
        assert max(len(row[key]) for key in ("value", "U", "accepted_from", "accepted_to")) <= 9
        assert float(row["P_conforms"]) < 1


def test_the_same_images_give_the_same_bytes(solid, images, exact, results):
    again = measure(measured_plan(solid), solid, images, registration=exact)
    # all but the time
    again = dataclasses.replace(again, source=dataclasses.replace(again.source, date="then"))
    results = dataclasses.replace(results, source=dataclasses.replace(results.source, date="then"))
    assert json.dumps(again.to_dict()) == json.dumps(results.to_dict())


def test_results_say_when_by_whom_and_with_what(solid, images, exact, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    plan = measured_plan(solid)
    results = Measurer(plan, solid).measure(images, MeasureOptions(exact), operator="A. Meyer")
    source = results.source
    assert (source.date, source.operator) == ("1970-01-02T00:00:00Z", "A. Meyer")
    assert source.plan_digest == hashlib.sha256(plan.file_text().encode()).hexdigest()
    assert source.camera == plan.camera
    root = ET.fromstring(qif_text(results))
    assert first(root, "InspectionEnd").text == "1970-01-02T00:00:00Z"
    assert first(root, "TimeCreated").text == "1970-01-02T00:00:00Z"
    assert first(root, "Application")[0].text == program_name()
    assert first(root, "InspectionOperator")[0].text == "A. Meyer"
    assert faults(qif_text(results)) == []
    page = measured_html(results)
    for text in ("A. Meyer", "1970-01-02T00:00:00Z", source.plan_digest[:12], plan.camera.name):
        assert text in page


def test_qif_names_the_camera_and_the_plan(results):
    root = ET.fromstring(qif_text(results))
    assert f"; camera {results.source.camera.name}" in first(root, "Description").text
    file = first(root, "ExternalFileReference")
    assert [element.text for element in file.iter() if (element.text or "").strip()] == [
        "plan.json",
        "inspection plan",
        f"SHA-256 {results.source.plan_digest}",
    ]
    assert faults(qif_text(results)) == []


def test_qif_and_json_name_the_files_of_images(solid, images, exact, results, tmp_path):
    """A URI has no blanks (RFC 3986); images that are arrays keep the names of their settings."""
    assert results.source.image_files == {}
    files = {}
    for number, name in ((1, "first one.png"), (2, "setting_02.PNG")):
        files[number] = tmp_path / name
        Image.fromarray(images[number]).save(files[number])
    stored = measure(measured_plan(solid), solid, files, registration=exact)
    names = {"setting_01": "first one.png", "setting_02": "setting_02.PNG"}
    assert stored.to_dict()["source"]["image_files"] == names
    for one, expected in (
        (stored, ["plan.json", "first%20one.png", "setting_02.PNG"]),
        (results, ["plan.json", "setting_01", "setting_02"]),
    ):
        root = ET.fromstring(qif_text(one))
        assert [element.text for element in by_tag(root, "URI")] == expected
        assert faults(qif_text(one)) == []


def test_a_deviation_that_rounds_to_nothing_has_no_sign(results):
    near = dataclasses.replace(results["left"], value=results["left"].nominal - 1e-9)
    results = dataclasses.replace(results, results={"left": near})
    (row,) = csv.DictReader(io.StringIO(results.to_csv()))
    assert row["deviation"] == "0.0"
    page = measured_html(results)
    assert "deviation −0.0" not in page
    assert ">−0.000<" not in page
    assert ">+0.000<" in page


def test_one_note_about_all_images_that_it_is_about(results):
    names = list(results.pictures)
    notes = [*(f"{name}: loses detail" for name in names), "setting_01: dark", "a plan: a note"]
    results = dataclasses.replace(results, notes=tuple(notes), edges="")
    assert list(image_notes(results)) == [
        f"note: {' and '.join(names)}: loses detail",
        "note: setting_01: dark",
        "note: a plan: a note",
    ]


def test_a_measurer_measures_many_parts(solid, exact):
    measurer = Measurer(measured_plan(solid, ["width"]), solid)
    wide = [
        measurer.measure(
            photograph(fine_plate(width=more), POSES), MeasureOptions(exact), serial=f"N{more}"
        )
        for more in (0.0, 0.3)
    ]
    difference = wide[1]["width"].value - wide[0]["width"].value
    assert difference == pytest.approx(0.3, abs=0.01)
    assert wide[0]["width"].decision is Decision.CONFORMS
    assert wide[1]["width"].decision is Decision.DOES_NOT_CONFORM
    assert wide[1].serial == "N0.3"


def test_an_overexposed_image_is_not_measured(solid, exact):
    bright = photograph(fine_plate(), POSES, exposure=2.5)
    results = measure(measured_plan(solid, ["left"]), solid, bright, registration=exact)
    assert results["left"].decision is Decision.NOT_MEASURED
    assert "overexposed" in results["left"].reason


def test_a_black_image_is_not_measured(solid, exact):
    black = {1: np.zeros((512, 640), np.uint8), 2: np.ones((512, 640), np.uint8)}
    results = measure(measured_plan(solid), solid, black, registration=exact)
    assert results.counts == {"not measured": 4}
    assert "weak" in results["left"].reason


def test_a_rim_that_is_half_covered_is_not_measured(solid, exact, images, results):
    covered = {k: image.copy() for k, image in images.items()}
    for k, reading in enumerate(results["left"].readings):
        middle = int(np.median(reading.points[0]["u"]))
        covered[k + 1][:, :middle] = 20
    results = measure(measured_plan(solid, ["left"]), solid, covered, registration=exact)
    assert results["left"].decision is Decision.NOT_MEASURED
    assert "was found" in results["left"].reason


def test_a_robot_that_is_said_to_be_exact(solid, images):
    plan = measured_plan(solid, ["right"], pose_uncertainty=PoseUncertainty(np.zeros((6, 6))))
    one = measure(plan, solid, images)["right"]
    assert one.measured, one.reason
    assert abs(one.deviation) < one.expanded_uncertainty


def test_a_lens_with_distortion(solid, images):
    """The images as a lens with distortion takes them: pixels of the real image from those of the ideal one."""
    camera = dataclasses.replace(CAMERA, distortion=(-0.4, 0.1, 0.002, -0.001))
    v, u = np.mgrid[:512, :640].astype(float)
    ideal = undistorted_px(camera, np.stack([u, v], axis=-1).reshape(-1, 2))
    assert np.abs(ideal - np.c_[u.ravel(), v.ravel()]).max() > 3
    bent = {
        k: map_coordinates(image.astype(float), ideal[:, ::-1].T, order=3, mode="nearest")
        for k, image in images.items()
    }
    taken = {
        k: np.clip(grey, 0, 255).reshape(512, 640).astype(np.uint8) for k, grey in bent.items()
    }
    results = measure(measured_plan(solid, ["right", "width"], camera=camera), solid, taken)
    for name in ("right", "width"):
        assert results[name].measured, results[name].reason
        assert abs(results[name].deviation - TRUE[name]) < results[name].expanded_uncertainty


@pytest.mark.parametrize("strength", [1.0, -0.25], ids=["6 px", "1.4 px"])
def test_undistorted_images_are_refused(solid, images, strength):
    """The plan's lens has distortion, of up to so much, and the images have none."""
    lens = tuple(strength * k for k in (-0.4, 0.1, 0.002, -0.001))
    plan = measured_plan(solid, ["right"], camera=dataclasses.replace(CAMERA, distortion=lens))
    results = measure(plan, solid, images)
    assert set(results.failed) == {"setting_01", "setting_02"}
    for why in results.failed.values():
        assert "looks undistorted, and the plan's camera has lens distortion" in why


@pytest.mark.parametrize(("times", "is_refused"), [(2.8, False), (1.0, True)])
def test_faces_that_deviate_are_not_taken_for_a_lens(monkeypatch, times, is_refused):
    """Misfits of a bracket with faces off by 0.05 mm: without the lens, they would have to be off 2.8 times as far."""
    taken = SimpleNamespace(misfit_px=0.116, used=3972)
    other = SimpleNamespace(misfit_px=0.054, used=4128)
    monkeypatch.setattr(register, "register", lambda *_: other)
    monkeypatch.setattr(
        register, "times_more", lambda _model, found, _prior: times if found is other else 1.0
    )
    camera = dataclasses.replace(CAMERA, distortion=(-0.0612, 0.0811, 0.00021, -0.00013))
    picture = Picture.of("one", np.zeros(CAMERA.resolution[::-1], dtype=np.uint8), camera)
    expected = (
        pytest.raises(NotRegisteredError, match="undistorted") if is_refused else nullcontext()
    )
    with expected:
        register.check_lens(None, [picture], np.eye(4), np.eye(6), taken)


def test_notes_on_exposure(solid, exact, images):
    plan = measured_plan(solid, ["left"], settings=1)
    dark = measure(plan, solid, {1: images[1] // 8}, registration=exact)
    assert any("setting_01: dark: expose for" in note for note in dark.notes)
    bright = np.clip(images[1].astype(int) * 4, 0, 255).astype(np.uint8)
    over = measure(plan, solid, {1: bright}, registration=exact)
    assert any("of the image is overexposed" in note for note in over.notes)


def test_a_note_names_targets_that_are_overexposed_in_an_image_that_is_not(solid, exact, images):
    """A small part of the image gets four times as much light, and it is at the left hole."""
    plan = measured_plan(solid, ["left", "right"], settings=1)
    seen = measure(plan, solid, {1: images[1]}, registration=exact)
    (points,) = seen["left"].readings[0].points
    places = np.c_[points["u"], points["v"]]
    size = int(np.linalg.norm(places - places.mean(axis=0), axis=1).mean())
    # around a point of the rim, so large that it covers a quarter of it
    u, v = places[0].astype(int)
    spot = images[1].astype(float)
    spot[v - size : v + size, u - size : u + size] *= 4
    spot = np.clip(spot, 0, 255).astype(np.uint8)
    results = measure(plan, solid, {1: spot}, registration=exact)
    assert results.pictures["setting_01"].clipped_share < 0.05
    assert (
        "setting_01: overexposed beside left: expose for half of the time or less" in results.notes
    )


def test_a_note_says_for_what_share_of_the_time_to_expose(solid, exact, images):
    """The brightest faces have four fifths of white when they are exposed for that time."""
    plan = measured_plan(solid, ["left", "width"], settings=1)
    lit = LitImage((0,), {"left": 0.5, "width": 0.5})
    light = LightPlan("fixed", 0.1, 0.05, "dark", LAMP.place[None], ((lit,),), ({},), 1, "by hand")
    plan = dataclasses.replace(plan, light=light)
    bright = photograph(fine_plate(**MADE), POSES[:1], exposure=2.5)
    results = measure(plan, solid, bright, registration=exact)
    (note,) = results.notes
    found = re.fullmatch(
        r"setting_01: \d+ % of the image is overexposed: expose for (\d+) % of the time, "
        "less if the part is shiny",
        note,
    )
    share = int(found[1]) / 100
    # of the image at exposure 1, in which nothing is overexposed
    true = 0.8 / (2.5 * np.quantile(images[1], 0.995) / 255)
    assert 0.8 < share / true < 1.1
    again = photograph(fine_plate(**MADE), POSES[:1], exposure=2.5 * share)
    results = measure(plan, solid, again, registration=exact)
    assert results.measured
    assert results.notes == ()


def test_several_lamps_of_a_setting(solid, images, exact):
    """Each target is measured in the image whose lamp shows it; both images have one pose, within its repeatability."""
    plan = measured_plan(solid, ["left", "right"], settings=1)
    lit = (LitImage((0,), {"left": 0.5}), LitImage((1,), {"right": 0.5}))
    lamps = np.array([[0.0, 0, 500], [100.0, 0, 500]])
    light = LightPlan("placed", 0.1, 0.05, "dark", lamps, (lit,), ({},), 1, "by hand")
    both = dataclasses.replace(plan, light=light)
    taken = {"setting_01_1": images[1], "setting_01_2": images[1] // 2}
    results = measure(both, solid, taken)
    assert [r.image for r in results["left"].readings] == ["setting_01_1"]
    assert [r.image for r in results["right"].readings] == ["setting_01_2"]
    first, second = results.images.values()
    move = np.linalg.inv(first.cam2world) @ second.cam2world - np.eye(4)
    assert np.abs(move[:3, 3]).max() < 0.02
    assert np.abs(move[:3, :3]).max() < 1e-4
    for name in ("left", "right"):
        assert abs(results[name].deviation - TRUE[name]) < results[name].expanded_uncertainty


def test_each_image_of_a_setting_may_have_its_own_stated_pose(solid, images):
    plan = measured_plan(solid, ["left", "right"], settings=1)
    lit = (LitImage((0,), {"left": 0.5}), LitImage((1,), {"right": 0.5}))
    lamps = np.array([[0.0, 0, 500], [100.0, 0, 500]])
    light = LightPlan("placed", 0.1, 0.05, "dark", lamps, (lit,), ({},), 1, "by hand")
    both = dataclasses.replace(plan, light=light)
    moved = displaced(POSES[0], [0.1, 0, 0, 0, 0, 0])
    taken = {"setting_01_1": images[1], "setting_01_2": photograph(fine_plate(**MADE), moved)[1]}
    poses = {"setting_01_1": POSES[0], "setting_01_2": moved[0]}
    stated = Registration.given(poses, np.diag([1e-8] * 3 + [1e-12] * 3))
    results = measure(both, solid, taken, registration=stated)
    for name, pose in zip(("left", "right"), poses.values(), strict=True):
        assert abs(results[name].deviation - TRUE[name]) < results[name].expanded_uncertainty
        np.testing.assert_array_equal(
            results.images[results[name].readings[0].image].cam2world, pose
        )


def test_rules_and_coverage(solid, images, exact):
    plan = measured_plan(solid, ["left"])
    simple = measure(plan, solid, images, registration=exact, rule=DecisionRule.simple())
    assert str(simple.rule) == "simple acceptance"
    with pytest.raises(RequestError, match=r"coverage must be in \(0, 1\]. Got 1.2"):
        measure(plan, solid, images, coverage=1.2)


def test_another_part_is_refused(solid, images):
    plan = measured_plan(solid)
    with pytest.raises(RequestError, match="part must be the one that was planned"):
        measure(changed(plan, part="plate"), solid, images)


ENDS = {
    "front": [[0.0, 0, 40], [80, 0, 40]],
    "left": [[0.0, 0, 40], [0, 50, 40]],
    "right": [[80.0, 0, 40], [80, 50, 40]],
}


def lengths_plan(plan):
    """The same settings for lengths of edges."""
    settings = [
        dataclasses.replace(one, entities=tuple(ENDS), probability=dict.fromkeys(ENDS, 0.9))
        for one in plan.settings
    ]
    ends = {name: np.array(points) for name, points in ENDS.items()}
    return changed(plan, settings=settings, entities=ends)


@pytest.mark.parametrize("poses", ["given", "own edges"])
def test_lengths_of_edges_end_at_corners(solid, images, exact, poses):
    """The plate is 0.08 mm wider: the edges at its sides are longer by that, the one in front is not."""
    how = exact if poses == "given" else Registration.own_edges()
    results = measure(lengths_plan(measured_plan(solid)), solid, images, registration=how)
    for name, true in (("front", 0.0), ("left", 0.08), ("right", 0.08)):
        one = results[name]
        assert one.measured, one.reason
        assert abs(one.deviation - true) < one.expanded_uncertainty
        # a fifth of a pixel
        assert abs(one.deviation - true) < 0.035
        assert one.expanded_uncertainty < 0.1


def test_the_uncertainty_of_a_length_is_that_of_the_plan(solid, images):
    """With planned poses, what the pose adds is computed by differences here, and by the model of the plan there."""
    plan = lengths_plan(measured_plan(solid))
    results = measure(plan, solid, images, registration=Registration.none())
    for name in ("front", "left"):
        for reading in results[name].readings:
            pose = np.asarray(plan.settings[reading.setting].cam2world)
            budget = plan.targets[name].describe(pose, plan.means).budget
            by_pose = budget["translation"] + budget["rotation"]
            assert reading.budget["pose"] == pytest.approx(by_pose, rel=0.05)


def test_an_edge_without_a_corner_is_named(solid, images, exact):
    covered = {k: image.copy() for k, image in images.items()}
    covered[1][:, :] = np.where(np.arange(640) < 200, 12, covered[1])
    plan = lengths_plan(measured_plan(solid, settings=1))
    results = measure(plan, solid, {1: covered[1]}, registration=exact)
    assert "not measured" in results.counts


def with_positions():
    """A position of a bolt with (M) against two datums, one of a slot, and one of a pattern without datums."""
    bolt = dataclasses.replace(
        result("bolt", "position", Decision.CONFORMS, 0.12, 0.01, (0.0, 0.4)),
        nominal=0.0,
        material="M",
        datums=("e17", "r 4"),
    )
    slot = dataclasses.replace(bolt, name="slot", kind="width_position", material="")
    free = dataclasses.replace(bolt, name="free pattern", material="L", datums=())
    round_about = dataclasses.replace(bolt, name="round about", kind="coaxiality")
    every = {one.name: one for one in (bolt, slot, free, round_about)}
    return dataclasses.replace(measured(), results=every)


def test_positions_have_zones_conditions_and_datum_reference_frames():
    text = qif_text(with_positions())
    assert faults(text) == []
    document = ET.fromstring(text)
    definitions = by_tag(document, "PositionCharacteristicDefinition")
    assert [child.text for child in by_tag(document, "MaterialCondition")] == [
        *("MAXIMUM", "REGARDLESS", "LEAST")
    ]
    shapes = [tag(shape[0]) for shape in by_tag(document, "ZoneShape")]
    assert shapes == ["DiametricalZone", "NonDiametricalZone", "DiametricalZone"]
    # both have the datums e17 and r_4 in this order, so one frame
    (frame,) = by_tag(document, "DatumReferenceFrame")
    frames = [by_tag(one, "DatumReferenceFrameId") for one in definitions]
    assert [one[0].text for one in frames[:2]] == [frame.get("id")] * 2
    assert frames[2] == []
    labels = {one.get("id"): one[0].text for one in by_tag(document, "DatumDefinition")}
    order = [labels[one.text] for one in by_tag(frame, "DatumDefinitionId")]
    assert order == ["e17", "r_4"]
    assert "not in this file: round about" in by_tag(document, "Description")[0].text
