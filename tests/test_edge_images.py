"""The referee for edges in rendered images: it measures what is known, and flags what cannot be measured."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from lit_parts import block
from plan_examples import plan, setting

from aspectgraph import Solid, read_solid
from planner import Camera, Detectability, PoseUncertainty
from planner.detectability.image_check import ImageCheck

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "images"))
from corner_detectors import corner_sub_pix, traced_end
from edge_images import Lines, Pair, crossing, fitted, pairs

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 600.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.0005)
ONE = np.ones((1, 1), dtype=bool)


def one_plan(position, target, ends):
    return plan(
        settings=(setting(position, ["edge"], target),),
        entities={"edge": np.array(ends, dtype=float)},
        uninspectable={},
        camera=CAMERA,
        pose_uncertainty=UNCERTAINTY,
    )


def only(asked, solid, n=8):
    (found,) = pairs(asked, solid, n, 0)
    return found


def margins(asked, solid, edge_ids):
    """What the planner says of the same view."""
    check = ImageCheck(
        solid, [edge_ids], np.array([asked.entities["edge"]]), CAMERA, Detectability()
    )
    pose = np.asarray(asked.settings[0].cam2world)[None]
    return check.corners(pose, ONE)[0, 0], check.separations(pose, ONE)[0, 0]


def plate(thickness):
    vertices = [(x, y, z) for x in (0.0, 80) for y in (0.0, 50) for z in (0.0, thickness)]
    return Solid(
        vertices,
        [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)],
    )


def test_a_line_and_where_two_meet():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 100, 40)
    points = np.column_stack([3 + 0.6 * t, 5 + 0.8 * t]) + rng.normal(0, 0.05, (40, 2))
    # one point astray
    points[7] += (9.0, -9.0)
    line = fitted(points)
    assert abs(line[1] @ (0.6, 0.8)) == pytest.approx(1.0, abs=1e-5)
    other = np.array([33.0, 0.0]), np.array([0.0, 1.0])
    assert crossing(line, other) == pytest.approx((33.0, 45.0), abs=0.1)


def test_detectors_find_the_corner_of_a_bright_square():
    """Its corner is at (20.3, 24.7) of a picture that begins at (100, 200): pixels are averages over their area."""
    fine = np.zeros((450, 450))
    fine[:252, :208] = 200.0
    grey = fine.reshape(45, 10, 45, 10).mean(axis=(1, 3)).astype(np.uint8)
    first = np.array([100, 200])
    corner = np.array([100 + 20.3, 200 + 24.7])
    assert corner_sub_pix(grey, first, corner + 0.4) == pytest.approx(corner, abs=0.2)
    # the right side ends below, and its trace goes around the corner
    end = traced_end(grey, first, corner, np.array([0.0, 1.0]))
    assert np.linalg.norm(end - corner) < 2.0
    # where there is no edge, nothing is traced
    assert np.isnan(
        traced_end(np.zeros((45, 45), np.uint8), first, corner, np.array([0.0, 1.0]))
    ).all()


def test_a_clean_edge_is_measured_as_promised():
    """The front edge of a block from before and above: two corners, nothing near."""
    asked = one_plan((40.0, -420.0, 420.0), (40.0, 10.0, 50.0), [[0, 0, 60], [80, 0, 60]])
    found = only(asked, block())
    assert found.kind == "clean"
    assert found.step > 5
    assert found.measured[:2] == (1.0, 1.0)
    assert found.worst <= 3
    assert min(margins(asked, block(), solid_edge(block(), asked))) >= 0


def solid_edge(solid, asked):
    from aspectgraph import resolve_entities

    return resolve_entities(solid, {"e": asked.entities["edge"]})["e"].edge_ids


def test_floor_and_rim_seen_edge_on_are_flagged():
    """A plate 0.6 mm thick, from 600 mm: its upper and its lower edge are 7 px apart at most."""
    solid = plate(0.6)
    asked = one_plan((40.0, -300.0, 520.0), (40.0, 10.0, 0.0), [[0, 0, 0.6], [80, 0, 0.6]])
    found = only(asked, solid)
    assert found.kind in ("near line", "no corner")
    assert found.near_px < 5
    assert min(margins(asked, solid, solid_edge(solid, asked))) < 0


def test_the_straight_side_of_a_slot_is_flagged():
    """It runs on in an arc at both ends, so there is no corner to measure to."""
    solid = read_solid("examples/nist_ctc_01_ap242.stp")
    asked = one_plan((-285.0, -120.0, 420.0), (-285.0, 0.0, 0.0), [[-325, -20, 0], [-245, -20, 0]])
    found = only(asked, solid, 1)
    assert found.kind == "no corner"
    # the paper's conditions would promise nearly all
    assert found.promised[0] > 0.99
    assert margins(asked, solid, solid_edge(solid, asked))[0] < 0


def test_lines_of_a_block():
    """Of a corner seen from outside, all three edges leave it; from straight before a face, two of them show."""
    lines = Lines(block())
    assert lines.line.all()
    assert lines.shown(np.array([300.0, -300.0, 300.0])).sum() == 9
    assert lines.shown(np.array([40.0, -300.0, 30.0])).sum() == 4


def test_what_is_promised_too_much_is_told_in_standard_errors():
    one = Pair(
        "p",
        0,
        "e",
        "clean",
        100.0,
        50.0,
        100,
        (0.9, 0.9, 0.5),
        (0.78, 0.9, 0.0),
        *[(0.8, 0.9, 0.1)] * 3,
    )
    # sqrt(.9 * .1 / 100) = .03
    assert one.worst == pytest.approx(4.0)
