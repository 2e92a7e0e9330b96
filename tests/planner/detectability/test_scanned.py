"""How near other lines come to rims and edges that are fitted: known answers, and a program of its own."""

import sys
from pathlib import Path

import holed_plate as plates
import numpy as np
import pytest

from errors.measurands import Circle, Line
from planner import Camera, Detectability, look_at
from planner.detectability.image_check import ImageCheck, Pieces, Scanned

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks" / "images"))
from rendered_images import Renderer
from seen_lines import Lines

pytestmark = pytest.mark.uncompiled

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
SHOWING = Detectability(separation_px=5.0)
ONE = np.ones((1, 1), dtype=bool)
POINTS = 24


@pytest.fixture
def fine_plate(monkeypatch):
    """The plate with holes of 240 chords: these leave their circles by a hundredth of a pixel."""
    monkeypatch.setattr(plates, "N", 240)
    return plates.holed_plate()


def upper_rim(solid):
    rims = [rim for rim in solid.rims() if abs(rim.centre[2] - plates.HEIGHT) < 1e-6]
    rim = min(rims, key=lambda one: one.centre[0])
    x = rim.reference
    start = np.cos(rim.start_rad) * x + np.sin(rim.start_rad) * np.cross(rim.axis, x)
    return rim, Circle(rim.centre, rim.axis, rim.radius_mm, start, 2 * np.pi)


def check_of(solid, edge_ids, geometry):
    scanned = [[Scanned.of(edge_ids, geometry)]]
    return ImageCheck(solid, [None], np.zeros((1, 2, 3)), CAMERA, SHOWING, scanned)


def distance_by(near):
    """Return what is said of an entity whose points have other lines so near."""
    line = Scanned((0,), np.zeros((POINTS, 3)))
    pieces, _ = Pieces.of([None], np.zeros((1, 2, 3)), [[line]])
    return pieces.of_pairs(np.zeros((1, 2), np.int64)).least_distance(np.asarray(near, float))[0]


@pytest.mark.parametrize(
    ("beside", "found"),
    [
        ([], 9.0),
        # a sixth of the points, in four twelfths
        ([0, 6, 12, 18], 9.0),
        # more than a fifth
        ([0, 4, 8, 12, 16], 2.0),
        # a whole twelfth
        ([6, 7], 2.0),
        # as many in two of them
        ([7, 8], 9.0),
    ],
)
def test_a_fifth_of_the_points_may_lie_beside_other_lines_but_no_twelfth(beside, found):
    near = np.full(POINTS, 9.0)
    near[beside] = 2.0
    assert distance_by(near) == found


@pytest.mark.parametrize("chords", [240, 24, 12])
def test_the_lower_rim_of_a_hole_from_above(chords, monkeypatch):
    """Both rims are circles about the image's centre, 8 mm at depths of 400 and 410 mm, however coarse the mesh."""
    monkeypatch.setattr(plates, "N", chords)
    plate = plates.holed_plate()
    rim, circle = upper_rim(plate)
    above = look_at([[20.0, 25.0, 410.0]], [20.0, 25.0, 10.0])
    found = check_of(plate, rim.edge_ids, circle).separations(above, ONE)[0, 0]
    px = CAMERA.matrix[0, 0]
    assert found + 5.0 == pytest.approx(px * 8.0 / 400.0 - px * 8.0 / 410.0, abs=0.08)


def test_the_lower_rim_may_cross_the_image_of_the_upper_one(fine_plate):
    """From the side, the visible part of the lower rim begins and ends on the upper one."""
    rim, circle = upper_rim(fine_plate)
    oblique = look_at([[20.0, -175.0, 356.0]], [20.0, 25.0, 10.0])
    check = check_of(fine_plate, rim.edge_ids, circle)
    assert check.separations(oblique, ONE)[0, 0] > 0
    assert check.shown(oblique, ONE).all()
    lines = Lines(fine_plate)
    renderer = Renderer(fine_plate.vertices, fine_plate.triangles, CAMERA.matrix)
    dense = circle.points(np.arange(360) * np.pi / 180)
    nearest = lines.apart_px(renderer, oblique[0], dense, set(rim.edge_ids))
    assert nearest.min() < 1.0


def test_two_sides_of_a_thin_plate():
    """Seen from the side, a plate of 0.2 mm has its lower edge 4 px from its upper one, all along."""
    thin = plates.holed_plate()
    thin = type(thin)(thin.vertices * [1.0, 1.0, 0.02], thin.faces)
    ends = np.array([[0.0, 0.0, 0.2], [80.0, 0.0, 0.2]])
    edge = next(
        one
        for one in thin.straight_edges()
        if {tuple(p) for p in thin.edge_points(one.id)} == {tuple(p) for p in ends}
    )
    side = look_at([[40.0, -400.0, 0.1]], [40.0, 0.0, 0.1])
    found = check_of(thin, (edge.id,), Line(*ends)).separations(side, ONE)[0, 0]
    assert found + 5.0 == pytest.approx(CAMERA.matrix[0, 0] * 0.2 / 400.0, abs=1e-6)
    assert not check_of(thin, (edge.id,), Line(*ends)).shown(side, ONE).any()


def test_random_poses_by_a_program_of_its_own(fine_plate):
    """Lines from faces and triangles, hidden by rays to dense points; it knows chords only."""
    solid = fine_plate
    rim, circle = upper_rim(solid)
    check = check_of(solid, rim.edge_ids, circle)
    lines = Lines(solid)
    renderer = Renderer(solid.vertices, solid.triangles, CAMERA.matrix)
    rng = np.random.default_rng(3)
    eyes = np.array([20.0, 25.0, 360.0]) + rng.uniform(-100, 100, (40, 3))
    poses = look_at(eyes, [20.0, 25.0, 10.0])
    said = check.shown(poses, np.ones((40, 1), bool))[:, 0]
    told = check.separations(poses, np.ones((40, 1), bool))[:, 0]
    np.testing.assert_array_equal(said, told >= 0)
    points = circle.points((np.arange(POINTS) + 0.5) * 2 * np.pi / POINTS)
    found = np.array([lines.apart_px(renderer, pose, points, set(rim.edge_ids)) for pose in poses])
    enough = np.sort(found, axis=1)[:, POINTS // 5]
    each = found.reshape(-1, 12, 2).max(axis=2).min(axis=1)
    apart = np.minimum(enough, each)
    off = np.abs(apart - np.minimum(told + 5.0, 12.0))
    # its lines are points a pixel apart, and rays end beside what they hit
    assert np.median(off) < 0.02
    assert (off < 0.5).sum() >= 36
    assert off.max() < 2.0
    assert 1 < (~said).sum() < 10


def test_yes_and_no_agree_with_how_much_beside_curves_of_few_chords(monkeypatch):
    """From 150 poses, many of them at the limit; the distance of a curve depends on nothing else that is near."""
    monkeypatch.setattr(plates, "N", 12)
    solid = plates.holed_plate()
    rim, circle = upper_rim(solid)
    check = check_of(solid, rim.edge_ids, circle)
    eyes = np.array([20.0, 25.0, 320.0]) + np.random.default_rng(7).uniform(-60, 60, (150, 3))
    poses = look_at(eyes, [20.0, 25.0, 10.0])
    wanted = np.ones((150, 1), bool)
    told = check.separations(poses, wanted)[:, 0]
    np.testing.assert_array_equal(check.shown(poses, wanted)[:, 0], told >= 0)
    assert 10 < (told < 0).sum() < 130
