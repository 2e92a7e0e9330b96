"""Requests to terminate: treated like an interruption from the keyboard, so that what was found out is kept."""

from __future__ import annotations

import _thread
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from planner.executors import TERMINATING

# compiled loops are handed over to C in functions of this file: an exception there is lost, and the process crashes
_HANDED_OVER = "executionengine.py"
# while this is loaded, an exception becomes another one that says nothing of an interruption
_LOADING = os.path.join("open3d", "__init__.py")
_LATER_S = 0.02


@contextmanager
def termination_as_interruption() -> Iterator[None]:
    """Raise `KeyboardInterrupt` in the block when the process is asked to terminate, or interrupted at the keyboard."""
    before = {}
    # signals are the main thread's; one that is ignored, as after nohup, stays so
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, *TERMINATING)}
    ours = [
        number
        for number, now in before.items()
        if now in (signal.SIG_DFL, signal.default_int_handler)
    ]
    try:
        for number in ours:
            signal.signal(number, _interrupt)
        yield
    finally:
        for number in ours:
            signal.signal(number, before[number])


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`; where that would not get through, a moment later."""
    while frame is not None:
        file = frame.f_code.co_filename
        name = frame.f_code.co_name
        handed_over = file.endswith(_HANDED_OVER) and name.startswith("_raw_object_cache")
        if handed_over or (file.endswith(_LOADING) and name == "<module>"):
            threading.Timer(_LATER_S, _thread.interrupt_main, (number,)).start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt
