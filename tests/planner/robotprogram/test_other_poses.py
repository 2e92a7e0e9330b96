"""Other poses inspect the same as a setting, and a plan with them is reached."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from robot_cells import TABLE, made_cell, pose
from robot_programs import HOME, cell, plan_of, reached_poses
from robot_programs import block as plain_block
from scipy.spatial.transform import Rotation

from aspectgraph import read_solid
from planner import (
    Camera,
    Dimension,
    Effort,
    Fixturing,
    GivenPose,
    InspectionOptions,
    PoseUncertainty,
    Registration,
    RequestError,
    look_at,
    plan_inspection,
    predict,
    read_plan,
    robot_program,
    robot_program_with_other_poses,
    with_reached_settings,
)
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE
from planner.request.reach import StatedRegion
from planner.robotprogram.other_poses import EquivalentPoses, as_driven, why_no_other_poses
from planner.search.plan_setting import setting_at

CAMERA = Camera.named("basler-acA2440-20gm-8mm")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
EDGES = {"left": [[60, 20, 10], [60, 40, 10]], "corner": [[0, 0, 0], [0, 0, 40]]}
EFFORT = Effort(
    viewpoints=6, pricing_rounds=1, refutations=1, bound_nodes=300, margin_generations=3
)


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


@pytest.fixture(scope="module")
def plan(block):
    """A plan for no robot: turned by 60°, no joints lead to its setting."""
    made = plan_inspection(block, EDGES, CAMERA, UNCERTAINTY, accuracy=0.95, effort=EFFORT)
    return made.simulated(500)


def turned_cell(degrees):
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    fixturing = Fixturing(pose((850.0, 0.0, 0.0), turn), {"table": TABLE})
    return made_cell(fixturings={"up": fixturing}, home=HOME)


@pytest.fixture(scope="module")
def reached(plan, block):
    cell = turned_cell(60)
    return cell, with_reached_settings(plan, block, cell)


def test_other_poses_inspect_the_same(plan, block):
    found = EquivalentPoses(plan, block)
    need = plan.requirements
    options = InspectionOptions(
        workspace=plan.workspace,
        field_margin_px=need["field_margin_px"],
        visibility_radius_mm=need["visibility_radius_mm"],
    )
    for k, setting in enumerate(plan.settings):
        poses = found.poses(k)
        assert len(poses) > 100
        wanted = {name: EDGES[name] for name in setting.entities}
        for one in poses[:: len(poses) // 4]:
            told = predict(block, wanted, one, CAMERA, UNCERTAINTY, accuracy=0.95, options=options)
            assert all(each.inspected for each in told.values())
            assert min(each.probability for each in told.values()) >= plan.probability
        distances = [np.dot(found.distance(k, one), (1.0, 200.0)) for one in poses]
        assert (np.diff(distances) > -1e-5).all()
        # some are only rolled
        shifts = np.linalg.norm(poses[:, :3, 3] - setting.position, axis=1)
        along = poses[:, :3, 2] @ setting.cam2world[:3, 2]
        assert ((shifts < 1e-6) & (along > 1 - 1e-9)).any()


def test_the_box_around_a_setting_contains_the_part(plan, block):
    """Also where the camera is far to one side: regions are computed in a box about the part."""
    found = EquivalentPoses(plan, block)
    low, high = np.asarray(block.bounds)
    for shift in ([900.0, 0.0, 0.0], [0.0, -700.0, 300.0]):
        pose = plan.settings[0].cam2world.copy()
        pose[:3, 3] += shift
        box = found._box(replace(plan.settings[0], cam2world=pose))
        first, last = np.asarray(plan.workspace)
        assert (box[0] < low).all()
        assert (box[1] > high).all()
        assert (box[0] >= first).all()
        assert (box[1] <= last).all()


def test_a_plan_with_other_poses_is_reached(plan, block, reached, tmp_path):
    cell, found = reached
    before = cell.reachability(plan, block)
    assert not before.complete
    assert set(found.replaced) == set(np.flatnonzero(~before.reached.any(axis=1)))
    assert not found.unreached
    assert cell.reachability(found.plan, block).complete
    for k, (one, old) in enumerate(zip(found.plan.settings, plan.settings, strict=True)):
        assert one.entities == old.entities
        if k not in found.replaced:
            assert one is old
            continue
        other = found.replaced[k]
        assert other.moved_mm == pytest.approx(np.linalg.norm(one.position - old.position))
        assert other.why == before.why_not(k)
        assert min(one.probability.values()) >= plan.probability
        assert min(one.p_all.values()) >= plan.probability
        assert min(one.margins.values()) >= 0
    # stated again for the new poses
    assert found.plan.simulation.n == plan.simulation.n
    assert found.plan.simulation.confirmed
    found.plan.write(tmp_path / "reached.json")
    again = read_plan(tmp_path / "reached.json")
    assert cell.reachability(again, block).complete


def test_a_program_drives_the_plan_that_it_holds(plan, block, reached, tmp_path):
    cell, found = reached
    without = (
        robot_program(plan, block, cell) if found.plan.settings[0] is plan.settings[0] else None
    )
    assert without is None or not without.complete
    made = robot_program_with_other_poses(plan, block, cell)
    assert made.complete
    assert set(made.replaced) >= set(found.replaced)
    inside = cell.with_part(block)
    for tour in made.tours:
        for stop in tour.stops:
            setting = made.plan.settings[stop.setting_idx]
            camera = inside.cam2world(stop.joints[None], tour.fixturing)[0]
            np.testing.assert_allclose(camera, setting.cam2world, atol=1e-3)
            assert setting.joints == tuple(stop.joints)
            assert setting.fixturing == tour.fixturing
    assert made.digests["plan"] == made.plan.digest != plan.digest
    record = json.loads(json.dumps(made.to_dict()))
    assert set(record["replaced"]) == {str(k + 1) for k in made.replaced}
    made.plan.write(tmp_path / "driven.json")
    assert read_plan(tmp_path / "driven.json").cell == cell.to_dict()


def test_a_setting_that_is_left_out_states_no_way_to_it(tmp_path):
    """What an earlier program stated is cleared, and the digest is that of the plan so changed."""
    poses = reached_poses()[:2].copy()
    poses[1, :3, 3] += [5000.0, 0.0, 0.0]
    plan = plan_of(poses)
    before = {"fixturing": "before", "joints": (0.1,) * 6, "arm": {"singular_value": 0.3}}
    stated = tuple(replace(setting, **before) for setting in plan.settings)
    plan = replace(plan, settings=stated)
    made = robot_program(plan, plain_block(), cell())
    assert list(made.unreached) == [1]
    driven = as_driven(plan, made, cell())
    first, second = driven.settings
    (stop,) = (stop for tour in made.tours for stop in tour.stops)
    assert first.joints == tuple(stop.joints)
    assert first.fixturing != "before"
    assert (second.fixturing, second.joints, second.angle_deg, second.arm) == ("", (), None, {})
    driven.write(tmp_path / "driven.json")
    written = hashlib.sha256((tmp_path / "driven.json").read_bytes()).hexdigest()
    assert written == driven.digest != plan.digest
    record = json.loads((tmp_path / "driven.json").read_text("utf-8"))["settings"]
    assert "before" not in json.dumps(record)
    assert not record[1].get("joints")


def test_where_all_is_reached_nothing_is_replaced(plan, block, reached):
    cell, found = reached
    again = with_reached_settings(found.plan, block, cell)
    assert again.plan is found.plan
    assert not again.replaced


def test_what_no_other_pose_reaches_says_why(plan, block):
    far = made_cell(fixturings={"far": Fixturing(pose((4000.0, 0.0, 0.0)))}, home=HOME)
    found = with_reached_settings(plan, block, far)
    assert found.plan is plan
    assert found.unreached == dict.fromkeys(range(len(plan.settings)), "beyond the arm's reach")


def test_plans_whose_request_cannot_be_made_again_have_no_other_poses():
    plan = plan_of(reached_poses()[:1])
    need = replace(plan.request.requirements, reach=StatedRegion({"state_name": "over the table"}))
    plan = replace(plan, request=replace(plan.request, requirements=need))
    assert why_no_other_poses(plan) == "the plan's request cannot be made again"
    far = made_cell(fixturings={"far": Fixturing(pose((4000.0, 0.0, 0.0)))}, home=HOME)
    found = with_reached_settings(plan, plain_block(), far)
    assert found.note == why_no_other_poses(plan)
    assert found.unreached
    with pytest.raises(RequestError, match="plan must allow other poses"):
        robot_program_with_other_poses(plan, plain_block(), far)


def test_a_plan_of_given_poses_keeps_them():
    plan = plan_of(reached_poses()[:1])
    given = (GivenPose("taught", plan.settings[0].cam2world),)
    plan = replace(plan, request=replace(plan.request, poses=given))
    assert why_no_other_poses(plan) == "its poses were chosen from poses that exist"


def test_other_poses_promise_what_registration_will_tell(block):
    """At its own pose a setting gets the plan's numbers, although it measures some of the targets only."""
    options = InspectionOptions(accuracy=0.95, effort=EFFORT, registration=Registration.own_edges())
    height = Dimension.distance([[60, 20, 30], [60, 40, 30]], EDGES["left"], max_error_mm=1.0)
    eyes = [[206.8, 206.7, 170.0], [-145.0, -210.0, 165.0]]
    poses = look_at(eyes, [[45.0, 30.0, 10.0], [10.0, 10.0, 20.0]])
    plan = plan_inspection(
        block, {"height": height, **EDGES}, CAMERA, UNCERTAINTY, options, poses=poses
    )
    # as if they had been searched
    plan = replace(plan, request=replace(plan.request, poses=None))
    assert len(plan.settings) == 2
    equivalents = EquivalentPoses(plan, block)
    for k, setting in enumerate(plan.settings):
        again = setting_at(equivalents.problem(k), setting.cam2world, setting.entities, "")
        for name, p in setting.probability.items():
            assert again.probability[name] == pytest.approx(p, abs=1e-9)
        known = setting.registered
        np.testing.assert_allclose(again.registered.covariance, known.covariance, rtol=1e-9)
        for name, sigma in known.by_surfaces.items():
            assert again.registered.by_surfaces[name] == pytest.approx(sigma, rel=1e-9)
    # a rolled image tells as much of the same edges
    other = equivalents.setting(0, equivalents.poses(0)[0])
    assert other.registered is not None
    assert min(other.p_all.values()) >= plan.probability


CELL = """
cam2flange = {{ xyz = [0, 0, 90] }}
home_deg = [0, -108.862, 97.403, 0, 89.954, 0]
camera_body = [{{ low = [-30, -30, -90], high = [30, 30, 0] }}]
robot = {{ urdf = "{folder}/made_parallel.urdf", packages = {{ made_robots = "{folder}" }} }}
[fixturings.up]
part2base = {{ xyz = [850, 0, 0], rpy_deg = [0, 0, 60] }}
[fixturings.up.obstacles.table]
low = [300, -500, -100]
high = [1300, 500, 0]
"""


@pytest.fixture(scope="module")
def files(plan, tmp_path_factory):
    from robot_cells import ROBOTS

    folder = tmp_path_factory.mktemp("reach")
    plan.write(folder / "plan.json")
    (folder / "cell.toml").write_text(CELL.format(folder=ROBOTS.as_posix()), "utf-8")
    return folder


def run(files, capsys, *arguments, plan="plan.json"):
    command, *more = arguments
    part = "examples/two_pocket_block.off"
    given = [command, files / plan, part, "--cell", files / "cell.toml", *more]
    code = main([str(one) for one in given])
    return code, " ".join(capsys.readouterr().out.split())


def test_reach_names_other_poses_and_writes_them_only_where_asked(files, capsys):
    before = (files / "plan.json").read_bytes()
    code, out = run(files, capsys, "reach")
    assert code == INCOMPLETE
    assert "setting 1 is reached from another pose that inspects the same:" in out
    assert "--plan-out FILE writes the plan with these poses" in out
    code, _ = run(files, capsys, "reach", "--plan-out", files / "reached.json")
    assert code == DONE
    code, out = run(files, capsys, "reach", plan="reached.json")
    assert code == DONE
    assert "another pose" not in out
    assert (files / "plan.json").read_bytes() == before


def test_program_uses_other_poses_only_where_asked(files, capsys):
    code, out = run(
        files, capsys, "program", "--out", files / "a.script", "--plan-out", files / "d.json"
    )
    assert code == DONE
    assert "has another pose that inspects the same" in out
    text = (files / "a.script").read_text("utf-8")
    assert "Setting 1 has another pose than in the first plan" in text
    assert hashlib.sha256((files / "d.json").read_bytes()).hexdigest() in text


def test_a_place_for_the_plan_that_is_none(files, capsys):
    code = main(
        [
            "reach",
            str(files / "plan.json"),
            "examples/two_pocket_block.off",
            "--cell",
            str(files / "cell.toml"),
            "--place",
            "--plan-out",
            "x.json",
        ]
    )
    assert code == BAD_INPUT
    assert "plan-out must not be given with --place" in capsys.readouterr().err
