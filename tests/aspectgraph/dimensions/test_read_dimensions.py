"""Dimensions of real parts: how many, what they say, and that their entities really have the value stated."""

from __future__ import annotations

import math
import re
from collections import Counter
from functools import cache

import numpy as np
import pytest
from real_parts import EXAMPLES, real_part
from step_kernels import one_kernel
from step_parts import CASES, HOLE, RADIUS_MM, mirrored, placement, step_assembly

from aspectgraph import (
    PartFileNotFoundError,
    ReadError,
    Solid,
    SolidChoice,
    read_dimensions,
    read_solid,
)
from aspectgraph.read.step.semantic_dimensions import list_attached_items
from aspectgraph.read.step.text import parse_entities

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


@pytest.mark.parametrize("name", ["mfcad_6-11-11-19.step", "nist_ctc_03_ap242.stp.gz"])
def test_a_solid_of_another_file_is_refused(name):
    """No vertex of it is where the file's dimensions have an edge."""
    solid = read_solid(EXAMPLES / name)
    rule = f"solid must be the part of {CTC_01.name}. Got {solid.name!r}, which has no edge"
    with pytest.raises(ReadError, match=re.escape(rule)):
        read_dimensions(CTC_01, solid)


def test_a_part_without_the_file_of_its_solid_is_known_by_its_edges(ctc_01):
    """A mesh has the vertices of the model, in the same frame; moved, it has none of them."""
    mesh = Solid(ctc_01.vertices, ctc_01.faces, name="mesh")
    assert len(read_dimensions(CTC_01, mesh)) == 12
    moved = Solid(np.add(ctc_01.vertices, [0.0, 0.0, 7.3]), ctc_01.faces, name="moved")
    with pytest.raises(ReadError, match=r"Got 'moved', which has no edge .* read_solid\.$"):
        read_dimensions(CTC_01, moved)


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


# Dimensions of parts that are placed in an assembly: they belong to the feature at its place, in
# every instance. Where a hole must be, the tests compute by matrices of their own.


UNIT = np.eye(4)
DIAGONAL = (0.0, 1.0, 1.0)
TURNED = placement((10.0, -200.0, 30.0), z=(1, 0, 0), x=DIAGONAL)
UPSIDE_DOWN = placement((0.0, 0.0, 100.0), z=(0, 0, -1))
ASIDE = placement((300.0, 0.0, 0.0), z=DIAGONAL)
TREE = {
    "root": [("plate", placement((0.0, -300.0, 0.0))), ("inner", TURNED), ("outer", ASIDE)],
    "outer": [("inner", UPSIDE_DOWN), ("inner", UNIT), ("plate", TURNED)],
    "inner": [("plate", ASIDE), ("plate", UPSIDE_DOWN)],
}


@cache
def read_case(name):
    """A case and its dimensions."""
    solid = read_solid(CASES / name)
    return solid, read_dimensions(CASES / name, solid)


def placements(tree, name="root", matrix=UNIT):
    """Go through the matrices of all plates below an assembly, in the order of the file."""
    for child, own in tree[name]:
        if child == "plate":
            yield matrix @ own
        else:
            yield from placements(tree, child, matrix @ own)


def centres(solid, dimension):
    """The centres of all rims that measure a diameter, sorted, shape (n, 3)."""
    rims = {rim.id: rim for rim in solid.rims()}
    ways = [rims[way[0]] for way in (dimension.entities, *dimension.alternatives)]
    assert all(rim.radius_mm == pytest.approx(RADIUS_MM) for rim in ways)
    return np.array(sorted(rim.centre.tolist() for rim in ways))


def hole_at(matrix):
    """The centres of the rims of the plate's first hole after a placement, sorted, shape (2, 3)."""
    return np.array(sorted((HOLE @ matrix.T)[:, :3].tolist()))


def written(folder, text):
    path = folder / "assembly.step"
    path.write_text(text)
    return path


def added(text, statements):
    """A file with more statements at its end."""
    return text.replace("ENDSEC;\nEND-ISO", statements + "\nENDSEC;\nEND-ISO")


def test_a_dimension_is_where_the_placements_put_its_hole(tmp_path):
    """Eight instances: at several depths, several of one assembly, and one assembly in several others."""
    path = written(tmp_path, step_assembly(TREE))
    solid = read_solid(path)
    dimensions = read_dimensions(path, solid)
    expected = list(placements(TREE))
    assert len(expected) == 8
    assert len(dimensions) == len(expected)
    for k, (dimension, matrix) in enumerate(zip(dimensions, expected, strict=True)):
        assert np.allclose(centres(solid, dimension), hole_at(matrix), atol=1e-6)
        assert dimension.solids == (k,)
        assert dimension.name == f"diameter 1 (solid {k})"


@pytest.mark.parametrize(
    ("name", "holes"),
    [
        ("dim_part_moved.step", [(-20.0, 20.0, 0.0)]),
        ("dim_cover_on_base.step", [(20.0, 20.0, 40.0)]),
        ("dim_two_instances.step", [(20.0, 20.0, 0.0), (20.0, 80.0, 0.0)]),
        ("dim_moved_reason.step", [(120.0, 70.0, 0.0)]),
    ],
)
def test_free_cases(name, holes):
    solid, dimensions = read_case(name)
    assert len(dimensions) == len(holes)
    for dimension, lowest in zip(dimensions, holes, strict=True):
        assert dimension.reason is None
        assert np.allclose(centres(solid, dimension), [lowest, np.add(lowest, (0.0, 0.0, 12.0))])


@pytest.mark.parametrize(
    ("solids", "reasons"),
    [
        ([1, 0], [None, None]),
        ([1], ["solid 0 of the file was not read", None]),
        ([0], [None, "solid 1 of the file was not read"]),
        (SolidChoice([1], "all"), ["solid 0 only stands in the way", None]),
    ],
)
def test_what_is_on_solids_that_are_not_measured_says_so(solids, reasons):
    path = CASES / "dim_two_instances.step"
    solid = read_solid(path, solids=solids)
    dimensions = read_dimensions(path, solid)
    assert [one.reason for one in dimensions] == reasons
    assert [one.name for one in dimensions] == ["diameter 1 (solid 0)", "diameter 1 (solid 1)"]
    for one, y in zip(dimensions, (20.0, 80.0), strict=True):
        if one.entities:
            assert np.allclose(centres(solid, one)[:, :2], (20.0, y))


def test_a_solid_that_was_not_read_leaves_its_dimension_to_no_other(tmp_path):
    """The lower rim of the cover's hole is the upper one of the base's here, and the base alone is read."""
    text = (CASES / "dim_cover_on_base.step").read_text().replace("(0.,0.,40.)", "(0.,0.,12.)")
    path = written(tmp_path, text)
    (dimension,) = read_dimensions(path, read_solid(path, solids=[0]))
    assert (dimension.entities, dimension.reason) == (None, "solid 1 of the file was not read")


def between_base_and_cover(name="dim_cover_on_base.step"):
    """A distance of 40 mm between the same face of the base and of the cover, which lies 40 mm higher."""
    text = (CASES / name).read_text()
    text = re.sub(r"#900 = DIMENSIONAL_SIZE\([^;]*;", "#900 = DIMENSIONAL_LOCATION('linear "
                  "distance','',#895,#3001);", text)  # fmt: skip
    text = text.replace("#895,#469,#857)", "#895,#469,#668)").replace(
        "MEASURE(12.)", "MEASURE(40.)"
    )
    return added(
        text,
        "#3001 = SHAPE_ASPECT('','',#30,.T.);\n"
        "#3002 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#3001,#36,#235);",
    )


def test_a_dimension_between_two_parts_is_measured_after_both_are_placed(tmp_path):
    path = written(tmp_path, between_base_and_cover())
    (dimension,) = read_dimensions(path, read_solid(path))
    assert (dimension.kind, dimension.geometry) == ("distance", pytest.approx(40.0))
    assert (dimension.solids, dimension.reason) == ((0, 1), None)


def test_a_dimension_between_parts_that_may_be_others_is_refused(tmp_path):
    second_cover = (
        "#3010 = CARTESIAN_POINT('',(0.,0.,80.));\n#3011 = DIRECTION('',(0.,0.,1.));\n"
        "#3012 = DIRECTION('',(1.,0.,0.));\n#3013 = AXIS2_PLACEMENT_3D('',#3010,#3011,#3012);\n"
        "#3014 = ITEM_DEFINED_TRANSFORMATION('','',#11,#3013);\n"
        "#3015 = ( REPRESENTATION_RELATIONSHIP('','',#469,#10) "
        "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#3014) "
        "SHAPE_REPRESENTATION_RELATIONSHIP() );\n"
        "#3016 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('9','','',#5,#464,$);\n"
        "#3017 = PRODUCT_DEFINITION_SHAPE('Placement','',#3016);\n"
        "#3018 = CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#3015,#3017);"
    )
    path = written(tmp_path, added(between_base_and_cover(), second_cover))
    (dimension,) = read_dimensions(path, read_solid(path))
    assert dimension.entities is None
    assert dimension.reason == (
        "it is attached to parts that are there 1 and 2 times, and the file does not say which of them belong together"
    )


def test_a_dimension_of_one_occurrence_is_not_one_of_all(tmp_path):
    text = (CASES / "dim_two_instances.step").read_text()
    path = written(tmp_path, text.replace("SHAPE_ASPECT('','',#30,", "SHAPE_ASPECT('','',#549,"))
    (dimension,) = read_dimensions(path, read_solid(path))
    assert dimension.reason == (
        "the file attaches it to one of 2 instances of the part, and which one is not read"
    )


def test_a_mirrored_part_is_refused_by_its_operator(tmp_path):
    """The kernel would turn it: the hole at (-20, 20) would come out at (-20, -20)."""
    path = written(tmp_path, step_assembly({"root": [("plate", mirrored((0.0, 0.0, 0.0)))]}))
    with pytest.raises(ReadError, match=r"must be moved and turned only\. Got #\d+, which mirrors"):
        read_solid(path)


def test_a_scaled_part_is_refused_by_its_operator(tmp_path):
    text = step_assembly({"root": [("plate", mirrored((0.0, 0.0, 0.0)))]})
    path = written(tmp_path, text.replace(",1.,#", ",2.,#"))
    with pytest.raises(ReadError, match=r"in their own size\. Got #\d+, which scales a part by 2"):
        read_solid(path)


# Dimensions of patterns: every item of an aspect counts, however the file attaches it. The plate
# has holes at (20, 20) and (60, 20), of radius 6, and is placed twice. The face of the first hole
# is #481, that of the second one #508; #335 is the cylinder below the second face, which no shape
# of the part is made from by itself.


USAGE = "GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#551,#36,#481);"
ALSO = "#900 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#551,#36,#{item});"
PARTS = """#900 = SHAPE_ASPECT('','',#30,.T.);
#901 = SHAPE_ASPECT('','',#30,.T.);
#902 = SHAPE_ASPECT_RELATIONSHIP('','',#551,#900);
#903 = SHAPE_ASPECT_RELATIONSHIP('','',#900,#901);
#904 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#901,#36,#481);
#905 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#901,#36,#508);"""


def plate(usages):
    """The file with these statements in place of what attaches its dimension."""
    text = (CASES / "dim_two_instances.step").read_text()
    number = text[: text.index(USAGE)].rsplit("#", 1)[1]
    return text.replace(f"#{number}{USAGE}", usages)


def dimensions_of(folder, usages):
    path = folder / "plate.step"
    path.write_text(plate(usages))
    solid = read_solid(path)
    return {rim.id: rim for rim in solid.rims()}, read_dimensions(path, solid)


def holes(rims, dimension):
    """The places of the holes of each feature, as (x, y)."""
    return [
        {tuple(rims[way[0]].centre[:2].round(6).tolist()) for way in ways}
        for ways in dimension.features
    ]


@pytest.mark.parametrize(
    "usages",
    [f"#552 = {USAGE}\n{ALSO.format(item=508)}", PARTS],
    ids=["two usages of one aspect", "two usages of a part of a part"],
)
def test_all_items_of_an_aspect_are_features(usages, tmp_path):
    rims, dimensions = dimensions_of(tmp_path, usages)
    assert len(dimensions) == 2
    for dimension, y in zip(dimensions, (20.0, 80.0), strict=True):
        assert (dimension.n_features, dimension.reason, dimension.note) == (2, None, "")
        assert sorted(map(sorted, holes(rims, dimension))) == [[(20.0, y)], [(60.0, y)]]


def test_an_item_that_no_shape_is_made_from_counts_and_is_told(tmp_path):
    rims, dimensions = dimensions_of(tmp_path, f"#552 = {USAGE}\n{ALSO.format(item=335)}")
    for dimension, y in zip(dimensions, (20.0, 80.0), strict=True):
        assert dimension.n_features == 2
        assert holes(rims, dimension) == [{(20.0, y)}, set()]
        assert dimension.note == (
            "1 item that it is attached to could not be read; 1 of its 2 features cannot be measured"
        )
        assert dimension.feature_reasons == (
            None,
            "the file attaches it to an item of this feature that could not be read",
        )


def test_an_item_that_is_stated_twice_counts_once(tmp_path):
    _, dimensions = dimensions_of(tmp_path, f"#552 = {USAGE}\n{ALSO.format(item=481)}")
    assert [one.n_features for one in dimensions] == [1, 1]


def items(statements):
    text = "DATA;\n#30=PRODUCT_DEFINITION_SHAPE('','',$);\n" + statements + "\nENDSEC;"
    return list_attached_items(parse_entities(text.encode()))


def test_items_in_the_text():
    """An aspect with items of its own is not asked for parts; circles of aspects end."""
    usages = (
        "#1=SHAPE_ASPECT('','',#30,.T.);#2=SHAPE_ASPECT('','',#30,.T.);"
        "#3=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#1,#7,#11);"
        "#4=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#1,#7,#12);"
        "#5=SHAPE_ASPECT_RELATIONSHIP('','',#2,#1);#6=SHAPE_ASPECT_RELATIONSHIP('','',#1,#2);"
        "#8=CENTRE_OF_SYMMETRY('','',#30,.F.);"
        "#9=SHAPE_ASPECT_DERIVING_RELATIONSHIP('','',#8,#2);"
    )
    assert items(usages + "#20=DIMENSIONAL_SIZE(#1,'');") == [[[11, 12]]]
    assert items(usages + "#20=DIMENSIONAL_LOCATION('','',#8,#1);") == [[[11, 12], [11, 12]]]
    assert items(usages + "#20=DIMENSIONAL_SIZE_WITH_DATUM_FEATURE('','',#30,.T.,#2,'');") == [
        [[11, 12]]
    ]
    assert items("#1=SHAPE_ASPECT('','',#30,.T.);#20=DIMENSIONAL_SIZE(#1,'');") == [[[]]]
