"""Lines that are left out near displaced cameras: against dense points and rays, and against looking at all lines."""

import dataclasses

import holed_plate as plates
import numpy as np
import pytest
from lit_parts import block
from real_parts import real_part

from aspectgraph import read_solid
from aspectgraph.solid.solid import RayScene
from errors.measurands import Circle
from planner import Camera, Detectability, look_at
from planner.camera.pose import moved
from planner.detectability import image_check
from planner.detectability.corners import SHOWS
from planner.detectability.image_check import ImageCheck, PartLines, Scanned
from planner.detectability.vicinity import PartPieces, Vicinity

PARTS = [
    "examples/two_pocket_block.off",
    "examples/mfcad_6-11-11-19.step",
    "examples/nist_ctc_01_ap242.stp",
]
CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 200.0)


def distance_for(solid):
    return 3.0 * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))


def views_of(solid, n, seed):
    """Return poses that look at the part from all sides."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(n, 3))
    middle = np.mean(solid.bounds, axis=0)
    eyes = middle + distance_for(solid) * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    aims = middle + rng.uniform(-0.3, 0.3, (n, 3)) * np.ptp(solid.bounds, axis=0)
    return [look_at(eye[None], aim)[0] for eye, aim in zip(eyes, aims, strict=True)]


def displaced(pose, n, rng, sigma_mm):
    """Return poses that are off by so much, and by 2 mrad."""
    return moved(pose, rng.normal(size=(n, 6)) * np.repeat([sigma_mm, 0.002], 3), 1.0)


def test_lines_are_left_out_only_if_no_camera_nearby_sees_them_near():
    """Against angles between dense points, from many places of the camera; most lines are left out."""
    rng = np.random.default_rng(8)
    behind = np.array([0.0, 0.0, 1000.0])
    eyes = np.tile(np.eye(4), (300, 1, 1))
    eyes[:, :3, 3] = behind + rng.normal(size=(300, 3)) * 0.5
    middles = behind + rng.normal(size=(400, 3)) * 20.0 + [0.0, 0.0, 60.0]
    lines = middles[:, None] + rng.normal(size=(400, 2, 3)) * 4.0
    spans = behind + np.array(
        [[[-3.0, 0.0, 60.0], [3.0, 1.0, 58.0]], [[8.0, 8.0, 70.0], [8.0, 8.0, 70.0]]]
    )
    bulges = rng.normal(size=(400, 3)) * (rng.random((400, 1)) < 0.3)
    angle = 0.02
    part = PartPieces(block(), RayScene(block().vertices, block().triangles), lines, bulges)
    vicinity = Vicinity.of(part, eyes)
    of, line = vicinity.lines_near(spans, np.arange(2), angle, np.ones((2, 400), bool))
    together = vicinity.lines_near(spans, np.zeros(2, int), angle, np.ones((1, 400), bool))
    np.testing.assert_array_equal(together, (of, line))
    kept = np.zeros((2, 400), bool)
    kept[of, line] = True
    share = np.linspace(0.0, 1.0, 101)[:, None]
    lift = 4.0 * share * (1.0 - share)
    curves = (
        lines[:, None, 0] + share * (lines[:, 1] - lines[:, 0])[:, None] + lift * bulges[:, None]
    )
    for span, lines_kept in zip(spans, kept, strict=True):
        places = span[0] + share * (span[1] - span[0])
        near = np.zeros(400, bool)
        for eye in eyes[::10, :3, 3]:
            seen, asked = (
                (p - eye) / np.linalg.norm(p - eye, axis=-1)[..., None] for p in (curves, places)
            )
            cosines = seen.reshape(-1, 3) @ asked.reshape(-1, 3).T
            near |= (cosines.max(axis=1) >= np.cos(angle)).reshape(400, -1).any(axis=1)
        assert near.sum() > 2
        assert not (near & ~lines_kept).any()
        assert lines_kept.sum() < 2 * near.sum() + 10


@pytest.mark.parametrize("name", PARTS)
def test_what_is_hidden_from_a_ball_is_hidden_from_each_place_in_it(name):
    """Against rays from random places to random points; most of what all these rays find hidden is proven to be."""
    solid = read_solid(name)
    part = PartLines.of(solid)
    rng = np.random.default_rng(3)
    proven = blocked = 0
    for pose in views_of(solid, 6, seed=1):
        vicinity = Vicinity.of(part.pieces, displaced(pose, 200, rng, 0.2))
        chosen = rng.choice(len(part.pieces.ends), min(60, len(part.pieces.ends)), replace=False)
        pieces = part.pieces.split[chosen].reshape(-1, 2, 3)
        hidden = part.pieces.faces.hide(vicinity, pieces)
        ways = rng.normal(size=(300, 3))
        ways *= (vicinity.radius_mm / np.linalg.norm(ways, axis=1))[:, None]
        share = rng.random((300, 1, 1))
        points = pieces[:, 0] + share * (pieces[:, 1] - pieces[:, 0])
        eyes = np.broadcast_to((vicinity.centre + ways)[:, None], points.shape)
        always = part.scene.blocked(eyes, points - eyes, 1.0 - 1e-4).all(axis=0)
        assert not (hidden & ~always).any()
        proven += hidden.sum()
        blocked += always.sum()
    assert proven > 0.3 * blocked > 10


@pytest.mark.parametrize("name", PARTS)
def test_contours_that_may_show_are_those_that_show_from_some_place(name):
    """Both faces of a contour are looked at from each place; few more may show than do."""
    solid = read_solid(name)
    part = PartLines.of(solid)
    contours = part.showing
    rng = np.random.default_rng(4)
    for pose in views_of(solid, 4, seed=2):
        vicinity = Vicinity.of(part.pieces, displaced(pose, 200, rng, 0.2))
        ways = rng.normal(size=(300, 3))
        ways *= (vicinity.radius_mm / np.linalg.norm(ways, axis=1))[:, None]
        height = (vicinity.centre + ways) @ contours.planes[:, :3].T - contours.planes[:, 3]
        fronts = (height > 0.0)[:, contours.faces].sum(axis=2)
        shows = (SHOWS[contours.kinds, fronts] > 0).any(axis=0)
        may_show = vicinity.may_show(contours)
        assert not (shows & ~may_show).any()
        assert may_show.sum() <= shows.sum() + 0.05 * len(shows) + 2


def judged(check, poses, wanted, monkeypatch):
    """Return what is said of poses with all lines, and without those that are left out."""
    with monkeypatch.context() as all_lines:
        all_lines.setattr(image_check, "_MANY_NEAR", 1_000_000)
        plain = check.shown(poses, wanted), check.separations(poses, wanted, 3.0)
    return plain, (check.shown(poses, wanted), check.separations(poses, wanted, 3.0))


@pytest.mark.parametrize("lens", [None, (-0.22, 0.06, 0.001, -0.001)])
def test_images_on_several_parts_are_judged_as_with_all_lines(lens, monkeypatch):
    """Edges of real parts, each in the images of 300 displaced poses; some show, and some do not."""
    rng = np.random.default_rng(6)
    shown = []
    for name in [*PARTS, real_part("mfcad_2-3-3-3-3-23.step")]:
        solid = read_solid(name)
        edges = solid.straight_edges()
        edges = edges[:: max(1, len(edges) // 12)][:12]
        ends = np.array([solid.edge_points(edge.id) for edge in edges])
        camera = dataclasses.replace(CAMERA, focus_distance_mm=distance_for(solid), distortion=lens)
        check = ImageCheck(solid, [[edge.id] for edge in edges], ends, camera, Detectability())
        every = np.ones((300, len(edges)), bool)
        for pose in views_of(solid, 4, seed=5):
            poses = displaced(pose, 300, rng, 1e-3 * distance_for(solid))
            plain, fewer = judged(check, poses, every, monkeypatch)
            assert np.array_equal(plain[0], fewer[0])
            assert np.array_equal(plain[1], fewer[1])
            shown.append(plain[0].ravel())
    assert 0.02 < np.concatenate(shown).mean() < 0.98


@pytest.mark.parametrize("chords", [12, 48])
def test_images_of_rims_are_judged_as_with_all_lines(chords, monkeypatch):
    """Of a plate with holes, whose lower rims come near the upper ones in some images."""
    monkeypatch.setattr(plates, "N", chords)
    solid = plates.holed_plate()
    rims = [rim for rim in solid.rims() if abs(rim.centre[2] - plates.HEIGHT) < 1e-6]
    scanned = [[Scanned.of(rim.edge_ids, circle_of(rim))] for rim in rims]
    check = ImageCheck(
        solid,
        [None] * len(rims),
        np.zeros((len(rims), 2, 3)),
        dataclasses.replace(CAMERA, focus_distance_mm=distance_for(solid)),
        Detectability(),
        scanned,
    )
    rng = np.random.default_rng(7)
    every = np.ones((300, len(rims)), bool)
    for pose in views_of(solid, 8, seed=9):
        plain, fewer = judged(check, displaced(pose, 300, rng, 0.3), every, monkeypatch)
        assert np.array_equal(plain[0], fewer[0])
        assert np.array_equal(plain[1], fewer[1])


def circle_of(rim):
    x = rim.reference
    start = np.cos(rim.start_rad) * x + np.sin(rim.start_rad) * np.cross(rim.axis, x)
    return Circle(rim.centre, rim.axis, rim.radius_mm, start, 2 * np.pi)


def test_most_pairs_of_displaced_poses_need_no_look(monkeypatch):
    """What is left out is the larger part where a block's edges are far from each other."""
    solid = block()
    edges = solid.straight_edges()
    ends = np.array([solid.edge_points(edge.id) for edge in edges])
    check = ImageCheck(solid, [[edge.id] for edge in edges], ends, CAMERA, Detectability())
    looked_at = {False: 0, True: 0}
    loop = image_check.near_contours

    def counted(poses, pairs, *others):
        looked_at[image_check._MANY_NEAR > 1000] += len(pairs)
        return loop(poses, pairs, *others)

    monkeypatch.setattr(image_check, "near_contours", counted)
    pose = look_at([[300.0, -250.0, 280.0]], [40.0, 25.0, 30.0])[0]
    poses = displaced(pose, 300, np.random.default_rng(1), 0.2)
    judged(check, poses, np.ones((300, len(edges)), bool), monkeypatch)
    assert looked_at[False] < 0.1 * looked_at[True]
