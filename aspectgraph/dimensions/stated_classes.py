"""The tolerance class that a file states of a dimension, as two deviations; and whether a rim is one of a hole."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aspectgraph.dimensions.statements import Statement
from aspectgraph.dimensions.tolerance_classes import NOMINAL_DIGITS, ToleranceClass
from aspectgraph.exceptions import ToleranceError
from aspectgraph.solid.rims import Arc
from aspectgraph.solid.solid import Solid

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
        found = "a hole" if in_hole else "a shaft"
        fault = f"the file states {name}, a class of {stands_for}, and its geometry is {found}"
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
