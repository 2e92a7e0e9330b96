"""The complete aspect graph: known counts, drawings by hand, and agreement with the referee."""

import numpy as np
import pytest
from engine_pairs import solid_of
from exact_checker import ExactChecker
from generated_solids import CUBE, L_BLOCK, prism, pyramid, rotation
from solids import STEP_ENTITIES

from aspectgraph.exceptions import SolidError, WorkspaceError
from aspectgraph.graph.aspect_graph import read_graphml, write_graphml
from aspectgraph.graph.build_graph import (
    Drawing,
    build_aspect_graph,
    complete_aspect_graph,
    describe_drawing,
    seen_whole,
)

BOX = ((-60, -60, -60), (61, 61, 61))


def size(graph):
    return (len(graph), graph.number_of_edges())


@pytest.fixture(scope="module")
def l_block():
    return complete_aspect_graph(solid_of(L_BLOCK), BOX)


def test_l_block_has_71_nodes_and_its_step_20(l_block):
    """The comparison of the paper's section 3.4."""
    step = build_aspect_graph(solid_of(L_BLOCK), STEP_ENTITIES, BOX)
    assert size(l_block) == (71, 164)
    assert size(step.graph) == (20, 40)


@pytest.mark.uncompiled
def test_cube_has_a_node_for_each_set_of_one_to_three_faces():
    graph = complete_aspect_graph(solid_of(CUBE), BOX)
    assert size(graph) == (26, 48)
    assert sorted(n for _, n in graph.nodes(data="n_visible")) == [4] * 6 + [7] * 12 + [9] * 8
    # The cube is [0, 2]³ in [-60, 61]³: slabs of 60, 2 and 59 mm along each axis.
    slabs = [
        x * y * z for x in (60, 2, 59) for y in (60, 2, 59) for z in (60, 2, 59) if x * y * z != 8
    ]
    np.testing.assert_allclose(sorted(v for _, v in graph.nodes(data="volume")), sorted(slabs))


@pytest.mark.uncompiled
def test_tetrahedron_has_a_node_for_each_set_of_one_to_three_faces():
    # Four planes in general position: 15 cells, one of them inside; 28 facets, 4 of them on the tetrahedron.
    tetrahedron = pyramid([(-3, -2), (4, -3), (1, 5)], (0, 1, 4))
    graph = complete_aspect_graph(solid_of(tetrahedron), ((-500, -500, -500), (500, 500, 500)))
    assert size(graph) == (14, 24)
    assert sorted(n for _, n in graph.nodes(data="n_visible")) == [3] * 4 + [5] * 6 + [6] * 4


def test_rotated_copy_has_the_same_graph(l_block):
    turned = complete_aspect_graph(
        solid_of(L_BLOCK.mapped(rotation((2, 1, 0, 1)), "turned")), np.array(BOX) * 6
    )
    assert size(turned) == size(l_block)
    assert sorted(d for _, d in turned.nodes(data="drawing")) == sorted(
        d for _, d in l_block.nodes(data="drawing")
    )


def test_other_proportions_have_the_same_number_of_domains_of_the_step():
    # A flatter step sees further over its foot: the drawings' names change, their number does not.
    flat = prism([(0, 0), (5, 0), (5, 1), (1, 1), (1, 2), (0, 2)], 3, "flat")
    assert size(complete_aspect_graph(solid_of(flat), BOX)) == (71, 164)


def test_whole_edges_of_every_drawing_are_those_of_the_referee(l_block):
    solid = solid_of(L_BLOCK)
    checker = ExactChecker.of(solid, 2**30)
    aside = np.array([1.0, 2.0, -1.5]) / 7
    for _, node in l_block.nodes(data=True):
        point = np.array(node["viewpoint"]) + node["clearance"] * aside
        point = np.rint(point * 2**30) / 2**30
        row = checker.observable(point[None], [edge.vertices for edge in solid.edges])[0]
        assert set(seen_whole(node["drawing"])) == set(np.flatnonzero(row).tolist())


def test_neighbours_differ_in_their_drawings(l_block):
    assert all(l_block.nodes[i]["drawing"] != l_block.nodes[j]["drawing"] for i, j in l_block.edges)
    assert all(area > 0 for _, _, area in l_block.edges(data="area"))


def drawing_of(part, viewpoint):
    solid = solid_of(part)
    edges = np.array([edge.vertices for edge in solid.edges])
    drawing = Drawing(solid.vertices, edges, solid.triangles)
    return solid, drawing.visible_parts(np.array(viewpoint, dtype=float))


def edge_id(solid, p, q):
    return next(
        e.id for e in solid.edges if {tuple(solid.vertices[v]) for v in e.vertices} == {p, q}
    )


def test_edge_behind_a_step_is_cut_off_at_a_t_junction():
    # From beyond the high part (x < 1, y up to 2) of the L-block, over it: the far low edges go behind its top edge.
    viewpoint = (-6.0, 5.0, 1.1)
    solid, parts = drawing_of(L_BLOCK, viewpoint)
    top = edge_id(solid, (1, 2, 0), (1, 2, 2))
    far = edge_id(solid, (3, 1, 0), (3, 1, 2))
    side = edge_id(solid, (1, 1, 2), (3, 1, 2))
    # The sight line over (1, 2) has slope -3/7 in x, y: at y = 1 it is at x = 10/3, beyond the far edge at x = 3.
    assert parts[far] == []
    higher, parts = drawing_of(L_BLOCK, (-1.0, 5.0, 1.1))
    # Now the slope is -3/2: at y = 1 the line is at x = 5/3, so the far edge is free and the side edge is cut there.
    assert parts[far] == [(-1, -1)]
    ends = [tuple(higher.vertices[v]) for v in higher.edges[side].vertices]
    corner_first = ends[0] == (1, 1, 2)
    (start, end) = parts[side][0]
    cut, free = (start, end) if corner_first else (end, start)
    assert free == -1
    assert cut != -1
    assert len(parts[side]) == 1
    names = {top, edge_id(higher, (0, 2, 2), (1, 2, 2))}
    assert cut in names


def test_drawing_as_text():
    assert (
        describe_drawing([[(-1, -1)], [], [(-1, 0)], [(0, 1), (2, -1)]], [4, 5, 8, 9])
        == "4 8[-4] 9[4-5] 9[8-]"
    )
    assert describe_drawing([[], []], [0, 1]) == "nothing"
    assert seen_whole("4 8[-4] 12") == (4, 12)
    assert seen_whole("nothing") == ()


def test_progress_counts_cells():
    calls = []
    graph = complete_aspect_graph(solid_of(CUBE), BOX, progress=lambda *args: calls.append(args))
    n = graph.graph["n_cells"]
    assert calls == [(done, n, "cells") for done in range(1, n + 1)]


def test_graph_can_be_written(l_block, tmp_path):
    write_graphml(l_block, tmp_path / "complete.graphml")
    read = read_graphml(tmp_path / "complete.graphml")
    assert dict(read.nodes(data=True)) == dict(l_block.nodes(data=True))


def test_workspace_must_contain_the_part():
    with pytest.raises(WorkspaceError, match="workspace"):
        complete_aspect_graph(solid_of(CUBE), ((1, 1, 1), (9, 9, 9)))


@pytest.mark.uncompiled
def test_what_is_no_solid_is_refused():
    with pytest.raises(SolidError, match=r"^solid must be a Solid\. Got 'x'; read_solid reads"):
        complete_aspect_graph("x")
