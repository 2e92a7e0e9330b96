"""Numbers in text files, read strictly.

Python's own ``float`` and ``int`` take more than any mesh format allows: ``1_0`` for 10, digits of other scripts. What
is no number in the format is a damaged number, and must not become another one.
"""

from __future__ import annotations

import re

_REAL = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|nan|inf(?:inity)?)")
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


def parse_real(word: str) -> float:
    """Return a decimal number; ``nan`` and ``inf`` are numbers too, for the reader to refuse where they matter.

    Raises
    ------
    ValueError
        The word is not a number.
    """
    if not _REAL.fullmatch(word.lower()):
        raise ValueError(f"{word[:40]!r}")
    return float(word)


def parse_integer(word: str) -> int:
    """Return an integer of at most 18 digits.

    Raises
    ------
    ValueError
        The word is not one.
    """
    if not _INTEGER.fullmatch(word):
        raise ValueError(f"{word[:40]!r}")
    return int(word)


def decode_text(data: bytes) -> str:
    """Return a file as text, without the byte order mark some editors put in front.

    Keywords and numbers are ASCII in every format; names may be in any encoding, so each byte becomes one character.
    """
    return data.removeprefix(_BYTE_ORDER_MARK).decode("latin-1")
