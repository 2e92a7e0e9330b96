"""Memory of a joint graph: about how much it takes, told before the work, and looked at while it grows.

The cells of a joint graph grow faster than the number of its entities, and how fast depends on the part. So what is
known before is an estimate, from the cells of the single regions, that may err by `ERROR` either way; what the cells
hold while they grow is counted. A graph is refused before the work only if the estimate is too large by more than its
error, and before all regions are there only if the first of them leave no doubt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from aspectgraph.exceptions import MemoryLimitError
from aspectgraph.visibility.entity_region import Region
from aspectgraph.visibility.visibility_regions import Progress, VisibilityRegions

if TYPE_CHECKING:
    import numpy as np

    from aspectgraph.entities.straight_edges import Entity
    from aspectgraph.solid.solid import Solid

try:
    import resource
except ImportError:  # not on Windows
    resource = None  # type: ignore[assignment]

# Bytes and seconds of a graph for (cells of all regions)^_POWER; how many times as much as the overlay's cells it takes
# in the end; and the factor by which the estimate may err. With 10, 20 and 60 edges of nist_ctc_01 the memory was 1.56,
# 1.37 and 0.88 of the estimate (the last by hand, the others by `benchmarks/engine/joint_memory.py`). No other part is
# known.
_BYTES = 5.0
_SECONDS = 2.5e-7
_POWER = 2.0
_OF_OVERLAY = 4.0
ERROR = 3.0

# regions from which the cells of all are guessed: at least so many, and such a share; the guess may err by this besides
_FIRST = 10
_FIRST_SHARE = 0.05
_FIRST_ERROR = 2.0

_GROUP = Path("/sys/fs/cgroup")

_ADVICE = (
    "Ask for fewer entities, or for the regions only: compute_regions answers the same questions, "
    "and a plan needs no joint graph"
)
_GIB = 2**30


class JointEstimate(NamedTuple):
    """Estimated memory and time of a joint graph.

    Attributes
    ----------
    memory_bytes : float
        Largest memory of the graph, in addition to that of the process, bytes.
    seconds : float
        Approximate time in seconds. A busy machine took four to five times as long.
    """

    memory_bytes: float
    seconds: float


def estimate_joint_graph(regions: Sequence[Region]) -> JointEstimate:
    """Return about what the joint graph of regions costs."""
    return _cost(sum(region.n_leaves for region in regions))


def estimate_graph(regions: VisibilityRegions, names: Sequence[str] | None = None) -> JointEstimate:
    """Estimate memory and time of `graph_of`, before you call it.

    Parameters
    ----------
    regions : VisibilityRegions
        From `compute_regions`.
    names : sequence of str, optional
        Names of the entities. Default: all.

    Returns
    -------
    JointEstimate
        ``memory_bytes`` and ``seconds``. The real values may differ by a factor of three, more on a
        busy machine.

    Examples
    --------
    >>> from aspectgraph import compute_regions, estimate_graph, read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> regions = compute_regions(block, {"rim": 17, "depth": 8})
    >>> estimate_graph(regions, ["rim"]).memory_bytes < estimate_graph(regions).memory_bytes < 1e9
    True
    """
    chosen = regions.check_names(regions.entity_names if names is None else names)
    return estimate_joint_graph([regions._regions[name] for name in chosen])


def _cost(cells: float) -> JointEstimate:
    growth = float(cells) ** _POWER
    return JointEstimate(_BYTES * growth, _SECONDS * growth)


class JointForecast:
    """Ends the computation of regions once their joint graph certainly exceeds the memory.

    Pass it to `compute_regions` as ``kept``. It stores no regions.

    Parameters
    ----------
    limit_bytes : float, optional
        Largest memory of the graph, in bytes. Default: the free memory.

    Raises
    ------
    MemoryLimitError
        If the limit is not a positive number, or in `put`, if the graph cannot fit.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import JointForecast, compute_regions
    >>> regions = compute_regions(box, {"top": 1, "side": 2}, kept=JointForecast(limit_bytes=2**30))
    >>> regions.entity_names
    ('top', 'side')
    """

    def __init__(self, limit_bytes: float | None = None) -> None:
        self.limit, self.whose = _limit(limit_bytes)
        self._total = 0
        self._known = 0
        self._cells = 0

    def begin(self, solid: Solid, box_mm: np.ndarray, entities: Mapping[str, Entity]) -> None:
        """Start with the number of entities.

        Parameters
        ----------
        solid : Solid
            The part.
        box_mm : array (2, 3)
            The workspace.
        entities : mapping of str to Entity
            All of them.
        """
        self._total = len(entities)
        self._known = 0
        self._cells = 0

    def get(self, name: str) -> None:
        """Return None, because it stores no regions.

        Parameters
        ----------
        name : str
            Of an entity.
        """

    def put(self, name: str, region: Region) -> None:
        """Count the cells of a region.

        Parameters
        ----------
        name : str
            Of its entity.
        region : Region
            Where it is observable.

        Raises
        ------
        MemoryLimitError
            If the graph cannot fit.
        """
        self._known = self._known + 1
        self._cells = self._cells + region.n_leaves
        if self._known < max(_FIRST, _FIRST_SHARE * self._total) or self._known == self._total:
            return
        about = _cost(self._cells * self._total / self._known).memory_bytes
        if about > _FIRST_ERROR * ERROR * self.limit:
            got = f"about {in_gib(about)}, estimated from the first {self._known} regions"
            raise _refusal(self._total, self.whose, self.limit, got)


class JointMemory:
    """Ends the work on a joint graph that does not fit; see `overlay`, which it watches.

    Parameters
    ----------
    regions : sequence of Region
        Of the entities.
    limit_bytes : float, optional
        Largest memory of the graph, in bytes. Default: the free memory.
    progress : callable, optional
        ``progress(done, total, "joint graph")``.

    Raises
    ------
    MemoryLimitError
        If the limit is no positive number, or the estimate is beyond it by more than its error.
    """

    def __init__(
        self, regions: Sequence[Region], limit_bytes: float | None, progress: Progress | None = None
    ) -> None:
        self.total = len(regions)
        self.progress = progress
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
        if isinstance(error, MemoryLimitError):
            if error.hint:
                return error
            # the room of the cells has a limit, too, which is not the memory
            what = f"the joint graph of {self.total} entities cannot be built: {error}"
            refusal = MemoryLimitError(what)
            refusal.hint = _ADVICE
            return refusal
        return self._refused(
            f"a process that gets no more memory ({str(error).rstrip('.') or 'no reason given'})"
        )

    def _refused(self, got: str) -> MemoryLimitError:
        return _refusal(self.total, self.whose, self.limit, got)


def _refusal(total: int, whose: str, limit: float, got: str) -> MemoryLimitError:
    return MemoryLimitError.of_rule(
        "",
        f"the joint graph of {total} entities must fit {whose}, {in_gib(limit)}",
        got,
        hint=_ADVICE,
        mentions=("memory_limit_bytes",),
    )


def in_gib(memory_bytes: float) -> str:
    """Return an amount of memory for people."""
    return f"{memory_bytes / _GIB:.2g} GiB"


def _limit(limit_bytes: float | None) -> tuple[float, str]:
    """Return what a graph may take, and the words for it."""
    if limit_bytes is None:
        return free_bytes(), "the memory that is free"
    if not limit_bytes > 0:
        raise MemoryLimitError.of_rule(
            "memory_limit_bytes", "must be a positive number of bytes", str(limit_bytes)
        )
    return float(limit_bytes), "memory_limit_bytes"


def free_bytes() -> float:
    """Return the memory that is left: of the machine, its container and the process; infinity where none tells."""
    return min(_left_of_machine(), _left_of_container(), _left_of_process())


def _left_of_machine() -> float:
    return _told_by("/proc/meminfo", "MemAvailable")


def _left_of_container() -> float:
    """Return what the control group of a container leaves; what files only passed through can be had again."""
    try:
        most, taken = (
            float(_GROUP.joinpath(name).read_text("ascii"))
            for name in ("memory.max", "memory.current")
        )
        stated = dict(
            line.split() for line in _GROUP.joinpath("memory.stat").read_text("ascii").splitlines()
        )
        return max(most - taken + float(stated["inactive_file"]), 0.0)
    except (OSError, ValueError, KeyError):
        # there is none, or its limit is "max"
        return inf


def _left_of_process() -> float:
    """Return what ``ulimit -v`` leaves."""
    if resource is None:
        return inf
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    taken = _told_by("/proc/self/status", "VmSize")
    return inf if most == resource.RLIM_INFINITY or taken == inf else max(most - taken, 0.0)


def _told_by(file: str, name: str) -> float:
    """Return an amount of memory in a file of the kernel; infinity where there is none."""
    try:
        with open(file, encoding="ascii", errors="replace") as lines:
            told = dict(line.split(":", 1) for line in lines if ":" in line)
        return 1024.0 * float(told[name].split()[0])
    except (OSError, KeyError, ValueError):
        return inf
