"""Samples: points of the part's sharp edges, rims and arcs, as one camera pose shows them.

A sample is visible if the ray from the camera reaches a place just above it, outside the material. Where another line
of the part lies close in the image, a sample says nothing certain: a scan across it could find the other line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aspectgraph.solid.ray_scene import RayScene
from errors.measurands import Circle, Geometry, Line
from planner.camera.camera import Camera
from planner.camera.imaging import image_of
from planner.camera.pose import world_to_cam

if TYPE_CHECKING:
    from aspectgraph import Arc, Solid

Array = NDArray[np.float64]

STEP_PX = 2.5
"""Distance of samples along an edge in the image."""
APART_PX = 5.0
"""A sample with another line of the part at most this far away in the image is left out."""
END_PX = 6.0
"""Samples of a straight edge begin this far from its ends in the image: other lines meet there."""

_OUTLINE = 65
# how far above the surface a sample is looked at
_LIFT_MM = 0.03
# of a length: steps along an edge that give its direction in the image
_AHEAD = 1e-4
# cosine from which on a face is level with a rim
_LEVEL = 0.999
# samples that are looked at around each one
_NEIGHBOURS = 8


@dataclass(frozen=True)
class PartEdge:
    """A sharp edge of the part.

    Attributes
    ----------
    name : str
        Its id, such as "e17", "r3" or "a5".
    geometry : Line or Circle
        Where it is, mm.
    edge_ids : tuple of int
        Edges of the solid: one, or the chords of a circle in their order.
    normals : array (n, 2, 3)
        Outward unit normals of both faces, for each of these.
    chord_mm : float
        Largest distance of a chord from the circle.
    """

    name: str
    geometry: Geometry
    edge_ids: tuple[int, ...]
    normals: Array
    chord_mm: float = 0.0

    def at(self, shares: Array) -> tuple[Array, Array, Array]:
        """Return points (n, 3), unit tangents (n, 3) and normals of both faces (n, 2, 3) at shares (n,) of it."""
        one = self.geometry
        if isinstance(one, Line):
            points = one.p + shares[:, None] * (one.q - one.p)
            tangents = np.broadcast_to(one.direction, points.shape)
        else:
            points = one.points(shares * one.span_rad)
            tangents = np.cross(one.axis, points - one.centre) / one.radius_mm
        k = np.clip((shares * len(self.normals)).astype(int), 0, len(self.normals) - 1)
        return points, tangents, self.normals[k]


@dataclass(frozen=True)
class Samples:
    """Samples (m) of several edges in one image.

    Attributes
    ----------
    edge : array of int (m,)
        Which edge each is of.
    share : array (m,)
        Where on it, in [0, 1].
    points, tangents : array (m, 3)
        In the part's frame, mm; unit vectors.
    visible : array of bool (m,)
        Whether nothing hides it, and it is in the image.
    apart : array of bool (m,)
        Whether no other line is near.
    """

    edge: NDArray[np.int64]
    share: Array
    points: Array
    tangents: Array
    visible: NDArray[np.bool_]
    apart: NDArray[np.bool_]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Which samples are visible and apart from other lines (m,)."""
        return self.visible & self.apart

    def of(self, edge: int) -> Samples:
        """Return the samples of one edge, by its number."""
        return self.chosen(self.edge == edge)

    def chosen(self, which: NDArray[np.bool_]) -> Samples:
        """Return some of the samples, given which (m,)."""
        return Samples(
            self.edge[which],
            self.share[which],
            self.points[which],
            self.tangents[which],
            self.visible[which],
            self.apart[which],
        )


class PartEdges:
    """All sharp edges, rims and arcs of a part, and rays that tell what hides them.

    Parameters
    ----------
    solid : Solid
        The part.
    """

    def __init__(self, solid: Solid) -> None:
        self.solid = solid
        self.scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        curves = [*solid.rims(), *solid.arcs()]
        chords = {edge_id for curve in curves for edge_id in curve.edge_ids}
        round_faces = [self._round_faces(curve) for curve in curves]
        straight = [
            edge
            for edge in solid.straight_edges()
            if edge.id not in chords
            and not any(faces.issuperset(edge.faces) for faces in round_faces)
        ]
        self.edges = [
            *(self.edge_of(f"e{e.id}", Line(*solid.edge_points(e.id)), (e.id,)) for e in straight),
            *(
                self.edge_of(c.id, circle_of(c), c.edge_ids, max(c.chord_mm, c.residual_mm))
                for c in curves
            ),
        ]

    @cached_property
    def _outlines(self) -> Array:
        return outlines_of(self.edges)

    def _round_faces(self, curve: Arc) -> set[int]:
        """Return the facets of the round surface beside a rim or arc: in a mesh, edges between them look sharp."""
        faces = np.array([self.solid.edges[i].faces for i in curve.edge_ids])
        level = np.abs(self.solid.normals[faces] @ curve.axis) > _LEVEL
        return set(faces[~level].tolist())

    def edge_of(
        self, name: str, geometry: Geometry, edge_ids: Sequence[int], chord_mm: float = 0.0
    ) -> PartEdge:
        """Return an edge with the normals of its faces."""
        faces = np.array([self.solid.edges[i].faces for i in edge_ids])
        return PartEdge(name, geometry, tuple(edge_ids), self.solid.normals[faces], chord_mm)

    def samples(
        self, cam2world: Array, camera: Camera, edges: Sequence[PartEdge], margin_px: float
    ) -> Samples:
        """Return the samples of some edges at a pose.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.
        camera : Camera
            The camera.
        edges : sequence of PartEdge
            The edges.
        margin_px : float
            Samples keep this distance from the image's border.
        """
        outlines = self._outlines if edges is self.edges else outlines_of(edges)
        images = pixels_of(outlines, cam2world, camera)
        parts = []
        for k, (edge, image) in enumerate(zip(edges, images, strict=True)):
            shares = sample_shares(edge, image)
            parts.append((np.full(len(shares), k), shares, *edge.at(shares)))
        number, share, points, tangents, normals = (
            np.concatenate(rows) for rows in zip(*parts, strict=True)
        )
        chord = np.array([edge.chord_mm for edge in edges])[number]
        visible = self._visible(points, normals, chord, cam2world)
        visible &= in_image(pixels_of(points, cam2world, camera), camera, margin_px)
        apart = np.ones(len(points), dtype=bool)
        return Samples(number, share, points, np.ascontiguousarray(tangents), visible, apart)

    def _visible(
        self, points: Array, normals: Array, chord_mm: Array, cam2world: Array
    ) -> NDArray[np.bool_]:
        """Return which points (n, 3) nothing hides."""
        above = normals.sum(axis=1)
        above /= np.maximum(np.linalg.norm(above, axis=1, keepdims=True), 1e-9)
        lifted = points + (_LIFT_MM + 2 * chord_mm)[:, None] * above
        origin = np.asarray(cam2world)[:3, 3]
        return np.asarray(~self.scene.blocked(origin, lifted - origin))


def circle_of(curve: Arc) -> Circle:
    """Return a rim or arc as a circle that starts where its first chord does."""
    x = curve.reference
    y = np.cross(curve.axis, x)
    start = np.cos(curve.start_rad) * x + np.sin(curve.start_rad) * y
    span = min(curve.end_rad - curve.start_rad, 2 * np.pi)
    return Circle(curve.centre, curve.axis, curve.radius_mm, start, span)


def outlines_of(edges: Sequence[PartEdge]) -> Array:
    """Return points equally far apart on each edge (e, k, 3), mm."""
    grid = np.linspace(0.0, 1.0, _OUTLINE)
    return np.array([edge.at(grid)[0] for edge in edges]).reshape(-1, _OUTLINE, 3)


def sample_shares(edge: PartEdge, outline: Array) -> Array:
    """Return where samples lie on an edge, equally far apart in the image: shares (n,); none behind the camera.

    Parameters
    ----------
    edge : PartEdge
        The edge.
    outline : array (k, 2)
        Images of its points of `outlines_of`, px.
    """
    closed = isinstance(edge.geometry, Circle) and edge.geometry.span_rad > 2 * np.pi - 1e-6
    if not np.isfinite(outline).all():
        return np.empty(0)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    ends = END_PX if isinstance(edge.geometry, Line) else 0.0
    room = along[-1] - 2 * ends
    n = int(room / STEP_PX)
    if n < 4:
        return np.empty(0)
    if closed:
        places = (np.arange(n) + 0.5) * room / n
    else:
        places = ends + (np.arange(n) + 0.5) * room / n
    return np.interp(places, along, np.linspace(0.0, 1.0, _OUTLINE))


def pixels_of(points: Array, cam2world: Array, camera: Camera) -> Array:
    """Return images (n, 2) in px of points (n, 3) in mm; nan behind the camera."""
    local = world_to_cam(points, cam2world)
    depth = np.where(local[..., 2:] > 0, local[..., 2:], np.nan)
    return image_of(camera, local / depth)


def across_of(points: Array, tangents: Array, cam2world: Array, camera: Camera) -> Array:
    """Return the unit vectors (n, 2) across edges in the image, to the right of where the tangents (n, 3) go."""
    size = np.linalg.norm(points - np.asarray(cam2world)[:3, 3], axis=1)[:, None]
    step = _AHEAD * size * tangents
    along = pixels_of(points + step, cam2world, camera) - pixels_of(
        points - step, cam2world, camera
    )
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def in_image(pixels: Array, camera: Camera, margin_px: float) -> NDArray[np.bool_]:
    """Return which places (n, 2) are on the sensor, with a margin."""
    limit = np.array(camera.resolution) - 1 - margin_px
    with np.errstate(invalid="ignore"):
        return np.asarray(np.all((pixels >= margin_px) & (pixels <= limit), axis=1))


def apart_from(
    samples: Samples,
    edges: Sequence[PartEdge],
    others: Samples,
    other_edges: Sequence[PartEdge],
    pixels: tuple[Array, Array],
    half_px: float = 0.0,
) -> NDArray[np.bool_]:
    """Return which samples (m,) have no visible sample of another edge near.

    Parameters
    ----------
    samples, edges
        What is asked about.
    others, other_edges
        All edges of the part, at the same pose.
    pixels : pair of array (m, 2), (k, 2)
        Images of both, px.
    half_px : float
        How far scans are searched: another line is apart if it lies farther away, and by `APART_PX` at least.
    """
    shown = np.flatnonzero(others.visible)
    if not len(shown):
        return np.ones(len(samples.edge), dtype=bool)
    holders: dict[int, list[int]] = {}
    for number, edge in enumerate(other_edges):
        for edge_id in edge.edge_ids:
            holders.setdefault(edge_id, []).append(number)
    same = np.zeros((len(edges), len(other_edges)), dtype=bool)
    for number, edge in enumerate(edges):
        for edge_id in edge.edge_ids:
            same[number, holders.get(edge_id, [])] = True
    tree = cKDTree(pixels[1][shown])
    finite = np.where(np.isfinite(pixels[0]), pixels[0], -1e6)
    # an edge's own samples are near, too: the first ones of other edges are looked for among so many
    k = min(_NEIGHBOURS + 2 * int(max(half_px - APART_PX, 0.0)), len(shown))
    distance, index = tree.query(finite, k=k, distance_upper_bound=max(APART_PX, half_px))
    distance = distance.reshape(len(finite), k)
    index = np.minimum(index.reshape(len(finite), k), len(shown) - 1)
    foreign = ~same[samples.edge[:, None], others.edge[shown[index]]]
    return ~np.any(np.isfinite(distance) & foreign, axis=1)
