from pathlib import Path

import jupytext
import pytest

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "measurement_error.ipynb"


def test_the_pair_is_in_step():
    paired = [jupytext.read(path) for path in (NOTEBOOK, NOTEBOOK.with_suffix(".py"))]
    cells = [[(cell.cell_type, cell.source) for cell in notebook.cells] for notebook in paired]
    assert len(cells[0]) > 10
    assert cells[0] == cells[1]


def test_the_notebook_is_stored_without_outputs():
    cells = jupytext.read(NOTEBOOK).cells
    assert not any(cell.get("outputs") for cell in cells)


@pytest.mark.parametrize("figure", ["Fig. 2", "Fig. 4", "Fig. 7"])
def test_the_papers_figures_are_drawn(figure):
    code = [cell.source for cell in jupytext.read(NOTEBOOK).cells if cell.cell_type == "code"]
    assert sum(f'suptitle("{figure}' in source for source in code) == 1
