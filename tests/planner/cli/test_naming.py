"""Errors name the options of the command line, never those of a call in Python."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from aspectgraph import AspectGraphError, PartFileNotFoundError, ReadError, SolidError, read_solid
from errors.exceptions import MeasurementModelError
from ga.exceptions import GAError
from planner.app.checks import in_words_of_shell
from planner.app.main import main
from planner.exceptions import PlannerError, RequestError

# parameter, rule, got, hint, arguments that rule and hint mention; text of a call, text at a shell
SAID = [
    (
        ("accuracy", "must be in (0, 1)", "2.0", "", ()),
        "accuracy must be in (0, 1). Got 2.0.",
        "--accuracy must be in (0, 1). Got 2.0.",
    ),
    (
        ("step", "must be in [0, 1)", "2", "", ()),
        "step must be in [0, 1). Got 2.",
        "--grey-step must be in [0, 1). Got 2.",
    ),
    (
        ("chord_tolerance_mm", "must be positive", "0", "", ()),
        "chord_tolerance_mm must be positive. Got 0.",
        "chord_tolerance_mm must be positive. Got 0.",
    ),
    (
        (
            *("", "faces must meet within gap_mm=0.1 mm", "0.2 mm", "allow gap_mm=..., and look"),
            ("gap_mm=0.1", "gap_mm=..."),
        ),
        "faces must meet within gap_mm=0.1 mm. Got 0.2 mm; allow gap_mm=..., and look.",
        "faces must meet within --gap-mm 0.1 mm. Got 0.2 mm; allow --gap-mm, and look.",
    ),
    (
        ("occluders", "must be numbers where solids does not", "solids", "", ("solids",)),
        "occluders must be numbers where solids does not. Got solids.",
        "--occluders must be numbers where --solids does not. Got solids.",
    ),
    (
        ("", "a file must be small", "x", "allow limits=Limits()", ("limits=Limits()",)),
        "a file must be small. Got x; allow limits=Limits().",
        "a file must be small. Got x.",
    ),
    (
        ("", "a file must be whole", "x", "Ask with solids=[0, 2]", ("solids=[0, 2]",)),
        "a file must be whole. Got x. Ask with solids=[0, 2].",
        "a file must be whole. Got x. Ask with --solids 0,2.",
    ),
]
KNOWN = dict.fromkeys(("accuracy", "gap_mm", "occluders", "solids"))
BASES = (AspectGraphError, MeasurementModelError, GAError, PlannerError)


def kinds(base):
    """Return an error class and all that inherit from it."""
    return [base, *(kind for derived in base.__subclasses__() for kind in kinds(derived))]


@pytest.mark.parametrize("cls", [ReadError, PartFileNotFoundError])
@pytest.mark.parametrize(("data", "call", "shell"), SAID)
def test_an_error_names_parameters_in_a_call_and_options_at_a_shell(cls, data, call, shell):
    parameter, rule, got, hint, mentions = data
    raised = cls.of_rule(parameter, rule, got, hint=hint, mentions=mentions)
    for error in (raised, pickle.loads(pickle.dumps(raised))):
        assert str(error) == call
        assert in_words_of_shell(error, KNOWN) == shell


@pytest.mark.parametrize("cls", [kind for base in BASES for kind in kinds(base)])
def test_every_error_has_words_for_a_shell_and_keeps_its_data_in_another_process(cls):
    error = pickle.loads(pickle.dumps(cls.of_rule("seed", "must be >= 0", "-1")))
    assert type(error) is cls
    assert str(error) == "seed must be >= 0. Got -1."
    assert (error.parameter, error.rule, error.got) == ("seed", "must be >= 0", "-1")
    assert in_words_of_shell(error, {"seed": 0}) == "--seed must be >= 0. Got -1."
    assert in_words_of_shell(cls("plain words"), {"seed": 0}) == "plain words"


def test_the_planner_gives_hints_that_are_the_same_in_a_call_and_at_a_shell():
    error = RequestError.of_rule("camera", "must be known", "'x'", hint="nearest: y")
    assert str(error) == "camera must be known. Got 'x'; nearest: y."
    known = {"camera": "x"}
    assert in_words_of_shell(error, known) == "--camera must be known. Got 'x'; nearest: y."


def test_a_hint_stands_behind_an_error_of_no_rule_too():
    error = SolidError("the surface is open.")
    error.hint = "Try solids=[1]"
    error.mentions = ("solids=[1]",)
    error = pickle.loads(pickle.dumps(error))
    assert str(error) == "the surface is open. Try solids=[1]."
    assert in_words_of_shell(error, KNOWN) == "the surface is open. Try --solids 1."


def test_an_error_of_a_call_holds_its_data():
    """Dask lets this package pickle exceptions, in its own way, wherever Dask is loaded."""
    pytest.importorskip("tblib.pickling_support").install()
    with pytest.raises(PartFileNotFoundError) as caught:
        read_solid("no such part.stl")
    error = pickle.loads(pickle.dumps(caught.value))
    assert (error.parameter, error.rule) == ("path", "must name an existing part file")
    assert error.got == "'no such part.stl'"


def test_an_option_that_was_typed_is_named_as_it_was():
    error = RequestError.of_rule("part", "must be an existing file", "'x'")
    assert in_words_of_shell(error, {"part": "x"}).startswith("the part must")
    assert in_words_of_shell(error, {"part": "x", "typed": {"--part"}}).startswith("--part must")


def test_an_error_in_a_file_names_its_field(tmp_path, capsys):
    path = tmp_path / "plan.json"
    path.write_text('{"format": "aspectgraph-plan", "version": 1}')
    assert main(["simulate", str(path)]) == 2
    assert "--" not in capsys.readouterr().err


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


@pytest.mark.parametrize("command", ["info", "dimensions"])
def test_the_time_limit_for_reading_is_an_option_and_its_end_one_line(capsys, command):
    pytest.importorskip("OCP")
    part = Path(__file__).parents[3] / "examples" / "nist_ctc_01_ap242.stp"
    assert main([command, str(part), "--read-time-limit", "0.01", "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{part}: a STEP file must be read within --read-time-limit 0.01 seconds" in line
    assert line.endswith("which takes longer; allow more with --read-time-limit.")


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no such device")
@pytest.mark.parametrize("options", [["--json"], []])
def test_standard_output_that_takes_no_more_is_one_line(options):
    script = "import sys; from planner.app.main import main; sys.exit(main())"
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-c", script, "cameras", *options]
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert run.returncode == 2
    assert (
        run.stderr
        == "aspectgraph: standard output must be writable. Got: No space left on device.\n"
    )
