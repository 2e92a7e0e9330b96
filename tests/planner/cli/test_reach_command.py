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
