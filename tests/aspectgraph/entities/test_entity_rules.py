"""Entities by rule, range, end points and CSV: on a block whose answers can be counted by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import solids

from aspectgraph import EntityError, read_entities, read_solid, select_entities
from aspectgraph.entities.entity_rules import Carriers, csv_text

EXAMPLES = Path(__file__).parents[3] / "examples"
BLOCK = read_solid(EXAMPLES / "two_pocket_block.off")
CTC = EXAMPLES / "nist_ctc_01_ap242.stp"


def by_hand(keep):
    """Return the ids of straight edges whose ends satisfy something."""
    return [
        edge.id
        for edge in BLOCK.straight_edges()
        if keep(np.asarray(BLOCK.edge_points(edge.id)), edge)
    ]


RULES = {
    "length > 20": lambda p, e: np.linalg.norm(p[1] - p[0]) > 20,
    "LENGTH <= 2e1": lambda p, e: np.linalg.norm(p[1] - p[0]) <= 20,
    "convex": lambda p, e: e.dihedral_deg > 0,
    "re-entrant": lambda p, e: e.dihedral_deg < 0,
    "direction = z": lambda p, e: (p[0][:2] == p[1][:2]).all(),
    "direction = 0,-3,0": lambda p, e: (p[0][[0, 2]] == p[1][[0, 2]]).all(),
    "face = bottom": lambda p, e: (p[:, 2] == BLOCK.vertices[:, 2].min()).all(),
    "face = right and length >= 40": lambda p, e: (
        (p[:, 0] == BLOCK.vertices[:, 0].max()).all() and np.linalg.norm(p[1] - p[0]) >= 40
    ),
    # the corner at the origin has three edges
    "near 0,0,0 < 0.001": lambda p, e: (p == 0).all(axis=1).any(),
    "turn < 91 and kind = any": lambda p, e: abs(e.dihedral_deg) < 91,
}


def test_sizes_are_equal_within_a_hundredth_of_a_millimetre():
    part = read_solid(CTC)
    sizes = {curve.id: 2.0 * curve.radius_mm for curve in (*part.rims(), *part.arcs())}
    wanted = sizes["r0"]
    same = [curve_id for curve_id, size in sizes.items() if abs(size - wanted) < 0.005]
    assert 0 < len(same) < len(sizes)
    assert select_entities(part, f"diameter = {wanted:.3f}") == same
    assert select_entities(part, f"radius = {wanted / 2:.3f} mm") == same
    assert select_entities(part, f"diameter = {wanted + 0.009}") == same
    above = [curve_id for curve_id, size in sizes.items() if size > wanted + 0.01]
    assert select_entities(part, f"diameter > {wanted + 0.01}") == above
    with pytest.raises(EntityError, match="at least one rim or arc"):
        select_entities(part, f"diameter = {wanted + 0.02}")


@pytest.mark.parametrize(
    ("length", "equal"), [(60.0, True), (60.01, True), (59.99, True), (60.02, False)]
)
def test_lengths_are_equal_within_a_hundredth_of_a_millimetre(length, equal):
    expected = by_hand(lambda p, e: np.linalg.norm(p[1] - p[0]) == 60)
    assert expected
    if equal:
        assert select_entities(BLOCK, f"length = {length}") == expected
    else:
        with pytest.raises(EntityError, match="at least one edge"):
            select_entities(BLOCK, f"length = {length}")


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_selects_what_it_says(rule):
    expected = by_hand(RULES[rule])
    assert expected
    assert select_entities(BLOCK, rule) == expected


def test_near_is_the_distance_from_the_segment_and_not_from_its_line():
    # 5 mm beyond the end of the edges at the corner, along x
    for radius, found in ((4.9, False), (5.1, True)):
        rule = f"near -5,0,0 < {radius}"
        if found:
            assert select_entities(BLOCK, rule) == select_entities(BLOCK, "near 0,0,0 < 0.001")
        else:
            with pytest.raises(EntityError, match="must hold for at least one edge"):
                select_entities(BLOCK, rule)


def test_rims_are_selected_by_kind_and_radius():
    pytest.importorskip("OCP")
    part = read_solid(CTC)
    expected = [rim.id for rim in part.rims() if rim.radius_mm > 10]
    assert expected
    assert select_entities(part, "kind = rim and radius > 10") == expected
    arcs = [arc.id for arc in part.arcs() if arc.radius_mm > 10]
    assert arcs
    assert select_entities(part, "radius > 10") == [*expected, *arcs]
    assert select_entities(part, "kind = any and radius > 10") == [*expected, *arcs]
    assert set(select_entities(part, "kind = any")) >= {*expected, *(arc.id for arc in part.arcs())}


@pytest.mark.parametrize(
    ("rule", "kinds"),
    [
        ("length > 900", "edge"),
        ("length > 900 and kind = edge", "edge"),
        ("kind = rim", "rim"),
        ("radius > 900 and KIND = arc", "arc"),
        ("length > 900 and kind = any", "edge, rim or arc"),
        ("kind = any and kind = rim", "rim"),
        ("radius > 10", "rim or arc"),
        ("radius > 10 mm and length > 10", "rim or arc"),
        ("kind = edge and radius > 10", "edge, rim or arc"),
        ("kind = arc and kind = rim", "edge, rim or arc"),
    ],
)
def test_a_rule_that_selects_nothing_names_the_kinds_it_could_select(rule, kinds):
    with pytest.raises(EntityError) as error:
        select_entities(BLOCK, rule)
    assert str(error.value) == f"select must hold for at least one {kinds}. Got none for {rule!r}."


@pytest.mark.parametrize("rule", [40, None, ["convex"]])
def test_a_rule_that_is_no_text_is_refused(rule):
    with pytest.raises(EntityError) as error:
        select_entities(BLOCK, rule)
    assert str(error.value) == f"rule must be a text such as 'length > 20'. Got {rule!r}."


@pytest.mark.parametrize(
    "rule", ["", "length == 3", "size > 2", "length > 2 or convex", "near 1,2 < 3", "face = roof"]
)
def test_other_words_are_refused(rule):
    with pytest.raises(EntityError, match="select must be conditions joined by 'and'"):
        select_entities(BLOCK, rule)


@pytest.mark.parametrize(
    ("rule", "same"),
    [
        ("length > 20 mm and convex", "length > 20 and convex"),
        ("length > 20mm", "length > 20"),
        ("turn < 91 deg", "turn < 91"),
        ("turn < 91°", "turn < 91"),
        ("near 0,0,0 < 0.001 mm", "near 0,0,0 < 0.001"),
    ],
)
def test_a_unit_may_follow_a_number(rule, same):
    assert select_entities(BLOCK, rule) == select_entities(BLOCK, same)


@pytest.mark.parametrize(
    ("rule", "meant"),
    [
        ("lenght > 20", "length > 20"),
        ("knid = rim", "kind = rim"),
        ("face = buttom", "face = bottom"),
        ("convx", "convex"),
        ("length > 2 and direktion = z", "direction = z"),
    ],
)
def test_what_was_probably_meant_is_said(rule, meant):
    with pytest.raises(EntityError, match=f"; '{meant}' may be meant"):
        select_entities(BLOCK, rule)


@pytest.mark.parametrize("rule", ["colour = red", "length > 2 deg", "turn < 3 mm"])
def test_nothing_is_suggested_where_nothing_is_near(rule):
    with pytest.raises(EntityError) as caught:
        select_entities(BLOCK, rule)
    assert "may be meant" not in str(caught.value)


def test_a_direction_needs_a_length():
    with pytest.raises(EntityError, match="direction must have a length"):
        select_entities(BLOCK, "direction = 0,0,0")


def test_ranges_and_end_points():
    assert list(read_entities("3, 8-10 e9", BLOCK)) == ["e3", "e8", "e9", "e10"]
    ends = np.asarray(BLOCK.edge_points(17))
    (x, y, z), (u, v, w) = ends
    found = read_entities(f"3, ({x},{y},{z})-({u}, {v}, {w})", BLOCK)
    assert found["p1"].edge_ids == (17,)
    assert found["e3"].edge_ids == (3,)
    for text, rule in (
        ("10-8", "a range must go upwards"),
        ("r1-3", "a range must be of one kind"),
        ("1-r3", "a range must be of one kind"),
        ("(0,0)-(1,1,1)", "an end point must be three numbers"),
    ):
        with pytest.raises(EntityError, match=rule):
            read_entities(text, BLOCK)


def test_a_table(tmp_path):
    (x, y, z), (u, v, w) = np.asarray(BLOCK.edge_points(17))
    path = tmp_path / "edges.csv"
    path.write_text(f"name,id\nfirst, 3\n\n second,e8\nfloor,{x},{y},{z},{u},{v},{w}\n")
    assert {name: one.edge_ids for name, one in read_entities(path, BLOCK).items()} == {
        "first": (3,),
        "second": (8,),
        "floor": (17,),
    }
    for text, rule in (
        ("a,1\na,2\n", "must name an entity once. Got 'a' again in edges.csv, row 2"),
        (
            "a,1,2\n",
            "a CSV row must be a name and an id, or a name and six coordinates. Got 'a,1,2' in edges.csv",
        ),
    ):
        path.write_text(text)
        with pytest.raises(EntityError, match=rule):
            read_entities(path, BLOCK)
    with pytest.raises(EntityError, match=r"a CSV file that can be read. Got .*none\.csv"):
        read_entities(tmp_path / "none.csv", BLOCK)


def test_names_of_a_table_that_a_spreadsheet_would_run_come_back(tmp_path):
    names = ["=HYPERLINK(1)", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "'=1", "it's", "a\nb"]
    path = tmp_path / "edges.csv"
    rows = [{"name": name, "id": 3 + k} for k, name in enumerate(names)]
    path.write_bytes(csv_text(["name", "id"], rows).encode())
    assert [*read_entities(path, BLOCK)] == names


# Surfaces that carry edges, and how edges move with them: by geometry that is easy to see.


@pytest.fixture(scope="module")
def block():
    return solids.drilled_block()


def test_an_edge_of_a_box_moves_with_both_faces(block):
    carriers = Carriers(block)
    edge = next(
        e
        for e in block.edges
        if {tuple(p) for p in block.edge_points(e.id)} == {(0, 0, 20), (40, 0, 20)}
    )
    pair = carriers.of_edge(edge.id)
    normals = {tuple(carriers.surfaces[k].axis.tolist()) for k in pair}
    assert normals == {(0.0, 0.0, 1.0), (0.0, -1.0, 0.0)}
    points = block.edge_points(edge.id)
    moved = carriers.displacement(pair, points)
    offsets = np.zeros(6)
    offsets[[0, 3]] = 0.3, 0.2
    by_plane = dict(zip((tuple(carriers.surfaces[k].axis) for k in pair), (0.3, 0.2), strict=True))
    expected = sum(np.array(normal) * off for normal, off in by_plane.items())
    np.testing.assert_allclose(moved @ offsets, [expected, expected], atol=1e-12)


def test_a_tilt_lifts_a_plane_at_its_extent(block):
    carriers = Carriers(block)
    edge = next(e for e in block.edges if not e.curved and abs(e.dihedral_deg) > 80)
    plane = carriers.surfaces[carriers.of_edge(edge.id)[0]]
    far = plane.point + plane.extent_mm * np.eye(3)
    lift = plane.offsets(far)
    np.testing.assert_allclose(lift[:, 0], 1.0)
    across = np.abs(plane.axis) < 0.5
    np.testing.assert_allclose(np.abs(lift[across, 1:]).max(axis=1), 1.0, atol=1e-12)


def test_a_rim_lies_on_its_face_and_its_cylinder(block):
    carriers = Carriers(block)
    upper, lower = sorted(block.rims(), key=lambda rim: -rim.centre[2])
    plane, cylinder = carriers.of_curve(upper)
    assert carriers.surfaces[plane].is_plane
    assert carriers.surfaces[cylinder].radius_mm == pytest.approx(5.0)
    # both rims of a hole are on one cylinder, and on two planes
    other = carriers.of_curve(lower)
    assert other[1] == cylinder
    assert other[0] != plane
    angle = np.linspace(0, 6, 9)
    out = np.c_[np.cos(angle), np.sin(angle), np.zeros(9)]
    points = upper.centre + 5.0 * out
    grown = carriers.displacement((plane, cylinder), points) @ [0.1, 0, 0, 0.4, 0, 0]
    np.testing.assert_allclose(grown, 0.4 * out + [0, 0, 0.1], atol=1e-9)


def test_a_hole_off_its_place_moves_as_a_whole(block):
    carriers = Carriers(block)
    pair = carriers.of_curve(block.rims()[0])
    points = np.array([[25.0, 15, 20], [15.0, 15, 20], [20.0, 20, 20], [20.0, 10, 20]])
    x = carriers.surfaces[pair[1]]
    moved = carriers.displacement(pair, points) @ [0, 0, 0, 0, 0.3, 0.0]
    # of a rigid shift, a circle shows what is along its radius
    shift = moved[:2].mean(axis=0) + moved[2:].mean(axis=0)
    assert np.linalg.norm(shift) == pytest.approx(0.3, abs=1e-9)
    assert shift @ x.axis == pytest.approx(0.0, abs=1e-12)


def test_where_a_bore_meets_a_cone_moves_with_both():
    solid = solids.countersunk_block()
    carriers = Carriers(solid)
    (rim,) = [one for one in solid.rims() if abs(one.centre[2] - 14.0) < 1e-9]
    cone, bore = carriers.of_curve(rim)
    assert not carriers.surfaces[cone].is_plane
    assert carriers.surfaces[bore].radius_mm == pytest.approx(5.0)
    angle = np.linspace(0, 6, 9)
    out = np.c_[np.cos(angle), np.sin(angle), np.zeros(9)]
    moved = carriers.displacement((cone, bore), rim.centre + 5.0 * out)
    # the cone is where z - 14 = r - 5: off by c along its normal, that of its outside, it is at r - 5 + c sqrt(2)
    up = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(moved @ [0, 0, 0, 0.4, 0, 0], 0.4 * out + 0.4 * up, atol=0.005)
    lowered = moved @ [0.1, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(lowered, np.tile(-0.1 * np.sqrt(2) * up, (9, 1)), atol=0.003)
    # a cone beside its place along x is as deep as before on the whole, and tilts the rim
    x = moved @ [0, 0.1, 0, 0, 0, 0]
    assert np.abs(x @ up).max() == pytest.approx(0.1, abs=0.01)
    assert (x @ up)[0] * (x @ up)[4] < 0


def test_a_rim_of_a_cone_in_a_plane_moves_with_both():
    solid = solids.countersunk_block()
    carriers = Carriers(solid)
    (rim,) = [one for one in solid.rims() if abs(one.centre[2] - 20.0) < 1e-9]
    plane, cone = carriers.of_curve(rim)
    assert carriers.surfaces[plane].is_plane
    assert not carriers.surfaces[cone].is_plane
    out = np.eye(3)[:2]
    moved = carriers.displacement((plane, cone), rim.centre + 11.0 * out)
    # the cone is 45°, so where it is cut higher it is as much wider
    np.testing.assert_allclose(moved @ [0.1, 0, 0, 0, 0, 0], 0.1 * out + [0, 0, 0.1], atol=0.002)
    wider = moved @ [0, 0, 0, 0.1, 0, 0]
    np.testing.assert_allclose(wider, 0.1 * np.sqrt(2) * out, atol=0.002)
