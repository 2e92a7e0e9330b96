"""A digest of source files: every change of code changes it, and nothing else does."""

import os
import stat
import sys
from pathlib import Path

import pytest
from pipes_to_write import read_while

from aspectgraph import (
    EntityError,
    OutputError,
    files,
    read_entities,
    read_solid,
    write_edge_picture,
)
from aspectgraph.files import DEEPEST, check_plain, code_digest, is_device, replacing
from planner import Camera, CameraError
from planner.app.job import read_lighting
from planner.app.options import Light
from planner.exceptions import RequestError
from planner.request.dimension_files import read_wanted


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of two rooms, which can be found."""
    for name in ("rooms/__init__.py", "rooms/work/__init__.py", "rooms/show/__init__.py"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / "rooms"
    sys.modules.pop("rooms", None)


def digest(*without):
    code_digest.cache_clear()
    return code_digest(("rooms",), without)


def test_every_change_of_code_is_noticed(package):
    first = digest()
    assert len(first) == 64
    assert digest() == first
    (package / "notes.txt").write_text("no code")
    assert digest() == first
    (package / "work" / "more.py").write_text("")
    second = digest()
    (package / "work" / "more.py").write_text("x = 2\n")
    third = digest()
    (package / "work" / "more.py").rename(package / "work" / "other.py")
    assert len({first, second, third, digest()}) == 4


def test_what_decides_about_nothing_is_left_out(package):
    first = digest("rooms.show")
    (package / "show" / "__init__.py").write_text("x = 2\n")
    assert digest("rooms.show") == first
    (package / "work" / "__init__.py").write_text("x = 2\n")
    assert digest("rooms.show") != first


def test_without_files_the_version_counts(monkeypatch):
    code_digest.cache_clear()
    assert code_digest(("no_such_package",)) != code_digest(("aspectgraph",))
    monkeypatch.setattr("aspectgraph.files.version", lambda name: "0.0.7")
    before = code_digest(("no_such_package",))
    code_digest.cache_clear()
    assert code_digest(("no_such_package",)) != before


# What is no file is written to, and stays what it is.


BLOCK = "examples/two_pocket_block.off"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_written_to(tmp_path):
    pipe = tmp_path / "edges.html"
    os.mkfifo(pipe)
    with read_while(pipe) as got:
        write_edge_picture(read_solid(BLOCK), pipe)
    assert got[0].rstrip().endswith("</html>")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert os.listdir(tmp_path) == ["edges.html"]


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no such device")
def test_a_device_is_never_replaced():
    """As root one may rename a file over it."""
    with (
        pytest.raises(
            OutputError,
            match=r"file that can be written\. Got '/dev/full': No space left on device",
        ),
        replacing("/dev/full") as beside,
    ):
        beside.write_text("some text")
    assert Path("/dev/full").is_char_device()


def test_files_folders_and_what_is_not_there_are_no_devices(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to("nowhere")
    assert not any(
        map(is_device, (tmp_path, tmp_path / "file", tmp_path / "link", tmp_path / "none", "a\0b"))
    )


# No more of a file than a limit is held.


@pytest.mark.parametrize(("large", "most"), [(False, 12), (True, 20)])
def test_a_file_is_read_up_to_its_limit(tmp_path, monkeypatch, large, most):
    monkeypatch.setattr(files, "SMALL_FILE_BYTES", 12)
    monkeypatch.setattr(files, "LARGE_FILE_BYTES", 20)
    path = tmp_path / "file"
    path.write_text("é\r\n" + "x" * (most - 4), encoding="utf-8")
    assert path.stat().st_size == most
    assert files.read_text(path, large=large) == "é\n" + "x" * (most - 4)
    path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(OSError, match=r"it has more than .* MB"):
        files.read_text(path, large=large)


def test_a_file_without_end_is_refused(monkeypatch):
    monkeypatch.setattr(files, "SMALL_FILE_BYTES", 1000)
    with pytest.raises(OSError, match=r"it has more than 0\.001 MB"):
        files.read_text("/dev/zero")


# Values of files that people write: neither deeper nor longer than code that prints them can
# bear.


# twice what Python recurses; TOML readers take the square of that in time
KEY = ".".join(["a"] * 2000)
DEEP = f"{KEY} = 1\n"
TABLE = f"[{KEY}]\nx = 1\n"
# hexadecimal digits have no limit in Python
LONG = f"a = 0x{'f' * 100_000}\n"


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


@pytest.mark.parametrize("text", [DEEP, TABLE, LONG])
def test_entities_dimensions_cameras_and_lamps_refuse_them(tmp_path, block, text):
    path = tmp_path / "values.toml"
    path.write_text(text)
    with pytest.raises(EntityError, match=r"nested too deep|too many digits"):
        read_entities(path, block)
    with pytest.raises(RequestError, match=r"nested too deep|too many digits"):
        read_wanted(path, ("length",))
    with pytest.raises(CameraError, match=r"nested too deep|too many digits"):
        Camera.from_toml(path)


@pytest.mark.parametrize("text", [DEEP, "lamps = " + "[" * 20_000 + "]" * 20_000, LONG])
def test_a_file_of_lamps_refuses_them(tmp_path, text):
    path = tmp_path / "lamps.toml"
    path.write_text(text)
    options = Light(light=str(path), grey_step=0.02)
    with pytest.raises(RequestError, match=r"nested too deep|too many digits"):
        read_lighting(options)


@pytest.mark.parametrize("text", ["9" * 5000, "3-" + "9" * 5000, "r" + "9" * 5000])
def test_ids_of_too_many_digits_are_refused(block, text):
    with pytest.raises(EntityError, match="entities must be 'all', ids"):
        read_entities(text, block)


def test_a_csv_row_with_such_an_id_is_refused(tmp_path, block):
    path = tmp_path / "ids.csv"
    path.write_text(f"a,{'9' * 5000}\n")
    with pytest.raises(EntityError, match="a CSV row must be a name and an id"):
        read_entities(path, block)


def test_the_limit_is_exact():
    value: object = 1
    for _ in range(DEEPEST - 1):
        value = [value]
    check_plain(value)
    with pytest.raises(ValueError, match="nested too deep"):
        check_plain([value])
