"""Rules of the command line that are checked before anything is loaded that takes long.

An error names the option as it was typed.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from planner.app.quantities import localisation_words
from planner.argument_kinds import (
    ABOVE_0_TO_1,
    BETWEEN_0_AND_1,
    FROM_0_BELOW_1,
    NOT_NEGATIVE,
    POSITIVE_SECONDS,
    NumberRule,
)
from planner.camera.camera import Camera
from planner.exceptions import CameraError, OutputError, RequestError
from planner.files import GRAPHML, PICKER, PICTURE, Kind, check_file_place

# The camera that ``--camera`` names; it loads nothing that takes long.


def read_camera(text: str) -> Camera:
    """Return the camera of a TOML file, or the one with that name in the catalogue."""
    path = Path(text)
    if path.suffix.lower() == ".toml" or path.is_file():
        try:
            return Camera.from_toml(path)
        except CameraError as error:
            # begins with the file, and the line that breaks a rule
            raise CameraError(f"--camera {error}") from None
    try:
        return Camera.named(text)
    except CameraError as error:
        if error.parameter != "camera":
            raise
        rule = "must be a TOML file, or a name that 'aspectgraph cameras' lists"
        raise CameraError.of_rule("camera", rule, error.got, hint=error.hint) from None


# What somebody at a shell knows the parameters of a call as, and errors in these words.


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
        option = as_typed(name, options)
        if option != name:
            value = "" if value == "..." else value.strip("[]").replace(", ", ",")
            text = text.replace(mention, f"{option} {value}".rstrip())
    return text


# The parser of the command line: errors in one line, with the name that was meant.


# a number with its unit, too, where argparse takes "-5mm" for an option
_NEGATIVE = re.compile(r"-\.?\d")
_ARGUMENT = re.compile(r"argument (?P<name>(?:--)?[\w-]+)(?:/-\w)?: (?P<text>.*)", re.DOTALL)
_CHOICE = re.compile(r"invalid choice: (.*) \(choose from (.*)\)", re.DOTALL)
# what argparse says of an argument, as a rule
_TEXTS = {
    "expected one argument": "must have a value. Got none",
    "not allowed with argument ": "must not be given with ",
}
_REQUIRED = "the following arguments are required: "
_ONE_OF = re.compile(r"one of the arguments (.*) is required")


class UsageError(Exception):
    """A command line that does not parse."""


class Help(argparse.RawDescriptionHelpFormatter):
    """Ends the help of an option with its default, unless the help states it."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text = action.help or ""
        is_plain = isinstance(action.default, int | float | str)
        if not is_plain or isinstance(action.default, bool):
            return text
        if action.default == argparse.SUPPRESS or "default" in text:
            return text
        return f"{text} (default: {_shown(action)})"


def _shown(action: argparse.Action) -> str:
    """Return the default of an option with the unit in its name."""
    value = action.default
    text = f"{value:g}" if isinstance(value, float) else str(value)
    unit = str(action.metavar).lower()
    return f"{text} {unit}" if unit in ("mm", "px", "rad", "deg") else text


class Parser(argparse.ArgumentParser):
    """A parser of one command, or of the whole command line."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = _NEGATIVE

    def print_help(self, file: Any = None) -> None:
        """Print all of it, or raise: argparse itself passes over a full disk."""
        print(self.format_help(), end="", file=file)

    def error(self, message: str) -> NoReturn:
        """Raise the error of a command line that does not parse, in one line."""
        match = _ARGUMENT.fullmatch(message)
        if match is not None:
            message = f"{match['name']} {_rule(match['text'])}"
        if message.startswith(_REQUIRED):
            message = f"{message.removeprefix(_REQUIRED)} must be given"
        if match := _ONE_OF.fullmatch(message):
            message = f"one of {', '.join(match[1].split())} must be given"
        raise UsageError(f"{self.prog}: {message.rstrip('.')}; see {self.prog} --help")


def _rule(text: str) -> str:
    """Return what argparse says of an argument as a rule."""
    if match := _CHOICE.fullmatch(text):
        return f"must be one of {match[2].replace(chr(39), '')}. Got {match[1]}"
    if match := re.fullmatch(r"expected (\d+) arguments", text):
        return f"must have {match[1]} values"
    for start, words in _TEXTS.items():
        if text.startswith(start):
            return (words + text.removeprefix(start)).split("/")[0]
    return text


def command_parsers(parser: argparse.ArgumentParser) -> Mapping[str, argparse.ArgumentParser]:
    """Return the parser of each command.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Of the whole command line.
    """
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return action.choices
    return {}


def check_names(parser: argparse.ArgumentParser, words: Sequence[str]) -> set[str]:
    """Refuse a command or an option that does not exist, and say which one may be meant.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Of the whole command line.
    words : sequence of str
        The command line, without the program.

    Returns
    -------
    set of str
        The options that were typed, each by its long name.

    Raises
    ------
    UsageError
        Names the command or option.
    """
    commands = command_parsers(parser)
    place = next((k for k, word in enumerate(words) if not word.startswith("-")), None)
    if place is not None and words[place] not in commands:
        text = f"aspectgraph: unknown command {words[place]!r}"
        raise UsageError(_with_guess(text, nearest(words[place], commands), "aspectgraph --help"))
    typed = set()
    for k, word in enumerate(words):
        if word == "--":
            break
        if len(word) < 2 or not word.startswith("-") or _NEGATIVE.match(word) or " " in word:
            continue
        is_of_command = place is not None and k > place
        owner = commands[words[place]] if place is not None and is_of_command else parser
        name = _option(owner, word)
        if name is None:
            raise UsageError(_unknown_option(owner, word.partition("=")[0], commands))
        typed |= name
    return typed


def _option(parser: argparse.ArgumentParser, word: str) -> set[str] | None:
    """Return the long names of the options in a word; None if one is unknown."""
    actions = parser._option_string_actions
    if word.startswith("--"):
        action = actions.get(word.partition("=")[0])
        return None if action is None else {_long_name(action)}
    names = set()
    for letter in word[1:]:
        action = actions.get(f"-{letter}")
        if action is None:
            return None
        names.add(_long_name(action))
        if action.nargs != 0:
            # the rest is its value
            break
    return names


def _long_name(action: argparse.Action) -> str:
    return next(text for text in action.option_strings if text.startswith("--"))


def _unknown_option(
    parser: argparse.ArgumentParser, name: str, commands: Mapping[str, argparse.ArgumentParser]
) -> str:
    text = f"{parser.prog}: unknown option {name}"
    owners = [key for key, command in commands.items() if name in command._option_string_actions]
    guess = nearest(name, parser._option_string_actions)
    if owners and not guess:
        text += f"; it is an option of {', '.join(owners)}"
    return _with_guess(text, guess, f"{parser.prog} --help")


def _with_guess(text: str, guess: str, help_command: str) -> str:
    if guess:
        return f"{text}; did you mean {guess}? See {help_command}"
    return f"{text}; see {help_command}"


def nearest(word: str, names: Iterable[str]) -> str:
    """Return the name that is spelled most like a word; empty if none is.

    Parameters
    ----------
    word : str
        What was typed.
    names : iterable of str
        What there is.
    """
    import difflib

    lower = {name.lower(): name for name in names}
    word = word.lower()
    # the beginning of one name only, as a shell would complete it
    begun = [name for name in lower if len(word) > 3 and name.startswith(word)]
    if len(begun) == 1:
        return lower[begun[0]]
    close = difflib.get_close_matches(word, lower, n=1, cutoff=0.7)
    return lower[close[0]] if close else ""


_COUNTS = {"seed": 0, "simulate": 1, "jobs": 1, "poses": 1, "draws": 1, "graph_limit": 0, "rows": 1}
# of what is counted
_MOST = 10**9
# as `planner.request.defaults.MOST_SEED`, which takes a second to load
_MOST_SEED = 10**300
_PROMISES = ("accuracy", "probability")
# a share close to 1 needs all its digits
_IN_FULL = (*_PROMISES, "contrast", "share")
_RULES = {
    **dict.fromkeys(
        (
            "sigma_mm",
            "sigma_rad",
            "stand_off",
            "min_length",
            "min_length_px",
            "field_margin_px",
            "focus_margin_mm",
            "visibility_radius_mm",
            "separation_px",
            "surround_px",
            "min_corner_deg",
            "surfaces_mm",
        ),
        NOT_NEGATIVE,
    ),
    **dict.fromkeys(_PROMISES, BETWEEN_0_AND_1),
    "contrast": NumberRule("must lie strictly between 0 and 1", BETWEEN_0_AND_1.holds),
    "share": ABOVE_0_TO_1,
    "speed": ABOVE_0_TO_1,
    "settle": NOT_NEGATIVE,
    "sigma_joints": NOT_NEGATIVE,
    "coverage": ABOVE_0_TO_1,
    "time_limit": POSITIVE_SECONDS,
    "read_time_limit": POSITIVE_SECONDS,
    "gap": FROM_0_BELOW_1,
    "give_up": FROM_0_BELOW_1,
}
# options that say nothing without --light
_OF_LIGHT = ("contrast", "grey-step", "ground")


def check_numbers(options: Any) -> None:
    """Refuse numbers that break the rule of their option, before any work.

    Parameters
    ----------
    options : argparse.Namespace
        Those of one command; options it does not have are passed over.

    Raises
    ------
    RequestError
        If a number breaks its rule; names the option.
    """
    values = vars(options)
    for name, minimum in _COUNTS.items():
        value = values.get(name)
        if value is None:
            continue
        if value < minimum:
            raise RequestError.of_rule(name, f"must be at least {minimum}", str(value))
        maximum = _MOST_SEED if name == "seed" else _MOST
        if value > maximum:
            got = f"a number of {len(str(value))} digits"
            raise RequestError.of_rule(name, f"must be at most {maximum:g}", got)
    for name, rule in _RULES.items():
        value = values.get(name)
        if value is None or rule.accepts(value):
            continue
        hint = f"write {value:g}%" if name in _PROMISES and 2 <= value < 100 else ""
        got = repr(value) if name in _IN_FULL else f"{value:g}"
        raise RequestError.of_rule(name, rule.text, got, hint=hint)


def check_inputs(options: Any) -> None:
    """Refuse empty texts, files and names that are not there, and values that break a rule, before the part is read.

    Parameters
    ----------
    options : argparse.Namespace
        Those of one command; options it does not have are passed over.

    Raises
    ------
    CameraError, OutputError, RequestError
        Names the option.
    """
    values = vars(options)
    for name, value in values.items():
        if isinstance(value, str) and not value.strip():
            raise RequestError.of_rule(name, "must not be empty", repr(value))
    _check_files(values)
    if values.get("write") is not None:
        _check_new_camera(values["write"])
    if values.get("localisation") is not None:
        localisation_words(values["localisation"])
    _check_box("workspace", values.get("workspace"))
    _check_box("within", values.get("within"), flat=True)
    _check_optics(values)
    _check_image(values)
    for name, other in (("contrast", "lamps"), *((option, "light") for option in _OF_LIGHT)):
        if f"--{name}" in values["typed"] and other in values and not values[other]:
            raise RequestError.of_rule(name, f"must be given with --{other}", "none")
    camera = values.get("camera")
    if camera is not None:
        # here, because it loads numpy
        ...  # joined

        read_camera(camera)
    # last, because a file that can be written takes a second to check
    for name in ("picture", "graphml", "write"):
        if values.get(name):
            check_file_place(values[name], f"--{name}", _kind(name, values[name]))


def _kind(name: str, path: str) -> Kind | None:
    """Return what kind of file an option writes; None of a camera, which replaces nothing."""
    if name == "picture":
        return PICKER if Path(path).suffix.lower() == ".html" else PICTURE
    return GRAPHML if name == "graphml" else None


def _check_files(values: Mapping[str, Any]) -> None:
    """Refuse a part, a plan, a folder, and a file of what is measured, that is not there."""
    part = values.get("part")
    if part is not None and (Path(part).is_dir() or not Path(part).exists()):
        rule = "must be an existing file"
        raise RequestError.of_rule("part", rule, _place(part))
    for name in ("plan", "again"):
        if values.get(name) is not None:
            _check_plan(name, values[name])
    cell = values.get("cell")
    if cell is not None and not Path(cell).is_file():
        raise RequestError.of_rule("cell", "must be an existing file", _place(cell))
    images = values.get("images")
    if images is not None and not Path(images).is_dir():
        raise RequestError.of_rule("images", "must be an existing folder", _place(images))
    register = values.get("register")
    if (
        register not in (None, "none", "edges")
        and not Path(register.removeprefix("edges+")).is_file()
    ):
        rule = "must be edges, none or name an existing file"
        raise RequestError.of_rule("register", rule, repr(register))
    folder = values.get("folder")
    if folder is not None and not Path(folder).is_dir():
        raise RequestError.of_rule("folder", "must be an existing folder", _place(folder))
    entities = (values.get("entities") or "").strip()
    is_file = Path(entities).suffix.lower() in (".toml", ".json", ".csv")
    if is_file and not Path(entities).exists():
        raise RequestError.of_rule("entities", "must name an existing file", repr(entities))
    dimensions = values.get("dimensions") or "all"
    if dimensions.strip().lower() != "all" and not Path(dimensions).exists():
        rule = "must be 'all' or name an existing file"
        raise RequestError.of_rule("dimensions", rule, repr(dimensions))


def _check_plan(name: str, path: str) -> None:
    """Refuse a plan that is not there."""
    place = Path(path)
    if place.is_dir() and not (place / "plan.json").exists():
        rule = "must be a plan file, or the folder it is in"
        raise RequestError.of_rule(name, rule, f"{path!r}, a folder without plan.json")
    if not place.exists():
        rule = "must be an existing plan file, or its folder"
        raise RequestError.of_rule(name, rule, repr(path))


def _place(path: str) -> str:
    """Return a path, and say if it is a file or a folder."""
    if Path(path).is_dir():
        return f"{path!r}, a folder"
    return f"{path!r}, a file" if Path(path).is_file() else repr(path)


def _check_new_camera(path: str) -> None:
    """Refuse the place of a camera's file; a file that is there is kept."""
    if Path(path).suffix.lower() != ".toml":
        raise RequestError.of_rule("write", "must end in .toml", repr(path))
    if Path(path).exists():
        raise OutputError(f"--write must be a new file. Got {path!r}, which exists.")


def _check_box(name: str, numbers: Sequence[float] | None, *, flat: bool = False) -> None:
    """Refuse what is no box, which may be flat or not; whether it is around the part is known later."""
    if numbers is None:
        return
    corners = [list(numbers[:3]), list(numbers[3:])]
    ordered = all(low < high or (flat and low == high) for low, high in zip(*corners, strict=True))
    if not (ordered and all(map(math.isfinite, numbers))):
        rule = "must be finite, lower corner first"
        raise RequestError.of_rule(name, rule, str(corners))


def _check_optics(values: Mapping[str, Any]) -> None:
    """Refuse bodies and working distances that `optics` cannot try."""
    distances = values.get("distances")
    if distances is not None and not all(0 < distance < math.inf for distance in distances):
        rule = "must be finite and positive, at least one"
        raise RequestError.of_rule("distances", rule, repr(distances))
    if values.get("body"):
        # here, because it loads the catalogue
        from planner.camera.catalogue import check_bodies

        check_bodies(values["body"])


def _check_image(values: Mapping[str, Any]) -> None:
    """Refuse an angle that no corner has."""
    corner = values.get("min_corner_deg")
    if corner is not None and corner >= 90:
        raise RequestError.of_rule("min_corner_deg", "must be below 90", repr(corner))
