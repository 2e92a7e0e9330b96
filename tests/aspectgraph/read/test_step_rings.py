"""Rings whose cones the kernel's mesher gives up: every face is read, within the chord tolerance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ring_files import Corner, Frames, write_ring

from aspectgraph import read_solid

pytest.importorskip("OCP")

ALONG_X = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def countersunk(hole, rim, outer, height, angle_deg):
    depth = (rim - hole) / math.tan(math.radians(angle_deg) / 2.0)
    return [
        Corner(hole, 0.0),
        Corner(outer, 0.0),
        Corner(outer, height),
        Corner(rim, height),
        Corner(hole, height - depth),
    ]


def volume(profile):
    """Volume by Pappus of a profile of straight lines."""
    ends = zip(profile, [*profile[1:], profile[0]], strict=True)
    return math.pi / 3.0 * sum((a.r * b.z - b.r * a.z) * (a.r + b.r) for a, b in ends)


# frames that end the seam's curves a rounding error beside the rims'
RINGS = [
    (90.0, Frames(ALONG_X, (0.0, 27.5, 27.5), 33.0, 90.0, 90.0, circles_down=True, cone_at_large_end=True)),
    (82.0, Frames(np.eye(3), (-38.9, 0.0, 0.0), 90.0, 0.0, 33.0)),
    (120.0, Frames(ALONG_X, (27.5, 27.5, 27.5), 90.0, 180.0, 33.0, False, True, True)),
    (60.0, Frames(np.eye(3), (27.5, 27.5, 0.0), 33.0, 90.0, 180.0, True, True)),
    (100.0, Frames(ALONG_X, (27.5, 0.0, -39.5), 33.0, 90.0, 0.0, True, True, True)),
]  # fmt: skip


@pytest.mark.parametrize(("angle_deg", "frames"), RINGS)
def test_countersunk_rings(tmp_path, angle_deg, frames):
    profile = countersunk(6.5, 8.2, 10.2, 4.0, angle_deg)
    solid = read_solid(write_ring(tmp_path / "ring.step", profile, frames))
    diameters = sorted(round(2 * rim.circle.radius_mm, 9) for rim in solid.rims())
    assert diameters == [13.0, 13.0, 16.4, 20.4, 20.4]
    chord = 1e-3 * math.dist((0, 0, 0), (20.4, 20.4, 4.0))
    area = 2 * math.pi * (6.5 + 10.2) * 4.0
    assert abs(solid.volume - volume(profile)) < chord * area


def test_the_chord_tolerance_holds_on_the_cone(tmp_path):
    profile = countersunk(6.5, 8.2, 10.2, 4.0, 90.0)
    path = write_ring(
        tmp_path / "ring.step", profile, Frames(np.eye(3), (0, 0, 0), 90.0, 0.0, 33.0)
    )
    for chord in (0.02, 0.005):
        solid = read_solid(path, chord_tolerance_mm=chord)
        corners = solid.vertices[solid.triangles]
        sides = 0.5 * (corners + np.roll(corners, 1, axis=1))
        tested = np.concatenate([sides.reshape(-1, 3), corners.mean(axis=1)])
        radii = np.hypot(tested[:, 0], tested[:, 1])
        on_cone = (tested[:, 2] > 2.3 + 1e-6) & (tested[:, 2] < 4.0 - 1e-6) & (radii < 9.0)
        true_radii = 6.5 + (tested[on_cone, 2] - 2.3)
        assert on_cone.sum() > 100
        assert np.abs(radii[on_cone] - true_radii).max() * math.sqrt(0.5) <= chord


def test_spherical_and_toroidal_seats(tmp_path):
    frames = Frames(ALONG_X, (27.5, 27.5, 0.0), 33.0, 90.0, 180.0, True, True)
    outline = [Corner(6.5, 0.0), Corner(10.2, 0.0), Corner(10.2, 5.0)]
    sphere = [*outline, Corner(8.2, 5.0, (0.0, 5.0, 8.2)), Corner(6.5, 5.0 - math.sqrt(24.99))]
    torus = [*outline, Corner(8.2, 5.0, (8.2, 3.3, 1.7)), Corner(6.5, 3.3)]
    ring = math.pi * (10.2**2 - 6.5**2) * 5.0
    # of the sphere's segment the hole was there already; of the torus a quarter disc stays of a square
    depth = math.sqrt(24.99)
    segment = math.pi * (8.2**2 * depth - depth**3 / 3.0) - math.pi * 6.5**2 * depth
    square = math.pi * (8.2**2 - 6.5**2) * 1.7
    centroid = 8.2 - 4.0 * 1.7 / (3.0 * math.pi)
    quarter = 2.0 * math.pi * centroid * math.pi * 1.7**2 / 4.0
    for name, profile, true in (
        ("sphere", sphere, ring - segment),
        ("torus", torus, ring - square + quarter),
    ):
        solid = read_solid(write_ring(tmp_path / f"{name}.step", profile, frames))
        assert solid.volume == pytest.approx(true, rel=1e-2), name


def test_a_face_that_stays_bare_is_named(tmp_path, monkeypatch):
    mesher = pytest.importorskip("aspectgraph.read.step.facets.mesher")
    from aspectgraph import ReadError
    from aspectgraph.read.step.solids import load_solids

    monkeypatch.setattr(mesher, "_with_revolved", lambda solid, face, cone: solid)
    profile = countersunk(6.5, 8.2, 10.2, 4.0, 90.0)
    path = write_ring(
        tmp_path / "ring.step", profile, Frames(np.eye(3), (0, 0, 0), 90.0, 0.0, 33.0)
    )
    shape = load_solids(path, "ring").slots[0].shape
    with pytest.raises(
        ReadError,
        match=r"Got no triangles for face 3 of the solid, a surface of the kind cone at \(",
    ):
        mesher.mesh_solid(shape, 0.05, math.radians(30.0))
