"""`.ci/versions`: what is tried on other versions of Python, and what is not."""

import re
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


def test_the_pins_hold_the_newest_numba_that_is_allowed():
    """Raising the bound without new pins, or the other way round, would try another numba than is allowed."""
    root = SCRIPT.parents[1]
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    bound = re.search(r'"numba>=(\d+)\.(\d+),<(\d+)\.(\d+)"', project)
    assert bound is not None
    _, _, major, minor = map(int, bound.groups())
    pins = sorted((root / ".ci" / "pins").glob("*.txt"))
    pinned = {
        re.search(r"^numba==(\d+)\.(\d+)\.", pin.read_text(), re.MULTILINE).groups() for pin in pins
    }
    assert len(pins) == 3
    assert pinned == {(str(major), str(minor - 1))}
