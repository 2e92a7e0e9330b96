"""The command ``program``: files, tables, exit codes, and what it refuses in one line."""

import json
from pathlib import Path

import pytest

from planner.app.main import main

ROOT = Path(__file__).parents[3]
PLAN = ROOT / "examples/two_pocket_block_plan.json"
PART = ROOT / "examples/two_pocket_block.off"
CELL = ROOT / "examples/cell.toml"
GIVEN = [str(PLAN), str(PART), "--cell", str(CELL), "--quiet"]


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_program_is_written_and_its_rounds_are_printed(capsys):
    words = ["--format", "krl", "--speed", "25%", "--sigma-joints", "0.1mrad"]
    assert main(["program", *GIVEN, *words]) == 0
    out = capsys.readouterr().out
    assert "setting_01.png" in out
    assert "25 % of the joints' speeds" in out
    assert "smallest P" in out
    assert out.splitlines()[-1] == "inspection.src"
    assert "$VEL_AXIS[i]=25" in Path("inspection.src").read_text("utf-8")


def test_json_is_the_record(capsys):
    assert main(["program", *GIVEN, "--format", "json", "--out", "p.json", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(Path("p.json").read_text("utf-8"))
    assert printed["speed"] == 0.5
    assert len(printed["tours"][0]["stops"]) == 1


def test_settle_and_signals_are_in_the_program():
    words = ["--settle", "250ms", "--trigger-output", "7", "--ready-input", "4"]
    assert main(["program", *GIVEN, *words]) == 2
    words[1] = "0.25"
    assert main(["program", *GIVEN, *words]) == 0
    script = Path("inspection.script").read_text("utf-8")
    assert "sleep(0.25)" in script
    assert "set_standard_digital_out(7, True)" in script
    assert "get_standard_digital_in(4)" in script


def cell_with(**changes):
    """A cell file beside the robots, with texts replaced."""
    text = CELL.read_text("utf-8").replace('"robots', f'"{ROOT}/examples/robots')
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    path = Path("cell.toml")
    path.write_text(text, encoding="utf-8")
    return [str(PLAN), str(PART), "--cell", str(path), "--quiet"]


def test_a_plan_out_of_reach_is_not_done(capsys):
    given = cell_with(far=("xyz = [800.0, 300.0", "xyz = [5800.0, 300.0"))
    assert main(["program", *given]) == 1
    assert "Got none: setting 1: beyond the arm's reach." in capsys.readouterr().err
    assert not Path("inspection.script").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--speed", "0"], "--speed must be in (0, 1]. Got 0."),
        (
            ["--speed", "0.001", "--format", "krl"],
            "--speed must be at least 0.01 for krl. Got 0.001.",
        ),
        (["--speed", "1e-9"], "--speed must be at least 0.001 for urscript. Got 1e-09."),
        (["--speed", "1e-300", "--format", "json"], "--speed must be at least 0.001 for json."),
        (["--settle", "1e300"], "--settle must be 0, or from 0.001 to 3600 s. Got 1e+300."),
        (["--settle", "1e-9"], "--settle must be 0, or from 0.001 to 3600 s. Got 1e-09."),
        (["--speed", "150%"], "--speed must be in (0, 1]. Got 1.5."),
        (["--settle", "-1"], "--settle must be finite and not negative. Got -1."),
        (["--sigma-joints", "-1"], "--sigma-joints must be finite and not negative. Got -1."),
        (["--sigma-joints", "2"], "--sigma-joints must be in [0, 1] rad"),
        (["--sigma-part", "0.1"], "--sigma-part must be a length and an angle"),
        (["--sigma-hand-eye", "500,0.001"], "--sigma-hand-eye must have standard deviations"),
        (["--format", "ls"], "--format must be one of urscript, rapid"),
        (["--out", "none/a.script"], "--out must be in a folder that exists"),
        (["--out", "."], "--out must be a file"),
        (["--trigger-output", "-1"], "--trigger-output must be"),
        (["--ready-input", "99999"], "--ready-input must be at most 4096"),
    ],
    ids=lambda one: one[0] if isinstance(one, list) else "",
)
def test_bad_options(words, message, capsys):
    assert main(["program", *GIVEN, *words]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert len(err.strip().splitlines()) == 1


def test_a_cell_without_home(capsys):
    line = next(line for line in CELL.read_text("utf-8").splitlines() if "home_deg" in line)
    assert main(["program", *cell_with(home=(line, ""))]) == 2
    assert "home_deg of the cell file must be given for a program" in capsys.readouterr().err


def test_a_missing_cell(capsys):
    assert main(["program", str(PLAN), str(PART), "--cell", "none.toml"]) == 2
    assert "--cell must be an existing file" in capsys.readouterr().err
