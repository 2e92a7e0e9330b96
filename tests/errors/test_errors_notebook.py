import re
from pathlib import Path

import jupytext
import pytest

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "measurement_error.ipynb"


@pytest.mark.parametrize("figure", ["Fig. 2", "Fig. 4", "Fig. 7"])
def test_the_papers_figures_are_drawn(figure):
    code = [cell.source for cell in jupytext.read(NOTEBOOK).cells if cell.cell_type == "code"]
    assert sum(bool(re.search(rf'suptitle\(\s*"{figure}', source)) for source in code) == 1
