"""Conditions for an edge to be found in the image: known answers, and a check by dense points and rays of its own."""

import dataclasses
import sys
from pathlib import Path

import holed_plate as plates
import numpy as np
import open3d as o3d
import pytest
from lit_parts import block
from scipy.optimize import least_squares
from scipy.spatial import KDTree
from shapely import LineString, Point
from solids import prism

from aspectgraph import Face, Solid, read_solid, resolve_entities
from aspectgraph.solid.rims import edges_that_show
from errors.measurands import Circle, Line
from planner import Camera, Detectability, RequestError, Requirements, look_at
from planner.camera.pose import moved, world_to_cam
from planner.detectability import image_check
from planner.detectability.corners import CONNECTED, OTHER, SHARP, SHOWS
from planner.detectability.image_check import (
    MOST_PX,
    ImageCheck,
    ImagePieces,
    PartLines,
    Scanned,
)
from planner.request.camera_limits import check_showing

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks" / "images"))
from rendered_images import Renderer
from seen_lines import Lines

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 600.0)
ONE = np.ones((1, 1), dtype=bool)


def check_of(solid, entities, showing, camera=CAMERA):
    found = resolve_entities(solid, entities)
    ends = np.array([one.endpoints for one in found.values()])
    return ImageCheck(solid, [one.edge_ids for one in found.values()], ends, camera, showing), ends


def image(points, pose, camera=CAMERA):
    """Project points (..., 3) to px by the matrix alone."""
    local = world_to_cam(np.asarray(points, dtype=float), pose)
    return (local / local[..., 2:]) @ camera.matrix.T[:, :2]


@pytest.mark.uncompiled
def test_two_edges_of_a_plate_seen_from_the_side():
    """Edges 60 mm apart, square to the axis at 600 mm depth: f / pitch * 60 / depth."""
    check, _ = check_of(
        block(), {"e": [[0, 0, 60], [80, 0, 60]]}, Detectability(separation_px=750.0)
    )
    pose = look_at([[40.0, -600.0, 30.0]], [40.0, 0.0, 30.0])
    scale = CAMERA.matrix[0, 0]
    # the front's lower edge; the upper face is not seen, so its other edges are not
    assert check.separations(pose, ONE)[0, 0] == pytest.approx(scale * 60 / 600 - 750, abs=1e-6)


@pytest.mark.uncompiled
@pytest.mark.parametrize("seed", range(6))
def test_separation_on_a_block_by_shapely(seed):
    """Of a convex part exactly the edges of faces that face the camera are visible."""
    solid = block()
    rng = np.random.default_rng(seed)
    showing = Detectability(separation_px=40.0, min_corner_deg=25.0)
    check, ends = check_of(solid, {"e": [[0, 0, 60], [80, 0, 60]]}, showing)
    eye = np.array([40.0, 25, 30]) + 500 * rng.normal(size=3) / 1.5
    pose = look_at([eye], [40.0, 20, 30], roll=rng.uniform(0, 6))
    own = LineString(image(ends[0], pose[0]))
    near = 40.0 / np.sin(np.radians(25.0))
    excepted = Point(own.coords[0]).buffer(near, 64).union(Point(own.coords[1]).buffer(near, 64))
    distances = [40.0 + MOST_PX]
    for edge in solid.edges:
        points = solid.vertices[list(edge.vertices)]
        front = [solid.normals[f] @ (eye - points[0]) > 0 for f in edge.faces]
        if not any(front) or set(map(tuple, points)) == set(map(tuple, ends[0])):
            continue
        line = LineString(image(points, pose[0]))
        if set(map(tuple, points)) & set(map(tuple, ends[0])):
            line = line.difference(excepted)
        if not line.is_empty:
            distances.append(line.distance(own))
    found = check.separations(pose, ONE)[0, 0] + 40.0
    assert found == pytest.approx(min(distances), abs=1.0)


@pytest.mark.uncompiled
def test_corners_of_a_block():
    """Frontal: the uprights are square to the edge, and the edges of the top face are not seen."""
    check, _ = check_of(
        block(), {"e": [[0, 0, 60], [80, 0, 60]]}, Detectability(min_corner_deg=25.0)
    )
    pose = look_at([[40.0, -600.0, 30.0]], [40.0, 0.0, 30.0])
    assert check.corners(pose, ONE)[0, 0] == pytest.approx(65.0, abs=1e-6)
    # from above, the edges of the top face are seen too, and the sharpest angle counts
    pose = look_at([[200.0, -300.0, 420.0]], [40.0, 20.0, 60.0])
    by_hand = []
    for corner, inward in (([0, 0, 60], [80, 0, 60]), ([80, 0, 60], [0, 0, 60])):
        tips = [[corner[0], 50, 60], [corner[0], 0, 0]]
        a, b, *arms = image([corner, inward, *tips], pose[0])
        edge = np.arctan2(*(b - a))
        angles = [
            np.degrees(abs((np.arctan2(*(tip - a)) - edge + np.pi) % (2 * np.pi) - np.pi))
            for tip in arms
        ]
        by_hand.append(min(max(min(x, 180 - x) for x in angles), *angles))
    assert check.corners(pose, ONE)[0, 0] == pytest.approx(min(by_hand) - 25.0, abs=1e-6)


@pytest.fixture(scope="module")
def ctc01():
    return read_solid("examples/nist_ctc_01_ap242.stp")


NAMED = {
    "web_back": [[-107.5, 125, 0], [107.5, 125, 0]],
    "boss_top_left": [[-45, -25.981, 50], [-45, 25.981, 50]],
    "chamfer": [[350, 225, 0], [400, 175, 0]],
    "slot_front": [[-325, -20, 0], [-245, -20, 0]],
}


def dense_separation(solid, scene, entity, pose, camera, near_px, chords):
    """The distance of the nearest visible point of all lines, 0.2 mm apart, up to 8 px.

    Near the edge's own ends, points of lines that meet it are left out; with ``chords`` those of all curves, too.
    """
    reach = 8.0
    eye = pose[:3, 3]
    own = LineString(image(entity.endpoints, pose, camera))
    ends = [Point(c) for c in own.coords]
    best = reach
    shows = edges_that_show(solid)
    for edge in solid.edges:
        a, b = solid.vertices[list(edge.vertices)]
        front = [solid.normals[f] @ (eye - a) > 1e-9 for f in edge.faces]
        contour = any(front) if shows[edge.id] else edge.dihedral_deg > 0 and sum(front) == 1
        if edge.id in entity.edge_ids or not contour:
            continue
        if LineString(image([a, b], pose, camera)).distance(own) >= reach:
            continue
        points = a + np.linspace(0, 1, max(2, int(np.linalg.norm(b - a) / 0.2)))[:, None] * (b - a)
        rays = np.concatenate([np.broadcast_to(eye, points.shape), points - eye], axis=1).astype(
            np.float32
        )
        hit = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
        at_own = set(edge.vertices) & {v for i in entity.edge_ids for v in solid.edges[i].vertices}
        least = near_px if at_own or (chords and edge.curved) else 0.0
        for point in image(points[hit >= 1 - 1e-4], pose, camera):
            spot = Point(point)
            if min(spot.distance(end) for end in ends) >= least:
                best = min(best, spot.distance(own))
    return best


@pytest.mark.uncompiled
def test_separation_on_a_real_part_by_dense_points(ctc01):
    camera = Camera.from_toml("examples/camera.toml")
    showing = Detectability(separation_px=8.0)
    check, _ = check_of(ctc01, NAMED, showing, camera)
    found = resolve_entities(ctc01, NAMED)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        np.asarray(ctc01.vertices, dtype=np.float32), np.asarray(ctc01.triangles, dtype=np.uint32)
    )
    rng = np.random.default_rng(7)
    near = 8.0 / np.sin(np.radians(25.0))
    compared = 0
    for k, entity in enumerate(found.values()):
        for _ in range(5):
            way = rng.normal(size=3) * (1, 1, 0.4) + (0, 0, 1)
            target = entity.endpoints.mean(axis=0)
            pose = look_at(
                [target + 420 * way / np.linalg.norm(way)], target, roll=rng.uniform(0, 6)
            )
            wanted = np.zeros((1, len(found)), dtype=bool)
            wanted[0, k] = True
            ours = check.separations(pose, wanted, 0.0)[0, k] + 8.0
            few, more = (
                dense_separation(ctc01, scene, entity, pose[0], camera, near, one)
                for one in (True, False)
            )
            # of curves, ours leaves out those that meet the edge
            assert more - 0.5 <= ours <= few + 0.5
            compared += ours < 8.0
    assert compared >= 3


@pytest.mark.uncompiled
def test_yes_and_no_agree_with_how_much(ctc01):
    """Whether anything is near is told by fewer rays than how near it is, and whether corners are wide enough, too."""
    camera = Camera.from_toml("examples/camera.toml")
    showing = Detectability(separation_px=8.0)
    rng = np.random.default_rng(3)
    check, ends = check_of(ctc01, NAMED, showing, camera)
    ways = rng.normal(size=(200, 3)) * (1, 1, 0.4) + (0, 0, 1)
    targets = ends.mean(axis=1)[np.arange(200) % len(ends)]
    poses = look_at(
        targets + 420 * ways / np.linalg.norm(ways, axis=1, keepdims=True), targets, roll=0.3
    )
    every = np.ones((200, len(ends)), dtype=bool)
    corners = check.corners(poses, every) >= 0
    apart = check.separations(poses, every, 0.0) >= 0
    # both answers of both conditions, else nothing is compared
    assert 0 < (corners & ~apart).sum() < corners.sum() < corners.size
    assert np.array_equal(check.shown(poses, every), corners & apart)


@pytest.mark.uncompiled
def test_the_lines_of_a_part_are_found_once_and_told_apart_by_what_they_are_asked_for(ctc01):
    part = PartLines.of(ctc01)
    assert PartLines.of(ctc01) is part
    # ends in an arc: more of its chords count as connected in a wider radius
    ids = resolve_entities(ctc01, NAMED)[list(NAMED)[3]].edge_ids
    narrow, wide = (part.relation(ids, radius) for radius in (0.1, 50.0))
    assert part.relation(list(ids), 0.1) is narrow
    assert (wide == CONNECTED).sum() > (narrow == CONNECTED).sum() > 0
    other = block()
    assert len(PartLines.of(other).contours.ids) == 12


def test_the_contour_of_its_own_wall_is_another_line_for_an_arc():
    """It leaves the arc tangentially, and so is near for long; an edge that ends in the arc knows it as a neighbour."""
    angles = np.pi * (np.arange(61) / 60 - 0.5)
    profile = [(0, -3), *((10 + 3 * np.cos(a), 3 * np.sin(a)) for a in angles), (0, 3)]
    solid = prism(profile, 4)
    part = PartLines.of(solid)
    contours = part.contours
    arc = next(arc for arc in solid.arcs() if arc.centre[2] == 4)
    smooth = contours.kinds & SHARP == 0
    vertices = {vertex for k in arc.edge_ids for vertex in solid.edges[k].vertices}
    meets = np.isin(contours.ends, list(vertices)).any(axis=1)
    relation = part.relation(arc.edge_ids, 0.1)
    assert (smooth & meets).sum() == 61
    assert (relation[smooth] == OTHER).all()
    # the sides of the bar
    assert (relation[meets & ~smooth] == CONNECTED).sum() == 2
    side = next(k for k, edge in enumerate(solid.edges) if part_of_side(solid, edge))
    assert (part.relation([side], 0.1)[smooth] == CONNECTED).any()


def part_of_side(solid, edge):
    """Whether an edge is the upper one of the side at y = 3."""
    ends = solid.edge_points(edge.id)
    return np.allclose(ends[:, 1:], [3, 4])


@pytest.mark.uncompiled
def test_corners_of_edges_that_share_arms_are_those_of_each_edge_alone():
    """Asked together, an arm of several edges is asked once, and of an end no more arms than it takes."""
    solid = read_solid("examples/two_pocket_block.off")
    showing = Detectability(separation_px=20.0, min_corner_deg=25.0)
    edges = [edge.id for edge in solid.straight_edges()]
    check, _ = check_of(solid, edges, showing)
    rng = np.random.default_rng(3)
    eyes = np.array([30.0, 30.0, 20.0]) + 400.0 * rng.normal(size=(40, 3))
    poses = look_at(eyes, [30.0, 30.0, 20.0])
    wanted = np.ones((len(poses), len(edges)), dtype=bool)
    margins = check.corners(poses, wanted)
    assert 0.02 < (margins >= 0).mean() < 0.98
    for k in range(0, len(edges), 5):
        alone, _ = check_of(solid, edges[k : k + 1], showing)
        assert np.array_equal(alone.corners(poses, wanted[:, :1])[:, 0], margins[:, k])
    # `corner_lines` asks all arms
    lines = check.corner_lines(poses, np.argwhere(wanted))
    has_lines = np.bincount(lines.of, minlength=2 * wanted.size).reshape(*wanted.shape, 2) > 0
    assert not (margins >= 0)[~has_lines.all(axis=2)].any()


def test_an_edge_that_runs_on_in_an_arc_has_no_corner(ctc01):
    check, ends = check_of(ctc01, NAMED, Detectability())
    assert [check.without_corner(k) is None for k in range(4)] == [True, True, True, False]
    assert any(np.allclose(check.without_corner(3), end) for end in ends[3])
    pose = look_at([[-285.0, 0.0, 500.0]], [-285.0, 0.0, 0.0])
    wanted = np.array([[False, False, False, True]])
    assert check.corners(pose, wanted)[0, 3] == -25.0
    assert check_of(ctc01, NAMED, Detectability(min_corner_deg=0))[0].without_corner(3) is None


def valley(turn_deg):
    """A bar whose upper side has a valley between two facets of curved surfaces, along y at x = 30, z = 20 mm."""
    top = 20.0 + 30.0 * np.tan(np.radians(turn_deg / 2))
    outline = [(0, 0), (60, 0), (60, top), (30, 20.0), (0, top)]
    n = len(outline)
    vertices = [(x, y, z) for y in (0.0, 40.0) for x, z in outline]
    sides = [(k, n + k, n + (k + 1) % n, (k + 1) % n) for k in range(n)]
    ends = [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1))]
    # sides 2 and 3 slope down to the valley
    return Solid(
        vertices, [*ends, *(Face(side, curved=k in (2, 3)) for k, side in enumerate(sides))]
    )


@pytest.mark.uncompiled
@pytest.mark.parametrize("turn_deg", [6.0, 20.0, 39.0, 41.0])
def test_an_edge_in_a_valley_of_curved_surfaces_shows(turn_deg):
    """The MTC plate has such edges. From above, the slopes leave it at right angles but for the perspective."""
    solid = valley(turn_deg)
    (edge,) = (
        one for one in solid.straight_edges() if all(solid.faces[f].curved for f in one.faces)
    )
    assert edge.turn_deg == pytest.approx(-turn_deg)
    check, _ = check_of(solid, {"valley": edge.id}, Detectability())
    pose = look_at([[30.0, 20.0, 600.0]], [30.0, 20.0, 0.0], roll=0.3)
    # an end of the valley is 20 mm off the axis and 580 mm away, and the slope is nearer by its rise
    rise = 30.0 * np.tan(np.radians(turn_deg / 2))
    aside = np.degrees(np.arctan2(20.0 * rise / 580.0, 30.0))
    assert check.corners(pose, ONE)[0, 0] == pytest.approx(65.0 - aside, abs=1e-6)
    # the slopes are its own neighbours, not other lines that touch it
    assert check.separations(pose, ONE)[0, 0] > 0.0
    assert check.shown(pose, ONE).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize(
    "name", ["examples/nist_ctc_01_ap242.stp", "examples/two_pocket_block.off"]
)
def test_every_edge_that_can_be_an_entity_shows(name):
    solid = read_solid(name)
    assert edges_that_show(solid)[[edge.id for edge in solid.straight_edges()]].all()


@pytest.mark.uncompiled
def test_surroundings_narrow_the_picture():
    need = Requirements(field_margin_px=27.0, showing=Detectability())
    assert need.border_px == 67.0
    assert need.to_dict()["surround_px"] == 40.0
    assert "surround_px" not in Requirements().to_dict()


@pytest.mark.uncompiled
@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"separation_px": -1}, "separation_px must be finite and not negative. Got -1."),
        ({"surround_px": float("nan")}, "surround_px must be finite and not negative. Got nan."),
        ({"min_corner_deg": "25"}, "min_corner_deg must be finite and not negative. Got '25'."),
        ({"min_corner_deg": 90}, "min_corner_deg must be below 90. Got 90."),
    ],
)
def test_conditions_that_cannot_be(values, text):
    with pytest.raises(RequestError) as error:
        Detectability(**values)
    assert str(error.value) == text


@pytest.mark.uncompiled
def test_conditions_wider_than_the_image():
    with pytest.raises(
        RequestError,
        match=r"separation_px must be less than half the image's smaller side, 2048 px",
    ):
        check_showing(Detectability(separation_px=1024), CAMERA)
    with pytest.raises(RequestError, match=r"showing must be a Detectability. Got 5."):
        check_showing(5, CAMERA)


# The lines that a corner is fitted with must be long enough in the image, and apart from others.


# pixels per mm, frontally at 600 mm
SCALE = float(CAMERA.matrix[0, 0]) / 600.0


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


# How near other lines come to edges: from true circles, in the image of a lens with distortion;
# numpy's own answer.


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
    check._visible = lambda cam2world, rows, places: np.ones(len(places), dtype=bool)
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
    told, own = compared(plate, camera, poses_about(plate, 2, 120.0)).T
    assert len(told) > 20
    assert (told - own).max() < 0.02
    # 0.06 px and 3 % of a bulge of 1.3 px: chords of 15° of a radius of 8 mm, 120 mm away
    assert (told - own).min() > -0.10


# How near other lines come to rims and edges that are fitted: known answers, and a program of its
# own.


CAMERA_SCANNED = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
SHOWING = Detectability(separation_px=5.0)
POINTS = 24


@pytest.fixture
def fine_plate(monkeypatch):
    """The plate with holes of 240 chords: these leave their circles by a hundredth of a pixel."""
    monkeypatch.setattr(plates, "N", 240)
    return plates.holed_plate()


def upper_rim(solid):
    rims = [rim for rim in solid.rims() if abs(rim.centre[2] - plates.HEIGHT) < 1e-6]
    rim = min(rims, key=lambda one: one.centre[0])
    x = rim.reference
    start = np.cos(rim.start_rad) * x + np.sin(rim.start_rad) * np.cross(rim.axis, x)
    return rim, Circle(rim.centre, rim.axis, rim.radius_mm, start, 2 * np.pi)


def check_of_scanned(solid, edge_ids, geometry):
    scanned = [[Scanned.of(edge_ids, geometry)]]
    return ImageCheck(solid, [None], np.zeros((1, 2, 3)), CAMERA_SCANNED, SHOWING, scanned)


def distance_by(near):
    """Return what is said of an entity whose points have other lines so near."""
    line = Scanned((0,), np.zeros((POINTS, 3)))
    pieces, _ = ImagePieces.of([None], np.zeros((1, 2, 3)), [[line]])
    return pieces.of_pairs(np.zeros((1, 2), np.int64)).least_distance(np.asarray(near, float))[0]


@pytest.mark.uncompiled
@pytest.mark.parametrize(
    ("beside", "found"),
    [
        ([], 9.0),
        # a sixth of the points, in four twelfths
        ([0, 6, 12, 18], 9.0),
        # more than a fifth
        ([0, 4, 8, 12, 16], 2.0),
        # a whole twelfth
        ([6, 7], 2.0),
        # as many in two of them
        ([7, 8], 9.0),
    ],
)
def test_a_fifth_of_the_points_may_lie_beside_other_lines_but_no_twelfth(beside, found):
    near = np.full(POINTS, 9.0)
    near[beside] = 2.0
    assert distance_by(near) == found


@pytest.mark.uncompiled
@pytest.mark.parametrize("chords", [240, 24, 12])
def test_the_lower_rim_of_a_hole_from_above(chords, monkeypatch):
    """Both rims are circles about the image's centre, 8 mm at depths of 400 and 410 mm, however coarse the mesh."""
    monkeypatch.setattr(plates, "N", chords)
    plate = plates.holed_plate()
    rim, circle = upper_rim(plate)
    above = look_at([[20.0, 25.0, 410.0]], [20.0, 25.0, 10.0])
    found = check_of_scanned(plate, rim.edge_ids, circle).separations(above, ONE)[0, 0]
    px = CAMERA_SCANNED.matrix[0, 0]
    assert found + 5.0 == pytest.approx(px * 8.0 / 400.0 - px * 8.0 / 410.0, abs=0.08)


@pytest.mark.uncompiled
def test_the_lower_rim_may_cross_the_image_of_the_upper_one(fine_plate):
    """From the side, the visible part of the lower rim begins and ends on the upper one."""
    rim, circle = upper_rim(fine_plate)
    oblique = look_at([[20.0, -175.0, 356.0]], [20.0, 25.0, 10.0])
    check = check_of_scanned(fine_plate, rim.edge_ids, circle)
    assert check.separations(oblique, ONE)[0, 0] > 0
    assert check.shown(oblique, ONE).all()
    lines = Lines(fine_plate)
    renderer = Renderer(fine_plate.vertices, fine_plate.triangles, CAMERA_SCANNED.matrix)
    dense = circle.points(np.arange(360) * np.pi / 180)
    nearest = lines.apart_px(renderer, oblique[0], dense, set(rim.edge_ids))
    assert nearest.min() < 1.0


@pytest.mark.uncompiled
def test_two_sides_of_a_thin_plate():
    """Seen from the side, a plate of 0.2 mm has its lower edge 4 px from its upper one, all along."""
    thin = plates.holed_plate()
    thin = type(thin)(thin.vertices * [1.0, 1.0, 0.02], thin.faces)
    ends = np.array([[0.0, 0.0, 0.2], [80.0, 0.0, 0.2]])
    edge = next(
        one
        for one in thin.straight_edges()
        if {tuple(p) for p in thin.edge_points(one.id)} == {tuple(p) for p in ends}
    )
    side = look_at([[40.0, -400.0, 0.1]], [40.0, 0.0, 0.1])
    found = check_of_scanned(thin, (edge.id,), Line(*ends)).separations(side, ONE)[0, 0]
    assert found + 5.0 == pytest.approx(CAMERA_SCANNED.matrix[0, 0] * 0.2 / 400.0, abs=1e-6)
    assert not check_of_scanned(thin, (edge.id,), Line(*ends)).shown(side, ONE).any()


@pytest.mark.uncompiled
def test_random_poses_by_a_program_of_its_own(fine_plate):
    """Lines from faces and triangles, hidden by rays to dense points; it knows chords only."""
    solid = fine_plate
    rim, circle = upper_rim(solid)
    check = check_of_scanned(solid, rim.edge_ids, circle)
    lines = Lines(solid)
    renderer = Renderer(solid.vertices, solid.triangles, CAMERA_SCANNED.matrix)
    rng = np.random.default_rng(3)
    eyes = np.array([20.0, 25.0, 360.0]) + rng.uniform(-100, 100, (40, 3))
    poses = look_at(eyes, [20.0, 25.0, 10.0])
    said = check.shown(poses, np.ones((40, 1), bool))[:, 0]
    told = check.separations(poses, np.ones((40, 1), bool))[:, 0]
    np.testing.assert_array_equal(said, told >= 0)
    points = circle.points((np.arange(POINTS) + 0.5) * 2 * np.pi / POINTS)
    found = np.array([lines.apart_px(renderer, pose, points, set(rim.edge_ids)) for pose in poses])
    enough = np.sort(found, axis=1)[:, POINTS // 5]
    each = found.reshape(-1, 12, 2).max(axis=2).min(axis=1)
    apart = np.minimum(enough, each)
    off = np.abs(apart - np.minimum(told + 5.0, 12.0))
    # its lines are points a pixel apart, and rays end beside what they hit
    assert np.median(off) < 0.02
    assert (off < 0.5).sum() >= 36
    assert off.max() < 2.0
    assert 1 < (~said).sum() < 10


@pytest.mark.uncompiled
def test_yes_and_no_agree_with_how_much_beside_curves_of_few_chords(monkeypatch):
    """From 150 poses, many of them at the limit; the distance of a curve depends on nothing else that is near."""
    monkeypatch.setattr(plates, "N", 12)
    solid = plates.holed_plate()
    rim, circle = upper_rim(solid)
    check = check_of_scanned(solid, rim.edge_ids, circle)
    eyes = np.array([20.0, 25.0, 320.0]) + np.random.default_rng(7).uniform(-60, 60, (150, 3))
    poses = look_at(eyes, [20.0, 25.0, 10.0])
    wanted = np.ones((150, 1), bool)
    told = check.separations(poses, wanted)[:, 0]
    np.testing.assert_array_equal(check.shown(poses, wanted)[:, 0], told >= 0)
    assert 10 < (told < 0).sum() < 130


# Distances of lines in the camera's image, by dense points and the equations of lens and circle
# alone.


SEPARATION = 5.0


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


def check_of_separation_referee(solid, edge, camera, separation=SEPARATION):
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


@pytest.mark.uncompiled
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
            told = (
                check_of_separation_referee(bar, edge, camera).separations(pose[None], ONE)[0, 0]
                + SEPARATION
            )
            off.append(told - truth)
    assert np.abs(off).max() < 0.05


@pytest.mark.uncompiled
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
    told = (
        check_of_separation_referee(plate, edge, camera, 230.0).separations(above, ONE)[0, 0]
        + 230.0
    )
    bulge = scale * 8.0 * (1.0 - np.cos(np.pi / chords))
    # never more, and less by what the straight pieces of an arc may be off
    assert truth - 0.06 - 0.03 * bulge <= told <= truth + 1e-6


@pytest.mark.uncompiled
@pytest.mark.parametrize("lens", LENSES)
def test_many_displaced_poses_are_judged_alike_with_all_lines(ctc01, lens, monkeypatch):
    camera = Camera.from_toml("examples/camera.toml")
    camera = dataclasses.replace(camera, distortion=lens)
    showing = Detectability(separation_px=8.0)
    rng = np.random.default_rng(5)
    check, ends = check_of(ctc01, NAMED, showing, camera)
    answers = []
    for k in range(len(ends)):
        way = rng.normal(size=(1, 3)) * (1, 1, 0.4) + (0, 0, 1)
        planned = look_at(
            ends[k].mean(axis=0) + 420 * way / np.linalg.norm(way), ends[k].mean(axis=0)
        )
        poses = moved(planned[0], rng.normal(size=(250, 6)) * 0.02, 10.0)
        every = np.ones((250, len(ends)), dtype=bool)
        with monkeypatch.context() as all_lines:
            all_lines.setattr(image_check, "_MANY_NEAR", 1_000_000)
            plain = check.shown(poses, every), check.separations(poses, every)
        fewer = check.shown(poses, every), check.separations(poses, every)
        assert np.array_equal(plain[0], fewer[0])
        assert np.array_equal(plain[1], fewer[1])
        answers.append(plain[0])
    assert 0 < np.mean(answers) < 1
