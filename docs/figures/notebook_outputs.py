"""Execute the notebooks, or those named, and store them with small outputs: a browser shows these.

Run from anywhere after editing a script of `notebooks/`, or code whose output a notebook shows. Pictures get few
colours, and the data of interactive figures is left out. A digest of the code is stored, so that a test notices
outputs that are older than the cells. With `--text` only the text between the cells is taken from the scripts.
"""

from __future__ import annotations

import base64
import hashlib
import io
import sys
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from nbclient import NotebookClient
from PIL import Image

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
WIDEST_PX = 1000
COLOURS = 64
SECONDS = 3600
# they repeat a picture as data for a script, and a script is not run where notebooks are only shown
INTERACTIVE = ("application/vnd.plotly.v1+json", "application/javascript")
LEFT_OUT = "An interactive 3-D view. Run this cell to see it."
DIGEST = "outputs_of"
# what Open3D prints at its import in a notebook
NOISE = ("Jupyter environment detected", "[Open3D INFO]")


def sources_digest(book: Any) -> str:
    """Return a digest of the code of a notebook."""
    code = "\0".join(cell.source for cell in book.cells if cell.cell_type == "code")
    return hashlib.sha256(code.encode()).hexdigest()


def small_png(data: str) -> str:
    """Return a picture with few colours that is no wider than a page."""
    full = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA")
    plain = Image.alpha_composite(Image.new("RGBA", full.size, "white"), full).convert("RGB")
    plain.thumbnail((WIDEST_PX, 10 * WIDEST_PX))
    file = io.BytesIO()
    plain.quantize(COLOURS).save(file, "PNG", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


def make_small(book: Any) -> None:
    """Leave out of the outputs what a page does not show, and what differs from run to run."""
    for cell in book.cells:
        # times of execution
        cell.metadata.pop("execution", None)
        outputs = []
        for output in cell.get("outputs", ()):
            if output.get("name") == "stderr":
                continue
            if "text" in output:
                lines = output.text.splitlines(keepends=True)
                output.text = "".join(line for line in lines if not line.startswith(NOISE))
                if not output.text:
                    continue
            data = output.get("data", {})
            for kind in INTERACTIVE:
                data.pop(kind, None)
            if "image/png" in data:
                data["image/png"] = small_png(data["image/png"])
            if "text/html" in data and "<script" in data["text/html"]:
                del data["text/html"]
            if "data" in output and not data:
                data["text/plain"] = LEFT_OUT
            outputs.append(output)
        if cell.cell_type == "code":
            cell.outputs = outputs


def executed(book: Any) -> Any:
    """Return a notebook with its outputs."""
    places = {"metadata": {"path": str(NOTEBOOKS)}}
    return NotebookClient(book, timeout=SECONDS, resources=places).execute()


def with_text_of(book: Any, script: Any) -> Any:
    """Return the cells of a script with the outputs of a notebook that has the same code."""
    if book.metadata.get(DIGEST) != sources_digest(script):
        raise ValueError("the code of the script is not that of the outputs: run without --text")
    outputs = [cell for cell in book.cells if cell.cell_type == "code"]
    texts = [cell for cell in script.cells if cell.cell_type == "code"]
    for old, new in zip(outputs, texts, strict=True):
        new.outputs = old.outputs
        new.execution_count = old.execution_count
    return script


def store(name: str, text_only: bool) -> None:
    """Execute a notebook, or take the text of its script, and store it."""
    path = NOTEBOOKS / f"{name}.ipynb"
    book = jupytext.read(path)
    # the script is what people edit
    script = jupytext.read(path.with_suffix(".py"))
    script.metadata = book.metadata
    book = with_text_of(book, script) if text_only else executed(script)
    make_small(book)
    book.metadata[DIGEST] = sources_digest(book)
    # the version of Python that executed it is of no interest
    book.metadata.pop("language_info", None)
    for number, cell in enumerate(book.cells):
        cell["id"] = f"{name}-{number}".replace("_", "-")
    nbformat.write(book, path)
    print(f"{name}: {path.stat().st_size / 1000:.0f} kB", flush=True)


def main(words: list[str]) -> None:
    """Store the notebooks that are named, or all."""
    names = [word for word in words if word != "--text"]
    for name in names or sorted(path.stem for path in NOTEBOOKS.glob("*.py")):
        store(name, "--text" in words)


if __name__ == "__main__":
    main(sys.argv[1:])
