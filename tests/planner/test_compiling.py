"""What is told of compiling: a line once, how far it has got, and nothing where the cache has it all."""

import gc
import re

import numba

from planner.compiling import compiling_told


def run(function):
    lines = []
    steps = []
    collecting = []
    with compiling_told(
        lines.append, lambda *told: steps.append(told) or collecting.append(gc.isenabled())
    ):
        function()
    return lines, steps


def test_it_is_told_once_and_then_no_more():
    @numba.njit
    def inner(x):
        return x + 1

    @numba.njit
    def outer(x):
        return inner(x) * 2

    inner.py_func.__module__ = outer.py_func.__module__ = "planner.nowhere"
    lines, steps = run(lambda: outer(1))
    first, last = lines
    assert "at the first run only" in first
    assert re.fullmatch(r"compiling 2 loops took \d+ s; the next run finds them", last)
    # the inner one is done first; the last report is the end
    assert [done for done, _ in steps] == [1, 2, 2]
    assert all(done <= total for done, total in steps)
    assert gc.isenabled()
    assert run(lambda: outer(2)) == ([], [])


def test_others_loops_are_not_counted():
    @numba.njit
    def other(x):
        return x - 1

    other.py_func.__module__ = "elsewhere"
    lines, steps = run(lambda: other(1))
    assert (len(lines), steps) == (1, [])


def test_it_is_told_once_however_many_others_come_first():
    functions = [numba.njit(lambda x, k=k: x + k) for k in range(3)]
    for function in functions:
        function.py_func.__module__ = "elsewhere"
    lines, _ = run(lambda: [function(1) for function in functions])
    assert len(lines) == 1


def test_a_run_that_can_keep_nothing_says_that_the_next_one_compiles_again(monkeypatch):
    monkeypatch.setattr("planner.compiling.can_keep", lambda source: False)

    @numba.njit
    def kept_nowhere(x):
        return x + 2

    kept_nowhere.py_func.__module__ = "planner.nowhere"
    lines, _ = run(lambda: kept_nowhere(1))
    assert "at every run" in lines[0]
    assert lines[1].endswith("the next run compiles them again")
