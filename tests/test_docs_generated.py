"""The reference that is made from docstrings when the documents are built."""

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
spec = importlib.util.spec_from_file_location("reference", ROOT / "docs/reference.py")
REFERENCE = importlib.util.module_from_spec(spec)
spec.loader.exec_module(REFERENCE)

DOCSTRING = """Do a thing with ``x`` and *more*.

**Guarantee.** It is below 3 < 4 $.

Parameters
----------
x : array_like, shape (n, 3)
    Points, mm. Wider
    than `y`.
*rest
    Others.

Returns
-------
float
    The value.

Examples
--------
>>> 1 < 2
True
"""


class Thing:
    """A thing."""

    def __init__(self, name: str = "", *, size: int = 3) -> None:
        """Make it."""

    @property
    def half(self) -> float:
        """Half of it."""

    def grow(self, by: float) -> None:
        """Grow."""


def test_a_docstring_becomes_lists_and_code():
    assert REFERENCE.markdown(DOCSTRING).split("\n\n") == [
        r"Do a thing with `x` and \*more\*.",
        "**Guarantee.** It is below 3 &lt; 4 &#36;.",
        "**Parameters**",
        "* `x` (array_like, shape (n, 3)): Points, mm. Wider than `y`.\n* `*rest`: Others.",
        "**Returns**",
        "* `float`: The value.",
        "**Examples**",
        "```python\n>>> 1 < 2\nTrue\n```",
    ]


def test_signatures_keep_their_defaults():
    assert REFERENCE.signature("tests.Thing", Thing) == "Thing(name: str = '', *, size: int = 3)"
    assert REFERENCE.signature("tests.Thing.grow", Thing.grow) == "Thing.grow(by: float) -> None"


@pytest.mark.parametrize("package", REFERENCE.PACKAGES)
def test_every_public_name_has_its_entry(package):
    page = REFERENCE.page(package)
    lines = page.splitlines()
    assert [
        name for name in importlib.import_module(package).__all__ if f"## {name}" not in lines
    ] == []
    # no section of a docstring is left as it was
    assert not any(set(line) == {"-"} for line in lines)


@pytest.mark.parametrize("package", REFERENCE.PACKAGES)
def test_a_page_begins_with_a_table_of_its_names(package):
    module = importlib.import_module(package)
    names = module.__all__
    head = REFERENCE.page(package).split("\n## ")[0]
    row = r"^\| \[`(\w+)`\]\(#(\w+)\) \| (.*) \| `([\w.]+)` \|$"
    rows = re.findall(row, head, flags=re.MULTILINE)
    assert sorted(name for name, *_ in rows) == sorted(names)
    assert all(link == name.lower() for name, link, *_ in rows)
    # some names are those of a package below
    assert {folder.split(".")[0] for *_, folder in rows} <= set(REFERENCE.PACKAGES)
    assert all(summary for name, _, summary, _ in rows if callable(getattr(module, name)))


def test_methods_stand_below_their_class():
    page = REFERENCE.page("planner")
    assert "\n### InspectionPlan.simulate\n" in page
    assert "\n### InspectionPlan.rows\n" in page
    assert "\n### InspectionPlan.minimal\n" in page
    assert "InspectionPlan._check_names" not in page
