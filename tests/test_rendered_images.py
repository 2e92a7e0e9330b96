"""The digital twin that measures in rendered images finds what is known: edges, circles, distances of simple bodies."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "images"))
from part_images import DeviatingPart, Surface
from rendered_images import (
    Lamp,
    Measured,
    Renderer,
    carried_back,
    fitted_circle,
    fitted_line,
    found_points,
)

MATRIX = np.array([[2000.0, 0.0, 500.0], [0.0, 2000.0, 400.0], [0.0, 0.0, 1.0]])
# 200 mm above the part, looking down
POSE = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 200], [0, 0, 0, 1]])
Z = np.array([0.0, 0.0, 1.0])


def slanted(angle):
    turn = np.eye(4)
    turn[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn @ POSE


def prism(outline):
    """A prism without a bottom over an outline (n, 2) around the origin, its top at z = 0, 20 mm deep."""
    n = len(outline)
    top = np.c_[outline, np.zeros(n)]
    bottom = np.c_[outline, np.full(n, -20.0)]
    i = np.arange(n)
    j = (np.arange(n) + 1) % n
    sides = np.concatenate([np.c_[i, j, n + j], np.c_[i, n + j, n + i]])
    lid = np.c_[np.full(n, 2 * n), i, j]
    return np.concatenate([top, bottom, [[0.0, 0, 0]]]), np.concatenate([sides, lid])


SQUARE = np.array([[-20.0, -15], [20, -15], [20, 15], [-20, 15]])
TURNS = np.arange(720) * np.pi / 360
ROUND = 12.0 * np.c_[np.cos(TURNS), np.sin(TURNS)]
LEFT, RIGHT = ((np.array([x, -15.0, 0]), np.array([x, 15.0, 0])) for x in (-20.0, 20.0))


def measured(shape, one, pose):
    rng = np.random.default_rng(7)
    renderer = Renderer(*prism(shape), MATRIX)
    back = []
    steps = []
    for (points, tangents), plane in zip(one.points(16), one.planes(), strict=True):
        pixels, step = found_points(
            renderer, pose, points, tangents, Lamp(np.array([120.0, 60, 160])), rng
        )
        back.append(carried_back(pixels, MATRIX, pose, plane))
        steps.append(step)
    return one.value(back), np.concatenate(steps)


# 0.1 mm are a px here; a fit over sixteen points of 0.1 px each knows a diameter to 0.005 mm
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_diameter(angle):
    value, step = measured(
        ROUND, Measured("diameter", [], [(np.zeros(3), Z, 12.0)], [None]), slanted(angle)
    )
    assert value == pytest.approx(24.0, abs=0.02)
    assert step.min() > 5


def test_radius_of_an_arc():
    arc = (np.array([1.0, 0, 0]), np.pi)
    value, _ = measured(ROUND, Measured("radius", [], [(np.zeros(3), Z, 12.0)], [arc]), POSE)
    assert value == pytest.approx(12.0, abs=0.02)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_distance(angle):
    value, _ = measured(SQUARE, Measured("distance", [LEFT, RIGHT], [], []), slanted(angle))
    assert value == pytest.approx(40.0, abs=0.02)


def test_angle():
    lower = (np.array([-20.0, -15, 0]), np.array([20.0, -15, 0]))
    value, _ = measured(SQUARE, Measured("angle", [LEFT, lower], [], []), slanted(0.3))
    assert value == pytest.approx(90.0, abs=0.1)


def test_a_face_without_an_edge_has_no_contrast():
    line = (np.array([-5.0, -8, 0]), np.array([5.0, -8, 0]))
    renderer = Renderer(*prism(SQUARE), MATRIX)
    [(points, tangents)] = Measured("length", [line], [], []).points(16)
    _, step = found_points(
        renderer, POSE, points, tangents, Lamp(np.array([120.0, 60, 160])), np.random.default_rng(1)
    )
    assert step.max() < 8


def test_centre_to_edge_and_centre_distance_of_exact_points():
    circles = [(np.zeros(3), Z, 3.0), (np.array([7.0, 0, 0]), Z, 2.0)]
    edge = (np.array([-20.0, -4, 0]), np.array([9.0, -4, 0]))
    one = Measured("centre_distance", [], circles, [None, None])
    assert one.value([points for points, _ in one.points(16)]) == pytest.approx(7.0, abs=1e-9)
    one = Measured("centre_to_edge", [edge], circles[:1], [None])
    assert one.value([points for points, _ in one.points(16)]) == pytest.approx(4.0, abs=1e-9)


def test_fits_of_exact_points():
    shifted = np.c_[ROUND[:90, 0] + 3, ROUND[:90, 1] + 4, np.zeros(90)]
    centre, radius = fitted_circle(shifted, Z)
    np.testing.assert_allclose([*centre, radius], [3, 4, 0, 12], atol=1e-8)
    middle, along = fitted_line(np.array([[0.0, 1, 2], [2, 1, 2], [5, 1, 2]]))
    assert abs(along[0]) == pytest.approx(1)
    np.testing.assert_allclose(middle[1:], [1, 2], atol=1e-12)


def test_a_kind_that_is_not_measured_is_refused():
    with pytest.raises(ValueError, match="kind must be one that is measured here"):
        Measured("volume", [LEFT], [], []).value([np.array(LEFT)])


def test_a_rim_between_a_bore_and_a_cone_is_where_both_are():
    """The bore has a radius of 5 mm, the cone widens by 45 degrees; the rim is where z = r - 5 + height."""
    bore = Surface(np.zeros(3), np.array([0.0, 0.0, 1.0]), 5.0, 0.0, 1.0, np.array([0.04, 0, 0]))
    cone = Surface(
        np.array([0.0, 0.0, 9.0]),
        np.array([0.0, 0.0, 1.0]),
        0.0,
        np.pi / 4,
        1.0,
        np.array([0.1, 0.0, 0.0]),
    )
    part = object.__new__(DeviatingPart)
    part.surfaces = [bore, cone]
    angle = np.linspace(0, 6, 7)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(7)], axis=1)
    moved = part.displaced(5.0 * out + [0, 0, 14.0], (0, 1))
    # out by what the bore is larger, and as much up, less what the cone is off along its normal
    expected = 0.04 * out + [0, 0, 0.04 - 0.1 * np.sqrt(2)]
    np.testing.assert_allclose(moved, expected, atol=1e-12)


def test_the_joint_of_an_arc_and_a_line_is_no_part_of_its_radius():
    angle = np.linspace(0.0, np.pi / 2, 256)
    points = 10.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros(256)], axis=1)
    part = object.__new__(DeviatingPart)
    part.nominal = points[::15]
    part.carried = [{0, 1} for _ in part.nominal]
    part.carried[0] = part.carried[-1] = {0, 1, 2}
    part._moved = 1.01 * part.nominal
    # the ends move with the lines that they join
    part._moved[[0, -1]] = part.nominal[[0, -1]]
    move = part._entity_move(points)
    np.testing.assert_allclose(np.linalg.norm(move, axis=1), 0.1, rtol=0.01)
