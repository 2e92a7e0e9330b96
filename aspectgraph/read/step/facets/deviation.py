"""How far the facets of a face leave its surface.

The mesher takes a chord tolerance as an aim: on tori it was seen to miss it by a factor of two.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Pnt, gp_Vec

from aspectgraph.read.step.shapes import face_mesh, xyz

_SAMPLES = np.array(
    [
        (0.5, 0.5, 0.0),
        (0.0, 0.5, 0.5),
        (0.5, 0.0, 0.5),
        (1 / 3, 1 / 3, 1 / 3),
        (0.6, 0.2, 0.2),
        (0.2, 0.6, 0.2),
        (0.2, 0.2, 0.6),
    ]
)
"""Where on a facet the distance is taken, as weights of its corners; corners are on the surface."""

_MAX_STEPS = 8


def deviation_mm(face: Any, surface: Any, enough_mm: float) -> float:
    """Return how far the facets of a face leave a surface, at the samples of every facet.

    Parameters
    ----------
    face : TopoDS_Face
        A face with triangles.
    surface : BRepAdaptor_Surface
        Where its facets should be, with the parameters of the face's own surface.
    enough_mm : float
        A distance of at most this may come out too large: the exact one costs time.

    Returns
    -------
    float
        In mm. No less than the true one at the samples.
    """
    kind = surface.GetType()
    if kind == GeomAbs_SurfaceType.GeomAbs_Plane:
        return 0.0
    mesh, _, points, corners = face_mesh(face)
    tested = _sampled(points, corners)
    if kind in _DISTANCES:
        return float(_DISTANCES[kind](surface, tested).max())
    if not mesh.HasUVNodes():
        return 0.0
    pairs = [mesh.UVNode(k) for k in range(1, mesh.NbNodes() + 1)]
    parameters = np.array([(pair.X(), pair.Y()) for pair in pairs])
    return _to_any(surface, tested, _sampled(parameters, corners), enough_mm)


def _sampled(rows: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return rows of numbers at the samples of every facet, linear between its corners."""
    samples: np.ndarray = np.einsum("wc,tcx->twx", _SAMPLES, rows[corners])
    return samples.reshape(-1, rows.shape[1])


def _about(axis: Any, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far points are along an axis and from it."""
    direction = axis.Direction()
    foot = axis.Location()
    along = np.array(xyz(direction))
    offsets = points - xyz(foot)
    heights = offsets @ along
    return heights, np.linalg.norm(offsets - np.outer(heights, along), axis=1)


def _to_cylinder(surface: Any, points: np.ndarray) -> np.ndarray:
    cylinder = surface.Cylinder()
    _, radii = _about(cylinder.Axis(), points)
    return np.abs(radii - cylinder.Radius())


def _to_cone(surface: Any, points: np.ndarray) -> np.ndarray:
    """Return distances on the side of the apex where the points lie."""
    cone = surface.Cone()
    heights, radii = _about(cone.Axis(), points)
    true_radii = np.abs(cone.RefRadius() + heights * np.tan(cone.SemiAngle()))
    distances: np.ndarray = np.abs(radii - true_radii) * np.cos(cone.SemiAngle())
    return distances


def _to_sphere(surface: Any, points: np.ndarray) -> np.ndarray:
    sphere = surface.Sphere()
    centre = sphere.Location()
    offsets = points - xyz(centre)
    return np.abs(np.linalg.norm(offsets, axis=1) - sphere.Radius())


def _to_torus(surface: Any, points: np.ndarray) -> np.ndarray:
    torus = surface.Torus()
    heights, radii = _about(torus.Axis(), points)
    # a torus that meets itself has points whose circle is on the other side of the axis
    near, far = (
        np.abs(np.hypot(radii - centre, heights) - torus.MinorRadius())
        for centre in (torus.MajorRadius(), -torus.MajorRadius())
    )
    distances: np.ndarray = np.minimum(near, far)
    return distances


_DISTANCES = {
    GeomAbs_SurfaceType.GeomAbs_Cylinder: _to_cylinder,
    GeomAbs_SurfaceType.GeomAbs_Cone: _to_cone,
    GeomAbs_SurfaceType.GeomAbs_Sphere: _to_sphere,
    GeomAbs_SurfaceType.GeomAbs_Torus: _to_torus,
}


def _to_any(surface: Any, points: np.ndarray, parameters: np.ndarray, enough_mm: float) -> float:
    """Return the largest distance of points from a surface; `parameters` are near those of the nearest ones."""
    values = [surface.Value(u, v) for u, v in parameters.tolist()]
    near = np.array([xyz(value) for value in values])
    distances = np.linalg.norm(points - near, axis=1)
    for k in np.flatnonzero(distances > enough_mm).tolist():
        distances[k] = _to_foot(surface, points[k], parameters[k], enough_mm)
    return float(distances.max())


def _to_foot(surface: Any, point: np.ndarray, start: np.ndarray, enough_mm: float) -> float:
    """Return the distance of a point from a surface near a start; steps end once it is small enough."""
    value = gp_Pnt()
    along_u = gp_Vec()
    along_v = gp_Vec()
    parameters = start.copy()
    nearest = np.inf
    for _ in range(_MAX_STEPS):
        surface.D1(float(parameters[0]), float(parameters[1]), value, along_u, along_v)
        gap = point - xyz(value)
        nearest = min(nearest, float(np.linalg.norm(gap)))
        if nearest <= enough_mm:
            break
        slopes = np.array([xyz(along_u), xyz(along_v)]).T
        parameters += np.linalg.lstsq(slopes, gap, rcond=None)[0]
    return nearest
