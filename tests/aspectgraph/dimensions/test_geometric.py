"""Geometric tolerances of STEP files: none is dropped, and each says why edges do not show it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from solids import cube, prism, ring

from aspectgraph import ReadError, SolidError, read_requirements, read_solid
from aspectgraph.dimensions.datum_frames import DatumFrame, NotShownError, seats_of_hole
from aspectgraph.dimensions.features import Axis, Sight
from aspectgraph.read.step.geometric_tolerances import (
    WITH_TEXTS,
    StatedTolerance,
    disagreements,
    list_datum_features,
    list_stated_tolerances,
)
from aspectgraph.read.step.text import parse_entities, parse_texts

EXAMPLE = Path("examples/nist_ctc_01_ap242.stp")
UNITS = """
#1 = ( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) );
#2 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.2),#1);
#3 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.),#1);
#4 = SHAPE_ASPECT('hole','',#9,.T.);
"""
DATUMS = """
#11 = DATUM('','',#9,.F.,'A');
#12 = DATUM('','',#9,.F.,'B');
#13 = DATUM_REFERENCE(1,#11);
#14 = DATUM_REFERENCE_ELEMENT('',$,#9,.F.,#11,$);
#15 = DATUM_REFERENCE_ELEMENT('',$,#9,.F.,#12,$);
#16 = DATUM_REFERENCE_COMPARTMENT('',$,#9,.F.,COMMON_DATUM_LIST((#14,#15)),$);
#17 = DATUM_REFERENCE_COMPARTMENT('',$,#9,.F.,#12,
  (SIMPLE_DATUM_REFERENCE_MODIFIER(.MAXIMUM_MATERIAL_REQUIREMENT.)));
#18 = DATUM_SYSTEM('','',#9,.F.,(#16,#17));
"""


def tolerances_in(text: str) -> list[StatedTolerance]:
    data = f"ISO-10303-21;\nDATA;\n{UNITS}{DATUMS}{text}ENDSEC;\nEND-ISO-10303-21;".encode()
    entities = parse_entities(data)
    return list_stated_tolerances(entities, parse_texts(data, entities, WITH_TEXTS))


def test_a_position_says_its_round_zone_condition_and_datums():
    (one,) = tolerances_in(
        """#20 = ( GEOMETRIC_TOLERANCE('bolts','',#2,#4)
GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE((#18))
GEOMETRIC_TOLERANCE_WITH_MODIFIERS((.LEAST_MATERIAL_REQUIREMENT.)) POSITION_TOLERANCE() );
#21 = TOLERANCE_ZONE_FORM('cylindrical or circular');
#22 = TOLERANCE_ZONE('',$,#9,.F.,(#20),#21);
#23 = PROJECTED_ZONE_DEFINITION(#22,(),#4,#3);
"""
    )
    expected = StatedTolerance(
        20, "bolts", "position", 0.2, True, "L", ("A-B", "B(M)"), 25.0, False, 4
    )
    assert one == expected


def test_older_files_state_datums_and_conditions_in_other_entities():
    text = """#20 = ( GEOMETRIC_TOLERANCE('','',#2,#4) GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE((#13))
MODIFIED_GEOMETRIC_TOLERANCE(.MAXIMUM_MATERIAL_CONDITION.) PERPENDICULARITY_TOLERANCE() );
#21 = CIRCULAR_RUNOUT_TOLERANCE('','',#2,#4,(#13));
"""
    first, second = tolerances_in(text)
    assert (first.characteristic, first.material, first.datums) == ("perpendicularity", "M", ("A",))
    assert (second.characteristic, second.zone_mm, second.datums) == (
        "circular run-out",
        0.2,
        ("A",),
    )


def test_text_and_kernel_agree_in_any_order_or_say_what_one_lacks():
    stated = tolerances_in(
        "#20 = FLATNESS_TOLERANCE('','',#2,#4);\n#21 = ROUNDNESS_TOLERANCE('','',#3,#4);\n"
    )
    assert not disagreements(stated, [("CircularityOrRoundness", 25.0), ("Flatness", 0.2)])
    assert disagreements(stated, [("Flatness", 0.2), ("Position", 0.5)]) == [
        "the kernel does not read roundness 25 mm, which the text states",
        "the kernel reads position 0.5 mm, which the text does not state",
    ]


def test_every_tolerance_of_a_part_is_listed_with_a_reason():
    pytest.importorskip("OCP")
    part = read_solid(EXAMPLE)
    stated = read_requirements(EXAMPLE, part)
    # all words of the file that end so are types of tolerances
    words = re.findall(r"([A-Z_]+)_TOLERANCE\s*\(", EXAMPLE.read_text())
    assert len(stated.tolerances) == len([w for w in words if w not in ("PLUS_MINUS", "GEOMETRIC")])
    assert not stated.disagreements
    # the two slots have positions, the rest is seen by no edge
    slots = [one for one in stated.tolerances if one.reason is None]
    assert [one.name for one in slots] == ["Position.1", "Position.2"]
    assert all(one.reason for one in stated.tolerances if one not in slots)
    # on the drawing they are 85 and 50 mm wide
    for one, width in zip(slots, (85.0, 50.0), strict=True):
        assert one.measured_as == "width_position"
        first, second = (part.edge_points(edge) for edge in one.entities[:2])
        apart = second.mean(axis=0) - first.mean(axis=0)
        assert np.linalg.norm(np.cross(apart, first[1] - first[0])) == pytest.approx(
            width * np.linalg.norm(first[1] - first[0])
        )
        assert one.to_dict()["entities"] == list(one.entities)


def test_a_datum_has_its_faces_itself_or_by_its_feature_or_has_targets():
    text = """#20 = DATUM_FEATURE('','',#9,.T.);
#21 = SHAPE_ASPECT_RELATIONSHIP('','',#20,#11);
#22 = PLACED_DATUM_TARGET_FEATURE('','point',#9,.T.,'1');
#23 = SHAPE_ASPECT_RELATIONSHIP('','',#22,#12);
"""
    data = f"ISO-10303-21;\nDATA;\n{UNITS}{DATUMS}{text}ENDSEC;\nEND-ISO-10303-21;".encode()
    entities = parse_entities(data)
    features = list_datum_features(entities, parse_texts(data, entities, WITH_TEXTS))
    assert features == {"A": [11, 20], "B": [12, 22]}


def test_positions_of_a_part_have_rims_datums_and_limits_of_size():
    """CTC 03: B and C are the holes of its drawing, D its upper face; the bolts are 11.125 and 15.875 mm wide."""
    pytest.importorskip("OCP")
    path = Path("examples/nist_ctc_03_ap242.stp.gz")
    part = read_solid(path)
    stated = read_requirements(path, part)
    positions = {one.name: one for one in stated.tolerances if one.kind == "position"}
    rims = {rim.id: rim for rim in part.rims()}
    bolts = positions["Position.4"]
    assert (bolts.material, bolts.n_features, len(bolts.features)) == ("M", 4, 4)
    for ways in bolts.features:
        rim, b, c = (rims[entity] for entity in ways[0])
        assert 2 * rim.radius_mm == pytest.approx(15.875, abs=1e-3)
        # the datums' holes are 203.2 mm apart, and parallel to the bolts
        assert abs(b.axis @ rim.axis) == pytest.approx(1.0)
        apart = b.centre - c.centre
        assert np.linalg.norm(apart - (apart @ b.axis) * b.axis) > 100
    assert all(size is not None and size[0] < 0 < size[1] for size in bolts.sizes)
    # about the hole of B alone, the rotation is free
    assert len(positions["Position.1"].entities) == 2


def test_a_datum_of_several_holes_is_shown_by_the_rims_beside_that_of_the_position():
    places = [(-15, -8), (15, -8), (15, 8), (0, 5)]
    bores = [ring(2.0, 24, place, clockwise=True) for place in places]
    solid = prism([(-20, -12), (20, -12), (20, 12), (-20, 12)], 6, bores)
    rims = {tuple(np.round(rim.centre, 6) + 0.0): rim for rim in solid.rims()}
    up = np.array([0.0, 0.0, 1.0])
    holes = [
        Axis(np.array([x, y, 0.0]), up, 2.0, (rims[x, y, 0.0], rims[x, y, 6.0])) for x, y in places
    ]
    sight = Sight(solid)
    seat = next(seat for seat in seats_of_hole(sight, holes[3]) if seat.centre[2] > 5)
    shown = DatumFrame(sight, ["B"], {"B": holes[:3]}).show(seat)
    assert shown.way == tuple(rims[x, y, 6.0].id for x, y in [places[3], *places[:3]])
    assert shown.groups == (3,)
    # holes about one axis are no pattern
    twice = [holes[0], Axis(holes[0].point + 3 * up, up, 3.0, holes[0].circles)]
    with pytest.raises(NotShownError, match="datum B to 2 features, not to one"):
        DatumFrame(sight, ["B"], {"B": twice}).show(seat)
    leaning = Axis(holes[1].point, np.array([1.0, 0.0, 0.0]), 2.0, holes[1].circles)
    with pytest.raises(NotShownError, match="the rim is inclined to datum B"):
        DatumFrame(sight, ["B"], {"B": [holes[0], leaning]}).show(seat)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            (None, str(EXAMPLE)),
            f"Got '{EXAMPLE}'; the order of the arguments is path, solid.",
        ),
        ((EXAMPLE, "x" * 80), f"Got '{'x' * 35}...'; read_solid reads one from a file."),
    ],
)
def test_what_is_no_solid_is_refused_with_the_order_of_the_arguments(given, message):
    path, solid = given
    with pytest.raises(SolidError) as info:
        read_requirements(cube() if path is None else path, solid)
    assert str(info.value) == f"solid must be a Solid. {message}"


def test_what_is_no_path_has_no_requirements():
    with pytest.raises(ReadError, match=r"^path must be a path\. Got 3\.$"):
        read_requirements(3, cube())


def test_a_summary_counts_requirements():
    whole = read_requirements(EXAMPLE, read_solid(EXAMPLE))
    one = replace(whole, dimensions=whole.dimensions[:1], tolerances=())
    assert repr(one) == "<ModelRequirements: 1 dimension, 0 geometric tolerances, 1 measurable>"
    assert one._notebook_view().title == "1 requirement, 1 measurable"
