"""GLB files: binary glTF 2.0 with triangles."""

from aspectgraph.read.glb.glb_scene import parse_glb

__all__ = [
    "parse_glb",
]
