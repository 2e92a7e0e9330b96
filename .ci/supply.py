"""What the installed packages are: their licences, known advisories, and a bill of materials.

Usage: python .ci/supply.py licences|advisories|sbom [FILE]

``licences`` fails for a package whose licence is not on the list. ``advisories`` asks pip-audit about the pinned
packages, and fails for what it finds. What nobody looked up is not checked, which is not passed: the exit code is 3
then, and the packages are named. ``sbom`` writes CycloneDX 1.5 as JSON.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from importlib.metadata import Distribution
from pathlib import Path

ALLOWED = re.compile(
    r"(Apache([- ]2\.0| Software License)|BSD( License|[- ][23]-Clause( License)?)?|0BSD|MIT( License|-CMU|-0)?|Zlib"
    r"|ISC( License \(ISCL\))?|CC0-1\.0|Unlicense|PSF-2\.0|Python(-2\.0| Software Foundation License)|Public Domain"
    r"|MPL-2\.0|Mozilla Public License 2\.0 \(MPL 2\.0\)|HPND)( WITH LLVM-exception)?"
)
"""Compatible with Apache-2.0 for a library that is used unchanged."""

TESTS_ONLY = {"igraph", "python-igraph"}
"""GPL: a test reads our files with them; no package of ours imports them."""

_SECONDS = 300
NOT_CHECKED = 3
"""Exit code where the advisories of some package were not looked up."""


def distributions() -> list[Distribution]:
    """Return what is installed, by name, ourselves left out."""
    found = {one.name.lower(): one for one in importlib.metadata.distributions()}
    return [found[name] for name in sorted(found) if name != "aspectgraph"]


def licence_of(one: Distribution) -> str:
    """Return the licence as an expression; several classifiers are a choice."""
    stated = one.metadata.get("License-Expression")
    if stated:
        return stated
    classifiers = one.metadata.get_all("Classifier") or []
    words = [text.split(" :: ")[-1] for text in classifiers if text.startswith("License ::")]
    words = [word for word in words if word != "OSI Approved"]
    return " OR ".join(words) or (one.metadata.get("License") or "").strip().split("\n")[0]


def is_allowed(expression: str) -> bool:
    """Say whether one way to choose in a licence expression is on the list, all its parts of it."""
    choices = [choice.split(" AND ") for choice in expression.split(" OR ")]
    return any(all(ALLOWED.fullmatch(part.strip()) for part in choice) for choice in choices)


def check_licences() -> int:
    """Print what is not allowed; return the exit code."""
    every = distributions()
    bad = {one.name: licence_of(one) for one in every if not is_allowed(licence_of(one))}
    bad = {name: licence for name, licence in bad.items() if name.lower() not in TESTS_ONLY}
    for name, licence in bad.items():
        print(f"licence of {name} must be on the list of .ci/supply.py. Got {licence or 'none'!r}.")
    print(f"licences: {len(every)} packages, {len(bad)} not allowed")
    return 1 if bad else 0


def check_advisories() -> int:
    """Ask pip-audit; return the exit code: 0 only if every package was looked up and has no advisory."""
    command = [
        "pip-audit",
        "--format",
        "json",
        "--progress-spinner",
        "off",
        "--require-hashes",
        "--disable-pip",
    ]
    command += ["--requirement", str(Path(__file__).parent / "pins" / "py3.11-test.txt")]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_SECONDS, check=False
        )
        audited = json.loads(done.stdout)["dependencies"]
    except (OSError, subprocess.TimeoutExpired, ValueError, KeyError):
        print("advisories: NOT CHECKED, pip-audit is not installed or its service was not reached")
        return NOT_CHECKED
    known = [one for one in audited if "vulns" in one]
    found = [(one["name"], one["version"], vuln["id"]) for one in known for vuln in one["vulns"]]
    for name, version, which in found:
        print(f"{name} {version} has the advisory {which}")
    missed = [one["name"] for one in audited if "vulns" not in one]
    counts = f"{len(known)} of {len(audited)} packages looked up, {len(found)} advisories"
    print(f"advisories: {counts}")
    if missed or not known:
        print(f"advisories: NOT CHECKED for {', '.join(missed) or 'any package'}")
    if found:
        return 1
    return NOT_CHECKED if missed or not known else 0


def bill_of_materials() -> dict[str, object]:
    """Return a CycloneDX document of what is installed; the same packages give the same bytes."""
    components = []
    for one in distributions():
        name = re.sub(r"[-_.]+", "-", one.name).lower()
        purl = f"pkg:pypi/{name}@{one.version}"
        licence = licence_of(one)
        components.append(
            {
                "type": "library",
                "bom-ref": purl,
                "name": one.name,
                "version": one.version,
                "purl": purl,
            }
            | ({"licenses": [{"license": {"name": licence}}]} if licence else {})
        )
    own = {
        "type": "library",
        "name": "aspectgraph",
        "version": importlib.metadata.version("aspectgraph"),
    }
    metadata = {"component": own | {"licenses": [{"license": {"id": "Apache-2.0"}}]}}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": metadata,
        "components": components,
    }


def main() -> int:
    """Do what the first word says."""
    what, *rest = sys.argv[1:] or [""]
    if what == "licences":
        return check_licences()
    if what == "advisories":
        return check_advisories()
    if what == "sbom":
        path = Path(rest[0] if rest else "sbom.cdx.json")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(bill_of_materials(), indent=1) + os.linesep, encoding="utf-8")
        return 0
    print(__doc__)
    return 2


if __name__ == "__main__":
    sys.exit(main())
