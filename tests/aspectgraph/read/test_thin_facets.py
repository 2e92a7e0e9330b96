"""Facets without area are taken out of a closed mesh, and the shape stays."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from mesh_files import stl_bytes
from scipy.spatial.transform import Rotation

from aspectgraph import read_solid
from aspectgraph.read.mesh import is_closed, turn_thin
from aspectgraph.solid.topology import signed_volume

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
