"""The picker: a page on which the edges, rims and arcs of a part are pointed at, filtered and collected.

One file that asks the network for nothing. Its TOML is what ``--entities`` or ``--dimensions`` reads. The
depth buffer of the browser decides which edges are visible; this serves looking only.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from html import escape
from importlib import resources
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aspectgraph.plot.named_items import (
    NamedItem,
    counts_text,
    item_faces,
    named_items,
    normal_text,
)
from aspectgraph.plot.style import is_feature
from aspectgraph.solid.rims import Arc
from aspectgraph.solid.solid import Solid

_SCRIPTS = ("scene.js", "labels.js", "choice.js", "pointer.js", "picker.js")
# room around the part in depth, so that nothing of it is cut off
_AIR = 1.05


def picker_html(
    solid: Solid, edge_ids: Iterable[int] | None = None, curve_ids: Iterable[str] | None = None
) -> str:
    """Return a page on which edges, rims and arcs are collected into a file for a plan.

    The file is one for ``--entities``, or one for ``--dimensions`` with tolerances.

    Parameters
    ----------
    solid : Solid
        The part.
    edge_ids : iterable of int, optional
        The edges on offer. Default: all of ``solid.straight_edges()``.
    curve_ids : iterable of str, optional
        The rims and arcs on offer. Default: all of ``solid.rims()`` and ``solid.arcs()``, but none if `edge_ids` are
        chosen.

    Returns
    -------
    str
        HTML without references to anything outside it. The same part gives the same page.

    Raises
    ------
    EntityError
        There is no such edge, rim or arc.
    """
    items = named_items(solid, edge_ids, curve_ids)
    name = solid.name or "part"
    return Template(_asset("picker.html")).substitute(
        title=escape(f"{name}: edges"),
        part=escape(name),
        counts=escape(counts_text(items)),
        file=escape(f"{_stem(name)}_entities.toml"),
        dimensions=escape(f"{_stem(name)}_dimensions.toml"),
        style=_asset("picker.css"),
        # a script element ends at the first </
        data=json.dumps(_data(solid, items, name), allow_nan=False).replace("<", "\\u003c"),
        script="\n".join(map(_asset, _SCRIPTS)),
    )


def _asset(name: str) -> str:
    return resources.files("aspectgraph.plot").joinpath("page", name).read_text(encoding="utf-8")


def _stem(name: str) -> str:
    """Return a part's name as a file name."""
    kept = "".join(c if c.isalnum() or c in "-_" else "_" for c in name.split(".")[0])
    return kept.strip("_") or "part"


def _data(solid: Solid, items: list[NamedItem], name: str) -> dict[str, Any]:
    """Return what the page shows; points about the centre of the part's box."""
    low, high = np.asarray(solid.bounds, dtype=np.float64)
    centre = (low + high) / 2
    named = {edge_id for item in items for edge_id in item.edge_ids}
    curves = {curve.id: curve for curve in (*solid.rims(), *solid.arcs())}
    rest = [edge.id for edge in solid.edges if edge.id not in named and is_feature(solid, edge)]
    return {
        "part": name,
        "stem": _stem(name),
        "radius": float(_AIR * np.linalg.norm(high - low) / 2),
        "vertices": _packed(solid.vertices - centre, "<f4"),
        "triangles": _packed(solid.triangles, "<u4"),
        "face_of": _packed(solid.triangle_face, "<u4"),
        "normals": _packed(solid.normals, "<f4"),
        "outlines": [_rounded(solid.edge_points(edge_id) - centre) for edge_id in rest],
        "faces": [_face_rows(solid, face) for face in range(len(solid.faces))],
        "items": [_record(solid, item, centre, curves.get(item.id)) for item in items],
    }


def _record(
    solid: Solid, item: NamedItem, centre: NDArray[np.float64], curve: Arc | None
) -> dict[str, Any]:
    symbol = {"edge": "", "rim": "R ", "arc": "R "}[item.kind]
    return {
        "id": item.id,
        "kind": item.kind,
        "size": item.size_mm,
        "told": f"{symbol}{item.size_mm:.5g} mm",
        # a mesh states no circle: how far its chords are off the one fitted to them
        "chords": {
            "n": len(item.edge_ids),
            "off": 0.0 if curve is None or not curve.fitted else float(curve.chord_mm),
        },
        "smooth": curve is None
        and any(end.kind == "tangent" for end in solid.edge_ends(item.edge_ids[0])),
        "turn": float(solid.edges[item.edge_ids[0]].turn_deg),
        "faces": item_faces(solid, item),
        "rows": item.rows,
        "line": _rounded(item.line - centre),
        # in full, for the file
        "ends": item.line.tolist() if item.kind == "edge" else None,
    }


def _face_rows(solid: Solid, face: int) -> list[str]:
    if solid.faces[face].curved:
        return [f"face {face}", "facet of a curved face"]
    return [f"face {face}", f"looks to {normal_text(solid, face)}", "double-click for its edges"]


def _packed(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _rounded(points: NDArray[np.float64]) -> list[list[float]]:
    """Return points with the seven digits that the browser draws with."""
    return [[float(f"{c:.7g}") for c in point] for point in points]
