"""How one pose is searched for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from planner.effort.checks import check_record
from planner.exceptions import RequestError
from planner.request.defaults import check_count

_STARTS = ("refine_starts", "spread_starts", "turned_starts")


@dataclass(frozen=True)
class Repair:
    """How feasible poses are drawn, and found near those that miss least if draws are in vain.

    Attributes
    ----------
    batch : int
        Viewpoints drawn at a time.
    pool : int
        Poses kept from one round of the repair to the next: the least violating.
    children : int
        Poses tried near them in a round.
    first_step, last_step : float
        Size of the changes in the first and the last round, as shares of the parameters' ranges.
    rounds : int
        Rounds; the steps shrink by a constant factor.
    """

    batch: int = 512
    pool: int = 32
    children: int = 256
    first_step: float = 0.2
    last_step: float = 1e-3
    rounds: int = 24


@dataclass(frozen=True)
class Starts:
    """Which starts of the refinement are told apart, followed, and for how long.

    Attributes
    ----------
    apart : float
        Poses are apart by this share of the distance, or in rad, or of a parameter's range: nearer ones would be
        refined to the same optimum.
    pool : int
        Positions drawn for each that is kept, so that those kept are spread.
    followed : int
        Ends that are refined at most.
    promising : float
        An end is followed if it reaches this share of the best one's merit.
    steps, steps_mirrored : int
        Steps from a start; a mirrored pose may have to go a long way.
    onward_rounds : int
        Refinements of one pose at most, the first in its cell.
    onward_gain : float
        One that gains no more than this share is the last.
    """

    apart: float = 0.1
    pool: int = 8
    followed: int = 3
    promising: float = 0.98
    steps: int = 8
    steps_mirrored: int = 20
    onward_rounds: int = 5
    onward_gain: float = 1e-6


@dataclass(frozen=True)
class Climbing:
    """How a pose climbs; lengths in units of its distance from the entities, turns in radians, both called a move.

    Attributes
    ----------
    step : float
        Half the step of the central differences.
    tolerance : float
        Where the solver stops: the change of the fitness, a probability or so, that no plan depends on.
    back_off : float
        Room left at every inequality: the solver takes those as satisfied that are broken by less than its tolerance in
        all.
    largest_move : float
        The farthest a pose moves along each of the six directions; the cell that holds it ends sooner nearly always.
    never_broken : float
        The largest slack there is: a lens in focus to infinity leaves infinite room, of which there is no derivative.
    most_slacks : int
        Of all inequalities of one kind so many, the nearest to being broken, guide the way: the solver's time grows
        with the square of their number.
    """

    step: float = 1e-4
    tolerance: float = 1e-7
    back_off: float = 2e-7
    largest_move: float = 0.5
    never_broken: float = 1e3
    most_slacks: int = 24


@dataclass(frozen=True)
class Search:
    """How the pose is searched; see `ga.maximize` for the genetic algorithm's parameters.

    Parameters
    ----------
    population : int
        Individuals in every generation (N).
    crossover : float
        Probability P_c that a couple is crossed.
    mutation : float
        Probability P_m that a bit flips.
    elitism : int
        How many of the best pass unchanged to the next generation.
    selection : {"roulette", "sus"}
        How parents are drawn.
    scaling : {"proportional", "window", "rank"}
        Slots of the wheel.
    attempts : int
        Offspring drawn for a place at most.
    epsilon : float
        Converged when the total fitness changes by less than this in `patience` generations running.
    patience : int
        Generations for `epsilon`.
    max_stall : int, optional
        Also stop when the best fitness has not improved in so many generations.
    max_generations : int
        Cap on generations.
    max_nfev : int, optional
        Cap on the individuals that the genetic algorithm evaluates.
    gene_bits : int
        Bits per gene (M).
    gray_code : bool
        Gray code instead of plain binary.
    refine_starts : int
        How many of the last population's best individuals, apart from each other, to refine from.
    spread_starts : int
        How many of the first population's individuals, the best around positions as far from each other as can be, to
        refine from: they reach optima that the population has left behind.
    turned_starts : int
        How many poses to refine from that are drawn in the covering domains with the view turned, feasible or not.
        Without starts of any kind nothing is refined: the genetic algorithm's best is the outcome.
    max_draws : int
        Most poses drawn for the first population before the least violating ones are repaired.
    stop_at_perfect : bool
        Whether to end when all probabilities are 1 but for 0.001 %, as no pose can be better.
    explain : bool
        Whether to search for what it is that no pose meets, if none meets all; else the nearest pose is told of.
    sampling : {"covering", "workspace"}
        Where positions are drawn and encoded: in the covering domains where the lens can focus, or, for comparison, in
        the whole workspace.
    repair : Repair
        How feasible poses are drawn and found.
    starts : Starts
        Which starts of the refinement are followed.
    climbing : Climbing
        How a pose climbs.

    Raises
    ------
    RequestError
        If a number of starts, `max_draws` or `sampling` breaks its rule; the others are checked by `ga`.

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
    selection: str = "roulette"
    scaling: str = "window"
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
    sampling: str = "covering"
    repair: Repair = field(default_factory=Repair)
    starts: Starts = field(default_factory=Starts)
    climbing: Climbing = field(default_factory=Climbing)

    def __post_init__(self) -> None:
        if self.sampling not in ("covering", "workspace"):
            raise RequestError(
                f"sampling must be 'covering' or 'workspace'. Got {self.sampling!r}."
            )
        for name, least in (
            ("refine_starts", 0),
            ("spread_starts", 0),
            ("turned_starts", 0),
            ("max_draws", 1),
        ):
            check_count(name, getattr(self, name), least)
        for name in ("repair", "starts", "climbing"):
            check_record(name, getattr(self, name))

    @classmethod
    def genetic(cls, **changes: Any) -> Search:
        """Choose the default genetic algorithm alone, without refinement.

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
        """Choose the paper's plain algorithm: raw fitness, plain binary, no elitism, no refinement, no early end.

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
        """Whether there is any local refinement."""
        return any(getattr(self, name) for name in _STARTS)

    def ga_options(self) -> dict[str, Any]:
        """Return the keyword arguments of `ga.maximize`.

        Returns
        -------
        dict
            Those of the fields that `ga.maximize` takes.
        """
        own = (
            "gene_bits",
            "gray_code",
            "max_draws",
            "stop_at_perfect",
            "explain",
            "sampling",
            "repair",
            "starts",
            "climbing",
            *_STARTS,
        )
        return {name: value for name, value in self.__dict__.items() if name not in own}
