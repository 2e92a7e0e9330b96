"""Records as one line."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pytest

from ground.short_repr import LONGEST, short_repr


@dataclass(frozen=True)
class Record:
    name: str
    weights: object = field(default_factory=lambda: np.zeros(3))
    share: float = math.nan
    n: int = 0
    hidden: int = field(default=1, repr=False)
    total: int = field(init=False, default=7)

    __repr__ = short_repr


class Pair(NamedTuple):
    a: object
    b: object = None

    __repr__ = short_repr


@pytest.mark.parametrize(
    ("record", "text"),
    [
        (Record("a", None), "Record(name='a', weights=None)"),
        (Record("a", np.array([1, 2.5, 3])), "Record(name='a', weights=(1, 2.5, 3))"),
        (Record("a", np.eye(4), 0.1 + 0.2), "Record(name='a', weights=<4 × 4 array>, share=0.3)"),
        (Record("a", [0] * 50, n=2), "Record(name='a', weights=<50 items>, n=2)"),
        (Record("a", {"x": "y" * 50}, n=2), "Record(name='a', weights=<1 item>, n=2)"),
        (Record("x" * 90, None), f"Record(name='{'x' * 37}…', weights=None)"),
        (Pair(1), "Pair(a=1)"),
        (Pair((np.eye(2), 1), Pair(2)), "Pair(a=<2 items>, b=Pair(a=2))"),
        (Pair((0.0, 2.0320000000081277)), "Pair(a=(0.0, 2.032))"),
        (Pair((-0.12345678901234567, 12345.678901234567)), "Pair(a=(-0.123457, 12345.7))"),
        (Pair((0.1 + 0.2,)), "Pair(a=(0.3,))"),
        (Pair((0.5,) * 20), "Pair(a=<20 items>)"),
        (Pair("line\nline"), "Pair(a='line\\nline')"),
        (Pair(b"x" * 50), "Pair(a=<bytes>)"),
    ],
)
def test_fields_that_differ_from_their_defaults(record, text):
    assert repr(record) == text


def test_what_has_no_room_is_left_out():
    kinds = [(f"field_{k}", int) for k in range(30)]
    Long = NamedTuple("Long", kinds)
    for n in (0, 10**6, 10**30):
        text = short_repr(Long(*[n] * 30))
        assert 80 < len(text) <= LONGEST
        assert text.startswith(f"Long(field_0={n}, ")
        assert text.endswith(", …)")


def test_the_longest_line_that_fits_is_whole():
    for n in range(60):
        pair = Pair("x" * 30, int("9" * max(n, 1)))
        assert len(repr(pair)) <= LONGEST
