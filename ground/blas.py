"""Threads of BLAS, the library behind products and factors of matrices: one, where matrices are small.

OpenBLAS wakes a thread for each core at matrices of about 100 rows. They wait for work in loops, so a call that takes
0.2 ms alone takes 10 ms beside other work. Sums are rounded in another order with several threads, and a search that
compares them may then find another plan. So nobody may choose the number, neither a user nor a library that changes
the environment, as `distributed` does when it starts workers.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar, cast

# as the wheels of numpy and scipy, and other builds of OpenBLAS, name them
_NAMES = tuple(
    f"{prefix}openblas_{{}}_num_threads{suffix}"
    for prefix in ("scipy_", "")
    for suffix in ("64_", "")
)

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


class OneThread:
    """Gives BLAS one thread in blocks, in the whole process; after the last block it has as many as before.

    Nothing is done where another library is used.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._depth = 0
        self._before: list[tuple[Callable[[int], None], int]] = []

    def __enter__(self) -> None:
        """Begin a block."""
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                for setter, getter in _libraries():
                    self._before.append((setter, getter()))
                    setter(1)

    def __exit__(self, *_: object) -> None:
        """End a block."""
        with self._lock:
            self._depth -= 1
            while self._depth == 0 and self._before:
                setter, number = self._before.pop()
                setter(number)


_one_thread = OneThread()


def with_one_thread(
    function: Callable[_Parameters, _Result],
) -> Callable[_Parameters, _Result]:
    """Let BLAS have one thread while a function runs."""

    @wraps(function)
    def alone(*arguments: _Parameters.args, **keywords: _Parameters.kwargs) -> _Result:
        with _one_thread:
            return function(*arguments, **keywords)

    return alone


@cache
def _libraries() -> tuple[tuple[Callable[[int], None], Callable[[], int]], ...]:
    """Return for each library that is loaded what sets and gets the number of its threads."""
    libraries = []
    for file in _linked_files():
        library = ctypes.CDLL(file)
        for name in _NAMES:
            setter = getattr(library, name.format("set"), None)
            getter = getattr(library, name.format("get"), None)
            if setter is not None and getter is not None:
                setter.restype = None
                setter.argtypes = [ctypes.c_int]
                getter.restype = ctypes.c_int
                libraries.append(
                    (cast("Callable[[int], None]", setter), cast("Callable[[], int]", getter))
                )
                break
    return tuple(libraries)


def _linked_files() -> list[str]:
    """Return the files of modules that are linked to a BLAS: the loader finds its functions through them."""
    try:
        from numpy.linalg import _umath_linalg
        from scipy.linalg import _fblas
    except ImportError:
        return []
    return [str(module.__file__) for module in (_umath_linalg, _fblas)]
