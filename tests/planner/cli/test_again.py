"""A plan is made again from its file."""

from __future__ import annotations

import json
import shutil

import pytest

from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE
from planner.plan import read_plan

CAMERA = "basler-acA2440-20gm-8mm"
WORK = ["--jobs", "1", "--simulate", "50", "--quiet"]


@pytest.fixture(scope="module")
def planned(tmp_path_factory, pytestconfig):
    """A folder with a part and its plan: an edge, a dimension, lamps, a localisation and limits of its own."""
    folder = tmp_path_factory.mktemp("again")
    shutil.copy(pytestconfig.rootpath / "examples" / "two_pocket_block.off", folder / "block.off")
    (folder / "edges.toml").write_text("rim = 8\n")
    request = ["--entities", str(folder / "edges.toml"), "--camera", CAMERA, "--effort", "quick"]
    request += ["--accuracy", "0.95", "--stand-off", "60", "--seed", "3", "--light", "at:0,0,900"]
    request += ["--units", "mm", "--separation-px", "4", "--localisation", "gaussian:0.2"]
    out = ["--out", str(folder / "plan")]
    assert main(["plan", str(folder / "block.off"), *request, *out, *WORK]) in (DONE, 1)
    return folder


def refusal(capsys, *arguments):
    capsys.readouterr()
    assert main(["plan", *arguments]) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_plan_made_again_is_the_same_byte_for_byte(planned, tmp_path):
    """Also where part and plan were moved together."""
    moved = tmp_path / "moved"
    shutil.copytree(planned, moved)
    again = ["--again", str(moved / "plan" / "plan.json"), "--out", str(moved / "again")]
    assert main(["plan", *again, *WORK]) in (DONE, 1)
    for name in ("plan.json", "measurements.csv", "poses_opencv.json"):
        assert (moved / "again" / name).read_bytes() == (planned / "plan" / name).read_bytes()
    found = read_plan(moved / "again" / "plan.json")
    assert found.source == {"file": "../block.off", "units": "mm"}
    assert found.light is not None
    assert found.seed == 3


def test_the_folder_of_a_plan_stands_for_its_file(planned, tmp_path, monkeypatch):
    """Then the plan is written to ./plan, as any other."""
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "--again", str(planned / "plan"), *WORK]) in (DONE, 1)
    assert read_plan("plan").settings == read_plan(planned / "plan").settings


def test_a_simulation_refuses_another_part_than_that_of_the_plan(planned, tmp_path, capsys):
    other = tmp_path / "other.off"
    other.write_text((planned / "block.off").read_text().replace("60 ", "61 "))
    command = ["simulate", str(planned / "plan"), "--poses", "10", "--quiet", "--part"]
    assert main([*command, str(other)]) == BAD_INPUT
    assert capsys.readouterr().err == (
        "aspectgraph: --part must be the one that was planned. "
        f"Got '{other}', which has another shape.\n"
    )
    assert main([*command, str(planned / "block.off")]) != BAD_INPUT


def test_a_part_that_changed_or_is_gone_is_told(planned, tmp_path, capsys):
    moved = tmp_path / "moved"
    shutil.copytree(planned, moved)
    again = ["--again", str(moved / "plan" / "plan.json"), "--out", str(moved / "again"), *WORK]
    text = (moved / "block.off").read_text()
    (moved / "block.off").write_text(text.replace("60 ", "61 "))
    assert "the part must be the one that was planned. Got" in refusal(capsys, *again)
    (moved / "block.off").unlink()
    assert "block.off'; give PART, too, if it was moved" in refusal(capsys, *again)
    (moved / "there.off").write_text(text.replace("60 ", "61 "))
    line = refusal(capsys, str(moved / "there.off"), *again)
    assert f"Got '{moved / 'there.off'}', which has another shape; plan it from" in line
    # of a plan from Python, nothing says where its part is
    data = json.loads((moved / "plan" / "plan.json").read_text())
    source = data.pop("source")
    (moved / "plan" / "plan.json").write_text(json.dumps(data))
    assert "source must name the part's file" in refusal(capsys, *again)
    data |= {"source": source, "request": {**data["request"], "colour": "red"}}
    (moved / "plan" / "plan.json").write_text(json.dumps(data))
    assert "request.colour must be known to this program" in refusal(capsys, *again)
    assert not (moved / "again").exists()


def test_what_the_request_says_is_not_given_again(planned, tmp_path, capsys):
    again = ["--again", str(planned / "plan" / "plan.json"), "--out", str(tmp_path / "again")]
    for more in (["--accuracy", "0.9"], ["--seed=4"], ["--all"], ["--light", "ring"]):
        name = more[0].partition("=")[0]
        line = refusal(capsys, *again, *more)
        assert f"{name} must not be given with --again, which takes the request from" in line
    line = refusal(capsys, *again, "--units", "inch")
    assert "the part must be given with options that say how to read it" in line
    for arguments, message in (
        (["--out", "x"], "PART, --camera must be given"),
        (
            ["p.off", "--camera", "c", "--out", "x"],
            "one of --entities, --select, --all, --dimensions must be given",
        ),
        (["--again", "p.json"], "--again must be an existing plan file, or its folder"),
    ):
        assert message in refusal(capsys, *arguments)
