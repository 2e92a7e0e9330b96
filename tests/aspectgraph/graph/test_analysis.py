"""Stability, richest domains and ways between domains, of a box whose domains are known by hand.

An edge of a convex body is observable from every point that lies outside the plane of one of its two faces.
"""

from itertools import product

import networkx as nx
import pytest

from aspectgraph import (
    Solid,
    build_aspect_graph,
    domain_path,
    read_graphml,
    richest_domains,
    stability,
    write_graphml,
)
from aspectgraph.exceptions import EntityError

FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
BOX = Solid(list(product((0, 40), (0, 30), (0, 20))), FACES, name="box")
WORKSPACE = [[-100, -100, -100], [140, 130, 120]]


@pytest.fixture(scope="module")
def eag():
    return build_aspect_graph(BOX, {"top": 1, "side": 2}, WORKSPACE)


def halves(eag, name):
    """Inward sides of the two faces beside an edge: (axis, bound, sign) with the outside at sign * (x - bound) > 0."""
    points = eag.entities[name].endpoints
    fixed = [axis for axis in range(3) if points[0][axis] == points[1][axis]]
    size = (40, 30, 20)
    return [(axis, points[0][axis], 1 if points[0][axis] == size[axis] else -1) for axis in fixed]


def test_shares_are_those_of_the_boxes_between_the_planes(eag):
    """Volumes by hand: the planes of the faces cut the workspace into boxes; each sees an edge or does not."""
    planes = [halves(eag, name) for name in ("top", "side")]
    cuts = [
        sorted(
            {
                WORKSPACE[0][a],
                WORKSPACE[1][a],
                *(float(b) for two in planes for axis, b, _ in two if axis == a),
            }
        )
        for a in range(3)
    ]
    expected = {}
    for corner in product(*(range(len(c) - 1) for c in cuts)):
        low = [cuts[a][k] for a, k in enumerate(corner)]
        high = [cuts[a][k + 1] for a, k in enumerate(corner)]
        middle = [(x + y) / 2 for x, y in zip(low, high, strict=True)]
        seen = tuple(
            name
            for name, two in zip(("top", "side"), planes, strict=True)
            if any(sign * (middle[axis] - bound) > 0 for axis, bound, sign in two)
        )
        volume = 1.0
        for x, y in zip(low, high, strict=True):
            volume *= y - x
        expected[seen] = expected.get(seen, 0.0) + volume
    expected[()] -= 40 * 30 * 20  # the box itself
    found = {one.observable: one.volume for one in stability(eag)}
    assert found == pytest.approx(expected)
    total = sum(expected.values())
    assert [one.share for one in stability(eag)] == pytest.approx(
        [volume / total for volume in sorted(expected.values(), reverse=True)]
    )


def test_each_domain_is_in_one_list(eag):
    found = stability(eag)
    assert sorted(node for one in found for node in one.domains) == list(eag.graph)
    assert sum(one.share for one in found) == pytest.approx(1.0)
    for one in found:
        assert {eag.graph.nodes[node]["observable"] for node in one.domains} == {one.observable}
        assert one.clearance == max(eag.graph.nodes[node]["clearance"] for node in one.domains)


def test_the_richest_domain_sees_both(eag):
    order = richest_domains(eag)
    sizes = [len(eag.graph.nodes[node]["observable"]) for node in order]
    assert sizes == sorted(sizes, reverse=True)
    assert eag.graph.nodes[order[0]]["observable"] == ("top", "side")
    assert richest_domains(eag, 2) == order[:2]


@pytest.mark.parametrize("n", [0, -1, 1.5, True])
def test_a_number_of_domains_must_be_positive(eag, n):
    with pytest.raises(EntityError, match="n must be a positive whole number"):
        richest_domains(eag, n)


def test_ways_are_shortest_and_tell_what_changes(eag):
    for start, goal in product(eag.graph, repeat=2):
        way = domain_path(eag, start, goal)
        assert len(way) == nx.shortest_path_length(eag.graph, start, goal)
        seen = set(eag.graph.nodes[start]["observable"])
        node = start
        for step in way:
            assert eag.graph.has_edge(node, step.domain)
            assert seen.isdisjoint(step.appear)
            assert seen.issuperset(step.vanish)
            seen = (seen | set(step.appear)) - set(step.vanish)
            node = step.domain
            assert seen == set(eag.graph.nodes[node]["observable"])
        assert node == goal


def test_of_two_ways_the_one_with_nearer_viewpoints_is_taken():
    graph = nx.Graph()
    for node, x, y in ((0, 0, 0), (1, 5, 50), (2, 5, 1), (3, 10, 0)):
        graph.add_node(node, viewpoint=(x, y, 0.0), observable=())
    graph.add_edges_from([(0, 1), (1, 3), (0, 2), (2, 3)])
    assert [step.domain for step in domain_path(graph, 0, 3)] == [2, 3]


def test_a_domain_that_is_not_there_is_refused(eag):
    with pytest.raises(EntityError, match=r"goal must be a domain of the graph, 0 to 3\. Got 9"):
        domain_path(eag, 0, 9)
    graph = nx.Graph()
    graph.add_node(0, viewpoint=(0, 0, 0), observable=())
    graph.add_node(1, viewpoint=(1, 0, 0), observable=())
    with pytest.raises(EntityError, match="must be connected"):
        domain_path(graph, 0, 1)


def test_a_graph_that_was_written_gives_the_same(eag, tmp_path):
    write_graphml(eag, tmp_path / "graph.graphml")
    again = read_graphml(tmp_path / "graph.graphml")
    assert stability(again) == stability(eag)
    assert domain_path(again, 0, 3) == domain_path(eag, 0, 3)
