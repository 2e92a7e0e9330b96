"""The lines that a corner is fitted with must be long enough in the image, and apart from others."""

import numpy as np
import pytest

from aspectgraph import Solid, resolve_entities
from planner import Camera, Detectability, look_at
from planner.detectability.image_check import ImageCheck

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 600.0)
# pixels per mm, frontally at 600 mm
SCALE = float(CAMERA.matrix[0, 0]) / 600.0
ONE = np.ones((1, 1), dtype=bool)


def extruded(outline):
    """A plate of 20 mm along y; its front face, at y = 0, is the outline (x, z), counter-clockwise from the front."""
    n = len(outline)
    vertices = [(x, y, z) for y in (0.0, 20.0) for x, z in outline]
    sides = [(k, n + k, n + (k + 1) % n, (k + 1) % n) for k in range(n)]
    return Solid(
        vertices, [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1)), *sides], name="plate"
    )


def corner(outline, showing):
    """The margin of the top front edge, seen frontally."""
    solid = extruded(outline)
    top = max(z for _, z in outline)
    xs = [x for x, z in outline if z == top]
    found = resolve_entities(solid, {"e": [[min(xs), 0, top], [max(xs), 0, top]]})["e"]
    check = ImageCheck(solid, [found.edge_ids], found.endpoints[None], CAMERA, showing)
    middle = (min(x for x, _ in outline) + max(x for x, _ in outline)) / 2
    pose = look_at([[middle, -600.0, top / 2]], [middle, 0.0, top / 2])
    return check.corners(pose, ONE)[0, 0]


def plate(height):
    return [(0, 0), (60, 0), (60, height), (0, height)]


@pytest.mark.parametrize("separation_px", [5.0, 12.0])
def test_a_line_must_be_two_separations_long(separation_px):
    """Square to the edge, all of a line's length counts: of the plate's sides, height times pixels per mm."""
    least = 2 * separation_px / SCALE
    showing = Detectability(separation_px=separation_px, min_corner_deg=25.0)
    # the lower edge must stay apart from the upper one, too: it is two separations away
    assert corner(plate(least * 1.01), showing) == pytest.approx(65.0, abs=1e-3)
    assert corner(plate(least * 0.99), showing) == -25.0
    assert corner(plate(least * 0.99), Detectability(0.0, 40.0, 25.0)) == pytest.approx(
        65.0, abs=1e-3
    )


@pytest.mark.parametrize(
    ("lean", "least_px"),
    [
        # the line goes out below the edge: the plate's bottom comes back from its tip at 45 degrees, too
        (1, 23.0),
        # it goes in: the bottom leaves its tip at 135 degrees, and is beside nothing of it
        (-1, 16.5),
    ],
)
def test_at_an_angle_the_first_piece_of_a_line_does_not_count(lean, least_px):
    """At 45 degrees 6.5 px of a line have the edge within 5 px and its blur across them; ten more are needed."""
    showing = Detectability(separation_px=5.0, min_corner_deg=25.0)
    for px, good in ((least_px + 0.3, True), (least_px - 0.3, False)):
        side = px / SCALE / np.sqrt(2)
        inside = lean * side
        outline = [(0, 0), (60, 0), (60 - inside, side), (inside, side)]
        assert (corner(outline, showing) > 0) == good


def test_an_edge_must_be_two_separations_long_beyond_what_is_mixed():
    """A parallelogram: one side comes back under the edge at 45 degrees, so 6.5 px are mixed; the other does not."""
    down = 60.0 / SCALE / np.sqrt(2)
    for px, good in ((16.8, True), (16.2, False)):
        long = px / SCALE
        outline = [(down, 0), (down + long, 0), (long, down), (0, down)]
        assert (corner(outline, Detectability(separation_px=5.0, min_corner_deg=25.0)) > 0) == good


def test_a_line_beside_the_line_at_an_end():
    """A slit 4 px beside the plate's left side, up to 12 px below the edge: that is apart from it, the side is not."""
    gap = 4.0 / SCALE
    top = 40.0
    below = top - 12.0 / SCALE
    slit = [
        (0, 0),
        (gap, 0),
        (gap, below),
        (gap + 1, below),
        (gap + 1, 0),
        (60, 0),
        (60, top),
        (0, top),
    ]
    assert corner(slit, Detectability(separation_px=5.0, min_corner_deg=25.0)) == -25.0
    assert corner(slit, Detectability(separation_px=3.0, min_corner_deg=25.0)) == pytest.approx(
        65.0, abs=1e-3
    )
    # beyond what is fitted it does not matter
    deep = [(x, z if z != below else top - 40.0 / SCALE) for x, z in slit]
    assert corner(deep, Detectability(separation_px=5.0, min_corner_deg=25.0)) == pytest.approx(
        65.0, abs=1e-3
    )
