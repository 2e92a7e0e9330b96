"""Argument types of compiled loops as plain data, which a file can hold for other versions of numba."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from numba import types as numba_types

# numba's own have no annotations
types: Any = numba_types

_NAMED = {
    str(kind): kind
    for kind in (
        *types.integer_domain,
        *types.real_domain,
        *types.complex_domain,
        types.boolean,
        types.none,
        types.unicode_type,
    )
}


def encoded(kind: Any) -> Any:
    """Return a type as names, numbers and lists.

    Parameters
    ----------
    kind : numba type
        Of a number, an array, a tuple, a named tuple, a compiled function, or what may be none of it.

    Returns
    -------
    str or list
        `decoded` makes the type of it.

    Raises
    ------
    ValueError
        If this module knows no words for the type.
    """
    plain = _plain(kind)
    if plain is None or decoded(plain) != kind:
        raise ValueError(f"kind must be one of the types that loops get. Got {kind}.")
    return plain


def _plain(kind: Any) -> Any:
    if str(kind) in _NAMED:
        return str(kind)
    if type(kind) is types.Array:
        flags = [int(kind.mutable), int(kind.aligned)]
        return ["array", _plain(kind.dtype), kind.ndim, kind.layout, *flags]
    if isinstance(kind, types.BaseTuple):
        items: Any = kind
        owner = getattr(items, "instance_class", None)
        name = "" if owner is None else address_of(owner)
        return ["tuple", name, *map(_plain, items.types)]
    if isinstance(kind, types.Optional):
        return ["optional", _plain(kind.type)]
    if isinstance(kind, types.Dispatcher):
        return ["function", address_of(kind.dispatcher.py_func)]
    if isinstance(kind, types.Omitted) and isinstance(kind.value, (bool, int, float, type(None))):
        return ["omitted", kind.value]
    if isinstance(kind, (types.IntegerLiteral, types.BooleanLiteral, types.StringLiteral)):
        return ["literal", kind.literal_value]
    return None


def decoded(plain: Any) -> Any:
    """Return the type that `encoded` made plain data of.

    Parameters
    ----------
    plain : str or list
        A name, or a kind with what belongs to it.

    Returns
    -------
    numba type
        Of an argument.

    Raises
    ------
    ValueError
        If the words are unknown.
    ImportError, AttributeError
        If a class or function is no longer there.
    """
    if isinstance(plain, str):
        if plain not in _NAMED:
            raise ValueError(f"plain must name a type. Got {plain!r}.")
        return _NAMED[plain]
    if not plain:
        raise ValueError("plain must name a type. Got nothing.")
    word = plain[0]
    if word == "array":
        _, dtype, ndim, layout, mutable, aligned = plain
        return types.Array(
            decoded(dtype), ndim, layout, readonly=not mutable, aligned=bool(aligned)
        )
    if word == "tuple":
        owner = named(plain[1]) if plain[1] else None
        return types.BaseTuple.from_types([decoded(part) for part in plain[2:]], owner)
    if word == "optional":
        return types.Optional(decoded(plain[1]))
    if word == "function":
        return types.Dispatcher(named(plain[1]))
    if word == "omitted":
        return types.Omitted(plain[1])
    if word == "literal":
        return types.literal(plain[1])
    raise ValueError(f"plain must begin with a known word. Got {word!r}.")


def named(address: str) -> Any:
    """Return the object with an address.

    Parameters
    ----------
    address : str
        Module and name in it, such as ``compiled.decorators:put``.

    Returns
    -------
    object
        A class or a compiled function.

    Raises
    ------
    ImportError, AttributeError
        If it is no longer there.
    """
    module, _, name = address.partition(":")
    value: Any = import_module(module)
    for part in name.split("."):
        value = getattr(value, part)
    return value


def address_of(value: Any) -> str:
    """Return the address of a class or function, see `named`.

    Parameters
    ----------
    value : class or function
        At the top of its module.

    Returns
    -------
    str
        Module and name.
    """
    return f"{value.__module__}:{value.__qualname__}"
