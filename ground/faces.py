"""Faces of packages: public names, imported from their modules when they are first used.

The stub beside a face (``__init__.pyi``) states each public name once, for type checkers and for
lazy_loader.
"""

from __future__ import annotations

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
        return attribute(name)

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
