"""What somebody at a shell knows the parameters of a call as, and errors in these words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# options that are not named like the parameters they give
_OPTIONS = {
    "part": "the part",
    "covariance": "--sigma-mm or --sigma-rad",
    "pose_uncertainty": "--sigma-mm or --sigma-rad",
    "translation_mm": "--sigma-mm",
    "rotation_rad": "--sigma-rad",
    "stand_off_mm": "--stand-off",
    "lighting": "--light",
    "lamps": "--light",
    "ring": "--light",
    "step": "--grey-step",
    "focus_reserve": "--focus-margin-mm",
    "rng": "--seed",
    "time_limit_s": "--time-limit",
    "memory_limit_bytes": "--memory-limit",
    "bodies": "--body",
    "distances_mm": "--distances",
}


def option(name: str) -> str:
    """Return the option that a user of the command line knows a parameter, or a field of a request, as.

    Parameters
    ----------
    name : str
        The parameter's name.
    """
    return _OPTIONS.get(name, f"--{name.replace('_', '-')}")


def as_typed(name: str, options: Mapping[str, Any]) -> str:
    """Return what the user of a command knows a parameter as.

    Parameters
    ----------
    name : str
        The parameter's name.
    options : mapping of str to value
        The command's options; ``typed`` holds those that were typed. Other parameters keep their
        names.
    """
    same = f"--{name.replace('_', '-')}"
    if same in options.get("typed", ()):
        return same
    return option(name) if name in _OPTIONS or name in options else name


def in_words_of_shell(error: BaseException, options: Mapping[str, Any]) -> str:
    """Return the message of an error with its parameters named as options.

    Parameters
    ----------
    error : Exception
        One of ours holds its parameters as data.
    options : mapping of str to value
        The command's options, see `as_typed`.
    """
    worded: Any = getattr(error, "for_shell", None)
    return str(error) if worded is None else str(worded(lambda name: as_typed(name, options)))
