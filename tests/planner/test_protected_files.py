"""What may not be written is told before the work, as it was named; links lead nowhere, round, or to what is kept."""

import os
import subprocess
import sys
from pathlib import Path

import networkx as nx
import pytest
from plan_examples import plan

from aspectgraph import OutputError as GraphOutputError
from aspectgraph import write_graphml
from aspectgraph.files import check_replaceable
from planner.exceptions import OutputError
from planner.files import GRAPHML, PLAN, check_file_place, output_folder, staged_folder, write_text
from planner.report.plan_folder import rescue, write_graph
from planner.resume import PlanningState

MARKED = "it is marked read-only"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def protected(path, text="mine"):
    path.write_text(text)
    path.chmod(0o444)
    return path


def refused(path, names=("plan.json", "colmap/images.txt")):
    with pytest.raises(OutputError) as caught, output_folder(path, names, "--out"):
        pytest.fail("the work has begun")
    return str(caught.value)


def test_a_file_that_is_marked_read_only_is_never_replaced(here):
    """A renaming would not ask."""
    path = protected(here / "plan.json")
    told = f"must be a file that can be written. Got: {MARKED}."
    with pytest.raises(OutputError, match=told):
        write_text(path, "other")
    with pytest.raises(GraphOutputError, match=f"Got .*plan.json': {MARKED}"):
        write_graphml(nx.Graph(), path)
    with pytest.raises(OutputError, match=f"^--graphml must be .* Got 'plan.json': {MARKED}"):
        check_file_place("plan.json", "--graphml")
    assert path.read_text() == "mine"
    assert os.listdir(here) == ["plan.json"]
    path.chmod(0o644)
    write_text(path, "other")
    assert path.read_text() == "other"


def test_a_folder_with_a_protected_file_is_refused_before_the_work_as_it_was_named(here):
    (here / "out" / "colmap").mkdir(parents=True)
    path = protected(here / "out" / "colmap" / "images.txt")
    assert (
        refused("out")
        == f"--out must be a folder that can be written. Got out: {MARKED} (colmap/images.txt)."
    )
    assert path.read_text() == "mine"


def test_whose_file_it_is_does_not_matter_in_a_folder_of_ones_own(here, monkeypatch):
    """A colleague's plan in a common folder may be replaced, as a renaming asks the folder only."""
    (here / "plan.json").write_text("a colleague's")

    def denied(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", denied)
        check_replaceable(here / "plan.json")
    # asking changes nothing
    assert (here / "plan.json").read_text() == "a colleague's"


def test_the_folder_of_the_set_that_cannot_be_written_is_named(here, monkeypatch):
    (here / "out" / "colmap").mkdir(parents=True)
    opened = os.open

    def mounted(path, *arguments, **options):
        if Path(path).parent.name == "colmap":
            raise OSError(30, "Read-only file system", str(path))
        return opened(path, *arguments, **options)

    monkeypatch.setattr(os, "open", mounted)
    assert refused("out").endswith("Got out: Read-only file system (colmap).")


def test_links_in_the_place_of_a_folder_are_told_for_what_they_are(here):
    for link, target in {"round": "and-round", "and-round": "round", "gone": "nowhere"}.items():
        (here / link).symlink_to(target)
    (here / "out").mkdir()
    (here / "out" / "colmap").symlink_to("nowhere")
    for path in ("round", "round/deep"):
        assert refused(path).endswith(f"Got {path}: round is a link that leads back to itself.")
    assert refused("gone/deep").endswith("Got gone/deep: gone is a link that leads nowhere.")
    assert refused("out").endswith("Got out: out/colmap is a link that leads nowhere.")
    with pytest.raises(
        OutputError, match=r"gone/state must be .* Got: gone is a link that leads nowhere\."
    ):
        PlanningState({}, Path("gone/state"))


@pytest.mark.parametrize("target", ["nowhere", "plan.json", "archive.json"])
def test_of_a_link_in_the_place_of_a_file_the_link_is_replaced(here, target):
    """What it leads to stays as it is, even where that may be written."""
    archive = protected(here / "archive.json")
    (here / "out").mkdir()
    links = [here / "out" / "plan.json", here / "plan.json", here / "graph.graphml"]
    for link in links:
        link.symlink_to(os.path.relpath(archive, link.parent) if target == archive.name else target)
    with staged_folder("out", ["plan.json"], "--out") as staging:
        (staging / "plan.json").write_text("new")
    write_text("plan.json", "new")
    check_file_place("graph.graphml")
    write_graphml(nx.Graph(), "graph.graphml")
    assert not any(map(os.path.islink, links))
    assert [path.read_text() for path in links[:2]] == ["new", "new"]
    assert archive.read_text() == "mine"
    assert not (here / "nowhere").exists()


def test_what_took_long_is_kept_at_home_where_nothing_temporary_can_be(here, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(here / "none"))
    told = rescue(plan(), here / "no-state")
    kept = next(here.glob("aspectgraph-*/plan.json"))
    assert told == f"The plan is in {kept} instead."
    assert kept.read_text().startswith("{")


def test_a_joint_graph_that_cannot_be_written_is_kept(here, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(here))
    path = protected(here / "g.graphml")
    graph = nx.Graph(entities=())
    with pytest.raises(OutputError) as caught:
        write_graph(graph, str(path), "--graphml")
    kept = next(here.glob("aspectgraph-*/graph.graphml"))
    assert str(caught.value) == (
        f"--graphml must be a file that can be written. Got '{path}': {MARKED}. The graph is in {kept} instead."
    )
    assert "</graphml>" in kept.read_text()


_MOUNTED = """
import subprocess, sys
from planner.exceptions import OutputError
from planner.files import output_folder
subprocess.run(["mount", "--bind", "out/plan.json", "out/plan.json"], check=True)
subprocess.run(["mount", "-o", "remount,ro,bind", "out/plan.json"], check=True)
try:
    with output_folder("out", ["plan.json"], "--out"):
        pass
except OutputError as error:
    print(error)
"""


def _may_mount():
    try:
        done = subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False)
    except OSError:
        return False
    return sys.platform == "linux" and done.returncode == 0


@pytest.mark.skipif(not _may_mount(), reason="nothing can be mounted here")
def test_a_plan_on_a_read_only_mount_is_found_out_before_the_work(here):
    """Permissions do not stop root, a mount does."""
    (here / "out").mkdir()
    (here / "out" / "plan.json").write_text("mine")
    done = subprocess.run(
        ["unshare", "-rm", sys.executable, "-c", _MOUNTED],
        capture_output=True,
        text=True,
        check=True,
    )
    assert (
        done.stdout
        == "--out must be a folder that can be written. Got out: Read-only file system (plan.json).\n"
    )
    assert os.listdir(here / "out") == ["plan.json"]


def test_a_file_replaces_only_one_of_its_kind(here):
    camera = here / "camera.toml"
    camera.write_text("f_number = 8\n")
    told = "^--graphml must be a new file, or a GraphML file. Got .*, which is another file"
    with pytest.raises(OutputError, match=told):
        check_file_place(camera, "--graphml", GRAPHML)
    write_graphml(nx.Graph(), here / "a.graphml")
    check_file_place(here / "a.graphml", "--graphml", GRAPHML)
    plan().write(here / "plan.json")
    check_file_place(here / "plan.json", "--plan-out", PLAN)
    (here / "empty").touch()
    check_file_place(here / "empty", "--graphml", GRAPHML)
    for name in ("a\0b", "half\ud800"):
        with pytest.raises(OutputError, match="--graphml must be the name of a file"):
            check_file_place(name, "--graphml", GRAPHML)
