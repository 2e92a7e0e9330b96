"""Compiling loops: for as few signatures as can be, and without bookkeeping where they are called very often.

Compiling takes most of the first run. Numba compiles a function anew for every combination of argument types. Integers
come in three kinds here: read from an array of 32 bits, computed in 64, and written in the source. What these
functions get is widened to 64 bits, so that there is one version of each.

Some of this rests on names of numba that are no promise. Where one is missing, functions are compiled in numba's usual
way: that takes longer, and the answers are the same.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numba as nb
from numba import types

from ground.loop_cache import keep

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
    found = False
    for value in values:
        found |= value == wanted
    return found
