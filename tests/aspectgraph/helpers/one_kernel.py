"""One process of the STEP kernel for all reads of a test module: to start one takes a second."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from remembered_kernel import END, START

from aspectgraph.read.limits import ReadLimits
from aspectgraph.read.step.step_file import StepKernel


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
