"""How near other lines come to edges: from true circles, in the image of a lens with distortion; numpy's own answer."""

import dataclasses

import holed_plate as plates
import numpy as np
import pytest
from scipy.optimize import least_squares

from aspectgraph import read_solid
from planner import Camera, Detectability, look_at
from planner.detectability.corners import OTHER, SHOWS
from planner.detectability.image_check import ImageCheck

WIDE = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 250.0)
LENSES = [None, (-0.22, 0.0, 0.0, 0.0), (-0.22, 0.06, 0.001, -0.001)]
ASKED = 5.0
# so many points of each line, to begin with
N = 100


class Seen:
    """Images of one camera, by the formula of OpenCV's page on calibration."""

    def __init__(self, camera, pose):
        self.camera = camera
        self.pose = pose

    def __call__(self, points):
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        x, y = (local[..., :2] / local[..., 2:]).T
        if self.camera.distortion is not None:
            lens = self.camera.distortion
            r = x**2 + y**2
            radial = 1 + lens.k1 * r + lens.k2 * r**2 + lens.k3 * r**3
            x, y = (
                x * radial + 2 * lens.p1 * x * y + lens.p2 * (r + 2 * x**2),
                y * radial + lens.p1 * (r + 2 * y**2) + 2 * lens.p2 * x * y,
            )
        matrix = self.camera.matrix
        return np.stack([matrix[0, 0] * x + matrix[0, 2], matrix[1, 1] * y + matrix[1, 2]], axis=-1)

    def holds(self, points):
        pixels = self(points)
        return (pixels >= 0).all() and (pixels <= np.array(self.camera.resolution) - 1).all()


def straight(ends):
    return lambda shares: ends[0] + np.atleast_1d(shares)[:, None] * (ends[1] - ends[0])


def circular(ends, arc):
    """Return a chord's part of its circle: points of the chord pushed out to the radius."""

    def points(shares):
        off = straight(ends)(shares) - arc.centre
        height = (off @ arc.axis)[:, None] * arc.axis
        out = off - height
        size = np.linalg.norm(out, axis=1, keepdims=True)
        return arc.centre + height + arc.radius_mm * out / size

    return points


def distance(one, other, seen):
    """Return the least distance of the images of two curves, from points all along them and a fit from the nearest."""
    ends = seen(other(np.array([0.0, 0.5, 1.0])))
    middle = seen(one(np.linspace(0.0, 1.0, 10)))
    apart = np.linalg.norm(middle - ends[1], axis=1).min()
    if apart > np.ptp(ends, axis=0).sum() + np.linalg.norm(middle[1] - middle[0]) + 4 * ASKED:
        return np.inf
    shares = np.linspace(0.0, 1.0, N)
    between = np.linalg.norm(seen(one(shares))[:, None] - seen(other(shares))[None], axis=-1)
    start = [shares[k] for k in np.unravel_index(between.argmin(), between.shape)]
    if between.min() > 4 * ASKED:
        return between.min()
    fit = least_squares(
        lambda x: (seen(one(x[0])) - seen(other(x[1])))[0], start, bounds=(0.0, 1.0), xtol=1e-12
    )
    return min(between.min(), np.linalg.norm(fit.fun))


def compared(solid, camera, poses):
    """Return for edges that are whole in the picture how near unconnected lines are, hidden or not: both answers."""
    edges = [k for k, edge in enumerate(solid.edges) if not edge.curved]
    ends = np.array([solid.edge_points(k) for k in edges], dtype=float)
    check = ImageCheck(solid, [[k] for k in edges], ends, camera, Detectability(ASKED))
    # nothing hides
    check._visible = lambda eyes, places: np.ones(len(places), dtype=bool)
    relations = check._entities.relations
    relations[relations != OTHER] = 1
    pieces = check._scanned.relations
    pieces[pieces != OTHER] = 1
    lines = check.contours
    arcs = {edge: arc for arc in (*solid.rims(), *solid.arcs()) for edge in arc.edge_ids}
    answers = []
    for pose in poses:
        seen = Seen(camera, pose)
        front = lines.planes[:, :3] @ pose[:3, 3] > lines.planes[:, 3]
        shows = SHOWS[lines.kinds, front[lines.faces].sum(axis=1)] > 0
        wanted = np.array([seen.holds(each) for each in ends])
        told = check.separations(pose[None], wanted[None], 3.0)[0] + ASKED
        for k in np.flatnonzero(wanted & (told < ASKED + 2.9)):
            curves = []
            for line in np.flatnonzero(shows & (relations[k] == OTHER)):
                places = lines.vertices[lines.ends[line]]
                arc = arcs.get(int(lines.ids[line]))
                curves.append(straight(places) if arc is None else circular(places, arc))
            answers.append((told[k], min(distance(straight(ends[k]), c, seen) for c in curves)))
    return np.array(answers)


def poses_about(solid, n, far):
    """Return poses from all sides, whose axes pass the part by up to its size, so that it lies near the border."""
    rng = np.random.default_rng(7)
    low, high = np.asarray(solid.bounds)
    ways = rng.normal(size=(n, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    targets = (low + high) / 2 + rng.uniform(-1.0, 1.0, (n, 3)) * (high - low)
    eyes = (low + high) / 2 + ways * far
    return [look_at(eye[None], target)[0] for eye, target in zip(eyes, targets, strict=True)]


@pytest.mark.parametrize("lens", LENSES)
def test_distances_are_those_in_the_image_of_the_lens(lens):
    block = read_solid("examples/two_pocket_block.off")
    camera = dataclasses.replace(WIDE, distortion=lens)
    told, own = compared(block, camera, poses_about(block, 8, 120.0)).T
    assert len(told) > 20
    assert np.abs(told - own).max() < 0.05


@pytest.mark.parametrize("lens", LENSES)
def test_distances_are_from_circles_not_from_their_chords(lens):
    """They may be stated too short for the pieces of arcs, as `test_separation_referee` bounds it, and not too long."""
    plate = plates.holed_plate()
    camera = dataclasses.replace(WIDE, distortion=lens)
    told, own = compared(plate, camera, poses_about(plate, 4, 120.0)).T
    assert len(told) > 20
    assert (told - own).max() < 0.02
    # 0.06 px and 3 % of a bulge of 1.3 px: chords of 15° of a radius of 8 mm, 120 mm away
    assert (told - own).min() > -0.10
