"""GraphML files: nothing lost, nothing another program could not read."""

import re
import xml.etree.ElementTree as ET
from itertools import product

import igraph
import networkx as nx
import numpy as np
import pytest
from graph_examples import small_graph
from hypothesis import given
from hypothesis import strategies as st
from part_mutants import damaged_bytes, damaged_encoding, damaged_numbers, damaged_xml
from solids import SLOT_ENTITIES, SLOT_LISTS, slotted_block

from aspectgraph import (
    GraphMLError,
    Solid,
    build_aspect_graph,
    domain_path,
    read_graphml,
    richest_domains,
    stability,
    write_graphml,
)
from aspectgraph.exceptions import EntityError, OutputError
from aspectgraph.graph.aspect_graph import PartitionSurface


def assert_same(one, other):
    """Assert equality of ids, edges, attributes, values and types, and of the order of attributes."""
    assert typed(one.graph) == typed(other.graph)
    assert [(n, typed(d)) for n, d in one.nodes(data=True)] == [
        (n, typed(d)) for n, d in other.nodes(data=True)
    ]
    assert [(u, v, typed(d)) for u, v, d in one.edges(data=True)] == [
        (u, v, typed(d)) for u, v, d in other.edges(data=True)
    ]


def typed(value):
    if isinstance(value, dict):
        return [(key, typed(x)) for key, x in value.items()]
    if isinstance(value, tuple):
        return (tuple, [typed(x) for x in value])
    return (type(value), value)


def test_round_trip_loses_nothing(tmp_path):
    write_graphml(small_graph(), tmp_path / "g.graphml")
    assert_same(read_graphml(tmp_path / "g.graphml"), small_graph())


def test_graph_is_taken_from_an_aspect_graph_and_left_alone(tmp_path):
    class AspectGraph:
        graph = small_graph()

    write_graphml(AspectGraph(), str(tmp_path / "g.graphml"))
    assert_same(AspectGraph.graph, small_graph())
    assert_same(read_graphml(str(tmp_path / "g.graphml")), small_graph())


def test_aspect_graph_of_a_solid(tmp_path):
    eag = build_aspect_graph(slotted_block(), SLOT_ENTITIES)
    write_graphml(eag, tmp_path / "g.graphml")
    read = read_graphml(tmp_path / "g.graphml")
    assert read.graph == eag.graph.graph
    assert dict(read.nodes(data=True)) == dict(eag.graph.nodes(data=True))
    assert list(read.edges(data=True)) == list(eag.graph.edges(data=True))
    other = igraph.Graph.Read_GraphML(str(tmp_path / "g.graphml"))
    assert (other.vcount(), other.ecount()) == (8, 11)
    assert sorted(other.vs["label"]) == sorted(
        ", ".join(sorted(names)) or "None" for names in SLOT_LISTS
    )


TEXTS = st.text(max_size=12).filter(lambda s: s.isprintable() or s == "")
FLOATS = st.floats(allow_nan=False, allow_infinity=False)


@given(
    part=st.text(max_size=12).filter(lambda s: not re.search("[\ud800-\udfff]", s)),
    names=st.lists(TEXTS, max_size=3),
    x=FLOATS,
    y=FLOATS,
    flag=st.booleans(),
)
def test_round_trip_of_any_values(tmp_path_factory, part, names, x, y, flag):
    graph = small_graph()
    graph.graph["part"] = part
    graph.nodes[1].update(observable=tuple(names), volume=x, viewpoint=(y, -x, 0.0), unbounded=flag)
    graph.edges[0, 1].update(
        area=y, surfaces=(PartitionSurface("B", part, (1,), (2, 3), (), (x, y, 0.0, 1.0)),)
    )
    path = tmp_path_factory.mktemp("any") / "g.graphml"
    write_graphml(graph, path)
    assert_same(read_graphml(path), graph)


def test_numpy_scalars_become_python_numbers(tmp_path):
    graph = small_graph()
    graph.nodes[0].update(volume=np.float64(2.5), n_cells=np.int64(7), confirmed=np.bool_(False))
    graph.nodes[0]["viewpoint"] = tuple(np.array([1.0, 2.0, 3.0]))
    write_graphml(graph, tmp_path / "g.graphml")
    read = read_graphml(tmp_path / "g.graphml").nodes[0]
    assert typed({k: read[k] for k in ("volume", "n_cells", "confirmed", "viewpoint")}) == typed(
        {"volume": 2.5, "n_cells": 7, "confirmed": False, "viewpoint": (1.0, 2.0, 3.0)}
    )


def test_further_scalar_attributes_are_kept(tmp_path):
    graph = small_graph()
    for n in graph:
        graph.nodes[n]["rank"] = n
    graph.graph["note"] = "two\nlines, ünïcode"
    write_graphml(graph, tmp_path / "g.graphml")
    assert_same(read_graphml(tmp_path / "g.graphml"), graph)


def test_graph_without_edges_or_nodes(tmp_path):
    for graph in (nx.Graph(), nx.empty_graph(1)):
        write_graphml(graph, tmp_path / "g.graphml")
        assert_same(read_graphml(tmp_path / "g.graphml"), graph)


def test_igraph_reads_every_value(tmp_path):
    write_graphml(small_graph(), tmp_path / "g.graphml")
    graph = igraph.Graph.Read_GraphML(str(tmp_path / "g.graphml"))
    assert (graph.vcount(), graph.ecount(), graph.is_directed()) == (3, 2, False)
    assert graph.vs["id"] == ["0", "1", "2"]
    assert graph.vs["label"] == ["None", "e1", "e1, side <e2>"]
    assert graph.vs["observable"] == ["[]", '["e1"]', '["e1", "side <e2>"]']
    assert graph.vs["volume"] == [1.5, 1e300, 2.5e-308]
    assert graph.vs["unbounded"] == [True, False, False]
    assert graph.vs["viewpoint_z"] == [1e-7] * 3
    assert graph.es["label"] == ["A", "A+B"]
    assert graph.es["area"] == [2.0, 0.1]
    assert graph["workspace_max_y"] == 61.0


def test_networkx_reads_every_value(tmp_path):
    write_graphml(small_graph(), tmp_path / "g.graphml")
    graph = nx.read_graphml(tmp_path / "g.graphml")
    assert graph.nodes["1"]["viewpoint_x"] == 0.1
    assert graph.edges["1", "2"]["label"] == "A+B"
    assert graph.graph["n_slivers"] == 2


def test_file_keeps_the_rules_of_the_format(tmp_path):
    """One key per name and element, a type GraphML knows, and every element with every key (Gephi, yEd, Cytoscape)."""
    write_graphml(small_graph(), tmp_path / "g.graphml")
    root = ET.parse(tmp_path / "g.graphml").getroot()
    space = "{http://graphml.graphdrawing.org/xmlns}"
    keys = root.findall(f"{space}key")
    assert {k.get("attr.type") for k in keys} <= {
        "boolean",
        "int",
        "long",
        "float",
        "double",
        "string",
    }
    names = [(k.get("for"), k.get("attr.name")) for k in keys]
    assert len(names) == len(set(names))
    graph = root.find(f"{space}graph")
    assert graph.get("edgedefault") == "undirected"
    for kind in ("node", "edge"):
        expected = {k.get("id") for k in keys if k.get("for") == kind}
        for element in graph.findall(f"{space}{kind}"):
            assert {d.get("key") for d in element.findall(f"{space}data")} == expected
            assert all(d.text for d in element.findall(f"{space}data"))


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"volume": float("nan")}, "volume of node 1 must be a finite number. Got nan"),
        (
            {"viewpoint": (0.0, float("inf"), 0.0)},
            "viewpoint of node 1 must be a finite number. Got inf",
        ),
        ({"viewpoint": (0.0, 1.0)}, "viewpoint of node 1 must be three numbers"),
        ({"n_cells": 2.5}, "n_cells of node 1 must be an integer. Got 2.5"),
        ({"n_cells": True}, "n_cells of node 1 must be an integer. Got True"),
        ({"confirmed": None}, "confirmed of node 1 must be a bool. Got None"),
        ({"observable": "e1"}, "observable of node 1 must be a tuple of names"),
        ({"colour": [1, 2]}, "colour of node 1 must be a bool, int, float or str"),
        ({"colour": ""}, "colour of node 1 must be text, not empty"),
        (
            {"colour": "a\rb"},
            "colour of node 1 must be text, not empty and without control characters",
        ),
        (
            {"colour": "red"},
            re.escape("every node must have the same attributes. Got a difference in ['colour']"),
        ),
        ({"label": "x"}, "attribute names must be text other than 'label'"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, attributes, message):
    graph = small_graph()
    graph.nodes[1].update(attributes)
    path = tmp_path / "g.graphml"
    with pytest.raises(GraphMLError, match=message) as caught:
        write_graphml(graph, path)
    assert str(path) in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_refused_graph_leaves_the_old_file(tmp_path):
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    bad = small_graph()
    bad.edges[0, 1]["area"] = float("nan")
    with pytest.raises(GraphMLError, match="area of edge 0-1"):
        write_graphml(bad, path)
    assert_same(read_graphml(path), small_graph())


@pytest.mark.parametrize("kind", [nx.DiGraph, nx.MultiGraph])
def test_other_kinds_of_graph_are_refused(tmp_path, kind):
    with pytest.raises(
        GraphMLError, match=f"plain undirected networkx.Graph. Got a {kind.__name__}"
    ):
        write_graphml(kind(), tmp_path / "g.graphml")


def test_what_is_no_graph_is_refused(tmp_path):
    path = str(tmp_path / "g.graphml")
    rule = "^graph and path must be an EntityAspectGraph or a networkx.Graph, and a path. "
    with pytest.raises(GraphMLError, match=f"{rule}Got objects of the types str and Graph."):
        write_graphml(path, small_graph())
    with pytest.raises(GraphMLError, match=f"{rule}Got objects of the types Graph and int."):
        write_graphml(small_graph(), 1)
    assert list(tmp_path.iterdir()) == []


def test_node_ids_must_be_integers(tmp_path):
    with pytest.raises(GraphMLError, match=r"node ids must be integers\. Got 'a'"):
        write_graphml(nx.Graph([("a", "b")]), tmp_path / "g.graphml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</graphml>", "", "must be GraphML"),
        ("<graphml", "<html", "must be GraphML"),
        ('<node id="0">', '<node id="n0">', "must be GraphML with integer node ids"),
        (
            'edgedefault="undirected"',
            'edgedefault="directed"',
            "one undirected edge at most.*DiGraph",
        ),
        (">1.5<", ">much<", "must be GraphML"),
        ('["e1"]', '["e1"', "observable of node 1"),
        ('["e1"]', "3", "observable of node 1 must be a JSON list"),
        (
            ">64<",
            "><",
            r"every node must have the same attributes. Got a difference in \['n_rays'\]",
        ),
        ('"type"', '"kind"', "surfaces of edge 0-1"),
    ],
)
def test_damaged_files_are_refused(tmp_path, old, new, message):
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(GraphMLError, match=message) as caught:
        read_graphml(path)
    assert str(path) in str(caught.value)


def test_missing_component_of_a_vector_is_refused(tmp_path):
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    text = path.read_text(encoding="utf-8").replace('attr.name="viewpoint_y"', 'attr.name="other"')
    path.write_text(text, encoding="utf-8")
    with pytest.raises(
        GraphMLError, match=r"viewpoint of node 0 must be a finite number\. Got None"
    ):
        read_graphml(path)


def test_missing_file_is_reported_as_such(tmp_path):
    with pytest.raises(FileNotFoundError) as info:
        read_graphml(tmp_path / "none.graphml")
    assert isinstance(info.value, GraphMLError)
    assert str(info.value).startswith("path must name an existing GraphML file. Got '")
    assert str(info.value).endswith("none.graphml'.")


def test_what_is_no_graph_file_is_refused(tmp_path):
    with pytest.raises(GraphMLError, match=r"^path must be a path\. Got None\.$"):
        read_graphml(None)
    with pytest.raises(GraphMLError, match=r"^path must name a GraphML file\. Got the folder '"):
        read_graphml(tmp_path)


def test_a_folder_is_not_made(tmp_path):
    with pytest.raises(
        OutputError, match=r"^path must be a file that can be written\. Got '.*g\.graphml': No such"
    ):
        write_graphml(small_graph(), tmp_path / "nowhere" / "g.graphml")
    assert not list(tmp_path.iterdir())


# No damage to a GraphML file leads to anything but a graph or the package's own error, and no
# warning.


@pytest.mark.parametrize("damage", [damaged_bytes, damaged_encoding, damaged_numbers, damaged_xml])
def test_damage(tmp_path, damage):
    rng = np.random.default_rng(20240229)
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    data = path.read_bytes()
    messages = []
    for _ in range(250):
        path.write_bytes(damage(data, rng))
        try:
            assert len(read_graphml(path)) <= len(small_graph()) + 1
        except GraphMLError as error:
            messages.append(str(error))
    assert len(messages) > 80
    assert not any("\n" in message for message in messages)


@pytest.mark.parametrize("declared", ["utf-9", "hex", "unicode_escape", "undefined"])
def test_an_encoding_that_is_none(tmp_path, declared):
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    path.write_bytes(
        path.read_bytes().replace(b"encoding='utf-8'", f"encoding='{declared}'".encode())
    )
    with pytest.raises(GraphMLError, match="must be GraphML with integer node ids"):
        read_graphml(path)


def test_a_missing_type_is_not_guessed(tmp_path):
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    path.write_bytes(path.read_bytes().replace(b' attr.type="double"', b"", 1))
    with pytest.raises(GraphMLError, match="No key type"):
        read_graphml(path)


def test_a_packed_file_that_is_cut_off(tmp_path):
    write_graphml(small_graph(), tmp_path / "g.graphml.gz")
    for data in (b"\x1f\x8b\x08\x00cut", b"plain"):
        (tmp_path / "g.graphml.gz").write_bytes(data)
        with pytest.raises(GraphMLError, match="must be GraphML"):
            read_graphml(tmp_path / "g.graphml.gz")


# Stability, richest domains and ways between domains, of a box whose domains are known by hand.
# An edge of a convex body is observable from every point that lies outside the plane of one of
# its two faces.


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
