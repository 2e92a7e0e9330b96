"""What the README shows runs as printed, in a clone of the repository."""

import re
import shlex
from pathlib import Path

import pytest

from aspectgraph import read_graphml
from planner.app.main import main
from planner.app.parsing import parse
from planner.plan import read_plan

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
OUTSIDE_BLOCKS = re.sub(r"^```.*?^```$", "", README, flags=re.MULTILINE | re.DOTALL)
# a command may go on after a backslash
COMMANDS = [
    line.strip()
    for line in OUTSIDE_BLOCKS.replace(" \\\n", " ").splitlines()
    if line.startswith("    ")
]


def blocks(kind):
    return re.findall(rf"^```{kind}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


SNIPPETS = blocks("python")
(DIMENSIONS,) = blocks("toml")
(PRINTED,) = blocks("text")


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
    assert README.count("```") == 2 * (len(SNIPPETS) + 2)
    assert [words(command)[1] for command in OWN] == [
        *("plan", "program", "render", "measure"),
        *("info", "dimensions", "graph", "simulate", "cameras"),
    ]
    rest = [words(command) for command in COMMANDS if command not in OWN]
    assert rest == [["pip", "install", ".[step,robot]"]]


def test_it_is_short():
    """All of it, with commands and what they print."""
    assert len(README.split()) <= 700


def test_commands_run_as_printed(clone, capsys, stated_in_full):
    for command in OWN:
        assert main(words(command)[1:]) == 0, command
    out = capsys.readouterr().out
    assert "116 sharp straight edges" in out
    # curved faces of the CAD model are many flat ones
    assert " facets, " in out
    assert " edges between facets, " in out
    assert "12 dimensions, 8 with a tolerance, 12 measurable" in out
    # what is quoted, row by row: the last column is left out there, as are lines between
    settings, dimensions, verdict = PRINTED.split("\n\n")
    for quoted in (*settings.splitlines(), *dimensions.splitlines(), verdict):
        assert " ".join(quoted.split()) in " ".join(out.split())
    assert "1 round from home to home" in out
    assert "2 of 2 planned targets measured in 1 image" in " ".join(out.split())
    assert "Save TOML" in (clone / "edges.html").read_text(encoding="utf-8")
    assert len(read_graphml(clone / "graph.graphml")) > 1
    check_table(read_plan(clone / "plan" / "plan.json"))


def check_table(plan):
    """What the table shows is what the plan holds."""
    assert plan.complete
    poses, dimensions, _ = PRINTED.split("\n\n")
    for name, dimension in plan.dimensions.items():
        assert f"{name} " in dimensions
        assert f"{dimension.permitted_error:g} mm" in dimensions
    (setting,) = plan.settings
    assert all(f"{value:.1f}" in poses for value in setting.cam2world[:3, 3])


def test_the_dimensions_that_are_shown_are_those_of_the_file():
    (name,) = re.findall(r"--dimensions (examples/\S+)", README)
    assert (ROOT / name).read_text(encoding="utf-8").endswith(DIMENSIONS)


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_snippets_run_as_printed(clone, capsys, snippet):
    names = {}
    exec(compile(snippet, "README.md", "exec"), names)
    assert names["plan"].complete
    out = capsys.readouterr().out
    assert "1 setting (at least 1 needed), 1 of 1 dimensions inspected" in out


def test_make_has_what_is_shown_and_its_demo_names_files_that_are_there():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    assert {"demo", "test"} <= set(re.findall(r"^([a-z-]+):", makefile, flags=re.MULTILINE))
    recipes = re.findall(r"\$\(BIN\)/aspectgraph (plan .*)", makefile)
    assert len(recipes) == 2
    outs = []
    for recipe in recipes:
        options = parse(words(recipe.replace("$(DEMO_OUT)", "demo-output")))
        for name in (options.part, options.entities, options.camera):
            assert name is None or (ROOT / name).is_file()
        outs.append(options.out)
    assert len(set(outs)) == 2


def test_extras_that_are_named_exist():
    extras = (
        (ROOT / "pyproject.toml")
        .read_text(encoding="utf-8")
        .split("[project.optional-dependencies]")[1]
    )
    (listed,) = re.findall(r"pip install \"\.\[([a-z,]+)\]\"", README)
    named = set(listed.split(","))
    assert named == {"step", "robot"}
    assert all(re.search(rf"^{name} = ", extras, flags=re.MULTILINE) for name in named)
