"""How few columns are chosen."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Relaxation:
    """How the program solves the linear relaxation, and which columns it omits.

    Attributes
    ----------
    fixing_bias, fixing_duals : float, int
        Bias and number of the duals that exclude columns. Their mean is nearer to the middle of all
        optimal duals than a single one.
    core_slack : float
        A column stays if its reduced cost is at most this.
    core_of_entity : int
        Of an entity in none of these columns, this many of the heaviest columns stay.
    first_columns, more_columns : int
        Columns in the first linear program, and violated columns added at a time. Few are ever
        needed.
    broken : float
        A smaller violation of a dual constraint is rounding.
    shares : int
        Groups of duals solved in parallel. Each dual starts with the columns of the one before
        in its group, so the result depends on this number and not on the machine.
    """

    fixing_bias: float = 1.05
    fixing_duals: int = 4
    core_slack: float = 0.1
    core_of_entity: int = 5
    first_columns: int = 300
    more_columns: int = 100
    broken: float = 1e-9
    shares: int = 2


@dataclass(frozen=True)
class Covering:
    """How long the program searches for a cover with few columns.

    Attributes
    ----------
    quality_slack : float
        The solver stops when better poses can gain at most this share in the cover.
    exchanges : int
        Steps of the exchange search for a cover of one column less.
    at_once : int
        Sets tried before the next exchange, because each realised set changes the value of the
        others.
    relaxation : Relaxation
        How the linear relaxation is solved.
    """

    quality_slack: float = 0.3
    exchanges: int = 1000
    at_once: int = 4
    relaxation: Relaxation = field(default_factory=Relaxation)
