"""Writing files so that a reader never meets half of one: write beside the target, then rename."""

import os
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

from planner.exceptions import OutputError


def write_text(path, text: str) -> None:
    """Write a text file in UTF-8; it appears whole or not at all.

    Raises
    ------
    OutputError
        If the folder does not exist or cannot be written.
    """
    path = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    except OSError as error:
        raise OutputError(f"{path} must be in a folder that can be written. Got: {error.strerror}.") from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path} must be a file that can be written. Got: {error.strerror}.") from None
    finally:
        Path(temporary).unlink(missing_ok=True)


@contextmanager
def staged_folder(path):
    """Collect files in a hidden folder and move them into place only when the block ends without an exception.

    Yields
    ------
    pathlib.Path
        The folder to write into. Files already in ``path`` are replaced when their names agree, others stay.

    Raises
    ------
    OutputError
        If the folder cannot be made or written.
    """
    path = check_folder(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    try:
        yield staging
        _move_into(staging, path)
    except OSError as error:
        raise OutputError(f"{path} must be a folder that can be written. Got: {error.strerror or error}.") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def check_folder(path) -> Path:
    """Return the path if it is, or can become, a folder that can be written; nothing is created.

    Raises
    ------
    OutputError
        If it is a file or lies where nothing can be made.
    """
    path = Path(path).absolute()
    nearest = next(p for p in (path, *path.parents) if p.exists())
    if not nearest.is_dir():
        raise OutputError(f"output folder must be a folder. Got {path}: {nearest} is a file.")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise OutputError(
            f"output folder must be a folder that can be written. Got {path}: no permission in {nearest}."
        )
    return path


def _move_into(staging: Path, target: Path) -> None:
    target.mkdir(exist_ok=True)
    for source in sorted(staging.rglob("*")):
        place = target / source.relative_to(staging)
        if source.is_dir():
            place.mkdir(exist_ok=True)
        else:
            os.replace(source, place)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
