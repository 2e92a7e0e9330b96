"""What `make coverage` says of lines and branches."""

import importlib.util
import json
from pathlib import Path

import pytest

spec = importlib.util.spec_from_file_location(
    "covered", Path(__file__).parents[1] / ".ci" / "covered.py"
)
covered = importlib.util.module_from_spec(spec)
spec.loader.exec_module(covered)


@pytest.mark.parametrize(
    ("lines", "branches", "code", "words"),
    [
        (950, 90, 0, "95.0 % of lines, 90.0 % of branches"),
        (949, 100, 1, "94.9 % of lines, 100.0 % of branches"),
        (1000, 89, 1, "100.0 % of lines, 89.0 % of branches"),
    ],
)
def test_lines_and_branches_are_each_compared_with_their_own_limit(
    lines, branches, code, words, capsys
):
    totals = {
        "covered_lines": lines,
        "num_statements": 1000,
        "covered_branches": branches,
        "num_branches": 100,
    }
    assert covered.main(json.dumps({"totals": totals})) == code
    out, err = capsys.readouterr()
    assert out == f"covered: {words}\n"
    assert err.count("must be run") == code
