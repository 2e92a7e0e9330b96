"""Programs with a turntable: the camera is where the plan wants it, and the table is an axis of the controller."""

import csv
import io
import json
import math
import re
from functools import cache

import numpy as np
import pytest
from robot_cells import TABLE, made_cell, pose, views
from robot_programs import HOME, SIZE, block, plan_of

from planner import ArmUncertainty, Fixturing, PoseUncertainty, RequestError, robot_program
from planner.robotprogram.moves import common_angles, few_branches
from planner.robotprogram.program import JointRates, move_times
from planner.robotprogram.program_texts import program_text

AXIS = ((800.0, 60.0, 0.0), (0.0, 0.0, 1.0))
PART2BASE = pose((700.0, 0.0, 20.0))
PLAIN = Fixturing(PART2BASE, {"table": TABLE})


def turntable(**changes):
    return Fixturing(PART2BASE, {"table": TABLE}, axis=AXIS, **{"angles": 8, **changes})


@cache
def cell():
    return made_cell(fixturings={"up": turntable()}, home=HOME)


@cache
def poses():
    """Poses that are reached without a turn, and poses that are reached only with one."""
    drawn = views(np.random.default_rng(5), 60, SIZE)
    inside = cell().with_part(block())
    straight = np.array([one.reached for one in inside.reach(drawn, "up", angle=0.0)])
    turned = np.array([one.reached for one in inside.reach(drawn, "up")])
    return np.concatenate([drawn[straight][:2], drawn[turned & ~straight][:3]])


@cache
def program():
    return robot_program(plan_of(poses()), block(), cell(), speed=0.5)


def test_each_stop_has_the_camera_of_its_setting():
    assert program().complete
    (tour,) = program().tours
    inside = cell().with_part(block())
    for stop in tour.stops:
        assert stop.joints.shape == (7,)
        camera = inside.cam2world(stop.joints[None], "up")[0]
        np.testing.assert_allclose(camera, poses()[stop.setting_idx], atol=1e-3)
        flange = inside.robot.forward(stop.joints[:6])
        np.testing.assert_allclose(flange, stop.flange, atol=1e-9)
    turned = {stop.setting_idx: stop.joints[6] != 0.0 for stop in tour.stops}
    assert all(turned[k] for k in range(2, len(poses())))


def test_moves_are_free_at_a_finer_step():
    (tour,) = program().tours
    inside = cell().with_part(block())
    for move in tour.moves:
        for start, end in zip(move.joints, move.joints[1:], strict=False):
            steps = np.linspace(0.0, 1.0, 60)[:, None]
            slack = inside.slack_bound(start + steps * (end - start), "up", 1.0, share=0.5)
            assert (slack > -1e-6).all()
    for one, other in zip(tour.moves, tour.moves[1:], strict=False):
        np.testing.assert_array_equal(one.joints[-1], other.joints[0])
    home = np.append(HOME, 0.0)
    np.testing.assert_array_equal(tour.moves[0].joints[0], home)
    np.testing.assert_array_equal(tour.moves[-1].joints[-1], home)


def test_the_slowest_of_joints_and_table_sets_the_time():
    (tour,) = program().tours
    robot = cell().robot
    speeds = np.append(robot.speeds, 0.5) / 2
    rates = JointRates(speeds, np.append(robot.accelerations, 0.5))
    assert program().rates_of(tour).speeds.tolist() == speeds.tolist()
    for move in tour.moves:
        seconds = move_times(move.joints[:-1], move.joints[1:], rates).sum()
        assert move.seconds == pytest.approx(seconds)
    # a quarter turn at 0.25 rad/s and 0.5 rad/s²: the way at full speed, and half a second to reach it
    still = np.zeros(7)
    quarter = np.append(np.zeros(6), math.pi / 2)
    assert move_times(still, quarter, rates) == pytest.approx(math.pi / 2 / 0.25 + 0.5)
    slow = made_cell(fixturings={"up": turntable(turn_speed=0.05)}, home=HOME)
    assert (
        robot_program(plan_of(poses()), block(), slow, speed=0.5).seconds > program().seconds + 10
    )


def test_one_angle_of_0_is_a_part_that_does_not_turn():
    plan = plan_of(poses()[:2])
    uncertainty = ArmUncertainty(
        1e-4, part=PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=1e-3)
    )
    made = [
        robot_program(
            plan,
            block(),
            made_cell(fixturings={"up": one}, home=HOME),
            uncertainty=uncertainty,
            simulate=0,
        )
        for one in (turntable(angles=1), PLAIN)
    ]
    records = [json.loads(json.dumps(one.to_dict())) for one in made]
    for record in records:
        del record["digests"]
        record["tours"][0].pop("turntable", None)
    rows = [record["tours"][0] for record in records]
    for stop in (*rows[0]["stops"], {"joints": [0.0] * 7, "move": rows[0]["back"]}):
        assert stop["joints"].pop() == 0.0
        assert all(row.pop() == 0.0 for row in stop["move"]["joints"])
    assert records[0] == records[1]


def test_the_registration_turns_with_the_part():
    """A part that lies turned and a part that is turned are as uncertain."""
    part = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=1e-3)
    uncertainty = ArmUncertainty(1e-4, part=part)
    angle = math.radians(90.0)
    plan = plan_of(poses()[2:3])
    only = made_cell(fixturings={"up": turntable(angles=[angle])}, home=HOME)
    lies = made_cell(fixturings={"up": turntable().at(angle)}, home=HOME)
    both = [
        robot_program(plan, block(), one, uncertainty=uncertainty, simulate=0)
        for one in (only, lies)
    ]
    stops = [one.tours[0].stops[0] for one in both]
    np.testing.assert_allclose(stops[0].covariance, stops[1].covariance, atol=1e-12)
    assert stops[0].probability == pytest.approx(stops[1].probability)


def angles_of_stops():
    return [math.degrees(stop.joints[6]) for stop in program().tours[0].stops]


def test_rapid_turns_the_first_external_axis():
    text = program_text(program(), "rapid")
    found = re.findall(r"jointtarget j\w+:=\[\[(.*?)\],\[(.*?)\]\];", text)
    external = [float(one.split(",")[0]) for _, one in found]
    assert external[0] == 0.0
    moves = np.concatenate([move.joints[1:] for move in program().tours[0].moves])
    np.testing.assert_allclose(external[1:], np.degrees(moves[:, 6]), atol=1e-5)
    assert all(one.split(",")[1:] == ["9E9"] * 5 for _, one in found)
    assert "Abs(now.extax.eax_a-jHome.extax.eax_a)>" in text
    assert "turntable" in text.partition("CONST")[0]


def test_krl_turns_e1():
    text = program_text(program(), "krl")
    turned = [float(one) for one in re.findall(r"PTP \{A1 .*?,E1 (.*?)\}", text)]
    moves = np.concatenate([move.joints[1:] for move in program().tours[0].moves])
    np.testing.assert_allclose(turned, [0.0, *np.degrees(moves[:, 6])], atol=1e-5)
    assert "$AXIS_ACT.E1-(0.000000)" in text
    assert "$VEL_EXTAX[1]=50" in text


def test_ros_and_tables_have_one_joint_more():
    (round_,) = json.loads(program_text(program(), "ros"))["rounds"]
    names = [*cell().robot.segment_names, "turntable"]
    assert round_["joint_names"][-1] == names[-1]
    assert round_["start_at"]["positions"] == [*HOME, 0.0]
    trajectories = [s["joint_trajectory"] for s in round_["steps"] if "joint_trajectory" in s]
    assert all(len(one["joint_names"]) == 7 for one in trajectories)
    ends = [math.degrees(one["points"][-1]["positions"][6]) for one in trajectories]
    np.testing.assert_allclose(ends, [*angles_of_stops(), 0.0], atol=1e-9)
    lines = [
        line for line in program_text(program(), "csv").splitlines() if not line.startswith("#")
    ]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    images = [math.degrees(float(row["turntable_rad"])) for row in rows if row["image"]]
    np.testing.assert_allclose(images, angles_of_stops(), atol=1e-5)


def test_urscript_refuses_a_turntable():
    with pytest.raises(RequestError, match="format must be rapid, krl, ros, csv or json for a"):
        program_text(program(), "urscript")


def test_rounds_with_and_without_a_turntable_in_one_program():
    over = np.diag([1.0, -1.0, -1.0, 1.0])
    over[:3, 3] = [700.0, 120.0, 110.0]
    fixturings = {"up": turntable(), "turned over": Fixturing(over, {"table": TABLE})}
    own = made_cell(fixturings=fixturings, home=HOME)
    below = views(np.random.default_rng(8), 40, SIZE)
    below[:, 1:3] *= -1.0
    below[:, :3, 3] += [0.0, 120.0, 80.0]
    inside = own.with_part(block())
    only = [
        pose
        for pose, up, other in zip(
            below, inside.reach(below, "up"), inside.reach(below, "turned over"), strict=True
        )
        if other.reached and not up.reached
    ]
    made = robot_program(plan_of([*poses()[2:4], only[0]]), block(), own)
    widths = {tour.fixturing: tour.back.joints.shape[1] for tour in made.tours}
    assert widths == {"up": 7, "turned over": 6}
    text = program_text(made, "rapid")
    assert text.count("],[9E9,9E9,9E9,9E9,9E9,9E9]]") >= 2
    rows = [row for row in program_text(made, "csv").splitlines() if row.startswith("turned over")]
    assert rows
    assert all(row.endswith(",") for row in rows)


def test_few_angles_serve_all_settings():
    assert common_angles([{0.0, 1.0}, {1.0, 2.0}, {2.0}, set()]) == [1.0, 2.0]
    assert common_angles([{1.0, -1.0}]) == [1.0]
    rates = JointRates(np.ones(7), np.ones(7))
    near = np.array([[0.1, 0, 0, 0, 0, 0, 2.0], [0.2, 0, 0, 0, 0, 0, 1.0]])
    kept = few_branches([np.repeat(near, 20, axis=0), near[:1]], np.zeros(7), rates)
    # the angle that both have comes first, and no more than two dozen stay
    assert [len(one) for one in kept] == [24, 1]
    assert kept[0][:, 6].tolist().count(2.0) == 20
    assert few_branches([near[:0]], np.zeros(7), rates)[0].shape == (0, 7)
