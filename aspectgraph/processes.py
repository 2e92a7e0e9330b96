"""Processes that do not outlive the one that started them."""

from __future__ import annotations

import os
import signal
import sys

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
