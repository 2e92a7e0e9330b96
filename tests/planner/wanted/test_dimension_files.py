"""Files of dimensions: what a user writes, and what is refused by name."""

import math

import pytest

from errors.measurands.measurand import kinds
from planner import Dimension, RequestError
from planner.request.dimension_files import read_wanted

FILE = """
bore = { diameter = "r3", tolerance = [-0.05, 0.05] }
step = { distance = [17, 18], max_error = 0.02 }
rim = { edge = 17, max_error = 0.05 }
inch = { radius = "a0", tolerance = [-0.001, 0.001], unit = "in" }
slope = { angle = [17, 21], max_error = 0.001, unit = "rad" }
plain = 18
ends = [[0, 0, 10], [80, 0, 10]]
long = { length = [[0, 0, 10], [80, 0, 10]], accuracy = 0.99 }
fit = { diameter = "r3", tolerance = "H7", share = 0.1, unit = "um" }
"""


def written(tmp_path, text, name="dimensions.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_every_way_to_say_it(tmp_path):
    found = read_wanted(written(tmp_path, FILE), kinds())
    assert list(found) == ["bore", "step", "rim", "inch", "slope", "plain", "ends", "long", "fit"]
    assert found["bore"] == Dimension.diameter("r3", tolerance_mm=(-0.05, 0.05))
    assert found["step"] == Dimension.distance(17, 18, max_error_mm=0.02)
    assert found["rim"] == Dimension.length(17, max_error_mm=0.05)
    assert found["inch"].tolerance == pytest.approx((-0.0254, 0.0254))
    assert found["slope"].max_error == pytest.approx(0.0572958, rel=1e-5)
    assert found["plain"] == 18
    assert found["fit"] == Dimension.diameter("r3", tolerance="H7", share=0.1)
    assert found["long"].entities == ([[0, 0, 10], [80, 0, 10]],)


def test_one_limit_of_a_tolerance(tmp_path):
    """An inch is 25.4 mm."""
    text = """
most = { diameter = "r3", tolerance = { upper = 0.05 }, max_error = 0.02 }
least = { radius = "a0", tolerance = { lower = -0.001 }, unit = "in" }
endless = { distance = [17, 18], tolerance = [-inf, 0.1] }
both = { distance = [17, 18], tolerance = { lower = -0.3, upper = 0.2 } }
"""
    found = read_wanted(written(tmp_path, text), kinds())
    assert found["most"] == Dimension.diameter("r3", tolerance_mm=(None, 0.05), max_error_mm=0.02)
    assert found["least"].tolerance == (pytest.approx(-0.0254), math.inf)
    assert found["endless"].tolerance == (-math.inf, 0.1)
    assert found["both"] == Dimension.distance(17, 18, tolerance_mm=(-0.3, 0.2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'a = { diameter = "r3", tolerance = { most = 1 } }',
            "dimension 'a': tolerance must be a table of lower, upper or both. Got {'most': 1}",
        ),
        ('a = { diameter = "r3", tolerance = {} }', "must be a table of lower, upper or both"),
        (
            'a = { diameter = "r3", tolerance = [-inf, inf] }',
            "dimension 'a': tolerance must have a finite limit",
        ),
        ('a = { width = "r3" }', "dimension 'a' must be made of a kind .* Got 'width'"),
        ("a = { max_error = 1 }", "dimension 'a' must have one kind. Got none"),
        ('a = { diameter = "r3", radius = "r3" }', "Got diameter, radius"),
        (
            'a = { diameter = "r3", max_error = 1, unit = "furlong" }',
            "dimension 'a': unit must be one of mm.*furlong",
        ),
        (
            'a = { diameter = "r3", max_error = 1, unit = "deg" }',
            "unit must be one of mm, um, in. Got 'deg'",
        ),
        (
            'a = { diameter = "r3", tolerance = [1, -1] }',
            "dimension 'a': tolerance must have its lower",
        ),
        (
            'a = { diameter = "r3", tolerance = "H77" }',
            "dimension 'a': tolerance must be a letter and a grade of ISO 286.* Got 'H77'",
        ),
        (
            'a = { radius = "r3", tolerance = "H7" }',
            "dimension 'a': tolerance must be two numbers, because only a diameter",
        ),
        (
            'a = { diameter = "r3", max_error = 0 }',
            "dimension 'a': max_error must be a positive number. Got 0",
        ),
        ("", "must hold one name at least"),
        ("a = [", "must be valid TOML or JSON"),
    ],
)
def test_refusals(tmp_path, text, message):
    with pytest.raises(RequestError, match=message):
        read_wanted(written(tmp_path, text), kinds())


def test_json_and_a_missing_file(tmp_path):
    path = written(
        tmp_path, '{"dimensions": {"bore": {"diameter": "r3", "accuracy": 0.99}}}', "d.json"
    )
    assert read_wanted(path, kinds()) == {"bore": Dimension.diameter("r3", accuracy=0.99)}
    with pytest.raises(RequestError, match="name an existing file"):
        read_wanted(tmp_path / "none.toml", kinds())


def test_dimensions_without_a_share_of_their_own_take_the_given_one(tmp_path):
    path = tmp_path / "d.toml"
    path.write_text(
        "a = { length = 17, tolerance = [-0.1, 0.1] }\n"
        "b = { length = 18, tolerance = [-0.1, 0.1], share = 0.1 }\n"
    )
    assert [one.share for one in read_wanted(path, kinds(), 0.5).values()] == [0.5, 0.1]
    assert [one.share for one in read_wanted(path, kinds()).values()] == [0.25, 0.1]
