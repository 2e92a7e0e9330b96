"""From a plan to a program: every setting reached, every move free at a fine step, P stated again."""

import csv
import io
import json
import math
import re
from functools import cache
from itertools import combinations, pairwise, product

import numpy as np
import pytest
from robot_cells import CAM2FLANGE, TABLE, made_cell, pose, views
from robot_programs import (
    ENTITIES,
    FIXTURINGS,
    HOME,
    SIZE,
    block,
    cell,
    plan_of,
    program,
    reached_poses,
)

from planner import (
    ArmUncertainty,
    Box,
    Fixturing,
    InfeasibleError,
    PoseUncertainty,
    RequestError,
    program_text,
    robot_program,
    simulate_setting,
)
from planner.robotprogram.moves import Detours, common_angles, few_branches
from planner.robotprogram.program import JointRates, move_times
from planner.robotprogram.robot_program import choose_fixturings, stated_probabilities


def stops(of):
    return [(tour, stop) for tour in of.tours for stop in tour.stops]


def test_every_setting_is_visited_once_in_a_fixturing_that_reaches_it():
    found = program()
    assert sorted(stop.setting_idx for _, stop in stops(found)) == list(range(5))
    assert found.complete
    assert [tour.fixturing for tour in found.tours] == ["up", "turned over"]
    # three settings by the better fixturing, all by both
    assert found.coverage == (3, 5)


def test_the_joints_bring_the_camera_to_the_planned_poses():
    poses = reached_poses()
    for tour, stop in stops(program()):
        part2base = FIXTURINGS[tour.fixturing].part2base
        flange = cell().robot.forward(stop.joints)
        camera = np.linalg.inv(part2base) @ flange @ CAM2FLANGE
        np.testing.assert_allclose(camera, poses[stop.setting_idx], atol=1e-4)
        np.testing.assert_allclose(flange, stop.flange, atol=1e-9)


def test_moves_are_free_at_a_fine_step():
    known = cell().with_part(block())
    for tour in program().tours:
        here = np.array(HOME)
        for move in tour.moves:
            assert np.array_equal(move.joints[0], here)
            here = move.joints[-1]
            for start, end in pairwise(move.joints):
                line = start + np.linspace(0, 1, 300)[:, None] * (end - start)
                slack = known.slack_bound(line, tour.fixturing, 1.0, share=0.5)
                assert (slack > 0).all()
        assert np.array_equal(here, HOME)


def test_a_thin_wall_is_gone_around():
    """A wall of 1 mm above the part: steps of 0.05 rad could miss it, and the arm must reach over it."""
    wall = Box((500.0, 59.5, 120.0), (950.0, 60.5, 620.0))
    fixturings = {"up": Fixturing(pose((700.0, 0.0, 20.0)), {"table": TABLE, "wall": wall})}
    own = made_cell(fixturings=fixturings, home=HOME)
    known = own.with_part(block())
    poses = views(np.random.default_rng(8), 12, SIZE)
    sides = [poses[k] for k, one in enumerate(known.reach(poses, "up")) if one.reached]
    found = robot_program(plan_of(np.array(sides[:3])), block(), own)
    moves = [move for tour in found.tours for move in tour.moves]
    assert any(move.is_detour for move in moves)
    for move in moves:
        for start, end in pairwise(move.joints):
            line = start + np.linspace(0, 1, 1000)[:, None] * (end - start)
            assert (known.slack_bound(line, "up", 1.0, share=0.5) > 0).all()


def test_times_are_those_of_the_moves_at_the_speed_that_was_asked():
    found = program()
    assert np.array_equal(found.rates.speeds, 0.5 * cell().robot.speeds)
    for tour in found.tours:
        for move in tour.moves:
            assert move.seconds == pytest.approx(
                move_times(move.joints[:-1], move.joints[1:], found.rates).sum()
            )
    assert found.seconds == pytest.approx(sum(tour.seconds for tour in found.tours))


def test_a_slower_program_takes_longer():
    plan = plan_of(reached_poses())
    slow = robot_program(plan, block(), cell(), speed=0.1)
    assert slow.seconds > 1.5 * program().seconds


def test_twice_the_same():
    plan = plan_of(reached_poses())
    texts = {json.dumps(robot_program(plan, block(), cell(), seed=2).to_dict()) for _ in range(2)}
    assert len(texts) == 1


def test_without_an_uncertainty_of_the_arm_p_is_not_stated():
    found = robot_program(plan_of(reached_poses()[:2]), block(), cell())
    assert all(stop.covariance is None and not stop.probability for _, stop in stops(found))
    assert found.warnings == ()


def test_an_arm_as_the_plan_assumes_states_the_probability_of_the_plan():
    """Without errors of joints Σ(q) is that of the hand-eye pose, whatever the joints."""
    plan = plan_of(reached_poses()[:2], accuracy=0.995)
    hand_eye = PoseUncertainty.isotropic(translation_mm=0.2, rotation_rad=0.003)
    found = robot_program(plan, block(), cell(), uncertainty=ArmUncertainty(0.0, hand_eye))
    for _, stop in stops(found):
        np.testing.assert_allclose(stop.covariance, hand_eye.covariance, atol=1e-12)
        setting = plan.settings[stop.setting_idx]
        simulated = simulate_setting(
            setting, ENTITIES, plan.camera, hand_eye, accuracy=0.995, sensor_limits=False
        )
        assert stop.simulated.keys() == simulated.keys()
        for name, rate in simulated.items():
            assert rate.low - 0.005 <= stop.probability[name] <= rate.high + 0.005


def test_a_shaky_arm_is_warned_of():
    plan = plan_of(reached_poses()[:2], accuracy=0.999)
    found = robot_program(plan, block(), cell(), uncertainty=ArmUncertainty(0.01))
    assert any("P with this arm is below 0.9 for near" in text for text in found.warnings)
    frequencies = [rate for _, stop in stops(found) for rate in stop.simulated.values()]
    assert all(rate.n == 10_000 for rate in frequencies)
    assert min(rate.frequency for rate in frequencies) < 0.9


def test_the_better_branch_is_preferred_for_a_twentieth_of_the_time():
    """The sum of times and shortfalls is least, so more time is only spent on a smaller shortfall."""
    plan = plan_of(reached_poses(), accuracy=0.997)
    shaky = ArmUncertainty(0.003)
    hasty = robot_program(plan, block(), cell())
    careful = robot_program(plan, block(), cell(), uncertainty=shaky, simulate=0)

    def worst(tour, stop):
        part2base = FIXTURINGS[tour.fixturing].part2base
        covariance = shaky.covariances(cell().robot, stop.joints[None], CAM2FLANGE, part2base)
        setting = plan.settings[stop.setting_idx]
        return min(stated_probabilities(plan, setting, covariance)[0].values())

    assert hasty.seconds <= careful.seconds <= 1.05 * hasty.seconds
    for tour, stop in stops(careful):
        assert worst(tour, stop) == pytest.approx(min(stop.probability.values()))
    sums = [sum(worst(tour, stop) for tour, stop in stops(one)) for one in (careful, hasty)]
    assert sums[0] >= sums[1] - 1e-12


def test_a_plan_for_another_cell_is_warned_of():
    of_cell = cell().to_dict()
    plan = plan_of(reached_poses()[:1], cell=of_cell)
    assert robot_program(plan, block(), cell()).warnings == ()
    plan = plan_of(reached_poses()[:1], cell={**of_cell, "digest": "0" * 64, "parts": {}})
    (warned,) = robot_program(plan, block(), cell()).warnings
    assert warned == (
        "the cell of the plan differs from the cell given, in something that the plan does not name."
    )
    moved = made_cell(fixturings={"up": FIXTURINGS["up"]}, home=HOME, clearance_mm=9.0)
    plan = plan_of(reached_poses()[1:2], cell=moved.to_dict())
    (warned,) = robot_program(plan, block(), cell()).warnings
    assert warned == (
        "the cell of the plan differs from the cell given, in clearance_mm and fixturing "
        "'turned over' (new)."
    )


def test_the_record_is_json():
    record = json.loads(json.dumps(program().to_dict(), allow_nan=False))
    assert record["joint_names"][0] == "shoulder_pan"
    assert record["unreached"] == {}
    assert [tour["fixturing"] for tour in record["tours"]] == ["up", "turned over"]
    assert {stop["setting"] for tour in record["tours"] for stop in tour["stops"]} == {
        1,
        2,
        3,
        4,
        5,
    }


def far_away(n=1):
    poses = reached_poses()[:n].copy()
    poses[:, :3, 3] += [5000.0, 0.0, 0.0]
    return poses


def test_settings_out_of_reach_are_named():
    plan = plan_of(np.concatenate([reached_poses()[:2], far_away()]))
    found = robot_program(plan, block(), cell())
    assert found.unreached == {2: "beyond the arm's reach"}
    assert not found.complete
    assert "1 not reached" in repr(found)


def test_nothing_reached_is_an_error_with_the_reason():
    with pytest.raises(InfeasibleError, match=r"setting 1: beyond the arm's reach"):
        robot_program(plan_of(far_away()), block(), cell())


def test_a_home_that_nothing_leads_to_is_an_error(monkeypatch):
    monkeypatch.setattr(Detours, "is_free", lambda self, start, end: False)
    monkeypatch.setattr(Detours, "find", lambda self, start, end, seed, **_options: None)
    with pytest.raises(InfeasibleError, match=r"setting 1: .*: no way without collision was found"):
        robot_program(plan_of(reached_poses()[:2]), block(), cell())


def test_one_fixturing_is_used_where_it_is_enough():
    own = made_cell(fixturings={**FIXTURINGS, "up again": FIXTURINGS["up"]}, home=HOME)
    up_only = [stop.setting_idx for tour, stop in stops(program()) if tour.fixturing == "up"]
    found = robot_program(plan_of(reached_poses()[up_only]), block(), own)
    assert [tour.fixturing for tour in found.tours] == ["up"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": 0.0}, "speed must be in"),
        ({"speed": 1.5}, "speed must be in"),
        ({"seed": -1}, "seed must be an integer"),
        ({"simulate": -1}, "simulate must be an integer"),
        ({"cell": "cell.toml"}, "cell must be a Cell"),
        ({"cell": made_cell(fixturings=FIXTURINGS)}, "cell.home must be given"),
        ({"plan": plan_of([], uninspectable=dict.fromkeys(ENTITIES, "no"))}, "plan must have set"),
        ({"plan": None}, "plan must be an InspectionPlan"),
    ],
    ids=lambda one: one if isinstance(one, str) else next(iter(one)),
)
def test_bad_arguments(changes, message):
    given = {"plan": plan_of(reached_poses()[:1]), "cell": cell(), **changes}
    plan = given.pop("plan")
    with pytest.raises(RequestError, match=message):
        robot_program(plan, block(), given.pop("cell"), **given)


def test_another_part_is_refused():
    plan = plan_of(reached_poses()[:1], part="block")
    with pytest.raises(RequestError, match="solid must be the part of the plan"):
        robot_program(plan, block(), cell())


def test_a_quarter_turn_of_the_whole_cell_changes_no_time():
    """The made robot's base is a square, so only the first joint's angles shift."""
    carry = pose(rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    table = Box(TABLE.low, TABLE.high, carry)
    fixturings = {
        name: Fixturing(carry @ one.part2base, {"table": table}) for name, one in FIXTURINGS.items()
    }
    own = made_cell(fixturings=fixturings, home=(HOME[0] + np.pi / 2, *HOME[1:]))
    plan = plan_of(reached_poses())
    turned = robot_program(plan, block(), own)
    straight = robot_program(plan, block(), cell())
    assert turned.seconds == pytest.approx(straight.seconds, rel=1e-6)
    for (_, stop), (_, other) in zip(stops(turned), stops(straight), strict=True):
        assert stop.setting_idx == other.setting_idx
        np.testing.assert_allclose(
            stop.joints - other.joints, [np.pi / 2, 0, 0, 0, 0, 0], atol=1e-6
        )


def near_home(gap, clearance):
    """A cell with a post beside the camera at home, so far away; its program."""
    known = cell()
    corners = np.concatenate(
        [
            points
            for name, moves, points, _ in known.shapes(np.array(HOME), "up")
            if name == "camera"
        ]
    )
    side = corners[:, 1].min() - gap
    middle = corners.mean(axis=0)
    post = Box((middle[0] - 20, side - 20, middle[2] - 20), (middle[0] + 20, side, middle[2] + 20))
    fixturings = {"up": Fixturing(FIXTURINGS["up"].part2base, {"table": TABLE, "post": post})}
    return made_cell(fixturings=fixturings, home=HOME, clearance_mm=clearance)


def test_all_joints_within_the_tolerance_of_home_are_free():
    """Corners of the box of joints and draws in it, by the exact distances: half the clearance is kept."""
    own = near_home(4.2, clearance=4.0)
    plan = plan_of(reached_poses()[up_settings()])
    found = robot_program(plan, block(), own)
    tolerance = found.start.tolerance_rad
    # 2.2 mm are left of 4.2 at home: less than 0.01 rad moves a camera that is 0.5 m away
    assert 1e-4 <= tolerance < 0.01
    known = own.with_part(block())
    corners = np.array(list(product((-1.0, 1.0), repeat=6)))
    draws = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 6))
    box = np.array(HOME) + tolerance * np.concatenate([corners, draws])
    assert (known.slack_bound(box, "up", 1.0, share=0.5) >= 0).all()
    # what was let pass before is not free
    wide = np.array(HOME) + 0.01 * corners
    assert (known.slack_bound(wide, "up", 1.0, share=0.5) < 0).any()
    assert f"> {tolerance:g}:" in program_text(found, "urscript")


def up_settings():
    return [stop.setting_idx for tour, stop in stops(program()) if tour.fixturing == "up"]


def test_far_from_everything_the_largest_tolerance_holds():
    assert program().start.tolerance_rad == 0.01


def test_a_home_that_touches_nothing_only_if_no_joint_is_off_is_refused():
    plan = plan_of(reached_poses()[up_settings()])
    tight = near_home(0.05, clearance=0.0)
    with pytest.raises(RequestError, match=r"cell\.home must stay free if each axis is 0.0001 rad"):
        robot_program(plan, block(), tight)


@pytest.mark.parametrize("speed", [float("nan"), float("inf"), 1e-300, 0.0009])
def test_speeds_of_nothing_are_refused(speed):
    with pytest.raises(RequestError, match="speed must be "):
        robot_program(plan_of(reached_poses()[:1]), block(), cell(), speed=speed)


# Programs with a turntable: the camera is where the plan wants it, and the table is an axis of
# the controller.


AXIS = ((800.0, 60.0, 0.0), (0.0, 0.0, 1.0))
PART2BASE = pose((700.0, 0.0, 20.0))
PLAIN = Fixturing(PART2BASE, {"table": TABLE})


def turntable(**changes):
    return Fixturing(PART2BASE, {"table": TABLE}, axis=AXIS, **{"angles": 8, **changes})


@cache
def cell_turntable_program():
    return made_cell(fixturings={"up": turntable()}, home=HOME)


@cache
def poses():
    """Poses that are reached without a turn, and poses that are reached only with one."""
    drawn = views(np.random.default_rng(5), 60, SIZE)
    inside = cell_turntable_program().with_part(block())
    straight = np.array([one.reached for one in inside.reach(drawn, "up", angle=0.0)])
    turned = np.array([one.reached for one in inside.reach(drawn, "up")])
    return np.concatenate([drawn[straight][:2], drawn[turned & ~straight][:3]])


@cache
def program_turntable_program():
    return robot_program(plan_of(poses()), block(), cell_turntable_program(), speed=0.5)


def test_each_stop_has_the_camera_of_its_setting():
    assert program_turntable_program().complete
    (tour,) = program_turntable_program().tours
    inside = cell_turntable_program().with_part(block())
    for stop in tour.stops:
        assert stop.joints.shape == (7,)
        camera = inside.cam2world(stop.joints[None], "up")[0]
        np.testing.assert_allclose(camera, poses()[stop.setting_idx], atol=1e-3)
        flange = inside.robot.forward(stop.joints[:6])
        np.testing.assert_allclose(flange, stop.flange, atol=1e-9)
    turned = {stop.setting_idx: stop.joints[6] != 0.0 for stop in tour.stops}
    assert all(turned[k] for k in range(2, len(poses())))


def test_moves_are_free_at_a_finer_step():
    (tour,) = program_turntable_program().tours
    inside = cell_turntable_program().with_part(block())
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
    (tour,) = program_turntable_program().tours
    robot = cell_turntable_program().robot
    speeds = np.append(robot.speeds, 0.5) / 2
    rates = JointRates(speeds, np.append(robot.accelerations, 0.5))
    assert program_turntable_program().rates_of(tour).speeds.tolist() == speeds.tolist()
    for move in tour.moves:
        seconds = move_times(move.joints[:-1], move.joints[1:], rates).sum()
        assert move.seconds == pytest.approx(seconds)
    # a quarter turn at 0.25 rad/s and 0.5 rad/s²: the way at full speed, and half a second to reach it
    still = np.zeros(7)
    quarter = np.append(np.zeros(6), math.pi / 2)
    assert move_times(still, quarter, rates) == pytest.approx(math.pi / 2 / 0.25 + 0.5)
    slow = made_cell(fixturings={"up": turntable(turn_speed=0.05)}, home=HOME)
    assert (
        robot_program(plan_of(poses()), block(), slow, speed=0.5).seconds
        > program_turntable_program().seconds + 10
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
    return [math.degrees(stop.joints[6]) for stop in program_turntable_program().tours[0].stops]


def test_rapid_turns_the_first_external_axis():
    text = program_text(program_turntable_program(), "rapid")
    found = re.findall(r"jointtarget j\w+:=\[\[(.*?)\],\[(.*?)\]\];", text)
    external = [float(one.split(",")[0]) for _, one in found]
    assert external[0] == 0.0
    moves = np.concatenate([move.joints[1:] for move in program_turntable_program().tours[0].moves])
    np.testing.assert_allclose(external[1:], np.degrees(moves[:, 6]), atol=1e-5)
    assert all(one.split(",")[1:] == ["9E9"] * 5 for _, one in found)
    assert "Abs(now.extax.eax_a-jHome.extax.eax_a)>" in text
    assert "turntable" in text.partition("CONST")[0]


def test_krl_turns_e1():
    text = program_text(program_turntable_program(), "krl")
    turned = [float(one) for one in re.findall(r"PTP \{A1 .*?,E1 (.*?)\}", text)]
    moves = np.concatenate([move.joints[1:] for move in program_turntable_program().tours[0].moves])
    np.testing.assert_allclose(turned, [0.0, *np.degrees(moves[:, 6])], atol=1e-5)
    assert "$AXIS_ACT.E1-(0.000000)" in text
    assert "$VEL_EXTAX[1]=50" in text


def test_ros_and_tables_have_one_joint_more():
    (round_,) = json.loads(program_text(program_turntable_program(), "ros"))["rounds"]
    names = [*cell_turntable_program().robot.segment_names, "turntable"]
    assert round_["joint_names"][-1] == names[-1]
    assert round_["start_at"]["positions"] == [*HOME, 0.0]
    trajectories = [s["joint_trajectory"] for s in round_["steps"] if "joint_trajectory" in s]
    assert all(len(one["joint_names"]) == 7 for one in trajectories)
    ends = [math.degrees(one["points"][-1]["positions"][6]) for one in trajectories]
    np.testing.assert_allclose(ends, [*angles_of_stops(), 0.0], atol=1e-9)
    lines = [
        line
        for line in program_text(program_turntable_program(), "csv").splitlines()
        if not line.startswith("#")
    ]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    images = [math.degrees(float(row["turntable_rad"])) for row in rows if row["image"]]
    np.testing.assert_allclose(images, angles_of_stops(), atol=1e-5)


def test_urscript_refuses_a_turntable():
    with pytest.raises(
        RequestError, match="format must be rapid, krl, fanuc, ros, csv or json for a"
    ):
        program_text(program_turntable_program(), "urscript")


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
    kept = few_branches([np.repeat(near, 20, axis=0), near[:1]], np.zeros(7), rates, turns=True)
    # the angle that both have comes first, and no more than two dozen stay
    assert [len(one) for one in kept] == [24, 1]
    assert kept[0][:, 6].tolist().count(2.0) == 20
    assert few_branches([near[:0]], np.zeros(7), rates, turns=True)[0].shape == (0, 7)


# Fewest fixturings against all subsets, then the time against all assignments.


def no_time(fixturing, settings):
    return 0.0


def test_one_fixturing_is_enough():
    reached = np.array([[1, 0, 1], [0, 1, 1], [1, 0, 1]], dtype=bool)
    found = choose_fixturings(reached, no_time)
    assert found.of_setting == (2, 2, 2)
    assert found.coverage == (3,)


def test_coverage_says_what_each_further_fixturing_adds():
    reached = np.array(
        [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]], dtype=bool
    )
    found = choose_fixturings(reached, no_time)
    assert found.coverage == (3, 5, 6)
    assert found.of_setting == (0, 0, 1, 1, 0, 2)


def test_settings_that_nothing_reaches():
    reached = np.array([[0, 0], [0, 1]], dtype=bool)
    assert choose_fixturings(reached, no_time) == (
        (-1, 1),
        (1,),
    )
    assert choose_fixturings(reached & False, no_time).of_setting == (-1, -1)


@pytest.mark.parametrize("seed", range(6))
def test_as_all_subsets_and_assignments(seed):
    rng = np.random.default_rng(seed)
    reached = rng.random((5, 4)) < 0.4
    weights = rng.uniform(1, 2, (4, 5))

    def seconds(fixturing, settings):
        # additive, so that moving one setting at a time finds the least
        return float(sum(weights[fixturing, k] for k in settings))

    found = choose_fixturings(reached, seconds)
    most = reached.any(axis=1).sum()
    used = sorted(set(found.of_setting) - {-1})
    assert sum(f >= 0 for f in found.of_setting) == most
    assert all(f < 0 or reached[k, f] for k, f in enumerate(found.of_setting))
    for size in range(len(used)):
        for chosen in combinations(range(4), size):
            assert reached[:, chosen].any(axis=1).sum() < most
    best = min(
        sum(weights[f, k] for k, f in enumerate(assignment) if f >= 0)
        for assignment in product(
            *([f for f in range(4) if reached[k, f]] or [-1] for k in range(5))
        )
        if len(set(assignment) - {-1}) <= max(len(used), 0)
    )
    time = sum(weights[f, k] for k, f in enumerate(found.of_setting) if f >= 0)
    assert time == pytest.approx(best)
