"""Lamps for plans: known answers on a block and a step, bad input, and a check by rays."""

from itertools import combinations

import numpy as np
import pytest
from lit_parts import RIM, block, step
from plan_examples import plan, setting

from aspectgraph import LightError, contrast, read_solid, resolve_entities
from aspectgraph.light import compute_light, silhouettes_from
from aspectgraph.solid.ray_scene import RayScene
from planner import RequestError, SphereRegion
from planner.light.corner_light import LampSets, sites_of
from planner.light.demands import demands_of, seen_as
from planner.light.lamps import LampBox, LampDome, LampsTogether
from planner.light.light_plan import LightPlan
from planner.light.lighting import Lighting, Served
from planner.light.plan_light import plan_light

AROUND = LampBox((-500, -500, -500), (580, 550, 560))


def one_setting(position, names, entities, target):
    return plan(
        settings=(setting(position, names, target),),
        entities=entities,
        uninspectable={},
        workspace=np.array([[-900.0] * 3, [900.0] * 3]),
    )


ABOVE = one_setting((10.0, 20.0, 400.0), ["rim"], RIM, (30.0, 20.0, 10.0))


def side_plan():
    """Two cameras at the height of the block's middle, each sees one of two opposite faces only."""
    entities = {"left": [[0.0, 0, 60], [0, 50, 60]], "right": [[80.0, 0, 60], [80, 50, 60]]}
    settings = (
        setting((-600.0, 25.0, 30.0), ["left"], (0, 25, 30)),
        setting((680.0, 25.0, 30.0), ["right"], (80, 25, 30)),
    )
    return plan(settings=settings, entities=entities, uninspectable={})


def test_opposite_faces_need_two_lamps():
    """Each face is seen alone, so it must be lit: by a lamp at x < 0, the other by one at x > 80."""
    found = plan_light(side_plan(), block(), AROUND)
    assert (len(found.lamps), found.lower_bound, found.minimal, found.complete) == (
        2,
        2,
        True,
        True,
    )
    for images, inside in zip(found.images, (lambda x: x < 0, lambda x: x > 80), strict=True):
        (image,) = images
        assert inside(found.lamps[image.lamps[0], 0])
        assert image.silhouettes == tuple(image.contrast)
    assert plan_light(side_plan(), block(), AROUND) == found


def test_what_no_place_shows_is_told():
    found = plan_light(side_plan(), block(), LampBox((90, -50, 0), (300, 90, 300)))
    assert not found.complete
    assert found.unlit[0] == {
        "left": "no position in the box of lamps lights its visible face with enough contrast and step."
    }
    assert found.images[0] == ()
    assert len(found.lamps) == found.lower_bound == 1


def test_a_back_light_shows_silhouettes_before_the_ground():
    found = plan_light(side_plan(), block(), AROUND, ground="bright")
    assert found.complete
    assert len(found.lamps) == found.lower_bound == 1


def test_fixed_lamps_by_the_formula():
    """Of the edge between y = 0 and z = 60, both faces seen: (I₁ - I₂) / (I₁ + I₂) with I ~ height over each face."""
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
    )
    even = (40.0, -300.0, 360.0)
    good = (40.0, -100.0, 360.0)
    behind = (40.0, 100.0, -10.0)
    assert plan_light(one, block(), [even, behind]).unlit[0] == {
        "top front": "none of 2 lamps shows it: 2 with a contrast under 0.1, 0 with a step under 0.1, "
        "0 not lighting all of it."
    }
    found = plan_light(one, block(), [even, behind, good])
    assert found.lamps.tolist() == [list(good)]
    assert found.images[0][0].contrast == {"top front": pytest.approx((300 - 100) / (300 + 100))}
    assert found.images[0][0].silhouettes == ()
    assert found.lower_bound == 1


def test_what_hardly_any_light_falls_on_does_not_show():
    """Heights of 40 and 10 mm over the faces give a contrast of .6, but in 5 m both are lit with .008 and less."""
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
    )
    grazing = [(5000.0, -40.0, 70.0)]
    assert plan_light(one, block(), grazing).unlit[0] == {
        "top front": "the lamp does not show it: 0 with a contrast under 0.1, 1 with a step under 0.1, "
        "0 not lighting all of it."
    }
    assert plan_light(one, block(), grazing, step=0.007).unlit[0]
    found = plan_light(one, block(), grazing, step=0.005)
    assert found.images[0][0].contrast["top front"] == pytest.approx(0.6)


def test_a_lamp_of_each_setting_is_asked_about_that_setting_only():
    one = side_plan()
    places = np.array([[-600.0, 25.0, 30.0], [680.0, 25.0, 30.0], [40.0, 25.0, 900.0]])
    every, own = (Lighting("ring").served(one, block()) for _ in range(2))
    every.keep(places[1::-1])
    own.keep_own(places[1::-1])
    # each lamp is on the other one's side
    assert (every.contrast > 0).tolist() == [[False, True], [True, False]]
    assert not own.contrast.any()
    own.keep_own(places[:2])
    every.keep(places[:2])
    assert own.contrast[2:].tolist() == np.diag(np.diag(every.contrast[2:])).tolist()
    assert (np.diag(own.step[2:]) > 0).all()


def test_ring_light():
    """At (40, -180, 620) the heights over the faces are 180 and 560: contrast 380 / 740."""
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
    )
    found = plan_light(one, block(), "ring")
    assert found.images[0][0].contrast["top front"] == pytest.approx(380 / 740)
    assert (
        plan_light(one, block(), "ring", contrast=0.52)
        .unlit[0]["top front"]
        .startswith("the ring light, at the camera or nearby, gives it")
    )
    # 30 mm beside it the heights may be 201 and 539: contrast 338 / 740 = 0.457
    near = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
        requirements={"visibility_radius_mm": 30.0},
    )
    assert plan_light(near, block(), "ring", contrast=0.5).unlit[0]
    assert plan_light(near, block(), "ring", contrast=0.4).complete


def test_a_silhouette_needs_contrast_with_what_is_behind():
    """Lit from high above, both floors of a step are as bright: 1 / (h²) differs by 2 % for 10 mm in 1000."""
    above = (20.0, 20.0, 1000.0)
    beside = (-40.0, 20.0, 20.0)
    found = plan_light(ABOVE, step(), [above])
    assert found.unlit[0]["rim"].endswith(
        "1 not lighting all of it, or no contrast with its background."
    )
    # a lamp so low on the left leaves what is beside the rim in the shadow of the step
    found = plan_light(ABOVE, step(), [above, beside])
    assert found.lamps.tolist() == [list(beside)]
    assert found.images[0][0].contrast["rim"] == 1.0
    assert plan_light(ABOVE, step(), LampBox((-100, -100, 20), (0, 100, 60))).complete


def test_edges_near_the_plane_of_a_face_are_both():
    solid = block()
    entity = resolve_entities(solid, {"e": [[0, 0, 60], [0, 50, 60]]})["e"]
    for x, radius, n in (
        (-5.0, 2.0, [0]),
        (5.0, 2.0, [1]),
        (-1.0, 2.0, [0, 1]),
        (1.0, 2.0, [0, 1]),
        (-1.0, 0.0, [0]),
    ):
        eye = np.array([x, 25.0, 600.0])
        assert [len(seen) for seen in seen_as(solid, entity, eye, radius)] == n
        if radius == 0:
            assert list(seen_as(solid, entity, eye, radius)) == [
                silhouettes_from(solid, entity, eye)
            ]


def test_a_tolerance_of_the_lamps():
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
    )
    # heights 100 and 130 over the faces: 30 / 230 is enough, but with both 20 mm off towards each other it is not
    lamp = [(40.0, -100.0, 190.0)]
    assert plan_light(one, block(), lamp).complete
    assert not plan_light(one, block(), lamp, tolerance_mm=20.0).complete


@pytest.mark.parametrize("lamps", [AROUND, LampDome((40, 25, 30), 400.0, -400.0)])
def test_rays_and_the_formula_confirm_every_lamp(lamps):
    solid = block()
    asked = plan()
    found = plan_light(asked, solid, lamps, contrast=0.2)
    assert found.complete
    assert found.minimal
    scene = RayScene(solid.vertices, solid.triangles)
    for one, images in zip(asked.settings, found.images, strict=True):
        assert sorted(name for image in images for name in image.contrast) == sorted(one.entities)
        for image in images:
            lamp = found.lamps[image.lamps[0]]
            assert scene.signed_distance(lamp[None])[0] >= 10
            for name, value in image.contrast.items():
                ends = np.array(asked.entities[name])
                points = ends[0] + np.linspace(0.05, 0.95, 9)[:, None] * (ends[1] - ends[0])
                assert (scene.cast(lamp, points - lamp)["t_hit"] > 1 - 1e-5).all()
                entity = resolve_entities(solid, {name: ends})[name]
                if name not in image.silhouettes:
                    assert value == pytest.approx(abs(contrast(solid, entity, lamp)[0]))
                    assert value >= 0.2


def test_lamps_stay_in_reach_of_a_robot():
    """A ball about (-300, 25, 60) with a radius of 200 mm, out of reach of x > 80."""
    reach = SphereRegion((-300.0, 25.0, 60.0), 200.0)
    found = plan_light(side_plan(), block(), LampBox(AROUND.low, AROUND.high, reach=reach))
    assert (reach.margin(found.lamps) > 0).all()
    assert [sorted(unlit) for unlit in found.unlit] == [[], ["right"]]
    assert found.unlit[1]["right"].startswith("no position found in the box of lamps")
    with pytest.raises(RequestError, match="reach must have a margin method"):
        LampBox((0, 0, 0), (1, 1, 1), reach="arm")


def test_the_record_comes_back():
    found = plan_light(side_plan(), block(), AROUND)
    assert LightPlan.from_dict(found.to_dict()) == found
    assert (
        repr(found)
        == "<LightPlan: 2 placed lamps (at least 2 needed), contrast 0.1, 2 images, 0 unlit>"
    )


def test_lamps_that_are_on_together_add_up():
    """Lamps square to either face, as far away: each alone has the contrast 1, both together 0."""
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
    )
    front = (40.0, -1000.0, 60.0)
    top = (40.0, 0.0, 1060.0)
    for lamp in (front, top):
        found = plan_light(one, block(), Lighting([lamp], together=True))
        assert found.images[0][0].contrast["top front"] == pytest.approx(1.0)
        assert found.together
    scene = RayScene(block().vertices, block().triangles)
    light = _light(one)
    sets = LampSets(
        scene, sites_of(light.light, light.pairs), np.array([front, top]), np.zeros((1, 3))
    )
    assert sets.shown(np.array([[0, 1]]))[0] == pytest.approx(0.0, abs=1e-12)
    # one of them may be left out, so the plan takes one
    found = plan_light(one, block(), Lighting([front, top], together=True))
    assert (len(found.lamps), found.lower_bound, found.complete) == (1, 1, True)


def test_together_by_the_formula():
    """Sums of n·(p - x) / |p - x|³ and of n·(p - x) / |p - x| at nine points; the smaller contrast counts."""
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
    )
    lamps = np.array([(-200.0, -700.0, 160.0), (300.0, -150.0, 900.0), (40.0, -250.0, 300.0)])
    values = []
    for power in (3, 1):
        for x in np.linspace(0.06, 0.94, 9) * 80.0:
            way = lamps - (x, 0.0, 60.0)
            share = 1.0 / np.linalg.norm(way, axis=1) ** power
            front = (-way[:, 1] * share).sum()
            top = (way[:, 2] * share).sum()
            values.append(abs(front - top) / (front + top))
    light = _light(one)
    scene = RayScene(block().vertices, block().triangles)
    sets = LampSets(scene, sites_of(light.light, light.pairs), lamps, np.zeros((1, 3)))
    assert sets.shown(np.array([[0, 1, 2]]))[0][0, 0] == pytest.approx(min(values))
    # lamps that may be off by a little show no more
    off = LampSets(
        scene,
        sites_of(light.light, light.pairs),
        lamps,
        np.array([[0.0, 0, 0], [0, 20, 0], [0, 0, -20]]),
    )
    assert off.shown(np.array([[0, 1, 2]]))[0][0, 0] < min(values)


def test_opposite_faces_need_two_lamps_together_too():
    """One image each, both lamps on; that a single one does it is refuted by the exact regions."""
    found = plan_light(side_plan(), block(), Lighting(AROUND, together=True))
    assert (len(found.lamps), found.lower_bound, found.complete, found.together) == (
        2,
        2,
        True,
        True,
    )
    assert [[image.lamps for image in images] for images in found.images] == [[(0, 1)], [(0, 1)]]
    assert sorted(found.lamps[:, 0] < 0) == sorted(found.lamps[:, 0] <= 80) == [False, True]
    places = [[-300, 25, 90], [40, -300, 90], [380, 25, 90]]
    fixed = plan_light(side_plan(), block(), Lighting(places, together=True))
    assert fixed.lamps[:, 0].tolist() == [-300, 380]
    assert fixed.minimal
    assert fixed.bound_proof == "All sets of fewer than 2 of the given lamps were tried."
    assert LightPlan.from_dict(fixed.to_dict()) == fixed
    dark = plan_light(side_plan(), block(), Lighting(places[:2], together=True))
    assert dark.unlit[1] == {
        "right": "of the sets tried of the given lamps, the one that shows the most targets does not show it."
    }


def test_the_earlier_name_of_lamps_that_are_on_together_still_works():
    with pytest.warns(DeprecationWarning, match=r"use Lighting\(lamps, together=True\)"):
        lamps = LampsTogether(AROUND)
    lighting = Lighting(lamps, 0.2)
    assert lighting.together
    np.testing.assert_array_equal(lighting.lamps, AROUND)
    assert lighting.contrast == 0.2


def test_the_mean_contrast_is_never_the_largest():
    """The mediant: of any lamps together, no contrast is larger than the largest of theirs."""
    one = plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        uninspectable={"top right": "", "bottom": ""},
    )
    rng = np.random.default_rng(4)
    lamps = np.array([40.0, -300.0, 400.0]) + rng.uniform(-300, 300, (12, 3)) * (1, 0.9, 0.9)
    light = _light(one)
    scene = RayScene(block().vertices, block().triangles)
    sets = LampSets(scene, sites_of(light.light, light.pairs), lamps, np.zeros((1, 3)))
    alone = sets.shown(np.arange(12)[:, None])[0][:, 0]
    trios = np.array(list(combinations(range(12), 3)))
    assert (sets.shown(trios)[0][:, 0] <= alone[trios].max(axis=1) + 1e-12).all()


def _light(one):
    solid = block()
    scene = RayScene(solid.vertices, solid.triangles)
    demands = demands_of(one, solid, scene, "dark")
    return Served(compute_light(solid, demands.entities, 0.1), scene, demands.pairs, 0.1, 0.05)


@pytest.mark.parametrize(
    ("lamps", "options", "text"),
    [
        (
            "torch",
            {},
            "lamps must be positions, a LampBox, a LampDome or 'ring'. Got 'torch'.",
        ),
        ([], {}, "lamps must be finite numbers in mm, shape (n, 3). Got []."),
        ([[1, 2]], {}, "lamps must be finite numbers in mm, shape (n, 3). Got [[1, 2]]."),
        ([[np.nan, 0, 0]], {}, "lamps must be finite"),
        (AROUND, {"ground": "grey"}, "ground must be one of dark, bright. Got 'grey'."),
        (AROUND, {"step": 1}, "step must be in [0, 1). Got 1."),
        (
            AROUND,
            {"tolerance_mm": np.inf},
            "tolerance_mm must be finite and not negative. Got inf.",
        ),
    ],
)
def test_bad_requests(lamps, options, text):
    with pytest.raises(RequestError) as error:
        plan_light(plan(), block(), lamps, **options)
    assert text in str(error.value)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: LampBox((0, 0, 0), (1, 0, 1)), "low must be below high"),
        (lambda: LampBox((0, 0), (1, 0, 1)), "corners of a box of lamps must be finite"),
        (
            lambda: LampBox((0, 0, 0), (1, 1, 1), -1),
            "clearance_mm must be finite and not negative. Got -1.",
        ),
        (lambda: LampDome((0, 0, 0), 0.0), "radius_mm must be positive. Got 0.0."),
        (lambda: LampDome((0, 0, 0), 5.0, 5.0), "lowest_mm must be below radius_mm, 5. Got 5.0."),
        (
            lambda: Lighting("ring", together=True),
            "together must be False for a ring light, which is one lamp. Got True.",
        ),
        (lambda: Lighting([[0, 0]]), "lamps must be finite numbers in mm, shape (n, 3)"),
        (
            lambda: plan_light(plan(), block(), Lighting("ring"), contrast=0.2),
            "lamps must hold contrast, step, ground and tolerance_mm where it is a Lighting. Got",
        ),
        (lambda: LampDome((0, 0, np.inf), 5.0), "the centre of a dome of lamps must be finite"),
    ],
)
def test_spaces_that_cannot_be(make, text):
    with pytest.raises(RequestError) as error:
        make()
    assert text in str(error.value)


def test_a_lamp_in_the_part_a_contrast_out_of_range_and_another_part():
    with pytest.raises(LightError, match="lamps must lie outside the part"):
        plan_light(plan(), block(), [[40.0, 25, 30]])
    with pytest.raises(LightError, match=r"contrast must lie strictly between 0 and 1\. Got 1"):
        plan_light(plan(), block(), AROUND, contrast=1)
    with pytest.raises(RequestError, match="solid must be the plan's part"):
        plan_light(plan(), read_solid("examples/two_pocket_block.off"), AROUND)


def test_a_plan_without_settings():
    empty = plan(
        settings=(),
        uninspectable=dict.fromkeys(("top front", "top right", "bottom"), "no"),
        lower_bound=0,
    )
    for lamps in (AROUND, "ring", [[500.0, 0, 0]]):
        found = plan_light(empty, block(), lamps)
        assert (len(found.lamps), found.lower_bound, found.complete) == (0, 0, True)
