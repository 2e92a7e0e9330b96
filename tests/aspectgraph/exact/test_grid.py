"""The integer grid: what snapping does, how mm become steps and back, and what does not fit."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numba as nb
import numpy as np
import pytest
import solids
import wide_integers
from engine_pairs import sharp_edges, solid_of, uniform_viewpoints, workspace_of
from exact_checker import ExactChecker
from generated_solids import generated_solid
from hypothesis import example, given, settings
from hypothesis import strategies as st
from moved_parts import THIN, TINY, fine_part
from scipy.spatial.transform import Rotation
from solids import FaceBuilder, add_prism, prism

from aspectgraph import SolidError, WorkspaceError
from aspectgraph.exact.grid import (
    EDGE_EDGE,
    GRID_BITS,
    LEAST_STEPS,
    LIMBS,
    POINT_BITS,
    VERTEX_FACE,
    Grid,
    _meet,
    _sign_at_point_exact,
    _sign_at_vertex_exact,
    face_planes,
    find_parallel,
    meet,
    nearest_features,
    plane_through,
    side_of,
    sign_at_point,
    sign_at_vertex,
)
from aspectgraph.exceptions import ResolutionError
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.scene import make_scene
from aspectgraph.visibility.visibility_regions import compute_regions

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


# Planes on the integer grid: which planes are one plane, and which become parallel.


ROTATION = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]


@pytest.mark.uncompiled
def test_plane_through_three_points_is_reduced_and_oriented():
    plane = plane_through(np.array([0, 0, 6]), np.array([4, 0, 6]), np.array([0, 10, 6]))
    assert plane.tolist() == [0, 0, 1, 6]
    assert not plane_through(np.array([0, 0, 0]), np.array([1, 1, 1]), np.array([3, 3, 3])).any()


@pytest.mark.uncompiled
def test_side_counts_a_vertex_within_the_resolution_as_on_the_plane():
    plane = np.array([0, 0, 1, 6])
    assert [side_of(plane, np.array([0, 0, z]), 0.0) for z in (5, 6, 7)] == [-1, 0, 1]
    assert [side_of(plane, np.array([0, 0, z]), 2.0) for z in (3, 4, 8, 9)] == [-1, 0, 0, 1]


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


# Exact signs against Python's own integers, on generic, degenerate and largest possible input.


SMALL = st.tuples(*[st.integers(-2, 2)] * 3, st.integers(-3, 3))
LARGE = st.tuples(*[st.integers(-(2**42), 2**42)] * 3, st.integers(-(2**62), 2**62))
PLANES = st.lists(st.one_of(SMALL, LARGE), min_size=4, max_size=4)


def determinant(rows):
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def common_point(planes):
    w = determinant([plane[:3] for plane in planes])
    if w == 0:
        return None
    columns = [
        [[p[3] if k == axis else p[k] for k in range(3)] for p in planes] for axis in range(3)
    ]
    return [Fraction(determinant(rows), w) for rows in columns]


def sign(x):
    return (x > 0) - (x < 0)


@pytest.mark.uncompiled
@settings(max_examples=300, deadline=None)
@given(PLANES)
def test_vertex_and_plane_agree_with_integers(planes):
    table = np.array(planes, np.int64)
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    point = common_point(planes[:3])
    assert meet(table, 0, 1, 2, vertices, coordinates, 0) == (point is not None)
    if point is not None:
        assert coordinates[0] == pytest.approx([float(x) for x in point], rel=1e-14, abs=0)
        for h, plane in enumerate(planes):
            expected = sign(sum(n * x for n, x in zip(plane[:3], point, strict=True)) - plane[3])
            assert sign_at_vertex(table, h, vertices, coordinates, 0) == expected


@pytest.mark.uncompiled
@settings(max_examples=300, deadline=None)
@given(
    st.one_of(SMALL, LARGE),
    st.lists(st.integers(-(2**45), 2**45), min_size=3, max_size=3),
    st.booleans(),
)
def test_point_and_plane_agree_with_integers(plane, point, on_grid):
    if on_grid:
        point = [(x >> 24) << POINT_BITS for x in point]
    exact = sum(n * x for n, x in zip(plane[:3], point, strict=True)) - (plane[3] << POINT_BITS)
    assert sign_at_point(np.array([plane], np.int64), 0, np.array(point, np.int64)) == sign(exact)


@pytest.mark.uncompiled
def test_every_degenerate_case_of_a_pencil():
    """All planes through one line, and points on that line: rounding alone would decide at random."""
    pencil = [(k, 7 - k, 0, 0) for k in range(8)] + [(0, 0, 1, 12345)]
    table = np.array(pencil, np.int64)
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    assert meet(table, 0, 3, 8, vertices, coordinates, 0)
    assert [sign_at_vertex(table, h, vertices, coordinates, 0) for h in range(9)] == [0] * 9


@pytest.mark.uncompiled
@settings(max_examples=200, deadline=None)
@given(
    st.tuples(*[st.integers(-(2**42), 2**42)] * 3),
    st.tuples(*[st.integers(-(2**18), 2**18)] * 3),
    st.integers(-1, 1),
)
@example((4124765444479, 2168393462016, 112740016985), (113628, 213988, 146529), 0)
@example((4124765444479, 2168393462016, 112740016985), (113628, 213988, 146529), -1)
def test_a_plane_that_passes_by_one_unit_is_on_the_right_side(normal, point, past):
    """Terms of 60 bits that cancel but for one unit, which doubles round away: their error bound must not."""
    level = sum(n * x for n, x in zip(normal, point, strict=True)) + past
    planes = np.array(
        [(1, 0, 0, point[0]), (0, 1, 0, point[1]), (0, 0, 1, point[2]), (*normal, level)], np.int64
    )
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    assert meet(planes, 0, 1, 2, vertices, coordinates, 0)
    assert sign_at_vertex(planes, 3, vertices, coordinates, 0) == -past
    assert sign_at_point(planes, 3, np.array(point, np.int64) << POINT_BITS) == -past


@pytest.mark.uncompiled
def test_parallel_planes_have_no_common_point():
    planes = np.array([(1, 2, 3, 4), (1, 2, 3, 5), (0, 0, 1, 0), (-2, -4, -6, 8)], np.int64)
    vertices = np.zeros((1, 4, LIMBS), np.int64)
    coordinates = np.zeros((1, 3))
    assert not meet(planes, 0, 1, 2, vertices, coordinates, 0)
    assert not meet(planes, 0, 2, 3, vertices, coordinates, 0)


# The 256-bit instructions, compiled anew, against Python's integers, limb by limb: what stands in
# must be the same.


PLANE = st.tuples(*[st.integers(-(2**42), 2**42)] * 3, st.integers(-(2**62), 2**62))
POINT = st.tuples(*[st.integers(-(2**45), 2**45)] * 3)


@nb.njit
def compiled(planes, point, vertices):
    met = _meet(planes, 0, 1, 2, vertices, 0)
    at_point = _sign_at_point_exact(planes, 3, point[0], point[1], point[2])
    return met, _sign_at_vertex_exact(planes, 3, vertices, 0), at_point


@pytest.mark.skipif(bool(nb.config.DISABLE_JIT), reason="nothing is compiled")
@settings(max_examples=200, deadline=None)
@given(st.lists(PLANE, min_size=4, max_size=4), POINT)
def test_instructions_do_what_integers_do(planes, point):
    table = np.array(planes, np.int64)
    made, expected = np.zeros((2, 1, 4, LIMBS), np.int64)
    found = compiled(table, np.array(point, np.int64), made)
    met = wide_integers._meet(table, 0, 1, 2, expected, 0)
    at_vertex = wide_integers._sign_at_vertex_exact(table, 3, expected, 0)
    assert found == (met, at_vertex, wide_integers._sign_at_point_exact(table, 3, *point))
    np.testing.assert_array_equal(made, expected)


@pytest.mark.skipif(bool(nb.config.DISABLE_JIT), reason="nothing is compiled")
@pytest.mark.parametrize(
    "value", [0, 1, -1, 2**63, -(2**63), 2**64, -(2**64), 2**200, -(2**255), 2**255 - 1]
)
def test_limbs_there_and_back(value):
    assert wide_integers.value_of(wide_integers.limbs(value)) == value


# Details near the grid's step: answered right, or refused; never answered wrong.


SHARES = (1e-9, 1e-7, 1e-6, 3e-6, 6e-6, 1e-5, 2e-5, 5e-5, 3e-4)
N_POINTS = 60
N_EDGES = 12


class Outcome(NamedTuple):
    """Whether a part was refused; else how many answers differ from the referee's on given and on snapped vertices."""

    refused: bool
    n: int = 0
    wrong_as_given: int = 0
    wrong_as_snapped: int = 0


def outcome(kind: str, share: float, seed: int, turned: bool) -> Outcome:
    part = fine_part(kind, share, seed, turned)
    rng = np.random.default_rng([seed, 7])
    referee = ExactChecker(part.vertices, part.faces)
    pairs = [
        sharp_edges(part, referee)[i]
        for i in rng.permutation(len(sharp_edges(part, referee)))[:N_EDGES]
    ]
    workspace = workspace_of(part)
    points = uniform_viewpoints(rng, workspace, N_POINTS, 1)
    points = points[referee.generic(points)]
    try:
        solid = solid_of(part)
        number = {tuple(sorted(edge.vertices)): edge.id for edge in solid.edges}
        regions = compute_regions(
            solid, {f"e{i}": number[pair] for i, pair in enumerate(pairs)}, workspace
        )
    except SolidError:
        return Outcome(True)
    engine = regions.observable(points)
    snapped = ExactChecker(regions.grid.points, part.faces)
    # the engine's viewpoints on the grid of the part, so that both programs get the same numbers
    whole = np.rint(regions.grid.to_points(points) / 2.0**POINT_BITS).astype(np.int64)
    on_grid = regions.grid.to_mm(whole)
    inside = ((on_grid >= workspace[0]) & (on_grid <= workspace[1])).all(axis=1) & snapped.generic(
        whole
    )
    as_snapped = regions.observable(on_grid[inside]) != snapped.observable(whole[inside], pairs)
    return Outcome(
        False,
        engine.size,
        int((engine != referee.observable(points, pairs)).sum()),
        int(as_snapped.sum()),
    )


@pytest.mark.parametrize("turned", [False, True], ids=["straight", "turned"])
@pytest.mark.parametrize("kind", THIN)
def test_thin_details_are_right_or_refused(kind, turned):
    outcomes = {share: outcome(kind, share, 1, turned) for share in SHARES}
    assert [
        share
        for share, result in outcomes.items()
        if result.wrong_as_given or result.wrong_as_snapped
    ] == []
    assert not any(result.refused for share, result in outcomes.items() if share >= 5e-5)
    if kind not in ("stack", "plate", "wedge"):  # thin sides have a finer grid
        assert all(result.refused for share, result in outcomes.items() if share <= 3e-6)


@pytest.mark.parametrize("turned", [False, True], ids=["straight", "turned"])
@pytest.mark.parametrize("kind", TINY)
def test_tiny_details_are_right_for_the_snapped_part_or_refused(kind, turned):
    """Snapping changes the proportions of a detail of k steps by up to 2/k, so answers are those for such a detail."""
    outcomes = {share: outcome(kind, share, 1, turned) for share in SHARES}
    assert [share for share, result in outcomes.items() if result.wrong_as_snapped] == []
    assert sum(result.wrong_as_given for result in outcomes.values()) <= 1e-3 * sum(
        r.n for r in outcomes.values()
    )
    assert all(result.refused for share, result in outcomes.items() if share <= 3e-6)
    assert not any(result.refused for share, result in outcomes.items() if share >= 5e-5)


@pytest.mark.parametrize("gap", [1e-7, 1e-6, 1e-5])
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_mating_boxes_are_refused_with_place_distance_and_step(gap, seed):
    boxes = _two_boxes(gap, seed)
    with pytest.raises(ResolutionError) as raised:
        compute_regions(boxes, [0])
    text = str(raised.value)
    assert text.startswith(f"parts of the surface must be at least {LEAST_STEPS:g} grid steps of ")
    assert f"Got {gap:.3g} mm between vertex (" in text or f"Got {gap:.3g} mm between edge" in text
    assert f"{20 * (1 + gap / 20) / 2**GRID_BITS:.3g}" in text
    assert text.endswith("merge the solids in the CAD model, leave one out, or widen the gap.")


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_a_gap_in_round_numbers_is_no_detail_too_small(seed):
    """10 µm between boxes of 10 mm: a grid of 10⁻⁵ mm displaces nothing, so nothing is too near."""
    regions = compute_regions(_two_boxes(1e-5, seed, size=5.0), [0])
    assert regions.grid.resolution == 0.0


def test_a_small_detail_of_one_solid_is_named():
    part = fine_part("step", 1e-6, 0, False)
    with pytest.raises(
        ResolutionError,
        match=r"between edge .* and edge .*; leave the detail out, or make it larger",
    ):
        make_scene(solid_of(part))


def test_plates_get_a_finer_grid_across():
    """A gap of 2 to 4·10⁻⁶ is 12 steps at most of the usual grid; the side across is a hundredth of the long one."""
    grid, _ = make_scene(solid_of(fine_part("stack", 2e-6, 3, False)))
    assert grid.scale.min() < 0.05
    assert np.ptp(grid.points, axis=0).tolist() == [1 << GRID_BITS] * 3


def test_nearest_features_by_hand():
    """The shortest edge of a box of 10 x 20 x 30; nothing else is as near."""
    one = prism([(0, 0), (10, 0), (10, 20), (0, 20)], 30)
    assert nearest_features(one, one.vertices, within=10.5).steps == 10.0
    assert nearest_features(one, one.vertices, within=10.0).n == 0


@pytest.mark.parametrize(
    ("shift", "kind"),
    [
        ((10.5, 2, 3), VERTEX_FACE),  # a corner over the inside of a face
        ((10.3, 2, 30.4), EDGE_EDGE),  # edges side by side
        ((10.3, 20.4, 3), EDGE_EDGE),
    ],
)
def test_nearest_features_of_two_boxes_by_hand(shift, kind):
    """Boxes of 10 x 20 x 30 and 5 x 6 x 7, half a unit apart."""
    builder = FaceBuilder()
    add_prism(builder, [(0, 0), (10, 0), (10, 20), (0, 20)], 30)
    x, y, z = shift
    add_prism(builder, [(x, y), (x + 5, y), (x + 5, y + 6), (x, y + 6)], 7, base=z)
    solid = builder.solid("two boxes")
    nearest = nearest_features(solid, solid.vertices, within=1.0)
    assert nearest.steps == pytest.approx(0.5)
    assert nearest.kind == kind


def _two_boxes(gap: float, seed: int | None, size: float = 10.0) -> Solid:
    turn = np.eye(3) if seed is None else Rotation.random(random_state=seed).as_matrix()
    box = prism([(0, 0), (size, 0), (size, size), (0, size)], size)
    faces = [
        *(face.outer for face in box.faces),
        *(tuple(v + 8 for v in face.outer) for face in box.faces),
    ]
    return Solid(
        np.concatenate([box.vertices, box.vertices + np.array([size + gap, 0, 0])]) @ turn.T, faces
    )
