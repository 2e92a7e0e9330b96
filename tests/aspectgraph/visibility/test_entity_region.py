"""From where stretches of edges and runs of rims are observable: known answers, the exact referee, and rays."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from engine_pairs import compare_stretches, sharp_edges, solid_of, stretched, workspace_of
from exact_checker import ExactChecker
from generated_solids import cell_solid, generated_solid
from real_parts import real_part
from rimmed_solids import PITCH, PlateBuilder, compare_rims, lattice_circle, rimmed_solid
from solids import prism

from aspectgraph import (
    EntityError,
    Run,
    Solid,
    Stretch,
    build_aspect_graph,
    compute_light,
    compute_regions,
    pieces_of_edge,
    plot_solid,
    read_graphml,
    read_solid,
    resolve_entities,
    run_arc,
    runs_of,
    write_graphml,
)
from aspectgraph.graph.build_graph import SightLines
from aspectgraph.solid.solid import RayScene
from aspectgraph.visibility import visibility_regions
from aspectgraph.visibility.entity_region import find_pieces, observable_region
from aspectgraph.visibility.scene import cut_point

N_EIGHTHS = 140
N_SEVENTHS = 80

# ------------------------------------------------------------------------------------------------- known answers


@pytest.fixture(scope="module")
def bridged():
    """A block 12 × 6 × 4 with a slot along x, 2 wide and 2 deep, and a bar across it, 5 ≤ x ≤ 7, 3 ≤ z ≤ 4."""
    full = np.ones((3, 3, 3), dtype=bool)
    full[:, 1, 1:] = False
    full[1, 1, 2] = True
    return solid_of(cell_solid(full, [[0, 5, 7, 12], [0, 2, 4, 6], [0, 2, 3, 4]], "bridged slot"))


def edge_between(solid: Solid, start, end) -> int:
    ends = sorted([list(map(float, start)), list(map(float, end))])
    (found,) = [e.id for e in solid.edges if sorted(solid.edge_points(e.id).tolist()) == ends]
    return found


def along_x(solid: Solid, edge: int, low: int, high: int, length: int) -> Stretch:
    """Return the stretch of an edge from x = low to x = high, whichever way the edge runs."""
    ends = (Fraction(low, length), Fraction(high, length))
    if solid.edge_points(edge)[0][0] > 0:
        ends = (1 - ends[1], 1 - ends[0])
    return Stretch(edge, *ends)


def test_a_bar_across_a_slot_hides_the_middle_of_its_edge(bridged):
    """The floor edge at y = 2, z = 2, seen from above the block, in front of the edge's wall, and over the other one.

    What the bar hides is told in the plane of x and z, as it fills the slot's width: a point p of the edge is hidden
    from v if the line pv passes the bar's section. For the end stretch [0, 5] no line does if v.x ≤ 5; otherwise that
    from p = 5 does. So with [7, 12]. No v is beside both.
    """
    edge = edge_between(bridged, (0, 2, 2), (12, 2, 2))
    parts = {
        "whole": edge,
        "left": along_x(bridged, edge, 0, 5, 12),
        "right": along_x(bridged, edge, 7, 12, 12),
        "shorter": along_x(bridged, edge, 0, 3, 12),
    }
    regions = compute_regions(bridged, parts, ((-30, -30, -30), (40, 40, 40)))
    rng = np.random.default_rng(0)
    points = np.array([0.0, 2.0, 4.0]) + rng.random((20_000, 3)) * [12, 4, 8]
    points[::2, 2] = 4 + 0.5 * rng.random(10_000)
    x, y, z = points.T
    over_the_wall = (y <= 4) | (z - 2 >= y - 2)
    seen = dict(zip(regions.entity_names, regions.observable(points).T, strict=True))
    assert not seen["whole"].any()
    assert (seen["left"] == (over_the_wall & (x <= 5))).all()
    assert (seen["right"] == (over_the_wall & (x >= 7))).all()
    # from p = 3 the line passes over the bar's upper left corner (5, 4) if it has risen by 2 there
    over_the_bar = (x <= 5) | (2 * (z - 2) >= 2 * (x - 3))
    assert (seen["shorter"] == (over_the_wall & over_the_bar)).all()
    assert 0.2 < seen["left"].mean() < 0.6
    assert (seen["shorter"] & ~seen["left"]).sum() > 500


def test_a_pin_hides_the_runs_with_chords_in_its_shadow():
    """Just above the plate and far below the pin's top, the plan decides: triangle of viewpoint and chord, and pin."""
    builder = PlateBuilder(2, 1, 6)
    middle = PITCH // 2
    builder.add((middle, middle), 25, 0)
    builder.add((middle + PITCH, middle), 5, 60)
    part = builder.part("hole and pin")
    solid = Solid(part.vertices, part.faces)
    (rim,) = [r for r in solid.rims() if r.centre[2] == 6 and r.radius_mm == pytest.approx(5)]
    pin = shapely.Polygon(np.add(lattice_circle(5), [middle + PITCH, middle]))
    rng = np.random.default_rng(1)
    points = rng.uniform([22, -20, 6.001], [60, 40, 7], (400, 3))
    points = points[~shapely.contains_xy(pin, *points[:, :2].T)]
    chords = solid.vertices[[solid.edges[e].vertices for e in rim.edge_ids]][:, :, :2]
    free = np.array(
        [
            [shapely.Polygon([v[:2], *chord]).intersection(pin).area < 1e-9 for chord in chords]
            for v in points
        ]
    )
    runs = runs_of(rim, 0.5)
    seen = compute_regions(solid, [rim.id, *runs], ((-90, -90, -90), (120, 120, 120))).observable(
        points
    )
    assert (seen[:, 0] == free.all(axis=1)).all()
    for column, run in enumerate(runs, start=1):
        own = np.isin(rim.edge_ids, run_arc(solid, run).edge_ids)
        assert (seen[:, column] == free[:, own].all(axis=1)).all()
    hidden = ~seen[:, 0]
    assert hidden.mean() > 0.2
    assert seen[hidden, 1:].any(axis=1).mean() > 0.3


# ------------------------------------------------------------------------------------------------------ referee


@pytest.mark.parametrize("first", range(0, N_EIGHTHS, 35))
def test_engine_never_disagrees_with_the_referee_on_eighths(first):
    """Ends that are points of the grid, and viewpoints on partition planes.

    A fault that one solid in fifty shows is missed by 6 % of such draws of 140. An engine that took the whole edge for
    its stretch would show it in more than half of the solids.
    """
    compared = [compare_stretches(seed, 40, 6, 8) for seed in range(first, first + 35)]
    assert [pair for comparison, _ in compared for pair in comparison.disagreements()] == []
    assert sum(comparison.engine.size for comparison, _ in compared) > 7_000
    assert 0.3 < np.mean([comparison.referee.mean() for comparison, _ in compared]) < 0.7
    assert np.mean([(c.referee != whole).any() for c, whole in compared]) > 0.5


@pytest.mark.parametrize("first", range(0, N_SEVENTHS, 40))
def test_engine_never_disagrees_with_the_referee_on_sevenths(first):
    """Ends that no grid of twos holds, many of them off their edge's line by less than a step."""
    compared = [compare_stretches(seed, 40, 6, 7, factor=7) for seed in range(first, first + 40)]
    assert [pair for comparison, _ in compared for pair in comparison.disagreements()] == []
    assert np.mean([(c.referee != whole).any() for c, whole in compared]) > 0.5


def test_the_triangle_of_an_edge_is_the_union_of_those_of_its_pieces():
    """The referee, which knows no regions: an edge is observable where all its quarters are; so by the engine."""
    n_free = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        part = generated_solid(seed)
        checker = ExactChecker(part.vertices, part.faces, 64)
        edge = sharp_edges(part, checker)[seed % 3]
        quarters = [Fraction(k, 4) for k in range(5)]
        _, cut, pairs = stretched(part, checker, [edge] * 4, list(pairwise(quarters)))
        workspace = workspace_of(part)
        points = rng.integers(workspace[0] * 64, workspace[1] * 64, (60, 3)) / 64
        points = points[checker.generic(points)]
        (whole,) = checker.observable(points, [edge]).T
        assert (whole == cut.observable(points, pairs).all(axis=1)).all()
        solid = solid_of(part)
        ids = [e.id for e in solid.edges if set(e.vertices) == set(edge)]
        names = [*ids, *(Stretch(ids[0], *ends) for ends in pairwise(quarters))]
        entities = resolve_entities(
            solid, {str(name): name for name in names}, min_dihedral_deg=1e-3
        )
        seen = compute_regions(solid, entities, workspace).observable(points)
        assert (seen[:, 0] == whole).all()
        assert (seen[:, 1:].all(axis=1) == whole).all()
        n_free += whole.sum()
    assert 200 < n_free < 900


@pytest.mark.parametrize(
    "name", ["nist_ctc_01_ap242.stp", "mfcad_6-11-11-19.step", "nist_d2mi_827-9999-904.stp"]
)
def test_rays_agree_on_real_parts(name):
    """From 400 viewpoints around eight stretches, 64 rays to each, and many more where the answers differ."""
    solid = read_solid(real_part(name))
    rng = np.random.default_rng(0)
    size = float(np.ptp(solid.bounds, axis=0).max())
    long = [e.id for e in solid.straight_edges() if solid.edge_length_mm(e.id) > 0.03 * size]
    stretches = []
    for edge in rng.choice(long, 8, replace=False).tolist():
        pieces = pieces_of_edge(solid, edge, solid.edge_length_mm(edge) / 3.5)
        stretches.append(pieces[rng.integers(len(pieces))])
    regions = compute_regions(solid, stretches)
    assert regions.grid.snapping_mm > 0
    assert regions.cutting_mm <= regions.grid.step_mm
    points = []
    for entity in regions.entities.values():
        outward = solid.normals[list(solid.edges[entity.edge_ids[0]].faces)].sum(axis=0)
        aside = rng.normal(size=(50, 3))
        ways = outward + aside / np.linalg.norm(aside, axis=1, keepdims=True)
        points.append(entity.endpoints.mean(axis=0) + ways * rng.uniform(0.05, 1.5, (50, 1)) * size)
    viewpoints = np.concatenate(points)
    outside = RayScene(solid.vertices, solid.triangles).signed_distance(viewpoints) > 1e-3
    viewpoints = viewpoints[outside]
    seen = regions.observable(viewpoints)
    rays = SightLines(solid, list(regions.entities.values()), 64).arrive(viewpoints)
    doubtful = np.argwhere(seen != rays)
    assert len(doubtful) < 0.005 * seen.size
    for row, column in doubtful:
        entity = list(regions.entities.values())[column]
        assert SightLines(solid, [entity], 1 << 14).arrive(viewpoints[[row]]) == seen[row, column]
    assert 0.1 < seen.mean() < 0.9


# ------------------------------------------------------------------------------------------------ how parts nest


@pytest.fixture(scope="module")
def plate():
    part, _ = rimmed_solid(3)
    return Solid(part.vertices, part.faces)


@pytest.fixture(scope="module")
def viewpoints(plate):
    rng = np.random.default_rng(4)
    low, high = plate.bounds
    return rng.uniform(low - 30, high + 30, (4000, 3))


def test_a_longer_part_is_seen_from_fewer_places(plate, viewpoints):
    rims = compute_regions(plate, plate.rims()).observable(viewpoints)
    rim = plate.rims()[np.argmax(rims.sum(axis=0))]
    some = plate.straight_edges()[::8]
    edge = some[np.argmax(compute_regions(plate, some).observable(viewpoints).sum(axis=0))].id
    n = len(rim.edge_ids)
    nested = [rim.id, Run(rim.id, 1, n - 1), Run(rim.id, 2, n - 2), Run(rim.id, 3, 4)]
    stretches = [edge, Stretch(edge, "1/8", 1), Stretch(edge, "1/4", "3/4"), f"{edge}[1/3:1/2]"]
    for chain in (nested, stretches):
        seen = compute_regions(plate, chain).observable(viewpoints)
        assert all((seen[:, k] <= seen[:, k + 1]).all() for k in range(3))
        assert seen[:, 0].any()


def test_what_consists_of_pieces_is_the_same_as_computed_alone(plate, viewpoints):
    rim = max(plate.rims(), key=lambda rim: len(rim.edge_ids))
    edge = plate.straight_edges()[-1].id
    quarters = [Stretch(edge, (k, 4), (k + 1, 4)) for k in range(4)]
    longer = Stretch(edge, "1/4", 1)
    together = [rim.id, *runs_of(rim), *quarters, longer]
    regions = compute_regions(plate, together)
    composed, hidden = find_pieces(plate, regions.entities)
    assert composed[longer.name] == tuple(quarter.name for quarter in quarters[1:])
    assert len(composed[rim.id]) == len(hidden) > 1
    seen = regions.observable(viewpoints)
    assert 0.05 < seen.mean() < 0.95
    for column, target in enumerate(together):
        alone = compute_regions(plate, [target])
        assert (alone.observable(viewpoints)[:, 0] == seen[:, column]).all()
    with ThreadPoolExecutor(2) as executor:
        parallel = compute_regions(plate, together, executor=executor)
    assert list(parallel.entities) == list(regions.entities)
    for name, region in regions._regions.items():
        other = parallel._regions[name]
        assert (region.tree.planes == other.tree.planes).all()
        assert (region.observable == other.observable).all()


class Store:
    """A store in memory that counts what it takes."""

    def __init__(self):
        self.regions = {}
        self.n_put = 0

    def begin(self, solid, box_mm, entities):
        self.names = list(entities)

    def get(self, name):
        return self.regions.get(name)

    def put(self, name, region):
        self.n_put += 1
        self.regions[name] = region


def test_kept_regions_are_those_asked_for_and_spare_the_pieces(plate):
    rim = plate.rims()[0]
    store = Store()
    told = []
    names = [rim.id, *runs_of(rim)]
    compute_regions(plate, names, kept=store, progress=lambda *row: told.append(row))
    assert set(store.regions) == set(store.names) == {str(name) for name in names}
    assert [row[0] for row in told] == list(range(1, len(told) + 1))
    assert {row[1] for row in told} == {len(told)}
    assert len(told) > len(names)
    told.clear()
    compute_regions(plate, names, kept=store, progress=lambda *row: told.append(row))
    assert (told, store.n_put) == ([], len(names))


def test_what_is_not_complete_by_the_deadline_is_missing(plate, monkeypatch):
    rim = plate.rims()[0]
    names = [rim.id, *runs_of(rim)]
    assert not compute_regions(plate, names, deadline=0.0).entities
    monkeypatch.setattr(visibility_regions, "observable_region", _without_deadline)
    pieces_only = compute_regions(plate, [plate.straight_edges()[0], *names], deadline=0.0)
    assert [entity.kind for entity in pieces_only.entities.values()] == ["edge"]


def _without_deadline(scene, solid, entity, box, deadline):
    return observable_region(scene, solid, entity, box)


def test_pieces_of_a_name_that_is_taken_get_another(plate):
    rim = plate.rims()[0]
    edge = plate.straight_edges()[0].id
    entities = resolve_entities(
        plate, {"one": Run(rim.id, 0, 4), "two": Run(rim.id, 2, 6), f"{rim.id}[2:4]": edge}
    )
    composed, hidden = find_pieces(plate, entities)
    assert composed["one"] == (f"{rim.id}[0:2]", f"{rim.id}[2:4]+")
    assert not set(hidden) & set(entities)


# --------------------------------------------------------------------------------------------------------- cuts


def test_cuts_are_points_of_the_grid_within_a_step_and_do_not_depend_on_the_direction():
    rng = np.random.default_rng(2)
    off = 0
    for _ in range(300):
        a, b = rng.integers(-(2**19), 2**19, (2, 3)).tolist()
        if rng.random() < 0.5:
            b[0] = a[0]
        if rng.random() < 0.5:
            b[1] = a[1]
        share = Fraction(int(rng.integers(1, 97)), 97)
        cut = cut_point(a, b, share)
        assert cut == cut_point(b, a, 1 - share)
        there = [p + share * (q - p) for p, q in zip(a, b, strict=True)]
        assert sum((x - y) ** 2 for x, y in zip(there, cut.point, strict=True)) <= 1
        way, own = (np.array(x, dtype=object) - a for x in (b, list(cut.point)))
        assert cut.on_line == (not np.cross(way, own).any())
        off += not cut.on_line
    assert 100 < off < 290


def test_a_cut_at_a_point_of_the_grid_is_that_point():
    assert cut_point((0, 0, 0), (8, 4, 12), Fraction(3, 4)) == ((6, 3, 9), True)
    assert cut_point((0, 0, 0), (7, 5, 3), Fraction(1, 2)).on_line is False


def test_a_stretch_needs_a_length_on_the_grid(bridged):
    with pytest.raises(EntityError, match="longer than a grid step"):
        compute_regions(bridged, [Stretch(0, "1/2", Fraction(2**19 + 1, 2**20))])


# ------------------------------------------------------------------------------------------ graphs and pictures


def test_graphs_files_and_pictures_hold_parts(bridged, tmp_path):
    edge = edge_between(bridged, (0, 2, 2), (12, 2, 2))
    left = along_x(bridged, edge, 0, 5, 12)
    right = along_x(bridged, edge, 7, 12, 12)
    eag = build_aspect_graph(bridged, [edge, left, right], ((-30, -30, -30), (40, 40, 40)))
    lists = {data["observable"] for _, data in eag.graph.nodes(data=True)}
    # the whole is seen along the slot only, from where both ends are
    assert {(left.name,), (right.name,), ()} < lists
    assert all({left.name, right.name} <= set(one) for one in lists if f"e{edge}" in one)
    for one, other, data in eag.graph.edges(data=True):
        changed = set(eag.graph.nodes[one]["observable"]) ^ set(
            eag.graph.nodes[other]["observable"]
        )
        assert {surface.entity for surface in data["surfaces"]} == changed
        assert all(v < len(bridged.vertices) for s in data["surfaces"] for v in s.vertices)
    assert eag.graph.graph["parts"] == ("", str(left), str(right))
    path = tmp_path / "graph.graphml"
    write_graphml(eag, path)
    assert read_graphml(path).graph["parts"] == eag.graph.graph["parts"]
    figure = plot_solid(bridged, eag.entities)
    texts = " ".join(str(trace.text) for trace in figure.data)
    assert left.name in texts


def test_lamps_light_a_stretch_wherever_they_light_the_edge(bridged):
    edge = edge_between(bridged, (0, 2, 2), (12, 2, 2))
    parts = [edge, along_x(bridged, edge, 0, 5, 12), along_x(bridged, edge, 5, 12, 12)]
    lit = compute_light(bridged, parts, workspace=((-30, -30, -30), (40, 40, 40)))
    rng = np.random.default_rng(0)
    points = np.concatenate(
        [rng.uniform(-30, 40, (4000, 3)), rng.uniform([0, 2, 2], [12, 4, 3], (4000, 3))]
    )
    whole, *own = lit.observable(points).T
    assert (whole == np.all(own, axis=0)).all()
    assert whole.sum() > 100
    assert (own[0] & ~whole).sum() > 100


# Rims seen as a whole: known answers for prismatic holes and bosses, and the exact referee chord
# by chord.


EXAMPLES = Path(__file__).parents[3] / "examples"

HEIGHT = 6
MIDDLE = PITCH // 2
WORKSPACE = ((-100, -100, -100), (120, 120, 100))


def plate_with(square: int, to: int) -> Solid:
    """One feature in the middle of a plate: a hole to z = `to`, right through at 0, or a boss above the plate."""
    builder = PlateBuilder(1, 1, HEIGHT)
    builder.add((MIDDLE, MIDDLE), square, to)
    part = builder.part("plate")
    return Solid(part.vertices, part.faces, name="plate")


def rim_at(solid: Solid, z: float):
    (rim,) = [rim for rim in solid.rims() if rim.centre[2] == pytest.approx(z)]
    return rim


def points_around(n: int = 4000) -> np.ndarray:
    """Points anywhere around the plate and, half of them, over and under its middle."""
    rng = np.random.default_rng(5)
    points = rng.uniform([-60, -60, -60], [80, 80, 80], (n, 3))
    points[::2, :2] = MIDDLE + rng.uniform(-9, 9, (len(points[::2]), 2))
    return points


def in_prism(points: np.ndarray, square: int) -> np.ndarray:
    """Whether points lie inside the polygon over the feature, at any height: left of every side of it."""
    corners = np.array(lattice_circle(square), dtype=float) + MIDDLE
    sides = np.roll(corners, -1, axis=0) - corners
    offsets = points[:, None, :2] - corners
    return (sides[:, 0] * offsets[:, :, 1] - sides[:, 1] * offsets[:, :, 0] > 0).all(axis=1)


def seen(solid: Solid, z: float, points: np.ndarray) -> np.ndarray:
    return compute_regions(solid, [rim_at(solid, z)], WORKSPACE).observable(points)[:, 0]


@pytest.mark.uncompiled
@pytest.mark.parametrize("square", [5, 25, 50, 65])
@pytest.mark.parametrize("floor", [1, 4])
def test_bottom_rim_of_a_blind_hole_is_seen_from_the_prism_over_it(square, floor):
    points = points_around()
    expected = in_prism(points, square) & (points[:, 2] > floor)
    assert 50 < expected.sum() < len(points) - 50
    assert (seen(plate_with(square, floor), floor, points) == expected).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize("square", [5, 25, 65])
def test_upper_rim_of_a_through_hole_is_seen_from_above_and_through_the_hole(square):
    points = points_around()
    expected = (points[:, 2] > HEIGHT) | in_prism(points, square)
    below = expected & (points[:, 2] < 0)
    assert below.sum() > 20
    assert (seen(plate_with(square, 0), HEIGHT, points) == expected).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize("square", [5, 25, 65])
def test_upper_rim_of_a_boss_is_seen_from_above_only(square):
    points = points_around()
    assert (
        seen(plate_with(square, HEIGHT + 5), HEIGHT + 5, points) == (points[:, 2] > HEIGHT + 5)
    ).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize("square", [5, 50])
def test_lower_rim_of_a_boss_is_seen_from_nowhere(square):
    assert not seen(plate_with(square, HEIGHT + 5), HEIGHT, points_around()).any()


@pytest.mark.parametrize("first", range(0, 12, 4))
def test_engine_never_disagrees_with_the_referee(first):
    compared = [compare_rims(seed, 90, 3) for seed in range(first, first + 4)]
    assert [pair for comparison in compared for pair in comparison.disagreements] == []
    assert 0.15 < np.mean([comparison.referee.mean() for comparison in compared]) < 0.85


@pytest.mark.uncompiled
def test_a_rim_is_seen_where_all_its_chords_are():
    """The chords of an eight-sided hole are straight edges, too, and their regions are computed one by one."""
    solid = plate_with(5, 2)
    rim = rim_at(solid, 2)
    chords = compute_regions(solid, list(rim.edge_ids), WORKSPACE)
    points = points_around()
    assert (seen(solid, 2, points) == chords.observable(points).all(axis=1)).all()


@pytest.mark.uncompiled
def test_an_arc_is_seen_where_all_its_chords_are():
    """A D-shaped hole: the arc's chords and the referee's answer for each."""
    circle = lattice_circle(25)
    profile = [(x, y) for x, y in circle if x <= 3]
    square = [(-10, -10), (10, -10), (10, 10), (-10, 10)]
    solid = prism(square, 4, [profile[::-1]])
    arcs = solid.arcs()
    assert [len(arc.edge_ids) for arc in arcs] == [8, 8]
    checker = ExactChecker.of(solid, 16)
    rng = np.random.default_rng(2)
    points = rng.integers(-20 * 16, 20 * 16, (300, 3)) / 16
    points[::2, :2] /= 8
    points = np.rint(points * 16) / 16
    points = points[checker.generic(points)]
    regions = compute_regions(solid, arcs, ((-50, -50, -50), (50, 50, 50)))
    pairs = [[solid.edges[e].vertices for e in arc.edge_ids] for arc in arcs]
    expected = np.column_stack([checker.observable(points, own).all(axis=1) for own in pairs])
    assert 0.1 < expected.mean() < 0.9
    assert (regions.observable(points) == expected).all()


@pytest.mark.uncompiled
def test_graph_of_rims_and_edges_lists_what_is_observable():
    part, _ = rimmed_solid(0)
    solid = Solid(part.vertices, part.faces)
    names = [*(rim.id for rim in solid.rims()[:3]), solid.straight_edges()[-1]]
    eag = build_aspect_graph(solid, names, WORKSPACE)
    points = np.random.default_rng(0).uniform(-60, 90, (2000, 3))
    nodes = eag.domain_of(points)
    lists = [
        set(eag.graph.nodes[node]["observable"]) if node >= 0 else set() for node in nodes.tolist()
    ]
    flags = eag.observable(points)
    seen_here = [
        {name for name, flag in zip(eag.entity_names, row, strict=True) if flag} for row in flags
    ]
    assert lists == seen_here
    assert sum(len(one) > 0 for one in lists) > 200
    assert all(set(eag.graph.nodes[node]["observable"]) >= {"r0"} for node in eag.covering(["r0"]))


def test_a_piece_nearly_in_line_with_a_chord_blocks_no_more_than_its_shadow():
    """A facet half a metre away, in whose plane a chord ends to within 0.12 mm, must not hide all that is behind it.

    The viewpoints are some from which rays reach every chord, far from that facet's shadow.
    """
    solid = read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")
    (rim,) = [rim for rim in solid.rims() if rim.centre == pytest.approx([160, 45, -50])]
    points_around = np.array(
        [
            (-1574.393, 872.998, -89.728),
            (1929.582, -31.711, -91.929),
            (-970.802, -198.308, -147.117),
        ]
    )
    regions = compute_regions(solid, {"rim": rim})
    assert SightLines(solid, list(regions.entities.values()), 360).arrive(points_around).all()
    assert regions.observable(points_around).all()
