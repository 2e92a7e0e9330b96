"""Facets of curved surfaces in meshes are told from faces that were meant flat."""

from __future__ import annotations

import numpy as np
import pytest
from solids import box_with_pockets, prism, ring

from aspectgraph import Solid
from aspectgraph.read.join_faces import find_curved
from aspectgraph.solid.topology import FaceLoops, faces_of

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
