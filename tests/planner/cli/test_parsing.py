"""Units, wrong names, short options, help and default folder: what is typed is understood, or one line says why not."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import pytest

from planner.app.main import main
from planner.app.options import COMMANDS, rules_of, texts_of
from planner.app.parsing import UsageError, arguments_of, command_help, parse
from planner.app.process import BAD_INPUT, DONE
from planner.app.quantities import DEG, MM, PX, RAD, SECONDS, SHARE, lengths, registration
from planner.light.background import DEFAULT_STEP
from planner.request.defaults import MOST_SEED

BLOCK = str(Path(__file__).parents[3] / "examples" / "two_pocket_block.off")
PLAN = ["plan", BLOCK, "--entities", "8", "--camera", "basler-acA2440-20gm-8mm", "--jobs", "1"]


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (SHARE, "98%", 0.98),
        (SHARE, "99.9 %", 0.999),
        (SHARE, "0.9", 0.9),
        (MM, "0.1mm", 0.1),
        (MM, "100um", 0.1),
        (MM, "100 µm", 0.1),
        (MM, "2.5cm", 25.0),
        (MM, "1in", 25.4),
        (MM, "-1e2", -100.0),
        (MM, ".5", 0.5),
        (RAD, "2mrad", 0.002),
        (RAD, "180deg", math.pi),
        (DEG, "25°", 25.0),
        (PX, "20px", 20.0),
        (SECONDS, "5min", 300.0),
        (SECONDS, "1.5h", 5400.0),
        (SECONDS, "90", 90.0),
    ],
)
def test_a_number_may_have_its_unit(kind, text, value):
    """Decimal units are exact: 99.9% is the number that 0.999 is."""
    assert kind(text) == value


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (MM, "0.1kg"),
        (MM, "0.1deg"),
        (MM, "10%"),
        (MM, "MM"),
        (MM, ""),
        (SHARE, "0.9mm"),
        (RAD, "1mm"),
        (SECONDS, "1d"),
        (PX, "1mm"),
        (MM, "1mm2"),
    ],
)
def test_another_unit_is_refused(kind, text):
    with pytest.raises(ValueError, match=r"^must be .*\. Got '"):
        kind(text)


def test_several_lengths_may_have_units():
    assert lengths("250,40cm,.5m") == [250.0, 400.0, 500.0]


def refusal(capsys, *words):
    assert main(list(words)) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["plna"], "unknown command 'plna'; did you mean plan?"),
        (["simul"], "did you mean simulate?"),
        (["help", "optiks"], "unknown command 'optiks'; did you mean optics?"),
        (["plan", "p.off", "--acuracy", "0.9"], "unknown option --acuracy; did you mean --accuracy?"),
        (["plan", "p.off", "--camra=x"], "unknown option --camra; did you mean --camera?"),
        (["info", "p.off", "--camera", "x"], "it is an option of plan, batch, graph"),
        (["info", "p.off", "-x"], "unknown option -x; see aspectgraph info --help"),
        (["--versoin"], "did you mean --version?"),
        ([*PLAN, "--sigma-mm", "0.1kg"], "--sigma-mm must be a length in mm, or with its unit"),
        ([*PLAN, "--accuracy", "98"], "--accuracy must be in (0, 1). Got 98.0; write 98%."),
        ([*PLAN, "-j", "many"], "--jobs must be a whole number. Got 'many'"),
        (["info", BLOCK, "--select", "lenght > 20"], "Got 'lenght > 20'; 'length > 20' may be meant"),
        (["info", BLOCK, "--select", "face = topp"], "'face = top' may be meant"),
    ],
)  # fmt: skip
def test_what_was_meant_is_said(capsys, words, message):
    assert message in refusal(capsys, *words)


def complaint(words):
    """What is wrong with a line, or nothing."""
    try:
        parse(words)
    except UsageError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_of_every_command_is_known(name):
    for argument in arguments_of(COMMANDS[name]):
        for text in filter(lambda text: text.startswith("-"), argument.names):
            assert "unknown" not in complaint([name, text])
    assert "unknown option --zebra" in complaint([name, "--zebra"])


def test_short_options_and_values_that_look_like_them():
    words = [*PLAN[:-2], "-qj2", "-oout", "--workspace", "-1", "-2mm", "-3e1", "4", "5", "6"]
    options = parse(words)
    assert {"--quiet", "--jobs", "--out", "--workspace"} <= options.typed
    assert (options.jobs, options.out, options.quiet) == (2, "out", True)
    assert options.workspace == (-1.0, -2.0, -30.0, 4.0, 5.0, 6.0)


def test_help_is_a_command_too(capsys):
    assert main(["help"]) == DONE
    assert "COMMAND" in capsys.readouterr().out
    assert main(["help", "plan"]) == DONE
    by_command = capsys.readouterr().out
    assert main(["plan", "--help"]) == DONE
    assert capsys.readouterr().out == by_command
    assert main(["-V"]) == DONE
    assert capsys.readouterr().out.startswith("aspectgraph ")


def test_the_most_used_options_come_first_and_lines_fit_80_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for name, command in COMMANDS.items():
        assert max(map(len, command_help(command).splitlines())) <= 80, name
    text = command_help(COMMANDS["plan"])
    order = [
        "--entities",
        "--select",
        "--dimensions",
        "--camera",
        "--accuracy",
        "--out",
        "--effort",
    ]
    order += ["--stand-off", "--light", "--units", "--json"]
    places = [re.search(rf"\n  {name}[ ,]", text).start() for name in order]
    assert places == sorted(places)


def test_the_folder_is_plan_where_none_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    quick = [*PLAN, "--effort", "quick", "--simulate", "100", "--quiet"]
    assert main(quick) == DONE
    assert capsys.readouterr().out.splitlines()[-1] == "12 files in plan/; open plan/report.html"
    assert main(["simulate", "plan", "--poses", "100", "--quiet"]) == DONE
    # the same request may replace its plan, another one may not
    capsys.readouterr()
    message = "plan.json of another request: --seed was 0 and is now 1"
    assert message in refusal(capsys, *quick, "--seed", "1")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("notes.txt", [], "--out must be given where ./plan holds other files. Got"),
        ("report.html", [], "report.html without its plan.json"),
        ("report.html", ["--out", "plan"], "report.html without its plan.json"),
    ],
)
def test_files_of_others_are_never_replaced(tmp_path, monkeypatch, capsys, name, options, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan").mkdir()
    (tmp_path / "plan" / name).write_text("mine")
    assert message in refusal(capsys, *PLAN, *options)
    assert (tmp_path / "plan" / name).read_text() == "mine"
    assert [one for one in os.listdir(tmp_path / "plan") if not one.startswith(".")] == [name]


def test_fish_gets_every_option_with_its_help(capsys):
    assert main(["completion", "fish"]) == DONE
    lines = capsys.readouterr().out.splitlines()
    for name, command in COMMANDS.items():
        own = [line for line in lines if f"'__aspectgraph_in {name}'" in line]
        names = [text for argument in arguments_of(command) for text in argument.names]
        for text in filter(lambda name: name.startswith("-"), names):
            flag = f" -l {text[2:]} " if text.startswith("--") else f" -s {text[1:]} "
            assert sum(flag in f"{line} " for line in own) == 1, (name, text)
    cameras = next(line for line in lines if "in plan'" in line and " -l camera " in line)
    assert "basler-acA2440-20gm-8mm" in cameras
    # in quotes, a quote of fish is escaped
    assert all(line.replace("\\'", "").count("'") % 2 == 0 for line in lines)


def test_how_poses_are_known_may_be_edges_none_or_a_pair():
    assert registration("none") is None
    assert (registration("edges").method, registration("edges").pose_uncertainty) == (
        "own edges",
        None,
    )
    sigmas = registration("20um,0.1mrad").pose_uncertainty.sigmas
    assert sigmas == pytest.approx([0.02] * 3 + [1e-4] * 3)
    for wrong in ("edge", "0.1", "1,2,3", "-1,0.1", "0.1mm,100"):
        with pytest.raises(ValueError, match="edges, none, or a length and an angle"):
            registration(wrong)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_its_help(name):
    texts = texts_of(COMMANDS[name])
    names = {argument.field_info.name for argument in arguments_of(COMMANDS[name])}
    assert all(texts[key] for key in names)
    assert set(texts) - {""} == names


def test_numbers_that_load_too_much_are_the_same():
    assert rules_of(COMMANDS["plan"])["seed"].maximum == MOST_SEED
    assert parse([*PLAN]).grey_step == DEFAULT_STEP


def test_the_last_value_of_an_option_counts_unless_it_may_be_given_again():
    options = parse([*PLAN, "--gap", "1%", "--gap=2%", "--out", "a", "-ob"])
    assert (options.gap, options.out) == (0.02, "b")
    assert parse(["optics", "p", "--all", "--body", "a", "--body=b"]).body == ["a", "b"]


def test_a_text_is_as_it_is_typed():
    words = ["plan", "none", "--entities=-5", "--camera", "none", "--out=-x", "--localisation="]
    options = parse(words)
    assert (options.part, options.entities, options.camera) == ("none", "-5", "none")
    assert (options.out, options.localisation) == ("-x", "")
    assert parse(["info", "--", "-p"]).part == "-p"
    assert parse(["info", "-", "--picture=-x"]).picture == "-x"
    assert parse([*PLAN[:2], "--entities", "-3,4", "--camera", "-"]).entities == "-3,4"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([*PLAN, "--gap", "--quiet"], "--gap must have a value. Got none;"),
        ([*PLAN, "--out", "-q"], "--out must have a value. Got none;"),
        ([*PLAN, "--workspace", *"12345", "-q"], "--workspace must have 6 values;"),
        (["info", "-x"], "unknown option -x;"),
        (["info", "p", "-qx"], "unknown option -x;"),
        (["plan", "--acuracy", "1", "p"], "unknown option --acuracy; did you mean --accuracy?"),
        (["info", "p", "--", "-q"], "unknown argument '-q';"),
        (["info", "p", "--quiet=x"], "--quiet must have no value. Got 'x';"),
        (["info", "p", "-qv"], "--verbose must not be given with --quiet;"),
    ],
)
def test_an_option_is_no_value(words, message):
    assert message in complaint(words)
