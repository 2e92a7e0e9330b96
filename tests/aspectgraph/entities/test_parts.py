"""Stretches of edges and runs of rims: values, text forms, where they lie, and the default pieces."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from rimmed_solids import lattice_circle
from solids import cube, prism

from aspectgraph import (
    EntityError,
    Run,
    Stretch,
    entity_order,
    facing_cuts,
    parse_part,
    pieces_of_edge,
    read_entities,
    resolve_entities,
    run_arc,
    runs_of,
)

CIRCLE = lattice_circle(25)


def holed():
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
    solid = holed()
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
    solid = holed()
    names = resolve_entities(solid, [0, "0[0:1/2]", "r0", "r0[0:5]", Run("r0", 5, 0)])
    assert list(names) == ["e0", "e0[0:1/2]", "r0", "r0[0:5]", "r0[5:0]"]
    with pytest.raises(EntityError, match="once"):
        resolve_entities(solid, {"one": "0[0:1/2]", "other": Stretch(0, 0, "1/2")})


@pytest.mark.parametrize(
    "part", ["99[0:1/2]", "r9[0:1]", "r0[0:12]", "a0[0:1]", Run("r0", 15, 2), Run("a7", 0, 1)]
)
def test_parts_of_what_the_solid_has_not_are_refused(part):
    with pytest.raises(EntityError, match="must"):
        resolve_entities(holed(), [part])


def test_arcs_end_at_their_last_joint():
    arc = d_shaped().arcs()[0]
    last = len(arc.edge_ids)
    assert resolve_entities(d_shaped(), [Run(arc.id, 1, last)])
    with pytest.raises(EntityError, match="joints"):
        resolve_entities(d_shaped(), [Run(arc.id, 1, last + 1)])


def test_files_and_command_lines_name_parts(tmp_path):
    path = tmp_path / "parts.csv"
    path.write_text("name,id\nleft,0[0:1/4]\nfront,r0[0:5]\n")
    assert [e.kind for e in read_entities(path, holed()).values()] == ["edge", "arc"]
    words = "e0[0:1/4], 0, r1[3:8]"
    assert list(read_entities(words, holed())) == ["e0[0:1/4]", "e0", "r1[3:8]"]


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
    rim = holed().rims()[0]
    for at_most, n in ((12, 12), (100, 12), (5, 5), (1, 1)):
        runs = runs_of(rim, coverage, at_most)
        assert len(set(runs)) == n
        assert {len(run_arc(holed(), run).edge_ids) for run in runs} == {held}
    everywhere = {e for run in runs_of(rim, coverage) for e in run_arc(holed(), run).edge_ids}
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
        make(holed())
