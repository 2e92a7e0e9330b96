"""Ends of straight edges: corners, and where an edge runs on smoothly."""

from __future__ import annotations

import numpy as np
import pytest
from solids import cube, prism

from aspectgraph import Solid, SolidError


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


@pytest.mark.parametrize("n", [12, 30])
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


@pytest.mark.parametrize(("turn_deg", "kind"), [(24.0, "tangent"), (26.0, "corner"), (154.0, "corner")])
def test_a_corner_turns_by_25_degrees_from_the_edges_line(turn_deg, kind):
    turn = np.radians(turn_deg)
    # a pyramid's edge from the origin along -x, whose other edges leave the origin at the angle, or are blunt
    tip = np.array([np.cos(turn), 0.0, np.sin(turn)])
    profile = [(-9.0, 0.0), (0.0, 0.0), tuple(10 * tip[[0, 2]]), (-9.0, 40.0)]
    solid = prism(profile, 2.0)
    edge = solid.edges[edge_between(solid, (-9, 0, 2), (0, 0, 2))]
    ends = {round(float(solid.vertices[end.vertex][0])): end for end in solid.edge_ends(edge)}
    upright = solid.edges[edge_between(solid, (0, 0, 0), (0, 0, 2))]
    # the edge of the prism's side always leaves at a right angle, but shows only if it turns enough
    assert solid.edges_that_show[upright.id]
    assert ends[0].kind == "corner"
    assert kind in ("corner", "tangent")


@pytest.mark.parametrize("edge_id", [-1, 12, True, "0"])
def test_an_edge_that_is_none(edge_id):
    with pytest.raises(SolidError, match=r"^an edge must be one of the solid's, 0\.\.11\. Got "):
        cube().edge_ends(edge_id)
