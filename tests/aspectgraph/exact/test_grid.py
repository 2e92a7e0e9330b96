"""The integer grid: what snapping does, how mm become steps and back, and what does not fit."""

import numpy as np
import pytest
import solids
from generated_solids import generated_solid
from scipy.spatial.transform import Rotation

from aspectgraph import SolidError, WorkspaceError
from aspectgraph.exact.grid import GRID_BITS, POINT_BITS, Grid

BLOCK = np.array([[0.0, 0, 0], [3, 1, 2]])
TURN = Rotation.random(random_state=3).as_matrix()
OBLIQUE = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
CUBE_TURNS = Rotation.create_group("O").as_matrix().round()


def random_vertices(n=200):
    return np.random.default_rng(0).uniform(-50, 50, (n, 3))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 7.0, 0.3, 1e5])
def test_part_in_round_numbers_is_not_displaced(scale):
    vertices = np.array([[0.0, 0, 0], [3, 1, 2], [0.25, 0.5, -1], [1.1, 0.7, 0.05]]) * scale
    grid = Grid.over(vertices)
    assert (grid.snapping_mm, grid.resolution) == (0.0, 0.0)
    assert (grid.scale == 1.0).all()
    assert 2 ** (GRID_BITS - 1) <= np.ptp(grid.points, axis=0).max() <= 2**GRID_BITS
    np.testing.assert_allclose(grid.to_mm(grid.points), vertices, atol=1e-14 * scale)


def test_dyadic_coordinates_come_back_to_the_bit():
    vertices = np.array([[0.0, 0, 0], [3, 1, 2], [0.25, 0.5, -1], [-17.375, 0, 0.125]])
    for turn in CUBE_TURNS:
        grid = Grid.over(vertices, turn)
        assert (grid.to_mm(grid.points) == vertices).all()
        assert np.log2(grid.step_mm) == int(np.log2(grid.step_mm))


def test_prism_with_a_side_of_irrational_length_gets_a_step_per_axis():
    """In the frame of the side from (0, 0) to (2, 1) the corners are multiples of 1/√5 along it and across."""
    along = np.array([2, 1, 0]) / np.sqrt(5)
    frame = np.array([along, [-along[1], along[0], 0], [0, 0, 1]])
    vertices = np.array([[0, 0, 0], [2, 1, 0], [1, 3, 0], [0, 0, 1], [2, 1, 1], [1, 3, 1.0]])
    grid = Grid.over(vertices, frame)
    assert grid.resolution == 0.0
    assert np.abs(grid.to_mm(grid.points) - vertices).max() < 1e-14
    own_multiples = np.ptp(grid.points, axis=0) * grid.steps_mm * [np.sqrt(5), np.sqrt(5), 1]
    assert own_multiples == pytest.approx(np.rint(own_multiples), abs=1e-12)
    # Corners 0 and 3 differ by (0, 0, 1), 0 and 1 by √5 along the side alone.
    assert np.count_nonzero(grid.points[3] - grid.points[0]) == 1
    assert np.count_nonzero(grid.points[1] - grid.points[0]) == 1


@pytest.mark.parametrize("turn", [np.eye(3), TURN], ids=["as it is", "turned"])
def test_displacement_is_reported_and_below_half_a_diagonal(turn):
    vertices = random_vertices()
    grid = Grid.over(vertices, turn)
    displaced = np.linalg.norm(grid.to_mm(grid.points) - vertices, axis=1)
    assert grid.snapping_mm == pytest.approx(displaced.max())
    assert 0 < grid.snapping_mm <= np.sqrt(3) / 2 * grid.step_mm
    assert grid.resolution > 0


def test_two_corners_off_any_lattice_are_no_accident_to_be_found():
    """A coordinate at 1/π of the extent is near some multiple of 1/d for large d; that does not make it one."""
    vertices = np.array([[0, 0, 0], [1, 1, 1], [1 / np.pi, 0, 0]])
    assert Grid.over(vertices * 1.0 + 300.0).resolution > 0


@pytest.mark.parametrize(
    "turn", [np.eye(3), CUBE_TURNS[5], TURN], ids=["as it is", "axes swapped", "turned"]
)
def test_viewpoints_are_rounded_to_a_millionth_of_a_step(turn):
    grid = Grid.over(BLOCK, turn)
    viewpoints = np.random.default_rng(0).uniform(-60, 60, (100, 3))
    back = grid.to_mm(grid.to_points(viewpoints) / 2.0**POINT_BITS)
    assert np.abs(back - viewpoints).max() <= np.sqrt(3) * 2.0**-POINT_BITS * grid.step_mm


@pytest.mark.parametrize("seed", range(10))
def test_planes_in_mm_hold_the_points_of_planes_on_the_grid(seed):
    grid = Grid.over(random_vertices(), Rotation.random(random_state=seed).as_matrix())
    trio = grid.points[:3]
    normal = np.cross(trio[1] - trio[0], trio[2] - trio[0])
    plane = grid.planes_to_mm(np.array([[*normal, normal @ trio[0]]]))[0]
    assert np.linalg.norm(plane[:3]) == pytest.approx(1.0)
    assert np.abs(grid.to_mm(trio) @ plane[:3] - plane[3]).max() < 1e-9


def corners(box):
    return np.array([[box[i][0], box[j][1], box[k][2]] for i, j, k in np.ndindex(2, 2, 2)])


@pytest.mark.parametrize("room", [0.1, 60.0, 1000.0])
@pytest.mark.parametrize(
    "frame", [np.eye(3), CUBE_TURNS[5], OBLIQUE, TURN], ids=["none", "swap", "oblique", "random"]
)
def test_turned_workspace_contains_the_workspace_and_less_than_a_step_more(frame, room):
    grid = Grid.over(BLOCK, frame)
    box = np.array([BLOCK[0] - room, BLOCK[1] + 1.5 * room])
    planes = grid.box_planes(box)
    assert planes[:, :3].__abs__().max() < 2**43
    assert (np.cross(planes[::2, :3].astype(float), planes[1::2, :3].astype(float)) == 0).all()
    in_mm = grid.planes_to_mm(planes)
    for axis in range(3):
        for side, plane in enumerate(in_mm[2 * axis : 2 * axis + 2]):
            outwards = (2 * side - 1) * (plane[3] - corners(box) @ plane[:3])
            ends = corners(box)[:, axis] == box[side, axis]
            assert outwards.min() > -1e-9 * room
            assert outwards[ends].max() < grid.step_mm
            assert plane[axis] == pytest.approx(1.0)


@pytest.mark.parametrize("frame", CUBE_TURNS[::5])
def test_workspace_of_an_axis_aligned_part_is_exact(frame):
    grid = Grid.over(BLOCK, frame)
    box = np.array([[-60.0, -59, -3], [61, 7.5, 60.25]])
    in_mm = grid.planes_to_mm(grid.box_planes(box))
    assert (in_mm[:, :3] == np.repeat(np.eye(3), 2, axis=0)).all()
    assert (in_mm[:, 3] == box.T.ravel()).all()


@pytest.mark.parametrize("seed", range(20))
def test_measures_do_not_depend_on_the_frame(seed):
    """Distances between vertices, by their places on the grid and as given; steps may differ from axis to axis."""
    vertices = np.array(generated_solid(seed).vertices, dtype=float)
    grid = Grid.over(vertices, Rotation.random(random_state=seed).as_matrix())
    on_grid = grid.points * grid.steps_mm
    between = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (vertices, on_grid)]
    assert np.abs(between[0] - between[1]).max() <= 2 * grid.snapping_mm + 1e-9


def test_part_too_far_from_the_origin_is_refused():
    # 2**20 extents of 1e-4 mm
    with pytest.raises(SolidError, match=r"within 104\.\d+ mm of the origin, 2\*\*40 grid steps"):
        Grid.over(np.array([[1e9, 0, 0], [1e9 + 1e-4, 1e-4, 1e-4]]))


@pytest.mark.parametrize("frame", [np.eye(3), TURN], ids=["as it is", "turned"])
def test_workspace_must_contain_the_part(frame):
    grid = Grid.over(solids.cube().vertices, frame)
    with pytest.raises(
        WorkspaceError, match=r"workspace must contain the part .* Got \[-1.0, -1.0, 1.0\]"
    ):
        grid.box_planes(np.array([[-1.0, -1, 1], [5, 5, 5]]))


def test_workspace_must_fit_the_grid():
    grid = Grid.over(solids.cube().vertices)
    with pytest.raises(
        WorkspaceError,
        match=r"must reach at most 2.09715e\+06 mm from the part, 2\*\*40 grid steps",
    ):
        grid.box_planes(np.array([[-1.0, -1, -1], [5, 5, 1e7]]))


def test_cube_is_the_same_for_all_workspaces_but_huge_ones():
    grid = Grid.over(BLOCK, TURN)
    boxes = [np.array([[-room] * 3, [room] * 3]) for room in (10.0, 100.0, 1000.0, 10_000.0)]
    cubes = [grid.cube_planes(box) for box in boxes]
    assert all((cube == cubes[0]).all() for cube in cubes[:3])
    for cube, box in zip(cubes, boxes, strict=True):
        assert (np.abs(grid.to_points(corners(box)) / 2.0**POINT_BITS) < cube[1, 3]).all()
