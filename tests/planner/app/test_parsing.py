"""Units, wrong names, short options, help and default folder: what is typed is understood, or one line says why not."""

from __future__ import annotations

import json
import math
import os
import pickle
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from plan_examples import plan

from aspectgraph import AspectGraphError, PartFileNotFoundError, ReadError, SolidError, read_solid
from errors.exceptions import MeasurementModelError
from ga.exceptions import GAError
from planner import Camera, camera_names, light_names, lights
from planner.app.checks import in_words_of_shell
from planner.app.main import main
from planner.app.options import COMMANDS, Plan, rules_of, texts_of
from planner.app.parsing import UsageError, arguments_of, command_help, parse, takes_value
from planner.app.part import read_part
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE
from planner.app.quantities import (
    DEG,
    MM,
    PX,
    RAD,
    SECONDS,
    SHARE,
    lengths,
    memory,
    registration,
    solid_names,
)
from planner.exceptions import PlannerError, RequestError, RobotError
from planner.light.corner_light import DEFAULT_STEP
from planner.lights import LightShows
from planner.request.camera_limits import MOST_SEED

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
        (["info", "p.off", "--camera", "x"], "it is an option of plan, predict, batch, graph"),
        (["info", "p.off", "-x"], "unknown option -x; see aspectgraph info --help"),
        (["--versoin"], "did you mean --version?"),
        ([*PLAN, "--sigma-mm", "0.1kg"], "--sigma-mm must be a length in mm, or with its unit"),
        ([*PLAN, "--accuracy", "98"], "--accuracy must be in (0, 1). Got 98.0; write 98%."),
        ([*PLAN, "--gap", "5"], "--gap must be in [0, 1). Got 5; write 5%."),
        # the permitted error and the accuracy are confused
        ([*PLAN, "--accuracy", "2"], "--accuracy must be in (0, 1). Got 2.0; write 98% for an error of 2%."),
        ([*PLAN, "--accuracy", "2%"], "--accuracy must be at least 0.5, because 0.98 permits an error of 2%. "
         "Got 0.02; write 0.98 for an error of 2%."),
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
    assert (registration("none").method, registration("none").pose_uncertainty) == ("planned", None)
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


def test_a_command_line_is_read_as_if_it_were_the_first():
    """Options are worked out once, and hold nothing of what was typed before."""
    words = ["plan", "block.off", "--camera", "camera.toml", "--entities"]
    first = parse([*words, "3,4", "--seed", "7"])
    second = parse([*words, "5"])
    assert (first.seed, second.seed) == (7, Plan.seed)
    assert first.typed == {"--camera", "--entities", "--seed"}
    assert second.typed == {"--camera", "--entities"}
    assert arguments_of(Plan) is arguments_of(Plan)
    assert not any(argument.tokens for argument in arguments_of(Plan))


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


# Numbers, defaults and the small commands: what a new user types first.


PLAN_CHECKS = [
    "plan",
    BLOCK,
    "--entities",
    "8",
    "--camera",
    "basler-acA2440-20gm-8mm",
    "--out",
    "out",
]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*PLAN_CHECKS, "--sigma-mm", "-1"], "--sigma-mm must be finite and not negative. Got -1."),
        (
            [*PLAN_CHECKS, "--sigma-rad", "nan"],
            "--sigma-rad must be finite and not negative. Got nan.",
        ),
        (
            [*PLAN_CHECKS, "--stand-off", "-1"],
            "--stand-off must be finite and not negative. Got -1.",
        ),
        ([*PLAN_CHECKS, "--simulate", "-1"], "--simulate must be at least 0. Got -1."),
        (
            ["info", BLOCK, "--min-length", "-3"],
            "--min-length must be finite and not negative. Got -3.",
        ),
        (["simulate", "plan.json", "--poses", "0"], "--poses must be at least 1. Got 0."),
    ],
)
def test_a_number_out_of_its_range_names_its_option(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == BAD_INPUT
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"aspectgraph: {message}\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("8", 8 * 2**30),
        ("1e-3", 2**30 / 1000),
        ("8GB", 8e9),
        ("1.5 gib", 1.5 * 2**30),
        ("500mb", 5e8),
    ],
)
def test_an_amount_of_memory_may_have_its_unit(text, value):
    assert memory(text) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["0", "-1", "8 apples", "nan", "inf", "", "GB", "8KB", "0GB"])
def test_what_is_no_amount_of_memory_is_refused(text):
    with pytest.raises(ValueError, match="must be a positive number of GiB"):
        memory(text)


def test_a_pitch_in_micrometres_is_refused(tmp_path, capsys):
    text = (
        "focal_length_mm = 8\npixel_pitch_mm = [3.45, 3.45]\nresolution = [64, 64]\nf_number = 8\n"
    )
    (tmp_path / "camera.toml").write_text(text + "focus_distance_mm = 300\n")
    out = str(tmp_path / "out")
    assert (
        main(["plan", BLOCK, "--all", "--camera", str(tmp_path / "camera.toml"), "--out", out])
        == BAD_INPUT
    )
    assert (
        "camera.toml:2: pixel_pitch_mm must be at most 0.5 mm; 3.45 um are 0.00345. Got 3.45."
        in (capsys.readouterr().err)
    )


def test_help_tells_defaults_once(capsys):
    assert main(["plan", "--help"]) == DONE
    text = " ".join(capsys.readouterr().out.split())
    for told in (
        "of the camera's position (default: 0.2 mm)",
        "from the part (default: 50 mm)",
        "displaced poses per setting (default: 10000)",
    ):
        assert told in text
    assert "at most one per core" in text
    assert "default: None" not in text
    assert "default: False" not in text


def test_cameras_are_listed(capsys):
    assert main(["cameras"]) == DONE
    lines = capsys.readouterr().out.splitlines()
    listed = [line.split()[0] for line in lines if " x " in line]
    assert listed == list(camera_names())
    row = next(line for line in lines if line.startswith("basler-acA2440-20gm-8mm"))
    # thin lens: the field at the distance s of sharp focus is the sensor's (s - f) / f times; 2448 x 0.00345 mm wide
    assert row.endswith(
        f"{2448 * 0.00345 * (300 - 8) / 8:.0f} x {2048 * 0.00345 * (300 - 8) / 8:.0f}"
    )
    assert main(["cameras", "--json"]) == DONE
    records = json.loads(capsys.readouterr().out)
    assert [Camera.from_dict(one) for one in records] == [
        Camera.named(name) for name in camera_names()
    ]


def test_facts_of_cameras_have_sources(capsys):
    assert main(["cameras", "--sources", "--json"]) == DONE
    parts = json.loads(capsys.readouterr().out)
    assert len(parts["body"]) >= 12
    assert len(parts["lens"]) >= 8
    for one in (*parts["body"].values(), *parts["lens"].values()):
        assert re.fullmatch(r"https://[\w.-]+/\S+", one["source"])
    assert parts["body"]["flir-BFS-U3-32S4M"]["resolution"] == [2048, 1536]
    assert parts["lens"]["falenses-FA1624M12A117"]["narrowest_f_number"] is None
    assert main(["cameras", "--sources"]) == DONE
    text = " ".join(capsys.readouterr().out.split())
    assert text.count("https://") == len(parts["body"]) + len(parts["lens"])


def test_lights_are_listed_with_sizes_and_sources(capsys):
    assert main(["lights"]) == DONE
    text = capsys.readouterr().out
    assert [name for name in light_names() if f"{name} " in text] == list(light_names())
    assert text.count("https://") + text.count("of no maker") == len(light_names())
    assert main(["lights", "--json"]) == DONE
    assert json.loads(capsys.readouterr().out)["coaxial"]["typical-50"]["side_mm"] == 50.0


LIGHTS_OF = ["lights", "examples/two_pocket_block_plan.json", "--part", BLOCK, "--quiet"]


def test_lights_are_compared_in_the_settings_of_a_plan(capsys):
    assert main([*LIGHTS_OF, "--json"]) == INCOMPLETE
    records = json.loads(capsys.readouterr().out)
    kinds = ["backlight", "coaxial", "diffuse-dome", "lamps", "ring-light"]
    assert sorted(record["kind"] for record in records) == kinds
    for record in records:
        assert sorted((*record["shown"], *record["dark"])) == ["e1", "e4"]
    counts = [len(record["shown"]) for record in records]
    assert counts == sorted(counts, reverse=True)


def test_the_light_that_suffices_is_named(capsys, monkeypatch):
    shows = [
        LightShows("coaxial", "a window", ("e1", "e2"), {"e3": "it is dark."}),
        LightShows("backlight", "a rectangle", ("e3",), {"e1": "it is dark.", "e2": "it is dark."}),
    ]
    monkeypatch.setattr(lights, "compare_lights", lambda *_, **__: tuple(shows))
    assert main(LIGHTS_OF) == INCOMPLETE
    text = capsys.readouterr().out
    assert "coaxial    2 of 3  e3" in text
    assert "backlight  1 of 3  e1, e2" in text
    assert (
        "No light shows all targets. coaxial shows most: 2 of 3. backlight shows e3, too." in text
    )
    shows[:] = [LightShows("coaxial", "a window", ("e1",))]
    assert main(LIGHTS_OF) == DONE
    assert "coaxial shows every target." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["lights", "--material", "metal"], "--material needs a plan."),
        (["lights", "examples/two_pocket_block_plan.json"], "Give --part PART."),
        (["lights", "--solids", "1"], "must be given with a part"),
    ],
)
def test_options_of_lights_that_say_nothing_are_refused(capsys, words, text):
    assert main(words) == 2
    assert text in capsys.readouterr().err


def test_the_assumed_unit_is_told(capsys):
    note = "note: OFF files state no unit, so the program assumes mm. Use --units for another unit"
    assert main(["info", BLOCK]) == DONE
    assert note in capsys.readouterr().out.splitlines()
    assert main(["info", BLOCK, "--units", "inch"]) == DONE
    out = capsys.readouterr().out
    assert note not in out
    # 60 x 60 x 40 of 25.4 mm
    assert "1524.00 x 1524.00 x 1016.00 mm" in out


def test_a_rule_chooses_edges(tmp_path, capsys):
    assert main(["info", BLOCK, "--select", "face = bottom"]) == DONE
    # the four sides of the base, 60 mm long
    assert "4 of 36 sharp straight edges" in capsys.readouterr().out
    graph = str(tmp_path / "g.graphml")
    assert (
        main(["graph", BLOCK, "--select", "face = bottom and direction = x", "--graphml", graph])
        == DONE
    )
    assert "of 2 entities" in capsys.readouterr().out
    assert main(["graph", BLOCK, "--select", "length > 900", "--graphml", graph]) == BAD_INPUT
    assert capsys.readouterr().err == (
        "aspectgraph: --select must hold for at least one edge. Got none for 'length > 900'.\n"
    )
    assert main(["graph", BLOCK, "--select", "convex", "--all", "--graphml", graph]) == BAD_INPUT
    assert "must not be given with" in capsys.readouterr().err


@pytest.mark.parametrize("wrong", ["", "1,,2", '"half', '"a"b', "1,"])
def test_what_is_no_list_of_solids_names_its_option(capsys, wrong):
    assert main(["info", BLOCK, f"--solids={wrong}"]) == BAD_INPUT
    rule = "must be numbers or names of solids like 0,2 or bracket,bolt:2"
    message = f"--solids {rule}. Got {wrong!r}; see aspectgraph info --help"
    assert capsys.readouterr().err == f"aspectgraph info: {message}\n"


@pytest.mark.parametrize(
    ("text", "solids"),
    [
        ("0, 2", [0, 2]),
        ("bracket,bolt:2,3", ["bracket", "bolt:2", 3]),
        ('"12","12":2', ["12", "12:2"]),
        ('"Gehäuse, groß":all,1.5', ["Gehäuse, groß:all", "1.5"]),
        ('"6"" pipe",it\'s 5" long', ['6" pipe', "it's 5\" long"]),
        ("-1", ["-1"]),
    ],
)
def test_solids_are_numbers_or_names(text, solids):
    assert solid_names(text) == solids


def test_lists_tell_the_units_of_their_numbers(capsys):
    part = str(Path(BLOCK).with_name("nist_ctc_01_ap242.stp"))
    assert main(["info", part, "--select", "kind = rim"]) == DONE
    out = capsys.readouterr().out
    assert "0 of 116 sharp straight edges" in out
    # no table of edges where there are none
    assert "from (mm)" not in out
    assert "diameter (mm)" in out
    assert main(["info", BLOCK]) == DONE
    assert "length (mm)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("part", "hint"),
    [("camera.toml", "; the camera seems to be 'camera.toml', so exchange the two"), (BLOCK, "")],
)
def test_a_part_for_the_camera_is_named(capsys, tmp_path, monkeypatch, part, hint):
    Path(tmp_path, "camera.toml").write_text("")
    block = str(Path(BLOCK).resolve())
    monkeypatch.chdir(tmp_path)
    part = block if part == BLOCK else part
    assert main(["plan", part, "--entities", "9", "--camera", block]) == BAD_INPUT
    rule = "--camera must be a TOML file, or a name that 'aspectgraph cameras' lists"
    assert capsys.readouterr().err == f"aspectgraph: {rule}. Got {block!r}, a part{hint}.\n"


def test_verbose_tells_where_an_error_arose(capsys):
    assert main(["info", "none.stp"]) == BAD_INPUT
    line = capsys.readouterr().err
    assert line == "aspectgraph: the part must be an existing file. Got 'none.stp'.\n"
    assert main(["info", "none.stp", "--verbose"]) == BAD_INPUT
    told = capsys.readouterr().err
    assert told.startswith("Traceback")
    assert told.endswith(line)
    assert main(["info", BLOCK, "--verbose", "--quiet"]) == BAD_INPUT
    assert "must not be given with" in capsys.readouterr().err


def test_an_error_names_the_part_file_in_whatever_folder_it_is(tmp_path, monkeypatch, capsys):
    path = tmp_path / "torn.step"
    path.write_text("nothing")
    monkeypatch.chdir(tmp_path)
    for part in ("torn.step", str(path)):
        assert main(["info", part]) == BAD_INPUT
        assert f"{part}: a STEP file must begin with" in capsys.readouterr().err


# what loads only with a part, or with what is computed from one
_HEAVY = ("aspectgraph.visibility", "scipy", "numba", "planner.optics")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--body", "box"], "--body must be of the catalogue"),
        (["--distances", "250,0"], "--distances must be finite and positive"),
        (["--write", "camera.txt"], "--write must end in .toml"),
        (["--write", "no/camera.toml"], "--write must be in a folder that exists"),
        (["--write", "known.toml"], "--write must be a new file"),
        (["--min-corner-deg", "90"], "--min-corner-deg must be below 90"),
        (["--workspace", "0", "0", "0", "9", "9", "0"], "--workspace must be finite, lower corner"),
        (["--localisation", "gauss"], "--localisation must be rounding, gaussian"),
        (["--localisation", "gaussian:x"], "--localisation must hold numbers"),
        (["--entities", "none.toml"], "--entities must name an existing file"),
        (["--dimensions", "none.toml"], "--dimensions must be 'all' or name an existing file"),
    ],
)
def test_a_bad_option_is_refused_before_anything_loads(tmp_path, arguments, message):
    """Otherwise a typing error costs three seconds; modules are counted, as no clock is sure."""
    (tmp_path / "known.toml").touch()
    wanted = [] if arguments[0] in ("--entities", "--dimensions") else ["--all"]
    program = (
        "import sys; from planner.app.main import main; code = main(sys.argv[1:]);"
        f"print([name for name in {_HEAVY!r} if name in sys.modules]); sys.exit(code)"
    )
    command = [sys.executable, "-c", program, "optics", BLOCK, *wanted, *arguments]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == BAD_INPUT
    assert f"aspectgraph: {message}" in ended.stderr
    assert ended.stdout == "[]\n"


# Every option that takes a value names itself, as it was typed, when the value is bad.


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
    "predict": ["box.off", "--all", *CAMERA, "--poses", "plan.json"],
    "program": ["plan.json", "box.off", "--cell", "cell.toml"],
    "reach": ["plan.json", "box.off", "--cell", "cell.toml"],
    "render": ["plan.json", "--part", "box.off", "--out", "out"],
    "lights": ["plan.json", "--part", "box.off"],
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
    "--edges": ["0.3..0.1"],
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
    "--material": ["wood"],
    "--memory-limit": ["0"],
    "--min-corner-deg": ["90"],
    "--min-length": NEGATIVE,
    "--min-length-px": NEGATIVE,
    "--occluders": NO_NUMBER,
    "--out": ["file"],
    "--cell-out": ["nowhere/placed.toml"],
    "--plan-out": ["nowhere/reached.json"],
    "--post-heights": ["high"],
    "--post-width": ["0"],
    "--part": ["nowhere.step"],
    "--picture": ["edges.txt"],
    "--pose-units": ["parsec"],
    "--poses": ["0"],
    "--register": ["nowhere.json"],
    "--rule": ["best"],
    "--probability": ["nan"],
    "--read-time-limit": ["0"],
    "--ready-input": NEGATIVE,
    "--rows": ["0"],
    "--operator": [" "],
    "--serial": [" "],
    "--scheduler": ["nowhere"],
    "--seed": NEGATIVE,
    "--select": ["colour = red"],
    "--separation-px": NEGATIVE,
    "--settle": NEGATIVE,
    "--split": ["always"],
    "--share": ["2"],
    "--sigma-hand-eye": ["0.1"],
    "--sigma-joints": NEGATIVE,
    "--sigma-mm": NEGATIVE,
    "--sigma-rad": ["inf"],
    "--sigma-part": ["-1mm,1mrad"],
    "--repeatability": ["-1mm,1mrad"],
    "--simulate": NEGATIVE,
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
    "--table": ["bench"],
    "--ways": ["3"],
    "--within": ["1", "1", "1", "0", "0", "0"],
    "--write": ["camera.txt"],
    "--workspace": ["1", "1", "1", "0", "0", "0"],
    "--white-level": ["4095.5"],
    "--response": ["9"],
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
    # read before the part
    cell = Path(BLOCK).with_name("cell.toml").read_text()
    (tmp_path / "cell.toml").write_text(cell.replace('"robots', f'"{Path(BLOCK).parent}/robots'))
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
    if (command, option) == ("batch", "--solids"):
        # each part says itself whether it has a solid of a name
        return [command, *needed, option, ","]
    return [command, *needed, option, *BAD[option]]


@pytest.mark.parametrize(("command", "option"), OPTIONS)
def test_a_bad_value_is_refused_in_one_line_that_names_its_option(folder, capsys, command, option):
    assert main([*_with(command, option), "--quiet"]) == 2
    caught = capsys.readouterr()
    (line,) = caught.err.splitlines()
    assert f"{option} " in f"{line} ".replace(":", " ")
    assert caught.out == ""
    assert not (folder / "out" / "plan.json").exists()


# Errors name the options of the command line, never those of a call in Python.


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


def test_a_pose_of_a_cell_is_named_with_its_file():
    error = RobotError.of_rule("part2base", "must not put the part through others", "(0, 0, 0) mm")
    text = in_words_of_shell(error, {"cell": "cell.toml"})
    assert text.startswith("cell.toml: part2base must not put the part through others. Got ")


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


@pytest.mark.parametrize("name", ["mfcad_6-11-11-19.step", "slotted_block.off"])
def test_reading_ends_with_the_time_of_the_plan(name):
    """A plan would have no time left. The kernel of STEP files is ended, and other readers at their next phase."""
    part = str(Path(BLOCK).with_name(name))
    options = parse(["plan", part, *PLAN[2:], "--time-limit", "10", "--quiet"])
    options.begun = time.monotonic() - 9.9999
    with pytest.raises(RequestError) as caught:
        read_part(options.part, options)
    assert caught.value.parameter == "time_limit_s"
    assert str(caught.value).endswith("must be long enough to read the part. Got 10.")
    # a shorter limit is for regions and search only
    options.time_limit = 0.5
    assert read_part(options.part, options).straight_edges()


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


def test_help_names_exit_codes_and_extras():
    for command in ("batch", "measure"):
        text = command_help(COMMANDS[command])
        assert "\nexit codes:\n  0  " in text
        assert "\n  2  bad input" in text
    picture = command_help(COMMANDS["info"]).partition("--picture")[2].partition("--select")[0]
    assert ".png, which needs the extra .[plot]," in " ".join(picture.split())


# Wrong files, texts and combinations: one line with the option as it was typed, and nothing is
# written.


EXAMPLES = Path(__file__).parents[3] / "examples"
BLOCK_BAD_INPUTS = str(EXAMPLES / "two_pocket_block.off")
CAMERA_BAD_INPUTS = ["--camera", "basler-acA2440-20gm-8mm"]
EDGES = ["plan", BLOCK_BAD_INPUTS, "--entities", "8", *CAMERA_BAD_INPUTS]
FOLDER = "'here', a folder"
NO_ENTITIES = "--entities must name edges, rims or arcs, or a file of them"

FILES = {
    "twice.json": '{"a": 17, "a": 18}',
    "unknown.toml": "a = 999",
    "dimensions.toml": "a = { distance = [25, 999], tolerance = [-0.1, 0.1] }",
    "camera.toml": "focal_length_mm = 8.0",
    "empty.toml": "",
    "lamps.toml": "lamp = 3",
    "whole_camera.toml": "name = 'left'\npixel_pitch_mm = 0.00345\nf_number = 8.0",
    "cell.toml": "home_deg = [0, 0]\n[robot]\nurdf = 'ur10.urdf'",
    "table.toml": "[dimensions]\na = { distance = [25, 27], max_error = 0.1 }",
}

BAD_BAD_INPUTS = {
    "a part of another unit": (
        ["plan", "huge.off", "--all", *CAMERA_BAD_INPUTS, "--time-limit", "1"],
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
        ["batch", "none", *CAMERA_BAD_INPUTS, "--out", "out"],
        "the folder of parts must be an existing folder. Got 'none'.",
    ),
    "a file for a folder of parts": (
        ["batch", "empty.toml", *CAMERA_BAD_INPUTS, "--out", "out"],
        "the folder of parts must be an existing folder. Got 'empty.toml', a file.",
    ),
    "a camera without fields": (
        ["graph", BLOCK_BAD_INPUTS, "--all", "--graphml", "g.graphml", "--camera", "empty.toml"],
        "--camera empty.toml:1: focal_length_mm must be given. Got none.",
    ),
    "a camera that lacks a field": (
        ["plan", BLOCK_BAD_INPUTS, "--all", "--camera", "camera.toml"],
        "--camera camera.toml:1: pixel_pitch_mm must be given. Got none.",
    ),
    "an unknown id": (
        ["plan", BLOCK_BAD_INPUTS, "--entities", "999", *CAMERA_BAD_INPUTS],
        "--entities: an edge id must be in 0..35. Got 999.",
    ),
    "an unknown id in a file": (
        ["graph", BLOCK_BAD_INPUTS, "--entities", "unknown.toml", "--graphml", "g.graphml"],
        "--entities unknown.toml: an edge id must be in 0..35. Got 999 for 'a'.",
    ),
    "a name twice": (
        ["plan", BLOCK_BAD_INPUTS, "--entities", "twice.json", *CAMERA_BAD_INPUTS],
        "--entities twice.json: an entity file must be valid JSON. Got twice.json: the name 'a' stands in it twice.",
    ),
    "a dimension of an unknown id": (
        ["optics", BLOCK_BAD_INPUTS, "--dimensions", "dimensions.toml"],
        "--dimensions dimensions.toml: dimension 'a': an edge id must be in 0..35. Got 999.",
    ),
    "dimensions for entities": (
        ["plan", BLOCK_BAD_INPUTS, "--entities", "table.toml", *CAMERA_BAD_INPUTS],
        f"{NO_ENTITIES}. Got 'table.toml', a file of dimensions; give it to --dimensions.",
    ),
    "dimensions without a table for entities": (
        ["graph", BLOCK_BAD_INPUTS, "--entities", "dimensions.toml", "--graphml", "g.graphml"],
        f"{NO_ENTITIES}. Got 'dimensions.toml', a file of dimensions.",
    ),
    "a camera for entities": (
        ["plan", BLOCK_BAD_INPUTS, "--entities", "whole_camera.toml", *CAMERA_BAD_INPUTS],
        f"{NO_ENTITIES}. Got 'whole_camera.toml', a camera file; give it to --camera.",
    ),
    "a cell for dimensions": (
        ["plan", BLOCK_BAD_INPUTS, "--dimensions", "cell.toml", *CAMERA_BAD_INPUTS],
        "--dimensions must be 'all' or a file of dimensions. Got 'cell.toml', a cell file; give it to --cell.",
    ),
    "a camera for a cell": (
        ["plan", BLOCK_BAD_INPUTS, "--all", "--cell", "whole_camera.toml", *CAMERA_BAD_INPUTS],
        "--cell must be a cell file, which names a robot. Got 'whole_camera.toml', a camera file; give it to --camera.",
    ),
    "dimensions for a cell": (
        ["plan", BLOCK_BAD_INPUTS, "--all", "--cell", "table.toml", *CAMERA_BAD_INPUTS],
        "--cell must be a cell file, which names a robot. Got 'table.toml', a file of dimensions; give it to "
        "--dimensions.",
    ),
    "dimensions for a camera": (
        ["plan", BLOCK_BAD_INPUTS, "--all", "--camera", "table.toml", "--out", "out"],
        "--camera must be a TOML file, or a name that 'aspectgraph cameras' lists. Got 'table.toml', a file of "
        "dimensions; give it to --dimensions.",
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
        ["graph", BLOCK_BAD_INPUTS, "--all", "--graphml", "g.graphml", "--contrast", "0.3"],
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


@pytest.mark.parametrize(
    ("arguments", "message"), BAD_BAD_INPUTS.values(), ids=list(BAD_BAD_INPUTS)
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    Path("here").mkdir()
    for name, text in FILES.items():
        Path(name).write_text(text)
    head, _, sizes, *lines = Path(BLOCK_BAD_INPUTS).read_text().splitlines()
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
        (["info", BLOCK_BAD_INPUTS, "more"], "info: unknown argument 'more'; see"),
        (
            ["lights", "plan", "p.stp"],
            "unknown argument 'p.stp'. Name the part by --part p.stp; see",
        ),
        (
            ["measure", "plan", "images", "p.stp", "--out", "m"],
            "unknown argument 'p.stp'. Name the part by --part p.stp; see",
        ),
        (
            ["reach", "plan", "--part", "p.stp", "--cell", "c.toml"],
            "unknown option --part: the part is given without a name, as PART; see",
        ),
        (
            ["plan", BLOCK_BAD_INPUTS, *CAMERA_BAD_INPUTS],
            "plan: one of --entities, --select, --all, --dimensions must",
        ),
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


# Completion, asked of a real bash.


def completed(script, *words):
    """Return what bash offers for the last of some words."""
    line = " ".join(f"'{word}'" for word in words)
    ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _aspectgraph aspectgraph '{words[-1]}' '{words[-2]}'"
    show = 'printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(
        ["bash", "-c", f"{script}\n{ask}\n{show}"], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_options_and_cameras(capsys):
    assert main(["completion", "bash"]) == DONE
    script = capsys.readouterr().out
    assert completed(script, "aspectgraph", "si") == ["simulate"]
    assert completed(script, "aspectgraph", "plan", "part.stp", "--focus") == ["--focus-margin-mm"]
    assert completed(script, "aspectgraph", "simulate", "--se") == ["--seed"]
    assert completed(script, "aspectgraph", "plan", "--camera", "") == list(camera_names())


def test_zsh_gets_the_same_with_its_adapter(capsys):
    assert main(["completion", "bash"]) == DONE
    bash = capsys.readouterr().out
    assert main(["completion", "zsh"]) == DONE
    assert capsys.readouterr().out == "autoload -U +X bashcompinit && bashcompinit\n" + bash
