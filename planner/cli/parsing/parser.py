"""The parser of the command line: errors in one line, with the name that was meant."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

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
        own = commands[words[place]] if place is not None and is_of_command else parser
        name = _option(own, word)
        if name is None:
            raise UsageError(_unknown_option(own, word.partition("=")[0], commands))
        typed |= name
    return typed


def _option(parser: argparse.ArgumentParser, word: str) -> set[str] | None:
    """Return the long names of the options in a word; None if one is unknown."""
    known = parser._option_string_actions
    if word.startswith("--"):
        action = known.get(word.partition("=")[0])
        return None if action is None else {_long_name(action)}
    names = set()
    for letter in word[1:]:
        action = known.get(f"-{letter}")
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
    owners = [key for key, one in commands.items() if name in one._option_string_actions]
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
