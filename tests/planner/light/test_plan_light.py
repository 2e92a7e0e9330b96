"""Lamps for plans: known answers on a block and a step, bad input, and a check by rays."""

import pickle
import re
import time
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from contrast_lamps import contrast_lamps
from holed_plate import FRONT, HEIGHT, HOLES, holed_plate
from lit_parts import RIM, block, step
from plan_examples import CAMERA, plan, setting

from aspectgraph import LightError, compute_light, contrast, read_solid, resolve_entities
from aspectgraph.cells.arrays import Cell
from aspectgraph.light import silhouettes_from
from aspectgraph.solid.solid import RayScene
from errors.measurands import Circle, Line
from planner import InspectionOptions, RequestError, RingSpace, SphereRegion, plan_light
from planner.light import plan_light as fewest
from planner.light.area_lights import AREA_LIGHTS
from planner.light.corner_light import LampSets, demands_of, seen_as, sites_of
from planner.light.light_plan import LightPlan
from planner.light.lighting import LampBox, LampDome, Lighting, Served
from planner.light.plan_light import LampSearch
from planner.progress import TimeIsUpError, TimeLeft
from planner.request.part_entities import parts_of
from planner.request.targets import edge_target

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


def test_lamps_are_numbered_in_the_order_of_images():
    """Whichever face the first camera sees, its image has the first lamp; given lamps keep their order."""
    two_faces = side_plan()
    for settings in (two_faces.settings, two_faces.settings[::-1]):
        light = plan_light(replace(two_faces, settings=settings), block(), AROUND)
        assert [image.lamps for images in light.images for image in images] == [(0,), (1,)]
        is_left = [light.lamps[0, 0] < 0, light.lamps[1, 0] < 0]
        assert is_left == ["left" in setting.entities for setting in settings]
    given = [(680.0, 25.0, 30.0), (-600.0, 25.0, 30.0)]
    light = plan_light(two_faces, block(), given)
    assert light.lamps.tolist() == [list(lamp) for lamp in given]
    assert [images[0].lamps for images in light.images] == [(1,), (0,)]


def test_what_no_place_shows_is_told():
    found = contrast_lamps(side_plan(), block(), LampBox((90, -50, 0), (300, 90, 300)))
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
    assert contrast_lamps(one, block(), [even, behind]).unlit[0] == {
        "top front": "none of 2 lamps shows it: 2 with a contrast under 0.1."
    }
    found = contrast_lamps(one, block(), [even, behind, good])
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
    assert contrast_lamps(one, block(), grazing).unlit[0] == {
        "top front": "the lamp does not show it: 1 with a step under 0.1."
    }
    assert contrast_lamps(one, block(), grazing, step=0.007).unlit[0]
    found = contrast_lamps(one, block(), grazing, step=0.005)
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
    found = contrast_lamps(ABOVE, step(), [above])
    assert found.unlit[0]["rim"].endswith(
        "1 not lighting all of it, or no contrast with its background."
    )
    # a lamp so low on the left leaves what is beside the rim in the shadow of the step
    found = contrast_lamps(ABOVE, step(), [above, beside])
    assert found.lamps.tolist() == [list(beside)]
    assert found.images[0][0].contrast["rim"] == 1.0
    assert contrast_lamps(ABOVE, step(), LampBox((-100, -100, 20), (0, 100, 60))).complete


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


def test_of_lamps_that_do_the_same_one_is_preferred_that_surely_registers():
    """Two places show both pairs of one setting, the first with the larger step, but with hardly enough edges."""
    pairs = [SimpleNamespace(setting=0), SimpleNamespace(setting=0)]
    served = SimpleNamespace(pairs=pairs, contrast=np.full((2, 2), 0.5))
    served.step = np.array([[0.9, 0.9], [0.3, 0.3]])
    served.reserve = np.array([[0.02, 0.3], [0.2, 0.3]])
    jobs = [(0, 1)]
    assert fewest._covered(served, jobs) == ([1], [(0, 1, [0, 1])], 1)
    # if neither does or both do, the step decides
    for reserve in (0.02, 0.2):
        served.reserve = np.full((2, 2), reserve)
        assert fewest._covered(served, jobs)[0] == [0]
    # fewer lamps come first
    served.contrast = np.array([[0.5, 0.5], [0.5, 0.0]])
    served.reserve = np.array([[0.02, 0.02], [0.2, -1.0]])
    assert fewest._covered(served, jobs)[0] == [0]


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
            "lamps must be positions, a LampBox, a LampDome, a light with an area, 'ring', ",
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
    with pytest.raises(LightError, match=r"outside the part\. Got \[0\.0, 0\.0, 0\.0\] mm on its"):
        plan_light(plan(), block(), np.zeros((3, 3)))
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


# The bound on lamps against all covers, and the spaces of lamps against points drawn in them.


@pytest.mark.parametrize("listed", [14, 0])
@pytest.mark.parametrize("seed", range(40))
def test_the_bound_is_the_least_cover_by_all_places(seed, listed, monkeypatch):
    """Only some places are known at first; ``decide`` finds another, or says truly that there is none."""
    monkeypatch.setattr(fewest, "_MOST_LISTED", listed)
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    places = np.concatenate([rng.random((12, n)) < rng.uniform(0.1, 0.6), np.eye(n, dtype=bool)])
    known = [np.eye(n, dtype=bool)[i] for i in range(n)]

    def decide(jobs):
        able = places[places[:, sorted(jobs)].all(axis=1)]
        known.extend(able[:1])
        return not len(able)

    bound = LampSearch(n, lambda: np.array(known), decide).bound()
    least = next(
        k for k in range(1, n + 1) for some in combinations(places, k) if np.any(some, axis=0).all()
    )
    assert bound == least
    assert any(np.any(some, axis=0).all() for some in combinations(np.unique(known, axis=0), least))


def test_what_stays_open_does_not_raise_the_bound():
    """Nothing is found and nothing refuted: one place might do all."""
    assert LampSearch(5, lambda: np.eye(5, dtype=bool), lambda jobs: False).bound() == 1


@pytest.mark.parametrize("n", [5, 20])
def test_without_time_nothing_is_decided_and_the_bound_says_no_more(n):
    asked = []

    def decide(jobs):
        asked.append(jobs)
        return True

    search = LampSearch(n, lambda: np.eye(n, dtype=bool), decide, lambda: len(asked) < 2)
    # two pairs are refuted: three jobs of which two exclude the third, at most
    assert search.bound() == 2
    assert len(asked) == 2


def test_light_that_is_not_known_in_time_gives_no_lamps():
    with pytest.raises(TimeIsUpError):
        fewest.chosen_lamps(Lighting(AROUND), side_plan(), block(), deadline=time.time() - 1)


def test_late_lamps_still_show_what_a_place_shows():
    """The regions are known, and then the time is up: more lamps than needed, never a lamp that shows less."""
    slow = fewest.chosen_lamps(Lighting(AROUND), side_plan(), block())
    assert slow.complete
    served = Lighting(AROUND).on_part(block(), side_plan().camera).served(side_plan(), block())
    late = fewest._chosen(
        Lighting(AROUND), served, side_plan(), (), TimeLeft(time.time() - 1), None
    )
    assert late.unlit == slow.unlit
    assert late.lower_bound <= slow.lower_bound <= len(slow.lamps) <= len(late.lamps)


@pytest.mark.parametrize("n", [15, 20])
def test_many_jobs(n):
    """A place does jobs whose numbers agree modulo 3: three places for all, and none needs to be known at first."""
    known = list(np.eye(n, dtype=bool))

    def decide(jobs):
        rest = {job % 3 for job in jobs}
        if len(rest) == 1:
            known.append(np.arange(n) % 3 == rest.pop())
        return len(rest) > 1

    assert LampSearch(n, lambda: np.array(known), decide).bound() == 3
    assert len(fewest.min_cover(np.array(known)).chosen) == 3


def test_many_jobs_of_which_all_pairs_but_no_three_go_together():
    """Sixteen jobs in pairs: eight places; no two exclude each other."""
    n = 16
    known = list(np.eye(n, dtype=bool))

    def decide(jobs):
        if len(jobs) > 2:
            return True
        known.append(np.isin(np.arange(n), list(jobs)))
        return False

    assert 2 <= LampSearch(n, lambda: np.array(known), decide).bound() <= 8


def random_cell(rng):
    """A tetrahedron about a random place."""
    corners = rng.normal(size=(4, 3)) * rng.uniform(0.1, 2) + rng.normal(size=3)
    rows = []
    for k in range(4):
        a, b, c = np.delete(corners, k, axis=0)
        normal = np.cross(b - a, c - a)
        normal *= -np.sign(normal @ (corners[k] - a)) / np.linalg.norm(normal)
        rows.append([*normal, -normal @ a])
    return Cell(np.array(rows), corners, 1.0)


def inside(cell, points):
    return (points @ cell.half_spaces[:, :3].T + cell.half_spaces[:, 3] <= 0).all(axis=1)


@pytest.mark.parametrize(
    "space", [LampBox((-1, -1, 0), (1, 0.5, 1)), LampDome((0, 0, 0), 1.0, -0.2)]
)
def test_a_cell_that_is_said_to_miss_holds_no_place(space):
    rng = np.random.default_rng(5)
    places = space.places(4000)
    low, high = space.bounds
    assert ((places >= low - 1e-9) & (places <= high + 1e-9)).all()
    missed = met = 0
    for _ in range(300):
        cell = random_cell(rng)
        if space.misses(cell):
            assert not inside(cell, places).any()
            missed += 1
        found = space.places_in(cell)
        assert inside(cell, found).all()
        if len(found):
            met += 1
            assert ((found >= low - 1e-9) & (found <= high + 1e-9)).all()
        else:
            assert inside(cell, places).mean() < 0.005
    assert missed > 60
    assert met > 60


def test_a_dome_is_spread_evenly_and_not_below_its_height():
    dome = LampDome((1, 2, 3), 10.0, 5.0)
    places = dome.places(1000) - [1, 2, 3]
    assert np.linalg.norm(places, axis=1) == pytest.approx(10.0)
    assert places[:, 2].min() >= 5.0
    # the area above a height goes with the height
    assert (places[:, 2] > 7.5).mean() == pytest.approx(0.5, abs=0.01)
    assert np.abs(places[:, :2].mean(axis=0)).max() < 0.1


# The space of a ring light: as `plan_light` says it of single poses, and known answers.


WORKSPACE = np.array([[-900.0] * 3, [900.0] * 3])


def space_of(solid, entities, contrast=0.1, least_step=0.1):
    return RingSpace(compute_light(solid, entities, contrast, WORKSPACE), CAMERA, least_step)


def test_both_floors_of_a_step_are_as_bright_from_above():
    """The rim of the upper floor is a silhouette for x < 30: 10 mm in 390 make no contrast."""
    space = space_of(step(), RIM)
    above = np.array([[10.0, 20, 400]])
    in_front = np.array([[200.0, 20, 400]])
    assert space.light.observable(above).all()
    assert not space.observable(above).any()
    # from x = 200 both faces are seen, at heights of 170 and 390 mm over them
    assert space.observable(in_front).all()
    assert not space_of(step(), RIM, contrast=0.4).observable(in_front).any()
    assert not space_of(step(), RIM, least_step=0.6).observable(in_front).any()


@pytest.mark.parametrize("part", ["block", "step", "pockets"])
def test_the_space_agrees_with_lamps_planned_for_single_poses(part):
    solid = {"block": block, "step": step}.get(
        part, lambda: read_solid("examples/two_pocket_block.off")
    )()
    edges = {f"e{edge.id}": solid.edge_points(edge.id) for edge in solid.straight_edges()}
    space = space_of(solid, resolve_entities(solid, edges))
    middle = solid.bounds.mean(axis=0)
    ways = np.random.default_rng(4).normal(size=(12, 3))
    eyes = middle + 300.0 * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    shown = space.observable(eyes)
    exact = space.light.observable(eyes)
    settings = []
    names = []
    for k, eye in enumerate(eyes):
        seen = [name for i, name in enumerate(edges) if exact[k, i]]
        settings.append(setting(tuple(eye), seen, tuple(middle), probability=1.0))
        names.append(seen)
    asked = plan(
        settings=tuple(settings),
        entities=edges,
        uninspectable=dict.fromkeys(set(edges) - set().union(*names), ""),
    )
    light = contrast_lamps(asked, solid, "ring")
    told = {
        (k, name)
        for k, images in enumerate(light.images)
        for image in images
        for name in image.contrast
    }
    found = {(k, name) for k in range(len(eyes)) for i, name in enumerate(edges) if shown[k, i]}
    assert found == told
    assert 0.3 * exact.sum() < len(found) < exact.sum()


def test_it_passes_to_other_processes_and_knows_its_parts():
    space = space_of(step(), RIM)
    eyes = np.array([[10.0, 20, 400], [200.0, 20, 400]])
    before = space.observable(eyes)
    again = pickle.loads(pickle.dumps(space))
    assert (again.observable(eyes) == before).all()
    assert (space.subset(["rim"]).observable(eyes) == before).all()
    assert space.covering_cells(["rim"]).volume == space.light.covering_cells(["rim"]).volume
    assert repr(space) == "<RingSpace of 'step': 1 entity, contrast 0.1>"
    with pytest.raises(RequestError, match=r"step must be in \[0, 1\). Got 1"):
        RingSpace(space.light, CAMERA, 1)


# What measured things of a plan consist of, found again in the part; in another part they are
# not.


PLATE = holed_plate()


def of(*geometry):
    return SimpleNamespace(geometry=geometry)


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1)])
def test_a_rim_and_an_edge_of_a_dimension_are_those_of_the_part(axis):
    (centre, radius) = HOLES["right"]
    rim, edge = parts_of(of(Circle((*centre, HEIGHT), axis, radius), Line(*FRONT)), PLATE, "it")
    assert rim.kind == "rim"
    assert rim.circle.centre == pytest.approx([*centre, HEIGHT])
    assert rim.circle.radius_mm == pytest.approx(radius)
    assert sorted(map(tuple, edge.endpoints.tolist())) == sorted(map(tuple, FRONT))
    (edge,) = parts_of(edge_target("edge", FRONT), PLATE, "edge")
    assert sorted(map(tuple, edge.endpoints.tolist())) == sorted(map(tuple, FRONT))


@pytest.mark.parametrize(
    "geometry",
    [
        Circle((*HOLES["right"][0], HEIGHT), (0, 0, 1), HOLES["right"][1] + 0.5),
        Circle((*HOLES["right"][0], HEIGHT + 0.5), (0, 0, 1), HOLES["right"][1]),
        Circle((*HOLES["right"][0], HEIGHT), (0, 1, 0), HOLES["right"][1]),
        Circle((*HOLES["right"][0], HEIGHT), (0, 0, 1), HOLES["right"][1] + 0.5, (1, 0, 0), 1.0),
        Line((0, 0, 11), (80, 0, 11)),
        # half of it lies beyond the edge
        Line((40, 0, 10), (120, 0, 10)),
    ],
)
def test_of_another_part_they_are_not_found(geometry):
    with pytest.raises(RequestError, match=r"solid must be the plan's part\."):
        parts_of(of(geometry), PLATE, "it")


def test_a_stretch_and_a_run_are_lit_as_the_whole_edge_and_rim():
    (centre, radius) = HOLES["right"]
    run = Circle((*centre, HEIGHT), (0, 0, 1), radius, (1, 0, 0), 1.0)
    stretch = Line((20, 0, 10), (40, 0, 10))
    rim, edge = parts_of(of(run, stretch), PLATE, "it")
    assert rim.kind == "rim"
    assert rim.circle.centre == pytest.approx([*centre, HEIGHT])
    assert sorted(map(tuple, edge.endpoints.tolist())) == sorted(map(tuple, FRONT))


@pytest.mark.parametrize("described", [InspectionOptions, Lighting, plan_light])
def test_docstrings_name_every_kind_of_lamp(described):
    text = described.__doc__.partition("    lamps : ")[2]
    text = re.split(r"\n    \w+(?:, \w+)* : ", text)[0]
    words = [f'"{word}"' for word in ("ring", *AREA_LIGHTS)]
    classes = ["LampBox", "LampDome", *(light.__name__ for light in AREA_LIGHTS.values())]
    assert [name for name in words + classes if name not in text] == []
