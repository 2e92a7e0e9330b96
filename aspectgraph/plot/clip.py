"""Cut convex cells and viewing domains down to a window or a box, for pictures only: in doubles."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

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


def clip_polygon(corners: np.ndarray, half_spaces: np.ndarray) -> np.ndarray:
    """Cut a convex polygon down to half-spaces (Sutherland and Hodgman 1974).

    Parameters
    ----------
    corners : ndarray, shape (n, d)
        In order; d is 2 or 3.
    half_spaces : ndarray, shape (k, d + 1)
        Rows (a, b) with a·x + b <= 0 inside.

    Returns
    -------
    ndarray, shape (m, d)
        Without rows if nothing is left.
    """
    for row in half_spaces:
        if not len(corners):
            break
        height = corners @ row[:-1] + row[-1]
        height[np.abs(height) < _ON] = 0.0
        if (height <= 0).all():
            continue
        # by hand, as np.roll and np.stack take longer than all the rest of so few corners
        after = np.concatenate([corners[1:], corners[:1]])
        height_after = np.concatenate([height[1:], height[:1]])
        crossed = height * height_after < 0
        share = np.where(crossed, height / np.where(crossed, height - height_after, 1.0), 0.0)
        both = np.empty((2 * len(corners), corners.shape[1]))
        kept = np.empty(2 * len(corners), bool)
        both[::2] = corners
        both[1::2] = corners + share[:, None] * (after - corners)
        kept[::2] = height <= 0
        kept[1::2] = crossed
        corners = both[kept]
    return corners


def box_half_spaces(box: np.ndarray) -> np.ndarray:
    """Rows (a, b) with a·x + b <= 0 inside a box given by its two corners, shape (2 d, d + 1)."""
    low, high = np.asarray(box, float)
    unit = np.eye(len(low))
    return np.vstack([np.column_stack([unit, -high]), np.column_stack([-unit, low])])


def clipped_facets(half_spaces: np.ndarray, box: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the facets of a convex cell cut down to a box, as (half-space it lies on, corners (n, 3)) pairs."""
    rows = np.vstack([half_spaces, box_half_spaces(box)])
    centre = box.mean(axis=0)
    reach = 2.0 * float(np.linalg.norm(np.ptp(box, axis=0)))
    facets = []
    for k, row in enumerate(rows):
        foot = centre - (row[:3] @ centre + row[3]) * row[:3]
        u, v = plane_axes(row[:3])
        square = foot + reach * np.array([-u - v, u - v, u + v, v - u])
        corners = clip_polygon(square, np.delete(rows, k, axis=0))
        if len(corners) > 2:
            facets.append((row, corners))
    return facets


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
    sides: dict[tuple[float, ...], tuple[list[Any], list[Any]]] = {}
    for cell in cells:
        for row, corners in clipped_facets(cell.half_spaces, box):
            key, sign = _plane_key(row)
            axes = plane_axes(np.array(key[:3]))
            sides.setdefault(key, ([], []))[sign].append(shapely.Polygon(corners @ axes.T))
    facets = []
    for key, (behind, before) in sides.items():
        grid = _SNAP * size
        one = polygon_union(behind, grid)
        other = polygon_union(before, grid)
        wall = shapely.MultiPolygon(polygon_parts(one.symmetric_difference(other, grid_size=grid)))
        wall = wall.difference(_solid_faces(solid, key, size), grid_size=grid)
        facets += [
            _lifted(part, key) for part in polygon_parts(wall) if part.area > (1e-4 * size) ** 2
        ]
    return facets


def section_polygon(cell: Cell, axis: int, at: float, window: np.ndarray) -> np.ndarray:
    """Cut a cell by the plane on which one coordinate has a value; corners inside a window (2, 2), shape (n, 2)."""
    u, v = section_axes(axis)
    rows = np.column_stack(
        [cell.half_spaces[:, [u, v]], cell.half_spaces[:, axis] * at + cell.half_spaces[:, 3]]
    )
    (x0, y0), (x1, y1) = window
    return clip_polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float), rows)


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


def _solid_faces(solid: Solid, key: tuple[float, ...], size: float) -> shapely.Geometry:
    """Return the union of the solid's faces in a plane, in the plane's axes."""
    normal = np.array(key[:3])
    offset = key[3]
    first = solid.vertices[[face.outer[0] for face in solid.faces]]
    parallel = np.abs(np.abs(solid.normals @ normal) - 1.0) < _PARALLEL
    in_plane = np.flatnonzero(parallel & (np.abs(first @ normal + offset) < 10 * _SNAP * size))
    if not len(in_plane):
        return shapely.MultiPolygon()
    axes = plane_axes(normal)
    corners = [
        solid.vertices[triangle] @ axes.T
        for face in in_plane
        for triangle in solid.face_triangles[face]
    ]
    return polygon_union([shapely.Polygon(triangle) for triangle in corners], _SNAP * size)


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
