"""No name moves the cursor of a terminal, colours its text, turns its direction or forges a line."""

import io
import json
import re
import sys
import traceback

import pytest
from plan_examples import plan, setting

from planner.app.main import main
from planner.files import print_json
from planner.progress import VisibleStream, terminal_progress, visible, visible_output
from planner.report import terminal_tables

NASTY = "bore\x1b[2J\x9b31m\x07\u202egnp\nfake: done\r\t\x7f:smile:"
SHOWN = r"bore\x1b[2J\x9b31m\x07\u202egnp\nfake: done\r\t\x7f:smile:"
# ISO 6429's C0 without line feed, DEL, C1; and what turns the direction of writing
OBEYED = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


@pytest.mark.parametrize("code", [*range(0x20), *range(0x7F, 0xA0), 0x202E, 0x2066, 0xDC80])
def test_every_control_character_is_shown(code):
    shown = visible(f"a{chr(code)}b")
    assert shown.isascii()
    assert shown.isprintable()
    assert shown.startswith("a\\")
    assert chr(code) == shown[1:-1].encode().decode("unicode_escape")


def test_all_else_stays():
    text = r"Ø12 ± 0.01 ≥ é 日本 C:\x1b"
    assert visible(text) == text
    assert visible("a\n\tb\x1b", lines=True) == "a\n\tb\\x1b"


def test_tables_and_sentences(capsys):
    start = [0, 0, 0]
    end = [80, 0, 0]
    found = plan(
        settings=[setting((40.0, -180.0, 620.0), [NASTY])],
        entities={NASTY: [start, end], "b\x1b": [start, end]},
        uninspectable={"b\x1b": "why\x1b[1m"},
        part=NASTY,
    )
    terminal_tables.print_plan(found)
    out = capsys.readouterr().out
    assert not OBEYED.search(out)
    assert SHOWN in out
    assert r"b\x1b: why\x1b[1m" in out
    assert "\nfake" not in out


def test_a_table_on_a_terminal_holds_nothing_that_it_obeys(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    with visible_output():
        found = plan(
            settings=[setting((40.0, -180.0, 620.0), [NASTY])],
            entities={NASTY: [[0, 0, 0], [80, 0, 0]]},
            uninspectable={},
        )
        terminal_tables.print_plan(found)
        print("note: \x1b[7m")
    text = screen.getvalue()
    assert not OBEYED.search(text)
    assert "\x1b[7m" not in text
    assert r"note: \x1b[7m" in text


@pytest.mark.parametrize("lines", [True, False])
def test_progress(lines):
    class Terminal(io.StringIO):
        def isatty(self):
            return not lines

    screen = Terminal()
    with terminal_progress(screen, lines=lines) as progress:
        progress(1, 1, NASTY)
        progress.note(NASTY)
    text = screen.getvalue()
    assert "\x1b[2J" not in text
    assert "\x9b" not in text
    assert "\nfake" not in text
    assert SHOWN in text


@pytest.mark.parametrize("option", [[], ["--json"]])
def test_commands_errors_and_warnings(tmp_path, capsys, option, block_text):
    part = tmp_path / "a\x1b[31m\x9b\u202e\x7fb.off"
    part.write_text(block_text)
    assert main(["info", str(part), *option]) == 0
    assert main(["info", str(tmp_path / "no\x1b[31m\nfake.off"), *option]) == 2
    assert main(["inf\x1b[2J", *option]) == 2
    out, err = capsys.readouterr()
    assert not OBEYED.search(out)
    assert not OBEYED.search(err)
    assert r"no\x1b[31m" in err
    assert len(err.splitlines()) == 2
    if option:
        # JSON has escapes of its own, and gives the name back
        assert json.loads(out)["part"] == part.stem
    else:
        assert r"a\x1b[31m\x9b\u202e\x7fb" in out


def test_tracebacks_and_several_lines(capsys):
    with visible_output():
        try:
            raise ValueError("bad\x1b[31m")
        except ValueError:
            traceback.print_exc()
        print("two\nlines", "and\ta tab", file=sys.stderr)
    err = capsys.readouterr().err
    assert r"bad\x1b[31m" in err
    assert err.endswith("two\nlines and\ta tab\n")


def test_json_gives_every_character_back(capsys):
    text = "".join(map(chr, range(0x100))) + "\u202e"
    print_json({"name": text})
    out = capsys.readouterr().out
    assert json.loads(out) == {"name": text}
    assert not OBEYED.search(out)


def test_streams_are_given_back_and_what_replaces_them_stays(monkeypatch):
    first = io.StringIO()
    monkeypatch.setattr(sys, "stdout", first)
    with visible_output():
        assert isinstance(sys.stdout, VisibleStream)
        with visible_output():
            assert sys.stdout.unescaped is first
    assert sys.stdout is first
    with visible_output():
        sys.stdout = None
    assert sys.stdout is None
    with visible_output():
        pass
    assert sys.stdout is None


@pytest.fixture
def block_text():
    return (
        "OFF\n8 6 12\n0 0 0\n80 0 0\n80 50 0\n0 50 0\n0 0 40\n80 0 40\n80 50 40\n0 50 40\n"
        "4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 2 3 7 6\n4 1 2 6 5\n4 0 4 7 3\n"
    )
