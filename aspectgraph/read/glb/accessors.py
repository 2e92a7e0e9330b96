"""The numbers of a GLB file: accessors, plain and sparse, with their bounds checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.glb.extensions import check_extensions

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_FLOAT = 5126
_UNSIGNED = (5121, 5123, 5125)
_SMALL_INTEGERS = (5120, 5121, 5122, 5123)
_QUANTIZATION = "KHR_mesh_quantization"


def item_at(items: list[Any], index: int) -> Any:
    """Return an item of a list of the document; Python would take -1 and True as well.

    Raises
    ------
    ReadError
        There is no such item.
    """
    if type(index) is not int or not 0 <= index < len(items):
        raise ReadError(
            f"the numbers in a GLB file must be those of things in it. Got {str(index)[:40]}."
        )
    return items[index]


def as_natural(value: object) -> int:
    """Return a whole number from 0.

    Raises
    ------
    ReadError
        It is none.
    """
    if type(value) is not int or value < 0:
        raise ReadError(
            f"counts and offsets in a GLB file must be whole numbers from 0. Got {str(value)[:40]}."
        )
    return value


class Accessors:
    """The accessors of a GLB document.

    Parameters
    ----------
    document : dict
        The JSON chunk.
    binary : bytes
        The binary chunk.
    most_rows : int
        Most rows of an accessor without data of its own, whose rows are zeros and cost the file nothing.
    """

    def __init__(self, document: dict[str, Any], binary: bytes, most_rows: int) -> None:
        self.document = document
        self.binary = binary
        self.most_rows = most_rows
        self.quantized = _QUANTIZATION in document.get("extensionsUsed", [])

    def positions(self, index: int) -> np.ndarray:
        """Return points or displacements, shape (n, 3)."""
        types = (_FLOAT, *_SMALL_INTEGERS) if self.quantized else (_FLOAT,)
        return self._reals(index, "VEC3", types)

    def indices(self, index: int) -> np.ndarray:
        """Return vertex numbers, shape (n,)."""
        return self._values(index, "SCALAR", _UNSIGNED).ravel()

    def instance_vectors(self, index: int) -> np.ndarray:
        """Return translations or scales of instances, shape (n, 3)."""
        return self._reals(index, "VEC3", (_FLOAT,))

    def instance_rotations(self, index: int) -> np.ndarray:
        """Return quaternions of instances, shape (n, 4)."""
        return self._reals(index, "VEC4", (_FLOAT, 5120, 5122))

    def _reals(self, index: int, kind: str, types: tuple[int, ...]) -> np.ndarray:
        values = self._values(index, kind, types)
        if values.dtype.kind == "f" or not self._accessor(index).get("normalized", False):
            return values
        return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)

    def _accessor(self, index: int) -> dict[str, Any]:
        accessor: dict[str, Any] = item_at(self.document["accessors"], index)
        return accessor

    def _values(self, index: int, kind: str, types: tuple[int, ...]) -> np.ndarray:
        accessor = self._accessor(index)
        check_extensions(accessor, f"accessor {index}")
        component = accessor.get("componentType")
        if accessor.get("type") != kind or component not in types:
            raise ReadError(
                f"a GLB accessor must be {kind} of a legal component type. "
                f"Got number {index}, which is not."
            )
        dtype = np.dtype(_TYPES[component])
        count = as_natural(accessor["count"])
        if "bufferView" in accessor:
            rows = self._rows(accessor, index, count, dtype, _WIDTHS[kind])
        else:
            rows = self._zeros(index, count, dtype, _WIDTHS[kind])
        return self._substituted(accessor, index, rows) if "sparse" in accessor else rows

    def _zeros(self, index: int, count: int, dtype: np.dtype, width: int) -> np.ndarray:
        if not 1 <= count <= self.most_rows:
            raise ReadError(
                f"a GLB accessor without data must have 1 to {self.most_rows} rows. "
                f"Got number {index} with {count}."
            )
        return np.zeros((count, width), dtype)

    def _rows(
        self, source: dict[str, Any], index: int, count: int, dtype: np.dtype, width: int
    ) -> np.ndarray:
        """Return a view of the rows that an accessor, or a part of a sparse one, has in the binary chunk."""
        view = item_at(self.document["bufferViews"], source["bufferView"])
        check_extensions(view, f"buffer view {source['bufferView']}")
        check_extensions(item_at(self.document["buffers"], 0), "buffer 0")
        if as_natural(view.get("buffer", 0)) != 0 or "uri" in self.document["buffers"][0]:
            raise ReadError(
                "a GLB file must hold its own data. "
                f"Got buffer view {source['bufferView']} elsewhere."
            )
        start = as_natural(source.get("byteOffset", 0))
        size = as_natural(view["byteLength"])
        offset = as_natural(view.get("byteOffset", 0))
        row = dtype.itemsize * width
        stride = as_natural(view.get("byteStride", row))
        outside = start + (count - 1) * stride + row > size or offset + size > len(self.binary)
        if count < 1 or stride < row or outside:
            raise ReadError(
                f"GLB accessors must lie inside the binary chunk. Got number {index} outside."
            )
        strides = (stride, dtype.itemsize)
        return np.ndarray((count, width), dtype, self.binary, offset + start, strides)

    def _substituted(self, accessor: dict[str, Any], index: int, rows: np.ndarray) -> np.ndarray:
        """Return the rows of a sparse accessor: those of its base, some of them replaced."""
        sparse = accessor["sparse"]
        count = as_natural(sparse["count"])
        component = sparse["indices"]["componentType"]
        if component not in _UNSIGNED:
            raise ReadError(
                "the indices of a sparse GLB accessor must be of a legal component type. "
                f"Got number {index}, whose are not."
            )
        for part in (sparse, sparse["indices"], sparse["values"]):
            check_extensions(part, f"accessor {index}")
        places = self._rows(sparse["indices"], index, count, np.dtype(_TYPES[component]), 1).ravel()
        values = self._rows(sparse["values"], index, count, rows.dtype, rows.shape[1])
        ascending = (places[1:] > places[:-1]).all()
        if not ascending or int(places[-1]) >= len(rows):
            raise ReadError(
                f"the indices of a sparse GLB accessor must ascend and be below {len(rows)}. "
                f"Got number {index}, whose do not."
            )
        whole = rows.copy()
        whole[places] = values
        return whole
