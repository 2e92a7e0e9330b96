"""The table of all parts."""

import csv
import json

from planner.app.batch import PLANNED, REFUSED, PartResult, write_tables


def result(part, status=PLANNED, reason=""):
    return PartResult(part, status, reason, 1, 1, 1, 0.5, "ab", "cd", "ef")


def test_no_spreadsheet_runs_the_name_of_a_file(tmp_path):
    names = ["+1.off", "-1.off", "=SUM(1).off", "@a.off", "a\rb.off", "b.off"]
    write_tables([result(name) for name in names] + [result("c", REFUSED, "=1: no")], tmp_path)
    with open(tmp_path / "results.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    shown = ["'+1.off", "'-1.off", "'=SUM(1).off", "'@a.off", "a\rb.off", "b.off", "c"]
    assert [row["part"] for row in rows] == shown
    assert rows[-1]["reason"] == "'=1: no"
    assert [row["seconds"] for row in rows] == ["0.5"] * 7
    # JSON has the names themselves
    parts = [row["part"] for row in json.loads((tmp_path / "results.json").read_text())]
    assert parts == [*names, "c"]
