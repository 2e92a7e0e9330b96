"""QIF 3.0: structure, references and values of the file.

The table below was read off the schema files QIFDocument, Characteristics, QIFResults and Units of QIF 3.0 and its
sample files (DMSC, qif-community). The files themselves are not kept here, so this does not show validity by them.
"""

import dataclasses
import re
import uuid
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from errors.measurands import Decision, DecisionRule
from planner.measuring.merge import Result
from planner.measuring.qif import CHARACTERISTICS, NAMESPACE, qif_text
from planner.measuring.reading import Reading
from planner.measuring.results import MeasurementResults

# children in their order; those without ? must be there
_STATUS = "(Attributes )?Status CharacteristicItemId (ActualComponentId )?(Value )?"
CHILDREN = {
    "QIFDocument": "QPId Header StandardsDefinitions FileUnits Characteristics Results ",
    "Header": "Application (Description )?(Scope )?",
    "StandardsDefinitions": "(Standard )+",
    "Standard": "Organization Designator (Year )?",
    "PrimaryUnits": "(AngularUnit )?(LinearUnit )?",
    "AngularUnit": "SIUnitName UnitName UnitConversion ",
    "LinearUnit": "SIUnitName UnitName UnitConversion ",
    "Characteristics": "FormalStandardId CharacteristicDefinitions CharacteristicNominals "
    "(CharacteristicItems )?",
    "Tolerance": "MaxValue MinValue DefinedAsLimit ",
    "Results": "MeasurementResultsSet (ActualComponentSets )?",
    "MeasurementResults": "(ExternalFileReferences )?MeasuredCharacteristics InspectionStatus "
    "(ActualComponentIds )?",
    "ExternalFileReference": "URI FileSpec (Description )?",
    "ActualComponent": "(SerialNumber )?Status ",
    "CharacteristicDesignator": "Designator (UUID )?",
}
KINDS = {"Diameter", "Radius", "Length", "DistanceBetween", "AngleBetween"}
for _kind in KINDS:
    _mode = "AnalysisMode " if _kind.endswith("Between") else ""
    _name = f"{_kind}Characteristic"
    CHILDREN[f"{_name}Definition"] = "(Tolerance |NonTolerance )"
    CHILDREN[f"{_name}Nominal"] = f"CharacteristicDefinitionId (Name )?(TargetValue )?{_mode}"
    CHILDREN[f"{_name}Item"] = "(Name )?(CharacteristicDesignator )?CharacteristicNominalId "
    CHILDREN[f"{_name}Measurement"] = _STATUS
DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)")
DECIMALS = {"TargetValue", "MaxValue", "MinValue", "Value", "Factor"}
STATUSES = {
    *("PASS", "FAIL", "REWORK", "SYSERROR", "INDETERMINATE", "NOT_ANALYZED", "BASIC_OR_TED"),
    "UNDEFINED",
}


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
    source = {"program": "1", "part": "plate", "part_digest": "ab", "images": {"setting_01": "f0"}}
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


def test_elements_have_their_children_in_the_order_of_the_schema(root):
    for element in root.iter():
        children = "".join(f"{tag(child)} " for child in element)
        if tag(element) in CHILDREN:
            assert re.fullmatch(CHILDREN[tag(element)], children), (tag(element), children)
        if element.get("n") is not None:
            assert int(element.get("n")) == len(element)
        if tag(element) in DECIMALS:
            assert DECIMAL.fullmatch(element.text)


def test_ids_are_unique_and_every_reference_names_the_right_kind(root):
    ids = {one.get("id"): tag(one) for one in root.iter() if one.get("id")}
    assert len(ids) == sum(one.get("id") is not None for one in root.iter())
    assert root.get("idMax") == str(max(map(int, ids)))
    assert root.get("versionQIF") == "3.0.0"
    for parent in root.iter():
        for child in parent:
            name = tag(child)
            if not name.endswith("Id") or name == "QPId":
                continue
            if name.startswith("Characteristic"):
                # of the same characteristic: a nominal refers to its definition, an item to its nominal
                aspect = name.removeprefix("Characteristic").removesuffix("Id")
                kind = re.split("(?<=Characteristic)", tag(parent))[0]
                assert ids[child.text] == kind + aspect
            elif name == "FormalStandardId":
                assert ids[child.text] == "Standard"
            else:
                assert ids[child.text] == "ActualComponent"


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
        assert fields["Status"][0].text in STATUSES
        if not one.measured:
            assert "Value" not in fields
            assert fields["Status"][0].text == "NOT_ANALYZED"
            assert fields["Attributes"][0].get("value") == "only 3 % < 80 % was\ufffdfound"
            continue
        assert float(fields["Value"].text) == one.value
        assert float(fields["Value"].get("combinedUncertainty")) == one.standard_uncertainty
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
