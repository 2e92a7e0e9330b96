"""The command line read into the record of a command, errors of it in one line, and the help.

cyclopts reads the words. Its errors hold as data what they are about, and are worded here: with the option as it was
typed, the rule and the value, and the name that was meant.
"""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, get_args, get_origin

from cyclopts import App, Argument, Parameter
from cyclopts.exceptions import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
)

from planner.app.options import COMMANDS, Command, Help, signature_of, texts_of

PROGRAM = "aspectgraph"
_DESCRIPTION = """\
Plan camera poses that measure edges and holes of a part: from where each can be
measured with the required accuracy, how probable that is, and how few poses
suffice."""
_EXAMPLES = """\
examples:
  aspectgraph info part.step --picture edges.html
  aspectgraph plan part.step --entities edges.toml --camera camera.toml
  aspectgraph plan part.step --select "length > 20" --camera camera.toml
  aspectgraph plan part.stp --dimensions all --camera camera.toml -o plan
  aspectgraph simulate plan
  aspectgraph reach plan part.step --cell cell.toml
  aspectgraph program plan part.step --cell cell.toml --format rapid
  aspectgraph measure plan images --part part.stp --out results
  aspectgraph optics part.step --select "length > 20" --write camera.toml
  aspectgraph batch parts --camera camera.toml --out plans
  aspectgraph graph part.step --entities 12,15,31 --graphml graph.graphml

An entities file (TOML or JSON) maps names to edge ids, to ids of rims and arcs,
or to two end points:
  top = 17
  bore = "r3"
  slot = [[0, 0, 10], [25, 0, 10]]

A dimensions file adds what is measured, and its tolerance:
  bore = { diameter = "r3", tolerance = [-0.05, 0.05] }

exit codes: 0 done, 1 plan incomplete, 2 bad input
(1 also if the simulation contradicts the plan, a measured part does not
conform, or the work was interrupted; 3 if an image cannot be registered;
70 if the program has a fault: please report it;
141 if a reader such as head closes the pipe early)"""
# of the program itself, beside its commands
_ROOT = {"--help": "show this help and exit", "--version": "show the version and exit"}
_ROOT_SHORT = {"-h": "--help", "-V": "--version"}
# words that begin with a minus and are values
_NEGATIVE = re.compile(r"-(\.?\d|inf|nan)")


class UsageError(Exception):
    """A command line that does not parse."""


def parse(words: Sequence[str]) -> Command | str:
    """Return the record of the command that was typed, or the help or version that was asked for.

    Parameters
    ----------
    words : sequence of str
        The command line, without the program.

    Raises
    ------
    UsageError
        If it does not parse.
    """
    place = next((k for k, word in enumerate(words) if not word.startswith("-")), len(words))
    for word in words[:place]:
        name = _ROOT_SHORT.get(word, word)
        if name == "--help":
            return program_help()
        if name == "--version":
            import planner

            return f"{PROGRAM} {planner.__version__}"
        raise UsageError(_unknown_option(PROGRAM, word, _ROOT))
    if place == len(words):
        raise _usage_error(PROGRAM, "COMMAND must be given")
    record = _record(_known_command(words[place]), words[place + 1 :])
    if not isinstance(record, Help):
        return record
    return program_help() if record.topic is None else command_help(_known_command(record.topic))


def _known_command(name: str) -> type[Command]:
    """Return the record of a command by its name, or say which one may be meant."""
    if name not in COMMANDS:
        text = f"{PROGRAM}: unknown command {name!r}"
        raise UsageError(_with_guess(text, nearest(name, COMMANDS), PROGRAM))
    return COMMANDS[name]


def _record(kind: type[Command], words: Sequence[str]) -> Command | str:
    """Return the record of a command and the words behind it, or its help."""
    program = _program(kind)
    # what cyclopts has read once it has looked at all options, also where it refuses a value then
    arguments: list[Argument] = []
    app = _app(kind)
    app.config = (lambda _, __, collection: arguments.extend(collection),)
    failure = None
    bound = None
    unused: Sequence[str] = ()
    try:
        _, bound, unused, _ = app.parse_known_args(list(words))
    except CycloptsError as error:
        failure = error
        unused = error.unused_tokens or () if arguments else ()
    end = words.index("--") if "--" in words else len(words)
    options = {word for word in words[:end] if _is_option_word(word)}
    places = [argument for argument in arguments if not is_option(argument)]
    taken = [token.value for argument in places for token in argument.tokens]
    for word in (*taken, *unused):
        # what is left of several letters behind a minus is no word
        if word in options or word not in words:
            raise UsageError(_unknown_option(program, word, _names(kind)))
    typed = _typed(arguments, words)
    if "--help" in typed:
        return command_help(kind)
    for argument in arguments:
        if any(token.value in options for token in argument.tokens):
            raise _usage_error(program, _without_value(argument))
    if unused:
        hint = ""
        if "--part" in _names(kind) and "--part" not in typed:
            hint = f". Name the part by --part {unused[0]}"
        raise _usage_error(program, f"unknown argument {unused[0]!r}{hint}")
    if arguments:
        _check_together(kind, arguments, typed)
    if failure is not None or bound is None:
        raise _usage_error(program, _worded(failure))
    record = kind(*bound.args, **bound.kwargs)
    record.typed = frozenset(typed)
    return record


def _program(kind: type[Command]) -> str:
    return f"{PROGRAM} {kind.name()}"


def _names(kind: type[Command]) -> list[str]:
    return [name for argument in arguments_of(kind) for name in argument.names]


def _is_option_word(word: str) -> bool:
    """Return whether a word is an option, unless it is behind an equals sign."""
    is_value = len(word) == 1 or " " in word or _NEGATIVE.match(word)
    return word.startswith("-") and not is_value


def _without_value(argument: Argument) -> str:
    count, _ = argument.token_count()
    rule = "must have a value. Got none" if count == 1 else f"must have {count} values"
    return f"{argument.name} {rule}"


def _typed(arguments: Sequence[Argument], words: Sequence[str]) -> list[str]:
    """Return the options that were typed, by their long names, in their order."""
    heads = [word.partition("=")[0] for word in words]

    def place(argument: Argument) -> int:
        return min((heads.index(name) for name in argument.names if name in heads), default=0)

    typed = [argument for argument in arguments if argument.tokens and is_option(argument)]
    return [argument.name for argument in sorted(typed, key=place)]


def _check_together(
    kind: type[Command], arguments: Sequence[Argument], typed: Sequence[str]
) -> None:
    """Refuse options that exclude each other, and the lack of those that are needed."""
    program = _program(kind)
    alternatives = [vars(base).get("at_most_one", ()) for base in kind.__mro__]
    for names in (kind.exactly_one, *alternatives):
        together = [name for name in typed if name in names]
        if len(together) > 1:
            raise _usage_error(program, f"{together[1]} must not be given with {together[0]}")
    if kind.instead in typed:
        return
    missing = [
        argument.name
        for argument in arguments
        if (argument.required or argument.name in kind.needed) and not argument.tokens
    ]
    if missing:
        raise _usage_error(program, f"{', '.join(missing)} must be given")
    if kind.exactly_one and not set(kind.exactly_one) & set(typed):
        raise _usage_error(program, f"one of {', '.join(kind.exactly_one)} must be given")


def _worded(error: CycloptsError | None) -> str:
    """Return an error of cyclopts as the rule of an option."""
    argument = None if error is None else error.argument
    if argument is None:
        return " ".join(str(error).split())
    if isinstance(error, MissingArgumentError):
        return _without_value(argument)
    token = getattr(error, "token", None)
    value = "none" if token is None else repr(token.value)
    if choices := choices_of(argument):
        return f"{argument.name} must be one of {', '.join(choices)}. Got {value}"
    if isinstance(error, CoercionError) and error.msg is not None:
        return f"{argument.name} {error.msg}"
    return f"{argument.name} must have no value. Got {value}"


# by command: they hold nothing of what was typed
_apps: dict[type[Command], App] = {}
_arguments: dict[type[Command], tuple[Argument, ...]] = {}


def _app(kind: type[Command]) -> App:
    """Return what reads the options of one command."""
    if kind not in _apps:
        _apps[kind] = _made_app(kind)
    return _apps[kind]


def _made_app(kind: type[Command]) -> App:
    def record(*arguments: Any, **options: Any) -> Command:
        return kind(*arguments, **options)

    # of a class, cyclopts would work out the types of all fields several times for each command line
    record.__signature__ = signature_of(kind)  # type: ignore[attr-defined]
    plain = Parameter(
        negative=(),
        allow_repeating=True,
        allow_leading_hyphen=True,
        json_dict=False,
        json_list=False,
    )
    app = App(default_parameter=plain, help_flags=(), version_flags=(), version="unknown")
    app.default(record)
    return app


def arguments_of(kind: type[Command]) -> tuple[Argument, ...]:
    """Return arguments and options of a command, without what was typed."""
    if kind not in _arguments:
        app = _app(kind)
        plain = app.default_parameter
        _arguments[kind] = tuple(
            app.assemble_argument_collection(default_parameter=plain, parse_docstring=False)
        )
    return _arguments[kind]


def choices_of(argument: Argument) -> list[str]:
    """Return the words that an argument may be; empty if it may be any."""
    kind = argument.resolved_hint
    return list(get_args(kind)) if get_origin(kind) is Literal else []


def is_option(argument: Argument) -> bool:
    """Return whether an argument is typed behind its name."""
    return argument.name.startswith("-")


def takes_value(argument: Argument) -> bool:
    """Return whether a value follows an option."""
    return argument.hint is not bool


def _usage_error(program: str, message: str) -> UsageError:
    return UsageError(f"{program}: {message.rstrip('.')}; see {program} --help")


def _unknown_option(program: str, word: str, names: Iterable[str]) -> str:
    """Return the line about an option that a command does not have."""
    name = word.partition("=")[0]
    text = f"{program}: unknown option {name}"
    if name == "--part" and "PART" in names:
        return _with_guess(f"{text}: the part is given without a name, as PART", "", program)
    guess = nearest(name, names)
    if not guess:
        owners = [key for key, kind in COMMANDS.items() if name in _names(kind)]
        # every command has those
        if owners and len(owners) < len(COMMANDS):
            text += f"; it is an option of {', '.join(owners)}"
    return _with_guess(text, guess, program)


def _with_guess(text: str, guess: str, program: str) -> str:
    if guess:
        return f"{text}; did you mean {guess}? See {program} --help"
    return f"{text}; see {program} --help"


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


# The help: texts of the docstrings, in the groups of the records.


def program_help() -> str:
    """Return the help of the whole command line."""
    width = _width()
    rows = [(f"  {name}", first_line(kind)) for name, kind in COMMANDS.items()]
    flags = [(f"  {name}, {short}", _ROOT[name]) for short, name in _ROOT_SHORT.items()]
    parts = [
        f"usage: {PROGRAM} COMMAND [options]",
        _DESCRIPTION,
        "\n".join(["commands:", *_table(rows, width)]),
        "\n".join(["options:", *_table(flags, width)]),
        _EXAMPLES,
    ]
    return "\n\n".join(parts)


def command_help(kind: type[Command]) -> str:
    """Return the help of a command."""
    width = _width()
    starts = ("usage: ", *["       "] * len(kind.usage))
    usage = [
        f"{start}{_program(kind)} {text}" for start, text in zip(starts, kind.usage, strict=False)
    ]
    parts = ["\n".join(usage), textwrap.fill(_described(kind), width)]
    texts = texts_of(kind)
    for title, arguments in _in_groups(kind).items():
        rows = [(f"  {_spelling(argument)}", _meaning(argument, texts)) for argument in arguments]
        parts.append("\n".join([*textwrap.wrap(title, width), *_table(rows, width)]))
    return "\n\n".join(filter(None, [*parts, kind.epilog]))


def first_line(kind: type[Command]) -> str:
    """Return what a command does, as a list of commands says it."""
    text = _described(kind).rstrip(".")
    return f"{text[0].lower()}{text[1:]}"


def _described(kind: type) -> str:
    return " ".join((kind.__doc__ or "").partition("\n\n")[0].split())


def _in_groups(kind: type[Command]) -> dict[str, list[Argument]]:
    """Return arguments, and options by the titles of their groups, in the order of the records."""
    arguments = {argument.field_info.name: argument for argument in arguments_of(kind)}
    places = [key for key, argument in arguments.items() if not is_option(argument)]
    groups = {"arguments:": [arguments.pop(key) for key in places]}
    titles = {record: _title(record) for record in kind.__mro__}
    titles[kind] = "options:"
    groups |= {title: [] for title in titles.values()}
    for record in reversed(kind.__mro__):
        for key in vars(record).get("__annotations__", ()):
            if key in arguments:
                groups[titles[record]].append(arguments.pop(key))
    return {title: group for title, group in groups.items() if group}


def _title(record: type) -> str:
    text = _described(record).rstrip(".")
    return f"{text[:1].lower()}{text[1:]}:"


def _spelling(argument: Argument) -> str:
    names = ", ".join(argument.names)
    if not is_option(argument) or not takes_value(argument):
        return names
    choices = choices_of(argument)
    metavar = f"{{{','.join(choices)}}}" if choices else argument.parameter.metavar
    return f"{names} {metavar}"


def _meaning(argument: Argument, texts: Mapping[str, str]) -> str:
    """Return the help of an argument; it ends with the default, unless the text states it."""
    text = texts[argument.field_info.name]
    default = argument.field_info.default
    if isinstance(default, bool) or not isinstance(default, int | float | str) or "default" in text:
        return text
    value = f"{default:g}" if isinstance(default, float) else str(default)
    unit = str(argument.parameter.metavar).lower()
    if unit in ("mm", "px", "rad", "deg"):
        value = f"{value} {unit}"
    return f"{text} (default: {value})"


_COLUMN = 24


def _table(rows: Iterable[tuple[str, str]], width: int) -> Iterator[str]:
    """Yield lines of names, and of texts beside or below them."""
    for name, text in rows:
        lines = textwrap.wrap(text, max(width - _COLUMN, 20)) or [""]
        if len(name) > _COLUMN - 2:
            yield name
        else:
            lines[0] = f"{name:{_COLUMN}}{lines[0]}"
            yield lines.pop(0).rstrip()
        for line in lines:
            yield f"{'':{_COLUMN}}{line}"


def _width() -> int:
    return shutil.get_terminal_size().columns - 2
