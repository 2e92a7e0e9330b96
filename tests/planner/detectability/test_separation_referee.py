"""Distances of lines in the camera's image, by dense points and the equations of lens and circle alone."""

import holed_plate as plates
import numpy as np
import pytest
from lit_parts import block
from scipy.spatial import KDTree

from aspectgraph import Solid
from planner import Camera, Detectability, look_at
from planner.detectability.image_check import ImageCheck

pytestmark = pytest.mark.uncompiled

SEPARATION = 5.0
ONE = np.ones((1, 1), dtype=bool)


def wide_camera(*coefficients):
    return Camera(
        6.0, (0.00345, 0.00345), (1920, 1200), 8.0, 250.0, distortion=coefficients or None
    )


def straight_edge(solid, one, other):
    """Return the id of the edge between two points."""
    ends = {tuple(one), tuple(other)}
    return next(
        edge.id
        for edge in solid.straight_edges()
        if {tuple(p) for p in solid.edge_points(edge.id)} == ends
    )


def check_of(solid, edge, camera, separation=SEPARATION):
    ends = solid.edge_points(edge)[None]
    return ImageCheck(solid, [(edge,)], ends, camera, Detectability(separation_px=separation))


def images(points, pose, camera, lens):
    """Return images in px of points (n, 3), by the equations of Brown and Conrady."""
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    x, y = (local[:, :2] / local[:, 2:]).T
    k1, k2, p1, p2, k3 = lens
    square = x * x + y * y
    radial = 1.0 + k1 * square + k2 * square**2 + k3 * square**3
    across = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
    down = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
    matrix = camera.matrix
    return np.column_stack(
        [matrix[0, 0] * across + matrix[0, 2], matrix[1, 1] * down + matrix[1, 2]]
    )


def dense_distance(solid, edge, pose, camera, lens):
    """Return how near other edges of a convex part come to an edge in the image, px; none to one that is hidden."""
    shares = np.linspace(0.0, 1.0, 6001)[:, None]
    eye = pose[:3, 3]
    lines = {}
    for other in solid.edges:
        first, last = solid.edge_points(other.id)
        # of a convex part, an edge shows if one of its faces turns to the camera
        if any(solid.normals[face] @ (eye - first) > 0 for face in other.faces):
            points = first + shares * (last - first)
            lines[other.id] = images(points, pose, camera, lens)
    if edge not in lines:
        return np.inf
    corners = lines[edge][[0, -1]]
    near = SEPARATION / np.sin(np.radians(25.0))
    tree = KDTree(lines[edge])
    least = np.inf
    for other, points in lines.items():
        if other == edge:
            continue
        if set(solid.edges[other].vertices) & set(solid.edges[edge].vertices):
            from_corner = np.linalg.norm(points[:, None] - corners, axis=2).min(axis=1)
            points = points[from_corner >= near]
        if len(points):
            least = min(least, tree.query(points)[0].min())
    return least


BARREL = (-0.22, 0.0, 0.0, 0.0, 0.0)


def test_lines_at_the_border_of_the_field_are_as_far_apart_as_dense_points():
    """A thin, tapered bar lies along each border and corner of the field, turned and tilted at random."""
    lens = BARREL
    bar = block()
    x, y, z = bar.vertices.T
    # one side is up to three times as thick at one end as at the other
    taper = 0.4 + 0.8 * (x - x.min()) / np.ptp(x)
    bar = Solid(np.column_stack([x, y / 2.0, z / 60.0 * taper]), bar.faces)
    tops = [e.id for e in bar.straight_edges() if np.ptp(bar.edge_points(e.id)[:, 0]) > 50]
    camera = wide_camera(*lens)
    left, top, right, bottom = camera.field().inner
    rng = np.random.default_rng(11)
    off = []
    while len(off) < 25:
        edge = int(rng.choice(tops))
        ends = bar.edge_points(edge)
        middle = ends.mean(axis=0)
        way = rng.normal(size=3)
        pose = look_at([middle + 260.0 * way / np.linalg.norm(way)], middle, roll=rng.uniform(0, 6))
        pose = pose[0]
        # the edge's middle goes to a place beside the border
        place = np.array([rng.uniform(left, right), rng.uniform(top, bottom)])
        side = rng.integers(4)
        place[side % 2] = 0.93 * (left, top, right, bottom)[side]
        pose[:3, 3] -= pose[:3, :2] @ (place * 260.0)
        local = (ends - pose[:3, 3]) @ pose[:3, :3]
        seen = local[:, :2] / local[:, 2:]
        if not ((seen > (left, top)) & (seen < (right, bottom))).all():
            continue
        truth = dense_distance(bar, edge, pose, camera, lens)
        if 1.0 < truth < 20.0:
            told = check_of(bar, edge, camera).separations(pose[None], ONE)[0, 0] + SEPARATION
            off.append(told - truth)
    assert np.abs(off).max() < 0.05


@pytest.mark.parametrize("chords", [240, 24, 12, 8])
def test_an_edge_keeps_its_distance_from_the_circle_of_a_hole(chords, monkeypatch):
    """Above a hole, its rim is a circle in the image: the edge is its centre's distance less its radius away."""
    monkeypatch.setattr(plates, "N", chords)
    plate = plates.holed_plate()
    camera = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
    rims = [rim for rim in plate.rims() if abs(rim.centre[2] - plates.HEIGHT) < 1e-6]
    centre = min(rims, key=lambda rim: rim.centre[0]).centre
    edge = straight_edge(plate, (0.0, 0.0, plates.HEIGHT), (0.0, 50.0, plates.HEIGHT))
    scale = camera.matrix[0, 0] / 400.0
    truth = scale * (20.0 - 8.0)
    above = look_at([np.add(centre, (0.0, 0.0, 400.0))], centre)
    told = check_of(plate, edge, camera, 230.0).separations(above, ONE)[0, 0] + 230.0
    bulge = scale * 8.0 * (1.0 - np.cos(np.pi / chords))
    # never more, and less by what the straight pieces of an arc may be off
    assert truth - 0.06 - 0.03 * bulge <= told <= truth + 1e-6
