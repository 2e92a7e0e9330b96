"""Pictures of the notebooks for the documents: executes them, or those named, and stores one picture of each."""

from __future__ import annotations

import base64
import io
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).parents[2]
# which picture of each, counted from its beginning
CHOSEN = {
    "quick_start": 0,
    "graph_analysis": 0,
    "slotted_block": 0,
    "measurement_error": 0,
    "showing": 0,
    "dimensions": 0,
    "tables_iii_iv": 0,
    "comparisons": 0,
}
WIDEST_PX, COLOURS = 1200, 128


def pictures(name: str) -> list[Image.Image]:
    """Execute a notebook and return its pictures in order."""
    book = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    NotebookClient(book, timeout=600, resources={"metadata": {"path": str(ROOT / "notebooks")}}).execute()
    found: list[dict[str, Any]] = [
        one.data for cell in book.cells for one in cell.get("outputs", ()) if "image/png" in one.get("data", {})
    ]
    return [Image.open(io.BytesIO(base64.b64decode(data["image/png"]))) for data in found]


def small(picture: Image.Image) -> Image.Image:
    """Return a picture of few colours that is no wider than a page."""
    picture.thumbnail((WIDEST_PX, 10 * WIDEST_PX))
    return picture.convert("RGB").quantize(COLOURS)


def main(names: list[str]) -> None:
    """Write a picture of each notebook."""
    for name in names or CHOSEN:
        found = pictures(name)
        small(found[CHOSEN[name]]).save(Path(__file__).parent / f"{name}.png", optimize=True)
        print(f"{name}: picture {CHOSEN[name] + 1} of {len(found)}")


if __name__ == "__main__":
    main(sys.argv[1:])
