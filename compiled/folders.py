"""Folders in which machine code can be kept: beside the source, in the user's cache, or in a temporary folder.

Machine code runs when it is read. So no folder is used into which another user could put some, see `is_trusted`.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

_TEMPORARY = "aspectgraph-loops"
_PRIVATE = 0o700
_READABLE = 0o755


def folders_for(source: Path) -> Iterator[Path]:
    """Yield the folders for the machine code of a source file, the best first; none is made.

    Those into which others could put code are left out. ``NUMBA_CACHE_DIR`` is the first where it is set, and the only
    one where it can be written. Next come ``__pycache__`` beside the source, the user's cache folder and a temporary
    folder of the user.

    Parameters
    ----------
    source : Path
        The file that defines the loops.

    Yields
    ------
    Path
        An absolute path.
    """
    chosen = chosen_folder()
    if chosen is not None and is_trusted(chosen, source):
        folder = chosen / _name_of(source)
        yield folder
        if is_writable(folder):
            return
    user = _user_cache()
    temporary = temporary_folder()
    places = [source.parent / "__pycache__"]
    if user is not None:
        places.append(user / "aspectgraph" / _name_of(source))
    if temporary is not None:
        places.append(temporary / _name_of(source))
    yield from (folder for folder in places if is_trusted(folder, source))


def is_trusted(path: Path, source: Path) -> bool:
    """Return whether nobody else can put machine code into a folder, or replace a file.

    It, all that it is in, and all links to it must belong to this user, to the system, or to whoever owns the source,
    as that runs as well. Others must not write there. In a folder above it they may, if they can rename nothing of
    others there, as in ``/tmp``.

    Parameters
    ----------
    path : Path
        The folder or file; what is not there yet is made by this user.
    source : Path
        The file that defines the loops.
    """
    if not hasattr(os, "getuid"):
        # Windows: the folders that are looked at belong to one user
        return True
    try:
        owners = {0, os.getuid(), Path("/").stat().st_uid, source.stat().st_uid}
    except OSError:
        owners = {0, os.getuid()}
    path = path.absolute()
    try:
        return all(_is_safe(way, owners) for way in {path, path.resolve()})
    except (OSError, RuntimeError):
        # such as a circle of links
        return False


def _is_safe(path: Path, owners: set[int]) -> bool:
    """Return whether only these users can change a path that may have links in it."""
    for place in (path, *path.parents):
        try:
            status = place.lstat()
        except (FileNotFoundError, NotADirectoryError):
            continue
        if status.st_uid not in owners:
            return False
        # who may write to a link is not told by its mode
        is_open = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not stat.S_ISLNK(
            status.st_mode
        )
        is_sticky = place != path and status.st_mode & stat.S_ISVTX
        if is_open and not is_sticky:
            return False
    return True


def chosen_folder() -> Path | None:
    """Return the folder that numba's settings name; before numba is loaded, which takes long, the environment's."""
    config = sys.modules.get("numba.core.config")
    if config is None:
        name = os.environ.get("NUMBA_CACHE_DIR", "")
    else:
        name = str(getattr(config, "CACHE_DIR", ""))
    return Path(name).absolute() if name else None


def temporary_folder() -> Path | None:
    """Return the user's temporary folder for machine code; none where others could write it.

    Machine code runs when it is read, so only a folder that belongs to this user alone will do.
    """
    try:
        parent = Path(tempfile.gettempdir())
    except OSError:
        return None
    if not hasattr(os, "getuid"):
        # Windows: the folder for temporary files belongs to one user
        return parent / _TEMPORARY
    try:
        folder = parent / f"{_TEMPORARY}-{os.getuid()}"
        return folder if is_trusted(folder, folder) and _is_private(folder) else None
    except OSError:
        return None


def make_folder(folder: Path) -> None:
    """Make a folder; the temporary one, and what is in it, for this user only.

    Raises
    ------
    OSError
        If it cannot be made, or is the temporary folder and not private.
    """
    temporary = temporary_folder()
    if temporary is not None and temporary in folder.parents:
        temporary.mkdir(mode=_PRIVATE, exist_ok=True)
        # somebody else may have made it meanwhile
        if hasattr(os, "getuid") and not _is_private(temporary):
            raise PermissionError(f"{temporary} must belong to this user only")
        folder.mkdir(mode=_PRIVATE, exist_ok=True)
        return
    for place in (*reversed(folder.parents), folder):
        # whatever the user's mask says: nobody else may write there
        place.mkdir(mode=_READABLE, exist_ok=True)


def is_temporary(folder: Path) -> bool:
    """Return whether a folder is in the temporary one, which the system may empty."""
    return any(parent.name.startswith(_TEMPORARY) for parent in folder.parents)


def is_writable(folder: Path) -> bool:
    """Return whether files can be made in a folder that is there, or that could be made."""
    for place in (folder, *folder.parents):
        if os.path.lexists(place):
            return place.is_dir() and os.access(place, os.W_OK | os.X_OK)
    return False


def can_keep(source: Path) -> bool:
    """Return whether any folder seems to take the machine code of a source file."""
    return any(is_writable(folder) for folder in folders_for(source))


def _name_of(source: Path) -> str:
    """Return a folder name for the folder of a source file: two copies of the sources do not share one."""
    folder = source.absolute().parent
    return f"{folder.name}_{hashlib.sha256(os.fsencode(folder)).hexdigest()[:32]}"


def _user_cache() -> Path | None:
    """Return the user's cache folder; None for a user without a home."""
    if sys.platform == "win32":
        named = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        named = os.path.expanduser("~/Library/Caches")
    else:
        named = os.environ.get("XDG_CACHE_HOME", "") or os.path.expanduser("~/.cache")
    # an unknown user's ~ stays as it is, and would be a folder of the current one
    return Path(named) if os.path.isabs(named) else None


def _is_private(folder: Path) -> bool:
    """Return whether a folder is not there yet, or is this user's, and no link."""
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return True
    ours = status.st_uid == os.getuid()
    return stat.S_ISDIR(status.st_mode) and ours and not status.st_mode & 0o077
