"""Damage of a STEP file: only that of the solids and of their places refuses it; what is ignored is told.

The plate is 100 x 40 x 12 mm with two holes of diameter 12.
"""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from assemblies import CASES, HOLE, placement, step_assembly
from one_kernel import one_kernel

from aspectgraph import ReadError, read_dimensions, read_solid

pytest.importorskip("OCP")

VOLUME = 100.0 * 40.0 * 12.0 - 2.0 * math.pi * 6.0**2 * 12.0
"""A finer chord tolerance than the default brings the facets within 10^-3 of it."""

PLACES = [placement((0.0, 0.0, 0.0)), placement((10.0, 80.0, 30.0), z=(0, 1, 0))]
LAYOUTS = {
    # as ST-Developer writes for Fusion 360: no names of transformations, relations and shapes
    "Fusion 360": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1($,$,",
        r"(REPRESENTATION_RELATIONSHIP)\('','',": r"\1($,$,",
        r"(PRODUCT_DEFINITION_SHAPE)\('','',": r"\1('',$,",
        r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE)\('(\d+)','','',(.*),\$\)": r"\1('\2:1','\2:1','\2:1',\3,'\2:1')",
    },
    # as the Scania files of the same writer: nothing of a shape is named
    "unnamed shapes": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1($,$,",
        r"(PRODUCT_DEFINITION_SHAPE)\('[^']*','',": r"\1($,$,",
    },
    "SolidWorks": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1('NONE','NONE',",
        r"(REPRESENTATION_RELATIONSHIP)\('','',": r"\1('NONE','NONE',",
        r"(PRODUCT_DEFINITION_SHAPE)\('','',": r"\1('NONE','NONE',",
        r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE)\('(\d+)','',''": r"\1('NAUO\2','','NONE'",
        r"((?:CARTESIAN_POINT|DIRECTION|AXIS2_PLACEMENT_3D))\(''": r"\1('NONE'",
    },
    "FreeCAD": {
        r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE)\('(\d+)','',''": r"\1('\2','=>[0:1:1:2]',''",
    },
    "Onshape": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1('',$,",
        r"(REPRESENTATION_RELATIONSHIP)\('','',": r"\1(' ',' ',",
        r"(PRODUCT_DEFINITION_SHAPE)\('','',": r"\1(' ',' ',",
    },
}


@pytest.fixture(scope="module", autouse=True)
def _one_kernel():
    with one_kernel():
        yield


def written(folder, text):
    path = folder / "part.step"
    path.write_text(text)
    return path


def assembly():
    return step_assembly({"root": [("plate", matrix) for matrix in PLACES]})


def with_dimension():
    return (CASES / "dim_with_datum_feature.step").read_text()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_parts_are_where_the_file_puts_them_whoever_wrote_it(layout, tmp_path):
    text = assembly()
    for pattern, new in LAYOUTS[layout].items():
        text, n = re.subn(pattern, new, text)
        assert n
    solid = read_solid(written(tmp_path, text))
    centres = np.array([rim.centre for rim in solid.rims()])
    assert len(centres) == 8
    for matrix in PLACES:
        for centre in (HOLE @ matrix.T)[:, :3]:
            assert np.linalg.norm(centres - centre, axis=1).min() < 1e-6
    assert not [note for note in solid.notes if "error" in note]


def test_solids_without_any_label_are_whole(tmp_path):
    head, data = (CASES / "dim_moved_reason.step").read_text().split("DATA;", 1)
    named = read_solid(written(tmp_path, head + "DATA;" + data))
    bare = read_solid(written(tmp_path, head + "DATA;" + data.replace("('',", "($,")))
    assert bare.volume == named.volume
    assert bare.edges == named.edges


def test_errors_in_pmi_are_ignored_and_told(tmp_path):
    """The size of a datum feature is the aspect itself, which the kernel does not know: three entities refer to it."""
    solid = read_solid(CASES / "dim_with_datum_feature.step", chord_tolerance_mm=0.001)
    assert solid.volume == pytest.approx(VOLUME, rel=1e-4)
    assert solid.notes[0] == (
        "3 errors in PMI were ignored, the first in GEOMETRIC_ITEM_SPECIFIC_USAGE #520"
    )


def test_a_missing_reference_in_pmi_is_ignored_and_one_in_a_face_is_not(tmp_path):
    text = with_dimension()
    pmi = text.replace("PLUS_MINUS_TOLERANCE(#527,", "PLUS_MINUS_TOLERANCE(#9527,")
    assert read_solid(written(tmp_path, pmi)).notes[0].startswith("3 errors in PMI")
    face = re.sub(r"(#459 = ADVANCED_FACE\('',)\(#\d+", r"\1(#9460", text)
    assert face != text
    with pytest.raises(ReadError, match="must be whole"):
        read_solid(written(tmp_path, face))


@pytest.mark.parametrize(
    ("pattern", "new", "message"),
    [
        (r"(ITEM_DEFINED_TRANSFORMATION\('','',#11,)#\d+", r"\1#12", "two coordinate systems"),
        (r"(ITEM_DEFINED_TRANSFORMATION\('','',#11,)#\d+", r"\1$", "must be whole|two coordinate"),
        (r"(ITEM_DEFINED_TRANSFORMATION\('','',#11,)#\d+", r"\1#9999", "must be whole|two coord"),
        (r"(REPRESENTATION_RELATIONSHIP\('','',)#\d+,", r"\1#12,", "must be whole"),
        (r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+','','',)#\d+,", r"\1#12,", "must be|lost"),
        (r"(SHAPE_DEFINITION_REPRESENTATION\(#\d+,)#36", r"\1#9999", "must be placed"),
    ],
)
def test_damage_of_what_places_a_part_is_refused(pattern, new, message, tmp_path):
    text, n = re.subn(pattern, new, assembly(), count=1)
    assert n == 1
    with pytest.raises(ReadError, match=message):
        read_solid(written(tmp_path, text))


def test_dimensions_that_the_kernel_drops_are_listed_with_what_is_known(tmp_path):
    name = "dim_on_thread_curve.step"
    solid = read_solid(CASES / name)
    hole, thread = read_dimensions(CASES / name, solid)
    assert (hole.nominal, hole.tolerance, hole.reason) == (12.0, (-0.05, 0.05), None)
    # the file states 13 +-0.02 on a circle of a curve set
    assert (thread.kind, thread.nominal, thread.tolerance) == ("diameter", 13.0, (-0.02, 0.02))
    assert (thread.entities, thread.reason) == (None, "it is attached to a curve, no face")
    # a size that is a datum feature is attached to the face of its hole
    solid = read_solid(CASES / "dim_with_datum_feature.step")
    (bore,) = read_dimensions(CASES / "dim_with_datum_feature.step", solid)
    rims = {rim.id: rim for rim in solid.rims()}
    assert (bore.kind, bore.nominal, bore.tolerance) == ("diameter", 12.0, (-0.05, 0.05))
    assert rims[bore.entities[0]].radius_mm == pytest.approx(6.0)
    text = (CASES / name).read_text()
    nothing = re.sub(r"#611 = GEOMETRIC_ITEM_SPECIFIC_USAGE\([^;]*;", "", text)
    path = written(tmp_path, nothing)
    assert [one.reason for one in read_dimensions(path, read_solid(path))] == [
        None,
        "it is attached to nothing",
    ]
