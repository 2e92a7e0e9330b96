r"""Text for a terminal: names of other people's files cannot move its cursor or forge a line.

Control characters (ISO 6429: C0, DEL and C1, ESC among them), signs that turn the direction of
writing, and halves of characters are shown as Python writes them: ``\x1b``, ``\u202e``.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

# C0, DEL, C1; direction marks, overrides and isolates; line and paragraph separators; half pairs,
# by which Python holds bytes of file names that are not UTF-8
_HIDDEN = "\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff"
_IN_LINES = re.compile(f"[{_HIDDEN}]")
_IN_TEXT = re.compile(f"(?![\n\t])[{_HIDDEN}]")
_SHORT = {"\n": r"\n", "\r": r"\r", "\t": r"\t"}


def visible(text: str, *, lines: bool = False) -> str:
    r"""Return text with what a terminal would obey shown instead.

    Parameters
    ----------
    text : str
        The text.
    lines : bool
        Keep line feeds and tabs: the text has several lines.

    Returns
    -------
    str
        For instance ``\x1b[2J`` in words of a terminal, and ``\n`` unless there may be `lines`.

    Examples
    --------
    >>> print(visible("bore\x1b[2J"))
    bore\x1b[2J
    """
    return (_IN_TEXT if lines else _IN_LINES).sub(_shown, text)


def _shown(character: re.Match[str]) -> str:
    code = ord(character[0])
    form = f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
    return _SHORT.get(character[0], form)


class VisibleStream:
    """A text stream that shows what a terminal would obey; all else is up to the stream beneath.

    Parameters
    ----------
    unescaped : text file
        The stream beneath, for who escapes names and writes colours.
    """

    def __init__(self, unescaped: TextIO) -> None:
        self.unescaped = unescaped

    def write(self, text: str) -> int:
        """Write a text; the number of its characters comes back."""
        self.unescaped.write(visible(text, lines=True))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write texts one after another."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unescaped, name)


def unescaped(stream: TextIO) -> TextIO:
    """Return the stream beneath a `VisibleStream`, for a console that escapes its text itself."""
    return getattr(stream, "unescaped", stream)


@contextmanager
def visible_output() -> Iterator[None]:
    """Escape all that is written to standard output and standard error, such as messages and notes.

    What replaces a stream meanwhile, or closes it, is left in place.
    """
    replaced: dict[str, VisibleStream] = {}
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and not isinstance(stream, VisibleStream):
            replaced[name] = VisibleStream(stream)
            setattr(sys, name, replaced[name])
    try:
        yield
    finally:
        for name, stream in replaced.items():
            if getattr(sys, name) is stream:
                setattr(sys, name, stream.unescaped)
