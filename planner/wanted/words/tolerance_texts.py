"""Tolerances as a drawing has them."""

from __future__ import annotations


def deviation_text(deviation: float) -> str:
    """Return a deviation that a tolerance allows, with its sign; 0 has none.

    Parameters
    ----------
    deviation : float
        mm (angles: degrees).
    """
    return f"{deviation:+.4g}" if deviation else "0"


def tolerance_text(tolerance: tuple[float, float]) -> str:
    """Return a tolerance as a drawing has it, such as "±0.05" or "0/-0.2".

    Parameters
    ----------
    tolerance : (float, float)
        Lower and upper deviation, mm (angles: degrees).
    """
    lower, upper = tolerance
    if lower == -upper:
        return f"±{upper:.4g}"
    return "/".join(deviation_text(limit) for limit in (upper, lower))
