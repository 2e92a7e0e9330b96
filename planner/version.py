"""The program: a digest of the code that decides about plans, and its version."""

from __future__ import annotations

_PACKAGES = ("aspectgraph", "errors", "ga", "planner")
# these show plans, and decide about none
_SHOW_ONLY = (
    "aspectgraph.plot",
    "planner.app",
    "planner.optics",
    "planner.report",
)


def program_digest() -> str:
    """Return a digest of all source files that a plan depends on, 64 hexadecimal digits."""
    from aspectgraph.files import code_digest

    return code_digest(_PACKAGES, _SHOW_ONLY)
