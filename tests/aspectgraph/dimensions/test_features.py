"""Features and measures on solids made by hand, with the values and the best entities known in advance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from solids import plain_box

from aspectgraph import Solid
from aspectgraph.dimensions.features import (
    Attachments,
    Axis,
    Plane,
    Sight,
    StraightLine,
    WaysFinder,
    describe_shape,
)
from aspectgraph.dimensions.read_dimensions import _Reader
from aspectgraph.dimensions.tolerances import Statement

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
    return attachments, WaysFinder(attachments, Sight(solid))


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


# Lines, cones and pairs of axes on solids made by hand, and what rows of a file say of them; all
# known in advance.


PLANE = {"kind": "plane", "point": [0.0, 0.0, 20.0], "axis": [0.0, 0.0, 1.0], "edges": []}
CONE = {"kind": "cone", "point": [0.0, 0.0, 2.0], "axis": [0.0, 0.0, 1.0], "angle_deg": 90.0}
SPHERE = {"kind": "sphere", "point": [0.0, 0.0, 0.0], "radius": 4.0}


@pytest.fixture(scope="module")
def pins():
    """Two prisms of twelve sides from z = 0 to 5, about (0, 0) with radius 10 and about (30, 40) with radius 6."""
    turn = 2.0 * np.pi * np.arange(N) / N
    corners = []
    faces = []
    for x, y, radius in ((0.0, 0.0, 10.0), (30.0, 40.0, 6.0)):
        first = len(corners)
        for z in (0.0, 5.0):
            corners += [[x + radius * np.cos(t), y + radius * np.sin(t), z] for t in turn]
        bottom, top = ([first + k * N + i for i in range(N)] for k in (0, 1))
        faces += [bottom[::-1], top]
        faces += [(bottom[i], bottom[(i + 1) % N], top[(i + 1) % N], top[i]) for i in range(N)]
    return Solid(corners, faces, name="pins")


def line(start, end):
    return {"kind": "line", "ends": [start, end]}


def circle_at(x, y, z, radius, axis=(0.0, 0.0, 1.0)):
    return {"kind": "circle", "point": [x, y, z], "axis": list(axis), "radius": radius}


X_FRONT = line([0, 0, 0], [40, 0, 0])
X_BACK = line([40, 30, 20], [0, 30, 20])
Y_LEFT = line([0, 0, 0], [0, 30, 0])


def test_edges_in_one_line_are_one_feature(box):
    attachments, _ = tools(box)
    half = line([20, 0, 0], [40, 0, 0])
    found, other = attachments.features([X_FRONT, X_BACK, half, X_FRONT])
    assert isinstance(found, StraightLine)
    (edge,) = found.edges
    assert sorted(box.edge_points(edge).tolist()) == X_FRONT["ends"]
    assert sorted(box.edge_points(other.edges[0]).tolist()) == X_BACK["ends"][::-1]


def test_parallel_edges_are_as_far_apart_as_pythagoras_says(box):
    attachments, measurer = tools(box)
    found = measurer.between(*attachments.features([X_FRONT, X_BACK]))
    assert (found.kind, found.reason) == ("distance", "")
    assert found.values == pytest.approx((np.hypot(30.0, 20.0),))
    assert np.abs(found.direction) == pytest.approx(
        np.array([0.0, 30.0, 20.0]) / np.hypot(30.0, 20.0)
    )
    ((way,),) = found.ways
    assert {tuple(sorted(map(tuple, box.edge_points(edge).tolist()))) for edge in way} == {
        ((0.0, 0.0, 0.0), (40.0, 0.0, 0.0)),
        ((0.0, 30.0, 20.0), (40.0, 30.0, 20.0)),
    }
    assert "not parallel" in measurer.between(*attachments.features([X_FRONT, Y_LEFT])).reason


@pytest.mark.parametrize("swapped", [False, True])
def test_an_edge_and_a_plane_beside_it(box, swapped):
    attachments, measurer = tools(box)
    ends = attachments.features([X_FRONT, PLANE])[:: -1 if swapped else 1]
    found = measurer.between(*ends)
    assert found.values == (20.0,)
    # the plane came without edges
    assert found.reason == "no two parallel sharp straight edges bound what it is attached to"
    upright = attachments.features([line([0, 0, 0], [0, 0, 20]), PLANE])
    assert "not parallel" in measurer.between(*upright).reason


def test_the_angle_of_two_edges(box):
    attachments, measurer = tools(box)
    one, other, back, plane = attachments.features([X_FRONT, Y_LEFT, X_BACK, PLANE])
    found = measurer.angle(one, other)
    assert found.values == pytest.approx((90.0, 90.0))
    assert found.ways == (((one.edges[0], other.edges[0]),),)
    assert measurer.angle(one, back).reason == "the two features it is attached to are parallel"
    assert (
        measurer.angle(one, plane).reason
        == "it is attached to other than two planes or two straight edges"
    )


def test_the_axis_of_a_cone_is_that_of_its_circles(pins):
    attachments, measurer = tools(pins)
    both = [circle_at(0.0, 0.0, 0.0, 10.0), circle_at(0.0, 0.0, 5.0, 10.0)]
    (axis,) = attachments.features([{**CONE, "edges": both}, {**CONE, "edges": both[:1]}])
    assert isinstance(axis, Axis)
    assert axis.radius_mm is None
    assert sorted(round(float(arc.centre[2]), 9) for arc in axis.circles) == [0.0, 5.0]
    assert measurer.size("diameter", [axis]).reason == "it is attached to no cylinder and no circle"
    # no circles, or circles about two axes: no feature
    assert attachments.features([{**CONE, "edges": []}]) == []
    assert (
        attachments.features([{**CONE, "edges": [both[0], circle_at(30.0, 40.0, 0.0, 6.0)]}]) == []
    )


def test_centres_of_two_pins_are_50_mm_apart(pins):
    """3, 4, 5; rims of one height come first, the other pairs are noted to be 5 mm apart along the axes."""
    attachments, measurer = tools(pins)
    one, other = attachments.features(
        [circle_at(0.0, 0.0, 0.0, 10.0), circle_at(30.0, 40.0, 2.0, 6.0)]
    )
    # a circle has only the rims in its own place
    assert (len(one.circles), len(other.circles)) == (1, 0)
    one, other = attachments.features(
        [circle_at(0.0, 0.0, 0.0, 10.0), circle_at(30.0, 40.0, 5.0, 6.0)]
    )
    found = measurer.between(one, other)
    assert (found.kind, found.reason) == ("centre_distance", "")
    assert found.values == pytest.approx((50.0,))
    assert found.direction == pytest.approx([0.6, 0.8, 0.0])
    assert (
        found.note
        == "its entities lie 5 mm apart along the axis; it is measured along its direction"
    )
    cylinders = [
        {
            **circle_at(x, y, 0.0, r),
            "kind": "cylinder",
            "edges": [circle_at(x, y, z, r) for z in (0.0, 5.0)],
        }
        for x, y, r in ((0.0, 0.0, 10.0), (30.0, 40.0, 6.0))
    ]
    found = measurer.between(*attachments.features(cylinders))
    assert (len(found.ways[0]), found.note) == (4, "")


def test_axes_and_edges_that_have_no_distance_say_why(pins):
    attachments, measurer = tools(pins)
    upright, lying = attachments.features(
        [circle_at(0.0, 0.0, 0.0, 10.0), circle_at(30.0, 40.0, 0.0, 6.0, axis=(1.0, 0.0, 0.0))]
    )
    assert (
        measurer.between(upright, lying).reason == "the two axes it is attached to are not parallel"
    )
    slanting, plane = attachments.features([line([0, 0, 0], [1, 0, 1]), PLANE])
    assert measurer.between(slanting, upright).reason.startswith(
        "the edge and the axis it is attached to are not perp"
    )
    assert measurer.between(upright, plane).reason.startswith(
        "the plane and the axis it is attached to are not par"
    )
    (beside,) = attachments.features([line([-50, 12, 0], [50, 12, 0])])
    found = measurer.between(upright, beside)
    assert found.values == (12.0,)
    assert "bounds it" in found.reason


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (PLANE, "plane through (0, 0, 20)"),
        (X_FRONT, "edge from (0, 0, 0) to (40, 0, 0)"),
        (circle_at(1.0, 2.0, 3.0, 10.0), "circle of radius 10 mm at (1, 2, 3)"),
        (SPHERE, "sphere at (0, 0, 0)"),
        ({"kind": "free form", "edges": []}, "free form face or edge"),
    ],
)
def test_shapes_in_words(shape, words):
    assert describe_shape(shape) == words


def row(words, *sides, kernel_type="Size_None"):
    first, second = (*sides, [], [])[:2]
    return {
        "words": words,
        "type": kernel_type,
        "sides": [first, second],
        "solids": [0],
        "unread": [0, 0],
        "compared": True,
        "unresolved": "",
    }


@pytest.mark.parametrize(
    ("what", "kind", "value", "reason"),
    [
        (
            row("spherical diameter", [SPHERE]),
            "spherical_diameter",
            8.0,
            "measure the spherical diameter",
        ),
        (
            row("spherical radius", [SPHERE]),
            "spherical_radius",
            4.0,
            "measure the spherical radius",
        ),
        (row("curve length", [X_FRONT]), "curve_length", None, "measure the curve length"),
        (
            row("arc", [X_FRONT], kernel_type="Location_LinearDistance"),
            "curve_length",
            None,
            "the curve length",
        ),
        (row("", [CONE], kernel_type="Size_Angular"), "angle", 90.0, "measure the angle of a cone"),
        (
            row("", [X_FRONT, Y_LEFT, X_BACK]),
            "distance",
            None,
            "two ends, each a plane, edge or axis. Got 3",
        ),
        (
            row("", [X_FRONT], [Y_LEFT, X_BACK]),
            "distance",
            None,
            "one plane, edge or axis. Got 1 and 2",
        ),
    ],
)
def test_what_edges_and_rims_do_not_measure(box, what, kind, value, reason):
    found = _Reader(box, 0.01, 0.05).dimension(what, Statement())
    assert (found.kind, found.geometry, found.entities) == (kind, value, None)
    assert reason in found.reason


def test_limits_get_the_geometrys_nominal_value(box):
    found = _Reader(box, 0.01, 0.05).dimension(
        row("", [X_FRONT], [X_BACK]), Statement(limits=(36.0, 36.1))
    )
    nominal = round(float(np.hypot(30.0, 20.0)), 9)
    assert found.nominal == pytest.approx(nominal, abs=1e-6)
    assert found.tolerance == pytest.approx((36.0 - nominal, 36.1 - nominal), abs=1e-6)
    assert found.entities is not None
    refused = _Reader(box, 0.01, 0.05).dimension(
        row("", [X_FRONT], [X_BACK]), Statement(limits=(36.1, 36.2))
    )
    assert refused.reason.startswith(
        "the file states 36.1 to 36.2 mm, the geometry it is attached to has 36.05"
    )


def test_of_a_pattern_what_cannot_be_measured_is_counted(pins):
    what = row("diameter", [circle_at(0.0, 0.0, 0.0, 10.0), circle_at(30.0, 40.0, 2.0, 10.0)])
    found = _Reader(pins, 0.01, 0.05).dimension(what, Statement(nominal=20.0))
    assert found.entities is not None
    assert found.note == "1 of its 2 features cannot be measured"
    assert found.n_features == 2
    assert found.feature_reasons == (None, "no sharp circular edge bounds this feature")


def test_the_rims_of_a_pattern_face_alike_whatever_their_ids(pins):
    """Each pin has a rim below and one above. The lower id of the second pin is that of its other rim."""
    _, measurer = tools(pins)
    of_pin = {}
    for rim in pins.rims():
        of_pin.setdefault(rim.radius_mm > 8, []).append(rim)
    first = of_pin[True]
    second = of_pin[False]
    (alike,) = (rim for rim in second if rim.axis @ first[0].axis > 0)
    turned = [replace(rim, id="r90" if rim is alike else "r80") for rim in second]
    axes = [
        Axis(rims[0].centre, rims[0].axis, rims[0].radius_mm, tuple(rims))
        for rims in (first, turned)
    ]
    assert measurer.size("diameter", axes).ways == ((("r0",), ("r1",)), (("r90",), ("r80",)))


def test_balls_of_one_size_are_features_of_one_radius(box):
    """Two halves of one ball are one feature, a ball elsewhere is another one."""
    ball = {"kind": "sphere", "point": [5.0, 5.0, 5.0], "radius": 4.0, "edges": []}
    balls = [ball, dict(ball), {**ball, "point": [5.0, 9.0, 5.0]}]
    found = _Reader(box, 0.01, 0.05).dimension(row("spherical radius", balls), Statement())
    assert (found.kind, found.n_features) == ("spherical_radius", 2)
