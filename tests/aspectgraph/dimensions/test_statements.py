"""What a file states of a dimension, from the kernel's rows and from those of the text."""

from __future__ import annotations

from aspectgraph.dimensions.features import unique_names
from aspectgraph.dimensions.tolerances import Statement, read_statements
from aspectgraph.read.step.stated_dimensions import StatedDimension, list_dimensions
from aspectgraph.read.step.text import parse_entities

# as OCCT gives them: the lower deviation with its sign turned; swapped ones as a range
PLAIN = {"values": [35.0, 0.2, 0.0], "is_range": False, "has_bounds": True}
SWAPPED = {"values": [9.525, 0.127], "is_range": True, "has_bounds": False}
LIMITS = {"values": [34.8, 35.2], "is_range": True, "has_bounds": False}
BARE = {"values": None, "is_range": False, "has_bounds": False}
TEXT = {
    "plain": {"location": False, "values": (35.0,), "bounds": (-0.2, 0.0), "of_occurrence": False},
    "swapped": {
        "location": False,
        "values": (9.525,),
        "bounds": (0.127, -0.127),
        "of_occurrence": False,
    },
    "limits": {"location": False, "values": (34.8, 35.2), "bounds": None, "of_occurrence": False},
    "bare": {"location": True, "values": (), "bounds": None, "of_occurrence": False},
    "left out": {"location": False, "values": (12.0,), "bounds": None, "of_occurrence": False},
}


def test_the_text_is_paired_by_order_and_value():
    rows = [PLAIN, SWAPPED, LIMITS, BARE]
    texts = [TEXT[name] for name in ("left out", "plain", "left out", "swapped", "limits", "bare")]
    plain, swapped, limits, bare = read_statements(rows, texts)
    assert plain == Statement(35.0, (-0.2, 0.0))
    assert (swapped.nominal, swapped.tolerance) == (9.525, (-0.127, 0.127))
    assert (
        swapped.note
        == "the file states +0.127 as the lower and -0.127 as the upper deviation; taken in order"
    )
    assert limits == Statement(limits=(34.8, 35.2))
    assert bare == Statement()


def test_without_the_text_swapped_bounds_are_a_fault():
    """A nominal value of 4.826, the middle of 9.525 and 0.127, would be nonsense."""
    plain, swapped, limits, bare = read_statements([PLAIN, SWAPPED, LIMITS, BARE], [TEXT["plain"]])
    assert (plain.nominal, plain.tolerance) == (35.0, (-0.2, 0.0))
    assert plain.note.startswith("the text of the file could not be compared")
    assert swapped == Statement(fault="its limits are in the wrong order: 9.525 above 0.127")
    assert limits == Statement(limits=(34.8, 35.2))
    assert bare == Statement()


def test_a_tolerance_is_not_paired_with_a_bare_value():
    texts = [
        {"location": False, "values": (35.0,), "bounds": None, "of_occurrence": False},
        TEXT["plain"],
    ]
    assert read_statements([PLAIN], texts) == [Statement(35.0, (-0.2, 0.0))]


def test_three_values_are_limits_around_the_nominal_one():
    text = {"location": False, "values": (35.0, 35.2, 34.8), "bounds": None, "of_occurrence": False}
    assert read_statements([LIMITS], [text]) == [Statement(35.0, (-0.2, 0.2))]


def test_units_of_the_text():
    """An inch has 25.4 mm, a radian 180/pi degrees; a degree written with few digits is a degree."""
    data = b"""DATA;
#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#2=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#1);
#3=(CONVERSION_BASED_UNIT('INCH',#2)LENGTH_UNIT()NAMED_UNIT(#9));
#4=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#5=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(0.01745329),#4);
#6=(CONVERSION_BASED_UNIT('DEGREE',#5)NAMED_UNIT(#9)PLANE_ANGLE_UNIT());
#10=DIMENSIONAL_SIZE(#9,'diameter');
#11=ANGULAR_LOCATION('angle',$,#9,#9,.SMALL.);
#12=ANGULAR_SIZE(#9,'angle',.SMALL.);
#20=LENGTH_MEASURE_WITH_UNIT(POSITIVE_LENGTH_MEASURE(2.),#3);
#21=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(30.),#6);
#22=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(1.),#4);
#23=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(-0.5),#3);
#24=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.25),#1);
#30=SHAPE_DIMENSION_REPRESENTATION('',(#20),#9);
#31=SHAPE_DIMENSION_REPRESENTATION('',(#21),#9);
#32=SHAPE_DIMENSION_REPRESENTATION('',(#22),#9);
#33=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#10,#30);
#34=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#11,#31);
#35=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#12,#32);
#36=TOLERANCE_VALUE(#23,#24);
#37=PLUS_MINUS_TOLERANCE(#36,#10);
ENDSEC;"""
    assert list_dimensions(parse_entities(data)) == [
        StatedDimension(False, (50.8,), (-12.7, 0.25)),
        StatedDimension(True, (30.0,), None),
        StatedDimension(False, (57.29577951308232,), None),
    ]


def test_names_are_unique():
    assert unique_names(["a", "b", "a", "a #2", "a"]) == ["a", "b", "a #2", "a #2 #2", "a #3"]
