"""Long work: its phases are reported to whoever waits, and its processes end with who started them."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

# Phases of long work, reported to whoever waits for it.
#
# A listener is called as ``progress(done, total, label)``. It holds for the current context, so
# that no function between the caller and the work needs a parameter for it. It may raise to
# cancel the work.


_LISTENER: ContextVar[Callable[[int, int, str], None] | None] = ContextVar("phases", default=None)


@contextmanager
def phases_reported_to(progress: Callable[[int, int, str], None] | None) -> Iterator[None]:
    """Report phases to a callable; for use in a ``with`` block.

    Parameters
    ----------
    progress : callable or None
        Takes how much is done, of how much, and the name of the phase. None: nothing is reported.
    """
    token = _LISTENER.set(progress)
    try:
        yield
    finally:
        _LISTENER.reset(token)


@contextmanager
def phases_checked_by(check: Callable[[], None]) -> Iterator[None]:
    """Call something at each report of a phase, besides the listener; for use in a ``with`` block.

    Parameters
    ----------
    check : callable
        May raise to cancel the work.
    """
    progress = _LISTENER.get()

    def checked(done: int, total: int, label: str) -> None:
        if progress is not None:
            progress(done, total, label)
        check()

    with phases_reported_to(checked):
        yield


def report_phase(done: int, total: int, label: str) -> None:
    """Report how far a phase is.

    Parameters
    ----------
    done, total : int
        Pieces of it.
    label : str
        Its name.
    """
    progress = _LISTENER.get()
    if progress is not None:
        progress(done, total, label)


@contextmanager
def phase(label: str) -> Iterator[None]:
    """Report the begin and the end of a phase; for use in a ``with`` block.

    Parameters
    ----------
    label : str
        Its name.
    """
    report_phase(0, 1, label)
    yield
    report_phase(1, 1, label)


# Processes that do not outlive the one that started them.


_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG


def die_with(parent: int) -> None:
    """Arrange that the death of the parent kills this process, whatever it is doing; on Linux.

    Parameters
    ----------
    parent : int
        Id of the process to die with. If it is dead already, this one ends at once.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
