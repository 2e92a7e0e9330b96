"""Rims and arcs of solids: circles fitted to chords, and what is none."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from rimmed_solids import lattice_circle, rimmed_solid
from solids import box_with_pockets, cube, prism, prism_faces, ring

from aspectgraph import Solid, SolidError, read_solid
from aspectgraph.solid.rims import Circle, CircularEdge, find_edge_ends, fit_circle

SQUARE = [(-10, -10), (10, -10), (10, 10), (-10, 10)]


def holed(n: int, radius: float = 4.0) -> Solid:
    return prism(SQUARE, 5, [ring(radius, n, (1, 2), clockwise=True)])


@pytest.mark.parametrize("n", [8, 12, 37, 120])
def test_rims_of_a_hole_have_its_circle(n):
    rims = holed(n).rims()
    assert [rim.id for rim in rims] == ["r0", "r1"]
    assert sorted(rim.centre[2].round(9) for rim in rims) == [0.0, 5.0]
    for rim in rims:
        assert rim.centre[:2] == pytest.approx([1, 2])
        assert rim.radius_mm == pytest.approx(4.0)
        assert rim.axis == pytest.approx([0, 0, 1 if rim.centre[2] > 1 else -1]), (
            "out of the material"
        )
        assert len(rim.edge_ids) == len(rim.vertices) == n
        assert rim.residual_mm < 1e-12
        assert rim.chord_mm == pytest.approx(4.0 * (1 - np.cos(np.pi / n)))
        assert rim.dihedral_deg == pytest.approx(90.0)
        assert rim.fitted


def test_chords_are_in_order_and_counter_clockwise():
    solid = holed(12)
    for rim in solid.rims():
        line = [*rim.vertices, rim.vertices[0]]
        for a, b, e in zip(line, line[1:], rim.edge_ids, strict=False):
            assert set(solid.edges[e].vertices) == {a, b}
            turn = (
                np.cross(solid.vertices[a] - rim.centre, solid.vertices[b] - rim.centre) @ rim.axis
            )
            assert turn == pytest.approx(16 * np.sin(np.pi / 6))


@pytest.mark.parametrize("n", [3, 4, 5, 6, 7])
def test_a_polygon_of_few_sides_is_no_rim(n):
    solid = holed(n)
    assert solid.rims() == () == solid.arcs()


def test_boxes_have_neither():
    for solid in (cube(), box_with_pockets((6, 6, 4), [(2, 1, 3, 1, 3, 2)])):
        assert solid.rims() == () == solid.arcs()


def test_an_ellipse_is_no_rim():
    profile = [(1.2 * x, y) for x, y in ring(4.0, 36, clockwise=True)]
    assert prism(SQUARE, 5, [profile]).rims() == ()


def test_the_flat_of_a_d_is_not_part_of_its_arc():
    profile = [p for p in ring(4.0, 24) if p[0] < 3.0]
    solid = prism(SQUARE, 5, [profile[::-1]])
    arcs = solid.arcs()
    # corners at 45° to 315° in steps of 15°
    assert [len(arc.edge_ids) for arc in arcs] == [18, 18]
    for arc in arcs:
        assert arc.end_rad - arc.start_rad == pytest.approx(np.radians(270))
        assert arc.radius_mm == pytest.approx(4.0)
        across = np.cross(arc.axis, arc.reference)
        angles = np.array([arc.start_rad, arc.end_rad])[:, None]
        ends = arc.centre + 4.0 * (np.cos(angles) * arc.reference + np.sin(angles) * across)
        assert ends == pytest.approx(solid.vertices[[arc.vertices[0], arc.vertices[-1]]])


def test_a_slot_has_two_arcs_on_each_side():
    right = [(3 + 2 * np.cos(a), 2 * np.sin(a)) for a in np.radians(np.arange(-90, 91, 15))]
    left = [(-x, -y) for x, y in right]
    arcs = prism(SQUARE, 5, [[*right, *left][::-1]]).arcs()
    assert [len(arc.edge_ids) for arc in arcs] == [12] * 4
    assert sorted(arc.centre[0].round(9) for arc in arcs) == [-3, -3, 3, 3]
    assert [arc.end_rad - arc.start_rad for arc in arcs] == pytest.approx([np.pi] * 4)


@pytest.mark.parametrize("seed", range(0, 24, 2))
def test_generated_plates_have_the_rims_they_were_built_with(seed):
    part, circles = rimmed_solid(seed)
    rims = Solid(part.vertices, part.faces).rims()
    found = {(*rim.centre.round(6).tolist(), round(rim.radius_mm**2, 6)) for rim in rims}
    assert found == {(*map(float, centre), float(square)) for centre, square in circles}
    assert len(rims) == len(circles)
    assert max(rim.residual_mm for rim in rims) < 1e-9


def test_moved_solids_and_pickles_have_the_same_rims():
    solid = holed(12)
    again = pickle.loads(pickle.dumps(solid))
    assert again.rims() == solid.rims()
    assert (again.rims()[0].centre == solid.rims()[0].centre).all()
    with pytest.raises(ValueError, match="read-only"):
        solid.rims()[0].centre[0] = 1.0


def test_the_truth_of_the_cad_model_is_kept_beside_the_chords():
    """Chords measured coarsely, the model's circle a little larger: it is the one reported, with what they are off."""
    builder = prism_faces(SQUARE, 5, [ring(4.0, 12, clockwise=True)])
    plain = builder.solid("plain")
    top = next(rim for rim in plain.rims() if rim.centre[2] > 1)
    circle = Circle(np.array([0.0, 0.0, 5.0]), np.array([0.0, 0.0, -1.0]), 4.01)
    halves = [top.vertices[:7], (*top.vertices[6:], top.vertices[0])]
    known = [CircularEdge(circle, half, 90.0) for half in halves]
    solid = Solid(plain.vertices, plain.faces, circular_edges=known)
    (rim,) = solid.rims()
    assert (rim.radius_mm, rim.fitted, len(rim.edge_ids)) == (4.01, False, 12)
    assert rim.residual_mm == pytest.approx(0.01)
    assert rim.axis == pytest.approx([0, 0, 1])
    assert solid.arcs() == ()
    (arc,) = Solid(plain.vertices, plain.faces, circular_edges=known[:1]).arcs()
    assert (len(arc.edge_ids), arc.id) == (6, "a0")


def test_a_smooth_circular_edge_is_offered_only_on_demand_and_numbered_last():
    plain = holed(12)
    rims = plain.rims()
    known = [
        CircularEdge(rim.circle, (*rim.vertices, rim.vertices[0]), turn)
        for rim, turn in zip(rims, (2, 90), strict=True)
    ]
    solid = Solid(plain.vertices, plain.faces, circular_edges=known)
    assert [(rim.id, rim.edge_ids) for rim in solid.rims()] == [("r0", rims[1].edge_ids)]
    assert [(rim.id, rim.edge_ids) for rim in solid.rims(min_dihedral_deg=1)] == [
        ("r0", rims[1].edge_ids),
        ("r1", rims[0].edge_ids),
    ]


def test_no_circles_in_the_model_means_none_are_fitted():
    plain = holed(12)
    assert Solid(plain.vertices, plain.faces, circular_edges=[]).rims() == ()


def test_fit_is_exact_on_a_circle():
    points = np.array([(x, y, 7) for x, y in lattice_circle(65)], dtype=float)
    circle = fit_circle(points)
    assert circle.centre == pytest.approx([0, 0, 7])
    assert circle.radius_mm == pytest.approx(np.sqrt(65))
    assert abs(circle.axis) == pytest.approx([0, 0, 1])
    assert fit_circle(np.array([(0, 0, 0), (1, 1, 1), (3, 3, 3)], dtype=float)) is None


# Ends of straight edges: corners, and where an edge runs on smoothly.


def rounded_bar(n: int) -> Solid:
    """A bar whose right end is half a circle of n chords, tangent to both of its long sides."""
    angles = np.pi * (np.arange(n + 1) / n - 0.5)
    arc = [(10 + 3 * np.cos(a), 3 * np.sin(a)) for a in angles]
    return prism([(0, -3), *arc, (0, 3)], 4, name="bar")


def edge_between(solid: Solid, p, q) -> int:
    places = [np.sort(solid.edge_points(edge.id), axis=0) for edge in solid.edges]
    return int(np.argmin([np.abs(place - np.sort([p, q], axis=0)).max() for place in places]))


def test_all_ends_of_a_cube_are_corners():
    solid = cube()
    for edge in solid.edges:
        ends = solid.edge_ends(edge)
        assert [end.vertex for end in ends] == list(edge.vertices)
        assert [(end.kind, end.arc) for end in ends] == [("corner", None)] * 2
        assert [end.angle_deg for end in ends] == pytest.approx([90.0, 90.0])


@pytest.mark.parametrize("n", [20, 30])
def test_a_side_runs_on_in_the_arc_it_touches(n):
    solid = rounded_bar(n)
    edge_id = edge_between(solid, (0, 3, 4), (10, 3, 4))
    by_x = {round(float(solid.vertices[end.vertex][0])): end for end in solid.edge_ends(edge_id)}
    assert (by_x[0].kind, by_x[0].text) == ("corner", "corner")
    assert by_x[10].kind == "tangent"
    # the first chord of n on half a circle turns by half of 180/n; the seam of the round face does not show
    assert by_x[10].angle_deg == pytest.approx(90.0 / n)
    arc = next(arc for arc in solid.arcs() if arc.id == by_x[10].arc)
    assert arc.radius_mm == pytest.approx(3.0)
    assert arc.centre == pytest.approx([10.0, 0.0, 4.0])
    assert by_x[10].text == f"tangent ({arc.id})"


@pytest.mark.parametrize(
    ("turn_deg", "kind"),
    [(24.0, "tangent"), (26.0, "corner"), (154.0, "corner"), (156.0, "tangent")],
)
def test_a_corner_turns_by_25_degrees_from_the_edges_line(turn_deg, kind):
    """A bar that turns at the origin; of the edges there only those of its outline show."""
    turn = np.radians(180 - turn_deg)
    profile = [(-9.0, 0.0), (0.0, 0.0), (-7 * np.cos(turn), 7 * np.sin(turn)), (-9.0, 9.0)]
    solid = prism(profile, 2.0)
    edge = solid.edges[edge_between(solid, (-9, 0, 2), (0, 0, 2))]
    outline = solid.edges[edge_between(solid, (0, 0, 2), (*profile[2], 2))]
    vertex = next(v for v in edge.vertices if np.abs(solid.vertices[v] - [0, 0, 2]).max() < 1e-9)
    (end,) = [
        end
        for end in find_edge_ends(solid, edge, {vertex: [edge, outline]}, {})
        if end.vertex == vertex
    ]
    assert (end.kind, end.arc) == (kind, None)
    assert end.angle_deg == pytest.approx(min(turn_deg, 180 - turn_deg))


@pytest.mark.parametrize("edge_id", [-1, 12, True, "0"])
def test_an_edge_that_is_none(edge_id):
    with pytest.raises(SolidError, match=r"^an edge must be one of the solid's, 0\.\.11\. Got "):
        cube().edge_ends(edge_id)


def test_ends_of_a_step_part_are_tangent_where_the_edge_is_square_to_the_radius():
    """Of NIST's CTC-01, whose fillets are quarter circles; a corner may lie at the end of an arc as well."""
    solid = read_solid("examples/nist_ctc_01_ap242.stp")
    straight = solid.straight_edges()
    expected = set()
    for arc in solid.arcs():
        for vertex in (arc.vertices[0], arc.vertices[-1]):
            radius = (solid.vertices[vertex] - arc.centre) / arc.radius_mm
            for edge in straight:
                start, end = solid.edge_points(edge.id)
                along = (end - start) / np.linalg.norm(end - start)
                if (
                    vertex in edge.vertices
                    and abs(along @ radius) < 1e-6
                    and abs(along @ arc.axis) < 1e-6
                ):
                    expected.add((edge.id, vertex))
    found = {
        (edge.id, end.vertex)
        for edge in straight
        for end in solid.edge_ends(edge)
        if end.arc is not None
    }
    assert len(expected) > 80
    assert found == expected
