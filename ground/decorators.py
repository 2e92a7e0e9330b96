"""Compiled loops: machine code kept in files, for as few signatures as can be."""

from __future__ import annotations

import glob
import hashlib
import logging
import multiprocessing
import os
import pickle
import sys
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numba as nb
from numba import types

from ground.ahead import (
    SHIPPED,
    chosen_folder,
    folders_for,
    is_awaited,
    is_temporary,
    is_trusted,
    make_folder,
)
from ground.loop_code import digest_of, file_digest

# Machine code of compiled loops, kept in files: one for each function and each combination of
# argument types.
#
# It takes the place of numba's own cache, which notices no change in another file, stops the
# program where it finds no folder to write, and mixes up two signatures of a function that two
# processes compile at once.
#
# A file is used only where all of these are the same: what the code depends on (`dependencies`),
# the versions of numba and Python, the processor's features, numba's settings, and the argument
# types. Whatever else is wrong with a file or a folder costs time: the loop is compiled.
#
# A wheel can bring files in the folder ``shipped``. They are for any processor of the level
# x86-64-v3.


_logger = logging.getLogger("aspectgraph")
_MAGIC = b"aspectgraph loop 1\n"
_TAG = f"{sys.implementation.name}{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
# what these hold changes the machine code
_DECIDING = ("decorators.py", "linked.py")
# processors that run what a wheel brings, in numba's name for them and their features
_PORTABLE = ("x86-64-v3", "")
_PORTABLE_FEATURES = frozenset(("+avx2", "+bmi", "+bmi2", "+f16c", "+fma", "+lzcnt", "+movbe"))
_POLL_S = 0.05
_OTHERS_WRITE = 0o022
# settings that change the machine code
_SETTINGS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT")


@dataclass
class _State:
    """What this process has met so far: whether it said so, and whether something could not be kept."""

    is_told: bool = False
    lost: bool = False


_state = _State()


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Callable[..., Any]:
    """Compile a function as `numba.njit` does, and keep the machine code; options are numba's."""
    if function is None:
        return partial(njit, **options)
    return keep(nb.njit(**options)(function))


def keep(dispatcher: Any) -> Any:
    """Let numba's dispatcher keep its machine code on disk; a function that is not compiled stays as it is."""
    if hasattr(dispatcher, "py_func") and hasattr(dispatcher, "_cache"):
        # numba's cache that keeps nothing has all that numba asks of one
        names = {name for name in dir(dispatcher._cache) if not name.startswith("_")}
        if names <= set(dir(LoopCache)):
            dispatcher._cache = LoopCache(dispatcher)
    return dispatcher


class LoopCache:
    """The machine code of one function on disk, in place of numba's cache.

    Parameters
    ----------
    dispatcher : numba dispatcher
        The compiled function.
    """

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher = dispatcher
        self._source = Path(dispatcher.py_func.__code__.co_filename)
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The first folder of those that are looked at."""
        return str(next(folders_for(self._source), ""))

    def enable(self) -> None:
        """Read and write files, as at first."""
        self._enabled = True

    def disable(self) -> None:
        """Neither read nor write files."""
        self._enabled = False

    def flush(self) -> None:
        """Keep what is on disk: it is used only where it is right."""

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature; None where no file has it."""
        if not self._enabled:
            return None
        result = self._loaded(signature, target_context)
        while result is None and is_awaited(self._dispatcher.py_func, signature):
            time.sleep(_POLL_S)
            result = self._loaded(signature, target_context)
        return result

    def _loaded(self, signature: Any, target_context: Any) -> Any:
        try:
            # the target must know what the code calls
            target_context.refresh()
            names = self._names(signature, target_context.codegen())
        except Exception:
            # whatever numba or a damaged installation raises: the loop is compiled
            return None
        for content in self._contents(names):
            result = _restored(content, signature, target_context)
            if result is not None:
                return result
        return None

    def is_kept(self, signature: Any) -> bool:
        """Return whether there is a file for a signature; it is not read.

        Parameters
        ----------
        signature : numba signature or tuple of types
            Of the arguments.
        """
        try:
            names = self._names(signature, self._dispatcher.targetctx.codegen())
        except Exception:
            # as in `_loaded`: compiling it will tell
            return False
        return any((folder / name).exists() for name in names for folder in self._folders())

    def save_overload(self, signature: Any, result: Any) -> None:
        """Write what was compiled for a signature to the first folder that takes it; tell once where none does."""
        if not self._enabled:
            return
        try:
            names = self._names(signature, result.library.codegen)
            content = _packed(result)
        except Exception as error:
            # whatever numba raises: the run goes on with what it compiled
            _lose(_in_one_line(error))
            return
        if names and content is not None:
            self._write(names[0], content)

    def _contents(self, names: Sequence[str]) -> Iterator[bytes]:
        """Yield the contents of the files of these names, without those that are cut or damaged."""
        if not names:
            return
        folders = self._folders()
        for name in names:
            for folder in folders:
                path = folder / name
                try:
                    whole = path.read_bytes()
                except OSError:
                    continue
                # also a file that another user left there before
                if not is_trusted(path, self._source):
                    continue
                start = len(_MAGIC) + hashlib.sha256().digest_size
                content = whole[start:]
                if whole[:start] == _MAGIC + hashlib.sha256(content).digest():
                    yield content

    def _folders(self) -> list[Path]:
        """Return the folders that are read."""
        folders = list(folders_for(self._source))
        if is_trusted(SHIPPED, self._source):
            folders.append(SHIPPED)
        return folders

    def _write(self, name: str, content: bytes) -> None:
        whole = _MAGIC + hashlib.sha256(content).digest() + content
        reason = "no folder can be written by this user alone"
        chosen = chosen_folder()
        if chosen is not None and not is_trusted(chosen, self._source):
            _tell_once(
                f"NUMBA_CACHE_DIR must be a folder that no other user can write. Got {chosen}; "
                "compiled loops are kept elsewhere."
            )
        for folder in folders_for(self._source):
            try:
                make_folder(folder)
                _replace(folder / name, whole)
            except OSError as error:
                reason = error.strerror or str(error)
                continue
            _remove_outdated(folder / name)
            if is_temporary(folder):
                _tell_once(
                    f"compiled loops are kept in {folder.parent}, because no other folder can be "
                    "written. Set NUMBA_CACHE_DIR to choose a folder."
                )
            return
        _lose(reason)

    def _names(self, signature: Any, codegen: Any) -> list[str]:
        """Return the names of files for a signature, the one that is written first.

        There are none where other processes know no such name.
        """
        if not self._source.is_absolute():
            return []
        kinds = _kinds_text(signature)
        if " at 0x" in kinds:
            return []
        content = _digest(digest_of(self._dispatcher), _own_digest(), nb.__version__)
        settings = [str(getattr(nb.config, name, None)) for name in _SETTINGS]
        function = self._dispatcher.py_func
        readable = function.__qualname__.replace("<", "").replace(">", "")[:80]
        names = []
        for target in _targets(codegen):
            key = _digest(kinds, target, *settings)
            names.append(f"{self._source.stem}.{readable}-{content[:20]}-{key[:20]}.{_TAG}.nbc")
        return names


def _targets(codegen: Any) -> Iterator[str]:
    """Yield the kinds of processors whose machine code this one runs, its own first."""
    target = codegen.magic_tuple()
    yield repr(target)
    triple, processor, features = target
    portable = (triple, *_PORTABLE)
    enough = triple.startswith("x86_64") and set(features.split(",")) >= _PORTABLE_FEATURES
    if enough and processor != portable[1]:
        yield repr(portable)


def _kinds_text(signature: Any) -> str:
    """Return the types of a signature; of named tuples the fields, too, which numba's names for types leave out."""
    kinds = getattr(signature, "args", signature)
    return ",".join(map(_kind_text, kinds))


def _kind_text(kind: Any) -> str:
    fields = getattr(kind, "fields", "")
    parts = getattr(kind, "types", ())
    inside = ",".join(map(_kind_text, parts)) if isinstance(parts, tuple) else ""
    named = getattr(kind, "instance_class", None)
    owner = f"{named.__module__}.{named.__qualname__}" if isinstance(named, type) else ""
    return f"{kind}{owner}{fields}({inside})"


def _packed(result: Any) -> bytes | None:
    """Return what is kept of compiled code; None for code that only this process can use."""
    from numba.core.serialize import dumps

    lifted = any(not loop.can_cache for loop in result.lifted)
    if lifted or result.library.has_dynamic_globals:
        _logger.info("%s cannot be kept on disk", result.fndesc.qualname)
        return None
    return bytes(dumps(result._reduce()))  # type: ignore[no-untyped-call]


def _restored(content: bytes, signature: Any, target_context: Any) -> Any:
    """Return compiled code from what was kept of it; None where that fails, or where it is another signature's."""
    try:
        from numba.core.compiler import CompileResult

        parts = pickle.loads(content)
        result: Any = CompileResult._rebuild(target_context, *parts)  # type: ignore[no-untyped-call]
        same = tuple(result.signature.args) == tuple(getattr(signature, "args", signature))
    except Exception:
        # unpickling runs what the file names, so any error is possible: the loop is compiled
        return None
    return result if same else None


def _replace(path: Path, content: bytes) -> None:
    """Write a file at once: readers see the old one or the new one."""
    beside = path.with_name(f"{path.name}.{uuid.uuid4().hex[:12]}.tmp")
    try:
        beside.write_bytes(content)
        mode = beside.stat().st_mode
        if mode & _OTHERS_WRITE:
            beside.chmod(mode & 0o777 & ~_OTHERS_WRITE)
        os.replace(beside, path)
    except BaseException:
        # an interruption, too, must leave no half a file
        beside.unlink(missing_ok=True)
        raise


def _remove_outdated(path: Path) -> None:
    """Remove what was kept of the same function before it, or what it calls, was edited."""
    base, content, _ = path.name.rsplit("-", 2)
    if ".locals." in base:
        # several functions of this name may be alive, with other values in their closures
        return
    for old in path.parent.glob(f"{glob.escape(base)}-*.{_TAG}.nbc"):
        if old.name.rsplit("-", 2)[:2] != [base, content]:
            with suppress(OSError):
                old.unlink()


@lru_cache(maxsize=1)
def _own_digest() -> str:
    """Return a digest of how loops are compiled."""
    folder = Path(__file__).parent
    return _digest(*(file_digest(str(folder / name)) for name in _DECIDING))


def _digest(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _in_one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


def keeps_loops() -> bool:
    """Return whether everything that this process compiled so far could be kept."""
    return not _state.lost


def _lose(reason: str) -> None:
    """Take note that something could not be kept."""
    _state.lost = True
    _tell_once(
        f"compiled loops cannot be kept ({reason}), so the next run compiles them again. "
        "Set NUMBA_CACHE_DIR to a folder that can be written."
    )


def _tell_once(text: str) -> None:
    """Log the first text of this process; worker processes leave it to the one that started them."""
    if not _state.is_told and multiprocessing.parent_process() is None:
        _logger.warning("%s", text)
    _state.is_told = True


# Compiling loops: for as few signatures as can be, and without bookkeeping where they are called
# very often.
#
# Compiling takes most of the first run. Numba compiles a function anew for every combination of
# argument types. Integers come in three kinds here: read from an array of 32 bits, computed in
# 64, and written in the source. What these functions get is widened to 64 bits, so that there is
# one version of each.
#
# Some of this rests on names of numba that are no promise. Where one is missing, functions are
# compiled in numba's usual way: that takes longer, and the answers are the same.


try:
    from ground.linked import EntryCompiler, LinkedCompiler, has_all_names
except (ImportError, AttributeError):
    _LINKING = False
else:
    _LINKING = has_all_names()

# names of numba's dispatchers that are no promise
_CALLED = ("get_call_template",)
_ENTERED = ("_insert", "_compile_for_args")


def _options(**wanted: Any) -> dict[str, Any]:
    """Return those options that numba knows."""
    try:
        from numba.core.cpu import CPUTargetOptions as Known
    except ImportError:
        return {}
    return {name: value for name, value in wanted.items() if hasattr(Known, name)}


# numba's stubs know none of these
_NO_ENTRY = _options(no_cpython_wrapper=True, no_cfunc_wrapper=True)
_NO_POINTER = _options(no_cfunc_wrapper=True)
_NO_COUNTS = _options(_nrt=False)


def _wide(kind: Any) -> Any:
    if isinstance(kind, types.IntegerLiteral):
        kind = kind.literal_type
    # numba's stubs do not know that integers may be signed
    integer = isinstance(kind, types.Integer)
    return types.int64 if integer and kind.signed else kind


def _one_signature(dispatcher: Any) -> Any:
    """Let calls from compiled code widen signed integers, which saves versions of the function.

    A function that is not compiled at all stays as it is.
    """
    if not _has(dispatcher, _CALLED):
        return dispatcher
    template = dispatcher.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        return template(tuple(map(_wide, args)), kws)

    dispatcher.get_call_template = get_call_template
    return dispatcher


def _has(value: Any, names: tuple[str, ...]) -> bool:
    return all(hasattr(value, name) for name in names)


def _for_loops_only(
    function: Callable[..., Any], options: dict[str, Any], counting: dict[str, Any]
) -> Any:
    """Compile a function without an entry for Python; once more, and with one, should Python call it."""
    usual = nb.njit(**options)(function)
    if not _LINKING or not _has(usual, _ENTERED):
        return keep(_one_signature(usual))
    kind = {**_NO_ENTRY, **counting, "pipeline_class": LinkedCompiler}
    dispatcher: Any = nb.njit(**kind, **options)(function)
    # without these an address that does not exist would be called
    dispatcher._insert = _not_inserted
    dispatcher._compile_for_args = usual._compile_for_args
    return keep(_one_signature(dispatcher))


def _not_inserted(*_: object, **__: object) -> None:
    """Keep a version from Python's sight."""


def entry_kernel(function: Callable[..., Any] | None = None, **options: Any) -> Callable[..., Any]:
    """Compile a function that Python calls, for one kind of integers; options are numba's."""
    if function is None:
        return partial(entry_kernel, **options)
    if _LINKING:
        options = {**_NO_POINTER, "pipeline_class": EntryCompiler, **options}
    dispatcher: Callable[..., Any] = keep(_one_signature(nb.njit(**options)(function)))
    return dispatcher


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Callable[..., Any]:
    """Compile a function that compiled loops call, for one kind of integers; options are numba's.

    There is no entry for Python, which takes longer to compile than many a loop: it unpacks all arrays of a complex. A
    call from Python, as in a test, compiles one.
    """
    if function is None:
        return partial(kernel, **options)
    return _for_loops_only(function, options, {})


def kernel_without_refcounts(
    function: Callable[..., Any] | None = None, **options: Any
) -> Callable[..., Any]:
    """Compile an `kernel` function that allocates nothing, without counting references.

    Counting those of a complex's arrays at every call takes longer than the work. Assigning a row of an array
    allocates.
    """
    if function is None:
        return partial(kernel_without_refcounts, **options)
    return _for_loops_only(function, options, _NO_COUNTS)


@kernel
def put(target: Any, values: Any) -> None:
    """Write values (n,) to the first places of a target, one by one.

    An assignment of arrays compares their shapes, with a message whose text takes seconds to compile.
    """
    for i in range(len(values)):
        target[i] = values[i]


@kernel
def put_table(target: Any, values: Any) -> None:
    """Write values (n, m) to the first rows of a target, one by one; see `put`."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            target[i, j] = values[i, j]


@kernel
def holds_value(values: Any, wanted: Any) -> bool:
    """Whether one of the values (n,) is the wanted one; an expression of arrays takes longer to compile."""
    holds = False
    for value in values:
        holds |= value == wanted
    return holds
