"""Shell completion: a script made from the parser, so that it knows every command and option."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable, Sequence
from typing import Any

from planner.camera.catalogue import camera_names
from planner.cli.parsing.parser import command_parsers
from planner.cli.process.exit_codes import DONE

# $2 is the word to complete, $3 the one before it; files are offered where nothing else fits
_SCRIPT = """\
_aspectgraph() {{
    local word="$2" before="$3" words=""
    case "$before" in
        --camera) words={cameras} ;;
        *) case "${{COMP_WORDS[1]}}" in
{cases}
        esac ;;
    esac
    [ "$COMP_CWORD" -eq 1 ] && words={commands}
    COMPREPLY=()
    if [[ "$word" == -* || "$COMP_CWORD" -eq 1 || "$before" == --camera ]]; then
        COMPREPLY=($(compgen -W "$words" -- "$word"))
    fi
    [ ${{#COMPREPLY[@]}} -eq 0 ] && COMPREPLY=($(compgen -f -- "$word"))
}}
complete -o filenames -F _aspectgraph aspectgraph
"""
_FISH = """\
function __aspectgraph_needs_command
    test (count (commandline -opc)) -eq 1
end
function __aspectgraph_in
    set -l words (commandline -opc)
    test (count $words) -gt 1; and test $words[2] = $argv[1]
end
"""
_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


def completion(options: argparse.Namespace) -> int:
    """Print the script for a shell."""
    print(completion_script(options.parser, camera_names(), options.shell), end="")
    return DONE


def completion_script(parser: argparse.ArgumentParser, cameras: Sequence[str], shell: str) -> str:
    """Return a script that teaches a shell the commands, their options and the cameras.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Of the whole command line.
    cameras : sequence of str
        Names for ``--camera``.
    shell : {"bash", "zsh", "fish"}
        The shell.

    Returns
    -------
    str
        To be evaluated when the shell starts.
    """
    choices = command_parsers(parser)
    if shell == "fish":
        return _fish_script(parser, cameras)
    cases = [
        f"            {name}) words={_words(option for action in one._actions for option in action.option_strings)} ;;"
        for name, one in choices.items()
    ]
    script = _SCRIPT.format(
        cameras=_words(cameras), commands=_words(choices), cases="\n".join(cases)
    )
    return (_ZSH if shell == "zsh" else "") + script


def _fish_script(parser: argparse.ArgumentParser, cameras: Sequence[str]) -> str:
    """Return the script for fish: a line per command and option, with its help."""
    lines = []
    helps = {one.dest: one.help for one in _subparsers(parser)._choices_actions}
    for name, command in command_parsers(parser).items():
        lines.append(
            f"complete -c aspectgraph -f -n __aspectgraph_needs_command -a {name} "
            f"-d {_fish_text(helps[name] or '')}"
        )
        for action in command._actions:
            lines.append(_fish_line(name, action, cameras))
    return _FISH + "\n".join(filter(None, lines)) + "\n"


def _subparsers(parser: argparse.ArgumentParser) -> argparse._SubParsersAction[Any]:
    return next(one for one in parser._actions if isinstance(one, argparse._SubParsersAction))


def _fish_line(command: str, action: argparse.Action, cameras: Sequence[str]) -> str:
    """Return the line of an option, or of the words that an argument may be."""
    start = f"complete -c aspectgraph -n '__aspectgraph_in {command}'"
    words = cameras if action.dest == "camera" else action.choices
    offer = "" if words is None else f" -a {_fish_text(' '.join(map(str, words)))}"
    if not action.option_strings:
        return f"{start} -f{offer}" if offer else ""
    names = "".join(
        f" -l {name[2:]}" if name.startswith("--") else f" -s {name[1:]}"
        for name in action.option_strings
    )
    # -r: it takes a value, a file unless words are offered
    value = "" if action.nargs == 0 else " -r"
    text = (action.help or "").replace("%%", "%")
    return f"{start}{names}{value}{offer} -d {_fish_text(text)}"


def _fish_text(text: str) -> str:
    """Return a text in quotes of fish, in which only these two signs are special."""
    quoted = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{quoted}'"


def _words(names: Iterable[str]) -> str:
    return shlex.quote(" ".join(names))
