"""How many features dimensions apply to, and how many of them a plan leaves out.

A dimension of a pattern applies to each of its holes. A plan measures one of them.
"""

from __future__ import annotations

from collections.abc import Sequence


def n_not_planned(counts: Sequence[int]) -> int:
    """Return how many features no plan measures, given the number of features of each dimension.

    Parameters
    ----------
    counts : sequence of int
        Features of each dimension, 1 or more.
    """
    return sum(counts) - len(counts)


def features_text(counts: Sequence[int]) -> str:
    """Say how many features are not planned; nothing if every dimension applies to one.

    Parameters
    ----------
    counts : sequence of int
        Features of each dimension, 1 or more.

    Examples
    --------
    >>> from planner.wanted.feature_counts import features_text
    >>> features_text([1, 6, 30, 4, 30, 1])
    '6 dimensions, 72 features: 66 not planned'
    """
    missing = n_not_planned(counts)
    if not missing:
        return ""
    dimensions = "1 dimension" if len(counts) == 1 else f"{len(counts)} dimensions"
    return f"{dimensions}, {sum(counts)} features: {missing} not planned"
