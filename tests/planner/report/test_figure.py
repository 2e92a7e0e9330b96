"""Views of the 3-D picture: all that shall be seen lies inside it, by the projection that plotly documents."""

import math

import cv2
import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from plan_examples import CAMERA, plan, setting
from robot_programs import FIXTURINGS, HOME, block, cell, program

from planner.report.figure import (
    SceneFrame,
    Stand,
    arm_figure,
    arm_section,
    box_around,
    figure_views,
    plan_figure,
    scene_frame,
)

SPACE = BoxSpace((80.0, 50.0, 60.0), [[-900.0] * 3, [900.0] * 3], EDGES)


def in_picture(camera, placed):
    """Return places (n, 2) in the picture, whose upper and lower sides are at 1 and −1; the field is 45 degrees."""
    eye, centre, up = (np.array([camera[key][i] for i in "xyz"]) for key in ("eye", "center", "up"))
    forward = (centre - eye) / np.linalg.norm(centre - eye)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    seen = (placed - eye) @ np.array([right, np.cross(right, forward), forward]).T
    assert (seen[:, 2] > 0).all()
    return seen[:, :2] / seen[:, 2:] / math.tan(math.radians(22.5))


def one_setting():
    entities = {"top front": [[0.0, 0.0, 60.0], [80.0, 0.0, 60.0]]}
    return plan(
        settings=(setting((40.0, -180.0, 620.0), ["top front"]),),
        entities=entities,
        uninspectable={},
    )


@pytest.mark.parametrize("made", [plan, one_setting])
def test_the_first_view_holds_every_camera_and_the_part(made):
    found = made()
    frame = scene_frame(found, SPACE.solid)
    shown = frame.placed(
        np.vstack([SPACE.solid.vertices, *(one.position[None] for one in found.settings)])
    )
    places = in_picture(figure_views(found, SPACE.solid)["everything"], shown)
    assert np.abs(places).max() < 0.9
    # and nothing is lost in the distance
    assert np.ptp(places, axis=0).max() > 0.8
    assert (frame.box[0] < np.array([one.position for one in found.settings]).min(axis=0)).all()


def test_the_view_of_a_setting_is_its_cameras_image():
    """Each corner of the part is where OpenCV projects it, as a share of the sensor's half height."""
    found = one_setting()
    view = figure_views(found, SPACE.solid)["setting-1"]
    corners = SPACE.solid.vertices
    placed = scene_frame(found, SPACE.solid).placed(corners)
    # the page sets the field of plotly's camera to the tangent of the sensor's half height
    seen = in_picture(view, placed) * math.tan(math.radians(22.5)) / view["field"]["y"]
    world2cam = np.linalg.inv(found.settings[0].cam2world)
    turn = cv2.Rodrigues(world2cam[:3, :3])[0]
    pixels = cv2.projectPoints(corners, turn, world2cam[:3, 3], CAMERA.matrix, np.zeros(5))[0][:, 0]
    width, height = CAMERA.resolution
    right = (pixels[:, 0] - (width - 1) / 2) / (width / 2)
    up = ((height - 1) / 2 - pixels[:, 1]) / (height / 2)
    wide = view["field"]["x"] / view["field"]["y"]
    assert seen == pytest.approx(np.column_stack([right * wide, up]), abs=1e-6)


def test_a_view_straight_along_up_is_a_view():
    frame = SceneFrame(np.array([[0.0, 0.0, 0.0], [10.0, 20.0, 20.0]]))
    camera = frame.camera([[0.0, 0.0, 0.0], [10.0, 20.0, 20.0]], (0, 0, 1), (0, 0, 1))
    assert np.isfinite(in_picture(camera, frame.placed([[5.0, 5.0, 5.0]]))).all()


def test_lengths_are_the_same_along_all_axes():
    frame = SceneFrame(np.array([[0.0, 0.0, 0.0], [10.0, 20.0, 20.0]]))
    sides = np.array([frame.layout["aspectratio"][i] for i in "xyz"])
    # the diagonal of 30 mm is 2 units long
    assert sides == pytest.approx(np.array([10, 20, 20]) / 15)
    assert frame.placed([[5.0, 10.0, 10.0]]) == pytest.approx(np.zeros((1, 3)))


def test_air_ends_at_the_limits_but_points_are_never_cut_off():
    box = box_around(
        np.array([[0.0, 0, 0], [300.0, 0, 400.0]]),
        np.array([[-10.0, -100, -100], [200.0, 100, 600]]),
    )
    # 8 % of 500 mm, but 10 mm to the first wall, and a point beyond the second
    assert box == pytest.approx(np.array([[-10.0, -40, -40], [300.0, 40, 440]]))


def test_the_figure_starts_with_everything_in_view():
    figure = plan_figure(one_setting(), SPACE.solid)
    assert figure.layout.scene.camera.eye.x == pytest.approx(
        figure_views(one_setting(), SPACE.solid)["everything"]["eye"]["x"]
    )


# The figure of the arm: everything where the cell has it, one slider, and not too large.


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
