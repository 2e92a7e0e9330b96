"""The picture of the graph and the cross-section show what the graph says."""

from __future__ import annotations

import builtins

import networkx as nx
import numpy as np
import pytest
import shapely
from solids import (
    L_PROFILE,
    SLOT_ENTITIES,
    SLOT_PROFILE,
    STEP_ENTITIES,
    TWO_POCKET_ENTITIES,
    cube,
    l_block,
    slotted_block,
    two_pocket_block,
)

from aspectgraph import (
    EntityError,
    MissingExtraError,
    WorkspaceError,
    build_aspect_graph,
    complete_aspect_graph,
    plot_graph,
    plot_section,
    read_graphml,
    write_graphml,
)
from aspectgraph.plot.traces import NOTHING, list_colors, list_text
from aspectgraph.plot.views import crossings, hits, layout, least_stress

plt = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(autouse=True)
def _no_window():
    plt.switch_backend("Agg")
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def slotted():
    return build_aspect_graph(slotted_block(), SLOT_ENTITIES)


@pytest.fixture(scope="module")
def pockets():
    return build_aspect_graph(two_pocket_block(), TWO_POCKET_ENTITIES)


@pytest.fixture(scope="module")
def step():
    return build_aspect_graph(l_block(), STEP_ENTITIES)


def test_every_node_is_labelled_with_its_list(slotted):
    drawing = plot_graph(slotted)
    labels = {node: text.get_text() for node, text in drawing.labels.items()}
    lists = {
        node: " ".join(listed) or "none" for node, listed in slotted.graph.nodes(data="observable")
    }
    assert labels == lists
    assert len(drawing.nodes.get_offsets()) == 8
    assert len(drawing.edges.get_segments()) == 11


def test_lines_join_the_circles_of_adjacent_domains(pockets):
    drawing = plot_graph(pockets)
    for (i, j), segment in zip(pockets.graph.edges, drawing.edges.get_segments(), strict=True):
        assert segment == pytest.approx(np.array([drawing.positions[i], drawing.positions[j]]))


def test_circles_grow_with_volume_and_lines_with_area(pockets):
    drawing = plot_graph(pockets)
    for sizes, values in (
        (drawing.nodes.get_sizes(), [v for _, v in pockets.graph.nodes(data="volume")]),
        (drawing.edges.get_linewidths(), [a for *_, a in pockets.graph.edges(data="area")]),
    ):
        order = np.argsort(values)
        assert (np.diff(np.asarray(sizes)[order]) >= -1e-9).all()
        assert max(sizes) > 2 * min(sizes)


def test_outlines_tell_bounded_domains_from_open_ones():
    graph = nx.path_graph(3)
    graph.graph["entities"] = ("a",)
    for node, is_open in enumerate((True, False, True)):
        graph.nodes[node].update(
            observable=("a",) if node == 1 else (), volume=1.0, unbounded=is_open
        )
    nx.set_edge_attributes(graph, 1.0, "area")
    drawing = plot_graph(graph)
    dashed = [dashes is not None for _, dashes in drawing.nodes.get_linestyle()]
    assert dashed == [True, False, True]
    explained = [text.get_text() for text in drawing.ax.get_legend().get_texts()]
    assert explained == ["open to the workspace's boundary", "bounded domain"]
    assert plot_graph(graph, legend=False).ax.get_legend() is None


def test_boundaries_of_type_b_alone_are_dashed(pockets):
    drawing = plot_graph(pockets)
    for (*_, data), (_, dashes) in zip(
        pockets.graph.edges(data=True), drawing.edges.get_linestyle(), strict=True
    ):
        assert (dashes is not None) == ({surface.type for surface in data["surfaces"]} == {"B"})


def test_a_graph_from_a_file_looks_the_same(slotted, tmp_path):
    write_graphml(slotted, tmp_path / "graph.graphml")
    figure, (left, right) = plt.subplots(1, 2)
    one = plot_graph(slotted, ax=left)
    two = plot_graph(read_graphml(tmp_path / "graph.graphml"), ax=right)
    assert (one.ax, two.ax) == (left, right)
    assert figure.axes == [left, right]
    assert np.array(list(one.positions.values())) == pytest.approx(
        np.array(list(two.positions.values()))
    )


def test_the_complete_graph_has_no_lists_and_can_be_labelled():
    graph = complete_aspect_graph(cube())
    assert plot_graph(graph).labels == {}
    drawing = plot_graph(graph, labels={0: "first"}, colors=dict.fromkeys(graph, "red"))
    assert [text.get_text() for text in drawing.labels.values()] == ["first"]
    assert drawing.nodes.get_facecolors()[:, :3] == pytest.approx(
        np.tile([1.0, 0.0, 0.0], (len(graph), 1))
    )


def test_one_node_alone_can_be_drawn():
    graph = nx.Graph(entities=())
    graph.add_node(0, observable=(), volume=2.0, unbounded=True)
    assert plot_graph(graph).labels[0].get_text() == "none"


@pytest.mark.parametrize(
    ("graph", "message"),
    [
        (nx.Graph(), "at least one node"),
        (nx.path_graph(2), "every node must have a volume.* Got 0 without"),
    ],
)
def test_other_graphs_are_refused(graph, message):
    with pytest.raises(ValueError, match=message):
        plot_graph(graph)


def test_without_matplotlib_the_extra_is_named(slotted, monkeypatch):
    real = builtins.__import__

    def without(name, *rest):
        if name.startswith("matplotlib"):
            raise ImportError(f"No module named {name!r}")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    for draw in (plot_graph, plot_section):
        with pytest.raises(MissingExtraError, match=r"pip install '\.\[plot\]'"):
            draw(slotted)


def test_crossings_are_counted():
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    assert crossings(nx.cycle_graph(4), square) == 0
    assert crossings(nx.complete_graph(4), square) == 1
    assert crossings(nx.Graph([(0, 2), (1, 3)]), square[[0, 2, 1, 3]]) == 1


def test_lines_over_nodes_are_counted():
    path = nx.Graph([(0, 1), (1, 2), (0, 2)])
    assert hits(path, np.array([(0, 0), (1, 0), (2, 0)], float)) == 1
    assert hits(path, np.array([(0, 0), (1, 1), (2, 0)], float)) == 0


def test_no_circle_covers_another(step, slotted, pockets):
    for eag in (step, slotted, pockets):
        points = np.array(list(layout(eag.graph).values()))
        apart = np.linalg.norm(points[:, None] - points[None], axis=2)
        assert (apart + np.eye(len(points)) > 0.3).all()


def test_distances_are_met_where_they_can_be():
    triangle = least_stress(3.0 * (1.0 - np.eye(3)), np.array([(0, 0), (1, 0), (0, 2)], float))
    sides = np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1)
    assert sides == pytest.approx([3.0, 3.0, 3.0], abs=1e-3)
    line = least_stress(
        np.abs(np.subtract.outer(range(4), range(4))).astype(float),
        np.eye(4)[:, :2] + [[0, 0], [1, 2], [3, 1], [2, 4]],
    )
    assert np.linalg.norm(line[3] - line[0]) == pytest.approx(3.0, abs=1e-2)


def test_small_graphs_are_laid_out_without_crossings_and_always_alike(slotted, pockets):
    for eag in (slotted, pockets):
        places = layout(eag.graph)
        points = np.array(list(places.values()))
        assert crossings(eag.graph, points) == 0
        assert points == pytest.approx(np.array(list(layout(eag.graph).values())))


def test_longer_lists_are_higher(pockets):
    places = layout(pockets.graph)
    lengths = [len(listed) for _, listed in pockets.graph.nodes(data="observable")]
    assert np.corrcoef(lengths, [place[1] for place in places.values()])[0, 1] > 0.6
    assert places[0][1] == max(place[1] for place in places.values())


def test_graphs_in_pieces_have_a_place_for_every_node():
    graph = nx.Graph([(0, 1), (2, 3)])
    places = layout(graph)
    assert sorted(places) == [0, 1, 2, 3]
    assert np.isfinite(np.array(list(places.values()))).all()


@pytest.mark.parametrize(
    ("listed", "text"),
    [
        ((), "none"),
        (("e1",), "e1"),
        (("e2", "e1"), "e1 e2"),
        (("e3", "e2", "e1"), "e1–e3"),
        (("e1", "e2", "e3", "e5", "rim"), "e1–e3 e5 rim"),
        (("e1", "e3", "e5", "rim", "slot"), "e1 e3 e5 rim\nslot"),
        (("e3", "rim", "slot"), "e3 rim slot"),
        (("e3", "a much longer name", "rim"), "e3 rim\na much longer name"),
    ],
)
def test_lists_as_text(listed, text):
    names = ["e1", "e2", "e3", "e5", "rim", "slot", "a much longer name"]
    assert list_text(listed, names) == text


def test_equal_lists_have_equal_colours_and_different_ones_different(step):
    colors = list_colors(step.graph)
    lists = dict(step.graph.nodes(data="observable"))
    for i in lists:
        for j in lists:
            assert (colors[i] == colors[j]) == (lists[i] == lists[j])
    assert [colors[node] for node in lists if not lists[node]] == [NOTHING]


def test_a_hundred_lists_have_a_hundred_colours():
    graph = nx.empty_graph(100)
    nx.set_node_attributes(graph, {node: (f"e{node}",) for node in graph}, "observable")
    assert len(set(list_colors(graph).values())) == 100


# cross-sections


@pytest.mark.parametrize(
    ("eag", "options", "outline"),
    [
        ("slotted", {}, SLOT_PROFILE),
        ("step", {}, L_PROFILE),
        ("step", {"axis": "y", "at": 1.5}, [(0, 0), (1, 0), (1, 2), (0, 2)]),
        ("step", {"axis": "x", "at": 2.0}, [(0, 0), (1, 0), (1, 2), (0, 2)]),
    ],
)
def test_the_section_of_the_part_is_its_profile(eag, options, outline, request):
    drawing = plot_section(request.getfixturevalue(eag), **options)
    profile = shapely.Polygon(outline)
    assert drawing.solid.symmetric_difference(profile).area < 1e-4 * profile.area


@pytest.mark.parametrize(("axis", "right", "up"), [("x", 1, 2), ("y", 0, 2), ("z", 0, 1)])
def test_the_section_agrees_with_point_location(pockets, axis, right, up):
    drawing = plot_section(pockets, axis=axis, at=2.2)
    rng = np.random.default_rng(3)
    low, high = (
        np.array(limits)
        for limits in zip(drawing.ax.get_xlim(), drawing.ax.get_ylim(), strict=True)
    )
    points = np.full((400, 3), 2.2)
    points[:, [right, up]] = rng.uniform(low, high, (400, 2))
    for point, node in zip(points, pockets.domain_of(points).tolist(), strict=True):
        at = shapely.Point(point[right], point[up])
        drawn = [key for key, geometry in drawing.domains.items() if geometry.contains(at)]
        assert drawn == ([node] if node >= 0 else [])
        assert drawing.solid.contains(at) == (node < 0)


def test_type_b_surfaces_of_the_slot_are_where_they_must_be(slotted):
    # the far edge of the slot's floor appears over the near rim: lines through (6, 2) (4, 3) and (4, 2) (6, 3)
    segments = plot_section(slotted).surfaces["B"].get_segments()
    assert segments
    for segment in segments:
        distances = [
            abs(y - (2.0 + side * (x - x0) / 2.0))
            for side, x0 in ((-1, 6), (1, 4))
            for x, y in segment
        ]
        assert min(max(distances[:2]), max(distances[2:])) < 1e-4


def test_type_a_surfaces_of_the_slot_are_planes_of_faces(slotted):
    for (x0, y0), (x1, y1) in plot_section(slotted).surfaces["A"].get_segments():
        assert (x0 == pytest.approx(x1) and min(abs(x0 - x) for x in (2, 4, 6, 8)) < 1e-6) or (
            y0 == pytest.approx(y1) and min(abs(y0 - y) for y in (1, 2, 3)) < 1e-6
        )


def test_pierced_entities_are_named_in_the_section(slotted):
    named = {text.get_text() for text in plot_section(slotted).ax.texts}
    assert {"e1", "e2", "e3", "e4", "e1 e2", "none"} <= named
    assert "e3" not in {
        text.get_text() for text in plot_section(slotted, box=[(0, 0, 0), (5, 5, 6)]).ax.texts
    }


def test_bad_sections_are_refused(slotted):
    with pytest.raises(ValueError, match=r"axis must be 'x', 'y' or 'z'. Got 'w'"):
        plot_section(slotted, axis="w")
    with pytest.raises(WorkspaceError, match="box must overlap the workspace"):
        plot_section(slotted, box=[(1e4, 0, 0), (2e4, 1, 1)])
    with pytest.raises(WorkspaceError, match=r"shape \(2, 3\)"):
        plot_section(slotted, box=[0, 1])
    with pytest.raises(WorkspaceError, match=r"at must be in the workspace.* Got 1e\+06"):
        plot_section(slotted, at=1e6)


@pytest.mark.parametrize(
    ("draw", "kinds", "makers"),
    [
        (plot_graph, "an EntityAspectGraph or a networkx.Graph", "and read_graphml make one"),
        (plot_section, "an EntityAspectGraph", "makes one"),
    ],
)
def test_what_is_no_graph_is_refused(draw, kinds, makers):
    with pytest.raises(EntityError) as info:
        draw(cube())
    assert str(info.value) == f"eag must be {kinds}. Got a Solid; build_aspect_graph {makers}."


def test_a_section_needs_the_part():
    with pytest.raises(EntityError, match=r"^eag must be an EntityAspectGraph\. Got a Graph;"):
        plot_section(nx.path_graph(2))
