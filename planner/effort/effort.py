"""How long to search for a plan."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Real

from planner.argument_kinds import check_count
from planner.effort.bound import BoundEffort, Sweeping
from planner.effort.checks import check_record
from planner.effort.columns import Nearness, Pricing, Support
from planner.effort.cover import Covering
from planner.effort.poses import Centring, Search
from planner.effort.stages import Preference, StageEffort
from planner.exceptions import RequestError


@dataclass(frozen=True)
class Effort:
    """How long to search for a plan and its proof. The defaults suit a hundred entities.

    `named` returns shorter and longer presets.

    Parameters
    ----------
    viewpoints : int
        Number of viewpoints drawn for each entity.
    pricing_rounds : int
        Largest number of rounds of column generation.
    refutations : int
        Largest number of optimistic columns that the genetic algorithm tries to realise.
    bound_nodes : int
        Largest number of boxes of poses for the proof of the lower bound. See `boxes_for`.
    cover_nodes : int
        Largest number of nodes of the integer programming solver for one cover. It is a tenth while
        the program tries optimistic columns.
    witnesses : int
        Largest number of sets of entities that the program considers for one dimension. A model may
        offer more. With 1, it takes the first, of whole entities.

    pricing : Pricing
        How the program draws and improves candidate poses. The default of this and the following
        seldom needs a change.
    nearness : Nearness
        When a pose nearly inspects an entity.
    support : Support
        When simulation supports a pose.
    search : Search
        How the program searches for the pose of one column.
    centring : Centring
        How the program moves a planned pose off its limits.
    cover : Covering
        How the program chooses few columns.
    bound : BoundEffort
        How the program proves the lower bound.
    stages : StageEffort
        How long the stages of a plan search.

    Raises
    ------
    RequestError
        If a number has the wrong type or is negative, or the viewpoints or nodes of the solver are
        zero.

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
    witnesses: int = 6
    pricing: Pricing = field(default_factory=Pricing)
    nearness: Nearness = field(default_factory=Nearness)
    support: Support = field(default_factory=Support)
    search: Search = field(default_factory=Search)
    centring: Centring = field(default_factory=Centring)
    cover: Covering = field(default_factory=Covering)
    bound: BoundEffort = field(default_factory=BoundEffort)
    stages: StageEffort = field(default_factory=StageEffort)

    @classmethod
    def named(cls, name: str) -> Effort:
        """Return a preset.

        Parameters
        ----------
        name : {"quick", "standard", "thorough"}
            "standard" is the default. "quick" ends after a short search and a short proof, and
            improves a pose only where simulation contradicts it. "thorough" searches four times as
            long and gives the proof five times as many boxes.

        Raises
        ------
        RequestError
            If there is no preset with this name.
        """
        if name not in _PRESETS:
            rule = f"must be one of {', '.join(_PRESETS)}"
            raise RequestError.of_rule("effort", rule, repr(name))
        return _PRESETS[name]

    @classmethod
    def for_dimensions(cls) -> Effort:
        """Return the default for dimensions: fewer boxes for the proof of the bound.

        The necessary conditions of a dimension exclude fewer poses than those of an edge. On the
        demo part, five times as many boxes raise the bound by one.
        """
        return cls(bound_nodes=1_500_000)

    def giving_up(self, give_up: float) -> Effort:
        """Return the same effort with another cost of the margin step.

        Parameters
        ----------
        give_up : float
            The step lowers no probability by more than this, in [0, 1). 0: there is no step.

        Returns
        -------
        Effort
            A new one.

        Raises
        ------
        RequestError
            If it breaks its rule.

        Examples
        --------
        >>> from planner import Effort
        >>> Effort().giving_up(0.01).centring.give_up
        0.01
        """
        if isinstance(give_up, bool) or not isinstance(give_up, Real) or not 0 <= give_up < 1:
            raise RequestError.of_rule("give_up", "must be in [0, 1)", repr(give_up))
        return replace(self, centring=replace(self.centring, give_up=float(give_up)))

    def boxes_for(self, n_targets: int) -> int:
        """Return the largest number of boxes of poses for the proof of so many targets.

        Parameters
        ----------
        n_targets : int
            Number of targets.

        Returns
        -------
        int
            `bound_nodes`, or fewer for more targets than `Sweeping.targets`.

        Examples
        --------
        >>> from planner import Effort
        >>> quick = Effort.named("quick")
        >>> quick.boxes_for(16), quick.boxes_for(64)
        (400000, 100000)
        """
        most = self.bound.sweeping.targets
        return self.bound_nodes * most // max(n_targets, most)

    def __post_init__(self) -> None:
        for name in ("pricing_rounds", "refutations", "bound_nodes"):
            check_count(name, getattr(self, name), 0)
        for name in ("viewpoints", "cover_nodes", "witnesses"):
            check_count(name, getattr(self, name), 1)
        for name in ("pricing", "nearness", "support", "centring", "cover", "bound", "stages"):
            check_record(name, getattr(self, name))


# what is searched with where nothing is said
NORMAL = Effort()
QUICK = Effort(
    pricing_rounds=20,
    refutations=4,
    bound_nodes=400_000,
    bound=BoundEffort(sweeping=Sweeping(targets=16)),
    stages=StageEffort(preference=Preference(enough=0.0)),
    cover_nodes=200,
    witnesses=3,
    search=Search(max_draws=2048),
    centring=Centring().shorter(),
)
THOROUGH = Effort(
    viewpoints=200,
    pricing_rounds=200,
    refutations=120,
    bound_nodes=40_000_000,
    cover_nodes=4000,
    witnesses=12,
)
_PRESETS = {"quick": QUICK, "standard": NORMAL, "thorough": THOROUGH}
