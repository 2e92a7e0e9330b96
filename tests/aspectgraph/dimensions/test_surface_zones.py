"""Flatness and profile tolerances: what the text states, and which dimensions they concern."""

from __future__ import annotations

import pytest
from real_parts import real_part

from aspectgraph import read_dimensions, read_solid
from aspectgraph.dimensions.features import Attachments, SurfaceZone, SurfaceZones
from aspectgraph.read.step.semantic_dimensions import (
    SurfaceTolerance,
    list_datum_items,
    list_surface_tolerances,
)
from aspectgraph.read.step.text import parse_entities
from tests.aspectgraph.helpers.solids import plain_box

TEXT = """ISO-10303-21;
HEADER;
ENDSEC;
DATA;
#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#2=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.2),#1);
#3=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.05),#1);
#4=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.),#1);
#10=SHAPE_ASPECT('','',#99,.T.);
#11=DATUM_FEATURE('','',#99,.T.);
#20=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#10,#98,#40);
#21=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#11,#98,#41);
#40=ADVANCED_FACE('',(#97),#96,.T.);
#41=ADVANCED_FACE('',(#97),#96,.T.);
#50=FLATNESS_TOLERANCE('Flat (1)','',#3,#11);
#51=(GEOMETRIC_TOLERANCE('P','',#2,#10)GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE((#60))
 SURFACE_PROFILE_TOLERANCE());
#52=(FLATNESS_TOLERANCE()GEOMETRIC_TOLERANCE('','',#2,#10)
 GEOMETRIC_TOLERANCE_WITH_DEFINED_UNIT(#3));
#53=(GEOMETRIC_TOLERANCE('','',#2,#10)SURFACE_PROFILE_TOLERANCE()
 UNEQUALLY_DISPOSED_GEOMETRIC_TOLERANCE(#4));
#54=CYLINDRICITY_TOLERANCE('','',#2,#10);
#55=SURFACE_PROFILE_TOLERANCE('','',#4,#10);
ENDSEC;
END-ISO-10303-21;
"""


def test_the_text_states_kind_width_datums_and_faces():
    """A zone all on one side of the surface lies in one of twice its width about it."""
    entities = parse_entities(TEXT.encode())
    assert list_surface_tolerances(entities) == [
        SurfaceTolerance("flatness", 0.05, False, (41,)),
        SurfaceTolerance("profile", 0.2, True, (40,)),
        SurfaceTolerance("profile", 0.4, False, (40,)),
    ]
    assert list_datum_items(entities) == {41}


def plane_row(z, corners, *, width, places):
    """Return the row of a horizontal face with straight edges between corners (x, y)."""
    loop = [(*corner, z) for corner in corners]
    ends = [[list(a), list(b)] for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]
    edges = [{"kind": "line", "ends": pair} for pair in ends]
    face = {"kind": "plane", "point": [0.0, 0.0, z], "axis": [0.0, 0.0, 1.0], "edges": edges}
    return {"tolerance": "profile", "width_mm": width, "places": places, "face": face}


CORNERS = ((0, 0), (30, 0), (30, 20), (0, 20))


def edges_at(solid, z):
    """Return the ids of the two edges along y at a height, by x."""
    found = [
        edge.id
        for edge in solid.straight_edges()
        if {point[2] for point in solid.edge_points(edge.id)} == {z}
        and len({point[0] for point in solid.edge_points(edge.id)}) == 1
    ]
    return sorted(found, key=lambda one: solid.edge_points(one)[0][0])


@pytest.fixture(scope="module")
def block():
    return plain_box((30.0, 20.0, 10.0))


def test_the_face_that_carries_both_edges_counts_and_no_other(block):
    """Two edges of the top face, 30 mm apart: their plane is the top face's. Those below have no zone."""
    zones = SurfaceZones(Attachments(block), [plane_row(10.0, CORNERS, width=0.2, places=True)])
    top = tuple(edges_at(block, 10.0))
    below = tuple(edges_at(block, 0.0))
    assert zones.of_way(top, (1, 0, 0)) == SurfaceZone("profile", 0.2, True)
    assert zones.of_way(below, (1, 0, 0)) is None
    # measured upwards, the two edges of one side lie in its plane, which has no tolerance
    assert zones.of_way((top[0], below[0]), (0, 0, 1)) is None
    # a length has no plane of its own
    assert zones.of_way(top[:1], None) is None


def test_a_zone_of_one_of_two_planes_says_not_where_both_are(block):
    rows = [plane_row(10.0, CORNERS, width=0.2, places=True)]
    way = (edges_at(block, 0.0)[0], edges_at(block, 10.0)[1])
    assert SurfaceZones(Attachments(block), rows).of_way(way, (1, 0, 0)) == SurfaceZone(
        "profile", 0.2, False
    )
    rows.append(plane_row(0.0, CORNERS, width=0.1, places=True))
    assert SurfaceZones(Attachments(block), rows).of_way(way, (1, 0, 0)) == SurfaceZone(
        "profile", 0.2, True
    )


def test_of_several_zones_of_a_face_the_widest_that_places_it_counts(block):
    """A lower row of a composite profile is narrower, and only turns the face."""
    rows = [
        plane_row(10.0, CORNERS, width=width, places=places)
        for width, places in ((0.5, False), (0.1, True), (0.2, True))
    ]
    way = tuple(edges_at(block, 10.0))
    found = SurfaceZones(Attachments(block), rows).of_way(way, (1, 0, 0))
    assert found == SurfaceZone("profile", 0.2, True)


def test_a_part_of_nist_states_the_zone_of_its_holes():
    """Read off the drawing of CTC 03 (.010 and .030 in), and off its text: the flatness is per area."""
    path = "examples/nist_ctc_03_ap242.stp.gz"
    zones = {one.name: one.surfaces for one in read_dimensions(path, read_solid(path))}
    inch = 25.4
    (bore,) = zones["Linear Size.6"]
    assert (bore.tolerance, bore.places) == ("profile", True)
    assert bore.width_mm == pytest.approx(0.030 * inch)
    (hole,) = zones["Linear Size.1"]
    assert (hole.tolerance, hole.places) == ("profile", False)
    assert hole.width_mm == pytest.approx(0.010 * inch)
    assert not any(zone and zone.tolerance == "flatness" for own in zones.values() for zone in own)


@pytest.mark.parametrize(
    ("part", "hole", "zone"),
    [
        ("nist_ctc_02_ap242.stp", "Linear Size.4", ("flatness", 0.05, True)),
        ("nist_ctc_02_ap242.stp", "Linear Size.6", ("profile", 0.1, False)),
        ("nist_d2mi_827-9999-904.stp", "Hole Dimension (193)", ("profile", 0.016 * 25.4, True)),
    ],
)
def test_larger_parts_state_the_zones_of_their_drawings(part, hole, zone):
    """The face of datum A of CTC 02 is flat to 0.05 mm; D2MI has a profile of .016 in all over."""
    path = real_part(part)
    (found,) = {one.name: one.surfaces for one in read_dimensions(path, read_solid(path))}[hole]
    assert (found.tolerance, found.places) == (zone[0], zone[2])
    assert found.width_mm == pytest.approx(zone[1])
