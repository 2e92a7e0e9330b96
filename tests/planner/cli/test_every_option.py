"""Every option that takes a value names itself, as it was typed, when the value is bad."""

from __future__ import annotations

import pytest
from plan_examples import plan

from planner.app.main import main
from planner.app.options import COMMANDS
from planner.app.parsing import arguments_of, takes_value

BOX = """OFF
8 6 0
0 0 0\n40 0 0\n40 30 0\n0 30 0\n0 0 20\n40 0 20\n40 30 20\n0 30 20
4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7
"""
CAMERA = ["--camera", "basler-acA2440-20gm-25mm"]
# what a command cannot do without
NEEDED = {
    "info": ["box.off"],
    "dimensions": ["box.off"],
    "graph": ["box.off", "--all", "--graphml", "graph.graphml"],
    "plan": ["box.off", "--all", *CAMERA, "--out", "out"],
    "batch": ["parts", *CAMERA, "--out", "out"],
    "simulate": ["plan.json"],
    "optics": ["box.off", "--all"],
    "program": ["plan.json", "box.off", "--cell", "cell.toml"],
    "reach": ["plan.json", "box.off", "--cell", "cell.toml"],
    "measure": ["plan.json", "parts", "--part", "box.off", "--out", "out"],
}
NO_NUMBER = ["many"]
NEGATIVE = ["-1"]
BAD = {
    "--accuracy": ["2"],
    "--again": ["nowhere.json"],
    "--body": ["pinhole"],
    "--camera": ["pinhole"],
    "--cell": ["nowhere.toml"],
    "--contrast": ["2"],
    "--coverage": ["2"],
    "--exit": ["never"],
    "--dimensions": ["nowhere.toml"],
    "--distances": ["near"],
    "--draws": ["0"],
    "--effort": ["none"],
    "--entities": ["?"],
    "--field-margin-px": NEGATIVE,
    "--focus-margin-mm": NEGATIVE,
    "--format": ["ls"],
    "--gap": ["1"],
    "--gap-mm": NEGATIVE,
    "--give-up": ["1"],
    "--graph-limit": NEGATIVE,
    "--graphml": ["nowhere/graph.graphml"],
    "--grey-step": ["1"],
    "--ground": ["grey"],
    "--jobs": ["0"],
    "--light": ["torch"],
    "--localisation": ["sharp"],
    "--memory-limit": ["0"],
    "--min-corner-deg": ["90"],
    "--min-length": NEGATIVE,
    "--min-length-px": NEGATIVE,
    "--occluders": NO_NUMBER,
    "--out": ["file"],
    "--cell-out": ["nowhere/placed.toml"],
    "--plan-out": ["nowhere/reached.json"],
    "--part": ["nowhere.step"],
    "--picture": ["edges.txt"],
    "--poses": ["0"],
    "--register": ["nowhere.json"],
    "--rule": ["best"],
    "--probability": ["nan"],
    "--read-time-limit": ["0"],
    "--ready-input": NEGATIVE,
    "--rows": ["0"],
    "--serial": [" "],
    "--scheduler": ["nowhere"],
    "--seed": NEGATIVE,
    "--select": ["colour = red"],
    "--separation-px": NEGATIVE,
    "--settle": NEGATIVE,
    "--share": ["2"],
    "--sigma-hand-eye": ["0.1"],
    "--sigma-joints": NEGATIVE,
    "--sigma-mm": NEGATIVE,
    "--sigma-rad": ["inf"],
    "--sigma-part": ["-1mm,1mrad"],
    "--simulate": ["0"],
    "--solids": NO_NUMBER,
    "--speed": ["0"],
    "--stand-off": NEGATIVE,
    "--surfaces-mm": NEGATIVE,
    "--floor-px": NEGATIVE,
    "--surround-px": NEGATIVE,
    "--time-limit": ["0"],
    "--trigger-output": NEGATIVE,
    "--units": ["ell"],
    "--visibility-radius-mm": NEGATIVE,
    "--within": ["1", "1", "1", "0", "0", "0"],
    "--write": ["camera.txt"],
    "--workspace": ["1", "1", "1", "0", "0", "0"],
    "--white-level": ["4095.5"],
}


OPTIONS = [
    (command, argument.name)
    for command, kind in COMMANDS.items()
    for argument in arguments_of(kind)
    if argument.name.startswith("-") and takes_value(argument)
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.off").write_text(BOX)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "box.off").write_text(BOX)
    (tmp_path / "file").write_text("")
    (tmp_path / "cell.toml").write_text("")
    plan().write(tmp_path / "plan.json")
    return tmp_path


def _with(command, option):
    """The shortest command line with a bad value of an option."""
    if option == "--again":
        return [command, option, *BAD[option], "--out", "out"]
    needed = list(NEEDED[command])
    if option in needed:
        first = needed.index(option)
        del needed[first : first + 2]
    if option in ("--entities", "--select", "--dimensions") and "--all" in needed:
        needed.remove("--all")
    if (command, option) == ("program", "--out"):
        # it writes a file
        return [command, *needed, option, "nowhere/inspection.script"]
    return [command, *needed, option, *BAD[option]]


@pytest.mark.parametrize(("command", "option"), OPTIONS)
def test_a_bad_value_is_refused_in_one_line_that_names_its_option(folder, capsys, command, option):
    assert main([*_with(command, option), "--quiet"]) == 2
    caught = capsys.readouterr()
    (line,) = caught.err.splitlines()
    assert f"{option} " in f"{line} ".replace(":", " ")
    assert caught.out == ""
    assert not (folder / "out" / "plan.json").exists()
