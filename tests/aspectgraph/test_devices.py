"""What is no file is written to, and stays what it is."""

import os
import stat
from pathlib import Path

import pytest
from pipes_to_write import read_while

from aspectgraph import OutputError, read_solid, write_edge_picture
from aspectgraph.files import is_device, replacing

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
