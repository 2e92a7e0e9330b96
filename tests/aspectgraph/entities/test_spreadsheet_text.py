"""Cells that a spreadsheet does not run, and the text that comes back from them."""

import csv
import io

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from aspectgraph.entities.entity_rules import (
    NumberText,
    cell_of_text,
    csv_text,
    table_text,
    text_of_cell,
)

# the first characters that OWASP names, and what Excel takes for them
STARTS = ("=", "+", "-", "@", "\t", "\r", "\n", "\0", "＝", "＋", "－", "＠")


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("before", ["", " ", "'", "''", "\u00a0 '"])
def test_what_begins_a_formula_is_text(start, before):
    text = f"{before}{start}HYPERLINK(1)"
    assert cell_of_text(text) == "'" + text
    assert text_of_cell(cell_of_text(text)) == text


@pytest.mark.parametrize("text", ["", "bore", "'bore'", "it's", "a=1", "r-3", "3 - 4", "'", "ø12"])
def test_other_text_stays(text):
    assert cell_of_text(text) == text == text_of_cell(text)


@given(st.text(alphabet=st.sampled_from("='+-@ \t\r\na1＝"), max_size=6))
@example("'=")
def test_every_text_comes_back(text):
    assert text_of_cell(cell_of_text(text)) == text
    # a written cell never begins with what starts a formula
    assert not cell_of_text(text).startswith(STARTS)


def test_numbers_stay_numbers_and_line_breaks_stay_in_their_cell():
    rows = [{"=x": "a\rb", "n": -1.5}, {"=x": "-1", "n": -2}, {"=x": None, "n": 1 / 3}]
    text = csv_text(["=x", "n"], rows)
    read = list(csv.reader(io.StringIO(text, newline="")))
    assert read == [["'=x", "n"], ["a\rb", "-1.5"], ["'-1", "-2"], ["", repr(1 / 3)]]


def test_no_terminal_obeys_a_cell_and_numbers_keep_their_decimals():
    rows = [["\x1b[2J", NumberText("-0.500"), "a\x9b", "\udce9", "-0.500"]]
    text = table_text(["=a", "b", "c", "d", "e"], rows, ["made\nby \x1b"], "\n")
    assert text == "# made by \\x1b\n'=a,b,c,d,e\n\\x1b[2J,-0.500,a\\x9b,\\udce9,'-0.500\n"
    assert text.encode()
