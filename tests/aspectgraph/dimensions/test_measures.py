"""Features and measures on solids made by hand, with the values and the best entities known in advance."""

from __future__ import annotations

import numpy as np
import pytest
from solids import plain_box

from aspectgraph import Solid
from aspectgraph.dimensions.features import Attachments, Axis, Measurer, Plane, Sight

N = 12


@pytest.fixture(scope="module")
def box():
    return plain_box((40, 30, 20))


@pytest.fixture(scope="module")
def prism():
    """Twelve sides around the z axis, from z = 0 to 5: its rims stand for circles of radius 10."""
    turn = 2.0 * np.pi * np.arange(N) / N
    ring = np.column_stack([10.0 * np.cos(turn), 10.0 * np.sin(turn)])
    corners = [*([x, y, 0.0] for x, y in ring), *([x, y, 5.0] for x, y in ring)]
    sides = [(i, (i + 1) % N, (i + 1) % N + N, i + N) for i in range(N)]
    return Solid(corners, [tuple(range(N))[::-1], tuple(range(N, 2 * N)), *sides], name="prism")


def tools(solid):
    attachments = Attachments(solid)
    return attachments, Measurer(attachments, Sight(solid))


def plane(solid, face):
    """A face of a solid as the kernel describes it."""
    corners = solid.vertices[list(solid.faces[face].outer)]
    lines = [
        {"kind": "line", "ends": [list(p), list(q)]}
        for p, q in zip(corners, np.roll(corners, -1, 0), strict=True)
    ]
    return {
        "kind": "plane",
        "point": list(corners[0]),
        "axis": list(solid.normals[face]),
        "edges": lines,
    }


def circle(z, radius=10.0, x=0.0):
    return {"kind": "circle", "point": [x, 0.0, z], "axis": [0.0, 0.0, 1.0], "radius": radius}


def on(solid, way):
    """Ids of the faces that all edges of a pair bound."""
    return set.intersection(*(set(solid.edges[i].faces) for i in way))


def test_a_plane_has_the_edges_around_its_face(box):
    (found,) = tools(box)[0].features([plane(box, 0), plane(box, 0)])
    assert isinstance(found, Plane)
    assert set(found.edges) == {edge.id for edge in box.edges if 0 in edge.faces}


def test_between_opposite_faces_edges_of_one_face_come_first(box):
    """x = 0 and x = 40: the edges of length 30 are longer than those of 20, and those of one face lie in one plane."""
    attachments, measurer = tools(box)
    one, other = attachments.features([plane(box, 0), plane(box, 1)])
    found = measurer.between(one, other)
    assert (found.kind, found.values, found.reason) == ("distance", (40.0,), "")
    assert found.direction == pytest.approx([-1, 0, 0])
    (ways,) = found.ways
    # of the four edges on each side each is parallel to two of the other side
    assert len(ways) == 8
    shared = [bool(on(box, way)) for way in ways]
    assert shared == [True] * 4 + [False] * 4
    assert [box.edge_length_mm(way[0]) for way in ways[:4]] == [30.0, 30.0, 20.0, 20.0]


def test_the_angle_of_a_corner_is_between_edges_across_its_fold(box):
    """x = 0 and y = 0 meet along z; edges across it: two of each face, and every pair of them is at 90 degrees."""
    attachments, measurer = tools(box)
    found = measurer.angle(*attachments.features([plane(box, 0), plane(box, 2)]))
    assert found.values == pytest.approx((90.0, 90.0))
    (ways,) = found.ways
    assert len(ways) == 4
    # best: both in the bottom or both in the top
    assert all(on(box, way) for way in ways[:2])


@pytest.mark.parametrize(
    ("faces", "reason"),
    [((0, 2), "are not parallel"), ((0, 0), "the same plane")],
)
def test_what_has_no_distance_says_why(box, faces, reason):
    attachments, measurer = tools(box)
    one, other = (attachments.features([plane(box, face)])[0] for face in faces)
    found = measurer.between(one, other)
    assert reason in found.reason
    assert not any(found.ways)


def test_parallel_faces_have_no_angle(box):
    attachments, measurer = tools(box)
    found = measurer.angle(*attachments.features([plane(box, 0), plane(box, 1)]))
    assert found.reason == "the two features it is attached to are parallel"


def test_edges_that_are_not_there_are_a_reason(box):
    attachments, measurer = tools(box)
    bare = {**plane(box, 0), "edges": []}
    one, other = attachments.features([bare, plane(box, 1)])
    found = measurer.between(one, other)
    assert (found.values, found.ways) == ((40.0,), ((),))
    assert found.reason == "no two parallel sharp straight edges bound what it is attached to"


def test_the_diameter_of_a_cylinder_is_that_of_both_its_rims(prism):
    attachments, measurer = tools(prism)
    cylinder = {
        **circle(2.0),
        "kind": "cylinder",
        "edges": [circle(0.0), circle(5.0), circle(5.0, radius=3.0)],
    }
    (axis,) = attachments.features([cylinder, circle(0.0)])
    assert isinstance(axis, Axis)
    found = measurer.size("diameter", [axis])
    assert (found.values, found.reason) == ((20.0,), "")
    assert sorted(found.ways[0]) == [("r0",), ("r1",)]
    assert measurer.size("radius", [axis]).values == (10.0,)


def test_circles_of_two_radii_are_a_pattern_of_which_one_has_no_rim(prism):
    attachments, measurer = tools(prism)
    found = measurer.size("diameter", attachments.features([circle(0.0, radius=3.0), circle(5.0)]))
    assert found.values == (6.0, 20.0)
    assert [len(ways) for ways in found.ways] == [0, 1]
    assert measurer.size("diameter", []).reason == "it is attached to no cylinder and no circle"


def test_two_features_on_one_axis_have_no_centre_distance(prism):
    attachments, measurer = tools(prism)
    one, other = attachments.features([circle(0.0, radius=3.0), circle(5.0)])
    assert measurer.between(one, other).reason == "both of its ends are attached to the same axis"
    one, other = attachments.features([circle(0.0, x=7.0), circle(5.0)])
    found = measurer.between(one, other)
    assert (found.kind, found.values) == ("centre_distance", (7.0,))
    assert found.reason == "no sharp circular edge is around one of its axes"


def test_centre_and_edge_out_of_one_plane_are_noted(prism):
    """The circle at z = 0 and an edge at z = 5, 10 cos 15° from the axis, or one beside it at z = 0."""
    attachments, measurer = tools(prism)
    side = next(face for face in range(2, N + 2))
    (wall,) = attachments.features([plane(prism, side)])
    (axis,) = attachments.features([circle(0.0)])
    found = measurer.between(wall, axis)
    assert found.kind == "centre_to_edge"
    assert found.values == pytest.approx((10.0 * np.cos(np.pi / N),))
    (ways,) = found.ways
    heights = [prism.edge_points(edge)[0, 2] for _, edge in ways]
    assert sorted(heights) == [0.0, 5.0]
    first = "its entities lie 5 mm apart along the axis; it is measured along its direction"
    assert found.note == (first if heights[0] == 5.0 else "")
