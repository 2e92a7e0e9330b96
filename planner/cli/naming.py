"""What somebody at a shell knows the parameters of a call as, and errors in these words."""

from __future__ import annotations

from collections.abc import Container
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


def in_words_of_shell(error: BaseException, options: Container[str]) -> str:
    """Return the message of an error with its parameters named as options.

    Parameters
    ----------
    error : Exception
        One of ours holds its parameters as data.
    options : container of str
        Names of the options of the command; other parameters keep theirs.
    """

    def name_of(parameter: str) -> str:
        known = parameter in _OPTIONS or parameter in options
        return option(parameter) if known else parameter

    worded: Any = getattr(error, "for_shell", None)
    return str(error) if worded is None else str(worded(name_of))
