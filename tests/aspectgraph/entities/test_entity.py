"""Entities: found by id, by end points and from files; everything else is refused by name."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from rimmed_solids import lattice_circle
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
    ring,
    slotted_block,
    two_pocket_block,
)

from aspectgraph import (
    Entity,
    EntityError,
    Run,
    Solid,
    Stretch,
    build_aspect_graph,
    entity_order,
    facing_cuts,
    parse_part,
    pieces_of_edge,
    read_entities,
    read_graphml,
    resolve_entities,
    run_arc,
    runs_of,
    write_graphml,
)


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
        ({1.0, 2}, "edge ids must be integers. Got 1.0"),
        ("all", "^entities must be a mapping or sequence. Got 'all'; read_entities reads a text, "),
        ("length > 30", "Got 'length > 30'; .* and select_entities takes a rule.$"),
        ("e1", "^entities must be a mapping or sequence. Got 'e1'; "),
        (b"ab", "^entities must be a mapping or sequence. Got b'ab'; "),
        (1, "^entities must be a mapping or sequence. Got 1; "),
        (None, "^entities must be a mapping or sequence. Got None; "),
        (np.array(1), r"^entities must be a mapping or sequence. Got array\(1\); "),
    ],
)
def test_refusals(mapping, rule):
    with pytest.raises(EntityError, match=rule):
        resolve_entities(cube(), mapping)


def test_what_is_no_id_is_shown_in_short():
    with pytest.raises(EntityError, match=r"^edge ids must be integers\. Got ") as info:
        resolve_entities(cube(), [{"a": list(range(1000))}])
    assert len(str(info.value)) < 120


def test_ids_of_arrays_and_sets():
    assert list(resolve_entities(cube(), np.array([7, 3]))) == ["e7", "e3"]
    for ids in ({11, 2, 7}, frozenset([7, 11, 2]), {7, "2[0:1/2]", 11}):
        assert [name[:3].strip("[") for name in resolve_entities(cube(), ids)] == [
            "e2",
            "e7",
            "e11",
        ]


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
        ("bare.toml", "\na = r7", r'\(at line 2, column 5\); write "r7" in quotes'),
        ("bare.toml", "a = [3, e17[0:1/4]]", r'column 9\); write "e17\[0:1/4\]" in quotes'),
        ("bare.json", '{"a": r7}', r'\(char 6\); write "r7" in quotes'),
        ("bare.toml", "a = rim", r"\(at line 1, column 5\)\.$"),
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


# Rims, arcs and edge objects as entities: by id, as objects and from files.


SQUARE = [(-10, -10), (10, -10), (10, 10), (-10, 10)]


def holed(n: int = 12):
    return prism(SQUARE, 5, [ring(4.0, n, clockwise=True)], name="holed")


def slotted():
    right = [(3 + 2 * np.cos(a), 2 * np.sin(a)) for a in np.radians(np.arange(-90, 91, 30))]
    return prism(SQUARE, 5, [[*right, *[(-x, -y) for x, y in right]][::-1]])


def test_ids_and_objects_are_the_same():
    solid = holed()
    rim = solid.rims()[1]
    edge = solid.straight_edges()[0]
    by_id = resolve_entities(solid, {"bore": "r1", "top": edge.id})
    assert resolve_entities(solid, {"bore": rim, "top": edge}) == by_id
    assert list(resolve_entities(solid, [rim, "r0", edge])) == ["r1", "r0", f"e{edge.id}"]
    assert resolve_entities(solid, by_id) == by_id


def test_a_rim_has_all_chords_its_circle_and_two_opposite_points():
    solid = holed()
    bore = resolve_entities(solid, {"bore": "r0"})["bore"]
    assert (bore.kind, len(bore.edge_ids), bore.points.shape, bore.outline.shape) == (
        "rim",
        12,
        (12, 3),
        (13, 3),
    )
    assert bore.circle.radius_mm == pytest.approx(4.0)
    assert bore.endpoints.mean(axis=0) == pytest.approx(bore.circle.centre)
    assert bore.length_mm == pytest.approx(8.0)
    with pytest.raises(ValueError, match="read-only"):
        bore.points[0] = 0


def test_an_arc_starts_and_ends_where_its_chords_do():
    arc = resolve_entities(slotted(), {"end": "a0"})["end"]
    assert (arc.kind, len(arc.edge_ids), len(arc.points)) == ("arc", 6, 7)
    assert (arc.endpoints == arc.points[[0, -1]]).all()
    assert arc.length_mm == pytest.approx(4.0)


def test_an_edge_says_it_is_one():
    edge = resolve_entities(cube(), [0])["e0"]
    assert (edge.kind, edge.circle) == ("edge", None)
    assert (edge.points == edge.endpoints).all()


def test_files_and_command_lines(tmp_path):
    path = tmp_path / "entities.toml"
    path.write_text('bore = "r1"\ntop = 0\n')
    solid = holed()
    assert [entity.kind for entity in read_entities(path, solid).values()] == ["rim", "edge"]
    assert list(read_entities("r0, e0", solid)) == ["r0", "e0"]
    assert list(read_entities("a0 a1", slotted())) == ["a0", "a1"]


@pytest.mark.parametrize(
    ("target", "rule"),
    [
        ("r2", r"one of the solid's 2 rims and 0 arcs, .* Got 'r2' for 'x'\."),
        ("a0", "Got 'a0' for 'x'"),
        (holed(16).rims()[0], "Got 'r0' for 'x', that of another solid"),
        (cube().edges[0], "another solid's edge 0 for 'x'"),
    ],
)
def test_refusals_of_curves(target, rule):
    with pytest.raises(EntityError, match=rule):
        resolve_entities(holed(), {"x": target})


def test_a_rim_is_named_once():
    with pytest.raises(EntityError, match=r"named once\. Got 'a' and 'b'"):
        resolve_entities(holed(), {"a": "r0", "b": holed().rims()[0]})


def test_graphml_keeps_kinds_and_circles(tmp_path):
    solid = holed()
    graph = build_aspect_graph(solid, {"bore": "r0", "top": solid.straight_edges()[0]}).graph
    write_graphml(graph, tmp_path / "g.graphml")
    again = read_graphml(tmp_path / "g.graphml")
    assert nx.utils.graphs_equal(again, graph)
    assert again.graph["kinds"] == ("rim", "edge")
    bore, top = again.graph["circles"]
    assert top == ()
    assert bore[:2] == pytest.approx((0, 0))
    assert bore[6] == pytest.approx(4.0)


# Stretches of edges and runs of rims: values, text forms, where they lie, and the default pieces.


CIRCLE = lattice_circle(25)


def holed_plate():
    """A plate with a round hole of 12 chords: rims r0 and r1."""
    square = [(-10, -10), (10, -10), (10, 10), (-10, 10)]
    return prism(square, 4, [CIRCLE[::-1]])


def d_shaped():
    """A plate with a hole of eight chords of a circle and a straight side: arcs a0 and a1."""
    square = [(-10, -10), (10, -10), (10, 10), (-10, 10)]
    return prism(square, 4, [[p for p in CIRCLE if p[0] <= 3][::-1]])


def edge_along(solid, start, end) -> int:
    """Return the id of the edge between two points, and check that it starts at the first."""
    (found,) = [
        e.id
        for e in solid.edges
        if sorted(solid.edge_points(e.id).tolist()) == sorted([start, end])
    ]
    return found


@pytest.mark.parametrize("text", ["17[0:1/4]", "0[3/7:1]", "r11[3:22]", "r11[22:3]", "a0[0:5]"])
def test_a_part_and_its_text_say_the_same(text):
    assert str(parse_part(text)) == text
    assert parse_part(str(parse_part(text))) == parse_part(text)
    assert len({parse_part(text), parse_part(text)}) == 1


def test_an_edge_may_be_named_with_its_letter():
    assert parse_part("e17[2/8:1/2]") == Stretch(17, (1, 4), "1/2")
    assert Stretch(17, "1/4", "1/2").name == "e17[1/4:1/2]"


@pytest.mark.parametrize(
    "make",
    [
        lambda: Stretch(1, "1/2", "1/4"),
        lambda: Stretch(1, "1/4", "1/4"),
        lambda: Stretch(1, 0, 1),
        lambda: Stretch(1, -1, "1/2"),
        lambda: Stretch(1, "1/2", 2),
        lambda: Stretch(1, 0.25, "1/2"),
        lambda: Stretch(1, 0, (1, 0)),
        lambda: Stretch(1, 0, Fraction(1, 2**21)),
        lambda: Stretch(True, 0, "1/2"),
        lambda: Stretch(-1, 0, "1/2"),
        lambda: Stretch(1.5, 0, "1/2"),
        lambda: Run("r1", 3, 3),
        lambda: Run("a1", 3, 2),
        lambda: Run("17", 3, 4),
        lambda: Run("r1", -1, 4),
        lambda: Run("r1", 1.0, 4),
        lambda: parse_part("17"),
        lambda: parse_part("r3[0:1/4]"),
        lambda: parse_part("17[0:1/4"),
        lambda: parse_part(17),
        lambda: entity_order("x3"),
        lambda: entity_order(True),
    ],
)
def test_what_is_no_part_is_refused(make):
    with pytest.raises(EntityError, match="must"):
        make()


def test_ids_and_parts_sort_by_kind_number_and_place():
    ordered = [3, 17, "17[0:1/4]", "17[1/4:1/2]", "r2", "r2[0:5]", "r10", "a0", "a0[1:2]"]
    shuffled = [ordered[i] for i in np.random.default_rng(0).permutation(len(ordered))]
    assert sorted(shuffled, key=entity_order) == ordered
    parsed = [parse_part(x) if "[" in str(x) else x for x in shuffled]
    assert list(map(str, sorted(parsed, key=entity_order))) == list(map(str, ordered))


def test_a_stretch_lies_between_its_shares_of_the_edge():
    solid = cube()
    start, end = solid.edge_points(4)
    entity = resolve_entities(solid, [Stretch(4, "1/4", 1)])["e4[1/4:1]"]
    assert entity.kind == "edge"
    assert entity.edge_ids == (4,)
    assert entity.endpoints == pytest.approx(np.array([start + (end - start) / 4, end]))
    assert (entity.endpoints[1] == end).all()
    assert entity.length_mm == pytest.approx(0.75 * solid.edge_length_mm(4))


def test_a_run_is_an_arc_of_its_circle():
    solid = holed_plate()
    (rim,) = [rim for rim in solid.rims() if rim.id == "r0"]
    run = Run("r0", 10, 2)
    arc = run_arc(solid, run)
    entity = resolve_entities(solid, ["r0[10:2]"])["r0[10:2]"]
    assert arc.edge_ids == entity.edge_ids == tuple(rim.edge_ids[i] for i in (10, 11, 0, 1))
    assert arc.vertices == tuple(rim.vertices[i] for i in (10, 11, 0, 1, 2))
    assert (entity.kind, entity.part) == ("arc", run)
    assert (entity.points == solid.vertices[list(arc.vertices)]).all()
    first, last = (entity.points[i] - rim.centre for i in (0, -1))
    spans = [np.degrees(np.arccos(a @ b / 25)) for a, b in pairwise(entity.points - rim.centre)]
    assert np.degrees(arc.end_rad - arc.start_rad) == pytest.approx(sum(spans))
    at = [np.cos(arc.start_rad), np.sin(arc.start_rad)]
    across = np.cross(rim.axis, rim.reference)
    assert at[0] * rim.reference + at[1] * across == pytest.approx(first / 5)
    at = [np.cos(arc.end_rad), np.sin(arc.end_rad)]
    assert at[0] * rim.reference + at[1] * across == pytest.approx(last / 5)


def test_parts_stand_beside_their_whole_but_not_twice():
    solid = holed_plate()
    names = resolve_entities(solid, [0, "0[0:1/2]", "r0", "r0[0:5]", Run("r0", 5, 0)])
    assert list(names) == ["e0", "e0[0:1/2]", "r0", "r0[0:5]", "r0[5:0]"]
    with pytest.raises(EntityError, match="once"):
        resolve_entities(solid, {"one": "0[0:1/2]", "other": Stretch(0, 0, "1/2")})


@pytest.mark.parametrize(
    "part", ["99[0:1/2]", "r9[0:1]", "r0[0:12]", "a0[0:1]", Run("r0", 15, 2), Run("a7", 0, 1)]
)
def test_parts_of_what_the_solid_has_not_are_refused(part):
    with pytest.raises(EntityError, match="must"):
        resolve_entities(holed_plate(), [part])


def test_arcs_end_at_their_last_joint():
    arc = d_shaped().arcs()[0]
    last = len(arc.edge_ids)
    assert resolve_entities(d_shaped(), [Run(arc.id, 1, last)])
    with pytest.raises(EntityError, match="joints"):
        resolve_entities(d_shaped(), [Run(arc.id, 1, last + 1)])


def test_files_and_command_lines_name_parts(tmp_path):
    path = tmp_path / "parts.csv"
    path.write_text("name,id\nleft,0[0:1/4]\nfront,r0[0:5]\n")
    assert [e.kind for e in read_entities(path, holed_plate()).values()] == ["edge", "arc"]
    words = "e0[0:1/4], 0, r1[3:8]"
    assert list(read_entities(words, holed_plate())) == ["e0[0:1/4]", "e0", "r1[3:8]"]


@pytest.mark.parametrize("length_mm", [0.3, 1.0, 3.0, 7.0])
def test_pieces_follow_each_other_and_are_about_equal(length_mm):
    solid = prism([(0, 0), (20, 0), (20, 5), (0, 5)], 3)
    edge = edge_along(solid, [0, 0, 0], [20, 0, 0])
    pieces = pieces_of_edge(solid, edge, length_mm)
    n = min(12, math.ceil(20 / length_mm))
    assert len(pieces) == n
    assert (pieces[0].start, pieces[-1].end) == (0, 1)
    assert all(one.end == other.start for one, other in pairwise(pieces))
    # cuts are rounded to 1/256
    assert max(abs(piece.share - Fraction(1, n)) for piece in pieces) <= Fraction(1, 256)


def test_an_edge_that_is_short_enough_has_no_pieces():
    solid = cube()
    assert pieces_of_edge(solid, 0, solid.edge_length_mm(0)) == ()
    assert len(pieces_of_edge(solid, 0, solid.edge_length_mm(0), cuts=[Fraction(1, 3)])) == 2


def test_edges_face_each_other_where_their_projections_overlap():
    """Edges from 0 to 20 and from 5 to 9 on a stepped prism: 1/4 and 9/20, the latter rounded inward to 1/1024."""
    profile = [(0, 0), (20, 0), (20, 5), (9, 5), (9, 8), (5, 8), (5, 5), (0, 5)]
    solid = prism(profile, 3)
    long = edge_along(solid, [0, 0, 0], [20, 0, 0])
    short = edge_along(solid, [5, 8, 0], [9, 8, 0])
    cuts = facing_cuts(solid, long, short)
    if solid.edge_points(long)[0][0] == 20:
        cuts = tuple(1 - cut for cut in reversed(cuts))
    assert cuts == (Fraction(1, 4), Fraction(460, 1024))
    assert facing_cuts(solid, short, long) == ()
    upright = edge_along(solid, [0, 0, 0], [0, 0, 3])
    assert facing_cuts(solid, long, upright) == ()


@pytest.mark.parametrize(("coverage", "held"), [(0.8, 10), (0.5, 6), (0.75, 9), (0.01, 1)])
def test_runs_of_a_rim_hold_the_share_asked_for(coverage, held):
    rim = holed_plate().rims()[0]
    for at_most, n in ((12, 12), (100, 12), (5, 5), (1, 1)):
        runs = runs_of(rim, coverage, at_most)
        assert len(set(runs)) == n
        assert {len(run_arc(holed_plate(), run).edge_ids) for run in runs} == {held}
    everywhere = {e for run in runs_of(rim, coverage) for e in run_arc(holed_plate(), run).edge_ids}
    assert everywhere == set(rim.edge_ids)


def test_runs_of_an_arc_reach_from_its_start_to_its_end():
    arc = d_shaped().arcs()[0]
    assert [(run.first, run.last) for run in runs_of(arc, 0.75)] == [(0, 6), (1, 7), (2, 8)]
    assert runs_of(arc, 1.0) == ()
    assert runs_of(arc, 0.95) == ()


@pytest.mark.parametrize(
    "make",
    [
        lambda solid: pieces_of_edge(solid, 0, 0.0),
        lambda solid: pieces_of_edge(solid, 0, float("nan")),
        lambda solid: pieces_of_edge(solid, 999, 1.0),
        lambda solid: pieces_of_edge(solid, 0, 1.0, 0),
        lambda solid: facing_cuts(solid, 0, -1),
        lambda solid: runs_of(solid.rims()[0], 0.0),
        lambda solid: runs_of(solid.rims()[0], 1.1),
        lambda solid: runs_of(solid.rims()[0], 0.5, 0),
    ],
)
def test_bad_numbers_are_refused(make):
    with pytest.raises(EntityError, match="must"):
        make(holed_plate())


def test_an_edge_is_named_as_tables_show_it(tmp_path):
    """Names stand on the left and ids on the right, so that "e4" may name another edge."""
    solid = l_block()
    assert list(resolve_entities(solid, ["e3"])) == ["e3"]
    named = resolve_entities(solid, {"e4": "e3", "other": "e4"})
    assert [entity.edge_ids for entity in named.values()] == [(3,), (4,)]
    assert list(resolve_entities(solid, {"e4", 3})) == ["e3", "e4"]
    assert Stretch("e3", 0, "1/2") == Stretch(3, 0, "1/2")
    path = tmp_path / "named.toml"
    path.write_text('e4 = "e3"\nother = "e4"\n')
    assert [entity.edge_ids for entity in read_entities(path, solid).values()] == [(3,), (4,)]
    with pytest.raises(EntityError, match="an edge must be named once"):
        resolve_entities(solid, [3, "e3"])
    with pytest.raises(EntityError, match=r"an edge id must be in 0\.\.\d+\. Got 999\."):
        resolve_entities(solid, ["e999"])
