"""A pipe with a name that is read while something is written to it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def read_while(pipe: Path) -> Iterator[list[str]]:
    """Read a pipe in the background; after the block the list holds what came."""
    got: list[str] = []
    reader = threading.Thread(
        target=lambda: got.append(pipe.read_text(encoding="utf-8")), daemon=True
    )
    reader.start()
    yield got
    reader.join(60.0)
