"""Ends of straight edges: corners, and where an edge runs on smoothly."""

from __future__ import annotations

import numpy as np
import pytest
from solids import cube, prism

from aspectgraph import Solid, SolidError, read_solid
from aspectgraph.solid.rims import find_edge_ends


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
