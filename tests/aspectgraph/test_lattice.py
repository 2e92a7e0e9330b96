"""The integer grid: what snapping does, which planes are one plane, and what does not fit."""

import numpy as np
import pytest
import solids

from aspectgraph import SolidError, WorkspaceError
from aspectgraph.lattice import GRID_BITS, Grid, face_planes, find_parallel, plane_through, side_of
from aspectgraph.predicates import POINT_BITS

ROTATION = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]


def test_step_is_a_power_of_two_and_the_part_spans_half_to_all_of_the_grid():
    for scale in (1e-3, 1.0, 7.0, 1e5):
        grid = Grid.over(np.array([[0.0, 0, 0], [3, 1, 2]]) * scale)
        assert np.log2(grid.step_mm) == int(np.log2(grid.step_mm))
        assert 2 ** (GRID_BITS - 1) <= 3 * scale / grid.step_mm <= 2**GRID_BITS


def test_representable_coordinates_are_not_displaced():
    grid = Grid.over(np.array([[0.0, 0, 0], [3, 1, 2], [0.25, 0.5, -1]]))
    assert (grid.snapping_mm, grid.resolution) == (0.0, 0.0)


def test_displacement_is_reported_and_below_half_a_diagonal():
    vertices = np.random.default_rng(0).uniform(-50, 50, (200, 3))
    grid = Grid.over(vertices)
    displaced = np.linalg.norm(grid.to_mm(grid.points) - vertices, axis=1)
    assert grid.snapping_mm == pytest.approx(displaced.max())
    assert 0 < grid.snapping_mm <= np.sqrt(3) / 2 * grid.step_mm
    assert grid.resolution > 0


def test_viewpoints_are_rounded_to_a_millionth_of_a_step():
    grid = Grid.over(np.array([[0.0, 0, 0], [3, 1, 2]]))
    viewpoints = np.random.default_rng(0).uniform(-60, 60, (100, 3))
    back = (grid.to_points(viewpoints) / 2.0**POINT_BITS + grid.origin) * grid.step_mm
    assert np.abs(back - viewpoints).max() <= 2.0**-POINT_BITS * grid.step_mm


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
    level, tilted = np.array([0, 0, 1, 0]), np.array([1, 0, 100, 0])
    turned = plane_through(*points[:3])
    found = find_parallel(np.array([tilted, level]), points, np.array([0, 1, 2]), 4.0, turned)
    assert found.tolist() == [0, 0, 1, 701]
    steeper = plane_through(*points[[0, 1, 3]])
    assert (
        find_parallel(np.array([tilted, level]), points, np.array([0, 1, 3]), 4.0, steeper).tolist() == steeper.tolist()
    )


def test_part_too_far_from_the_origin_is_refused():
    with pytest.raises(SolidError, match=r"within 1.09951e\+12 grid steps|2\*\*40 grid steps"):
        Grid.over(np.array([[1e9, 0, 0], [1e9 + 1e-4, 1e-4, 1e-4]]))


def test_workspace_must_contain_the_part():
    grid = Grid.over(solids.cube().vertices)
    with pytest.raises(WorkspaceError, match=r"workspace must contain the part .* Got \[-1.0, -1.0, 1.0\]"):
        grid.box_planes(np.array([[-1.0, -1, 1], [5, 5, 5]]))
