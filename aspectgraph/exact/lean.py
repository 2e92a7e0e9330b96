"""Compiling loops: each for as few signatures as can be, and those that are called very often without bookkeeping.

Compiling takes most of the first run. Numba compiles a function anew for every combination of argument types, and
integers come in three kinds here: read from an array of 32 bits, computed in 64, and written in the source. What these
functions get is widened to 64 bits, so that there is one version of each.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numba as nb
from numba.core import types

from aspectgraph.exact.linked import EntryCompiler, LinkedCompiler


def _wide(kind: Any) -> Any:
    if isinstance(kind, types.IntegerLiteral):
        kind = kind.literal_type
    # numba's stubs do not know that integers may be signed
    integer = isinstance(kind, types.Integer)
    return types.int64 if integer and kind.signed else kind


def _one_signature(dispatcher: Any) -> Any:
    """Let calls from compiled code widen signed integers; a function that is not compiled at all stays as it is."""
    if not hasattr(dispatcher, "get_call_template"):
        return dispatcher
    template = dispatcher.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        # a recursive call is resolved by the types of the call that is being compiled
        return template(args if dispatcher.is_compiling else tuple(map(_wide, args)), kws)

    dispatcher.get_call_template = get_call_template
    return dispatcher


# numba's stubs know none of these
_NO_ENTRY: dict[str, Any] = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": LinkedCompiler,
}
_NO_POINTER: dict[str, Any] = {"no_cfunc_wrapper": True, "pipeline_class": EntryCompiler}
_NO_COUNTS: dict[str, Any] = {"_nrt": False}


def _for_loops_only(dispatcher: Any, function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Let a function without an entry for Python be compiled once more, and with one, should Python call it."""
    if hasattr(dispatcher, "get_call_template"):
        # without these an address that does not exist would be called
        dispatcher._insert = _not_inserted
        dispatcher._compile_for_args = nb.njit(**options)(function)._compile_for_args
    return dispatcher


def _not_inserted(*_: object, **__: object) -> None:
    """Keep a version from Python's sight."""


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Callable[..., Any]:
    """Compile a function that Python calls, for one kind of integers; options are numba's."""
    if function is None:
        return partial(compiled, **options)
    dispatcher: Callable[..., Any] = _one_signature(
        nb.njit(cache=True, **_NO_POINTER, **options)(function)
    )
    return dispatcher


def inner(function: Callable[..., Any] | None = None, **options: Any) -> Callable[..., Any]:
    """Compile a function that compiled loops call, for one kind of integers; options are numba's.

    There is no entry for Python, which takes longer to compile than many a loop: it unpacks all arrays of a complex. A
    call from Python, as in a test, compiles one.
    """
    if function is None:
        return partial(inner, **options)
    return _for_loops_only(
        _one_signature(nb.njit(cache=True, **_NO_ENTRY, **options)(function)), function, options
    )


def lean(function: Callable[..., Any] | None = None, **options: Any) -> Callable[..., Any]:
    """Compile an `inner` function that allocates nothing, without counting references.

    Counting those of a complex's arrays at every call takes longer than the work. Assigning a row of an array
    allocates.
    """
    if function is None:
        return partial(lean, **options)
    dispatcher = nb.njit(cache=True, **_NO_ENTRY, **_NO_COUNTS, **options)(function)
    return _for_loops_only(_one_signature(dispatcher), function, options)


@inner
def put(target: Any, values: Any) -> None:
    """Write values (n,) to the first places of a target, one by one.

    An assignment of arrays compares their shapes, with a message whose text takes seconds to compile.
    """
    for i in range(len(values)):
        target[i] = values[i]


@inner
def put_table(target: Any, values: Any) -> None:
    """Write values (n, m) to the first rows of a target, one by one; see `put`."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            target[i, j] = values[i, j]


@inner
def holds_value(values: Any, wanted: Any) -> bool:
    """Whether one of the values (n,) is the wanted one; an expression of arrays takes longer to compile."""
    found = False
    for value in values:
        found |= value == wanted
    return found
