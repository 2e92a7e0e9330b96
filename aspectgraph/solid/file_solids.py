"""Which solids of a file a `Solid` was read from."""

from __future__ import annotations

from typing import NamedTuple


class FileSolids(NamedTuple):
    """Solids of a STEP file, by their numbers.

    Attributes
    ----------
    measured : tuple of int
        Solids whose edges can be entities, counted from 0 in the order of the file.
    occluders : tuple of int
        Solids that only stand in the way.
    """

    measured: tuple[int, ...]
    occluders: tuple[int, ...]
