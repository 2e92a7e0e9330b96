"""Which fixturings a plan needs: as many settings as can be reached, then few fixturings, then time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np


class FixturingChoice(NamedTuple):
    """Fixturings for the settings of a plan.

    Attributes
    ----------
    of_setting : tuple of int
        Fixturing of each setting; -1 if none reaches it.
    coverage : tuple of int
        Number of settings that the best single fixturing reaches, the best two, and so on.
    """

    of_setting: tuple[int, ...]
    coverage: tuple[int, ...]


def choose_fixturings(
    reached: np.ndarray, seconds: Callable[[int, tuple[int, ...]], float]
) -> FixturingChoice:
    """Choose the fewest fixturings that reach all settings which any fixturing reaches.

    **Guarantee.** No smaller set of fixturings reaches as many settings. Among the sets of this
    size, the time is the least that moving single settings between fixturings finds.

    Parameters
    ----------
    reached : array of bool (n, f)
        Whether a fixturing reaches a setting.
    seconds : callable
        ``seconds(fixturing, settings)`` returns the time of a round through settings.

    Returns
    -------
    FixturingChoice
        The first one, in the order of the fixturings, where several are as good.
    """
    n, f = reached.shape
    most = int(reached.any(axis=1).sum())
    coverage = []
    sets: list[tuple[int, ...]] = [()]
    for size in range(1, f + 1):
        sized = list(combinations(range(f), size))
        counts = [int(reached[:, chosen].any(axis=1).sum()) for chosen in sized]
        coverage.append(max(counts))
        if coverage[-1] == most:
            sets = [c for c, count in zip(sized, counts, strict=True) if count == most]
            break
    if most == 0:
        return FixturingChoice((-1,) * n, tuple(coverage[:1]))
    found = [_assigned(reached, chosen, seconds) for chosen in sets]
    _, of_setting = min(found, key=lambda one: one[0])
    return FixturingChoice(of_setting, tuple(coverage))


def _assigned(
    reached: np.ndarray,
    chosen: tuple[int, ...],
    seconds: Callable[[int, tuple[int, ...]], float],
) -> tuple[float, tuple[int, ...]]:
    """Give each setting one of the chosen fixturings; move settings while that saves time."""
    n = len(reached)
    usable = [[f for f in chosen if reached[k, f]] for k in range(n)]
    best = tuple(options[0] if options else -1 for options in usable)
    times: dict[tuple[int, tuple[int, ...]], float] = {}

    def total(of_setting: tuple[int, ...]) -> float:
        rounds = []
        for f in chosen:
            key = (f, tuple(k for k in range(n) if of_setting[k] == f))
            if key not in times:
                times[key] = seconds(*key) if key[1] else 0.0
            rounds.append(times[key])
        return sum(rounds)

    least = total(best)
    while True:
        shorter = [(total(other), other) for other in _moved(best, usable)]
        if not shorter or min(shorter)[0] >= least - 1e-9:
            return least, best
        least, best = min(shorter)


def _moved(of_setting: tuple[int, ...], usable: list[list[int]]) -> Iterator[tuple[int, ...]]:
    """Yield the assignments that differ in one setting."""
    for k, options in enumerate(usable):
        for f in options:
            if f != of_setting[k]:
                yield (*of_setting[:k], f, *of_setting[k + 1 :])
