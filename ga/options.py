"""Keywords of a public call that are held in a frozen dataclass: shown in its signature, and checked by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from inspect import Parameter, signature
from typing import Any, TypeVar

_Call = TypeVar("_Call", bound=Callable[..., Any])
_Options = TypeVar("_Options")


def with_keywords_of(kind: type) -> Callable[[_Call], _Call]:
    """Return a decorator that shows the fields of a dataclass as keywords, in place of ``**options``.

    Parameters
    ----------
    kind : type
        The dataclass; every field has a plain default.

    Returns
    -------
    callable
        Sets the ``__signature__`` of a function, which `help` and notebooks read, and returns the function itself.
    """

    def decorate(function: _Call) -> _Call:
        plain = signature(function)
        own = [one for one in plain.parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
        more = [
            Parameter(one.name, Parameter.KEYWORD_ONLY, default=one.default, annotation=one.type)
            for one in fields(kind)
        ]
        function.__signature__ = plain.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
        return function

    return decorate


def chosen(
    kind: type[_Options], function: Callable[..., Any], options: Mapping[str, object]
) -> _Options:
    """Return the options of a call as the dataclass that holds them.

    Parameters
    ----------
    kind : type
        The dataclass.
    function : callable
        The call, decorated by `with_keywords_of`.
    options : mapping of str to object
        Its ``**options``.

    Raises
    ------
    TypeError
        If a keyword is unknown; it names the legal ones.
    """
    known = {one.name for one in fields(kind)}  # type: ignore[arg-type]
    for name in options:
        if name not in known:
            legal = ", ".join(signature(function).parameters)
            raise TypeError(
                f"{function.__name__}() got an unexpected keyword argument {name!r}. It takes {legal}."
            )
    return kind(**options)
