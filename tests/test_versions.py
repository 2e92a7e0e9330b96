"""`.ci/versions`: what is tried on other versions of Python, and what is not."""

import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / ".ci" / "versions"


@pytest.mark.skipif(shutil.which("bash") is None, reason="no shell")
def test_versions_that_the_machine_does_not_have_are_said_so():
    run = subprocess.run([SCRIPT, "3.97", "3.98"], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == [
        f"Python {one}: not on this machine, so not tried" for one in ("3.97", "3.98")
    ]


def test_the_script_names_no_folder_of_one_machine():
    text = SCRIPT.read_text(encoding="utf-8")
    assert not any(place in text for place in ("/root", "/home", "/usr/local", ".pyenv"))
