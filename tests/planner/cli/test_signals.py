"""An interruption gets through, but not in the middle of handing compiled loops over to C: there it crashed."""

import os
import signal
import time

import pytest

from planner.cli.signals import termination_as_interruption

llvm = pytest.importorskip("llvmlite.binding.executionengine")


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


def test_the_functions_it_must_not_come_in_are_there():
    """Names of another package: if they change, the guard must."""
    assert os.path.basename(llvm.__file__) == "executionengine.py"
    names = {name for name in vars(llvm.ExecutionEngine) if name.startswith("_raw_object_cache")}
    assert {"_raw_object_cache_getbuffer", "_raw_object_cache_notify"} <= names
