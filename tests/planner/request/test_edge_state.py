"""Geometry of broken edges: the lines that a camera sees, and the statistics of a break."""

import numpy as np
import pytest

from planner import RequestError
from planner.request.edge_state import (
    UNSTATED_MM,
    EdgeState,
    broken_lines,
    chamfer_lines,
    checked_break,
    round_band,
    shifts_of,
    spread_of,
)

ALONG = np.array([[0.0, 1.0, 0.0]])


def wedge(angle_deg):
    """Normals (1, 2, 3) of two faces that meet along y, the first horizontal, and its edge's way into both faces."""
    angle = np.radians(angle_deg)
    normals = np.array([[[0.0, 0.0, 1.0], [np.sin(angle), 0.0, np.cos(angle)]]])
    into = np.array([[-1.0, 0.0, 0.0], [np.cos(angle), 0.0, -np.sin(angle)]])
    return normals, into


def arc(angle_deg, n=200_001):
    """Points of the round band of a break of 1 mm, found by its centre: the same distance from both faces."""
    normals, into = wedge(angle_deg)
    touch = into[0]
    radius = 1.0 / np.tan(np.radians(angle_deg) / 2)
    centre = touch - radius * normals[0, 0]
    turn = np.linspace(0.0, np.radians(angle_deg), n)
    return centre + radius * np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)


@pytest.mark.parametrize("angle_deg", [30.0, 90.0, 120.0])
def test_lines_lie_in_the_faces_one_leg_from_the_edge(angle_deg):
    normals, into = wedge(angle_deg)
    lines = broken_lines(normals, ALONG, np.array([True]), normals.sum(axis=1))
    assert lines[0] == pytest.approx(into, abs=1e-12)


@pytest.mark.parametrize(("angle_deg", "way"), [(90.0, (-1.0, 0.3, 0.5)), (60.0, (-2.0, 0.0, 0.3))])
def test_outline_is_where_the_line_of_sight_touches_the_band(angle_deg, way):
    normals, into = wedge(angle_deg)
    towards = np.array([way])
    lines = broken_lines(normals, ALONG, np.array([True]), towards)[0]
    across = np.cross(ALONG[0], way)
    band = arc(angle_deg)
    # the farthest point of the band towards the edge of the model
    towards_edge = -np.sign(into[0] @ across)
    extreme = towards_edge * (towards_edge * (band @ across)).max()
    assert lines[0] == pytest.approx(into[0])
    assert lines[1] @ across == pytest.approx(extreme, abs=1e-8)


def test_chamfer_is_seen_to_its_far_line_or_not_at_all():
    normals, into = wedge(90.0)
    convex = np.array([True])
    seen = chamfer_lines(normals, ALONG, convex, np.array([[-0.5, 0.0, 1.0]]))
    hidden = chamfer_lines(normals, ALONG, convex, np.array([[-2.0, 0.0, 1.0]]))
    assert seen[0] == pytest.approx(into)
    assert hidden[0] == pytest.approx(np.array([into[0], into[0]]))


def test_reentrant_and_smooth_edges_are_not_broken():
    normals, _ = wedge(90.0)
    assert not broken_lines(normals, ALONG, np.array([False]), normals.sum(axis=1)).any()
    smooth, _ = wedge(1.0)
    assert not broken_lines(smooth, ALONG, np.array([True]), smooth.sum(axis=1)).any()


def test_strips_lie_on_the_round_band():
    normals, into = wedge(120.0)
    lines, middles = round_band(normals, ALONG, normals.sum(axis=1), 6)
    band = arc(120.0)
    apart = np.linalg.norm(lines[0][:, None] - band[::50], axis=2).min(axis=1)
    assert apart.max() < 1e-3
    assert lines[0][[0, -1]] == pytest.approx(into)
    assert np.linalg.norm(middles, axis=2) == pytest.approx(1.0)


@pytest.mark.parametrize("state", [EdgeState(), EdgeState(0.1, 0.3, True)])
def test_shift_and_variance_are_those_of_drawn_breaks(state):
    rng = np.random.default_rng(1)
    n = 400_000
    ends = np.array([[1.0, 0.2], [-0.4, 0.1]])
    breaks = rng.uniform(state.low_mm, state.high_mm, (n, 2))
    drawn = (breaks * (ends[:, 0] + rng.uniform(0, 1, (n, 2)) * np.diff(ends)[:, 0])).sum(axis=1)
    shift, variance = spread_of(*shifts_of(ends, state), state)
    assert shift == pytest.approx(drawn.mean() if state.stated else 0.0, abs=3e-4)
    expected = drawn.var() if state.stated else (drawn**2).mean()
    assert variance == pytest.approx(expected, rel=0.01)


def test_what_is_not_stated_is_sharp_within_the_limit():
    assert EdgeState.of(None, None) == EdgeState(0.0, UNSTATED_MM, False)
    assert EdgeState.of(None, (0.1, 0.2), (0.3, 0.4)) == EdgeState(0.1, 0.2, True)
    assert [str(EdgeState.of(limits)) for limits in (None, (0, 0), (0.2, 0.2), (0.1, 0.3))] == [
        "assumed sharp within 0.05 mm",
        "stated as sharp",
        "broken by 0.2 mm",
        "broken by 0.1 to 0.3 mm",
    ]


@pytest.mark.parametrize(
    "value", [(0.3, 0.1), (-0.1, 0.1), (0.1,), "wide", (0.0, float("nan")), 0.2]
)
def test_breaks_are_two_numbers_in_rising_order(value):
    with pytest.raises(RequestError, match="edge_break_mm must be two numbers, 0 <= low <= high"):
        checked_break(value)
