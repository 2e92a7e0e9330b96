"""Extensions of glTF: those that leave the shape alone, those that are read, and all others, which are refused.

An extension may change the shape whether or not the file *requires* it: writers list as required only what a viewer
cannot show without. So an extension that is not known is refused wherever the shape comes from: the document, its
scenes, nodes, meshes, primitives, accessors and buffers. On materials, textures, cameras and images it does no harm.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from aspectgraph.exceptions import ReadError

HARMLESS_EXTENSIONS = frozenset(
    {
        "ADOBE_materials_clearcoat_specular", "ADOBE_materials_clearcoat_tint",
        "ADOBE_materials_thin_transparency", "CESIUM_primitive_outline", "EXT_instance_features",
        "EXT_lights_ies", "EXT_lights_image_based", "EXT_mesh_features", "EXT_mesh_manifold",
        "EXT_structural_metadata", "EXT_texture_avif", "EXT_texture_webp", "KHR_animation_pointer",
        "KHR_lights_punctual", "KHR_node_hoverability", "KHR_node_selectability",
        "KHR_techniques_webgl", "KHR_texture_basisu", "KHR_texture_transform", "KHR_xmp",
        "KHR_xmp_json_ld", "MSFT_lod", "MSFT_packing_normalRoughnessMetallic",
        "MSFT_packing_occlusionRoughnessMetallic", "MSFT_texture_dds",
    }
)  # fmt: skip
"""Light, texture, metadata, and coarser copies beside the finest: the shape is the same without them."""

READ_EXTENSIONS = frozenset({"EXT_mesh_gpu_instancing", "KHR_mesh_quantization"})
"""Those that change the shape and are read."""

_MATERIAL_PREFIX = "KHR_materials_"


def check_extensions(thing: dict[str, Any], where: str) -> None:
    """Check that the extensions of a thing in a GLB document leave its shape alone, or are read.

    Parameters
    ----------
    thing : dict
        Anything with ``extensions``.
    where : str
        What to call it in messages.

    Raises
    ------
    ReadError
        One of them may change the shape.
    """
    unread = unread_extensions(thing.get("extensions", {}))
    if unread:
        raise ReadError(
            "a GLB file must do without extensions that may change the shape and are not read. "
            f"Got {unread[0][:60]} at {where}; export the part without it."
        )


def unread_extensions(names: Iterable[str]) -> list[str]:
    """Return the extensions that may change the shape and are not read."""
    return [
        name
        for name in map(str, names)
        if name not in HARMLESS_EXTENSIONS | READ_EXTENSIONS
        and not name.startswith(_MATERIAL_PREFIX)
    ]
