"""`aspectgraph dimensions`: a table, JSON, and one line for what has none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE

pytest.importorskip("OCP")

EXAMPLES = Path(__file__).parents[3] / "examples"
PART = str(EXAMPLES / "nist_ctc_01_ap242.stp")


def test_the_table_names_value_tolerance_and_entities(capsys):
    assert main(["dimensions", PART]) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "12 dimensions, 8 with a tolerance, 12 measurable: 12 characteristics"
    row = next(line for line in lines if "Linear Size.1 " in line)
    assert row.split()[2:9] == ["diameter", "35", "mm", "0/-0.2", "mm", "1", "r8"]
    assert "note: distance 1: the file states no nominal value; this is the geometry's" in lines


def test_json_is_a_list_of_records(capsys):
    assert main(["dimensions", PART, "--json"]) == DONE
    records = json.loads(capsys.readouterr().out)
    assert len(records) == 12
    assert records[3]["name"] == "Linear Size.1"
    assert (records[3]["nominal"], records[3]["unit"], records[3]["tolerance"]) == (
        35.0,
        "mm",
        [-0.2, 0.0],
    )
    assert all(set(record) == set(records[0]) for record in records)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "mfcad_6-11-11-19.step",
            "the part must be a STEP file with semantic dimensions (AP242). Got ",
        ),
        (
            "slotted_block.off",
            "dimensions are read from .step and .stp files. Got 'slotted_block.off'.",
        ),
        ("none.stp", "the part must be an existing file. Got "),
    ],
)
def test_what_has_no_dimensions_is_one_line(capsys, name, message):
    assert main(["dimensions", str(EXAMPLES / name)]) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"aspectgraph: {message}")
    assert len(err.splitlines()) == 1
