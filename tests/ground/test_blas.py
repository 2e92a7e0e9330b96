"""BLAS gets one thread in a block, and what it had before after it."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from ground import blas
from ground.blas import OneThread, with_one_thread
from planner.executors import in_order


@pytest.fixture
def two_threads():
    """As on a machine of two cores."""
    libraries = blas._libraries()
    if not libraries:
        pytest.skip("numpy uses another library")
    before = numbers()
    for setter, _ in libraries:
        setter(2)
    yield
    for (setter, _), number in zip(libraries, before, strict=True):
        setter(number)


def numbers():
    return [getter() for _, getter in blas._libraries()]


def test_a_function_runs_with_one_thread(two_threads):
    assert set(numbers()) == {2}
    assert set(with_one_thread(numbers)()) == {1}
    assert set(numbers()) == {2}


def test_an_inner_block_ends_nothing(two_threads):
    one_thread = OneThread()
    with one_thread:
        with one_thread:
            assert set(numbers()) == {1}
        assert set(numbers()) == {1}
    assert set(numbers()) == {2}


def test_an_error_ends_the_block(two_threads):
    with pytest.raises(ZeroDivisionError):
        with_one_thread(lambda: 1 // 0)()
    assert set(numbers()) == {2}


def test_tasks_of_workers_run_with_one_thread(two_threads):
    """A process that is started anew has a thread for each core, and its results must be those of this one."""
    with ThreadPoolExecutor(1) as executor:
        assert [set(found) for found in in_order(executor, numbers, [()])] == [{1}]


def test_the_environment_decides_nothing(two_threads, monkeypatch):
    """Rounding would follow it: a library that sets it when it starts workers made the next plan another one."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert set(with_one_thread(numbers)()) == {1}


def test_the_library_behind_numpy_is_found():
    """The wheels of numpy and scipy bring OpenBLAS, each its own."""
    import numpy as np

    if "openblas" in np.show_config("dicts")["Build Dependencies"]["blas"]["name"]:
        assert len(blas._libraries()) >= 1
