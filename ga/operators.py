"""The options of `ga.maximize`: how individuals are selected and bred, and when to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from ga import checks
from ga.offspring import Breeding
from ga.population import Feasible
from ga.record import Stopping
from ga.result import Generation
from ga.selection import SCALINGS, SELECTIONS


@dataclass(frozen=True)
class Operators:
    """Options of `ga.maximize`, which describes them. They are checked when they are used."""

    rng: int | np.random.Generator | None = 0
    callback: Callable[[Generation], object] | None = None
    selection: str = "roulette"
    scaling: str = "proportional"
    elitism: int = 0
    duplicates: bool = True
    epsilon: float = 1e-3
    patience: int = 5
    max_stall: int | None = None
    target: float | None = None
    max_generations: int = 1000
    max_nfev: int | None = None
    attempts: int = 20
    initial_attempts: int = 100

    def breeding(
        self, size: int, crossover: float, mutation: float, feasible: Feasible | None
    ) -> Breeding:
        """Return how a population of a size is bred; a broken rule is a `ParameterError`."""
        return Breeding(
            crossover=checks.check_probability("crossover", crossover),
            mutation=checks.check_probability("mutation", mutation),
            weigh=SCALINGS[checks.check_choice("scaling", self.scaling, SCALINGS)],
            select=SELECTIONS[checks.check_choice("selection", self.selection, SELECTIONS)],
            elitism=checks.check_integer("elitism", self.elitism, 0, size - 1),
            duplicates=checks.check_flag("duplicates", self.duplicates),
            attempts=checks.check_integer("attempts", self.attempts, 1),
            feasible=feasible,
        )

    def stopping(self, size: int, elitism: int) -> Stopping:
        """Return when to stop a population of a size; a broken rule is a `ParameterError`."""
        stall = self.max_stall
        target = self.target
        most = self.max_nfev
        return Stopping(
            epsilon=checks.check_nonnegative("epsilon", self.epsilon),
            patience=checks.check_integer("patience", self.patience, 1),
            max_stall=None if stall is None else checks.check_integer("max_stall", stall, 1),
            target=None if target is None else checks.check_finite("target", target),
            max_generations=checks.check_integer("max_generations", self.max_generations, 1),
            max_nfev=None if most is None else checks.check_integer("max_nfev", most, size),
            evaluations_ahead=size - elitism,
        )


class Keywords(TypedDict, total=False):
    """The same for type checkers."""

    rng: int | np.random.Generator | None
    callback: Callable[[Generation], object] | None
    selection: str
    scaling: str
    elitism: int
    duplicates: bool
    epsilon: float
    patience: int
    max_stall: int | None
    target: float | None
    max_generations: int
    max_nfev: int | None
    attempts: int
    initial_attempts: int
