"""How machines leave edges: broken by a little, and which lines of a broken edge a camera sees.

A convex edge with the outward normals n1 and n2 of its faces is broken by c along each face. Then it is two lines, one
on each face: L1 = P + c d1 and L2 = P + c d2. P is the edge of the model, and d1 and d2 lie in the faces and lead away
from it. Between them lies a plane (a chamfer of the leg c) or a round band of the radius r = c / tan(phi / 2), where
phi is the angle of the normals. An edge that is re-entrant is not broken.

Where a camera sees both faces, the step of grey values lies between both lines. Where it sees one face, the step lies
between the line on that face and the outline of the round band, which touches the line of sight at
T = P + c (n - m / cos(phi / 2)) / tan(phi / 2). Here m bisects the normals, and n is the normal that is perpendicular
to the line of sight. The outline of a chamfer lies between these two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle
from ground.convert import Meta
from planner.exceptions import RequestError

if TYPE_CHECKING:
    from errors.measurands import Measurand

Array = NDArray[np.float64]

TYPICAL_BREAK_MM = 0.1
"""Where no break is stated, reports say what this one would do."""
STATE_EDGES = "State the edges: --edges sharp, or --edges 0.1..0.3 for breaks in mm (in Python: edge_break_mm)"
"""What to do about edges whose breaks nobody states."""
UNSTATED_MM = 0.05
"""Edges are broken by up to so much, mm, where nothing is stated: ISO 13715 has it as the limit of a sharp edge."""
UNSEEN_PX = 3.0
"""Images show wider breaks, as two steps. Narrower ones leave the shape of a step as it is, and only move it.

Chamfers of 2 px are seen, and round bands of 3 px not always, see `benchmarks/images/broken_edges.py`.
"""
MOST_UNSEEN_MM = 0.5
"""Larger breaks are dimensioned in drawings, and so the model has them."""
MOST_BREAK_MM = 10.0
"""A larger break is a face of the model."""

# sine of the angle of two faces: those of a smaller one leave no edge to break
_LEAST_TURN = 0.05
_NODES = 4
# of difference quotients
_STEP_MM = 1e-4

Break = Annotated[tuple[float, float], Meta(title="must be two numbers, 0 <= low <= high, mm")]
"""Least and largest break of an edge along its faces, mm."""


def checked_break(value: object, name: str = "edge_break_mm") -> tuple[float, float]:
    """Return the least and the largest break of edges, mm.

    Parameters
    ----------
    value : object
        As it was given.
    name : str
        What it is, for the error.

    Raises
    ------
    RequestError
        If it is not two numbers in rising order from 0 to `MOST_BREAK_MM`.
    """
    rule = f"must be two numbers, 0 <= low <= high <= {MOST_BREAK_MM:g}, mm"
    try:
        low, high = (float(number) for number in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise RequestError.of_rule(name, rule, repr(value)) from None
    if not 0 <= low <= high <= MOST_BREAK_MM:
        raise RequestError.of_rule(name, rule, repr(value))
    return low, high


@dataclass(frozen=True)
class EdgeState:
    """By how much edges are broken: every break between two limits is equally likely.

    Attributes
    ----------
    low_mm, high_mm : float
        Least and largest break along each face, mm.
    stated : bool
        Whether it was stated. What is only assumed corrects no value.

    Examples
    --------
    >>> EdgeState(0.1, 0.3, True).mean_mm
    0.2
    """

    low_mm: float = 0.0
    high_mm: float = UNSTATED_MM
    stated: bool = False

    @classmethod
    def of(cls, *stated: tuple[float, float] | None) -> EdgeState:
        """Return the first that is stated; without any, edges are sharp within `UNSTATED_MM`."""
        for limits in stated:
            if limits is not None:
                return cls(*limits, True)
        return cls()

    @classmethod
    def planned(cls, stated: tuple[float, float] | None) -> EdgeState:
        """Return what plans count: breaks that are stated; without any, edges are as the model has them."""
        return SHARP if stated is None else cls(*stated, True)

    @property
    def mean_mm(self) -> float:
        """Mean break, mm."""
        return (self.low_mm + self.high_mm) / 2

    @property
    def mean_square(self) -> float:
        """Mean square of the break, mm²."""
        return (self.low_mm**2 + self.low_mm * self.high_mm + self.high_mm**2) / 3

    @property
    def is_sharp(self) -> bool:
        """Whether edges are as the model has them."""
        return self.high_mm == 0

    def nodes(self) -> tuple[Array, Array]:
        """Return breaks (k,), mm, and their weights, which integrate over all of them (Gauss and Legendre)."""
        places, weights = np.polynomial.legendre.leggauss(_NODES)
        half = (self.high_mm - self.low_mm) / 2
        return self.mean_mm + half * places, weights / 2

    def __str__(self) -> str:
        """Return what a report says of it."""
        if not self.stated:
            return f"assumed sharp within {self.high_mm:g} mm"
        if self.is_sharp:
            return "stated as sharp"
        if self.low_mm == self.high_mm:
            return f"broken by {self.high_mm:g} mm"
        return f"broken by {self.low_mm:g} to {self.high_mm:g} mm"

    def deviation_note(self, faces: str, shown_mm: float, stated_mm: float) -> str:
        """Return the note on faces that seem to deviate more than stated, as wrongly taken edges make them seem, too.

        Parameters
        ----------
        faces : str
            Which faces, with the verb, such as "faces seem to deviate by about".
        shown_mm, stated_mm : float
            By how much they seem to deviate, and by how much is stated.
        """
        taken = "broken" if self.stated and not self.is_sharp else "sharp"
        return (
            f"{faces} {shown_mm:.2g} mm, not by {stated_mm:.2g} mm as stated, or edges are not {taken} as taken here "
            f"({self}); U is computed with that deviation"
        )


SHARP = EdgeState(0.0, 0.0, True)
"""Edges as the model has them."""


def broken_lines(normals: Array, tangents: Array, convex: NDArray[np.bool_], ways: Array) -> Array:
    """Return between which lines the step of broken edges is seen, as vectors from the edge for each mm of the break.

    Parameters
    ----------
    normals : array (n, 2, 3)
        Outward unit normals of both faces.
    tangents : array (n, 3)
        Unit vectors along the edges.
    convex : array of bool (n,)
        Which edges are convex.
    ways : array (n, 3)
        From the edge to the camera.

    Returns
    -------
    array (n, 2, 3)
        The line on each face; for a face that the camera does not see, the outline of a round band. Zeros where nothing
        is broken.
    """
    first = normals[:, 0]
    second = normals[:, 1]
    cosine = (first * second).sum(axis=1)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    is_broken = convex & (sine > _LEAST_TURN)
    safe = np.where(is_broken, sine, 1.0)[:, None]
    lines = np.stack([cosine[:, None] * first - second, cosine[:, None] * second - first], axis=1)
    lines = lines / safe[:, None]
    is_seen = (normals * ways[:, None]).sum(axis=2) > 0
    outline = _outlines(normals, tangents, np.where(is_broken, cosine, 0.0), ways)
    for k in (0, 1):
        hidden = is_seen[:, 1 - k] & ~is_seen[:, k]
        lines[hidden, k] = outline[hidden]
    return np.where((is_broken & is_seen.any(axis=1))[:, None, None], lines, 0.0)


def chamfer_lines(normals: Array, tangents: Array, convex: NDArray[np.bool_], ways: Array) -> Array:
    """Return the lines at which the grey values of a chamfer change (n, 2, 3); arguments as of `broken_lines`.

    Of a face that the camera does not see, that is the chamfer's far line, or the near one if it is hidden, too.
    """
    lines = broken_lines(normals, tangents, convex, ways)
    # straight from above both faces, a camera sees both
    every = broken_lines(normals, tangents, convex, normals.sum(axis=1))
    is_seen = (normals * ways[:, None]).sum(axis=2) > 0
    band = (normals.sum(axis=1) * ways).sum(axis=1) > 0
    for k in (0, 1):
        hidden = is_seen[:, 1 - k] & ~is_seen[:, k]
        lines[hidden, k] = np.where(band[hidden, None], every[hidden, k], every[hidden, 1 - k])
    return lines


def round_band(normals: Array, tangents: Array, ways: Array, count: int) -> tuple[Array, Array]:
    """Return the strips of what a camera sees of round bands; arguments as of `broken_lines`.

    Parameters
    ----------
    count : int
        Number of strips of equal angles, k.

    Returns
    -------
    lines : array (n, k + 1, 3)
        Their borders, from the first face to the second, as vectors from the edge for each mm of the break.
    middles : array (n, k, 3)
        Their outward unit normals.
    """
    touching = _touching(normals, tangents, ways)
    is_seen = (normals * ways[:, None]).sum(axis=2) > 0
    first, last = np.where(is_seen[..., None], normals, touching[:, None]).transpose(1, 0, 2)
    bisector = normals.sum(axis=1)
    bisector = bisector / np.maximum(np.linalg.norm(bisector, axis=1, keepdims=True), 1e-9)
    half = np.arccos(np.clip((normals[:, 0] * normals[:, 1]).sum(axis=1), -1.0, 1.0)) / 2
    half = np.maximum(half, _LEAST_TURN / 2)[:, None, None]
    borders = _between(first, last, np.linspace(0.0, 1.0, count + 1))
    lines = (borders - bisector[:, None] / np.cos(half)) / np.tan(half)
    return lines, _between(first, last, (np.arange(count) + 0.5) / count)


def _between(first: Array, last: Array, shares: Array) -> Array:
    """Return unit vectors (n, k, 3) that turn evenly from the first (n, 3) to the last."""
    angle = np.arccos(np.clip((first * last).sum(axis=1), -1.0, 1.0))[:, None]
    safe = np.where(angle > 1e-6, angle, 1.0)
    weights = [np.sin(safe * part) / np.sin(safe) for part in (1 - shares, shares)]
    turned = weights[0][..., None] * first[:, None] + weights[1][..., None] * last[:, None]
    return np.where(angle[..., None] > 1e-6, turned, first[:, None])


def _touching(normals: Array, tangents: Array, ways: Array) -> Array:
    """Return the outward unit normals (n, 3) of round bands where lines of sight touch them."""
    across = np.cross(tangents, ways)
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    return np.asarray(across * np.sign((across * normals.sum(axis=1)).sum(axis=1, keepdims=True)))


def _outlines(normals: Array, tangents: Array, cosine: Array, ways: Array) -> Array:
    """Return where lines of sight touch round bands (n, 3), as vectors from the edge for each mm of the break."""
    bisector = normals.sum(axis=1)
    bisector = bisector / np.maximum(np.linalg.norm(bisector, axis=1, keepdims=True), 1e-9)
    touching = _touching(normals, tangents, ways)
    half = np.arccos(np.clip(cosine, -1.0, 1.0)) / 2
    return np.asarray((touching - bisector / np.cos(half)[:, None]) / np.tan(half)[:, None])


def spread_of(means: Array, squares: Array, state: EdgeState) -> tuple[float, float]:
    """Return by how much breaks shift a value on average, and the variance that remains.

    Parameters
    ----------
    means, squares : array (e,)
        Mean shift by each entity, and its mean square; entities are broken independently.
    state : EdgeState
        If it is not stated, nothing is corrected: then the square of the mean is part of the variance.

    Returns
    -------
    (float, float)
        The shift to correct, and the variance.
    """
    mean = float(np.sum(means))
    variance = math.fsum(np.maximum(squares - np.square(means), 0.0).tolist())
    return (mean, variance) if state.stated else (0.0, variance + mean**2)


def value_sigma(measurand: Measurand, state: EdgeState) -> float:
    """Return the root mean square error of a value by broken edges, whatever pose and light are.

    The step of each entity lies between the line on the wanted face, where the model has it, and the line on the other
    face, a break away across the entity. Both and all between are equally likely. Entities are broken independently;
    if nothing is stated, the mean of the breaks remains, and those of all entities add up.

    Parameters
    ----------
    measurand : Measurand
        The value.
    state : EdgeState
        The breaks.

    Returns
    -------
    float
        In the value's unit.
    """
    slopes = np.abs(_by_offsets(measurand))
    means, squares = shifts_of(np.stack([0.0 * slopes, slopes], axis=1), state)
    return math.sqrt(spread_of(means, squares, state)[1])


def largest_shift(measurand: Measurand) -> float:
    """Return how far a value moves at most if all its edges are broken by 1 mm, in its unit per mm."""
    return float(np.abs(_by_offsets(measurand)).sum())


def _by_offsets(measurand: Measurand) -> Array:
    """Return how far a value moves if each entity moves by 1 mm across itself, or each end of a length along it."""
    if measurand.in_image:
        return np.ones(2)
    slopes = []
    for k in range(len(measurand.geometry)):
        values = []
        for sign in (1.0, -1.0):
            fitted = []
            for i, entity in enumerate(measurand.geometry):
                step = sign * _STEP_MM * (i == k)
                if isinstance(entity, Circle):
                    fitted.append(np.array([[0.0, 0.0, entity.radius_mm + step]]))
                else:
                    fitted.append(np.array([[step, 0.0]]))
            values.append(float(measurand.value(fitted)[0]))
        slopes.append((values[0] - values[1]) / (2 * _STEP_MM))
    return np.array(slopes)


def shifts_of(ends: Array, state: EdgeState) -> tuple[Array, Array]:
    """Return mean shift and mean square if the step lies anywhere between two lines with the same probability.

    Parameters
    ----------
    ends : array (..., 2)
        Shift by a break of 1 mm if the step lies at one or the other line.
    state : EdgeState
        The breaks.

    Returns
    -------
    pair of array (...)
        E[c w] and E[c² w²], with w uniform between the ends.
    """
    low = ends[..., 0]
    high = ends[..., 1]
    mean = state.mean_mm * (low + high) / 2
    return np.asarray(mean), np.asarray(state.mean_square * (low**2 + low * high + high**2) / 3)
