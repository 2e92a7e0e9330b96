"""Standard streams: closed ones harm nothing, and every text can be written to them."""

from __future__ import annotations

import errno
import io
import os
import re
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# Exit codes of the command line.


DONE = 0
INCOMPLETE = 1
BAD_INPUT = 2
# an image does not show the part as the plan has it
NOT_REGISTERED = 3

# a fault of the program: EX_SOFTWARE of sysexits.h, so that no script takes it for a result
INTERNAL = 70

# 128 + SIGPIPE, as a shell tells of any program that writes to a pipe whose reader has ended
NOBODY_READS = 141


# Memory, threads or processes that the system does not give: each is one line, whatever library
# says it.


_MEMORY = (
    "cannot allocate memory",
    "failed to map",
    "cannot map",
    "out of memory",
    "unable to allocate",
    "bad_alloc",
    "bad allocation",
    # what llvmlite says of a library that the loader could not map
    "could not find/load shared object file 'libllvmlite",
)
_THREADS = ("can't start new thread", "resource temporarily unavailable")
_WORKERS = ("process in the process pool was terminated abruptly", "process pool is not usable")


def shortage(error: BaseException) -> str | None:
    """Return the line for an error that a lack of memory, threads or processes causes.

    Parameters
    ----------
    error : exception
        Any; what it was raised from counts, too.

    Returns
    -------
    str or None
        None: it has another cause.
    """
    reasons: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and len(reasons) < _LONGEST_CHAIN:
        reasons.append(cause)
        cause = cause.__cause__ or cause.__context__
    # the first cause says most: what a library makes of it may be a page of advice
    for reason in reversed(reasons):
        text = " ".join(_COLOUR.sub("", str(reason)).split())
        lower = text.lower()
        number = getattr(reason, "errno", None)
        if isinstance(reason, MemoryError) or number == errno.ENOMEM or _says(lower, _MEMORY):
            return f"enough memory must be free. Got: {text[:_LONGEST_TEXT] or 'no more of it'}; see ulimit -v."
        if number == errno.EAGAIN or _says(lower, _THREADS):
            return f"the system must allow more threads or processes. Got: {text[:_LONGEST_TEXT]}; see ulimit -u, -v."
        if _says(lower, _WORKERS):
            return "a worker must stay alive. Got one that ended abruptly; most often memory is short: fewer --jobs."
    return None


# Open3D colours its errors
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LONGEST_CHAIN = 20
_LONGEST_TEXT = 200


def _says(text: str, signs: tuple[str, ...]) -> bool:
    return any(sign in text for sign in signs)


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
    from planner.progress import visible

    verbose = not _VERBOSE.isdisjoint(sys.argv[1:] if words is None else words)
    if verbose:
        write_error("".join(traceback.format_exception(error)).rstrip())
    text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(".")
    line = visible(text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}...")
    advice = "Please report it with the command and its files"
    ending = advice if verbose else f"{advice}; --verbose shows its origin"
    write_error(f"aspectgraph: the program has a fault. Got {line}. {ending}.")


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

    before_show = warnings.showwarning
    warnings.showwarning = show
    try:
        os.environ.setdefault("PYTHONWARNINGS", "ignore")
        yield
    finally:
        warnings.showwarning = before_show
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
