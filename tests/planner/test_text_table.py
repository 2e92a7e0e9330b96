"""Tables and sentences of any width: names are never broken, and lines fit where they can."""

from __future__ import annotations

import io
import json
import os
import re
import sys
import traceback
from dataclasses import replace

import numpy as np
import pytest
from plan_examples import ENTITIES, plan, planned_dimension, setting

from errors.measurands import Line, Localisation
from planner.app.main import main
from planner.files import print_json
from planner.progress import VisibleStream, terminal_progress, visible, visible_output
from planner.report import terminal_tables
from planner.text_table import (
    Column,
    Table,
    WholePieces,
    digits_text,
    enumerated,
    listed,
    print_text,
    share_text,
    terminal_width,
    words,
)

COLUMNS = (Column("entity"), Column("P", right=True), Column("what is said of it"))
NAMES = ("far rim of the slot", "bohrung_d12_h7_links_oben", "e7")
ROWS = [(name, "0.9987", words("a reason of several words")) for name in NAMES]


@pytest.mark.parametrize("width", [None, 200, 80, 60, 50, 40, 30, 26, 10])
def test_names_stay_whole_at_any_width(width):
    lines = Table(COLUMNS, ROWS).lines(width)
    for name in NAMES:
        assert sum(name in line for line in lines) == 1
    assert sum("0.9987" in line for line in lines) == len(NAMES)
    if width is not None:
        # a line may be longer where one name is
        longest = max(width, *map(len, NAMES))
        assert max(map(len, lines)) <= longest
    text = " ".join(" ".join(lines).split())
    assert text.count("reason") == text.count("several") == len(NAMES)


def test_a_wide_terminal_has_a_line_per_row_and_numbers_below_each_other():
    lines = Table(COLUMNS, ROWS).lines(None)
    assert len(lines) == 2 + len(ROWS)
    assert {line.index("0.9987") for line in lines[2:]} == {len(max(NAMES, key=len)) + 2}
    assert lines[1] == "-" * len(lines[1])


def test_wide_characters_take_two_columns():
    """As terminals show them: 穴 is as wide as two letters."""
    lines = Table((Column("name"), Column("P")), [("穴", "1"), ("ab", "2")]).lines(20)
    assert lines[2:] == ["穴    1", "ab    2"]


def test_a_table_is_the_same_for_every_reader():
    """Numbers in their format for a person, without loss for a program; text never as markup."""
    columns = (
        Column("name"),
        Column("place", right=True, unit="mm", spec=".1f"),
        Column("P", right=True, spec=".3f"),
    )
    table = Table(columns, [("<b>=1", (1.25, -2.0), 1 / 3), ("c", None, None)], below={0: "a<b"})
    assert [" ".join(line.split()) for line in table.lines(None)] == [
        "name place (mm) P",
        "-" * 24,
        "<b>=1 1.2 -2.0 0.333",
        "c",
    ]
    assert table.records()[0] == {"name": "<b>=1", "place": (1.25, -2.0), "P": 1 / 3}
    assert table.csv().splitlines()[2] == "c,,"
    assert table.csv().splitlines()[1].endswith(",0.333")
    html = table.html()
    assert '<td class="n">1.2 -2.0</td>' in html
    assert "<td>&lt;b&gt;=1</td>" in html
    assert '<tr class="warning"><td colspan="3">a&lt;b</td></tr>' in html


def test_a_list_is_broken_after_its_commas():
    names = listed(["far rim", "near rim", "bottom"])
    lines = Table((Column("n", right=True), Column("observable")), [("1", names)]).lines(22)
    assert lines[2:] == ["1  far rim, near rim,", "   bottom"]


def test_a_sentence_keeps_names_with_blanks_together(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "20")
    print_text(words("not inspected: far rim of it: no view", ["far rim of it"]))
    assert capsys.readouterr().out.splitlines() == ["not inspected:", "far rim of it: no", "view"]


def test_nothing_obeyed_by_a_terminal_comes_through(capsys):
    lines = Table((Column("n"), Column("x")), [("a\x1b[2J", WholePieces(("b\n", "c")))]).lines(80)
    assert "\x1b" not in "".join(lines)
    assert len(lines) == 3


@pytest.mark.parametrize(("columns", "width"), [("57", 57), ("0", None), ("wide", None)])
def test_the_variable_columns_is_respected_where_there_is_no_terminal(monkeypatch, columns, width):
    monkeypatch.setenv("COLUMNS", columns)
    assert terminal_width() == width


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_the_width_of_the_terminal_is_respected(monkeypatch):
    import fcntl
    import struct
    import termios

    monkeypatch.delenv("COLUMNS", raising=False)
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 83, 0, 0))
    with os.fdopen(theirs, "w") as screen:
        monkeypatch.setattr("sys.stdout", screen)
        width = terminal_width()
        monkeypatch.undo()
    os.close(ours)
    assert width == 83


def test_a_plan_fits_80_columns_with_its_tightest_margin_only(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    names = list(ENTITIES)
    margins = {"focus_mm": 0.5, "field_of_view_px": 300.0, "visible": 1.0}
    view = replace(setting((40.0, -180.0, 620.0), names), margins=margins)
    found = plan(settings=[view], uninspectable={})
    # half the depth of field of this camera is far more than 0.5 mm
    assert terminal_tables.tightest_margin(found, found.settings[0]) == "focus: 3 % left (+0.5 mm)"
    terminal_tables.print_plan(found)
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert "focus: 3 % left (+0.5 mm)" in out
    assert "field of view" not in out
    for name in names:
        assert name in out


def test_a_reason_of_several_targets_is_printed_once(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    left = dict.fromkeys(list(ENTITIES)[:3], "no view found yet")
    terminal_tables.print_plan(plan(settings=[], lower_bound=0, uninspectable=left))
    out = " ".join(capsys.readouterr().out.split())
    assert f"not inspected: {', '.join(left)}: no view found yet" in out
    assert out.count("no view found yet") == 1


@pytest.mark.parametrize(
    ("tolerance", "error", "texts"),
    [
        ((-0.05, 0.05), 0.0125, ("±0.05", "error up to 0.0125 mm (25 %)")),
        ((-0.02, 0.1), 0.03, ("+0.1/-0.02", "error up to 0.03 mm (50 %)")),
        (None, 0.2, ("", "error up to 0.2 mm")),
    ],
)
def test_a_dimension_says_which_share_of_its_tolerance_is_permitted(tolerance, error, texts):
    """A quarter of a half width of 0.05 is 0.0125."""
    edge = Line(np.zeros(3), np.array([40.0, 0.0, 0.0]))
    model = Localisation.gaussian(0.1)
    one = planned_dimension("length", ("e1",), (edge,), error, model, tolerance)
    nominal, text = one.requirement_texts
    assert nominal.endswith(texts[0])
    assert text == texts[1]


def test_one_line_says_how_many_files_there_are_and_which_to_open(capsys):
    terminal_tables.print_written(["plan/a", "plan/report.html"], "plan", "plan/report.html")
    assert capsys.readouterr().out == "2 files in plan/; open plan/report.html\n"


# No name moves the cursor of a terminal, colours its text, turns its direction or forges a line.


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


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 2, "0"),
        (0.01234, 2, "0.012"),
        (0.0000321, 2, "0.000032"),
        (-0.00001, 3, "-0.00001"),
        (1234.5, 3, "1234"),
        (12.345, 3, "12.3"),
        (4e-7, 3, "< 0.000001"),
    ],
)
def test_numbers_have_no_exponent(value, digits, text):
    assert digits_text(value, digits) == text


def test_a_list_in_a_sentence_ends_with_and():
    assert [enumerated(list(names)) for names in ("", "a", "ab", "abc")] == [
        "",
        "a",
        "a and b",
        "a, b and c",
    ]


@pytest.mark.parametrize(
    ("share", "limit", "text"),
    [
        (0.797, 0.8, "79.7"),
        (0.79999, 0.8, "79.9"),
        (0.7949, 0.8, "79"),
        (0.9, 0.8, "90"),
        (0.9049, 0.905, "90.4"),
    ],
)
def test_a_share_below_its_limit_does_not_read_the_same(share, limit, text):
    assert share_text(share, limit) == text
