"""How long the stages of a plan search."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Preference:
    """When the program uses a candidate pose, and when that of the genetic algorithm.

    Attributes
    ----------
    fitness_gain : float
        Least gain in the sum of the probabilities. A smaller gain is rounding.
    enough : float
        The genetic algorithm does not search for a better pose where the candidate pose has more
        than this probability for each of its targets, and simulation confirms it. At 1, it always
        searches.
    """

    fitness_gain: float = 1e-6
    enough: float = 1.0


@dataclass(frozen=True)
class Joining:
    """How long the program improves columns from poses that the proof found.

    Attributes
    ----------
    rounds : int
        Smallest number of rounds of column generation.
    most_rounds : int
        Largest number of rounds, for few columns.
    columns : int
        Rounds times columns is about this, because a round over many columns takes longer.
    """

    rounds: int = 5
    most_rounds: int = 25
    columns: int = 20_000

    def rounds_for(self, n_columns: int) -> int:
        """Return the number of rounds for a pool of this many columns."""
        return min(max(self.rounds, self.columns // max(1, n_columns)), self.most_rounds)


@dataclass(frozen=True)
class Improving:
    """How often the program searches for a better plan, and how it finds the first ones.

    Attributes
    ----------
    rounds : int
        Rounds of column generation between two searches.
    directions : tuple of int
        Number of viewing directions per entity, for each of the first plans.
    """

    rounds: int = 5
    directions: tuple[int, ...] = (4, 32)


@dataclass(frozen=True)
class Trying:
    """How long the program searches for a cover that simulation confirms.

    Attributes
    ----------
    exchanges : int
        Steps of the exchange search for a cover of one column less.
    covers : int
        Largest number of covers that are simulated. Each omits the edges contradicted before.
    in_vain : int
        Drop an edge that simulation contradicts from this many candidate poses and confirms from
        none.
    """

    exchanges: int = 1000
    covers: int = 20
    in_vain: int = 4


@dataclass(frozen=True)
class CoverShares:
    """Shares of `Effort.cover_nodes` for covers on the way to the last one.

    Attributes
    ----------
    refuting : float
        Share for each cover while the program tries optimistic columns. There are many, and a cover
        that is not the best costs no more than a run of the genetic algorithm.
    """

    refuting: float = 0.1


@dataclass(frozen=True)
class Looking:
    """How long the program searches for a pose from which a lamp lights an entity.

    Attributes
    ----------
    viewpoints : int
        Viewpoints drawn for each unlit entity, in addition to the poses of the pool.
    around : int
        Poses tried around each planned pose of the entity, which may keep the other targets of the
        setting.
    tried : int
        Poses of each entity whose light is computed.
    kept : int
        Of the poses where the entity is lit, keep this many as candidates: those that inspect most
        entities with the highest probability.
    places : int
        Lamp positions tried in addition to the chosen ones, for lamps without fixed positions.
    """

    viewpoints: int = 60
    around: int = 400
    tried: int = 48
    kept: int = 8
    places: int = 1000


@dataclass(frozen=True)
class StageEffort:
    """How long the stages of a plan search.

    Attributes
    ----------
    improving : Improving
        How often the program searches for a better plan.
    trying : Trying
        How long the program searches for a cover that simulation confirms.
    joining : Joining
        How long the program improves columns from poses of the proof.
    shares : CoverShares
        Shares of the nodes for covers on the way.
    preference : Preference
        When the program prefers a candidate pose.
    looking : Looking
        How long the program searches for poses with light.
    """

    improving: Improving = field(default_factory=Improving)
    trying: Trying = field(default_factory=Trying)
    joining: Joining = field(default_factory=Joining)
    shares: CoverShares = field(default_factory=CoverShares)
    preference: Preference = field(default_factory=Preference)
    looking: Looking = field(default_factory=Looking)
