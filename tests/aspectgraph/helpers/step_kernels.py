"""The STEP kernel's process in tests: answers kept for later tests, and one process for all reads of a module."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aspectgraph.files import ReadLimits
from aspectgraph.read.step.step_file import StepKernel

# Answers of the STEP kernel's process, kept for later tests: each read takes one to three
# seconds.
#
# What the program makes of an answer, it makes each time. Errors are not kept. Tests of the
# process itself get one of their own: they are in `tests/aspectgraph/read`.


START = StepKernel.__enter__
ASK = StepKernel.ask
END = StepKernel.__exit__
# by limits and the requests of a process so far
_answers: dict[tuple[str, ...], Any] = {}
_on = [False]


def remember(on: bool) -> None:
    """Say whether kernels that start from now on use what was kept."""
    _on[0] = on


def _start(kernel: StepKernel) -> StepKernel:
    if not _on[0]:
        return START(kernel)
    kernel.asked = (repr(kernel.limits),)
    kernel.waiting = []
    return kernel


def _ask(kernel: StepKernel, do: str, **options: Any) -> Any:
    if not hasattr(kernel, "asked"):
        return ASK(kernel, do, **options)
    kernel.asked += (_described(do, options),)
    if hasattr(kernel, "process") or kernel.asked not in _answers:
        if not hasattr(kernel, "process"):
            START(kernel)
            for earlier, given in kernel.waiting:
                ASK(kernel, earlier, **given)
        _answers[kernel.asked] = ASK(kernel, do, **options)
    kernel.waiting.append((do, options))
    return copy.deepcopy(_answers[kernel.asked])


def _end(kernel: StepKernel, *error: object) -> None:
    if hasattr(kernel, "process"):
        END(kernel, *error)


def _described(do: str, options: dict[str, Any]) -> str:
    """Return a request as a text, with the content of a file in place of where it is."""
    given = dict(options)
    if "path" in given:
        given["path"] = hashlib.sha256(Path(given["path"]).read_bytes()).hexdigest()
    return json.dumps([do, given])


StepKernel.__enter__ = _start
StepKernel.ask = _ask
StepKernel.__exit__ = _end


# One process of the STEP kernel for all reads of a test module: to start one takes a second.


@contextmanager
def one_kernel() -> Iterator[None]:
    """Let every read within ask the same process; it answers until its input ends."""
    start = StepKernel.__enter__
    end = StepKernel.__exit__
    first = START(StepKernel("all files", ReadLimits()))

    def join(kernel: StepKernel) -> StepKernel:
        kernel.process = first.process
        kernel._requests = first._requests
        kernel._answers = first._answers
        return kernel

    StepKernel.__enter__ = join
    StepKernel.__exit__ = lambda kernel, *error: None
    try:
        yield
    finally:
        StepKernel.__enter__ = start
        StepKernel.__exit__ = end
        END(first, None, None, None)
