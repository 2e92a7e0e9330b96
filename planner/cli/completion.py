"""Shell completion: a script made from the parser, so that it knows every command and option."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable, Sequence

from planner.camera.catalogue import camera_names
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
    shell : {"bash", "zsh"}
        The shell.

    Returns
    -------
    str
        To be evaluated when the shell starts.
    """
    choices = next(
        one.choices for one in parser._actions if isinstance(one, argparse._SubParsersAction)
    )
    cases = [
        f"            {name}) words={_words(option for action in one._actions for option in action.option_strings)} ;;"
        for name, one in choices.items()
    ]
    script = _SCRIPT.format(
        cameras=_words(cameras), commands=_words(choices), cases="\n".join(cases)
    )
    return (_ZSH if shell == "zsh" else "") + script


def _words(names: Iterable[str]) -> str:
    return shlex.quote(" ".join(names))
