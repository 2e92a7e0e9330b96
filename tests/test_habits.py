"""Files about the project agree: one version, one ruff, forms that are whole, commits that exist."""

import re
import shutil
import subprocess
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

import planner

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


def read_yaml(name):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_citation_has_the_version_and_the_licence_of_the_project():
    citation = read_yaml("CITATION.cff")
    assert citation["version"] == PROJECT["project"]["version"]
    assert citation["license"] == PROJECT["project"]["license"]
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    (paper,) = citation["references"]
    assert [one["family-names"] for one in paper["authors"]] == ["Yang", "Ciarallo"]


def test_the_changelog_has_the_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[{re.escape(PROJECT['project']['version'])}\] - ", text, re.MULTILINE)
    assert all(f"\n### {kind}\n" in text for kind in ("Added", "Changed", "Fixed"))


def test_the_version_is_that_of_the_installed_package():
    assert planner.__version__ == version("aspectgraph")


def test_no_source_states_the_version_again():
    stated = f'"{PROJECT["project"]["version"]}"'
    packages = ("aspectgraph", "errors", "ga", "planner")
    sources = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    assert [path for path in sources if stated in path.read_text(encoding="utf-8")] == []


def test_hooks_use_the_ruff_of_the_extra():
    ruff, local = read_yaml(".pre-commit-config.yaml")["repos"]
    (pinned,) = [
        one.removeprefix("ruff==").removesuffix(".*")
        for one in PROJECT["project"]["optional-dependencies"]["test"]
        if one.startswith("ruff==")
    ]
    assert ruff["rev"].startswith(f"v{pinned}.")
    pins = (ROOT / ".ci" / "pins" / "py3.11-test.txt").read_text(encoding="utf-8")
    assert f"\nruff=={ruff['rev'][1:]} " in pins
    assert [hook["id"] for hook in ruff["hooks"]] == ["ruff-check", "ruff-format"]
    assert [hook["entry"] for hook in local["hooks"]] == ["lint-imports", "mypy"]


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_forms_are_whole(path):
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= form.keys()
    ids = [field["id"] for field in form["body"]]
    assert len(set(ids)) == len(ids)
    assert all(field["attributes"]["label"] for field in form["body"])
    assert all(field["type"] in ("textarea", "input", "dropdown") for field in form["body"])


def test_there_is_a_form_for_each_kind():
    assert [path.stem for path in FORMS] == ["bug", "question", "refused_part"]


def test_commits_that_blame_passes_over_are_whole_digests():
    lines = (ROOT / ".git-blame-ignore-revs").read_text(encoding="utf-8").splitlines()
    digests = [line for line in lines if line and not line.startswith("#")]
    assert digests
    assert all(re.fullmatch(r"[0-9a-f]{40}", one) for one in digests)
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a clone")
    shallow = subprocess.run(
        ["git", "rev-parse", "--is-shallow-repository"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if shallow.stdout.strip() != "false":
        pytest.skip("a clone without its history")
    for digest in digests:
        subprocess.run(["git", "cat-file", "-e", f"{digest}^{{commit}}"], cwd=ROOT, check=True)
