"""Where parts of entities lie on a solid, in mm."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from aspectgraph.entities.parts import Run, Stretch
from aspectgraph.exceptions import EntityError
from aspectgraph.solid.circles import FloatArray
from aspectgraph.solid.rims import Arc, Rim, angles_of
from aspectgraph.solid.solid import Solid


def stretch_ends(solid: Solid, stretch: Stretch) -> FloatArray:
    """Return the two ends of a stretch.

    Parameters
    ----------
    solid : Solid
        The part.
    stretch : Stretch
        A stretch of one of its edges.

    Returns
    -------
    ndarray of float64, shape (2, 3)
        In mm, in the order of ``Edge.vertices``.

    Raises
    ------
    EntityError
        If the solid has no such edge.
    """
    if stretch.edge >= len(solid.edges):
        raise EntityError(
            f"an edge id must be in 0..{len(solid.edges) - 1}. Got {stretch.edge} in {stretch}."
        )
    ends = solid.edge_points(stretch.edge)
    return np.array([_at(ends, stretch.start), _at(ends, stretch.end)])


def _at(ends: FloatArray, share: Fraction) -> FloatArray:
    """Return the point at a share of the way; an end is exactly that end."""
    point = ends[1] if share == 1 else ends[0] + float(share) * (ends[1] - ends[0])
    return np.asarray(point, dtype=np.float64)


def run_arc(solid: Solid, run: Run) -> Arc:
    """Return a run as an arc of its circle.

    Parameters
    ----------
    solid : Solid
        The part.
    run : Run
        A run of one of its rims or arcs.

    Returns
    -------
    Arc
        Its id is the text form of the run.

    Raises
    ------
    EntityError
        If the solid has no such rim or arc, or that has no such joints.

    Examples
    --------
    >>> from aspectgraph import Run, read_solid, run_arc
    >>> part = read_solid("examples/nist_ctc_01_ap242.stp")
    >>> arc = run_arc(part, Run("r0", 1, 4))
    >>> arc.id, len(arc.edge_ids), len(arc.vertices)
    ('r0[1:4]', 3, 4)
    """
    curves = {curve.id: curve for curve in (*solid.rims(0.0), *solid.arcs(0.0))}
    if run.curve not in curves:
        raise EntityError.of_rule("curve", "must be one of the solid's rims or arcs", str(run))
    return run_of_curve(solid, curves[run.curve], run)


def run_of_curve(solid: Solid, curve: Arc, run: Run) -> Arc:
    """Return a run of a given rim or arc as an arc."""
    chords = run_chords(curve, run)
    joints = [*chords, chords[-1] + 1]
    n = len(curve.vertices)
    vertices = tuple(curve.vertices[joint % n] for joint in joints)
    start, span = angles_of(solid.vertices[list(vertices)], curve.circle)
    fields = {name: getattr(curve, name) for name in _OF_THE_CURVE}
    return Arc(
        id=str(run),
        edge_ids=tuple(curve.edge_ids[chord % n] for chord in chords),
        vertices=vertices,
        start_rad=start,
        end_rad=start + span,
        **fields,
    )


_OF_THE_CURVE = (
    "centre",
    "axis",
    "radius_mm",
    "residual_mm",
    "chord_mm",
    "dihedral_deg",
    "fitted",
)


def run_chords(curve: Arc, run: Run) -> list[int]:
    """Return the chords of a run, counted from 0; those of a rim past joint 0 from its number of chords on."""
    n = len(curve.edge_ids)
    last = n - 1 if isinstance(curve, Rim) else n
    if max(run.first, run.last) > last:
        raise EntityError.of_rule(
            "first and last", f"must be joints of {curve.id}, 0..{last}", f"{run}"
        )
    return list(range(run.first, run.last if run.last > run.first else run.last + n))
