"""Faces of packages: public names, imported from their modules when they are first used.

The stub beside a face (``__init__.pyi``) states each public name once, for type checkers and for
lazy_loader.
"""

from __future__ import annotations

import dataclasses
import inspect
import types
import typing
from collections.abc import Callable
from typing import Any

import lazy_loader

_OWN_NAMES = ("__all__", "__doc__", "__file__", "__name__", "__path__", "__version__")


def face(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package from its stub.

    Parameters
    ----------
    package : str
        The package's ``__name__``.
    file : str
        The package's ``__file__``.
    """
    attribute, _, names = lazy_loader.attach_stub(package, file)

    def look_up(name: str) -> Any:
        """Import a public name; look up the version, which stands in pyproject.toml only."""
        if name == "__version__":
            return project_version()
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = attribute(name)
        if isinstance(value, type) and (
            dataclasses.is_dataclass(value) or hasattr(value, "_fields")
        ):
            _show_plain_types(value)
        return value

    def public() -> list[str]:
        """List the public names only."""
        return sorted([*names, *_OWN_NAMES])

    return look_up, public, names


def program_name() -> str:
    """Return name and version of the program, as records state them: ``"aspectgraph 0.1.0"``."""
    return f"aspectgraph {project_version()}"


def project_version() -> str:
    """Return the version of the installed program; ``"unknown"`` if it runs from its source."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("aspectgraph")
    except PackageNotFoundError:
        return "unknown"


@dataclasses.dataclass(frozen=True)
class _Words:
    """A type as signatures show it."""

    words: str

    def __repr__(self) -> str:
        return self.words


def _show_plain_types(record: type) -> None:
    """Let ``help`` show the types of a record's fields without the rules of files, which only the reader needs."""
    if "__signature__" in vars(record):
        return
    try:
        hints = typing.get_type_hints(record)
    except NameError:
        # of what only type checkers import
        return
    maker: Any = record.__init__ if dataclasses.is_dataclass(record) else record.__new__
    signature = inspect.signature(maker)
    parameters = [
        parameter.replace(annotation=_Words(words_of(hints[name]))) if name in hints else parameter
        for name, parameter in signature.parameters.items()
    ]
    maker.__signature__ = signature.replace(parameters=parameters)
    record.__signature__ = inspect.Signature(parameters[1:])  # type: ignore[attr-defined]


def words_of(hint: Any) -> str:
    """Return a type in the words of a docstring: ``"tuple[float, float] | None"``, ``"ndarray"``.

    Parameters
    ----------
    hint : type or generic alias
        As `typing.get_type_hints` returns it.
    """
    from numpy.typing import ArrayLike

    kind = typing.get_origin(hint)
    if hint == ArrayLike:
        return "ArrayLike"
    if kind in (typing.Union, types.UnionType):
        return " | ".join(words_of(item) for item in typing.get_args(hint))
    if hint is type(None):
        return "None"
    if kind is typing.Literal:
        return f"Literal[{', '.join(map(repr, typing.get_args(hint)))}]"
    name = getattr(kind or hint, "__name__", str(hint))
    arguments = typing.get_args(hint)
    if not arguments or name == "ndarray":
        return str(name)
    return f"{name}[{', '.join(map(_argument, arguments))}]"


def _argument(hint: Any) -> str:
    if hint is ...:
        return "..."
    return f"[{', '.join(map(words_of, hint))}]" if isinstance(hint, list) else words_of(hint)
