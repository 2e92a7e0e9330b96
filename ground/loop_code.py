"""Argument types of compiled loops as plain data, which a file can hold for other versions of numba."""

from __future__ import annotations

import enum
import hashlib
import inspect
import sys
import types as python_types
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numba import types as numba_types

# What machine code depends on: a digest of a compiled function, of all it calls, and of the
# constants it takes in.
#
# Numba freezes global constants and compiles called functions into the machine code. Its own
# cache looks at the file of the function alone, so it does not notice an edited function or
# constant of another file.
#
# Code and values are compared, not files: an edited comment compiles nothing anew, and a copy of
# the sources elsewhere finds what was compiled for it.


# numba's own code has numba's version, and the rest is Python's
_FOREIGN = frozenset({*sys.stdlib_module_names, "numba", "numpy", "llvmlite", "scipy"})
# numba clears the other flags of a loop's code that runs under a profiler
_CALLING = inspect.CO_VARARGS | inspect.CO_VARKEYWORDS | inspect.CO_GENERATOR
_PLAIN = (bool, int, float, complex, str, bytes, range, slice, type(None), type(...))


def digest_of(function: Callable[..., Any]) -> str:
    """Return a digest of a function, of all functions it can call, and of the constants they use.

    Parameters
    ----------
    function : callable
        A function, or numba's dispatcher of one.

    Returns
    -------
    str
        64 hexadecimal digits, the same in every process and for every copy of the sources.
    """
    texts = sorted(_text(called) for called in reachable(function))
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def reachable(function: Callable[..., Any]) -> list[Any]:
    """Return a function and all it can call, directly or not, each once; foreign ones are left out."""
    waiting = [function]
    ids = {id(plain_function(function))}
    result = []
    while waiting:
        current = waiting.pop()
        result.append(current)
        for called in callees(current):
            plain = plain_function(called)
            if id(plain) not in ids:
                ids.add(id(plain))
                waiting.append(called)
    return result


def callees(function: Any) -> Iterator[Any]:
    """Yield the functions that a function names, in the order of their names; foreign ones are left out."""
    for _, value in _references(plain_function(function)):
        yield from _functions_in(value)


def _functions_in(value: Any) -> Iterator[Any]:
    if isinstance(value, (tuple, list)):
        for part in value:
            yield from _functions_in(part)
        return
    plain = plain_function(value)
    if isinstance(plain, python_types.FunctionType) and not _is_foreign(plain):
        yield value


def plain_function(value: Any) -> Any:
    """Return the Python function of numba's dispatcher or intrinsic; otherwise the value itself."""
    if isinstance(value, (type, python_types.ModuleType, python_types.FunctionType, np.ndarray)):
        return value
    for name in ("py_func", "__wrapped__"):
        inside = getattr(value, name, None)
        if isinstance(inside, python_types.FunctionType):
            return inside
    return value


def _is_foreign(value: Any) -> bool:
    name = getattr(value, "__module__", None) or ""
    return name.partition(".")[0] in _FOREIGN


def _text(function: Any) -> str:
    """Return what one function is: its code, its options, and the values it names."""
    plain = plain_function(function)
    parts = [plain.__module__ or "", plain.__qualname__, _code_text(plain.__code__)]
    parts.append(_value_text(plain.__defaults__))
    parts.append(_value_text(plain.__kwdefaults__))
    parts.append(_value_text(getattr(function, "targetoptions", None)))
    parts += [f"{name}={_value_text(value)}" for name, value in _references(plain)]
    return "|".join(parts)


def _references(function: python_types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the global names and the values of closures that a function uses, with their values.

    A name that is an attribute only is taken for a global of that name, too: the digest then holds more than it must.
    """
    names = _names(function.__code__)
    for name in names:
        if name in function.__globals__:
            value = function.__globals__[name]
            yield name, value
            if isinstance(value, python_types.ModuleType):
                yield from _attributes(value, names)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=False):
        try:
            yield name, cell.cell_contents
        except ValueError:
            # not filled yet
            continue


def _attributes(
    module: python_types.ModuleType, names: tuple[str, ...]
) -> Iterator[tuple[str, Any]]:
    """Yield the values of a module of ours that have one of the names, and of the modules in it."""
    waiting = [module]
    module_names = set()
    while waiting:
        current = waiting.pop()
        if current.__name__ in module_names or current.__name__.partition(".")[0] in _FOREIGN:
            continue
        module_names.add(current.__name__)
        for name in names:
            value = vars(current).get(name)
            if isinstance(value, python_types.ModuleType):
                waiting.append(value)
            elif name in vars(current):
                yield f"{current.__name__}.{name}", value


@cache
def _names(code: python_types.CodeType) -> tuple[str, ...]:
    """Return the names of globals and attributes in a function's code and in the functions inside it, sorted."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, python_types.CodeType):
            names.update(_names(constant))
    return tuple(sorted(names))


@cache
def _code_text(code: python_types.CodeType) -> str:
    """Return instructions, names and constants; not where they stand in which file."""
    flags = code.co_flags & _CALLING
    parts = [code.co_code.hex(), repr((code.co_argcount, code.co_kwonlyargcount, flags))]
    parts += [repr(code.co_names), repr(code.co_varnames), repr(code.co_freevars)]
    for constant in code.co_consts:
        inside = isinstance(constant, python_types.CodeType)
        parts.append(_code_text(constant) if inside else _value_text(constant))
    return hashlib.sha256("|".join(parts).encode()).hexdigest()


def _value_text(value: Any) -> str:
    """Return a text that is the same for the same value, in every process."""
    if isinstance(value, enum.Enum):
        return f"{type(value).__module__}.{value}={value.value!r}"
    if type(value) in _PLAIN:
        return f"{type(value).__name__}:{value!r}"
    if isinstance(value, (np.ndarray, np.generic)):
        table = np.ascontiguousarray(value)
        content = hashlib.sha256(table.tobytes()).hexdigest()
        return f"array:{table.dtype.descr}:{np.shape(value)}:{content}"
    if isinstance(value, (tuple, list)):
        return f"{_class_name(type(value))}({','.join(map(_value_text, value))})"
    if isinstance(value, (set, frozenset)):
        return f"set({','.join(sorted(map(_value_text, value)))})"
    if isinstance(value, dict):
        pairs = [f"{_value_text(key)}:{_value_text(held)}" for key, held in value.items()]
        return f"dict({','.join(sorted(pairs))})"
    if isinstance(value, python_types.ModuleType):
        return f"module:{value.__name__}"
    if isinstance(value, type):
        return _class_text(value)
    return _object_text(value)


def _object_text(value: Any) -> str:
    plain = plain_function(value)
    name = getattr(plain, "__qualname__", None)
    if name is not None:
        # what a function of ours does is in the digest by itself
        return f"function:{getattr(plain, '__module__', '')}.{name}"
    shown = repr(value)
    text = f"object:{_class_text(type(value))}:{'' if ' at 0x' in shown else shown}"
    held = getattr(value, "__dict__", None)
    if isinstance(held, dict) and not _is_foreign(type(value)):
        simple = {key: part for key, part in held.items() if type(part) in _PLAIN}
        return f"{text}:{_value_text(simple)}"
    return text


def _class_name(kind: type) -> str:
    fields = getattr(kind, "_fields", "")
    return f"{kind.__module__}.{kind.__qualname__}{fields}"


def _class_text(kind: type) -> str:
    """Return a class's name, its fields or members, and the content of its file: its methods can be compiled, too."""
    if _is_foreign(kind):
        return f"class:{_class_name(kind)}"
    if issubclass(kind, tuple) and hasattr(kind, "_fields"):
        return f"class:{_class_name(kind)}"
    if issubclass(kind, enum.Enum):
        return f"class:{_class_name(kind)}:{','.join(map(_value_text, kind))}"
    if issubclass(kind, BaseException):
        return f"class:{_class_name(kind)}"
    return f"class:{_class_name(kind)}:{_source_digest(kind.__module__)}"


def _source_digest(module: str) -> str:
    path = getattr(sys.modules.get(module), "__file__", None)
    return file_digest(path) if path else ""


@cache
def file_digest(path: str) -> str:
    """Return a digest of a file's content; an empty text where it cannot be read."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return ""


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
        Module and name in it, such as ``ground.decorators:put``.

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
