"""Machine code on disk: used while nothing it depends on has changed, and no reason to stop where it cannot be kept."""

import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from ground.decorators import _PORTABLE_FEATURES

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

ROOT = Path(__file__).parents[2]
CONSTANTS = """
from typing import NamedTuple

FACTOR = 2.0

class Pair(NamedTuple):
    left: float
    right: float
"""
CALLED = """
import loops.constants
from loops.constants import FACTOR
from ground.decorators import njit

@njit
def scaled(x):
    # a comment
    return FACTOR * x

@njit
def lifted(x):
    return x + loops.constants.FACTOR
"""
CALLERS = """
from loops.called import lifted, scaled
from ground.decorators import njit

@njit
def total(x):
    return scaled(x) + 1.0

@njit
def raised(x):
    return lifted(x)

@njit
def left_of(pair):
    return pair.left
"""
RUN = """
import sys
from numba.core import event
from loops import callers, constants

class Compiled(event.Listener):
    names = []
    def on_start(self, start):
        self.names.append(start.data["dispatcher"].py_func.__name__)
    def on_end(self, end):
        pass

event.register("numba:compile", Compiled())
values = [callers.total(3.0), callers.raised(3.0)]
values.append(callers.left_of(constants.Pair(left=1.0, right=2.0)))
print(*values, *Compiled.names)
"""
SERVER = """
import json, os, runpy, sys, tempfile, traceback
import numba
import ground.decorators

numba.njit(lambda x: x + 1.0)(1.0)

def run(order):
    os.environ.clear()
    os.environ.update(order["environment"])
    os.chdir(order["folder"])
    sys.path.insert(0, order["folder"])
    tempfile.tempdir = None
    numba.config.reload_config()
    try:
        runpy.run_path("run.py")
        return 0
    except BaseException:
        traceback.print_exc()
        return 1

for line in sys.stdin:
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as message:
        child = os.fork()
        if child == 0:
            sys.stdout, sys.stderr = output, message
            code = run(json.loads(line))
            output.flush()
            message.flush()
            os._exit(code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        output.seek(0)
        message.seek(0)
        print(json.dumps([code, output.read(), message.read()]), flush=True)
"""
FRESH = ["total", "scaled", "raised", "lifted", "left_of"]


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a package of compiled loops in three files."""
    package = tmp_path / "tree" / "loops"
    package.mkdir(parents=True)
    for name, text in (
        ("__init__", ""),
        ("constants", CONSTANTS),
        ("called", CALLED),
        ("callers", CALLERS),
    ):
        (package / f"{name}.py").write_text(text)
    (package.parent / "run.py").write_text(RUN)
    return package.parent


def environment(**changed):
    """Return an environment with this tree and without a chosen cache; names without a value are left out."""
    kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    own = {"PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "0", "PYTHONDONTWRITEBYTECODE": "1"}
    every = {**kept, **own, **changed}
    return {name: value for name, value in every.items() if value is not None}


@pytest.fixture(scope="module")
def server():
    """Return a process that has loaded numba, and none of the loops; it runs each script in a process of its own."""
    process = subprocess.Popen(
        [sys.executable, "-c", SERVER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    yield process
    process.stdin.close()
    process.stdout.close()
    process.wait()


@pytest.fixture
def run(server, folder):
    """Return a function that runs the loops of a folder in a new process.

    It returns three numbers, the names of the loops that were compiled, and standard error.
    """

    def run_loops(tree=folder, **changed):
        order = {"folder": str(tree), "environment": environment(**changed)}
        print(json.dumps(order), file=server.stdin, flush=True)
        code, output, message = json.loads(server.stdout.readline())
        assert code == 0, message
        return [float(word) for word in output.split()[:3]], output.split()[3:], message

    return run_loops


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_loop_is_compiled_anew_where_a_function_it_calls_was_edited_in_another_file(run, folder):
    assert run() == ([7.0, 5.0, 1.0], FRESH, "")
    assert run() == ([7.0, 5.0, 1.0], [], "")
    edit(folder / "loops" / "called.py", "FACTOR * x", "FACTOR * x + 10.0")
    # what does not call it is not compiled
    assert run() == ([17.0, 5.0, 1.0], ["total", "scaled"], "")
    assert run() == ([17.0, 5.0, 1.0], [], "")


def test_a_loop_is_compiled_anew_where_a_constant_of_a_module_without_loops_was_edited(run, folder):
    run()
    edit(folder / "loops" / "constants.py", "FACTOR = 2.0", "FACTOR = 4.0")
    assert run() == ([13.0, 7.0, 1.0], FRESH[:4], "")


def test_a_loop_is_compiled_anew_where_the_fields_of_a_tuple_changed_places(run, folder):
    run()
    edit(
        folder / "loops" / "constants.py",
        "    left: float\n    right: float\n",
        "    right: float\n    left: float\n",
    )
    assert run() == ([7.0, 5.0, 1.0], ["left_of"], "")


def test_a_loop_is_not_compiled_anew_for_a_comment_a_copy_or_another_time(run, folder, tmp_path):
    run()
    edit(folder / "loops" / "called.py", "# a comment", "# another\n    # comment")
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy, copy_function=shutil.copy)
    assert run(copy) == ([7.0, 5.0, 1.0], [], "")


def test_what_was_kept_before_an_edit_is_removed(run, folder):
    def n_files():
        return len(list(folder.rglob("*.nbc")))

    run()
    assert n_files() == len(FRESH)
    edit(folder / "loops" / "called.py", "FACTOR * x", "FACTOR - x")
    run()
    assert n_files() == len(FRESH)


@pytest.mark.parametrize("damage", ["cut", "changed", "empty", "folder"])
def test_a_damaged_file_costs_time_only(run, folder, damage):
    run()
    (path,) = folder.rglob("callers.total-*.nbc")
    content = path.read_bytes()
    middle = len(content) // 2
    if damage == "cut":
        path.write_bytes(content[:middle])
    elif damage == "changed":
        path.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    elif damage == "empty":
        path.write_bytes(b"")
    else:
        path.unlink()
        path.mkdir()
    numbers, names, message = run(XDG_CACHE_HOME=str(folder / "user"))
    assert (numbers, names, message) == ([7.0, 5.0, 1.0], ["total"], "")
    assert run(XDG_CACHE_HOME=str(folder / "user"))[1] == []


def block(folder):
    """Put a file in the place of every folder for machine code but the temporary one, as nobody can write there."""
    (folder / "loops" / "__pycache__").write_text("")
    (folder / "file").write_text("")
    return {"XDG_CACHE_HOME": str(folder / "file"), "HOME": None}


def test_without_a_folder_a_private_temporary_one_is_used_and_said_once(run, folder, tmp_path):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    nowhere = {**block(folder), "TMPDIR": str(temporary)}
    numbers, names, message = run(**nowhere)
    (made,) = temporary.iterdir()
    assert (numbers, names) == ([7.0, 5.0, 1.0], FRESH)
    assert made.stat().st_mode & 0o777 == 0o700
    assert message == (
        f"compiled loops are kept in {made}, because no other folder can be written. "
        "Set NUMBA_CACHE_DIR to choose a folder.\n"
    )
    assert run(**nowhere) == ([7.0, 5.0, 1.0], [], "")


@pytest.mark.parametrize("attack", ["open", "link"])
def test_a_temporary_folder_that_others_may_write_is_not_used(run, folder, tmp_path, attack):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    nowhere = {**block(folder), "TMPDIR": str(temporary)}
    run(**nowhere)
    (made,) = temporary.iterdir()
    if attack == "open":
        made.chmod(0o770)
    else:
        made.rename(tmp_path / "elsewhere")
        made.symlink_to(tmp_path / "elsewhere")
    numbers, names, message = run(**nowhere)
    assert (numbers, names) == ([7.0, 5.0, 1.0], FRESH)
    assert message.startswith("compiled loops cannot be kept (")
    assert message.count("\n") == 1


def test_a_chosen_folder_is_the_only_one(run, folder, tmp_path):
    run()
    chosen = {"NUMBA_CACHE_DIR": str(tmp_path / "chosen")}
    assert run(**chosen)[1] == FRESH
    assert run(**chosen)[1] == []


def test_a_full_disk_costs_time_only_and_is_said_once(run, folder):
    """Writing fails as on a full disk, after some bytes; nothing of it is left behind."""
    full = """
import errno
from pathlib import Path
written = Path.write_bytes
def write_bytes(path, content):
    written(path, content[:9])
    raise OSError(errno.ENOSPC, "No space left on device")
Path.write_bytes = write_bytes
"""
    script = folder / "run.py"
    script.write_text(full + RUN)
    numbers, names, message = run(TMPDIR=str(folder), XDG_CACHE_HOME=str(folder / "user"))
    assert (numbers, names) == ([7.0, 5.0, 1.0], FRESH)
    assert message == (
        "compiled loops cannot be kept (No space left on device), so the next run compiles them "
        "again. Set NUMBA_CACHE_DIR to a folder that can be written.\n"
    )
    assert not [path for path in folder.rglob("*") if ".nbc" in path.name]


def test_an_unknown_user_makes_no_folder_named_tilde(folder, monkeypatch):
    from ground import ahead as folders

    monkeypatch.setattr(folders.os.path, "expanduser", lambda path: path)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    places = list(folders.folders_for(folder / "loops" / "called.py"))
    assert all(place.is_absolute() and "~" not in str(place) for place in places)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="processors of another kind")
def test_what_a_wheel_brings_for_many_processors_is_used(folder, tmp_path):
    """In processes of their own: numba asks for the processor once."""
    shipped = tmp_path / "shipped"
    script = folder / "shipped.py"
    place = f"import ground.decorators, pathlib\nground.decorators.SHIPPED = pathlib.Path({str(shipped)!r})\n"
    script.write_text(place + RUN)

    def alone(**changed):
        done = subprocess.run(
            [sys.executable, str(script)],
            env=environment(**{"NUMBA_CPU_FEATURES": "", **changed}),
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.split()

    level = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CACHE_DIR": str(shipped)}
    assert alone(**level) == ["7.0", "5.0", "1.0", *FRESH]
    for path in list(shipped.rglob("*.nbc")):
        path.rename(shipped / path.name)
    features = ",".join(sorted(_PORTABLE_FEATURES))
    able = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": features}
    old = {"NUMBA_CPU_NAME": "nehalem"}
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    assert alone(**kept, **able) == ["7.0", "5.0", "1.0"]
    assert not list((tmp_path / "kept").rglob("*.nbc"))
    assert alone(**kept, **old) == ["7.0", "5.0", "1.0", *FRESH]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="modes of folders")
@pytest.mark.parametrize("place", ["chosen", "beside", "user", "above", "file"])
def test_code_that_others_could_have_written_is_not_run(run, folder, tmp_path, place):
    """Loops are compiled anew where others may write the folder, one above it, or the file itself."""
    user = folder / "user"
    changed = {"XDG_CACHE_HOME": str(user), "TMPDIR": str(folder)}
    if place == "chosen":
        changed["NUMBA_CACHE_DIR"] = str(tmp_path / "chosen")
    if place in ("user", "above"):
        (folder / "loops" / "__pycache__").write_text("")
    run(**changed)
    assert run(**changed)[1] == []
    (kept, *_) = [path.parent for path in tmp_path.rglob("*.nbc")]
    if place == "file":
        for path in kept.glob("*.nbc"):
            path.chmod(0o666)
    else:
        opened = {"chosen": tmp_path / "chosen", "above": user}.get(place, kept)
        opened.chmod(0o777)
    numbers, names, message = run(**changed)
    assert (numbers, names) == ([7.0, 5.0, 1.0], FRESH)
    assert ("NUMBA_CACHE_DIR must be a folder that no other user can write" in message) == (
        place == "chosen"
    )


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="modes of folders")
def test_folders_are_made_for_this_user_whatever_its_mask(run, folder, tmp_path):
    """With a mask of 0, others could write all that a program makes."""
    script = folder / "run.py"
    script.write_text("import os\nos.umask(0)\n" + RUN)
    changed = {"XDG_CACHE_HOME": str(folder / "user"), "NUMBA_CACHE_DIR": str(tmp_path / "chosen")}
    assert run(**changed)[1] == FRESH
    assert run(**changed)[1] == []
    made = [*(tmp_path / "chosen").rglob("*")]
    assert made
    assert not [path for path in made if path.stat().st_mode & 0o022]


# Names of numba that are no promise: where one has another name, loops compile more slowly, with
# the same answers.


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
RUN_RENAMED = """
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
def renamed_folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("renamed")
    (place / "own_loops.py").write_text(LOOPS)
    (place / "run.py").write_text(RUN_RENAMED)
    return place


def run_renamed(renamed_folder, cache, *names):
    own = {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(cache), "NUMBA_DISABLE_JIT": "0"}
    done = subprocess.run(
        [sys.executable, renamed_folder / "run.py", *names],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **own},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def run_twice(renamed_folder, cache, *names):
    """Return what a run that compiles prints, and one that finds its machine code."""
    return [run_renamed(renamed_folder, cache, *names) for _ in range(2)]


def test_loops_run_where_no_name_is_as_it_was(renamed_folder):
    assert run_twice(renamed_folder, renamed_folder / "all", *NAMES) == [PRINTED, PRINTED]


@pytest.mark.skipif("EACH_NAME" not in os.environ, reason="two minutes, set EACH_NAME=1")
@pytest.mark.parametrize("name", NAMES)
def test_loops_run_where_one_name_is_another(renamed_folder, name):
    assert run_twice(renamed_folder, renamed_folder / name, name) == [PRINTED, PRINTED]
