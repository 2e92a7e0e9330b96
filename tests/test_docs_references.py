"""The documents name code and tests that exist: `package.module.name` and `tests/file.py::test`, in backticks."""

from __future__ import annotations

import ast
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
# a name in backticks, by itself or called
CODE = re.compile(
    r"(?<!`)`((?:aspectgraph|errors|ga|ground|planner)(?:\.[A-Za-z_]\w*)+)(?:\([^`]*\))?`(?!`)"
)
TEST = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
LINK = re.compile(r"\]\(([^)#\s]+)[^)]*\)")


def found(pattern):
    """All that a pattern finds in the documents, each once, with a document that holds it."""
    return sorted(
        {
            match: path for path in DOCUMENTS for match in pattern.findall(path.read_text("utf-8"))
        }.items()
    )


def resolve(name: str) -> object:
    """Import the longest module of a dotted name and take the rest from it."""
    parts = name.split(".")
    for size in range(len(parts), 0, -1):
        module = ".".join(parts[:size])
        try:
            value = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{module}.".startswith(f"{error.name}."):
                raise
            continue
        for part in parts[size:]:
            value = member(value, part)
        return value
    raise ModuleNotFoundError(name)


def member(value: object, name: str) -> object:
    """Return an attribute; of a class also a field without a default."""
    if isinstance(value, type) and name in getattr(value, "__annotations__", {}):
        return name
    return getattr(value, name)


@cache
def functions_in(path: Path) -> frozenset[str]:
    """Names of all functions in a file."""
    tree = ast.parse(path.read_text("utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def test_there_are_documents_and_references():
    assert len(DOCUMENTS) > 1
    assert len(found(CODE)) > 50
    assert len(found(TEST)) > 20


@pytest.mark.parametrize(
    ("name", "path"), found(CODE), ids=lambda value: str(getattr(value, "name", value))
)
def test_code_that_is_named_exists(name, path):
    assert resolve(name) is not None


@pytest.mark.parametrize(
    ("test", "path"), found(TEST), ids=lambda value: str(getattr(value, "name", value))
)
def test_tests_that_are_named_exist(test, path):
    file, function = test
    assert (ROOT / file).is_file()
    assert not function or function in functions_in(ROOT / file)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_within_the_documents_lead_somewhere(path):
    for target in LINK.findall(path.read_text("utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), target


@pytest.mark.parametrize(
    "name", ["planner.no_such_module.f", "planner.bound.lower_bound.no_such_name"]
)
def test_a_wrong_name_is_noticed(name):
    with pytest.raises((ImportError, AttributeError)):
        resolve(name)
