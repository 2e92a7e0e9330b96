"""Entities: found by id, by end points and from files; everything else is refused by name."""

from __future__ import annotations

import json

import numpy as np
import pytest
from solids import (
    SLOT_ENTITIES,
    STEP_ENTITIES,
    TWO_POCKET_ENTITIES,
    box_with_pockets,
    cube,
    l_block,
    plate,
    plate_entities,
    prism,
    slotted_block,
    two_pocket_block,
)

from aspectgraph import Entity, EntityError, Solid, read_entities, resolve_entities


@pytest.mark.parametrize(
    ("solid", "mapping"),
    [
        (l_block(), STEP_ENTITIES),
        (slotted_block(), SLOT_ENTITIES),
        (two_pocket_block(), TWO_POCKET_ENTITIES),
        (plate(3), plate_entities(3, 12)),
    ],
)
def test_end_points_find_their_edges_in_the_order_given(solid, mapping):
    entities = resolve_entities(solid, mapping)
    assert list(entities) == list(mapping)
    for name, (p, q) in mapping.items():
        entity = entities[name]
        assert entity.endpoints == pytest.approx(np.array([p, q], dtype=float))
        assert len(entity.edge_ids) == 1
        assert {tuple(v) for v in solid.edge_points(entity.edge_ids[0])} == {
            tuple(map(float, p)),
            tuple(map(float, q)),
        }


def test_ids_and_lists_of_ids():
    solid = cube()
    assert resolve_entities(solid, {"rim": 4})["rim"].edge_ids == (4,)
    entities = resolve_entities(solid, [3, np.int64(7)])
    assert {name: entity.edge_ids for name, entity in entities.items()} == {"e3": (3,), "e7": (7,)}
    assert entities["e3"].endpoints == pytest.approx(solid.edge_points(3))
    assert entities["e3"].length_mm == 2.0


def test_entities_can_be_resolved_again():
    solid = slotted_block()
    entities = resolve_entities(solid, SLOT_ENTITIES)
    assert resolve_entities(solid, entities) == entities
    with pytest.raises(EntityError, match=r"must be in 0..11"):
        resolve_entities(cube(), entities)


def test_a_chain_of_collinear_edges():
    # The lower step runs under the upper one, so the front rim is cut twice by faces that end at it.
    block = prism([(0, 0), (6, 0), (6, 2), (4, 2), (4, 4), (2, 4), (2, 2), (0, 2)], 1)
    top = resolve_entities(block, {"left": ((0, 2, 1), (2, 2, 1)), "right": ((4, 2, 1), (6, 2, 1))})
    assert len(top["left"].edge_ids) == 1
    with pytest.raises(EntityError, match="ends of an edge"):
        resolve_entities(block, {"gap": ((0, 2, 1), (6, 2, 1))})
    split = split_box()
    chain = resolve_entities(split, {"rim": ((6, 0, 2), (0, 0, 2))})["rim"]
    assert len(chain.edge_ids) == 2
    points = [set(map(tuple, split.edge_points(i).tolist())) for i in chain.edge_ids]
    assert points == [{(6.0, 0.0, 2.0), (3.0, 0.0, 2.0)}, {(3.0, 0.0, 2.0), (0.0, 0.0, 2.0)}]
    assert chain.endpoints.tolist() == [[6.0, 0.0, 2.0], [0.0, 0.0, 2.0]]


def split_box() -> Solid:
    """Box whose front upper rim has a vertex in its middle, where the front face is cut in two."""
    box = box_with_pockets((6, 2, 2))
    vertices = [*box.vertices.tolist(), [3, 0, 2], [3, 0, 0]]
    number = {tuple(v): i for i, v in enumerate(vertices)}
    cuts = {((0, 0, 2), (6, 0, 2)): 8, ((0, 0, 0), (6, 0, 0)): 9}
    faces = []
    for face in box.faces:
        loop = []
        for a, b in face.directed_edges():
            loop.append(a)
            ends = tuple(tuple(map(int, vertices[v])) for v in (a, b))
            loop += [cuts[key] for key in (ends, ends[::-1]) if key in cuts]
        faces.append(loop)
    front = next(f for f in faces if all(vertices[v][1] == 0 for v in f))
    faces.remove(front)
    left = [v for v in front if vertices[v][0] <= 3]
    right = [v for v in front if vertices[v][0] >= 3]
    assert number[0.0, 0.0, 2.0] in left
    return Solid(vertices, [*faces, left, right])


def test_the_edge_between_coplanar_faces_is_smooth():
    with pytest.raises(
        EntityError, match=r"turn by at least 5 degrees. Got 0 at edge \d+ for 'seam'"
    ):
        resolve_entities(split_box(), {"seam": ((3, 0, 0), (3, 0, 2))})


def test_a_curved_edge_is_refused():
    box = cube()
    solid = Solid(box.vertices, box.faces, curved_edges=[box.edges[5].vertices])
    with pytest.raises(
        EntityError,
        match=r"straight, sharp edge. Got edge 5, part of a curve or of an occluder, for 'rim'",
    ):
        resolve_entities(solid, {"rim": 5})


@pytest.mark.parametrize(
    ("mapping", "rule"),
    [
        ({"a": 12}, r"edge id must be in 0..11. Got 12 for 'a'"),
        ({"a": -1}, r"edge id must be in 0..11. Got -1 for 'a'"),
        ({"a": True}, "edge id or two finite end points. Got True"),
        ({"a": "17"}, "two finite end points. Got '17'"),
        ({"a": ((0, 0, 0), (1, 0))}, "edge id or two finite end points"),
        ({"a": ((0, 0, 0), (np.nan, 0, 0))}, "two finite end points"),
        (
            {"a": ((1, 2, 0), (1, 2, 0))},
            r"must have a length. Got two end points at \(1, 2, 0\) for 'a'",
        ),
        (
            {"a": ((0, 0, 0), (1, 0, 0))},
            r"the nearest is edge \d+ from \(0, 0, 0\) to \(2, 0, 0\), 1 mm off",
        ),
        ({"a": ((0, 0, 0), (2, 2, 0))}, "within 0.000346 mm of the ends of an edge"),
        ({"a": 3, "b": 3}, "named once. Got 'a' and 'b' for edge 3"),
        ({"a": 9, "b": ((2, 0, 0), (0, 0, 0))}, "named once. Got 'a' and 'b' for edge 9"),
        ({"": 3}, "name must be text. Got ''"),
        ({3: 3}, "name must be text. Got 3"),
        ({}, "at least one edge, rim or arc. Got none"),
        ([], "at least one edge, rim or arc. Got none"),
        ([1, 1], "named once. Got edge 1 twice"),
        ([1.0], "edge ids must be integers. Got 1.0"),
    ],
)
def test_refusals(mapping, rule):
    with pytest.raises(EntityError, match=rule):
        resolve_entities(cube(), mapping)


def test_tolerance():
    near = {"a": ((0.05, 0, 0), (2, 0.05, 0))}
    assert resolve_entities(cube(), near, tolerance_mm=0.1)["a"].endpoints.tolist() == [
        [0, 0, 0],
        [2, 0, 0],
    ]
    with pytest.raises(EntityError, match=r"within 0\.01 mm"):
        resolve_entities(cube(), near, tolerance_mm=0.01)
    with pytest.raises(EntityError, match=r"tolerance_mm must be positive\. Got 0"):
        resolve_entities(cube(), near, tolerance_mm=0)


def test_shallow_edges_need_a_smaller_dihedral():
    roof = prism([(0, 0), (4, 0), (4, 1), (2, 1 + 2 * np.tan(np.radians(1))), (0, 1)], 1)
    ridge = {
        "ridge": ((2, 1 + 2 * np.tan(np.radians(1)), 0), (2, 1 + 2 * np.tan(np.radians(1)), 1))
    }
    with pytest.raises(EntityError, match=r"turn by at least 5 degrees\. Got 2 at"):
        resolve_entities(roof, ridge)
    assert list(resolve_entities(roof, ridge, min_dihedral_deg=1.5)) == ["ridge"]


def test_text():
    assert list(read_entities("all", cube())) == [f"e{i}" for i in range(12)]
    assert list(read_entities("3, e7 11", cube())) == ["e3", "e7", "e11"]
    for text in ("", "front", "1,2,x"):
        with pytest.raises(EntityError, match="'all', ids such as 17,18 or r3,a0, ranges"):
            read_entities(text, cube())


def test_files(tmp_path):
    toml = tmp_path / "edges.toml"
    toml.write_text("e1 = [[6, 2, 0], [6, 2, 6]]\n[entities]\n'rim 2' = 4\n", encoding="utf-8")
    assert list(read_entities(toml, slotted_block())) == ["rim 2"]
    toml.write_text("e1 = [[6, 2, 0], [6, 2, 6.0]]\ne2 = 5\n", encoding="utf-8")
    assert list(read_entities(str(toml), slotted_block())) == ["e1", "e2"]
    listed = tmp_path / "edges.json"
    listed.write_text(json.dumps([1, 2]))
    assert list(read_entities(listed, cube())) == ["e1", "e2"]
    listed.write_text(json.dumps({"entities": {"x": [[0, 0, 0], [2, 0, 0]]}}))
    assert list(read_entities(listed, cube())) == ["x"]


@pytest.mark.parametrize(
    ("name", "text", "rule"),
    [
        ("broken.toml", "a = [", "must be valid TOML. Got broken.toml"),
        ("broken.json", "{", "must be valid JSON. Got broken.json"),
        ("word.json", '"all"', "must hold names or edge ids. Got word.json with str"),
        ("absent.toml", None, "must name an existing file"),
    ],
)
def test_broken_files(tmp_path, name, text, rule):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(EntityError, match=rule) as caught:
        read_entities(tmp_path / name, cube())
    assert "\n" not in str(caught.value)


def test_entities_do_not_change():
    points = np.zeros((2, 3))
    entity = Entity("a", points, (1,))
    points[0, 0] = 5.0
    assert entity.endpoints[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        entity.endpoints[0, 0] = 1.0
