"""The referee itself: against hand-made answers, against box occupancy, and against the slow second program."""

from itertools import pairwise, product

import numpy as np
import pytest
from exact_checker import ExactChecker, observable_by_section
from generated_solids import (
    CUBE,
    L_BLOCK,
    SLOTTED_BLOCK,
    TWO_POCKET_BLOCK,
    block_with_pocket,
    cell_solid,
    check_part,
    generated_solid,
    prism,
)


def checker_of(part, steps_per_mm=1):
    return ExactChecker(part.vertices, part.faces, steps_per_mm)


def viewpoints(rng, part, checker, n, reach=12, steps_per_mm=2):
    """Return generic points around a part on a coarse grid, so that many lie on planes through edges and vertices."""
    low = np.min(part.vertices, axis=0) - reach
    high = np.max(part.vertices, axis=0) + reach
    points = rng.integers(low * steps_per_mm, high * steps_per_mm + 1, (n, 3)) / steps_per_mm
    return points[checker.generic(points)]


@pytest.mark.parametrize("seed", range(100))
def test_generated_solids_are_closed_and_consistently_oriented(seed):
    part = generated_solid(seed)
    check_part(part)
    assert all(np.gcd.reduce(normal) == 1 for normal, _ in checker_of(part).planes)


@pytest.mark.parametrize("seed", range(5))
def test_contains_agrees_with_the_boxes_a_solid_was_made_of(seed):
    rng = np.random.default_rng(seed)
    part = None
    found = 0
    while part is None:
        full = rng.random((4, 3, 3)) < 0.6
        part = cell_solid(full, [range(0, 10, 2)[: n + 1] for n in full.shape])
    centres = np.array(list(product(*(range(1, 2 * n, 2) for n in full.shape))), dtype=float)
    found = checker_of(part).contains(centres).reshape(full.shape)
    np.testing.assert_array_equal(found, full)


def test_convex_solid_shows_an_edge_exactly_from_in_front_of_one_of_its_faces():
    checker = checker_of(CUBE, 8)
    rng = np.random.default_rng(0)
    points = viewpoints(rng, CUBE, checker, 500, steps_per_mm=8)
    outside = ((points < 0) | (points > 2)).any(axis=1)
    edges = CUBE.edges()
    seen = checker.observable(points[outside], edges)
    front = np.stack([points[outside] @ np.array(n) * 8 > d for n, d in checker.planes], axis=1)
    expected = np.stack([front[:, list(checker.edge_faces[e])].any(axis=1) for e in edges], axis=1)
    np.testing.assert_array_equal(seen, expected)


@pytest.mark.parametrize(
    ("viewpoint", "seen"),
    [
        ((5.5, 7.5, 3.5), True),  # straight down the slot
        ((4.5, 9.5, 11.5), True),  # down the slot, beyond the end of the part
        (
            (3.5, 9.5, 3.5),
            True,
        ),  # over the near wall: the line from the floor edge (6, 2) passes (4, 3) at x = 4.67
        ((2.5, 3.5, 3.5), False),  # too low: the near wall's top corner (4, 3) is in the way
        ((12.5, 3.5, 3.5), False),  # behind the far wall
        ((5.5, -2.5, 3.5), False),  # from below
    ],
)
def test_edge_at_the_far_side_of_the_slot_floor(viewpoint, seen):
    edge = SLOTTED_BLOCK.edge_between((6, 2, 0), (6, 2, 6))
    assert checker_of(SLOTTED_BLOCK, 2).observable([viewpoint], [edge]) == seen


def test_partly_hidden_edge_is_not_observable():
    pocket = block_with_pocket([(-2, -2), (2, -2), (2, 2), (-2, 2)], 5, 6, 4)
    floor_edge = pocket.edge_between((-2, -2, 2), (-2, 2, 2))
    # From the floor edge (-2, ., 2) the rim (2, ., 6) is passed at slope 1: at x = 6.5 that is z = 10.5.
    points = [(6.5, 0.5, 10.0), (6.5, 0.5, 11.0), (6.5, 0.5, 10.5)]
    np.testing.assert_array_equal(
        checker_of(pocket, 2).observable(points, [floor_edge])[:, 0], [False, True, True]
    )


def test_sight_triangle_may_graze_a_convex_edge_but_not_run_through_a_re_entrant_one():
    # A tread at y = 1 from x = 0 to 5, then a wall up to y = 2; everything runs along z.
    part = prism([(0, 0), (6, 0), (6, 2), (5, 2), (5, 1), (0, 1)], 3)
    lower, wall, corner = (
        part.edge_between((x, y, 0), (x, y, 3)) for x, y in [(0, 1), (5, 2), (5, 1)]
    )
    checker = checker_of(part, 2)
    # On the line from (0, 1) over (5, 2), slope 1/5: beyond (5, 2) the line runs free above the wall's top.
    np.testing.assert_array_equal(
        checker.observable([(10, 3, 1.5), (10, 2.5, 1.5)], [lower])[:, 0], [True, False]
    )
    # From the left, below the tread: its own end is free; the line to (5, 2) passes x = 0 at y = 1.25 or 0.25.
    assert checker.observable([(-5.0, 0.5, 1.5)], [lower])
    np.testing.assert_array_equal(
        checker.observable([(-5, 0.5, 1.5), (-5, -1.5, 1.5)], [wall])[:, 0], [True, False]
    )
    # From below, the part itself is in the way of its top; the re-entrant edge is free from above.
    far = part.edge_between((6, 2, 0), (6, 2, 3))
    assert not checker.observable([(3.0, -1.0, 1.5)], [far])
    assert checker.observable([(3.0, 3.5, 1.5)], [corner])


def test_inside_is_not_observable():
    assert not checker_of(L_BLOCK, 4).observable([(0.75, 1.25, 1.25)], L_BLOCK.edges()).any()


PARTS = [L_BLOCK, SLOTTED_BLOCK, TWO_POCKET_BLOCK, *(generated_solid(seed) for seed in range(40))]


@pytest.mark.parametrize("part", PARTS, ids=[part.name for part in PARTS])
def test_agrees_with_cutting_the_section(part):
    rng = np.random.default_rng(1)
    checker = checker_of(part, 2)
    points = viewpoints(rng, part, checker, 12)
    edges = [part.edges()[i] for i in rng.permutation(len(part.edges()))[:4]]
    seen = checker.observable(points, edges)
    slow = [
        [observable_by_section(checker, tuple(v), *e) for e in edges]
        for v in (points * 2).astype(int).tolist()
    ]
    np.testing.assert_array_equal(seen, slow)


def in_plane_viewpoints(rng, part, a, b, n):
    """Return points in planes through ab and another edge that is coplanar with ab."""
    vertices = np.array(part.vertices)
    found = []
    for i, j in part.edges():
        frame = vertices[[b, i, j]] - vertices[a]
        if round(np.linalg.det(frame)) == 0 and np.linalg.matrix_rank(frame) == 2:
            steps = rng.integers(-8, 9, (n, 2)) / 2
            found.extend(
                vertices[a]
                + steps[:, :1] * (vertices[b] - vertices[a])
                + steps[:, 1:] * (vertices[i] - vertices[a])
            )
    return np.array(found).reshape(-1, 3)


@pytest.mark.parametrize("part", PARTS[::2], ids=[part.name for part in PARTS[::2]])
def test_agrees_with_cutting_the_section_in_planes_through_two_edges(part):
    rng = np.random.default_rng(2)
    checker = checker_of(part, 2)
    for a, b in [part.edges()[i] for i in rng.permutation(len(part.edges()))[:4]]:
        points = in_plane_viewpoints(rng, part, a, b, 2)
        points = points[checker.generic(points)][:10]
        seen = checker.observable(points, [(a, b)])[:, 0]
        slow = [
            observable_by_section(checker, tuple(v), a, b)
            for v in (points * 2).astype(int).tolist()
        ]
        assert seen.tolist() == slow


def test_answers_do_not_depend_on_the_width_of_integers():
    rng = np.random.default_rng(3)
    points = viewpoints(rng, TWO_POCKET_BLOCK, checker_of(TWO_POCKET_BLOCK, 2), 100)
    narrow, wide = (checker_of(TWO_POCKET_BLOCK, steps) for steps in (2, 2**40))
    assert narrow._exact_array([[0, 0, 0]]).dtype == np.int64
    assert wide._exact_array([[0, 0, 0]]).dtype == object
    edges = TWO_POCKET_BLOCK.edges()
    np.testing.assert_array_equal(narrow.observable(points, edges), wide.observable(points, edges))


def test_viewpoint_on_a_face_plane_is_refused():
    with pytest.raises(ValueError, match="viewpoints must lie on no face plane"):
        checker_of(CUBE).observable([(5, 5, 2)], CUBE.edges())


def test_point_off_the_grid_is_refused():
    with pytest.raises(ValueError, match="multiples of 1/4 mm"):
        checker_of(CUBE, 4).generic([(0.1, 0, 0)])


def test_face_out_of_plane_is_refused():
    vertices = [*CUBE.vertices[:-1], (0, 2, 3)]
    with pytest.raises(ValueError, match="face 1 must be exactly planar"):
        ExactChecker(vertices, CUBE.faces)


def test_face_with_the_wrong_orientation_is_refused():
    faces = [(tuple(reversed(CUBE.faces[0][0])), ()), *CUBE.faces[1:]]
    with pytest.raises(ValueError, match="traversed once in each direction"):
        ExactChecker(CUBE.vertices, faces)


def test_edges_pair_up_on_every_known_solid():
    for part in (CUBE, L_BLOCK, SLOTTED_BLOCK, TWO_POCKET_BLOCK):
        directed = [
            e
            for outer, holes in part.faces
            for loop in (outer, *holes)
            for e in pairwise((*loop, loop[0]))
        ]
        assert len(part.edges()) * 2 == len(directed)
        assert (
            len(part.vertices)
            - len(part.edges())
            + len(part.faces)
            - sum(len(h) for _, h in part.faces)
            == 2
        )
