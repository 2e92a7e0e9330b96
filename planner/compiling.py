"""Compiling loops at the first run: reported once, with its progress, and collecting garbage seldom meanwhile."""

from __future__ import annotations

import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

from ground.ahead import can_keep, collect_seldom, current_run, may_begin
from ground.decorators import keeps_loops

_FIRST = "compiling loops, at the first run only: about a minute in all"
_EVERY = "compiling loops, at every run, because no folder can be written: about a minute in all"
_POLL_S = 0.25
_OURS = ("aspectgraph", "ground", "errors", "ga", "planner")


@contextmanager
def compiling_told(
    say: Callable[[str], object], report: Callable[[int, int], object]
) -> Iterator[None]:
    """Report once that loops are compiled, if they are, then the progress, and in the end how long it took.

    Meanwhile garbage is collected seldom.

    A run that finds them in the cache says nothing. Compiling makes millions of objects that stay, and looking through
    them for garbage again and again takes a quarter of the time.

    Parameters
    ----------
    say : callable
        Gets a line that stays: at the first loop, and in the end.
    report : callable
        ``report(done, total)``; the total counts the loops of all modules loaded, not all of which are needed.
    """
    listener = _Compiling(say, report)
    event.register("numba:compile", listener)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)  # type: ignore[no-untyped-call]
        listener.finish()


@contextmanager
def ahead_told(
    say: Callable[[str], object], report: Callable[[int, int], object]
) -> Iterator[None]:
    """Report how far other processes are that compile ahead for this one, if there are any.

    A run whose loops are all on disk says nothing.

    Parameters
    ----------
    say : callable
        Gets a line that stays, in the end.
    report : callable
        ``report(done, total)``, from another thread.
    """
    if not may_begin():
        yield
        return
    ended = threading.Event()
    watch = threading.Thread(target=_watch, args=(ended, say, report), daemon=True)
    watch.start()
    try:
        yield
    finally:
        ended.set()
        watch.join()


def _watch(
    ended: threading.Event,
    say: Callable[[str], object],
    report: Callable[[int, int], object],
) -> None:
    run = None
    while run is None:
        # it begins with the first loop that has no file
        if ended.wait(_POLL_S) or not may_begin():
            return
        run = current_run()
    begun = time.monotonic()
    total = 0
    while not ended.wait(_POLL_S) and run.is_active():
        progress = run.progress()
        if progress is not None and progress.compiled:
            total = progress.total
            report(progress.done, total)
    if total and not ended.is_set():
        report(total, total)
        say(
            f"compiling {total} loops took {time.monotonic() - begun:.0f} s; "
            "the next run finds them"
        )


class _Compiling(event.Listener):
    """Listens to numba, which begins to compile a function when its cache does not have it."""

    def __init__(self, say: Callable[[str], object], report: Callable[[int, int], object]) -> None:
        self._say = say
        self._report = report
        self._depth = 0
        self._collecting = False
        self._told = False
        self._is_told = False
        self._keeps = True
        self._begun = 0.0
        self._seconds = 0.0
        self._done: set[str] = set()

    def on_start(self, event: Any) -> None:
        """Take the start of a function; those it calls come before its end."""
        self._depth += 1
        if self._depth == 1:
            self._begun = time.monotonic()
            self._collecting = gc.isenabled()
            gc.disable()
            # otherwise `ahead_told` says it
            self._is_told |= current_run() is not None
            if not self._told and not self._is_told:
                self._told = True
                self._keeps = can_keep(Path(_function_of(event).__code__.co_filename))
                self._say(_FIRST if self._keeps else _EVERY)

    def on_end(self, event: Any) -> None:
        """Take the end of a function."""
        self._depth -= 1
        if self._depth == 0:
            self._seconds += time.monotonic() - self._begun
        if self._collecting:
            collect_seldom()
        if self._depth == 0 and self._collecting:
            gc.enable()
        function = _function_of(event)
        if function.__module__.partition(".")[0] in _OURS:
            self._done.add(f"{function.__module__}.{function.__qualname__}")
            self._report(len(self._done), max(len(self._done) + 1, _loops()))

    def finish(self) -> None:
        """Tell how many there were, and how long they took: other work was done between them."""
        if self._done:
            self._report(len(self._done), len(self._done))
        if self._done and not self._is_told:
            next_run = "finds them" if self._keeps and keeps_loops() else "compiles them again"
            self._say(
                f"compiling {len(self._done)} loops took {self._seconds:.0f} s; "
                f"the next run {next_run}"
            )


def _function_of(event: Any) -> Any:
    """Return the function that is compiled."""
    return event.data["dispatcher"].py_func


def _loops() -> int:
    """Return how many compiled functions the modules loaded have."""
    modules = [
        module for name, module in list(sys.modules.items()) if name.partition(".")[0] in _OURS
    ]
    return len(
        {
            id(value)
            for module in modules
            for value in vars(module).values()
            if isinstance(value, Dispatcher)
        }
    )
