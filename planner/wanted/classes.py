"""Tolerance classes of ISO 286 in a request: checked where they are given, and resolved on the part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from planner.exceptions import RequestError

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.solid.rims import Arc


def checked_class(text: str, kind: str) -> str:
    """Return a tolerance class as ISO 286 writes it.

    Parameters
    ----------
    text : str
        Such as "H7".
    kind : str
        Kind of its dimension.

    Raises
    ------
    RequestError
        If it is no class, or a dimension of this kind has none.
    """
    from aspectgraph import ToleranceError
    from aspectgraph.dimensions.stated_classes import KINDS_WITH_CLASS
    from aspectgraph.dimensions.tolerance_classes import ToleranceClass

    try:
        found = str(ToleranceClass.of(text))
    except ToleranceError as error:
        raise RequestError.of_rule("tolerance", error.rule, error.got, hint=error.hint) from None
    if kind not in KINDS_WITH_CLASS:
        raise RequestError.of_rule(
            "tolerance",
            f"must be two numbers, because only a {', '.join(KINDS_WITH_CLASS[:-1])} or {KINDS_WITH_CLASS[-1]} "
            "has a tolerance class",
            f"{found!r} for a {kind.replace('_', ' ')}",
        )
    return found


def class_limits(tolerance_class: str, nominal_mm: float) -> tuple[float, float]:
    """Return the limit deviations of a tolerance class that was checked, mm.

    Parameters
    ----------
    tolerance_class : str
        Such as "H7".
    nominal_mm : float
        Nominal size.

    Raises
    ------
    RequestError
        If ISO 286 has no limits of this class for the nominal size.
    """
    from aspectgraph import ToleranceError, tolerance_class_deviations

    try:
        return tolerance_class_deviations(tolerance_class, nominal_mm)
    except ToleranceError as error:
        raise RequestError.of_rule("tolerance", error.rule, error.got, hint=error.hint) from None


def check_side(tolerance_class: str, solid: Solid, arcs: Sequence[Arc]) -> None:
    """Refuse the class of a shaft for the rim of a hole, and that of a hole for the rim of a shaft.

    Parameters
    ----------
    tolerance_class : str
        Such as "H7"; capitals are for holes.
    solid : Solid
        The part.
    arcs : sequence of Rim or Arc
        What is measured. A circle that is neither is not checked.

    Raises
    ------
    RequestError
        If they contradict each other.
    """
    from aspectgraph.dimensions.stated_classes import is_in_hole

    for_hole = tolerance_class.isupper()
    for arc in arcs:
        in_hole = is_in_hole(solid, arc)
        if in_hole is not None and in_hole != for_hole:
            rule = "holes, in capitals" if in_hole else "shafts, in small letters"
            side = "a hole" if in_hole else "a shaft"
            raise RequestError.of_rule(
                "tolerance",
                f"must be a class of {rule}, because {arc.id} is the rim of {side}",
                repr(tolerance_class),
            )
