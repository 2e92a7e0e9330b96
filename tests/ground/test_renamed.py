"""Names of numba that are no promise: where one has another name, loops compile more slowly, with the same answers."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

ROOT = Path(__file__).parents[2]
# without names that compiled parts of numba use, which cannot be changed here
NAMES = (
    "CompileResult",
    "CPUTargetOptions",
    "Flags",
    "JITCPUCodegen",
    "JITCodeLibrary",
    "_cache",
    "_codegen",
    "_final_module",
    "_finalize_dynamic_globals",
    "_finalize_final_module",
    "_finalize_specific",
    "_finalized",
    "_find_referenced_environments",
    "_nrt",
    "_optimize_final_module",
    "_values",
    "_verify_declare_only_symbols",
    "define_pipelines",
    "enable_object_caching",
    "func_id",
    "func_qualname",
    "get_call_template",
    "get_pointer_to_function",
    "has_dynamic_globals",
    "is_compiling",
    "load_overload",
    "lookup_environment",
    "magic_tuple",
    "no_cfunc_wrapper",
    "no_cpython_wrapper",
    "save_overload",
    "serialize_using_bitcode",
    "serialize_using_object_code",
    "set_env",
    "targetctx",
)
LOOPS = """
import numpy as np
from ground.decorators import entry_kernel, kernel, kernel_without_refcounts
from ground.decorators import njit

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

@njit(error_model="numpy")
def inverse(value):
    return 1.0 / value
"""
RUN = """
import importlib.machinery
import re
import sys

names = "|".join(sys.argv[1:])
pattern = re.compile(rf"\\b({names})\\b".encode())

class Renaming(importlib.machinery.SourceFileLoader):
    def get_code(self, fullname):
        source = self.get_data(self.path)
        if names and pattern.search(source):
            return compile(pattern.sub(rb"\\1_renamed", source), self.path, "exec")
        return super().get_code(fullname)

class Finder(importlib.machinery.PathFinder):
    @classmethod
    def find_spec(cls, fullname, path=None, target=None):
        spec = super().find_spec(fullname, path, target)
        if spec is not None and type(spec.loader) is importlib.machinery.SourceFileLoader:
            if fullname.partition(".")[0] == "numba":
                spec.loader = Renaming(fullname, spec.loader.path)
        return spec

sys.meta_path.insert(0, Finder)

import numpy as np
import own_loops

print(own_loops.total(np.array([1.0, 2.0, 3.0])), own_loops.square(3))
print(own_loops.squares(np.array([1, 2])).tolist(), own_loops.inverse(0.0))
try:
    own_loops.total(np.ones(4))
except ValueError as error:
    print(error)
"""

PRINTED = "14.0 9\n[1.0, 4.0] inf\nat most three\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("renamed")
    (place / "own_loops.py").write_text(LOOPS)
    (place / "run.py").write_text(RUN)
    return place


def run(folder, cache, *names):
    own = {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(cache), "NUMBA_DISABLE_JIT": "0"}
    done = subprocess.run(
        [sys.executable, folder / "run.py", *names],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **own},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def run_twice(folder, cache, *names):
    """Return what a run that compiles prints, and one that finds its machine code."""
    return [run(folder, cache, *names) for _ in range(2)]


def test_loops_run_where_no_name_is_as_it_was(folder):
    assert run_twice(folder, folder / "all", *NAMES) == [PRINTED, PRINTED]


@pytest.mark.skipif("EACH_NAME" not in os.environ, reason="two minutes, set EACH_NAME=1")
@pytest.mark.parametrize("name", NAMES)
def test_loops_run_where_one_name_is_another(folder, name):
    assert run_twice(folder, folder / name, name) == [PRINTED, PRINTED]
