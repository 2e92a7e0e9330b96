"""The figure of the arm: everything where the cell has it, one slider, and not too large."""

import numpy as np
import pytest
from robot_programs import FIXTURINGS, HOME, block, cell, program

from planner.report.graph_picture import Stand, arm_figure, arm_section


def stands():
    return [
        Stand(f"setting {stop.setting_idx + 1}", tour.fixturing, tuple(stop.joints))
        for tour in program().tours
        for stop in tour.stops
    ]


def shown(figure, step):
    (slider,) = figure.layout.sliders
    visible = slider.steps[step].args[0]["visible"]
    return [trace for trace, is_shown in zip(figure.data, visible, strict=True) if is_shown]


def corners(trace):
    return np.stack([trace.x, trace.y, trace.z], axis=1)


@pytest.fixture(scope="module")
def figure():
    return arm_figure(stands(), block(), cell())


def test_each_step_shows_one_arm_one_camera_and_one_part(figure):
    for k, stand in enumerate(stands()):
        names = sorted(trace.name for trace in shown(figure, k))
        assert names == ["camera", "obstacles", "part", "robot"]
        assert figure.layout.sliders[0].steps[k].label == f"{stand.label}, {stand.fixturing}"


def test_at_first_the_first_step_is_shown(figure):
    assert [t for t in figure.data if t.visible] == shown(figure, 0)


def test_the_camera_is_where_the_joints_bring_it(figure):
    """The box of the camera ends at the nodal point, by the kinematics of the robot alone."""
    known = cell()
    for k, stand in enumerate(stands()):
        (camera,) = (trace for trace in shown(figure, k) if trace.name == "camera")
        place = known.robot.forward(np.array(stand.joints)) @ known.cam2flange
        local = (corners(camera) - place[:3, 3]) @ place[:3, :3]
        np.testing.assert_allclose(local.min(axis=0), [-30, -30, -90], atol=1.0)
        np.testing.assert_allclose(local.max(axis=0), [30, 30, 0], atol=1.0)


def test_the_part_lies_as_in_the_fixturing(figure):
    for k, stand in enumerate(stands()):
        (part,) = (trace for trace in shown(figure, k) if trace.name == "part")
        pose = FIXTURINGS[stand.fixturing].part2base
        local = (corners(part) - pose[:3, 3]) @ pose[:3, :3]
        np.testing.assert_allclose(local.max(axis=0), [200, 120, 80], atol=1.0)
        assert len(part.i) == len(block().triangles)


def test_one_setting_needs_no_slider():
    assert not arm_figure(stands()[:1], block(), cell()).layout.sliders


def test_many_settings_stay_below_a_megabyte():
    many = [Stand("home", "up", HOME)] * 40
    assert len(arm_figure(many, block(), cell()).to_json()) < 1_000_000


def test_no_section_for_a_plan_without_a_cell():
    from robot_programs import plan_of, reached_poses

    assert arm_section(plan_of(reached_poses()[:1]), block(), cell()) == ""
