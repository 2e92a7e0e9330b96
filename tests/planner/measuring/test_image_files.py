"""Images that are wrong are refused, all of them at once, before one is measured."""

import numpy as np
import pytest
from PIL import Image

from planner import Camera, RequestError
from planner.measuring.images import Shot, read_images

CAMERA = Camera(8.0, (0.01, 0.01), (60, 40), 8.0, 300.0)
SHOTS = [Shot(f"setting_{k + 1:02d}", k, ("a",)) for k in range(3)]
RNG = np.random.default_rng(0)


def grey(k=0, size=(40, 60), bits=8):
    return RNG.integers(0, 2**bits, size).astype(np.uint8 if bits == 8 else np.uint16)


def folder(tmp_path, **files):
    for name, array in files.items():
        stem, _, suffix = name.partition("__")
        path = tmp_path / f"{stem}.{suffix or 'png'}"
        if isinstance(array, bytes):
            path.write_bytes(array)
        elif path.suffix == ".npy":
            np.save(path, array)
        else:
            Image.fromarray(array).save(path)
    return tmp_path


def three(**more):
    return {"setting_01": grey(), "setting_02": grey(), "setting_03": grey(), **more}


def test_a_folder_of_files_of_all_kinds(tmp_path):
    arrays = [grey(), grey(bits=16), grey()]
    names = ("setting_01__bmp", "setting_02__tiff", "setting_03__npy")
    found = read_images(folder(tmp_path, **dict(zip(names, arrays, strict=True))), SHOTS, CAMERA)
    for shot, array in zip(SHOTS, arrays, strict=True):
        np.testing.assert_array_equal(found.images[shot.name], array)
    assert len(set(found.digests.values())) == 3
    assert not found.notes


def test_arrays_and_files_by_number_or_name(tmp_path):
    path = folder(tmp_path, other=grey()) / "other.png"
    found = read_images({1: grey(), "setting_02": path, 3: grey() / 255.0}, SHOTS, CAMERA)
    assert list(found.images) == [shot.name for shot in SHOTS]


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "images must hold images named like setting_01.png. Got none in"),
        (
            {"setting_01": grey()},
            r"images must be the 3 images of the plan, setting_01 to setting_03. "
            r"Got no setting_02, setting_03; --partial measures what is there.",
        ),
        (three(setting_09=grey()), "Got setting_09, which the plan does not take."),
        (
            three(setting_02__bmp=grey()),
            "must hold one file for each image. Got setting_02.bmp and",
        ),
        (three(setting_02=b"no image"), "setting_02: is no image that can be read"),
        (three(setting_02=grey(size=(60, 40))), "setting_02: is 40 × 60 px, turned by 90 degrees"),
        (three(setting_02=grey(size=(20, 30))), "setting_02: is 30 × 20 px, binned or scaled"),
        (three(setting_02=grey(size=(40, 61))), "is 61 × 40 px; the plan's camera has 60 × 40 px"),
    ],
    ids=["none", "missing", "extra", "two files", "no image", "turned", "binned", "another size"],
)
def test_files_that_are_refused(tmp_path, files, message):
    with pytest.raises(RequestError, match=message):
        read_images(folder(tmp_path, **files), SHOTS, CAMERA)


def test_a_mosaic_of_colours(tmp_path):
    large = Camera(8.0, (0.01, 0.01), (160, 120), 8.0, 300.0)
    v, u = np.mgrid[:120, :160]
    scene = 100 + 60 * np.sin(u / 20) * np.cos(v / 15)
    mosaic = scene.copy()
    mosaic[::2, ::2] *= 0.7
    path = folder(tmp_path, setting_01=scene.astype(np.uint8), setting_02=mosaic.astype(np.uint8))
    with pytest.raises(RequestError, match=r"Got setting_02: looks like the mosaic of a colour"):
        read_images(path, SHOTS, large, partial=True)
    found = read_images(path, SHOTS, large, partial=True, allow_lossy=True)
    assert len(found.images) == 2


def test_the_same_image_twice(tmp_path):
    same = grey()
    files = three(setting_01=same, setting_03=same)
    with pytest.raises(RequestError, match="setting_03: is the same image as setting_01"):
        read_images(folder(tmp_path, **files), SHOTS, CAMERA)


def test_jpeg_is_lossy(tmp_path):
    files = {"setting_01": grey(), "setting_02__jpg": grey(), "setting_03": grey()}
    path = folder(tmp_path, **files)
    with pytest.raises(RequestError, match="setting_02: is a JPEG file"):
        read_images(path, SHOTS, CAMERA)
    assert len(read_images(path, SHOTS, CAMERA, allow_lossy=True).images) == 3


def test_an_image_that_says_it_is_turned(tmp_path):
    path = folder(tmp_path, **three())
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(grey()).save(path / "setting_02.png", exif=exif)
    with pytest.raises(RequestError, match="setting_02: says that it is turned"):
        read_images(path, SHOTS, CAMERA)


@pytest.mark.parametrize(
    ("array", "note"),
    [
        (np.stack([grey(), grey(), grey()], axis=2), "colour image, measured in its luminance"),
        (np.repeat(grey()[..., None], 3, axis=2), ""),
        (grey(bits=12), "16 bits that hold 12"),
        (grey().astype(np.uint16), "16 bits that hold 8"),
    ],
    ids=["colour", "grey in colour", "12 bits", "8 bits"],
)
def test_what_is_made_of_other_images(array, note):
    found = read_images({1: array}, SHOTS, CAMERA, partial=True)
    assert found.images["setting_01"].shape == (40, 60)
    notes = [text for text in found.notes if text.startswith("setting_01")]
    assert notes == ([f"setting_01: {note}"] if note else [])


def test_twelve_bits_fill_the_range():
    found = read_images({1: np.full((40, 60), 4095, np.uint16)}, SHOTS, CAMERA, partial=True)
    assert found.images["setting_01"].max() == 4095 * 16


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.full((40, 60), 1.5), "must have grey values of 8 or 16 bits, or from 0 to 1"),
        (np.full((40, 60), np.nan), "must have grey values of 8 or 16 bits, or from 0 to 1"),
        (
            np.zeros((2, 40, 60), np.uint8),
            r"has the shape \(2, 40, 60\); it must be one grey image",
        ),
        (np.dstack([grey()] * 4), "has transparent pixels"),
    ],
    ids=["above 1", "nan", "two images", "alpha"],
)
def test_arrays_that_are_refused(array, message):
    with pytest.raises(RequestError, match=message):
        read_images({1: array}, SHOTS, CAMERA, partial=True)


def test_missing_images_may_be_allowed():
    found = read_images({2: grey()}, SHOTS, CAMERA, partial=True)
    assert list(found.images) == ["setting_02"]
    assert "setting_01: no image" in found.notes
    with pytest.raises(RequestError, match="Got no setting_01"):
        read_images({}, SHOTS, CAMERA, partial=True)
