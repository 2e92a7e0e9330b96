"""Characteristics: one dimension on one feature. Their names, and how many a plan leaves out.

A dimension of a pattern applies to each of its holes. A plan measures each of them, or one per
pattern if the request says so. A distance may also be asked for at several places along its edges.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

_NUMBERED = re.compile(r" \[\d+ of \d+( places)?\]( #\d+)?$")


def characteristic_name(dimension: str, k: int, n: int) -> str:
    """Return the name of a dimension on one feature of a pattern.

    Parameters
    ----------
    dimension : str
        Name of the dimension.
    k, n : int
        Number of the feature, from 1, and number of all features.

    Examples
    --------
    >>> from planner.wanted.words.feature_counts import characteristic_name
    >>> characteristic_name("Linear Size.11", 3, 30)
    'Linear Size.11 [3 of 30]'
    """
    return f"{dimension} [{k} of {n}]"


def place_name(dimension: str, k: int, n: int) -> str:
    """Return the name of a dimension at one of several places along its edges.

    Parameters
    ----------
    dimension : str
        Name of the dimension.
    k, n : int
        Number of the place, from 1, and number of all places.

    Examples
    --------
    >>> from planner.wanted.words.feature_counts import place_name
    >>> place_name("width", 2, 3)
    'width [2 of 3 places]'
    """
    return f"{dimension} [{k} of {n} places]"


def is_characteristic(name: str) -> bool:
    """Return whether a name is that of a dimension on one feature of a pattern, or at one place.

    Parameters
    ----------
    name : str
        Name of a target.
    """
    return _NUMBERED.search(name) is not None


def n_not_planned(counts: Sequence[int]) -> int:
    """Return how many characteristics a plan leaves out that measures one feature of each dimension.

    Parameters
    ----------
    counts : sequence of int
        Features of each dimension, 1 or more.
    """
    return sum(counts) - len(counts)


def features_text(counts: Sequence[int]) -> str:
    """Say how many characteristics are not planned; nothing if every dimension applies to one.

    Parameters
    ----------
    counts : sequence of int
        Features of each dimension, 1 or more.

    Examples
    --------
    >>> from planner.wanted.words.feature_counts import features_text
    >>> features_text([1, 6, 30, 4, 30, 1])
    '6 dimensions, 72 characteristics: 66 not planned'
    """
    missing = n_not_planned(counts)
    if not missing:
        return ""
    dimensions = "1 dimension" if len(counts) == 1 else f"{len(counts)} dimensions"
    return f"{dimensions}, {sum(counts)} characteristics: {missing} not planned"
