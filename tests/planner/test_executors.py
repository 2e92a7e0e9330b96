"""Tasks in order, and how waiting for them is ended."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from planner.executors import check_on_the_way, checked_by, in_order


class Enough(Exception):
    pass


def test_results_come_in_the_order_of_the_arguments():
    def late(k):
        time.sleep(0.01 * (4 - k))
        return k

    with ThreadPoolExecutor(4) as executor:
        assert list(in_order(executor, late, [(k,) for k in range(4)])) == [0, 1, 2, 3]
    assert list(in_order(None, late, [(k,) for k in range(4)])) == [0, 1, 2, 3]


def test_while_results_are_waited_for_the_work_can_be_ended():
    release = threading.Event()
    begun = []

    def task(k):
        begun.append(k)
        release.wait(30)

    def check():
        raise Enough

    with ThreadPoolExecutor(1) as executor:
        start = time.monotonic()
        with pytest.raises(Enough):
            list(in_order(executor, task, [(k,) for k in range(5)], check))
        # the task that runs would run for half a minute, and the others are dropped
        assert time.monotonic() - start < 15
        release.set()
    assert begun == [0]


def test_without_an_executor_it_is_asked_before_every_task():
    done = []
    left = [None, None]

    def check():
        if not left:
            raise Enough
        left.pop()

    def task(k):
        done.append(k)

    with pytest.raises(Enough):
        list(in_order(None, task, [(7,), (8,), (9,)], check))
    assert done == [7, 8]


@pytest.mark.parametrize("check", [None, lambda: None])
def test_a_time_limit_of_the_task_itself_is_its_error(check):
    def task():
        raise TimeoutError("the robot does not answer")

    with ThreadPoolExecutor(1) as executor, pytest.raises(TimeoutError, match="robot"):
        list(in_order(executor, task, [()], check))


def test_tasks_end_on_the_way_and_so_does_the_work_around_them():
    def task(k):
        for _ in range(k):
            check_on_the_way()
        return k

    calls = []

    def check():
        calls.append(1)
        if len(calls) > 5:
            raise Enough

    with ThreadPoolExecutor(1) as executor, checked_by(lambda: check):
        assert list(in_order(executor, task, [(2,), (3,)])) == [2, 3]
        with pytest.raises(Enough):
            list(in_order(executor, task, [(1,)]))
        with pytest.raises(Enough):
            check_on_the_way()
    check_on_the_way()
    assert len(calls) == 7


def test_blocks_with_no_check_end_nothing():
    with checked_by(None):
        check_on_the_way()
        assert list(in_order(None, abs, [(-1,)])) == [1]
