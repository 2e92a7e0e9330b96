"""What is named in pictures of a part: edges, rims and arcs, each with its line and what is said of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph.exceptions import EntityError
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid


class NamedItem(NamedTuple):
    """What is named in a picture.

    Attributes
    ----------
    id : str
        Its id.
    kind : str
        ``"edge"``, ``"rim"`` or ``"arc"``.
    line : ndarray, shape (k, 3)
        Its polyline, mm; that of a rim ends where it starts.
    edge_ids : tuple of int
        Its edges in the solid.
    size_mm : float
        Length of an edge, radius of a rim or arc.
    rows : tuple of str
        What is said of it, a line each.
    """

    id: str
    kind: str
    line: NDArray[np.float64]
    edge_ids: tuple[int, ...]
    size_mm: float
    rows: tuple[str, ...]

    @property
    def middle(self) -> NDArray[np.float64]:
        """Where its label goes, shape (3,): the middle of an edge, a vertex in the middle of a chain of chords."""
        return np.asarray(
            self.line.mean(axis=0) if len(self.line) == 2 else self.line[len(self.line) // 2]
        )


def named_items(
    solid: Solid, edge_ids: Iterable[int] | None, curve_ids: Iterable[str] | None
) -> list[NamedItem]:
    """Return what shall be named, edges first.

    Parameters
    ----------
    solid : Solid
        The part.
    edge_ids : iterable of int or None
        The edges; None: all of ``solid.straight_edges()``.
    curve_ids : iterable of str or None
        The rims and arcs; None: all, but none if `edge_ids` are chosen.

    Raises
    ------
    EntityError
        There is no such edge, rim or arc.
    """
    curves = {curve.id: curve for curve in (*solid.rims(), *solid.arcs())}
    if curve_ids is None:
        curve_ids = list(curves) if edge_ids is None else []
    chosen = list(curve_ids)
    bad = [name for name in chosen if name not in curves]
    if bad:
        raise EntityError(
            f"a curve id must be that of a rim or arc, {', '.join(curves) or 'none here'}. Got {bad[0]!r}."
        )
    edges = [_edge_item(solid, edge_id) for edge_id in _checked_ids(solid, edge_ids)]
    return edges + [_curve_item(solid, curves[name]) for name in chosen]


def counts_text(items: Iterable[NamedItem]) -> str:
    """Return how many of each kind there are: ``3 straight edges, 1 rim, 0 arcs``; curves only if there are any."""
    kinds = [item.kind for item in items]
    n_edges, n_rims, n_arcs = (kinds.count(kind) for kind in ("edge", "rim", "arc"))
    curves = f", {n_rims} rims, {n_arcs} arcs" if n_rims + n_arcs else ""
    return f"{n_edges} straight edges{curves}"


def item_faces(solid: Solid, item: NamedItem) -> list[int]:
    """Return the faces on both sides of an item, each once."""
    return sorted({face for edge_id in item.edge_ids for face in solid.edges[edge_id].faces})


def normal_text(solid: Solid, face: int) -> str:
    """Return where a face looks: ``+z``, or the components of its normal."""
    normal = solid.normals[face]
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) > 1 - 1e-9:
        return f"{'+' if normal[axis] > 0 else '-'}{'xyz'[axis]}"
    return "(" + ", ".join(f"{c + 0.0:.3g}" for c in normal) + ")"


def _edge_item(solid: Solid, edge_id: int) -> NamedItem:
    line = np.asarray(solid.edge_points(edge_id), dtype=np.float64)
    edge = solid.edges[edge_id]
    length = float(solid.edge_length_mm(edge_id))
    rows = (
        f"edge {edge_id}",
        f"length {length:.6g} mm",
        _turn(edge.turn_deg),
        _faces(solid, (edge_id,)),
        f"{_point(line[0])} to {_point(line[1])}",
        f"ends: {', '.join(end.text for end in solid.edge_ends(edge_id))}",
    )
    return NamedItem(str(edge_id), "edge", line, (edge_id,), length, rows)


def _curve_item(solid: Solid, curve: Arc) -> NamedItem:
    closed = isinstance(curve, Rim)
    line = solid.vertices[list(curve.vertices + curve.vertices[:1] if closed else curve.vertices)]
    kind = "rim" if closed else "arc"
    size = f"diameter {2 * curve.radius_mm:.6g}" if closed else f"radius {curve.radius_mm:.6g}"
    rows = (
        f"{kind} {curve.id}",
        f"{size} mm",
        _turn(solid.edges[curve.edge_ids[0]].turn_deg),
        _faces(solid, curve.edge_ids),
        f"centre {_point(curve.centre)}",
        f"axis {_point(curve.axis)}",
    )
    return NamedItem(
        curve.id, kind, np.asarray(line, np.float64), curve.edge_ids, float(curve.radius_mm), rows
    )


def _turn(dihedral_deg: float) -> str:
    return f"angle {dihedral_deg:.4g}°, {'convex' if dihedral_deg > 0 else 're-entrant'}"


def _faces(solid: Solid, edge_ids: Iterable[int]) -> str:
    """Name the faces on both sides; facets of curved ones together."""
    faces = dict.fromkeys(face for edge_id in edge_ids for face in solid.edges[edge_id].faces)
    flat = [
        f"{face} ({normal_text(solid, face)})" for face in faces if not solid.faces[face].curved
    ]
    if len(flat) < len(faces):
        flat.append("a curved one")
    return f"{'face' if len(flat) == 1 else 'faces'} {' and '.join(flat)}"


def _point(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in point) + ")"


def _checked_ids(solid: Solid, edge_ids: Iterable[int] | None) -> list[int]:
    if edge_ids is None:
        return [edge.id for edge in solid.straight_edges()]
    ids = [int(edge_id) for edge_id in edge_ids]
    bad = [edge_id for edge_id in ids if not 0 <= edge_id < len(solid.edges)]
    if bad:
        raise EntityError(f"an edge id must be in 0..{len(solid.edges) - 1}. Got {bad[0]}.")
    return ids
