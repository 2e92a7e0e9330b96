"""Standard streams: closed ones harm nothing, and every text can be written to them."""

from __future__ import annotations

import io
import os
import sys


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
