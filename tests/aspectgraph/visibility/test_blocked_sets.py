"""Blocked sets: what bounds them, by their definition, and that nothing is listed twice or for nothing."""

from __future__ import annotations

import numpy as np
import pytest
import solids

from aspectgraph.entities.entity import resolve_entities
from aspectgraph.exact.grid import side_of
from aspectgraph.visibility.blocked_sets import blockers
from aspectgraph.visibility.scene import (
    EDGE_AND_END,
    FACE,
    VERTEX_AND_ENTITY,
    entity_ends,
    make_scene,
)

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
