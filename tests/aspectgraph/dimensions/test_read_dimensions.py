"""Dimensions of real parts: how many, what they say, and that their entities really have the value stated."""

from __future__ import annotations

import math
from collections import Counter
from functools import cache

import numpy as np
import pytest
from one_kernel import one_kernel
from real_parts import EXAMPLES, real_part

from aspectgraph import PartFileNotFoundError, ReadError, read_dimensions, read_solid

pytest.importorskip("OCP")

CTC_01 = EXAMPLES / "nist_ctc_01_ap242.stp"
# semantic dimensions, those with a tolerance, those measurable; counted before, without this code
COUNTS = {
    "nist_ctc_01_ap242.stp": (12, 8, 12),
    "nist_ctc_02_ap242.stp": (7, 7, 7),
    "nist_ctc_03_ap242.stp": (10, 8, 10),
    # ten sizes and locations in the text; the kernel leaves out the one that is attached to curves
    "nist_ctc_04_ap242.stp": (10, 7, 6),
    "nist_ctc_05_ap242.stp": (6, 2, 2),
    # 41 have entities where they are attached; 8 of them state another value than these have
    "nist_d2mi_827-9999-904.stp": (54, 9, 33),
}
# features of the measurable ones: as the drawings number their holes, such as 30 x and 4 x
CHARACTERISTICS = {
    "nist_ctc_01_ap242.stp": 12,
    "nist_ctc_02_ap242.stp": 7,
    "nist_ctc_03_ap242.stp": 14,
    "nist_ctc_04_ap242.stp": 72,
    "nist_ctc_05_ap242.stp": 2,
    "nist_d2mi_827-9999-904.stp": 40,
}
# reference and basic ones: the notes 'auxiliary' and 'theoretical' in the text of the files, counted there
ROLES = {
    "nist_ctc_01_ap242.stp": {},
    "nist_ctc_02_ap242.stp": {},
    "nist_ctc_03_ap242.stp": {"reference": 1},
    "nist_ctc_04_ap242.stp": {"basic": 2},
    "nist_ctc_05_ap242.stp": {"basic": 4},
    "nist_d2mi_827-9999-904.stp": {"basic": 45},
}
REFUSED_IN_D2MI = [
    f"Perpendicular Dimension ({n})" for n in (179, 217, 224, 225, 231, 243, 262, 263)
]


@pytest.fixture(scope="module", autouse=True)
def _one_kernel():
    with one_kernel():
        yield


@cache
def read(name):
    path = real_part(name)
    solid = read_solid(path)
    return solid, read_dimensions(path, solid)


@pytest.fixture(scope="module")
def ctc_01():
    return read("nist_ctc_01_ap242.stp")[0]


def value_of(solid, kind, entities, direction):
    """The value of entities, from the chords and end points of the solid alone; in mm or degrees."""
    circles = {arc.id: arc for arc in (*solid.rims(), *solid.arcs())}

    def place(entity):
        return circles[entity].centre if entity in circles else solid.edge_points(entity)[0]

    if kind in ("diameter", "radius"):
        corners = solid.vertices[list(circles[entities[0]].vertices)]
        distances = np.linalg.norm(corners - circles[entities[0]].centre, axis=1)
        return float(distances.max()) * (2.0 if kind == "diameter" else 1.0)
    if kind == "angle":
        one, other = (np.diff(solid.edge_points(i), axis=0)[0] for i in entities)
        cosine = abs(one @ other) / np.linalg.norm(one) / np.linalg.norm(other)
        return math.degrees(math.acos(cosine))
    return abs(float((place(entities[1]) - place(entities[0])) @ np.array(direction)))


@pytest.mark.parametrize("name", COUNTS)
def test_as_many_as_the_file_holds(name):
    """Nothing that only draws a dimension is among them: with those there would be 158 instead of 99."""
    _, dimensions = read(name)
    found = (
        len(dimensions),
        sum(one.tolerance is not None for one in dimensions),
        sum(one.entities is not None for one in dimensions),
    )
    assert found == COUNTS[name]
    assert len({one.name for one in dimensions}) == len(dimensions)


@pytest.mark.parametrize("name", CHARACTERISTICS)
def test_every_feature_of_a_real_pattern_is_measured_by_entities_of_its_own(name):
    _, dimensions = read(name)
    able = [one for one in dimensions if one.entities]
    assert sum(one.n_features for one in able) == CHARACTERISTICS[name]
    for one in able:
        first = [ways[0] for ways in one.features]
        assert len(set(first)) == len(first) == one.n_features
        assert one.feature_reasons == (None,) * one.n_features


@pytest.mark.parametrize("name", ROLES)
def test_reference_and_basic_dimensions_have_no_tolerance(name):
    """In these files. 19.05 mm is the one in parentheses on the drawing of CTC-03."""
    _, dimensions = read(name)
    assert Counter(one.role for one in dimensions if one.role) == ROLES[name]
    assert {one.tolerance for one in dimensions if one.role} <= {None}
    assert [one.nominal for one in dimensions if one.role == "reference"] == [
        pytest.approx(19.05)
    ] * ROLES[name].get("reference", 0)


@pytest.mark.parametrize("name", COUNTS)
def test_entities_have_the_value_that_is_stated(name):
    solid, dimensions = read(name)
    checked = 0
    for one in dimensions:
        assert (one.entities is None) == (one.reason is not None)
        ways = tuple(way for ways in one.features for way in ways)
        assert ways == ((one.entities, *one.alternatives) if one.entities else ())
        for way in ways:
            value = value_of(solid, one.kind, way, one.direction)
            assert value == pytest.approx(one.nominal, abs=0.014), one
            checked += 1
    assert checked >= COUNTS[name][2]


def test_what_ctc_01_says():
    """Values as its drawing shows them: NIST MBE PMI, CTC-01."""
    _, dimensions = read("nist_ctc_01_ap242.stp")
    angle = dimensions[2]
    diameter = dimensions[3]
    assert (angle.name, angle.kind, angle.nominal, angle.unit, angle.tolerance) == (
        "Angular Size.1", "angle", 60.0, "deg", (-0.5, 0.5)
    )  # fmt: skip
    assert (diameter.name, diameter.kind, diameter.nominal, diameter.tolerance) == (
        "Linear Size.1", "diameter", 35.0, (-0.2, 0.0)
    )  # fmt: skip
    # stated as limits, 34.8 to 35.2
    assert (dimensions[7].nominal, dimensions[7].tolerance) == (35.0, (-0.2, 0.2))


def test_where_no_value_is_stated_it_is_the_geometrys():
    ones = [
        one
        for name in ("nist_ctc_01_ap242.stp", "nist_ctc_03_ap242.stp")
        for one in read(name)[1]
        if one.note
    ]
    assert [one.nominal for one in ones] == [85.0, 50.0, 35.0, 35.0, pytest.approx(38.1, abs=1e-6)]
    assert {one.note for one in ones} == {
        "the file states no nominal value; this is the geometry's"
    }
    assert all(one.tolerance is None for one in ones)


def test_inches_are_millimetres():
    """The drawing of CTC-03 is in inches: 0.75; 0.438 ± 0.005; 0.82 ± 0.06."""
    _, dimensions = read("nist_ctc_03_ap242.stp")
    stated = [(one.nominal, one.tolerance) for one in (dimensions[0], dimensions[1], dimensions[8])]
    expected = [(0.75, None), (0.438, (-0.005, 0.005)), (0.82, (-0.06, 0.06))]
    for (nominal, tolerance), (inches, deviations) in zip(stated, expected, strict=True):
        assert nominal == pytest.approx(25.4 * inches, abs=1e-6)
        assert (tolerance is None) == (deviations is None)
        if tolerance is not None:
            assert tolerance == pytest.approx([25.4 * inch for inch in deviations], abs=1e-6)


def test_a_pattern_lists_each_of_its_holes():
    solid, dimensions = read("nist_ctc_03_ap242.stp")
    holes = dimensions[3]
    assert len(holes.features) == 4
    rims = {arc.id: arc for arc in solid.rims()}
    centres = {tuple(rims[ways[0][0]].centre[:2].round(3)) for ways in holes.features}
    assert centres == {(-38.1, 96.774), (-38.1, 230.124), (-38.1, 185.674), (-38.1, 141.224)}


def test_swapped_signs_and_refused_values_of_d2mi():
    _, dimensions = read("nist_d2mi_827-9999-904.stp")
    swapped = [one for one in dimensions if "taken in order" in one.note]
    assert len(swapped) == 7
    # ± 0.005 inch on each
    assert all(one.tolerance == pytest.approx((-0.127, 0.127)) for one in swapped)
    assert swapped[0].nominal == pytest.approx(9.525)
    assert sum(one.entities is not None for one in dimensions) + len(REFUSED_IN_D2MI) == 41
    reasons = {one.name: one.reason or "" for one in dimensions}
    assert all(reasons[name].startswith("the file states ") for name in REFUSED_IN_D2MI)
    assert reasons["Perpendicular Dimension (217)"] == (
        "the file states 65.278 mm, the geometry it is attached to has 75 mm"
    )


def changed(folder, old, new, count=1):
    text = CTC_01.read_text("latin-1")
    assert text.count(old) == count
    path = folder / "changed.stp"
    path.write_text(text.replace(old, new), "latin-1")
    return path


def last(path, solid, **options):
    """The diameter of 25 ± 0.15 mm."""
    return read_dimensions(path, solid, **options)[11]


def test_swapped_bounds_are_put_in_order(ctc_01, tmp_path):
    one = last(changed(tmp_path, "TOLERANCE_VALUE(#93,#92)", "TOLERANCE_VALUE(#92,#93)"), ctc_01)
    assert (one.nominal, one.tolerance, one.entities) == (25.0, (-0.15, 0.15), ("r2",))
    assert (
        one.note
        == "the file states +0.15 as the lower and -0.15 as the upper deviation; taken in order"
    )


def test_bounds_keep_their_signs(ctc_01, tmp_path):
    """Both above the nominal value: the kernel would give -0.05 to +0.15."""
    path = changed(tmp_path, "LENGTH_MEASURE(-0.15)", "LENGTH_MEASURE(0.05)")
    assert last(path, ctc_01).tolerance == (0.05, 0.15)


def test_values_in_another_unit_than_the_geometry(ctc_01, tmp_path):
    """25 mm in inches, in a file in mm."""
    path = changed(
        tmp_path, "LENGTH_MEASURE(25.),#4361", "LENGTH_MEASURE(0.984251968503937),#999901"
    )
    inch = (
        "#999900=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#4361);\n"
        "#999901=(CONVERSION_BASED_UNIT('INCH',#999900)LENGTH_UNIT()NAMED_UNIT(#4363));\n"
    )
    path.write_text(path.read_text("latin-1").replace("#63=TOL", inch + "#63=TOL"), "latin-1")
    one = last(path, ctc_01)
    assert one.nominal == pytest.approx(25.0, abs=1e-9)
    assert one.tolerance == (-0.15, 0.15)
    assert one.entities == ("r2",)


def test_a_value_that_disagrees_with_the_geometry_is_refused(ctc_01, tmp_path):
    path = changed(tmp_path, "LENGTH_MEASURE(25.)", "LENGTH_MEASURE(25.02)")
    one = last(path, ctc_01)
    assert one.entities is None
    assert one.reason == "the file states 25.02 mm, the geometry it is attached to has 25 mm"
    assert (one.nominal, one.geometry, one.features, one.alternatives) == (25.02, 25.0, (), ())
    assert last(path, ctc_01, agreement_mm=0.03).entities == ("r2",)


def test_an_angle_that_disagrees_is_refused_in_degrees(ctc_01, tmp_path):
    path = changed(tmp_path, "PLANE_ANGLE_MEASURE(60.0)", "PLANE_ANGLE_MEASURE(61.0)")
    assert read_dimensions(path, ctc_01)[2].reason == (
        "the file states 61 degrees, the geometry it is attached to has 60 degrees"
    )
    # 120 degrees are between the same planes
    supplement = tmp_path / "supplement"
    supplement.mkdir()
    path = changed(supplement, "PLANE_ANGLE_MEASURE(60.0)", "PLANE_ANGLE_MEASURE(120.0)")
    assert read_dimensions(path, ctc_01)[2].entities is not None


@pytest.mark.parametrize(
    ("fits", "name", "tolerance"),
    [
        # over 18 to 30 mm: IT7 is 21 µm, IT6 is 13 µm, g begins 7 µm off
        ("'H','hole','7',''", "H7", (0.0, 0.021)),
        ("'G6','hole','',''", "G6", (0.007, 0.02)),
    ],
)
def test_a_tolerance_class_gives_the_limits_of_the_nominal_value(
    ctc_01, tmp_path, fits, name, tolerance
):
    path = changed(tmp_path, "TOLERANCE_VALUE(#93,#92)", f"LIMITS_AND_FITS({fits})")
    one = last(path, ctc_01)
    assert (one.nominal, one.tolerance_class, one.tolerance) == (25.0, name, tolerance)
    assert (one.entities, one.note) == (("r2",), "")


def test_the_class_of_a_shaft_on_a_hole_is_refused(ctc_01, tmp_path):
    path = changed(tmp_path, "TOLERANCE_VALUE(#93,#92)", "LIMITS_AND_FITS('g','shaft','6','')")
    one = last(path, ctc_01)
    assert one.entities is None
    assert one.reason == "the file states g6, a class of shafts, and its geometry is a hole"


def test_the_same_file_gives_the_same_dimensions(ctc_01):
    assert read_dimensions(CTC_01, ctc_01) == read_dimensions(CTC_01, read_solid(CTC_01))


def test_a_file_without_semantic_dimensions_has_none():
    path = EXAMPLES / "mfcad_6-11-11-19.step"
    assert read_dimensions(path, read_solid(path)) == ()


def test_what_is_asked_for_must_make_sense(ctc_01, tmp_path):
    with pytest.raises(
        ReadError, match=r"dimensions are read from \.step and \.stp files\. Got 'part\.stl'"
    ):
        read_dimensions(tmp_path / "part.stl", ctc_01)
    with pytest.raises(PartFileNotFoundError, match="path must name an existing part file"):
        read_dimensions(tmp_path / "none.stp", ctc_01)
    with pytest.raises(ReadError, match=r"agreement_mm must be positive and finite\. Got 0"):
        read_dimensions(CTC_01, ctc_01, agreement_mm=0.0)
    (tmp_path / "text.stp").write_text("solid")
    with pytest.raises(ReadError, match=r"must begin with ISO-10303-21\. Got text\.stp"):
        read_dimensions(tmp_path / "text.stp", ctc_01)


def test_entities_of_another_solid_are_not_offered():
    solid = read_solid(EXAMPLES / "mfcad_6-11-11-19.step")
    dimensions = read_dimensions(CTC_01, solid)
    assert len(dimensions) == 12
    assert all(one.entities is None for one in dimensions)
    assert {one.reason for one in dimensions if one.kind == "diameter"} == {
        "no sharp circular edge bounds what it is attached to"
    }


def test_a_record_says_itself_in_json_and_in_one_line():
    one = read("nist_ctc_01_ap242.stp")[1][3]
    record = one.to_dict()
    assert (record["tolerance"], record["entities"], record["unit"]) == (
        [-0.2, 0.0],
        [one.entities[0]],
        "mm",
    )
    assert set(record) == {*one.__dataclass_fields__, "unit"}
    assert (
        repr(one) == f"<ModelDimension 'Linear Size.1': diameter 35 mm, by ['{one.entities[0]}']>"
    )
