"""A ChArUco board on the plate, rendered: where the camera is, and what is refused."""

import re

import numpy as np
import pytest
from measured_plate import (
    CAMERA,
    POSES,
    UNCERTAINTY,
    fine_plate,
    measured_plan,
    photograph,
    thick_plate,
)

from planner import Registration, RequestError, measure
from planner.measuring.images import Picture
from planner.measuring.registered import displaced
from planner.measuring.registration import MARKERS, Fiducials, NoFiducialsError, locate
from planner.measuring.task import NotRegisteredError

cv2 = pytest.importorskip("cv2")
# on the top, between the holes; z of the board points into the part, so that x and y are as in the image of it
BOARD = {
    "squares": (3, 4),
    "square_mm": 6.5,
    "marker_mm": 5.0,
    "dictionary": "DICT_4X4_50",
    "board2part": [[1.0, 0, 0, 31.0], [0, -1, 0, 38.0], [0, 0, -1, 40.0], [0, 0, 0, 1]],
    "sigma_mm": 0.01,
    "sigma_rad": 0.0005,
}
FINE = 40


def with_board(image, pose, rng):
    """An image with the board on the plate: its print, carried into the image by the camera matrix."""
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((3, 4), 6.5, 5.0, markers)
    size = (int(3 * 6.5 * FINE), int(4 * 6.5 * FINE))
    ink = board.generateImage(size, marginSize=0).astype(np.float64)
    # pixels of the print to millimetres on the board
    scale = np.array([[1 / FINE, 0, 0.5 / FINE], [0, 1 / FINE, 0.5 / FINE], [0, 0, 1]])
    to_camera = np.linalg.inv(pose) @ np.array(BOARD["board2part"])
    plane = CAMERA.matrix @ to_camera[:3, [0, 1, 3]] @ scale
    # several subpixels each way
    many = 6
    finer = np.array([[many, 0, (many - 1) / 2], [0, many, (many - 1) / 2], [0, 0, 1.0]])
    shape = (image.shape[1] * many, image.shape[0] * many)
    covered = cv2.warpPerspective(np.ones_like(ink), finer @ plane, shape)
    drawn = cv2.warpPerspective(40 + 0.6 * ink, finer @ plane, shape)
    share, grey = (
        cv2.resize(one, image.shape[::-1], interpolation=cv2.INTER_AREA) for one in (covered, drawn)
    )
    share, grey = (cv2.GaussianBlur(one, (0, 0), 0.7) for one in (share, grey))
    mixed = image * (1 - share) + grey + rng.normal(0, 1.0, image.shape) * share
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def stated_at(x):
    pose = np.array(BOARD["board2part"])
    pose[0, 3] = x
    return pose


@pytest.fixture(scope="module")
def real():
    rng = np.random.default_rng(8)
    moves = rng.normal(size=(2, 6)) * UNCERTAINTY.sigmas * 2
    return [displaced(pose, move)[0] for pose, move in zip(POSES, moves, strict=True)]


@pytest.fixture(scope="module")
def images(real):
    rng = np.random.default_rng(9)
    plain = photograph(fine_plate(left=0.05), real)
    return {k + 1: with_board(plain[k + 1], pose, rng) for k, pose in enumerate(real)}


@pytest.fixture(scope="module")
def board():
    return Fiducials(**BOARD)


def test_corners_are_found_where_they_are(board, images, real):
    points, found = board.corners(Picture.of("one", images[1], CAMERA))
    assert len(points) == 6
    local = (points - real[0][:3, 3]) @ real[0][:3, :3]
    true = (local / local[:, 2:] @ CAMERA.matrix.T)[:, :2]
    # no half pixel between conventions
    assert np.abs((found - true).mean(axis=0)).max() < 0.06
    assert np.abs(found - true).max() < 0.2


def test_the_pose_is_within_its_covariance(board, images, real):
    for k, pose in enumerate(POSES):
        picture = Picture.of("one", images[k + 1], CAMERA)
        found, covariance = locate(board, [picture], pose, UNCERTAINTY.covariance * 4)
        step = np.linalg.inv(found) @ real[k]
        off = np.array([*step[:3, 3], step[2, 1], step[0, 2], step[1, 0]])
        # 1 in 10,000 of six degrees of freedom
        assert off @ np.linalg.solve(covariance, off) < 27.9
        assert (np.diag(covariance) < np.diag(UNCERTAINTY.covariance * 4)).all()


def test_values_by_fiducials_and_by_both(board, images):
    solid = thick_plate()
    plan = measured_plan(solid, ["right"])
    alone = measure(plan, solid, images, registration=Registration.fiducials(board))["right"]
    both = measure(plan, solid, images, registration=Registration.both(board))["right"]
    for one in (alone, both):
        assert one.measured, one.reason
        assert abs(one.deviation) < one.expanded_uncertainty
    # what is found at both poses differs by single points
    assert both.standard_uncertainty <= 1.02 * alone.standard_uncertainty


@pytest.mark.parametrize("method", [Registration.fiducials, Registration.both])
def test_a_board_that_is_printed_too_small(images, method):
    """A print at 1 / 1.02 of its size is 98.0 % of it. The bore was read 0.071 mm too large by it, with U 0.035."""
    solid = thick_plate()
    plan = measured_plan(solid, ["right"])
    stated = Fiducials(**{**BOARD, "square_mm": 6.5 * 1.02, "marker_mm": 5.0 * 1.02})
    results = measure(plan, solid, images, registration=method(stated))
    assert not results["right"].measured
    for reason in results.failed.values():
        assert re.search(
            r"corners of the board are \d\.\d+ px off its pose, and corner_px is 0\.05", reason
        )
        percent = float(re.search(r"looks printed at (\d+\.\d) %", reason)[1])
        # 0.05 px on six corners of a board that is 80 px wide
        assert abs(percent - 100 / 1.02) < 0.15


@pytest.mark.parametrize(
    "change",
    [
        {"board2part": stated_at(81.0)},
        # turned about its own x by half a turn: its print is on the other side
        {"board2part": np.array(BOARD["board2part"]) @ np.diag([1.0, -1, -1, 1])},
        {"square_mm": 65.0, "marker_mm": 50.0},
    ],
    ids=["50 mm off", "from behind", "ten times as large"],
)
def test_a_board_that_is_elsewhere(images, change):
    stated = Fiducials(**{**BOARD, **change})
    picture = Picture.of("one", images[1], CAMERA)
    with pytest.raises(NotRegisteredError, match=r"board|standard deviations away"):
        locate(stated, [picture], POSES[0], UNCERTAINTY.covariance)


def test_images_of_one_setting_must_have_one_pose(board, images, real):
    """Of two images of one setting, one is from a pose that is 5 standard deviations off in x."""
    first = Picture.of("setting_01_1", images[1], CAMERA)
    rng = np.random.default_rng(10)
    moved = displaced(real[0], [0.5, 0, 0, 0, 0, 0])
    plain = photograph(fine_plate(left=0.05), moved, seed=2)[1]
    second = Picture.of("setting_01_2", with_board(plain, moved[0], rng), CAMERA)
    wide = UNCERTAINTY.covariance * 16
    with pytest.raises(
        NotRegisteredError, match="setting_01_1 and setting_01_2 do not fit one pose"
    ):
        locate(board, [first, second], POSES[0], wide)
    # the same camera with other noise
    again = with_board(photograph(fine_plate(left=0.05), real[:1], seed=3)[1], real[0], rng)
    locate(board, [first, Picture.of("setting_01_2", again, CAMERA)], POSES[0], wide)


def test_dictionaries_have_the_markers_that_are_stated():
    for name, count in MARKERS.items():
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        assert len(markers.bytesList) == count, name


def test_an_image_without_the_board(board, real):
    plain = Picture.of("one", photograph(fine_plate(), real[:1])[1], CAMERA)
    with pytest.raises(NoFiducialsError, match="only 0 corners of the board were found"):
        locate(board, [plain], POSES[0], UNCERTAINTY.covariance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"square_mm": 0}, "square_mm must be positive. Got 0"),
        ({"squares": (3, 1)}, "squares must be two numbers of at least 2"),
        ({"squares": 5}, "squares must be two numbers of at least 2. Got 5"),
        ({"squares": (True, 3)}, "squares must be two numbers of at least 2"),
        # a board has a marker in every second square, and this dictionary has 50
        ({"squares": (100_000, 100_000)}, "squares must be at most 101 in all with DICT_4X4_50"),
        ({"square_mm": float("nan")}, "square_mm must be positive. Got NaN"),
        ({"square_mm": 10**400}, "square_mm must be at most 1000"),
        ({"marker_mm": 6.5}, r"marker_mm must be below square_mm, 6\.5"),
        ({"sigma_mm": 1e200}, "sigma_mm must be at most 100"),
        ({"corner_px": 0}, "corner_px must be positive"),
        ({"dictionary": "CharucoDetector"}, "dictionary must be one of OpenCV"),
        ({"dictionary": ["DICT_4X4_50"]}, "dictionary must be one of OpenCV"),
        ({"board2part": [[1, 0], [0, 1]]}, "board2part must be a matrix"),
        ({"board2part": [[1, 0, 0, 0], [0, 1], [0], []]}, "board2part must be a matrix"),
        ({"board2part": {"a": 1}}, "board2part must be a matrix"),
        ({"board2part": np.diag([1.0, 1, -1, 1])}, "board2part must be .* Got a mirrored one"),
        ({"board2part": stated_at(np.nan)}, "board2part must be a matrix"),
        ({"board2part": stated_at(1e7)}, r"board2part must be within 1e\+06 mm"),
    ],
)
def test_boards_that_are_refused(change, message):
    with pytest.raises(RequestError, match=message):
        Fiducials(**{**BOARD, **change})


def test_a_file(tmp_path):
    lines = [
        f"{name} = {list(value) if isinstance(value, tuple) else value!r}"
        for name, value in BOARD.items()
    ]
    path = tmp_path / "dots.toml"
    path.write_text("\n".join(lines))
    assert Fiducials.read(path).squares == (3, 4)
    path.write_text("\n".join(lines[1:]))
    with pytest.raises(RequestError, match=r"must have the fields squares, .* Got no squares"):
        Fiducials.read(path)
    path.write_text("squares = ")
    with pytest.raises(RequestError, match="register must be TOML"):
        Fiducials.read(path)


def test_an_old_opencv_is_refused(board, images, monkeypatch):
    monkeypatch.setattr(cv2, "__version__", "4.10.0")
    with pytest.raises(RequestError, match=r"OpenCV must be 4\.13 or newer\. Got 4\.10\.0"):
        board.corners(Picture.of("one", images[1], CAMERA))
