"""What a file states of a dimension: its value and its tolerance, from the kernel and from the text.

The text has the last word. The kernel forgets the signs of tolerances; where a file states the lower bound above the
upper one, it takes the value and the tolerance for the limits of a range, 9.525 ± 0.127 mm for 0.127 to 9.525.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

_SAME = 1e-6
"""Relative difference of a value as the kernel and as the text state it, both converted to mm or degrees."""

DIGITS = 9
"""Values that are computed are rounded to as many decimal places: 35 minus 34.8 is 0.2."""

_UNSIGNED = "the text of the file could not be compared: its deviations are taken as one below and one above"


@dataclass(frozen=True)
class Statement:
    """What a file states of a dimension, in mm or degrees.

    Attributes
    ----------
    nominal : float or None
        Its value.
    tolerance : tuple of float or None
        Lower and upper deviation from it.
    limits : tuple of float or None
        Lower and upper limit, where the file states these only.
    note : str
        What is wrong with it, and was mended.
    fault : str or None
        What is wrong with it, and was not.
    of_occurrence : bool
        It belongs to one occurrence of a part in an assembly, not to the part.
    tolerance_class : str
        Its tolerance class as the file writes it; empty if there is none.
    role : str
        "reference", "basic", or empty.
    notes : tuple of str
        Other notes of the file on it.
    """

    nominal: float | None = None
    tolerance: tuple[float, float] | None = None
    limits: tuple[float, float] | None = None
    note: str = ""
    fault: str | None = None
    of_occurrence: bool = False
    tolerance_class: str = ""
    role: str = ""
    notes: tuple[str, ...] = ()


def read_statements(
    found: Sequence[dict[str, Any]], texts: Sequence[dict[str, Any]]
) -> list[Statement]:
    """Return what the file states of each dimension that the kernel found.

    Parameters
    ----------
    found : sequence of dict
        See `semantic_dimensions.read_semantic_dimensions`.
    texts : sequence of dict
        The fields of each `stated_dimensions.StatedDimension`, in the order of the file; some the kernel leaves out.

    Returns
    -------
    list of Statement
        In the order of `found`.
    """
    paired = _pair(found, texts)
    if paired is None:
        return [_from_kernel(row) for row in found]
    return [
        replace(
            _from_text(tuple(text["values"]), text["bounds"]),
            of_occurrence=text["of_occurrence"],
            tolerance_class=text.get("tolerance_class", ""),
            role=text.get("role", ""),
            notes=tuple(text.get("notes", ())),
        )
        for text in paired
    ]


def _pair(
    found: Sequence[dict[str, Any]], texts: Sequence[dict[str, Any]]
) -> list[dict[str, Any]] | None:
    """Return the text of each dimension, by order and value; None if some dimension fits no text."""
    rest = iter(texts)
    paired = [next((text for text in rest if _fits(row, text)), None) for row in found]
    whole = [text for text in paired if text is not None]
    return whole if len(whole) == len(paired) else None


def _fits(row: dict[str, Any], text: dict[str, Any]) -> bool:
    values = row["values"] or []
    stated = [*text["values"], *map(abs, text["bounds"] or ())]
    if not values or (len(values) > 1) != (len(stated) > 1):
        return not values and not text["values"]
    return all(any(abs(abs(a) - b) <= _SAME * max(abs(b), 1.0) for b in stated) for a in values)


def _from_text(values: tuple[float, ...], bounds: Sequence[float] | None) -> Statement:
    if bounds is not None:
        lower, upper = bounds
        swapped = lower > upper
        note = f"the file states {lower:+.4g} as the lower and {upper:+.4g} as the upper deviation; taken in order"
        return Statement(
            values[0] if values else None, (min(bounds), max(bounds)), note=note if swapped else ""
        )
    if len(values) == 2:
        return Statement(limits=(min(values), max(values)))
    if len(values) == 3:
        lower, nominal, upper = sorted(values)
        return Statement(nominal, deviations(nominal, (lower, upper)))
    return Statement(values[0] if values else None)


def deviations(nominal: float, limits: tuple[float, float]) -> tuple[float, float]:
    """Return the lower and upper deviation of two limits from a nominal value, without the noise of subtraction.

    Parameters
    ----------
    nominal : float
        In mm or degrees.
    limits : tuple of float
        Lower and upper, in the same unit.
    """
    return round(limits[0] - nominal, DIGITS), round(limits[1] - nominal, DIGITS)


def _from_kernel(row: dict[str, Any]) -> Statement:
    """Return what the kernel makes of it; it keeps the lower deviation with the opposite sign."""
    values = row["values"] or []
    if row["is_range"] and len(values) == 2:
        if values[0] > values[1]:
            return Statement(
                fault=f"its limits are in the wrong order: {values[0]:.6g} above {values[1]:.6g}"
            )
        return Statement(limits=(values[0], values[1]))
    if row["has_bounds"] and len(values) == 3:
        return Statement(values[0], (-values[1], values[2]), note=_UNSIGNED)
    return Statement(values[0] if values else None)
