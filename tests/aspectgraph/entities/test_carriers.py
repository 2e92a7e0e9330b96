"""Surfaces that carry edges, and how edges move with them: by geometry that is easy to see."""

import holed_block
import numpy as np
import pytest

from aspectgraph.entities.entity_rules import Carriers


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


def test_where_a_bore_meets_a_cone_moves_with_both():
    solid = holed_block.countersunk_block()
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
    solid = holed_block.countersunk_block()
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
