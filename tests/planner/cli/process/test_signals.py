"""An interruption gets through, but not in the middle of handing compiled loops over to C: there it crashed."""

import os
import signal
import subprocess
import sys
import time

import pytest

from planner.app.main import termination_as_interruption

llvm = pytest.importorskip("llvmlite.binding.executionengine")


@pytest.fixture(autouse=True)
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


def test_elsewhere_it_comes_at_once():
    with pytest.raises(KeyboardInterrupt), termination_as_interruption():
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_is_ignored_stays_ignored(number):
    signal.signal(number, signal.SIG_IGN)
    with termination_as_interruption():
        os.kill(os.getpid(), number)
        assert signal.getsignal(number) == signal.SIG_IGN
    assert signal.getsignal(number) == signal.SIG_IGN


def test_the_functions_it_must_not_come_in_are_there():
    """Names of another package: if they change, the guard must."""
    assert os.path.basename(llvm.__file__) == "executionengine.py"
    names = {name for name in vars(llvm.ExecutionEngine) if name.startswith("_raw_object_cache")}
    assert {"_raw_object_cache_getbuffer", "_raw_object_cache_notify"} <= names


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


def test_the_command_begins_there():
    from importlib.metadata import entry_points

    (command,) = entry_points(group="console_scripts", name="aspectgraph")
    assert command.value == "planner.app:start"
