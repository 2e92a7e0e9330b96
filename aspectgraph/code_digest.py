"""A digest of source files: what was computed by other code is told from what this code computes."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path


@cache
def code_digest(packages: Sequence[str], without: Sequence[str] = ()) -> str:
    """Return a digest of the Python files of packages.

    Parameters
    ----------
    packages : tuple of str
        Names of packages.
    without : tuple of str
        Names of packages or modules in them that decide about no result.

    Returns
    -------
    str
        64 hexadecimal digits. Where the files cannot be read, that of the program's version.
    """
    digest = hashlib.sha256()
    left_out = [name.replace(".", "/") for name in without]
    read = 0
    for package in packages:
        spec = find_spec(package)
        for folder in () if spec is None else map(Path, spec.submodule_search_locations or ()):
            for path in sorted(folder.rglob("*.py")):
                name = f"{package}/{path.relative_to(folder).as_posix()}"
                if any(f"{name[:-3]}/".startswith(f"{place}/") for place in left_out):
                    continue
                digest.update(f"{name}\0".encode())
                digest.update(hashlib.sha256(path.read_bytes()).digest())
                read += 1
    if read == 0:
        digest.update(_version().encode())
    return digest.hexdigest()


def _version() -> str:
    try:
        return version("aspectgraph")
    except PackageNotFoundError:
        return "unknown"
