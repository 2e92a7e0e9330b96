"""Visible regions kept in files as they are computed, so that an interrupted computation goes on where it was.

One file per region, written whole or not at all. Its name is a digest of all that the region depends on, of the request
and of the entity, so a file is never taken for another request's. What is damaged is computed again. A file beside them
says which request they are of.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Protocol

import numpy as np

from aspectgraph.cells.point_location import Tree
from aspectgraph.code_digest import code_digest
from aspectgraph.visibility.entity_region import Region

if TYPE_CHECKING:
    from aspectgraph.entities.straight_edges import Entity
    from aspectgraph.solid.solid import Solid

OWNER_FILE = "request.json"
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
        It is made with the first region. What cannot be written is not kept, and computed again another time; nor is
        anything read or written through a link in its place.
    request : mapping, optional
        What the regions are computed for, as plain values. Those of another request are not taken.
    """

    def __init__(
        self, folder: str | os.PathLike[str], request: Mapping[str, Any] | None = None
    ) -> None:
        self.folder = Path(folder)
        self._owner = "" if request is None else json.dumps(request, sort_keys=True)
        self._request = b""

    def __bool__(self) -> bool:
        """Whether there are any files, of whatever request."""
        return self.is_own_folder and any(self.folder.iterdir())

    @property
    def is_own_folder(self) -> bool:
        """Whether the folder is there, and no link to another one."""
        return self.folder.is_dir() and not self.folder.is_symlink()

    def owner(self) -> dict[str, Any] | None:
        """Return the request that the folder's regions are of, or None if nothing says so."""
        try:
            owner = json.loads((self.folder / OWNER_FILE).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return owner if isinstance(owner, dict) else None

    def begin(self, solid: Solid, box_mm: np.ndarray, entities: Mapping[str, Entity]) -> None:
        """Say what the regions depend on: part, workspace, all entities, as they share a grid, and the program."""
        digest = hashlib.sha256(code_digest(("aspectgraph",)).encode())
        digest.update(self._owner.encode("utf-8", "surrogatepass"))
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
        if not self.is_own_folder:
            return None
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
        with suppress(OSError):
            self._make_folder()
            with _written_whole(self._path(name)) as file:
                np.savez(
                    file,
                    **region.tree._asdict(),
                    origin=region.origin,
                    observable=region.observable,
                )

    def _make_folder(self) -> None:
        """Make the folder, if need be, and say whose it is before there is a region."""
        if self.folder.is_symlink():
            raise NotADirectoryError
        self.folder.mkdir(parents=True, exist_ok=True)
        owner = self.folder / OWNER_FILE
        if self._owner and not owner.exists():
            with _written_whole(owner) as file:
                file.write(self._owner.encode("utf-8", "surrogatepass"))

    def remove(self) -> None:
        """Delete the folder; of a link in its place nothing but the link."""
        if self.folder.is_symlink():
            with suppress(OSError):
                self.folder.unlink()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, name: str) -> Path:
        text = name.encode("utf-8", "surrogatepass")
        return self.folder / f"{hashlib.sha256(self._request + text).hexdigest()[:40]}.npz"


@contextmanager
def _written_whole(path: Path) -> Iterator[IO[bytes]]:
    """Open a file that appears under its name when the block ends, or not at all."""
    handle, temporary = tempfile.mkstemp(dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)
