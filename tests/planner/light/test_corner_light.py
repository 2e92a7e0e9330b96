"""The other line at each end of an edge must show too: lines of a block, and lamps that light one side or none."""

import numpy as np
import pytest
from contrast_lamps import contrast_lamps
from lit_parts import RIM, block, step
from plan_examples import plan, setting

from aspectgraph.solid.solid import RayScene
from planner.light.corner_light import Corners, SeenLine, Sites, beside_lines, corners_of

LIMITS = (0.1, 0.05)


def asked(**requirements):
    return plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
        requirements=requirements,
    )


def found(one):
    ids = [edge.id for edge in block().edges if set(edge_ends(edge)) == {(0, 0, 60), (80, 0, 60)}]
    scene = RayScene(block().vertices, block().triangles)
    return corners_of(one, block(), scene, [(0, "top front")], [ids])


def edge_ends(edge):
    return [tuple(block().vertices[v]) for v in edge.vertices]


def test_lines_that_leave_an_edge_of_a_block():
    """From before and above, of either end the upright and the edge of the top are seen: one face of each is."""
    corners = found(asked(min_corner_deg=25.0))
    assert corners.pair.tolist() == [0, 0]
    assert sorted(corners.end.tolist()) == [0, 0, 1, 1]
    # nine points each, before the dark ground, as the faces at the sides are not seen
    assert len(corners.sites.compared) == 36
    assert set(corners.sites.compared[:, 1].tolist()) == {-1}
    assert set(map(tuple, corners.sites.normals.tolist())) == {(0.0, -1.0, 0.0), (0.0, 0.0, 1.0)}


def test_who_does_not_ask_for_corners_gets_none():
    assert len(found(asked()).pair) == 0
    assert len(found(asked(min_corner_deg=0.0)).pair) == 0


def test_one_line_per_end_is_enough_and_no_end_may_lack_one():
    """A lamp before the block, below its top: the uprights show, the edges of the top do not."""
    corners = found(asked(min_corner_deg=25.0))
    scene = RayScene(block().vertices, block().triangles)
    lamps = np.array([(40.0, -400.0, 30.0), (40.0, 400.0, 30.0)])
    sets = np.array([[0], [1]])
    assert corners.shown(scene, lamps, sets, LIMITS, np.ones((2, 1), bool))[:, 0].tolist() == [
        True,
        False,
    ]
    both = corners.shown(scene, lamps, np.array([[0, 1]]), LIMITS, np.ones((1, 1), bool))
    assert both[0, 0]


def test_an_end_whose_only_line_is_dark():
    """The first pair has a lit line at one end only, the second one at both."""
    front = np.array([0.0, -1, 0])
    top = np.array([0.0, 0, 1])
    points = np.array([[10.0, 0, 60], [70, 0, 60], [10, 0, 60], [70, 0, 60]])
    normals = np.array([front, top, front, front])
    sites = Sites(points, normals, np.array([[0, -1], [1, -1], [2, -1], [3, -1]]), np.arange(4), 4)
    corners = Corners(sites, np.arange(4), np.array([0, 0, 1, 1]))
    scene = RayScene(block().vertices, block().triangles)
    lamp = np.array([(40.0, -400.0, 30.0)])
    assert corners.shown(scene, lamp, np.array([[0]]), LIMITS, np.ones((1, 2), bool)).tolist() == [
        [False, True]
    ]


def test_lamps_are_planned_with_it():
    """From behind the front face nothing of the corners is lit, and the reason says what it lacks."""
    one = asked(min_corner_deg=25.0)
    assert contrast_lamps(one, block(), [(40.0, -100.0, 360.0)]).complete
    dark = contrast_lamps(one, block(), [(40.0, 100.0, -10.0)])
    assert dark.unlit[0]["top front"] == "the lamp does not show it: 1 with a contrast under 0.1."


# Shadows that end beside a line: of a step, where a wall's shadow ends follows from similar
# triangles.


EYE = np.array([45.0, 20.0, 400.0])
# 0.4 mm on the lower floor
PIXEL_RAD = 0.001
SCENE = RayScene(step().vertices, step().triangles, n_threads=1)


def line(x, z, low=4.0, high=36.0):
    """A line along y, seen from above."""
    points = np.column_stack([np.full(9, x), np.linspace(low, high, 9), np.full(9, z)])
    return SeenLine(EYE, points, np.array([0.0, 1, 0]))


def lamp_for(end_x):
    """A lamp at x = -200 under which the shadow of the wall x = 30, z = 10 ends there on the floor z = 0."""
    return [-200.0, 20.0, 10.0 + 230.0 * 10.0 / (end_x - 30.0)]


@pytest.mark.parametrize(
    ("end_x", "clear"),
    [
        # 5 px are 2 mm: beyond that, within it, and the edge itself in the shadow
        (57.0, True),
        (58.3, False),
        (59.3, False),
        # three quarters of a pixel of shadow between edge and border
        (59.7, False),
        # a lit strip of 0.16 px between them
        (59.936, False),
        (62.0, True),
    ],
)
def test_a_shadow_that_ends_beside_an_edge(end_x, clear):
    beside = beside_lines(SCENE, [line(60.0, 0.0)], 5.0, PIXEL_RAD)
    lamps = np.array([lamp_for(end_x)])
    assert beside.clear(SCENE, lamps, np.ones((1, 1), bool)).tolist() == [[clear]]


def test_nothing_is_said_of_what_is_not_wanted():
    beside = beside_lines(SCENE, [line(60.0, 0.0), line(0.0, 10.0)], 5.0, PIXEL_RAD)
    lamps = np.array([lamp_for(58.3), lamp_for(57.0)])
    assert beside.clear(SCENE, lamps, np.ones((2, 2), bool)).tolist() == [
        [False, True],
        [True, True],
    ]
    assert beside.clear(SCENE, lamps, np.zeros((2, 2), bool)).all()


def test_without_a_separation_there_is_nothing_beside():
    beside = beside_lines(SCENE, [line(60.0, 0.0)], 0.0, PIXEL_RAD)
    assert (len(beside.places), beside.n_lines) == (0, 1)
    assert beside.clear(SCENE, np.array([lamp_for(58.3)]), np.ones((1, 1), bool)).all()


def test_places_are_on_the_face_beside_the_line():
    """Beside the rim, of the upper face on one side; on the other one the floor, past the wall of 0.96 px."""
    beside = beside_lines(SCENE, [line(30.0, 10.0)], 5.0, PIXEL_RAD)
    ends = np.array(RIM["rim"])
    assert ends[0, 0] == 30.0
    up = beside.places[:, 2] > 5
    assert (beside.places[up, 0] < 30).all()
    assert (beside.places[~up, 0] > 30).all()
    assert np.allclose(beside.places[up, 2], 10.0, atol=1e-3)
    assert np.allclose(beside.normals, [0, 0, 1], atol=1e-6)
    assert up.sum() == 9 * 7
    assert (~up).sum() == 9 * 5


def test_a_border_beside_one_point_of_a_line_is_enough():
    """The places beside all points but the last are moved to where the whole floor is in the shadow."""
    points = np.column_stack([np.full(9, 60.0), np.linspace(4.0, 36.0, 9), np.zeros(9)])
    beside = beside_lines(SCENE, [SeenLine(EYE, points, np.array([0.0, 1, 0]))], 5.0, PIXEL_RAD)
    lamps = np.array([lamp_for(58.3)])
    asked = np.ones((1, 1), bool)
    one = beside.strip // 2 == 8
    moved = np.where(one[:, None], beside.places, beside.places - [20.0, 0, 0])
    assert beside.clear(SCENE, lamps, asked).tolist() == [[False]]
    shadow = type(beside)(moved, beside.normals, beside.strip, beside.line, 1)
    assert shadow.clear(SCENE, lamps, asked).tolist() == [[False]]
    only = type(beside)(moved[~one], beside.normals[~one], beside.strip[~one], beside.line[~one], 1)
    assert only.clear(SCENE, lamps, asked).tolist() == [[True]]
