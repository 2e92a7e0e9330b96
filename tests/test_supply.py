"""What continuous integration says of licences and advisories, and the pins."""

import importlib.util
import json
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
spec = importlib.util.spec_from_file_location("supply", ROOT / ".ci" / "supply.py")
supply = importlib.util.module_from_spec(spec)
spec.loader.exec_module(supply)


@pytest.mark.parametrize(
    ("licence", "allowed"),
    [
        ("MIT", True),
        ("BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0", True),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("BSD 3-Clause License", True),
        ("GPL-3.0-only OR MIT", True),
        ("MIT AND GPL-3.0-only", False),
        ("GNU Affero General Public License v3", False),
        ("MITIGATED", False),
        ("", False),
    ],
)
def test_licences_are_choices_of_sums(licence, allowed):
    assert supply.is_allowed(licence) is allowed


@pytest.mark.parametrize(
    ("answer", "code", "words"),
    [
        ("no JSON", 3, "NOT CHECKED, pip-audit"),
        ('{"dependencies": []}', 3, "NOT CHECKED for any package"),
        (
            '{"dependencies": [{"name": "a", "skip_reason": "not found"}]}',
            3,
            "NOT CHECKED for a",
        ),
        (
            '{"dependencies": [{"name": "a", "version": "1", "vulns": []}, {"name": "b"}]}',
            3,
            "NOT CHECKED for b",
        ),
        (
            '{"dependencies": [{"name": "a", "version": "1", "vulns": []}]}',
            0,
            "1 of 1 packages looked up, 0 adv",
        ),
        (
            '{"dependencies": [{"name": "a", "version": "1", "vulns": [{"id": "X-1"}]}]}',
            1,
            "a 1 has the advisory X-1",
        ),
    ],
)
def test_what_was_not_looked_up_is_not_called_safe(monkeypatch, capsys, answer, code, words):
    monkeypatch.setattr(
        subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 0, answer)
    )
    assert supply.check_advisories() == code
    assert words in capsys.readouterr().out


def test_the_bill_of_materials_names_every_package():
    bill = json.loads(json.dumps(supply.bill_of_materials()))
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    names = [one["name"].lower() for one in bill["components"]]
    assert "numpy" in names
    assert len(names) == len(set(names))


def test_every_pin_has_a_hash_and_every_dependency_a_pin():
    project = (ROOT / "pyproject.toml").read_text()
    needed = re.findall(
        r'^    "([a-z0-9_-]+)[^"\n]*",$', project.split("dependencies = [")[1].split("]")[0], re.M
    )
    for path in (ROOT / ".ci" / "pins").glob("*.txt"):
        pins = re.sub(r"\\\n\s*", "", path.read_text()).splitlines()
        assert all(
            re.match(r"[A-Za-z0-9._-]+==\S+ .*--hash=sha256:[0-9a-f]{64}", pin) for pin in pins
        )
        # open3d-cpu is the same without code for graphics cards
        pinned = {pin.split("==")[0].removesuffix("-cpu") for pin in pins}
        assert set(needed) <= pinned
        assert "http" not in path.read_text()
