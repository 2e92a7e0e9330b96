"""Pictures of the notebooks for the documents: executes them, or those named, and stores one picture of each."""

from __future__ import annotations

import base64
import io
import shutil
import subprocess
import sys
import tempfile
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
    "measurement_error": 4,
    "showing": 0,
    "dimensions": 1,
    "measuring": 0,
    "robot_cell": 0,
    "tables_iii_iv": 2,
    "comparisons": 3,
    "cluster": 0,
}
WIDEST_PX = 1000
COLOURS = 96
SVG_PX = (900, 753)


def pictures(name: str) -> list[Image.Image]:
    """Execute a notebook and return its pictures in order."""
    book = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    NotebookClient(
        book, timeout=900, resources={"metadata": {"path": str(ROOT / "notebooks")}}
    ).execute()
    outputs: list[dict[str, Any]] = [
        one.get("data", {}) for cell in book.cells for one in cell.get("outputs", ())
    ]
    found = []
    for data in outputs:
        if "image/png" in data:
            found.append(Image.open(io.BytesIO(base64.b64decode(data["image/png"]))))
        elif "image/svg+xml" in data:
            found.append(drawn(data["image/svg+xml"]))
    return found


def drawn(svg: str) -> Image.Image:
    """Return a vector picture as Chromium draws it."""
    program = shutil.which("chromium") or "google-chrome"
    width, height = SVG_PX
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        shot = Path(folder) / "shot.png"
        page.write_text(
            f"<style>*{{margin:0}}svg{{display:block;width:{width}px}}</style>{svg}",
            encoding="utf-8",
        )
        switches = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            f"--user-data-dir={folder}/user",
        ]
        told = [f"--window-size={width},{height}", f"--screenshot={shot}", page.as_uri()]
        subprocess.run([program, *switches, *told], check=True, capture_output=True)
        return Image.open(shot).copy()


def small(picture: Image.Image) -> Image.Image:
    """Return a picture of few colours that is no wider than a page."""
    # transparent ones are drawn on white
    full = picture.convert("RGBA")
    plain = Image.alpha_composite(Image.new("RGBA", full.size, "white"), full).convert("RGB")
    plain.thumbnail((WIDEST_PX, 10 * WIDEST_PX))
    return plain.quantize(COLOURS)


def main(names: list[str]) -> None:
    """Write a picture of each notebook."""
    for name in names or CHOSEN:
        found = pictures(name)
        small(found[CHOSEN[name]]).save(Path(__file__).parent / f"{name}.png", optimize=True)
        print(f"{name}: picture {CHOSEN[name] + 1} of {len(found)}")


if __name__ == "__main__":
    main(sys.argv[1:])
