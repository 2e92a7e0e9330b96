"""Rims, arcs and edge objects as entities: by id, as objects and from files."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from solids import cube, prism, ring

from aspectgraph import (
    EntityError,
    build_aspect_graph,
    read_entities,
    read_graphml,
    resolve_entities,
    write_graphml,
)

SQUARE = [(-10, -10), (10, -10), (10, 10), (-10, 10)]


def holed(n: int = 12):
    return prism(SQUARE, 5, [ring(4.0, n, clockwise=True)], name="holed")


def slotted():
    right = [(3 + 2 * np.cos(a), 2 * np.sin(a)) for a in np.radians(np.arange(-90, 91, 30))]
    return prism(SQUARE, 5, [[*right, *[(-x, -y) for x, y in right]][::-1]])


def test_ids_and_objects_are_the_same():
    solid = holed()
    rim = solid.rims()[1]
    edge = solid.straight_edges()[0]
    by_id = resolve_entities(solid, {"bore": "r1", "top": edge.id})
    assert resolve_entities(solid, {"bore": rim, "top": edge}) == by_id
    assert list(resolve_entities(solid, [rim, "r0", edge])) == ["r1", "r0", f"e{edge.id}"]
    assert resolve_entities(solid, by_id) == by_id


def test_a_rim_has_all_chords_its_circle_and_two_opposite_points():
    solid = holed()
    bore = resolve_entities(solid, {"bore": "r0"})["bore"]
    assert (bore.kind, len(bore.edge_ids), bore.points.shape, bore.outline.shape) == (
        "rim",
        12,
        (12, 3),
        (13, 3),
    )
    assert bore.circle.radius_mm == pytest.approx(4.0)
    assert bore.endpoints.mean(axis=0) == pytest.approx(bore.circle.centre)
    assert bore.length_mm == pytest.approx(8.0)
    with pytest.raises(ValueError, match="read-only"):
        bore.points[0] = 0


def test_an_arc_starts_and_ends_where_its_chords_do():
    arc = resolve_entities(slotted(), {"end": "a0"})["end"]
    assert (arc.kind, len(arc.edge_ids), len(arc.points)) == ("arc", 6, 7)
    assert (arc.endpoints == arc.points[[0, -1]]).all()
    assert arc.length_mm == pytest.approx(4.0)


def test_an_edge_says_it_is_one():
    edge = resolve_entities(cube(), [0])["e0"]
    assert (edge.kind, edge.circle) == ("edge", None)
    assert (edge.points == edge.endpoints).all()


def test_files_and_command_lines(tmp_path):
    path = tmp_path / "entities.toml"
    path.write_text('bore = "r1"\ntop = 0\n')
    solid = holed()
    assert [entity.kind for entity in read_entities(path, solid).values()] == ["rim", "edge"]
    assert list(read_entities("r0, e0", solid)) == ["r0", "e0"]
    assert list(read_entities("a0 a1", slotted())) == ["a0", "a1"]


@pytest.mark.parametrize(
    ("target", "rule"),
    [
        ("r2", r"one of the solid's 2 rims and 0 arcs, .* Got 'r2' for 'x'\."),
        ("a0", "Got 'a0' for 'x'"),
        (holed(16).rims()[0], "Got 'r0' for 'x', that of another solid"),
        (cube().edges[0], "another solid's edge 0 for 'x'"),
    ],
)
def test_refusals(target, rule):
    with pytest.raises(EntityError, match=rule):
        resolve_entities(holed(), {"x": target})


def test_a_rim_is_named_once():
    with pytest.raises(EntityError, match=r"named once\. Got 'a' and 'b'"):
        resolve_entities(holed(), {"a": "r0", "b": holed().rims()[0]})


def test_graphml_keeps_kinds_and_circles(tmp_path):
    solid = holed()
    graph = build_aspect_graph(solid, {"bore": "r0", "top": solid.straight_edges()[0]}).graph
    write_graphml(graph, tmp_path / "g.graphml")
    again = read_graphml(tmp_path / "g.graphml")
    assert nx.utils.graphs_equal(again, graph)
    assert again.graph["kinds"] == ("rim", "edge")
    bore, top = again.graph["circles"]
    assert top == ()
    assert bore[:2] == pytest.approx((0, 0))
    assert bore[6] == pytest.approx(4.0)
