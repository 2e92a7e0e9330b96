"""Errors name the options of the command line, never those of a call in Python."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from planner.cli.main import main
from planner.cli.messages import as_typed

TOLD = [
    (
        "Got 3; read some of them with solids=[0, 2] (on the command line --solids 0,2).",
        "Got 3; read some of them with --solids 0,2.",
    ),
    (
        "a file must have at most file_mb=256 MB. Got x with more; allow more with limits=ReadLimits(file_mb=...).",
        "a file must have at most file_mb=256 MB. Got x with more.",
    ),
    (
        "p.step: solids must name some of 0..2 of p.step. Got [9].",
        "p.step: --solids must name some of 0..2 of p.step. Got [9].",
    ),
    ("units must be one of mm, cm. Got 'em'.", "--units must be one of mm, cm. Got 'em'."),
    (
        "select must be conditions joined by 'and'. Got 'x'.",
        "--select must be conditions joined by 'and'. Got 'x'.",
    ),
    (
        "p.step: select must hold for at least one edge. Got none for 'length > 9'.",
        "p.step: --select must hold for at least one edge. Got none for 'length > 9'.",
    ),
    ("accuracy must be in (0, 1). Got 2.0.", "--accuracy must be in (0, 1). Got 2.0."),
    ("out must be a folder. Got x: x is a file.", "--out must be a folder. Got x: x is a file."),
    (
        "path of a picture must end in .png or .html. Got 'x'.",
        "--picture must end in .png or .html. Got 'x'.",
    ),
    ("stand_off_mm must be less than 3. Got 4.", "--stand-off must be less than 3. Got 4."),
    (
        "plan.json: accuracy must be in (0, 1). Got 2.0.",
        "plan.json: accuracy must be in (0, 1). Got 2.0.",
    ),
    (
        "camera must be a name of the catalogue. Got 'x'.",
        "--camera must be a TOML file, or a name that 'aspectgraph cameras' lists. Got 'x'.",
    ),
    (
        "entities must be 'all', ids such as 17. Got 'x'.",
        "--entities must be 'all', ids such as 17. Got 'x'.",
    ),
    (
        "plan.json: entities must be an object. Got 1.",
        "plan.json: entities must be an object. Got 1.",
    ),
    (
        "path must name an existing part file. Got 'x'.",
        "the part must be an existing file. Got 'x'.",
    ),
    (
        "path of a picture must end in .png or .html. Got 'x'.",
        "--picture must end in .png or .html. Got 'x'.",
    ),
    ("plan.json: camera must be an object. Got 1.", "plan.json: camera must be an object. Got 1."),
    ("light.contrast must be in (0, 1). Got 1.", "light.contrast must be in (0, 1). Got 1."),
    (
        "contrast must lie strictly between 0 and 1. Got 2.0.",
        "--contrast must lie strictly between 0 and 1. Got 2.0.",
    ),
    ("min_corner_deg must be below 90. Got 95.0.", "--min-corner-deg must be below 90. Got 95.0."),
    (
        "separation_px must be less than half the image",
        "--separation-px must be less than half the image",
    ),
    ("must meet within gap_mm=0.1 mm. Got 0.2 mm", "must meet within --gap-mm 0.1 mm. Got 0.2 mm"),
    (
        "allow more with gap_mm=... (on the command line --gap-mm), and look",
        "allow more with --gap-mm, and look",
    ),
    (
        "the joint graph of 4 entities must fit memory_limit_bytes, 1 GiB. Got 2 GiB. Ask for fewer entities, or for "
        "the regions only: compute_regions answers the same questions, and a plan needs no joint graph.",
        "the joint graph of 4 entities must fit --memory-limit, 1 GiB. Got 2 GiB. Ask for fewer entities: a plan needs "
        "no joint graph.",
    ),
    (
        "solids must not overlap. Got solids 0 and 1.",
        "solids must not overlap. Got solids 0 and 1.",
    ),
]


@pytest.mark.parametrize(("text", "told"), TOLD)
def test_options_are_named_as_they_are_typed(text, told):
    assert as_typed(text) == told


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("part.stl", ["--solids", "0"], "--solids applies to STEP files"),
        ("part.stl", ["--gap-mm", "0.1"], "--gap-mm applies to STEP files"),
        ("part.stl", ["--units", "ell"], "--units must be one of"),
        ("part.step", ["--units", "mm"], "--units applies to mesh files"),
        ("part.step", ["--gap-mm", "-1"], "--gap-mm must be positive"),
    ],
)
def test_errors_of_the_reader(tmp_path, capsys, name, options, told):
    path = tmp_path / name
    path.write_text("ISO-10303-21;\n" if name.endswith("step") else "solid x\nendsolid x\n")
    assert main(["info", str(path), *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert not any(f"{one}=" in line for one in ("solids", "units", "gap_mm", "limits"))


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no such device")
@pytest.mark.parametrize("options", [["--json"], []])
def test_standard_output_that_takes_no_more_is_one_line(options):
    script = "import sys; from planner.cli.main import main; sys.exit(main())"
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-c", script, "cameras", *options]
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert run.returncode == 2
    assert (
        run.stderr
        == "aspectgraph: standard output must be writable. Got: No space left on device.\n"
    )
