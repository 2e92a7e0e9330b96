"""Positions against datums in files and in Python: what they ask for, and what is refused."""

from __future__ import annotations

import pytest

from planner import Dimension, RequestError
from planner.request.dimension_files import read_wanted

KINDS = ("position", "diameter")


def wanted(tmp_path, text):
    path = tmp_path / "wanted.toml"
    path.write_text(text)
    return read_wanted(path, KINDS)


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
    assert items["bolt"] == Dimension.position("r3", [17, 18], 0.2)
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
