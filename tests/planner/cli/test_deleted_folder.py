"""The current folder may be deleted while a plan is made: the plan is not lost."""

import subprocess
import sys
from pathlib import Path

import pytest

from planner.files import absolute, path_text
from planner.plan import read_plan
from planner.report.plan_folder import write_graph

BLOCK = Path(__file__).parents[3] / "examples" / "two_pocket_block.off"
_SCRIPT = """
import os, shutil, sys
from pathlib import Path
from planner.app import plan_commands as commands
from planner.app.main import main

here, out, block = map(Path, sys.argv[1:])
read = commands.read_job

def read_and_delete(options):
    job = read(options)
    shutil.rmtree(here)
    assert "open3d" not in sys.modules
    return job

here.mkdir()
os.chdir(here)
commands.read_job = read_and_delete
plan = ["plan", str(block), "--entities", "8", "--camera", "basler-acA2440-20gm-8mm"]
plan += ["--effort", "quick", "--simulate", "50", "--jobs", "1", "--quiet", "--out"]
code = main([*plan, str(out)])
print("absolute", code)
commands.read_job = lambda options: (read(options), shutil.rmtree(here))[0]
here.mkdir()
os.chdir(here)
print("relative", main([*plan, "inside"]))
shutil.move(here / "inside", out.with_name("moved"))
# and from the beginning in a folder that is not there
shutil.rmtree(here, ignore_errors=True)
commands.read_job = read
print("gone", main([*plan, "inside"]))
print("gone", main(["graph", str(block), "--entities", "8", "--graphml", "g.graphml"]))
print("gone", main(["batch", str(block.parent), "--camera", "x.toml", "--out", "o"]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it cannot be deleted")
def test_a_plan_outlives_the_folder_its_process_is_in(tmp_path):
    here = tmp_path / "here"
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(here), str(out), str(BLOCK)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line for line in lines if line.startswith(("absolute ", "relative ", "gone "))] == [
        "absolute 0",
        "relative 0",
        "gone 2",
        "gone 2",
        "gone 2",
    ]
    # where the user looks for it, though the folder was deleted
    assert read_plan(out / "plan.json").complete
    assert f"12 files in {out}/; open {out / 'report.html'}" in lines
    moved = read_plan(tmp_path / "moved" / "plan.json")
    assert (
        moved.settings[0].cam2world.tolist()
        == read_plan(out / "plan.json").settings[0].cam2world.tolist()
    )
    inside = here / "inside"
    assert f"12 files in {inside}/; open {inside / 'report.html'}" in lines
    errors = done.stderr.splitlines()
    assert len(errors) == 3
    assert errors[0].startswith(
        "aspectgraph: --out must be a folder that can be written. Got inside"
    )
    assert all(line.startswith("aspectgraph: ") for line in errors)


def test_a_plan_is_kept_where_only_the_last_place_takes_it(tmp_path, monkeypatch):
    """Neither the system's folder nor the current one: a user's home does."""

    class Graph:
        pass

    def write(graph, path):
        if tmp_path not in Path(path).parents:
            from aspectgraph import OutputError

            raise OutputError("path must be in a folder that can be written. Got: gone.")
        Path(path).write_text("graph")

    def gone():
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr("planner.report.plan_folder.write_graphml", write)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr(Path, "cwd", gone)
    monkeypatch.setenv("HOME", str(tmp_path))
    from planner.exceptions import OutputError

    with pytest.raises(OutputError) as caught:
        write_graph(Graph(), "/gone/g.graphml", "--graphml")
    (kept,) = tmp_path.glob("aspectgraph-*/graph.graphml")
    assert str(caught.value).endswith(f"The graph is in {kept} instead.")


def test_names_are_short_where_they_can_be(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert path_text(tmp_path / "out" / "plan.json") == str(Path("out", "plan.json"))
    assert path_text(tmp_path.parent / "x") == str(tmp_path.parent / "x")
    assert absolute("out") == tmp_path / "out"

    def gone():
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr("os.getcwd", gone)
    assert path_text(tmp_path / "out") == str(tmp_path / "out")
    assert absolute("out") == Path("out")
