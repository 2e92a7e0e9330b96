"""Files of one set appear in a folder together or not at all, wherever it is and whatever fails."""

import errno
import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import networkx as nx
import pytest
from pipes_to_write import read_while
from plan_examples import plan

from aspectgraph import OutputError as GraphOutputError
from aspectgraph import write_graphml
from aspectgraph.files import check_replaceable
from planner import files
from planner.exceptions import OutputError
from planner.files import GRAPHML, PLAN, check_file_place, output_folder, staged_folder, write_text
from planner.report.plan_folder import rescue, write_graph
from planner.resume import PlanningState

NAMES = ("plan.json", "graph.graphml", "colmap/images.txt")


def contents(folder):
    return {
        str(p.relative_to(folder)): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def write(folder, names, text):
    with staged_folder(folder, NAMES, "--out") as staging:
        (staging / "colmap").mkdir()
        for name in names:
            (staging / name).write_text(text)


@pytest.fixture
def out(tmp_path):
    """A folder with an older set and files of the user."""
    folder = tmp_path / "out"
    write(folder, NAMES, "old")
    for name in ("notes.txt", "colmap/database.db"):
        (folder / name).write_text("mine")
    return folder


def test_of_an_older_set_nothing_stays_and_all_else_does(out):
    write(out, ["plan.json", "colmap/images.txt"], "new")
    assert contents(out) == {
        "plan.json": "new", "colmap/images.txt": "new", "notes.txt": "mine", "colmap/database.db": "mine",
    }  # fmt: skip


@pytest.mark.parametrize("failing", range(1, 20))
@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()]
)
def test_whatever_step_fails_the_older_set_stays_whole(out, monkeypatch, failing, error):
    before = contents(out)
    steps = []
    fails = [True]

    def breaking(function, after):
        def step(*arguments, **options):
            steps.append(function)
            if len(steps) == failing and fails.pop():
                if after:
                    # an interruption may come when the step is done
                    function(*arguments, **options)
                raise error
            return function(*arguments, **options)

        return step

    for name in ("replace", "mkdir", "fsync"):
        monkeypatch.setattr(
            os, name, breaking(getattr(os, name), isinstance(error, KeyboardInterrupt))
        )
    caught = None
    try:
        write(out, NAMES[::2], "new")
    except (OutputError, KeyboardInterrupt) as stopped:
        caught = stopped
    monkeypatch.undo()
    # the last of these steps are one too many
    assert (caught is None) == bool(fails)
    after = {**before, "plan.json": "new", "colmap/images.txt": "new"}
    del after["graph.graphml"]
    assert contents(out) == (before if caught else after)


def test_a_file_that_cannot_be_replaced_is_named(out, monkeypatch):
    replace = os.replace

    def stuck(source, place):
        if Path(source).name == "images.txt" and "old" in Path(place).name:
            raise PermissionError(
                errno.EPERM, "Operation not permitted", str(source), None, str(place)
            )
        replace(source, place)

    before = contents(out)
    monkeypatch.setattr(os, "replace", stuck)
    with pytest.raises(
        OutputError, match=r"/out: Operation not permitted \(colmap/images\.txt\)\.$"
    ):
        write(out, NAMES, "new")
    assert contents(out) == before


def test_the_first_file_is_never_beside_others_of_another_set(out, monkeypatch):
    seen = []
    replace = os.replace

    def watch(source, place):
        replace(source, place)
        seen.append({name: (out / name).read_text() for name in NAMES if (out / name).exists()})

    monkeypatch.setattr(os, "replace", watch)
    write(out, NAMES, "new")
    with_plan = [found for found in seen if "plan.json" in found]
    assert len(seen) > len(with_plan) > 1
    assert all(len(set(found.values())) == 1 and len(found) == len(NAMES) for found in with_plan)


def test_another_file_system_in_a_folder_of_the_set_is_no_obstacle(out, monkeypatch):
    replace = os.replace

    def across(source, place):
        if (Path(source).parent.name == "colmap") != (Path(place).parent.name == "colmap") or (
            Path(source).parent != Path(place).parent and Path(place).parent.name == "colmap"
        ):
            raise OSError(errno.EXDEV, "Invalid cross-device link")
        replace(source, place)

    monkeypatch.setattr(os, "replace", across)
    write(out, NAMES, "new")
    assert {name: text for name, text in contents(out).items() if text != "mine"} == dict.fromkeys(
        NAMES, "new"
    )


def test_a_folder_whose_parent_cannot_be_written_will_do(out, monkeypatch):
    """Nothing is made beside it: it may be a mount point, or all that the user may write to."""
    mkdir = os.mkdir
    opened = os.open

    def inside(path):
        if not Path(path).is_relative_to(out):
            raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(os, "mkdir", lambda path, *a, **k: inside(path) or mkdir(path, *a, **k))
    monkeypatch.setattr(os, "open", lambda path, *a, **k: inside(path) or opened(path, *a, **k))
    write(out, NAMES, "new")
    monkeypatch.undo()
    assert contents(out)["plan.json"] == "new"


def hidden_by(out, pid):
    """Leave in a folder what a process leaves that is killed while it writes."""
    name = f".aspectgraph-{files._this_host()}-{pid}-abc"
    left = (f"{name}/plan.json", f"{name}-old-plan.json", f"colmap/{name}-new-images.txt")
    for path in left:
        (out / path).parent.mkdir(exist_ok=True)
        (out / path).write_text("half")
    return set(left)


@pytest.fixture
def dead_pid():
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_what_a_killed_run_left_is_removed_by_the_next(out, dead_pid):
    hidden_by(out, dead_pid)
    write(out, NAMES, "new")
    assert set(contents(out)) == {*NAMES, "notes.txt", "colmap/database.db"}


def test_what_another_process_writes_just_now_is_left_alone(out):
    """The parent of this process runs as long as the test."""
    live = hidden_by(out, os.getppid())
    # of a program that did not write its id, or of another machine
    for name in (".aspectgraph-x1", ".aspectgraph-01234567-1-x2"):
        (out / name).write_text("half")
        live.add(name)
    write(out, NAMES, "new")
    assert live <= set(contents(out))
    # two days later nobody writes there any more
    for name in live:
        os.utime(out / name, (time.time() - 2 * 86_400,) * 2, follow_symlinks=False)
        os.utime((out / name).parent, (time.time() - 2 * 86_400,) * 2)
    write(out, NAMES, "new")
    assert set(contents(out)) == {*NAMES, "notes.txt", "colmap/database.db"}


def test_nothing_is_written_through_a_link_in_the_place_of_a_folder(out, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    for path in (out / "colmap").iterdir():
        path.unlink()
    (out / "colmap").rmdir()
    (out / "colmap").symlink_to(tmp_path / "elsewhere")
    assert "colmap is a link to another folder" in refused(out)
    with pytest.raises(OutputError, match="colmap is a link to another folder"):
        write(out, NAMES, "new")
    assert list((tmp_path / "elsewhere").iterdir()) == []
    assert contents(out)["plan.json"] == "old"


def test_the_reason_behind_an_error_in_the_block_is_told(tmp_path):
    def full():
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise OutputError(
                f"some hidden file must be writable. Got: {error.strerror}."
            ) from None

    def fill():
        with staged_folder(tmp_path / "out"):
            full()

    with pytest.raises(
        OutputError,
        match=r"^output folder must be a folder that can be written\. Got .*/out: No space",
    ):
        fill()
    assert list(tmp_path.iterdir()) == []


# --- what is found out before the work ------------------------------------------------------------------------------


def refused(path, names=NAMES):
    with pytest.raises(OutputError) as caught, output_folder(path, names, "--out"):
        pytest.fail("the work has begun")
    return str(caught.value)


def test_places_that_are_no_folder_are_refused(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("file", "file/deep"):
        assert refused(tmp_path / name).endswith(f"{tmp_path / 'file'} is a file.")
    for name in ("link", "link/deep"):
        assert refused(tmp_path / name).endswith(
            f"{tmp_path / 'link'} is a link that leads nowhere."
        )
    assert "File name too long" in refused(tmp_path / ("x" * 300))
    assert sorted(os.listdir(tmp_path)) == ["file", "link"]


def test_what_is_in_the_way_of_a_file_is_told(tmp_path):
    (tmp_path / "one" / "plan.json").mkdir(parents=True)
    assert "plan.json is a folder" in refused(tmp_path / "one")
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "colmap").write_text("")
    assert "colmap is a file" in refused(tmp_path / "two")


@pytest.mark.parametrize("function", ["mkdir", "open", "fsync"])
def test_a_place_that_cannot_be_written_is_found_out_by_trying(tmp_path, monkeypatch, function):
    def fail(*arguments, **options):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(os, function, fail)
    message = refused(tmp_path / "new")
    monkeypatch.undo()
    assert (
        message
        == f"--out must be a folder that can be written. Got {tmp_path / 'new'}: Read-only file system."
    )
    assert list(tmp_path.iterdir()) == []


def test_folders_made_in_vain_are_removed_again_and_others_stay(tmp_path):
    (tmp_path / "there").mkdir()
    for name in ("there/a/b", "there"):
        with output_folder(tmp_path / name, NAMES) as folder:
            assert folder.is_dir()
    assert os.listdir(tmp_path) == ["there"]
    assert os.listdir(tmp_path / "there") == []
    with output_folder(tmp_path / "there" / "a", NAMES) as folder:
        (folder / "state").write_text("")
    assert contents(tmp_path) == {"there/a/state": ""}


def test_a_file_that_could_not_be_written_is_refused(tmp_path, monkeypatch):
    check_file_place(tmp_path / "g.graphml")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(
        OutputError, match=r"^--graphml must be a file that can be written\. Got '.*', a folder"
    ):
        check_file_place(tmp_path, "--graphml")
    with pytest.raises(
        OutputError,
        match=r"must be in a folder that exists and can be written\. Got .*No such file",
    ):
        check_file_place(tmp_path / "no" / "g.graphml")
    monkeypatch.setattr(
        os, "fsync", lambda handle: (_ for _ in ()).throw(OSError(errno.ENOSPC, "No space left"))
    )
    with pytest.raises(OutputError, match="No space left"):
        check_file_place(tmp_path / "g.graphml")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_written_to_and_stays_a_pipe(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    check_file_place(pipe)
    with read_while(pipe) as got:
        write_text(pipe, "some text")
    assert got == ["some text"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert os.listdir(tmp_path) == ["pipe"]


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no such device")
def test_a_device_is_never_replaced():
    """As root one may rename a file over it."""
    with pytest.raises(
        OutputError, match=r"/dev/full must be a file that can be written\. Got: No space left"
    ):
        write_text("/dev/full", "some text")
    assert Path("/dev/full").is_char_device()


# What may not be written is told before the work, as it was named; links lead nowhere, round, or
# to what is kept.


MARKED = "it is marked read-only"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def protected(path, text="mine"):
    path.write_text(text)
    path.chmod(0o444)
    return path


def refused_protected_files(path, names=("plan.json", "colmap/images.txt")):
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
        refused_protected_files("out")
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
    assert refused_protected_files("out").endswith("Got out: Read-only file system (colmap).")


def test_links_in_the_place_of_a_folder_are_told_for_what_they_are(here):
    for link, target in {"round": "and-round", "and-round": "round", "gone": "nowhere"}.items():
        (here / link).symlink_to(target)
    (here / "out").mkdir()
    (here / "out" / "colmap").symlink_to("nowhere")
    for path in ("round", "round/deep"):
        assert refused_protected_files(path).endswith(
            f"Got {path}: round is a link that leads back to itself."
        )
    assert refused_protected_files("gone/deep").endswith(
        "Got gone/deep: gone is a link that leads nowhere."
    )
    assert refused_protected_files("out").endswith(
        "Got out: out/colmap is a link that leads nowhere."
    )
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
