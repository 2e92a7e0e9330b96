"""Known answers of the literature and of two independent exact programs, through the engine."""

import numpy as np
import pytest
import solids

from aspectgraph import build_aspect_graph

pytestmark = pytest.mark.uncompiled

WORKSPACE = ((-60, -60, -60), (60, 60, 60))

# (solid, entities, domains, adjacencies, distinct lists)
COUNTS = {
    "cube": (solids.cube, solids.all_edges, 26, 48, 26),
    "L-block": (solids.l_block, solids.all_edges, 55, 116, 55),
    "L-block, other proportions": (
        lambda: solids.l_block([(0, 0), (7, 0), (7, 2), (2, 2), (2, 5), (0, 5)], 1.5),
        solids.all_edges,
        55,
        116,
        55,
    ),
    "step of the L-block (paper, Fig. 8)": (
        solids.l_block,
        lambda solid: solids.STEP_ENTITIES,
        20,
        40,
        13,
    ),
    "slotted block (paper, Table I)": (
        solids.slotted_block,
        lambda solid: solids.SLOT_ENTITIES,
        8,
        11,
        8,
    ),
    "two-pocket block (paper, Table II)": (
        solids.two_pocket_block,
        lambda solid: solids.TWO_POCKET_ENTITIES,
        9,
        13,
        9,
    ),
}


@pytest.mark.parametrize("name", COUNTS)
def test_domains_adjacencies_and_lists(name):
    make, entities_of, domains, adjacencies, lists = COUNTS[name]
    solid = make()
    graph = build_aspect_graph(solid, entities_of(solid), WORKSPACE).graph
    found = {listed for _, listed in graph.nodes(data="observable")}
    assert (len(graph), graph.number_of_edges(), len(found)) == (domains, adjacencies, lists)
    assert graph.graph["n_slivers"] == 0


@pytest.mark.parametrize(
    ("make", "entities", "lists"),
    [
        (solids.slotted_block, solids.SLOT_ENTITIES, solids.SLOT_LISTS),
        (solids.two_pocket_block, solids.TWO_POCKET_ENTITIES, solids.TWO_POCKET_LISTS),
    ],
)
def test_every_list_of_the_papers_tables(make, entities, lists):
    graph = build_aspect_graph(make(), entities, WORKSPACE).graph
    found = sorted(sorted(listed) for _, listed in graph.nodes(data="observable"))
    assert found == sorted(sorted(listed) for listed in lists)


@pytest.mark.parametrize("name", COUNTS)
def test_domains_and_solid_fill_the_workspace(name):
    make, entities_of, *_ = COUNTS[name]
    solid = make()
    graph = build_aspect_graph(solid, entities_of(solid), WORKSPACE).graph
    assert sum(volume for _, volume in graph.nodes(data="volume")) + solid.volume == pytest.approx(
        120.0**3, rel=1e-9
    )


def test_cube_domains_are_the_26_sectors():
    """Beyond 6 face, 12 edge and 8 corner sectors there is nothing; each lists the edges of the faces it looks at."""
    graph = build_aspect_graph(solids.cube(), solids.all_edges(solids.cube()), WORKSPACE).graph
    lengths = sorted(len(listed) for _, listed in graph.nodes(data="observable"))
    assert lengths == [4] * 6 + [7] * 12 + [9] * 8
    degrees = sorted(degree for _, degree in graph.degree)
    assert degrees == [3] * 8 + [4] * (12 + 6)


def test_walls_of_a_closed_void_are_seen_only_from_inside_it():
    solid = solids.hollow_box()
    inner = [
        edge.id
        for edge in solid.straight_edges()
        if (np.abs(solid.edge_points(edge.id) - 2.0) <= 1.0 + 1e-9).all()
    ]
    graph = build_aspect_graph(solid, inner, WORKSPACE).graph
    lists = {
        listed: data["unbounded"]
        for _, data in graph.nodes(data=True)
        for listed in [data["observable"]]
    }
    assert len(graph) == 2
    assert lists == {(): True, tuple(f"e{edge}" for edge in inner): False}
    assert graph.number_of_edges() == 0
