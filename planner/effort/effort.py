"""How long to search for a plan."""

from __future__ import annotations

from dataclasses import dataclass, field

from planner.effort.bound import BoundEffort
from planner.effort.checks import check_record
from planner.effort.columns import Nearness, Pricing, Support
from planner.effort.cover import Covering
from planner.effort.poses import Search
from planner.effort.stages import StageEffort
from planner.exceptions import RequestError
from planner.request.defaults import check_count


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

    pricing : Pricing
        How candidate poses are drawn and improved. This and the rest seldom need another value than the default.
    nearness : Nearness
        When a pose nearly inspects an entity.
    support : Support
        When simulation supports a pose.
    search : Search
        How the pose of one column is searched for.
    cover : Covering
        How few columns are chosen.
    bound : BoundEffort
        How the lower bound is proven.
    stages : StageEffort
        How hard the stages of a plan try.

    Raises
    ------
    RequestError
        If a number is not of its kind, or negative; of viewpoints and nodes of the solver there must be one at least.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from planner import Effort
    >>> effort = Effort(viewpoints=10)
    >>> effort.viewpoints, effort.pricing.parents
    (10, 64)
    >>> replace(effort, pricing=replace(effort.pricing, parents=32)).pricing.parents
    32
    """

    viewpoints: int = 50
    pricing_rounds: int = 50
    refutations: int = 30
    bound_nodes: int = 8_000_000
    cover_nodes: int = 1000
    pricing: Pricing = field(default_factory=Pricing)
    nearness: Nearness = field(default_factory=Nearness)
    support: Support = field(default_factory=Support)
    search: Search = field(default_factory=Search)
    cover: Covering = field(default_factory=Covering)
    bound: BoundEffort = field(default_factory=BoundEffort)
    stages: StageEffort = field(default_factory=StageEffort)

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
            rule = f"must be one of {', '.join(_PRESETS)}"
            raise RequestError.of_rule("effort", rule, repr(name))
        return _PRESETS[name]

    @classmethod
    def for_dimensions(cls) -> Effort:
        """Return the default where dimensions are planned: fewer boxes behind the bound.

        What of a dimension is necessary, excludes less than of an edge; on the part of the demo, five times as many
        boxes raise the bound by one.
        """
        return cls(bound_nodes=1_500_000)

    def __post_init__(self) -> None:
        for name in ("pricing_rounds", "refutations", "bound_nodes"):
            check_count(name, getattr(self, name), 0)
        for name in ("viewpoints", "cover_nodes"):
            check_count(name, getattr(self, name), 1)
        for name in ("pricing", "nearness", "support", "cover", "bound", "stages"):
            check_record(name, getattr(self, name))


# what is searched with where nothing is said
NORMAL = Effort()
QUICK = Effort(pricing_rounds=20, refutations=4, bound_nodes=400_000, cover_nodes=200)
THOROUGH = Effort(
    viewpoints=200,
    pricing_rounds=200,
    refutations=120,
    bound_nodes=40_000_000,
    cover_nodes=4000,
)
_PRESETS = {"quick": QUICK, "standard": NORMAL, "thorough": THOROUGH}
