"""Lights of a cell: their solids by closed forms, collisions, and the light that plans get."""

import pickle

import numpy as np
import pytest
from robot_cells import CAM2FLANGE, ROBOTS, TABLE, made_cell, pose
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from aspectgraph import read_solid
from planner import (
    Backlight,
    Box,
    Camera,
    CarriedLight,
    Cell,
    DiffuseDome,
    Fixturing,
    InspectionOptions,
    LightBox,
    Lighting,
    PoseUncertainty,
    RequestError,
    RingLight,
    RobotError,
)
from planner.light.area_lights import light_of_cell
from planner.resolve_request import resolve_request
from planner.robotcell.cell_file import moved_cell

RING = CarriedLight("ring-light:typical-90", 150.0)
DOME = CarriedLight("diffuse-dome:basler-dome-200", 270.0)
BACK = "backlight:basler-back-200x300"
CAMERA = Camera.named("basler-acA2440-20gm-8mm")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
EDGES = {"left": [[60, 20, 10], [60, 40, 10]]}


def held_in(light, points):
    """Return which points are in a solid of a light, by the planes of its hulls."""
    inside = np.zeros(len(points), dtype=bool)
    for corners, _ in light.bodies():
        planes = ConvexHull(corners).equations
        inside |= (points @ planes[:, :3].T + planes[:, 3] < 1e-9).all(axis=1)
    return inside


def spherical(rng, radii, angles):
    """Return points (n, 3) about the middle of the dome's rim, by radius and angle from its top."""
    turn = rng.uniform(0.0, 2 * np.pi, len(radii))
    across = radii * np.sin(angles)
    high = 270.0 - radii * np.cos(angles)
    return np.stack([across * np.cos(turn), across * np.sin(turn), high], axis=1)


def test_a_dome_is_its_shell_and_leaves_the_hole_and_the_inside():
    rng = np.random.default_rng(1)
    hole = np.arcsin(30.0 / 200.0)
    angles = rng.uniform(hole, np.pi / 2, 2000)
    assert held_in(DOME, spherical(rng, rng.uniform(100.0, 120.0, 2000), angles)).all()
    # sectors of 45 by about 41 degrees come no nearer to the middle than their chords
    free = 100.0 * np.cos(np.pi / 8) * np.cos((np.pi / 2 - hole) / 4) - 1e-6
    assert not held_in(DOME, spherical(rng, rng.uniform(0.0, free, 2000), angles)).any()
    up = np.array([[0.0, 0.0, z] for z in (100.0, 160.0, 169.0, 200.0)])
    assert not held_in(DOME, up).any()


def test_a_ring_is_an_annulus_of_its_thickness():
    rng = np.random.default_rng(2)
    turn = rng.uniform(0.0, 2 * np.pi, 2000)
    ways = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    high = rng.uniform(130.0, 150.0, (2000, 1))

    def at(low_mm, high_mm):
        return np.hstack([ways * rng.uniform(low_mm, high_mm, (2000, 1)), high])

    assert held_in(RING, at(25.0, 45.0)).all()
    assert not held_in(RING, at(0.0, 25.0 * np.cos(np.pi / 8) - 1e-6)).any()
    assert not held_in(RING, at(45.0 / np.cos(np.pi / 8) + 1e-6, 60.0)).any()


def looks_down(height_mm):
    """Return the pose of a camera at a height that looks down at the origin of the part."""
    return pose((0.0, 0.0, height_mm), np.diag([1.0, -1.0, -1.0]))[None]


def test_a_light_is_swept_with_the_camera():
    # the ring ends at most 49 mm from the axis, 40 mm above the part: a post in 55 mm is too near
    post = Box((755.0, -10.0, 0.0), (775.0, 10.0, 60.0))
    lying = Fixturing(pose((700.0, 0.0, 0.0)), {"table": TABLE, "post": post})
    dark = made_cell(fixturings={"up": lying})
    lit = made_cell(fixturings={"up": lying}, light=RING)
    assert dark.reach(looks_down(190.0), "up")[0].reached
    answer = lit.reach(looks_down(190.0), "up")[0]
    assert not answer.reached
    assert "light touches post" in answer.why
    # 20 mm over the post there is room
    assert lit.reach(looks_down(230.0), "up")[0].reached
    assert dark.state_name != lit.state_name
    assert lit.difference(dark.to_dict()) == "light (new)"


def test_a_backlight_is_in_the_way_and_moves_with_its_fixturing():
    high = pose((700.0, 0.0, 200.0))
    lying = Fixturing(pose((700.0, 0.0, 200.0)), {"light": LightBox.of(BACK, high)})
    cell = made_cell(fixturings={"up": lying})
    # a camera 100 mm below the plane of the light, which is 20 mm thick
    low = looks_down(-100.0)
    assert "light" in cell.reach(low, "up")[0].why
    assert made_cell().moved(pose((0, 0, 200.0))).reach(low, "up")[0].why != ""
    motion = pose((30.0, -40.0, 5.0), Rotation.from_euler("z", 40, degrees=True).as_matrix())
    moved = cell.moved(motion)
    np.testing.assert_allclose(moved.light.pose, cell.light.pose, atol=1e-12)
    copied = pickle.loads(pickle.dumps(moved))
    assert copied.state_name == moved.state_name
    np.testing.assert_allclose(copied.light.pose, np.eye(4), atol=1e-12)


def test_plans_get_the_light_where_it_is_below_the_part():
    # the part lies turned by 90 degrees, and the light is 10 mm off along x of the base
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    lying = Fixturing(
        pose((700.0, 0.0, 0.0), quarter), {"light": LightBox.of(BACK, pose((710.0, 0.0, 0.0)))}
    )
    light = light_of_cell(made_cell(fixturings={"up": lying}))
    assert isinstance(light, Backlight)
    # x of the base is -y of the part; 200 mm wide along it
    np.testing.assert_allclose(light.centre, (0.0, -10.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(light.half_width, (0.0, -100.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(light.half_height, (150.0, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(light.normal, (0.0, 0.0, 1.0), atol=1e-12)
    ring = light_of_cell(made_cell(light=RING))
    assert ring == RingLight(50.0, 90.0, 150.0, name="typical-90")
    dome = light_of_cell(made_cell(light=DOME))
    assert dome == DiffuseDome(200.0, 30.0, 270.0, name="basler-dome-200")
    assert light_of_cell(made_cell()) is None


def test_the_request_takes_the_light_of_the_cell_and_no_other():
    block = read_solid("examples/two_pocket_block.off")
    cell = made_cell(light=RING)

    def request(lamps=None):
        options = InspectionOptions(accuracy=0.95, cell=cell, lamps=lamps)
        return resolve_request(block, EDGES, CAMERA, UNCERTAINTY, options).request

    lit = request()
    assert lit.lighting.area.distance_mm == 150.0
    assert request("ring-light:typical-90").identity() == lit.identity()
    assert request(Lighting(light_of_cell(cell))).identity() == lit.identity()
    rule = "lamps must be left out, or be that of the cell, ring-light:typical-90. Got "
    with pytest.raises(RequestError, match=f"{rule}backlight"):
        request("backlight")
    with pytest.raises(RequestError, match=f"{rule}lamps"):
        request([[0.0, 0.0, 300.0]])


def fixturing(x=700.0, light_x=700.0, **options):
    return Fixturing(
        pose((x, 0.0, 0.0)), {"light": LightBox.of(BACK, pose((light_x, 0.0, 0.0)))}, **options
    )


def test_lines_of_sight_meet_the_bright_rectangle_where_similar_triangles_say():
    light = LightBox.of(BACK, pose((710.0, 0.0, 40.0)))
    eye = np.array([[700.0, 10.0, 440.0], [700.0, 10.0, 20.0]])
    segment = np.array([[[690.0, 30.0, 240.0], [720.0, 10.0, 140.0]]])
    ends, met = light.behind(eye, segment)
    # half way down the ray goes twice as far; at three quarters, 4/3 as far
    np.testing.assert_allclose(ends[0, 0], [[680.0, 50.0, 40.0], [700 + 80 / 3, 10.0, 40.0]])
    assert met.tolist() == [[True], [False]]
    assert np.isnan(ends[1]).all()
    beside = np.array([0.0, 80.0, 0.0])
    assert light.behind(eye[:1], segment + beside)[1].tolist() == [[False]]
    # a segment in the plane is its own image; one below it has the plane before it
    flat = np.array([[[650.0, 0.0, 40.0], [750.0, 0.0, 40.0]]])
    np.testing.assert_allclose(light.behind(eye[:1], flat)[0][0], flat)
    assert not light.behind(eye[:1], flat - [0, 0, 5.0])[1].any()


REFUSED = {
    "two lights": (
        {
            "light": RING,
            "fixturings": {
                "up": Fixturing(
                    pose((700.0, 0.0, 0.0)), {"back": LightBox.of(BACK, pose((700.0, 0.0, 0.0)))}
                )
            },
        },
        "light must be the only light of the cell. Got ring-light:typical-90 and backlight:",
    ),
    "a body of its name": (
        {"light": RING, "fixturings": {"up": fixturing()}},
        "must have names that no other object",
    ),
    "elsewhere": (
        {"fixturings": {"up": fixturing(), "over": fixturing(light_x=720.0)}},
        "light must be under the part in every fixturing, .* Got another one in 'over'",
    ),
    "without": (
        {"fixturings": {"up": fixturing(), "over": Fixturing(pose((700.0, 0.0, 0.0)))}},
        "Got another one in 'over'",
    ),
    "turntable": (
        {"fixturings": {"up": fixturing(axis=((700.0, 0.0, 0.0), (0.0, 0.0, 1.0)), angles=4)}},
        "light must turn with the part in fixturing 'up'",
    ),
}


@pytest.mark.parametrize(("changes", "message"), REFUSED.values(), ids=REFUSED)
def test_lights_that_no_plan_can_have_are_refused(changes, message):
    with pytest.raises(RobotError, match=message):
        made_cell(**changes)


def written(folder, top="", lying=""):
    """Return a cell file beside the robots, with lines at its top and in its first fixturing."""
    text = (ROBOTS.parent / "cell.toml").read_text("utf-8").replace('"robots', f'"{ROBOTS}')
    up = text.index("[fixturings.up.obstacles.table]")
    over = text.index('[fixturings."turned over"]')
    path = folder / "cell.toml"
    path.write_text(f"{text[:up]}{lying}\n{text[up:over]}{top}", encoding="utf-8")
    return path


CARRIED = '[light]\nname = "ring-light:typical-90"\ndistance_mm = 200.0\n'
BELOW = f'[fixturings.up.light]\nname = "{BACK}"\npose = {{ xyz = [800.0, 300.0, 100.0] }}\n'


def test_cell_files_state_lights(tmp_path):
    carried = Cell.from_toml(written(tmp_path, top=CARRIED))
    assert carried.light == CarriedLight("ring-light:typical-90", 200.0, 20.0)
    path = written(tmp_path, lying=BELOW + "thickness_mm = 12.0\n")
    cell = Cell.from_toml(path)
    assert cell.fixturings["up"].obstacles["light"].low == (-100.0, -150.0, -12.0)
    motion = pose((5.0, 6.0, 7.0))
    content = moved_cell(path, motion, tmp_path)
    np.testing.assert_array_equal(
        np.array(content["fixturings"]["up"]["light"]["pose"])[:3, 3], (805.0, 306.0, 107.0)
    )


WRONG = {
    "kind": (CARRIED.replace("ring-light", "lamp"), "", "light.name must be diffuse-dome or"),
    "name": (CARRIED.replace("90", "91"), "", "light.name must name a light of kind ring-light"),
    "no distance": (CARRIED.replace("distance_mm", "thickness_mm"), "", "light.distance_mm"),
    "negative": (CARRIED.replace("200.0", "-1.0"), "", "light.distance_mm must be .*Got -1"),
    "carried below": ("", BELOW.replace(BACK, "coaxial:typical-50"), "up.light.name must be backl"),
    "no pose": ("", BELOW.replace("pose", "place"), "fixturings.up.light"),
}


@pytest.mark.parametrize(("top", "lying", "message"), WRONG.values(), ids=WRONG)
def test_errors_of_lights_name_the_field(tmp_path, top, lying, message):
    with pytest.raises(RobotError, match=message):
        Cell.from_toml(written(tmp_path, top, lying))


def test_the_frame_of_a_carried_light_is_the_camera():
    cell = made_cell(light=CarriedLight("coaxial:typical-50", 150.0, 5.0))
    bodies = cell.shapes(np.zeros(6), "up")
    corners = next(points for name, _, points, _ in bodies if name == "light")
    in_base = cell.robot.forward(np.zeros((1, 6)))[0] @ CAM2FLANGE
    local = (corners - in_base[:3, 3]) @ in_base[:3, :3]
    np.testing.assert_allclose(local.min(axis=0), (-30.0, -30.0, 100.0), atol=1e-9)
    np.testing.assert_allclose(local.max(axis=0), (30.0, 30.0, 150.0), atol=1e-9)
