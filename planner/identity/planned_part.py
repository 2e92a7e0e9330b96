"""Whether a part is the one of a plan: by its digest, or by what a plan without one holds of its part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from errors.measurands.geometry import Circle, Geometry, Line
from planner.exceptions import RequestError
from planner.identity.inspection_request import PartRecord
from planner.request.defaults import default_workspace

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan

_SAME_MM = 1e-3
# of the longest chords, as a share of the radius: those of a circle in 6 pieces
_SAG = 0.134
# points of a planned edge or circle that must lie on edges of the part
_SHARES = np.linspace(0.0, 1.0, 8)


def other_part(plan: InspectionPlan, solid: Solid) -> str:
    """Return why a part is not the plan's, in words that follow its name.

    A plan of an early version has no digest of its part. Then its edges and
    circles must lie on edges of the part.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        The part.

    Returns
    -------
    str
        Such as "which has another shape"; empty if it is the plan's.

    Raises
    ------
    RequestError
        If the plan holds nothing that could be compared.
    """
    planned = plan.request.get("part")
    if planned is not None:
        same = planned["digest"] == PartRecord.of(solid).digest
        return "" if same else "which has another shape"
    targets = plan.targets
    if not targets:
        rule = "must hold the digest of its part, or an edge to compare"
        hint = "it is of an early version: plan the part again"
        raise RequestError.of_rule("plan", rule, "neither", hint=hint)
    starts, ends = _edges(solid)
    for name, target in targets.items():
        for one in target.geometry:
            if not _is_on(one, starts, ends):
                return f"which has no edge at {name!r}"
    return ""


def part_note(plan: InspectionPlan, solid: Solid) -> str:
    """Return what remains open about a part that `other_part` finds no fault with; empty if nothing does."""
    if plan.request.get("part") is not None or _has_default_workspace(plan, solid):
        return ""
    return "the plan has no digest of its part, so only its edges were compared: plan it again."


def _has_default_workspace(plan: InspectionPlan, solid: Solid) -> bool:
    """Return whether the plan's workspace is the one about this part, which tells the size of its box."""
    default = default_workspace(solid, plan.camera)
    return bool(np.allclose(plan.workspace, default, rtol=0.0, atol=_SAME_MM))


def _is_on(one: Geometry, starts: np.ndarray, ends: np.ndarray) -> bool:
    """Return whether a line or circle lies on edges (n, 3) of a part; of circles these are the chords."""
    if isinstance(one, Line):
        points = one.p + _SHARES[:, None] * (one.q - one.p)
        return bool((_distances(points, starts, ends) <= _SAME_MM).all())
    chords = _is_near(one, starts) & _is_near(one, ends)
    points = one.points(one.span_rad * _SHARES)
    off = _distances(points, starts[chords], ends[chords])
    return bool((off <= _SAME_MM + _SAG * one.radius_mm).all())


def _is_near(circle: Circle, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) lie on a whole circle (n,)."""
    apart = points - circle.centre
    heights = apart @ circle.axis
    across = apart - heights[:, None] * circle.axis
    radial = np.sqrt((across**2).sum(axis=1)) - circle.radius_mm
    return np.asarray(np.hypot(heights, radial) <= _SAME_MM)


def _edges(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of all edges of a part, (n, 3) each."""
    pairs = np.array([edge.vertices for edge in solid.edges], dtype=np.int64).reshape(-1, 2)
    return solid.vertices[pairs[:, 0]], solid.vertices[pairs[:, 1]]


def _distances(points: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return how far points (m, 3) are from the nearest of segments (n, 3), (m,)."""
    ways = ends - starts
    squares = np.maximum((ways**2).sum(axis=1), np.finfo(float).tiny)
    found = []
    for point in points:
        shares = np.clip(((point - starts) * ways).sum(axis=1) / squares, 0.0, 1.0)
        apart = starts + shares[:, None] * ways - point
        found.append(np.sqrt((apart**2).sum(axis=1)).min(initial=np.inf))
    return np.array(found)
