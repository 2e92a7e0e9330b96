"""What reading a part file may cost: a file from anywhere must not take the machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from aspectgraph.exceptions import ReadError


@dataclass(frozen=True)
class ReadLimits:
    """Limits of time, memory and size for reading one part file.

    The defaults are far above the needs of real parts. The largest NIST test part (2 MB, 635 faces)
    takes 3 s and 80 MB in the STEP kernel. An STL file of a million facets has 50 MB.

    Attributes
    ----------
    time_s : float
        Largest wall-clock time of the STEP kernel, in seconds.
    memory_mb : float
        Largest memory of the STEP kernel for the file, in MB (10⁶ bytes). If the operating system
        cannot limit it, only the time limit applies.
    file_mb : float
        Largest size of the uncompressed file, in MB.
    triangles : int
        Largest number of triangles of a mesh file, counting each use of a shared mesh.

    Raises
    ------
    ReadError
        A limit is not positive.

    Examples
    --------
    >>> from aspectgraph import ReadLimits, read_solid
    >>> part = read_solid("examples/mfcad_6-11-11-19.step", limits=ReadLimits(time_s=60.0))
    >>> part.name
    'mfcad_6-11-11-19'
    """

    time_s: float = 300.0
    memory_mb: float = 2000.0
    file_mb: float = 256.0
    triangles: int = 5_000_000

    def __post_init__(self) -> None:
        for name in ("time_s", "memory_mb", "file_mb", "triangles"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ReadError(f"{name} of the limits must be positive and finite. Got {value}.")


def more_of(limit: str) -> dict[str, Any]:
    """Return the hint of an error to raise a limit, with the argument it mentions."""
    argument = f"limits=ReadLimits({limit}=...)"
    return {"hint": f"allow more with {argument}", "mentions": (argument,)}


# Which solids of a STEP file are measured, and which only stand in the way.


@dataclass(frozen=True)
class SolidChoice:
    """A choice of solids of a STEP file: those to measure, and those that occlude them.

    Attributes
    ----------
    measured : sequence of int, optional
        Solids whose edges can be entities, counted from 0 in the order of the file. Default: all
        that are not occluders.
    occluders : "all" or sequence of int
        Solids that only occlude. Their edges are not entities. ``"all"``: all except the measured
        ones.

    Raises
    ------
    ReadError
        A solid is both, or no solid remains.

    Examples
    --------
    >>> from aspectgraph import SolidChoice
    >>> SolidChoice(measured=(1, 3), occluders="all")
    SolidChoice(measured=(1, 3), occluders='all')
    """

    measured: Sequence[int] | None = None
    occluders: str | Sequence[int] = ()

    def __post_init__(self) -> None:
        if isinstance(self.occluders, str) and self.occluders != "all":
            raise ReadError.of_rule(
                "occluders", "must be 'all' or numbers of solids", repr(self.occluders)
            )
        if self.occluders == "all" and self.measured is None:
            raise ReadError.of_rule(
                "occluders",
                "must be numbers where solids does not say which are measured",
                "'all'",
                mentions=("solids",),
            )
        both = sorted(
            set(self.measured or ()) & set(() if self.occluders == "all" else self.occluders)
        )
        if both:
            raise ReadError(
                f"a solid must be measured or an occluder. Got solid {both[0]} as both."
            )

    def split(self, n: int) -> tuple[list[int], list[int]]:
        """Return the measured solids and the occluders of a file, without checking numbers.

        Parameters
        ----------
        n : int
            Number of solids in the file.

        Returns
        -------
        measured : list of int
            In the order given.
        occluders : list of int
            Likewise.
        """
        if self.occluders == "all":
            measured = [int(i) for i in self.measured or ()]
            return measured, [i for i in range(n) if i not in measured]
        occluders = [int(i) for i in self.occluders]
        if self.measured is None:
            return [i for i in range(n) if i not in occluders], occluders
        return [int(i) for i in self.measured], occluders


def as_choice(solids: Sequence[int] | SolidChoice | None) -> SolidChoice:
    """Return a choice as a `SolidChoice`."""
    return (
        solids
        if isinstance(solids, SolidChoice)
        else SolidChoice(None if solids is None else tuple(solids))
    )
