"""Interactive pictures show the domains as they are, and only what is inside the box."""

from __future__ import annotations

import json

import numpy as np
import pytest
from solids import (
    SLOT_ENTITIES,
    STEP_ENTITIES,
    TWO_POCKET_ENTITIES,
    all_edges,
    box_with_pockets,
    cube,
    l_block,
    slotted_block,
    two_pocket_block,
)

from aspectgraph import (
    AspectGraphError,
    EntityError,
    SolidError,
    WorkspaceError,
    build_aspect_graph,
    build_light_graph,
    compute_regions,
    plot_domains,
    plot_solid,
)
from aspectgraph.plot import traces as clip
from aspectgraph.plot.traces import (
    box_around,
    clip_polygons,
    clipped_facets,
    domain_facets,
    plane_axes,
)
from aspectgraph.plot.views import best_view


@pytest.fixture(scope="module")
def slotted():
    return build_aspect_graph(slotted_block(), SLOT_ENTITIES)


@pytest.fixture(scope="module")
def pockets():
    return build_aspect_graph(two_pocket_block(), TWO_POCKET_ENTITIES)


def named(figure, name):
    return [trace for trace in figure.data if trace.name == name]


def points_of(trace):
    points = np.column_stack([np.asarray(trace[axis], float) for axis in "xyz"])
    return points[~np.isnan(points).any(axis=1)]


def n_crossed(p, q, triangles):
    """How many triangles (t, 3, 3) each segment from p to q, both (n, 3), passes through."""

    def volume(u, v, w, x):
        return np.einsum("...i,...i", np.cross(v - u, w - u), x - u)

    a, b, c = triangles.swapaxes(0, 1)
    p = p[:, None]
    q = q[:, None]
    turns = np.stack([volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)])
    inside = (turns > 0).all(axis=0) | (turns < 0).all(axis=0)
    return (inside & (volume(a, b, c, p) * volume(a, b, c, q) < 0)).sum(axis=1)


def test_squares_are_cut_each_by_its_own_lines():
    everything = [0.0, 0.0, -1.0]
    cuts = np.array(
        [
            [[1.0, 1.0, -1.0], everything],
            [[1.0, 0.0, -0.25], everything],
            [[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
            [[1.0, 0.0, -1.0], everything],
            [[1.0, 1.0, -1.5], [-1.0, -1.0, 0.5]],
        ]
    )
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    triangle, strip, nothing, whole, hexagon = clip_polygons(np.tile(square, (5, 1, 1)), cuts)
    assert sorted(map(tuple, triangle)) == [(0, 0), (0, 1), (1, 0)]
    assert sorted(map(tuple, strip)) == [(0, 0), (0, 1), (0.25, 0), (0.25, 1)]
    assert nothing.shape == (0, 2)
    assert (whole == square).all()
    # in the order of the square, beginning where its first corner was cut off
    assert hexagon.tolist() == [[0.5, 0], [1, 0], [1, 0.5], [0.5, 1], [0, 1], [0, 0.5]]


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, -1, 0), (0.6, 0, 0.8), (1, 2, 3)])
def test_axes_of_a_plane(normal):
    unit = np.array(normal) / np.linalg.norm(normal)
    axes = np.array([*plane_axes(np.array(normal)), unit])
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_facets_of_a_cell_in_a_box():
    # x + y + z <= 1.5 cuts a corner off the unit cube: the cut is a regular hexagon with sides of sqrt(1/2)
    # and a cell of fewer sides, in the same call, is the cube
    half = np.array([[1.0, 1.0, 1.0, -1.5], [1.0, 0.0, 0.0, -2.0]])
    half[0] /= np.sqrt(3.0)
    box = np.array([[0.0, 0, 0], [1, 1, 1]])
    facets = clipped_facets([half, np.array([[1.0, 0.0, 0.0, -2.0]])], box)
    row, hexagon = facets[0]
    assert len(facets) == 7 + 6
    assert all(len(corners) == 4 for _, corners in facets[7:])
    assert (row == half[0]).all()
    sides = np.linalg.norm(hexagon - np.roll(hexagon, 1, axis=0), axis=1)
    assert sides == pytest.approx(np.full(6, np.sqrt(0.5)))


@pytest.mark.parametrize(
    ("solid", "entities"),
    [
        (slotted_block(), SLOT_ENTITIES),
        (two_pocket_block(), TWO_POCKET_ENTITIES),
        (l_block(), all_edges(l_block())),
        (box_with_pockets((5, 5, 3), [(2, 1, 4, 1, 4, 2)]), {"floor": ((1, 1, 1), (4, 1, 1))}),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_the_surface_drawn_separates_a_domain_from_the_rest(solid, entities):
    eag = build_aspect_graph(solid, entities)
    box = box_around(solid, eag.workspace)
    p, q = np.random.default_rng(5).uniform(*box, (2, 400, 3))
    free = (n_crossed(p, q, solid.vertices[solid.triangles]) == 0) & (eag.domain_of(p) >= 0)
    p = p[free]
    q = q[free]
    start = eag.domain_of(p)
    end = eag.domain_of(q)
    for node in eag.graph:
        facets = domain_facets(eag.cells(node), solid, box)
        triangles = np.concatenate([facet.triangles for facet in facets] or [np.zeros((0, 3, 3))])
        changes = (start == node) != (end == node)
        assert (n_crossed(p, q, triangles) % 2 == changes).all()
    assert (start != end).sum() > 10


def test_faces_in_a_plane_are_united_once_for_all_domains(monkeypatch):
    solid = l_block()
    eag = build_aspect_graph(solid, all_edges(solid))
    box = box_around(solid, eag.workspace)
    made = []
    unite = clip._FacePlanes._united

    def counted(planes, key, size):
        made.append((key, size))
        return unite(planes, key, size)

    monkeypatch.setattr(clip._FacePlanes, "_united", counted)
    for node in list(eag.graph)[:6]:
        domain_facets(eag.cells(node), solid, box)
    assert made
    assert len(made) == len(set(made))


def test_no_wall_inside_a_domain_and_none_on_the_part():
    # a cube's "nothing" is empty: one entity, and everything in front of either face sees it, in several cells
    solid = cube()
    eag = build_aspect_graph(solid, {"e": 0})
    for node in eag.graph:
        box = box_around(solid, eag.workspace)
        for triangle in np.concatenate(
            [facet.triangles for facet in domain_facets(eag.cells(node), solid, box)]
        ):
            middle = triangle.mean(axis=0)
            aside = 1e-3 * np.cross(*(triangle[1:] - triangle[0]))
            inside = [
                p for p in (middle - aside, middle + aside) if ((p > box[0]) & (p < box[1])).all()
            ]
            beside = eag.domain_of(inside).tolist()
            assert beside.count(node) == 1
            assert -1 not in beside


def test_everything_drawn_lies_in_the_box(slotted):
    box = np.array([(-2.0, 0, -1), (12, 6, 8)])
    figure = plot_domains(slotted, slotted.graph, box=box)
    for trace in figure.data:
        if trace.name != "names":
            points = points_of(trace)
            assert (points >= box[0] - 1e-6).all()
            assert (points <= box[1] + 1e-6).all()


def test_the_default_box_stays_close_to_the_part(slotted):
    points = np.vstack([points_of(trace) for trace in plot_domains(slotted).data])
    extent = np.ptp(points, axis=0).max()
    part = np.ptp(slotted.solid.bounds, axis=0).max()
    assert extent < 3 * part < np.ptp(slotted.workspace, axis=0).max()


def test_each_viewpoint_lies_in_its_domain_and_sees_its_list(pockets):
    figure = plot_domains(pockets, pockets.graph)
    for node, listed in pockets.graph.nodes(data="observable"):
        (marker,) = named(figure, f"viewpoint {node}")
        (viewpoint,) = points_of(marker)
        assert pockets.domain_of([viewpoint]) == [node]
        (sight,) = named(figure, f"sight lines {node}")
        ends = {tuple(p) for p in points_of(sight) if tuple(p) != tuple(viewpoint)}
        assert ends == {tuple(end) for name in listed for end in pockets.entities[name].endpoints}


def test_the_graphs_viewpoint_is_used_where_it_is_in_the_box():
    eag = build_aspect_graph(slotted_block(), SLOT_ENTITIES, workspace=[(-8, -8, -8), (18, 11, 14)])
    figure = plot_domains(eag, [1, 2], box=eag.workspace)
    for node in (1, 2):
        (marker,) = named(figure, f"viewpoint {node}")
        assert points_of(marker)[0] == pytest.approx(np.array(eag.graph.nodes[node]["viewpoint"]))
        assert (
            "observable: " + ", ".join(eag.graph.nodes[node]["observable"]) in marker.hovertext[0]
        )


def test_the_legend_lists_every_domain_once(slotted):
    figure = plot_domains(slotted)
    entries = [
        trace.name
        for trace in figure.data
        if trace.showlegend and str(trace.legendgroup).startswith("domain")
    ]
    assert [int(name.split(":")[0]) for name in entries] == list(slotted.graph)
    assert entries[0] == "0: e1 e2"
    assert entries[-1] == "7: none"
    shown = {trace.legendgroup for trace in figure.data if trace.visible is True}
    assert shown == {"domain 0", "domain 1", "domain 2"}
    chosen = plot_domains(slotted, [5, 7])
    assert {trace.legendgroup for trace in chosen.data if trace.visible} >= {"domain 5", "domain 7"}


def test_light_domains_are_drawn_with_what_they_light():
    """Their nodes hold lists of what shows, and none of what is observable."""
    graph = build_light_graph(cube(), {"top": 1, "side": 2}, contrast=0.2)
    figure = plot_domains(graph, [0])
    names = graph.graph.nodes[0]["showing"]
    (surface,) = [trace for trace in figure.data if trace.legendgroup == "domain 0"][:1]
    assert surface.name == f"0: {' '.join(names)}"
    (marker,) = named(figure, "viewpoint 0")
    assert f"showing: {', '.join(names)}" in marker.hovertext[0]


def test_a_domain_outside_the_box_says_so(slotted):
    figure = plot_domains(slotted, [1, 2], box=[(8.5, 5, 0), (9.5, 7, 6)])
    names = [trace.name for trace in figure.data if trace.type == "mesh3d"]
    assert names == ["part", "1: e1 e4 (not in this picture)", "2: e2 e3"]


def test_the_figure_is_plain_json(slotted):
    data = json.loads(plot_domains(slotted).to_json())
    assert len(data["data"]) == len(plot_domains(slotted).data)


def test_bad_input_is_refused(slotted):
    with pytest.raises(AspectGraphError, match=r"nodes must be in the graph, 0 to 7. Got 8"):
        plot_domains(slotted, [0, 8])
    with pytest.raises(ValueError, match=r"opacity must be in \(0, 1\]. Got 0"):
        plot_domains(slotted, opacity=0)
    with pytest.raises(WorkspaceError, match="box must overlap the workspace"):
        plot_domains(slotted, box=[(1e5, 0, 0), (2e5, 1, 1)])


def test_a_part_is_drawn_with_its_entities():
    regions = compute_regions(l_block(), STEP_ENTITIES)
    figure = plot_solid(regions)
    (lines,) = named(figure, "entities")
    ends = {tuple(p) for p in points_of(lines)}
    assert {tuple(map(float, end)) for pair in STEP_ENTITIES.values() for end in pair} <= ends
    (names,) = named(figure, "names")
    assert [text.strip("</b>") for text in names.text] == list(STEP_ENTITIES)
    away = points_of(names) - np.array(
        [regions.entities[name].endpoints.mean(axis=0) for name in STEP_ENTITIES]
    )
    assert (np.linalg.norm(away, axis=1) < 0.5).all()


def test_a_bare_part_has_no_entities():
    figure = plot_solid(cube())
    assert [trace.name for trace in figure.data] == ["part", "edges"]
    assert len(points_of(figure.data[1])) == 24
    assert len(figure.data[0].i) == 12


def test_the_legend_names_domains_only_where_they_are_drawn(slotted):
    assert not plot_solid(slotted).layout.legend.title.text
    assert plot_domains(slotted).layout.legend.title.text == "viewing domains"


def test_the_first_view_faces_the_entities():
    block = two_pocket_block()
    entities = compute_regions(block, TWO_POCKET_ENTITIES).entities
    x, y, _ = best_view(block, entities)
    # both pockets open towards +x and +y
    assert x > 0
    assert y > 0


def test_what_is_no_graph_has_no_domains():
    with pytest.raises(EntityError, match=r"^eag must be an EntityAspectGraph\. Got a Solid;"):
        plot_domains(cube())


@pytest.mark.parametrize(("part", "got"), [("x", "'x'"), (3, "3"), ([], "a list")])
def test_what_is_no_part_is_refused(part, got):
    with pytest.raises(SolidError) as info:
        plot_solid(part)
    assert str(info.value) == (
        "part must be a Solid, an EntityAspectGraph or VisibilityRegions. "
        f"Got {got}; read_solid reads a Solid from a file."
    )
