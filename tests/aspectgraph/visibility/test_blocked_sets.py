"""Blocked sets: what bounds them, by their definition, and that nothing is listed twice or for nothing."""

from __future__ import annotations

import numpy as np
import pytest
import solids
from engine_pairs import solid_of, workspace_of
from real_parts import real_part
from rimmed_solids import PITCH, PlateBuilder, lattice_circle, rimmed_solid

from aspectgraph import Solid, compute_regions, read_solid
from aspectgraph.entities.entity import resolve_entities
from aspectgraph.exact.grid import side_of
from aspectgraph.graph.build_graph import SightLines
from aspectgraph.visibility import blocked_sets
from aspectgraph.visibility.blocked_sets import Disc, blockers, free_disc
from aspectgraph.visibility.scene import (
    EDGE_AND_END,
    FACE,
    VERTEX_AND_ENTITY,
    entity_ends,
    make_scene,
)
from aspectgraph.visibility.visibility_regions import laid_out

pytestmark = pytest.mark.uncompiled


def cases():
    for make, entities in (
        (solids.slotted_block, solids.SLOT_ENTITIES),
        (solids.two_pocket_block, solids.TWO_POCKET_ENTITIES),
    ):
        solid = make()
        resolved = resolve_entities(solid, entities)
        _, scene = make_scene(solid, resolved)
        for entity in resolved.values():
            yield scene, solid, entity, blockers(scene, solid, entity)


def test_every_plane_passes_through_what_it_is_said_to_come_from():
    kinds = set()
    for scene, solid, entity, sets in cases():
        ends = set(entity_ends(scene, solid, entity))
        for number in set(sets.plane.tolist()):
            kind, *places = sets.origin[number].tolist()
            kinds.add(kind)
            if kind == FACE:
                places = [v for loop in solid.faces[places[0]].loops for v in loop]
            elif kind == EDGE_AND_END:
                assert places[2] in ends
            else:
                assert kind == VERTEX_AND_ENTITY
                assert set(places[1:]) == ends
            assert all(
                side_of(sets.planes[number], scene.points[v], scene.resolution) == 0 for v in places
            )
    assert kinds == {FACE, EDGE_AND_END, VERTEX_AND_ENTITY}


def test_no_plane_is_cast_for_nothing_or_twice():
    for scene, _, _, sets in cases():
        cast = set(range(len(scene.planes), len(sets.planes)))
        assert cast <= set(sets.plane.tolist())
        assert len(np.unique(sets.planes, axis=0)) == len(sets.planes)
        for k in range(len(sets.first) - 1):
            own = sets.plane[sets.first[k] : sets.first[k + 1]].tolist()
            assert len(set(own)) == len(own)


def test_every_set_but_those_of_the_faces_next_to_it_holds_its_piece_and_not_the_entity():
    for scene, solid, entity, sets in cases():
        ends = scene.points[list(entity_ends(scene, solid, entity))]
        loops = [
            scene.points[scene.pieces.vertices[a:b]]
            for a, b in zip(scene.pieces.first[:-1], scene.pieces.first[1:], strict=True)
        ]
        for k in range(len(sets.first) - 1):
            rows = slice(sets.first[k], sets.first[k + 1])
            halves = sets.planes[sets.plane[rows]] * sets.side[rows, None]
            inside = [bool((loop @ halves[:, :3].T - halves[:, 3] >= 0).all()) for loop in loops]
            assert any(inside)
            assert not (ends @ halves[:, :3].T - halves[:, 3] > 0).all(axis=1).any()


# Rims seen as one flat disc: which discs are free, and that their regions are those of all
# chords.


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
