"""Places in words, for messages."""

from __future__ import annotations

from collections.abc import Iterable


def describe_point(point: Iterable[float]) -> str:
    """Return a point as text for a message, in millimetres."""
    return "(" + ", ".join(f"{float(c):.6g}" for c in point) + ")"
