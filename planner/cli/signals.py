"""Requests to terminate: treated like an interruption from the keyboard, so that what was found out is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from planner.executors import TERMINATING


@contextmanager
def termination_as_interruption() -> Iterator[None]:
    """Raise `KeyboardInterrupt` in the block when the process is asked to terminate."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    ours = []
    # signals are the main thread's; one that is ignored, as after nohup, stays so
    if threading.current_thread() is threading.main_thread():
        ours = [one for one in TERMINATING if signal.getsignal(one) == signal.SIG_DFL]
    try:
        for one in ours:
            signal.signal(one, interrupt)
        yield
    finally:
        for one in ours:
            signal.signal(one, signal.SIG_DFL)
