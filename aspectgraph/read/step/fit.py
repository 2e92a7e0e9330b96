"""Whether the vertices, edges and faces of a STEP solid fit together closely enough to say what shape it has.

A STEP file states the *uncertainty* of its geometry: points closer than that are meant to be the same. Of 23 real parts
(40 solids) measured, all but one keep within it: vertices lie on the ends of their edges to 2·10⁻⁵ mm, edges on their
planar faces likewise, and on their curved faces to 0.01 mm. The one that does not leaves a curved face by 0.0174 mm and
states 0.0166 mm. A wrong vertex or a wrong plane shows up a hundred times wider. Hence:

* up to the stated uncertainty a gap is what the file promises; nothing is said;
* a wider gap is noted while it is too small to change the shape. At a vertex and at a planar face that is the planarity
  tolerance (10⁻⁶ of the diagonal), beyond which a planar face falls into several and edges appear that the part does
  not have. At a curved face it is a tenth of the default chord tolerance (10⁻⁴ of the diagonal), which the facets leave
  the face by anyway;
* a gap wider than both is refused.

The stated uncertainty counts up to the default chord tolerance: a file that states more says nothing about its shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from aspectgraph.exceptions import ReadError
from aspectgraph.solid.checks import RELATIVE_PLANARITY
from aspectgraph.solid.rims import Circle, CircularEdge
from aspectgraph.solid.topology import describe_point

# Circular edges as arrays, the way they leave the kernel's process.


def pack_circles(
    edges: Sequence[CircularEdge],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return circular edges as arrays.

    Returns
    -------
    numbers : ndarray, shape (n, 8)
        Centre, axis, radius and turn of each.
    vertices : ndarray of int, shape (m,)
        Their vertices, one edge after the other.
    first : ndarray of int, shape (n + 1,)
        Where those of each edge start.
    """
    rows = [
        [*edge.circle.centre, *edge.circle.axis, edge.circle.radius_mm, edge.turn_deg]
        for edge in edges
    ]
    vertices = [v for edge in edges for v in edge.vertices]
    first = np.cumsum([0] + [len(edge.vertices) for edge in edges])
    return (
        np.array(rows, dtype=np.float64).reshape(-1, 8),
        np.array(vertices, dtype=np.int64),
        first,
    )


def unpack_circles(
    numbers: npt.NDArray[np.float64], vertices: npt.NDArray[np.int64], first: npt.NDArray[np.int64]
) -> list[CircularEdge]:
    """Return the circular edges that `pack_circles` packed."""
    return [
        CircularEdge(
            Circle(row[:3], row[3:6], float(row[6])), tuple(vertices[i:j].tolist()), float(row[7])
        )
        for row, i, j in zip(numbers, first, first[1:], strict=False)
    ]


RELATIVE_CHORD = 1e-3
"""Default chord tolerance as a fraction of the bounding box diagonal of the solids read."""

UNSTATED_UNCERTAINTY_MM = 1e-3
"""Taken for the uncertainty of a file that states none: far above rounding, far below what a camera measures."""

_RELATIVE_HARMLESS = {
    "vertex": RELATIVE_PLANARITY,
    "planar": RELATIVE_PLANARITY,
    "curved": RELATIVE_CHORD / 10.0,
}
_WHERE = {
    "vertex": "between a vertex and its edge",
    "planar": "between an edge and its planar face",
    "curved": "between an edge and its curved face",
}


def check_fit(
    fits: Sequence[dict[str, Any]],
    solids: Sequence[int],
    diagonal_mm: float,
    gap_mm: float | None,
    name: str,
) -> list[str]:
    """Check the gaps of solids; return a note if one is wider than the file states.

    Parameters
    ----------
    fits : sequence of dict
        For every solid ``"uncertainty_mm"`` (None if not stated) and ``"gaps"``: kind of gap to its width and place,
        see `gaps.measure_gaps`.
    solids : sequence of int
        Their numbers in the file.
    diagonal_mm : float
        Diagonal of the box around them.
    gap_mm : float, optional
        The widest gap permitted; default: by the rule of this module.
    name : str
        Name of the file, for messages.

    Raises
    ------
    ReadError
        A gap is too wide.
    """
    widest: tuple[float, str] = (0.0, "")
    for solid, fit in zip(solids, fits, strict=True):
        stated = fit["uncertainty_mm"]
        stated = (
            UNSTATED_UNCERTAINTY_MM if stated is None else min(stated, RELATIVE_CHORD * diagonal_mm)
        )
        for kind, (gap, place) in fit["gaps"].items():
            permitted = (
                max(stated, _RELATIVE_HARMLESS[kind] * diagonal_mm) if gap_mm is None else gap_mm
            )
            place_text = f"{_WHERE[kind]} at {describe_point(place)} of solid {solid}"
            if not gap <= permitted:
                argument = f"gap_mm={permitted:.3g}"
                raise ReadError.of_rule(
                    "",
                    f"the vertices, edges and faces of a STEP file must meet within {argument} mm",
                    f"a gap of {gap:.3g} mm {place_text} of {name}",
                    hint="allow more with gap_mm=..., and look at the result",
                    mentions=(argument, "gap_mm=..."),
                )
            if gap > max(stated, RELATIVE_PLANARITY * diagonal_mm, widest[0]):
                widest = gap, f"a gap of {gap:.3g} mm {place_text}; the file states {stated:.3g} mm"
    return [widest[1]] if widest[1] else []
