"""Every format is read back by its own rules (or its own library) and must put one known point on the same pixel."""

import dataclasses
import json
import re

import cv2
import numpy as np
import open3d
import pytest
import yaml
from plan_examples import CAMERA, LIGHT, plan

from planner import Camera, OutputError
from planner.report.plan_folder import inverse, write_poses
from planner.sensor_setting import image_name

POINT = np.array([37.0, 12.0, 55.0])


def pixel(cam2world):
    """Project by the definition: pixel coordinates with (0, 0) at the centre of the first pixel."""
    x, y, z = cam2world[:3, :3].T @ (POINT - cam2world[:3, 3])
    d = CAMERA.image_distance_mm
    return [1223.5 + d * x / z / 0.00345, 1023.5 + d * y / z / 0.0035]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("poses")
    write_poses(plan(), path)
    return path


@pytest.fixture(params=[0, 1], scope="module")
def k(request):
    return request.param


@pytest.fixture
def expected(k):
    return pytest.approx(pixel(plan().settings[k].cam2world), abs=1e-6)


def test_point_is_inside_the_image(k):
    u, v = pixel(plan().settings[k].cam2world)
    assert 0 < u < 2447
    assert 0 < v < 2047
    assert abs(u - 1223.5) + abs(v - 1023.5) > 50


def test_images_under_lamps_say_what_to_expose_for(tmp_path):
    lit = plan(light=LIGHT)
    two = dataclasses.replace(LIGHT, images=(LIGHT.images[0] + LIGHT.images[1], ()))
    for light, names in (
        (LIGHT, ["setting_01.png"]),
        (two, ["setting_01_1.png", "setting_01_2.png"]),
    ):
        write_poses(dataclasses.replace(lit, light=light), tmp_path)
        settings = json.loads((tmp_path / "poses_opencv.json").read_text())["settings"]
        assert [one["name"] for one in settings[0]["images"]] == names
        # whoever reads the images by these files finds each of them
        every = [*names, "setting_02.png"]
        frames = json.loads((tmp_path / "transforms.json").read_text())["frames"]
        assert [frame["file_path"] for frame in frames] == [f"images/{name}" for name in every]
        poses = [frame["transform_matrix"] for frame in frames]
        assert all(pose == poses[0] for pose in poses[: len(names)])
        rows = (tmp_path / "colmap" / "images.txt").read_text().splitlines()[2::2]
        assert [(row.split()[0], row.split()[9]) for row in rows] == [
            (str(number), name) for number, name in enumerate(every, start=1)
        ]
        found = settings[0]["images"][0]
        assert found["lamps"] == [[40.0, -300.0, 500.0]]
        assert found["entities"] == ["top front", "top right"]
        exposed = {
            "target": "top right",
            "pixel": [1200, 800],
            "dimmest": "top front",
            "times": 2.5,
            "radius_px": 0,
            "share": 0.8,
        }
        assert found["expose_for"] == exposed
    assert settings[0]["images"][1]["expose_for"] is None
    assert settings[1]["images"] == []


def test_poses_without_lamps_have_no_images(folder):
    settings = json.loads((folder / "poses_opencv.json").read_text())["settings"]
    assert all("images" not in one for one in settings)


def test_opencv(folder, k, expected):
    data = json.loads((folder / "poses_opencv.json").read_text())
    found = data["settings"][k]
    for rotation in (np.array(found["rvec"]), cv2.Rodrigues(np.array(found["R"]))[0]):
        uv, _ = cv2.projectPoints(
            POINT[None], rotation, np.array(found["t"]), np.array(data["K"]), None
        )
        assert uv.ravel() == expected
    assert found["entities"] == list(plan().settings[k].entities)


def test_colmap(folder, k, expected):
    cameras = (folder / "colmap/cameras.txt").read_text().splitlines()[1].split()
    assert cameras[:4] == ["1", "PINHOLE", "2448", "2048"]
    fx, fy, cx, cy = map(float, cameras[4:])
    lines = [
        line
        for line in (folder / "colmap/images.txt").read_text().splitlines()
        if not line.startswith("#")
    ]
    fields = lines[2 * k].split()
    assert lines[2 * k + 1] == ""
    assert fields[0] == str(k + 1)
    assert fields[9] == image_name(k)
    w, qx, qy, qz, tx, ty, tz = map(float, fields[1:8])
    # rotation by a unit quaternion: v + 2w (q x v) + 2 q x (q x v)
    q = np.array([qx, qy, qz])
    x, y, z = (
        POINT + 2 * w * np.cross(q, POINT) + 2 * np.cross(q, np.cross(q, POINT)) + [tx, ty, tz]
    )
    assert [fx * x / z + cx - 0.5, fy * y / z + cy - 0.5] == expected


def test_open3d(folder, k, expected):
    trajectory = open3d.io.read_pinhole_camera_trajectory(str(folder / "poses_open3d.json"))
    parameters = trajectory.parameters[k]
    assert parameters.intrinsic.width == 2448
    local = parameters.extrinsic @ [*POINT, 1.0]
    u, v, w = parameters.intrinsic.intrinsic_matrix @ local[:3]
    assert [u / w, v / w] == expected


def test_ros(folder, k, expected):
    number = r"(-?\d+\.\d+)"
    text = (folder / "poses_ros.yaml").read_text()
    positions = re.findall(rf"- position: {{x: {number}, y: {number}, z: {number}}}", text)
    quaternions = re.findall(
        rf"  orientation: {{x: {number}, y: {number}, z: {number}, w: {number}}}", text
    )
    assert len(positions) == len(quaternions) == 2
    x, y, z, w = map(float, quaternions[k])
    q = np.array([-x, -y, -z])
    offset = POINT - 1000.0 * np.array(positions[k], dtype=float)
    local = offset + 2 * w * np.cross(q, offset) + 2 * np.cross(q, np.cross(q, offset))
    u, v, w = CAMERA.matrix @ local
    assert [u / w, v / w] == expected


def test_nerfstudio(folder, k, expected):
    data = json.loads((folder / "transforms.json").read_text())
    assert data["camera_model"] == "OPENCV"
    frame = data["frames"][k]
    # OpenGL camera: looks along -z with y up, pixel corners at whole numbers
    x, y, z, _ = np.linalg.inv(frame["transform_matrix"]) @ [*POINT, 1.0]
    assert z < 0
    u = data["fl_x"] * x / -z + data["cx"]
    v = data["fl_y"] * -y / -z + data["cy"]
    assert [u - 0.5, v - 0.5] == expected
    assert frame["file_path"].endswith(image_name(k))


FAR = np.array([170.0, 95.0, 20.0])
SCALES = 3000.0, 2960.0, 1240.25, 1001.5
# a calibrated camera: off centre, unequal scales, distortion with and without k3
CALIBRATED = {
    k3: Camera.from_opencv(
        [[3000.0, 0, 1240.25], [0, 2960.0, 1001.5], [0, 0, 1]],
        [-0.3, 0.2, 1e-3, -2e-3, k3],
        (2448, 2048),
        pixel_pitch_mm=0.00345,
        f_number=8.0,
        focus_distance_mm=600.0,
    )
    for k3 in (0.0, 0.05)
}


@pytest.fixture(params=CALIBRATED, scope="module")
def k3(request):
    return request.param


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory, k3):
    path = tmp_path_factory.mktemp("calibrated")
    write_poses(plan(camera=CALIBRATED[k3]), path)
    return path


@pytest.fixture
def distorted(k, k3):
    """The pixel by the equations of Brown and Conrady, written out."""
    pose = plan().settings[k].cam2world
    local = pose[:3, :3].T @ (FAR - pose[:3, 3])
    return pytest.approx(brown_conrady(local, SCALES, (-0.3, 0.2, 1e-3, -2e-3, k3)), abs=1e-6)


def brown_conrady(local, scales, coefficients):
    (fx, fy, cx, cy) = scales
    (k1, k2, p1, p2, k3) = coefficients
    x = local[0] / local[2]
    y = local[1] / local[2]
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    v = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return [fx * u + cx, fy * v + cy]


def test_distortion_matters_here(k, k3, distorted):
    pose = plan().settings[k].cam2world
    plain = brown_conrady(pose[:3, :3].T @ (FAR - pose[:3, 3]), SCALES, [0.0] * 5)
    assert np.abs(np.subtract(plain, distorted.expected)).max() > 0.2


def test_opencv_with_distortion(calibrated, k, distorted):
    data = json.loads((calibrated / "poses_opencv.json").read_text())
    found = data["settings"][k]
    lens = np.array(data["K"]), np.array(data["distortion"])
    uv, _ = cv2.projectPoints(FAR[None], np.array(found["rvec"]), np.array(found["t"]), *lens)
    assert uv.ravel() == distorted


def test_colmap_with_distortion(calibrated, k, k3, distorted):
    fields = (calibrated / "colmap/cameras.txt").read_text().splitlines()[1].split()
    fx, fy, cx, cy, k1, k2, p1, p2, *more = map(float, fields[4:])
    assert (fields[1], more) == (("FULL_OPENCV", [k3, 0.0, 0.0, 0.0]) if k3 else ("OPENCV", []))
    local = inverse(plan().settings[k].cam2world) @ [*FAR, 1.0]
    # the first pixel's centre is (0.5, 0.5)
    assert brown_conrady(local, (fx, fy, cx - 0.5, cy - 0.5), (k1, k2, p1, p2, k3)) == distorted


def test_ros_camera(calibrated, k, distorted):
    data = yaml.safe_load((calibrated / "camera_ros.yaml").read_text())
    assert (data["image_width"], data["image_height"], data["distortion_model"]) == (
        2448,
        2048,
        "plumb_bob",
    )
    local = inverse(plan().settings[k].cam2world) @ [*FAR, 1.0]
    matrix = np.reshape(data["camera_matrix"]["data"], (3, 3))
    np.testing.assert_array_equal(
        np.reshape(data["projection_matrix"]["data"], (3, 4))[:, :3], matrix
    )
    scales = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    assert brown_conrady(local, scales, data["distortion_coefficients"]["data"]) == distorted


def test_nerfstudio_with_distortion(calibrated, k, distorted):
    data = json.loads((calibrated / "transforms.json").read_text())
    x, y, z, _ = np.linalg.inv(data["frames"][k]["transform_matrix"]) @ [*FAR, 1.0]
    scales = data["fl_x"], data["fl_y"], data["cx"] - 0.5, data["cy"] - 0.5
    coefficients = (*(data[name] for name in ("k1", "k2", "p1", "p2")), data.get("k3", 0.0))
    assert brown_conrady([x, -y, -z], scales, coefficients) == distorted


def test_open3d_is_for_undistorted_images(calibrated, k):
    trajectory = open3d.io.read_pinhole_camera_trajectory(str(calibrated / "poses_open3d.json"))
    pose = plan().settings[k].cam2world
    local = pose[:3, :3].T @ (FAR - pose[:3, 3])
    u, v, w = trajectory.parameters[k].intrinsic.intrinsic_matrix @ local
    undistorted = brown_conrady(local, SCALES, [0.0] * 5)
    assert [u / w, v / w] == pytest.approx(undistorted, abs=1e-6)
    assert "undistorted" in json.loads((calibrated / "poses_open3d.json").read_text())["comment"]


def test_plan_without_settings_is_still_well_formed(tmp_path):
    empty = plan(
        settings=(), lower_bound=0, uninspectable=dict.fromkeys(plan().entities, "unobservable")
    )
    assert len(write_poses(empty, tmp_path)) == 8
    assert "poses: []" in (tmp_path / "poses_ros.yaml").read_text()
    assert json.loads((tmp_path / "transforms.json").read_text())["frames"] == []


def test_a_folder_that_is_not_there_is_made(tmp_path):
    folder = tmp_path / "new" / "poses"
    files = write_poses(plan(), folder)
    assert sorted(path for path in folder.rglob("*") if path.is_file()) == files
    with pytest.raises(OutputError, match=r"^folder must be a folder\."):
        write_poses(plan(), files[0])


def test_inverse_undoes_a_pose():
    pose = plan().settings[0].cam2world
    assert inverse(pose) @ pose == pytest.approx(np.eye(4), abs=1e-12)
