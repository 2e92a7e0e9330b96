"""Memory, threads or processes that the system does not give: each is one line, whatever library says it."""

from __future__ import annotations

import errno
import re

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
