"""Which of the witnesses that a model offers for a dimension are planned with.

A model offers up to sixty sets of entities for one distance. Each costs regions, poses and proof, and most look alike
to a camera. So few are kept: those that can be in one picture, as different as they get.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.wanted.targets import Witness


class WitnessChoice(NamedTuple):
    """How many witnesses of a dimension are kept, and which can be in one picture.

    Attributes
    ----------
    most : int
        Witnesses of a dimension at most.
    widest_mm : float
        Two points that are farther apart are never in one sharp image.
    stretch_mm : float
        Of edges that are longer, stretches of about this length are considered, too.
    """

    most: int = 1
    widest_mm: float = np.inf
    stretch_mm: float = np.inf


PREFERRED = WitnessChoice()
"""The preferred witness only, whatever the camera."""


def kept_witnesses(witnesses: Sequence[Witness], choice: WitnessChoice) -> list[int]:
    """Return which witnesses to keep, in their order; one at least.

    Left out are those that need more entities than another one, those that no picture holds, and of the rest all but
    a few that lie far apart: the first, then again and again the one whose middle is farthest from those chosen.

    Parameters
    ----------
    witnesses : sequence of Witness
        The preferred one first.
    choice : WitnessChoice
        How many are kept.

    Returns
    -------
    list of int
        Ascending.
    """
    sets = [frozenset(witness.entities) for witness in witnesses]
    needed = [
        k
        for k, own in enumerate(sets)
        # of equal sets the first stays
        if not any(other < own or (other == own and i < k) for i, other in enumerate(sets))
    ]
    fitting = [k for k in needed if _extent_mm(witnesses[k]) <= choice.widest_mm]
    left = fitting or needed[:1]
    middles = np.array([witnesses[k].segments.reshape(-1, 3).mean(axis=0) for k in left])
    chosen = [0]
    while len(chosen) < min(choice.most, len(left)):
        apart = np.linalg.norm(middles[:, None] - middles[chosen], axis=-1).min(axis=1)
        apart[chosen] = -1.0
        # of equally far ones the first: distances that differ by rounding are equal
        chosen.append(int(np.argmax(np.round(apart, 6))))
    return sorted(left[k] for k in chosen)


def _extent_mm(witness: Witness) -> float:
    """Return how far apart the two points of a witness are that are farthest apart."""
    ends: NDArray[np.float64] = witness.ends
    return float(np.linalg.norm(ends[1] - ends[0]))
