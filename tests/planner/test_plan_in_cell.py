"""Plans for a robot cell: all settings are reached, and a cell that forbids nothing changes no bit."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from robot_cells import CAM2FLANGE, CAMERA_BODY, TABLE, made_cell, made_robot, pose

from aspectgraph import compute_regions, read_solid
from planner import (
    Box,
    Camera,
    Cell,
    Effort,
    Fixturing,
    InspectionPlan,
    PoseUncertainty,
    ReasonKind,
    RequestError,
    RobotError,
    default_workspace,
    plan_inspection,
)
from planner.report.tables import arm, clearance_sentence
from planner.search.incumbents import fewest_fixturings

CAMERA = Camera.named("basler-acA2440-20gm-8mm")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
EFFORT = Effort(
    viewpoints=6, pricing_rounds=1, refutations=1, bound_nodes=300, margin_generations=3
)
EDGES = {
    "left": [[60, 20, 10], [60, 40, 10]],
    "back": [[20, 60, 10], [40, 60, 10]],
    "corner": [[0, 0, 0], [0, 0, 40]],
}


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


def planned(block, entities=EDGES, **options):
    return plan_inspection(
        block, entities, CAMERA, UNCERTAINTY, accuracy=0.95, effort=EFFORT, **options
    )


def apart_from_the_arm(plan):
    """Return what a plan says, without what only a cell adds."""
    data = plan.to_dict()
    del data["request"]
    data.pop("cell", None)
    for one in data["settings"]:
        for name in ("fixturing", "joints", "arm"):
            one.pop(name, None)
    order = sorted(range(len(data["settings"])), key=lambda k: data["settings"][k]["cam2world"])
    data["settings"] = [data["settings"][k] for k in order]
    return data


class EveryPose:
    """A cell that forbids nothing."""

    state_name = "every pose"

    def region(self, solid):
        return self

    def inspectable(self, cam2world, segments, owner, wanted):
        return wanted.copy()

    def placed(self, cam2world, segments):
        return {}

    def to_dict(self):
        return {"robot": "any", "digest": "0", "fixturings": {}}


EveryPose.__name__ = "Cell"


@pytest.fixture(scope="module")
def free(block):
    return planned(block)


@pytest.fixture(scope="module")
def celled(block):
    fixturings = {"up": Fixturing(pose((600.0, 0.0, 0.0)), {"table": TABLE})}
    cell = made_cell(fixturings=fixturings)
    return cell, planned(block, cell=cell)


def test_a_cell_that_forbids_nothing_changes_no_bit(block, free):
    assert apart_from_the_arm(planned(block, cell=EveryPose())) == apart_from_the_arm(free)


def test_every_setting_is_reached_without_collision(block, celled):
    cell, plan = celled
    assert plan.complete
    told = cell.reachability(plan, block)
    assert told.complete
    inside = cell.with_part(block)
    for setting in plan.settings:
        q = np.array([setting.joints])
        assert inside.free(q, setting.fixturing).all()
        camera = inside.cam2world(q, setting.fixturing)[0]
        np.testing.assert_allclose(camera, setting.cam2world, atol=1e-3)
        assert setting.arm["clearance_robot_mm"] == inside.clearance(q[0], setting.fixturing).mm
        assert setting.arm["to_limit_rad"] == cell.robot.to_limit_rad(q)[0]
        assert setting.arm["singular_value"] == pytest.approx(cell.robot.singular_value(q)[0])


def test_the_smallest_clearance_is_said_with_its_objects(free, celled):
    plan = celled[1]
    smallest = min(plan.settings, key=lambda setting: setting.arm["clearance_robot_mm"])
    mm = smallest.arm["clearance_robot_mm"]
    said = clearance_sentence(plan)
    assert f"{mm:.1f} mm, between {smallest.arm['closest']} in setting" in said
    assert not clearance_sentence(free)


def test_the_bound_is_proven_without_the_cell(free, celled):
    assert celled[1].lower_bound == free.lower_bound
    assert len(celled[1].settings) >= free.lower_bound


def test_a_plan_for_a_cell_comes_back_from_its_file(celled, tmp_path):
    plan = celled[1]
    plan.write(tmp_path / "plan.json")
    again = InspectionPlan.read(tmp_path / "plan.json")
    assert again.to_dict() == plan.to_dict()
    assert again.cell == celled[0].to_dict()
    for one, other in zip(again.settings, plan.settings, strict=True):
        assert (one.fixturing, one.joints, one.arm) == (other.fixturing, other.joints, other.arm)


def test_a_plan_that_its_time_limit_ends_has_joints_too(block, celled):
    space = compute_regions(block, EDGES, workspace=default_workspace(block, CAMERA))
    plan = planned(block, cell=celled[0], space=space, time_limit_s=1e-3)
    assert plan.unfinished
    assert plan.settings
    assert all(one.fixturing == "up" and len(one.joints) == 6 for one in plan.settings)
    assert celled[0].reachability(plan, block).complete


def test_processes_plan_the_same(block, celled):
    cell, plan = celled
    with ProcessPoolExecutor(2) as executor:
        other = planned(block, cell=cell, executor=executor)
    assert other.to_dict() == plan.to_dict()


def test_targets_behind_a_wall_need_the_fixturing_without_it(block):
    # each pocket opens to one side, close to which a wall stands
    place = pose((600.0, 0.0, 0.0))
    walls = {
        "left open": Box((300.0, 80.0, 5.0), (900.0, 90.0, 700.0)),
        "back open": Box((680.0, -300.0, 5.0), (690.0, 300.0, 700.0)),
    }
    ways = {name: Fixturing(place, {"table": TABLE, "wall": box}) for name, box in walls.items()}
    wanted = {name: EDGES[name] for name in ("left", "back")}
    both = planned(block, wanted, cell=made_cell(fixturings=ways))
    assert both.complete
    by_target = {name: one.fixturing for one in both.settings for name in one.entities}
    assert by_target == {"left": "left open", "back": "back open"}
    one_way = made_cell(fixturings={"left open": ways["left open"]})
    plan = planned(block, wanted, cell=one_way)
    assert plan.uninspectable["back"].kind == ReasonKind.OUT_OF_REACH
    assert "wall" in plan.uninspectable["back"]


@pytest.fixture(scope="module")
def turned(block):
    """A wall before the part, which opens to all sides where it lies on a turntable."""
    wall = Box((500.0, -300.0, 5.0), (510.0, 300.0, 700.0))
    place = pose((600.0, -30.0, 5.0))
    axis = ((630.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    on_table = Fixturing(place, {"table": TABLE, "wall": wall}, axis=axis, angles=4)
    cell = made_cell(fixturings={"turns": on_table})
    wanted = {name: EDGES[name] for name in ("left", "back")}
    return cell, planned(block, wanted, cell=cell)


def test_on_a_turntable_each_setting_has_its_angle(block, turned, tmp_path):
    cell, plan = turned
    assert plan.complete
    assert cell.reachability(plan, block).complete
    inside = cell.with_part(block)
    for setting in plan.settings:
        assert setting.angle_deg in (0.0, 90.0, -90.0, 180.0)
        assert inside.free(np.array([setting.axes]), "turns").all()
        camera = inside.cam2world(np.array([setting.axes]), "turns")[0]
        np.testing.assert_allclose(camera, setting.cam2world, atol=1e-3)
    plan.write(tmp_path / "plan.json")
    again = InspectionPlan.read(tmp_path / "plan.json")
    assert [one.axes for one in again.settings] == [one.axes for one in plan.settings]
    assert again.to_dict() == plan.to_dict()
    assert again.cell["turntables"]["turns"]["point"] == [630.0, 0.0, 0.0]
    assert "Turntable (°)" in [column.heading for column in arm(plan).columns]


def test_a_turntable_of_one_angle_plans_as_a_part_that_does_not_turn(block, celled, free):
    only = Fixturing(
        pose((600.0, 0.0, 0.0)), {"table": TABLE}, axis=((600, 0, 0), (0, 0, 1)), angles=1
    )
    plan = planned(block, cell=made_cell(fixturings={"up": only}))
    assert {one.angle_deg for one in plan.settings} == {0.0}
    records = [one.to_dict() for one in (plan, celled[1])]
    for record in records:
        for name in ("request", "cell"):
            del record[name]
        for one in record["settings"]:
            one.pop("angle_deg", None)
    assert records[0] == records[1]


def test_what_is_out_of_reach_says_what_is_in_the_way(block):
    far = {"far": Fixturing(pose((3000.0, 0.0, 0.0)))}
    plan = planned(block, {"left": EDGES["left"]}, cell=made_cell(fixturings=far))
    assert not plan.settings
    reason = plan.uninspectable["left"]
    assert reason.kind == ReasonKind.OUT_OF_REACH
    assert "the robot reaches no tried pose that meets all else for left" in reason
    assert "beyond the arm's reach (" in reason
    assert "in 'far'" in reason


def test_a_cell_must_be_one(block):
    with pytest.raises(RequestError, match="cell must be a Cell"):
        planned(block, cell=made_robot("made_wrist"))


def test_a_part_through_the_table_is_refused_before_the_work(block):
    through = {"up": Fixturing(pose((600.0, 0.0, -20.0)), {"table": TABLE})}
    with pytest.raises(RobotError, match="part2base must not put the part through other objects"):
        planned(block, cell=made_cell(fixturings=through))


def test_another_cell_is_another_request(block, celled, tmp_path):
    state = tmp_path / "state.json"
    cell = celled[0]
    first = planned(block, {"left": EDGES["left"]}, cell=cell, state=state)
    again = planned(block, {"left": EDGES["left"]}, cell=cell, state=state)
    assert [one.joints for one in again.settings] == [one.joints for one in first.settings]
    other = Cell(
        cell.robot,
        CAM2FLANGE,
        camera_body=CAMERA_BODY,
        clearance_mm=11.0,
        fixturings=cell.fixturings,
    )
    with pytest.raises(ValueError, match="cell changed"):
        planned(block, {"left": EDGES["left"]}, cell=other, state=state)


@pytest.mark.parametrize(
    ("ways", "chosen"),
    [
        ([], ()),
        ([{"a", "b"}, {"b"}, {"b", "c"}], ("b",)),
        # in the order of the cell
        ([{"a"}, {"b"}, {"a", "b"}], ("b", "a")),
        ([{"b", "a"}, {"a", "b"}], ("b",)),
        ([{"a"}, set()], ("a",)),
    ],
)
def test_the_fewest_fixturings_are_chosen(ways, chosen):
    assert fewest_fixturings(ways, ["c", "b", "a"]) == chosen


def test_of_many_fixturings_some_are_chosen():
    ways = [{f"w{k}", "common" if k % 2 else f"v{k}"} for k in range(20)]
    chosen = fewest_fixturings(ways, sorted(set().union(*ways)))
    assert all(names.intersection(chosen) for names in ways)
    assert "common" in chosen


def test_settings_without_a_cell_have_no_joints(free):
    assert {(one.fixturing, one.joints) for one in free.settings} == {("", ())}
    assert "cell" not in free.to_dict()
    assert replace(free, cell={}).to_dict() == free.to_dict()


def test_the_report_states_the_joints(celled, free):
    table = str(arm(celled[1]).html())
    first = celled[1].settings[0]
    assert ">up</td>" in table
    for angle in np.degrees(first.joints):
        assert f">{angle + 0.0:.2f}</td>" in table
    assert first.arm["closest"].split(" and ")[0] in table
    assert arm(free) is None
