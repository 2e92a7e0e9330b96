"""Planes on the integer grid: which planes are one plane, and which become parallel."""

import numpy as np
import pytest
import solids

from aspectgraph.exact.grid import Grid, face_planes, find_parallel, plane_through, side_of

pytestmark = pytest.mark.uncompiled

ROTATION = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]


def test_plane_through_three_points_is_reduced_and_oriented():
    plane = plane_through(np.array([0, 0, 6]), np.array([4, 0, 6]), np.array([0, 10, 6]))
    assert plane.tolist() == [0, 0, 1, 6]
    assert not plane_through(np.array([0, 0, 0]), np.array([1, 1, 1]), np.array([3, 3, 3])).any()


def test_side_counts_a_vertex_within_the_resolution_as_on_the_plane():
    plane = np.array([0, 0, 1, 6])
    assert [side_of(plane, np.array([0, 0, z]), 0.0) for z in (5, 6, 7)] == [-1, 0, 1]
    assert [side_of(plane, np.array([0, 0, z]), 2.0) for z in (3, 4, 8, 9)] == [-1, 0, 0, 1]


@pytest.mark.parametrize("rotation", [np.eye(3), ROTATION])
def test_coplanar_faces_share_one_plane_in_any_frame(rotation):
    solid = solids.box_with_pockets((6, 6, 4), [(2, 1, 2, 1, 2, 1), (2, 4, 5, 4, 5, 1)])
    vertices = solid.vertices @ rotation.T * 1.7
    grid = Grid.over(vertices)
    loops = [np.array(face.outer) for face in solid.faces]
    planes, plane_of_face, side_of_face = face_planes(grid, loops, solid.normals @ rotation.T)
    corners = solid.vertices[[face.outer[0] for face in solid.faces]]
    true = np.column_stack([solid.normals, (solid.normals * corners).sum(axis=1)]).round(6) + 0.0
    planes_of_space = {max(tuple(row), tuple(-row + 0.0)) for row in true}
    assert len(planes) == len(planes_of_space)
    outward = planes[plane_of_face, :3] * side_of_face[:, None]
    assert ((outward * (solid.normals @ rotation.T)).sum(axis=1) > 0).all()


def test_parallel_faces_have_exactly_parallel_planes_in_any_frame():
    """The block's three directions; snapped corner by corner, they would spread to one direction a plane."""
    solid = solids.box_with_pockets((6, 6, 4), [(2, 1, 2, 1, 2, 1), (2, 4, 5, 4, 5, 1)])
    vertices = solid.vertices @ ROTATION.T * 1.7
    grid = Grid.over(vertices)
    loops = [np.array(face.outer) for face in solid.faces]
    planes, plane_of_face, _ = face_planes(grid, loops, solid.normals @ ROTATION.T)
    assert len({max(tuple(row), tuple(-row)) for row in planes[:, :3]}) == 3
    for loop, plane in zip(loops, planes[plane_of_face], strict=True):
        assert all(side_of(plane, point, grid.resolution) == 0 for point in grid.points[loop])


def test_plane_that_snapping_turned_becomes_parallel_to_what_it_was_parallel_to():
    points = np.array([(0, 0, 700), (9000, 10, 701), (20, 8000, 702), (9000, 8000, 705)])
    level = np.array([0, 0, 1, 0])
    tilted = np.array([1, 0, 100, 0])
    turned = plane_through(*points[:3])
    found = find_parallel(np.array([tilted, level]), points, np.array([0, 1, 2]), 4.0, turned)
    assert found.tolist() == [0, 0, 1, 701]
    steeper = plane_through(*points[[0, 1, 3]])
    assert (
        find_parallel(np.array([tilted, level]), points, np.array([0, 1, 3]), 4.0, steeper).tolist()
        == steeper.tolist()
    )
