"""How long to search for a plan."""

from __future__ import annotations

from dataclasses import dataclass, fields

from planner.exceptions import RequestError
from planner.request.defaults import check_count

_PRESETS: dict[str, dict[str, int]] = {
    "quick": {"pricing_rounds": 20, "refutations": 4, "bound_nodes": 400_000, "cover_nodes": 200},
    "standard": {},
    "thorough": {
        "viewpoints": 200,
        "pricing_rounds": 200,
        "refutations": 120,
        "bound_nodes": 40_000_000,
        "cover_nodes": 4000,
    },
}


@dataclass(frozen=True)
class Effort:
    """How long to search; the defaults suit a hundred entities, and `named` knows shorter and longer ones.

    Parameters
    ----------
    viewpoints : int
        Viewpoints drawn for every entity.
    pricing_rounds : int
        Rounds of column generation at most.
    refutations : int
        Optimistic columns that the genetic algorithm tries to realise, at most.
    bound_nodes : int
        Boxes of poses behind the lower bound, at most.
    cover_nodes : int
        Nodes of the integer programming solver for one cover, at most; a tenth while optimistic ones are tried.

    Raises
    ------
    RequestError
        If one is no integer, or negative; of viewpoints and nodes of the solver there must be one at least.

    Examples
    --------
    >>> from planner import Effort
    >>> Effort(viewpoints=10).viewpoints
    10
    """

    viewpoints: int = 50
    pricing_rounds: int = 50
    refutations: int = 30
    bound_nodes: int = 8_000_000
    cover_nodes: int = 1000

    @classmethod
    def named(cls, name: str) -> Effort:
        """Return a preset.

        Parameters
        ----------
        name : {"quick", "standard", "thorough"}
            Standard is the default. Quick ends after a short search and a short proof. Thorough searches four times as
            long, and gives the proof five times as many boxes.

        Raises
        ------
        RequestError
            If there is none with this name.
        """
        if name not in _PRESETS:
            raise RequestError.of_rule(
                "effort", f"must be one of {', '.join(_PRESETS)}", repr(name)
            )
        return cls(**_PRESETS[name])

    @classmethod
    def for_dimensions(cls) -> Effort:
        """Return the default where dimensions are planned: fewer boxes behind the bound.

        What of a dimension is necessary, excludes less than of an edge; on the part of the demo, five times as many
        boxes raise the bound by one.
        """
        return cls(bound_nodes=1_500_000)

    def __post_init__(self) -> None:
        for field in fields(self):
            check_count(
                field.name,
                getattr(self, field.name),
                int(field.name in ("viewpoints", "cover_nodes")),
            )
