"""Wrong files, texts and combinations: one line with the option as it was typed, and nothing is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from planner.app.main import main
from planner.app.process import BAD_INPUT

EXAMPLES = Path(__file__).parents[3] / "examples"
BLOCK = str(EXAMPLES / "two_pocket_block.off")
CAMERA = ["--camera", "basler-acA2440-20gm-8mm"]
EDGES = ["plan", BLOCK, "--entities", "8", *CAMERA]
FOLDER = "'here', a folder"

FILES = {
    "twice.json": '{"a": 17, "a": 18}',
    "unknown.toml": "a = 999",
    "dimensions.toml": "a = { distance = [25, 999], tolerance = [-0.1, 0.1] }",
    "camera.toml": "focal_length_mm = 8.0",
    "empty.toml": "",
    "lamps.toml": "lamp = 3",
}

BAD = {
    "a part of another unit": (
        ["plan", "huge.off", "--all", *CAMERA, "--time-limit", "1"],
        "the part must lie within 1e+07 mm of the origin. "
        "Got one from 0 0 0 to 6e+07 6e+07 4e+07 mm; its unit may be another one.",
    ),
    "an empty folder to write to": ([*EDGES, "--out", ""], "--out must not be empty. Got ''."),
    "an empty part": (["info", " "], "the part must not be empty. Got ' '."),
    "an empty plan": (["simulate", ""], "the plan must not be empty. Got ''."),
    "a folder for a part": (["info", "here"], f"the part must be an existing file. Got {FOLDER}."),
    "no plan": (
        ["simulate", "none.json"],
        "the plan must be an existing plan file, or its folder. Got 'none.json'.",
    ),
    "a folder without a plan": (
        ["simulate", "here"],
        f"the plan must be a plan file, or the folder it is in. Got {FOLDER} without plan.json.",
    ),
    "a folder without a plan, again": (
        ["plan", "--again", "here"],
        f"--again must be a plan file, or the folder it is in. Got {FOLDER} without plan.json.",
    ),
    "no folder of parts": (
        ["batch", "none", *CAMERA, "--out", "out"],
        "the folder of parts must be an existing folder. Got 'none'.",
    ),
    "a file for a folder of parts": (
        ["batch", "empty.toml", *CAMERA, "--out", "out"],
        "the folder of parts must be an existing folder. Got 'empty.toml', a file.",
    ),
    "a camera without fields": (
        ["graph", BLOCK, "--all", "--graphml", "g.graphml", "--camera", "empty.toml"],
        "--camera empty.toml:1: focal_length_mm must be given. Got nothing.",
    ),
    "a camera that lacks a field": (
        ["plan", BLOCK, "--all", "--camera", "camera.toml"],
        "--camera camera.toml:1: pixel_pitch_mm must be given. Got focal_length_mm.",
    ),
    "an unknown id": (
        ["plan", BLOCK, "--entities", "999", *CAMERA],
        "--entities: an edge id must be in 0..35. Got 999 for 'e999'.",
    ),
    "an unknown id in a file": (
        ["graph", BLOCK, "--entities", "unknown.toml", "--graphml", "g.graphml"],
        "--entities unknown.toml: an edge id must be in 0..35. Got 999 for 'a'.",
    ),
    "a name twice": (
        ["plan", BLOCK, "--entities", "twice.json", *CAMERA],
        "--entities twice.json: an entity file must be valid JSON. Got twice.json: the name 'a' stands in it twice.",
    ),
    "a dimension of an unknown id": (
        ["optics", BLOCK, "--dimensions", "dimensions.toml"],
        "--dimensions dimensions.toml: dimension 'a': an edge id must be in 0..35. Got 999 for 'e999'.",
    ),
    "a share of no tolerance": (
        [*EDGES, "--share", "0.3"],
        "--share must be given with --dimensions. Got none.",
    ),
    "a contrast without lamps": (
        [*EDGES, "--contrast", "0.3"],
        "--contrast must be given with --light. Got none.",
    ),
    "a contrast of no graph of lamps": (
        ["graph", BLOCK, "--all", "--graphml", "g.graphml", "--contrast", "0.3"],
        "--contrast must be given with --lamps. Got none.",
    ),
    "a box of lamps upside down": (
        [*EDGES, "--light", "box:9,9,9,0,0,0"],
        "--light: low must be below high in every coordinate. Got (9.0, 9.0, 9.0) and (0.0, 0.0, 0.0).",
    ),
    "a file without lamps": (
        [*EDGES, "--light", "lamps.toml"],
        "--light lamps.toml: a file of lamps must hold lamps = [[X, Y, Z], ...]. Got no lamps.",
    ),
    "a margin wider than the image": (
        [*EDGES, "--field-margin-px", "1024"],
        "--field-margin-px must be less than half the image's smaller side, 2048 px. Got 1024.",
    ),
}


@pytest.mark.parametrize(("arguments", "message"), BAD.values(), ids=list(BAD))
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    Path("here").mkdir()
    for name, text in FILES.items():
        Path(name).write_text(text)
    head, _, sizes, *lines = Path(BLOCK).read_text().splitlines()
    n = int(sizes.split()[0])
    big = [" ".join(f"{float(x) * 1e6:g}" for x in line.split()) for line in lines[:n]]
    Path("huge.off").write_text("\n".join([head, sizes, *big, *lines[n:]]))
    before = sorted(tmp_path.rglob("*"))
    assert main(arguments) == BAD_INPUT
    out, err = capsys.readouterr()
    lines = [line for line in err.replace("\r", "\n").splitlines() if line.strip()]
    assert (out, lines[-1]) == ("", f"aspectgraph: {message}")
    assert len(lines) == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["info"], "info: PART must be given"),
        (["info", BLOCK, "more"], "info: unknown argument 'more'"),
        (["plan", BLOCK, *CAMERA], "plan: one of --entities, --select, --all, --dimensions must"),
        ([*EDGES, "--all"], "plan: --all must not be given with --entities;"),
        ([*EDGES, "--out"], "plan: --out must have a value. Got none;"),
        ([*EDGES, "--workspace", "0", "0"], "plan: --workspace must have 6 values;"),
        ([*EDGES, "--effort", "fast"], "--effort must be one of quick, standard, thorough. Got"),
        (["completion", "tcsh"], "shell must be one of bash, zsh, fish. Got 'tcsh';"),
    ],
)
def test_a_line_that_does_not_parse_breaks_a_rule_in_plain_words(capsys, arguments, message):
    assert main(arguments) == BAD_INPUT
    line = capsys.readouterr().err
    assert message in line
    assert line.endswith("--help\n")
