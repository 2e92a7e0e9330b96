"""Surfaces that carry edges, and how edges move with them: by geometry that is easy to see."""

import holed_block
import numpy as np
import pytest

from aspectgraph.entities.carriers import Carriers


@pytest.fixture(scope="module")
def block():
    return holed_block.block()


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
