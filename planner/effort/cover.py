"""How few columns are chosen."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Relaxation:
    """How the linear relaxation is solved, and which columns it leaves out.

    Attributes
    ----------
    fixing_bias, fixing_duals : float, int
        Bias and number of the duals that columns are left out by: their mean is nearer to the middle of all optimal
        duals than any one of them.
    core_slack : float
        A column stays if its reduced cost is no more than this.
    core_of_entity : int
        So many of the heaviest columns of every entity stay in any case.
    first_columns, more_columns : int
        Columns in the first linear program, and of those it breaks so many more at a time: few are ever needed.
    broken : float
        A constraint of the dual that is broken by less is rounding.
    shares : int
        Several duals are solved in so many shares, one thread each.
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
    """How long few columns are looked for.

    Attributes
    ----------
    quality_slack : float
        Share of what better poses can gain in the cover that is not worth the solver's time.
    exchanges : int
        Steps of the exchange search for a cover of one column less.
    at_once : int
        Sets to be tried before the next exchange: what is realised of them changes what others are worth.
    relaxation : Relaxation
        How the linear relaxation is solved.
    """

    quality_slack: float = 0.3
    exchanges: int = 1000
    at_once: int = 4
    relaxation: Relaxation = field(default_factory=Relaxation)
