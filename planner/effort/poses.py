"""How one pose is searched for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, is_dataclass, replace
from functools import cache
from typing import Any, get_type_hints

from planner.argument_kinds import NOT_NEGATIVE, NumberRule, check_count, check_number
from planner.exceptions import RequestError

# Checks of records of numbers, and of what is in them.


# types of fields that hold floats
_FLOATS = (float, tuple[float, ...])
_NOT_NEGATIVE = NumberRule("must be a finite number, 0 or more", NOT_NEGATIVE.holds)
# numbers of things of which there may be none
_MAY_BE_NONE = {
    "around",
    "cover_rounds",
    "displaced",
    "exchanges",
    "most_trials",
    "neighbours",
    "nodes",
    "pause",
    "retried",
    "viewpoints",
}


def is_record(value: Any) -> bool:
    """Return whether a value is a dataclass or a named tuple."""
    return is_dataclass(value) or hasattr(value, "_asdict")


def fields_of(record: Any) -> Iterator[tuple[str, bool, Any]]:
    """Yield name, whether it holds floats, and value of each field of a record."""
    kind: Any = type(record)
    for name, is_float in _kinds(kind).items():
        yield name, is_float, getattr(record, name)


@cache
def _kinds(record: type) -> dict[str, bool]:
    return {name: kind in _FLOATS for name, kind in get_type_hints(record).items()}


def check_record(owner: str, record: Any) -> None:
    """Raise `RequestError` unless all numbers of a record have their type and are not negative.

    Records inside it are checked as well.

    Parameters
    ----------
    owner : str
        Its name in messages, such as ``pricing``.
    record : dataclass or named tuple
        Its fields are numbers, tuples of numbers, or records.
    """
    for name, is_float, value in fields_of(record):
        full = f"{owner}.{name}"
        if is_record(value):
            check_record(full, value)
            continue
        for number in value if isinstance(value, tuple) else (value,):
            if is_float:
                check_number(full, number, _NOT_NEGATIVE)
            else:
                check_count(full, number, 0 if name in _MAY_BE_NONE else 1)


def with_floats(record: Any) -> Any:
    """Return a named tuple whose numbers are of the declared kinds: compiled loops are made for kinds of numbers."""
    values = []
    for _, is_float, value in fields_of(record):
        if is_record(value):
            values.append(with_floats(value))
        else:
            values.append(float(value) if is_float else int(value))
    return type(record)(*values)


_STARTS = ("refine_starts", "spread_starts", "turned_starts")


@dataclass(frozen=True)
class Repair:
    """How the program draws feasible poses, and repairs the nearest ones if no draw is feasible.

    Attributes
    ----------
    batch : int
        Viewpoints drawn at a time.
    pool : int
        Poses kept from one round of the repair to the next: those that violate least.
    children : int
        Poses tried near them in each round.
    first_step, last_step : float
        Size of the changes in the first and the last round, as shares of the parameters' ranges.
    rounds : int
        Number of rounds. The steps shrink by a constant factor.
    most_unreached : int
        The search stops after this many poses that meet all constraints, if the robot reaches none
        of them.
    """

    batch: int = 512
    pool: int = 32
    children: int = 256
    first_step: float = 0.2
    last_step: float = 1e-3
    rounds: int = 24
    most_unreached: int = 500


@dataclass(frozen=True)
class Centring:
    """How the margin step moves a pose off its limits.

    Attributes
    ----------
    give_up : float
        No probability falls by more than this. At 0 there is no margin step.
    generations, population : int
        Generations at most, and poses of each.
    patience : int
        A search ends after this many generations without a gain.
    steps : tuple of float
        First standard deviation of the moves, of one search after the other: turns in rad, shifts
        as shares of the distance.
    softness : float
        τ of the soft minimum of the shares.
    tried : int
        Number of the best poses of a generation whose lines must show from displaced poses, too.
    sigmas : float
        How far these are displaced, in standard deviations.
    outline : float
        Weight of the share of the part's outline that is outside the picture.
    """

    give_up: float = 0.001
    generations: int = 60
    population: int = 24
    patience: int = 15
    steps: tuple[float, ...] = (0.02, 0.005, 0.001)
    softness: float = 0.04
    tried: int = 3
    sigmas: float = 3.0
    outline: float = 0.3

    def shorter(self) -> Centring:
        """Return what is done where a time limit has ended the search: about a fifth of it."""
        return replace(self, generations=max(1, self.generations // 4), steps=self.steps[:2])


@dataclass(frozen=True)
class Starts:
    """Which starts the refinement follows, and for how many steps.

    Attributes
    ----------
    apart : float
        Starts differ by at least this share of the distance or of a parameter's range, or this
        angle in rad. Nearer ones would be refined to the same optimum.
    pool : int
        Positions drawn for each one kept, so that those kept are spread out.
    followed : int
        Largest number of ends that are refined.
    promising : float
        The refinement follows an end that reaches this share of the best merit.
    steps, steps_mirrored : int
        Steps from a start, and from a mirrored pose, which may be far from its optimum.
    onward_rounds : int
        Largest number of refinements of one pose, the first in its cell.
    onward_gain : float
        A refinement that gains no more than this share is the last.
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
    """How the local refinement moves a pose.

    Lengths are in units of the distance from the entities, turns in radians; both are moves.

    Attributes
    ----------
    step : float
        Half the step of the central differences.
    tolerance : float
        The solver stops at this change of the fitness, on the scale of a probability.
    back_off : float
        Margin kept at every inequality, because the solver accepts violations below its tolerance.
    largest_move : float
        Largest move along each of the six directions. The cell of the pose nearly always ends
        sooner.
    never_broken : float
        Upper limit of every slack. A lens in focus to infinity has an infinite slack, without a
        derivative.
    most_slacks : int
        Number of inequalities of one kind that the solver uses, the tightest ones. Its time grows
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
    repair : Repair
        How the program draws and repairs poses.
    starts : Starts
        Which starts the refinement follows.
    climbing : Climbing
        How a pose climbs.

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
