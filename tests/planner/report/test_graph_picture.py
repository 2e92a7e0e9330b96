"""The picture of an aspect graph: its circles, surfaces and texts are those of the domains, asked in another way."""

import re

import networkx as nx
import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from plan_examples import plan, setting

from aspectgraph import build_aspect_graph
from planner.report import figure as room
from planner.report.figure import graph_picture
from planner.report.page import report_html

SPACE = BoxSpace((80.0, 50.0, 60.0), [[-900.0] * 3, [900.0] * 3], EDGES)
NAMES = ("+z-y", "+z+x", "-z+y")
BOX = np.array([[-300.0, -300.0, -200.0], [400.0, 300.0, 700.0]])
COLORS = ("#0072b2", "#d55e00")


@pytest.fixture(scope="module")
def graph():
    ends = {name: SPACE.entities[name].endpoints for name in NAMES}
    return build_aspect_graph(SPACE.solid, ends, workspace=SPACE.workspace)


def box_plan(**changes):
    entities = {name: SPACE.entities[name].endpoints for name in NAMES}
    settings = (
        setting((40.0, -180.0, 620.0), ["+z-y", "+z+x"]),
        setting((250.0, 40.0, 600.0), ["+z+x"]),
    )
    return plan(
        settings=settings, entities=entities, uninspectable={"-z+y": "unobservable"}, **changes
    )


def drawn(svg):
    """Places and radii of the circles by domain, and lines."""
    circles = re.findall(
        r'<g data-domain="(\d+)".*?<circle cx="([\d.]+)" cy="([\d.]+)" r="([\d.]+)" fill="(\S+)"/>',
        svg,
    )
    lines = re.findall(r'<line x1="([\d.]+)" y1="([\d.]+)" x2="([\d.]+)" y2="([\d.]+)"/>', svg)
    return {
        int(node): (float(x), float(y), float(r), fill) for node, x, y, r, fill in circles
    }, lines


def test_all_domains_of_a_small_graph_and_their_neighbours_are_drawn(graph):
    picture = graph_picture(box_plan(), graph, BOX, COLORS)
    circles, lines = drawn(picture.svg)
    assert set(circles) == set(graph.graph)
    places = {(f"{x:.1f}", f"{y:.1f}"): node for node, (x, y, *_) in circles.items()}
    joined = {frozenset((places[a, b], places[c, d])) for a, b, c, d in lines}
    assert joined == set(map(frozenset, graph.graph.edges))
    assert picture.n_drawn == picture.n == len(graph.graph)


def test_circles_lie_inside_the_picture_and_do_not_hide_one_another(graph):
    circles, _ = drawn(graph_picture(box_plan(), graph, BOX, COLORS).svg)
    places = np.array([one[:2] for one in circles.values()])
    radii = np.array([one[2] for one in circles.values()])
    assert (places - radii[:, None] > 0).all()
    assert (places + radii[:, None] < [420, 560]).all()
    apart = np.linalg.norm(places[:, None] - places[None], axis=2) + 1e9 * np.eye(len(places))
    assert (apart > np.maximum(radii[:, None], radii[None])).all()


def test_cameras_are_told_where_they_stand(graph):
    picture = graph_picture(box_plan(), graph, BOX, COLORS)
    found = box_plan()
    circles = drawn(picture.svg)[0]
    told = picture.domains
    # camera 1 is above and before the box, camera 2 above: both see the top's edges
    nodes = graph.domain_of([one.position for one in found.settings])
    for k, node in enumerate(nodes):
        assert re.search(rf'<g data-domain="{node}".*?<text[^>]*>[\d, ]*{k + 1}', picture.svg)
        assert re.search(rf"Cameras? in it: [\d, ]*{k + 1}", told[str(node)]["text"])
    assert circles[nodes[0]][3] == COLORS[0]
    grey = [node for node in circles if not set(graph.graph.nodes[node]["observable"]) >= {"+z+x"}]
    assert {circles[node][3] for node in grey} == {"#c3cbd4"}


def test_the_surface_of_a_domain_parts_it_from_the_rest(graph):
    told = graph_picture(box_plan(), graph, BOX, COLORS).domains
    checked = 0
    for node, one in told.items():
        corners = np.column_stack([one[i] for i in "xyz"])
        triangles = corners[np.column_stack([one[i] for i in "ijk"])]
        assert (corners >= BOX[0] - 1e-3).all()
        assert (corners <= BOX[1] + 1e-3).all()
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        large = lengths > 1e3
        step = 0.5 * normals[large] / lengths[large, None]
        middle = triangles[large].mean(axis=1)
        sides = np.array(
            [
                graph.domain_of(middle + step) == int(node),
                graph.domain_of(middle - step) == int(node),
            ]
        )
        # at the picture's limits the domain goes on beyond
        at_limit = (np.abs(middle[:, None] - BOX).min(axis=1) < 1e-3).any(axis=1)
        assert (sides.sum(axis=0)[~at_limit] == 1).all()
        assert sides.any(axis=0).all()
        checked += large.sum()
    assert checked > 50


def test_of_a_large_graph_ways_between_cameras_and_the_largest_are_drawn(graph, monkeypatch):
    monkeypatch.setattr(room, "MOST_DOMAINS", 4)
    picture = graph_picture(box_plan(), graph, BOX, COLORS)
    circles, _ = drawn(picture.svg)
    assert len(circles) == 4
    assert nx.is_connected(graph.graph.subgraph(circles))
    assert set(graph.domain_of([one.position for one in box_plan().settings])) <= set(circles)
    assert (picture.n_drawn, picture.n) == (4, len(graph.graph))


def test_surfaces_are_left_out_where_there_is_no_time_but_of_domains_with_cameras_last(
    graph, monkeypatch
):
    found = box_plan()
    standing = {str(node) for node in graph.domain_of([one.position for one in found.settings])}
    cells = graph.graph.nodes(data="n_cells")
    monkeypatch.setattr(room, "MOST_CELLS", sum(cells[int(node)] for node in standing))
    told = graph_picture(found, graph, BOX, COLORS).domains
    assert {node for node, one in told.items() if one["i"]} == standing
    left_out = [one["text"] for node, one in told.items() if node not in standing]
    assert left_out
    assert all(text.endswith("It has too many cells to be drawn.") for text in left_out)


def test_a_domain_beyond_the_picture_is_said_to_be_there(graph):
    # below the part, where no camera is
    below = np.array([[200.0, 200.0, -700.0], [400.0, 300.0, -200.0]])
    told = graph_picture(box_plan(), graph, below, COLORS).domains
    hidden = {
        node for node, one in told.items() if one["text"].endswith("It lies outside the picture.")
    }
    assert hidden == {node for node, one in told.items() if not one["i"]}
    assert hidden >= {
        str(node) for node in graph.domain_of([one.position for one in box_plan().settings])
    }


def test_names_cannot_end_the_script_that_holds_them():
    name = "</script><b>"
    ends = SPACE.entities["+z-y"].endpoints
    small = build_aspect_graph(SPACE.solid, {name: ends}, workspace=SPACE.workspace)
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), [name]),), entities={name: ends}, uninspectable={}
    )
    picture = graph_picture(one, small, BOX, COLORS)
    assert "<b>" not in picture.svg
    assert "</script><b>" not in report_html(one, small, graph=small)
    assert any(name in told["text"] for told in picture.domains.values())


def test_a_plan_without_settings_has_a_graph_too(graph):
    nothing = plan(
        settings=(),
        entities={"a": [[0, 0, 0], [1, 0, 0]]},
        uninspectable={"a": "no"},
        lower_bound=0,
    )
    circles, _ = drawn(graph_picture(nothing, graph, BOX, ()).svg)
    assert set(circles) == set(graph.graph)
