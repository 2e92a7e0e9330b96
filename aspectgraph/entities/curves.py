"""Rims and arcs of a solid, picked by id or as objects."""

from __future__ import annotations

import re

import numpy as np

from aspectgraph.exceptions import EntityError
from aspectgraph.solid.circles import FloatArray
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid

# Python reads no integer of more than some thousand digits
_CURVE_ID = re.compile(r"[ra]\d{1,300}", re.ASCII)


def is_curve_id(target: object) -> bool:
    """Return whether something is the id of a rim or an arc: ``"r0"`` or ``"a0"``, ``"r1"`` or ``"a1"`` and so on."""
    return isinstance(target, str) and _CURVE_ID.fullmatch(target) is not None


def find_curve(solid: Solid, target: str | Arc, name: str, min_dihedral_deg: float) -> Arc:
    """Return the rim or arc of a solid that an id or an object stands for.

    Parameters
    ----------
    solid : Solid
        The part.
    target : str or Rim or Arc
        Its id, or itself.
    name : str
        Of the entity, for messages.
    min_dihedral_deg : float
        Smallest turn of the normal across its chords.

    Raises
    ------
    EntityError
        The solid has no such rim or arc, or it is blunter.
    """
    curves = [*solid.rims(0.0), *solid.arcs(0.0)]
    wanted = target if isinstance(target, str) else target.id
    found = next((curve for curve in curves if curve.id == wanted), None)
    if found is None or not (isinstance(target, str) or found == target):
        n_rims, n_arcs = (
            sum(isinstance(c, Rim) is is_rim for c in curves) for is_rim in (True, False)
        )
        raise EntityError(
            f"a rim or arc must be one of the solid's {n_rims} rims and {n_arcs} arcs, r0, r1, … and a0, a1, …. "
            f"Got {wanted!r} for {name!r}{'' if found is None else ', that of another solid'}."
        )
    if found.dihedral_deg < min_dihedral_deg:
        raise EntityError(
            f"an entity's faces must turn by at least {min_dihedral_deg:g} degrees. "
            f"Got {found.dihedral_deg:.3g} at {found.id} for {name!r}."
        )
    return found


def curve_points(solid: Solid, curve: Arc) -> FloatArray:
    """Return the ends of a rim's or arc's chords in order, shape (m, 3)."""
    return np.asarray(solid.vertices[list(curve.vertices)], dtype=np.float64)


def curve_ends(points: FloatArray, curve: Arc) -> FloatArray:
    """Return the two ends of an arc, or two opposite points of a rim, shape (2, 3)."""
    other = len(points) // 2 if isinstance(curve, Rim) else len(points) - 1
    return np.asarray(points[[0, other]], dtype=np.float64)
