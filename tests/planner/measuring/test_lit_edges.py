"""What a plan says that `measure` will find, against what it finds in rendered images."""

import pickle
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from contrast_lamps import contrast_lamps
from holed_plate import holed_plate
from measured_plate import (
    CAMERA,
    LAMP,
    POSES,
    TOP,
    crowded_bore,
    crowded_plate,
    dimensions_of,
    fine_plate,
    measured_plan,
    thick_plate,
)
from part_images import Optics, PartImages
from rendered_images import Lamp

from planner import Backlight, LampDome, Rehearsal, measure, plan_light
from planner.light.light_plan import beside, irradiance
from planner.light.lighting import Lighting
from planner.light.plan_light import chosen_lamps
from planner.measuring.lit_edges import (
    LEAST_REGISTERED,
    EndLight,
    EntityLight,
    LitEdges,
    Needed,
    TargetLight,
    _Seen,
    reads_of,
)
from planner.measuring.samples import State, circle_of, parts_of
from planner.request.registration import OWN_EDGES, RegistrationRecord

LAMPS = np.array([LAMP.place, [40.0, 25.0, 400.0], [-250.0, 25.0, 160.0], [40.0, 330.0, 100.0]])


@pytest.fixture(scope="module")
def solid():
    return thick_plate()


@pytest.fixture(scope="module")
def plan(solid):
    return measured_plan(solid, settings=1)


@pytest.fixture(scope="module")
def reads(solid):
    return LitEdges(solid, registers=True)


def image_of(lamp):
    given = {"matrix": CAMERA.matrix, "size": CAMERA.resolution, "noise": 0.005}
    images = PartImages(*fine_plate(), Optics(**given))
    return images.image(POSES[0], [Lamp(lamp)], np.random.default_rng(1))


@pytest.mark.parametrize("lamp", LAMPS)
def test_samples_are_found_where_the_lamp_shows_them(solid, plan, reads, lamp):
    """An image by a renderer of its own, at the planned pose. At the limits of steps, some samples differ."""
    results = measure(plan, solid, {1: image_of(lamp)})
    if results.failed:
        share = reads.shown_share(POSES[0], CAMERA, lamp[None], 0.0, np.full((1, 1), np.inf))
        assert share[0, 0] < LEAST_REGISTERED
        return
    for result in results:
        light = reads.of_target(POSES[0], CAMERA, plan.targets[result.name], 0.0)
        (reading,) = result.readings
        for entity, points in zip(light.entities, reading.points, strict=True):
            found = entity.sides.found(lamp[None])[0] & entity.usable
            at = np.abs(points["share"][:, None] - entity.share).argmin(axis=0)
            is_found = np.isin(points["state"][at], (State.FOUND, State.OUTLIER))
            # what is promised is found; more may be
            assert np.mean(is_found[found]) > 0.95 if found.any() else True
        if light.shown(lamp[None])[0]:
            assert result.measured, result.reason


def test_a_target_that_is_hidden_has_a_reason(solid, plan, reads):
    """From below, at most half of the upper rim is seen through the bore."""
    below = POSES[0].copy()
    below[:3, 3] = [40.0, 25.0, -300.0]
    below[:3, :3] = np.diag([1.0, 1.0, 1.0])
    light = reads.of_target(below, CAMERA, plan.targets["left"], 0.0)
    share = re.match(
        r"only (\d+) % of r0 is visible and 5 px apart from other lines, and 80 % must be$",
        light.reason,
    )
    assert share
    assert int(share[1]) <= 50
    assert not light.shown(LAMPS).any()


def test_a_twelfth_that_is_hidden_is_named():
    usable = np.arange(100) >= 9
    share = np.linspace(0.0, 1.0, 100)
    light = TargetLight([EntityLight("r3", share, usable, SimpleNamespace())])
    assert (
        light.reason == "too little of a twelfth of r3 is visible and 5 px apart from other lines"
    )


def test_lamps_of_a_plan_show_what_is_read(solid, plan):
    """Each lamp that is chosen shows enough of its targets; without the check, lamps may be others."""
    reads = reads_of(solid, RegistrationRecord(OWN_EDGES, 0.02))
    assert reads.registers
    dome = Lighting(LampDome((40.0, 25.0, TOP), 330.0, 20.0))
    light = chosen_lamps(dome, plan, solid, reads=reads)
    assert light.complete
    for image in light.images[0]:
        lamps = light.lamps[list(image.lamps)]
        for name in image.contrast:
            target = reads.of_target(POSES[0], CAMERA, plan.targets[name], 0.0)
            assert target.shown(lamps).all()
            whites = target.white(lamps)[:, None]
            assert (reads.reserve(POSES[0], CAMERA, lamps, 0.0, whites) >= 0).all()


@pytest.fixture(scope="module")
def crowded():
    """A plate, and a plan of a bore next to three others and of the distance of two long edges."""
    solid = crowded_plate()
    wanted = {"bore": crowded_bore(solid), "width": dimensions_of(thick_plate())["width"]}
    return solid, measured_plan(solid, tuple(wanted), settings=1, dimensions=wanted)


@pytest.mark.parametrize("lamps", [[[40.0, 25.0, 400.0]], "ring"])
def test_lamps_are_complete_only_if_rendered_images_give_every_value(crowded, lamps, tmp_path):
    """Contrast shows both targets. A third of the rim of the bore lies next to those of others, so it is not read."""
    solid, plan = crowded
    assert contrast_lamps(plan, solid, lamps).complete
    light = plan_light(plan, solid, lamps)
    lit = replace(plan, light=light)
    Rehearsal(lit, solid).write(tmp_path / "images")
    results = measure(lit, solid, tmp_path / "images")
    assert {result.name for result in results if result.measured} == {"width"}
    assert not light.complete
    assert set(light.images[0][0].contrast) == {"width"}
    share = re.fullmatch(
        r"only (\d+) % of r0 is visible and 5 px apart from other lines, and 80 % must be\.",
        light.unlit[0]["bore"],
    )
    (bore,) = (result for result in results if result.name == "bore")
    found = re.search(r"only (\d+) % of rim r0 was found", bore.reason)
    assert int(share[1]) == pytest.approx(int(found[1]), abs=3)


def test_a_ring_with_an_area_is_complete_only_if_every_target_is_read(crowded):
    """It shows the same lines as the lamp on the camera, so the same rim is next to others."""
    solid, plan = crowded
    assert contrast_lamps(plan, solid, "ring-light").complete
    light = plan_light(plan, solid, "ring-light")
    assert set(light.images[0][0].contrast) == {"width"}
    assert "% of r0 shows 5 px apart from other lines" in light.unlit[0]["bore"]


def test_what_measuring_lacks_under_a_lamp_is_said(solid, plan):
    """The first lamp leaves a part of the left rim in shadow, the third one shows neither side of it."""
    assert contrast_lamps(plan, solid, LAMPS[:1]).complete
    why = "'measure' would find too little of it."
    alone = plan_light(plan, solid, LAMPS[:1])
    assert alone.unlit[0] == dict.fromkeys(["left", "apart"], f"the lamp shows it, but {why}")
    both = plan_light(plan, solid, LAMPS[[0, 2]])
    counts = f"1 with a contrast under 0.1, 1 under which {why}"
    assert both.unlit[0]["left"] == f"none of 2 lamps shows it: {counts}"


@pytest.mark.parametrize(("lamps", "start"), [(LAMPS[1:2], "the lamp"), ("ring", "the ring light")])
def test_an_image_that_is_not_registered_is_said_to_be_so(solid, plan, monkeypatch, lamps, start):
    """With the reserve of 0.08, more than all edges would have to show."""
    assert plan_light(plan, solid, lamps).complete
    monkeypatch.setattr("planner.measuring.lit_edges.LEAST_REGISTERED", 0.95)
    edges = "'measure' would find too few of the part's edges to register the image"
    assert plan_light(plan, solid, lamps).unlit[0] == dict.fromkeys(
        plan.targets, f"{start} shows it, but {edges}."
    )


def test_a_light_with_an_area_is_asked_for_what_is_read(solid, plan, reads):
    """Straight from above, a lower rim bounds the bright disc. The upper one is dark on both sides."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    target = plan.targets["left"]
    pose[:3, 3] = [*target.geometry[0].centre[:2], 300.0]
    under = Backlight.under(solid)
    text = reads.unread(pose, CAMERA, target, under)
    assert re.match(r"none of r\d is shown, and 88 % must be", text)
    away = pose.copy()
    away[2, 3] = 30_000.0
    assert "is too short" in reads.unread(away, CAMERA, target, under)
    outline = plan.targets["width"]
    pose[:3, 3] = [*np.mean(solid.bounds, axis=0)[:2], 330.0]
    assert reads.unread(pose, CAMERA, outline, under) == ""


def test_rims_that_show_too_near_to_each_other_are_said_to_be_so(monkeypatch):
    """Through a plate of 10 mm, the wall of a bore is r h / (d - h) wide: less than 2 px where a pixel is 0.17 mm."""
    plate = holed_plate()
    rim = min(plate.rims(), key=lambda one: (one.centre[2], one.centre[0]))
    target = SimpleNamespace(name="left", geometry=(circle_of(rim),))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = [*rim.centre[:2], 300.0]
    both = LitEdges(plate, registers=True)
    # a light that shows all there is
    monkeypatch.setattr(LitEdges, "_lit", lambda self, edges, samples, *_: samples.visible)
    text = both.unread(pose, CAMERA, target, Backlight.under(plate))
    assert text.startswith(f"none of {rim.id} shows 5 px apart from other lines")


def test_a_length_that_is_promised_is_measured(solid, reads):
    """The lines at both corners must be found, too. A lamp shows them or not, whatever it shows of the edge."""
    plan = measured_plan(solid, ["long"], settings=1)
    lamps = np.array(
        [[40.0, -300.0, 60.0], [150.0, -260.0, 340.0], LAMP.place, [40.0, 25.0, 400.0]]
    )
    light = reads.of_target(POSES[0], CAMERA, plan.targets["long"], 0.0)
    assert not light.reason
    assert [len(end.arms) for end in light.ends] == [2, 2]
    promised = light.shown(lamps)
    results = [measure(plan, solid, {1: image_of(lamp)}) for lamp in lamps]
    measured = [any(result.measured for result in each) for each in results]
    assert all(np.array(measured)[promised])
    assert promised.any()


def test_a_short_rim_has_fewer_parts():
    """A twelfth of a rim of 72 px is two points, which may be outliers; a sixth is 12 px."""
    assert [parts_of(n) for n in (1, 9, 29, 57, 58, 500)] == [1, 1, 6, 11, 12, 12]
    usable = np.arange(29) >= 3
    share = np.linspace(0.0, 1.0, 29)
    rim = EntityLight("r3", share, usable, SimpleNamespace(), Needed(parts_of(29)))
    assert not rim.reason
    assert EntityLight("r3", share, usable, SimpleNamespace()).reason
    later = np.arange(29) >= 5
    shorter = EntityLight("r3", share, later, SimpleNamespace(), Needed(parts_of(29), 0.5))
    assert (
        shorter.reason == "too little of a sixth of r3 is visible and 5 px apart from other lines"
    )


def test_lamps_keep_a_reserve_only_as_far_as_other_lines_leave_one():
    """Where 83 of 100 samples are apart, a lamp must show all of these; where all are, 88 of them."""
    numbers = np.arange(100)
    rim = EntityLight("r3", numbers / 99, numbers % 6 > 0, SimpleNamespace())
    assert not rim.reason
    assert rim.covers((numbers != 7)[None]).tolist() == [False]
    assert rim.covers((numbers != 6)[None]).tolist() == [True]
    free = EntityLight("r3", numbers / 99, numbers >= 0, SimpleNamespace())
    assert free.covers(np.stack([numbers % 9 > 0, numbers % 8 > 0])).tolist() == [True, False]
    # 79 are too few, whatever a lamp shows
    crowded = EntityLight("r3", numbers / 99, (numbers % 5 > 0) & (numbers > 1), SimpleNamespace())
    assert crowded.reason.startswith("only 79 % of r3 is visible")


def line_shown_by(name, lamps):
    """A line of which each lamp shows all or nothing."""
    shown = np.array(lamps, dtype=bool)
    sides = SimpleNamespace(
        found=lambda places: np.repeat(shown[places[:, :1].astype(int)], 100, 1)
    )
    usable = np.ones(100, dtype=bool)
    return EntityLight(name, np.linspace(0.0, 1.0, 100), usable, sides, Needed(apart=0.5))


def test_one_line_at_each_corner_is_enough():
    """Lamp k is at (k, 0, 0). The last one shows the edge, but no line at its second end."""
    lamps = np.arange(5)[:, None] * np.array([[1.0, 0.0, 0.0]])
    edge = line_shown_by("e1", [1, 1, 1, 0, 1])
    first = EndLight("e1", [line_shown_by("e2", [1, 0, 1, 1, 1])])
    second = EndLight(
        "e1", [line_shown_by("e3", [1, 1, 0, 1, 0]), line_shown_by("e4", [0, 1, 1, 1, 0])]
    )
    light = TargetLight([edge], [first, second])
    assert light.shown(lamps).tolist() == [True, False, True, False, False]
    assert second.shown(lamps).tolist() == [True, True, True, True, False]


def test_a_corner_without_a_line_is_said_to_have_none(solid, reads):
    plan = measured_plan(solid, ["long"], settings=1)
    light = reads.of_target(POSES[0], CAMERA, plan.targets["long"], 0.0)
    name = light.entities[0].name
    bare = TargetLight(light.entities, [EndLight(name, [])])
    assert bare.reason == f"no straight line leaves an end of {name} at 20° in the image"
    assert not bare.shown(LAMPS).any()
    hidden = replace(light.ends[0].arms[0], usable=np.zeros_like(light.ends[0].arms[0].usable))
    text = TargetLight(light.entities, [EndLight(name, [hidden])]).reason
    assert re.fullmatch(
        rf"no line that leaves a corner of {name} is found: none of e\d+ is visible and 5 px apart from other lines, "
        "and 58 % must be",
        text,
    )


def test_a_light_with_an_area_is_asked_for_the_corners_of_a_length(solid, reads, monkeypatch):
    plan = measured_plan(solid, ["long"], settings=1)
    target = plan.targets["long"]
    under = Backlight.under(solid)
    monkeypatch.setattr(LitEdges, "_lit", lambda self, edges, samples, *_: samples.visible)
    assert reads.unread(POSES[0], CAMERA, target, under) == ""
    front = reads.of_target(POSES[0], CAMERA, target, 0.0).entities[0].name

    def front_only(self, edges, samples, *view):
        names = np.array([edge.name == front for edge in edges])
        return samples.visible & names[samples.edge]

    monkeypatch.setattr(LitEdges, "_lit", front_only)
    text = reads.unread(POSES[0], CAMERA, target, under)
    assert text.startswith(f"no line that leaves a corner of {front} is found: none of e")


def test_it_crosses_process_boundaries(solid, plan, reads):
    again = pickle.loads(pickle.dumps(reads))
    light = again.of_target(POSES[0], CAMERA, plan.targets["left"], 0.0)
    mine = reads.of_target(POSES[0], CAMERA, plan.targets["left"], 0.0)
    assert np.array_equal(light.shown(LAMPS), mine.shown(LAMPS))


def test_what_is_overexposed_registers_nothing(plan, reads):
    """Irradiances are those of the plan's exposures; edges in more light than white are lost, the others stay."""
    lamp = LAMPS[0]
    target = reads.of_target(POSES[0], CAMERA, plan.targets["left"], 0.0)
    (white,) = target.white(lamp[None])
    scene = reads.model.edges.scene
    pixels = beside(CAMERA, POSES[0], plan.targets["left"].points)
    light = irradiance(scene, POSES[0], CAMERA, pixels.reshape(-1, 2), lamp[None])
    assert white == pytest.approx(light.max() / 0.8, rel=0.02)
    whites = np.array([[np.inf, white, 0.5 * white, 0.0]])
    (shares,) = reads.shown_share(POSES[0], CAMERA, lamp[None], 0.0, whites)
    assert (np.diff(shares) <= 0).all()
    assert shares[0] > LEAST_REGISTERED
    # what shows is lit
    assert shares[3] == 0.0


def test_the_brightest_is_that_of_all_that_is_seen(plan, reads):
    """The rays to the nearest places alone, and those to all places, some of which do not count."""
    for target in plan.targets.values():
        for entity in reads.of_target(POSES[0], CAMERA, target, 0.0).entities:
            some = np.arange(len(entity.usable)) % 3 > 0
            beside = entity.sides.seen(LAMPS).brighter
            assert beside.max() > 0.0
            brightest = entity.sides.brightest(LAMPS, some)
            np.testing.assert_array_equal(brightest, beside[:, some].max(axis=1))
            none = np.zeros_like(some)
            np.testing.assert_array_equal(entity.sides.brightest(LAMPS, none), 0.0)


def test_what_is_too_dark_for_the_exposure_is_not_found():
    """Contrast is not enough: an edge at three times the distance has a ninth of the light."""
    sides = np.array([[[9.0, 1.0, 1.0], [0.0, 0.9, 0.99]]])
    seen = _Seen(np.ones((1, 3), dtype=bool), sides.max(axis=1), sides)
    # 0.024 of white: 0.1 is enough of 4, 0.01 is not of 1
    np.testing.assert_array_equal(seen.under(np.array([10.0])), [[True, False, False]])
    np.testing.assert_array_equal(seen.under(np.array([4.0])), [[False, True, False]])
    assert seen.under(np.array([np.inf])).all()
    # before a bright background, white less the face
    bright = _Seen(np.ones((1, 1), dtype=bool), np.array([[1.0]]), np.array([[[1.0], [np.inf]]]))
    np.testing.assert_array_equal(bright.under(np.array([1.01])), [[False]])
    np.testing.assert_array_equal(bright.under(np.array([2.0])), [[True]])


def test_all_samples_of_a_rim_are_looked_at_for_what_is_apart(solid, plan, reads):
    """Of 96 of the 152 samples of a rim, 0.802 were apart, and `measure` found 0.796 of all: it needs 0.8."""
    edge = reads.model.entity(plan.targets["left"].geometry[0], "left")
    samples = reads.model.edges.samples(POSES[0], CAMERA, [edge], 4.0)
    assert 96 < len(samples.share) <= 192
    light = reads.of_target(POSES[0], CAMERA, plan.targets["left"], 0.0)
    assert len(light.entities[0].share) == len(samples.share)
