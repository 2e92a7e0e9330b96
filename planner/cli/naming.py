"""What somebody at a shell knows the parameters of a call as, and errors in these words."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

# options that are not named like the parameters they give
_OPTIONS = {
    "part": "the part",
    "plan": "the plan",
    "images": "the images",
    "folder": "the folder of parts",
    "covariance": "--sigma-mm or --sigma-rad",
    "pose_uncertainty": "--sigma-mm or --sigma-rad",
    "translation_mm": "--sigma-mm",
    "rotation_rad": "--sigma-rad",
    "stand_off_mm": "--stand-off",
    "lighting": "--light",
    "lamps": "--light",
    "ring": "--light",
    "step": "--grey-step",
    "registration": "--register",
    "focus_reserve": "--focus-margin-mm",
    "rng": "--seed",
    "time_limit_s": "--time-limit",
    "memory_limit_bytes": "--memory-limit",
    "bodies": "--body",
    "distances_mm": "--distances",
    "joints_rad": "--sigma-joints",
    "settle_s": "--settle",
    "cell.home": "home_deg of the cell file",
    "solid": "the part",
}

# fields that some commands have an option of another name for
_FIELDS = {"time_s": "read_time_limit"}
_LIMIT = re.compile(r"limits=ReadLimits\((\w+)=\.\.\.\)")

# what helps at a shell, where that is not what helps in a call, of the error with this name
_HINTS = {"MemoryLimitError": "Choose fewer entities: a plan needs no joint graph"}


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
    if _FIELDS.get(name) in options:
        return option(_FIELDS[name])
    same = f"--{name.replace('_', '-')}"
    if same in options.get("typed", ()):
        return same
    return option(name) if name in _OPTIONS or name in options else name


def in_words_of_shell(error: Exception, options: Mapping[str, Any]) -> str:
    """Return the text of an error of ours with its parameters named as options.

    Parameters
    ----------
    error : Exception
        Holds as data what it names.
    options : mapping of str to value
        The command's options, see `as_typed`.
    """
    # the exceptions of the packages have no base in common
    data: Any = error
    mentions = getattr(data, "mentions", ())
    if data.rule:
        parameter = data.parameter and as_typed(data.parameter, options)
        rule = _worded(data.rule, mentions, options)
        worded = type(data).of_rule(parameter, rule, data.got)
    else:
        worded = type(data)(*data.args)
    if hint := getattr(data, "hint", ""):
        hint = _worded(_HINTS.get(type(data).__name__, hint), mentions, options)
        # an argument that no option gives helps nobody at a shell
        worded.hint = "" if any(mention in hint for mention in mentions) else hint
    return str(worded)


@contextmanager
def named_by(name: str, options: Mapping[str, Any]) -> Iterator[None]:
    """Let an error in the block begin with the option whose value it is about, unless it does.

    Parameters
    ----------
    name : str
        The option's name in `options`. A value that is a file is named, too.
    options : mapping of str to value
        The command's options, see `as_typed`.
    """
    from aspectgraph.exceptions import AspectGraphError
    from planner.exceptions import PlannerError

    try:
        yield
    except (AspectGraphError, PlannerError) as error:
        text = in_words_of_shell(error, options)
        if text.startswith(("--", "the part")):
            raise
        typed = as_typed(name, options)
        value = str(options[name])
        named = f"{typed} {value}" if os.path.isfile(value) else typed
        # of a file with the place of the error in it
        if text.startswith(value):
            raise type(error)(f"{typed} {text}") from error
        raise type(error)(f"{named}: {text}") from error


def _worded(text: str, mentions: Sequence[str], options: Mapping[str, Any]) -> str:
    """Return a text with the arguments that it mentions as options, where the command has them."""
    for mention in mentions:
        limit = _LIMIT.fullmatch(mention)
        name, _, value = (f"{limit[1]}=..." if limit else mention).partition("=")
        known = as_typed(name, options)
        if known != name:
            value = "" if value == "..." else value.strip("[]").replace(", ", ",")
            text = text.replace(mention, f"{known} {value}".rstrip())
    return text
