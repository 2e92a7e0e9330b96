"""A plan of given poses is the smallest cover by them, as trying all of their subsets finds it."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from plan_examples import BRIEF
from scipy.spatial.transform import Rotation

from aspectgraph import compute_regions, read_solid
from planner import (
    Backlight,
    Camera,
    Dimension,
    GivenPose,
    InspectionOptions,
    PoseUncertainty,
    Registration,
    RequestError,
    default_workspace,
    look_at,
    plan_inspection,
    predict_poses,
    read_plan,
)
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE
from planner.sensor_setting import ReasonKind

BLOCK = "examples/two_pocket_block.off"
CAMERA = Camera.named("basler-acA2440-20gm-8mm")
SIGMA = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
EDGES = {
    "e1": [[60, 20, 10], [60, 40, 10]],
    "e2": [[60, 20, 10], [60, 20, 30]],
    "e4": [[20, 60, 10], [40, 60, 10]],
    "corner": [[0, 0, 0], [0, 0, 40]],
    "below": [[0, 0, 0], [60, 0, 0]],
}
RING = np.linspace(0.0, 2 * np.pi, 9)[:-1] + 0.2
EYES = np.stack([30 + 240 * np.cos(RING), 30 + 240 * np.sin(RING), np.full(8, 170.0)], axis=1)
# one is too far away
ALL = np.concatenate([look_at(EYES, [35.0, 35.0, 15.0]), look_at([[0, 0, 900.0]], [30, 30, 0])])
GIVEN = tuple(GivenPose(f"p{k}", pose) for k, pose in enumerate(ALL))


@pytest.fixture(scope="module")
def block():
    return read_solid(BLOCK)


@pytest.fixture(scope="module")
def space(block):
    return compute_regions(block, EDGES, workspace=default_workspace(block, CAMERA))


@pytest.fixture(scope="module")
def options(space):
    return InspectionOptions(accuracy=0.95, effort=BRIEF, space=space)


@pytest.fixture(scope="module")
def plan(block, options):
    return plan_inspection(block, EDGES, CAMERA, SIGMA, options, poses=GIVEN)


@pytest.fixture(scope="module")
def predicted(block, options):
    return predict_poses(block, EDGES, GIVEN, CAMERA, SIGMA, accuracy=0.95, options=options)


def test_no_fewer_given_poses_inspect_the_same(plan, predicted):
    inspects = {
        pose.name: {name for name in EDGES if pose.name in predicted.inspecting(name)}
        for pose in GIVEN
    }
    everything = set().union(*inspects.values())
    assert set(plan.inspected) == everything
    smallest = next(
        size
        for size in range(1, len(GIVEN) + 1)
        if any(
            set().union(*(inspects[pose.name] for pose in some)) == everything
            for some in combinations(GIVEN, size)
        )
    )
    assert len(plan.settings) == plan.lower_bound == smallest > 1
    assert plan.minimal
    assert "given poses" in plan.bound_proof


def test_settings_are_given_poses_with_their_promise(plan, predicted):
    by_pose = dict(zip((pose.name for pose in GIVEN), predicted.predictions, strict=True))
    for setting in plan.settings:
        name = setting.message.removeprefix("given pose ")
        (given,) = [pose for pose in GIVEN if pose.name == name]
        assert (setting.cam2world == given.cam2world).all()
        for target in setting.entities:
            told = by_pose[name][target]
            assert told.probability == pytest.approx(setting.probability[target], abs=1e-9)
            # both are counts over displaced poses
            assert told.p_all == pytest.approx(setting.p_all[target], abs=0.02)
        assert min(setting.p_all.values()) >= plan.probability
        assert min(setting.margins.values()) >= 0


def test_what_no_given_pose_inspects_has_the_nearest_miss(plan, predicted):
    assert set(plan.uninspectable) == set(predicted.missed) == {"below"}
    shares = [targets["below"].worst_share for targets in predicted.predictions]
    nearest = GIVEN[int(np.argmin(shares))].name
    for reason in (plan.uninspectable["below"], predicted.missed["below"]):
        assert f"{nearest} is nearest: out of focus by " in reason
    assert plan.uninspectable["below"].kind is ReasonKind.OUT_OF_FOCUS


def test_a_pose_out_of_focus_says_by_how_much(block, options):
    far = [GivenPose("far", look_at([[450.0, 450.0, 380.0]], [45, 30, 10])[0])]
    told = predict_poses(block, EDGES, far, CAMERA, SIGMA, accuracy=0.95, options=options)
    plan = plan_inspection(block, EDGES, CAMERA, SIGMA, options, poses=far)
    assert not plan.settings
    # the distance along the axis of the farther end, and the limit of the lens
    limit = CAMERA.depth_of_field_mm[1]
    world2cam = np.linalg.inv(far[0].cam2world)
    ends = np.array(EDGES["e1"]) @ world2cam[:3, :3].T + world2cam[:3, 3]
    missed = told.predictions[0]["e1"].missed["focus_mm"]
    assert missed >= ends[:, 2].max() - limit > 0
    assert f"far is nearest: out of focus by {missed:.3g} mm" in plan.uninspectable["e1"]
    assert plan.uninspectable["e1"].kind is ReasonKind.OUT_OF_FOCUS


def test_the_plan_comes_back_from_its_file_with_the_poses(plan, tmp_path):
    plan.write(tmp_path / "plan.json")
    again = read_plan(tmp_path / "plan.json")
    assert again == plan
    assert [pose.name for pose in again.request.poses] == [pose.name for pose in GIVEN]
    other = replace(again.request, poses=again.request.poses[:-1])
    assert "poses" in again.request.difference(other)


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ([], "poses must hold at least one pose"),
        (
            np.zeros((1, 3, 4)),
            r"poses must have the shape \(n, 4, 4\)\. Got \(3, 4\) for 'pose_01'",
        ),
        (np.eye(4)[:3], r"\(n, 4, 4\)\. Got \(3, 4\); an array of one pose has .* \(1, 4, 4\)\.$"),
        (np.eye(4).tolist(), r"\(n, 4, 4\)\. Got \(4, 4\); an array of one pose has "),
        (5, r"poses must be a list of GivenPose or an array \(n, 4, 4\)\. Got 5\."),
        (["x"], r"poses must all be GivenPose, or arrays of numbers\. Got \['x'\]"),
        (
            [np.diag([2.0, 2.0, 2.0, 1.0])],
            r"poses must be rigid\. Got 'pose_01', .* determinant 8, and .* identity by 3\.$",
        ),
        ([np.diag([0.0, 0.0, 0.0, 1.0])], "determinant 0, and .* identity by 1"),
        ([np.diag([1.0, 1.0, -1.0, 1.0])], "'pose_01', which is mirrored: .* determinant -1"),
        ([np.diag([1.0, 1.0, np.nan, 1.0])], "'pose_01', which holds a number that is not finite"),
        (
            [np.eye(4) + np.outer(np.eye(4)[3], [0, 0, 300, 0])],
            r"poses must have the last row \[0, 0, 0, 1\].* Got \[0.0, 0.0, 300.0, 1.0\] in 'pose_01', which is tr",
        ),
        ([GIVEN[0], GIVEN[0]], "poses must have different names"),
    ],
)
def test_poses_that_are_none_are_refused(block, poses, message):
    with pytest.raises(RequestError, match=message):
        plan_inspection(block, EDGES, CAMERA, SIGMA, poses=poses)


def test_poses_are_chosen_where_the_light_shows_the_targets(block, options):
    """A backlight shows outlines only: a pose from which the edge is one is taken, although another one inspects it."""
    corner = {"corner": EDGES["corner"]}
    light = Backlight.horizontal((30.0, 30.0, -1.0), 400.0, 400.0)
    plan = plan_inspection(
        block, corner, CAMERA, SIGMA, replace(options, space=None), poses=GIVEN, lamps=light
    )
    assert plan.light is not None
    assert {setting.message for setting in plan.settings} <= {
        f"given pose {pose.name}" for pose in GIVEN
    }


# Registration: P and U of a prediction are those of the plan.


STEP = {
    "step": Dimension.distance(
        [[50, 20, 10], [50, 40, 10]], [[60, 20, 10], [60, 40, 10]], max_error_mm=0.05
    ),
    "rim": EDGES["e1"],
}


@pytest.mark.parametrize(
    "registration",
    [
        Registration.own_edges(),
        PoseUncertainty.isotropic(translation_mm=0.02, rotation_rad=2e-4),
    ],
)
def test_a_registered_prediction_is_that_of_the_plan(block, registration, stated_in_full):
    options = InspectionOptions(accuracy=0.95, effort=BRIEF, registration=registration)
    plan = plan_inspection(block, STEP, CAMERA, SIGMA, options, poses=GIVEN)
    poses = [GivenPose(f"s{k}", setting.cam2world) for k, setting in enumerate(plan.settings)]
    told = predict_poses(block, STEP, poses, CAMERA, SIGMA, accuracy=0.95, options=options)
    rows = plan.rows()
    assert plan.settings
    for row in rows:
        if row["setting"] is None:
            continue
        ours = told.predictions[row["setting"] - 1][row["name"]]
        assert ours.probability == pytest.approx(row["probability"], abs=1e-9)
        assert ours.standard_uncertainty == pytest.approx(row["standard_uncertainty"], rel=1e-9)
        assert row["standard_uncertainty"] > 0
        assert_within_chance(ours, row)


def assert_within_chance(ours, row):
    """Both bounds are of as many draws: they differ by five standard errors at most."""
    n = ours.p_all_poses
    assert n == 20_000
    error = np.sqrt(2 * row["p_all"] * (1 - row["p_all"]) / n)
    assert ours.p_all == pytest.approx(row["p_all"], abs=5 * error)
    # Clopper and Pearson for n of n: p ** n = 0.001
    assert ours.p_all <= 0.001 ** (1 / n) + 1e-12


# On the command line.


@pytest.fixture
def ros_file(tmp_path):
    poses = []
    for pose in GIVEN:
        quaternion = Rotation.from_matrix(pose.cam2world[:3, :3]).as_quat().tolist()
        place = (pose.cam2world[:3, 3] / 1000).tolist()
        poses.append(
            {
                "position": dict(zip("xyz", place, strict=True)),
                "orientation": dict(zip("xyzw", quaternion, strict=True)),
            }
        )
    path = tmp_path / "poses.json"
    path.write_text(json.dumps({"header": {"frame_id": "part"}, "poses": poses}))
    return path


WORDS = ["--camera", "basler-acA2440-20gm-8mm", "--accuracy", "95%", "--sigma-mm", "0.05"]


def test_predict_prints_what_each_pose_inspects_and_what_none_does(ros_file, tmp_path, capsys):
    entities = tmp_path / "edges.json"
    entities.write_text(json.dumps(EDGES))
    words = ["predict", BLOCK, "--poses", str(ros_file), "--entities", str(entities), *WORDS]
    assert main([*words, "--quiet"]) == INCOMPLETE
    told = capsys.readouterr().out
    assert "9 poses: poses of ROS, optical frame (z forward) to part, metres (REP 103)" in told
    assert "No pose inspects 1 of 5 targets" in told
    assert main([*words, "--quiet", "--json"]) == INCOMPLETE
    record = json.loads(capsys.readouterr().out)
    assert list(record["not_inspected"]) == ["below"]
    first = record["poses"][0]["targets"]
    assert {name: item["inspected"] for name, item in first.items()} == {
        name: item["reason"] is None for name, item in first.items()
    }


def test_predict_and_plan_name_what_is_wrong_with_poses(tmp_path, capsys):
    path = tmp_path / "poses.csv"
    path.write_text("x,y,z,qx,qy,qz,qw\n0,0,300,0,1,0,0\n")
    words = [BLOCK, "--all", "--camera", WORDS[1], "--quiet"]
    for command in (["predict"], ["plan", "--out", str(tmp_path / "plan")]):
        assert main([*command, *words, "--poses", str(path)]) == BAD_INPUT
        line = capsys.readouterr().err
        assert "poses.csv:1: header must state the unit" in line
        assert "--pose-units mm" in line
    assert main(["plan", *words, "--pose-units", "mm", "--out", str(tmp_path)]) == BAD_INPUT
    assert "--pose-units must be given with --poses" in capsys.readouterr().err


def test_plan_takes_the_fewest_of_given_poses(ros_file, tmp_path, capsys):
    entities = tmp_path / "edges.json"
    entities.write_text(json.dumps({"e1": EDGES["e1"], "e2": EDGES["e2"]}))
    out = tmp_path / "plan"
    words = ["plan", BLOCK, "--poses", str(ros_file), "--entities", str(entities), *WORDS]
    assert main([*words, "--out", str(out), "--quiet", "--simulate", "500"]) == DONE
    told = capsys.readouterr().out
    assert "Proven minimal: of the 9 given poses, no fewer inspect" in told
    assert "given poses: setting 1 is pose_0" in told
    page = (out / "report.html").read_text()
    assert "Given poses: setting 1 is pose_0" in page
    assert "It searched and moved\nno pose: the request gives 9 camera poses" in page
