"""What reading a part file may cost: a file from anywhere must not take the machine."""

from __future__ import annotations

import math
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
