"""The process that leads others in compiling the listed loops (`ahead`): callees before their callers."""

from __future__ import annotations

import gc
import multiprocessing
import os
import select
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from ground.ahead import (
    MOST_PROCESSES,
    PREFIX,
    AheadRun,
    collect_seldom,
    read_list,
    state_files,
    taken,
)
from ground.decorators import LoopCache
from ground.loop_code import decoded, named, plain_function, reachable

_STANDARD_INPUT = 0
_POLL_S = 0.1
# what compiling makes stays in memory: 0.74 GB after all of them, 0.45 after so many
_LOOPS_OF_PROCESS = 60


def lead(handle: int, state: str, done: str, processes: int, *, ends_with_starter: bool) -> None:
    """Compile all listed loops, each in one of several processes.

    Parameters
    ----------
    handle : int
        Descriptor of the state file, which holds its lock.
    state, done : str
        The state file, and the file that is made in the end.
    processes : int
        How many compile at once.
    ends_with_starter : bool
        Whether to end when standard input ends, which otherwise has the numbers of loops that are needed next.
    """
    loops = read_list()
    agenda = Agenda(loops)
    workers = [Worker() for _ in range(processes)]
    compiled = 0
    try:
        _write_state(handle, agenda, compiled)
        while not agenda.is_done():
            for worker in workers:
                if worker.index is None and (index := agenda.take()) is not None:
                    worker.begin(index, loops[index])
            ended = _ended(workers)
            for worker in ended:
                index, is_new = worker.result()
                agenda.finish(index)
                compiled += is_new
            if ended:
                # only then: others take the time of the file for that of the last loop
                _write_state(handle, agenda, compiled)
            if ends_with_starter:
                agenda.prefer(_wishes())
    except (EOFError, OSError):
        # a process was killed for its memory, for instance: whoever needs a loop compiles it
        return
    finally:
        for worker in workers:
            worker.close()
    if not agenda.missing:
        for old in Path(done).parent.glob(f"{PREFIX}*"):
            old.unlink(missing_ok=True)
        Path(done).touch()
    Path(state).unlink(missing_ok=True)


class Agenda:
    """Loops to be compiled, in the order of the list, but those that another one calls before it.

    Parameters
    ----------
    loops : list
        As `read_list` returns them. Those whose function is no longer there are left out, and those with a file.
    """

    def __init__(self, loops: list[list[Any]]) -> None:
        functions = [_function(loop[0]) for loop in loops]
        self.total = len(loops)
        # of a package that is not installed yet, for instance
        self.missing = {i for i, function in enumerate(functions) if function is None}
        self.finished = self.missing | {
            i for i in range(self.total) if _is_kept(functions[i], loops[i][1:])
        }
        self._needs = _needs(functions)
        self._waiting = [i for i in range(self.total) if i not in self.finished]

    def is_done(self) -> bool:
        """Return whether all are compiled."""
        return len(self.finished) == self.total

    def take(self) -> int | None:
        """Return the next loop all of whose callees are compiled, which waits no longer; None if there is none."""
        for index in self._waiting:
            if self._needs[index] <= self.finished:
                self._waiting.remove(index)
                return index
        return None

    def finish(self, index: int) -> None:
        """Take note that a loop is compiled."""
        self.finished.add(index)

    def prefer(self, indices: Sequence[int]) -> None:
        """Put these loops, and what they need, before all others; without any, keep the order."""
        if not indices:
            return
        first = {needed for index in indices for needed in (index, *self._needs[index])}
        self._waiting.sort(key=lambda index: (index not in first, index))


def _function(address: str) -> Any:
    try:
        return named(address)
    except (ImportError, AttributeError):
        return None


def _is_kept(function: Any, kinds: list[Any]) -> bool:
    """Return whether a loop has its file already; reading it is left to whoever needs it."""
    cache = getattr(function, "_cache", None)
    if not isinstance(cache, LoopCache):
        return False
    try:
        return cache.is_kept(tuple(map(decoded, kinds)))
    except (ImportError, AttributeError, ValueError):
        return False


def _needs(functions: list[Any]) -> list[set[int]]:
    """Return for each loop the earlier ones whose functions it can call."""
    called: dict[int, set[int]] = {}
    for function in functions:
        plain = id(plain_function(function))
        if function is not None and plain not in called:
            called[plain] = {id(plain_function(other)) for other in reachable(function)} - {plain}
    plains = [id(plain_function(function)) for function in functions]
    return [
        {k for k in range(i) if functions[i] is not None and plains[k] in called[plains[i]]}
        for i in range(len(functions))
    ]


class Worker:
    """A process that compiles one loop at a time; after some, another one takes its place.

    It has the modules of this process already where processes are forked.

    Attributes
    ----------
    index : int or None
        Of the loop that it compiles.
    connection : Connection
        To it; can be read when the loop is done.
    """

    def __init__(self) -> None:
        self.index: int | None = None
        self._start()

    def _start(self) -> None:
        forks = "fork" in multiprocessing.get_all_start_methods()
        context = multiprocessing.get_context("fork" if forks else None)
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, os.getpid()))
        self._process.start()
        theirs.close()
        self._n_left = _LOOPS_OF_PROCESS

    def begin(self, index: int, loop: list[Any]) -> None:
        """Let it compile a loop of the list."""
        if self._n_left == 0:
            self.close()
            self._start()
        self._n_left -= 1
        self.index = index
        self.connection.send(loop)

    def result(self) -> tuple[int, bool]:
        """Return the index of the loop that is done, and whether it was compiled; EOFError if the process died."""
        is_new = self.connection.recv()
        index = self.index
        assert index is not None
        self.index = None
        return index, is_new

    def close(self) -> None:
        """End the process after its loop."""
        with suppress(OSError):
            self.connection.send(None)
        self._process.join()
        self.connection.close()


def _ended(workers: Sequence[Worker]) -> list[Worker]:
    """Wait a moment, and return those that are done."""
    running = [worker for worker in workers if worker.index is not None]
    readable = wait([worker.connection for worker in running], _POLL_S)
    return [worker for worker in running if worker.connection in readable]


def _serve(connection: Connection, leader: int) -> None:
    """Compile what comes, until None does. Garbage is collected seldom, and the process ends with its leader."""
    gc.disable()
    threading.Thread(target=_end_with, args=(leader,), daemon=True).start()
    while (loop := connection.recv()) is not None:
        try:
            is_new = _compile(loop)
        except Exception:
            # a loop that no longer compiles for these types is nobody's need
            is_new = False
        connection.send(is_new)


def _end_with(leader: int) -> None:
    while os.getppid() == leader:
        time.sleep(_POLL_S)
    os._exit(1)


def _compile(loop: list[Any]) -> bool:
    """Compile a loop, or find it on disk; return whether it was compiled."""
    dispatcher = named(loop[0])
    before = sum(dispatcher.stats.cache_misses.values())
    dispatcher.compile(tuple(decoded(kind) for kind in loop[1:]))
    collect_seldom()
    return bool(sum(dispatcher.stats.cache_misses.values()) > before)


def _write_state(handle: int, agenda: Agenda, compiled: int) -> None:
    """Write counts, and for each loop whether it is done, over what stood there."""
    flags = "".join("1" if i in agenda.finished else "0" for i in range(agenda.total))
    counts = f"{len(agenda.finished)} {agenda.total} {compiled}"
    os.pwrite(handle, f"{counts:<30}\n{flags}".encode(), 0)


def _wishes() -> list[int]:
    """Return the loops that the starter waits for; end with it."""
    ready, _, _ = select.select([_STANDARD_INPUT], [], [], 0)
    if not ready:
        return []
    text = os.read(_STANDARD_INPUT, 2**16)
    if not text:
        # the processes notice it
        os._exit(0)
    return [int(line) for line in text.split() if line.isdigit()]


def compile_all(processes: int) -> None:
    """Compile all listed loops, and wait for it, also where another program compiles them already.

    If that program is stopped, its loops are left to whoever needs them.

    Parameters
    ----------
    processes : int
        How many compile at once.
    """
    files = state_files()
    if files is None:
        return
    state, done = files
    other = AheadRun(state)
    while not done.exists():
        handle = taken(state)
        if handle is not None:
            lead(handle, str(state), str(done), processes, ends_with_starter=False)
            return
        if other.is_silent():
            return
        time.sleep(_POLL_S)


if __name__ == "__main__":
    compile_all(int(sys.argv[1]) if len(sys.argv) > 1 else min(os.cpu_count() or 1, MOST_PROCESSES))
