"""The command ``reach``: tables, exit codes, and what it refuses."""

import json
from pathlib import Path

import pytest
from robot_cells import ROBOTS

from planner.cli.main import main

EXAMPLES = ROBOTS.parent
PLAN = str(EXAMPLES / "two_pocket_block_plan.json")
PART = str(EXAMPLES / "two_pocket_block.off")
CELL = """
cam2flange = {{ xyz = [0, 0, 90] }}
[robot]
urdf = "{robots}/made_parallel.urdf"
packages = {{ made_robots = "{robots}" }}
[[camera_body]]
low = [-30, -30, -90]
high = [30, 30, 0]
[fixturings.up]
part2base = {{ xyz = [{x}, 0, {z}] }}
[fixturings.up.obstacles.table]
low = [300, -500, -100]
high = [1300, 500, 0]
"""


def cell_file(folder, x=600, z=0):
    path = folder / "cell.toml"
    path.write_text(CELL.format(robots=ROBOTS, x=x, z=z), encoding="utf-8")
    return str(path)


def test_a_plan_that_is_reached(tmp_path, capsys):
    assert main(["reach", PLAN, PART, "--cell", cell_file(tmp_path)]) == 0
    printed = capsys.readouterr().out
    count = len(json.loads(Path(PLAN).read_text("utf-8"))["settings"])
    assert f"{count} of {count} settings reached: {count} in 'up'" in printed
    assert "setting_01 in 'up': tool0 at (" in printed
    assert "Joints in degrees, by 'made_parallel'" in printed
    assert (
        "not compared, because the arm is built so: link_3 and link_5, link_4 and link_6" in printed
    )


def test_a_plan_that_is_not(tmp_path, capsys):
    assert main(["reach", PLAN, PART, "--cell", cell_file(tmp_path, x=2500)]) == 1
    printed = capsys.readouterr().out
    assert "'up' reaches nothing; most often: beyond the arm's reach" in printed


def test_records_for_other_programs(tmp_path, capsys):
    assert main(["reach", PLAN, PART, "--cell", cell_file(tmp_path), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert len(record["setting_01"]["up"]["joints_rad"]) == 6


def test_places_to_put_the_part(tmp_path, capsys):
    words = ["reach", PLAN, PART, "--cell", cell_file(tmp_path, x=2500), "--place", "--quiet"]
    assert main([*words, "--draws", "15", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found[0]["reached"] >= found[-1]["reached"]
    box = ["--within", "600", "-10", "20", "620", "10", "20"]
    assert main([*words, "--draws", "3", *box]) == 0
    printed = capsys.readouterr().out
    assert "part2base = [[" in printed
    assert "# up" in printed
    outside = ["--within", "4000", "0", "20", "4010", "1", "20"]
    assert main([*words, "--draws", "2", *outside]) == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([PLAN, PART], "--cell must be given"),
        ([PLAN, PART, "--cell", "none.toml"], "--cell must be an existing file. Got 'none.toml'"),
        ([PLAN, "none.off", "--cell", "CELL"], "the part must be an existing file"),
        (["none", PART, "--cell", "CELL"], "the plan must be an existing plan file"),
        (
            [PLAN, PART, "--cell", "CELL", "--within", *"123456"],
            "--within must be given with --place",
        ),
        ([PLAN, PART, "--cell", "THROUGH"], "30 mm deep in table"),
        ([PLAN, PART, "--cell", PART], "cell file must be TOML"),
        (
            [PLAN, PART, "--cell", "CELL", "--place", "--within", *"623451"],
            "--within must be finite, lower corner first",
        ),
    ],
)
def test_bad_input_is_one_line(words, message, tmp_path, capsys):
    places = {"CELL": cell_file(tmp_path)}
    if "THROUGH" in words:
        places["THROUGH"] = cell_file(tmp_path, z=-30)
    words = [places.get(word, word) for word in words]
    try:
        code = main(["reach", *words])
    except SystemExit as error:
        code = error.code
    assert code == 2
    told = capsys.readouterr().err
    assert message in told
    assert len(told.strip().splitlines()) == 1


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """Return a folder with a plan for a cell, and the cell's file."""
    folder = tmp_path_factory.mktemp("planned")
    path = cell_file(folder)
    words = ["--entities", "17", "--camera", "basler-acA2440-20gm-8mm", "--accuracy", "0.98"]
    words += ["--effort", "quick", "--simulate", "1000", "--jobs", "1", "--quiet"]
    out = str(folder / "plan")
    assert main(["plan", PART, *words, "--cell", path, "--out", out]) == 0
    return out, path


def test_a_plan_for_a_cell_is_reached(planned, capsys):
    out, path = planned
    plan = json.loads(Path(out, "plan.json").read_text("utf-8"))
    assert plan["version"] == 3
    assert plan["cell"]["robot"] == "made_parallel"
    assert plan["settings"][0]["fixturing"] == "up"
    assert main(["reach", out, PART, "--cell", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["setting_01"]["up"]["joints_rad"] == plan["settings"][0]["joints"]


def test_another_cell_is_noted(planned, tmp_path, capsys):
    out, path = planned
    assert main(["reach", out, PART, "--cell", path]) == 0
    assert "cell of the plan differs" not in capsys.readouterr().out
    main(["reach", out, PART, "--cell", cell_file(tmp_path, x=610)])
    assert "note: the cell of the plan differs from the cell given, in" in capsys.readouterr().out


def test_a_plan_for_a_cell_is_planned_again_with_its_cell(planned, tmp_path, capsys):
    out, path = planned
    again = ["plan", "--again", out, "--out", str(tmp_path / "again"), "--quiet", "--jobs", "1"]
    assert main(again) == 2
    assert "--cell must be given for a plan of a robot cell" in capsys.readouterr().err
    assert main([*again, "--cell", cell_file(tmp_path, x=610)]) == 2
    assert "--cell must be the cell of the plan" in capsys.readouterr().err
    assert main([*again, "--cell", path]) == 0
    printed = capsys.readouterr().out
    assert "part lies" in printed
    assert "made_parallel reaches all settings, with the part lying 'up'." in printed
    first, second = (
        json.loads(Path(folder, "plan.json").read_text("utf-8"))["settings"]
        for folder in (out, tmp_path / "again")
    )
    assert first == second
    without = ["plan", "--again", PLAN, "--out", str(tmp_path / "none"), "--quiet"]
    assert main([*without, "--cell", path]) == 2


@pytest.mark.parametrize("command", ["reach", "program"])
def test_another_part_is_refused_although_the_plan_has_no_digest(command, tmp_path, capsys):
    assert "request" not in json.loads(Path(PLAN).read_text("utf-8"))
    other = str(EXAMPLES / "nist_ctc_01_ap242.stp")
    assert main([command, PLAN, other, "--cell", cell_file(tmp_path), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "the part must be the one that was planned. Got" in line
    assert "which has no edge at 'e1'" in line
