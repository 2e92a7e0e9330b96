import math

import numpy as np
import pytest

from planner import Camera, CameraError, camera_names
from planner.camera.camera import catalogued


def make(**changes):
    fields = {
        "focal_length_mm": 25.0,
        "pixel_pitch_mm": (0.00345, 0.00345),
        "resolution": (2448, 2048),
        "f_number": 8.0,
        "focus_distance_mm": 600.0,
    }
    return Camera(**{**fields, **changes})


def blur_by_image_distances(camera, depth):
    """Blur circle from where the point's own image lies, by similar triangles behind the lens."""
    sharp = camera.focal_length_mm * depth / (depth - camera.focal_length_mm)
    aperture = camera.focal_length_mm / camera.f_number
    return aperture * abs(camera.image_distance_mm - sharp) / sharp


def test_image_distance_satisfies_the_lens_equation():
    camera = make()
    assert 1 / camera.focal_length_mm == pytest.approx(
        1 / camera.image_distance_mm + 1 / camera.focus_distance_mm
    )


@pytest.mark.parametrize("f_number", [2.0, 8.0, 16.0])
@pytest.mark.parametrize("focus", [120.0, 600.0])
def test_depth_of_field_ends_where_the_blur_circle_is_the_largest_allowed(f_number, focus):
    camera = make(f_number=f_number, focus_distance_mm=focus)
    nearest, farthest = camera.depth_of_field_mm
    assert nearest < focus < farthest
    for limit in (nearest, farthest):
        assert blur_by_image_distances(camera, limit) == pytest.approx(
            camera.largest_blur_mm, rel=1e-9
        )
    assert blur_by_image_distances(camera, nearest * 1.001) < camera.largest_blur_mm
    assert blur_by_image_distances(camera, farthest * 1.001) > camera.largest_blur_mm


def test_depth_of_field_matches_hand_computed_numbers():
    # f = 50, s = 550: d = 55; N = 5: a = 10; c = 0.1: c/(a·d) = 1/5500 and 1/s = 10/5500, so 5500/11 and 5500/9
    camera = make(focal_length_mm=50.0, focus_distance_mm=550.0, f_number=5.0, largest_blur_mm=0.1)
    assert camera.image_distance_mm == pytest.approx(55.0)
    assert camera.depth_of_field_mm == pytest.approx((500.0, 5500 / 9))


def test_beyond_the_hyperfocal_distance_everything_far_is_sharp():
    camera = make(focus_distance_mm=50_000.0, f_number=16.0)
    assert camera.depth_of_field_mm[1] == math.inf
    assert blur_by_image_distances(camera, 1e9) < camera.largest_blur_mm


def test_largest_blur_is_the_smaller_pitch_by_default():
    assert make(pixel_pitch_mm=(0.01, 0.013)).largest_blur_mm == 0.01


def test_matrix_maps_the_axis_to_the_middle_and_a_known_point_to_its_pixel():
    camera = make(pixel_pitch_mm=(0.01, 0.02), resolution=(101, 51))
    assert camera.matrix @ [0, 0, 1] == pytest.approx([50, 25, 1])
    x, y, w = camera.matrix @ [30.0, 10.0, 600.0]
    assert x / w - 50 == pytest.approx(camera.image_distance_mm * 30 / 600 / 0.01)
    assert y / w - 25 == pytest.approx(camera.image_distance_mm * 10 / 600 / 0.02)


def test_catalogue_has_a_dozen_cameras_whose_sensors_and_apertures_exist():
    names = camera_names()
    assert len(names) >= 12
    for name in names:
        camera = Camera.named(name)
        assert camera.name == name
        assert 2 < camera.sensor_size_mm[1] < camera.sensor_size_mm[0] < 16
        assert name.endswith(f"-{camera.focal_length_mm:g}mm")


def test_the_image_circle_of_every_lens_covers_the_sensor():
    for name, (_, lens) in catalogued().items():
        assert math.hypot(*Camera.named(name).sensor_size_mm) <= lens["image_circle_mm"], name


def test_small_parts_can_be_seen_closely():
    """At 100 to 300 mm a field of 35 mm and more whose pixels are at most 1/80 of an edge of 2 mm."""
    close = [
        camera for camera in map(Camera.named, camera_names()) if camera.focus_distance_mm < 300.1
    ]
    fields = {}
    for camera in close:
        mm_per_image_mm = camera.focus_distance_mm / camera.image_distance_mm
        if camera.pixel_pitch_mm[0] * mm_per_image_mm <= 2.0 / 80:
            fields[camera.name] = camera.sensor_size_mm[0] * mm_per_image_mm
    assert len(fields) >= 5
    assert 35 < min(fields.values()) < max(fields.values()) < 120


def test_named_ignores_case_and_takes_settings():
    camera = Camera.named("BASLER-aca2440-20gm-25MM", focus_distance_mm=400.0)
    assert (camera.resolution, camera.focus_distance_mm) == ((2448, 2048), 400.0)
    assert camera.focused_at(500.0).focus_distance_mm == 500.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"f_number": 1.4}, r"f_number must be in 1\.8 to 16, the lens's range\. Got 1\.4\."),
        ({"f_number": 22.0}, r"f_number must be in 1\.8 to 16, the lens's range\. Got 22\."),
        (
            {"focus_distance_mm": 99.0},
            r"focus_distance_mm must be at least 100, the lens's closest object\. Got 99\.",
        ),
    ],
)
def test_what_the_lens_cannot_be_set_to_is_refused(changes, message):
    with pytest.raises(CameraError, match=message):
        Camera.named("basler-acA2440-20gm-25mm", **changes)


def test_unknown_name_offers_the_nearest():
    with pytest.raises(
        CameraError, match=r"Got 'basler-acA2440-25mm'; nearest: .*basler-acA2440-20gm-25mm"
    ):
        Camera.named("basler-acA2440-25mm")


def test_the_catalogue_is_not_handed_out_for_writing():
    before = Camera.named("basler-acA2440-20gm-25mm")
    with pytest.raises(AttributeError):
        before.f_number = 4.0
    assert Camera.named("basler-acA2440-20gm-25mm") == before
    assert "basler-acA2440-20gm-25mm" in catalogued()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"focal_length_mm": 0}, r"focal_length_mm must be finite and positive\. Got 0\."),
        ({"f_number": math.nan}, r"f_number must be finite and positive\. Got nan\."),
        ({"focal_length_mm": "25"}, r"focal_length_mm must be finite and positive\. Got '25'\."),
        ({"resolution": (2448.5, 2048)}, r"resolution must be whole pixels\. Got 2448\.5\."),
        ({"resolution": 2448}, r"resolution must be two numbers, across and down\. Got 2448\."),
        (
            {"pixel_pitch_mm": (0.01, -0.01)},
            r"pixel_pitch_mm must be finite and positive\. Got -0\.01\.",
        ),
        (
            {"focus_distance_mm": 20.0},
            r"focus_distance_mm must exceed focal_length_mm \(25\).*Got 20\.",
        ),
        (
            {"focal_length_mm": 0.025},
            r"focal_length_mm must be at least 0\.\d+ mm for a sensor of [\d.]+ mm\. Got 0\.025; 0\.025 m are 25\.",
        ),
    ],
)
def test_impossible_cameras_are_refused(changes, message):
    with pytest.raises(CameraError, match=message) as caught:
        make(**changes)
    assert isinstance(caught.value, ValueError)


GOOD = """focal_length_mm = 25.0
pixel_pitch_mm = [0.00345, 0.00345]
resolution = [2448, 2048]
f_number = 8.0
focus_distance_mm = 600.0
"""


def test_toml_round_trip(tmp_path):
    path = tmp_path / "cell 7.toml"
    path.write_text(GOOD)
    camera = Camera.from_toml(path)
    assert camera == make(name="cell 7")
    assert Camera.from_dict(camera.to_dict()) == camera


def test_one_pitch_is_that_of_square_pixels(tmp_path):
    path = tmp_path / "square.toml"
    path.write_text(GOOD.replace("[0.00345, 0.00345]", "0.00345"))
    assert Camera.from_toml(path) == make(name="square")
    with pytest.raises(CameraError, match=r"must be two numbers, across and down\. Got True"):
        make(pixel_pitch_mm=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD + "lens = \n", r"bad\.toml:6: camera file must be TOML\."),
        (
            GOOD.replace("= 8.0", "= -8.0"),
            r"bad\.toml:4: f_number must be finite and positive\. Got -8\.0\.",
        ),
        (
            GOOD + "colour = 'red'\n",
            r"bad\.toml:6: colour must be left out, or renamed to one of focal_length_mm, .*unknown",
        ),
        (GOOD.replace("f_number = 8.0\n", ""), r"bad\.toml:1: f_number must be given"),
        # the text of this error begins with the calibration's path
        (GOOD + 'calibration = "none.yaml"\n', r"bad\.toml:6: .*none\.yaml: camera file cannot"),
    ],
)
def test_bad_toml_names_file_and_line(tmp_path, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(CameraError, match=message):
        Camera.from_toml(path)


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(CameraError, match=r"none\.toml: camera file cannot be read: No such file"):
        Camera.from_toml(tmp_path / "none.toml")
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CameraError, match="must be UTF-8 text"):
        Camera.from_toml(path)


def test_half_diagonal_is_the_angle_of_the_corner():
    camera = make()
    corner = np.linalg.inv(camera.matrix) @ [-0.5, -0.5, 1.0]
    assert math.tan(camera.half_diagonal_rad) == pytest.approx(math.hypot(*corner[:2]))


@pytest.mark.parametrize(
    ("size", "point", "turned"),
    [
        ((2048, 2448), (1219.7, 1030.2), True),
        ((2448, 2048), (1219.7, 1030.2), False),
        # off the middle of either size, as behind a shifted lens
        ((2448, 2048), (900.0, 700.0), False),
        ((2448, 2048), None, False),
    ],
)
def test_an_exchanged_image_size_shows_in_the_principal_point(size, point, turned):
    assert make(resolution=size, principal_point_px=point).seems_turned is turned
