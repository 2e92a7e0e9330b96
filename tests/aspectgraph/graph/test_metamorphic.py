"""What must follow when the question changes: more in the way, fewer entities, other units."""

from __future__ import annotations

import moved_parts
import networkx as nx
import numpy as np
import pytest
from generated_solids import generated_solid
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_files import off_text
from solids import (
    SLOT_ENTITIES,
    STEP_ENTITIES,
    TWO_POCKET_ENTITIES,
    l_block,
    slotted_block,
    two_pocket_block,
)

from aspectgraph import build_aspect_graph, compute_regions, read_solid
from aspectgraph.read.mesh import UNITS_MM
from aspectgraph.solid.solid import Solid

ROOM = [[-30.0] * 3, [30.0] * 3]
CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
QUADS = np.array(
    [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
)
KNOWN = {
    "slots": (slotted_block, SLOT_ENTITIES),
    "step": (l_block, STEP_ENTITIES),
    "pockets": (two_pocket_block, TWO_POCKET_ENTITIES),
}


def boxes(*places):
    """A solid of boxes, each as (low corner, size)."""
    vertices = np.vstack([np.array(low) + CORNERS * size for low, size in places])
    return Solid(vertices, [tuple(quad + 8 * k) for k in range(len(places)) for quad in QUADS])


@st.composite
def places_beside(draw):
    """Low corner and size of one to three boxes that keep clear of the cube [0, 4]³ and of each other."""
    slots = [
        np.array(at) for at in ((-9, 0, 0), (9, 0, 0), (0, -9, 0), (0, 9, 0), (0, 0, -9), (0, 0, 9))
    ]
    chosen = draw(st.lists(st.integers(0, 5), min_size=1, max_size=3, unique=True))
    number = st.integers(0, 3)
    return [
        (slots[k] + [draw(number) for _ in range(3)], [draw(number) + 1 for _ in range(3)])
        for k in chosen
    ]


@settings(max_examples=12, deadline=None, derandomize=True)
@given(places_beside(), st.integers(0, 10**6))
def test_more_in_the_way_never_enlarges_a_region(places, seed):
    cube = ((0, 0, 0), (4, 4, 4))
    edges = {"x": ((0, 0, 0), (4, 0, 0)), "y": ((4, 0, 4), (4, 4, 4)), "z": ((0, 4, 0), (0, 4, 4))}
    points = np.random.default_rng(seed).uniform(-30, 30, (400, 3))
    before = None
    for n in range(len(places) + 1):
        regions = compute_regions(boxes(cube, *places[:n]), edges, workspace=ROOM)
        seen = regions.observable(points)
        volumes = np.array([regions.covering_cells([name]).volume for name in edges])
        if before is not None:
            assert not (seen & ~before[0]).any()
            assert (volumes <= before[1] * (1 + 1e-9)).all()
        before = seen, volumes


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(0, 500))
def test_neighbours_differ_by_what_appears_or_disappears_between_them(seed):
    part = generated_solid(seed)
    solid = Solid(part.vertices, part.faces)
    edges = solid.straight_edges()[:4]
    graph = build_aspect_graph(solid, [edge.id for edge in edges]).graph
    lists = {node: set(data["observable"]) for node, data in graph.nodes(data=True)}
    assert all(lists[a] != lists[b] for a, b in graph.edges)
    assert set().union(*lists.values()) <= {f"e{edge.id}" for edge in edges}
    for a, b, data in graph.edges(data=True):
        assert lists[a] ^ lists[b] <= {surface.entity for surface in data["surfaces"]}


@pytest.mark.parametrize("name", KNOWN)
def test_without_an_entity_domains_that_it_parted_merge(name):
    make, asked = KNOWN[name]
    whole = build_aspect_graph(make(), asked).graph
    for left_out in asked:
        rest = {key: ends for key, ends in asked.items() if key != left_out}
        lists = {n: frozenset(d["observable"]) - {left_out} for n, d in whole.nodes(data=True)}
        same = nx.Graph([(a, b) for a, b in whole.edges if lists[a] == lists[b]])
        same.add_nodes_from(whole)
        groups = list(nx.connected_components(same))
        group_of = {n: k for k, group in enumerate(groups) for n in group}
        merged = nx.Graph(
            (group_of[a], group_of[b]) for a, b in whole.edges if group_of[a] != group_of[b]
        )
        merged.add_nodes_from(range(len(groups)))
        for k, group in enumerate(groups):
            merged.nodes[k]["observable"] = tuple(lists[min(group)])
        assert moved_parts.same_graph(build_aspect_graph(make(), rest).graph, merged), left_out


@pytest.mark.parametrize("unit", UNITS_MM)
def test_units_change_nothing(tmp_path, unit):
    original = slotted_block()
    path = tmp_path / "part.off"
    path.write_bytes(
        off_text(original.vertices / UNITS_MM[unit], [face.outer for face in original.faces])
    )
    solid = read_solid(path, units=unit)
    assert solid.vertices == pytest.approx(original.vertices, abs=1e-12)
    one, other = (build_aspect_graph(each, SLOT_ENTITIES).graph for each in (original, solid))
    assert moved_parts.same_graph(one, other)
    assert sorted(v for _, v in other.nodes(data="volume")) == pytest.approx(
        sorted(v for _, v in one.nodes(data="volume"))
    )
