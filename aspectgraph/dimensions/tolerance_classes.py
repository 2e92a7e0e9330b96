"""Tolerance classes of ISO 286, such as H7 of a hole and g6 of a shaft, as limit deviations.

A class is a letter, or two, and a grade. The grade gives the width of the tolerance interval. The letter gives its
distance from the nominal size: capitals are for holes, other letters for shafts.

Rules
-----
* Holes A to H mirror the shafts a to h.
* Holes K to ZC mirror the shafts, too, but up to grade 8 (K, M, N) and grade 7 (P to ZC) they move up by
  Δ = IT(n) - IT(n-1). A hole and the shaft of the grade below then fit in both systems. Δ is 0 up to 3 mm, and above
  500 mm.
* Hole N above grade 8 begins at the nominal size, but for sizes up to 3 mm. Hole M6 over 250 to 315 mm is 2 µm higher
  than the rule says.

Reference: ISO 286-1:2010, 4.3 and Tables 1 to 5.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import dataclass

from aspectgraph.dimensions.iso_286_tables import (
    DEVIATION_LIMITS_MM,
    DEVIATIONS_UM,
    GRADES,
    J_UM,
    LARGE_TOLERANCE_LIMITS_MM,
    TOLERANCE_LIMITS_MM,
    TOLERANCES_UM,
)
from aspectgraph.exceptions import ToleranceError

NOMINAL_DIGITS = 3
"""Decimal places of a nominal size in mm. A range ends at whole mm, and the geometry of 30 mm may say 30.0000001."""

_TEXT = re.compile(r"([A-Za-z]{1,2}) ?(0?[0-9]|1[0-8])")
_LETTERS = tuple(sorted((*DEVIATIONS_UM, "h", "j", "js"), key=lambda name: (name[0], name)))
_BELOW = ("a", "b", "c", "cd", "d", "e", "ef", "f", "fg", "g")
_TO_GRADE_8 = ("k", "m", "n")
_DELTA_MM = (3, 500)
_LIMITS_MM = (*TOLERANCE_LIMITS_MM, *LARGE_TOLERANCE_LIMITS_MM)
_RULE = (
    "must be a letter and a grade of ISO 286, such as H7 for a hole or g6 for a shaft, "
    f"with {', '.join(name.upper() for name in _LETTERS)} or the same in small letters, and 01, 0, 1 to 18"
)


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
        found = _TEXT.fullmatch(text.strip()) if isinstance(text, str) else None
        if found is not None:
            letters, grade = found.groups()
            if letters[0].isupper():
                letters = letters.upper()
            one_case = letters in (letters.lower(), letters.upper())
            if one_case and letters.lower() in _LETTERS and grade in GRADES:
                return cls(letters, grade)
        hint = ""
        if isinstance(text, str) and "/" in text:
            hint = "give the class of this part only, because H7/g6 is a fit of two parts"
        raise ToleranceError.of_rule("tolerance_class", _RULE, repr(text), hint=hint)

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
        if not 0 < nominal <= _LIMITS_MM[-1]:
            raise ToleranceError.of_rule(
                "nominal_mm",
                f"must be over 0 and up to {_LIMITS_MM[-1]} mm for a tolerance class of ISO 286",
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
        width = TOLERANCES_UM[bisect_left(_LIMITS_MM, nominal)][place]
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
