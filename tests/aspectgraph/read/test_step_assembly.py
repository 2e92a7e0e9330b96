"""Assemblies: solids in contact become one body, and some of them may only stand in the way."""

from __future__ import annotations

import numpy as np
import pytest
from one_kernel import one_kernel

from aspectgraph import (
    EntityError,
    ReadError,
    SelfIntersectionError,
    SolidChoice,
    SolidError,
    read_solid,
    resolve_entities,
)

pytest.importorskip("OCP")
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer


@pytest.fixture(scope="module", autouse=True)
def _one_kernel():
    with one_kernel():
        yield


def box(size, at):
    return BRepPrimAPI_MakeBox(gp_Pnt(*map(float, at)), *map(float, size)).Shape()


def cylinder(radius, height, at):
    return BRepPrimAPI_MakeCylinder(
        gp_Ax2(gp_Pnt(*map(float, at)), gp_Dir(0, 0, 1)), radius, height
    ).Shape()


def write(path, *shapes):
    writer = STEPControl_Writer()
    for shape in shapes:
        writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
    return path


@pytest.fixture
def boss_on_plate(tmp_path):
    """A plate, a boss in the middle of its top, and a block apart."""
    return write(
        tmp_path / "assembly.step",
        box((8, 8, 2), (0, 0, 0)),
        box((4, 4, 3), (2, 2, 2)),
        box((1, 1, 1), (20, 0, 0)),
    )


def lengths(solid):
    return sorted(round(solid.edge_length_mm(edge.id), 9) for edge in solid.straight_edges())


def test_solids_in_contact_are_one_body(boss_on_plate):
    solid = read_solid(boss_on_plate)
    # the top of the plate has a hole, the bottom of the boss is gone
    assert (solid.n_shells, len(solid.faces), len(solid.edges)) == (2, 6 + 5 + 6, 12 + 12 + 12)
    assert solid.volume == pytest.approx(8 * 8 * 2 + 4 * 4 * 3 + 1, rel=1e-12)
    assert "solids 0 and 1 touch and are one body; edges inside a contact are gone" in solid.notes
    assert lengths(solid) == sorted([8.0] * 8 + [2.0] * 4 + [4.0] * 8 + [3.0] * 4 + [1.0] * 12)


@pytest.mark.parametrize(
    ("choice", "expected", "n_shells"),
    [
        (SolidChoice([0], "all"), [8.0] * 8 + [2.0] * 4, 2),
        (SolidChoice([1], [0]), [4.0] * 8 + [3.0] * 4, 1),
        (SolidChoice(None, [0]), [4.0] * 8 + [3.0] * 4 + [1.0] * 12, 2),
        (SolidChoice([2], [1]), [1.0] * 12, 2),
    ],
)
def test_edges_of_occluders_are_no_entities(boss_on_plate, choice, expected, n_shells):
    solid = read_solid(boss_on_plate, solids=choice)
    assert lengths(solid) == sorted(expected)
    assert solid.n_shells == n_shells
    assert any(note.endswith("in the way only") for note in solid.notes)
    other = next(edge.id for edge in solid.edges if edge not in solid.straight_edges())
    with pytest.raises(EntityError, match="of an occluder"):
        resolve_entities(solid, [other])


def test_edges_flush_with_an_occluder_end_where_the_contact_ends(tmp_path):
    # The upper of two boxes of the same section: its vertical edges go on in those of the lower one, whose are no
    # entities; its lower edges lie between coplanar faces and are none either.
    path = write(tmp_path / "stack.step", box((4, 4, 2), (0, 0, 0)), box((4, 4, 3), (0, 0, 2)))
    assert lengths(read_solid(path, solids=SolidChoice([1], "all"))) == [3.0] * 4 + [4.0] * 4
    assert lengths(read_solid(path)) == [4.0] * 8 + [5.0] * 4
    assert read_solid(path).volume == pytest.approx(4 * 4 * 5, rel=1e-12)


def test_a_pin_in_its_hole(tmp_path):
    plate = BRepAlgoAPI_Cut(box((20, 20, 4), (0, 0, 0)), cylinder(3.0, 4.0, (10, 10, 0))).Shape()
    path = write(tmp_path / "pin.step", plate, cylinder(3.0, 10.0, (10, 10, 0)))
    solid = read_solid(path, solids=SolidChoice([0], [1]), chord_tolerance_mm=0.02)
    assert solid.n_shells == 1
    assert lengths(solid) == [4.0] * 4 + [20.0] * 8
    # the plate is full, and six millimetres of the pin stand out of it
    assert solid.volume == pytest.approx(20 * 20 * 4 + 6 * np.pi * 9, rel=2e-3)
    # the plate's two rims of the hole: where the pin ends flush there is none to be seen
    assert [round(rim.radius_mm, 9) for rim in solid.rims()] == [3.0]


def test_solids_apart_stay_as_they_were(tmp_path):
    path = write(tmp_path / "apart.step", box((2, 2, 2), (0, 0, 0)), box((2, 2, 2), (1, 0, 5)))
    solid = read_solid(path)
    assert (solid.n_shells, len(solid.edges), solid.notes) == (2, 24, ("2 solids",))


def test_solids_that_overlap_are_refused_by_number(tmp_path):
    path = write(
        tmp_path / "part.step",
        box((9, 9, 9), (0, 0, 0)),
        box((1, 1, 1), (20, 0, 0)),
        box((2, 2, 2), (3, 3, 3)),
    )
    with pytest.raises(
        SelfIntersectionError, match=r"must not overlap. Got solids 0 and 2 of part.step, which do"
    ):
        read_solid(path)
    assert read_solid(path, solids=[0, 1]).volume == pytest.approx(730)


@pytest.mark.parametrize("at", [(2, 2, 0), (2, 2, 2)])
def test_contact_in_a_line_or_a_point_is_refused(tmp_path, at):
    path = write(tmp_path / "part.step", box((2, 2, 2), (0, 0, 0)), box((2, 2, 2), at))
    with pytest.raises(SolidError, match="holds 2 solids; read some of them"):
        read_solid(path)


def test_choices_that_are_none(boss_on_plate):
    with pytest.raises(
        ReadError, match=r"occluders must be 'all' or numbers of solids. Got 'most'"
    ):
        SolidChoice([0], "most")
    with pytest.raises(
        ReadError, match="must be numbers where solids does not say which are measured"
    ):
        SolidChoice(None, "all")
    with pytest.raises(ReadError, match=r"measured or an occluder. Got solid 1 as both"):
        SolidChoice([0, 1], [1])
    with pytest.raises(
        ReadError, match=r"^occluders must name some of 0..2 of assembly.step. Got \[7\]"
    ):
        read_solid(boss_on_plate, solids=SolidChoice([0], [7]))
    with pytest.raises(
        ReadError, match=r"^occluders must leave a solid to measure. Got \[0, 1, 2\]"
    ):
        read_solid(boss_on_plate, solids=SolidChoice(None, [0, 1, 2]))
