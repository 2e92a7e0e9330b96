"""Carriers: the planes, cylinders and cones that carry the faces of a part, and how an edge moves with them.

A surface deviates by three numbers, mm. Those of a plane are its offset along its normal, and how far two tilts lift
it at its extent. Those of a cylinder are its radius and the place of its axis; those of a cone its offset along its
normal, and the place of its axis. An edge lies on two surfaces and moves by the least vector that meets both:
pinv([n1; n2]) [r1; r2], with their unit normals n and offsets r.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from aspectgraph.solid.rims import Arc, reference_direction

if TYPE_CHECKING:
    from aspectgraph.solid.solid import Solid


FloatArray = npt.NDArray[np.float64]

PARAMETERS = 3
"""Numbers that a surface deviates by."""

# planes whose normals and offsets agree to these digits carry their faces together
_NORMAL_DIGITS = 5
_OFFSET_DIGITS = 3
# cosine from which on a face is perpendicular to an axis, and up to which it is parallel to it
_PERPENDICULAR = 0.999
_PARALLEL = 0.02
# normals that differ by less than this share do not fix how an edge moves along their difference
_ALIKE = 0.05


@dataclass(frozen=True)
class Carrier:
    """A plane, cylinder or cone.

    Attributes
    ----------
    point : ndarray, shape (3,)
        A point of the plane, or of the axis, mm.
    axis : ndarray, shape (3,)
        Unit normal of the plane, or direction of the axis.
    radius_mm : float
        0 for a plane; of a cone, at the edge that it carries.
    extent_mm : float
        Largest distance of the plane's faces from the point; tilts count there.
    lean : float
        How far the unit normals of a cone go along its axis; 0 for planes and cylinders.
    """

    point: FloatArray
    axis: FloatArray
    radius_mm: float
    extent_mm: float
    lean: float = 0.0

    @property
    def is_plane(self) -> bool:
        """Whether it is a plane."""
        return self.radius_mm == 0.0

    def normals(self, points: FloatArray) -> FloatArray:
        """Return unit normals (n, 3) at points (n, 3); of cylinders and cones away from the axis."""
        if self.is_plane:
            return np.tile(self.axis, (len(points), 1))
        off = points - self.point
        off = off - (off @ self.axis)[:, None] * self.axis
        out = off / np.linalg.norm(off, axis=1, keepdims=True)
        return np.asarray(np.sqrt(1.0 - self.lean**2) * out + self.lean * self.axis)

    def offsets(self, points: FloatArray) -> FloatArray:
        """Return how far (n, 3) the surface is off along its normal at points (n, 3) for each of its numbers."""
        x = reference_direction(self.axis)
        y = np.cross(self.axis, x)
        if self.is_plane:
            off = (points - self.point) / self.extent_mm
        else:
            off = self.normals(points)
        return np.stack([np.ones(len(points)), off @ x, off @ y], axis=1)


class Carriers:
    """The planes, cylinders and cones of a part that carry its sharp edges, rims and arcs.

    Parameters
    ----------
    solid : Solid
        The part.

    Attributes
    ----------
    surfaces : list of Carrier
        Those that carry an edge asked for so far.
    """

    def __init__(self, solid: Solid) -> None:
        self.surfaces: list[Carrier] = []
        self._solid = solid
        self._planes: dict[tuple[float, ...], int] = {}
        self._cylinders: dict[tuple[float, ...], int] = {}
        self._members: dict[tuple[float, ...], list[int]] = {}
        for face, normal in enumerate(solid.normals):
            self._members.setdefault(self._plane_key(face, normal), []).append(face)

    def of_edge(self, edge_id: int) -> tuple[int, int]:
        """Return the two surfaces that carry a straight edge, as numbers in `surfaces`."""
        first, second = self._solid.edges[edge_id].faces
        return self._plane(first), self._plane(second)

    def of_curve(self, curve: Arc) -> tuple[int, int]:
        """Return the two surfaces that carry a rim or arc: what fixes where it is along its axis, and what is round.

        The first is what is level with it, or else a cone; the second a cylinder, or else a cone. A cone may stand for
        any surface that is neither level nor parallel to the axis. What is missing is a plane or a cylinder of the
        curve's own.
        """
        faces = np.array([self._solid.edges[i].faces for i in curve.edge_ids])
        cosines = np.abs(self._solid.normals[faces] @ curve.axis)
        level = np.all(cosines >= _PERPENDICULAR, axis=0)
        parallel = bool(np.any(np.all(cosines <= _PARALLEL, axis=0)))
        leaning = np.flatnonzero(np.all(cosines > _PARALLEL, axis=0) & ~level)
        cone = self._add(self._cone(curve, faces[:, leaning[0]])) if len(leaning) else None
        if level.any():
            first = self._plane(int(faces[0, np.flatnonzero(level)[0]]))
            if cone is not None:
                return first, cone
        elif cone is not None:
            first = cone
        else:
            first = self._add(Carrier(curve.centre, curve.axis, 0.0, max(curve.radius_mm, 1.0)))
        return first, self._cylinder(curve, shared=parallel)

    def displacement(self, pair: Sequence[int], points: FloatArray) -> FloatArray:
        """Return how points of an edge move with its surfaces.

        Parameters
        ----------
        pair : sequence of int
            The two surfaces that carry it.
        points : ndarray, shape (n, 3)
            On the edge, mm.

        Returns
        -------
        ndarray, shape (n, 3, 6)
            Displacement in mm by the numbers of both surfaces.
        """
        both = [self.surfaces[k] for k in pair]
        # those of planes are the same everywhere
        samples = points[:1] if all(surface.is_plane for surface in both) else points
        normals = np.stack([surface.normals(samples) for surface in both], axis=1)
        inverse = np.linalg.pinv(normals, rcond=_ALIKE)
        moved = [
            inverse[:, :, k, None] * surface.offsets(points)[:, None, :]
            for k, surface in enumerate(both)
        ]
        return np.concatenate(moved, axis=2)

    def _plane_key(self, face: int, normal: FloatArray) -> tuple[float, ...]:
        offset = float(normal @ self._solid.vertices[self._solid.faces[face].outer[0]])
        return (*(np.round(normal, _NORMAL_DIGITS) + 0.0), round(offset, _OFFSET_DIGITS) + 0.0)

    def _plane(self, face: int) -> int:
        key = self._plane_key(face, self._solid.normals[face])
        if key not in self._planes:
            members = self._members[key]
            corners = sorted({v for i in members for v in self._solid.faces[i].outer})
            points = self._solid.vertices[corners]
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            normal = self._solid.normals[face]
            middle = middle - ((middle - points[0]) @ normal) * normal
            extent = float(np.linalg.norm(points - middle, axis=1).max())
            self._planes[key] = self._add(Carrier(middle, normal, 0.0, extent))
        return self._planes[key]

    def _cylinder(self, curve: Arc, *, shared: bool) -> int:
        axis = curve.axis * (1.0 if curve.axis[int(np.argmax(np.abs(curve.axis)))] > 0 else -1.0)
        foot = curve.centre - (curve.centre @ axis) * axis
        rounded = np.round([*axis, *foot, curve.radius_mm], _OFFSET_DIGITS) + 0.0
        key = tuple(rounded.tolist())
        if not shared:
            return self._add(Carrier(curve.centre, axis, curve.radius_mm, curve.radius_mm))
        if key not in self._cylinders:
            carrier = Carrier(curve.centre, axis, curve.radius_mm, curve.radius_mm)
            self._cylinders[key] = self._add(carrier)
        return self._cylinders[key]

    def _cone(self, curve: Arc, faces: npt.NDArray[np.int64]) -> Carrier:
        """Return the cone that touches the faces (n,) on one side of a curve, one for each of its chords."""
        normals = self._solid.normals[faces]
        ends = [self._solid.edge_points(i) for i in curve.edge_ids]
        middles = np.array([(start + end) / 2 for start, end in ends]) - curve.centre
        # away from the axis, as the normals of carriers are
        side = np.sign((normals * middles).sum(axis=1).mean())
        lean = float(side * (normals @ curve.axis).mean())
        return Carrier(curve.centre, curve.axis, curve.radius_mm, curve.radius_mm, lean)

    def _add(self, carrier: Carrier) -> int:
        self.surfaces.append(carrier)
        return len(self.surfaces) - 1
