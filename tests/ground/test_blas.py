"""BLAS gets one thread in a block, and what it had before after it."""

import pytest

from ground import blas
from ground.blas import OneThread, with_one_thread


@pytest.fixture
def two_threads(monkeypatch):
    """As on a machine of two cores whose environment says nothing."""
    for name in blas._SETTINGS:
        monkeypatch.delenv(name, raising=False)
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


def test_the_environment_decides(two_threads, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert set(with_one_thread(numbers)()) == {2}


def test_the_library_behind_numpy_is_found():
    """The wheels of numpy and scipy bring OpenBLAS, each its own."""
    import numpy as np

    if "openblas" in np.show_config("dicts")["Build Dependencies"]["blas"]["name"]:
        assert len(blas._libraries()) >= 1
