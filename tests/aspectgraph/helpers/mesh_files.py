"""Writers of small mesh files, good and damaged, for the tests of the readers."""

from __future__ import annotations

import json
import struct

import numpy as np

from aspectgraph import Solid


def stl_bytes(corners, header=b"binary part", count=None, tail=b"") -> bytes:
    """Binary STL of triangle corners (t, 3, 3)."""
    rows = np.zeros(len(corners), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = corners
    return (
        header.ljust(80, b" ")
        + struct.pack("<I", len(rows) if count is None else count)
        + rows.tobytes()
        + tail
    )


def stl_text(corners, newline="\n", upper=False) -> bytes:
    lines = ["solid part"]
    for triangle in corners:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += ["  vertex " + " ".join(repr(float(c)) for c in p) for p in triangle]
        lines += [" endloop", "endfacet"]
    text = newline.join([*lines, "endsolid part", ""])
    return (text.upper() if upper else text).encode()


def obj_text(vertices, polygons, negative=False) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, dtype=float).tolist()]
    n = len(lines)
    for polygon in polygons:
        lines.append("f " + " ".join(f"{v - n if negative else v + 1}//{v + 1}" for v in polygon))
    return "\n".join(["# part", "mtllib part.mtl", *lines, ""]).encode()


def off_text(vertices, polygons) -> bytes:
    rows = [" ".join(repr(c) for c in p) for p in np.asarray(vertices, dtype=float).tolist()]
    rows += [" ".join(map(str, (len(p), *p))) + " 255 0 0" for p in polygons]
    return "\n".join(["OFF", "# part", f"{len(vertices)} {len(polygons)} 0", *rows, ""]).encode()


def ply_bytes(vertices, polygons, form="ascii") -> bytes:
    header = f"""ply
format {form} 1.0
comment part
element vertex {len(vertices)}
property uchar red
property double x
property double y
property double z
element face {len(polygons)}
property list uchar int vertex_indices
property float quality
end_header
"""
    vertices = np.asarray(vertices, dtype=float).tolist()
    if form == "ascii":
        rows = ["7 " + " ".join(map(repr, p)) for p in vertices]
        rows += [" ".join(map(str, (len(p), *p))) + " 0.5" for p in polygons]
        return (header + "\n".join(rows) + "\n").encode()
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(order + "Bddd", 7, *p) for p in vertices)
    body += b"".join(struct.pack(f"{order}B{len(p)}if", len(p), *p, 0.5) for p in polygons)
    return header.encode() + body


def glb_bytes(vertices, triangles, node=None, **extra) -> bytes:
    points = np.asarray(vertices, dtype="<f4").tobytes()
    indices = np.asarray(triangles, dtype="<u2").ravel().tobytes()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "translation": [1, 0, 0]}, {"mesh": 0, **(node or {})}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3 * len(triangles), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices)},
        ],
        "buffers": [{"byteLength": len(points) + len(indices)}],
        **extra,
    }
    head = json.dumps(document).encode()
    head += b" " * (-len(head) % 4)
    body = points + indices
    body += b"\0" * (-len(body) % 4)
    total = 12 + 8 + len(head) + 8 + len(body)
    return (
        struct.pack("<4sII", b"glTF", 2, total)
        + struct.pack("<I4s", len(head), b"JSON") + head
        + struct.pack("<I4s", len(body), b"BIN\0") + body
    )  # fmt: skip


def corners(solid: Solid) -> np.ndarray:
    """Triangle corners (t, 3, 3) of a solid."""
    return solid.vertices[solid.triangles]


def quartered(triangles: np.ndarray) -> np.ndarray:
    """Every triangle cut into four at the middles of its sides."""
    a, b, c = triangles.swapaxes(0, 1)
    ab = (a + b) / 2
    bc = (b + c) / 2
    ca = (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])
