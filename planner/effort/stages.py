"""How hard the stages of a plan try."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Preference:
    """When the candidate pose is tried before the pose that the genetic algorithm found.

    Attributes
    ----------
    fitness_gain : float
        It is so much better in the sum of its probabilities: less is rounding.
    """

    fitness_gain: float = 1e-6


@dataclass(frozen=True)
class Joining:
    """How long the columns are improved from poses that the proof has come across.

    Attributes
    ----------
    rounds : int
        Rounds of column generation at least.
    most_rounds : int
        Rounds at most, while columns are few.
    columns : int
        Rounds times columns is about this: a round over many columns takes longer.
    """

    rounds: int = 5
    most_rounds: int = 25
    columns: int = 20_000

    def rounds_for(self, n_columns: int) -> int:
        """Return the rounds for a pool of so many columns."""
        return min(max(self.rounds, self.columns // max(1, n_columns)), self.most_rounds)


@dataclass(frozen=True)
class Improving:
    """How often a better incumbent is looked for, and from how many poses the first ones are.

    Attributes
    ----------
    rounds : int
        Of column generation, from one look to the next.
    directions : tuple of int
        From so many each entity is looked at, at the first glances.
    """

    rounds: int = 5
    directions: tuple[int, ...] = (4, 32)


@dataclass(frozen=True)
class Trying:
    """How hard a cover is looked for that simulation supports.

    Attributes
    ----------
    exchanges : int
        Steps of the exchange search for a cover of one column less.
    covers : int
        Covers that are simulated at most, each with what was contradicted before taken out.
    in_vain : int
        An edge that simulation contradicts from so many candidate poses, and supports from none, is given up.
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
        For each cover while optimistic columns are tried: there are many of them, and a cover that is not the best
        costs no more than a run of the genetic algorithm.
    """

    refuting: float = 0.1


@dataclass(frozen=True)
class Looking:
    """How hard a pose is looked for from which a lamp shows an entity.

    Attributes
    ----------
    viewpoints : int
        Drawn for each entity that no lamp shows, beside the poses of the pool.
    around : int
        Poses tried around each that was planned for it: what else the setting measures may stay with it.
    tried : int
        Poses of each entity that are lit by trial.
    kept : int
        Of those from which it shows, so many are candidates: those that inspect most, and that most surely.
    places : int
        Places of lamps that are tried beside the chosen ones, where lamps are placed.
    """

    viewpoints: int = 60
    around: int = 400
    tried: int = 48
    kept: int = 8
    places: int = 1000


@dataclass(frozen=True)
class StageEffort:
    """How hard the stages of a plan try.

    Attributes
    ----------
    improving : Improving
        How often a better plan is looked for on the way.
    trying : Trying
        How hard a cover is looked for that simulation supports.
    joining : Joining
        How long columns are improved from poses of the proof.
    shares : CoverShares
        Shares of the nodes for covers on the way.
    preference : Preference
        When a candidate pose is preferred.
    looking : Looking
        How hard poses are looked for that lamps show.
    """

    improving: Improving = field(default_factory=Improving)
    trying: Trying = field(default_factory=Trying)
    joining: Joining = field(default_factory=Joining)
    shares: CoverShares = field(default_factory=CoverShares)
    preference: Preference = field(default_factory=Preference)
    looking: Looking = field(default_factory=Looking)
