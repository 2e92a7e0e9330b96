"""Calibrations of other programs: the numbers arrive in their places, and what is not understood is refused."""

import cv2
import numpy as np
import pytest
import yaml

from planner import Camera, CameraError

LENS = {"pixel_pitch_mm": 0.00345, "f_number": 8.0, "focus_distance_mm": 300.0}
MATRIX = [2320.5, 0.0, 1240.25, 0.0, 2318.25, 1010.75, 0.0, 0.0, 1.0]
FIVE = [-0.12, 0.08, 4e-4, -3e-4, 0.01]


def read(tmp_path, text, name):
    path = tmp_path / name
    path.write_text(text)
    return Camera.from_calibration(path, **LENS)


@pytest.mark.parametrize(
    ("line", "scales", "coefficients"),
    [
        ("SIMPLE_PINHOLE 2448 2048 2300 1224 1024", (2300, 2300, 1223.5, 1023.5), None),
        ("PINHOLE 2448 2048 2300 2310 1224 1024", (2300, 2310, 1223.5, 1023.5), None),
        (
            "SIMPLE_RADIAL 2448 2048 2300 1224 1024 -0.1",
            (2300, 2300, 1223.5, 1023.5),
            (-0.1, 0, 0, 0, 0),
        ),
        (
            "RADIAL 2448 2048 2300 1224 1024 -0.1 0.05",
            (2300, 2300, 1223.5, 1023.5),
            (-0.1, 0.05, 0, 0, 0),
        ),
        (
            "OPENCV 2448 2048 2300 2310 1240.25 1000.5 -0.1 0.05 1e-3 -2e-3",
            (2300, 2310, 1239.75, 1000.0),
            (-0.1, 0.05, 1e-3, -2e-3, 0),
        ),
        (
            "FULL_OPENCV 2448 2048 2300 2310 1240.25 1000.5 -0.1 0.05 1e-3 -2e-3 0.02 0 0 0",
            (2300, 2310, 1239.75, 1000.0),
            (-0.1, 0.05, 1e-3, -2e-3, 0.02),
        ),
    ],
)
def test_colmap_models(tmp_path, line, scales, coefficients):
    camera = read(tmp_path, f"# Camera list\n\n1 {line}\n", "cameras.txt")
    matrix = camera.matrix
    assert (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]) == pytest.approx(
        scales, rel=1e-13
    )
    assert (None if camera.distortion is None else camera.distortion.coefficients) == coefficients
    assert camera.resolution == (2448, 2048)
    assert camera.name == "cameras"


CALIBRATION_YAML = f"""image_width: 2448
image_height: 2048
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: {MATRIX}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: {FIVE}}}
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
"""
ROS1_MESSAGE = f"""header:
  seq: 7
  frame_id: "camera"
height: 2048
width: 2448
distortion_model: "plumb_bob"
D: {FIVE}
K: {MATRIX}
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  height: 0
  width: 0
"""
ROS2_MESSAGE = (
    "height: 2048\nwidth: 2448\ndistortion_model: rational_polynomial\n"
    + yaml.safe_dump({"d": [*FIVE, 0.0, 0.0, 0.0], "k": MATRIX, "binning_x": 1})
)


@pytest.mark.parametrize("text", [CALIBRATION_YAML, ROS1_MESSAGE, ROS2_MESSAGE + "---\n"])
def test_ros_cameras(tmp_path, text):
    # they are YAML indeed
    assert isinstance(yaml.safe_load(text.removesuffix("---\n")), dict)
    camera = read(tmp_path, text, "left.yaml")
    np.testing.assert_allclose(camera.matrix.ravel(), MATRIX, rtol=1e-13)
    assert camera.distortion.coefficients == tuple(FIVE)
    assert camera.resolution == (2448, 2048)


def test_files_of_opencvs_own_calibration_program(tmp_path):
    path = tmp_path / "out_camera_data.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon Nov 23 12:00:00")
    storage.write("image_width", 2448)
    storage.write("image_height", 2048)
    storage.write("camera_matrix", np.reshape(MATRIX, (3, 3)))
    storage.write("distortion_coefficients", np.reshape(FIVE, (5, 1)))
    storage.write("avg_reprojection_error", 0.21)
    storage.release()
    camera = Camera.from_calibration(path, **LENS)
    np.testing.assert_allclose(camera.matrix.ravel(), MATRIX, rtol=1e-13)
    assert camera.distortion.coefficients == tuple(FIVE)
    assert camera.resolution == (2448, 2048)


def test_toml_may_name_a_calibration(tmp_path):
    (tmp_path / "left.yaml").write_text(CALIBRATION_YAML)
    lens = "pixel_pitch_mm = 0.00345\nf_number = 8.0\nfocus_distance_mm = 300.0\n"
    (tmp_path / "camera.toml").write_text('calibration = "left.yaml"\n' + lens)
    camera = Camera.from_toml(tmp_path / "camera.toml")
    assert camera.name == "camera"
    np.testing.assert_allclose(camera.matrix.ravel(), MATRIX, rtol=1e-13)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("cameras.txt", "", "must be a calibration of ROS.*Got an empty file"),
        ("cameras.txt", "# CAMERA_ID, MODEL, WIDTH\n", "must hold one camera. Got 0"),
        (
            "cameras.txt",
            "1 PINHOLE 9 9 1 1 1 1\n2 PINHOLE 9 9 1 1 1 1\n",
            "must hold one camera.*Got 2",
        ),
        (
            "cameras.txt",
            "1 OPENCV_FISHEYE 9 9 1 1 1 1 0 0 0 0\n",
            "model must be one of .*Got 'OPENCV_FISHEYE'",
        ),
        ("cameras.txt", "1 PINHOLE 9 9 1 1 1\n", "PINHOLE must have 4 parameters. Got 3"),
        ("cameras.txt", "1 PINHOLE 9 9 1 1 1 x\n", "numbers must follow"),
        ("a.yaml", "width: 9\n", "image_height must be given. Got width"),
        (
            "a.yaml",
            ROS1_MESSAGE.replace("D: ", "# D: "),
            "distortion_coefficients must be given",
        ),
        ("a.yaml", "d: []\nwidth: 9\nheight: 9\nk: [1, 2]\n", "k must be 9 numbers. Got 2"),
        (
            "a.yaml",
            ROS1_MESSAGE.replace("plumb_bob", "equidistant"),
            "distortion_model must be plumb_bob",
        ),
        (
            "a.yaml",
            ROS1_MESSAGE.replace("binning_x: 0", "binning_x: 2.5"),
            "binning_x must be a whole number. Got 2.5",
        ),
        ("a.yaml", ROS2_MESSAGE.replace("- 0.01", "- 0.01\n- 0.5"), "no coefficients beyond"),
        ("a.yaml", CALIBRATION_YAML.replace("[2320.5, 0.0,", "[2320.5, 1.0,"), "no skew"),
    ],
)
def test_what_is_not_understood_is_refused(tmp_path, name, text, message):
    with pytest.raises(CameraError, match=message):
        read(tmp_path, text, name)


def test_file_that_is_not_there(tmp_path):
    with pytest.raises(CameraError, match=r"none\.yaml: camera file cannot be read"):
        Camera.from_calibration(tmp_path / "none.yaml", **LENS)


def test_own_pose_files_are_read_back(tmp_path):
    from plan_examples import plan

    from planner.report.pose_files import write_poses

    camera = Camera.from_opencv(np.reshape(MATRIX, (3, 3)), FIVE, (2448, 2048), **LENS)
    write_poses(plan(camera=camera), tmp_path)
    for name in ("colmap/cameras.txt", "camera_ros.yaml"):
        again = Camera.from_calibration(tmp_path / name, **LENS)
        np.testing.assert_allclose(again.matrix, camera.matrix, rtol=1e-13)
        assert again.distortion == camera.distortion
