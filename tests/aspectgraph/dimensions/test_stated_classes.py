"""Tolerance classes, reference and basic dimensions in the text of a file, and what becomes of them."""

from __future__ import annotations

import numpy as np
import pytest

from aspectgraph import Solid
from aspectgraph.dimensions.read_dimensions import _Reader
from aspectgraph.dimensions.tolerances import (
    Statement,
    is_in_hole,
    read_statements,
    resolve_stated_class,
)
from aspectgraph.read.step.stated_dimensions import WITH_TEXTS, list_dimensions
from aspectgraph.read.step.text import parse_entities, parse_texts

N = 12
H7 = (0.0, 0.021)


@pytest.fixture(scope="module")
def ring():
    """A ring whose profile is a rhombus: radius 6 within, 10 outside, and 8 at its upper and lower edge."""
    profile = ((10.0, 0.0), (8.0, 4.0), (6.0, 0.0), (8.0, -4.0))
    turn = 2.0 * np.pi * np.arange(N) / N
    corners = [[r * np.cos(t), r * np.sin(t), z] for r, z in profile for t in turn]
    n = len(profile)
    faces = [
        (k * N + i, k * N + (i + 1) % N, (k + 1) % n * N + (i + 1) % N, (k + 1) % n * N + i)
        for k in range(n)
        for i in range(N)
    ]
    return Solid(corners, faces, name="ring")


def test_a_rim_is_in_a_hole_where_its_walls_face_the_axis(ring):
    found = {round(rim.radius_mm, 6): is_in_hole(ring, rim) for rim in ring.rims()}
    # at the radius of 8 mm one wall faces the axis and one faces away
    assert found == {10.0: False, 6.0: True, 8.0: None}


def file(*lines):
    """Two diameters of 20 mm with what the lines add: the notes #40 are those of the first."""
    return (
        "DATA;\n"
        "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n"
        "#10=DIMENSIONAL_SIZE(#9,'diameter');\n"
        "#11=DIMENSIONAL_SIZE(#9,'diameter');\n"
        "#20=LENGTH_MEASURE_WITH_UNIT(POSITIVE_LENGTH_MEASURE(20.),#1);\n"
        "#30=SHAPE_DIMENSION_REPRESENTATION('',(#20,#40),#9);\n"
        "#31=SHAPE_DIMENSION_REPRESENTATION('',(#20),#9);\n"
        "#33=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#10,#30);\n"
        "#34=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#11,#31);\n"
        "#41=PLUS_MINUS_TOLERANCE(#42,#10);\n" + "\n".join(lines) + "\nENDSEC;"
    ).encode()


def listed(*lines):
    data = file(*lines)
    entities = parse_entities(data)
    first, second = list_dimensions(entities, parse_texts(data, entities, WITH_TEXTS))
    assert (second.tolerance_class, second.role, second.notes) == ("", "", ())
    return first


@pytest.mark.parametrize(
    ("fits", "expected"),
    [
        # as ISO 10303 and its recommended practices have it
        ("'H','hole','7',''", "H7"),
        ("'g','shaft','6',''", "g6"),
        # as files of NIST have it: STC-10 and FTC-10
        ("'G','','6',''", "G6"),
        ("'G6','hole','',''", "G6"),
        # the zone has the last word
        ("'h','hole','7',''", "H7"),
        ("'JS','shaft','9',''", "js9"),
        ("'H','H','IT7',''", "H7"),
        ("'zc','s','IT 11','ISO 286'", "zc11"),
        ("'D','','01',''", "D01"),
        ("'what''s this?','','7',''", "what's this? 7"),
        ("'','','',''", ""),
    ],
)
def test_limits_and_fits_are_a_class(fits, expected):
    assert listed(f"#42=LIMITS_AND_FITS({fits});").tolerance_class == expected


@pytest.mark.parametrize(
    ("note", "role"),
    [
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','auxiliary')", "reference"),
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','Reference ')", "reference"),
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','theoretical')", "basic"),
        (
            "(DESCRIPTIVE_REPRESENTATION_ITEM('theoretical')REPRESENTATION_ITEM('dimensional note'))",
            "basic",
        ),
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','statistical')", ""),
    ],
)
def test_notes_make_a_dimension_a_reference_or_a_basic_one(note, role):
    assert listed(f"#40={note};").role == role


def test_texts_are_read_as_they_are_written():
    """Semicolons and quotation marks in texts, comments between, and a text that looks like an entity."""
    data = file(
        "#40=DESCRIPTIVE_REPRESENTATION_ITEM('it''s; #42=X', /* '; */ 'b');",
        "#50=OTHER('#40=DESCRIPTIVE_REPRESENTATION_ITEM(''c'')');",
    )
    entities = parse_entities(data)
    assert parse_texts(data, entities, WITH_TEXTS) == {40: ("it's; #42=X", "b")}
    assert parse_texts(data, entities, ("OTHER",)) == {
        50: ("#40=DESCRIPTIVE_REPRESENTATION_ITEM('c')",)
    }
    assert parse_texts(data, entities, ("NONE",)) == {}


def test_class_role_and_notes_reach_the_statement():
    row = {"values": [20.0], "is_range": False, "has_bounds": False}
    text = {
        "location": False,
        "values": (20.0,),
        "bounds": None,
        "of_occurrence": False,
        "tolerance_class": "H7",
        "role": "reference",
        "notes": ("2x",),
    }
    (found,) = read_statements([row], [text])
    assert found == Statement(20.0, tolerance_class="H7", role="reference", notes=("2x",))


@pytest.mark.parametrize(
    ("notes", "title", "expected"),
    [
        ((), "Ø20 H7", "H7"),
        ((), "20H7", "H7"),
        ((), "D = 20,0 H7 THRU", "H7"),
        (("H7",), "", "H7"),
        (("dimensional note", "20 H7"), "", "H7"),
        # other sizes, threads, products and numbers are no classes
        ((), "25 H7", None),
        ((), "H7", None),
        ((), "Linear Size.20", None),
        (("M6",), "20 x5", None),
        ((), "20 R5", None),
        ((), "20 C1", None),
        ((), "20 H75", None),
        ((), "120 H7", None),
        ((), "20 H7.5", None),
    ],
)
def test_a_class_in_notes_and_names_stands_behind_the_nominal_value(notes, title, expected):
    found = resolve_stated_class(Statement(20.0, notes=notes), title, "diameter", 20.0, None)
    assert (found.name, found.fault) == (expected, None)
    assert found.deviations == (H7 if expected else None)


def resolve(name, kind="diameter", nominal=20.0, in_hole=None, **stated):
    statement = Statement(nominal, tolerance_class=name, **stated)
    return resolve_stated_class(statement, "", kind, nominal, in_hole)


@pytest.mark.parametrize(
    ("found", "fault"),
    [
        (resolve("q7"), "the file states the tolerance class 'q7', which is none of ISO 286"),
        (resolve("t6"), "the file states 20 t6: t is defined over 24 and up to 3150 mm"),
        (resolve("H7", nominal=4000.0), "the file states 4000 H7: must be over 0 and up to 3150"),
        (resolve("H7", "angle"), "the file states the tolerance class H7, which is for diameters"),
        (resolve("H7", nominal=None), "the file states the tolerance class H7 without a size"),
        (
            resolve("g6", in_hole=True),
            "the file states g6, a class of shafts, and its geometry is a hole",
        ),
        (
            resolve("H7", in_hole=False),
            "the file states H7, a class of holes, and its geometry is a shaft",
        ),
    ],
)
def test_classes_that_give_no_tolerance_are_faults(found, fault):
    assert found.fault is not None
    assert found.fault.startswith(fault)


def test_deviations_beside_a_class_are_compared():
    assert resolve("H7", tolerance=(0.0, 0.021)).note == ""
    assert resolve("H7", tolerance=(0.0, 0.0205)).note == ""
    assert resolve("H7", tolerance=(0.0, 0.03)).note == (
        "the file states H7, which is +0 and +0.021 mm, and other deviations; these are taken"
    )


def row(radius):
    circle = {"kind": "circle", "point": [0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0], "radius": radius}
    return {
        "words": "diameter",
        "type": "Size_Diameter",
        "name": "bore",
        "sides": [[circle], []],
        "solids": [0],
        "unread": [0, 0],
        "compared": True,
        "unresolved": "",
    }


def test_a_dimension_has_the_limits_of_its_class(ring):
    """12 H7 is +18 and 0 µm, 20 g6 is -7 and -20 µm."""
    reader = _Reader(ring, 0.01, 0.05)
    bore = reader.dimension(row(6.0), Statement(12.0, tolerance_class="H7"))
    assert (bore.tolerance, bore.tolerance_class, bore.reason) == ((0.0, 0.018), "H7", None)
    assert bore.to_dict()["tolerance_class"] == "H7"
    outside = reader.dimension(row(10.0), Statement(20.0, tolerance_class="g6"))
    assert (outside.tolerance, outside.tolerance_class) == ((-0.02, -0.007), "g6")
    wrong = reader.dimension(row(6.0), Statement(12.0, tolerance_class="g6"))
    assert wrong.entities is None
    assert wrong.reason == "the file states g6, a class of shafts, and its geometry is a hole"
    # where the file states no value, the class is that of the geometry's
    assert reader.dimension(row(6.0), Statement(tolerance_class="H7")).tolerance == (0.0, 0.018)


def test_stated_deviations_come_before_those_of_a_class(ring):
    reader = _Reader(ring, 0.01, 0.05)
    stated = Statement(12.0, (0.0, 0.05), tolerance_class="H7", role="reference")
    bore = reader.dimension(row(6.0), stated)
    assert (bore.tolerance, bore.role) == ((0.0, 0.05), "reference")
    assert bore.note.startswith("the file states H7, which is +0 and +0.018 mm")
    limits = reader.dimension(row(6.0), Statement(limits=(12.0, 12.018), tolerance_class="H7"))
    assert (limits.tolerance, limits.note) == (
        (0.0, 0.018),
        "the file states no nominal value; this is the geometry's",
    )
