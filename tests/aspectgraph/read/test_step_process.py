"""The STEP kernel in its own process: what it may cost, how it ends, and that nothing of it is left."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aspectgraph import MissingExtraError, ReadError, ReadLimits, Solid, SolidError, read_solid
from aspectgraph.read.step import step_file as client
from aspectgraph.read.step.server import LENGTHS, _answer, _send

pytest.importorskip("OCP")


PART = Path(__file__).parents[3] / "examples" / "mfcad_6-11-11-19.step"

linux = pytest.mark.skipif(
    sys.platform != "linux", reason="limits memory and looks at processes as Linux does"
)


@pytest.fixture
def fake_kernel(monkeypatch, tmp_path):
    """Let the process run something else instead of the kernel; return where to write it."""
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / "OCP.py"


def test_a_crash_is_one_line(fake_kernel):
    fake_kernel.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)")
    with pytest.raises(
        ReadError, match=r"that OCCT can read\. Got mfcad_6-11-11-19\.step, on which it crashes"
    ) as caught:
        read_solid(PART)
    assert not isinstance(caught.value, MissingExtraError)
    assert "\n" not in str(caught.value)
    assert isinstance(read_solid(PART.with_name("slotted_block.off")), Solid)


def test_too_slow(fake_kernel):
    fake_kernel.write_text("while True: pass")
    started = time.monotonic()
    with pytest.raises(
        ReadError, match=r"within time_s=0\.5 seconds.*limits=ReadLimits\(time_s=...\)"
    ):
        read_solid(PART, limits=ReadLimits(time_s=0.5))
    assert time.monotonic() - started < 5.0


@linux
def test_too_little_memory():
    with pytest.raises(ReadError, match=r"memory_mb=1 MB"):
        read_solid(PART, limits=ReadLimits(memory_mb=1))


def test_what_the_kernel_prints_does_no_harm(monkeypatch, tmp_path):
    plain = read_solid(PART)
    noisy = f"""import os
from aspectgraph.read.step.part import StepPart
load = StepPart.load
def noisy(self, **options):
    open({str(tmp_path / "called")!r}, "w").close()
    os.write(1, b"noise" * 9999), os.write(2, b"noise" * 9999)
    return load(self, **options)
StepPart.load = noisy
from aspectgraph.read.step.server"""
    monkeypatch.setattr(
        client, "_PROGRAM", client._PROGRAM.replace("from aspectgraph.read.step.server", noisy)
    )
    assert read_solid(PART).edges == plain.edges
    assert (tmp_path / "called").exists()


def state_and_parent(pid: int | str) -> tuple[str, int]:
    """From /proc; the name of the program, in brackets, may hold blanks."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return "gone", 0
    return fields[0], int(fields[1])


def children(of: int) -> list[int]:
    pids = [path.name for path in Path("/proc").iterdir() if path.name.isdigit()]
    return [int(pid) for pid in pids if state_and_parent(pid)[1] == of]


def is_running(pid: int) -> bool:
    return state_and_parent(pid)[0] not in ("gone", "Z")


def wait_until(condition, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.02)
    return False


@pytest.fixture
def busy_reader(fake_kernel):
    """A process that reads a STEP file whose kernel never answers, and the id of the kernel's process."""
    fake_kernel.write_text("while True: pass")
    # without a main guard, as people write scripts; a job in the background ignores interrupts, as do its children
    script = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    script += f"import sys; sys.path[:] = {sys.path!r}\nfrom aspectgraph import read_solid\nread_solid({str(PART)!r})"
    reader = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE, text=True)
    assert wait_until(lambda: children(reader.pid), 60.0)
    time.sleep(0.5)
    yield reader, children(reader.pid)[0]
    reader.kill()
    reader.communicate()


@linux
def test_an_interrupt_ends_both_at_once(busy_reader):
    reader, kernel = busy_reader
    started = time.monotonic()
    reader.send_signal(signal.SIGINT)
    _, text = reader.communicate(timeout=20)
    assert time.monotonic() - started < 3.0
    assert text.strip().endswith("KeyboardInterrupt")
    assert "MissingExtraError" not in text
    assert not is_running(kernel)


@linux
def test_no_orphan_is_left(busy_reader):
    reader, kernel = busy_reader
    os.kill(reader.pid, signal.SIGKILL)
    reader.wait()
    assert wait_until(lambda: not is_running(kernel), 5.0)


@linux
def test_no_process_is_left_after_a_read():
    before = children(os.getpid())
    read_solid(PART)
    with pytest.raises(ReadError):
        read_solid(PART, solids=[5])
    assert children(os.getpid()) == before


def test_without_the_extra(monkeypatch, tmp_path):
    (tmp_path / "OCP.py").write_text("raise ImportError(\"No module named 'OCP'\")")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[step\]'") as caught:
        read_solid(PART)
    assert isinstance(caught.value, ImportError)
    assert "No module named 'OCP'" in str(caught.value)


# What the kernel's process answers when something goes wrong there, and what the reader makes of
# it.


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
