"""Numbers as text: percents, and probabilities, which are rounded to the safe side and never 1."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

# four decimals tell what 10,000 simulated poses can
_DIGITS = 4
_LARGEST = math.nextafter(1.0, 0.0)


def below_one(value: float) -> float:
    """Return a probability for a file: the largest number below 1 where rounding gave 1.

    No model proves certainty, so 1 is an effect of rounding.

    Parameters
    ----------
    value : float
        In [0, 1]; nan is kept.

    Returns
    -------
    float
        In [0, 1).
    """
    return _LARGEST if value >= 1.0 else value


def percent_text(share: float, digits: int = 3) -> str:
    """Return a share in percent with so many digits, and never with an exponent.

    Parameters
    ----------
    share : float
        1 is 100 %.
    digits : int
        Significant digits; a whole number of percents keeps all of its own.

    Returns
    -------
    str
        Such as ``"2.5 %"``, or ``"1000 %"``.
    """
    percents = 100.0 * share
    if abs(percents) >= 10.0 ** (digits - 1) or not math.isfinite(percents):
        return f"{percents:.0f} %"
    text = f"{Decimal(f'{percents:.{digits - 1}e}'):f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def is_nearly_one(value: float, required: float = 0.0) -> bool:
    """Say whether `probability_text` gives no more than a bound such as ``"> 0.9999"``.

    Parameters
    ----------
    value, required : float
        As for `probability_text`.
    """
    return probability_text(value, required).startswith(">")


def probability_text(value: float, required: float = 0.0) -> str:
    """Return a probability rounded down; near 1 only a bound, because no model proves certainty.

    Parameters
    ----------
    value : float
        In [0, 1], or nan.
    required : float
        The text keeps enough decimals to show on which side of this the value is.

    Returns
    -------
    str
        Such as ``"0.9512"`` or ``"> 0.9999"``.
    """
    if math.isnan(value):
        return "nan"
    digits = _DIGITS
    if 0.0 < 1.0 - required < 1e-3:
        digits = 1 - math.floor(math.log10(1.0 - required) + 1e-9)
    unit = Decimal(1).scaleb(-digits)
    ceiling = 1 - unit
    if Decimal(repr(float(value))) > ceiling:
        return f"> {ceiling}"
    return str(_rounded(value, digits, ROUND_FLOOR))


def frequency_text(successes: int, n: int) -> str:
    """Return how often a trial succeeded: a share rounded down, and the counts where the share would seem to be 1.

    Parameters
    ----------
    successes, n : int
        Successes among n trials.

    Returns
    -------
    str
        Such as ``"0.9512"`` or ``"10000 of 10000"``.
    """
    share = _rounded(successes / n, _DIGITS, ROUND_FLOOR)
    return str(share) if share < 1 - Decimal(1).scaleb(-_DIGITS) else f"{successes} of {n}"


def interval_text(low: float, high: float, between: str = " to ") -> str:
    """Return an interval of probabilities, rounded outwards; without an upper limit where that rounds to 1.

    Parameters
    ----------
    low, high : float
        Its limits, in [0, 1].
    between : str
        What stands between them.

    Returns
    -------
    str
        Such as ``"0.9471 to 0.9551"`` or ``"0.9994 or more"``.
    """
    lower = _rounded(low, _DIGITS, ROUND_FLOOR)
    upper = _rounded(high, _DIGITS, ROUND_CEILING)
    if upper >= 1:
        return f"{min(lower, 1 - Decimal(1).scaleb(-_DIGITS))} or more"
    return f"{lower}{between}{upper}"


def _rounded(value: float, digits: int, rounding: str) -> Decimal:
    """Return a number with so many decimals; as it is written, so that 0.29 is not rounded down to 0.28."""
    return Decimal(repr(float(value))).quantize(Decimal(1).scaleb(-digits), rounding=rounding)
