"""Cell files: the example, and what is refused with the file's name and the field."""

import re

import numpy as np
import pytest
from robot_cells import ROBOTS

from planner import Cell, RobotError

EXAMPLE = ROBOTS.parent / "cell.toml"


def test_the_example_is_what_it_says():
    cell = Cell.from_toml(EXAMPLE)
    assert cell.robot.name == "made_parallel"
    assert list(cell.fixturings) == ["up", "turned over"]
    assert cell.clearance_mm == 10.0
    np.testing.assert_array_equal(cell.cam2flange[:3, 3], (0.0, 0.0, 120.0))
    np.testing.assert_allclose(np.degrees(cell.home), (0.0, -110.0, 100.0, 0.0, 90.0, 0.0))
    over = cell.fixturings["turned over"]
    # turned by half a turn about x, then by 130° about z
    np.testing.assert_allclose(over.part2base[2, :3], (0.0, 0.0, -1.0), atol=1e-15)
    assert over.part2base[0, 0] == pytest.approx(np.cos(np.radians(130.0)))
    assert over.obstacles["table"].high == (1500.0, 900.0, 0.0)


def written(folder, changes=()):
    """Return the path of a changed example beside the robots."""
    text = EXAMPLE.read_text("utf-8").replace('"robots', f'"{ROBOTS}')
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_names_of_files_are_relative_to_the_folder(tmp_path):
    cube = (ROBOTS / "cube.obj").read_text("utf-8")
    (tmp_path / "clamp.obj").write_text(cube, encoding="utf-8")
    table = "[fixturings.up.obstacles.table]"
    changes = [(table, f'[fixturings.up.obstacles.clamp]\nmesh = "clamp.obj"\n\n{table}')]
    cell = Cell.from_toml(written(tmp_path, changes))
    assert cell.fixturings["up"].obstacles["clamp"] == tmp_path / "clamp.obj"
    assert cell.state_name != Cell.from_toml(EXAMPLE).state_name


POSE = "part2base = { xyz = [800.0, 300.0, 100.0], rpy_deg = [0.0, 0.0, 130.0] }"
CASES = {
    "unknown": (
        "clearance_mm",
        "clearence_mm",
        "clearence_mm must be left out, or renamed to one of robot,.*"
        " Got an unknown field; the nearest is clearance_mm",
    ),
    "camera file": (
        "clearance_mm",
        "name",
        "name must be left out, or renamed to one of robot, camera, .* Got an unknown field",
    ),
    "unknown of the robot": (
        'tip = "tool0"',
        'tool = "tool0"',
        "robot.tool must be left out, or renamed to one of urdf",
    ),
    "no urdf": ('urdf = "', 'tip = "tool0"\nbase = "', "cannot|must be"),
    "tip": ('tip = "tool0"', "tip = 3", "tip must be a link of the robot. Got 3"),
    "another tip": ('tip = "tool0"', 'tip = "hand"', "tip must be a link of the robot. Got 'hand'"),
    "text for a number": (
        "clearance_mm = 10.0",
        'clearance_mm = "ten"',
        "clearance_mm must be finite",
    ),
    "five joints": (
        "0.0, 90.0, 0.0]\n\n# hand",
        "0.0, 90.0]\n\n# hand",
        "home_deg must be 6 numbers, one for each joint of the robot. Got 5",
    ),
    "pose of three rows": (
        "    [0.0, 0.0, 0.0, 1.0],\n",
        "",
        r"cam2flange must have shape \(4, 4\)",
    ),
    "pose without place": (
        POSE,
        "part2base = { rpy_deg = [0, 0, 0] }",
        "up.part2base.xyz must be given",
    ),
    "no pose": (POSE, "", "fixturings.up.part2base must be given. Got none"),
    "half a box": (
        "high = [35.0, 35.0, -10.0]",
        "",
        r"camera_body\[0\]: must have a mesh, or low and high. Got no high",
    ),
    "box and mesh": (
        "high = [35.0, 35.0, -10.0]",
        'mesh = "lens.stl"',
        r"camera_body\[0\]: must have either a mesh or low and high. Got low, mesh",
    ),
    "swapped box": (
        "low = [-35.0, -35.0, -120.0]",
        "low = [-35.0, -35.0, 0.0]",
        "low must be below high",
    ),
    "no mesh": ("high = [35.0, 35.0, -10.0]\n", "", "no high"),
    "no TOML": ("[robot]", "[robot", "cell file must be TOML"),
    "packages": ('made_robots = "', 'other = "', "must name the folder of package 'made_robots'"),
    "speeds": (
        "accelerations = 1.4",
        "speeds = 0",
        "speeds must be a positive number of rad/s, or one for each joint. Got 0",
    ),
    "bodiless links": (
        "accelerations = 1.4",
        'bodiless_links = ["link_9"]',
        "bodiless_links must be .* Got 'link_9'; these are link_1, link_2",
    ),
    "bodiless links in one word": (
        "accelerations = 1.4",
        'bodiless_links = "link_1"',
        "bodiless_links must be \"all\" or a list of links behind joints. Got 'link_1'",
    ),
    "metres": (
        "[0.0, 0.0, 1.0, 120.0]",
        "[0.0, 0.0, 1.0, 0.12]",
        r"cell.toml: cam2flange must be in mm. Got a lever of 0.12 mm; is it in metres\?",
    ),
    "accelerations": (
        "accelerations = 1.4",
        "accelerations = [1, 2]",
        "accelerations must be a positive number",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_refused_names_file_and_field(case, tmp_path):
    old, new, message = CASES[case]
    path = written(tmp_path, [(old, new)])
    with pytest.raises((RobotError, ValueError), match=message) as raised:
        Cell.from_toml(path)
    assert "\n" not in str(raised.value)
    if case not in ("text for a number",):
        assert re.search("cell.toml", str(raised.value))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RobotError, match=r"none.toml: cell file cannot be read: No such file"):
        Cell.from_toml(tmp_path / "none.toml")


def test_a_camera_body_is_a_list(tmp_path):
    path = written(tmp_path, [("[[camera_body]]", "[camera_body]"), ("[[camera_body]]", "[lens]")])
    with pytest.raises(
        RobotError,
        match=r"lens must be left out, or renamed to one of robot|must be written \[\[camera_body\]\]",
    ):
        Cell.from_toml(path)


def test_axes_of_the_controller(tmp_path):
    line = 'tip = "tool0"'
    fields = f"{line}\ncoupled = [[3, 2, 1.0]]\naxis_limits_deg = [[3, -60.0, 190.0]]"
    axes = Cell.from_toml(written(tmp_path, [(line, fields)])).robot.controller
    assert axes.coupled == ((3, 2, 1.0),)
    np.testing.assert_allclose(np.degrees(axes.limits[0][1:]), (-60.0, 190.0))
    for wrong, message in (
        ("coupled = [[3, 3, 1.0]]", "coupled must name another joint, from 1 to 6. Got"),
        ("coupled = 3", "coupled must hold three numbers each"),
        ("axis_limits_deg = [[3, -60.0]]", r"robot.axis_limits_deg\[0\] must be 3 finite"),
        ("axis_limits_deg = [[3, 60.0, 50.0]]", "axis_limits must go from a smaller angle"),
        (
            "axis_limits_deg = [[3, 0.0, 5.0]]",
            "home must be free.*axis of the controller is beyond",
        ),
    ):
        with pytest.raises(RobotError, match=message):
            Cell.from_toml(written(tmp_path, [(line, f"{line}\n{wrong}")]))
