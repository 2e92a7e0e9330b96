"""Real parts: those among the examples, and larger ones in a folder that the variable ASPECTGRAPH_PARTS names."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "examples"


def real_part(name: str) -> Path:
    """Return the path of a part by its file name, compressed or not; skip the test if it is nowhere."""
    folders = [EXAMPLES]
    if os.environ.get("ASPECTGRAPH_PARTS"):
        folders.append(Path(os.environ["ASPECTGRAPH_PARTS"]))
    for folder in folders:
        for path in (folder / name, folder / f"{name}.gz"):
            if path.is_file():
                return path
    pytest.skip(f"{name} is not among the examples; name its folder with ASPECTGRAPH_PARTS")
