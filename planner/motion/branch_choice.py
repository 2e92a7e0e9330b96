"""Which of many branches a round chooses from: on a turntable a setting may have two hundred."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.motion.move_time import JointRates, move_times
from planner.motion.tour import EXACT_UP_TO

_MOST = 24
_MOST_IN_LONG_ROUNDS = 12


def few_branches(
    branches: Sequence[np.ndarray], home: np.ndarray, rates: JointRates
) -> list[np.ndarray]:
    """Return at most 24 branches of each setting, in rounds of more than 10 settings at most 12.

    The angles that serve most settings come first, one after the other until each setting has one,
    and then the branches that are near home; they stay in their order. So a round can do with few turns of the table.

    Parameters
    ----------
    branches : sequence of array (b, k)
        Of each setting; the last number is the angle of the turntable.
    home : array (k,)
        Joints at which the round begins and ends, rad.
    rates : JointRates
        Of all of them.
    """
    preferred = common_angles([set(group[:, -1].tolist()) for group in branches])
    most = _MOST if len(branches) <= EXACT_UP_TO else _MOST_IN_LONG_ROUNDS
    result = []
    for group in branches:
        places = [preferred.index(a) if a in preferred else len(preferred) for a in group[:, -1]]
        seconds = np.round(move_times(group, home[None], rates), 6)
        order = np.lexsort((seconds, np.array(places, dtype=int)))
        result.append(group[np.sort(order[:most])])
    return result


def common_angles(options: Sequence[set[float]]) -> list[float]:
    """Return angles of which each setting has one, greedily those that serve most; the nearest to 0 of equal ones.

    Parameters
    ----------
    options : sequence of set of float
        The angles of each setting, rad; settings without one are left out.
    """
    left = [angles for angles in options if angles]
    chosen: list[float] = []
    while left:
        every = sorted(set().union(*left), key=lambda angle: (abs(angle), -angle))
        best = max(every, key=lambda angle: sum(angle in angles for angles in left))
        chosen.append(best)
        left = [angles for angles in left if best not in angles]
    return chosen
