"""Images that are wrong are refused, all of them at once, before one is measured."""

import contextlib
import hashlib
import os
import struct
import zlib
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from planner import Camera, CameraError, MeasureOptions, Registration, RequestError
from planner.measuring.images import DEPTH, PLATEAU, STATED, Picture, Shot, read_images, white_of

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


def test_a_file_is_read_once_so_that_its_digest_is_that_of_its_pixels(tmp_path, monkeypatch):
    path = folder(tmp_path, setting_01=grey()) / "setting_01.png"
    content = path.read_bytes()
    reads = []
    read_bytes = Path.read_bytes

    def counted(self):
        reads.append(self)
        return read_bytes(self)

    monkeypatch.setattr(Path, "read_bytes", counted)
    found = read_images({1: path}, SHOTS[:1], CAMERA)
    assert found.digests["setting_01"] == hashlib.sha256(content).hexdigest()
    assert reads == [path]


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
            r"Got no setting_02, setting_03; partial=True measures what is there.",
        ),
        (three(setting_09=grey()), "Got setting_09, which the plan does not take."),
        (
            three(setting_02__bmp=grey()),
            "must hold one file for each image. Got setting_02.bmp and",
        ),
        (three(setting_02=b"no image"), "setting_02, which is no image that can be read"),
        (
            three(setting_02=grey(size=(60, 40))),
            "setting_02, which is 40 × 60 px, turned by 90 degrees",
        ),
        (
            three(setting_02=grey(size=(20, 30))),
            "setting_02, which is 30 × 20 px, binned or scaled",
        ),
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
    with pytest.raises(
        RequestError, match=r"Got setting_02, which looks like the mosaic of a colour"
    ):
        read_images(path, SHOTS, large, partial=True)
    found = read_images(path, SHOTS, large, partial=True, allow_lossy=True)
    assert len(found.images) == 2


def test_a_reason_of_several_images_stands_once(tmp_path):
    wrong = {f"setting_0{k}": grey(size=(20, 30)) for k in (1, 3)}
    with pytest.raises(RequestError) as caught:
        read_images(folder(tmp_path, **three(**wrong, setting_02=b"no image")), SHOTS, CAMERA)
    assert str(caught.value) == (
        "images must be as the plan's camera takes them. Got setting_01, setting_03, each of which is "
        "30 × 20 px, binned or scaled; the plan's camera has 60 × 40 px; and setting_02, which is no image "
        "that can be read."
    )


def test_the_same_image_twice(tmp_path):
    same = grey()
    files = three(setting_01=same, setting_03=same)
    with pytest.raises(RequestError, match="setting_03, which is the same image as setting_01"):
        read_images(folder(tmp_path, **files), SHOTS, CAMERA)


def test_jpeg_is_lossy(tmp_path):
    files = {"setting_01": grey(), "setting_02__jpg": grey(), "setting_03": grey()}
    path = folder(tmp_path, **files)
    with pytest.raises(RequestError, match="setting_02, which is a JPEG file"):
        read_images(path, SHOTS, CAMERA)
    found = read_images(path, SHOTS, CAMERA, allow_lossy=True)
    assert len(found.images) == 3
    assert found.notes == ["setting_02: JPEG loses detail of edges"]


def saved(kind, image=None, **how):
    stream = BytesIO()
    (image or Image.fromarray(grey())).save(stream, kind, **how)
    return stream.getvalue()


def tiff(array, tags, order="<"):
    """A TIFF file of one strip as the standard has it (TIFF 6.0, section 2), without a library."""
    data = array.astype(array.dtype.newbyteorder(order)).tobytes()
    height, width = array.shape
    every = {256: width, 257: height, 258: 8 * array.itemsize, 259: 1, 262: 1, 273: 8, 277: 1}
    every |= {278: height, 279: len(data)} | tags
    start = 8 + len(data) + len(data) % 2
    head = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, start)
    # short values lie in the first bytes of their four
    entries = b"".join(
        struct.pack(order + "HHI", tag, 4 if tag in (273, 279) else 3, 1)
        + struct.pack(order + ("I" if tag in (273, 279) else "Hxx"), value)
        for tag, value in sorted(every.items())
    )
    body = data + bytes(len(data) % 2) + struct.pack(order + "H", len(every)) + entries
    return head + body + bytes(4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (saved("JPEG"), "is a JPEG file, whose edges"),
        (saved("WEBP"), "is a WEBP file, whose edges"),
        (saved("TIFF", compression="jpeg"), "is a TIFF file compressed as jpeg, whose edges"),
        (saved("GIF"), "is a GIF file; store PNG, TIFF, BMP or NumPy"),
        (saved("PPM"), "is a PPM file; store PNG, TIFF, BMP or NumPy"),
        (
            saved("TIFF", save_all=True, append_images=[Image.fromarray(grey())]),
            "holds 2 images; it must hold one",
        ),
        (
            saved("PNG", save_all=True, append_images=[Image.fromarray(grey())]),
            "holds 2 images; it must hold one",
        ),
        (saved("PNG", Image.fromarray(grey() > 99)), "has values of 1 bit;"),
        (saved("TIFF", Image.fromarray(grey() > 99)), "has values of 1 bit;"),
        (saved("BMP", Image.fromarray(grey() > 99)), "has values of 1 bit;"),
        (saved("PNG", Image.fromarray(grey() // 32).quantize(8), bits=4), "has values of 4 bits;"),
        (saved("TIFF", Image.new("LAB", (60, 40))), "has values of the kind LAB"),
        (saved("TIFF", Image.new("CMYK", (60, 40))), "has values of the kind CMYK"),
    ],
    ids=[
        *("JPEG", "WebP", "JPEG in TIFF", "GIF", "PGM", "pages", "animation"),
        *("1 bit PNG", "1 bit TIFF", "1 bit BMP", "4 bits", "LAB", "CMYK"),
    ],
)
@pytest.mark.parametrize("suffix", ["png", "tif", "npy"])
def test_the_content_decides_and_not_the_suffix(tmp_path, content, message, suffix):
    path = folder(tmp_path, **{f"setting_01__{suffix}": content})
    with pytest.raises(RequestError, match=f"Got setting_01, which {message}"):
        read_images(path, SHOTS, CAMERA, partial=True)


def test_files_are_read_as_what_they_are(tmp_path):
    """TIFF 6.0: values have the file's order of bytes, and photometric 0 is white as 0."""
    values = grey(bits=16)
    for content, right in (
        (tiff(values, {}, ">"), values),
        (tiff(values, {}, "<"), values),
        (tiff(values, {262: 0}), 65535 - values),
        (tiff(grey_8 := grey(), {262: 0}), 255 - grey_8),
        (tiff(grey_8, {262: 0}, ">"), 255 - grey_8),
        (saved("PNG", Image.fromarray(grey_8)), grey_8),
        (saved("BMP", Image.fromarray(grey_8)), grey_8),
    ):
        (tmp_path / "setting_01.npy").write_bytes(content)
        found = read_images(tmp_path, SHOTS, CAMERA, partial=True)
        np.testing.assert_array_equal(found.images["setting_01"], right)
        assert found.digests["setting_01"] == hashlib.sha256(content).hexdigest()


def test_a_palette_is_read_in_its_luminance(tmp_path):
    """0.299 R + 0.587 G + 0.114 B of red (200, 0, 0) and white (ITU-R BT.601)."""
    image = Image.fromarray(np.repeat(np.uint8([[7, 255]]), [30, 30], axis=1).repeat(40, axis=0))
    image.putpalette([200, 0, 0] * 255 + [255, 255, 255])
    path = folder(tmp_path, setting_01=saved("PNG", image))
    found = read_images(path, SHOTS, CAMERA, partial=True)
    assert set(np.unique(found.images["setting_01"])) == {60, 255}


def test_colours_of_sixteen_bits_have_a_note(tmp_path):
    """A PNG file of 16 bits a colour, by the standard: signature, header, pixels, end."""

    def chunk(name, data):
        check = struct.pack(">I", zlib.crc32(name + data))
        return struct.pack(">I", len(data)) + name + data + check

    rows = b"".join(b"\0" + grey(size=(180,), bits=16).astype(">u2").tobytes() for _ in range(40))
    head = struct.pack(">IIBBBBB", 60, 40, 16, 2, 0, 0, 0)
    parts = [chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")]
    path = folder(tmp_path, setting_01=b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    found = read_images(path, SHOTS, CAMERA, partial=True, allow_lossy=True)
    note = "setting_01: colours or grey with opacity of 16 bits, read with 8"
    assert note in found.notes


def test_what_is_no_file_is_refused_at_once(tmp_path):
    """Reading a pipe would wait for someone to write into it."""
    os.mkfifo(tmp_path / "setting_01.png")
    (tmp_path / "setting_02.png").symlink_to(tmp_path / "nowhere.png")
    (tmp_path / "setting_03.png").mkdir()
    with pytest.raises(RequestError) as caught:
        read_images(tmp_path, SHOTS, CAMERA)
    message = str(caught.value)
    assert "setting_01, which is a pipe or device; it must be a file" in message
    assert "setting_02, which is a link to nothing" in message
    assert "setting_03, which is a folder; it must be a file" in message


def test_no_damage_of_a_file_is_more_than_one_line(tmp_path, capfd):
    """Bytes of good files are exchanged, cut, doubled and overwritten; what is read then is an image or refused."""
    rng = np.random.default_rng(3)
    text = BytesIO()
    np.save(text, grey())
    seeds = [saved(kind) for kind in ("PNG", "TIFF", "BMP", "JPEG", "WEBP", "GIF")]
    seeds += [text.getvalue(), saved("TIFF", compression="tiff_lzw"), tiff(grey(bits=16), {262: 0})]
    refused = 0
    for _ in range(600):
        content = bytearray(seeds[rng.integers(len(seeds))])
        # headers matter most
        reach = min(len(content), 200) if rng.random() < 0.7 else len(content)
        for _ in range(rng.integers(1, 6)):
            content[rng.integers(reach)] = rng.choice([0, 1, 127, 255, rng.integers(256)])
        if rng.random() < 0.2:
            content = content[: rng.integers(len(content))]
        (tmp_path / "setting_01.tif").write_bytes(content)
        found = None
        with contextlib.suppress(RequestError):
            found = read_images(tmp_path, SHOTS, CAMERA, partial=True, allow_lossy=True)
        assert found is None or found.images["setting_01"].shape == (40, 60)
        refused += found is None
    assert refused > 100
    # libraries in C write there
    assert capfd.readouterr() == ("", "")


def test_white_of_a_camera_is_that_of_its_files(tmp_path):
    stated = replace(CAMERA, white_level=4095)
    path = folder(tmp_path, setting_01=grey())
    with pytest.raises(RequestError, match="has 8 bits; the camera's white_level is 4095"):
        read_images(path, SHOTS, stated, partial=True)
    with pytest.raises(RequestError, match=r"white_level is 4095, and 9\d % are brighter"):
        read_images({1: grey(bits=16)}, SHOTS, stated, partial=True)
    assert read_images({1: grey(bits=12)}, SHOTS, stated, partial=True).images


def test_an_image_that_says_it_is_turned(tmp_path):
    path = folder(tmp_path, **three())
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(grey()).save(path / "setting_02.png", exif=exif)
    with pytest.raises(RequestError, match="setting_02, which says that it is turned"):
        read_images(path, SHOTS, CAMERA)


@pytest.mark.parametrize(
    ("array", "note"),
    [
        (np.stack([grey(), grey(), grey()], axis=2), "colour image, measured in its luminance"),
        (np.repeat(grey()[..., None], 3, axis=2), ""),
        (grey(bits=12), ""),
        (grey().astype(np.uint32), ""),
        (grey(bits=16).astype(">u2"), ""),
    ],
    ids=["colour", "grey in colour", "12 bits", "32 bits that hold 8", "big-endian"],
)
def test_what_is_made_of_other_images(array, note):
    found = read_images({1: array}, SHOTS, CAMERA, partial=True)
    assert found.images["setting_01"].shape == (40, 60)
    notes = [text for text in found.notes if text.startswith("setting_01")]
    assert notes == ([f"setting_01: {note}"] if note else [])


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
        (np.full((40, 60), -1), "must have grey values of 8 or 16 bits, or from 0 to 1"),
        (np.full((40, 60), 70_000), "must have grey values of 8 or 16 bits, or from 0 to 1"),
        (np.zeros((40, 60), bool), "has values of the kind bool; it must have grey values"),
        (np.zeros((40, 60), complex), "has values of the kind complex128"),
        (np.full((40, 60), "a"), "has values of the kind <U1"),
        (np.zeros((40, 60), [("a", "u1")]), "has values of the kind"),
        (np.zeros((0, 60), np.uint8), "has no values"),
        (np.array(7, np.uint8), r"has the shape \(\); it must be one grey image"),
        ([[1, 2], [3]], "is no array of numbers"),
    ],
    ids=[
        *("above 1", "nan", "two images", "alpha", "negative", "17 bits", "bool", "complex"),
        *("text", "records", "empty", "a number", "ragged"),
    ],
)
def test_arrays_that_are_refused(array, message):
    with pytest.raises(RequestError, match=message):
        read_images({1: array}, SHOTS, CAMERA, partial=True)


@pytest.mark.parametrize("images", [[grey()], grey(), None, 1])
def test_images_without_numbers_are_refused(images):
    kind = type(images).__name__
    rule = f"^images must be a folder or a mapping. Got an object of type {kind}; write {{1: image"
    with pytest.raises(RequestError, match=rule):
        read_images(images, SHOTS, CAMERA)


def test_missing_images_may_be_allowed():
    found = read_images({2: grey()}, SHOTS, CAMERA, partial=True)
    assert list(found.images) == ["setting_02"]
    assert "setting_01: no image" in found.notes
    with pytest.raises(RequestError, match="Got no setting_01"):
        read_images({}, SHOTS, CAMERA, partial=True)


# Full exposure, and notes on the exposure, of images whose light is known.


CAMERA_PICTURE = Camera(8.0, (0.01, 0.01), (400, 300), 8.0, 300.0)
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
    "8 bits in 16": {"white": 65535, "step": 257},
    "8 bits in 12": {"white": 4095, "step": 4095 / 255},
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
        ("8 bits in 16", 65535),
        ("8 bits in 12", 4095),
    ],
)
def test_without_a_plateau_white_is_that_of_the_bits(how, white):
    image = stored(light(), **CAMERAS[how])
    assert white_of(image) == (white, DEPTH)
    assert Picture.of("one", image, CAMERA_PICTURE).notes(0.0) == []


@pytest.mark.parametrize("how", CAMERAS.values(), ids=list(CAMERAS))
@pytest.mark.parametrize("times", [0.01, 0.05, 0.2, 0.6, 1.0])
def test_no_dark_image_is_exposed_too_long(how, times):
    """Exposed for as long as the note says, the bright part of the image has at most white."""
    share = light(times)
    picture = Picture.of("one", stored(share, **how), CAMERA_PICTURE)
    assert picture.clipped_share < 1e-3
    for note in picture.notes(0.0):
        longer = float(note.split("expose for ")[1].split()[0])
        assert longer * np.quantile(share, 0.995) < 1.0


def test_a_small_part_on_a_large_sensor_is_not_dark():
    """It fills 0.1 % of 5 million pixels, in 200 of 255, before a dark ground."""
    levels = np.full((2048, 2448), 3, dtype=np.uint8)
    levels[1000:1071, 1200:1271] = 200
    camera = replace(CAMERA_PICTURE, resolution=(2448, 2048))
    assert Picture.of("one", levels, camera).notes(0.5) == []
    levels[1000:1071, 1200:1271] = 20
    assert Picture.of("one", levels, camera).notes(0.5) == ["dark: expose for 10 times as long"]


def test_a_dark_image_says_what_white_is_taken_for():
    """A highlight tells how many bits there are: 16. The part has 8 % of white, and shall have 80."""
    share = light(0.1)
    share[150:155, 200:205] = 0.6
    image = stored(share, 65535)
    (note,) = Picture.of("one", image, CAMERA_PICTURE).notes(0.0)
    assert note.startswith(
        "dark, if white is 65535 (white_level of the camera states it): expose for 10 times"
    )
    (note,) = Picture.of("one", image, replace(CAMERA_PICTURE, white_level=65535)).notes(0.0)
    assert note.startswith("dark: expose for 10 times")


def test_white_that_the_camera_states():
    image = stored(light(0.2), 16383)
    picture = Picture.of("one", image, replace(CAMERA_PICTURE, white_level=16383))
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


# what programs make of 8 bits
STRETCHES = {
    "16 bits": lambda grey: grey * 257,
    "12 bits": lambda grey: np.rint(grey * (4095 / 255)).astype(np.uint16),
    "14 bits": lambda grey: (grey * (16383 / 255)).astype(np.uint16),
    "floats": lambda grey: grey / 255,
    "single floats": lambda grey: (grey / 255).astype(np.float32),
    "light of a gamma curve": lambda grey: (grey / 255) ** 2.2,
}


@pytest.mark.parametrize("stretch", STRETCHES.values(), ids=list(STRETCHES))
def test_stretched_levels_are_judged_as_those_of_the_camera(stretch):
    """An even face has a few levels of 8 bits. They are far from each other in more bits, and not clipped."""
    even = np.where(light() > 0.4, 0.7, 0.3) + np.random.default_rng(5).normal(0, 0.004, U.shape)
    grey = stored(even, 255).astype(np.uint16)
    assert white_of(grey.astype(np.uint8)) == (255, DEPTH)
    white = float(np.asarray(stretch(np.array([255], dtype=np.uint16)))[0])
    assert white_of(stretch(grey)) == (white, DEPTH)
    clipped = stored(light(1.4), 255)
    found = white_of(stretch(clipped))
    assert found.origin == PLATEAU
    assert found.level == pytest.approx(white, rel=1e-6)


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
        replace(CAMERA_PICTURE, white_level=value)
    with pytest.raises(CameraError, match=r"white_level must be"):
        MeasureOptions(Registration.none(), white_level=value)


def test_a_camera_keeps_its_white_level(tmp_path):
    camera = replace(CAMERA_PICTURE, white_level=4095.0)
    assert Camera.read(camera.write(tmp_path / "camera.toml")) == camera
    assert camera.to_dict()["white_level"] == 4095
    assert "white_level" not in CAMERA_PICTURE.to_dict()


def test_an_image_that_is_exposed_as_planned_has_no_note():
    """A plan exposes for its targets; what is brighter elsewhere, up to 30 % of the image, may be overexposed."""
    for clipped, noted in ((0.2, False), (0.4, True)):
        image = np.full((100, 100), 120, np.uint8)
        image[: round(100 * clipped)] = 255
        picture = Picture.of("one", image, CAMERA_PICTURE)
        assert picture.overexposed
        assert picture.notes(0.0)
        assert bool(picture.notes(0.0, planned=True)) == noted
        # unless a target is lost, or the light says by how much there is too much of it
        assert picture.notes(0.0, ["bore"], planned=True)
        assert picture.notes(0.0, share=0.5, planned=True)
