"""What a loop calls: found through names, modules, closures and tuples of functions; no loop calls itself."""

import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import aspectgraph
import errors
import ga
import ground as compiled
import planner
from ground import ahead as folders
from ground import decorators as cache
from ground import loop_code as dependencies

ROOT = Path(__file__).parents[2]
PACKAGES = (aspectgraph, compiled, errors, ga, planner)


def loops():
    """Return all compiled functions of the packages."""
    every = {}
    for package in PACKAGES:
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            module = importlib.import_module(found.name)
            kept = [value for value in vars(module).values() if isinstance(value, Dispatcher)]
            every.update({id(loop): loop for loop in kept})
    return list(every.values())


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_no_loop_calls_itself_directly_or_not():
    """Numba's kept code of such functions crashed when it was read (numba #6061, #6713)."""
    every = loops()
    assert len(every) > 200
    recursive = []
    for loop in every:
        below = {
            id(dependencies.plain_function(deeper))
            for called in dependencies.callees(loop)
            for deeper in dependencies.reachable(called)
        }
        if id(loop.py_func) in below:
            recursive.append(loop.py_func.__qualname__)
    assert recursive == []


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_every_loop_is_kept_by_what_it_depends_on():
    other = [loop.py_func.__qualname__ for loop in loops() if not hasattr(loop, "_cache")]
    assert other == []
    numba_s = [
        loop.py_func.__qualname__
        for loop in loops()
        if not isinstance(loop._cache, cache.LoopCache)
    ]
    assert numba_s == []


def calls_itself(n):
    return n and calls_itself(n - 1)


def ping(n):
    return n and pong(n - 1)


def pong(n):
    return n and ping(n - 1)


@pytest.mark.parametrize("function", [calls_itself, ping])
def test_circles_are_found_and_their_digests_end(function):
    below = [
        deeper
        for called in dependencies.callees(function)
        for deeper in dependencies.reachable(called)
    ]
    assert function in below
    assert len(dependencies.digest_of(function)) == 64


TABLE = np.array([1.0, 2.0])
NAMES = frozenset({"one", "two", "three"})


def with_globals(x):
    return x + TABLE[0] + len(NAMES)


def test_the_content_of_a_table_counts(monkeypatch):
    before = dependencies.digest_of(with_globals)
    monkeypatch.setitem(globals(), "TABLE", np.array([1.0, 2.0]))
    assert dependencies.digest_of(with_globals) == before
    for other in (np.array([1.0, 3.0]), np.array([[1.0, 2.0]]), np.array([1.0, 2.0], np.float32)):
        monkeypatch.setitem(globals(), "TABLE", other)
        assert dependencies.digest_of(with_globals) != before


@pytest.mark.parametrize(("one", "other"), [(0.0, -0.0), (1, 1.0), (1, True), ((1, 2), [1, 2])])
def test_values_that_are_equal_to_python_but_not_to_a_compiler_differ(one, other):
    assert one == other or isinstance(one, tuple)
    held = [dependencies.digest_of(lambda x, held=held: (x, held)) for held in (one, other)]
    assert held[0] != held[1]


def test_a_profiler_changes_no_digest():
    """Otherwise a profiled program compiles its loops anew, and so does the next one that is not."""
    script = (
        "import cProfile, sys\n"
        "import numpy as np\n"
        "from planner.camera.pose_loops import move\n"
        "from ground.loop_code import digest_of\n"
        "call = lambda: move(np.eye(4), np.zeros((2, 6)), 0.0, np.empty((2, 4, 4)))\n"
        "cProfile.Profile().runcall(call) if sys.argv[1] == 'profiled' else call()\n"
        "print(digest_of(move))"
    )
    seen = {
        subprocess.run(
            [sys.executable, "-c", script, kind],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        ).stdout
        for kind in ("profiled", "plain")
    }
    assert len(seen) == 1


def test_the_digest_is_the_same_in_every_process():
    script = (
        "from errors.model import _joint_loop\n"
        "from ground.loop_code import digest_of\n"
        "print(digest_of(_joint_loop))"
    )
    seen = {
        subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    assert len(seen) == 1


def test_the_temporary_folder_must_not_be_one_that_others_can_replace(tmp_path, monkeypatch):
    monkeypatch.setattr(folders.tempfile, "gettempdir", lambda: str(tmp_path))
    assert folders.temporary_folder() is not None
    tmp_path.chmod(0o777)
    assert folders.temporary_folder() is None
    tmp_path.chmod(0o1777)
    assert folders.temporary_folder() is not None


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners of files")
def test_a_folder_of_another_user_is_not_trusted_unless_the_source_is(tmp_path, monkeypatch):
    source = tmp_path / "loops.py"
    source.write_text("")
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    assert folders.is_trusted(theirs / "new", source)
    (tmp_path / "link").symlink_to(theirs)
    if os.getuid() == 0:
        os.chown(theirs, 12345, -1)
    else:
        # all is another user's; so is the source
        monkeypatch.setattr(folders.os, "getuid", lambda: 12345)
        source = tmp_path / "no source"
    assert not folders.is_trusted(theirs / "new", source)
    assert not folders.is_trusted(tmp_path / "link" / "new", source)
    if os.getuid() == 0:
        # who owns the source can run code anyway
        os.chown(source, 12345, -1)
        assert folders.is_trusted(theirs / "new", source)


def test_a_circle_of_links_is_not_trusted(tmp_path):
    (tmp_path / "one").symlink_to(tmp_path / "two")
    (tmp_path / "two").symlink_to(tmp_path / "one")
    assert (
        not folders.is_trusted(tmp_path / "one" / "new", tmp_path / "loops.py") or os.name == "nt"
    )
