"""What machine code depends on: a digest of a compiled function, of all it calls, and of the constants it takes in.

Numba freezes global constants and compiles called functions into the machine code. Its own cache looks at the file
of the function alone, so it does not notice an edited function or constant of another file.

Code and values are compared, not files: an edited comment compiles nothing anew, and a copy of the sources elsewhere
finds what was compiled for it.
"""

from __future__ import annotations

import enum
import hashlib
import sys
import types
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

# numba's own code has numba's version, and the rest is Python's
_FOREIGN = frozenset({*sys.stdlib_module_names, "numba", "numpy", "llvmlite", "scipy"})
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
    known = {id(plain_function(function))}
    result = []
    while waiting:
        current = waiting.pop()
        result.append(current)
        for called in callees(current):
            plain = plain_function(called)
            if id(plain) not in known:
                known.add(id(plain))
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
    if isinstance(plain, types.FunctionType) and not _is_foreign(plain):
        yield value


def plain_function(value: Any) -> Any:
    """Return the Python function of numba's dispatcher or intrinsic; otherwise the value itself."""
    if isinstance(value, (type, types.ModuleType, types.FunctionType, np.ndarray)):
        return value
    for name in ("py_func", "__wrapped__"):
        inside = getattr(value, name, None)
        if isinstance(inside, types.FunctionType):
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


def _references(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the global names and the values of closures that a function uses, with their values.

    A name that is an attribute only is taken for a global of that name, too: the digest then holds more than it must.
    """
    names = _names(function.__code__)
    for name in names:
        if name in function.__globals__:
            value = function.__globals__[name]
            yield name, value
            if isinstance(value, types.ModuleType):
                yield from _attributes(value, names)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=False):
        try:
            yield name, cell.cell_contents
        except ValueError:
            # not filled yet
            continue


def _attributes(module: types.ModuleType, names: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the values of a module of ours that have one of the names, and of the modules in it."""
    waiting = [module]
    known = set()
    while waiting:
        current = waiting.pop()
        if current.__name__ in known or current.__name__.partition(".")[0] in _FOREIGN:
            continue
        known.add(current.__name__)
        for name in names:
            value = vars(current).get(name)
            if isinstance(value, types.ModuleType):
                waiting.append(value)
            elif name in vars(current):
                yield f"{current.__name__}.{name}", value


@cache
def _names(code: types.CodeType) -> tuple[str, ...]:
    """Return the names of globals and attributes in a function's code and in the functions inside it, sorted."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names.update(_names(constant))
    return tuple(sorted(names))


@cache
def _code_text(code: types.CodeType) -> str:
    """Return instructions, names and constants; not where they stand in which file."""
    parts = [code.co_code.hex(), repr((code.co_argcount, code.co_kwonlyargcount, code.co_flags))]
    parts += [repr(code.co_names), repr(code.co_varnames), repr(code.co_freevars)]
    for constant in code.co_consts:
        inside = isinstance(constant, types.CodeType)
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
    if isinstance(value, types.ModuleType):
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
