"""Facets of curved surfaces in meshes are told from faces that were meant flat."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from mesh_files import stl_bytes
from scipy.spatial.transform import Rotation
from solids import box_with_pockets, prism, ring

from aspectgraph import Solid, read_solid
from aspectgraph.read.join_faces import (
    _split_at_repeats,
    drop_idle_vertices,
    find_curved,
    turns_of_runs,
)
from aspectgraph.read.mesh import is_closed, turn_thin
from aspectgraph.solid.topology import FaceLoops, faces_of, signed_volume

SQUARE = [(-10, -10), (10, -10), (10, 10), (-10, 10)]


def candidates(solid: Solid) -> Solid:
    """The solid as the mesh reader would see it."""
    loops = FaceLoops.of(solid.faces)
    curved, chords = find_curved(solid.vertices, loops)
    return Solid(solid.vertices, faces_of(loops, curved.tolist()), curved_edges=chords)


def rounded_square(side, radius, n_per_corner):
    """Square profile with arcs for corners, counter-clockwise."""
    half = side / 2 - radius
    points = []
    for k, (sx, sy) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        angles = np.pi / 2 * (k + np.arange(n_per_corner + 1) / n_per_corner)
        points += [(sx * half + radius * np.cos(a), sy * half + radius * np.sin(a)) for a in angles]
    return points


@pytest.mark.parametrize("n", [12, 16, 24, 48, 96])
def test_a_round_hole_offers_no_edges(n):
    solid = candidates(prism(SQUARE, 5, [ring(4, n, clockwise=True)]))
    assert len(solid.straight_edges()) == 12
    assert sum(face.curved for face in solid.faces) == n


@pytest.mark.parametrize("n", [12, 24, 64])
def test_a_cylinder_offers_no_edges(n):
    assert candidates(prism(ring(4, n), 5)).straight_edges() == ()


@pytest.mark.parametrize("n", [3, 4, 6, 8])
def test_a_prism_with_few_sides_keeps_its_edges(n):
    assert len(candidates(prism(ring(4, n), 5)).straight_edges()) == 3 * n


@pytest.mark.parametrize("n_per_corner", [3, 4, 6, 10])
def test_a_rounded_block_keeps_the_straight_parts_of_its_rims(n_per_corner):
    solid = candidates(prism(rounded_square(20, 3, n_per_corner), 5))
    lengths = sorted(solid.edge_length_mm(edge.id) for edge in solid.straight_edges())
    assert lengths == pytest.approx([14.0] * 8)
    assert sum(face.curved for face in solid.faces) == 4 * n_per_corner


def test_a_slot_between_two_arcs_keeps_its_straight_sides():
    right = [(6 + 2 * np.cos(a), 2 * np.sin(a)) for a in np.linspace(-np.pi / 2, np.pi / 2, 9)]
    slot = right + [(-x, -y) for x, y in right]
    solid = candidates(prism([(-10, -10), (10, -10), (10, 10), (-10, 10)], 5, [slot[::-1]]))
    lengths = sorted(solid.edge_length_mm(edge.id) for edge in solid.straight_edges())
    assert lengths == pytest.approx([5.0] * 4 + [12.0] * 4 + [20.0] * 8)


def test_a_quarter_round_keeps_its_sharp_ends():
    quarter = [(10 * np.cos(a), 10 * np.sin(a)) for a in np.linspace(0, np.pi / 2, 10)]
    solid = candidates(prism([(0, 0), *quarter], 5))
    lengths = sorted(solid.edge_length_mm(edge.id) for edge in solid.straight_edges())
    assert lengths == pytest.approx([5.0] * 3 + [10.0] * 4)


def test_a_shallow_but_sharp_end_of_an_arc_stays():
    # An arc in steps of 5 degrees that meets the top at 20 degrees: 22.5 of its own less half a step.
    angles = np.radians(np.arange(-22.5, 22.6, 5))
    arc = [(20 * np.sin(a), 20 * np.cos(a) - 20 * np.cos(angles[0]) + 5) for a in angles[::-1]]
    solid = candidates(prism([(-20, 0), (20, 0), (20, 5), *arc, (-20, 5)], 10))
    along = [e for e in solid.straight_edges() if np.ptp(solid.edge_points(e.id)[:, 2]) > 0]
    assert sorted(e.dihedral_deg for e in along) == pytest.approx([-20, -20, 90, 90, 90, 90])


def test_strips_cut_into_two_triangles_that_are_not_quite_flat():
    # The top of a tapered tower is turned by one degree against its bottom, so no strip is flat.
    n = 24
    turn = np.radians(1.0)
    lower, upper = (
        np.array([(r * np.cos(a), r * np.sin(a)) for a in 2 * np.pi * np.arange(n) / n])
        for r in (5, 4)
    )
    upper = upper @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    vertices = [*((x, y, 0) for x, y in lower), *((x, y, 9) for x, y in upper)]
    faces = [tuple(range(n))[::-1], tuple(range(n, 2 * n))]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, n + j), (i, n + j, n + i)]
    solid = candidates(Solid(vertices, faces))
    assert 0 < min(abs(e.dihedral_deg) for e in solid.edges) < 1.5
    assert solid.straight_edges(min_dihedral_deg=0.0) == ()


def test_a_bent_sheet_keeps_its_shallow_bends():
    # Bends of 20 degrees between panels of 50 mm: an arc through a panel would stand off by 2 mm.
    turn = np.radians([0, 20, 40])
    path = np.cumsum([[0, 0], *(50 * np.stack([np.cos(turn), np.sin(turn)], axis=1))], axis=0)
    normal = np.array([-np.sin(turn[[0, 0, 1, 2]]), np.cos(turn[[0, 0, 1, 2]])]).T
    profile = [*map(tuple, path), *map(tuple, (path + 2 * normal)[::-1])]
    solid = candidates(prism(profile, 30))
    assert len(solid.straight_edges()) == 3 * len(profile)


def test_chamfers_are_faces():
    solid = candidates(
        prism([(1, 0), (9, 0), (10, 1), (10, 9), (9, 10), (1, 10), (0, 9), (0, 1)], 4)
    )
    assert len(solid.straight_edges()) == 24


def test_flat_parts_are_left_alone():
    solid = box_with_pockets((6, 6, 4), [(2, 1, 3, 1, 3, 2)])
    curved, chords = find_curved(solid.vertices, FaceLoops.of(solid.faces))
    assert not curved.any()
    assert len(chords) == 0


# Boundary cycles, and the vertices on them that say nothing: by hand.


def prism_of(outline):
    """Vertices and loops of an upright prism over a polygon, and the pairs of its vertical edges."""
    n = len(outline)
    vertices = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in outline])
    walls = [[[i, (i + 1) % n, (i + 1) % n + n, i + n]] for i in range(n)]
    return vertices, [[list(range(n))[::-1]], [list(range(n, 2 * n))], *walls]


def test_a_cycle_that_touches_itself_is_cut_there():
    assert _split_at_repeats([0, 1, 2, 3]) == [[0, 1, 2, 3]]
    # an eight, and a flower whose leaves meet in 9
    assert sorted(map(sorted, _split_at_repeats([0, 1, 2, 3, 1, 4]))) == [[0, 1, 4], [1, 2, 3]]
    leaves = _split_at_repeats([9, 1, 2, 9, 3, 4, 9, 5, 6])
    assert sorted(map(sorted, leaves)) == [[1, 2, 9], [3, 4, 9], [5, 6, 9]]
    assert all(len(set(leaf)) == len(leaf) for leaf in leaves)


def test_vertices_of_a_straight_side_between_two_faces_go():
    """A wall whose foot has two vertices more; of the two faces there only the bottom and that wall know them."""
    vertices, loops = prism_of([(0, 0), (3, 0), (3, 3), (0, 3)])
    vertices = np.vstack([vertices, [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])
    loops[0] = [[3, 2, 1, 9, 8, 0]]
    loops[2] = [[0, 8, 9, 1, 5, 4]]
    kept, curved = drop_idle_vertices(vertices, loops, set(), 1e-6)
    assert kept[0] == [[3, 2, 1, 0]]
    assert kept[2] == [[0, 1, 5, 4]]
    assert curved == set()
    # as a run of curved chords, it stays curved
    chords = {(0, 8), (8, 9), (1, 9)}
    kept, curved = drop_idle_vertices(vertices, loops, chords, 1e-6)
    assert (kept[0], curved) == ([[3, 2, 1, 0]], {(0, 1)})
    # and the largest turn along it is that of what stands for it
    turns = turns_of_runs(loops, kept, {(0, 8): 5.0, (8, 9): 7.0, (1, 9): 6.0})
    assert turns == {(0, 1): 7.0}


def test_of_a_bent_run_the_vertex_that_leaves_the_line_stays():
    """Vertices at x = 1, 2, 3 of a side of 4: the middle one is 0.01 mm out, the others nearly in line with it."""
    vertices, loops = prism_of([(0, 0), (4, 0), (4, 4), (0, 4)])
    vertices = np.vstack([vertices, [[1.0, -0.005, 0.0], [2.0, -0.01, 0.0], [3.0, -0.005, 0.0]]])
    loops[0] = [[3, 2, 1, 10, 9, 8, 0]]
    loops[2] = [[0, 8, 9, 10, 1, 5, 4]]
    assert drop_idle_vertices(vertices, loops, set(), 1e-3)[0][0] == [[3, 2, 1, 9, 0]]
    assert drop_idle_vertices(vertices, loops, set(), 0.02)[0][0] == [[3, 2, 1, 0]]


def test_a_cycle_that_would_vanish_keeps_its_vertices():
    """Two faces that share all of a triangle with one corner nearly in line: without it there are two vertices."""
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 1e-9, 0.0], [2.0, 0.0, 0.0]])
    loops = [[[0, 1, 2]], [[2, 1, 0]]]
    kept, _ = drop_idle_vertices(vertices, loops, set(), 1e-6)
    assert kept == loops


# Facets without area are taken out of a closed mesh, and the shape stays.


CORNERS = [(x, y, z) for x in (0, 2) for y in (0, 2) for z in (0, 2)]


def box_with_slivers(shares, order):
    """A box of side 2 whose top has vertices on its front edge that the front face passes by: facets fill the gap.

    `shares` tell where the vertices are on the edge, `order` in which order they are cut off.
    """
    vertices = [*CORNERS, *((2.0 * share, 0.0, 2.0) for share in shares)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    chain = [1, *range(8, 8 + len(shares)), 5]
    triangles += [(a, b, 3) for a, b in pairwise(chain)] + [(5, 7, 3)]
    gap = chain
    for k in order:
        at = gap.index(8 + k)
        triangles.append((gap[at + 1], gap[at], gap[at - 1]))
        gap = [*gap[:at], *gap[at + 1 :]]
    return np.array(vertices, dtype=np.float64), np.array(triangles)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (1, 3, 0, 2), (2, 0, 3, 1)])
def test_turned_facets_leave_the_same_closed_surface(order):
    vertices, triangles = box_with_slivers((0.2, 0.3, 0.65, 0.9), order)
    assert is_closed(triangles)
    notes: list[str] = []
    turned = turn_thin(vertices, triangles, 1e-12, notes)
    assert notes == ["took out 4 facets without area by turning their longest sides"]
    assert is_closed(turned)
    assert set(turned.ravel()) == set(range(12)), "no vertex is lost"
    assert signed_volume(vertices, turned) == pytest.approx(8.0, abs=1e-12)
    sides = vertices[turned][:, 1:] - vertices[turned][:, :1]
    doubled_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    assert doubled_area.sum() == pytest.approx(2 * 24.0), "nothing is folded over"
    assert doubled_area.min() > 0.1


@pytest.mark.parametrize("seed", range(6))
def test_a_turned_mesh_with_facets_without_area_is_the_box_it_was(tmp_path, seed):
    rng = np.random.default_rng(seed)
    vertices, triangles = box_with_slivers(np.sort(rng.uniform(0.05, 0.95, 5)), rng.permutation(5))
    turn = Rotation.random(rng=rng).as_matrix() if seed else np.eye(3)
    path = tmp_path / "box.stl"
    path.write_bytes(stl_bytes((vertices @ turn.T)[triangles]))
    solid = read_solid(path, planarity_mm=1e-3)
    assert (len(solid.vertices), len(solid.edges), len(solid.faces)) == (8, 12, 6)
    assert solid.volume == pytest.approx(8.0, rel=1e-5)
    assert any(note.startswith("took out 5 facets without area") for note in solid.notes)


def test_facets_without_area_on_a_solid_wall_end_as_vertices_of_both_faces(tmp_path):
    # a spike: the middle corner of the facet is the end of another wall, so the edge must stay cut there
    vertices, triangles = box_with_slivers((0.5,), (0,))
    raised = np.vstack([vertices, [(1.0, 1.0, 3.0)]])
    # a ridge from the middle of the front edge: the three facets of the top around corner 3 become a tent
    top = [(1, 8, 9), (8, 5, 9), (5, 7, 9), (7, 3, 9), (3, 1, 9)]
    rest = [row for row in triangles.tolist() if row not in [[1, 8, 3], [8, 5, 3], [5, 7, 3]]]
    path = tmp_path / "tent.stl"
    path.write_bytes(stl_bytes(raised[np.array(rest + top)]))
    solid = read_solid(path)
    # the pyramid on the box has the area of the top, 4, and the height 1
    assert solid.volume == pytest.approx(8.0 + 4.0 / 3.0)
    assert len(solid.faces) == 5 + 4
    assert len(solid.vertices) == 9


def test_a_mesh_without_thin_facets_is_not_touched():
    vertices, triangles = box_with_slivers((), ())
    notes: list[str] = []
    assert turn_thin(vertices, triangles, 1e-9, notes) is triangles
    assert notes == []


def test_a_flat_pillow_is_left_alone():
    # two facets on each other: there is no other side to turn to
    vertices = np.array([(0, 0, 0), (2, 0, 0), (1, 0, 0)], dtype=np.float64)
    triangles = np.array([(0, 1, 2), (1, 0, 2)])
    assert turn_thin(vertices, triangles, 1e-9, []).tolist() == triangles.tolist()
