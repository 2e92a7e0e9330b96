"""Standard streams: closed ones harm nothing, and every text can be written to them."""

from __future__ import annotations

import io
import os
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_LONGEST = 200
_VERBOSE = {"-v", "--verbose"}


def prepare_streams() -> None:
    """Make the standard streams safe to write to.

    A stream that the caller closed leads nowhere: the next file that is opened would take its number, and be
    written to by libraries. Errors never go to standard output instead. A character that an encoding lacks is
    written as an escape sequence, so ``PYTHONIOENCODING=ascii`` and ``LC_ALL=C`` end no command.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # takes the lowest number that is free, which is this one
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        forget_errors()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors != "backslashreplace":
            stream.reconfigure(errors="backslashreplace")


def forget_errors() -> None:
    """From now on, write errors nowhere; without a stream, they would go to standard output."""
    sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def write_error(line: str) -> None:
    """Write a line to standard error; where that takes no more, the exit code says all."""
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        forget_errors()


def write_fault(error: BaseException, words: list[str] | None = None) -> None:
    """Write of an error that nobody foresaw: one line, and with ``--verbose`` where it comes from.

    Parameters
    ----------
    error : BaseException
        The error.
    words : list of str, optional
        The arguments of the command line. Default: those the program was started with.
    """
    from planner.progress.terminal_text import visible

    verbose = not _VERBOSE.isdisjoint(sys.argv[1:] if words is None else words)
    if verbose:
        write_error("".join(traceback.format_exception(error)).rstrip())
    text = " ".join(f"{type(error).__name__}: {error}".split())
    shown = visible(text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}...")
    advice = "Please report it with the command and its files"
    how = advice if verbose else f"{advice}; --verbose shows its origin"
    write_error(f"aspectgraph: the program has a fault. Got {shown}. {how}.")


@contextmanager
def quiet_libraries(words: list[str] | None = None) -> Iterator[None]:
    """Keep warnings of libraries, which are for programmers, from standard error; ``--verbose`` shows them in lines.

    Processes that the block starts keep to it, too.

    Parameters
    ----------
    words : list of str, optional
        As for `write_fault`.
    """
    verbose = not _VERBOSE.isdisjoint(sys.argv[1:] if words is None else words)
    before = os.environ.get("PYTHONWARNINGS")

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        if verbose:
            write_error(f"aspectgraph: {category.__name__}: {' '.join(str(message).split())}")

    shown = warnings.showwarning
    warnings.showwarning = show
    try:
        os.environ.setdefault("PYTHONWARNINGS", "ignore")
        yield
    finally:
        warnings.showwarning = shown
        if before is None:
            os.environ.pop("PYTHONWARNINGS", None)


def settle() -> None:
    """Forget standard error if it takes no more: the interpreter would write to it again, and change the exit code."""
    try:
        print(end="", file=sys.stderr, flush=True)
    except OSError:
        forget_errors()


def stop_writing() -> None:
    """Forget standard output: the interpreter would write to it again while it shuts down, and complain."""
    sys.stdout = None
    settle()


def output_fails(error: OSError) -> bool:
    """Tell whether an error comes from standard output; if so, forget that.

    Parameters
    ----------
    error : OSError
        One that names a file comes from there.
    """
    if error.filename is not None:
        return False
    try:
        # nothing need be left of what failed, so an empty line finds out
        print(flush=True)
    except OSError:
        stop_writing()
        return True
    return False
