"""What the README shows runs as printed, in a clone of the repository."""

import re
import shlex
from pathlib import Path

import pytest

from aspectgraph import read_graphml
from planner.cli.main import build_parser, main
from planner.plan import read_plan

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [
    line.strip() for line in README.splitlines() if line.startswith("    ") and line.strip()
]
SNIPPETS = re.findall(r"^```python\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def words(command):
    return shlex.split(command, comments=True)


OWN = [command for command in COMMANDS if words(command)[0] == "aspectgraph"]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder with the examples, to write to."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_all_that_is_shown_is_tested_here():
    """The fenced and the indented code are all there is, and of known kinds."""
    assert README.count("```") == 2 * len(SNIPPETS) > 0
    assert [words(command)[1] for command in OWN] == [
        "info",
        "dimensions",
        "graph",
        "plan",
        "simulate",
        "cameras",
    ]
    rest = [words(command) for command in COMMANDS if command not in OWN]
    assert rest == [["make", "demo"], ["make", "test"], ["pip", "install", ".[step]"]]


def test_commands_run_as_printed(clone, capsys):
    for command in OWN:
        assert main(words(command)[1:]) == 0, command
    out = capsys.readouterr().out
    assert "116 sharp straight edges" in out
    assert "12 dimensions, 8 with a tolerance, 12 measurable" in out
    assert "3 of 3 entities inspected" in out
    assert "confirms the plan" in out
    assert "Save TOML" in (clone / "edges.html").read_text(encoding="utf-8")
    assert len(read_graphml(clone / "graph.graphml")) > 1
    assert read_plan(clone / "plan" / "plan.json").complete


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_snippets_run_as_printed(clone, capsys, snippet):
    names = {}
    exec(compile(snippet, "README.md", "exec"), names)
    assert names["plan"].complete
    out = capsys.readouterr().out
    # from the viewpoint one of the two entities is observable
    assert "[[False  True]]" in out
    # one view may see both, but then another line comes near to one of them
    assert out.splitlines()[-1] in ("1 1 {}", "2 1 {}")
    assert len(read_graphml(clone / "graph.graphml")) == len(names["eag"].graph)


def test_make_has_what_is_shown_and_its_demo_names_files_that_are_there():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    assert {"demo", "test"} <= set(re.findall(r"^([a-z-]+):", makefile, flags=re.MULTILINE))
    recipe = re.search(r"\$\(BIN\)/aspectgraph (plan .*)", makefile).group(1)
    options = build_parser().parse_args(words(recipe.replace("$(DEMO_OUT)", "demo-output")))
    for name in (options.part, options.entities, options.camera):
        assert (ROOT / name).is_file()


def test_extras_that_are_named_exist():
    extras = (
        (ROOT / "pyproject.toml")
        .read_text(encoding="utf-8")
        .split("[project.optional-dependencies]")[1]
    )
    named = set(re.findall(r"\[([a-z]+)\]", README.split("## Command line")[0]))
    assert named == {"step", "plot"}
    assert all(re.search(rf"^{name} = ", extras, flags=re.MULTILINE) for name in named)
