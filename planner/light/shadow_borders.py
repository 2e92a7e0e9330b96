"""Under which lamps a border of a shadow runs beside a line in the image, where a detector may take it for the line.

A line is found by the strongest grey step within some pixels of where it should be. A part that casts a shadow onto the
face beside an edge makes another step there, often a stronger one. So the surface beside a line is looked at, by rays
from the camera, at places up to as many pixels away as other lines have to keep: on each side all places must be lit,
or none. This is computed for lamps at given places and takes no part in proofs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.light.background import across, shadowed_each

if TYPE_CHECKING:
    from aspectgraph.solid.ray_scene import RayScene

Array = NDArray[np.float64]

# places on each side of a point of a line, as shares of how far the last one is: a shadow less than a pixel wide beside
# a line moves its strongest step by as much as that
_PLACES = np.array([0.07, 0.2, 0.4, 0.6, 0.8, 1.0])
# the place that says which face is meant: nearer ones may be on a face that is seen from its edge
_FACE = 1
# a place on a face that is turned by more, or off the tangent plane by more, is beyond another line of the part
_TURN_DEG = 20.0
_ROUNDING = 1e-5


class SeenLine(NamedTuple):
    """A line in an image: from where it is seen, points of it (n, 3) and its direction (3,); mm."""

    eye: Array
    points: Array
    along: Array


@dataclass(frozen=True)
class Beside:
    """Places on the surface beside lines.

    Attributes
    ----------
    places, normals : array (n, 3)
        In mm, and unit normals towards the camera.
    strip : array of int (n,)
        Number of the strip, from a point of a line to one side, in rising order; all its places are to be alike.
    line : array of int (n,)
        Number of the line, in rising order.
    n_lines : int
        Number of lines.
    """

    places: Array
    normals: Array
    strip: NDArray[np.int_]
    line: NDArray[np.int_]
    n_lines: int

    def clear(self, scene: RayScene, lamps: Array, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return under which lamps (l, n_lines) no shadow ends beside a line; True where that is not wanted.

        Parameters
        ----------
        scene : RayScene
            Of the part.
        lamps : array (l, 3)
            Places of lamps, mm.
        wanted : array of bool (l, n_lines)
            What is asked for.
        """
        is_clear = np.ones((len(lamps), self.n_lines), dtype=bool)
        begin = np.searchsorted(self.line, np.arange(self.n_lines + 1))
        for line in range(self.n_lines):
            of_line = slice(begin[line], begin[line + 1])
            rows = np.flatnonzero(wanted[:, line])
            if rows.size and of_line.stop > of_line.start:
                lit = self._lit(scene, lamps[rows], of_line)
                starts = np.flatnonzero(np.diff(self.strip[of_line], prepend=-1))
                least = np.logical_and.reduceat(lit, starts, axis=1)
                most = np.logical_or.reduceat(lit, starts, axis=1)
                is_clear[rows, line] = (least == most).all(axis=1)
        return is_clear

    def _lit(self, scene: RayScene, lamps: Array, of_line: slice) -> NDArray[np.bool_]:
        places = self.places[of_line]
        normals = self.normals[of_line]
        lit = np.einsum("lpi,pi->lp", lamps[:, None] - places, normals) > 0
        lamp, place = np.nonzero(lit)
        lit[lamp, place] = ~shadowed_each(scene, places[place], lamps[lamp])
        return lit


def beside_lines(
    scene: RayScene, lines: Sequence[SeenLine], reach_px: float, pixel_rad: float
) -> Beside:
    """Return places on the surface beside lines in images.

    Parameters
    ----------
    scene : RayScene
        Of the part.
    lines : sequence of SeenLine
        The lines.
    reach_px : float
        How far beside the line the last place is, px; without it there are none.
    pixel_rad : float
        Angle of a pixel.

    Returns
    -------
    Beside
        Of each strip those that are on the surface next to the line; without those in front of the ground.
    """
    strips_found: list[tuple[Array, Array, NDArray[np.int_]]] = []
    owner: list[NDArray[np.int_]] = []
    strips = 0
    for number, line in enumerate(lines if reach_px > 0 else ()):
        places, normals, strip = _strips(scene, line, reach_px * pixel_rad)
        strips_found.append((places, normals, strip + strips))
        owner.append(np.full(len(places), number))
        strips += 2 * len(line.points)
    if not strips_found:
        return Beside(
            np.empty((0, 3)), np.empty((0, 3)), np.empty(0, int), np.empty(0, int), len(lines)
        )
    places, normals, strip = (np.concatenate(parts) for parts in zip(*strips_found, strict=True))
    return Beside(places, normals, strip, np.concatenate(owner), len(lines))


def _strips(
    scene: RayScene, line: SeenLine, reach_rad: float
) -> tuple[Array, Array, NDArray[np.int_]]:
    """Return places (n, 3), normals (n, 3) and strips (n,) beside a line."""
    sight = line.points - line.eye
    aside = across(sight, line.along) * np.linalg.norm(sight, axis=1, keepdims=True)
    off = reach_rad * _PLACES
    # (points, sides, places, 3)
    rays = (
        sight[:, None, None]
        + np.array([1.0, -1.0])[:, None, None] * off[:, None] * aside[:, None, None]
    )
    hit = scene.cast(line.eye, rays)
    t_hit = hit["t_hit"].astype(np.float64)
    met = np.isfinite(t_hit)
    places = line.eye + np.where(met, t_hit, 1.0)[..., None] * rays
    normals = hit["primitive_normals"].astype(np.float64)
    normals *= np.where((normals * rays).sum(axis=-1) > 0, -1.0, 1.0)[..., None]
    first = normals[:, :, _FACE, None]
    way = places - places[:, :, _FACE, None]
    height = np.abs((way * first).sum(axis=-1))
    distance = np.linalg.norm(way, axis=-1)
    turn = np.radians(_TURN_DEG)
    flat = (
        height <= np.sin(turn) * distance + _ROUNDING * np.linalg.norm(sight, axis=1)[:, None, None]
    )
    same = met & met[:, :, _FACE, None] & flat & ((normals * first).sum(axis=-1) >= np.cos(turn))
    strip = np.broadcast_to(np.arange(2 * len(sight)).reshape(-1, 2, 1), same.shape)
    return places[same], normals[same], strip[same]
