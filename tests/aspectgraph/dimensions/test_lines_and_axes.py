"""Lines, cones and pairs of axes on solids made by hand, and what rows of a file say of them; all known in advance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from solids import plain_box

from aspectgraph import Solid
from aspectgraph.dimensions.features import (
    Attachments,
    Axis,
    Measurer,
    Sight,
    StraightLine,
    describe_shape,
)
from aspectgraph.dimensions.read_dimensions import _Reader
from aspectgraph.dimensions.tolerances import Statement

N = 12
PLANE = {"kind": "plane", "point": [0.0, 0.0, 20.0], "axis": [0.0, 0.0, 1.0], "edges": []}
CONE = {"kind": "cone", "point": [0.0, 0.0, 2.0], "axis": [0.0, 0.0, 1.0], "angle_deg": 90.0}
SPHERE = {"kind": "sphere", "point": [0.0, 0.0, 0.0], "radius": 4.0}


@pytest.fixture(scope="module")
def box():
    return plain_box((40, 30, 20))


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


def tools(solid):
    attachments = Attachments(solid)
    return attachments, Measurer(attachments, Sight(solid))


def line(start, end):
    return {"kind": "line", "ends": [start, end]}


def circle(x, y, z, radius, axis=(0.0, 0.0, 1.0)):
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
    both = [circle(0.0, 0.0, 0.0, 10.0), circle(0.0, 0.0, 5.0, 10.0)]
    (axis,) = attachments.features([{**CONE, "edges": both}, {**CONE, "edges": both[:1]}])
    assert isinstance(axis, Axis)
    assert axis.radius_mm is None
    assert sorted(round(float(arc.centre[2]), 9) for arc in axis.circles) == [0.0, 5.0]
    assert measurer.size("diameter", [axis]).reason == "it is attached to no cylinder and no circle"
    # no circles, or circles about two axes: no feature
    assert attachments.features([{**CONE, "edges": []}]) == []
    assert attachments.features([{**CONE, "edges": [both[0], circle(30.0, 40.0, 0.0, 6.0)]}]) == []


def test_centres_of_two_pins_are_50_mm_apart(pins):
    """3, 4, 5; rims of one height come first, the other pairs are noted to be 5 mm apart along the axes."""
    attachments, measurer = tools(pins)
    one, other = attachments.features([circle(0.0, 0.0, 0.0, 10.0), circle(30.0, 40.0, 2.0, 6.0)])
    # a circle has only the rims in its own place
    assert (len(one.circles), len(other.circles)) == (1, 0)
    one, other = attachments.features([circle(0.0, 0.0, 0.0, 10.0), circle(30.0, 40.0, 5.0, 6.0)])
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
            **circle(x, y, 0.0, r),
            "kind": "cylinder",
            "edges": [circle(x, y, z, r) for z in (0.0, 5.0)],
        }
        for x, y, r in ((0.0, 0.0, 10.0), (30.0, 40.0, 6.0))
    ]
    found = measurer.between(*attachments.features(cylinders))
    assert (len(found.ways[0]), found.note) == (4, "")


def test_axes_and_edges_that_have_no_distance_say_why(pins):
    attachments, measurer = tools(pins)
    upright, lying = attachments.features(
        [circle(0.0, 0.0, 0.0, 10.0), circle(30.0, 40.0, 0.0, 6.0, axis=(1.0, 0.0, 0.0))]
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
        (circle(1.0, 2.0, 3.0, 10.0), "circle of radius 10 mm at (1, 2, 3)"),
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
    what = row("diameter", [circle(0.0, 0.0, 0.0, 10.0), circle(30.0, 40.0, 2.0, 10.0)])
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
