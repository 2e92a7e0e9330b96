"""Compiling ahead: the list holds what plans need, each loop is compiled once, and others wait for it."""

from __future__ import annotations

import inspect
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from ground import ahead, leader
from ground.ahead import AheadRun, list_entry, read_list, taken
from ground.decorators import LoopCache
from ground.leader import Agenda
from ground.loop_code import decoded, encoded, named, plain_function, reachable

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

ROOT = Path(__file__).parents[2]
AGAIN = "ground/loops.json is out of date. Make it again with: make loops"
LOOPS = """
from ground.decorators import entry_kernel, kernel

@kernel
def inner(x):
    return x + 1.0

@entry_kernel
def outer(x):
    return inner(x) * 2.0
"""
LIST = [["loops:inner", "float64"], ["loops:outer", "float64"]]
SCRIPT = """
import sys, json
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from ground import ahead, leader
ahead.LISTED = Path(sys.argv[1]) / "list.json"
from ground.leader import compile_all
from numba.core import event

class Compiled(event.Listener):
    names = []
    def on_start(self, start):
        self.names.append(start.data["dispatcher"].py_func.__name__)
    def on_end(self, end):
        pass

event.register("numba:compile", Compiled())
if len(sys.argv) > 2:
    compile_all(2)
import loops
print(json.dumps([loops.outer(2.0), Compiled.names]))
"""


def test_all_that_is_listed_is_there():
    assert len(read_list()) > 150
    for address, *kinds in read_list():
        try:
            function = named(address)
        except (ImportError, AttributeError):
            pytest.fail(f"{address} is no longer there. {AGAIN}")
        assert len(kinds) == len(inspect.signature(function.py_func).parameters), AGAIN
        assert isinstance(function._cache, LoopCache)
        types = tuple(map(decoded, kinds))
        assert list_entry(function.py_func, types) == [address, *kinds]


def test_all_that_a_listed_loop_calls_is_listed():
    functions = [named(loop[0]) for loop in read_list()]
    listed = {id(plain_function(function)) for function in functions}
    called = {
        f"{other.py_func.__module__}:{other.py_func.__qualname__}"
        for function in functions
        for other in reachable(function)
        if isinstance(getattr(other, "_cache", None), LoopCache)
        and id(plain_function(other)) not in listed
        and "<locals>" not in other.py_func.__qualname__
    }
    assert called == set(), AGAIN


def test_a_plan_compiles_nothing_that_is_not_listed(tmp_path):
    """In a process of its own, which has no loops of other tests."""
    code = """
import json, sys
from numba.core.dispatcher import Dispatcher
from ground.ahead import list_entry
from planner.app.main import main
main(sys.argv[1:])
used = {
    json.dumps(list_entry(loop.py_func, args))
    for module in list(sys.modules.values())
    for loop in vars(module).values()
    if isinstance(loop, Dispatcher) and "_cache" in vars(loop)
    for args in loop.overloads
}
print(json.dumps(sorted(used)))
"""
    plan = [
        *("plan", "examples/two_pocket_block.off", "--entities", "17", "--effort", "quick"),
        *("--camera", "basler-acA2440-20gm-8mm", "--accuracy", "0.98", "--probability", "0.9"),
        *("--jobs", "1", "--quiet", "--simulate", "100", "--out", str(tmp_path / "plan")),
    ]
    done = subprocess.run(
        [sys.executable, "-c", code, *plan], cwd=ROOT, capture_output=True, text=True, check=True
    )
    used = json.loads(done.stdout.splitlines()[-1])
    listed = {json.dumps(loop) for loop in read_list()}
    assert len(used) > 10
    assert [loop for loop in used if loop not in listed] == [], AGAIN


@pytest.mark.parametrize(
    "kind",
    [
        numba.int64,
        numba.boolean,
        numba.none,
        numba.types.Array(numba.float64, 2, "C"),
        numba.types.Array(numba.uint8, 1, "A", readonly=True),
        numba.types.Tuple([numba.int64, numba.float64]),
        numba.types.UniTuple(numba.int64, 3),
        numba.types.Optional(numba.float64),
        numba.types.literal(3),
        numba.types.Omitted(1.5),
    ],
    ids=str,
)
def test_types_are_plain_data_and_back(kind):
    assert decoded(json.loads(json.dumps(encoded(kind)))) == kind


def test_a_type_without_words_is_not_listed():
    with pytest.raises(ValueError, match="must be one of the types"):
        encoded(numba.types.List(numba.int64))
    assert list_entry(test_a_type_without_words_is_not_listed, (numba.types.pyobject,)) is None


def test_callees_come_first_and_wishes_before_the_rest(monkeypatch):
    monkeypatch.setattr(leader, "_is_kept", lambda function, kinds: False)
    put = [
        "ground.decorators:put",
        ["array", "int64", 1, "C", 1, 1],
        ["array", "int64", 1, "C", 1, 1],
    ]
    agenda = Agenda([put, ["nowhere:gone"], put, put])
    assert agenda.missing == {1}
    assert agenda.take() == 0
    agenda.prefer([3])
    # no wish since then
    agenda.prefer([])
    assert [agenda.take(), agenda.take(), agenda.take()] == [3, 2, None]
    for index in (0, 2, 3):
        assert not agenda.is_done()
        agenda.finish(index)
    assert agenda.is_done()


def test_a_caller_waits_for_what_it_calls(tmp_path, monkeypatch):
    (tmp_path / "loops_of_agenda.py").write_text(LOOPS)
    monkeypatch.syspath_prepend(tmp_path)
    agenda = Agenda([["loops_of_agenda:inner", "float64"], ["loops_of_agenda:outer", "float64"]])
    assert agenda.take() == 0
    assert agenda.take() is None
    agenda.finish(0)
    assert agenda.take() == 1


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "loops.py").write_text(LOOPS)
    (tmp_path / "list.json").write_text(json.dumps(LIST))
    (tmp_path / "script.py").write_text(SCRIPT)
    return tmp_path


def run(folder, *more):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(folder / "script.py"), str(folder), *more],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_what_is_compiled_ahead_is_not_compiled_again(folder):
    assert run(folder, "ahead") == [6.0, []]
    assert len(list(folder.rglob("*.nbc"))) == len(LIST)
    assert len(list(folder.rglob("ahead-*.done"))) == 1
    assert not list(folder.rglob("ahead-*.state"))
    assert run(folder) == [6.0, []]


def test_without_the_list_all_is_compiled_where_it_is_needed(folder):
    (folder / "list.json").write_text("[]")
    assert run(folder, "ahead") == [6.0, ["outer", "inner"]]


def test_a_loop_is_waited_for_until_it_is_done(folder, monkeypatch):
    monkeypatch.setattr(ahead, "LISTED", folder / "list.json")
    state = folder / "ahead.state"
    handle = taken(state)
    assert taken(state) is None
    waited = AheadRun(state)
    monkeypatch.setattr(ahead._process, "run", waited)
    assert waited.is_active()
    assert waited.progress() is None

    def inner(x):
        return x

    inner.__module__ = "loops"
    inner.__qualname__ = "inner"
    kinds = (numba.float64,)
    assert ahead.is_awaited(inner, kinds)
    os.pwrite(handle, b"0 2 0    \n00", 0)
    assert waited.progress() == (0, 2, 0)
    assert ahead.is_awaited(inner, kinds)
    # another signature is not listed
    assert not ahead.is_awaited(inner, (numba.int64,))
    os.pwrite(handle, b"1 2 1    \n10", 0)
    # its file may have come meanwhile; after one more look it has not
    assert ahead.is_awaited(inner, kinds)
    assert not ahead.is_awaited(inner, kinds)
    # stopped, for instance
    monkeypatch.setattr(ahead, "_SILENCE_S", -1.0)
    assert not waited.is_active()
    assert waited.is_silent()
    monkeypatch.undo()
    monkeypatch.setattr(ahead._process, "run", waited)
    os.close(handle)
    assert ahead.is_awaited(inner, kinds)
    assert not ahead.is_awaited(inner, kinds)
    assert ahead.current_run() is None


def test_the_processes_end_with_the_program_that_started_them(folder, monkeypatch):
    (folder / "loops.py").write_text("import time\ntime.sleep(60)\n")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder / "kept"))
    monkeypatch.setattr(ahead, "LISTED", folder / "list.json")
    monkeypatch.setattr(ahead, "_has_kept", lambda: False)
    with ahead.compiling_ahead(2):
        started = ahead.current_run()
        assert started.is_active()
        assert ahead._begun(1).process is None
    deadline = time.monotonic() + 20
    while started.is_active() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not started.is_active()
    assert ahead.current_run() is None


@pytest.mark.parametrize("given_up", [False, True])
def test_a_stopped_leader_is_ended_too(folder, monkeypatch, given_up):
    """Neither the end of the program nor another one waits for it."""
    (folder / "loops.py").write_text("import time\ntime.sleep(60)\n")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder / "kept"))
    monkeypatch.setattr(ahead, "LISTED", folder / "list.json")
    monkeypatch.setattr(ahead, "_has_kept", lambda: False)
    with ahead.compiling_ahead(2):
        started = ahead.current_run()
        os.kill(started.process.pid, signal.SIGSTOP)
        if given_up:
            monkeypatch.setattr(ahead, "_SILENCE_S", -1.0)
            assert ahead.is_awaited(len, ())
            assert ahead.current_run() is None
            leader.compile_all(2)
            assert not list(folder.rglob("*.nbc"))
    assert started.process.returncode == -signal.SIGKILL
    assert not started.is_active()


def take_half_a_second(loop):
    time.sleep(0.5)
    return False


def test_the_state_is_written_when_a_loop_is_done_and_not_otherwise(folder, monkeypatch):
    """A process that compiles and hangs must not look like progress."""
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr(leader, "read_list", lambda: LIST[:1])
    monkeypatch.setattr(leader, "_compile", take_half_a_second)
    written = []
    monkeypatch.setattr(leader, "_write_state", lambda *state: written.append(state[2]))
    state = folder / "ahead.state"
    leader.lead(taken(state), str(state), str(folder / "done"), 1, ends_with_starter=False)
    assert len(written) == 2
    assert (folder / "done").exists()


def test_what_is_kept_is_not_asked_for(folder, monkeypatch):
    """No process begins where no loop lacks its file, and one that begins leaves alone those that are kept."""
    assert run(folder) == [6.0, ["outer", "inner"]]
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder / "kept"))
    # this process has loaded numba, which looks at the variable no more
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder / "kept"))
    monkeypatch.setattr(ahead, "LISTED", folder / "list.json")
    monkeypatch.setattr(ahead, "_has_kept", lambda: True)

    def listed(x):
        return x

    listed.__module__ = "loops"
    listed.__qualname__ = "inner"
    with ahead.compiling_ahead(2):
        assert ahead.may_begin()
        # of another signature, which is not listed
        assert not ahead.is_awaited(listed, (numba.int64,))
        assert ahead.current_run() is None
        assert not list(folder.rglob("ahead-*"))
        # this process does not wait for the other to start
        assert not ahead.is_awaited(listed, (numba.float64,))
        assert ahead.current_run().is_late
    assert not ahead.may_begin()
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "loops", raising=False)
    assert Agenda(LIST).is_done()
    for file in folder.rglob("loops.outer*.nbc"):
        file.unlink()
    assert Agenda(LIST).take() == 1


def test_one_process_compiles_for_itself(folder, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder / "kept"))
    monkeypatch.setattr(ahead, "LISTED", folder / "list.json")
    with ahead.compiling_ahead(1):
        assert ahead.current_run() is None
    assert not list(folder.rglob("ahead-*"))
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    with ahead.compiling_ahead(2):
        assert ahead.current_run() is None


def test_a_named_tuple_of_arrays_keeps_its_class():
    from aspectgraph.cells import arrays

    kinds = [
        kind
        for kind in vars(arrays).values()
        if isinstance(kind, type) and hasattr(kind, "_fields")
    ]
    assert kinds
    values = kinds[0](*(np.zeros(1) for _ in kinds[0]._fields))
    kind = numba.typeof(values)
    assert decoded(json.loads(json.dumps(encoded(kind)))) == kind
