"""The tolerance class that a file states of a dimension, as two deviations; and whether a rim is one of a hole."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aspectgraph.exceptions import ToleranceError
from aspectgraph.solid.rims import Arc
from aspectgraph.solid.solid import Solid

# The figures of ISO 286-1:2010: standard tolerances and fundamental deviations, in µm.
#
# A row belongs to one range of nominal sizes: over the limit of the row before, up to and
# including its own. Source: ISO 286-1:2010, Tables 1 to 5, as catalogues and textbooks repeat
# them. The tests compare them with such tables and with the formulas of the standard.


GRADES = ("01", "0", *(str(grade) for grade in range(1, 19)))
"""Standard tolerance grades, in the order of `TOLERANCES_UM`."""

TOLERANCE_LIMITS_MM = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
LARGE_TOLERANCE_LIMITS_MM = (630, 800, 1000, 1250, 1600, 2000, 2500, 3150)


def _rows(text: str) -> tuple[tuple[float | None, ...], ...]:
    """Return the rows of a table; a dash is None."""
    return tuple(
        tuple(None if word == "-" else float(word) for word in line.split())
        for line in text.strip().splitlines()
    )


# one row per range of TOLERANCE_LIMITS_MM and LARGE_TOLERANCE_LIMITS_MM, one column per grade
TOLERANCES_UM = _rows("""
0.3 0.5 0.8 1.2 2 3 4 6 10 14 25 40 60 100 140 250 400 600 1000 1400
0.4 0.6 1 1.5 2.5 4 5 8 12 18 30 48 75 120 180 300 480 750 1200 1800
0.4 0.6 1 1.5 2.5 4 6 9 15 22 36 58 90 150 220 360 580 900 1500 2200
0.5 0.8 1.2 2 3 5 8 11 18 27 43 70 110 180 270 430 700 1100 1800 2700
0.6 1 1.5 2.5 4 6 9 13 21 33 52 84 130 210 330 520 840 1300 2100 3300
0.6 1 1.5 2.5 4 7 11 16 25 39 62 100 160 250 390 620 1000 1600 2500 3900
0.8 1.2 2 3 5 8 13 19 30 46 74 120 190 300 460 740 1200 1900 3000 4600
1 1.5 2.5 4 6 10 15 22 35 54 87 140 220 350 540 870 1400 2200 3500 5400
1.2 2 3.5 5 8 12 18 25 40 63 100 160 250 400 630 1000 1600 2500 4000 6300
2 3 4.5 7 10 14 20 29 46 72 115 185 290 460 720 1150 1850 2900 4600 7200
2.5 4 6 8 12 16 23 32 52 81 130 210 320 520 810 1300 2100 3200 5200 8100
3 5 7 9 13 18 25 36 57 89 140 230 360 570 890 1400 2300 3600 5700 8900
4 6 8 10 15 20 27 40 63 97 155 250 400 630 970 1550 2500 4000 6300 9700
- - 9 11 16 22 32 44 70 110 175 280 440 700 1100 1750 2800 4400 7000 11000
- - 10 13 18 25 36 50 80 125 200 320 500 800 1250 2000 3200 5000 8000 12500
- - 11 15 21 28 40 56 90 140 230 360 560 900 1400 2300 3600 5600 9000 14000
- - 13 18 24 33 47 66 105 165 260 420 660 1050 1650 2600 4200 6600 10500 16500
- - 15 21 29 39 55 78 125 195 310 500 780 1250 1950 3100 5000 7800 12500 19500
- - 18 25 35 46 65 92 150 230 370 600 920 1500 2300 3700 6000 9200 15000 23000
- - 22 30 41 55 78 110 175 280 440 700 1100 1750 2800 4400 7000 11000 17500 28000
- - 26 36 50 68 96 135 210 330 540 860 1350 2100 3300 5400 8600 13500 21000 33000
""")

_LIMITS_MM = (
    3, 6, 10, 14, 18, 24, 30, 40, 50, 65, 80, 100, 120, 140, 160, 180, 200, 225, 250, 280, 315, 355,
    400, 450, 500,
)  # fmt: skip
_LARGE_LIMITS_MM = (
    560, 630, 710, 800, 900, 1000, 1120, 1250, 1400, 1600, 1800, 2000, 2240, 2500, 2800, 3150,
)  # fmt: skip

# distances of the tolerance interval from the nominal size: of shafts a to g the upper limit lies below it
_ABOVE_UM = """
a b c cd d e ef f fg g
270 140 60 34 20 14 10 6 4 2
270 140 70 46 30 20 14 10 6 4
280 150 80 56 40 25 18 13 8 5
290 150 95 - 50 32 - 16 - 6
290 150 95 - 50 32 - 16 - 6
300 160 110 - 65 40 - 20 - 7
300 160 110 - 65 40 - 20 - 7
310 170 120 - 80 50 - 25 - 9
320 180 130 - 80 50 - 25 - 9
340 190 140 - 100 60 - 30 - 10
360 200 150 - 100 60 - 30 - 10
380 220 170 - 120 72 - 36 - 12
410 240 180 - 120 72 - 36 - 12
460 260 200 - 145 85 - 43 - 14
520 280 210 - 145 85 - 43 - 14
580 310 230 - 145 85 - 43 - 14
660 340 240 - 170 100 - 50 - 15
740 380 260 - 170 100 - 50 - 15
820 420 280 - 170 100 - 50 - 15
920 480 300 - 190 110 - 56 - 17
1050 540 330 - 190 110 - 56 - 17
1200 600 360 - 210 125 - 62 - 18
1350 680 400 - 210 125 - 62 - 18
1500 760 440 - 230 135 - 68 - 20
1650 840 480 - 230 135 - 68 - 20
"""

# of shafts k to zc the lower limit lies above it; k of IT4 to IT7
_BELOW_UM = """
k m n p r s t u v x y z za zb zc
0 2 4 6 10 14 - 18 - 20 - 26 32 40 60
1 4 8 12 15 19 - 23 - 28 - 35 42 50 80
1 6 10 15 19 23 - 28 - 34 - 42 52 67 97
1 7 12 18 23 28 - 33 - 40 - 50 64 90 130
1 7 12 18 23 28 - 33 39 45 - 60 77 108 150
2 8 15 22 28 35 - 41 47 54 63 73 98 136 188
2 8 15 22 28 35 41 48 55 64 75 88 118 160 218
2 9 17 26 34 43 48 60 68 80 94 112 148 200 274
2 9 17 26 34 43 54 70 81 97 114 136 180 242 325
2 11 20 32 41 53 66 87 102 122 144 172 226 300 405
2 11 20 32 43 59 75 102 120 146 174 210 274 360 480
3 13 23 37 51 71 91 124 146 178 214 258 335 445 585
3 13 23 37 54 79 104 144 172 210 254 310 400 525 690
3 15 27 43 63 92 122 170 202 248 300 365 470 620 800
3 15 27 43 65 100 134 190 228 280 340 415 535 700 900
3 15 27 43 68 108 146 210 252 310 380 465 600 780 1000
4 17 31 50 77 122 166 236 284 350 425 520 670 880 1150
4 17 31 50 80 130 180 258 310 385 470 575 740 960 1250
4 17 31 50 84 140 196 284 340 425 520 640 820 1050 1350
4 20 34 56 94 158 218 315 385 475 580 710 920 1200 1550
4 20 34 56 98 170 240 350 425 525 650 790 1000 1300 1700
4 21 37 62 108 190 268 390 475 590 730 900 1150 1500 1900
4 21 37 62 114 208 294 435 530 660 820 1000 1300 1650 2100
5 23 40 68 126 232 330 490 595 740 920 1100 1450 1850 2400
5 23 40 68 132 252 360 540 660 820 1000 1250 1600 2100 2600
"""

_LARGE_UM = """
d e f g k m n p r s t u
260 145 76 22 0 26 44 78 150 280 400 600
260 145 76 22 0 26 44 78 155 310 450 660
290 160 80 24 0 30 50 88 175 340 500 740
290 160 80 24 0 30 50 88 185 380 560 840
320 170 86 26 0 34 56 100 210 430 620 940
320 170 86 26 0 34 56 100 220 470 680 1050
350 195 98 28 0 40 66 120 250 520 780 1150
350 195 98 28 0 40 66 120 260 580 840 1300
390 220 110 30 0 48 78 140 300 640 960 1450
390 220 110 30 0 48 78 140 330 720 1050 1600
430 240 120 32 0 58 92 170 370 820 1200 1850
430 240 120 32 0 58 92 170 400 920 1350 2000
480 260 130 34 0 68 110 195 440 1000 1500 2300
480 260 130 34 0 68 110 195 460 1100 1650 2500
520 290 145 38 0 76 135 240 550 1250 1900 2900
520 290 145 38 0 76 135 240 580 1400 2100 3200
"""

# one row per range of TOLERANCE_LIMITS_MM: lower limits of shafts j5 and j6, j7, j8; upper limits of holes J6, J7, J8
_J_UM = """
j5 j6 j7 j8 J6 J7 J8
-2 -2 -4 -6 2 4 6
-2 -2 -4 - 5 6 10
-2 -2 -5 - 5 8 12
-3 -3 -6 - 6 10 15
-4 -4 -8 - 8 12 20
-5 -5 -10 - 10 14 24
-7 -7 -12 - 13 18 28
-9 -9 -15 - 16 22 34
-11 -11 -18 - 18 26 41
-13 -13 -21 - 22 30 47
-16 -16 -26 - 25 36 55
-18 -18 -28 - 29 39 60
-20 -20 -32 - 33 43 66
"""


def _columns(text: str) -> dict[str, tuple[float | None, ...]]:
    """Return the columns of a table by their names in its first line."""
    names, rows = text.strip().split("\n", 1)
    return dict(zip(names.split(), zip(*_rows(rows), strict=True), strict=True))


def _by_size(*tables: tuple[tuple[int, ...], str]) -> dict[str, dict[int, float]]:
    """Return the values of each letter by the upper limit of the range, mm; blanks are left out."""
    by_letter: dict[str, dict[int, float]] = {}
    for limits, text in tables:
        for letter, column in _columns(text).items():
            rows = zip(limits, column, strict=True)
            values = {limit: value for limit, value in rows if value is not None}
            by_letter.setdefault(letter, {}).update(values)
    return by_letter


DEVIATION_LIMITS_MM = (*_LIMITS_MM, *_LARGE_LIMITS_MM)
"""Upper limits of the ranges of nominal sizes for fundamental deviations, in mm."""

DEVIATIONS_UM: Mapping[str, Mapping[int, float]] = _by_size(
    (_LIMITS_MM, _ABOVE_UM), (_LIMITS_MM, _BELOW_UM), (_LARGE_LIMITS_MM, _LARGE_UM)
)
"""Distance of a shaft's tolerance interval from the nominal size, in µm, by letter and range.

Those of a to g lie below the nominal size and those of k to zc above it. For k it is that of IT4 to IT7.
"""

J_UM: Mapping[str, Mapping[int, float]] = _by_size((TOLERANCE_LIMITS_MM, _J_UM))
"""Lower limit deviations of shafts j5 to j8 and upper ones of holes J6 to J8, in µm, by class and range."""


# What a file states of a dimension: its value and its tolerance, from the kernel and from the
# text.
#
# The text has the last word. The kernel forgets the signs of tolerances; where a file states the
# lower bound above the upper one, it takes the value and the tolerance for the limits of a range,
# 9.525 ± 0.127 mm for 0.127 to 9.525.


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
    rows: Sequence[dict[str, Any]], texts: Sequence[dict[str, Any]]
) -> list[Statement]:
    """Return what the file states of each dimension that the kernel found.

    Parameters
    ----------
    rows : sequence of dict
        See `semantic_dimensions.read_semantic_dimensions`.
    texts : sequence of dict
        The fields of each `stated_dimensions.StatedDimension`, in the order of the file; some the kernel leaves out.

    Returns
    -------
    list of Statement
        In the order of `rows`.
    """
    paired = _pair(rows, texts)
    if paired is None:
        return [_from_kernel(row) for row in rows]
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
    rows: Sequence[dict[str, Any]], texts: Sequence[dict[str, Any]]
) -> list[dict[str, Any]] | None:
    """Return the text of each dimension, by order and value; None if some dimension fits no text."""
    queue = iter(texts)
    paired = [next((text for text in queue if _fits(row, text)), None) for row in rows]
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


# Tolerance classes of ISO 286, such as H7 of a hole and g6 of a shaft, as limit deviations.
#
# A class is a letter, or two, and a grade. The grade gives the width of the tolerance interval.
# The letter gives its distance from the nominal size: capitals are for holes, other letters for
# shafts.
#
# Rules
# -----
# * Holes A to H mirror the shafts a to h.
# * Holes K to ZC mirror the shafts, too, but up to grade 8 (K, M, N) and grade 7 (P to ZC) they move up by
#   Δ = IT(n) - IT(n-1). A hole and the shaft of the grade below then fit in both systems. Δ is 0 up to 3 mm, and above
#   500 mm.
# * Hole N above grade 8 begins at the nominal size, but for sizes up to 3 mm. Hole M6 over 250 to 315 mm is 2 µm higher
#   than the rule says.
#
# Reference: ISO 286-1:2010, 4.3 and Tables 1 to 5.


NOMINAL_DIGITS = 3
"""Decimal places of a nominal size in mm. A range ends at whole mm, and the geometry of 30 mm may say 30.0000001."""

_TEXT = re.compile(r"([A-Za-z]{1,2}) ?(0?[0-9]|1[0-8])")
_LETTERS = tuple(sorted((*DEVIATIONS_UM, "h", "j", "js"), key=lambda name: (name[0], name)))
_BELOW = ("a", "b", "c", "cd", "d", "e", "ef", "f", "fg", "g")
_TO_GRADE_8 = ("k", "m", "n")
_DELTA_MM = (3, 500)
_TOLERANCE_CLASSES_LIMITS_MM = (*TOLERANCE_LIMITS_MM, *LARGE_TOLERANCE_LIMITS_MM)
_RULE = "must be a letter and a grade of ISO 286, such as H7 for a hole or g6 for a shaft"
_NAMES = (
    f", with {', '.join(name.upper() for name in _LETTERS)} or the same in small letters, "
    "and 01, 0, 1 to 18"
)
# as on a drawing, such as 24 H7 or Ø24H7: the size and its class
_WITH_SIZE = re.compile(r"[⌀Ø∅]? ?[0-9.,]+ ?([A-Za-z]{1,2} ?[0-9]{1,2})")


@dataclass(frozen=True)
class ToleranceClass:
    """A tolerance class of ISO 286.

    Attributes
    ----------
    letters : str
        The fundamental deviation: ``"H"``, ``"js"``; capitals for holes.
    grade : str
        The standard tolerance grade: ``"01"``, ``"0"``, ``"1"`` to ``"18"``.
    """

    letters: str
    grade: str

    @classmethod
    def of(cls, text: str) -> ToleranceClass:
        """Return the class that a text such as "H7" stands for.

        Parameters
        ----------
        text : str
            Letters and grade; "Js7" is the hole JS7.

        Raises
        ------
        ToleranceError
            If it is no class of ISO 286.
        """
        match = _TEXT.fullmatch(text.strip()) if isinstance(text, str) else None
        if match is not None:
            letters, grade = match.groups()
            if letters[0].isupper():
                letters = letters.upper()
            one_case = letters in (letters.lower(), letters.upper())
            if one_case and letters.lower() in _LETTERS and grade in GRADES:
                return cls(letters, grade)
        hint = ""
        rule = _RULE + _NAMES
        if isinstance(text, str):
            with_size = _WITH_SIZE.fullmatch(text.strip())
            if "/" in text:
                hint = "give the class of this part only, because H7/g6 is a fit of two parts"
            elif with_size is not None:
                rule = _RULE
                hint = f"write {with_size[1]} alone, because the nominal size is the part's"
        raise ToleranceError.of_rule("tolerance_class", rule, repr(text), hint=hint)

    def __str__(self) -> str:
        """Return it as a drawing has it."""
        return f"{self.letters}{self.grade}"

    @property
    def is_hole(self) -> bool:
        """Whether it is for holes and other internal features; otherwise for shafts."""
        return self.letters.isupper()

    def deviations_mm(self, nominal_mm: float) -> tuple[float, float]:
        """Return the lower and upper limit deviation of a nominal size.

        Parameters
        ----------
        nominal_mm : float
            Nominal size in mm, over 0 and up to 3150; rounded to 0.001 mm.

        Returns
        -------
        tuple of float
            In mm.

        Raises
        ------
        ToleranceError
            If ISO 286-1 has no limits for this class and size.
        """
        nominal = round(float(nominal_mm), NOMINAL_DIGITS)
        if not 0 < nominal <= _TOLERANCE_CLASSES_LIMITS_MM[-1]:
            raise ToleranceError.of_rule(
                "nominal_mm",
                f"must be over 0 and up to {_TOLERANCE_CLASSES_LIMITS_MM[-1]} mm for a tolerance class of ISO 286",
                f"{nominal_mm:g} for {self}",
            )
        lower, upper = self._limits_um(nominal)
        return round(lower / 1000, 9) + 0.0, round(upper / 1000, 9) + 0.0

    def _limits_um(self, nominal: float) -> tuple[float, float]:
        width = self._width_um(nominal, GRADES.index(self.grade))
        kind = self.letters.lower()
        if kind == "js":
            return -width / 2, width / 2
        if kind == "h":
            distance = 0.0
        elif kind == "j":
            distance = self._j_um(nominal)
        else:
            distance = self._distance_um(nominal, kind)
        # the limit nearer to the nominal size is the lower one of holes A to H and of shafts j to zc
        if self.is_hole == (kind in (*_BELOW, "h")):
            return distance, distance + width
        return distance - width, distance

    def _width_um(self, nominal: float, place: int) -> float:
        width = TOLERANCES_UM[bisect_left(_TOLERANCE_CLASSES_LIMITS_MM, nominal)][place]
        if width is None:
            raise self._undefined(nominal, f"grades 01 and 0 end at {TOLERANCE_LIMITS_MM[-1]} mm")
        return width

    def _j_um(self, nominal: float) -> float:
        defined = J_UM.get(str(self), {})
        place = bisect_left(TOLERANCE_LIMITS_MM, nominal)
        if place < len(TOLERANCE_LIMITS_MM) and TOLERANCE_LIMITS_MM[place] in defined:
            return defined[TOLERANCE_LIMITS_MM[place]]
        raise self._undefined(
            nominal, "j is defined for j5, j6, j7, J6, J7, J8 up to 500 mm, j8 up to 3 mm"
        )

    def _distance_um(self, nominal: float, kind: str) -> float:
        """Return the limit deviation that is nearer to the nominal size, but for h, j and js."""
        value = DEVIATIONS_UM[kind].get(
            DEVIATION_LIMITS_MM[bisect_left(DEVIATION_LIMITS_MM, nominal)]
        )
        if value is None:
            raise self._undefined(nominal, _sizes_text(self.letters, kind))
        if kind in ("a", "b") and nominal <= 1:
            raise self._undefined(nominal, f"{self.letters} begins above 1 mm")
        if kind in _BELOW:
            return value if self.is_hole else -value
        if self.is_hole:
            return self._upper_of_hole_um(nominal, kind, value)
        of_k = kind == "k" and not 4 <= self._number <= 7
        return 0.0 if of_k else value

    @property
    def _number(self) -> int:
        """The grade as a number; 01 is -1."""
        return GRADES.index(self.grade) - 1

    def _upper_of_hole_um(self, nominal: float, kind: str, value: float) -> float:
        """Return the upper limit deviation of a hole K to ZC from the deviation of its shaft."""
        number = self._number
        small, large = _DELTA_MM
        if kind == "k" and number > 8 and nominal > small:
            raise self._undefined(nominal, "K ends at grade 8 above 3 mm")
        if kind == "n" and number > 8 and nominal <= 1:
            raise self._undefined(nominal, "N ends at grade 8 up to 1 mm")
        if not small < nominal <= large:
            return -value
        if number > (8 if kind in _TO_GRADE_8 else 7):
            return 0.0 if kind == "n" else -value
        if number < 3:
            raise self._undefined(nominal, f"{self.letters} begins at grade 3 above 3 mm")
        if str(self) == "M6" and 250 < nominal <= 315:
            return -9.0
        place = GRADES.index(self.grade)
        delta = self._width_um(nominal, place) - self._width_um(nominal, place - 1)
        return delta - value

    def _undefined(self, nominal: float, hint: str) -> ToleranceError:
        return ToleranceError.of_rule(
            "tolerance_class",
            f"must have limits in ISO 286-1 for the nominal size {nominal:g} mm",
            repr(str(self)),
            hint=hint,
        )


def class_tables() -> dict[str, Any]:
    """Return the figures of ISO 286 for a page that computes limits of its own, with sizes in mm and the rest in µm."""
    return {
        "grades": GRADES,
        "limits": _TOLERANCE_CLASSES_LIMITS_MM,
        "widths": TOLERANCES_UM,
        "steps": DEVIATION_LIMITS_MM,
        "distances": DEVIATIONS_UM,
        "j": J_UM,
    }


def tolerance_class_deviations(tolerance_class: str, nominal_mm: float) -> tuple[float, float]:
    """Return the limit deviations of a tolerance class of ISO 286.

    Grades 01 to 18 and nominal sizes up to 3150 mm are known, with all letters up to 500 mm (cd, ef and fg up to
    10 mm) and d to u above it.

    Parameters
    ----------
    tolerance_class : str
        Such as ``"H7"`` of a hole or ``"g6"`` of a shaft.
    nominal_mm : float
        Nominal size in mm.

    Returns
    -------
    lower, upper : float
        Limit deviations in mm (ISO 286-1:2010, Tables 1 to 5).

    Raises
    ------
    ToleranceError
        If it is no class of ISO 286, or the standard has no limits for this size.

    Examples
    --------
    >>> from aspectgraph import tolerance_class_deviations
    >>> tolerance_class_deviations("H7", 20.0)
    (0.0, 0.021)
    >>> tolerance_class_deviations("g6", 20.0)
    (-0.02, -0.007)
    """
    return ToleranceClass.of(tolerance_class).deviations_mm(nominal_mm)


def _sizes_text(letters: str, kind: str) -> str:
    """Say for which nominal sizes a fundamental deviation is defined."""
    limits = sorted(DEVIATIONS_UM[kind])
    place = DEVIATION_LIMITS_MM.index(limits[0])
    first = DEVIATION_LIMITS_MM[place - 1] if place else 0
    return f"{letters} is defined over {first} and up to {limits[-1]} mm"


KINDS_WITH_CLASS = ("diameter", "distance", "length")
"""Kinds of dimensions that ISO 286 is for: sizes of cylinders, and of pairs of parallel planes."""

WALL = 0.5
"""Least part of a face's unit normal along the radius of a circle for it to be a wall around it: 60 degrees off."""

ROUNDED_MM = 0.001
"""Deviations that a file states beside a class are the same up to this: they may be rounded to whole µm."""

_SAME_MM = 0.5 * 10**-NOMINAL_DIGITS

# in free text C1 is a chamfer, M6 a thread, R5 a radius, t5 a thickness, and 20 x5 a size
_CLASS = re.compile(r"(?![CMRTXcmrtx])[A-Za-z]{1,2}\d{1,2}")
_SIZED = re.compile(rf"(?<![\d.,])(\d+(?:[.,]\d+)?) ?({_CLASS.pattern})(?![\w.,])")


@dataclass(frozen=True)
class StatedClass:
    """What became of the tolerance class of a dimension.

    Attributes
    ----------
    name : str or None
        The class, such as "H7".
    deviations : tuple of float or None
        Its lower and upper deviation in mm.
    note : str
        How it differs from deviations that the file states, too.
    fault : str or None
        Why it gives no deviations.
    """

    name: str | None = None
    deviations: tuple[float, float] | None = None
    note: str = ""
    fault: str | None = None


def resolve_stated_class(
    stated: Statement, title: str, kind: str, nominal: float | None, in_hole: bool | None
) -> StatedClass:
    """Return the limit deviations of the tolerance class that a file states of a dimension.

    Parameters
    ----------
    stated : Statement
        What the file states.
    title : str
        Name of the dimension, in which the class may stand behind the nominal value, as in "Ø20 H7".
    kind : str
        See `ModelDimension`.
    nominal : float or None
        Its nominal value.
    in_hole : bool or None
        Whether it is the diameter of a hole; None if that is not known.
    """
    text = stated.tolerance_class
    if not text and kind in KINDS_WITH_CLASS:
        text = _class_in_texts(stated.notes, title, nominal)
    if not text:
        return StatedClass()
    try:
        tolerance_class = ToleranceClass.of(text)
    except ToleranceError:
        return StatedClass(
            fault=f"the file states the tolerance class {text!r}, which is none of ISO 286"
        )
    name = str(tolerance_class)
    if kind not in KINDS_WITH_CLASS:
        fault = f"the file states the tolerance class {name}, which is for diameters and distances"
        return StatedClass(name, fault=fault)
    if nominal is None:
        return StatedClass(name, fault=f"the file states the tolerance class {name} without a size")
    try:
        deviations = tolerance_class.deviations_mm(nominal)
    except ToleranceError as error:
        return StatedClass(
            name, fault=f"the file states {nominal:.6g} {name}: {error.hint or error.rule}"
        )
    if in_hole is not None and in_hole != tolerance_class.is_hole:
        stands_for = "holes" if tolerance_class.is_hole else "shafts"
        feature = "a hole" if in_hole else "a shaft"
        fault = f"the file states {name}, a class of {stands_for}, and its geometry is {feature}"
        return StatedClass(name, deviations, fault=fault)
    return StatedClass(name, deviations, _difference(name, deviations, stated))


def _class_in_texts(notes: Iterable[str], title: str, nominal: float | None) -> str:
    """Return the class in the notes or the title of a dimension; nothing if there is none.

    A note may be the class alone. In longer texts, the class stands behind the nominal value, as in "Ø20 H7".
    """
    notes = tuple(notes)
    names = [note for note in notes if _CLASS.fullmatch(note)]
    for text in (*notes, title):
        for size, name in _SIZED.findall(text):
            apart = float(size.replace(",", ".")) - (math.inf if nominal is None else nominal)
            if abs(apart) < _SAME_MM:
                names.append(name)
    return next((name for name in names if _is_class(name)), "")


def _is_class(text: str) -> bool:
    try:
        ToleranceClass.of(text)
    except ToleranceError:
        return False
    return True


def _difference(name: str, deviations: tuple[float, float], stated: Statement) -> str:
    """Say that the file states other deviations than those of the class; nothing if it does not."""
    if stated.tolerance is None:
        return ""
    apart = max(abs(a - b) for a, b in zip(deviations, stated.tolerance, strict=True))
    if apart <= ROUNDED_MM:
        return ""
    return (
        f"the file states {name}, which is {deviations[0]:+.4g} and {deviations[1]:+.4g} mm, "
        "and other deviations; these are taken"
    )


def is_in_hole(solid: Solid, arc: Arc) -> bool | None:
    """Return whether a rim or arc is at the end of a hole, judged by the walls along it.

    Parameters
    ----------
    solid : Solid
        The part.
    arc : Rim or Arc
        One of its circles.

    Returns
    -------
    bool or None
        Whether the walls face the axis. None if there is no wall, or walls of both kinds.
    """
    sides: set[bool] = set()
    for edge_id in arc.edge_ids:
        edge = solid.edges[edge_id]
        offset = solid.vertices[list(edge.vertices)].mean(axis=0) - arc.centre
        radial = offset - (offset * arc.axis).sum() * arc.axis
        radial = radial / np.sqrt((radial * radial).sum())
        outward = (solid.normals[list(edge.faces)] * radial).sum(axis=1)
        sides.update(bool(part < 0) for part in outward.tolist() if abs(part) >= WALL)
    return sides.pop() if len(sides) == 1 else None
