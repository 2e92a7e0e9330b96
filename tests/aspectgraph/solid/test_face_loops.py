"""The loops of faces as arrays, against the same by hand, and checks that are computed from them."""

from __future__ import annotations

import numpy as np
import pytest
from solids import box_with_pockets

from aspectgraph import NonManifoldError, OpenSolidError, OrientationError, Solid, SolidError
from aspectgraph.solid.checks import face_area_vectors
from aspectgraph.solid.topology import (
    Face,
    FaceLoops,
    check_fans,
    faces_of,
    newell_area_vector,
    pair_edges,
)

# a triangle, a square with a triangular hole, and a pentagon
FACES = [
    Face((0, 1, 2)),
    Face((3, 4, 5, 6), ((7, 9, 8),)),
    Face((1, 0, 6, 5, 4)),
]
TETRAHEDRON = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def test_half_edges_follow_the_loops():
    loops = FaceLoops.of(FACES)
    by_hand = [pair for face in FACES for pair in face.directed_edges()]
    assert list(zip(loops.start.tolist(), loops.end.tolist(), strict=True)) == by_hand
    assert loops.start[loops.preceding[loops.following]].tolist() == loops.start.tolist()
    assert loops.face.tolist() == [0] * 3 + [1] * 7 + [2] * 5
    assert loops.n_loops.tolist() == [1, 2, 1]
    assert loops.is_triangle.tolist() == [True, False, False]
    assert [loops.loops_of(f) for f in range(3)] == [list(face.loops) for face in FACES]
    assert faces_of(loops, [False] * 3) == FACES
    assert faces_of(loops.only(np.array([False, True, True])), [True, False]) == [
        Face(FACES[1].outer, FACES[1].holes, True),
        FACES[2],
    ]


def test_area_vectors_are_bit_for_bit_those_of_single_loops():
    rng = np.random.default_rng(5)
    vertices = rng.normal(size=(4000, 3))
    sizes = [3, 3, 17, 3, 4, 4, 900, 17, 3, 900]
    cycles = [[rng.permutation(4000)[:k].tolist()] for k in sizes]
    cycles[4].append([5, 6, 7, 8, 9])
    expected = [sum(newell_area_vector(vertices[loop]) for loop in face) for face in cycles]
    areas = face_area_vectors(vertices, FaceLoops.of_cycles(cycles))
    assert areas.tobytes() == np.array(expected).tobytes()


def test_edges_pair_up_in_order_of_first_appearance():
    loops = FaceLoops.of(Solid(CORNERS, TETRAHEDRON).faces)
    edge_vertices, edge_faces = pair_edges(CORNERS, loops)
    assert edge_vertices.tolist() == [[0, 2], [2, 1], [1, 0], [1, 3], [3, 0], [2, 3]]
    assert edge_faces.tolist() == [[0, 3], [0, 2], [0, 1], [1, 2], [1, 3], [2, 3]]
    assert (loops.start[loops.twin] == loops.end).all()


@pytest.mark.parametrize(
    ("faces", "error", "message"),
    [
        (TETRAHEDRON[:3], OpenSolidError, r"one face only at the .*vertices 0 and 2\) \(3 such"),
        (
            [*TETRAHEDRON, (0, 1, 2)],
            NonManifoldError,
            r"Got 3 at the .*vertices 0 and 2\) \(3 such",
        ),
        ([*TETRAHEDRON[:3], (0, 2, 3)], OrientationError, r"the same at the .*vertices 0 and 2\)"),
    ],
)
def test_edges_that_do_not_pair_up_are_named(faces, error, message):
    with pytest.raises(error, match=message):
        pair_edges(CORNERS, [Face(loop) for loop in faces])


def test_the_first_vertex_with_two_fans_is_named():
    """Two tetrahedra that share vertex 3."""
    mirrored = {0: 4, 1: 5, 2: 6, 3: 3}
    second = [tuple(mirrored[v] for v in loop) for loop in TETRAHEDRON]
    vertices = np.vstack([CORNERS, CORNERS[:3] + np.array([0.0, 0.0, 2.0])])
    faces = [Face(loop) for loop in (*TETRAHEDRON, *second)]
    with pytest.raises(NonManifoldError, match=r"form one fan.*\(vertex 3\)"):
        check_fans(vertices, faces)


def test_of_several_wrong_loops_the_first_is_named():
    with pytest.raises(SolidError, match=r"all distinct. Got \(0, 2, 2\) in face 0"):
        Solid(CORNERS, [(0, 2, 2), (0, 1, 9), (1, 2, 3), (2, 0, 3)])
    with pytest.raises(SolidError, match=r"must be in 0\.\.3. Got \(0, 1, 9\) in face 1"):
        Solid(CORNERS, [(0, 2, 1), (0, 1, 9), (1, 2), (2, 0, 3)])


def test_faces_with_holes_are_cut_as_each_alone_would_be():
    solid = box_with_pockets((6, 6, 4), [(2, 1, 3, 1, 3, 2), (2, 4, 5, 4, 5, 1)])
    top = [face for face in solid.faces if face.holes]
    assert len(top) == 1
    assert len(top[0].holes) == 2
    for face, triangles in zip(solid.faces, solid.face_triangles, strict=True):
        corners = sum(map(len, face.loops))
        assert len(triangles) == corners + 2 * len(face.holes) - 2
        assert set(np.unique(triangles).tolist()) == {v for loop in face.loops for v in loop}
