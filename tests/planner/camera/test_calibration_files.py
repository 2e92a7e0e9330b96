"""Files of ROS, OpenCV, Kalibr and Autoware: read as their programs mean them, or refused by name."""

import json

import cv2
import numpy as np
import pytest
import yaml

from planner import Camera, CameraError

LENS = {"pixel_pitch_mm": 0.00345, "f_number": 8.0, "focus_distance_mm": 300.0}
K = [1200.0, 0.0, 639.5, 0.0, 1201.0, 479.5, 0.0, 0.0, 1.0]
FIVE = [-0.1, 0.05, 0.001, -0.0005, 0.0]
MESSAGE = {
    **{"width": 2448, "height": 2048, "distortion_model": "plumb_bob"},
    **{"d": [-0.12, 0.08, 4e-4, -3e-4, 0.01]},
    **{"k": [2320.5, 0.0, 1240.25, 0.0, 2318.25, 1010.75, 0.0, 0.0, 1.0]},
}
OPENCV = {
    "image_width": 1280,
    "image_height": 960,
    "camera_matrix": {"rows": 3, "cols": 3, "data": K},
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": FIVE},
}
KALIBR = {
    "camera_model": "pinhole",
    "cam_overlaps": [],
    "distortion_coeffs": FIVE[:4],
    "distortion_model": "radtan",
    "intrinsics": [1200.0, 1201.0, 639.5, 479.5],
    "resolution": [1280, 960],
    "rostopic": "/cam0/image_raw",
}
AUTOWARE = f"""%YAML:1.0
---
CameraExtrinsicMat: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [ 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1. ]
CameraMat: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: {K}
DistCoeff: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: {FIVE}
ImageSize: [ 1280, 960 ]
ReprojectionError: 0.31
DistModel: plumb_bob
"""


def read(tmp_path, content, name="cal.yaml"):
    text = content if isinstance(content, str) else yaml.safe_dump(content)
    (tmp_path / name).write_text(text)
    return Camera.from_calibration(tmp_path / name, **LENS)


def known(camera):
    """What a file states of a camera, rounded to 13 digits."""
    matrix = [float(f"{value:.13g}") for value in camera.matrix.ravel()]
    return matrix, camera.distortion.coefficients, camera.resolution


KNOWN = K, tuple(FIVE), (1280, 960)


@pytest.mark.parametrize(
    ("region", "binning"),
    [((1024, 824, 400, 401), (0, 0)), ((0, 0, 0, 0), (2, 4)), ((601, 402, 1299, 1203), (2, 3))],
)
def test_roi_and_binning_are_of_the_delivered_image(tmp_path, region, binning):
    # the pixels that REP 104 delivers, found by counting: cut the region out, then join its pixels
    across, down = (max(factor, 1) for factor in binning)
    left, top, width, height = region if any(region) else (0, 0, 2448, 2048)
    columns = np.arange(left, left + width)[: width // across * across].reshape(-1, across)
    rows = np.arange(top, top + height)[: height // down * down].reshape(-1, down)
    roi = dict(zip(("x_offset", "y_offset", "width", "height"), region, strict=True))
    message = {**MESSAGE, "binning_x": binning[0], "binning_y": binning[1], "roi": roi}
    camera = read(tmp_path, message)
    assert camera.resolution == (len(columns), len(rows))
    # the first and the last delivered pixel look where OpenCV says their middles do
    ends = np.array([[columns[k].mean(), rows[k].mean()] for k in (0, -1)])
    true = cv2.undistortPoints(ends, np.reshape(MESSAGE["k"], (3, 3)), np.array(MESSAGE["d"]))
    ours = np.array([[0.0, 0.0], [len(columns) - 1, len(rows) - 1]])
    ideal = (ours - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    found = camera.distortion.undistort(ideal)
    np.testing.assert_allclose(found, true.reshape(-1, 2), atol=1e-6)
    # the lens does not change, and pixels of the image have the size of those that they join
    whole = read(tmp_path, MESSAGE)
    assert camera.image_distance_mm == pytest.approx(whole.image_distance_mm, rel=1e-13)
    factors = np.array(camera.pixel_pitch_mm) / whole.pixel_pitch_mm
    np.testing.assert_allclose(factors, (across, down), rtol=1e-13)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ({"x_offset": 2400, "width": 100, "height": 9}, "roi must be in the image of 2448 x 2048"),
        ({"x_offset": 5}, "roi must be in the image"),
        ({"x_offset": 0, "width": 100, "height": 100}, "roi must hold the principal point"),
        ({"x_offset": -1, "width": 9, "height": 9}, "x_offset of roi must be a whole number"),
        ({"left": 1}, "roi must hold x_offset.*Got left"),
        ([1, 2, 3, 4], "roi must hold keys"),
    ],
)
def test_regions_that_cannot_be(tmp_path, region, message):
    with pytest.raises(CameraError, match=message):
        read(tmp_path, {**MESSAGE, "roi": region})


def test_a_calibration_with_the_points_of_all_images_is_read(tmp_path):
    points = [[k / 7, k / 9] for k in range(18_000)]
    assert known(read(tmp_path, json.dumps({**OPENCV, "image_points": points}))) == KNOWN


@pytest.mark.parametrize(
    "key",
    ["model_type", "distortion_model", "camera_model", "model", "distortion_type", "DistModel"],
)
@pytest.mark.parametrize("model", ["KANNALA_BRANDT", "equidistant", "mei", "fisheye", 7])
def test_other_lens_models_are_refused_by_name(tmp_path, key, model):
    with pytest.raises(CameraError, match=rf"{key} must be .*Got {model}\."):
        read(tmp_path, {**OPENCV, key: model})
    # a fisheye lens without coefficients is no pinhole
    zero = {**OPENCV, "distortion_coefficients": {"rows": 1, "cols": 4, "data": [0.0] * 4}}
    with pytest.raises(CameraError, match=rf"{key} must be .*Got {model}\."):
        read(tmp_path, {**zero, key: model})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *[("distortion_model", name) for name in ("plumb_bob", "radtan", "Radial-Tangential")],
        *[("camera_model", "plumb_bob"), ("model_type", "PINHOLE"), ("fisheye_model", 0)],
        *[("fisheye_model", False), ("flags", 2), ("aspectRatio", 1.0)],
        ("rectification_matrix", {"rows": 3, "cols": 3, "data": [0, 1, 0, -1, 0, 0, 0, 0, 1]}),
        ("projection_matrix", {"rows": 3, "cols": 4, "data": [9.0] * 12}),
    ],
)
def test_what_changes_nothing_is_read(tmp_path, key, value):
    assert known(read(tmp_path, {**OPENCV, key: value})) == KNOWN


def test_no_distortion_has_no_coefficients(tmp_path):
    bare = {key: KALIBR[key] for key in KALIBR if key != "distortion_coeffs"}
    assert read(tmp_path, {**bare, "distortion_model": "none"}).distortion is None
    with pytest.raises(CameraError, match="distortion_coeffs must be zero where distortion_model"):
        read(tmp_path, {**KALIBR, "distortion_model": "none"})


@pytest.mark.parametrize("key", ["fov", "Camera.RGB", "xi", "skew", "mirror", "distortion_order"])
def test_keys_that_are_not_known_are_refused(tmp_path, key):
    with pytest.raises(CameraError, match=f"{key} must be a key that is known here"):
        read(tmp_path, {**OPENCV, key: 1.0})


def test_keys_may_be_sorted_and_lists_nested(tmp_path):
    # PyYAML sorts: cols, data, rows
    assert yaml.safe_dump(OPENCV).index("data") < yaml.safe_dump(OPENCV).index("rows")
    assert known(read(tmp_path, OPENCV)) == KNOWN
    nested = {**OPENCV, "camera_matrix": np.reshape(K, (3, 3)).tolist(), "dist_coeff": [FIVE]}
    del nested["distortion_coefficients"]
    assert known(read(tmp_path, nested)) == KNOWN


def test_numbers_are_those_of_yaml_1_2(tmp_path):
    # yaml-cpp writes exponents without a point; PyYAML takes 1e-3 for a word
    text = yaml.safe_dump(OPENCV).replace("0.001", "1e-3").replace("-0.0005", "-5e-04")
    assert known(read(tmp_path, text)) == KNOWN
    with pytest.raises(CameraError, match=r"image_width must be .*Got '01280'\."):
        read(tmp_path, yaml.safe_dump(OPENCV).replace("1280", "01280"))


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("names", ["new", "old"])
def test_files_that_opencv_writes(tmp_path, suffix, names):
    path = tmp_path / f"camera.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    new = names == "new"
    storage.write("calibration_time" if new else "calibration_Time", "Mon 23 <Nov> 12:00")
    storage.write("image_width" if new else "image_Width", 1280)
    storage.write("image_height" if new else "image_Height", 960)
    storage.write("flags" if new else "flagValue", 6)
    storage.write("fisheye_model", 0)
    storage.write("camera_matrix" if new else "Camera_Matrix", np.reshape(K, (3, 3)))
    coefficients = np.reshape(FIVE, (5, 1))
    storage.write("distortion_coefficients" if new else "Distortion_Coefficients", coefficients)
    storage.write("image_points" if new else "Image_points", np.zeros((2, 4), np.float32))
    storage.release()
    assert known(Camera.from_calibration(path, **LENS)) == KNOWN


def test_kalibr_and_autoware(tmp_path):
    assert known(read(tmp_path, {"cam0": KALIBR})) == KNOWN
    assert known(read(tmp_path, KALIBR)) == KNOWN
    assert known(read(tmp_path, AUTOWARE)) == KNOWN
    assert known(read(tmp_path, json.dumps(OPENCV), "camera.json")) == KNOWN


XML = "<?xml version='1.0'?>\n<opencv_storage>{}</opencv_storage>"
BOMB = (
    '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "1280">]><opencv_storage>'
    "<image_width>&b;</image_width></opencv_storage>"
)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"cam0": KALIBR, "cam1": KALIBR}, "must hold one camera.*Got cam0, cam1"),
        ({"cam0": {**KALIBR, "distortion_model": "equidistant"}}, "Got equidistant"),
        ({"cam0": {**KALIBR, "camera_model": "omni"}}, "camera_model must be.*Got omni"),
        ({"cam0": {**KALIBR, "intrinsics": [1.0] * 5}}, "intrinsics must be 4 numbers"),
        (AUTOWARE.replace("plumb_bob", "fisheye"), "DistModel must be.*Got fisheye"),
        (AUTOWARE.replace("cols: 5", "cols: 4"), "must hold rows x cols numbers, 1 x 4. Got 5"),
        (AUTOWARE.replace("dt: d", "dt: 2d"), "CameraMat must state one number for each element"),
        (AUTOWARE.replace("!!opencv-matrix", "!!binary"), r":3: a tag must be.*Got !!binary"),
        ({**OPENCV, "image_width": "1280"}, "image_width must be a whole number. Got '1280'"),
        ({**OPENCV, "image_width": 0}, "image_width must be positive"),
        ({**OPENCV, "width": 1280}, "image_width must stand alone. Got width, too"),
        ({**OPENCV, "D": FIVE}, "distortion_coefficients must stand alone. Got D, too"),
        ({**MESSAGE, "D": FIVE}, "must stand once"),
        (
            yaml.safe_dump(OPENCV) + "image_width: 640\n",
            r":\d+: a key must stand once. Got image_w",
        ),
        ({**MESSAGE, "k": [1.0, 0, 0.5, 0, 1, 0.5, 0, 0, 1]}, "focal lengths in pixels. Got 1 "),
        (
            {**MESSAGE, "k": [900.0, 0, 9000, 0, 900, 9, 0, 0, 1]},
            "k must hold a principal point in",
        ),
        ({**MESSAGE, "k": [0.0] * 9}, "positive focal lengths. Got 0: the camera was not calib"),
        ({**MESSAGE, "k": [900.0, 0, 0, 0, 900, 0, 600, 500, 1]}, "last row 0, 0, 1"),
        ({**MESSAGE, "k": [900.0, 2, 600, 0, 900, 500, 0, 0, 1]}, "k must have no skew. Got 2"),
        ({**MESSAGE, "k": "900"}, "k must be a list of numbers"),
        ({**MESSAGE, "k": ["900", *MESSAGE["k"][1:]]}, "k must hold numbers. Got '900'"),
        ({**MESSAGE, "d": [0.1, 0.2]}, "d must be 4 or 5 numbers"),
        ({**MESSAGE, "d": [float("inf"), 0, 0, 0, 0]}, "finite numbers. Got inf for k1"),
        (yaml.safe_dump(MESSAGE) + "---\n" + yaml.safe_dump(MESSAGE), "Got 2 YAML documents"),
        ("width: [1, 2\n", r":\d: camera file must be a calibration; as YAML it is broken"),
        ("a: &a\n  <<: *a\n", "a key must be a word"),
        ("width: *a\n", "an alias must follow what it stands for. Got a"),
        ("width: &a [*a]\n", "an alias must not stand for what it is in"),
        ("- " * 800, "must not nest its parts so deep"),
        (XML.format("<a>" * 2000 + "</a>" * 2000), "must not nest its parts so deep"),
        ("width: " + "9" * 1_000_000, "must have at most 1000000 characters"),
        (BOMB, "XML must have no DOCTYPE. Got opencv_storage|XML must have no DOCTYPE. Got a"),
        ("<cameras><camera/></cameras>", "XML must be of OpenCV.*Got <cameras>"),
        (XML.format("<a>"), r":\d+: camera file must be.*as XML it is broken"),
        (XML.format("<image_width>9</image_width><image_width>8</image_width>"), "stand once"),
    ],
)
def test_files_that_are_not_understood(tmp_path, content, message):
    with pytest.raises(CameraError, match=message):
        read(tmp_path, content)


@pytest.mark.parametrize(
    ("text", "got"),
    [
        ("ISO-10303-21;\nHEADER;\n", "text that is neither"),
        ("focal_length_mm: 25\n", "the keys focal_length_mm"),
        ("# nothing\n", "text that is neither"),
        ("- 1\n- 2\n", "text that is neither"),
    ],
)
@pytest.mark.parametrize("name", ["part.step", "camera.txt", "camera.yaml"])
def test_files_that_are_no_calibration_are_refused_as_such(tmp_path, text, got, name):
    with pytest.raises(CameraError, match=f"must be a calibration of ROS.*Got {got}") as error:
        read(tmp_path, text, name)
    assert "must hold one camera" not in str(error.value)


# Calibrations of other programs: the numbers arrive in their places, and what is not understood
# is refused.


MATRIX = [2320.5, 0.0, 1240.25, 0.0, 2318.25, 1010.75, 0.0, 0.0, 1.0]
FIVE_READERS = [-0.12, 0.08, 4e-4, -3e-4, 0.01]


def read_readers(tmp_path, text, name):
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
    camera = read_readers(tmp_path, f"# Camera list\n\n1 {line}\n", "cameras.txt")
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
distortion_coefficients: {{rows: 1, cols: 5, data: {FIVE_READERS}}}
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
D: {FIVE_READERS}
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
    + yaml.safe_dump({"d": [*FIVE_READERS, 0.0, 0.0, 0.0], "k": MATRIX, "binning_x": 1})
)


@pytest.mark.parametrize("text", [CALIBRATION_YAML, ROS1_MESSAGE, ROS2_MESSAGE + "---\n"])
def test_ros_cameras(tmp_path, text):
    # they are YAML indeed
    assert isinstance(yaml.safe_load(text.removesuffix("---\n")), dict)
    camera = read_readers(tmp_path, text, "left.yaml")
    np.testing.assert_allclose(camera.matrix.ravel(), MATRIX, rtol=1e-13)
    assert camera.distortion.coefficients == tuple(FIVE_READERS)
    assert camera.resolution == (2448, 2048)


def test_files_of_opencvs_own_calibration_program(tmp_path):
    path = tmp_path / "out_camera_data.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon Nov 23 12:00:00")
    storage.write("image_width", 2448)
    storage.write("image_height", 2048)
    storage.write("camera_matrix", np.reshape(MATRIX, (3, 3)))
    storage.write("distortion_coefficients", np.reshape(FIVE_READERS, (5, 1)))
    storage.write("avg_reprojection_error", 0.21)
    storage.release()
    camera = Camera.from_calibration(path, **LENS)
    np.testing.assert_allclose(camera.matrix.ravel(), MATRIX, rtol=1e-13)
    assert camera.distortion.coefficients == tuple(FIVE_READERS)
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
        read_readers(tmp_path, text, name)


def test_file_that_is_not_there(tmp_path):
    with pytest.raises(CameraError, match=r"none\.yaml: camera file cannot be read"):
        Camera.from_calibration(tmp_path / "none.yaml", **LENS)


def test_own_pose_files_are_read_back(tmp_path):
    from plan_examples import plan

    from planner.report.plan_folder import write_poses

    camera = Camera.from_opencv(np.reshape(MATRIX, (3, 3)), FIVE_READERS, (2448, 2048), **LENS)
    write_poses(plan(camera=camera), tmp_path)
    for name in ("colmap/cameras.txt", "camera_ros.yaml"):
        again = Camera.from_calibration(tmp_path / name, **LENS)
        np.testing.assert_allclose(again.matrix, camera.matrix, rtol=1e-13)
        assert again.distortion == camera.distortion
