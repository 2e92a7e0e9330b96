"""Streams that are closed, full, read no further or of a poor encoding: one clear line, and the right exit code."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from planner.app import plan_commands as commands
from planner.app.main import termination_as_interruption
from planner.app.process import shortage, write_fault
from planner.files import absolute, path_text
from planner.plan import read_plan
from planner.progress import terminal_progress
from planner.report.plan_folder import write_graph

llvm = pytest.importorskip("llvmlite.binding.executionengine")


SCRIPT = "import sys; from planner.app import start; sys.exit(start())"
EXAMPLE = Path(__file__).parents[3] / "examples" / "two_pocket_block.off"
# the project may lie in a folder with a space
TYPED = shlex.quote(str(EXAMPLE))


def run(arguments: str, shell: str = "{}", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command line inside a line of bash, as somebody types it."""
    line = shell.format(f'"{sys.executable}" -c "{SCRIPT}" {arguments}')
    given = {**os.environ, **environment}
    command = ["bash", "-c", line]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=given)


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
@pytest.mark.parametrize("arguments", ["--version"])
def test_closed_output_is_refused_in_one_line(arguments):
    done = run(arguments, "{} >&-")
    assert done.returncode == 2
    assert done.stderr == "aspectgraph: standard output must be open. Got a closed one.\n"


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
def test_closed_errors_do_not_go_to_the_output():
    done = run("info nowhere.off", "{} 2>&-")
    assert done.returncode == 2
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
def test_progress_without_standard_error_harms_nothing(tmp_path):
    graph = tmp_path / "g.graphml"
    done = run(f"graph {TYPED} --entities 17 --graphml {graph} --json", "{} 2>&- <&-")
    assert done.returncode == 0
    assert done.stdout.startswith("{")
    assert graph.is_file()


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
@pytest.mark.parametrize("arguments", ["cameras", "cameras --json"])
def test_a_reader_that_ends_first_is_no_error(arguments):
    """As of ``cat``: nothing is said, and a shell that asks learns of the closed pipe."""
    done = run(arguments, "{} | true; echo ${{PIPESTATUS[0]}}")
    assert done.stdout == "141\n"
    assert done.stderr == ""


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
def test_full_disk_under_the_errors_keeps_the_exit_code():
    if not Path("/dev/full").is_char_device():
        pytest.skip("no such device")
    assert run("info nowhere.off", "{} 2>/dev/full").returncode == 2


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
@pytest.mark.parametrize("arguments", ["--help"])
def test_help_on_a_full_disk_is_an_error(arguments):
    if not Path("/dev/full").is_char_device():
        pytest.skip("no such device")
    done = run(arguments, "{} >/dev/full")
    assert done.returncode == 2
    assert done.stderr.startswith("aspectgraph: standard output must be writable")


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
def test_a_name_that_the_encoding_lacks_is_escaped(tmp_path):
    part = tmp_path / "bücher.off"
    part.write_bytes(EXAMPLE.read_bytes())
    done = run(f"info {part}", PYTHONIOENCODING="ascii")
    assert done.returncode == 0
    assert done.stdout.startswith("b\\xfccher: 1 shell")


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
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


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
def test_a_path_that_is_too_long_names_its_option():
    done = run(f"info {TYPED} --picture {'x' * 5000}.png")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("aspectgraph: --picture must be a path that can be used. Got 'xxx")
    assert line.endswith("File name too long.")
    assert done.stdout == ""


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
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


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
def test_the_first_cause_says_most():
    error = ImportError("a page of advice")
    error.__cause__ = ImportError("libY.so: failed to map segment")
    assert "libY.so" in shortage(error)


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
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


@pytest.mark.skipif(os.name != "posix", reason="redirections of a POSIX shell")
def test_a_full_disk_under_the_log_does_not_end_the_work():
    full = _Full()
    with terminal_progress(full) as progress:
        progress(1, 1, "first")
        progress(1, 1, "second")
    assert full.refused


# An interruption gets through, but not in the middle of handing compiled loops over to C: there
# it crashed.


@pytest.fixture
def not_ignored():
    """Begin as at a terminal: what is started in the background inherits that interruptions are ignored."""
    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    yield
    for one, handler in before.items():
        signal.signal(one, handler)


def in_its_callback(work):
    """Run some work as if llvmlite had called it: by name and file, as the frame tells."""
    scope = {"work": work}
    exec(compile("def _raw_object_cache_getbuffer():\n    work()\n", llvm.__file__, "exec"), scope)
    scope["_raw_object_cache_getbuffer"]()


@pytest.mark.usefixtures("not_ignored")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_waits_until_loops_are_handed_over(number):
    done = []

    def work():
        os.kill(os.getpid(), number)
        # the handler runs before the next line does
        done.append("whole")

    def handed_over():
        in_its_callback(work)
        done.append("after")
        time.sleep(5.0)
        done.append("lost")

    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), termination_as_interruption():
        handed_over()
    assert done == ["whole", "after"]
    assert signal.getsignal(number) == before


@pytest.mark.usefixtures("not_ignored")
def test_an_interruption_waits_until_open3d_is_loaded(tmp_path):
    """Loading it takes a second; an interruption in it became an ImportError, told with a traceback."""
    package = tmp_path / "open3d"
    package.mkdir()
    (package / "__init__.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(0.1)\nloaded = True\n"
    )
    scope = {}

    def load():
        source = (package / "__init__.py").read_text()
        exec(compile(source, str(package / "__init__.py"), "exec"), scope)
        time.sleep(5.0)
        scope["lost"] = True

    with pytest.raises(KeyboardInterrupt), termination_as_interruption():
        load()
    assert scope["loaded"]
    assert "lost" not in scope


@pytest.mark.usefixtures("not_ignored")
def test_elsewhere_it_comes_at_once():
    with pytest.raises(KeyboardInterrupt), termination_as_interruption():
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.usefixtures("not_ignored")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_is_ignored_stays_ignored(number):
    signal.signal(number, signal.SIG_IGN)
    with termination_as_interruption():
        os.kill(os.getpid(), number)
        assert signal.getsignal(number) == signal.SIG_IGN
    assert signal.getsignal(number) == signal.SIG_IGN


@pytest.mark.usefixtures("not_ignored")
def test_the_functions_it_must_not_come_in_are_there():
    """Names of another package: if they change, the guard must."""
    assert os.path.basename(llvm.__file__) == "executionengine.py"
    names = {name for name in vars(llvm.ExecutionEngine) if name.startswith("_raw_object_cache")}
    assert {"_raw_object_cache_getbuffer", "_raw_object_cache_notify"} <= names


@pytest.mark.usefixtures("not_ignored")
def test_an_interruption_while_the_program_loads_is_one_line():
    """Pressed when the first of its own modules is looked for."""
    code = (
        "import sys\n"
        "class Pressed:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'planner.app.options':\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Pressed())\n"
        "from planner.app import start\n"
        "sys.exit(start())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "info", "part.step"], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "aspectgraph: interrupted\n")


@pytest.mark.usefixtures("not_ignored")
def test_the_command_begins_there():
    from importlib.metadata import entry_points

    (command,) = entry_points(group="console_scripts", name="aspectgraph")
    assert command.value == "planner.app:start"


# Worker processes of the command line: no more than cores, and none that outlives its parent.


_PARENT = """
import os, sys, time
from planner.app import plan_commands as commands
with commands._executor(2) as executor:
    futures = [executor.submit(os.getpid) for _ in range(8)]
    print(*{future.result() for future in futures}, flush=True)
    time.sleep(60)
"""


def _is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            # a zombie waits for init only
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.all_cores
@pytest.mark.skipif(sys.platform != "linux", reason="workers of Linux")
def test_no_worker_outlives_a_parent_that_is_killed():
    parent = subprocess.Popen([sys.executable, "-c", _PARENT], stdout=subprocess.PIPE, text=True)
    workers = [int(pid) for pid in parent.stdout.readline().split()]
    assert workers
    assert all(_is_running(pid) for pid in workers)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    for _ in range(100):
        if not any(_is_running(pid) for pid in workers):
            return
        time.sleep(0.05)
    pytest.fail("workers are still running five seconds later")


_TERMINATED_GROUP = """
import os, signal, time
from planner.app import plan_commands as commands
from planner.app.main import termination_as_interruption
with termination_as_interruption(), commands._executor(2) as executor:
    executor.submit(os.getpid).result()
    workers = set(executor._processes)
    try:
        os.killpg(0, signal.SIGTERM)
        time.sleep(60)
    except KeyboardInterrupt:
        print(executor.submit(os.getpid).result() in workers, flush=True)
"""


@pytest.mark.all_cores
@pytest.mark.skipif(os.name != "posix", reason="groups of processes")
def test_workers_go_on_when_the_whole_group_is_terminated():
    """As `timeout` does: the parent ends the search, and needs them for the plan that is kept."""
    done = subprocess.run(
        [sys.executable, "-c", _TERMINATED_GROUP],
        capture_output=True,
        text=True,
        timeout=60,
        start_new_session=True,
    )
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr


def test_there_are_no_more_workers_than_cores(monkeypatch):
    asked = []

    class Pool:
        def __init__(self, jobs, **_):
            asked.append(jobs)

        def shutdown(self, **_):
            pass

    monkeypatch.setattr("planner.app.batch.ProcessPoolExecutor", Pool)
    monkeypatch.setattr(commands, "usable_cores", lambda: 3)
    with commands._executor(200):
        pass
    assert asked == [3]


# The current folder may be deleted while a plan is made: the plan is not lost.


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


def test_a_fault_ends_with_one_full_stop(capsys):
    write_fault(ValueError("x must be finite. Got nan."), [])
    assert "Got nan. Please report it" in capsys.readouterr().err
