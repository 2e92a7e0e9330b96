"""What measuring needs to know of a part, found once: its edges, the surfaces that carry them, the plan's targets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.carriers import PARAMETERS, Carriers
from errors.measurands import Circle, Geometry, Line
from planner.exceptions import RequestError
from planner.measuring.image.part_edge import PartEdge
from planner.measuring.image.samples import PartEdges, ShownEdges
from planner.wanted.planned import PlannedTarget

if TYPE_CHECKING:
    from aspectgraph import Arc, Solid
    from planner.camera.camera import Camera

Array = NDArray[np.float64]

POSE = 6
"""Numbers of a camera's displacement, which come first among the unknowns of an image."""

# a requested circle is the part's if centre and radius agree to this share of the radius
_SAME = 1e-3
# of arcs, rad
_ANGLE = 1e-3
# edges meet where their ends are this near
_MEETS_MM = 1e-3
# a stretch of an edge lies on it as near as this
_ON_MM = 1e-2
# cosine from which on a surface faces across an entity, and so moves its value
_ACROSS = 0.1


class PartModel:
    """Edges, surfaces and targets of a part.

    Parameters
    ----------
    solid : Solid
        The part.
    targets : mapping of str to PlannedTarget
        What is measured, by name.

    Attributes
    ----------
    edges : PartEdges
        All sharp edges, rims and arcs.
    measured : dict of str to tuple of PartEdge
        The entities of each target.
    carried_by : dict of str to (int, int)
        Numbers of the surfaces that carry each edge, by the edge's name.
    free : set of int
        Surfaces whose deviation some target measures.

    Raises
    ------
    RequestError
        If the part lacks an entity of a target.
    """

    def __init__(self, solid: Solid, targets: Mapping[str, PlannedTarget]) -> None:
        self.solid = solid
        self.edges = PartEdges(solid)
        self.carriers = Carriers(solid)
        self._curves = {curve.id: curve for curve in (*solid.rims(), *solid.arcs())}
        self.carried_by: dict[str, tuple[int, int]] = {}
        for edge in self.edges.edges:
            self._carry(edge)
        self._shown: tuple[bytes, Camera, ShownEdges] | None = None
        self.measured = {
            name: tuple(self._entity(one, name) for one in target.geometry)
            for name, target in targets.items()
        }
        self.free: set[int] = set()
        for name, target in targets.items():
            self._free_surfaces(target, self.measured[name])

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns of an image: the pose, and the deviations of all surfaces."""
        return POSE + PARAMETERS * len(self.carriers.surfaces)

    def unknowns_of(self, edge: PartEdge) -> NDArray[np.int64]:
        """Return which unknowns are those of the surfaces that carry an edge (6,)."""
        starts = POSE + PARAMETERS * np.array(self.carried_by[edge.name])
        return np.concatenate([start + np.arange(PARAMETERS) for start in starts])

    def displacement(self, edge: PartEdge, points: Array) -> Array:
        """Return how points (n, 3) of an edge move with `unknowns_of` it; (n, 3, 6)."""
        return self.carriers.displacement(self.carried_by[edge.name], points)

    def shown(self, cam2world: Array, camera: Camera) -> ShownEdges:
        """Return all edges as they are seen from a pose; what the pose asked for last shows is kept."""
        key = np.ascontiguousarray(cam2world).tobytes()
        if self._shown is None or self._shown[0] != key or self._shown[1] is not camera:
            self._shown = key, camera, self.edges.shown(cam2world, camera)
        return self._shown[2]

    def leaving(self, edge: PartEdge, end: Array) -> list[PartEdge]:
        """Return the straight edges that leave an end (3,) of an edge."""
        return [
            other
            for other in self.edges.edges
            if isinstance(other.geometry, Line)
            and not set(other.edge_ids) & set(edge.edge_ids)
            and min(np.linalg.norm(other.geometry.p - end), np.linalg.norm(other.geometry.q - end))
            < _MEETS_MM
        ]

    def _carry(self, edge: PartEdge) -> None:
        if edge.name in self._curves:
            pair = self.carriers.of_curve(self._curves[edge.name])
        else:
            pair = self.carriers.of_edge(edge.edge_ids[0])
        self.carried_by[edge.name] = pair

    def _entity(self, geometry: Geometry, target: str) -> PartEdge:
        """Return the part's edge for an entity of a target."""
        if isinstance(geometry, Circle):
            return self._curve(geometry, target)
        from aspectgraph import resolve_entities
        from aspectgraph.exceptions import EntityError

        try:
            found = resolve_entities(self.solid, {target: (geometry.p, geometry.q)})[target]
        except EntityError as error:
            if (stretch := self._stretch(geometry)) is not None:
                return stretch
            rule = "must be the one that was planned"
            raise RequestError.of_rule("part", rule, f"another: {error}".rstrip(".")) from error
        name = "+".join(f"e{i}" for i in found.edge_ids)
        edge = self.edges.edge_of(name, geometry, found.edge_ids)
        self._carry(edge)
        return edge

    def _stretch(self, line: Line) -> PartEdge | None:
        """Return the part's edge that a line is a stretch of, as long as the line; None if there is none."""
        for edge in self.edges.edges:
            one = edge.geometry
            if not isinstance(one, Line):
                continue
            ends = np.array([line.p, line.q]) - one.p
            along = ends @ one.direction
            off = np.linalg.norm(ends - along[:, None] * one.direction, axis=1)
            if (
                off.max() <= _ON_MM
                and along.min() >= -_ON_MM
                and along.max() <= one.length + _ON_MM
            ):
                return self.edges.edge_of(edge.name, line, edge.edge_ids)
        return None

    def _curve(self, geometry: Circle, target: str) -> PartEdge:
        allowed = _SAME * geometry.radius_mm
        for curve in self._curves.values():
            same_size = abs(curve.radius_mm - geometry.radius_mm) <= allowed
            if not same_size or np.linalg.norm(curve.centre - geometry.centre) > allowed:
                continue
            if _holds(curve, geometry):
                return next(edge for edge in self.edges.edges if edge.name == curve.id)
        raise RequestError.of_rule(
            "part", "must be the one that was planned", f"one without the rim or arc of {target!r}"
        )

    def _free_surfaces(self, target: PlannedTarget, edges: tuple[PartEdge, ...]) -> None:
        frames = target.measurand.frames
        if target.in_image:
            self._free_ends(edges[0])
            return
        for edge, frame in zip(edges, frames, strict=True):
            pair = self.carried_by[edge.name]
            if isinstance(edge.geometry, Line):
                for k in pair:
                    middle = edge.geometry.middle[None]
                    normal = self.carriers.surfaces[k].normals(middle)[0]
                    if abs(normal @ frame.y) > _ACROSS:
                        self.free.add(k)
            else:
                self.free.add(pair[1])

    def _free_ends(self, edge: PartEdge) -> None:
        """Let the surfaces that end an edge be free: those of the edges that leave its ends, across it."""
        line = edge.geometry
        if not isinstance(line, Line):
            return
        for end in (line.p, line.q):
            for other in self.leaving(edge, end):
                for k in self.carried_by[other.name]:
                    normal = self.carriers.surfaces[k].normals(end[None])[0]
                    if abs(normal @ line.direction) > _ACROSS:
                        self.free.add(k)


def _holds(curve: Arc, geometry: Circle) -> bool:
    """Return whether a rim or arc is the one of a circle's angles: one circle may carry several arcs."""
    span = curve.end_rad - curve.start_rad
    if span < geometry.span_rad - _ANGLE:
        return False
    if span >= 2 * np.pi - _ANGLE:
        return True
    (middle,) = geometry.points(np.array([geometry.span_rad / 2])) - geometry.centre
    across = np.cross(curve.axis, curve.reference)
    angle = float(np.arctan2(middle @ across, middle @ curve.reference))
    return bool((angle - curve.start_rad) % (2 * np.pi) <= span)
