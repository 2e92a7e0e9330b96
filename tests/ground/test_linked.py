"""Functions that only compiled loops call: what they do when compiled, loaded from the cache, and in part from it."""

import os
import subprocess
import sys

import numpy as np
import pytest

from ground.decorators import entry_kernel, kernel, kernel_without_refcounts

INNER = """
import numpy as np
from ground.decorators import entry_kernel, kernel, kernel_without_refcounts

@kernel_without_refcounts
def square(x):
    return x * x

@kernel
def squares(values):
    if len(values) > 3:
        raise ValueError("at most three")
    result = np.empty(len(values))
    for i in range(len(values)):
        result[i] = square(values[i])
    return result

@entry_kernel
def total(values):
    return squares(values).sum()
"""
OTHER = """
from ground.decorators import entry_kernel
from own_loops import squares

@entry_kernel
def largest(values):
    return squares(values).max()
"""
RUN = """
import sys
import numpy as np
from numba.core import event

class Compiled(event.Listener):
    names = []
    def on_start(self, start):
        function = start.data["dispatcher"].py_func
        if function.__module__ in ("own_loops", "other_loops"):
            self.names.append(function.__name__)
    def on_end(self, end):
        pass

event.register("numba:compile", Compiled())
module, name = sys.argv[1:]
function = getattr(__import__(module), name)
print(function(np.array([1.0, 2.0, 3.0])), end=" ")
try:
    function(np.ones(4))
except ValueError as error:
    print(error, end=" ")
print(*Compiled.names)
"""

BOTH = """
import numpy as np
from ground.decorators import entry_kernel, kernel
from numba.core import event

@kernel
def inner_mean(values):
    return np.median(values) / values[0]

@entry_kernel(nogil=True)
def alone(values):
    return np.median(values)

@entry_kernel(error_model="numpy")
def as_numpy(values):
    return np.median(values) / values[0]

@entry_kernel
def both(values):
    return np.median(values) + inner_mean(values)

class Medians(event.Listener):
    n = 0
    def on_start(self, start):
        self.n += start.data["dispatcher"].py_func.__name__ == "median_impl"
    def on_end(self, end):
        pass

listener = Medians()
event.register("numba:compile", listener)
for function in (both, alone, as_numpy):
    print(function(np.array([2.0, 4.0, 6.0])), listener.n)
print(as_numpy(np.zeros(3)))
try:
    both(np.zeros(3))
except ZeroDivisionError:
    print("zero")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("loops")
    for name, text in (
        ("own_loops", INNER),
        ("other_loops", OTHER),
        ("both_kinds", BOTH),
        ("run", RUN),
    ):
        (place / f"{name}.py").write_text(text)
    return place


def run(folder, script, *arguments):
    kept = {"NUMBA_CACHE_DIR": str(folder / "compiled"), "NUMBA_DISABLE_JIT": "0"}
    result = subprocess.run(
        [sys.executable, script, *arguments],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **kept},
    )
    return result.stdout.split()


def test_a_loop_is_compiled_once_and_then_found_and_tells_errors_of_inner_ones_either_way(folder):
    told = ["14.0", "at", "most", "three"]
    assert run(folder, folder / "run.py", "own_loops", "total") == [
        *told,
        "total",
        "squares",
        "square",
    ]
    assert run(folder, folder / "run.py", "own_loops", "total") == told
    # what another loop calls is found, too
    assert run(folder, folder / "run.py", "other_loops", "largest") == [
        "9.0",
        "at",
        "most",
        "three",
        "largest",
    ]
    assert run(folder, folder / "run.py", "other_loops", "largest") == [
        "9.0",
        "at",
        "most",
        "three",
    ]


def test_what_numba_has_is_compiled_once_for_callers_of_all_kinds_but_not_for_another_division(
    folder,
):
    assert run(folder, folder / "both_kinds.py") == [
        "6.0",
        "1",
        "4.0",
        "1",
        "2.0",
        "2",
        "nan",
        "zero",
    ]


@kernel
def doubled(values):
    return 2 * values


@kernel_without_refcounts
def half(value):
    return value / 2


@entry_kernel(error_model="numpy")
def of_both(values):
    return half(doubled(values)[0])


@kernel_without_refcounts(error_model="numpy")
def inverse(value):
    return 1 / value


def test_inner_functions_can_be_called_from_python_with_the_options_they_have_in_loops():
    assert of_both(np.array([3.0])) == 3.0
    assert doubled(np.array([3.0])).tolist() == [6.0]
    assert half(3.0) == 1.5
    if hasattr(inverse, "py_func"):
        assert inverse(0.0) == np.inf


@pytest.mark.skipif(not hasattr(half, "py_func"), reason="loops run uncompiled")
def test_inner_functions_have_no_machine_code_of_their_own():
    of_both(np.array([3.0]))
    for function in (doubled, half):
        for compilation in function.overloads.values():
            assert compilation.library.get_pointer_to_function(compilation.fndesc.mangled_name) == 0
    entry = next(iter(of_both.overloads.values()))
    assert entry.library.get_pointer_to_function(entry.fndesc.mangled_name) != 0
