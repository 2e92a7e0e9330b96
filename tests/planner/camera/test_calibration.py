"""Calibrated cameras: OpenCV projects the same, and rectangles of the field hold what they promise."""

import cv2
import numpy as np
import pytest

from planner import Camera, CameraError, PoseUncertainty
from planner.bound.pose_space import sensor_tangents
from planner.camera.calibration import Distortion
from planner.camera.camera import field_of, image_of, tangents_of, undistorted_px
from planner.exceptions import UncertaintyError
from planner.request.camera_limits import corner_margin_px
from planner.request.constraints import cone_slacks, field_of_view_slacks

K = np.array([[2320.0, 0.0, 1251.5], [0.0, 2326.0, 1009.0], [0.0, 0.0, 1.0]])
LENS = {"pixel_pitch_mm": 0.00345, "f_number": 8.0, "focus_distance_mm": 300.0}
SIZE = (2448, 2048)
BARREL = (-0.21, 0.08, 1e-3, -6e-4, -0.01)
CUSHION = (0.09, 0.03, -8e-4, 5e-4, 0.0)
TANGENTIAL = (0.0, 0.0, 2e-3, 3e-3, 0.0)
MOUSTACHE = (-0.12, 0.35, 0.0, 0.0, -0.1)


def camera(distortion):
    return Camera.from_opencv(K, distortion, SIZE, **LENS)


@pytest.fixture(params=[BARREL, CUSHION, TANGENTIAL, MOUSTACHE])
def coefficients(request):
    return request.param


def test_camera_matrix_comes_back():
    one = camera(None)
    np.testing.assert_allclose(one.matrix, K, rtol=1e-13)
    # the thin-lens equation, and d = f_x r_x
    assert 1 / one.focal_length_mm == pytest.approx(1 / (2320 * 0.00345) + 1 / 300, rel=1e-14)


def test_points_are_imaged_where_opencv_images_them(coefficients):
    left, top, right, bottom = camera(coefficients).field().inner
    x, y = np.random.default_rng(1).uniform([left, top], [right, bottom], (500, 2)).T
    points = np.stack([x, y, np.ones_like(x)], axis=-1)
    expected, _ = cv2.projectPoints(
        points * 312.0, np.zeros(3), np.zeros(3), K, np.array(coefficients)
    )
    np.testing.assert_allclose(
        image_of(camera(coefficients), points), expected[:, 0], rtol=0, atol=1e-9
    )


def test_undistorted_pixels_are_those_of_the_pinhole(coefficients):
    pixels = np.random.default_rng(2).uniform(-0.5, np.array(SIZE) - 0.5, (500, 2))
    ideal = undistorted_px(camera(coefficients), pixels)
    # a pinhole sees them along these rays, which OpenCV's lens brings back to where they came from
    rays = np.c_[ideal, np.ones(500)] @ np.linalg.inv(K).T
    back, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, np.array(coefficients))
    np.testing.assert_allclose(back[:, 0], pixels, rtol=0, atol=1e-8)
    assert np.abs(ideal - pixels).max() > 5.0


def test_directions_of_pixels_are_imaged_on_them(coefficients):
    one = camera(coefficients)
    pixels = np.random.default_rng(3).uniform(-0.5, np.array(SIZE) - 0.5, (500, 2))
    tangents = tangents_of(one, pixels)
    np.testing.assert_allclose(
        image_of(one, np.c_[tangents, np.ones(500)]), pixels, rtol=0, atol=1e-8
    )


@pytest.mark.parametrize("margin", [0.0, 40.0])
def test_rectangles_lie_inside_and_around_the_field(coefficients, margin):
    one = camera(coefficients)
    left, top, right, bottom = one.field(margin).inner
    rng = np.random.default_rng(4)
    x, y = rng.uniform([left, top], [right, bottom], (20_000, 2)).T
    corners = np.array([[left, top], [right, top], [left, bottom], [right, bottom]])
    points = np.c_[np.r_[np.c_[x, y], corners], np.ones(20_004)]
    seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(coefficients))
    low = margin - 0.5
    high = np.array(SIZE) - 0.5 - margin
    assert (seen[:, 0] >= low).all()
    assert (seen[:, 0] <= high).all()
    sides = np.linspace(low, high, 400)
    border = np.r_[
        np.c_[np.full(400, low), sides[:, 1]],
        np.c_[np.full(400, high[0]), sides[:, 1]],
        np.c_[sides[:, 0], np.full(400, low)],
        np.c_[sides[:, 0], np.full(400, high[1])],
    ]
    directions = tangents_of(one, border)
    left, top, right, bottom = one.field(margin).outer
    assert (directions >= [left, top]).all()
    assert (directions <= [right, bottom]).all()
    # and the symmetric view of the bound holds both
    assert (np.abs(directions) <= sensor_tangents(one, margin)).all()
    # neither is far from the border
    assert np.ptp(directions[:, 0]) == pytest.approx(right - left, rel=1e-3)


def test_stretch_bounds_singular_values(coefficients):
    one = camera(coefficients)
    field = one.field()
    left, top, right, bottom = field.inner
    points = np.random.default_rng(5).uniform([left, top], [right, bottom], (300, 2))
    lens = Distortion(*coefficients)
    step = 1e-6
    columns = [
        (lens.distort(points + step * e) - lens.distort(points - step * e)) / (2 * step)
        for e in np.eye(2)
    ]
    values = np.linalg.svd(np.stack(columns, axis=-1), compute_uv=False)
    assert values.min() >= field.least_stretch - 1e-8
    assert values.max() <= field.most_stretch + 1e-8
    assert field.least_stretch > 0.5


def test_lens_that_folds_on_the_sensor_is_refused():
    # x(1 - 2.2 x²) has no more than 0.2595, and the sensor's side is at 0.5
    with pytest.raises(CameraError, match="folds"):
        camera((-2.2, 0, 0, 0, 0))


def test_off_centre_sides_by_hand():
    one = camera(None)
    point = np.array([[[[0.0, 0.0, 300.0], [30.0, -24.0, 300.0]]]])
    left, left_2, right, right_2, up, up_2, down, down_2 = field_of_view_slacks(one, point, 0.0)[
        0, 0
    ]
    assert [left, right, up, down] == pytest.approx([1252.0, 1196.0, 1009.5, 1038.5])
    # 30 / 300 * 2320 = 232 px to the right, 24 / 300 * 2326 = 186.08 px up
    assert [left_2, right_2, up_2, down_2] == pytest.approx([1484.0, 964.0, 823.42, 1224.58])


def test_slacks_of_distorted_camera_are_conservative(coefficients):
    one = camera(coefficients)
    ends = np.random.default_rng(6).uniform([-180, -160, 290], [180, 160, 310], (2000, 1, 2, 3))
    seen, _ = cv2.projectPoints(
        ends.reshape(-1, 3), np.zeros(3), np.zeros(3), K, np.array(coefficients)
    )
    margin = 25.0
    inside = (seen[:, 0] >= margin - 0.5) & (seen[:, 0] <= np.array(SIZE) - 0.5 - margin)
    allowed = (field_of_view_slacks(one, ends, margin).min(axis=-1) >= 0).ravel()
    really = inside.all(axis=1).reshape(-1, 2).all(axis=1)
    assert not (allowed & ~really).any()
    assert allowed.sum() > 0.8 * really.sum() > 100


def test_cone_of_an_off_centre_camera_keeps_to_the_nearest_side():
    # the upper side is nearest to the axis: tan a = 1009.5 / 2326, and a sphere in it at depth z has r = z sin a
    angle = np.arctan(1009.5 / 2326.0)
    centre = np.array([[0.0, 0.0, 300.0]])
    assert cone_slacks(camera(None), centre, 300.0 * np.sin(angle)).item() == pytest.approx(
        0.0, abs=1e-9
    )


def test_margin_of_poses_is_counted_in_real_pixels():
    sigma = PoseUncertainty.isotropic(translation_mm=0.2, rotation_rad=0.002)
    plain = camera(None)
    cushion = camera(CUSHION)
    # a cushion stretches the image near the corner, so a displacement is more pixels there
    assert corner_margin_px(cushion, sigma) > 1.05 * corner_margin_px(plain, sigma)


def test_pitch_of_the_undistorted_image():
    # purely radial k1: the least stretch is 1 + 3 k1 r², in the corner of the inner rectangle
    one = camera((-0.2, 0, 0, 0, 0))
    left, top, right, bottom = one.field().inner
    r2 = max(left**2, right**2) + max(top**2, bottom**2)
    expected = max(one.pixel_pitch_mm) / (1 - 0.6 * r2)
    assert one.image_pitch_mm == pytest.approx((expected, expected), rel=0.01)
    assert one.image_pitch_mm[0] >= expected
    assert (
        camera(None).image_pitch_mm == camera(None).pixel_pitch_mm == camera(None).finest_pitch_mm
    )


def test_dictionary_and_back():
    one = camera(BARREL)
    assert Camera.from_dict(one.to_dict()) == one
    assert tuple(one.to_dict()["distortion"]) == BARREL
    assert not {"distortion", "principal_point_px"} & set(
        Camera(8.0, (0.01, 0.01), (9, 9), 8.0, 300.0).to_dict()
    )
    assert camera([0.0] * 8) == camera(None)


def test_toml_holds_a_calibration(tmp_path):
    path = tmp_path / "camera.toml"
    path.write_text(
        "focal_length_mm = 8.0\npixel_pitch_mm = [0.00345, 0.00345]\nresolution = [2448, 2048]\nf_number = 8.0\n"
        "focus_distance_mm = 300.0\nprincipal_point_px = [1230.0, 1010.5]\ndistortion = [-0.1, 0.02, 0.0, 0.001, 0.0]\n"
    )
    one = Camera.from_toml(path)
    assert one.matrix[:2, 2].tolist() == [1230.0, 1010.5]
    assert one.distortion == Distortion(-0.1, 0.02, 0.0, 0.001)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"matrix": [[2320, 1, 1251], [0, 2326, 1009], [0, 0, 1]]}, "matrix must be"),
        ({"matrix": "K"}, "matrix must be"),
        ({"matrix": -K + [[0, 0, 0], [0, 0, 0], [0, 0, 2]]}, "f_x must be finite and positive"),
        (
            {"matrix": [[2320, 0, 9999], [0, 2326, 1009], [0, 0, 1]]},
            "principal_point_px must be on the sensor",
        ),
        ({"distortion": [0.1, 0.2]}, "distortion must be four or five numbers"),
        ({"distortion": [0.1, 0, 0, 0, 0, 0.3]}, "no coefficients beyond"),
        ({"distortion": "none"}, "distortion must be four or five numbers"),
        ({"image_size": 5}, "image_size must be two numbers"),
        ({"pixel_pitch_mm": (1, 2)}, "pixel_pitch_mm must be finite and positive"),
        ({"sharpness": 3}, "sharpness must be left out, or renamed to one of focal_length_mm,"),
        # um: the focus is not to blame
        (
            {"pixel_pitch_mm": 3.45},
            r"pixel_pitch_mm must be at most 0\.5 mm; 3\.45 um are 0\.00345",
        ),
        ({"focus_distance_mm": 250.0, "pixel_pitch_mm": 3.45}, r"pixel_pitch_mm must be at most"),
        # metres: the image is 8 mm from the lens
        (
            {"focus_distance_mm": 0.3},
            r"focus_distance_mm must be at least 2 mm: .* Got 0\.3; 0\.3 m are 300\.",
        ),
    ],
)
def test_what_is_no_calibration_is_refused(changes, message):
    given = {"matrix": K, "distortion": None, "image_size": SIZE, **LENS, **changes}
    with pytest.raises(CameraError, match=message):
        Camera.from_opencv(**given)


def test_pixel_pitch_must_be_given():
    with pytest.raises(CameraError, match="pixel_pitch_mm must be given"):
        Camera.from_opencv(K, None, SIZE, f_number=8, focus_distance_mm=300)


def test_sides_without_an_inside_have_no_field():
    assert field_of(Distortion(-0.1), (0.2, 0.0, -0.2, 0.1)).inner == (0.2, 0.0, -0.2, 0.1)


def test_distort_known_point():
    # by hand: r² = 0.25, radial 1 + 0.025 + 0.0125 + 0.0046875
    lens = Distortion(k1=0.1, k2=0.2, p1=0.01, p2=0.02, k3=0.3)
    radial = 1.0421875
    expected = [0.3 * radial + 0.0024 + 0.02 * 0.43, 0.4 * radial + 0.01 * 0.57 + 0.0048]
    np.testing.assert_allclose(lens.distort([0.3, 0.4]), expected, rtol=0, atol=1e-15)


def test_undistort_inverts_distort():
    lens = Distortion(k1=-0.2, k2=0.05, p1=1e-3, p2=-2e-3, k3=-0.01)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (1000, 2))
    np.testing.assert_allclose(lens.undistort(lens.distort(points)), points, rtol=0, atol=1e-10)


def test_no_ideal_point_beyond_the_fold():
    # x(1 - x²) is at most 2/(3 sqrt 3) = 0.385
    with pytest.raises(CameraError, match="folds"):
        Distortion(k1=-1.0).undistort([0.5, 0.0])


def test_coefficient_must_be_finite():
    with pytest.raises(CameraError, match="k2 must be finite"):
        Distortion(k2=float("nan"))


# Numbers that no camera has, and camera files that no computer should read: refused by name,
# shortly.


GOOD = {
    "focal_length_mm": 25.0,
    "pixel_pitch_mm": (0.00345, 0.00345),
    "resolution": (2448, 2048),
    "f_number": 8.0,
    "focus_distance_mm": 600.0,
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"focal_length_mm": None}, r"focal_length_mm must be finite and positive\. Got None"),
        (
            {"focal_length_mm": 10**400},
            r"focal_length_mm must be finite and positive\. Got an integer of 1329 bits",
        ),
        (
            {"white_level": "4095"},
            r"white_level must be a whole number .* Got '4095'; write 4095 without quotes",
        ),
        ({"f_number": "8"}, r"f_number must be finite and positive\. Got '8'"),
        (
            {"focus_distance_mm": 1e12},
            r"focus_distance_mm must be in \[1e-09, 1e\+09\]\. Got 1e\+12",
        ),
        (
            {"pixel_pitch_mm": "0.00345"},
            r"pixel_pitch_mm must be two numbers, across and down\. Got '0\.00345'",
        ),
        ({"resolution": "24"}, r"resolution must be two numbers, across and down\. Got '24'"),
        ({"resolution": (2448, 2048.5)}, r"resolution must be whole pixels\. Got 2048\.5"),
        ({"name": ["n"] * 100}, r"name must be text\. Got \['n', .*\.\.\.\.$"),
        ({"principal_point_px": (None, 3.0)}, r"principal_point_px must be finite\. Got None"),
        ({"principal_point_px": (True, 3.0)}, r"principal_point_px must be finite\. Got True"),
        (
            {"principal_point_px": (-0.5, 3.0)},
            r"principal_point_px must be on the sensor\. Got \(-0\.5, 3\.0\)",
        ),
    ],
)
def test_what_no_camera_has(changes, message):
    with pytest.raises(CameraError, match=message) as caught:
        Camera(**{**GOOD, **changes})
    assert len(str(caught.value)) < 180


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("focal_length_mm = " + "[" * 100_000, "must not nest arrays or tables so deep"),
        ("focal_length_mm = " + "1" * 10_000, "must hold numbers of a sensible length"),
        ("focal_length_mm = 25.0\n[camera", r"camera\.toml:2: camera file must be TOML"),
    ],
)
def test_files_that_are_odd(tmp_path, text, message):
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(CameraError, match=message) as caught:
        Camera.from_toml(path)
    assert len(str(caught.value)) < len(str(path)) + 180


def test_a_calibration_is_no_camera_but_can_be_named_in_one(tmp_path):
    path = tmp_path / "cam.yaml"
    path.write_text("%YAML:1.0\n---\nimage_width: 640\n")
    with pytest.raises(CameraError, match=r'write a TOML file with calibration = "cam\.yaml"'):
        Camera.from_toml(path)


def test_odd_uncertainties():
    good = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.01)
    still = {
        f"{one}_{what}": 0.0
        for one in ("robot", "hand_eye")
        for what in ("translation_mm", "rotation_rad")
    }
    with pytest.raises(
        UncertaintyError, match=r"cam2flange must have the shape \(4, 4\)\. Got \(3, 3\)"
    ):
        PoseUncertainty.robot_hand_eye(**still, cam2flange=np.eye(3))
    with pytest.raises(UncertaintyError, match=r"covariance must be given\. Got covariances"):
        PoseUncertainty.from_dict({"covariances": 1})
    with pytest.raises(UncertaintyError, match=r"Got nothing"):
        PoseUncertainty.from_dict({})
    assert good != "an uncertainty"
    assert good == PoseUncertainty.from_dict(good.to_dict())


def test_a_matrix_that_is_none_is_shown_in_one_line():
    with pytest.raises(CameraError) as info:
        Camera.from_opencv(K.T, None, SIZE, **LENS)
    assert info.value.got == "[[2320.0, 0.0, 0.0], [0.0, 2326.0, 0.0], [1251.5, 1009.0, 1.0]]"
    assert str(info.value).endswith("; transpose it.")
    with pytest.raises(CameraError, match=r"^matrix must be .* Got 'x'\.$"):
        Camera.from_opencv("x", None, SIZE, **LENS)
