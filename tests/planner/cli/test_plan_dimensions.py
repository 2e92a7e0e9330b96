"""`aspectgraph plan --dimensions`: a file of dimensions planned, and one line for every bad one."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from planner import Localisation, read_plan
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE

EXAMPLES = Path(__file__).parents[3] / "examples"
CASES = Path(__file__).parents[2] / "cases"
BLOCK = str(EXAMPLES / "two_pocket_block.off")
CAMERA = [
    "--camera",
    "basler-acA2440-20gm-8mm",
    "--sigma-mm",
    "0.05",
    "--sigma-rad",
    "0.001",
    "--jobs",
    "1",
]
LEFT = "[[50, 20, 10], [50, 40, 10]]"
RIGHT = "[[60, 20, 10], [60, 40, 10]]"
ACROSS = "[[50, 20, 10], [60, 20, 10]]"


def planned(tmp_path, text, *options, part=BLOCK):
    path = tmp_path / "wanted.toml"
    path.write_text(text)
    return main(
        ["plan", part, "--dimensions", str(path), *CAMERA, "--out", str(tmp_path / "out"), *options]
    )


def test_a_file_of_dimensions(tmp_path, capsys):
    text = f"step = {{ distance = [{LEFT}, {RIGHT}], max_error = 0.1 }}\nfloor = {{ edge = {LEFT}, max_error = 0.2 }}"
    assert planned(tmp_path, text, "--simulate", "2000") == DONE
    assert "2 of 2 dimensions inspected" in capsys.readouterr().out
    plan = read_plan(tmp_path / "out" / "plan.json")
    assert plan.dimensions["step"].nominal == pytest.approx(10.0)
    step = plan.dimensions["step"]
    assert step.localisation == Localisation("gaussian", 0.1, floor_px=0.05)
    assert step.surfaces_mm == plan.request.surfaces_mm == 0.02
    assert plan.dimensions["floor"].permitted_error == 0.2
    assert plan.simulation.confirmed
    assert (tmp_path / "out" / "graph.graphml").is_file()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"step = {{ distance = [{LEFT}, {ACROSS}] }}",
            "dimension 'step': the edges of a distance must be parallel",
        ),
        (f"step = {{ width = {LEFT} }}", "dimension 'step' must be made of a kind"),
        ("bore = { diameter = 'r7' }", "dimension 'bore': "),
        (
            f"step = {{ edge = {LEFT}, max_error = 1, unit = 'ell' }}",
            "dimension 'step': unit must be one of",
        ),
        (
            f"step = {{ edge = {LEFT}, tolerance = [1, -1] }}",
            "dimension 'step': tolerance must have its lower",
        ),
        (
            f"step = {{ edge = {LEFT}, max_error = 0 }}",
            "dimension 'step': max_error must be a positive number. Got 0",
        ),
        (
            f"step = {{ edge = {LEFT}, max_error = 99 }}",
            "dimension 'step': the permitted error of a length must be",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(tmp_path, capsys, text, message):
    assert planned(tmp_path, text) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("aspectgraph: --dimensions ")
    assert f"wanted.toml: {message}" in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--localisation", "canny"], "--localisation must be rounding, gaussian"),
        (["--localisation", "gaussian:much"], "--localisation must hold numbers of px"),
        (
            ["--localisation", "gaussian:-1"],
            "--localisation: sigma_px must be finite and not negative",
        ),
    ],
)
def test_localisation_is_checked(tmp_path, capsys, options, message):
    assert planned(tmp_path, f"floor = {LEFT}", *options) == BAD_INPUT
    assert capsys.readouterr().err.startswith(f"aspectgraph: {message}")
    assert not (tmp_path / "out").exists()


def test_all_dimensions_of_a_pattern(tmp_path, capsys):
    """Two instances of a plate with two holes. A third item of the aspect is none of its faces."""
    pytest.importorskip("OCP")
    text = (CASES / "dim_two_instances.step").read_text()
    usage = "#{}=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#551,#36,#{});\n"
    more = usage.format(900, 508) + usage.format(901, 335)
    part = tmp_path / "pattern.step"
    part.write_text(text.replace("ENDSEC;\nEND-ISO", f"{more}ENDSEC;\nEND-ISO"))
    wanted = ["--dimensions", "all", "--share", "1", "--effort", "quick", "--simulate", "500"]
    out = str(tmp_path / "out")
    assert main(["plan", str(part), *wanted, *CAMERA, "--out", out, "--json"]) == DONE
    found = json.loads(capsys.readouterr().out)
    names = [f"diameter 1 (solid {i}) [{k} of 3]" for i in (0, 1) for k in (1, 2, 3)]
    planned = [name for name in names if "[3 of" not in name]
    assert list(found["plan"]["targets"]) == planned
    unread = "the file attaches it to an item of this feature that could not be read"
    assert found["not_planned"] == {name: unread for name in names if name not in planned}
    with open(tmp_path / "out" / "measurements.csv", newline="") as file:
        assert {row["name"] for row in csv.DictReader(file)} == set(planned)


@pytest.mark.parametrize(
    "option", ["--one-per-pattern", "--reference-dimensions", "--no-basic-dimensions"]
)
@pytest.mark.parametrize(
    ("wanted", "got"), [(["--all"], "none"), (["--dimensions", BLOCK], repr(BLOCK))]
)
def test_options_for_the_dimensions_of_the_model_need_these(tmp_path, capsys, wanted, got, option):
    request = ["plan", BLOCK, *wanted, option, *CAMERA, "--out", str(tmp_path / "out")]
    assert main(request) == BAD_INPUT
    assert capsys.readouterr().err == (
        f"aspectgraph: {option} must be given with --dimensions all. Got {got}.\n"
    )
    assert not (tmp_path / "out").exists()


def test_a_model_of_reference_dimensions_says_how_to_plan_them(tmp_path, capsys):
    """The diameter of the case, with the note that it is for information only."""
    pytest.importorskip("OCP")
    text = (CASES / "dim_two_instances.step").read_text()
    note = "#900 = DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','auxiliary');\n"
    text = text.replace("ENDSEC;\nEND-ISO", note + "ENDSEC;\nEND-ISO")
    part = tmp_path / "reference.step"
    part.write_text(
        text.replace("REPRESENTATION('',(#553),#535)", "REPRESENTATION('',(#553,#900),#535)")
    )
    request = ["plan", str(part), "--dimensions", "all", *CAMERA, "--out", str(tmp_path / "out")]
    assert main(request) == BAD_INPUT
    assert capsys.readouterr().err == (
        f"aspectgraph: --dimensions all needs a dimension that can be measured. Got none in {part}; "
        "2 reference dimensions are left out: see --reference-dimensions.\n"
    )
    assert main(["dimensions", str(part)]) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("2 dimensions, 2 with a tolerance, 2 reference, 2 measurable")
    assert "±0.05 mm reference" in lines[3]


def test_a_part_without_dimensions_says_so(tmp_path, capsys):
    pytest.importorskip("OCP")
    part = str(EXAMPLES / "mfcad_6-11-11-19.step")
    assert (
        main(["plan", part, "--dimensions", "all", *CAMERA, "--out", str(tmp_path / "out")])
        == BAD_INPUT
    )
    assert "must be a STEP file with semantic dimensions (AP242)" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
