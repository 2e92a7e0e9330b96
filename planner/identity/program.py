"""The program: a digest of the code that decides about plans, and its version."""

from __future__ import annotations

_PACKAGES = ("aspectgraph", "errors", "ga", "planner")
# these show plans, and decide about none
_SHOW_ONLY = (
    "aspectgraph.plot",
    "planner.cli",
    "planner.optics",
    "planner.output",
    "planner.report",
)


def program_digest() -> str:
    """Return a digest of all source files that a plan depends on, 64 hexadecimal digits."""
    from aspectgraph.code_digest import code_digest

    return code_digest(_PACKAGES, _SHOW_ONLY)


def program_version() -> str:
    """Return the version of the installed program; ``"unknown"`` if it runs from its source."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("aspectgraph")
    except PackageNotFoundError:
        return "unknown"
