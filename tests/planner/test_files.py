"""Files of one set appear in a folder together or not at all, wherever it is and whatever fails."""

import errno
import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pipes_to_write import read_while

from planner import files
from planner.exceptions import OutputError
from planner.files import check_file_place, output_folder, staged_folder, write_text

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
