"""`aspectgraph optics`: the table, its records, and what it says when nothing can do it."""

import json
from pathlib import Path

from planner.cli.main import main
from planner.cli.process.exit_codes import BAD_INPUT, DONE, INCOMPLETE

BLOCK = str(Path(__file__).parents[3] / "examples" / "two_pocket_block.off")
EDGE = "(60,20,10)-(60,40,10)"
OPTICS = [
    "optics",
    BLOCK,
    "--entities",
    EDGE,
    "--body",
    "basler-acA2440-20gm",
    "--distances",
    "250,400",
]
SURE = ["--sigma-mm", "0.05", "--sigma-rad", "0.001"]


def test_table_of_optics(capsys):
    assert main([*OPTICS, *SURE, "--rows", "2"]) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:4] == ["items", "U/error", "body", "lens"]
    assert [line.split()[0] for line in lines[1:3]] == ["1/1", "1/1"]
    assert float(lines[1].split()[1]) <= float(lines[2].split()[1])
    assert lines[3].startswith("note: OFF files state no unit")


def test_records_of_optics(capsys):
    assert main([*OPTICS, *SURE, "--rows", "3", "--json"]) == DONE
    records = json.loads(capsys.readouterr().out)
    assert len(records) == 3
    for one in records:
        assert one["body"] == "basler-acA2440-20gm"
        assert one["camera"]["focus_distance_mm"] in (250.0, 400.0)
        assert [*one["probability"]] == one["able"]


def test_nothing_can_do_it(capsys):
    # no image of 20 mm has 5000 px on a sensor of 2448
    assert main([*OPTICS, *SURE, "--min-length-px", "5000"]) == INCOMPLETE
    assert "0/1" in capsys.readouterr().out


def test_unknown_bodies_and_distances_are_refused(capsys):
    assert main([*OPTICS, "--body", "box"]) == BAD_INPUT
    assert "bodies must be of the catalogue" in capsys.readouterr().err
    assert main([*OPTICS, "--distances", "near"]) == BAD_INPUT
    assert "must be numbers like 250,400. Got 'near'" in capsys.readouterr().err
    assert main([*OPTICS, "--rows", "0"]) == BAD_INPUT
    assert "--rows must be at least 1" in capsys.readouterr().err
