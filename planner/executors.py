"""Tasks for executors: results in order.

Results do not depend on the executor, so a task must depend on its arguments only.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, TimeoutError
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Any

from ground.blas import with_one_thread

# between two calls of what is asked whether to go on
_POLL_S = 0.1

# signals that ask a process to end; not everywhere is there a terminal to be hung up
TERMINATING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]

# of compiled loops that release the interpreter's lock; no result depends on it
THREADS = 2


Check = Callable[[], None]
"""It raises when some work is to end."""

_check_now: ContextVar[Callable[[], Check] | None] = ContextVar("check_now", default=None)


@contextmanager
def checked_by(check_now: Callable[[], Check] | None) -> Iterator[None]:
    """Let `check_on_the_way` end the work in the block, also in tasks that `in_order` gives to others.

    Parameters
    ----------
    check_now : callable or None
        Returns a check that can be sent to other processes, as it is now. None ends nothing.
    """
    token = _check_now.set(check_now)
    try:
        yield
    finally:
        _check_now.reset(token)


def check_on_the_way() -> None:
    """End the work if it is late, see `checked_by`: to be called in pieces that take longer than a second."""
    check_now = _check_now.get()
    if check_now is not None:
        check_now()()


@with_one_thread
def _in_worker(check: Check | None, task: Callable[..., Any], *values: Any) -> Any:
    """Run a task with the check and the number of threads that it would have here."""
    with checked_by(None if check is None else lambda: check):
        return task(*values)


def usable_cores() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(
    executor: Executor | None,
    task: Callable[..., Any],
    arguments: Iterable[tuple[Any, ...]],
    check: Callable[[], None] | None = None,
) -> Iterator[Any]:
    """Run a task for each tuple of arguments; yield the results in order.

    Inside `checked_by`, tasks end where they call `check_on_the_way`, so that none holds up what comes after the end.

    Parameters
    ----------
    executor : concurrent.futures.Executor or None
        None runs each task when its result is asked for.
    task : callable
        At the top level of a module, so that other processes find it.
    arguments : iterable of tuple
    check : callable, optional
        Is called while results are waited for, or before each task; it may raise. Tasks not begun are then dropped.
    """
    if executor is None:
        for values in arguments:
            _call(check)
            yield task(*values)
        return
    check_now = _check_now.get()
    task = partial(_in_worker, None if check_now is None else check_now(), task)
    futures = [executor.submit(task, *values) for values in arguments]
    try:
        for future in futures:
            yield future.result() if check is None else _checked(future, check)
    finally:
        for future in futures:
            future.cancel()


def _checked(future: Future[Any], check: Callable[[], None]) -> Any:
    """Return the result of a task; now and then it is asked whether to go on."""
    while True:
        try:
            return future.result(_POLL_S)
        except TimeoutError:
            # the task may have raised one itself
            if future.done():
                raise
            check()


def _call(check: Callable[[], None] | None) -> None:
    if check is not None:
        check()


def leave_signals_to_the_parent(parent: int) -> None:
    """In a worker process, ignore what the parent answers: interruptions from the keyboard, and requests to terminate.

    All processes of a group get them, as from `timeout`. The parent still needs its workers to keep what was found.

    Parameters
    ----------
    parent : int
        Id of the process it works for. A forked worker dies with it: nobody else would end it.
    """
    # here, as the command line asks for help without it
    from aspectgraph.phases import die_with

    if multiprocessing.get_start_method() == "fork":
        die_with(parent)
    for signal_number in (signal.SIGINT, *TERMINATING):
        signal.signal(signal_number, signal.SIG_IGN)
