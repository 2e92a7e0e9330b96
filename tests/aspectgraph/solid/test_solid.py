"""What a Solid promises, and what it refuses."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import (
    FaceBuilder,
    add_prism,
    box_with_pockets,
    cube,
    hollow_box,
    l_block,
    plate,
    prism,
    prism_faces,
    ring,
    slotted_block,
    two_boxes,
    two_pocket_block,
)

from aspectgraph import (
    Face,
    NonManifoldError,
    OpenSolidError,
    OrientationError,
    PlanarityError,
    SelfIntersectionError,
    Solid,
    SolidError,
    TouchingError,
    read_solid,
)
from aspectgraph.solid.checks import face_area_vectors
from aspectgraph.solid.solid import RayScene
from aspectgraph.solid.topology import (
    FaceLoops,
    check_fans,
    faces_of,
    newell_area_vector,
    pair_edges,
)

SQUARE = [(0, 0), (2, 0), (2, 2), (0, 2)]

# name, maker, vertices, edges, faces, volume, shells; Euler: v - e + f = 2 (shells) + holes in faces - 2 (handles)
KNOWN = [
    (cube, 8, 12, 6, 8.0, 1),
    (l_block, 12, 18, 8, 8.0, 1),
    (slotted_block, 24, 36, 14, 120.0, 1),
    (two_pocket_block, 24, 36, 16, 6 * 6 * 4 - 8.0, 1),
    (lambda: plate(5), 208, 312, 131, 16 * 16 * 3 - 25 * 8.0, 1),
    (two_boxes, 16, 24, 12, 16.0, 2),
    (hollow_box, 16, 24, 12, 64.0 - 8.0, 2),
]


def cube_parts():
    solid = cube()
    return solid.vertices.copy(), [face.outer for face in solid.faces]


@pytest.mark.parametrize(("make", "n_vertices", "n_edges", "n_faces", "volume", "n_shells"), KNOWN)
def test_known_solids(make, n_vertices, n_edges, n_faces, volume, n_shells):
    solid = make()
    assert (len(solid.vertices), len(solid.edges), len(solid.faces)) == (
        n_vertices,
        n_edges,
        n_faces,
    )
    assert solid.volume == pytest.approx(volume, rel=1e-12)
    assert solid.n_shells == n_shells
    assert len(solid.straight_edges()) == n_edges


@pytest.mark.parametrize("make", [row[0] for row in KNOWN])
def test_edges_are_numbered_and_traversed_forwards_then_backwards(make):
    solid = make()
    for i, edge in enumerate(solid.edges):
        assert edge.id == i
        assert edge.vertices in set(solid.faces[edge.faces[0]].directed_edges())
        assert edge.vertices[::-1] in set(solid.faces[edge.faces[1]].directed_edges())


@pytest.mark.parametrize("make", [row[0] for row in KNOWN])
def test_triangles_cover_each_face_once_and_meet_edge_to_edge(make):
    solid = make()
    for face, triangles, normal in zip(
        solid.faces, solid.face_triangles, solid.normals, strict=True
    ):
        corners = solid.vertices[triangles]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ normal
        assert (doubled > 0).all()
        assert set(triangles.ravel()) == {v for loop in face.loops for v in loop}
        sides = [
            tuple(side) for t in triangles.tolist() for side in zip(t, [*t[1:], t[0]], strict=True)
        ]
        assert len(set(sides)) == len(sides)
        rim = {side for side in sides if side[::-1] not in sides}
        assert rim == set(face.directed_edges())


def test_dihedral_is_positive_where_convex_and_negative_where_re_entrant():
    turns = {
        tuple(sorted(map(tuple, l_block().edge_points(e.id)))): e.dihedral_deg
        for e in l_block().edges
    }
    assert turns[(1.0, 1.0, 0.0), (1.0, 1.0, 2.0)] == pytest.approx(-90.0)
    assert sorted(turns.values())[1:] == pytest.approx([90.0] * 17)


def test_dihedral_of_a_shallow_roof():
    roof = prism([(0, 0), (4, 0), (4, 1), (2, 1 + 2 * np.tan(np.radians(3))), (0, 1)], 1)
    shallow = [edge for edge in roof.edges if edge.dihedral_deg == pytest.approx(6.0)]
    assert len(shallow) == 1
    assert shallow[0] in roof.straight_edges()
    assert shallow[0] not in roof.straight_edges(min_dihedral_deg=7.0)
    assert len(roof.straight_edges(min_length_mm=1.5)) == 2 * 3


def test_curved_edges_are_no_candidates():
    vertices, faces = cube_parts()
    a = faces[0][0]
    b = faces[0][1]
    solid = Solid(vertices, faces, curved_edges=[(b, a)])
    assert [edge.vertices for edge in solid.edges if edge.curved] == [(a, b)]
    assert len(solid.straight_edges()) == 11
    with pytest.raises(SolidError, match=r"curved_edges must name edges. Got vertices \(0, 99\)"):
        Solid(vertices, faces, curved_edges=[(99, 0)])
    with pytest.raises(SolidError, match=rf"must name edges. Got vertices \(0, {10**30}\)"):
        Solid(vertices, faces, curved_edges=[(10**30, 0)])
    for pair in ((a, b + 0.5), (a, b, a), (a,), ("a", "b"), (a, True)):
        message = rf"must be pairs of integer vertex indices. Got {re.escape(str(pair))}\."
        with pytest.raises(SolidError, match=f"curved_edges {message}"):
            Solid(vertices, faces, curved_edges=[pair])
        with pytest.raises(SolidError, match=f"surface_turns {message}"):
            Solid(vertices, faces, surface_turns={pair: 3.0})
    with pytest.raises(SolidError, match="curved_edges must be pairs"):
        Solid(vertices, faces, curved_edges=np.array([[a, b, a], [b, a, b]]))


def test_turns_of_the_surfaces_decide_what_is_sharp():
    vertices, faces = cube_parts()
    a = faces[0][0]
    b = faces[0][1]
    solid = Solid(vertices, faces, surface_turns={(b, a): 20.0})
    edge = next(edge for edge in solid.edges if set(edge.vertices) == {a, b})
    assert (edge.dihedral_deg, edge.turn_deg) == (pytest.approx(90.0), 20.0)
    assert [one.turn_deg for one in solid.edges if one is not edge] == pytest.approx([90.0] * 11)
    assert edge in solid.straight_edges(min_dihedral_deg=20.0)
    assert edge not in solid.straight_edges(min_dihedral_deg=21.0)
    with pytest.raises(SolidError, match=r"surface_turns must name edges. Got vertices \(0, 99\)"):
        Solid(vertices, faces, surface_turns={(99, 0): 20.0})
    with pytest.raises(SolidError, match=r"surface_turns must be in 0..180 degrees. Got 190"):
        Solid(vertices, faces, surface_turns={(b, a): 190.0})


def test_collinear_vertices_are_kept_and_used():
    builder = prism_faces([(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)], 2.0)
    solid = builder.solid("split")
    assert len(solid.edges) == 15
    assert solid.volume == pytest.approx(8.0)
    assert len(solid.straight_edges()) == 14, "the edge between the two coplanar faces is none"


def test_a_face_may_touch_itself_in_a_vertex():
    # A pocket and a boss on the top whose corners meet: one fan of faces, the top face twice in it.
    builder = FaceBuilder()
    builder.add([(0, 0, 0), (0, 6, 0), (6, 6, 0), (6, 0, 0)])
    for (x0, y0), (x1, y1) in zip(
        [(0, 0), (6, 0), (6, 6), (0, 6)], [(6, 0), (6, 6), (0, 6), (0, 0)], strict=True
    ):
        builder.add([(x0, y0, 0), (x1, y1, 0), (x1, y1, 4), (x0, y0, 4)])
    pocket = [(1, 1), (3, 1), (3, 3), (1, 3)]
    boss = [(3, 3), (5, 3), (5, 5), (3, 5)]
    rims = [[(x, y, 4) for x, y in reversed(loop)] for loop in (pocket, boss)]
    builder.add([(0, 0, 4), (6, 0, 4), (6, 6, 4), (0, 6, 4)], rims)
    for loop, z in ((pocket, 3), (boss, 5)):
        builder.add([(x, y, z) for x, y in loop])
        for (x0, y0), (x1, y1) in zip(loop, [*loop[1:], loop[0]], strict=True):
            wall = [(x0, y0, 4), (x1, y1, 4), (x1, y1, z), (x0, y0, z)]
            builder.add(wall)
    solid = builder.solid("touching rims")
    assert solid.volume == pytest.approx(6 * 6 * 4 - 4 + 4)


def test_a_hole_may_touch_the_outer_loop_in_a_vertex():
    # The corner of a tapered pocket meets a straight edge of the top in its middle: one fan of faces.
    builder = FaceBuilder()
    builder.add([(0, 0, 0), (0, 4, 0), (4, 4, 0), (4, 0, 0)])
    builder.add([(0, 0, 0), (4, 0, 0), (4, 0, 3), (2, 0, 3), (0, 0, 3)])
    for (x0, y0), (x1, y1) in [((4, 0), (4, 4)), ((4, 4), (0, 4)), ((0, 4), (0, 0))]:
        builder.add([(x0, y0, 0), (x1, y1, 0), (x1, y1, 3), (x0, y0, 3)])
    rim = [(2, 0, 3), (1, 2, 3), (3, 2, 3)]
    tip = (2, 1, 1.5)
    builder.add([(0, 0, 3), (2, 0, 3), (4, 0, 3), (4, 4, 3), (0, 4, 3)], [rim])
    for start, end in zip(rim, [*rim[1:], rim[0]], strict=True):
        builder.add([end, start, tip])
    solid = builder.solid("touching the rim")
    # a pyramid with a base of 2 mm² and a height of 1.5 mm is missing
    assert solid.volume == pytest.approx(4 * 4 * 3 - 2 * 1.5 / 3)
    assert len(solid.straight_edges()) == 12 + 1 + 6, "the edge of the top is two"


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(1e-3, 1e3))
def test_moved_and_scaled_solids_stay_valid(seed, scale):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes[0] *= np.sign(np.linalg.det(axes))
    original = two_pocket_block()
    moved = Solid(scale * (original.vertices @ axes.T + rng.normal(size=3)), original.faces)
    assert moved.volume == pytest.approx(scale**3 * original.volume)
    assert [e.vertices for e in moved.edges] == [e.vertices for e in original.edges]
    assert [e.dihedral_deg for e in moved.edges] == pytest.approx(
        [e.dihedral_deg for e in original.edges]
    )


def test_arrays_are_read_only_and_solids_can_be_pickled():
    solid = two_pocket_block()
    with pytest.raises(ValueError, match="read-only"):
        solid.vertices[0, 0] = 1.0
    twin = pickle.loads(pickle.dumps(solid))
    assert twin.edges == solid.edges
    assert (twin.triangles == solid.triangles).all()


@pytest.mark.parametrize("edge_id", [12, -1, True, 1.0])
def test_an_edge_that_a_solid_lacks(edge_id):
    for asked in (cube().edge_points, cube().edge_length_mm, cube().edge_ends):
        with pytest.raises(SolidError, match=rf"one of the solid's, 0\.\.11\. Got {edge_id}"):
            asked(edge_id)


@pytest.mark.parametrize(
    ("value", "rule"),
    [(np.nan, "must be finite"), (np.inf, "must be finite"), (1e61, "below 1e60 mm")],
)
def test_bad_coordinates(value, rule):
    vertices, faces = cube_parts()
    vertices[3, 1] = value
    with pytest.raises(SolidError, match=rule):
        Solid(vertices, faces)


@pytest.mark.parametrize(
    ("loop", "rule"),
    [
        ((0, 1, 99), "indices must be in 0..7"),
        ((0, 1, -1), "indices must be in 0..7"),
        ((0, 1), "at least 3 vertices"),
        ((0, 1, 1), "all distinct"),
        ((0, 1, 2.5), "integer vertex indices"),
    ],
)
def test_bad_loops(loop, rule):
    vertices, faces = cube_parts()
    with pytest.raises(SolidError, match=rule):
        Solid(vertices, [loop, *faces[1:]])


def test_wrong_shape_and_too_few_faces():
    vertices, faces = cube_parts()
    with pytest.raises(SolidError, match=re.escape("vertices must have shape (n, 3)")):
        Solid(vertices[:, :2], faces)
    with pytest.raises(SolidError, match="at least 4 faces"):
        Solid(vertices, faces[:3])
    with pytest.raises(SolidError, match="planarity_mm must be positive"):
        Solid(vertices, faces, planarity_mm=0.0)


def test_an_open_surface_names_an_edge():
    vertices, faces = cube_parts()
    with pytest.raises(
        OpenSolidError, match=r"edge from \(0, 0, 2\) to \(0, 0, 0\) .* \(4 such edges\)"
    ):
        Solid(vertices, faces[1:])


def test_a_reversed_face_names_an_edge():
    vertices, faces = cube_parts()
    with pytest.raises(OrientationError, match="opposite directions along an edge"):
        Solid(vertices, [faces[0][::-1], *faces[1:]])


def test_an_inside_out_solid_is_refused():
    vertices, faces = cube_parts()
    with pytest.raises(
        OrientationError, match=r"counter-clockwise seen from outside. Got a shell of volume -8 mm³"
    ):
        Solid(vertices, [face[::-1] for face in faces])


def test_equal_vertices_are_refused():
    vertices, faces = cube_parts()
    doubled = [tuple(v + 8 for v in face) if i == 0 else face for i, face in enumerate(faces)]
    with pytest.raises(SolidError, match=r"one face only|distinct points"):
        Solid(np.vstack([vertices, vertices]), doubled)


def test_a_warped_face_is_refused_unless_allowed():
    vertices, faces = cube_parts()
    top = int(np.flatnonzero((vertices == 2).all(axis=1))[0])
    vertices[top] += 1e-3
    with pytest.raises(PlanarityError, match=r"planar within 3\.47e-06 mm"):
        Solid(vertices, faces)
    assert Solid(vertices, faces, planarity_mm=1e-2).volume == pytest.approx(8.0, abs=0.02)


def test_a_face_without_area_is_refused():
    builder = prism_faces([(0, 0), (2, 0), (2, 2), (1, 1), (0, 0.0)][:3], 1.0)
    vertices = [*builder.index, (1.0, 0.0, 0.0)]
    (bottom, _), *rest = builder.faces
    a = builder.index[0.0, 0.0, 0.0]
    b = builder.index[2.0, 0.0, 0.0]
    middle = len(vertices) - 1
    at = bottom.index(b)
    wide = (
        [*bottom[: at + 1], middle, *bottom[at + 1 :]]
        if bottom[(at + 1) % 3] == a
        else [middle, *bottom]
    )
    with pytest.raises(SolidError, match="area above zero"):
        Solid(vertices, [wide, (b, a, middle), *rest])


def test_crossing_loops_are_refused():
    builder = FaceBuilder()
    add_prism(builder, SQUARE, 2.0)
    outer, _ = builder.faces[1]
    hole = builder.loop([(1, 1, 2), (1, 3, 2), (1.5, 1, 2)])
    apex = builder.loop([(1.2, 1.5, 0.5)])[0]
    builder.faces[1] = (outer, [hole])
    rim = zip(hole, [*hole[1:], hole[0]], strict=True)
    walls = [((b, a, apex), []) for a, b in rim]
    with pytest.raises(SolidError, match="loops of a face must not cross"):
        Solid(list(builder.index), builder.faces + walls)


def test_solids_that_share_an_edge_a_vertex_or_a_face():
    def pair(corner):
        builder = FaceBuilder()
        add_prism(builder, SQUARE, 2.0)
        x, y, z = corner
        add_prism(builder, [(px + x, py + y) for px, py in SQUARE], 2.0, base=z)
        return builder.solid("pair")

    with pytest.raises(NonManifoldError, match=r"exactly two faces. Got 4 at the edge"):
        pair((2, 2, 0))
    with pytest.raises(NonManifoldError, match=r"one fan. Got more at \(2, 2, 2\)"):
        pair((2, 2, 2))
    with pytest.raises(NonManifoldError, match="touch along an edge or a face"):
        pair((2, 0, 0))


@pytest.mark.parametrize(
    ("corner", "error", "rule"),
    [
        ((2, 0.5, 0.5), TouchingError, "solids must not touch"),
        ((2, 2, 1), TouchingError, "solids must not touch"),
        ((1, 1, 1), SelfIntersectionError, "solids must not overlap"),
        ((0.5, 0.5, 1), SelfIntersectionError, "solids must not overlap"),
        ((2 - 1e-6, 0.5, 0.5), SelfIntersectionError, "solids must not overlap"),
        ((2 + 1e-12, 0.5, 0.5), TouchingError, "solids must not touch"),
    ],
)
def test_solids_in_contact(corner, error, rule):
    builder = FaceBuilder()
    add_prism(builder, SQUARE, 2.0)
    x, y, z = corner
    add_prism(builder, [(px + x, py + y) for px, py in SQUARE], 2.0, base=z)
    with pytest.raises(error, match=rule) as caught:
        builder.solid("pair")
    assert caught.type is error


@pytest.mark.parametrize("edges_at_once", [1, 5])
def test_contacts_are_the_same_however_many_edges_are_taken_at_once(monkeypatch, edges_at_once):
    def message():
        builder = FaceBuilder()
        add_prism(builder, SQUARE, 2.0)
        add_prism(builder, [(x + 1.0, y + 1.0) for x, y in SQUARE], 2.0, base=1.0)
        with pytest.raises(SelfIntersectionError) as caught:
            builder.solid("pair")
        return str(caught.value)

    whole = message()
    assert "such pairs" in whole
    monkeypatch.setattr("aspectgraph.solid.checks._EDGES_AT_ONCE", edges_at_once)
    assert message() == whole


def test_solids_a_micron_apart_are_legal():
    assert two_boxes(gap=1e-3).n_shells == 2


def test_a_solid_inside_the_material_of_another():
    builder = FaceBuilder()
    add_prism(builder, [(0, 0), (4, 0), (4, 4), (0, 4)], 4.0)
    add_prism(builder, [(1, 1), (3, 1), (3, 3), (1, 3)], 2.0, base=1.0)
    with pytest.raises(SelfIntersectionError, match="inside the material of another"):
        builder.solid("nested")


def test_a_solid_inside_a_void_is_legal():
    hollow = hollow_box()
    inner = box_with_pockets((1, 1, 1))
    vertices = np.vstack([hollow.vertices, inner.vertices + 1.5])
    shifted = [Face(tuple(v + 16 for v in face.outer)) for face in inner.faces]
    assert Solid(vertices, [*hollow.faces, *shifted]).volume == pytest.approx(57.0)


def test_a_surface_that_crosses_itself():
    # A Z-shaped profile pushed through itself.
    profile = [(0, 0), (4, 0), (4, 3), (1, 3), (1, 2), (3, 2), (3, 1), (0, 1)]
    assert prism(profile, 1).volume == pytest.approx(4 + 2 * 1 + 3 * 1 - 1)
    vertices = prism(profile, 1).vertices.copy()
    dented = vertices[:, 1] == 2
    vertices[dented, 1] = 0.5
    with pytest.raises(SolidError, match="cross"):
        Solid(vertices, prism(profile, 1).faces)


def test_a_spike_through_the_opposite_face():
    base = box_with_pockets((6, 6, 2), [(2, 2, 4, 2, 4, 1)])
    vertices = base.vertices.copy()
    floor = np.isclose(vertices[:, 2], 1.0)
    vertices[floor, 2] = -1.0
    with pytest.raises(SelfIntersectionError, match="the surface must not cross itself"):
        Solid(vertices, base.faces)
    vertices[floor, 2] = 0.0
    with pytest.raises(TouchingError, match="no neighbours must not touch"):
        Solid(vertices, base.faces)


def test_polygonal_hole():
    solid = prism(ring(5, 16), 2, [ring(2, 12, clockwise=True)])
    area = 0.5 * 25 * 16 * np.sin(2 * np.pi / 16) - 0.5 * 4 * 12 * np.sin(2 * np.pi / 12)
    assert solid.volume == pytest.approx(2 * area)
    assert len(solid.faces[0].holes) == 1


# The loops of faces as arrays, against the same by hand, and checks that are computed from them.


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


# Rays: what is in the way is what a ray hits first, and known answers on a block.


def test_a_block_is_in_the_way_of_what_is_behind_it():
    block = read_solid("examples/two_pocket_block.off")
    scene = RayScene(block.vertices, block.triangles)
    low, high = block.bounds
    middle = (np.array(low) + high) / 2
    eye = np.array([middle[0], middle[1], high[2] + 100.0])
    behind = middle - [0, 0, 200]
    before = eye - [0, 0, 50]
    beside = eye + np.array([500.0, 0, 0])
    towards = np.array([behind, before, beside]) - eye
    assert scene.blocked(eye, towards).tolist() == [True, False, False]


def test_what_is_blocked_is_hit_on_the_way():
    block = read_solid("examples/two_pocket_block.off")
    scene = RayScene(block.vertices, block.triangles, n_threads=1)
    rng = np.random.default_rng(3)
    low, high = (np.asarray(corner, dtype=float) for corner in block.bounds)
    start = (low + high) / 2 + rng.normal(size=(2000, 3)) * 3 * (high - low)
    towards = rng.uniform(low, high, (2000, 3)) - start
    hit = scene.cast(start, towards)["t_hit"]
    assert 100 < (hit < 0.87).sum() < 1900
    for share in (0.87, 1.0):
        sure = np.abs(hit - share) > 1e-4
        assert np.array_equal(scene.blocked(start, towards, share)[sure], (hit < share)[sure])


@pytest.mark.parametrize("edge_id", ["e5", "e05", np.int64(5)])
def test_an_edge_is_known_by_its_text_too(edge_id):
    solid = cube()
    assert np.array_equal(solid.edge_points(edge_id), solid.edge_points(5))
    assert solid.edge_length_mm(edge_id) == solid.edge_length_mm(5)
    assert solid.edge_ends(edge_id) == solid.edge_ends(5)


@pytest.mark.parametrize("edge_id", ["e12", "e-1", "r0", "", "5", "5.0", True, None])
def test_what_names_no_edge_is_refused(edge_id):
    with pytest.raises(SolidError, match=re.escape(f"0..11. Got {edge_id!r}.")):
        cube().edge_points(edge_id)
