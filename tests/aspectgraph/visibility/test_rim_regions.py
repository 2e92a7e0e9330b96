"""Rims seen as a whole: known answers for prismatic holes and bosses, and the exact referee chord by chord."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exact_checker import ExactChecker
from rimmed_solids import PITCH, PlateBuilder, compare_rims, lattice_circle, rimmed_solid
from solids import prism

from aspectgraph import Solid, build_aspect_graph, compute_regions, read_solid
from aspectgraph.graph.complete_graph import SightLines

EXAMPLES = Path(__file__).parents[3] / "examples"

HEIGHT = 6
MIDDLE = PITCH // 2
WORKSPACE = ((-100, -100, -100), (120, 120, 100))


def plate(square: int, to: int) -> Solid:
    """One feature in the middle of a plate: a hole to z = `to`, right through at 0, or a boss above the plate."""
    builder = PlateBuilder(1, 1, HEIGHT)
    builder.add((MIDDLE, MIDDLE), square, to)
    part = builder.part("plate")
    return Solid(part.vertices, part.faces, name="plate")


def rim_at(solid: Solid, z: float):
    (rim,) = [rim for rim in solid.rims() if rim.centre[2] == pytest.approx(z)]
    return rim


def viewpoints(n: int = 4000) -> np.ndarray:
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
    points = viewpoints()
    expected = in_prism(points, square) & (points[:, 2] > floor)
    assert 50 < expected.sum() < len(points) - 50
    assert (seen(plate(square, floor), floor, points) == expected).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize("square", [5, 25, 65])
def test_upper_rim_of_a_through_hole_is_seen_from_above_and_through_the_hole(square):
    points = viewpoints()
    expected = (points[:, 2] > HEIGHT) | in_prism(points, square)
    below = expected & (points[:, 2] < 0)
    assert below.sum() > 20
    assert (seen(plate(square, 0), HEIGHT, points) == expected).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize("square", [5, 25, 65])
def test_upper_rim_of_a_boss_is_seen_from_above_only(square):
    points = viewpoints()
    assert (
        seen(plate(square, HEIGHT + 5), HEIGHT + 5, points) == (points[:, 2] > HEIGHT + 5)
    ).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize("square", [5, 50])
def test_lower_rim_of_a_boss_is_seen_from_nowhere(square):
    assert not seen(plate(square, HEIGHT + 5), HEIGHT, viewpoints()).any()


@pytest.mark.parametrize("first", range(0, 12, 4))
def test_engine_never_disagrees_with_the_referee(first):
    compared = [compare_rims(seed, 90, 3) for seed in range(first, first + 4)]
    assert [pair for comparison in compared for pair in comparison.disagreements] == []
    assert 0.15 < np.mean([comparison.referee.mean() for comparison in compared]) < 0.85


@pytest.mark.uncompiled
def test_a_rim_is_seen_where_all_its_chords_are():
    """The chords of an eight-sided hole are straight edges, too, and their regions are computed one by one."""
    solid = plate(5, 2)
    rim = rim_at(solid, 2)
    chords = compute_regions(solid, list(rim.edge_ids), WORKSPACE)
    points = viewpoints()
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
    viewpoints = np.array(
        [
            (-1574.393, 872.998, -89.728),
            (1929.582, -31.711, -91.929),
            (-970.802, -198.308, -147.117),
        ]
    )
    regions = compute_regions(solid, {"rim": rim})
    assert SightLines(solid, list(regions.entities.values()), 360).arrive(viewpoints).all()
    assert regions.observable(viewpoints).all()
