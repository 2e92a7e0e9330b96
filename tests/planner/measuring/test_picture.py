"""Full exposure, and notes on the exposure, of images whose light is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from planner import Camera, CameraError, MeasureOptions, Registration
from planner.measuring.images import DEPTH, PLATEAU, STATED, Picture, white_of

CAMERA = Camera(8.0, (0.01, 0.01), (400, 300), 8.0, 300.0)
V, U = np.mgrid[:300, :400] / 400


def light(times=1.0, noise=0.008):
    """A part before a darker background, shaded, whose brightest place has 80 % of white; with noise."""
    rng = np.random.default_rng(2)
    part = (np.hypot(U - 0.5, V - 0.4) < 0.3) * (0.45 + 0.35 * U / 0.8)
    scene = gaussian_filter(np.maximum(part, 0.12 + 0.1 * V), 0.8)
    return np.clip(times * (scene + rng.normal(0, noise, U.shape) * np.sqrt(scene)), 0, None)


def stored(share, white, kind=np.uint16, black=0, step=1):
    """What a camera stores of light, as a share of white: no more than white."""
    return (step * np.rint((black + (white - black) * np.minimum(share, 1)) / step)).astype(kind)


# what cameras and programs store of full exposure, from their bits
CAMERAS = {
    "8 bits": {"white": 255, "kind": np.uint8},
    "video": {"white": 235, "kind": np.uint8, "black": 16},
    "10 bits": {"white": 1023},
    "12 bits": {"white": 4095},
    "12 bits, upper": {"white": 4095 * 16, "step": 16},
    "14 bits": {"white": 16383},
    "15 bits": {"white": 32767},
    "16 bits": {"white": 65535},
    "sum of four of 12 bits": {"white": 4 * 4095, "step": 4},
    "mean of three of 12 bits": {"white": 4095},
    "below the converter's end": {"white": 3712},
}


@pytest.mark.parametrize("how", CAMERAS.values(), ids=list(CAMERAS))
@pytest.mark.parametrize("times", [1.4, 2.0, 4.0])
def test_white_is_where_the_brightest_pixels_end(how, times):
    image = stored(light(times), **how)
    assert white_of(image) == (how["white"], PLATEAU)
    # hot pixels, and the text that a program writes into an image
    image.flat[:: image.size // 8] = np.iinfo(image.dtype).max
    assert white_of(image) == (how["white"], PLATEAU)


@pytest.mark.parametrize(
    ("how", "white"),
    [
        ("8 bits", 255),
        ("10 bits", 1023),
        ("12 bits", 4095),
        ("12 bits, upper", 4095 * 16),
        ("14 bits", 16383),
        ("16 bits", 65535),
    ],
)
def test_without_a_plateau_white_is_that_of_the_bits(how, white):
    image = stored(light(), **CAMERAS[how])
    assert white_of(image) == (white, DEPTH)
    assert Picture.of("one", image, CAMERA).notes(0.0) == []


@pytest.mark.parametrize("how", CAMERAS.values(), ids=list(CAMERAS))
@pytest.mark.parametrize("times", [0.01, 0.05, 0.2, 0.6, 1.0])
def test_no_dark_image_is_exposed_too_long(how, times):
    """Exposed for as long as the note says, the bright part of the image has at most white."""
    share = light(times)
    picture = Picture.of("one", stored(share, **how), CAMERA)
    assert picture.clipped_share < 1e-3
    for note in picture.notes(0.0):
        longer = float(note.split("expose for ")[1].split()[0])
        assert longer * np.quantile(share, 0.995) < 1.0


def test_a_dark_image_says_what_white_is_taken_for():
    """A highlight tells how many bits there are: 16. The part has 8 % of white, and shall have 80."""
    share = light(0.1)
    share[150:155, 200:205] = 0.6
    image = stored(share, 65535)
    (note,) = Picture.of("one", image, CAMERA).notes(0.0)
    assert note.startswith(
        "dark, if white is 65535 (white_level of the camera states it): expose for 10."
    )
    (note,) = Picture.of("one", image, replace(CAMERA, white_level=65535)).notes(0.0)
    assert note.startswith("dark: expose for 10.")


def test_white_that_the_camera_states():
    image = stored(light(0.2), 16383)
    picture = Picture.of("one", image, replace(CAMERA, white_level=16383))
    assert (picture.white, picture.white_from) == (16383, STATED)
    (note,) = picture.notes(0.0)
    # the bright part has 16 % of white, and shall have 80
    assert 4.7 < float(note.removeprefix("dark: expose for ").split()[0]) < 5.3


@pytest.mark.parametrize("divided_by", [65535, 16383])
def test_white_of_floats(divided_by):
    """A program may divide what a camera of 14 bits stored by another number than its white."""
    image = stored(light(2.0), 16383) / divided_by
    assert white_of(image.astype(np.float32)).level == pytest.approx(16383 / divided_by, rel=1e-4)
    assert white_of(light()) == (1.0, DEPTH)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((300, 400), np.uint8),
        np.full((300, 400), 180, np.uint8),
        np.where(U < 0.5, 20, 180).astype(np.uint8),
        np.where(U < 0.5, 0, 180).astype(np.uint8),
        stored(light(noise=0.0), 200, np.uint8),
        stored(light(0.05), 255, np.uint8),
        stored(light(noise=0.002), 230, np.uint8),
    ],
    ids=["black", "grey", "two faces", "a face", "without noise", "dark", "little noise"],
)
def test_no_white_is_seen_where_nothing_is_clipped(image):
    assert white_of(image) == (255, DEPTH)


def test_a_plane_of_light_that_just_does_not_clip():
    """The background is even and bright, 98 % of white: noise tells that it is not clipped."""
    rng = np.random.default_rng(4)
    share = np.where(light() > 0.4, 0.3, 0.9) + rng.normal(0, 0.01, U.shape)
    for how in CAMERAS.values():
        assert white_of(stored(share, **how)).origin == DEPTH


@pytest.mark.parametrize("value", [0, -1, 12, 65536, 4095.5, "4095", True, float("nan")])
def test_white_levels_that_are_refused(value):
    with pytest.raises(CameraError, match=r"white_level must be"):
        replace(CAMERA, white_level=value)
    with pytest.raises(CameraError, match=r"white_level must be"):
        MeasureOptions(Registration.none(), white_level=value)


def test_a_camera_keeps_its_white_level(tmp_path):
    camera = replace(CAMERA, white_level=4095.0)
    assert Camera.read(camera.write(tmp_path / "camera.toml")) == camera
    assert camera.to_dict()["white_level"] == 4095
    assert "white_level" not in CAMERA.to_dict()
