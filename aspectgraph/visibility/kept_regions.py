"""Visible regions kept in files as they are computed, so that an interrupted computation goes on where it was.

One file per region, written whole or not at all. Its name is a digest of all that the region depends on, of the request
and of the entity, so a file is never taken for another request's. In it is a digest of these and of the region. What is
damaged, or no tree that compiled loops can walk, is computed again. A file beside them says which request they are of.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
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
_DIGEST = "digest"
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
                digest = str(data[_DIGEST])
                arrays = {field: data[field] for field in _FIELDS}
        except Exception:
            # NumPy raises whatever its parsers do where bytes are damaged: the region is computed
            return None
        if not _has_form(arrays) or digest != self._digest(name, arrays):
            return None
        if not _is_tree(arrays):
            return None
        tree = Tree(arrays["planes"], arrays["plane"], arrays["child"])
        return Region(tree, arrays["origin"], arrays["observable"])

    def put(self, name: str, region: Region) -> None:
        """Keep the region of an entity, if that is possible."""
        with suppress(OSError):
            self._make_folder()
            arrays: dict[str, Any] = {
                **region.tree._asdict(),
                "origin": region.origin,
                "observable": region.observable,
            }
            arrays[_DIGEST] = np.array(self._digest(name, arrays))
            with _written_whole(self._path(name)) as file:
                np.savez(file, **arrays)

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

    def _digest(self, name: str, arrays: Mapping[str, np.ndarray]) -> str:
        """Return the digest of a region, of what it depends on, and of its name."""
        digest = hashlib.sha256(self._request + name.encode("utf-8", "surrogatepass"))
        for field in _FIELDS:
            array = np.ascontiguousarray(arrays[field])
            digest.update(f"{field} {array.dtype.str} {array.shape}".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def _path(self, name: str) -> Path:
        text = name.encode("utf-8", "surrogatepass")
        return self.folder / f"{hashlib.sha256(self._request + text).hexdigest()[:40]}.npz"


def _has_form(arrays: Mapping[str, np.ndarray]) -> bool:
    """Return whether arrays have the types and axes of a region."""
    return all(
        arrays[field].dtype == kind and arrays[field].ndim == axes
        for field, (kind, axes) in _FIELDS.items()
    )


def _is_tree(arrays: Mapping[str, np.ndarray]) -> bool:
    """Return whether arrays are a binary tree with planes, so that compiled loops stay within them, and end.

    Each node has two children or none. A child comes after its parent, and has one parent.
    """
    planes = arrays["planes"]
    plane = arrays["plane"]
    child = arrays["child"]
    n = len(plane)
    shapes = {
        "planes": (len(planes), 4),
        "plane": (n,),
        "child": (n, 2),
        "origin": (len(planes), 4),
        "observable": (n,),
    }
    if n == 0 or any(arrays[field].shape != shape for field, shape in shapes.items()):
        return False
    inner = np.flatnonzero(plane >= 0)
    children = child[inner]
    in_range = bool((plane >= -1).all() and (plane < len(planes)).all())
    later = bool((children > inner[:, None]).all() and (children < n).all())
    return in_range and later and len(np.unique(children)) == children.size


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
