"""Every notebook is a pair of a script to review and an ipynb to open, in step, with small outputs for a browser.

`make test` executes them. `docs/figures/notebook_outputs.py` stores the outputs.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

jupytext = pytest.importorskip("jupytext")

ROOT = Path(__file__).parents[1]
NOTEBOOKS = ROOT / "notebooks"
MOST_BYTES = 2_000_000
spec = importlib.util.spec_from_file_location(
    "notebook_outputs", ROOT / "docs/figures/notebook_outputs.py"
)
OUTPUTS = importlib.util.module_from_spec(spec)
spec.loader.exec_module(OUTPUTS)
NAMES = sorted({path.stem for path in NOTEBOOKS.glob("*") if path.suffix in (".py", ".ipynb")})


def test_there_are_notebooks():
    assert {"measurement_error", "slotted_block"} <= set(NAMES)


@pytest.fixture(params=NAMES)
def pair(request):
    paths = [NOTEBOOKS / f"{request.param}{suffix}" for suffix in (".ipynb", ".py")]
    assert all(path.is_file() for path in paths)
    return [jupytext.read(path) for path in paths]


def test_the_pair_is_in_step(pair):
    opened, script = (
        [(cell.cell_type, cell.source) for cell in notebook.cells] for notebook in pair
    )
    assert opened == script
    assert len(opened) > 3


def test_the_pair_is_declared(pair):
    assert [notebook.metadata.jupytext["formats"] for notebook in pair] == ["ipynb,py:percent"] * 2


def test_outputs_are_stored_for_the_code_as_it_is(pair):
    """If this fails, run docs/figures/notebook_outputs.py with the name of the notebook."""
    opened, script = pair
    assert opened.metadata[OUTPUTS.DIGEST] == OUTPUTS.sources_digest(script)
    code = [cell for cell in opened.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell.outputs]
    assert outputs
    assert {output.output_type for output in outputs} <= {
        "stream",
        "display_data",
        "execute_result",
    }
    # what an interactive view leaves out is said instead
    assert all(output.data for output in outputs if "data" in output)
    assert any(
        "image/png" in o.get("data", {}) or "image/svg+xml" in o.get("data", {}) for o in outputs
    )


def test_outputs_hold_nothing_of_the_machine(pair):
    text = str([cell.get("outputs") for cell in pair[0].cells])
    assert str(Path.home()) + "/" not in text
    assert not [word for word in ("/tmp/", "/work/", "Traceback", "Open3D INFO") if word in text]


def test_notebooks_are_small_together():
    assert sum(path.stat().st_size for path in NOTEBOOKS.glob("*.ipynb")) < MOST_BYTES


def test_it_begins_with_a_title(pair):
    first = pair[0].cells[0]
    assert first.cell_type == "markdown"
    assert first.source.startswith("# ")
