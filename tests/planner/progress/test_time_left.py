"""Whether one more piece of work fits before a deadline."""

from __future__ import annotations

import pytest

from planner.progress import TimeIsUpError, TimeLeft


class _Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_a_piece_fits_if_the_longest_so_far_would():
    clock = _Clock()
    time_left = TimeLeft(110.0, clock)
    answers = []
    for seconds in (1.0, 4.0, 0.5, 0.5, 1.0):
        answers.append(time_left.fits_another())
        clock.now += seconds
    # at 100, 101, 105 and 105.5 the longest of 4 s still ends by 110, at 106 just so
    assert answers == [True, True, True, True, True]
    # at 107 it would end at 111
    assert not time_left.fits_another()


def test_the_deadline_itself_is_in_time_and_what_is_later_is_not():
    clock = _Clock()
    time_left = TimeLeft(100.0, clock)
    time_left.check()
    assert time_left.fits_another()
    assert time_left.seconds == 0.0
    clock.now = 100.5
    assert time_left.seconds == 0.0
    assert not time_left.fits_another()
    with pytest.raises(TimeIsUpError):
        time_left.check()


def test_without_a_deadline_everything_fits():
    time_left = TimeLeft()
    assert all(time_left.fits_another() for _ in range(3))
    time_left.check()
