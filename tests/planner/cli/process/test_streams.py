"""Streams that are closed, full, read no further or of a poor encoding: one clear line, and the right exit code."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from planner.app.process import shortage
from planner.progress import terminal_progress

SCRIPT = "import sys; from planner.app import start; sys.exit(start())"
EXAMPLE = Path(__file__).parents[4] / "examples" / "two_pocket_block.off"
# the project may lie in a folder with a space
TYPED = shlex.quote(str(EXAMPLE))

pytestmark = pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")


def run(arguments: str, shell: str = "{}", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command line inside a line of bash, as somebody types it."""
    line = shell.format(f'"{sys.executable}" -c "{SCRIPT}" {arguments}')
    given = {**os.environ, **environment}
    command = ["bash", "-c", line]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=given)


@pytest.mark.parametrize("arguments", ["--version"])
def test_closed_output_is_refused_in_one_line(arguments):
    done = run(arguments, "{} >&-")
    assert done.returncode == 2
    assert done.stderr == "aspectgraph: standard output must be open. Got a closed one.\n"


def test_closed_errors_do_not_go_to_the_output():
    done = run("info nowhere.off", "{} 2>&-")
    assert done.returncode == 2
    assert (done.stdout, done.stderr) == ("", "")


def test_progress_without_standard_error_harms_nothing(tmp_path):
    graph = tmp_path / "g.graphml"
    done = run(f"graph {TYPED} --entities 17 --graphml {graph} --json", "{} 2>&- <&-")
    assert done.returncode == 0
    assert done.stdout.startswith("{")
    assert graph.is_file()


@pytest.mark.parametrize("arguments", ["cameras", "cameras --json"])
def test_a_reader_that_ends_first_is_no_error(arguments):
    """As of ``cat``: nothing is said, and a shell that asks learns of the closed pipe."""
    done = run(arguments, "{} | true; echo ${{PIPESTATUS[0]}}")
    assert done.stdout == "141\n"
    assert done.stderr == ""


def test_full_disk_under_the_errors_keeps_the_exit_code():
    if not Path("/dev/full").is_char_device():
        pytest.skip("no such device")
    assert run("info nowhere.off", "{} 2>/dev/full").returncode == 2


@pytest.mark.parametrize("arguments", ["--help"])
def test_help_on_a_full_disk_is_an_error(arguments):
    if not Path("/dev/full").is_char_device():
        pytest.skip("no such device")
    done = run(arguments, "{} >/dev/full")
    assert done.returncode == 2
    assert done.stderr.startswith("aspectgraph: standard output must be writable")


def test_a_name_that_the_encoding_lacks_is_escaped(tmp_path):
    part = tmp_path / "bücher.off"
    part.write_bytes(EXAMPLE.read_bytes())
    done = run(f"info {part}", PYTHONIOENCODING="ascii")
    assert done.returncode == 0
    assert done.stdout.startswith("b\\xfccher: 1 shell")


@pytest.mark.parametrize("kilobytes", [60_000, 1_000_000])
def test_too_little_memory_is_one_line(tmp_path, kilobytes):
    """The first ends numpy's loading, the second that of the ray caster."""
    graph = tmp_path / "g.graphml"
    done = run(
        f"graph {TYPED} --entities 17 --graphml {graph} --quiet", f"ulimit -v {kilobytes}; {{}}"
    )
    if done.returncode == 0:
        pytest.skip("the limit is not kept here")
    (line,) = done.stderr.splitlines()
    assert line.startswith("aspectgraph: enough memory must be free. Got: ")
    assert done.returncode == 2


def test_a_path_that_is_too_long_names_its_option():
    done = run(f"info {TYPED} --picture {'x' * 5000}.png")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("aspectgraph: --picture must be a path that can be used. Got 'xxx")
    assert line.endswith("File name too long.")
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "enough memory must be free"),
        (
            ImportError("libX.so: failed to map segment from shared object"),
            "enough memory must be free",
        ),
        (RuntimeError("can't start new thread"), "threads or processes"),
        (BlockingIOError(11, "Resource temporarily unavailable"), "threads or processes"),
        (OSError(12, "Cannot allocate memory"), "enough memory must be free"),
    ],
)
def test_shortages_are_told_apart(error, words):
    assert words in shortage(error)


def test_the_first_cause_says_most():
    error = ImportError("a page of advice")
    error.__cause__ = ImportError("libY.so: failed to map segment")
    assert "libY.so" in shortage(error)


def test_other_errors_are_no_shortages():
    assert shortage(ImportError("No module named 'x'")) is None
    assert shortage(FileNotFoundError(2, "No such file", "x")) is None


class _Full:
    """A stream on a full disk."""

    encoding = "utf-8"
    refused = 0

    def isatty(self):
        return False

    def write(self, _):
        self.refused += 1
        raise OSError(28, "No space left on device")

    def flush(self):
        pass


def test_a_full_disk_under_the_log_does_not_end_the_work():
    full = _Full()
    with terminal_progress(full) as progress:
        progress(1, 1, "first")
        progress(1, 1, "second")
    assert full.refused
