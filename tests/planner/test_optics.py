"""Proposals are confirmed pose by pose by `predict`, and apertures by the formula of the Airy disk."""

import json
import math
from dataclasses import replace

import pytest
from contrast_lamps import contrast_lamps
from measured_plate import crowded_bore, crowded_plate, measured_plan

from aspectgraph import read_solid
from planner import (
    Dimension,
    Effort,
    LampDome,
    LightComparison,
    Lighting,
    PoseUncertainty,
    Registration,
    RequestError,
    compare_lights,
    optics_table,
    plan_light,
    predict,
    propose_optics,
    read_plan,
)
from planner.camera.camera import camera_parts
from planner.inspection import with_light
from planner.optics import DISTANCES_MM
from planner.options import InspectionOptions
from planner.sensor_setting import ReasonKind

BLOCK = read_solid("examples/two_pocket_block.off")
SIGMA = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
RIM = [[60, 20, 10], [60, 40, 10]]
OTHER = [[20, 60, 10], [40, 60, 10]]
WANTED = {
    "rim": RIM,
    "height": Dimension.distance([[60, 20, 30], [60, 40, 30]], RIM, max_error_mm=0.05),
}
BODIES = ["basler-acA2440-20gm", "flir-BFS-U3-244S8M"]


@pytest.fixture(scope="module")
def proposals():
    return propose_optics(BLOCK, WANTED, SIGMA, bodies=BODIES, distances_mm=[250.0, 400.0])


def test_predict_says_the_same_of_every_pose_proposed(proposals):
    able = [one for one in proposals if one.able]
    assert len(able) >= 5
    for one in able[:5]:
        for name, pose in one.poses.items():
            # as for all of them: there is a dimension
            told = predict(BLOCK, WANTED, pose, one.camera, SIGMA)[name]
            assert told.observable
            assert min(told.margins.values()) >= 0
            # three standard deviations, 0.15 mm, are kept from the ends of the depth of field
            assert told.margins["focus_mm"] >= 0.15
            assert one.probability[name] == pytest.approx(told.probability, abs=1e-9)
            assert one.share[name] == pytest.approx(
                told.expanded_uncertainty / told.permitted_error, rel=1e-9
            )


@pytest.mark.parametrize(
    "registration",
    [Registration.own_edges(), PoseUncertainty.isotropic(translation_mm=0.01, rotation_rad=1e-4)],
)
def test_with_registration_optics_are_ranked_as_a_plan_would_measure(registration):
    # of one witness, as optics are
    options = InspectionOptions(registration=registration, effort=Effort(witnesses=1))
    wide = PoseUncertainty.isotropic(translation_mm=0.3, rotation_rad=0.001)
    asked = {"bodies": BODIES[:1], "distances_mm": [250.0]}
    one = propose_optics(BLOCK, WANTED, wide, **asked, options=options)[0]
    plain = propose_optics(BLOCK, WANTED, wide, **asked)[0]
    told = predict(BLOCK, WANTED, one.poses["height"], one.camera, wide, options=options)["height"]
    assert one.probability["height"] == pytest.approx(told.conditional_probability, abs=1e-9)
    assert one.share["height"] == pytest.approx(
        told.expanded_uncertainty / told.permitted_error, rel=1e-9
    )
    assert one.share["height"] < plain.share["height"]


def test_the_best_comes_first(proposals):
    keys = [(-len(one.able), one.worst_share) for one in proposals]
    assert keys == sorted(keys)
    assert len({(one.body, one.lens) for one in proposals}) == len(proposals)
    assert all(one.working_distance_mm in (250.0, 400.0) for one in proposals)


def test_apertures_are_closed_until_diffraction_blurs_two_pixels(proposals):
    lenses = camera_parts()["lens"]
    stops = [1.4, 2, 2.8, 4, 5.6, 8, 11, 16]
    for one in proposals:
        camera = one.camera
        airy = 2.44 * 550e-6 * camera.image_distance_mm / camera.aperture_mm
        allowed = 2 * camera.pixel_pitch_mm[0]
        widest = lenses[one.lens]["widest_f_number"]
        assert airy <= allowed or camera.f_number == widest
        closer = [
            stop
            for stop in stops
            if camera.f_number < stop <= lenses[one.lens]["narrowest_f_number"]
        ]
        assert not closer or airy * closer[0] / camera.f_number > allowed


def test_image_circles_cover_the_sensor_and_lenses_can_focus(proposals):
    lenses = camera_parts()["lens"]
    for one in proposals:
        assert math.hypot(*one.camera.sensor_size_mm) <= lenses[one.lens]["image_circle_mm"]
    close = propose_optics(BLOCK, {"rim": RIM}, SIGMA, bodies=BODIES[:1], distances_mm=[150.0])
    # lenses that focus from 200 mm on are not among them
    assert {lenses[one.lens]["closest_object_mm"] for one in close} == {100.0}


def test_depth_of_field_must_hold_the_error_of_the_position():
    # the depth of field at 250 mm is some millimetres, and 3 standard deviations are 30 mm
    rough = PoseUncertainty.isotropic(translation_mm=10.0, rotation_rad=0.001)
    found = propose_optics(BLOCK, {"rim": RIM}, rough, bodies=BODIES[:1], distances_mm=[250.0])
    assert all(one.able == () and one.probability == {"rim": 0.0} for one in found)
    assert found[0].worst_share == math.inf


def test_images_too_short_are_no_proposals():
    # 20 mm are less than 5000 px from anywhere: the sensor has 2448
    options = InspectionOptions(min_length_px=5000.0)
    found = propose_optics(
        BLOCK, {"rim": RIM}, SIGMA, bodies=BODIES[:1], distances_mm=[250.0], options=options
    )
    assert not any(one.able for one in found)


def test_table_and_records(proposals):
    lines = optics_table(proposals, most=3).splitlines()
    # heading, rule and three proposals
    assert len(lines) == 5
    assert f" {len(proposals[0].able)}/2 " in lines[2]
    assert lines[2].split()[:2] == [proposals[0].body, proposals[0].lens]
    record = json.loads(json.dumps(proposals[0].to_dict()))
    assert record["able"] == list(proposals[0].able)
    assert record["camera"]["focus_distance_mm"] == proposals[0].working_distance_mm


def test_a_proposal_shows_itself(proposals):
    one = proposals[0]
    told = f"{one.body} with {one.lens}, f/{one.camera.f_number:g} at {one.working_distance_mm:g} mm: 2 of 2 targets"
    assert repr(one) == f"<OpticsProposal: {told}>"
    alone = replace(one, probability={"rim": 1.0}, share={"rim": 0.5})
    assert repr(alone).endswith("mm: 1 of 1 target>")


def test_the_same_again(proposals):
    assert (
        propose_optics(BLOCK, WANTED, SIGMA, bodies=BODIES, distances_mm=[250.0, 400.0])
        == proposals
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bodies": ["box camera"]}, "bodies must be of the catalogue.*Got 'box camera'"),
        ({"wanted": {}}, "wanted must hold at least one item"),
        ({"distances_mm": []}, "distances_mm must be finite and positive"),
        ({"distances_mm": [-1.0]}, "distances_mm must be finite and positive"),
        ({"probability": 1.0}, "probability must be in"),
    ],
)
def test_bad_requests_are_refused(changes, message):
    given = {
        "solid": BLOCK,
        "wanted": {"rim": OTHER},
        "pose_uncertainty": SIGMA,
        "distances_mm": DISTANCES_MM,
    }
    with pytest.raises(RequestError, match=message):
        propose_optics(**{**given, **changes})


def test_a_bare_edge_is_rated_as_predict_rates_it():
    proposals = propose_optics(
        BLOCK, {"rim": RIM}, SIGMA, bodies=BODIES[:1], accuracy=0.95, distances_mm=[250.0]
    )
    able = [one for one in proposals if one.able]
    assert able
    for one in able[:3]:
        told = predict(BLOCK, {"rim": RIM}, one.poses["rim"], one.camera, SIGMA, accuracy=0.95)
        assert "corner_deg" in told["rim"].margins
        assert told["rim"].margins["corner_deg"] >= 0
        assert one.probability["rim"] == pytest.approx(told["rim"].probability, abs=1e-9)


def test_lights_show_only_what_is_read_as_in_a_plan():
    """The rim of a hole that nearly touches three others is bright enough, but four lines lie too near each other."""
    solid = crowded_plate()
    plan = measured_plan(solid, ("bore",), settings=1, dimensions={"bore": crowded_bore(solid)})
    dome = LampDome((40.0, 25.0, 20.0), 300.0)
    assert contrast_lamps(plan, solid, dome).complete
    light = plan_light(plan, solid, dome)
    planned = with_light(plan, solid, Lighting(dome))
    assert planned.uninspectable["bore"].kind is ReasonKind.NOT_SHOWN
    lights = compare_lights(plan, solid)
    assert isinstance(lights, LightComparison)
    compared = {item.kind: item for item in lights}
    assert list(compared["lamps"].dark) == ["bore"]
    assert "5 px apart from other lines" in compared["lamps"].dark["bore"]
    assert light.unlit == (compared["lamps"].dark,)


def test_lights_are_compared_on_the_part_of_the_plan():
    plan = read_plan("examples/two_pocket_block_plan.json")
    with pytest.raises(RequestError) as refused:
        compare_lights(plan, crowded_plate())
    rule = "solid must be the part of the plan"
    assert str(refused.value) == f"{rule}. Got 'plate', which has another shape."


@pytest.mark.parametrize(("given", "got"), [(3, "3"), ("x", "'x'"), ([3], "a list with 3")])
def test_a_table_is_made_of_proposals(given, got):
    with pytest.raises(RequestError) as info:
        optics_table(given)
    assert str(info.value) == (
        f"proposals must be a list of OpticsProposal. Got {got}; propose_optics returns one."
    )


def test_a_table_of_no_proposal_is_its_heading():
    heading, rule = optics_table([]).splitlines()
    assert heading.startswith("body  lens  f/")
    assert set(rule) == {"-"}
