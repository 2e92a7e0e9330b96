"""Tolerance classes in a request: resolved on the part, and refused for the wrong kind of feature."""

from __future__ import annotations

import pytest
from holed_plate import holed_plate, upper_rims
from solids import prism, ring

from planner import Dimension, RequestError
from planner.request.resolve import resolve_wanted

# holes of 16 and 12 mm, with chords up to 0.07 mm off the circle
PLATE = holed_plate()
LEFT, RIGHT = upper_rims(PLATE)


def test_a_class_becomes_the_limits_of_the_feature_it_is_asked_of():
    """IT13 is 270 µm over 10 to 18 mm; E begins 32 µm above the nominal size there (ISO 286-1)."""
    wanted = {
        "left": Dimension.diameter(LEFT, tolerance="H13", share=1.0),
        "right": Dimension.diameter(RIGHT, tolerance="E13", share=0.6),
    }
    _, (left, right) = resolve_wanted(PLATE, wanted, 0.98)
    assert left.tolerance == (0.0, 0.27)
    assert left.permitted_error == pytest.approx(0.135)
    assert right.tolerance == (0.032, 0.302)
    assert right.permitted_error == pytest.approx(0.6 * 0.135)
    assert right.share == 0.6


def test_the_class_of_a_shaft_is_refused_for_a_hole():
    with pytest.raises(
        RequestError,
        match=f"dimension 'left': tolerance must be a class of holes, in capitals, because {LEFT} is "
        "the rim of a hole. Got 'h13'",
    ):
        resolve_wanted(PLATE, {"left": Dimension.diameter(LEFT, tolerance="h13")}, 0.98)


def test_the_class_of_a_hole_is_refused_for_a_shaft():
    pin = prism(ring(8.0, 24), 10.0)
    rim = pin.rims()[0].id
    _, (target,) = resolve_wanted(
        pin, {"pin": Dimension.diameter(rim, tolerance="js14", share=1.0)}, 0.98
    )
    # IT14 is 430 µm over 10 to 18 mm
    assert target.tolerance == (-0.215, 0.215)
    with pytest.raises(
        RequestError,
        match=f"tolerance must be a class of shafts, in small letters, because {rim} is the rim of a shaft",
    ):
        resolve_wanted(pin, {"pin": Dimension.diameter(rim, tolerance="JS14")}, 0.98)


def test_a_distance_has_a_class_of_either_kind():
    """The plate is 50 mm deep: IT9 is 62 µm over 30 to 50 mm."""
    edges = {"front": [[0, 0, 10], [80, 0, 10]], "back": [[0, 50, 10], [80, 50, 10]]}
    for name, limits in (("H9", (0.0, 0.062)), ("h9", (-0.062, 0.0))):
        depth = Dimension.distance(*edges.values(), tolerance=name)
        _, (target,) = resolve_wanted(PLATE, {"depth": depth}, 0.98)
        assert target.tolerance == limits
        assert target.permitted_error == pytest.approx(0.062 / 8)
