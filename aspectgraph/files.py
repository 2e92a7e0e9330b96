"""Writing files so that a reader never meets half of one: write beside the place, then rename."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from aspectgraph.exceptions import OutputError


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Provide a path to write to; what is there moves to `path` when the block ends without an exception.

    Raises
    ------
    OutputError
        The folder does not exist, or the file cannot be written.
    """
    path = Path(path)
    beside = path.parent / f".{path.name}.{os.getpid()}.part"
    try:
        yield beside
        os.replace(beside, path)
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(f"path must be a file that can be written. Got {str(path)!r}: {reason}.") from error
    finally:
        with suppress(OSError):
            beside.unlink()
