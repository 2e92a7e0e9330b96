"""QIF 3.0: files are valid by a schema, and their values are the results'.

The schema is `qif_written.xsd`, which states requirements of QIF 3.0 for what is written, and is stricter.
"""

import dataclasses
import re
import uuid
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import xmlschema

from errors.measurands import Decision, DecisionRule
from planner.measuring.reading import Reading
from planner.measuring.results import (
    CHARACTERISTICS,
    NAMESPACE,
    MeasurementResults,
    Result,
    Source,
    qif_text,
)

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
