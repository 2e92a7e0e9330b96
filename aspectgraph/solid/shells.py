"""Shells: which way they face, and which lies inside which.

A shell with positive volume bounds material from outside, one with negative volume bounds a void. The winding number of
a point with respect to a closed shell is a sum of solid angles (Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30,
1983): 1 inside a shell with positive volume, -1 inside one with negative volume, and 0 outside.
"""

from __future__ import annotations

import numpy as np

from aspectgraph.exceptions import OrientationError, SelfIntersectionError
from aspectgraph.solid.places import describe_point
from aspectgraph.solid.triangulate import signed_volume


def winding_number(point: np.ndarray, corners: np.ndarray) -> int:
    """Return how often closed triangles wind around a point that is not on them.

    Parameters
    ----------
    point : ndarray, shape (3,)
    corners : ndarray, shape (t, 3, 3)
        Triangle corners.
    """
    a, b, c = (corners - point).swapaxes(0, 1)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    dot_ab, dot_bc, dot_ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    half_angles = np.arctan2(volume, la * lb * lc + dot_ab * lc + dot_bc * la + dot_ca * lb)
    return round(float(half_angles.sum()) / (2.0 * np.pi))


def shell_windings(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> np.ndarray:
    """Return the winding number of every shell around one vertex of every other.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
    triangles : ndarray of int, shape (t, 3)
    shell : ndarray of int, shape (t,)
        The shell 0..s-1 of each triangle.

    Returns
    -------
    ndarray of int, shape (s, s)
        Entry (i, j): shell j around a vertex of shell i; 0 on the diagonal.
    """
    corners = [vertices[triangles[shell == s]] for s in range(int(shell.max()) + 1)]
    lows, highs = (
        [extreme(c.reshape(-1, 3), axis=0) for c in corners] for extreme in (np.min, np.max)
    )
    windings = np.zeros((len(corners), len(corners)), dtype=np.int64)
    for i, own in enumerate(corners):
        for j, other in enumerate(corners):
            if i != j and (lows[j] <= own[0, 0]).all() and (own[0, 0] <= highs[j]).all():
                windings[i, j] = winding_number(own[0, 0], other)
    return windings


def shell_volumes(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> np.ndarray:
    """Return the signed volume of every shell in mm³, shape (s,)."""
    return np.array(
        [signed_volume(vertices, triangles[shell == s]) for s in range(int(shell.max()) + 1)]
    )


def check_shells(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> None:
    """Check that shells face outwards and that solids and voids alternate from outside in.

    Raises
    ------
    OrientationError
        A shell is inside out.
    SelfIntersectionError
        A solid lies inside the material of another.
    """
    volumes = shell_volumes(vertices, triangles, shell)
    around = shell_windings(vertices, triangles, shell).sum(axis=1)
    for s, (volume, depth) in enumerate(zip(volumes, around, strict=True)):
        place = describe_point(vertices[triangles[shell == s][0, 0]])
        if volume > 0 and depth > 0:
            raise SelfIntersectionError(
                f"solids must not overlap. Got one inside the material of another at {place}."
            )
        if volume <= 0 and depth != 1:
            raise OrientationError(
                f"faces must run counter-clockwise seen from outside. "
                f"Got a shell of volume {volume:.6g} mm³ at {place}."
            )


def face_outwards(
    vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray
) -> tuple[np.ndarray, int]:
    """Turn inside-out bodies right.

    An outermost shell with negative volume is turned together with everything inside it.

    Returns
    -------
    triangles : ndarray of int, shape (t, 3)
    n_turned : int
        How many outermost shells were turned.
    """
    volumes = shell_volumes(vertices, triangles, shell)
    inside = shell_windings(vertices, triangles, shell) != 0
    turn = np.zeros(len(volumes), dtype=bool)
    inverted = np.flatnonzero(~inside.any(axis=1) & (volumes < 0))
    for root in inverted:
        turn |= inside[:, root]
        turn[root] = True
    return np.where(turn[shell][:, None], triangles[:, ::-1], triangles), len(inverted)
