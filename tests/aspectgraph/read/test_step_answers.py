"""What the kernel's process answers when something goes wrong there, and what the reader makes of it."""

from __future__ import annotations

import io
import json
from types import SimpleNamespace

import numpy as np
import pytest

from aspectgraph import ReadError, ReadLimits, SolidError
from aspectgraph.read.step import step_file as client
from aspectgraph.read.step.server import LENGTHS, _answer, _send


def part_that(error):
    def answer(**_):
        raise error

    return SimpleNamespace(answer=answer)


@pytest.mark.parametrize(
    ("error", "kind", "message"),
    [
        (SolidError("a surface must be closed."), SolidError, r"^a surface must be closed\.$"),
        (
            MemoryError(),
            ReadError,
            r"within memory_mb=7 MB\. Got part\.stp, which takes more; allow more",
        ),
        (RuntimeError("Standard_OutOfMemory"), ReadError, r"within memory_mb=7 MB"),
        (
            RuntimeError("no\n  such\tsurface"),
            ReadError,
            r"on which it stops with RuntimeError: no such surface\.$",
        ),
        (ValueError(), ReadError, r"Got part\.stp, on which it stops with ValueError\.$"),
        (ValueError("x" * 1000), ReadError, r"ValueError: x{200}\.$"),
    ],
)
def test_every_error_of_the_kernel_is_one_of_ours(error, kind, message):
    header, arrays = _answer(part_that(error), {"do": "load"})
    assert arrays == {}
    kernel = client.StepKernel("part.stp", ReadLimits(memory_mb=7))
    complaint = kernel._complaint(json.loads(json.dumps(header)))
    assert type(complaint) is kind
    with pytest.raises(kind, match=message):
        raise complaint


def test_answers_are_read_as_they_were_sent_and_not_if_cut_off():
    sent = io.BytesIO()
    _send(sent, {"n": 3}, {"points": np.arange(6.0).reshape(2, 3)})
    kernel = client.StepKernel("part.stp", ReadLimits())
    kernel._requests = io.BytesIO()
    kernel._answers = io.BytesIO(sent.getvalue())
    header, arrays = kernel._exchange({"do": "load"})
    assert header == {"n": 3}
    assert arrays["points"].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert kernel._requests.getvalue() == b'{"do": "load"}\n'
    # within the lengths, the header, or the arrays
    for length in (0, LENGTHS.size - 1, LENGTHS.size + 3, len(sent.getvalue()) - 1):
        kernel._answers = io.BytesIO(sent.getvalue()[:length])
        assert kernel._exchange({"do": "load"}) is None
