"""The outside of a camera: its solids by closed forms, its keys in a cell file, and what is said without it."""

import numpy as np
import pytest
from robot_cells import ROBOTS, made_cell, pose
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from planner import Box, CableCapsule, CameraBody, Cell, Fixturing, RobotError
from planner.robotcell.camera_body import NO_CAMERA_BODY, camera_body_parts
from planner.robotcell.hand import has_camera_body

CABLE = CableCapsule((0.0, -60.0, -140.0), 20.0)
BODY = CameraBody((40.0, 30.0, 50.0), (33.0, 45.0), 25.0, CABLE)


def heights_over(corners, points):
    """Return by how much points are outside the hull of corners, mm; negative inside."""
    planes = ConvexHull(corners).equations
    return (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)


def test_the_solids_are_those_of_the_sizes():
    housing, lens, cable = BODY.bodies()
    # the front of the lens is 25 mm before the nodal point, its mount 20 mm behind
    assert (housing.low, housing.high) == ((-20.0, -15.0, -70.0), (20.0, 15.0, -20.0))
    np.testing.assert_allclose(lens[0][:, 2].min(), -20.0)
    np.testing.assert_allclose(lens[0][:, 2].max(), 25.0)
    turns = np.linspace(0, 2 * np.pi, 90)
    rim = np.stack([16.5 * np.cos(turns), 16.5 * np.sin(turns), 0 * turns], axis=1)
    outside = heights_over(lens[0], rim)
    assert outside.max() <= 1e-9
    assert outside.min() > -0.3
    # points at the radius from the axis of the cable are within, those 1 mm farther are not
    start = np.array([0.0, 0.0, -70.0])
    along = np.array(CABLE.to_mm) - start
    rng = np.random.default_rng(1)
    aside = rng.normal(size=(200, 3))
    aside -= np.outer(aside @ along, along) / (along @ along)
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    axis = start + rng.uniform(0, 1, (200, 1)) * along
    assert heights_over(cable[0], axis + 20.0 * aside).max() <= 1e-9
    assert heights_over(cable[0], axis + 21.0 * aside).min() > 0
    balls = rng.normal(size=(200, 3))
    balls *= 20.0 / np.linalg.norm(balls, axis=1)[:, None]
    for end in (start, np.array(CABLE.to_mm)):
        assert heights_over(cable[0], end + balls).max() <= 1e-9


def test_every_entry_of_the_catalogue_is_a_camera():
    parts = camera_body_parts()
    for housing in parts["housing"]:
        for lens in parts["lens"]:
            bodies = CameraBody(housing.upper(), lens, 10.0).bodies()
            assert len(bodies) == 2
    for of in parts.values():
        for name, facts in of.items():
            assert facts["source"].startswith("https://") or name.startswith("typical")


def test_a_cable_meets_what_the_camera_passes():
    """A shelf beside the camera is in the way of the cable alone."""
    camera = pose((40.0, 20.0, 400.0), Rotation.from_rotvec([np.pi, 0, 0]).as_matrix())
    part2base = pose((600.0, 0.0, 0.0))
    # the cable leaves the rear 70 mm above the nodal point and ends 160 mm beside it, towards +y of the base
    aside = CableCapsule((0.0, -160.0, -70.0), 20.0)
    shelf = Box((620.0, 170.0, 450.0), (660.0, 210.0, 490.0))
    fixturings = {"up": Fixturing(part2base, {"shelf": shelf})}
    for cable, reached in ((None, True), (aside, False)):
        body = CameraBody((40.0, 30.0, 50.0), (33.0, 45.0), 25.0, cable)
        cell = made_cell(fixturings=fixturings, camera_body=body.bodies(), clearance_mm=1.0)
        (told,) = cell.reach(camera[None], "up")
        assert told.reached is reached
        assert reached or "camera touches shelf" in told.why


def test_a_cell_without_the_outside_of_its_camera_says_so(tmp_path):
    bare = made_cell(camera_body=())
    assert bare.unchecked == (NO_CAMERA_BODY,)
    assert not has_camera_body(bare.to_dict()["parts"])
    held = made_cell(camera_body=BODY.bodies())
    assert held.unchecked == ()
    assert has_camera_body(held.to_dict()["parts"])
    assert held.difference(bare.to_dict()) == "camera_body"


FILE = """
cam2flange = {{ xyz = [0, 0, 90] }}
[robot]
urdf = "{robots}/made_parallel.urdf"
packages = {{ made_robots = "{robots}" }}
[camera]
housing = [40, 30, 50]
lens = [33, 45]
nodal_mm = 25
cable = {{ to_mm = [0, -60, -140], radius_mm = 20 }}
[fixturings.up]
part2base = {{ xyz = [700, 0, 60] }}
"""


def test_a_cell_file_states_its_camera(tmp_path):
    path = tmp_path / "cell.toml"
    text = FILE.format(robots=ROBOTS)
    path.write_text(text, encoding="utf-8")
    read = Cell.from_toml(path)
    made = made_cell(
        camera_body=BODY.bodies(), fixturings={"up": Fixturing(pose((700.0, 0.0, 60.0)))}
    )
    name = "camera_body"
    assert read.to_dict()["parts"][name] == made.to_dict()["parts"][name]
    wrong = {
        'housing = "basler-ac"': "camera.housing must be a housing of the catalogue.*nearest",
        "housing = [1, 2]": "camera.housing must be 3 numbers of at least 1 mm",
        "housing = [1, 2, -3]": r"camera.housing must be 3 numbers .* Got \[1, 2, -3\]\.$",
        "housing = [0.04, 0.03, 0.05]": r"camera.housing must be 3 numbers .*; are they in m\?$",
        "housing = [true, 30, 50]": "camera.housing must be 3 numbers of at least 1 mm",
        'housing = ["40", "30", "50"]': "camera.housing must be 3 numbers of at least 1 mm",
    }
    for line, message in wrong.items():
        path.write_text(text.replace("housing = [40, 30, 50]", line), encoding="utf-8")
        with pytest.raises(RobotError, match=message):
            Cell.from_toml(path)
    for old, new, message in (
        ("nodal_mm = 25", "nodal_mm = -2", "camera.nodal_mm must"),
        ("radius_mm = 20", "radius_mm = 0", "camera.cable.radius_mm must be positive"),
        ("to_mm = [0, -60, -140]", "to_mm = [0]", "camera.cable.to_mm must be 3 finite"),
    ):
        path.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(RobotError, match=message):
            Cell.from_toml(path)
