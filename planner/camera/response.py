"""The response of a camera: how much light a grey value stands for, as users, curves and image files state it.

Notation
--------
g   grey value above black, as a share of full exposure       L   light, as a share of that of full exposure

A response is L(g). Cameras with gamma have g = L^(1/gamma), so that L = g^gamma.
"""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.argument_kinds import shown
from planner.exceptions import CameraError

Array = NDArray[np.float64]

LINEAR_NAME = "linear"
"""The response of grey values that are proportional to light."""
SRGB_NAME = "srgb"
"""The response of IEC 61966-2-1."""
LEAST_GAMMA = 0.5
"""The smallest gamma that can be stated. Where a camera is set to 0.45, its response is 2.2."""
MOST_GAMMA = 4.0
"""The largest one."""
VIDEO_BLACK = 16 / 255
"""Black of images in video range (16 to 235 of 255), as a share of the largest grey value."""

_RULE = (
    f"must be {LINEAR_NAME}, {SRGB_NAME}, a gamma from {LEAST_GAMMA:g} to {MOST_GAMMA:g} such as 2.2, "
    "or a file of level and light"
)
_FILE_RULE = "must be a file of two columns that rise, level and light, as shares that end with 1 1"
_MOST_ROWS = 65_536
# IEC 61966-2-1: where the line near black ends, its slope, and the power above it
_SRGB_END = 0.04045
_SRGB_SLOPE = 12.92
_SRGB_OFFSET = 0.055
_SRGB_POWER = 2.4


@dataclass(frozen=True)
class Response:
    """How much light a grey value stands for.

    Attributes
    ----------
    text : str
        Its name: "linear", "srgb", a gamma such as "2.2", or the rows of a curve, "0 0; 0.5 0.2; 1 1".
    gamma : float
        Power of the share of full exposure; 1 of what is no power.
    black : float
        Grey value of no light, as a share of full exposure.
    levels, lights : tuple of float
        Rows of a curve; empty if it is none.
    """

    text: str = LINEAR_NAME
    gamma: float = 1.0
    black: float = 0.0
    levels: tuple[float, ...] = ()
    lights: tuple[float, ...] = ()

    @classmethod
    def of(cls, value: object, folder: Path | None = None) -> Response:
        """Return the response that a user states.

        Parameters
        ----------
        value : Response, str or float
            "linear", "srgb", a gamma, the rows of a curve, or the path of a file of two columns.
        folder : pathlib.Path, optional
            Where a path begins. Default: the current folder.

        Raises
        ------
        CameraError
            If it is nothing of this, or the file is not such a file.
        """
        if isinstance(value, Response):
            return value
        if isinstance(value, bool) or not isinstance(value, str | int | float | os.PathLike):
            raise CameraError.of_rule("response", _RULE, shown(value))
        text = str(value).strip()
        if text.lower() in (LINEAR_NAME, SRGB_NAME):
            return cls(text.lower())
        number = _number(text)
        if number is not None:
            if not LEAST_GAMMA <= number <= MOST_GAMMA:
                hint = (
                    "" if not 0 < number < LEAST_GAMMA else f"; gamma {text} has {1 / number:.2g}"
                )
                raise CameraError.of_rule("response", _RULE + hint, text)
            return cls.power(number)
        if ";" in text:
            return cls._curve(text, text.split(";"))
        path = Path(text) if folder is None else folder / text
        try:
            content = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
        except OSError:
            content = ""
        if not content:
            raise CameraError.of_rule("response", _RULE, shown(value))
        return cls._curve(str(value), content.splitlines())

    @classmethod
    def power(cls, gamma: float, black: float = 0.0) -> Response:
        """Return the response of a gamma, whose black is this share of full exposure."""
        text = f"{gamma:.6g}" if gamma != 1.0 or black else LINEAR_NAME
        return cls(text, float(gamma), black)

    @classmethod
    def _curve(cls, source: str, lines: list[str]) -> Response:
        rows: list[list[float | None]] = []
        for line in lines:
            words = line.split("#")[0].replace(",", " ").split()
            if words:
                numbers = [_number(word) for word in words]
                if rows or None not in numbers:
                    rows.append(numbers)
        table = _checked(source, rows)
        text = "; ".join(f"{level:.6g} {light:.6g}" for level, light in table.tolist())
        return cls(text, levels=tuple(table[:, 0]), lights=tuple(table[:, 1]))

    @property
    def is_linear(self) -> bool:
        """Whether grey values are proportional to light."""
        return self.text == LINEAR_NAME

    @property
    def power_at_half(self) -> float:
        """The gamma that makes the same light of half of full exposure."""
        light = float(np.clip(self.light(np.array(0.5)), 1e-6, 1 - 1e-6))
        return math.log(light) / math.log(0.5)

    @property
    def words(self) -> str:
        """Its name in sentences."""
        if self.levels:
            return f"a curve of {len(self.levels)} rows"
        return {LINEAR_NAME: "linear", SRGB_NAME: "sRGB"}.get(self.text, f"gamma {self.gamma:.3g}")

    def light(self, share: NDArray[Any]) -> Array:
        """Return the light (...) of grey values (...), both as shares of those of full exposure."""
        above = np.asarray(share, dtype=np.float64)
        if self.levels:
            return np.interp(above, self.levels, self.lights)
        if self.text == SRGB_NAME:
            power = ((np.maximum(above, 0.0) + _SRGB_OFFSET) / (1 + _SRGB_OFFSET)) ** _SRGB_POWER
            return np.where(above <= _SRGB_END, above / _SRGB_SLOPE, power)
        above = np.maximum((above - self.black) / (1 - self.black), 0.0)
        return np.asarray(above**self.gamma)

    def level(self, light: NDArray[Any]) -> Array:
        """Return the grey values (...) of light (...), both as shares of those of full exposure; inverse of `light`.

        Light is taken as 0 at least, and a curve ends with its last row.
        """
        exposure = np.maximum(np.asarray(light, dtype=np.float64), 0.0)
        if self.levels:
            return np.interp(exposure, self.lights, self.levels)
        if self.text == SRGB_NAME:
            power = (1 + _SRGB_OFFSET) * exposure ** (1 / _SRGB_POWER) - _SRGB_OFFSET
            return np.where(exposure <= _SRGB_END / _SRGB_SLOPE, _SRGB_SLOPE * exposure, power)
        return np.asarray(self.black + (1 - self.black) * exposure ** (1 / self.gamma))

    def applied(self, levels: NDArray[np.float32], white: float) -> NDArray[np.float32]:
        """Return light (h, w) of grey values (h, w), scaled so that full exposure remains the same number."""
        if self.is_linear:
            return levels
        brightest = int(levels.max(initial=0.0))
        whole = levels.astype(np.uint16) if 0 < brightest < 2**16 else np.zeros(0, np.uint16)
        if white > 1 and whole.size and np.array_equal(whole, levels):
            table = white * self.light(np.arange(brightest + 1) / white)
            return np.asarray(np.take(table.astype(np.float32), whole))
        return np.asarray(white * self.light(levels / white), dtype=np.float32)


LINEAR = Response()
SRGB = Response(SRGB_NAME)


def check_response(value: object) -> str:
    """Return a camera's response as text, or raise `CameraError`."""
    return Response.of(value).text


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _checked(source: str, rows: list[list[float | None]]) -> Array:
    """Return the rows (n, 2) of a curve."""
    if len(rows) < 2 or len(rows) > _MOST_ROWS or any(len(row) != 2 or None in row for row in rows):
        raise CameraError.of_rule("response", _FILE_RULE, shown(source))
    table = np.array(rows, dtype=np.float64)
    rises = (np.diff(table, axis=0) > 0).all() and (table >= 0).all()
    if not rises or not np.allclose(table[-1], 1.0, atol=1e-6):
        raise CameraError.of_rule("response", _FILE_RULE, shown(source))
    return table


# What image files state: the chunks gAMA, sRGB and iCCP of PNG, profiles and EXIF of all kinds.
#
# A profile has a curve for grey (kTRC) or for each colour (rTRC, gTRC): a gamma, a table or one of
# five formulas (ICC.1:2022, 10.6 and 10.18).


_EXIF_IFD = 0x8769
_COLOUR_SPACE = 0xA001
_TRC = (b"kTRC", b"gTRC", b"rTRC")
_TAGS_AT = 128
_MOST_TAGS = 100
# a curve that is nearer to a power or to sRGB than this is called so
_SAME = 0.004
_PROFILE_STEPS = 256


def stated_in_file(info: Mapping[Any, Any], exif: Any) -> Response | None:
    """Return the response that an image file states; None if it states none.

    Parameters
    ----------
    info : mapping
        What Pillow reads of the file's chunks: ``icc_profile``, ``srgb``, ``gamma``. In PNG, a profile counts more than
        sRGB, and this more than gAMA.
    exif : PIL.Image.Exif
        Its EXIF tags.
    """
    profile = info.get("icc_profile")
    if profile:
        try:
            return of_profile(bytes(profile))
        except (struct.error, ValueError, IndexError, TypeError):
            # what cannot be read states nothing
            return None
    if "srgb" in info:
        return SRGB
    encoding = info.get("gamma")
    if isinstance(encoding, int | float) and LEAST_GAMMA <= 1 / max(encoding, 1e-3) <= MOST_GAMMA:
        return _named(Response.power(1 / encoding))
    if exif and exif.get_ifd(_EXIF_IFD).get(_COLOUR_SPACE) == 1:
        return SRGB
    return None


def of_profile(profile: bytes) -> Response | None:
    """Return the response of an ICC profile; None if it has no curve.

    Raises
    ------
    struct.error, ValueError
        If it is no such profile.
    """
    (count,) = struct.unpack_from(">I", profile, _TAGS_AT)
    places = {}
    for k in range(min(count, _MOST_TAGS)):
        tag, start, _ = struct.unpack_from(">4sII", profile, _TAGS_AT + 4 + 12 * k)
        places[tag] = start
    for tag in _TRC:
        if tag in places:
            share = np.linspace(0.0, 1.0, _PROFILE_STEPS)
            return _of_curve(share, _profile_curve(profile, places[tag])(share))
    return None


def _profile_curve(profile: bytes, start: int) -> Callable[[Array], Array]:
    """Return the function of a curve of a profile."""
    kind = profile[start : start + 4]
    if kind == b"curv":
        (count,) = struct.unpack_from(">I", profile, start + 8)
        values = np.array(struct.unpack_from(f">{count}H", profile, start + 12), dtype=np.float64)
        if count == 0:
            return lambda x: x
        if count == 1:
            return lambda x: x ** (values[0] / 256)
        return lambda x: np.interp(x, np.linspace(0.0, 1.0, count), values / 65535)
    if kind != b"para":
        raise ValueError("no curve")
    (number,) = struct.unpack_from(">H", profile, start + 8)
    counts = (1, 3, 4, 5, 7)
    if number >= len(counts):
        raise ValueError("no curve")
    numbers = struct.unpack_from(f">{counts[number]}i", profile, start + 12)
    g, a, b, c, d, e, f = [n / 65536 for n in numbers] + [0.0] * (7 - len(numbers))
    if number == 0:
        return lambda x: x**g
    # below the break, the first two kinds have a constant, the others a line
    first = number in (1, 2)
    at = -b / a if first else d
    above = c if number == 2 else e
    line = 0.0 if first else c
    below = c if number == 2 else f

    def formula(x: Array) -> Array:
        power = np.maximum(a * x + b, 0.0) ** g + above
        return np.where(x >= at, power, line * x + below)

    return formula


def _of_curve(share: Array, light: Array) -> Response:
    """Return the response of a curve: by its name, if it is a usual one."""
    inner = (share > 0.05) & (share < 1) & (light > 0) & (light < 1)
    if not inner.any():
        raise ValueError("no curve")
    gamma = float(np.median(np.log(light[inner]) / np.log(share[inner])))
    for usual in (LINEAR, SRGB, Response.power(round(gamma, 2))):
        if np.abs(usual.light(share) - light).max() < _SAME:
            return usual
    rises = np.concatenate([[True], np.diff(light) > 0])
    rows = [[float(x), float(y)] for x, y in zip(share[rises], light[rises], strict=True)]
    rows[-1] = [1.0, 1.0]
    table = _checked("profile", [list(row) for row in rows])
    return Response("profile", levels=tuple(table[:, 0]), lights=tuple(table[:, 1]))


def _named(response: Response) -> Response:
    """Return a gamma that a file states with five digits as the number that is meant."""
    rounded = round(response.gamma, 2)
    return Response.power(rounded) if abs(rounded - response.gamma) < 1e-3 else response
