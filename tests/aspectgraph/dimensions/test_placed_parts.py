"""Dimensions of parts that are placed in an assembly: they belong to the feature at its place, in every instance.

Where a hole must be, the tests compute by matrices of their own.
"""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from assemblies import CASES, HOLE, RADIUS_MM, mirrored, placement, step_assembly
from one_kernel import one_kernel

from aspectgraph import ReadError, SolidChoice, read_dimensions, read_solid

pytest.importorskip("OCP")

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


@pytest.fixture(scope="module", autouse=True)
def _one_kernel():
    with one_kernel():
        yield


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
