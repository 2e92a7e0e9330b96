"""Every notebook is a pair of a script to read and review and an ipynb to open, in step and without outputs.

`make test` executes them.
"""

from __future__ import annotations

from pathlib import Path

import pytest

jupytext = pytest.importorskip("jupytext")

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
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


def test_no_outputs_are_stored(pair):
    code = [cell for cell in pair[0].cells if cell.cell_type == "code"]
    assert [cell.outputs for cell in code] == [[]] * len(code)
    assert {cell.execution_count for cell in code} == {None}


def test_it_begins_with_a_title(pair):
    first = pair[0].cells[0]
    assert first.cell_type == "markdown"
    assert first.source.startswith("# ")
