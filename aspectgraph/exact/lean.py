"""Compiling loops: each for as few signatures as can be, and those that are called very often without bookkeeping.

Compiling takes most of the first run. Numba compiles a function anew for every combination of argument types, and
integers come in three kinds here: read from an array of 32 bits, computed in 64, and written in the source. What these
functions get is widened to 64 bits, so that there is one version of each.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba as nb
from numba.core import types


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


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function, for one kind of integers."""
    return _one_signature(nb.njit(cache=True)(function))


def lean(function: Callable[..., Any]) -> Any:
    """Compile a function that allocates nothing, for one kind of integers and without counting references.

    Counting those of a complex's arrays at every call takes longer than the work. Assigning a row of an array
    allocates.
    """
    # numba's stubs do not know the option
    options: dict[str, Any] = {"cache": True, "_nrt": False}
    return _one_signature(nb.njit(**options)(function))


@compiled
def put(target: Any, values: Any) -> None:
    """Write values (n,) to the first places of a target, one by one.

    An assignment of arrays compares their shapes, with a message whose text takes seconds to compile.
    """
    for i in range(len(values)):
        target[i] = values[i]
