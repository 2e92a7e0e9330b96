"""Hulls contain what they stand for, and spheres cover hulls."""

import numpy as np
import pytest
from robot_cells import NAMES, made_robot, pose

from planner import Box, RobotError
from planner.robotcell.bodies import grown, hull_of, mesh_of, round_points, surface_of

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def inside(hull, rng, count):
    """Return drawn points (n, 3) of a hull: means of its corners with drawn weights."""
    weights = rng.dirichlet(np.full(len(hull.corners), 0.2), count)
    return weights @ hull.corners


def covered(hull, points):
    apart = np.linalg.norm(points[:, None] - hull.centres, axis=2)
    return (apart <= hull.radii).any(axis=1)


def heights(hull, points):
    """Return how far points (n, 3) are outside of the planes of a hull, (n,)."""
    sides = hull.corners[hull.triangles]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return ((points[:, None] - sides[:, 0]) * normals).sum(axis=2).max(axis=1)


@pytest.mark.parametrize("seed", range(6))
def test_spheres_cover_a_hull(seed):
    rng = np.random.default_rng(seed)
    hull = hull_of(rng.normal(size=(60, 3)) * rng.choice([10.0, 50.0, 400.0], 3), "body")
    assert covered(hull, inside(hull, rng, 2000)).all()
    assert covered(hull, hull.corners).all()


@pytest.mark.parametrize("name", NAMES)
def test_spheres_cover_the_links(name):
    rng = np.random.default_rng(0)
    for hulls in made_robot(name).hulls:
        for hull in hulls:
            assert covered(hull, inside(hull, rng, 300)).all()


def test_a_long_body_has_slim_spheres():
    box = hull_of(CUBE * [600.0, 100.0, 100.0], "body")
    assert len(box.radii) > 2
    # one ball about all of it has 308 mm
    assert box.radii.max() < 110.0


@pytest.mark.parametrize("seed", range(4))
def test_a_grown_hull_contains_what_is_near(seed):
    rng = np.random.default_rng(seed)
    hull = hull_of(rng.normal(size=(8 if seed % 2 else 200, 3)) * 50.0, "body")
    outer = grown(hull, 7.0)
    steps = rng.normal(size=(2000, 3))
    steps *= 7.0 / np.linalg.norm(steps, axis=1)[:, None]
    assert heights(outer, inside(hull, rng, 2000) + steps).max() < 1e-6


def test_a_grown_box_keeps_the_distance_of_its_sides():
    outer = grown(hull_of(CUBE * 100.0, "body"), 5.0)
    np.testing.assert_allclose(outer.corners.min(axis=0), [-5.0] * 3, atol=1e-9)
    np.testing.assert_allclose(outer.corners.max(axis=0), [105.0] * 3, atol=1e-9)


@pytest.mark.parametrize("length", [0.0, 80.0])
def test_round_bodies_are_within_their_hulls(length):
    hull = hull_of(round_points(30.0, length), "body")
    rng = np.random.default_rng(0)
    points = rng.normal(size=(3000, 3))
    if length:
        points[:, :2] *= 30.0 / np.linalg.norm(points[:, :2], axis=1)[:, None]
        points[:, 2] = rng.uniform(-length / 2, length / 2, 3000)
    else:
        points *= 30.0 / np.linalg.norm(points, axis=1)[:, None]
    assert heights(hull, points).max() < 1e-9
    assert np.linalg.norm(hull.corners[:, :2], axis=1).max() < 31.5


def test_a_box_may_be_turned():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    box = Box((0, 0, 0), (10, 20, 30), pose((100.0, 0.0, 0.0), turn))
    np.testing.assert_allclose(box.corners().min(axis=0), (80.0, 0.0, 0.0))
    np.testing.assert_allclose(box.corners().max(axis=0), (100.0, 10.0, 30.0))


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ((0, 0, 0), (1, 1, 0), "low must be below high in every coordinate"),
        ((0, 0), (1, 1, 1), r"low must be three finite numbers. Got \(0, 0\)"),
        ((0, 0, 0), (1, float("inf"), 1), "high must be three finite numbers"),
        ("abc", (1, 1, 1), "low must be three finite numbers"),
    ],
)
def test_boxes_that_are_none(low, high, message):
    with pytest.raises(RobotError, match=message):
        Box(low, high)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (3, "camera_body must be a Box, a mesh file, or corners and triangles. Got 3"),
        ((CUBE, [[0, 1, 8]]), "must number its corners from 0. Got 8 of 8"),
        ((CUBE, [[0, 1]]), r"must have corners \(v, 3\) that are finite and triangles"),
        ("lens.step", r"must be a mesh file \(.stl, .obj, .ply, .off\). Got 'lens.step'"),
        ("no.stl", "must be a file that can be read. Got 'no.stl'"),
    ],
)
def test_bodies_that_are_none(body, message):
    with pytest.raises(RobotError, match=message):
        mesh_of(body, "camera_body")


def test_a_damaged_mesh_is_refused(tmp_path):
    path = tmp_path / "lens.stl"
    path.write_bytes(b"solid x\nfacet\nvertex 1 2\n")
    with pytest.raises(RobotError, match="camera_body must be an intact mesh"):
        mesh_of(path, "camera_body")


def test_only_a_closed_surface_has_an_inside():
    hull = hull_of(CUBE, "body")
    assert surface_of(hull.corners, hull.triangles).closed
    assert not surface_of(hull.corners, hull.triangles[1:]).closed
    assert not surface_of(hull.corners, np.concatenate([hull.triangles, hull.triangles[:1]])).closed
