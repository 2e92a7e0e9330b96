"""Rims seen as one flat disc: which discs are free, and that their regions are those of all chords."""

from __future__ import annotations

import numpy as np
import pytest
from engine_pairs import solid_of, workspace_of
from real_parts import real_part
from rimmed_solids import PITCH, PlateBuilder, lattice_circle, rimmed_solid

from aspectgraph import Solid, compute_regions, read_solid
from aspectgraph.graph.complete_graph import SightLines
from aspectgraph.visibility import blocked_sets
from aspectgraph.visibility.blocked_sets import Disc, free_disc
from aspectgraph.visibility.visibility_regions import laid_out

pytestmark = pytest.mark.uncompiled

HEIGHT = 6
MIDDLE = PITCH // 2
WORKSPACE = ((-100, -100, -100), (120, 120, 1200))


def plate(to: int, inner: tuple[int, int] | None = None) -> Solid:
    """A hole to z = `to` in the middle of a plate, or a boss, with a smaller feature in its end."""
    builder = PlateBuilder(1, 1, HEIGHT)
    builder.add((MIDDLE, MIDDLE), 50, to, inner)
    part = builder.part("plate")
    return Solid(part.vertices, part.faces, name="plate")


def disc_at(solid: Solid, z: float, radius: float) -> Disc | None:
    (rim,) = (
        rim
        for rim in solid.rims()
        if rim.centre[2] == pytest.approx(z) and rim.radius_mm == pytest.approx(radius)
    )
    solid, _, entities, _, scene = laid_out(solid, [rim], None)
    return free_disc(scene, solid, entities[rim.id])


LARGE = 50**0.5
SMALL = 5**0.5


@pytest.mark.parametrize(
    ("to", "inner", "z", "radius"),
    [
        (0, None, HEIGHT, LARGE),
        (0, None, 0, LARGE),
        (2, None, HEIGHT, LARGE),
        (2, None, 2, LARGE),
        (3, (5, 1), 3, LARGE),
        (3, (5, 1), 1, SMALL),
        (3, (5, 5), HEIGHT, LARGE),
        (3, (5, 5), 5, SMALL),
    ],
)
def test_the_opening_and_the_floor_of_a_hole_are_free(to, inner, z, radius):
    disc = disc_at(plate(to, inner), z, radius)
    assert disc is not None
    assert disc.certified.all()


@pytest.mark.parametrize(
    ("to", "inner", "z", "radius"),
    [
        # the solid is inside it
        (HEIGHT + 5, None, HEIGHT, LARGE),
        (3, (5, 5), 3, SMALL),
        # a pin stands in it, or goes through it
        (3, (5, 5), 3, LARGE),
        (3, (5, HEIGHT + 3), HEIGHT, LARGE),
    ],
)
def test_a_disc_with_solid_in_it_is_not_free(to, inner, z, radius):
    assert disc_at(plate(to, inner), z, radius) is None


def test_the_top_of_a_part_is_certified_from_above_only():
    disc = disc_at(plate(HEIGHT + 5), HEIGHT + 5, LARGE)
    assert disc is not None
    up = disc.plane[2] > 0
    assert disc.certified.tolist() == [[up, not up]]


def viewpoints(solid: Solid, n: int) -> np.ndarray:
    """Points anywhere and, half of them, near the part."""
    rng = np.random.default_rng(4)
    low, high = solid.bounds
    room = (high - low).max()
    points = rng.uniform(low - 2 * room, high + 2 * room, (n, 3))
    points[::2] = rng.uniform(low - 0.3 * room, high + 0.3 * room, (len(points[::2]), 3))
    return points


@pytest.mark.parametrize("first", range(0, 12, 4))
def test_the_disc_gives_the_region_of_all_chords(first, monkeypatch):
    n_discs = 0
    for seed in range(first, first + 4):
        part, _ = rimmed_solid(seed)
        solid = solid_of(part)
        rims = solid.rims()[:6]
        workspace = workspace_of(part)
        points = np.clip(viewpoints(solid, 3000), *workspace)
        seen = compute_regions(solid, rims, workspace).observable(points)
        with monkeypatch.context() as patch:
            patch.setattr(blocked_sets, "free_disc", lambda *_: None)
            expected = compute_regions(solid, rims, workspace).observable(points)
        solid, _, entities, _, scene = laid_out(solid, rims, workspace)
        n_discs += sum(free_disc(scene, solid, one) is not None for one in entities.values())
        assert (seen == expected).all()
        assert expected.any()
    assert n_discs > 8


def test_a_rim_is_seen_around_a_body_that_floats_over_its_hole():
    """Of two bodies, one hides the rim only from where it looks as large as the hole."""
    builder = PlateBuilder(1, 1, HEIGHT)
    builder.add((MIDDLE, MIDDLE), 50, 0)
    part = builder.part("plate")
    n = len(part.vertices)
    corners = [(MIDDLE + x, MIDDLE + y, z) for x in (-1, 1) for y in (-1, 1) for z in (20, 22)]
    box = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [*part.faces, *((tuple(n + v for v in loop), ()) for loop in box)]
    solid = Solid([*part.vertices, *corners], faces, name="plate and body")
    (rim,) = (rim for rim in solid.rims() if rim.centre[2] == pytest.approx(HEIGHT))
    regions = compute_regions(solid, [rim], WORKSPACE)
    heights = np.array([23, 24, 40, 200, 1000])
    points = np.column_stack([np.full((5, 2), MIDDLE + 0.05), heights])
    # the shadow of the body's top corner on the plate's face reaches so far from the axis
    reach = 2**0.5 * (heights - HEIGHT) / (heights - 22)
    # the corners lie at 7.07, the middles of the longest sides at 6.7
    assert ((reach < 6.5) | (reach > 7.2)).all()
    assert regions.observable(points)[:, 0].tolist() == (reach < 6.5).tolist()


def test_the_wide_rim_of_a_cone_is_seen_from_both_sides():
    """A convex part: an edge is seen in front of one of its faces. From below, the whole part is before the disc."""
    low = [(x, y, 0) for x, y in lattice_circle(50)]
    high = [(2 * x, 2 * y, 10) for x, y in lattice_circle(50)]
    n = len(low)
    walls = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    solid = Solid(
        [*low, *high], [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *walls], name="cone"
    )
    rng = np.random.default_rng(3)
    points = rng.uniform(-60, 60, (3000, 3))
    points[::3] = rng.uniform((-5, -5, -90), (5, 5, -20), (len(points[::3]), 3))
    (rim,) = (rim for rim in solid.rims() if rim.radius_mm > 10)
    seen = compute_regions(solid, [rim], ((-99, -99, -99), (99, 99, 99))).observable(points)[:, 0]
    normals = solid.normals[2:]
    offsets = (normals * solid.vertices[[loop[0] for loop in walls]]).sum(axis=1)
    in_front = (points @ normals.T > offsets).all(axis=1)
    assert (in_front & (points[:, 2] < 0)).sum() > 500
    assert (seen == ((points[:, 2] > 10) | in_front)).all()


def test_a_piece_that_looks_thinner_than_the_resolution_hides_no_half_of_space(monkeypatch):
    """Chord by chord: a triangle seen on edge, whose upper and lower bound agree to within the resolution."""
    solid = read_solid(real_part("nist_ctc_04_ap242.stp"))
    (rim,) = (r for r in solid.rims() if np.allclose(r.centre, (95, 181.844, -25.08), atol=1e-3))
    monkeypatch.setattr(blocked_sets, "free_disc", lambda *_: None)
    regions = compute_regions(solid, [rim])
    in_steps = np.array(
        [[-128825.649, -281430.457, -14610.337], [-125304.682, -279446.211, -13999.66]]
    )
    points = regions.grid.to_mm(in_steps)
    assert SightLines(solid, list(regions.entities.values()), 360).arrive(points).all()
    assert regions.observable(points).all()
