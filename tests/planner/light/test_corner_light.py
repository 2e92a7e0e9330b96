"""The other line at each end of an edge must show too: lines of a block, and lamps that light one side or none."""

import numpy as np
from lit_parts import block
from plan_examples import plan, setting

from aspectgraph.solid.ray_scene import RayScene
from planner.light.corner_light import Corners, Sites, corners_of
from planner.light.plan_light import plan_light

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
    """From behind the front face nothing of the corners is lit, and the reason says what was asked."""
    one = asked(min_corner_deg=25.0)
    assert plan_light(one, block(), [(40.0, -100.0, 360.0)]).complete
    dark = plan_light(one, block(), [(40.0, 100.0, -10.0)])
    assert dark.unlit[0]["top front"].endswith("or no other line at an end.")
