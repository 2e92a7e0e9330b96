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


def carried_back(points, pose, deltas, noise, rng, z=0.0, heights=None):
    """Points (m, 3) at height z, seen by displaced cameras (n, 6), carried back with the planned pose to this height.

    On each part the face is higher than planned by heights (n,), or heights (n, m) of its points.
    """
    raised = np.repeat(points[None], len(deltas), axis=0)
    if heights is not None:
        raised[..., 2] += np.reshape(heights, (len(deltas), -1))
    inside = raised @ pose[:3, :3].T + pose[:3, 3]
    turns = Rotation.from_rotvec(deltas[:, 3:]).as_matrix()
    seen = np.einsum("nji,nmj->nmi", turns, inside - deltas[:, None, :3])
    image = seen[..., :2] / seen[..., 2:]
    image = image + noise * rng.normal(size=image.shape)
    rays = np.concatenate([image, np.ones((*image.shape[:2], 1))], axis=2) @ pose[:3, :3]
    centre = -pose[:3, :3].T @ pose[:3, 3]
    return (centre + rays * ((z - centre[2]) / rays[..., 2])[..., None])[..., :2]


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


SLOT_EDGES = (Line((70, 26, 0), (90, 26, 0)), Line((70, 34, 0), (90, 34, 0)))
DATUM_SLOT = (Line((20, 2, -4), (100, 2, -4)), Line((20, 58, -4), (100, 58, -4)))
HOLES = tuple(Circle((x, y, 0), Z, 4) for x, y in ((10, 10), (105, 8), (100, 52), (15, 50)))
FRAMES = {
    "two planes": (HOLE, [EDGE_B, EDGE_C], ()),
    "a plane and a hole": (HOLE, [EDGE_B, HOLES[0]], ()),
    "a hole and a plane": (HOLE, [HOLES[0], EDGE_B], ()),
    "a hole": (HOLE, [HOLES[0]], ()),
    "a hole about the axis": (HOLE, [Circle((80, 30, -6), Z, 9)], ()),
    "two holes": (HOLE, [HOLES[0], HOLES[1]], ()),
    "a slot and a plane": (HOLE, [DATUM_SLOT, EDGE_C], ()),
    "a pattern of holes": (HOLE, [HOLES], ()),
    "a plane and a pattern": (HOLE, [EDGE_B, HOLES[:2]], ()),
    "the own pattern": (HOLE, [], HOLES),
    "a hole and the own pattern": (HOLE, [HOLES[0]], HOLES[1:]),
    "a slot to a plane": (SLOT_EDGES, [EDGE_B], ()),
    "a slot to a slot": (SLOT_EDGES, [DATUM_SLOT], ()),
}


def parts_of(item):
    return item if isinstance(item, tuple) else (item,)


def middle_of(fits):
    """Points (n, 2) and angles (n,) of the fits of a line, a circle, or of the lines of a slot."""
    points = np.mean([point for point, _ in fits], axis=0)
    ways = [way for _, way in fits if way is not None]
    if not ways:
        return points, None
    both = ways[0] + sum(way * np.sign(np.sum(way * ways[0], axis=-1))[:, None] for way in ways[1:])
    return points, np.arctan2(both[:, 1], both[:, 0])


def turned(vectors, angle):
    c = np.cos(angle)
    s = np.sin(angle)
    x = np.asarray(vectors)[..., 0]
    y = np.asarray(vectors)[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def deviations(kind, fits, nominal):
    """e (n, 2) or (n, 1) of a kind of frame by fits and nominal ones of every item: turn and shift of the part."""
    _, datums, pattern = FRAMES[kind]
    turn = None
    rows = []
    items = [(item, k + 1, False) for k, item in enumerate(datums)]
    if pattern:
        items.append((None, -1, True))
    for item, k, is_own in items:
        is_pattern = is_own or (isinstance(item, tuple) and isinstance(item[0], Circle))
        if is_pattern:
            at, true = ([*x[0], *x[-1]] if is_own else x[k] for x in (fits, nominal))
            points = np.stack([point for point, _ in at])
            places = np.stack([point for point, _ in true])
            mean = points.mean(axis=0), places.mean(axis=0)
            axes = [np.array([1.0, 0.0]), np.array([0.0, 1.0])]
            if len(rows) == 1:
                axes = [np.array([-rows[0][0][1], rows[0][0][0]])]
            if len(rows) < 2:
                rows += [(axis, *mean) for axis in axes]
            if turn is None:
                away = points - rows[0][1], places - rows[0][2]
                turn = np.arctan2(
                    np.sum(
                        away[1][..., 0] * away[0][..., 1] - away[1][..., 1] * away[0][..., 0], 0
                    ),
                    np.sum(away[1] * away[0], axis=(0, 2)),
                )
            continue
        (point, angle), (place, way) = (middle_of(x[k]) for x in (fits, nominal))
        if angle is not None:
            turn = angle - way if turn is None else turn
            normal = np.array([-np.sin(way[0]), np.cos(way[0])])
            if all(abs(np.linalg.det([other, normal])) > 1e-6 for other, _, _ in rows[:1]):
                rows += [(normal, point, place)] * (len(rows) < 2)
        elif not rows:
            rows += [(axis, point, place) for axis in np.eye(2)]
        elif len(rows) == 1:
            rows.append((np.array([-rows[0][0][1], rows[0][0][0]]), point, place))
        elif turn is None:
            away = point - rows[0][1], place - rows[0][2]
            turn = np.arctan2(away[0][:, 1], away[0][:, 0]) - np.arctan2(
                away[1][:, 1], away[1][:, 0]
            )
    (at, _), (place, way) = (middle_of(x[0]) for x in (fits, nominal))
    if turn is None:
        away = at - rows[0][1], place - rows[0][2]
        if not np.any(away[1]):
            return away[0]
        return (np.linalg.norm(away[0], axis=1) - np.linalg.norm(away[1], axis=1))[:, None]
    # where the part's frame takes the place, as far as each row tells, in its axes
    off = [
        turned(at - point, -turn) @ normal - (place - true) @ normal for normal, point, true in rows
    ]
    if way is None:
        return np.linalg.solve(np.stack([normal for normal, _, _ in rows]), np.stack(off)).T
    return off[0][:, None]


DRAWN = Localisation.gaussian(0.1, floor_px=0.0)
SIGMAS = np.repeat([0.05, 0.002], 3)
SURFACES_MM = 0.03


def drawn_deviations(kind, n, rng, heights):
    """e of n measurements: displaced cameras and noise; faces at a depth are higher by heights[z](x, y), (n, m) mm."""
    deltas = rng.normal(size=(n, 6)) * SIGMAS
    noise = 0.1 * 0.00345 / 25.0
    steps = (np.arange(DRAWN.points) + 0.5) / DRAWN.points
    turn = 2 * np.pi * steps
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)

    def fit(shape):
        if isinstance(shape, Circle):
            points = shape.centre + shape.radius_mm * ring
        else:
            points = shape.middle + ((steps - 0.5) * shape.length)[:, None] * shape.direction
        z = float(points[0, 2])
        raised = heights[z](points[:, 0], points[:, 1])
        back = carried_back(points, world_to_camera(), deltas, noise, rng, z, raised)
        if isinstance(shape, Circle):
            return circle_fits(back), None
        middle, way = line_fits(back)
        return middle, way * np.sign(way @ shape.direction[:2])[:, None]

    def exact(shape):
        if isinstance(shape, Circle):
            return shape.centre[None, :2], None
        return shape.middle[None, :2], shape.direction[None, :2]

    items = items_of(kind)
    fits, nominal = ([[of(shape) for shape in item] for item in items] for of in (fit, exact))
    return np.linalg.norm(deviations(kind, fits, nominal), axis=1)


def items_of(kind):
    first, datums, pattern = FRAMES[kind]
    return [parts_of(first), *map(parts_of, datums), pattern]


def probability_of(kind, radius_mm):
    first, datums, _ = FRAMES[kind]
    groups = tuple(len(parts_of(datum)) for datum in datums) or (0,)
    name = "width_position" if isinstance(first, tuple) else "position"
    shapes = [shape for item in items_of(kind) for shape in item]
    model = PositionModel(
        measurand(name, shapes, None, groups),
        image_distance_mm=25.0,
        pixel_pitch_mm=(0.00345, 0.00345),
        pose_covariance=np.diag(SIGMAS**2),
        localisation=DRAWN,
        permitted_error=2 * radius_mm,
        surfaces_mm=SURFACES_MM,
    )
    return model.describe(world_to_camera()).probability


@pytest.mark.parametrize("kind", FRAMES)
def test_every_kind_of_frame_has_the_probability_of_drawn_measurements(kind):
    """Faces are off as a whole: points are carried back and fitted by another program."""
    n = 20_000
    rng = np.random.default_rng(len(kind))
    offsets = {z: SURFACES_MM * rng.normal(size=(n, 1)) for z in (0.0, -4.0, -6.0)}
    heights = {z: lambda x, y, off=off: off + 0 * x for z, off in offsets.items()}
    e = drawn_deviations(kind, n, rng, heights)
    for share in (0.5, 0.9):
        radius = float(np.quantile(e, share))
        assert probability_of(kind, radius) == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize("kind", FRAMES)
def test_no_more_is_promised_of_parts_whose_faces_are_bent_within_their_zones(kind):
    """Each face is off and wavy, anywhere in the zone whose standard deviation is stated."""
    n = 10_000
    rng = np.random.default_rng(len(kind))
    half = math.sqrt(3.0) * SURFACES_MM

    def wavy():
        way = rng.uniform(0, 2 * np.pi, (n, 1))
        phase = rng.uniform(0, 2 * np.pi, (n, 1))
        wave = 2 * np.pi / rng.uniform(60, 240, (n, 1))
        high = rng.uniform(0, half, (n, 1))
        off = rng.uniform(-1, 1, (n, 1)) * (half - high)

        def height(x, y):
            return off + high * np.sin(wave * (np.cos(way) * x + np.sin(way) * y) + phase)

        return height

    e = drawn_deviations(kind, n, rng, {z: wavy() for z in (0.0, -4.0, -6.0)})
    # of 10,000 the quantile is within 0.005 of its probability
    assert probability_of(kind, float(np.quantile(e, 0.95))) <= 0.95 + 0.01


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


def test_a_pattern_of_holes_as_the_datum_is_fitted_by_least_squares():
    places = np.array([[0, 0], [100, 0], [100, 60], [20, 55.0]])
    moves = 0.02 * np.random.default_rng(4).normal(size=(5, 2))
    holes = tuple(circles_at(places))
    frame = PositionFrame(HOLE, [holes])
    assert (frame.components, frame.free) == (2, ())
    # the frame that is nearest to all of its holes takes the rim with it (Kabsch)
    middle = places.mean(axis=0)
    actual = places + moves[1:]
    u, _, v = np.linalg.svd((places - middle).T @ (actual - actual.mean(axis=0)))
    turn = (u @ v).T
    nominal = HOLE.centre[:2]
    expected = (nominal + moves[0] - actual.mean(axis=0)) @ turn + middle - nominal
    e = frame.axes[:, :2].T @ frame.error(fitted_at(frame, moves))
    assert e == pytest.approx(expected, abs=1e-7)
    # a pattern of two turns with the line through both, and stays in their middle
    pair = PositionFrame(HOLE, [holes[:2]])
    e = pair.axes[:, :2].T @ pair.error(fitted_at(pair, [(0, 0), (0, -0.05), (0, 0.05)]))
    assert e == pytest.approx([30e-3, -30e-3], abs=1e-4)
    again = pickle.loads(pickle.dumps(measurand("position", [HOLE, *holes], None, (4,))))
    assert again.datum_names(["r9", "r1", "r2", "r3", "r4"]) == ["r1-r2-r3-r4"]


def test_a_pattern_fixes_what_the_datums_before_it_leave_free():
    holes = tuple(circles_at([(20, 10), (60, 10), (40, 40)]))
    frame = PositionFrame(HOLE, [EDGE_B, holes])
    # across B it is B that counts, along it the mean of the pattern
    moves = [(0.0, 0.0), (0.3, 0.1), (0.0, 0.2), (0.0, 0.3)]
    fits = fitted_at(frame, [moves[0], (0, 0), *moves[1:]])
    fits[1] = (0.0, 0.0)
    assert frame.error(fits) == pytest.approx([-0.1, 0.0], abs=1e-12)
    with pytest.raises(MeasurandError, match="datum 3, which fixes nothing"):
        PositionFrame(HOLE, [EDGE_B, EDGE_C, holes])


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
    # edges at 4 and 10 have their middle at 7, those at 0 and 15 at 7.5
    with pytest.raises(
        MeasurandError, match=r"one mid-line for both slots. Got two, 0\.5 mm apart"
    ):
        measurand("symmetry", [*slot, datum[0], Line((80, 15, 0), (0, 15, 0))])


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
        ("width_position", [HOLE, EDGE_B], (), "must have two straight edges"),
    ],
)
def test_groups_that_do_not_fit_are_refused(kind, shapes, groups, message):
    with pytest.raises(MeasurandError, match=message):
        measurand(kind, shapes, None, groups)
