"""The camera: a thin lens in front of a pixel grid.

Notation (all distances along the optical axis from the front nodal point, in millimetres)
------------------------------------------------------------------------------------------
f   focal length                     s   focus distance: the object plane that is imaged sharply
d   image distance, 1/f = 1/d + 1/s  a   aperture diameter f / f_number
c   largest blur circle              z   depth of an object point

A point at depth z would be sharp at the image distance d' with 1/f = 1/d' + 1/z. On the sensor, which stays at d, its
cone of light has the diameter a·|d − d'|/d' = a·d·|1/s − 1/z|. Both limits of the depth of field follow from that line.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from planner.camera.catalogue import catalogued
from planner.exceptions import CameraError

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib  # type: ignore[no-redef]

# numbers outside are slips of the pen, and what is derived from them is not finite
_SMALLEST, _LARGEST = 1e-9, 1e9
# some ten times the coarsest pixels of cameras: more is a pitch in um
_LARGEST_PITCH_MM = 0.5


@dataclass(frozen=True)
class Camera:
    """A thin-lens camera with square or rectangular pixels and a centred optical axis.

    Parameters
    ----------
    focal_length_mm : float
        Focal length f of the lens.
    pixel_pitch_mm : tuple of float
        Distance (r_x, r_y) between neighbouring pixels, across and down.
    resolution : tuple of int
        Pixel counts (width, height).
    f_number : float
        Focal length divided by the aperture diameter.
    focus_distance_mm : float
        Distance s from the front nodal point to the plane in sharp focus.
    largest_blur_mm : float, optional
        Diameter of the largest blur circle that still counts as sharp. Default: the smaller pixel pitch.
    name : str
        For reports; the catalogue fills it in.

    Raises
    ------
    CameraError
        If a number is not positive and of a sensible size, a count not a positive integer, the focus distance not
        beyond f, or the name no text.
    """

    focal_length_mm: float
    pixel_pitch_mm: tuple[float, float]
    resolution: tuple[int, int]
    f_number: float
    focus_distance_mm: float
    largest_blur_mm: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        for field in ("focal_length_mm", "f_number", "focus_distance_mm"):
            object.__setattr__(self, field, _check_positive(field, getattr(self, field)))
        pitch = tuple(_check_positive("pixel_pitch_mm", p) for p in _check_pair("pixel_pitch_mm", self.pixel_pitch_mm))
        if max(pitch) > _LARGEST_PITCH_MM:
            raise CameraError(
                f"pixel_pitch_mm must be at most {_LARGEST_PITCH_MM:g} mm; 3.45 um are 0.00345. Got {max(pitch):g}."
            )
        object.__setattr__(self, "pixel_pitch_mm", pitch)
        counts = tuple(_check_count("resolution", n) for n in _check_pair("resolution", self.resolution))
        object.__setattr__(self, "resolution", counts)
        blur = min(pitch) if self.largest_blur_mm is None else self.largest_blur_mm
        object.__setattr__(self, "largest_blur_mm", _check_positive("largest_blur_mm", blur))
        if not isinstance(self.name, str):
            raise CameraError(f"name must be text. Got {_shown(self.name)}.")
        # focus a rounding error beyond f is none: the image distance would not be finite
        if not 1.0 / self.focal_length_mm > 1.0 / self.focus_distance_mm:
            raise CameraError(
                f"focus_distance_mm must exceed focal_length_mm ({self.focal_length_mm:g}), "
                f"else no real image forms. Got {self.focus_distance_mm:g}."
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
        return self.resolution[0] * self.pixel_pitch_mm[0], self.resolution[1] * self.pixel_pitch_mm[1]

    @property
    def half_diagonal_rad(self) -> float:
        """Angle between the optical axis and the ray to a corner of the sensor."""
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
    def matrix(self) -> np.ndarray:
        """Intrinsic matrix (3, 3) in pixels, OpenCV convention: the centre of the first pixel is (0, 0)."""
        (width, height), (pitch_x, pitch_y) = self.resolution, self.pixel_pitch_mm
        d = self.image_distance_mm
        return np.array([[d / pitch_x, 0.0, (width - 1) / 2], [0.0, d / pitch_y, (height - 1) / 2], [0.0, 0.0, 1.0]])

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
    def named(cls, name: str, **changes: Any) -> Camera:
        """Make a camera of the catalogue.

        Parameters
        ----------
        name : str
            One of `camera_names()`; upper and lower case are the same.
        **changes : float, tuple or str
            Fields to replace, such as ``focus_distance_mm`` or ``f_number``: choices, not data-sheet facts.

        Returns
        -------
        Camera
            Its name is that of the catalogue, unless replaced.

        Raises
        ------
        CameraError
            If the name is unknown (the message offers the nearest names), or the lens cannot be set so.

        Examples
        --------
        >>> from planner import Camera
        >>> camera = Camera.named("basler-acA2440-20gm-8mm", focus_distance_mm=400)
        >>> camera.focal_length_mm, camera.focus_distance_mm, camera.resolution
        (8.0, 400.0, (2448, 2048))
        """
        known = {key.lower(): key for key in catalogued()}
        key = known.get(str(name).lower())
        if key is None:
            near = difflib.get_close_matches(str(name).lower(), known, n=3, cutoff=0.3) or sorted(known)[:3]
            offered = ", ".join(known[n] for n in near)
            raise CameraError(f"camera must be a name of the catalogue. Got {str(name)!r}; nearest: {offered}.")
        fields, lens = catalogued()[key]
        camera = cls.from_dict({**fields, "name": key, **changes})
        widest, narrowest, closest = lens["widest_f_number"], lens["narrowest_f_number"], lens["closest_object_mm"]
        if not widest <= camera.f_number <= narrowest:
            raise CameraError(
                f"f_number must be in {widest:g} to {narrowest:g}, the lens's range. Got {camera.f_number:g}."
            )
        if camera.focus_distance_mm < closest:
            raise CameraError(
                f"focus_distance_mm must be at least {closest:g}, the lens's closest object. "
                f"Got {camera.focus_distance_mm:g}."
            )
        return camera

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> Camera:
        """Read a camera from a TOML file whose top level holds the fields of this class.

        Parameters
        ----------
        path : str or os.PathLike
            The file.

        Returns
        -------
        Camera
            Named after the file if the file gives no name.

        Raises
        ------
        CameraError
            If the file cannot be read, is not TOML, or a field is missing, unknown or wrong; names file and line.
        """
        path = Path(path)
        text, data = _read_toml(path)
        try:
            return cls.from_dict({"name": path.stem, **data})
        except CameraError as error:
            field = str(error).split(" ", 1)[0]
            raise CameraError(f"{path}:{_line_of(field, text)}: {error}") from None

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain Python values, ready for JSON or TOML.

        Returns
        -------
        dict
            Field names and values; pairs are tuples.
        """
        return asdict(self)

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
        known = [field.name for field in fields(cls)]
        for key in data:
            if key not in known:
                named = key if key.isidentifier() else _shown(key)
                raise CameraError(f"{named} must be one of {', '.join(known)}. Got an unknown field.")
        for key in known[:5]:
            if key not in data:
                raise CameraError(f"{key} must be given. Got {_shown(', '.join(map(str, data)) or 'nothing', str)}.")
        return cls(**data)


def _read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    try:
        text = path.read_text(encoding="utf-8")
        return text, tomllib.loads(text)
    except OSError as error:
        raise CameraError(f"{path}: camera file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError as error:
        raise CameraError(
            f"{path}: camera file must be UTF-8 text. Got byte {error.object[error.start]:#04x}."
        ) from None
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"line (\d+)", str(error))
        line = int(found.group(1)) if found else len(text.splitlines())
        raise CameraError(f"{path}:{line}: camera file must be TOML. {error}.") from None
    except RecursionError:
        raise CameraError(f"{path}: camera file must not nest arrays or tables so deep. Got too many levels.") from None
    except ValueError:
        # Python reads no integer of more than some thousand digits
        raise CameraError(f"{path}: camera file must hold numbers of a sensible length. Got a longer one.") from None


def _line_of(field: str, text: str) -> int:
    """Return the line that assigns a field; 1 when the field is missing."""
    pattern = re.compile(rf"\s*[\"']?{re.escape(field)}[\"']?\s*[=.\]]")
    return next((i for i, line in enumerate(text.splitlines(), 1) if pattern.match(line.lstrip("["))), 1)


def _check_pair(field: str, values: Any) -> tuple[Any, ...]:
    try:
        pair = tuple(values)
    except TypeError:
        pair = ()
    if len(pair) != 2 or isinstance(values, str):
        raise CameraError(f"{field} must be two numbers, across and down. Got {_shown(values)}.")
    return pair


def _check_positive(field: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and number > 0) or isinstance(value, str | bool):
        raise CameraError(f"{field} must be finite and positive. Got {_shown(value)}.")
    if not _SMALLEST <= number <= _LARGEST:
        raise CameraError(f"{field} must be in [{_SMALLEST:g}, {_LARGEST:g}]. Got {number:g}.")
    return number


def _check_count(field: str, value: object) -> int:
    number = _check_positive(field, value)
    if number != int(number):
        raise CameraError(f"{field} must be whole pixels. Got {_shown(value)}.")
    return int(number)


def _shown(value: object, text: Callable[[Any], str] = repr) -> str:
    """Return a value as Python writes it, shortened to a readable length."""
    if isinstance(value, int) and value.bit_length() > 240:
        return f"an integer of {value.bit_length()} bits"
    told = text(value)
    return told if len(told) <= 80 else f"{told[:77]}..."
