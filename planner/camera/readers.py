"""Calibrations of other programs: COLMAP's cameras.txt; as YAML those of ROS and OpenCV, and ROS's CameraInfo."""

from __future__ import annotations

import re
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.camera.calibration import opencv_fields
from planner.camera.checks import shown
from planner.exceptions import CameraError

# COLMAP's models: where f_x, f_y, c_x, c_y, and k1, k2, p1, p2, k3 to k6 stand among the parameters; -1 is zero
_COLMAP = {
    "SIMPLE_PINHOLE": (3, (0, 0, 1, 2), ()),
    "PINHOLE": (4, (0, 1, 2, 3), ()),
    "SIMPLE_RADIAL": (4, (0, 0, 1, 2), (3, -1, -1, -1)),
    "RADIAL": (5, (0, 0, 1, 2), (3, 4, -1, -1)),
    "OPENCV": (8, (0, 1, 2, 3), (4, 5, 6, 7)),
    "FULL_OPENCV": (12, (0, 1, 2, 3), (4, 5, 6, 7, 8, 9, 10, 11)),
}
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
# OpenCV's own model; the rational one holds it where its further coefficients are zero
_ROS_MODELS = ("plumb_bob", "rational_polynomial")


class Calibration(NamedTuple):
    """Camera matrix (3, 3) in OpenCV's convention, distortion as OpenCV orders it, and image size, px."""

    matrix: NDArray[np.float64]
    distortion: list[float] | None
    image_size: tuple[int, int]


def calibrated_fields(path: str | PathLike[str], lens: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a camera of a calibration file; see `Camera.from_calibration`."""
    path = Path(path)
    found = read_ros(path) if path.suffix.lower() in (".yaml", ".yml") else read_colmap(path)
    return opencv_fields(*found, {"name": path.stem, **lens})


def read_colmap(path: Path) -> Calibration:
    """Read COLMAP's cameras.txt, which must hold one camera.

    Parameters
    ----------
    path : pathlib.Path
        The file. COLMAP's first pixel has its centre at (0.5, 0.5).

    Returns
    -------
    Calibration
        Of the models SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV.

    Raises
    ------
    CameraError
        If the file cannot be read, holds none or several cameras, or another model.
    """
    lines = [
        line.split()
        for line in _text(path).splitlines()
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) != 1 or len(lines[0]) < 5:
        raise CameraError(
            f"{path}: file must hold one camera: id, model, width, height, numbers. Got {len(lines)}."
        )
    _, model, width, height, *rest = lines[0]
    if model not in _COLMAP:
        raise CameraError(
            f"{path}: camera model must be one of {', '.join(_COLMAP)}. Got {shown(model)}."
        )
    count, scales, coefficients = _COLMAP[model]
    try:
        size, numbers = (int(width), int(height)), [*map(float, rest)]
    except ValueError:
        raise CameraError(
            f"{path}: numbers must follow the model. Got {shown(' '.join(lines[0][2:]))}."
        ) from None
    if len(numbers) != count:
        raise CameraError(f"{path}: {model} must have {count} parameters. Got {len(numbers)}.")
    fx, fy, cx, cy = (numbers[k] for k in scales)
    distortion = [0.0 if k < 0 else numbers[k] for k in coefficients]
    return Calibration(_matrix(fx, fy, cx - 0.5, cy - 0.5), distortion or None, size)


def read_ros(path: Path) -> Calibration:
    """Read a camera of ROS or OpenCV: the YAML file of a calibration, or a CameraInfo message as ROS prints it.

    Parameters
    ----------
    path : pathlib.Path
        The file: with ``image_width``, ``camera_matrix`` and ``distortion_coefficients``, or ``width``, ``k``, ``d``.

    Returns
    -------
    Calibration
        Of the unrectified image.

    Raises
    ------
    CameraError
        If the file cannot be read, lacks something, is of binned images, or of another model than plumb_bob.
    """
    parts = _yaml_parts(_text(path))

    def numbers(*names: str, count: int | None = None) -> list[float]:
        for name in names:
            if name in parts:
                found = [float(one) for one in _NUMBER.findall(parts[name].rpartition("data:")[2])]
                if count is not None and len(found) != count:
                    raise CameraError(f"{path}: {name} must be {count} numbers. Got {len(found)}.")
                return found
        raise CameraError(f"{path}: {names[0]} must be given. Got {shown(', '.join(parts), str)}.")

    model = parts.get("distortion_model", "plumb_bob").strip().strip("'\"")
    distortion = numbers("distortion_coefficients", "d", "D")
    if any(distortion) and model not in _ROS_MODELS:
        raise CameraError(f"{path}: distortion_model must be plumb_bob. Got {shown(model)}.")
    for name in ("binning_x", "binning_y"):
        if name in parts and numbers(name, count=1)[0] > 1:
            raise CameraError(f"{path}: {name} must be 0 or 1. Got {parts[name].strip()}.")
    width, height = (numbers(f"image_{name}", name, count=1)[0] for name in ("width", "height"))
    fx, skew, cx, _, fy, cy, *_ = numbers("camera_matrix", "k", "K", count=9)
    if skew:
        raise CameraError(f"{path}: camera_matrix must have no skew. Got {skew:g}.")
    return Calibration(_matrix(fx, fy, cx, cy), distortion or None, (int(width), int(height)))


def _yaml_parts(text: str) -> dict[str, str]:
    """Return the text behind each key of the top level; items of a list may stand at the margin."""
    parts: dict[str, str] = {}
    key = ""
    for line in text.splitlines():
        line = re.sub(r"(^|\s)#.*", "", line)
        if found := re.match(r"(\w+)\s*:(.*)", line):
            key = found.group(1)
            parts[key] = found.group(2)
        elif line.strip() != "---" and key:
            parts[key] += "\n" + re.sub(r"^\s*- ", " ", line)
    return parts


def _matrix(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _text(path: Path) -> str:
    from aspectgraph.files import read_text

    try:
        return read_text(path)
    except OSError as error:
        raise CameraError(f"{path}: camera file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise CameraError(f"{path}: camera file must be UTF-8 text. Got other bytes.") from None
