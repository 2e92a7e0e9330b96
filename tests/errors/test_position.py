"""The position of a hole in a datum reference frame: closed forms, other frames, and drawn measurements."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from errors.exceptions import MeasurandError
from errors.measurands import Circle, Line, Localisation, disc_probability
from errors.measurands.measurand import measurand
from errors.measurands.position import Position, PositionFrame, PositionModel

Z = np.array([0.0, 0.0, 1.0])
HOLE = Circle((80, 30, 0), Z, 5)
EDGE_B = Line((10, 0, 0), (110, 0, 0))
EDGE_C = Line((0, 5, 0), (0, 55, 0))
FITTED = 7


def zeros():
    return np.zeros(FITTED)


def error_of(frame, **moved):
    """e when the hole, B and C lie off by small numbers: dx, dy, b (offset, slope), c (offset, slope)."""
    d = zeros()
    x = frame.frames[0].x[:2]
    y = frame.frames[0].y[:2]
    hole = np.array(moved.get("hole", (0.0, 0.0)))
    d[0] = hole @ x
    d[1] = hole @ y
    d[3:5] = moved.get("b", (0.0, 0.0))
    d[5:7] = moved.get("c", (0.0, 0.0))
    # x along B, y across it
    return frame.error([d[:3], d[3:5], d[5:7]])


def test_the_error_of_a_hole_is_known_with_two_edges_as_datums():
    """Least squares lines of 101 and 51 points; the values are those of the normal equations by hand."""
    frame = PositionFrame(HOLE, [EDGE_B, EDGE_C])
    at_b = np.arange(10.0, 111.0)
    at_c = np.arange(5.0, 56.0)
    sigma = 0.01
    covariance = np.diag(
        [
            0.004**2,
            0.004**2,
            0.0,
            sigma**2 / 101,
            sigma**2 / np.sum((at_b - 60.0) ** 2),
            sigma**2 / 51,
            sigma**2 / np.sum((at_c - 30.0) ** 2),
        ]
    )
    rows = np.stack([jet.gradient for jet in frame.errors])
    of_e = rows @ covariance @ rows.T
    assert np.sqrt(np.diag(of_e)) == pytest.approx([0.0042380, 0.0041780], abs=1e-7)
    assert disc_probability(of_e, 0.01) == pytest.approx(0.9405963, abs=2e-6)


def test_moving_the_hole_moves_the_error_and_moving_everything_does_not():
    frame = PositionFrame(HOLE, [EDGE_B, EDGE_C])
    assert error_of(frame, hole=(0.03, -0.02)) == pytest.approx([0.03, -0.02])
    # y of B's frame is the part's y, that of C's frame is -x
    assert error_of(frame, hole=(0.03, -0.02), b=(-0.02, 0), c=(-0.03, 0)) == pytest.approx([0, 0])
    # a turn about the origin by a small angle, to second order
    t = 1e-3
    turned = Rotation.from_rotvec([0, 0, t]).as_matrix()[:2, :2] @ [80, 30] - [80, 30]
    slope = math.tan(t)
    # the lines through the origin, told at their middles
    both = error_of(frame, hole=turned, b=(60 * slope, slope), c=(30 * slope, slope))
    assert np.abs(both).max() < 1e-7


def test_the_order_of_datums_decides_when_they_are_not_square():
    tilted = math.radians(89.9)
    edge = Line((0, 0, 0), (50 * math.cos(tilted), 50 * math.sin(tilted), 0))
    first = PositionFrame(HOLE, [EDGE_B, edge])
    second = PositionFrame(HOLE, [edge, EDGE_B])
    slope = 1e-3
    # B turns about its middle: as the first datum it turns the frame, as the second one it does not
    assert np.linalg.norm(first.error([zeros()[:3], (0, slope), (0, 0)])) == pytest.approx(
        slope * np.hypot(20, 5), rel=0.2
    )
    assert np.linalg.norm(second.error([zeros()[:3], (0, 0), (0, slope)])) < 1e-12


def test_a_hole_as_the_only_datum_leaves_the_rotation_free():
    other = Circle((50, 30, 0), Z, 8)
    frame = PositionFrame(HOLE, [other])
    assert (frame.free, frame.components) == (("rotation",), 1)
    coaxial = PositionFrame(HOLE, [Circle((80, 30, -10), Z, 3)])
    assert coaxial.components == 2
    assert coaxial.error([(0.3, 0.4, 0), (0.3, 0.4, 0)]) == pytest.approx([0, 0])


def test_a_second_hole_fixes_the_rotation():
    frame = PositionFrame(HOLE, [Circle((0, 0, 0), Z, 4), Circle((100, 0, 0), Z, 4)])
    x = frame.frames[2].x[:2]
    y = frame.frames[2].y[:2]
    # the second hole goes up by 0.1 in 100: the true position turns with it
    moved = np.array([0.0, 0.1])
    e = frame.error([zeros()[:3], zeros()[:3], (moved @ x, moved @ y, 0)])
    assert np.linalg.norm(e) == pytest.approx(1e-3 * np.hypot(80, 30), rel=1e-3)


def test_a_slot_has_a_deviation_across_it_only():
    slot = (Line((20, 10, 0), (40, 10, 0)), Line((40, 14, 0), (20, 14, 0)))
    frame = PositionFrame(slot, [EDGE_B])
    assert frame.components == 1
    (e,) = frame.error([(0.1, 0), (-0.1, 0), (0, 0)])
    assert abs(e) == pytest.approx(0.1)
    # both edges away from each other: the width grows, the mid-line stays
    (e,) = frame.error([(0.1, 0), (0.1, 0), (0, 0)])
    assert abs(e) == pytest.approx(0.0, abs=1e-12)


def test_what_fixes_nothing_or_leaves_too_much_free_is_refused():
    lean = math.radians(12)
    inclined = Circle((0, 0, 0), (math.sin(lean), 0, math.cos(lean)), 3)
    with pytest.raises(MeasurandError, match="inclined by 12 degrees"):
        PositionFrame(HOLE, [inclined])
    with pytest.raises(MeasurandError, match="datum 2, which fixes nothing"):
        PositionFrame(HOLE, [EDGE_B, Line((10, 60, 0), (110, 60, 0))])
    with pytest.raises(MeasurandError, match="fix both translations"):
        PositionFrame(HOLE, [EDGE_B])
    with pytest.raises(MeasurandError, match="needs a datum"):
        PositionFrame(HOLE, [])


# A camera that is off its planned pose, drawn and measured with nothing but lines, circles and a pinhole.


def world_to_camera():
    cam2world = np.eye(4)
    cam2world[:3, :3] = Rotation.from_euler("xyz", [165, 12, 20], degrees=True).as_matrix()
    cam2world[:3, 3] = np.array([60, 25, 0]) - 300 * cam2world[:3, 2]
    return np.linalg.inv(cam2world)


def carried_back(points, pose, deltas, noise, rng):
    """Points (m, 3) at z = 0, seen by displaced cameras (n, 6), carried back with the planned pose to z = 0."""
    inside = points @ pose[:3, :3].T + pose[:3, 3]
    turns = Rotation.from_rotvec(deltas[:, 3:]).as_matrix()
    seen = np.einsum("nji,nmj->nmi", turns, inside[None] - deltas[:, None, :3])
    image = seen[..., :2] / seen[..., 2:]
    image = image + noise * rng.normal(size=image.shape)
    rays = np.concatenate([image, np.ones((*image.shape[:2], 1))], axis=2) @ pose[:3, :3]
    centre = -pose[:3, :3].T @ pose[:3, 3]
    return (centre + rays * (-centre[2] / rays[..., 2])[..., None])[..., :2]


def line_fits(points):
    """Middle and direction of points (n, m, 2) that go along y of the given frame: total least squares."""
    middle = points.mean(axis=1)
    _, _, v = np.linalg.svd(points - middle[:, None])
    return middle, v[:, 0] * np.sign(v[:, 0] @ [1.0, 1.0])[:, None]


def circle_fits(points):
    """Centres of algebraic fits of points (n, m, 2), which are nearly those of least squares."""
    design = np.concatenate([2 * points, np.ones((*points.shape[:2], 1))], axis=2)
    right = (points**2).sum(axis=2)
    found = np.linalg.solve(
        np.einsum("nmi,nmj->nij", design, design), np.einsum("nmi,nm->ni", design, right)[..., None]
    )
    return found[:, :2, 0]


@pytest.mark.parametrize(("sigma_mm", "sigma_rad"), [(0.05, 0.001), (0.3, 0.01)])
def test_the_probability_of_a_position_is_that_of_drawn_measurements(sigma_mm, sigma_rad):
    n = 20_000
    rng = np.random.default_rng(3)
    pose = world_to_camera()
    points = Localisation.gaussian(0.1, floor_px=0.0).points
    steps = (np.arange(points) + 0.5) / points
    turn = 2 * np.pi * steps
    rim = HOLE.centre + 5 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    lines = [
        line.middle + ((steps - 0.5) * line.length)[:, None] * line.direction
        for line in (EDGE_B, EDGE_C)
    ]
    deltas = rng.normal(size=(n, 6)) * np.repeat([sigma_mm, sigma_rad], 3)
    noise = 0.1 * 0.00345 / 25.0
    hole = circle_fits(carried_back(rim, pose, deltas, noise, rng))
    (b, along), (c, _) = (line_fits(carried_back(p, pose, deltas, noise, rng)) for p in lines)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    e = np.stack(
        [np.einsum("ni,ni->n", hole - c, along), np.einsum("ni,ni->n", hole - b, across)], axis=1
    )
    e -= [80, 30]
    median = float(np.median(np.hypot(*e.T)))
    model = PositionModel(
        Position((HOLE, EDGE_B, EDGE_C)),
        image_distance_mm=25.0,
        pixel_pitch_mm=(0.00345, 0.00345),
        pose_covariance=np.diag(np.repeat([sigma_mm, sigma_rad], 3) ** 2),
        localisation=Localisation.gaussian(0.1, floor_px=0.0),
        permitted_error=4 * median,
    )
    drawn = np.mean(np.hypot(*e.T) <= 2 * median)
    assert model.describe(pose).probability == pytest.approx(drawn, abs=0.01)
    prediction = model.describe(pose)
    # twice the error along the axis in which it is largest
    assert prediction.standard_uncertainty == pytest.approx(
        2 * math.sqrt(np.linalg.eigvalsh(np.cov(e.T))[1]), rel=0.03
    )
    of_drawn = np.sort(np.linalg.eigvalsh(np.cov(e.T)))
    assert np.linalg.eigvalsh(model.covariance_at(pose)) == pytest.approx(of_drawn, rel=0.05)


def test_a_camera_that_turns_about_the_normal_measures_no_error():
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = (-60.0, 30.0, 300.0)
    model = PositionModel(
        Position((HOLE, EDGE_B, EDGE_C)),
        image_distance_mm=25.0,
        pixel_pitch_mm=(0.00345, 0.00345),
        pose_covariance=np.diag([0, 0, 0, 0, 0, 1e-4]),
        localisation=Localisation.gaussian(0.0, floor_px=0.0),
        permitted_error=0.01,
    )
    assert np.abs(model.covariance_at(pose)).max() < 1e-15


def circles_at(points, radius=3.0):
    return [Circle((*point, 0), Z, radius) for point in points]


def fitted_at(frame, moves):
    """What is fitted of circles whose centres move by (dx, dy)."""
    return [
        (np.array(move) @ shape.x[:2], np.array(move) @ shape.y[:2], 0.0)
        for move, shape in zip(moves, frame.frames, strict=True)
    ]


def best_fit(nominal, actual):
    """Rotation and shift by singular values (Kabsch), that bring points nearest to their places."""
    middle = nominal.mean(axis=0)
    centre = actual.mean(axis=0)
    u, _, v = np.linalg.svd((nominal - middle).T @ (actual - centre))
    turn = (u @ np.diag([1, np.sign(np.linalg.det(u @ v))]) @ v).T
    return (actual - centre) @ turn + middle - nominal


def test_a_pattern_without_datums_is_fitted_as_a_whole():
    places = np.array([[0, 0], [60, 0], [60, 40], [10, 45.0]])
    moves = 0.01 * np.random.default_rng(3).normal(size=(4, 2))
    first, *others = circles_at(places)
    frame = PositionFrame(first, [], others)
    found = frame.axes[:, :2].T @ frame.error(fitted_at(frame, moves))
    # to second order: the moves are 1e-4 of the extent
    assert found == pytest.approx(best_fit(places, places + moves)[0], abs=1e-7)
    # a pattern that is moved and turned as a whole has no deviation
    turned = places @ Rotation.from_rotvec([0, 0, 1e-3]).as_matrix()[:2, :2].T + [0.3, -0.2]
    assert np.abs(frame.error(fitted_at(frame, turned - places))).max() < 1e-7


def test_the_turn_about_a_datum_hole_is_fitted_to_the_pattern():
    places = np.array([[50, 0], [0, 50], [-50, 0.0]])
    datum, *rims = circles_at([(0, 0), *places])
    frame = PositionFrame(rims[0], [datum], rims[1:])
    assert frame.components == 2
    # all turn alike: nothing is left; one alone turns: a third of it is the pattern's
    t = 1e-4
    around = np.array([[0, 50], [-50, 0], [0, -50.0]]) * t
    assert np.abs(frame.error(fitted_at(frame, [around[0], (0, 0), *around[1:]]))).max() < 1e-6
    alone = frame.error(fitted_at(frame, [around[0], (0, 0), (0, 0), (0, 0)]))
    assert np.linalg.norm(alone) == pytest.approx(2 / 3 * 50 * t, rel=1e-3)


def test_what_an_edge_leaves_free_is_fitted_along_it():
    first, *others = circles_at([(20, 30), (50, 30), (90, 30)])
    frame = PositionFrame(first, [EDGE_B], others)
    # the pattern moves along B as a whole, and one rim alone across it
    moved = [(0.3, 0.02), (0.3, 0.0), (0.3, 0.0)]
    fits = fitted_at(frame, [moved[0], (0, 0), *moved[1:]])
    fits[1] = (0.0, 0.0)
    assert frame.error(fits) == pytest.approx([0.0, 0.02], abs=1e-9)


def test_symmetry_is_how_far_mid_lines_are_apart():
    slot = [Line((0, 4, 0), (30, 4, 0)), Line((0, 10, 0), (30, 10, 0))]
    datum = [Line((0, 0, 0), (80, 0, 0)), Line((80, 14, 0), (0, 14, 0))]
    one = measurand("symmetry", [*slot, *datum])
    assert one.frame.components == 1
    # the slot's edges up by .1 and .3, the datum's upper edge up by .2: mid-lines up by .2 and .1
    signs = [frame.y[1] for frame in one.frames]
    fits = [
        np.array([[move * sign, 0.0]]) for move, sign in zip((0.1, 0.3, 0, 0.2), signs, strict=True)
    ]
    assert one.value(fits) == pytest.approx([0.2])
    # the slot grew by .2
    assert one.along([0.0], 1.0).value(fits) == pytest.approx([0.2])
    assert one.size_mm == pytest.approx(6.0)
    again = pickle.loads(pickle.dumps(measurand("width_position", [*slot, *datum], None, (2,))))
    assert (again.groups, float(again.value(fits)[0])) == ((2,), pytest.approx(0.2))


def test_coaxiality_is_twice_the_offset_of_the_centres():
    one = measurand("coaxiality", [Circle((5, 5, 0), Z, 4), Circle((5, 5, -12), Z, 2)])
    fits = [np.array([[0.03, 0.04, 4.1]]), np.array([[0.0, 0.0, 2.0]])]
    assert one.value(fits) == pytest.approx([0.1])
    with pytest.raises(MeasurandError, match="two circles about one axis"):
        measurand("coaxiality", [Circle((5, 5, 0), Z, 4), Circle((9, 5, -12), Z, 2)])


@pytest.mark.parametrize(
    ("kind", "shapes", "groups", "message"),
    [
        ("position", [HOLE, EDGE_B, EDGE_C], (1,), "a pattern must be one of rims"),
        ("position", [HOLE, EDGE_B], (1, 1), "groups must count"),
        ("position", [HOLE, EDGE_B, HOLE], (2,), "two edges of a slot"),
        ("diameter", [HOLE], (1,), "groups must be those of a position"),
        ("width_position", [HOLE, EDGE_B], (), "one straight edge and one straight edge"),
    ],
)
def test_groups_that_do_not_fit_are_refused(kind, shapes, groups, message):
    with pytest.raises(MeasurandError, match=message):
        measurand(kind, shapes, None, groups)
