"""Cut convex cells and viewing domains down to a window or a box, for pictures only: in doubles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from numpy.typing import ArrayLike

from aspectgraph.cells.cell_set import Cell
from aspectgraph.exceptions import WorkspaceError
from aspectgraph.solid.solid import Solid

# heights over a plane and parts of a normal below this are rounding
_ON = 1e-9
# grid on which polygons are united, as a share of the size
_SNAP = 1e-7
# largest lack to 1 of the cosine between parallel normals
_PARALLEL = 1e-10
# bounds the memory that cells of many sides take
_CELLS_AT_ONCE = 256
# a half-space that holds every point
_EVERYTHING = np.array([0.0, 0.0, 0.0, -1.0])


class Facet(NamedTuple):
    """A planar piece of a domain's surface.

    Attributes
    ----------
    outlines : list of ndarray, shape (n, 3)
        Closed rings.
    triangles : ndarray, shape (t, 3, 3)
    """

    outlines: list[np.ndarray]
    triangles: np.ndarray


def clip_polygons(polygons: np.ndarray, half_spaces: np.ndarray) -> list[np.ndarray]:
    """Cut convex polygons down to half-spaces of their own (Sutherland and Hodgman 1974).

    Parameters
    ----------
    polygons : ndarray, shape (f, n, d)
        Corners of each, in order; d is 2 or 3.
    half_spaces : ndarray, shape (f, k, d + 1)
        Rows (a, b) of each polygon with a·x + b <= 0 inside.

    Returns
    -------
    list of ndarray, shape (m, d)
        One per polygon, without rows if nothing is left.
    """
    # a polygon with fewer corners than others repeats its first one, which also closes it
    corners = np.array(polygons, float)
    n = np.full(len(corners), corners.shape[1])
    for row in np.moveaxis(half_spaces, 1, 0):
        height = _heights(corners, row)
        cut = np.flatnonzero((n > 0) & (height > 0).any(axis=1))
        if not len(cut):
            continue
        pieces, n[cut] = _clip_once(corners[cut], n[cut], height[cut])
        missing = pieces.shape[1] - corners.shape[1]
        if missing > 0:
            corners = np.concatenate([corners, corners[:, :1].repeat(missing, axis=1)], axis=1)
        corners[cut, : pieces.shape[1]] = pieces
        corners[cut, pieces.shape[1] :] = pieces[:, :1]
    return [polygon[:count] for polygon, count in zip(corners, n.tolist(), strict=True)]


def _heights(corners: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the heights (f, n) of corners over a plane per polygon; 0 where they are rounding."""
    height = (corners @ row[:, :-1, None])[..., 0] + row[:, None, -1]
    height[np.abs(height) < _ON] = 0.0
    return height


def _clip_once(
    corners: np.ndarray, n: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons with n corners each at height 0; return their new corners and numbers."""
    after = np.roll(corners, -1, axis=1)
    height_after = np.roll(height, -1, axis=1)
    crossed = height * height_after < 0
    share = np.where(crossed, height / np.where(crossed, height - height_after, 1.0), 0.0)
    size, width, d = corners.shape
    both = np.empty((size, 2 * width, d))
    inside = np.empty((size, 2 * width), bool)
    both[:, ::2] = corners
    both[:, 1::2] = corners + share[..., None] * (after - corners)
    inside[:, ::2] = (height <= 0) & (np.arange(width) < n[:, None])
    inside[:, 1::2] = crossed
    n_left = inside.sum(axis=1)
    order = np.argsort(~inside, axis=1, kind="stable")[:, : max(n_left.max(), 1)]
    polygons = np.take_along_axis(both, order[..., None], axis=1)
    missing = np.arange(polygons.shape[1]) >= n_left[:, None]
    return np.where(missing[..., None], polygons[:, :1], polygons), n_left


def _stacked(half_spaces: Sequence[np.ndarray]) -> np.ndarray:
    """Return sets of half-spaces as one array (f, k, d + 1), filled up with some that hold all."""
    n_rows = max(map(len, half_spaces))
    everything = np.zeros(half_spaces[0].shape[1])
    everything[-1] = -1.0
    rows = np.tile(everything, (len(half_spaces), n_rows, 1))
    for k, sides in enumerate(half_spaces):
        rows[k, : len(sides)] = sides
    return rows


def box_half_spaces(box: np.ndarray) -> np.ndarray:
    """Rows (a, b) with a·x + b <= 0 inside a box given by its two corners, shape (2 d, d + 1)."""
    low, high = np.asarray(box, float)
    unit = np.eye(len(low))
    return np.vstack([np.column_stack([unit, -high]), np.column_stack([-unit, low])])


def clipped_facets(
    cells: Sequence[np.ndarray], box: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the facets of convex cells cut down to a box.

    Parameters
    ----------
    cells : sequence of ndarray, shape (k, 4)
        Half-spaces of each cell.
    box : ndarray, shape (2, 3)

    Returns
    -------
    list of tuple of ndarray
        The half-space (4,) that a facet lies on, and its corners (n, 3).
    """
    return [
        facet
        for start in range(0, len(cells), _CELLS_AT_ONCE)
        for facet in _some_facets(cells[start : start + _CELLS_AT_ONCE], box)
    ]


def _some_facets(
    cells: Sequence[np.ndarray], box: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the facets of so few cells that they are cut down together."""
    sides = box_half_spaces(box)
    all_rows = _stacked([np.vstack([cell, sides]) for cell in cells])
    n_rows = [len(cell) + len(sides) for cell in cells]
    cell = np.repeat(np.arange(len(cells)), n_rows)
    on = np.concatenate([np.arange(count) for count in n_rows])
    row = all_rows[cell, on]
    others = all_rows[cell]
    # a facet lies on its own half-space, which must not cut it
    others[np.arange(len(on)), on] = _EVERYTHING
    corners = clip_polygons(_squares(row, box), others)
    return [(plane, facet) for plane, facet in zip(row, corners, strict=True) if len(facet) > 2]


def _squares(rows: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return squares (f, 4, 3) in planes (f, 4), each larger than the box."""
    centre = box.mean(axis=0)
    reach = 2.0 * float(np.linalg.norm(np.ptp(box, axis=0)))
    axes = np.array([plane_axes(row[:3]) for row in rows])
    u = axes[:, 0]
    v = axes[:, 1]
    foot = centre - (rows[:, :3] @ centre + rows[:, 3])[:, None] * rows[:, :3]
    return foot[:, None] + reach * np.stack([-u - v, u - v, u + v, v - u], axis=1)


def plane_axes(normal: np.ndarray) -> np.ndarray:
    """Return two orthonormal vectors in the plane with a normal, shape (2, 3)."""
    a, b, c = np.asarray(normal, float) / np.linalg.norm(normal)
    # the cross product with the axis that is farthest from the normal, written out for speed
    u = ((0.0, c, -b), (-c, 0.0, a), (b, -a, 0.0))[int(np.argmin(np.abs((a, b, c))))]
    x, y, z = np.array(u) / np.linalg.norm(u)
    return np.array([(x, y, z), (b * z - c * y, c * x - a * z, a * y - b * x)])


def domain_facets(cells: Iterable[Cell], solid: Solid, box: np.ndarray) -> list[Facet]:
    """Return the surface of a union of cells inside a box, without walls between cells and on the solid.

    Parameters
    ----------
    cells : iterable of Cell
    solid : Solid
    box : ndarray, shape (2, 3)

    Returns
    -------
    list of Facet
    """
    size = float(np.ptp(box, axis=0).max())
    grid = _SNAP * size
    if solid not in _PLANES:
        _PLANES[solid] = _FacePlanes(solid)
    planes = _PLANES[solid]
    facets = []
    for key, (behind, before) in _sides(cells, box).items():
        wall = polygon_union(behind, grid).symmetric_difference(
            polygon_union(before, grid), grid_size=grid
        )
        wall = shapely.MultiPolygon(polygon_parts(wall))
        wall = wall.difference(planes.union(key, size), grid_size=grid)
        facets += [
            _lifted(part, key) for part in polygon_parts(wall) if part.area > (1e-4 * size) ** 2
        ]
    return facets


def _sides(
    cells: Iterable[Cell], box: np.ndarray
) -> dict[tuple[float, ...], tuple[list[Any], list[Any]]]:
    """Return the facets of cells by their plane, in its axes: those behind it and those before."""
    sides: dict[tuple[float, ...], tuple[list[Any], list[Any]]] = {}
    axes: dict[tuple[float, ...], np.ndarray] = {}
    for row, corners in clipped_facets([cell.half_spaces for cell in cells], box):
        key, sign = _plane_key(row)
        if key not in sides:
            sides[key] = ([], [])
            axes[key] = plane_axes(np.array(key[:3])).T
        sides[key][sign].append(corners @ axes[key])
    return {key: (_polygons(behind), _polygons(before)) for key, (behind, before) in sides.items()}


def _polygons(rings: Sequence[np.ndarray]) -> list[Any]:
    """Return rings (n, 2) as polygons."""
    if not rings:
        return []
    index = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    return list(shapely.polygons(shapely.linearrings(np.concatenate(rings), indices=index)))


def section_polygons(
    cells: Iterable[Cell], axis: int, at: float, window: np.ndarray
) -> list[np.ndarray]:
    """Cut cells by the plane on which one coordinate has a value.

    Parameters
    ----------
    cells : iterable of Cell
    axis : int
        The coordinate.
    at : float
        Its value, mm.
    window : ndarray, shape (2, 2)
        What is kept of the plane.

    Returns
    -------
    list of ndarray, shape (n, 2)
        The corners of each cell's section; none of a cell that the plane misses.
    """
    u, v = section_axes(axis)
    rows = [
        np.column_stack(
            [cell.half_spaces[:, [u, v]], cell.half_spaces[:, axis] * at + cell.half_spaces[:, 3]]
        )
        for cell in cells
    ]
    if not rows:
        return []
    (x0, y0), (x1, y1) = window
    squares = np.tile(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float), (len(rows), 1, 1))
    return clip_polygons(squares, _stacked(rows))


def section_axes(axis: int) -> tuple[int, int]:
    """Return the coordinates drawn to the right and upwards in a section."""
    return ((1, 2), (0, 2), (0, 1))[axis]


def box_around(
    solid: Solid, workspace: np.ndarray, box: ArrayLike | None = None, margin: float = 0.6
) -> np.ndarray:
    """Return a box inside the workspace, the given one or one around the part; shape (2, 3).

    Raises
    ------
    WorkspaceError
        If the box is none, or has no room in common with the workspace.
    """
    if box is None:
        room = margin * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
        box = solid.bounds + np.array([[-room], [room]])
    corners = np.asarray(box, float)
    if corners.shape != (2, 3) or not np.isfinite(corners).all():
        raise WorkspaceError(
            f"box must be two finite corners, shape (2, 3). Got {np.asarray(box).tolist()}."
        )
    corners = np.array([np.maximum(corners[0], workspace[0]), np.minimum(corners[1], workspace[1])])
    if (corners[0] >= corners[1]).any():
        raise WorkspaceError(
            f"box must overlap the workspace, lower corner first. Got {np.asarray(box).tolist()}."
        )
    return corners


def _plane_key(row: np.ndarray) -> tuple[tuple[float, ...], int]:
    """Name a plane by its rounded coefficients, and say on which side of it the half-space lies."""
    sign = 1 if row[np.argmax(np.abs(row[:3]) > _ON)] > 0 else -1
    return tuple((np.round(sign * row, 9) + 0.0).tolist()), (sign + 1) // 2


def polygon_union(polygons: list[Any], grid: float) -> shapely.Geometry:
    """Return the union of polygons on a grid, without the lines that the thinnest of them collapse to there."""
    return shapely.MultiPolygon(polygon_parts(shapely.union_all(polygons, grid_size=grid)))


def polygon_parts(geometry: shapely.Geometry) -> list[Any]:
    """Return the polygons in a geometry."""
    return [
        part
        for part in getattr(geometry, "geoms", [geometry])
        if part.geom_type == "Polygon" and not part.is_empty
    ]


class _FacePlanes:
    """The solid's faces by the plane they lie in: each union is made once, for all domains.

    Parameters
    ----------
    solid : Solid
    """

    def __init__(self, solid: Solid) -> None:
        # no reference to the solid, which is a weak key of these
        self._normals = solid.normals
        self._first = solid.vertices[[face.outer[0] for face in solid.faces]]
        self._corners = [solid.vertices[triangles] for triangles in solid.face_triangles]
        self._unions: dict[tuple[tuple[float, ...], float], shapely.Geometry] = {}

    def union(self, key: tuple[float, ...], size: float) -> shapely.Geometry:
        """Return the union of the faces in a plane, in the plane's axes."""
        if (key, size) not in self._unions:
            self._unions[key, size] = self._united(key, size)
        return self._unions[key, size]

    def _united(self, key: tuple[float, ...], size: float) -> shapely.Geometry:
        normal = np.array(key[:3])
        height = np.abs(self._first @ normal + key[3])
        parallel = np.abs(np.abs(self._normals @ normal) - 1.0) < _PARALLEL
        in_plane = np.flatnonzero(parallel & (height < 10 * _SNAP * size))
        if not len(in_plane):
            return shapely.MultiPolygon()
        corners = np.concatenate([self._corners[face] for face in in_plane])
        return polygon_union(_polygons(list(corners @ plane_axes(normal).T)), _SNAP * size)


_PLANES: WeakKeyDictionary[Solid, _FacePlanes] = WeakKeyDictionary()


def _lifted(polygon: shapely.Polygon, key: tuple[float, ...]) -> Facet:
    normal = np.array(key[:3])
    axes = plane_axes(normal)
    foot = -key[3] * normal / (normal @ normal)

    def lift(ring: Any) -> Any:
        return foot + np.asarray(ring.coords)[:, :2] @ axes

    pieces = shapely.constrained_delaunay_triangles(polygon)
    triangles = [lift(piece.exterior)[:3] for piece in pieces.geoms]
    return Facet(
        [lift(ring) for ring in (polygon.exterior, *polygon.interiors)],
        np.array(triangles).reshape(-1, 3, 3),
    )
