"""How long to search for a plan: the numbers that somebody sets, and three presets of them.

They are of the request: another number may give another plan. Every other number that steers the
search is a constant beside its algorithm.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any, Literal

from ga.bits import Scaling, Selection
from ground.short_repr import short_repr
from planner.argument_kinds import NOT_NEGATIVE, check_count, check_number, names_meant
from planner.exceptions import RequestError

Preset = Literal["quick", "standard", "thorough"]
_STARTS = ("refine_starts", "spread_starts", "turned_starts")
# fields of `Search` that `ga.maximize` does not take
_NOT_OF_GA = ("gene_bits", "gray_code", "max_draws", "stop_at_perfect", "explain", "sampling")


@dataclass(frozen=True)
class Search:
    """How to search for one pose; see `ga.maximize` for the genetic algorithm's parameters.

    Parameters
    ----------
    population : int
        Number of individuals in every generation (N).
    crossover : float
        Probability P_c of crossing a couple.
    mutation : float
        Probability P_m that a bit flips.
    elitism : int
        Number of best individuals that pass unchanged to the next generation.
    selection : {"roulette", "sus"}
        How the algorithm draws parents.
    scaling : {"proportional", "window", "rank"}
        How fitness determines the slots of the wheel.
    attempts : int
        Largest number of offspring drawn for one member of the next generation.
    epsilon : float
        The run has converged when the total fitness changes by less than this in `patience`
        consecutive generations.
    patience : int
        Number of consecutive generations for `epsilon`.
    max_stall : int, optional
        Also stop after this many generations without a better best fitness.
    max_generations : int
        Cap on generations.
    max_nfev : int, optional
        Cap on the individuals that the genetic algorithm evaluates.
    gene_bits : int
        Bits per gene (M).
    gray_code : bool
        Whether to use Gray code instead of plain binary.
    refine_starts : int
        Number of distinct best individuals of the last population to refine from.
    spread_starts : int
        Number of individuals of the first population to refine from. They are the best around
        positions as far apart as possible. They reach optima that the population has left.
    turned_starts : int
        Number of poses to refine from that are drawn in the covering domains with the view turned,
        feasible or not. Without starts of any kind there is no refinement, and the result is the
        genetic algorithm's best.
    max_draws : int
        Largest number of poses drawn for the first population. After that, the program repairs the
        poses that violate least.
    stop_at_perfect : bool
        Whether to end when all probabilities are within 0.001 % of 1, because no pose can be
        better.
    explain : bool
        If no pose meets all constraints, whether to search for the constraint that none can meet.
        Otherwise the message describes the nearest pose.
    sampling : {"covering", "workspace"}
        Region in which positions are drawn and encoded. "covering" is the covering domains where
        the lens can focus. "workspace", for comparison, is the whole workspace.

    Raises
    ------
    RequestError
        If a number of starts, `max_draws` or `sampling` breaks its rule. `ga` checks the others.

    Examples
    --------
    >>> from planner import Search
    >>> Search(population=50).population
    50
    """

    population: int = 100
    crossover: float = 0.9
    mutation: float = 0.1
    elitism: int = 2
    selection: Selection = "roulette"
    scaling: Scaling = "window"
    attempts: int = 6
    epsilon: float = 1e-3
    patience: int = 5
    max_stall: int | None = 8
    max_generations: int = 50
    max_nfev: int | None = None
    gene_bits: int = 16
    gray_code: bool = True
    refine_starts: int = 3
    spread_starts: int = 5
    turned_starts: int = 10
    max_draws: int = 8192
    stop_at_perfect: bool = True
    explain: bool = True
    sampling: Literal["covering", "workspace"] = "covering"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.sampling not in ("covering", "workspace"):
            raise RequestError(
                f"sampling must be 'covering' or 'workspace'. Got {self.sampling!r}."
            )
        for name in _STARTS:
            check_count(name, getattr(self, name), 0)
        check_count("max_draws", self.max_draws, 1)

    @classmethod
    def genetic(cls, **changes: Any) -> Search:
        """Return the default genetic algorithm alone, without refinement.

        Parameters
        ----------
        **changes : int, float, bool or str
            Fields to set otherwise.

        Returns
        -------
        Search
            With no starts of any kind to refine from, unless changed.

        Raises
        ------
        RequestError
            If a field breaks its rule.
        """
        return cls(**{**dict.fromkeys(_STARTS, 0), **changes})

    @classmethod
    def paper(cls, **changes: Any) -> Search:
        """Return the paper's algorithm: raw fitness, plain binary, and no refinement.

        It has neither elitism nor an early end.

        Parameters
        ----------
        **changes : int, float, bool or str
            Fields to set otherwise.

        Returns
        -------
        Search
            The paper's choices, unless changed.

        Raises
        ------
        RequestError
            If a field breaks its rule.
        """
        plain = {
            "elitism": 0,
            "scaling": "proportional",
            "max_stall": None,
            "max_generations": 1000,
            "gray_code": False,
            "attempts": 20,
            "stop_at_perfect": False,
        }
        return cls.genetic(**{**plain, **changes})

    @property
    def refines(self) -> bool:
        """Whether the search includes local refinement."""
        return any(getattr(self, name) for name in _STARTS)

    def ga_options(self) -> dict[str, Any]:
        """Return the keyword arguments of `ga.maximize`.

        Returns
        -------
        dict
            The fields that `ga.maximize` takes.
        """
        others = (*_NOT_OF_GA, *_STARTS)
        return {name: value for name, value in self.__dict__.items() if name not in others}


@names_meant
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
    give_up : float
        The margin step, which moves planned poses off their limits, lowers no probability by more
        than this. At 0 there is no margin step.
    margin_generations : int
        Largest number of generations of a search of the margin step. A short search leaves out the
        finest moves.
    good_enough : float
        The genetic algorithm does not search for a better pose where the candidate pose has more
        than this probability for each of its targets, and simulation confirms it. At 1, it always
        searches.
    bound_targets : int
        Largest number of targets for which the proof may use all boxes. With more targets, each box
        takes longer, and the number of boxes falls in proportion.
    search : Search
        How the program searches for the pose of one column.

    Raises
    ------
    RequestError
        If a number has the wrong type or is negative, or the viewpoints or nodes of the solver are
        zero.

    Examples
    --------
    >>> from planner import Effort
    >>> effort = Effort(viewpoints=10)
    >>> effort.viewpoints, effort.pricing_rounds
    (10, 100)
    """

    viewpoints: int = 50
    pricing_rounds: int = 100
    refutations: int = 30
    bound_nodes: int = 8_000_000
    cover_nodes: int = 1000
    witnesses: int = 6
    give_up: float = 0.001
    margin_generations: int = 60
    good_enough: float = 1.0
    bound_targets: int = 500
    search: Search = field(default_factory=Search)

    __repr__ = short_repr

    @classmethod
    def named(cls, name: Preset) -> Effort:
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
        >>> Effort().giving_up(0.01).give_up
        0.01
        """
        if isinstance(give_up, bool) or not isinstance(give_up, Real) or not 0 <= give_up < 1:
            raise RequestError.of_rule("give_up", "must be in [0, 1)", repr(give_up))
        return replace(self, give_up=float(give_up))

    def boxes_for(self, n_targets: int) -> int:
        """Return the largest number of boxes of poses for the proof of so many targets.

        Parameters
        ----------
        n_targets : int
            Number of targets.

        Returns
        -------
        int
            `bound_nodes`, or fewer for more targets than `bound_targets`.

        Examples
        --------
        >>> from planner import Effort
        >>> quick = Effort.named("quick")
        >>> quick.boxes_for(16), quick.boxes_for(64)
        (400000, 100000)
        """
        return self.bound_nodes * self.bound_targets // max(n_targets, self.bound_targets)

    def __post_init__(self) -> None:
        for name in ("pricing_rounds", "refutations", "bound_nodes"):
            check_count(name, getattr(self, name), 0)
        for name in (
            "viewpoints",
            "cover_nodes",
            "witnesses",
            "margin_generations",
            "bound_targets",
        ):
            check_count(name, getattr(self, name), 1)
        for name in ("give_up", "good_enough"):
            check_number(name, getattr(self, name), NOT_NEGATIVE)


# what is searched with where nothing is said
NORMAL = Effort()
QUICK = Effort(
    pricing_rounds=40,
    refutations=4,
    bound_nodes=400_000,
    cover_nodes=200,
    witnesses=3,
    margin_generations=15,
    good_enough=0.0,
    bound_targets=16,
    search=Search(max_draws=2048),
)
THOROUGH = Effort(
    viewpoints=200,
    pricing_rounds=400,
    refutations=120,
    bound_nodes=40_000_000,
    cover_nodes=4000,
    witnesses=12,
)
_PRESETS: dict[Preset, Effort] = {"quick": QUICK, "standard": NORMAL, "thorough": THOROUGH}
