"""The process in which the STEP kernel runs: it answers requests until its input ends.

A request is a line of JSON. An answer is two lengths, then that many bytes of JSON and of an .npz archive. Before the
answer may come others with a phase, which only tell how far the work is. The kernel is a large C++ library that a
damaged file can crash or keep busy for ever; only answers reach the caller.
"""

from __future__ import annotations

import io
import json
import os
import signal
import struct
import sys
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from aspectgraph.exceptions import AspectGraphError
from aspectgraph.phases import die_with

if TYPE_CHECKING:
    from aspectgraph.read.step.part import StepPart


LENGTHS = struct.Struct("<QQ")
OUT_OF_MEMORY = 12
"""Exit code of a process without the memory to say so."""

_PAGE_COUNTS = "/proc/self/statm"


def serve(parent: int, memory_mb: float) -> None:
    """Answer requests from standard input on standard output.

    Parameters
    ----------
    parent : int
        Id of the process to die with.
    memory_mb : float
        See `ReadLimits`.
    """
    if os.name == "posix":
        # an interrupt is for the parent, which ends this process
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        die_with(parent)
    answers = os.fdopen(os.dup(1), "wb")
    # whatever the kernel prints must not end up between the answers
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    try:
        from aspectgraph.read.step.part import StepPart
    except ImportError as error:
        _send(answers, {"error": "MissingExtraError", "message": str(error)})
        return
    _limit_memory(memory_mb)
    part = StepPart()
    part.report = lambda done, total, label: _send(answers, {"phase": [done, total, label]})
    try:
        for line in sys.stdin.buffer:
            request = json.loads(line)
            _limit_time(request.pop("time_s"))
            _send(answers, *_answer(part, request))
    except MemoryError:
        # too little is left for an answer
        os._exit(OUT_OF_MEMORY)


def _answer(part: StepPart, request: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        return part.answer(**request)
    except AspectGraphError as error:
        return {"error": type(error).__name__, "message": str(error)}, {}
    except MemoryError:
        return {"error": "MemoryError"}, {}
    except Exception as error:
        # exceptions of the kernel have no common base in Python
        text = " ".join(str(error).split())[:200]
        if "memory" in f"{type(error).__name__} {text}".lower():
            return {"error": "MemoryError"}, {}
        return {
            "error": "KernelError",
            "message": f"{type(error).__name__}: {text}".rstrip(": "),
        }, {}


def _send(answers: IO[bytes], header: dict[str, Any], arrays: dict[str, Any] | None = None) -> None:
    packed = io.BytesIO()
    np.savez(packed, **(arrays or {}))
    text = json.dumps(header).encode()
    answers.write(LENGTHS.pack(len(text), packed.getbuffer().nbytes) + text)
    answers.write(packed.getbuffer())
    answers.flush()


def _limit_time(seconds: float) -> None:
    """Let the system end this process a little after the parent would have: the parent may be gone by then."""
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, seconds + 2.0)


def _limit_memory(megabytes: float) -> None:
    """Limit what this process may take beyond what the program itself takes by now."""
    try:
        import resource

        with open(_PAGE_COUNTS) as counts:
            in_use = int(counts.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (in_use + int(megabytes * 1e6),) * 2)
    except (ImportError, OSError, ValueError):
        # no such limit here; that on time still holds
        return
