"""Positions against datums in files and in Python: what they ask for, and what is refused."""

from __future__ import annotations

import pytest

from aspectgraph import GeometricTolerance
from planner import Dimension, RequestError, dimensions_to_plan
from planner.request.dimension_files import read_wanted

KINDS = ("position", "diameter")


def wanted(tmp_path, text, kinds=KINDS):
    path = tmp_path / "wanted.toml"
    path.write_text(text)
    return read_wanted(path, kinds)


def test_a_file_names_its_datums_once(tmp_path):
    items = wanted(
        tmp_path,
        """
        bolt = { position = "r3", zone = 0.2, datums = ["A", "B", 18] }
        pin = { position = "r4", zone = 0.01, unit = "in", datums = ["B", "C"], share = 0.5 }
        [datums]
        A = "parallel"
        B = 17
        C = "r7"
        """,
    )
    # reports name the datums as the drawing does, the parallel one too
    frame = ("A", "B", "e18")
    assert items["bolt"] == Dimension.position("r3", [17, 18], 0.2, frame=frame)
    assert items["pin"].frame == ("B", "C")
    assert items["pin"].entities == ("r4", 17, "r7")
    assert items["pin"].tolerance == pytest.approx((0.0, 0.254))
    # half of the radius of the zone, as a diameter
    assert items["pin"].permitted_error(0.0) == pytest.approx(0.127)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('bolt = { position = "r3", zone = 0.2 }', "datums must be a list of one entity at least"),
        ('bolt = { position = "r3", datums = [17] }', "zone must be"),
        ('bolt = { position = "r3", zone = -1, datums = [17] }', "zone must be"),
        (
            'bolt = { position = "r3", zone = 1, tolerance = [0, 1], datums = [17] }',
            "must have a zone instead of a tolerance",
        ),
        ('bore = { diameter = "r3", zone = 0.2 }', "zone and datums must be those of a position"),
        ('datums = 3\nbolt = { position = "r3" }', "datums must be a table"),
        (
            'bolt = { position = "r3", zone = 1, datums = ["A", "B"] }\n[datums]\nA = 17',
            "datums must name entities, or a name in the table datums, which has 'A'. Got 'B'",
        ),
        (
            'bolt = { position = "r3", zone = 1, datums = ["A"] }\n[datum]\nA = 17',
            "Got 'datum'; 'datums' may be meant",
        ),
        (
            'bolt = { position = "r3", zone = 1, datums = ["A"] }',
            r"because the file has no names in a table \[datums\]. Got 'A'",
        ),
        (
            'bolt = { position = "r3", zone = 1, datums = [17, "r3"] }',
            r"datums must differ from the rim and from each other. Got \[17, 'r3'\] for 'r3'",
        ),
        (
            'bolt = { position = "r3", zone = 1, datums = [17, 17] }',
            "datums must differ from the rim and from each other",
        ),
    ],
)
def test_what_is_no_position_is_refused(tmp_path, text, message):
    with pytest.raises(RequestError, match=message):
        wanted(tmp_path, text)


def test_edges_may_be_written_as_tables_name_them(tmp_path):
    items = wanted(tmp_path, 'bolt = { position = "r3", zone = 0.2, datums = ["e17", "e18"] }')
    assert items["bolt"] == Dimension.position("r3", [17, 18], 0.2)


def test_a_condition_takes_the_limits_of_a_diameter_of_the_file(tmp_path):
    items = wanted(
        tmp_path,
        """
        bore = { diameter = "r3", tolerance = [-0.002, 0.002], unit = "in" }
        fit = { diameter = "r3", tolerance = "H7" }
        bolt = { position = "r3", zone = 0.2, datums = [17, 18], material = "M", size = "bore" }
        pin = { position = "r3", zone = 0.2, datums = [17, 18], material = "L", size = "fit" }
        own = { position = "r3", zone = 0.01, unit = "in", datums = [17, 18], material = "M", size = [0, 0.004] }
        """,
    )
    assert items["bolt"].material == "M"
    assert items["bolt"].size == pytest.approx((-0.0508, 0.0508))
    assert (items["pin"].material, items["pin"].size) == ("L", "H7")
    assert items["own"].size == pytest.approx((0.0, 0.1016))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'size = "bore" }\nbore = { diameter = "r3", max_error = 0.1 }',
            "size must name a diameter",
        ),
        ('size = "bore" }\nbore = 17', "size must name a diameter"),
        ('size = "other" }', "size must be two deviations, a class such as H7, or in a file"),
        ("size = 3 }", "size must be two numbers"),
    ],
)
def test_a_size_without_limits_is_refused(tmp_path, text, message):
    head = 'bolt = { position = "r3", zone = 0.2, datums = [17, 18], material = "M", '
    with pytest.raises(RequestError, match=message):
        wanted(tmp_path, head + text)


def test_only_positions_have_a_condition(tmp_path):
    with pytest.raises(RequestError, match="material and size must be those of a position"):
        wanted(tmp_path, 'bore = { diameter = "r3", material = "M", max_error = 0.1 }')


def stated_position(**changes):
    """A position of two holes with (M) as a model states it; the second hole states no limits of size."""
    values = {
        **{"name": "bolts", "kind": "position", "zone_mm": 0.2, "diametral": True, "material": "M"},
        **{"datums": ("A", "B"), "projected_mm": None, "attached": (), "n_features": 2},
        **{"reason": None, "entities": ("r1", 17), "measured_as": "position"},
        "features": ((("r1", 17, "r2"), ("r3", 17, "r4")), (("r2", 17, "r1"),)),
        "feature_reasons": (None, None),
        "sizes": ((-0.1, 0.1), None),
        "groups": (1,),
    }
    return GeometricTolerance(**(values | changes))


def test_each_hole_of_a_pattern_of_the_model_is_a_characteristic():
    wanted, left_out = dimensions_to_plan([stated_position()])
    first = wanted["bolts [1 of 2]"]
    second = wanted["bolts [2 of 2]"]
    assert (first.entities, first.alternatives) == (("r1", 17, "r2"), (("r3", 17, "r4"),))
    assert (first.material, first.size, first.groups) == ("M", (-0.1, 0.1), (1,))
    # without limits no bonus, which is stricter
    assert (second.material, second.size) == ("", None)
    assert left_out == {}


def test_positions_of_the_model_are_left_out_on_request():
    wanted, left_out = dimensions_to_plan([stated_position()], positions=False)
    assert wanted == {}
    assert left_out == {"bolts": "positions, symmetry and coaxiality are left out of this plan"}


def test_slots_symmetry_and_coaxiality_are_read_from_files(tmp_path):
    items = wanted(
        tmp_path,
        """
        slot = { position = [39, "e47"], zone = 0.3, datums = ["A", "S", "r8"] }
        mid = { symmetry = [39, 47], zone = 0.1, datums = [[3, 4]] }
        step = { coaxiality = "r8", zone = 0.1, datums = ["r9"] }
        free = { position = "r0", zone = 0.3, datums = ["A"], pattern = ["r1", "r2"] }
        [datums]
        A = "parallel"
        S = [1, 2]
        """,
        ("position", "symmetry", "coaxiality"),
    )
    slot = items["slot"]
    assert (slot.kind, slot.entities, slot.groups) == (
        *("width_position", (39, 47, 1, 2, "r8"), (2, 1)),
    )
    assert items["mid"] == Dimension.symmetry([39, 47], [3, 4], 0.1)
    assert items["step"] == Dimension.coaxiality("r8", "r9", 0.1)
    assert items["free"].entities == ("r0", "r1", "r2")
    assert items["free"].groups == (0,)


def test_several_rims_are_a_pattern_as_the_datum(tmp_path):
    items = wanted(
        tmp_path,
        """
        bolt = { position = "r9", zone = 0.2, datums = ["P", "e17"] }
        pin = { position = "r9", zone = 0.2, datums = [17, ["r12", "r14"]] }
        [datums]
        P = ["r1", "r2", "r3"]
        """,
    )
    assert items["bolt"] == Dimension.position(
        "r9", [["r1", "r2", "r3"], 17], 0.2, frame=("P", "e17")
    )
    assert (items["bolt"].entities, items["bolt"].groups) == (("r9", "r1", "r2", "r3", 17), (3, 1))
    # ids of three letters are no end points
    assert (items["pin"].entities, items["pin"].groups) == (("r9", 17, "r12", "r14"), (1, 2))
    ends = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    assert Dimension.position("r9", [ends, 17], 0.2).groups == ()


@pytest.mark.parametrize(
    ("datums", "pattern", "message"),
    [
        (3, (), "datums must be a list of entities. Got 3; write [3] for one."),
        ("r1", (), "datums must be a list of entities. Got 'r1'; write ['r1'] for one."),
        (None, (), "datums must be a list of entities. Got None."),
        ([3], "r2", "pattern must be a list of entities. Got 'r2'; write ['r2'] for one."),
    ],
)
def test_one_entity_is_no_list_of_them(datums, pattern, message):
    with pytest.raises(RequestError) as info:
        Dimension.position("r0", datums, 0.2, pattern=pattern)
    assert str(info.value) == message
