"""The caller's side of the STEP kernel's process: requests out, checked answers back, within limits."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from aspectgraph import exceptions
from aspectgraph.exceptions import MissingExtraError, ReadError, how_to_install
from aspectgraph.phases import report_phase
from aspectgraph.read.limits import ReadLimits, more_of
from aspectgraph.read.step.server import LENGTHS, OUT_OF_MEMORY

# The process needs a few modules of these rooms, not all that their faces import; so it starts in half a second.
_PROGRAM = """
import sys, types
sys.path[:] = {path!r}
for room in ("", ".read", ".read.step", ".read.step.facets", ".solid"):
    package = types.ModuleType("aspectgraph" + room)
    package.__path__ = [{folder!r} + room.replace(".", "/")]
    sys.modules[package.__name__] = package
from aspectgraph.read.step.server import serve
serve({parent!r}, {memory_mb!r})
"""


class StepKernel:
    """A process with the STEP kernel; to be used in a ``with`` block, at whose end it is gone.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    limits : ReadLimits
        The time limit is for all requests together.

    Raises
    ------
    MissingExtraError
        The package cadquery-ocp-novtk is not installed.
    ReadError
        The file crashed the kernel, or made it exceed a limit.
    """

    def __init__(self, name: str, limits: ReadLimits) -> None:
        self.name = name
        self.limits = limits
        self.seconds_left = limits.time_s

    def __enter__(self) -> StepKernel:
        program = _PROGRAM.format(
            path=sys.path,
            folder=str(Path(__file__).parents[2]),
            parent=os.getpid(),
            memory_mb=self.limits.memory_mb,
        )
        self.process: subprocess.Popen[bytes] = subprocess.Popen(
            [sys.executable, "-c", program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._requests = self.process.stdin
        self._answers = self.process.stdout
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self._answers.close()
        try:
            self._requests.close()
        except OSError:
            # a request that could not be delivered any more
            return

    def ask(self, do: str, **options: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Send a request and return its answer: JSON values and arrays."""
        timed_out = threading.Event()

        def stop() -> None:
            timed_out.set()
            self.process.kill()

        timer = threading.Timer(self.seconds_left, stop)
        timer.daemon = True
        started = time.monotonic()
        timer.start()
        try:
            answer = self._exchange({"do": do, "time_s": self.seconds_left, **options})
        finally:
            timer.cancel()
            self.seconds_left = max(self.seconds_left - (time.monotonic() - started), 1e-3)
        if answer is None:
            raise self._death(timed_out.is_set())
        header, arrays = answer
        if "error" in header:
            raise self._complaint(header)
        return header, arrays

    def _exchange(
        self, request: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        """Return the answer to a request, or None if the process died."""
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
        except OSError:
            # gone; what it said last may still be in the pipe
            pass
        while (answer := self._next_answer()) is not None and "phase" in answer[0]:
            report_phase(*answer[0]["phase"])
        return answer

    def _next_answer(self) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        head = self._answers.read(LENGTHS.size)
        if len(head) < LENGTHS.size:
            return None
        sizes = LENGTHS.unpack(head)
        header, packed = (self._answers.read(size) for size in sizes)
        if (len(header), len(packed)) != sizes:
            return None
        with np.load(io.BytesIO(packed), allow_pickle=False) as archive:
            return json.loads(header), dict(archive)

    def _death(self, timed_out: bool) -> ReadError:
        self.process.kill()
        code = self.process.wait()
        if timed_out or code == -getattr(signal, "SIGALRM", 0):
            written = f"time_s={self.limits.time_s:g}"
            more = more_of("time_s")
            more["mentions"] = (written, *more["mentions"])
            return ReadError.of_rule(
                "",
                f"a STEP file must be read within {written} seconds",
                f"{self.name}, which takes longer",
                **more,
            )
        if code == OUT_OF_MEMORY:
            return self._complaint({"error": "MemoryError"})
        cause = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return ReadError(
            f"a STEP file must be one that OCCT can read. Got {self.name}, on which it crashes ({cause}), or runs out "
            f"of its memory_mb={self.limits.memory_mb:g} MB."
        )

    def _complaint(self, header: dict[str, Any]) -> ReadError:
        if header["error"] == "MemoryError":
            return ReadError.of_rule(
                "",
                f"a STEP file must be read within memory_mb={self.limits.memory_mb:g} MB",
                f"{self.name}, which takes more",
                **more_of("memory_mb"),
            )
        if header["error"] == "MissingExtraError":
            if sys.version_info < (3, 11):
                advice = (
                    "it has no files for Python 3.10: read them with 3.11 or newer, or read a mesh"
                )
            else:
                advice = how_to_install("step")
            return MissingExtraError(
                f"STEP files need the package cadquery-ocp-novtk, 8 or newer. Got {header['message']}; {advice}"
            )
        if header["error"] == "KernelError":
            return ReadError(
                f"a STEP file must be one that OCCT can read. Got {self.name}, on which it stops with "
                f"{header['message']}."
            )
        return getattr(exceptions, header["error"])(header["message"])
