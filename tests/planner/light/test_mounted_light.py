"""Lights that the camera carries: what edges show, against closed forms, and plans with them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from lit_parts import RIM, block, bore, step
from plan_examples import CAMERA, plan, setting

from ground.convert import from_plain, to_plain
from planner import (
    Backlight,
    CoaxialLight,
    DiffuseDome,
    LampBox,
    Lighting,
    Material,
    RingLight,
    plan_light,
)
from planner.exceptions import RequestError
from planner.light.area_light import AreaSpace, EdgePoints, Sight, entity_shown
from planner.light.light_plan import LightPlan
from planner.light.mounted_light import HeldLight, flat_normals, looking_at
from planner.light.reflection import Glare, Places
from planner.request.reach import AROUND

METAL = Material("metal", 0.1)


def rim_ids(solid, radius):
    on_rim = (np.abs(np.linalg.norm(solid.vertices[:, :2], axis=1) - radius) < 1e-9) & (
        solid.vertices[:, 2] == 0
    )
    return [edge.id for edge in solid.edges if on_rim[list(edge.vertices)].all()]


def above(height, solid, pixel_rad):
    scene = Sight.of(solid, CAMERA).scene
    return looking_at(np.array([[0.0, 0, height]]), np.zeros(3))[0], Sight(solid, scene, pixel_rad)


@pytest.mark.parametrize("depth", [5.0, 10.0, 25.0])
def test_a_rim_under_a_dome_by_the_view_factor_of_the_bores_mouth(depth):
    """The top sees all of the dome; the floor, off the axis, sees it through the mouth."""
    radius = 10.0
    height = 3000.0
    pixel_rad = 1e-4
    part = bore(radius, depth)
    pose, sight = above(height, part, pixel_rad)
    light = DiffuseDome(400.0, 22.0, height)
    points = EdgePoints.of(part, rim_ids(part, radius))
    contrast, _ = HeldLight(light, pose).shown(sight, points, pose[None, :3, 3], 1024, 0)
    # a small face parallel to a disc (Howell, A Catalog of Radiation Configuration Factors, B-13)
    aside = (radius - 3 * pixel_rad * height) * (1 + depth / height)
    h = depth / aside
    r = radius / aside
    z = 1 + h**2 + r**2
    seen = 0.5 * (1 - (z - 2 * r**2) / math.sqrt(z**2 - 4 * r**2))
    assert contrast[0].mean() == pytest.approx((1 - seen) / (1 + seen), abs=0.02)


def test_a_step_under_a_dome_by_the_sky_that_its_wall_hides():
    """Beside a long wall of height h, at distance d, a face sees (1 + cos(atan(h/d))) / 2 of the sky."""
    part = step()
    pose = looking_at(np.array([[30.0, 20, 3000]]), np.array([30.0, 20, 0]))[0]
    sight = Sight(part, Sight.of(part, CAMERA).scene, 1e-4)
    # the wall is 40 mm long: only its middle has a long one beside it
    middle = EdgePoints(
        np.array([[30.0, 20, 10]]),
        np.array([[0.0, 1, 0]]),
        np.array([[[0.0, 0, 1], [1, 0, 0]]]),
    )
    held = HeldLight(DiffuseDome(4000.0, 0.01, 2990.0), pose)
    contrast, _ = held.shown(sight, middle, pose[None, :3, 3], 4096, 0)
    low = (1 + math.cos(math.atan2(10.0, 3e-4 * 3000))) / 2
    # beyond its ends more sky is seen: little, at a distance of 1 mm
    assert contrast[0, 0] == pytest.approx((1 - low) / (1 + low), abs=0.02)


def test_coaxial_light_on_metal_shows_faces_that_are_square_to_the_axis():
    part = block()
    light = CoaxialLight(40.0, 200.0, METAL)
    bright = []
    for tilt_deg in (0.0, 8.0, 20.0):
        tilt = math.radians(tilt_deg)
        eye = np.array([40.0, 25, 60]) + 300 * np.array([math.sin(tilt), 0, math.cos(tilt)])
        held = light.held(looking_at(eye[None], np.array([40.0, 25, 60]))[0])
        scene = Sight.of(part, CAMERA).scene
        way = np.array([40.0, 25, 60]) - eye
        bright.append(float(held.brightness(scene, eye, way[None])[0]))
    assert bright[0] > bright[1] > bright[2]
    assert bright[2] < 0.05 * bright[0]


def test_the_search_looks_square_at_flat_faces_under_coaxial_light():
    """Beside the part's middle, a camera that looks at the middle is tilted; one that looks square is not."""
    part = block()
    sight = Sight.of(part, CAMERA)
    top = [edge.id for edge in part.edges if (part.normals[list(edge.faces), 2] > 0.9).any()]
    edges = EdgePoints.of(part, top[:1])
    eyes = part.bounds.mean(axis=0) + np.array([[0.0, 0, 300], [15, 10, 300]])
    poses = CoaxialLight(40.0, 200.0, METAL).likely_poses(sight, edges, eyes)
    assert np.allclose(poses[:, :3, 2], [0, 0, -1])
    assert np.allclose(poses[:, :3, 3], eyes)
    dome = DiffuseDome(200, 40, 250).likely_poses(sight, edges, eyes)
    assert np.allclose(dome[0, :3, 2], [0, 0, -1])
    assert dome[1, 2, 2] > -0.999
    # a bore has one flat face beside its rim
    rim = bore(6.0, 12.0)
    assert np.allclose(flat_normals(EdgePoints.of(rim, rim_ids(rim, 6.0))), [[0, 0, 1]])


def test_the_quick_answer_of_the_search_is_near_the_full_one():
    part = bore(6.0, 12.0)
    sight = Sight.of(part, CAMERA)
    ids = rim_ids(part, 6.0)
    middle = np.mean(part.bounds, axis=0)
    eyes = np.array([[0.0, 0, 600], [30, 10, 590], [-30, 15, 580]])
    for light in (kind.on(CAMERA, None, 40.0) for kind in (DiffuseDome, CoaxialLight, RingLight)):
        quick = entity_shown(light, sight, ids, eyes)[0]
        full = [
            entity_shown(light.held(pose), sight, ids, pose[None, :3, 3])[0][0]
            for pose in looking_at(eyes, middle)
        ]
        assert quick == pytest.approx(full, abs=0.25)
        assert ((quick >= 0.1) == (np.array(full) >= 0.1)).all()


@pytest.mark.parametrize("kind", [DiffuseDome, CoaxialLight, RingLight])
def test_around_a_viewpoint_it_shows_what_it_shows_from_there(kind):
    """So the search asks the regions alone of these points: faces hide at once, and the light is the camera's."""
    part = bore(6.0, 12.0)
    sight = Sight.of(part, CAMERA)
    ids = rim_ids(part, 6.0)
    light = kind.on(CAMERA, None, 40.0)
    for pose in looking_at(np.array([[0.0, 0, 600], [30, 10, 590]]), np.mean(part.bounds, axis=0)):
        moved = pose[:3, 3] + 0.5 * np.vstack([np.zeros(3), AROUND])
        contrast, step = entity_shown(light.held(pose), sight, ids, moved)
        assert np.ptp(contrast) < 0.02
        assert np.ptp(step) < 0.02
    regions = object.__new__(AreaSpace)
    assert AreaSpace(regions, CAMERA, light, (0.1, 0.1)).nearby is regions
    standing = AreaSpace(regions, CAMERA, Backlight.under(part), (0.1, 0.1))
    assert standing.nearby is standing


def test_nothing_shows_beside_the_hole_or_with_the_light_in_the_part():
    part = bore(10.0, 10.0)
    pose, sight = above(300.0, part, 4e-4)
    eye = pose[None, :3, 3]
    ids = rim_ids(part, 10.0)
    assert entity_shown(DiffuseDome(200.0, 60.0, 270.0).held(pose), sight, ids, eye)[0] > 0.1
    # the rim is at 10 mm / 300 mm from the axis; this hole shows 2 mm / 200 mm
    assert entity_shown(DiffuseDome(200.0, 4.0, 270.0).held(pose), sight, ids, eye)[0] == 0
    # the rim of the dome would be inside the part
    assert entity_shown(DiffuseDome(200.0, 60.0, 310.0).held(pose), sight, ids, eye)[0] == 0


@pytest.mark.parametrize(
    ("light", "reason"),
    [
        (DiffuseDome(200.0, 60.0, 270.0), ""),
        # the rim is at 10 mm / 300 mm from the axis; this hole shows 2 mm / 200 mm
        (DiffuseDome(200.0, 4.0, 270.0), "only 0 % of it lies in the opening of the diffuse dome"),
        (DiffuseDome(200.0, 60.0, 310.0), "the diffuse dome would touch the part"),
        (RingLight(50.0, 90.0, 30.0), ""),
        # the ring is on the far side of the part
        (RingLight(50.0, 90.0, 400.0), "only 0 % of it lies in the opening of the ring light"),
        (CoaxialLight(40.0, 250.0), ""),
        (CoaxialLight(6.0, 250.0), "only 0 % of it lies in the opening of the coaxial light"),
    ],
)
def test_a_light_on_the_wrong_side_is_named_in_the_reason(light, reason):
    part = bore(10.0, 10.0)
    pose, sight = above(300.0, part, 4e-4)
    points = EdgePoints.of(part, rim_ids(part, 10.0)).points
    said = light.misplaced(sight.scene, pose, points)
    assert str(said).startswith(reason) if reason else said is None


def test_the_most_frequent_reason_in_the_dark_is_named_alone():
    """At 300 mm above the bore the dome is in the part, at 400 mm it is not."""
    part = bore(10.0, 10.0)
    near, far = (above(height, part, 4e-4)[0] for height in (300.0, 400.0))
    rim = SimpleNamespace(edge_ids=rim_ids(part, 10.0))
    regions = SimpleNamespace(solid=part, entities={"rim": rim})
    space = AreaSpace(regions, CAMERA, DiffuseDome(200.0, 60.0, 310.0), (0.1, 0.1))
    touches = "the diffuse dome would touch the part"
    assert space.why_dark(np.stack([near, near]), ["rim"]) == touches
    often = f"{touches} (from 2 of 3 of these poses)"
    assert space.why_dark(np.stack([near, far, near]), ["rim"]) == often
    text = space.why_dark(far[None], ["rim"])
    assert text.endswith(
        "has too little contrast or light under the diffuse dome, at the camera or nearby"
    )
    assert "touch" not in text


ABOVE = plan(
    settings=(setting((10.0, 20.0, 590.0), ["rim"], (30.0, 20.0, 10.0)),),
    entities=RIM,
    uninspectable={},
    workspace=np.array([[-900.0] * 3, [900.0] * 3]),
)


@pytest.mark.parametrize("kind", ["diffuse-dome", "coaxial", "ring-light"])
def test_a_plan_holds_its_light(kind):
    found = plan_light(ABOVE, step(), kind)
    assert (found.kind, len(found.lamps), found.lower_bound) == (kind, 0, 0)
    assert found.area.kind == kind
    assert LightPlan.from_dict(found.to_dict()) == found
    # beside the wall, the lower face sees half of the light
    (image,) = found.images[0]
    assert 0.1 < image.contrast["rim"] < 0.4
    assert image.lamps == ()
    assert image.expose_for.target == "rim"


def test_the_material_belongs_to_the_request():
    metal = Lighting("coaxial", material=METAL)
    assert from_plain(Lighting, to_plain(metal), RequestError).material == METAL
    light = metal.on_part(block(), CAMERA).area
    assert light.material == METAL
    assert from_plain(CoaxialLight, to_plain(light), RequestError) == light
    assert Lighting(CoaxialLight(50.0, 200.0), material=METAL).area.material == METAL
    assert Lighting("backlight", material=METAL).on_part(block(), CAMERA).area.on_metal


def test_a_space_with_a_mounted_light_shows_no_more_than_the_regions():
    class Everywhere:
        solid = bore(6.0, 12.0)
        entity_names = ("rim",)

        def __init__(self):
            self.entities = {"rim": type("Rim", (), {"edge_ids": rim_ids(self.solid, 6.0)})}

        def observable(self, points, names):
            return np.ones((len(points), len(names)), dtype=bool)

    metal = CoaxialLight(60.0, 210.0, METAL)
    space = AreaSpace(Everywhere(), CAMERA, metal, (0.1, 0.1))
    # from the side, the square top of the part is dark, as the bore is
    seen = space.observable(np.array([[0.0, 0, 280], [200, 0, 200]]))
    assert seen.tolist() == [[True], [False]]


def test_glare_is_where_facets_stand_half_way_between_lamp_and_camera():
    up = np.array([[0.0, 0, 1]])
    glare = Glare(Places(np.zeros((1, 3)), up, up), np.array([1]), 0.3)
    # the camera is above: facets of angle a send the light of a lamp at 2 a to it; tan a is 0.3 at the border
    border = 2 * math.atan(0.3)
    lamps = [
        (1000 * math.sin(angle), 0, 1000 * math.cos(angle))
        for angle in (0.0, border - 0.01, border + 0.01, 3.0)
    ]
    assert glare.meets(np.array(lamps), 2).tolist() == [
        [False, True],
        [False, True],
        [False, False],
        [False, False],
    ]


def test_lamps_that_metal_mirrors_are_left_out():
    lamp = [[30.0, 20.0, 900.0]]
    # camera and lamp above the face: its mirror image is in the image
    matt = plan_light(ABOVE, step(), Lighting(LampBox((-300, -300, 200), (300, 300, 600))))
    metal = plan_light(
        ABOVE,
        step(),
        Lighting(LampBox((-300, -300, 200), (300, 300, 600)), material=Material("metal", 0.05)),
    )
    assert matt.complete
    for lamps in metal.lamps:
        eye = np.array([10.0, 20, 590])
        for y in (0.0, 20.0, 40.0):
            point = np.array([30.0, y, 10.0])
            half = sum((way - point) / np.linalg.norm(way - point) for way in (eye, lamps))
            assert np.hypot(*half[:2]) / half[2] > 0.05
    mirrored = plan_light(ABOVE, step(), Lighting(lamp, material=Material("metal", 1.0)))
    assert "mirrored" in mirrored.unlit[0]["rim"]


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: DiffuseDome(100, 120, 200), "hole_mm must be below diameter_mm, 100. Got 120."),
        (lambda: DiffuseDome(100, 20, 40), "distance_mm must be above half of diameter_mm, 50."),
        (lambda: RingLight(90, 60, 20), "inner_mm must be below outer_mm, 60. Got 90."),
        (lambda: CoaxialLight(-1.0, 20), "side_mm must be finite and positive. Got -1.0."),
        (lambda: Material("glass"), "material must be matt or metal. Got 'glass'."),
        (lambda: Material("metal", 2.0), "roughness must be in [0.02, 1]. Got 2.0."),
        (lambda: Lighting("coaxial", together=True), "together must be False for a light that"),
        (
            lambda: Lighting([[1, 2, 3]], together=True, material=METAL),
            "together must be False for metal",
        ),
    ],
)
def test_bad_lights_are_refused_in_one_line(make, text):
    with pytest.raises(RequestError) as error:
        make()
    assert text in str(error.value)
