"""Conditions for an edge to be found in the image: known answers, and a check by dense points and rays of its own."""

import numpy as np
import open3d as o3d
import pytest
from lit_parts import block
from shapely import LineString, Point

from aspectgraph import Face, Solid, read_solid, resolve_entities
from aspectgraph.solid.rims import edges_that_show
from planner import Camera, Detectability, RequestError, Requirements, look_at
from planner.camera.pose import world_to_cam
from planner.detectability.corners import CONNECTED
from planner.detectability.image_check import MOST_PX, ImageCheck, PartLines
from planner.request.defaults import check_showing

pytestmark = pytest.mark.uncompiled

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


def test_two_edges_of_a_plate_seen_from_the_side():
    """Edges 60 mm apart, square to the axis at 600 mm depth: f / pitch * 60 / depth."""
    check, _ = check_of(
        block(), {"e": [[0, 0, 60], [80, 0, 60]]}, Detectability(separation_px=750.0)
    )
    pose = look_at([[40.0, -600.0, 30.0]], [40.0, 0.0, 30.0])
    scale = CAMERA.matrix[0, 0]
    # the front's lower edge; the upper face is not seen, so its other edges are not
    assert check.separations(pose, ONE)[0, 0] == pytest.approx(scale * 60 / 600 - 750, abs=1e-6)


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


@pytest.mark.parametrize(
    "name", ["examples/nist_ctc_01_ap242.stp", "examples/two_pocket_block.off"]
)
def test_every_edge_that_can_be_an_entity_shows(name):
    solid = read_solid(name)
    assert edges_that_show(solid)[[edge.id for edge in solid.straight_edges()]].all()


def test_surroundings_narrow_the_picture():
    need = Requirements(field_margin_px=27.0, showing=Detectability())
    assert need.border_px == 67.0
    assert need.to_dict()["surround_px"] == 40.0
    assert "surround_px" not in Requirements().to_dict()


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


def test_conditions_wider_than_the_image():
    with pytest.raises(
        RequestError,
        match=r"separation_px must be less than half the image's smaller side, 2048 px",
    ):
        check_showing(Detectability(separation_px=1024), CAMERA)
    with pytest.raises(RequestError, match=r"showing must be a Detectability. Got 5."):
        check_showing(5, CAMERA)
