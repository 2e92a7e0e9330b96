"""COLMAP's cameras.txt: a line for each camera, of its id, model, width, height and numbers."""

from __future__ import annotations

import re
from pathlib import Path

from planner.argument_kinds import shown
from planner.camera.readers.stated_calibration import (
    Calibration,
    camera_matrix,
    check_finite,
    check_pixels,
)
from planner.exceptions import CameraError

# the parameters of each model, in COLMAP's order
_COLMAP = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": (
        *("fx", "fy", "cx", "cy"),
        *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    ),
}
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_CAMERA = re.compile(r"\d+\s+[A-Z][A-Z_0-9]*(\s|$)")
# COLMAP writes this comment above its cameras
_HEADING = re.compile(r"#.*CAMERA_ID,\s*MODEL")
_WHOLE = re.compile(r"\d{1,9}")


def is_colmap(text: str) -> bool:
    """Tell whether a text is COLMAP's: its first line that says something is a camera."""
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            return bool(_CAMERA.match(line.lstrip()))
    return bool(_HEADING.search(text))


def read_colmap(path: Path, text: str) -> Calibration:
    """Read COLMAP's cameras.txt, which must hold one camera.

    Parameters
    ----------
    path : pathlib.Path
        The file, for messages.
    text : str
        What it holds. COLMAP's first pixel has its centre at (0.5, 0.5).

    Returns
    -------
    Calibration
        Of the models SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV.

    Raises
    ------
    CameraError
        If the file holds none or several cameras, or another model.
    """
    lines = [
        line.split()
        for line in text.splitlines()
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) != 1:
        raise CameraError(f"{path}: file must hold one camera. Got {len(lines)}.")
    _, model, *rest = lines[0]
    if model not in _COLMAP:
        raise CameraError(
            f"{path}: camera model must be one of {', '.join(_COLMAP)}. Got {shown(model)}."
        )
    names = _COLMAP[model]
    if len(rest) < 2 or not all(_WHOLE.fullmatch(size) for size in rest[:2]):
        raise CameraError(
            f"{path}: width and height must follow the model. Got {shown(' '.join(rest))}."
        )
    size = (int(rest[0]), int(rest[1]))
    try:
        numbers = [float(number.replace("_", "x")) for number in rest[2:]]
    except ValueError:
        raise CameraError(
            f"{path}: numbers must follow the model. Got {shown(' '.join(rest))}."
        ) from None
    if len(numbers) != len(names):
        raise CameraError(f"{path}: {model} must have {len(names)} parameters. Got {len(numbers)}.")
    check_finite(f"{path}: {model}", numbers, names)
    value = dict(zip(names, numbers, strict=True))
    fx = value.get("fx", value.get("f", 0.0))
    fy = value.get("fy", value.get("f", 0.0))
    matrix = camera_matrix(fx, fy, value["cx"] - 0.5, value["cy"] - 0.5)
    check_pixels(f"{path}: {model}", matrix, size)
    distortion = [value.get(name, 0.0) for name in _COEFFICIENTS] if "k1" in value else None
    if distortion and any(distortion[5:]):
        raise CameraError(
            f"{path}: {model} must have no coefficients beyond k1, k2, p1, p2, k3. "
            f"Got {shown(distortion)}."
        )
    return Calibration(matrix, distortion, size)
