"""What calibration programs say of a camera, as the fields of `Camera`."""

from __future__ import annotations

import math
import re

# Checks of a camera's numbers, and the reading of its file: errors name the field, the rule and
# the value.
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.argument_kinds import shown
from planner.exceptions import CameraError

# numbers outside are slips of the pen, and what is derived from them is not finite
_SMALLEST = 1e-9
_LARGEST = 1e9

LEAST_WHITE = 63
"""Grey value of full exposure at least: below, steps of grey values are too coarse to find edges."""
MOST_WHITE = 65535
"""Grey value of full exposure at most: that of 16 bits."""


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Return the text of a TOML file and what it says, or raise `CameraError` with file and line."""
    from aspectgraph.files import check_plain, read_text

    try:
        text = read_text(path)
        content = tomllib.loads(text)
    except OSError as error:
        raise CameraError(f"{path}: camera file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError as error:
        raise CameraError(
            f"{path}: camera file must be UTF-8 text. Got byte {error.object[error.start]:#04x}."
        ) from None
    except tomllib.TOMLDecodeError as error:
        match = re.search(r"line (\d+)", str(error))
        line = int(match.group(1)) if match else len(text.splitlines())
        text = f"{path}:{line}: camera file must be TOML. {error}."
        if path.suffix.lower() in _OF_CALIBRATIONS:
            text += (
                f' For a calibration, write a TOML file with calibration = "{path.name}", pixel_pitch_mm, '
                f"f_number and focus_distance_mm."
            )
        raise CameraError(text) from None
    except RecursionError:
        raise CameraError(
            f"{path}: camera file must not nest arrays or tables so deep. Got too many levels."
        ) from None
    except ValueError:
        # Python reads no integer of more than some thousand digits
        raise CameraError(
            f"{path}: camera file must hold numbers of a sensible length. Got a longer one."
        ) from None
    try:
        check_plain(content)
    except ValueError as error:
        raise CameraError(f"{path}: camera file must be TOML for a camera. Got: {error}.") from None
    return text, content


def line_of(field: str, text: str) -> int:
    """Return the line that assigns a field; 1 when the field is missing."""
    pattern = re.compile(rf"\s*[\"']?{re.escape(field)}[\"']?\s*[=.\]]")
    return next(
        (i for i, line in enumerate(text.splitlines(), 1) if pattern.match(line.lstrip("["))), 1
    )


def check_pair(field: str, values: Any) -> tuple[Any, ...]:
    """Return two values of a field, or raise `CameraError`."""
    try:
        pair = tuple(values)
    except TypeError:
        pair = ()
    if len(pair) != 2 or isinstance(values, str):
        raise CameraError.of_rule(field, "must be two numbers, across and down", shown(values))
    return pair


def check_number(field: str, value: Any) -> float:
    """Return a finite number, or raise `CameraError`."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number) or isinstance(value, str | bool):
        raise CameraError.of_rule(field, "must be finite", shown(value))
    return number


def check_positive(field: str, value: Any) -> float:
    """Return a positive number of a sensible size, or raise `CameraError`."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and number > 0) or isinstance(value, str | bool):
        raise CameraError.of_rule(field, "must be finite and positive", shown(value))
    if not _SMALLEST <= number <= _LARGEST:
        raise CameraError.of_rule(field, f"must be in [{_SMALLEST:g}, {_LARGEST:g}]", f"{number:g}")
    return number


def check_count(field: str, value: object) -> int:
    """Return a positive whole number, or raise `CameraError`."""
    number = check_positive(field, value)
    if number != int(number):
        raise CameraError.of_rule(field, "must be whole pixels", shown(value))
    return int(number)


def check_white_level(value: object) -> int:
    """Return a grey value of full exposure, or raise `CameraError`."""
    rule = f"must be a whole number from {LEAST_WHITE} to {MOST_WHITE}, such as 4095 of 12 bits"
    if isinstance(value, str) and value.strip().isdecimal():
        hint = f"write {value.strip()} without quotes"
        raise CameraError.of_rule("white_level", rule, shown(value), hint=hint)
    number = check_positive("white_level", value)
    if number % 1 or not LEAST_WHITE <= number <= MOST_WHITE:
        raise CameraError.of_rule("white_level", rule, shown(value))
    return int(number)


# Brown-Conrady lens distortion as OpenCV states it, and its inverse.
#
# Coordinates are those of the image plane at unit distance: x across, y down, without unit.


_STEPS = 50
_RESIDUAL = 1e-12


@dataclass(frozen=True)
class Distortion:
    """Lens distortion as in OpenCV: radial (k1, k2, k3) and tangential (p1, p2) coefficients.

    Parameters
    ----------
    k1, k2, p1, p2, k3 : float
        Coefficients without unit. All zero means no distortion.

    Raises
    ------
    CameraError
        If a coefficient is not finite.

    Examples
    --------
    >>> from planner import Distortion
    >>> Distortion(k1=-0.1).k1
    -0.1
    """

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        for name in ("k1", "k2", "p1", "p2", "k3"):
            if not np.isfinite(getattr(self, name)):
                raise CameraError.of_rule(name, "must be finite", repr(getattr(self, name)))

    @classmethod
    def of(cls, values: Distortion | ArrayLike | None) -> Distortion | None:
        """Return a distortion from coefficients in OpenCV's order, or None where all are zero.

        Parameters
        ----------
        values : Distortion, array_like or None
            k1, k2, p1, p2 and an optional fifth, k3. Further values must be zero, because OpenCV's
            rational, thin-prism and tilted models are not supported.

        Returns
        -------
        Distortion or None
            None means a lens without distortion.

        Raises
        ------
        CameraError
            If there are fewer than four numbers, or others than the first five are not zero.
        """
        if values is None:
            return None
        if isinstance(values, Distortion):
            return values if any(values.coefficients) else None
        try:
            numbers = np.asarray(values, dtype=float).ravel()
        except (TypeError, ValueError):
            numbers = np.empty(0)
        if len(numbers) < 4:
            raise CameraError.of_rule(
                "distortion", "must be four or five numbers k1, k2, p1, p2, k3", repr(values)
            )
        if np.any(numbers[5:]):
            raise CameraError.of_rule(
                "distortion",
                "must have no coefficients beyond k1, k2, p1, p2, k3",
                repr(values),
            )
        return cls.of(cls(*map(float, numbers[:5])))

    @property
    def coefficients(self) -> tuple[float, float, float, float, float]:
        """The coefficients k1, k2, p1, p2, k3 in OpenCV's order."""
        return self.k1, self.k2, self.p1, self.p2, self.k3

    def distort(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return where the lens images points of the ideal image plane.

        Parameters
        ----------
        points : array_like of shape (..., 2)
            Ideal coordinates x/z, y/z.

        Returns
        -------
        ndarray of shape (..., 2)
            x(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 xy + p2 (r² + 2x²), and y likewise with p1, p2 exchanged.
        """
        x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        across = x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x)
        down = y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y
        return np.stack([across, down], axis=-1)

    def stretch(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of `distort` at ideal points.

        Parameters
        ----------
        points : array (..., 2)
            Ideal points, without unit.

        Returns
        -------
        array (..., 2, 2)
            Of each coordinate of the distorted point (rows) by those of the ideal one (columns).
        """
        x, y = np.moveaxis(points, -1, 0)
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3))
        xx = radial + slope * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x
        xy = slope * x * y + 2.0 * self.p1 * x + 2.0 * self.p2 * y
        yy = radial + slope * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x
        return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)

    def undistort(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the ideal points of distorted images, by Newton's method.

        Parameters
        ----------
        points : array_like of shape (..., 2)
            Distorted coordinates.

        Returns
        -------
        ndarray of shape (..., 2)
            Ideal coordinates.

        Raises
        ------
        CameraError
            If the iteration finds no ideal point: the lens model folds before it.
        """
        target = np.asarray(points, dtype=float)
        ideal = target.copy()
        for _ in range(_STEPS):
            residual = self.distort(ideal) - target
            if (
                not np.all(np.isfinite(residual))
                or np.max(np.abs(residual), initial=0.0) <= _RESIDUAL
            ):
                break
            jacobian = self.stretch(ideal)
            if np.any(np.linalg.det(jacobian) <= 0.0):
                break
            ideal = ideal - np.linalg.solve(jacobian, residual[..., None])[..., 0]
        if not np.max(np.abs(self.distort(ideal) - target), initial=0.0) <= _RESIDUAL:
            raise CameraError(
                f"points must be images of the lens model before it folds. Got {self}."
            )
        return ideal


# some ten times the coarsest pixels of cameras: more is a pitch in um
_LARGEST_PITCH_MM = 0.5
# below the wavelength of light: less is a pitch in metres
_LEAST_PITCH_MM = 0.0001
_NEEDED = ("pixel_pitch_mm", "f_number", "focus_distance_mm")
# no lens for measuring enlarges more: a smaller distance is in metres
_MOST_MAGNIFICATION = 4.0
# what programs write calibrations to
_OF_CALIBRATIONS = (".json", ".txt", ".xml", ".yaml", ".yml")


def check_pitches(values: Any) -> tuple[float, ...]:
    """Return the pitch across and down, mm, or raise `CameraError`; one number is that of square pixels."""
    if isinstance(values, Real) and not isinstance(values, bool):
        values = (values, values)
    return tuple(map(check_pitch, check_pair("pixel_pitch_mm", values)))


def check_pitch(value: Any) -> float:
    """Return a pixel pitch, or raise `CameraError` if it is rather in µm or m."""
    pitch = check_positive("pixel_pitch_mm", value)
    if pitch > _LARGEST_PITCH_MM:
        rule = f"must be at most {_LARGEST_PITCH_MM:g} mm; 3.45 um are 0.00345"
        raise CameraError.of_rule("pixel_pitch_mm", rule, f"{pitch:g}")
    if pitch < _LEAST_PITCH_MM:
        rule = f"must be at least {_LEAST_PITCH_MM:g} mm; 3.45e-06 m are 0.00345"
        raise CameraError.of_rule("pixel_pitch_mm", rule, f"{pitch:g}")
    return pitch


def opencv_fields(
    matrix: ArrayLike,
    distortion: ArrayLike | Distortion | None,
    image_size: tuple[int, int],
    lens: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the fields of the camera that OpenCV calibrated; see `Camera.from_opencv`."""
    try:
        k = np.asarray(matrix, dtype=float)
    except (TypeError, ValueError):
        k = np.empty(0)
    if (
        k.shape != (3, 3)
        or not np.isfinite(k).all()
        or k[0, 1]
        or k[1, 0]
        or (k[2] != [0.0, 0.0, 1.0]).any()
    ):
        rule = "must be [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]"
        got = shown(k.tolist() if k.size else matrix)
        turned = k.shape == (3, 3) and (k[:, 2] == [0.0, 0.0, 1.0]).all()
        raise CameraError.of_rule("matrix", rule, got, hint="transpose it" if turned else "")
    scale_x = check_positive("f_x", k[0, 0])
    scale_y = check_positive("f_y", k[1, 1])
    for name in _NEEDED:
        if name not in lens:
            rule = "must be given: a calibration in pixels does not know it"
            raise CameraError.of_rule(name, rule, "none")
    pitch = check_pitch(lens["pixel_pitch_mm"])
    focus = check_positive("focus_distance_mm", lens["focus_distance_mm"])
    distance = scale_x * pitch
    nearest = distance / _MOST_MAGNIFICATION
    if focus < nearest:
        rule = f"must be at least {nearest:.3g} mm: the image is {distance:.3g} mm from the lens"
        hint = f"{focus:g} m are {1000 * focus:g}"
        raise CameraError.of_rule("focus_distance_mm", rule, f"{focus:g}", hint=hint)
    return {
        **lens,
        "focal_length_mm": 1.0 / (1.0 / distance + 1.0 / focus),
        "pixel_pitch_mm": (pitch, distance / scale_y),
        "resolution": check_pair("image_size", image_size),
        "principal_point_px": (float(k[0, 2]), float(k[1, 2])),
        "distortion": Distortion.of(distortion),
    }
