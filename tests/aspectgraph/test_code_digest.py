"""A digest of source files: every change of code changes it, and nothing else does."""

import sys

import pytest

from aspectgraph.files import code_digest


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of two rooms, which can be found."""
    for name in ("rooms/__init__.py", "rooms/work/__init__.py", "rooms/show/__init__.py"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / "rooms"
    sys.modules.pop("rooms", None)


def digest(*without):
    code_digest.cache_clear()
    return code_digest(("rooms",), without)


def test_every_change_of_code_is_noticed(package):
    first = digest()
    assert len(first) == 64
    assert digest() == first
    (package / "notes.txt").write_text("no code")
    assert digest() == first
    (package / "work" / "more.py").write_text("")
    second = digest()
    (package / "work" / "more.py").write_text("x = 2\n")
    third = digest()
    (package / "work" / "more.py").rename(package / "work" / "other.py")
    assert len({first, second, third, digest()}) == 4


def test_what_decides_about_nothing_is_left_out(package):
    first = digest("rooms.show")
    (package / "show" / "__init__.py").write_text("x = 2\n")
    assert digest("rooms.show") == first
    (package / "work" / "__init__.py").write_text("x = 2\n")
    assert digest("rooms.show") != first


def test_without_files_the_version_counts(monkeypatch):
    code_digest.cache_clear()
    assert code_digest(("no_such_package",)) != code_digest(("aspectgraph",))
    monkeypatch.setattr("aspectgraph.files.version", lambda name: "0.0.7")
    before = code_digest(("no_such_package",))
    code_digest.cache_clear()
    assert code_digest(("no_such_package",)) != before
