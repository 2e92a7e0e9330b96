"""What to expose for, against light that is computed by hand for a block."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from contrast_lamps import contrast_lamps
from lit_parts import RIM, block, step
from plan_examples import plan, setting
from scipy.spatial.transform import Rotation

from aspectgraph.solid.solid import RayScene
from planner import (
    Camera,
    Exposure,
    LampDome,
    LightPlan,
    LitImage,
    PoseUncertainty,
    look_at,
    plan_light,
)
from planner.camera.camera import image_of
from planner.camera.pose import world_to_cam
from planner.light.light_plan import (
    CAMERA_CLEARANCE_MM,
    WHITE_SHARE,
    CameraWays,
    beside,
    exposure,
    eyes_of,
    irradiance,
    spread_px,
    white_share,
)
from planner.report.setting_report import exposure_texts

CAMERA = Camera(25.0, (0.0138, 0.0138), (640, 512), 8.0, 300.0)
ABOVE = look_at([[40.0, 25.0, 360.0]], [40.0, 25.0, 60.0])[0]
# of the block's upper face: near x = 0 and near x = 80
EDGES = {
    "left": np.array([[0.0, y, 60.0] for y in (5.0, 25.0, 45.0)]),
    "right": np.array([[80.0, y, 60.0] for y in (5.0, 25.0, 45.0)]),
}


def pixel_of(place):
    local = world_to_cam(np.array([place]), ABOVE)
    return image_of(CAMERA, local / local[:, 2:])[0]


def scene_of(solid):
    return RayScene(solid.vertices, solid.triangles)


def test_light_falls_with_cosine_and_squared_distance():
    lamp = np.array([40.0, 25.0, 160.0])
    places = np.array([[40.0, 25.0, 60.0], [70.0, 25.0, 60.0]])
    pixels = np.array([pixel_of(one) for one in places])
    light = irradiance(scene_of(block()), ABOVE, CAMERA, pixels, lamp[None])
    # straight above at 100 mm; and 30 mm aside
    assert light[0] == pytest.approx(1 / 100**2, rel=1e-3)
    assert light[1] == pytest.approx((100 / np.hypot(100, 30)) / (100**2 + 30**2), rel=1e-3)


def test_off_the_part_and_below_a_face_there_is_no_light():
    off = np.array([pixel_of([-40.0, 25.0, 60.0]), pixel_of([40.0, 25.0, 60.0])])
    below = np.array([[40.0, 25.0, -100.0]])
    assert irradiance(scene_of(block()), ABOVE, CAMERA, off, below).tolist() == [0.0, 0.0]
    assert exposure(scene_of(block()), ABOVE, CAMERA, EDGES, below) is None


def test_a_lamp_at_one_side_lights_its_edge_most():
    lamp = np.array([[90.0, 25.0, 160.0]])
    found = exposure(scene_of(block()), ABOVE, CAMERA, EDGES, lamp)
    assert (found.target, found.dimmest) == ("right", "left")
    # within 3 px of the middle of the right edge
    np.testing.assert_allclose(found.pixel, pixel_of([80.0, 25.0, 60.0]), atol=4)
    near = 100 / np.hypot(100, 10.5) ** 3
    far = 100 / np.sqrt(100**2 + 89.5**2 + 20**2) ** 3
    assert found.times == pytest.approx(near / far, rel=0.1)


def test_lamps_of_a_plan_come_with_what_to_expose_for():
    ends = {"left": [[0.0, 0, 60], [0, 50, 60]], "right": [[80.0, 0, 60], [80, 50, 60]]}
    one = dataclasses.replace(
        setting((40.0, 25.0, 360.0), list(ends), (40.0, 25.0, 60.0)), cam2world=ABOVE
    )
    above = plan(settings=(one,), entities=ends, uninspectable={}, camera=CAMERA)
    light = contrast_lamps(above, block(), [[90.0, 25.0, 160.0]])
    (image,) = light.images[0]
    found = image.expose_for
    assert (found.target, found.dimmest) == ("right", "left")
    # of a place on the upper face, whose light is known
    way = (np.array(found.pixel) - pixel_of([40.0, 25.0, 60.0])) * 300 * 0.0138 / 25.0
    aside = np.hypot(50.0 - abs(way[0]), way[1])
    place = 100 / np.hypot(100, aside) ** 3
    near = 100 / np.hypot(100, 10.5) ** 3
    far = 100 / np.sqrt(100**2 + 89.5**2) ** 3
    # half of the left edge is nearer to its middle than 12.5 mm
    assert found.times == pytest.approx(near / far, rel=0.1)
    # evenly lit: the darkest place around counts
    assert 0.85 < found.share / (WHITE_SHARE * place / near) < 1.02
    assert found.radius_px == 10
    assert LightPlan.from_dict(json.loads(json.dumps(light.to_dict()))) == light
    assert contrast_lamps(above, block(), [[90.0, 25.0, 160.0]]) == light


def displaced(pose, move):
    moved = pose.copy()
    moved[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(move[3:]).as_matrix()
    moved[:3, 3] += pose[:3, :3] @ move[:3]
    return moved


def test_a_displaced_camera_is_not_overexposed():
    """The camera is moved by some pixels. The place beside the brightest edge has 80 % then, and not more."""
    solid = step()
    scene = scene_of(solid)
    pose = look_at([[10.0, 20.0, 300.0]], [30.0, 20.0, 0.0])[0]
    points = {"rim": np.array([[30.0, 0.0, 10.0], [30.0, 40.0, 10.0]])}
    lamps = np.array([[80.0, 20.0, 120.0]])
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.3, rotation_rad=0.004)
    seen = SimpleNamespace(camera=CAMERA, pose_uncertainty=uncertainty)
    spread = spread_px(seen, pose, points["rim"])
    exposed = exposure(scene, pose, CAMERA, points, lamps, spread)
    assert exposed.radius_px > 0
    rng = np.random.default_rng(4)
    moves = rng.standard_normal((60, 6)) * uncertainty.sigmas
    steps = np.arange(-exposed.radius_px, exposed.radius_px + 1, 4)
    disc = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= exposed.radius_px]
    white = []
    for move in moves:
        real = displaced(pose, move)
        region = irradiance(scene, real, CAMERA, np.array(exposed.pixel) + disc, lamps)
        ring = beside(CAMERA, real, points["rim"]).reshape(-1, 2)
        brightest = irradiance(scene, real, CAMERA, ring, lamps).max()
        white.append(exposed.share / region.mean() * brightest)
    assert np.quantile(white, 0.95) < 0.83
    assert np.quantile(white, 0.05) > 0.6


@pytest.mark.parametrize("height", [12.0, 20.0, 60.0, 120.0])
def test_what_an_image_is_exposed_for_is_evenly_lit(height):
    """Under low lamps hardly anything is: then the pixel next to the edge is named, and no dark place next to light."""
    solid = step()
    scene = scene_of(solid)
    pose = look_at([[10.0, 20.0, 300.0]], [30.0, 20.0, 0.0])[0]
    points = {"rim": np.array([[30.0, 0.0, 10.0], [30.0, 40.0, 10.0]])}
    lamps = np.array([[80.0, 20.0, height]])
    exposed = exposure(scene, pose, CAMERA, points, lamps, spread_px=25.0)
    steps = np.arange(-exposed.radius_px, exposed.radius_px + 1, 2)
    disc = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= exposed.radius_px]
    region = irradiance(scene, pose, CAMERA, np.array(exposed.pixel) + disc, lamps)
    ring = beside(CAMERA, pose, points["rim"]).reshape(-1, 2)
    brightest = irradiance(scene, pose, CAMERA, ring, lamps).max()
    # as bright as it is meant to be, or darker by what a region may be uneven
    white = exposure(scene, pose, CAMERA, points, lamps).share
    assert 0.65 * white < exposed.share / region.mean() * brightest < 1.01 * white


def test_the_spread_of_an_image_is_that_of_displaced_cameras():
    """Of 99 of 100 draws, by images of real displacements; the formula is the one of the wider direction."""
    place = np.array([[60.0, 40.0, 60.0]])
    for mm, rad in ((0.4, 1e-6), (1e-6, 0.003), (0.3, 0.002)):
        uncertainty = PoseUncertainty.isotropic(translation_mm=mm, rotation_rad=rad)
        seen = SimpleNamespace(camera=CAMERA, pose_uncertainty=uncertainty)
        moves = np.random.default_rng(3).standard_normal((2000, 6)) * uncertainty.sigmas
        local = np.concatenate([world_to_cam(place, displaced(ABOVE, move)) for move in moves])
        away = np.linalg.norm(image_of(CAMERA, local / local[:, 2:]) - pixel_of(place[0]), axis=1)
        assert spread_px(seen, ABOVE, place) == pytest.approx(np.quantile(away, 0.99), rel=0.1)


def test_of_two_equally_bright_targets_the_first_is_named():
    """The lamp is over the middle, and rays differ in their last digits."""
    lamp = np.array([[40.0, 25.0, 160.0]])
    for names in (("left", "right"), ("right", "left")):
        points = {name: EDGES[name] for name in names}
        found = exposure(scene_of(block()), ABOVE, CAMERA, points, lamp)
        assert (found.target, found.dimmest) == (names[0], names[0])


def test_what_the_camera_does_not_see_is_not_exposed_for():
    outside = {"left": EDGES["left"] + [0.0, 200.0, 0.0]}
    lamp = np.array([[40.0, 225.0, 160.0]])
    assert exposure(scene_of(block()), ABOVE, CAMERA, outside, lamp) is None


def test_an_infinite_ratio_is_null_and_plans_of_earlier_programs_have_none():
    image = LitImage((0,), {"a": 0.5, "b": 0.5}, (), Exposure("a", (3, 4), "b", np.inf))
    light = LightPlan("fixed", 0.1, 0.05, "dark", np.ones((1, 3)), ((image,),), ({},), 1, "by hand")
    data = light.to_dict()
    assert data["settings"][0]["images"][0]["expose_for"]["times"] is None
    assert LightPlan.from_dict(data) == light
    del data["settings"][0]["images"][0]["expose_for"]
    assert LightPlan.from_dict(data).images[0][0].expose_for is None


def test_a_shadow_is_dark():
    """Of the step of 10 mm, the lower floor beside it is in the shadow of a low lamp behind."""
    pose = look_at([[30.0, 20.0, 300.0]], [30.0, 20.0, 0.0])[0]
    local = world_to_cam(np.array([[32.0, 20.0, 0.0], [55.0, 20.0, 0.0]]), pose)
    pixels = image_of(CAMERA, local / local[:, 2:])
    light = irradiance(scene_of(step()), pose, CAMERA, pixels, np.array([[-10.0, 20.0, 30.0]]))
    # the shadow ends at x = 50: from 40 mm away, 20 mm above the step of 10 mm
    assert light[0] == 0
    assert light[1] > 0


def test_the_report_says_what_to_expose_for():
    lamps = np.array([[30.0, 20.0, 500.0]])
    light = LightPlan(
        "placed", 0.1, 0.05, "dark", lamps, ((LitImage((0,), {"rim": 0.5}),),), ({},), 1, "by hand"
    )
    lit = plan(
        settings=(setting((10.0, 20.0, 400.0), ["rim"], (30.0, 20.0, 10.0)),),
        entities=RIM,
        uninspectable={},
        workspace=np.array([[-900.0] * 3, [900.0] * 3]),
        light=light,
    )
    (text,) = exposure_texts(lit, scene_of(step()), 0)
    assert text.startswith("under lamp 1, expose so that the mean within 10 px of pixel (")
    assert "at rim, then has at most 80 % of white" in text
    # what the plan holds is not computed again
    stored = Exposure("rim", (7, 9), "rim", 1.0, 0)
    images = ((LitImage((0,), {"rim": 0.5}, (), stored),),)
    known = dataclasses.replace(lit, light=dataclasses.replace(light, images=images))
    (text,) = exposure_texts(known, scene_of(step()), 0)
    assert text.startswith("under lamp 1, expose so that pixel (7, 9) beside rim")


@pytest.mark.parametrize(
    ("others", "share", "white"),
    [(2.0, 0.04, 0.8), (2.0, 0.2, 0.47), (2.0, 0.5, 0.47), (1.3, 0.5, 0.73), (9.0, 0.5, 0.27)],
    ids=["few of the places", "a fifth", "half of them", "hardly overexposed", "very bright"],
)
def test_what_registers_is_not_overexposed_for_weak_targets(others, share, white):
    """Some of what is lit is twice as bright as the targets: with .47 for these it has .95 of white."""
    light = np.where(np.arange(1000) < 1000 * share, others, 0.9)
    assert white_share(light) == pytest.approx(white, abs=0.006)
    # what no lamp lights does not count
    assert white_share(np.concatenate([light, np.zeros(5000)])) == white_share(light)


# A camera 400 mm above the middle of a block of 80 x 50 x 60 mm, whose top is 340 mm before it.
DOWN = [[1, 0, 0, 40.0], [0, -1, 0, 25.0], [0, 0, -1, 400.0], [0, 0, 0, 1]]


def ways():
    pinhole = [[4000.0, 0, 599.5], [0, 4000.0, 399.5], [0, 0, 1]]
    return CameraWays(np.array([DOWN]), np.array(pinhole), (1200, 800), np.array([340.0]))


@pytest.mark.parametrize(
    ("place", "meets"),
    [
        # in the lens, beside it, and in and behind the housing
        ((45.0, 25.0, 395.0), True),
        ((40.0, 74.0, 400.0), True),
        ((40.0, 76.0, 400.0), False),
        ((40.0, 60.0, 540.0), True),
        ((40.0, 25.0, 599.0), True),
        ((40.0, 25.0, 601.0), False),
        # 300 mm before it, half the image is 600 / 4000 · 300 = 45 mm and 30 mm
        ((84.0, 25.0, 100.0), True),
        ((86.0, 25.0, 100.0), False),
        ((40.0, 54.0, 100.0), True),
        ((40.0, 56.0, 100.0), False),
        # beside the part, or behind it, it hides nothing
        ((84.0, 25.0, 50.0), False),
        ((40.0, 25.0, -10.0), False),
    ],
)
def test_a_lamp_is_in_no_camera_and_before_no_image(place, meets):
    assert ways().meet(np.array([place])).tolist() == [meets]


def test_placed_lamps_keep_out_of_the_way_of_cameras():
    """The dome goes through the camera of the only setting."""
    found = plan(settings=(setting((40.0, 25.0, 400.0), ["top front", "top right"]),))
    dome = LampDome((40.0, 25.0, 0.0), 400.0, 300.0)
    light = plan_light(found, block(), dome)
    assert light.complete
    assert not CameraWays.of(found, block()).meet(light.lamps).any()
    (eye,) = eyes_of(found)
    assert np.linalg.norm(light.lamps - eye, axis=1).min() >= CAMERA_CLEARANCE_MM
    # where a lamp is given, it is where it is
    given = plan_light(found, block(), [[45.0, 25.0, 400.0]])
    assert given.lamps.tolist() == [[45.0, 25.0, 400.0]]
