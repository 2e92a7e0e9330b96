"""What `predict` says at the poses of a plan is what the plan says there: both resolve and judge alike."""

import math
from dataclasses import replace
from functools import cache

import pytest
from plan_examples import BRIEF

from aspectgraph import EntityError, read_solid
from planner import (
    Camera,
    Dimension,
    Effort,
    InspectionOptions,
    PoseUncertainty,
    ReasonKind,
    RequestError,
    look_at,
    plan_inspection,
    predict,
    predict_poses,
    read_plan,
    read_poses,
)
from planner.camera.pose import checked_poses
from planner.resolve_request import resolve_targets

CAMERA = Camera.named("basler-acA2440-20gm-8mm")
SIGMA = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
EFFORT = replace(BRIEF, witnesses=2)
OPTIONS = InspectionOptions(effort=EFFORT)
BLOCK = "examples/two_pocket_block.off"
RIM = [[60, 20, 10], [60, 40, 10]]
HEIGHT = Dimension.distance([[60, 20, 30], [60, 40, 30]], RIM, max_error_mm=0.05)
CASES = {
    "bare ids": (BLOCK, {"first": 25, "second": 27}),
    "a named edge": (BLOCK, {"rim": RIM}),
    "an edge beside a dimension": (BLOCK, {"rim": RIM, "height": HEIGHT}),
    "a part of mfcad": ("examples/mfcad_6-11-11-19.step", {"e0": 0, "e5": 5, "e9": 9}),
}


@cache
def solid_of(path):
    return read_solid(path)


@cache
def plan_of(case):
    path, wanted = CASES[case]
    return plan_inspection(solid_of(path), wanted, CAMERA, SIGMA, accuracy=0.95, effort=EFFORT)


@pytest.mark.parametrize("case", CASES)
def test_a_pose_of_a_plan_is_predicted_as_the_plan_states_it(case):
    path, wanted = CASES[case]
    plan = plan_of(case)
    assert plan.settings
    for setting in plan.settings:
        told = predict(
            solid_of(path), wanted, setting.cam2world, CAMERA, SIGMA, accuracy=0.95, options=OPTIONS
        )
        for name in setting.entities:
            row = told[name]
            assert row.inspected
            assert row.probability == pytest.approx(setting.probability[name], abs=1e-9)
        # the margins of a setting are the least of its targets
        for constraint, margin in setting.margins.items():
            own = [told[name].margins.get(constraint, math.inf) for name in setting.entities]
            assert min(own) == pytest.approx(margin, abs=1e-6), constraint


@pytest.mark.parametrize("wanted", [{"no": 10_000}, {"rim": [[0, 0, 0], [1, 2, 3]]}])
def test_what_a_plan_refuses_is_refused_in_the_same_words(wanted):
    block = solid_of(BLOCK)
    pose = plan_of("a named edge").settings[0].cam2world
    with pytest.raises((RequestError, EntityError)) as by_plan:
        plan_inspection(block, wanted, CAMERA, SIGMA, effort=EFFORT)
    with pytest.raises((RequestError, EntityError)) as by_predict:
        predict(block, wanted, pose, CAMERA, SIGMA, options=OPTIONS)
    assert type(by_predict.value) is type(by_plan.value)
    assert str(by_predict.value) == str(by_plan.value)
    assert "\n" not in str(by_predict.value)


@pytest.mark.parametrize("most", [1, 2])
def test_the_effort_says_how_many_witnesses_are_offered(most):
    # the pocket is 20 mm wide at its mouth (y = 60) and at its floor (y = 50)
    width = Dimension("distance", (25, 27), tolerance=(-0.1, 0.1), alternatives=((28, 30),))
    options = InspectionOptions(effort=Effort(witnesses=most), accuracy=0.95)
    (target,) = resolve_targets(solid_of(BLOCK), {"width": width}, CAMERA, options).targets
    assert len(target.witnesses) == most


SLOT = [[-325, -20, 0], [-245, -20, 0]]


@pytest.mark.parametrize(
    "wanted",
    [
        {"slot": SLOT},
        {"slot": Dimension.length(SLOT, tolerance_mm=(-5.0, 5.0))},
        {"slot": SLOT, "bore": Dimension.diameter("r15", tolerance_mm=(-1.0, 1.0))},
    ],
    ids=["an edge", "a length with a tolerance", "an edge beside a dimension"],
)
def test_an_edge_that_a_plan_refuses_for_its_corners_is_refused_by_predict(wanted):
    # of CTC-01: both ends of the slot's side pass into tangent arcs, so it has no corner to measure to
    solid = solid_of("examples/nist_ctc_01_ap242.stp")
    plan = plan_inspection(solid, wanted, CAMERA, SIGMA, accuracy=0.95, effort=EFFORT)
    assert plan.uninspectable["slot"].kind is ReasonKind.NO_CORNER
    assert "ends in a tangent arc" in plan.uninspectable["slot"]
    pose = look_at([[-285, -20, 300]], [-285, -20, 0])[0]
    told = predict(solid, wanted, pose, CAMERA, SIGMA, accuracy=0.95, options=OPTIONS)["slot"]
    assert not told.inspected
    # all of the 25 degrees that are required are missing
    assert told.missed["corner_deg"] == pytest.approx(25.0)
    assert math.isnan(told.probability)


# What `predict` says at the poses of a plan is what the plan says: bare edges, dimensions, and
# any effort.


POCKETS = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
STEP = Dimension.distance(
    [[50, 20, 10], [50, 40, 10]], [[60, 20, 10], [60, 40, 10]], max_error_mm=0.08
)
BOSS = {
    "left": [[-45, -25.981, 50], [-45, 25.981, 50]],
    "right": [[45, -25.981, 50], [45, 25.981, 50]],
}
ACROSS = Dimension.distance(BOSS["left"], BOSS["right"], max_error_mm=0.5)


@pytest.mark.parametrize("witnesses", [1, 12])
@pytest.mark.parametrize(
    ("part", "wanted"),
    [
        ("two_pocket_block.off", POCKETS),
        ("two_pocket_block.off", {"step": STEP, **POCKETS}),
        ("mfcad_6-11-11-19.step", {"a": 1, "b": 3, "c": 5}),
        ("nist_ctc_01_ap242.stp", {"across": ACROSS, **BOSS}),
    ],
)
def test_a_prediction_at_a_planned_pose_is_that_of_the_plan(part, wanted, witnesses):
    solid = read_solid(f"examples/{part}")
    effort = replace(BRIEF, witnesses=witnesses)
    plan = plan_inspection(solid, wanted, CAMERA, SIGMA, accuracy=0.95, effort=effort)
    assert plan.settings
    options = InspectionOptions(effort=effort)
    for setting in plan.settings:
        told = predict(
            solid, wanted, setting.cam2world, CAMERA, SIGMA, accuracy=0.95, options=options
        )
        for name, probability in setting.probability.items():
            assert told[name].inspected
            assert told[name].probability == pytest.approx(probability, abs=1e-9)


@pytest.mark.parametrize("mm", [100.0, 5000.0])
def test_from_outside_the_workspace_nothing_is_said_to_be_hidden(mm):
    """The rim is in plain view from above, however far the camera is; it is too far to be in focus there."""
    workspace = ((-60.0, -60.0, -60.0), (120.0, 120.0, 60.0))
    options = replace(OPTIONS, workspace=workspace)
    pose = look_at((60.0, 30.0, 60.0 + mm), (60.0, 30.0, 10.0))[0]
    said = predict(solid_of(BLOCK), {"rim": RIM}, pose, CAMERA, SIGMA, options=options)["rim"]
    assert not said.observable
    assert said.missed["workspace_mm"] == pytest.approx(mm)
    assert "visibility" not in said.missed
    why = said.reason(0.9)
    assert "hidden" not in why
    assert f"outside the workspace by {mm:.0f} mm" in why


def test_poses_of_a_file_are_taken_as_they_are_read():
    """With or without taking them out; and a pose with a name is a pose."""
    block = read_solid("examples/two_pocket_block.off")
    made = read_plan("examples/two_pocket_block_plan.json")
    read = read_poses("examples/two_pocket_block_plan.json")
    assert checked_poses(read) == read.poses
    how = {"camera": made.camera, "pose_uncertainty": made.pose_uncertainty, "accuracy": 0.95}
    wanted = {"e1": made.entities["e1"]}
    predicted = predict_poses(block, wanted, read, **how)
    assert predicted.poses == read.poses
    assert predicted.predictions[0] == predict(block, wanted, read.poses[0], **how)
    planned = plan_inspection(block, wanted, poses=read, **how)
    assert len(planned.settings) == 1
    assert planned.request.poses == read.poses
