"""Numbers with units: ``98%`` is 0.98, ``100um`` is 0.1 mm, ``2min`` is 120 s."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from cyclopts import Parameter

from planner.exceptions import PlannerError, RequestError

if TYPE_CHECKING:
    from planner.light.reflection import Material
    from planner.request.registration import RegistrationRecord

_NUMBER = r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|inf(?:inity)?|nan)"
_QUANTITY = re.compile(rf"({_NUMBER})\s*(.*)", re.ASCII | re.IGNORECASE | re.DOTALL)
# how many of the unit that is meant a unit is; a text is multiplied without rounding
_LENGTHS = {
    "mm": "1", "um": "0.001", "µm": "0.001", "μm": "0.001", "cm": "10", "m": "1000", "in": "25.4",
    "inch": "25.4",
}  # fmt: skip


class Quantity:
    """Reads numbers of one kind.

    Parameters
    ----------
    form : str
        What it must be, for the error: it follows "must be".
    units : mapping of str to str or float
        How much each unit is; a number alone is taken as it is.
    """

    def __init__(self, form: str, units: Mapping[str, str | float]) -> None:
        self._what = form
        self._units = units

    def __call__(self, text: str) -> float:
        """Return the value of a text.

        Raises
        ------
        ValueError
            If it is no number, or has another unit.
        """
        match = _QUANTITY.fullmatch(text.strip())
        unit = "" if match is None else match[2].strip()
        if match is None or (unit and unit not in self._units):
            raise ValueError(f"must be {self._what}. Got {text!r}.")
        factor = self._units[unit] if unit else "1"
        if isinstance(factor, float):
            return float(match[1]) * factor
        if factor == "1":
            return float(match[1])
        from decimal import Decimal

        # 99.9% is the number 0.999 then, not its neighbour
        return float(Decimal(match[1]) * Decimal(factor))


class Count(NamedTuple):
    """The range of a whole number, both ends included."""

    minimum: int
    maximum: int = 10**9


MOST_BREAK_MM = 10.0
"""As `planner.request.edge_state.MOST_BREAK_MM`, which takes long to load."""

BOX = tuple[float, float, float, float, float, float]


def value(kind: Callable[[str], Any], metavar: str, *names: str, count: int = 1) -> Parameter:
    """Return how the value of an option is read.

    Parameters
    ----------
    kind : callable
        Returns the value of a text.
    metavar : str
        The value in the help.
    *names : str
        The option, if it is not named like its field.
    count : int
        How many values belong together.
    """

    def read(_: Any, tokens: Any) -> Any:
        values = [kind(token.value) for token in tokens[-count:]]
        return tuple(values) if count > 1 else values[0]

    return Parameter(
        name=names or None,
        metavar=metavar,
        converter=read,
        n_tokens=count,
    )


SHARE = Quantity("a number like 0.98, or a percentage like 98%", {"%": "0.01"})
MM = Quantity(
    "a length in mm, or with its unit (mm, um, cm, m or in) like 0.1mm or 100um", _LENGTHS
)
RAD = Quantity(
    "an angle in rad, or with its unit (rad, mrad or deg) like 2mrad or 0.1deg",
    {"rad": "1", "mrad": "0.001", "deg": math.radians(1.0), "°": math.radians(1.0)},
)
DEG = Quantity(
    "an angle in degrees, or with its unit (deg or rad) like 25deg",
    {"deg": "1", "°": "1", "rad": math.degrees(1.0)},
)
WHITE = Quantity("a grey value like 4095", {})
PX = Quantity("a number of pixels like 20 or 20px", {"px": "1"})
SECONDS = Quantity(
    "a time in seconds, or with its unit (s, min or h) like 90s or 5min",
    {"s": "1", "min": "60", "h": "3600"},
)


# as a standard deviation, a larger number without a unit was rather meant as mrad or degrees
_PLAIN_RAD = 0.1


def sigma_angle(text: str) -> float:
    """Return the standard deviation of an angle, rad; a large one must have its unit.

    Parameters
    ----------
    text : str
        Like ``0.002``, ``2mrad`` or ``0.1deg``.

    Raises
    ------
    ValueError
        If it is no angle, or has no unit and is above 0.1 rad (5.7°).
    """
    angle = RAD(text)
    plain = text.strip()
    if _PLAIN_RAD < angle < math.inf and plain[-1:].isdigit():
        raise ValueError(
            f"must have a unit above {_PLAIN_RAD} rad. Got {plain!r}, which is {math.degrees(angle):.3g}° in rad; "
            f"did you mean {plain}mrad or {plain}deg?"
        )
    return angle


def lengths(text: str) -> list[float]:
    """Return lengths separated by commas, mm; each may have its unit.

    Parameters
    ----------
    text : str
        Like ``250,400`` or ``25cm,400mm``.

    Raises
    ------
    ValueError
        If one of them is no length.
    """
    try:
        return [MM(number) for number in text.split(",")]
    except ValueError:
        raise ValueError(f"must be numbers like 250,400. Got {text!r}.") from None


def break_range(text: str) -> tuple[float, float]:
    """Return the least and the largest break of edges, mm.

    Parameters
    ----------
    text : str
        Like ``0.1..0.3`` or ``100um..0.3mm``, or one length for both, or ``sharp``.

    Raises
    ------
    ValueError
        If it is no such pair, or not in rising order.
    """
    if text == "sharp":
        return 0.0, 0.0
    words = text.split("..")
    try:
        limits = [MM(word) for word in words]
    except ValueError:
        limits = []
    if len(limits) in (1, 2) and 0 <= limits[0] <= limits[-1] <= MOST_BREAK_MM:
        return limits[0], limits[-1]
    raise ValueError(
        f"must be sharp, or two lengths like 0.1..0.3 or one, in rising order from 0 to {MOST_BREAK_MM:g} mm. "
        f"Got {text!r}."
    )


def sigma_pair(text: str) -> tuple[float, float]:
    """Return standard deviations of a pose: a length in mm and an angle in rad.

    Parameters
    ----------
    text : str
        Like ``0.05,0.0005`` or ``50um,0.5mrad``.

    Raises
    ------
    ValueError
        If it is no such pair.
    """
    words = text.split(",")
    try:
        sigmas = (MM(words[0]), sigma_angle(words[1])) if len(words) == 2 else (-1.0, -1.0)
    except ValueError:
        sigmas = (-1.0, -1.0)
    if min(sigmas) >= 0:
        return sigmas
    raise ValueError(
        f"must be a length and an angle like 0.05mm,0.5mrad, not negative. Got {text!r}."
    )


def registration(text: str) -> RegistrationRecord:
    """Return how poses are known when values are read.

    Parameters
    ----------
    text : str
        ``edges``, ``none``, or standard deviations as `sigma_pair` takes them.

    Raises
    ------
    ValueError
        If it is none of these.
    """
    # here, because they load numpy
    from planner.camera.pose import PoseUncertainty
    from planner.request.registration import GIVEN, OWN_EDGES, PLANNED, RegistrationRecord

    if text == "none":
        return RegistrationRecord(PLANNED)
    if text == "edges":
        return RegistrationRecord(OWN_EDGES)
    try:
        length, angle = sigma_pair(text)
        uncertainty = PoseUncertainty.isotropic(translation_mm=length, rotation_rad=angle)
    except (ValueError, PlannerError):
        raise ValueError(
            f"must be edges, none, or a length and an angle like 0.02mm,0.1mrad. Got {text!r}."
        ) from None
    return RegistrationRecord(GIVEN, None, uncertainty)


def material(text: str) -> Material:
    """Return how the part reflects light.

    Parameters
    ----------
    text : str
        ``matt``, ``metal``, or ``metal:ROUGHNESS``.

    Raises
    ------
    ValueError
        If it is none of these.
    """
    # here, because it loads numpy
    from planner.light.reflection import Material

    kind, colon, roughness = text.partition(":")
    try:
        if not colon:
            return Material(kind)  # type: ignore[arg-type]
        if kind == "metal":
            return Material("metal", float(roughness))
    except (ValueError, PlannerError):
        pass
    rule = "must be matt, metal, or metal:ROUGHNESS with a roughness from 0.02 to 1"
    raise ValueError(f"{rule}. Got {text!r}.")


# no file has more solids; Python reads no number of more than some thousand digits
_WHOLE = re.compile(r"[-+]?\d{1,400}", re.ASCII)
_INDEX = re.compile(r"\d{1,18}", re.ASCII)
_SOLID = re.compile(
    r"""\s*(?:"(?P<quoted>(?:[^"]|"")+)"(?P<which>:\d+|:all)?\s*|(?P<plain>[^,"\s][^,]*))(?=,|\Z)""",
    re.ASCII,
)


def whole(text: str) -> int:
    """Return a whole number.

    Parameters
    ----------
    text : str
        Digits, perhaps with a sign.

    Raises
    ------
    ValueError
        If it is none.
    """
    if not _WHOLE.fullmatch(text.strip()):
        start = text if len(text) <= 40 else f"{text[:37]}..."
        raise ValueError(f"must be a whole number. Got {start!r}.")
    return int(text)


def solid_names(text: str) -> list[int | str]:
    """Return numbers and names of solids separated by commas; digits alone are a number.

    Parameters
    ----------
    text : str
        Like ``0,2`` or ``bracket,bolt:2``. A name in double quotes is taken as it is: ``"12"`` is no
        number, and commas may be in it. A double quote in it stands twice.

    Raises
    ------
    ValueError
        If one of them is empty, or quotes do not end.
    """
    names: list[int | str] = []
    place = 0
    while place <= len(text):
        match = _SOLID.match(text, place)
        if match is None or not (match["quoted"] or match["plain"]):
            raise ValueError(
                f"must be numbers or names of solids like 0,2 or bracket,bolt:2. Got {text!r}."
            )
        plain = (match["plain"] or "").strip()
        if match["quoted"]:
            names.append(match["quoted"].replace('""', '"') + (match["which"] or ""))
        else:
            names.append(int(plain) if _INDEX.fullmatch(plain) else plain)
        place = match.end() + 1
    return names


def all_or_solids(text: str) -> str | list[int | str]:
    """Return ``all``, or numbers and names of solids.

    Parameters
    ----------
    text : str
        ``all``, or as `solid_names` takes it; ``"all"`` in double quotes is a name.
    """
    return text if text == "all" else solid_names(text)


# models of errors in the image, and how many numbers may follow each
_LOCALISATIONS = {"rounding": 0, "gaussian": 2, "fit": 3}


def localisation_words(text: str) -> tuple[str, list[float]]:
    """Return the name of a localisation model and its numbers, like ``gaussian:0.05``.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    RequestError
        If the model is unknown, or what follows is no number.
    """
    name, *numbers = text.strip().split(":")
    if name not in _LOCALISATIONS or len(numbers) > _LOCALISATIONS[name]:
        raise RequestError(
            "--localisation must be rounding, gaussian[:SIGMA[:FLOOR]] or fit[:SIGMA[:CORRELATION[:FLOOR]]], in px. "
            f"Got {text!r}."
        )
    try:
        return name, [float(number) for number in numbers]
    except ValueError:
        raise RequestError(
            f"--localisation must hold numbers of px after the model. Got {text!r}."
        ) from None


_BYTES = {"mb": 1e6, "gb": 1e9, "tb": 1e12, "mib": 2.0**20, "gib": 2.0**30, "tib": 2.0**40}
_MEMORY = re.compile(r"(\d+(?:\.\d*)?(?:e[+-]?\d+)?) ?([MGT]i?B)?", re.ASCII | re.IGNORECASE)


def memory(text: str) -> float:
    """Return an amount of memory in bytes; a number alone is in GiB.

    Parameters
    ----------
    text : str
        Like ``8``, ``8GB`` or ``500MB``.

    Raises
    ------
    ValueError
        If it is none.
    """
    match = _MEMORY.fullmatch(text.strip())
    if match is None or not float(match[1]) > 0:
        raise ValueError(f"must be a positive number of GiB, or like 8GB or 500MB. Got {text!r}.")
    return float(match[1]) * _BYTES[(match[2] or "gib").lower()]
