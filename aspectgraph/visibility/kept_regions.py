"""Visible regions kept in files as they are computed, so that an interrupted computation goes on where it was.

One file per region, written whole or not at all. Its name is a digest of all that the region depends on and of the
entity, so a file is never taken for another request's. What is damaged is computed again.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from aspectgraph.cells.point_location import Tree
from aspectgraph.visibility.entity_region import Region

if TYPE_CHECKING:
    from aspectgraph.entities.straight_edges import Entity
    from aspectgraph.solid.solid import Solid

_FIELDS = {
    "planes": (np.int64, 2),
    "plane": (np.int32, 1),
    "child": (np.int32, 2),
    "origin": (np.int32, 2),
    "observable": (np.bool_, 1),
}


class RegionStore(Protocol):
    """What is told of regions as they are computed, and may know some of them; an error it raises ends the work."""

    def begin(self, solid: Solid, box_mm: np.ndarray, entities: Mapping[str, Entity]) -> None:
        """Say what the regions depend on: part, workspace, and all entities."""

    def get(self, name: str) -> Region | None:
        """Return the region of an entity, if it is known."""

    def put(self, name: str, region: Region) -> None:
        """Take the region of an entity."""


class KeptRegions:
    """A folder of regions.

    Parameters
    ----------
    folder : path
        It is made with the first region. What cannot be written is not kept, and computed again another time.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self._request = b""

    def __bool__(self) -> bool:
        """Whether there are any files, of whatever request."""
        return self.folder.is_dir() and any(self.folder.iterdir())

    def begin(self, solid: Solid, box_mm: np.ndarray, entities: Mapping[str, Entity]) -> None:
        """Say what the regions depend on: part, workspace, all entities, as they share a grid, and the program."""
        digest = hashlib.sha256(_program().encode())
        for array in (solid.vertices, solid.triangles, box_mm):
            digest.update(np.ascontiguousarray(array).tobytes())
        for name, entity in entities.items():
            digest.update(
                repr((name, entity.kind, tuple(entity.edge_ids))).encode("utf-8", "surrogatepass")
            )
            digest.update(np.ascontiguousarray(entity.points, dtype=np.float64).tobytes())
        self._request = digest.digest()

    def get(self, name: str) -> Region | None:
        """Return the region of an entity, or None if there is none, or none that can be read."""
        try:
            with self._path(name).open("rb") as file, np.load(file, allow_pickle=False) as data:
                arrays = {field: data[field] for field in _FIELDS}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        for field, (kind, axes) in _FIELDS.items():
            if arrays[field].dtype != kind or arrays[field].ndim != axes:
                return None
        tree = Tree(arrays["planes"], arrays["plane"], arrays["child"])
        return Region(tree, arrays["origin"], arrays["observable"])

    def put(self, name: str, region: Region) -> None:
        """Keep the region of an entity, if that is possible."""
        temporary = None
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=self.folder)
            with os.fdopen(handle, "wb") as file:
                np.savez(
                    file,
                    **region.tree._asdict(),
                    origin=region.origin,
                    observable=region.observable,
                )
            os.replace(temporary, self._path(name))
        except OSError:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)

    def remove(self) -> None:
        """Delete the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, name: str) -> Path:
        text = name.encode("utf-8", "surrogatepass")
        return self.folder / f"{hashlib.sha256(self._request + text).hexdigest()[:40]}.npz"


def _program() -> str:
    try:
        return version("aspectgraph")
    except PackageNotFoundError:
        return "unknown"
