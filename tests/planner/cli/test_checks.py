"""Numbers, defaults and the small commands: what a new user types first."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from planner import Camera, camera_names
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE
from planner.app.quantities import memory

BLOCK = str(Path(__file__).parents[3] / "examples" / "two_pocket_block.off")
PLAN = ["plan", BLOCK, "--entities", "8", "--camera", "basler-acA2440-20gm-8mm", "--out", "out"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*PLAN, "--sigma-mm", "-1"], "--sigma-mm must be finite and not negative. Got -1."),
        ([*PLAN, "--sigma-rad", "nan"], "--sigma-rad must be finite and not negative. Got nan."),
        ([*PLAN, "--stand-off", "-1"], "--stand-off must be finite and not negative. Got -1."),
        ([*PLAN, "--simulate", "0"], "--simulate must be at least 1. Got 0."),
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


@pytest.mark.parametrize("wrong", ["nonsense", "", "-1", "1.5"])
def test_what_is_no_list_of_solids_names_its_option(capsys, wrong):
    assert main(["info", BLOCK, f"--solids={wrong}"]) == BAD_INPUT
    message = f"--solids must be whole numbers like 0,2. Got {wrong!r}; see aspectgraph info --help"
    assert capsys.readouterr().err == f"aspectgraph info: {message}\n"


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
