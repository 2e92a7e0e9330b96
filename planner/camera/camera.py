"""Cameras: those of the catalogue, their lens, sensor and field, and where points lie in their images."""

from __future__ import annotations

import difflib
import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, lru_cache
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ground.convert import ROW, Meta, check_keys, to_plain
from planner.argument_kinds import check_path, shown
from planner.camera.calibration import (
    LEAST_WHITE,
    MOST_WHITE,
    Distortion,
    check_count,
    check_number,
    check_pair,
    check_pitches,
    check_positive,
    check_white_level,
    line_of,
    opencv_fields,
    read_toml,
)
from planner.camera.calibration_files import calibrated_fields
from planner.camera.response import Response, check_response
from planner.exceptions import CameraError, RequestError
from planner.files import name_text

# The catalogue of real cameras: bodies, lenses and pairs of them, read from ``catalogue.toml``.


# A camera as the text of a TOML file.


def toml_text(fields: Mapping[str, Any]) -> str:
    """Return fields as TOML, one to a line; None is left out, because TOML has no word for it.

    Parameters
    ----------
    fields : mapping of str to value
        Texts, numbers, and sequences of them.
    """
    lines = [f"{key} = {_value(value)}" for key, value in fields.items() if value is not None]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, str):
        # TOML forbids DEL, which JSON leaves as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_value, value))}]"
    # the shortest digits that give the same number back
    return repr(value)


# what a camera takes from its body
_BODY = ("pixel_pitch_mm", "resolution")
# sensor's diagonal in focal lengths: the widest straight lenses have 5, a fisheye lens 3
_WIDEST = 20.0


def camera_names() -> tuple[str, ...]:
    """Return the names of the cameras in the catalogue, sorted.

    Returns
    -------
    tuple of str
        Names for `Camera.named`. Each is a camera with a lens.

    Examples
    --------
    >>> from planner import camera_names
    >>> "basler-acA2440-20gm-8mm" in camera_names()
    True
    """
    return tuple(sorted(catalogued()))


def camera_parts() -> dict[str, dict[str, dict[str, Any]]]:
    """Return the bodies and lenses of the catalogue with the facts of their data sheets and where these were read.

    Returns
    -------
    dict
        ``"body"`` and ``"lens"``: by name, the facts, their ``source`` (an address), and ``maker``: whether that is the
        maker's own page.
    """
    data = _data()
    return {
        kind: {name: {"maker": True, **facts} for name, facts in data[kind].items()}
        for kind in ("body", "lens")
    }


def check_bodies(names: Sequence[str]) -> None:
    """Raise `RequestError` unless all names are bodies of the catalogue."""
    bodies = _data()["body"]
    for name in names:
        if name not in bodies:
            rule = f"must be of the catalogue: {', '.join(bodies)}"
            raise RequestError.of_rule("bodies", rule, repr(name))


@cache
def _data() -> dict[str, Any]:
    text = resources.files("planner.camera").joinpath("catalogue.toml").read_text(encoding="utf-8")
    return dict(tomllib.loads(text))


@cache
def catalogued() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Read the catalogue: the fields of each camera, and its lens.

    Bodies and lenses hold data-sheet facts, pairs say which are mounted and how they are set.
    """
    data = _data()
    cameras = {}
    for name, pair in data["pair"].items():
        body = {k: data["body"][pair["body"]][k] for k in _BODY}
        lens = data["lens"][pair["lens"]]
        settings = {key: value for key, value in pair.items() if key not in ("body", "lens")}
        cameras[name] = {"focal_length_mm": lens["focal_length_mm"], **body, **settings}, lens
    return cameras


def find_camera(name: str) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """Return the name of a camera as the catalogue spells it, its fields and its lens; or raise `CameraError`."""
    keys = {key.lower(): key for key in catalogued()}
    key = keys.get(str(name).lower())
    if key is None:
        near = difflib.get_close_matches(str(name).lower(), keys, n=3, cutoff=0.4)
        hint = f"nearest: {', '.join(keys[n] for n in near)}" if near else ""
        rule = "must be a name of the catalogue, which 'aspectgraph cameras' lists"
        raise CameraError.of_rule("camera", rule, repr(str(name)), hint=hint)
    return key, *catalogued()[key]


def check_lens(lens: Mapping[str, Any], f_number: float, focus_distance_mm: float) -> None:
    """Raise `CameraError` unless a lens of the catalogue can be set so."""
    widest = lens["widest_f_number"]
    narrowest = lens["narrowest_f_number"]
    closest = lens["closest_object_mm"]
    if not widest <= f_number <= narrowest:
        raise CameraError.of_rule(
            "f_number", f"must be in {widest:g} to {narrowest:g}, the lens's range", f"{f_number:g}"
        )
    if focus_distance_mm < closest:
        raise CameraError.of_rule(
            "focus_distance_mm",
            f"must be at least {closest:g}, the lens's closest object",
            f"{focus_distance_mm:g}",
        )


# The camera: a thin lens in front of a pixel grid.
#
# Notation (all distances along the optical axis from the front nodal point, in millimetres)
# ------------------------------------------------------------------------------------------
# f   focal length                     s   focus distance: the object plane that is imaged sharply
# d   image distance, 1/f = 1/d + 1/s  a   aperture diameter f / f_number
# c   largest blur circle              z   depth of an object point
#
# A point at depth z would be sharp at the image distance d' with 1/f = 1/d' + 1/z. On the sensor,
# which stays at d, its cone of light has the diameter a·|d − d'|/d' = a·d·|1/s − 1/z|. Both
# limits of the depth of field follow from that line.
#
# distances of a principal point from the middle, as shares of the larger side of an image
_IN_THE_MIDDLE = 0.02
_BESIDE = 0.05

# A calibrated camera may have its principal point off the sensor's middle, and a lens with
# distortion. Lengths are then those of the undistorted image, and `Camera.field` says what of it
# the sensor holds.


# Which ideal image points a lens with distortion brings onto the sensor: a rectangle inside and
# one around them.
#
# Ideal points are directions (x/z, y/z). The field is the connected set of them around the middle
# of the sensor whose images lie on it. Its border is curved; loops and proofs want rectangles.
# Both are *checked* by interval arithmetic:
#
# * inner: the Jacobian J of the distortion is positive definite in it, so its image is bounded by
#   the image of its
#   border, and that lies on the sensor. A segment with both ends in it is imaged whole.
# * outer: its border is imaged off the sensor, so the field, which is connected, does not cross
#   it.
#
# J is symmetric. Where it is positive definite on a convex set, no two points share an image: the
# lens does not fold.


# points of a side, pieces of a side and cells along a side of a rectangle
_POINTS = 129
_PIECES = 1024
_CELLS = 96
# first slack of a rectangle as a share of its size, and how often it is doubled
_SLACK = 1e-5
_DOUBLINGS = 12
_ROUNDING = 1e-12

Rectangle = tuple[float, float, float, float]
_Interval = tuple[NDArray[np.float64], NDArray[np.float64]]


class Field(NamedTuple):
    """Field of view, as tangents left, top, right, bottom of the optical axis.

    Attributes
    ----------
    inner, outer : tuple of float
        Rectangles inside the field and around it.
    least_stretch : float
        Least stretch by the lens in the inner one: smallest eigenvalue of J.
    most_stretch : float
        Largest stretch in the outer one.
    """

    inner: Rectangle
    outer: Rectangle
    least_stretch: float = 1.0
    most_stretch: float = 1.0


@lru_cache(maxsize=64)
def field_of(lens: Distortion, sides: Rectangle) -> Field:
    """Return the field of a lens before a sensor.

    Parameters
    ----------
    lens : Distortion
        The lens.
    sides : tuple of float
        Left, top, right and bottom side of the sensor as its images are measured: tangents with distortion.

    Returns
    -------
    Field
        Sides without an inside have no field: the rectangles are the sides.

    Raises
    ------
    CameraError
        If the lens model folds within the field.
    """
    x_low, y_low, x_high, y_high = sides
    if not (x_low < x_high and y_low < y_high):
        return Field(sides, sides)
    along = np.linspace(0.0, 1.0, _POINTS)
    x = x_low + (x_high - x_low) * along
    y = y_low + (y_high - y_low) * along
    walls = [
        np.stack(np.broadcast_arrays(*wall), axis=-1)
        for wall in ((x_low, y), (x, y_low), (x_high, y), (x, y_high))
    ]
    ideal = [lens.undistort(wall) for wall in walls]
    every = np.concatenate(ideal)
    size = np.ptp(every, axis=0)
    widest = np.concatenate([every.min(axis=0), every.max(axis=0)])
    outer = _first(widest, np.concatenate([-size, size]), lambda box: _off_sensor(lens, box, sides))
    narrowest = np.array(
        [ideal[0][:, 0].max(), ideal[1][:, 1].max(), ideal[2][:, 0].min(), ideal[3][:, 1].min()]
    )
    inner = _first(
        narrowest, np.concatenate([size, -size]), lambda box: _on_sensor(lens, box, sides)
    )
    if outer is None or inner is None or _stretch(lens, outer)[0] <= 0.0:
        raise CameraError.of_rule("distortion", "must not fold within the field of view", str(lens))
    return Field(inner, outer, _stretch(lens, inner)[0], _stretch(lens, outer)[1])


def _first(
    start: NDArray[np.float64], step: NDArray[np.float64], holds: Callable[[Rectangle], bool]
) -> Rectangle | None:
    """Return the first of ever wider, or narrower, rectangles that passes a check."""
    for k in range(_DOUBLINGS):
        x_low, y_low, x_high, y_high = (start + _SLACK * 2**k * step).tolist()
        if holds((x_low, y_low, x_high, y_high)):
            return x_low, y_low, x_high, y_high
    return None


def _off_sensor(lens: Distortion, box: Rectangle, sides: Rectangle) -> bool:
    (x_low, x_high), (y_low, y_high) = _border_images(lens, box)
    first_x, first_y, last_x, last_y = sides
    gap = _ROUNDING
    off = (
        (x_high < first_x - gap)
        | (x_low > last_x + gap)
        | (y_high < first_y - gap)
        | (y_low > last_y + gap)
    )
    return bool(off.all())


def _on_sensor(lens: Distortion, box: Rectangle, sides: Rectangle) -> bool:
    if not (box[0] < box[2] and box[1] < box[3]):
        return False
    (x_low, x_high), (y_low, y_high) = _border_images(lens, box)
    first_x, first_y, last_x, last_y = sides
    gap = _ROUNDING
    on = (
        (x_low > first_x + gap)
        & (x_high < last_x - gap)
        & (y_low > first_y + gap)
        & (y_high < last_y - gap)
    )
    return bool(on.all()) and _stretch(lens, box)[0] > 0.0


def _border_images(lens: Distortion, box: Rectangle) -> tuple[_Interval, _Interval]:
    """Return bounds of the images of a rectangle's border, piece by piece: the middle's, and J times half a piece."""
    x_low, y_low, x_high, y_high = box
    xs = np.linspace(x_low, x_high, _PIECES + 1)
    ys = np.linspace(y_low, y_high, _PIECES + 1)
    pieces = [(_still(wall, _PIECES), (ys[:-1], ys[1:])) for wall in (x_low, x_high)]
    pieces += [((xs[:-1], xs[1:]), _still(wall, _PIECES)) for wall in (y_low, y_high)]
    x = (
        np.concatenate([piece[0][0] for piece in pieces]),
        np.concatenate([piece[0][1] for piece in pieces]),
    )
    y = (
        np.concatenate([piece[1][0] for piece in pieces]),
        np.concatenate([piece[1][1] for piece in pieces]),
    )
    middle = lens.distort(np.stack([(x[0] + x[1]) / 2, (y[0] + y[1]) / 2], axis=-1))
    half_x = (x[1] - x[0]) / 2
    half_y = (y[1] - y[0]) / 2
    mean, half, mixed = _jacobian(lens, x, y)
    across = _largest(_plus(mean, half)) * half_x + _largest(mixed) * half_y
    down = _largest(mixed) * half_x + _largest(_plus(mean, _times(-1.0, half))) * half_y
    return (middle[:, 0] - across, middle[:, 0] + across), (
        middle[:, 1] - down,
        middle[:, 1] + down,
    )


def _stretch(lens: Distortion, box: Rectangle) -> tuple[float, float]:
    """Return bounds of the eigenvalues of J in a rectangle: mean -+ sqrt(half² + mixed²), cell by cell."""
    xs = np.linspace(box[0], box[2], _CELLS + 1)
    ys = np.linspace(box[1], box[3], _CELLS + 1)
    x = tuple(np.repeat(side, _CELLS) for side in (xs[:-1], xs[1:]))
    y = tuple(np.tile(side, _CELLS) for side in (ys[:-1], ys[1:]))
    mean, half, mixed = _jacobian(lens, (x[0], x[1]), (y[0], y[1]))
    root = np.hypot(_largest(half), _largest(mixed))
    return float((mean[0] - root).min()) - _ROUNDING, float((mean[1] + root).max()) + _ROUNDING


def _jacobian(
    lens: Distortion, x: _Interval, y: _Interval
) -> tuple[_Interval, _Interval, _Interval]:
    """Return bounds of (J_xx + J_yy)/2, (J_xx - J_yy)/2 and J_xy."""
    xx = _square(x)
    yy = _square(y)
    r2 = _plus(xx, yy)
    radial = _polynomial((1.0, lens.k1, lens.k2, lens.k3), r2)
    slope = _polynomial((2.0 * lens.k1, 4.0 * lens.k2, 6.0 * lens.k3), r2)
    mean = _plus(
        _plus(radial, _times(0.5, _product(slope, r2))),
        _plus(_times(4 * lens.p1, y), _times(4 * lens.p2, x)),
    )
    half = _times(0.5, _product(slope, _plus(xx, _times(-1.0, yy))))
    half = _plus(half, _plus(_times(2 * lens.p2, x), _times(-2 * lens.p1, y)))
    mixed = _plus(
        _product(slope, _product(x, y)), _plus(_times(2 * lens.p1, x), _times(2 * lens.p2, y))
    )
    return mean, half, mixed


def _still(value: float, n: int) -> _Interval:
    return np.full(n, value), np.full(n, value)


def _plus(a: _Interval, b: _Interval) -> _Interval:
    return a[0] + b[0], a[1] + b[1]


def _times(factor: float, a: _Interval) -> _Interval:
    return (factor * a[0], factor * a[1]) if factor >= 0 else (factor * a[1], factor * a[0])


def _product(a: _Interval, b: _Interval) -> _Interval:
    every = np.stack([a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]])
    return every.min(axis=0), every.max(axis=0)


def _square(a: _Interval) -> _Interval:
    low = np.square(a[0])
    high = np.square(a[1])
    return np.where((a[0] <= 0) & (a[1] >= 0), 0.0, np.minimum(low, high)), np.maximum(low, high)


def _polynomial(coefficients: tuple[float, ...], a: _Interval) -> _Interval:
    """Return bounds of a polynomial of a, which is not negative, by its rising and its falling terms."""
    low = np.zeros_like(a[0])
    high = np.zeros_like(a[0])
    for k, c in enumerate(coefficients):
        low = low + c * a[0 if c >= 0 else 1] ** k
        high = high + c * a[1 if c >= 0 else 0] ** k
    return low, high


def _largest(a: _Interval) -> NDArray[np.float64]:
    return np.maximum(np.abs(a[0]), np.abs(a[1]))


Positive = Annotated[float, Meta(gt=0, title="must be finite and positive")]
_PAIR = Meta(title="must be two numbers, across and down")
_COUNT = Meta(ge=1, title="must be a positive integer")


@dataclass(frozen=True)
class Camera:
    """A thin-lens camera with rectangular pixels; a calibrated one may be off centre and distort.

    Parameters
    ----------
    focal_length_mm : float
        Focal length f of the lens.
    pixel_pitch_mm : tuple of float
        Distance (r_x, r_y) between neighbouring pixels, across and down. One number stands for square pixels.
    resolution : tuple of int
        Pixel counts (width, height).
    f_number : float
        Focal length divided by the aperture diameter.
    focus_distance_mm : float
        Distance s from the front nodal point to the plane in sharp focus.
    largest_blur_mm : float, optional
        Diameter of the largest blur circle that still counts as sharp. Default: the smaller pixel pitch.
    name : str
        Name for reports. `named` sets it to the name in the catalogue.
    principal_point_px : tuple of float, optional
        Point (c_x, c_y) on the optical axis; (0, 0) is the first pixel's centre. Default: the
        middle.
    distortion : Distortion or sequence of float, optional
        Coefficients k1, k2, p1, p2, k3 as OpenCV states them. Default: none.
    white_level : int, optional
        Grey value of full exposure in its image files of 8 or 16 bits, such as 4095 of 12 bits.
        Default: that of the image, see `planner.measuring.images.white_of`.
    response : str or float, optional
        How much light a grey value stands for: "linear", "srgb", a gamma such as 2.2, or a file. The file has two
        columns, level and light, as shares of full exposure. Default: what image files state and edges show.

    Raises
    ------
    CameraError
        If a field breaks its rule, the principal point is off the sensor, or the lens model folds
        on the sensor.

    Examples
    --------
    >>> from planner import Camera
    >>> camera = Camera(25.0, (0.00345, 0.00345), (2448, 2048), f_number=8.0, focus_distance_mm=250.0)
    >>> round(camera.image_distance_mm, 3)
    27.778
    """

    focal_length_mm: Positive
    pixel_pitch_mm: Annotated[tuple[Positive, Positive], _PAIR]
    resolution: Annotated[
        tuple[Annotated[int, _COUNT], Annotated[int, _COUNT]],
        _PAIR,
    ]
    f_number: Positive
    focus_distance_mm: Positive
    largest_blur_mm: Positive | None = None
    name: str = ""
    principal_point_px: Annotated[tuple[float, float] | None, _PAIR] = None
    distortion: Annotated[
        Distortion | None, ROW, Meta(title="must be five numbers: k1, k2, p1, p2, k3")
    ] = None
    white_level: Annotated[
        int | None,
        Meta(
            ge=LEAST_WHITE,
            le=MOST_WHITE,
            title=f"must be a whole number from {LEAST_WHITE} to {MOST_WHITE}",
            description="Grey value of full exposure in image files of 8 or 16 bits. "
            "Without it, it is that of each image.",
        ),
    ] = None
    response: Annotated[
        str | None,
        Meta(
            description="Light of a grey value: linear, srgb, a gamma, or rows of level and light. "
            "Without it, image files and edges show it."
        ),
    ] = None

    def __post_init__(self) -> None:
        for field in ("focal_length_mm", "f_number", "focus_distance_mm"):
            object.__setattr__(self, field, check_positive(field, getattr(self, field)))
        pitch = check_pitches(self.pixel_pitch_mm)
        object.__setattr__(self, "pixel_pitch_mm", pitch)
        counts = tuple(
            check_count("resolution", n) for n in check_pair("resolution", self.resolution)
        )
        object.__setattr__(self, "resolution", counts)
        self._check_view()
        blur = min(pitch) if self.largest_blur_mm is None else self.largest_blur_mm
        object.__setattr__(self, "largest_blur_mm", check_positive("largest_blur_mm", blur))
        if not isinstance(self.name, str):
            raise CameraError.of_rule("name", "must be text", shown(self.name))
        if self.white_level is not None:
            object.__setattr__(self, "white_level", check_white_level(self.white_level))
        if self.response is not None:
            object.__setattr__(self, "response", check_response(self.response))
        # focus a rounding error beyond f is none: the image distance would not be finite
        if not 1.0 / self.focal_length_mm > 1.0 / self.focus_distance_mm:
            rule = (
                f"must exceed focal_length_mm ({self.focal_length_mm:g}), "
                "otherwise no real image forms"
            )
            raise CameraError.of_rule("focus_distance_mm", rule, f"{self.focus_distance_mm:g}")
        self._check_calibration()

    def _check_view(self) -> None:
        """Refuse a focal length that is rather in metres: no lens has so wide a view."""
        diagonal = math.hypot(*self.sensor_size_mm)
        if self.focal_length_mm * _WIDEST < diagonal:
            rule = f"must be at least {diagonal / _WIDEST:.3g} mm for a sensor of {diagonal:.3g} mm"
            hint = f"{self.focal_length_mm:g} m are {1000 * self.focal_length_mm:g}"
            raise CameraError.of_rule(
                "focal_length_mm", rule, f"{self.focal_length_mm:g}", hint=hint
            )

    def _check_calibration(self) -> None:
        object.__setattr__(self, "distortion", Distortion.of(self.distortion))
        if self.principal_point_px is not None:
            point = tuple(
                check_number("principal_point_px", c)
                for c in check_pair("principal_point_px", self.principal_point_px)
            )
            object.__setattr__(self, "principal_point_px", point)
            if not all(-0.5 < c < n - 0.5 for c, n in zip(point, self.resolution, strict=True)):
                raise CameraError.of_rule(
                    "principal_point_px", "must be on the sensor", shown(point)
                )
        if self.distortion is not None:
            # a pixel more than there is: what is rounded to the last one lies half a pixel beyond
            self.field(-1.0)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        name = f" {self.name!r}" if self.name else ""
        width, height = self.resolution
        is_calibrated = self.distortion is not None or self.principal_point_px is not None
        calibrated = ", calibrated" if is_calibrated else ""
        return (
            f"<Camera{name}: {self.focal_length_mm:g} mm, {width} × {height} px, "
            f"f/{self.f_number:g}, focus at {self.focus_distance_mm:g} mm{calibrated}>"
        )

    @property
    def image_distance_mm(self) -> float:
        """Distance d from the rear nodal point to the sensor, 1/f = 1/d + 1/s."""
        return 1.0 / (1.0 / self.focal_length_mm - 1.0 / self.focus_distance_mm)

    @property
    def aperture_mm(self) -> float:
        """Diameter a of the aperture."""
        return self.focal_length_mm / self.f_number

    @property
    def sensor_size_mm(self) -> tuple[float, float]:
        """Width and height of the sensor."""
        return self.resolution[0] * self.pixel_pitch_mm[0], self.resolution[
            1
        ] * self.pixel_pitch_mm[1]

    @property
    def half_diagonal_rad(self) -> float:
        """Largest angle between the optical axis and a ray to the sensor, in its farthest corner."""
        if not self.is_centred:
            x_low, y_low, x_high, y_high = self.field().outer
            return math.atan(math.hypot(max(-x_low, x_high), max(-y_low, y_high)))
        return math.atan(0.5 * math.hypot(*self.sensor_size_mm) / self.image_distance_mm)

    @property
    def depth_of_field_mm(self) -> tuple[float, float]:
        """Nearest and farthest depth (D_min, D_max) whose blur circle is not too large; D_max may be inf."""
        sharp = 1.0 / self.focus_distance_mm
        blur = float(self.largest_blur_mm or 0.0)  # never None once made
        spread = blur / (self.aperture_mm * self.image_distance_mm)
        farthest = 1.0 / (sharp - spread) if sharp > spread else math.inf
        return 1.0 / (sharp + spread), farthest

    @property
    def depth_of_field_text(self) -> str:
        """Depth of field in mm, with enough digits, such as ``249.8 to 250.2``."""
        nearest, farthest = self.depth_of_field_mm
        if not math.isfinite(farthest):
            return f"{nearest:.4g} to infinity"
        digits = 1 - math.floor(math.log10(farthest - nearest)) if farthest > nearest else 6
        digits = min(max(digits, 0), 6)
        return f"{nearest:.{digits}f} to {farthest:.{digits}f}"

    @property
    def matrix(self) -> np.ndarray:
        """Intrinsic matrix (3, 3) in pixels, OpenCV convention: the centre of the first pixel is (0, 0)."""
        (width, height) = self.resolution
        (pitch_x, pitch_y) = self.pixel_pitch_mm
        across, down = self.principal_point_px or ((width - 1) / 2, (height - 1) / 2)
        d = self.image_distance_mm
        return np.array([[d / pitch_x, 0.0, across], [0.0, d / pitch_y, down], [0.0, 0.0, 1.0]])

    @property
    def is_centred(self) -> bool:
        """Whether the optical axis meets the sensor's middle, without lens distortion."""
        return self.principal_point_px is None and self.distortion is None

    @property
    def seems_turned(self) -> bool:
        """Whether the principal point is in the middle of an image of exchanged width and height alone."""
        if self.principal_point_px is None:
            return False
        (across, down) = self.principal_point_px
        (width, height) = self.resolution
        larger = max(width, height)
        off = math.hypot(across - (width - 1) / 2, down - (height - 1) / 2)
        off_exchanged = math.hypot(across - (height - 1) / 2, down - (width - 1) / 2)
        return off > _BESIDE * larger and off_exchanged < _IN_THE_MIDDLE * larger

    def field(self, margin_px: float = 0.0) -> Field:
        """Return the part of the undistorted image on the sensor, without a strip along its edges.

        Parameters
        ----------
        margin_px : float
            Width of the strip in pixels of the real image.

        Returns
        -------
        Field
            Tangents of the angles to the optical axis; see `planner.camera.camera`.

        Raises
        ------
        CameraError
            If the lens model folds within the field.
        """
        matrix = self.matrix
        low = (margin_px - 0.5 - matrix[:2, 2]) / np.diag(matrix)[:2]
        high = (np.array(self.resolution) - 0.5 - margin_px - matrix[:2, 2]) / np.diag(matrix)[:2]
        sides = float(low[0]), float(low[1]), float(high[0]), float(high[1])
        return Field(sides, sides) if self.distortion is None else field_of(self.distortion, sides)

    @property
    def image_pitch_mm(self) -> tuple[float, float]:
        """Pixel pitch in the undistorted image. With distortion, the coarsest in the inner field.

        Rounding there has the covariance J^-1 D^2 J^-1 / 12. It is at most the largest pitch
        squared over the smallest eigenvalue of J squared, over 12.
        """
        if self.distortion is None:
            return self.pixel_pitch_mm
        coarsest = max(self.pixel_pitch_mm) / self.field().least_stretch
        return coarsest, coarsest

    @property
    def finest_pitch_mm(self) -> tuple[float, float]:
        """Lower bound of the pixel pitch in the undistorted image, over the outer field."""
        largest_stretch = self.field().most_stretch
        return self.pixel_pitch_mm[0] / largest_stretch, self.pixel_pitch_mm[1] / largest_stretch

    def focused_at(self, distance_mm: float) -> Camera:
        """Return the same camera and lens, focused at another distance.

        Parameters
        ----------
        distance_mm : float
            New distance from the front nodal point to the plane in sharp focus, mm.

        Returns
        -------
        Camera
            A new camera; this one is not changed.

        Raises
        ------
        CameraError
            If the distance does not exceed the focal length.
        """
        return replace(self, focus_distance_mm=distance_mm)

    @classmethod
    def from_opencv(
        cls,
        matrix: ArrayLike,
        distortion: ArrayLike | Distortion | None,
        image_size: tuple[int, int],
        **lens: Any,
    ) -> Camera:
        """Make a camera from the result of an OpenCV calibration.

        A calibration gives focal lengths in pixels only. The sensor's pixel pitch in mm converts
        them to lengths: d = f_x r_x, r_y = d / f_y, and f = 1 / (1/d + 1/s).

        Parameters
        ----------
        matrix : array_like (3, 3)
            Camera matrix K in px, without skew; the first pixel's centre is (0, 0).
        distortion : array_like, Distortion or None
            k1, k2, p1, p2 and k3 as ``cv2.calibrateCamera`` returns them, at its focus.
        image_size : tuple of int
            Width and height, px.
        **lens : float or str
            Must hold ``pixel_pitch_mm`` (one number, across), ``f_number`` and ``focus_distance_mm``; may hold
            ``largest_blur_mm``, ``white_level``, ``response`` and ``name``.

        Returns
        -------
        Camera
            Its `matrix` is K.

        Raises
        ------
        CameraError
            If K is not a camera matrix, or a number is missing or wrong.

        Examples
        --------
        >>> from planner import Camera
        >>> k = [[2320.0, 0, 1231.5], [0, 2321.5, 1019.0], [0, 0, 1]]
        >>> lens = {"pixel_pitch_mm": 0.00345, "f_number": 8, "focus_distance_mm": 300}
        >>> camera = Camera.from_opencv(k, [-0.12, 0.09, 4e-4, -2e-4, 0], (2448, 2048), **lens)
        >>> round(camera.focal_length_mm, 3), camera.principal_point_px
        (7.796, (1231.5, 1019.0))
        """
        return cls.from_dict(opencv_fields(matrix, distortion, image_size, lens))

    @classmethod
    def named(cls, name: str, **changes: Any) -> Camera:
        """Make a camera from the catalogue.

        Parameters
        ----------
        name : str
            One of `camera_names()`, in upper or lower case.
        **changes : float, tuple or str
            Fields to replace, such as ``focus_distance_mm`` or ``f_number``: choices, not data-sheet facts.

        Returns
        -------
        Camera
            Its name is that of the catalogue, unless replaced.

        Raises
        ------
        CameraError
            If the name is unknown (the message offers the nearest), or the lens excludes the
            setting.

        Examples
        --------
        >>> from planner import Camera
        >>> camera = Camera.named("basler-acA2440-20gm-8mm", focus_distance_mm=400)
        >>> camera.focal_length_mm, camera.focus_distance_mm, camera.resolution
        (8.0, 400.0, (2448, 2048))
        """
        key, facts, lens = find_camera(name)
        _check_changes(changes, [item.name for item in fields(cls)])
        camera = cls.from_dict({**facts, "name": key, **changes})
        check_lens(lens, camera.f_number, camera.focus_distance_mm)
        return camera

    @classmethod
    def from_calibration(cls, path: str | PathLike[str], **lens: Any) -> Camera:
        """Make a camera from another program's calibration file.

        Parameters
        ----------
        path : str or os.PathLike
            A calibration file of one camera, from ROS (also a CameraInfo message), OpenCV (YAML,
            XML, JSON), Kalibr or Autoware, or COLMAP's cameras.txt. The content decides, not the
            name. The result describes the raw image as the camera delivers it, with region of
            interest and binning.
        **lens : float or str
            As in `from_opencv`. The pixel pitch is the sensor's, without binning.

        Returns
        -------
        Camera
            Named after the file if no name is given.

        Raises
        ------
        CameraError
            If the file cannot be read, or holds several cameras, another lens model or an unknown
            key. If a number is missing or wrong.
        """
        return cls.from_dict(calibrated_fields(path, lens))

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> Camera:
        """Read a camera from a TOML file with the fields of this class at its top level.

        Parameters
        ----------
        path : str or os.PathLike
            The file. Its ``calibration`` may name a file for `from_calibration` in the same folder.
            It replaces focal length, resolution and both pixel pitches. Its ``response`` may name a file there, too.

        Returns
        -------
        Camera
            Named after the file if the file gives no name.

        Raises
        ------
        CameraError
            If the file cannot be read, is not TOML, or a field is missing, unknown or wrong. The
            message names file and line.
        """
        if not isinstance(path, str | PathLike):
            raise CameraError.of_rule("path", "must be a path", shown(path))
        path = Path(path)
        text, data = read_toml(path)
        try:
            if "response" in data:
                data["response"] = Response.of(data["response"], path.parent).text
            if "calibration" in data:
                return cls.from_calibration(
                    path.parent / str(data.pop("calibration")),
                    **{"name": name_text(path.stem), **data},
                )
            return cls.from_dict({"name": name_text(path.stem), **data})
        except CameraError as error:
            # an error without a parameter is one of the file that ``calibration`` names
            line = line_of(error.parameter or "calibration", text)
            raise CameraError(f"{path}:{line}: {error}") from None

    @classmethod
    def read(cls, path: str | PathLike[str]) -> Camera:
        """Read a camera that `write` wrote; another name of `from_toml`.

        Parameters
        ----------
        path : str or os.PathLike
            The TOML file.

        Returns
        -------
        Camera
            Equal to the camera written.
        """
        return cls.from_toml(path)

    def write(self, path: str | PathLike[str]) -> Path:
        """Write the camera as a TOML file, which `from_toml` and ``--camera`` read.

        Parameters
        ----------
        path : str or os.PathLike
            The file; an existing one is replaced.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        OutputError
            If it cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> from planner import Camera
        >>> camera = Camera.named("basler-acA2440-20gm-8mm")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = camera.write(Path(folder) / "camera.toml")
        ...     Camera.read(path) == camera
        True
        """
        from planner.files import write_text

        check_path("path", path)
        write_text(path, toml_text(self.to_dict()))
        return Path(path)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain Python values, ready for JSON or TOML.

        Returns
        -------
        dict
            Field names and values, without those that are not stated.
        """
        # a file without a name is named after itself
        return {"name": self.name, **to_plain(self)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Camera:
        """Build a camera from the fields of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            Fields of this class; those with a default may be missing.

        Returns
        -------
        Camera
            The camera.

        Raises
        ------
        CameraError
            If a field is missing, unknown or wrong.
        """
        check_keys(cls, data, CameraError)
        return cls(**data)


# Where a camera images points, and what a lens without distortion would have imaged there.


# what is rounded to the last pixel lies half a pixel off the sensor, with a random phase a whole one
_BEYOND_PX = 1.0


def image_of(camera: Camera, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where points are imaged.

    Parameters
    ----------
    camera : Camera
        The camera.
    directions : array (..., 3)
        Points in its frame over their depth, (x/z, y/z, 1).

    Returns
    -------
    array (..., 2)
        Pixels of the real, distorted image; nan where a lens with distortion has no field of view.
    """
    matrix = camera.matrix
    if camera.distortion is None:
        return np.asarray((directions @ matrix.T)[..., :2])
    x_low, y_low, x_high, y_high = camera.field(-_BEYOND_PX).outer
    x = directions[..., 0]
    y = directions[..., 1]
    inside = ((x >= x_low) & (x <= x_high) & (y >= y_low) & (y <= y_high))[..., None]
    distorted = camera.distortion.distort(np.where(inside, directions[..., :2], 0.0))
    return np.where(inside, distorted * np.diag(matrix)[:2] + matrix[:2, 2], np.nan)


def tangents_of(camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the directions that are seen at some pixels.

    Parameters
    ----------
    camera : Camera
        The camera.
    pixels : array (..., 2)
        Pixels of the real image.

    Returns
    -------
    array (..., 2)
        x/z and y/z; nan more than a pixel off the sensor where the lens distorts.
    """
    scale = np.diag(camera.matrix)[:2]
    centre = camera.matrix[:2, 2]
    if camera.distortion is None:
        return np.asarray((pixels - centre) / scale)
    limit = np.array(camera.resolution) - 0.5 + _BEYOND_PX
    inside = np.all((pixels >= -0.5 - _BEYOND_PX) & (pixels <= limit), axis=-1, keepdims=True)
    ideal = camera.distortion.undistort(np.where(inside, (pixels - centre) / scale, 0.0))
    return np.where(inside, ideal, np.nan)


def undistorted_px(camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a lens without distortion would have imaged what is seen at some pixels.

    Parameters
    ----------
    camera : Camera
        The camera.
    pixels : array (..., 2)
        Pixels of the real image.

    Returns
    -------
    array (..., 2)
        Pixels of the undistorted image; nan more than a pixel off the sensor where the lens distorts.
    """
    if camera.distortion is None:
        return pixels
    return tangents_of(camera, pixels) * np.diag(camera.matrix)[:2] + camera.matrix[:2, 2]


def _check_changes(changes: Mapping[str, Any], names: Sequence[str]) -> None:
    """Refuse a change of what a camera has not, and name the field that may be meant."""
    for name in changes:
        if name in names:
            continue
        near = [field for field in names if field.startswith(name)] or difflib.get_close_matches(
            name, names
        )
        hint = f"did you mean {near[0]}?" if near else ""
        rule = f"must be fields of a camera, {', '.join(names)}"
        raise CameraError.of_rule("changes", rule, repr(name), hint=hint)
