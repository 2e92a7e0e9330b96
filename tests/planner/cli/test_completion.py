"""Completion, asked of a real bash."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from planner import camera_names
from planner.app.main import main
from planner.app.process import DONE


def completed(script, *words):
    """Return what bash offers for the last of some words."""
    line = " ".join(f"'{word}'" for word in words)
    ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _aspectgraph aspectgraph '{words[-1]}' '{words[-2]}'"
    show = 'printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(
        ["bash", "-c", f"{script}\n{ask}\n{show}"], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_options_and_cameras(capsys):
    assert main(["completion", "bash"]) == DONE
    script = capsys.readouterr().out
    assert completed(script, "aspectgraph", "si") == ["simulate"]
    assert completed(script, "aspectgraph", "plan", "part.stp", "--focus") == ["--focus-margin-mm"]
    assert completed(script, "aspectgraph", "simulate", "--se") == ["--seed"]
    assert completed(script, "aspectgraph", "plan", "--camera", "") == list(camera_names())


def test_zsh_gets_the_same_with_its_adapter(capsys):
    assert main(["completion", "bash"]) == DONE
    bash = capsys.readouterr().out
    assert main(["completion", "zsh"]) == DONE
    assert capsys.readouterr().out == "autoload -U +X bashcompinit && bashcompinit\n" + bash
