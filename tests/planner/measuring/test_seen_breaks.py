"""Breaks that images show: closed forms of profiles, and plates with true chamfers and bands, seen by rays."""

from functools import cache
from types import SimpleNamespace

import measured_plate as plate
import numpy as np
import pytest
from part_images import Optics, PartImages
from scipy.ndimage import gaussian_filter1d

from planner import Camera, MeasureOptions, Measurer, Registration
from planner.measuring.seen_breaks import (
    LEAST_TIMES,
    ROUND_TIMES,
    SeenBreak,
    _agreed,
    _between_flat,
    _Sections,
    distance_of_steps,
    pixel_mm,
    seen_notes,
)
from planner.request.edge_state import SHARP, EdgeState

OWN = Registration.own_edges(0.02)
# .11 mm are a pixel
CAMERA = Camera(25.0, (0.009, 0.009), (960, 768), 8.0, 300.0)
FINE = 50


def blurred(light):
    """Grey values (n,) every half pixel of light that is given FINE times a pixel: box of a pixel, blur of 0.8 px."""
    box = np.convolve(np.pad(light, FINE, mode="edge"), np.ones(FINE) / FINE, mode="same")
    return gaussian_filter1d(box[FINE:-FINE], 0.8 * FINE)[:: FINE // 2]


def places():
    return (np.arange(24 * FINE + 1) - 12 * FINE) / FINE


@pytest.mark.parametrize("apart", [2.2, 3.0, 7.0])
def test_the_distance_of_two_steps_is_found_wherever_they_are(apart):
    x = places()
    for first in (-3.3, 0.2):
        light = 0.2 + 0.15 * (x > first) + 0.3 * (x > first + apart)
        assert distance_of_steps(blurred(light)) == pytest.approx(apart, rel=0.2)


def test_a_single_step_on_uneven_faces_has_no_distance():
    x = places()
    light = np.where(x < 0.4, 0.3 + 0.01 * x, 0.6 - 0.008 * x)
    assert distance_of_steps(blurred(light)) <= 0.8


@pytest.mark.parametrize("turn", [-20.0, 10.0, 40.0, 65.0])
@pytest.mark.parametrize("size", [2.5, 6.0])
def test_a_round_band_looks_like_a_chamfer_up_to_so_much_smaller(turn, size):
    """A camera straight above, a matt quarter of a cylinder to the background, light from an angle."""
    x = places()
    inside = np.clip(x / size, 0.0, 1.0)
    normal = np.stack([inside, np.sqrt(1.0 - inside**2)])
    lamp = np.array([np.sin(np.deg2rad(turn)), np.cos(np.deg2rad(turn))])
    light = np.where(x < size, 0.1 + 0.7 * np.maximum(lamp @ normal, 0.0), 0.05)
    seen = distance_of_steps(blurred(light))
    assert LEAST_TIMES * seen <= size
    # a lamp from the other side leaves a band that is as bright as the face
    assert size <= ROUND_TIMES * max(seen, 0.8) * 1.1


@cache
def measured(kind, size):
    """Values of a plate of which nothing is stated, with its true deviations of zero."""
    solid = plate.thick_plate()
    measurer = Measurer(plate.measured_plan(solid, settings=1, camera=CAMERA), solid)
    profile = {
        "chamfer": [(size, 0.0), (0.0, size)],
        "radius": [
            (size * (1 - np.sin(turn)), size * (1 - np.cos(turn)))
            for turn in np.linspace(0.0, np.pi / 2, 7)
        ],
    }
    mesh = plate.broken_plate(profile[kind]) if size else plate.fine_plate()
    images = PartImages(*mesh, Optics(CAMERA.matrix, CAMERA.resolution, noise=0.005, samples=3))
    image = images.image(plate.POSES[0], [plate.LAMP], np.random.default_rng(1))
    return measurer.measure({1: image}, MeasureOptions(OWN), partial=True)


@pytest.mark.parametrize(("kind", "size"), [("chamfer", 0.3), ("chamfer", 0.6), ("radius", 0.5)])
def test_breaks_that_nobody_states_are_seen_and_values_hold(kind, size):
    results = measured(kind, size)
    (note,) = [note for note in results.notes if "edges look broken" in note]
    assert "state edges" in note
    low, high = (float(word) for word in results.edges.split(" mm")[0].split()[2::2])
    assert low <= size <= high
    assert results.edges.endswith("(as images show)")
    read = [result for result in results if result.measured]
    assert read
    for result in read:
        assert abs(result.deviation) <= result.expanded_uncertainty


def test_breaks_with_which_fewer_images_are_registered_are_not_believed(monkeypatch):
    """Faces that deviate look like breaks. The image is then registered as stated, and measured so."""
    whole = Measurer._all_registered

    def sharp_only(self, pictures, options, progress):
        if options.edge_break_mm is None:
            return whole(self, pictures, options, progress)
        return {}, dict.fromkeys(pictures, ("too few edges", ""))

    monkeypatch.setattr(Measurer, "_all_registered", sharp_only)
    results = measured.__wrapped__("chamfer", 0.6)
    assert not results.failed
    assert len(results.images) == 1
    assert results.edges.startswith("assumed sharp")
    assert not any("edges look broken" in note for note in results.notes)


def test_sharp_edges_show_no_break():
    results = measured("sharp", 0.0)
    assert not any("broken" in note for note in results.notes)
    assert results.edges.startswith("assumed sharp")


def test_a_break_within_what_is_stated_is_not_told():
    seen = SeenBreak(0.2, (0.16, 0.6), ("e1", "e2", "e3", "e4"))
    assert seen_notes(None, EdgeState()) == []
    assert seen_notes(seen, EdgeState(0.1, 0.3, True)) == []
    (unstated,) = seen_notes(seen, EdgeState())
    assert unstated == (
        "edges look broken by about 0.2 mm (e1, e2, e3, ...): measured as broken by 0.16 to 0.6 mm; state edges"
    )
    (wrong,) = seen_notes(seen, SHARP)
    assert wrong.endswith("and they are stated as sharp: measured as stated")
    small = EdgeState(0.1, 0.1, True)
    (wrong,) = seen_notes(seen, small)
    assert wrong.endswith("and they are stated as broken by 0.1 mm: measured as stated")
    # rendered edges are sharp: they look broken because a break is stated
    assert seen_notes(seen, small, is_drawn_sharp=True) == []
    assert seen_notes(seen, EdgeState(), is_drawn_sharp=True) == [unstated]


class Beside:
    """Faces beside six samples: the second side turns from 3 px on, or ends, or there is a shadow on it."""

    def beside(self, across, px):
        turn = np.deg2rad([0.0, 5.0, 30.0, 0.0, 0.0, 0.0]) * (px > 3)
        turned = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
        normals = np.stack([np.tile([0.0, 0.0, 1.0], (6, 1)), turned])
        on_part = np.ones((2, 6), dtype=bool)
        on_part[0, 3] = False
        on_part[0, 4] = px < 3
        light = np.ones((2, 6))
        light[1, 5] = px < 3
        return SimpleNamespace(normals=normals, light=lambda place: (light, light)), on_part


SIZES = np.array([0.0, 0.04, 0.08, 0.12, 0.17, 0.25, 0.4, 0.5, 0.7, 1.0])


def agreed(shown):
    """What edges show of one section each: a size where it is clear, any size for None; 10 px a millimetre."""
    n = len(shown)
    likelihoods = np.zeros((n, len(SIZES)))
    for row, size in zip(likelihoods, shown, strict=True):
        if size is not None:
            row[:] = -100.0
            row[np.argmin(np.abs(SIZES - size))] = 0.0
    each = np.arange(n)
    sections = _Sections(
        np.zeros((n, 3)), np.full(n, 10.0), each, np.zeros(n, int), np.full(n, 10.0), np.ones(n)
    )
    return _agreed(likelihoods, sections, SIZES, [f"e{k}" for k in each])


@pytest.mark.parametrize(
    ("shown", "limits"),
    [
        ([0.17] * 3, (0.14, 0.51)),
        # one radius in light from one side, with its median between both
        ([0.17] * 3 + [0.4] * 3, (0.14, 1.2)),
        ([0.17] * 3 + [0.4] * 3 + [0.0] * 5, (0.14, 1.2)),
        # too few, too different, or too many edges that are sharper
        ([0.17] * 2 + [0.4] * 2, None),
        ([0.17] * 3 + [0.5] * 3, None),
        ([0.17] * 3 + [0.4] * 3 + [0.0] * 6, None),
    ],
)
def test_edges_agree_on_one_size_or_on_one_radius(shown, limits):
    seen = agreed([*shown, None, None])
    assert (seen and seen.limits_mm) == limits


def test_a_pixel_is_at_least_as_large_as_at_the_nearest_sharp_place():
    """A camera within a large part may look past its middle: 8 mm, 0.00345 mm pitch, sharp from 266 mm on."""
    camera = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 300.0)
    solid = plate.thick_plate()
    away = np.eye(4)
    away[:3, 3] = [40.0, 25.0, 500.0]
    nearest, _ = camera.depth_of_field_mm
    expected = 0.00345 * nearest / camera.image_distance_mm
    assert pixel_mm(camera, solid, [away]) == pytest.approx(expected)
    away[2, 3] = -300.0
    middle = 300.0 + solid.vertices[:, 2].max() / 2
    assert pixel_mm(camera, solid, [away]) == pytest.approx(expected * middle / nearest)


def test_profiles_end_where_a_round_face_the_background_or_a_shadow_begins():
    across = np.zeros((6, 2))
    lamp = SimpleNamespace(place=np.zeros(3))
    even = [True, True, False, True, False]
    assert _between_flat(Beside(), across, 6.5, None).tolist() == [*even, True]
    assert _between_flat(Beside(), across, 6.5, lamp).tolist() == [*even, False]
    assert _between_flat(Beside(), across, 2.5, lamp).all()
