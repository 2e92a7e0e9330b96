"""Which solids of a STEP file are measured, and which only stand in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from aspectgraph.exceptions import ReadError


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
