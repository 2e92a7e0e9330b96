"""A calibration of ROS, OpenCV, Kalibr or Autoware, by the names of its values; or COLMAP's file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.argument_kinds import shown
from planner.camera.calibration import opencv_fields
from planner.camera.checks import check_positive
from planner.camera.readers import key_names as names
from planner.camera.readers.colmap import is_colmap, read_colmap
from planner.camera.readers.documents import tree_of
from planner.camera.readers.named_values import NamedValues
from planner.camera.readers.stated_calibration import (
    Calibration,
    camera_matrix,
    check_pixels,
    is_in_image,
)
from planner.exceptions import CameraError
from planner.files import name_text

_KNOWN = (
    "a calibration of ROS, OpenCV, Kalibr or Autoware (YAML, XML, JSON), or COLMAP's cameras.txt"
)
_CAMERA_OF_SEVERAL = re.compile(r"cam\d+")
_MATRIX_NAMES = ("f_x", "skew", "c_x", "K[1, 0]", "f_y", "c_y", "K[2, 0]", "K[2, 1]", "K[2, 2]")
_INTRINSICS_NAMES = ("f_x", "f_y", "c_x", "c_y")
_COEFFICIENT_NAMES = (
    *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    *("s1", "s2", "s3", "s4", "tau_x", "tau_y"),
)
# how many OpenCV's functions take
_COEFFICIENT_COUNTS = (0, 4, 5, 8, 12, 14)
_ROI_KEYS = ("x_offset", "y_offset", "width", "height", "do_rectify")


def calibrated_fields(path: str | PathLike[str], lens: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a camera of a calibration file; see `Camera.from_calibration`."""
    path = Path(path)
    found = read_calibration(path)
    lens = {"name": name_text(path.stem), **lens}
    if found.binning[0] > 1 and "pixel_pitch_mm" in lens:
        # the pitch is the sensor's, as its data sheet states it
        pitch = check_positive("pixel_pitch_mm", lens["pixel_pitch_mm"])
        lens["pixel_pitch_mm"] = pitch * found.binning[0]
    return opencv_fields(found.matrix, found.distortion, found.image_size, lens)


def read_calibration(path: Path) -> Calibration:
    """Read the camera of a calibration file.

    Parameters
    ----------
    path : pathlib.Path
        The file; its content decides what it is, not its name.

    Returns
    -------
    Calibration
        Of the raw image as the camera delivers it.

    Raises
    ------
    CameraError
        If the file cannot be read, holds several cameras, another lens model, a key that is not
        known, or lacks something.
    """
    text = _text(path)
    if is_colmap(text):
        return read_colmap(path, text)
    tree = tree_of(path, text)
    if not isinstance(tree, dict) or not tree:
        contents = "text that is neither" if text.strip() else "an empty file"
        raise CameraError(f"{path}: camera file must be {_KNOWN}. Got {contents}.")
    return _camera(NamedValues(path, _of_one_camera(path, tree)))


def _of_one_camera(path: Path, tree: dict[str, Any]) -> dict[str, Any]:
    """Return what is said of the camera, in Kalibr's file under the name of the camera."""
    cameras = [key for key in tree if _CAMERA_OF_SEVERAL.fullmatch(key)]
    if not cameras:
        if not any(names.plain(key) in names.READ for key in tree):
            keys = shown(", ".join(tree), str)
            raise CameraError(f"{path}: camera file must be {_KNOWN}. Got the keys {keys}.")
        return tree
    if len(cameras) > 1:
        raise CameraError(
            f"{path}: file must hold one camera; leave the one to be read. "
            f"Got {', '.join(cameras)}."
        )
    others = [key for key in tree if key not in cameras]
    if others:
        raise CameraError(
            f"{path}: {shown(others[0], str)} must be a key that is known here. "
            f"Got an unknown key beside {cameras[0]}."
        )
    values = tree[cameras[0]]
    if not isinstance(values, dict):
        raise CameraError(f"{path}: {cameras[0]} must hold keys. Got {shown(values)}.")
    return values


def _camera(values: NamedValues) -> Calibration:
    is_distorted = _check_model(values)
    size = _size(values)
    matrix, key = _matrix(values)
    check_pixels(f"{values.path}: {key}", matrix, size)
    distortion = _distortion(values, is_distorted)
    return _delivered(values, Calibration(matrix, distortion, size))


def _check_model(values: NamedValues) -> bool:
    """Return whether the lens may distort; refuse every model but Brown and Conrady's and none."""
    is_distorted = True
    for key, model in values.entries(names.FISHEYE):
        if model is not False and model != 0:
            raise values.error(
                key, "must be 0: fisheye lenses are not known here", shown(model, str)
            )
    for key, model in values.entries(names.DISTORTION_MODEL):
        word = _word(model)
        if word in names.UNDISTORTED:
            is_distorted = False
        elif word not in names.BROWN_CONRADY:
            raise values.error(
                key,
                "must be plumb_bob, radtan or none, the model of Brown and Conrady",
                shown(model, str),
            )
    for key, model in values.entries(names.CAMERA_MODEL):
        if _word(model) not in (*names.PINHOLE, *names.BROWN_CONRADY):
            raise values.error(
                key,
                "must be pinhole, or plumb_bob, the model of Brown and Conrady",
                shown(model, str),
            )
    return is_distorted


def _word(model: Any) -> str:
    """Return the plain name of a model; what is no word is no name."""
    if model is None:
        return ""
    return names.plain(model) if isinstance(model, str) else shown(model)


def _size(values: NamedValues) -> tuple[int, int]:
    key = values.key(names.SIZE)
    if key is None:
        width = values.needed(names.WIDTH, "image_width")
        height = values.needed(names.HEIGHT, "image_height")
        return _pixels(values, *width), _pixels(values, *height)
    for other in (*names.WIDTH, *names.HEIGHT):
        if values.key((other,)) is not None:
            raise values.error(key, "must stand alone", f"{other}, too")
    _, pair = values.needed(names.SIZE, "resolution")
    if not isinstance(pair, list) or len(pair) != 2:
        raise values.error(key, "must be a width and a height", shown(pair))
    return _pixels(values, key, pair[0]), _pixels(values, key, pair[1])


def _pixels(values: NamedValues, key: str, value: Any) -> int:
    number = values.count(key, value)
    if number == 0:
        raise values.error(key, "must be positive", "0")
    return number


def _matrix(values: NamedValues) -> tuple[NDArray[np.float64], str]:
    """Return the camera matrix, of nine numbers or of Kalibr's four, and its key."""
    key = values.key((*names.CAMERA_MATRIX, *names.INTRINSICS))
    if key is not None and names.plain(key) in names.INTRINSICS:
        _, value = values.needed(names.INTRINSICS, "intrinsics")
        four = values.numbers(key, value, _INTRINSICS_NAMES)
        if len(four) != 4:
            raise values.error(key, "must be 4 numbers f_x, f_y, c_x, c_y", len(four))
        return camera_matrix(*four), key
    key, value = values.needed(names.CAMERA_MATRIX, "camera_matrix")
    nine = values.numbers(key, value, _MATRIX_NAMES)
    if len(nine) != 9:
        raise values.error(key, "must be 9 numbers", len(nine))
    fx, skew, cx, below, fy, cy, *last = nine
    if skew or below:
        raise values.error(key, "must have no skew", f"{skew or below:g}")
    # an uncalibrated camera of ROS has nine zeros, which says more than its last row
    if any(nine) and last != [0.0, 0.0, 1.0]:
        raise values.error(key, "must have the last row 0, 0, 1, row by row", shown(last))
    return camera_matrix(fx, fy, cx, cy), key


def _distortion(values: NamedValues, is_distorted: bool) -> list[float] | None:
    if not is_distorted and values.key(names.DISTORTION) is None:
        return None
    key, value = values.needed(names.DISTORTION, "distortion_coefficients")
    if value is None or (isinstance(value, dict) and value.get("data", 0) is None):
        value = []
    coefficients = values.numbers(key, value, _COEFFICIENT_NAMES)
    if any(coefficients[5:]):
        raise values.error(
            key, "must have no coefficients beyond k1, k2, p1, p2, k3", shown(coefficients)
        )
    if len(coefficients) not in _COEFFICIENT_COUNTS:
        raise values.error(key, "must be 4 or 5 numbers k1, k2, p1, p2, k3", len(coefficients))
    if any(coefficients) and not is_distorted:
        model = values.key(names.DISTORTION_MODEL)
        raise values.error(key, f"must be zero where {model} is none", shown(coefficients))
    return coefficients or None


def _delivered(values: NamedValues, full: Calibration) -> Calibration:
    """Return the camera of the delivered image: ROS cuts out the region, then bins its pixels."""
    left, top, width, height = _region(values, full.image_size)
    across = _binning(values, names.BINNING_X, width)
    down = _binning(values, names.BINNING_Y, height)
    # the middle of a binned pixel is the middle of its pixels
    matrix = camera_matrix(
        full.matrix[0, 0] / across,
        full.matrix[1, 1] / down,
        (full.matrix[0, 2] - left + 0.5) / across - 0.5,
        (full.matrix[1, 2] - top + 0.5) / down - 0.5,
    )
    size = (width // across, height // down)
    is_whole = (width, height) == full.image_size
    if not is_in_image(matrix, size):
        raise values.error(
            "roi",
            f"must hold the principal point ({full.matrix[0, 2]:g}, {full.matrix[1, 2]:g})",
            f"{width} x {height} pixels at ({left}, {top})",
        )
    if is_whole and (across, down) == (1, 1):
        return full
    return Calibration(matrix, full.distortion, size, (across, down))


def _binning(values: NamedValues, key_of: tuple[str, ...], size: int) -> int:
    """Return how many pixels make one; ROS's 0 is 1."""
    for key, value in values.entries(key_of):
        number = max(values.count(key, value), 1)
        if number > size:
            raise values.error(key, f"must be at most {size}", number)
        return number
    return 1


def _region(values: NamedValues, image_size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return left, top, width and height of what is delivered; ROS's zeros are the whole image."""
    whole = (0, 0, *image_size)
    for key, roi in values.entries(names.ROI):
        if roi is None:
            return whole
        if not isinstance(roi, dict):
            raise values.error(key, "must hold keys", shown(roi))
        for name in roi:
            if name not in _ROI_KEYS:
                raise values.error(key, f"must hold {', '.join(_ROI_KEYS)}", shown(name, str))
        left, top, width, height = (
            values.count(f"{name} of {key}", roi.get(name, 0)) for name in _ROI_KEYS[:4]
        )
        if not (left or top or width or height):
            return whole
        is_inside = left + width <= image_size[0] and top + height <= image_size[1]
        if not (width and height and is_inside):
            raise values.error(
                key,
                f"must be in the image of {image_size[0]} x {image_size[1]} pixels",
                f"{width} x {height} at ({left}, {top})",
            )
        return left, top, width, height
    return whole


def _text(path: Path) -> str:
    from aspectgraph.files import read_text

    try:
        # some editors begin a file with a byte order mark
        return read_text(path, "utf-8-sig")
    except OSError as error:
        raise CameraError(f"{path}: camera file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise CameraError(f"{path}: camera file must be UTF-8 text. Got other bytes.") from None
