"""Memory of a joint graph: about how much it takes, told before the work, and looked at while it grows.

The cells of a joint graph grow faster than the number of its entities, and how fast depends on the part. So what is
known before is an estimate, from the cells of the single regions, that may err by `ERROR` either way; what the cells
hold while they grow is counted. A graph is refused before the work only if the estimate is too large by more than its
error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from aspectgraph.exceptions import MemoryLimitError
from aspectgraph.visibility.entity_region import Region
from aspectgraph.visibility.visibility_regions import Progress

# Bytes and seconds of a graph for (cells of all regions)^_POWER; how many times as much as the overlay's cells it takes
# in the end; and the factor by which the estimate may err. With 10, 20 and 60 edges of nist_ctc_01 the memory was 1.56,
# 1.37 and 0.88 of the estimate (the last by hand, the others by `benchmarks/joint_memory.py`). No other part is known.
_BYTES, _SECONDS, _POWER = 5.0, 2.5e-7, 2.0
_OF_OVERLAY = 4.0
ERROR = 3.0

_ADVICE = (
    "Ask for fewer entities, or for the regions only: compute_regions answers the same questions, and a plan needs no "
    "joint graph."
)
_GIB = 2**30


class JointEstimate(NamedTuple):
    """About what a joint graph costs.

    Attributes
    ----------
    memory_bytes : float
        Most memory it takes, beside what the process holds already.
    seconds : float
        Rough: a busy machine took four to five times as long.
    """

    memory_bytes: float
    seconds: float


def estimate_joint_graph(regions: Sequence[Region]) -> JointEstimate:
    """Return about what the joint graph of regions costs."""
    growth = float(sum(region.n_leaves for region in regions)) ** _POWER
    return JointEstimate(_BYTES * growth, _SECONDS * growth)


class JointMemory:
    """Ends the work on a joint graph that does not fit; see `overlay`, which it watches.

    Parameters
    ----------
    regions : sequence of Region
        Of the entities.
    limit_bytes : float, optional
        What the graph may take. Default: the memory that the machine has left.
    progress : callable, optional
        ``progress(done, total, "joint graph")``.

    Raises
    ------
    MemoryLimitError
        If the limit is no positive number, or the estimate is beyond it by more than its error.
    """

    def __init__(self, regions: Sequence[Region], limit_bytes: float | None, progress: Progress | None = None) -> None:
        self.total, self.progress = len(regions), progress
        self.limit, self.whose = _limit(limit_bytes)
        about = estimate_joint_graph(regions)
        if about.memory_bytes > ERROR * self.limit:
            raise self._refused(f"about {in_gib(about.memory_bytes)}, estimated before the work")

    def __call__(self, done: int, held: int) -> None:
        """Look at what the cells hold after some regions."""
        if self.progress is not None:
            self.progress(done, self.total, "joint graph")
        if _OF_OVERLAY * held > self.limit:
            so_far = f"about {in_gib(_OF_OVERLAY * held)} after {done} of {self.total} entities"
            raise self._refused(so_far if done == self.total else f"{so_far}, and more to come")

    def refused(self, error: MemoryError) -> MemoryLimitError:
        """Return the error to raise in place of one that came on the way."""
        if isinstance(error, MemoryLimitError) and "joint graph" in str(error):
            return error
        return self._refused(f"a process that gets no more memory ({str(error).rstrip('.') or 'no reason given'})")

    def _refused(self, got: str) -> MemoryLimitError:
        return MemoryLimitError(
            f"the joint graph of {self.total} entities must fit {self.whose}, {in_gib(self.limit)}. Got {got}. "
            f"{_ADVICE}"
        )


def in_gib(memory_bytes: float) -> str:
    """Return an amount of memory for people."""
    return f"{memory_bytes / _GIB:.2g} GiB"


def _limit(limit_bytes: float | None) -> tuple[float, str]:
    """Return what a graph may take, and the words for it."""
    if limit_bytes is None:
        return free_bytes(), "the memory that is free"
    if not limit_bytes > 0:
        raise MemoryLimitError(f"memory_limit_bytes must be a positive number of bytes. Got {limit_bytes}.")
    return float(limit_bytes), "memory_limit_bytes"


def free_bytes() -> float:
    """Return the memory that the machine has left; infinity where it does not tell."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            told = dict(line.split(":", 1) for line in lines)
        return 1024.0 * float(told["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        return float("inf")
