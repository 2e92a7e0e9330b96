"""Requests to terminate: treated like an interruption from the keyboard, so that what was found out is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# not everywhere is there a terminal to be hung up
_TERMINATING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def termination_as_interruption() -> Iterator[None]:
    """Raise `KeyboardInterrupt` in the block when the process is asked to terminate."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    ours = []
    # signals are the main thread's; one that is ignored, as after nohup, stays so
    if threading.current_thread() is threading.main_thread():
        ours = [one for one in _TERMINATING if signal.getsignal(one) == signal.SIG_DFL]
    try:
        for one in ours:
            signal.signal(one, interrupt)
        yield
    finally:
        for one in ours:
            signal.signal(one, signal.SIG_DFL)


def leave_signals_to_the_parent(parent: int) -> None:
    """In a worker process, ignore an interruption from the keyboard, which every process gets; terminate at once.

    Parameters
    ----------
    parent : int
        Id of the process it works for. A forked worker dies with it: nobody else would end it.
    """
    # here, as the command line asks for help without them
    import multiprocessing

    from aspectgraph.processes import die_with

    if multiprocessing.get_start_method() == "fork":
        die_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for one in _TERMINATING:
        signal.signal(one, signal.SIG_DFL)
