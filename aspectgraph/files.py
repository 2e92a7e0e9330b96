"""Files that are written whole or not at all, read up to a limit, and digested."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from aspectgraph.exceptions import OutputError

# Files: written so that a reader never meets half of one, and read only up to a size.


SMALL_FILE_BYTES = 64_000_000
"""Most of a file that people write: names, dimensions, cameras, lamps. These have kilobytes."""
LARGE_FILE_BYTES = 1_000_000_000
"""Most of a file that the package writes: plans, states, graphs. Those of large parts have some ten megabytes."""

DEEPEST = 40
"""Most levels of tables and arrays in a file that people write. These have three."""
# a double has 1024 at most
_MOST_BITS = 1000


def read_text(
    path: str | os.PathLike[str],
    encoding: str = "utf-8",
    *,
    large: bool = False,
    newline: str | None = None,
) -> str:
    """Read a text file of a sensible size; no more of it is ever held.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    encoding : str, optional
    large : bool, optional
        Allow `LARGE_FILE_BYTES` instead of `SMALL_FILE_BYTES`.
    newline : str, optional
        As `open` takes it: with "", line ends stay as they are in the file.

    Raises
    ------
    OSError
        The file cannot be read, or is larger; `strerror` says so.
    UnicodeDecodeError
        It holds other bytes.
    """
    try:
        os.fsencode(path)
    except UnicodeEncodeError as error:
        raise OSError(errno.EINVAL, "half a character is no name of a file") from error
    with open(path, "rb") as file:
        return io.TextIOWrapper(
            io.BytesIO(up_to_limit(file, large=large)), encoding=encoding, newline=newline
        ).read()


def up_to_limit(file: IO[bytes], *, large: bool) -> bytes:
    """Return what an open file holds, or raise the `OSError` of :func:`read_text` if that is too much."""
    limit = LARGE_FILE_BYTES if large else SMALL_FILE_BYTES
    data = file.read(limit + 1)
    if len(data) > limit:
        raise OSError(errno.EFBIG, f"it has more than {limit / 1e6:g} MB")
    return data


def check_plain(value: object) -> None:
    """Refuse what no file of names or numbers needs, and what code that walks or prints values would fail at.

    Parameters
    ----------
    value : object
        What a TOML or JSON file holds. The walk does not recurse.

    Raises
    ------
    ValueError
        Tables or arrays are nested deeper than `DEEPEST`, or a whole number exceeds every floating-point number; the
        message is the reason alone.
    """
    level = [value]
    for _ in range(DEEPEST):
        below: list[object] = []
        for item in level:
            if isinstance(item, dict):
                below += item.values()
            elif isinstance(item, list):
                below += item
            elif isinstance(item, int) and item.bit_length() > _MOST_BITS:
                raise ValueError("it holds a number of too many digits")
        if not below:
            return
        level = below
    raise ValueError("it is nested too deep")


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Provide a path to write to; what is there moves to `path` when the block ends without an exception.

    What is no file, such as ``/dev/stdout``, is written to and stays what it is. Of a symbolic link, the link is
    replaced; the file it leads to stays as it is.

    Raises
    ------
    OutputError
        The folder does not exist, or the file cannot be written.
    """
    path = Path(path)
    written_to = is_device(path)
    try:
        check_replaceable(path)
        with tempfile.TemporaryDirectory() if written_to else nullcontext(path.parent) as folder:
            beside = Path(folder) / f".{path.name}.{os.getpid()}.part"
            try:
                yield beside
                if written_to:
                    pour(beside, path)
                else:
                    os.replace(beside, path)
            finally:
                with suppress(OSError):
                    beside.unlink()
    except OSError as error:
        reason = error.strerror or error
        raise OutputError.of_rule(
            "path", "must be a file that can be written", f"{str(path)!r}: {reason}"
        ) from error


def is_device(path: str | os.PathLike[str]) -> bool:
    """Tell whether a path is there, but neither a file nor a folder: a device or a pipe, which no file may replace."""
    try:
        kind = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(kind) or stat.S_ISDIR(kind))


def check_replaceable(path: str | os.PathLike[str]) -> None:
    """Refuse a file that is there and may not be replaced; a renaming would not ask, or fail after the work.

    Raises
    ------
    OSError
        Nobody may write it, as it is marked read-only, or as it is on a read-only mount or immutable.
    """
    # of a link what it is, and not what it leads to, is replaced
    if os.path.islink(path) or not os.path.isfile(path):
        return
    if not os.stat(path).st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(errno.EACCES, "it is marked read-only", str(path))
    try:
        # nothing is written, and no time changes
        os.close(os.open(path, os.O_WRONLY))
    except OSError as error:
        # who owns a folder may replace what others own in it
        if error.errno in (errno.EROFS, errno.EPERM):
            raise


def pour(source: str | os.PathLike[str], device: str | os.PathLike[str]) -> None:
    """Write what is in a file to a device or a pipe."""
    with open(source, "rb") as ours, open(device, "wb") as theirs:
        shutil.copyfileobj(ours, theirs)


# A digest of source files: what was computed by other code is told from what this code computes.


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
