"""Small questions to shapes of the kernel: what they consist of, their points and their triangles.

Imports OCP; import this module only when a boundary representation is at hand.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location


def explore(
    shape: Any, kind: TopAbs_ShapeEnum, outside: TopAbs_ShapeEnum = TopAbs_ShapeEnum.TopAbs_SHAPE
) -> list[Any]:
    """Return the sub-shapes of a kind that are in none of the kind `outside`, in file order, once for each use."""
    found = []
    explorer = TopExp_Explorer(shape, kind, outside)
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


def unplaced(shape: Any) -> Any:
    """Return a shape as its part states it, before any placement."""
    return shape.Located(TopLoc_Location())


def xyz(point: Any) -> tuple[float, float, float]:
    """Return the coordinates of an OCCT point or vector."""
    return point.X(), point.Y(), point.Z()


def face_mesh(face: Any) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    """Return the triangles of a face.

    Parameters
    ----------
    face : TopoDS_Face
        A face with triangles.

    Returns
    -------
    mesh : Poly_Triangulation
        As the kernel has it, before its placement.
    location : TopLoc_Location
        Its placement.
    points : ndarray, shape (n, 3)
        Its nodes in place, in mm.
    triangles : ndarray of int, shape (t, 3)
        Rows of `points`, as the surface turns.
    """
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    move = location.Transformation()
    nodes = [mesh.Node(k).Transformed(move) for k in range(1, mesh.NbNodes() + 1)]
    rows = [mesh.Triangle(k) for k in range(1, mesh.NbTriangles() + 1)]
    corners = [(row.Value(1), row.Value(2), row.Value(3)) for row in rows]
    return mesh, location, np.array([xyz(node) for node in nodes]), np.array(corners) - 1
