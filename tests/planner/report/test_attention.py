"""The head of a report: few warnings are told one by one, many by kind; nothing is lost either way."""

import re

from ground.templates import render
from planner.report import tables
from planner.report.tables import FEW
from planner.rows import Row, Warned, WarningKind
from planner.sensor_setting import Reason, ReasonKind


def row(number, name, *warnings):
    return Row(number, name, "length", 80.0, "mm", 1.6, 1.0, 0.95, None, 0.1, 12.0, {}, warnings)


def part(**values):
    values = {"notices": [], "not_inspected": None, **values}
    return render("planner", "report/templates/attention.html", **values).strip()


def attention(rows, unsharp=()):
    return part(notices=tables.attention(rows, unsharp))


def not_inspected(reasons):
    return part(not_inspected=tables.not_inspected(reasons, "edge"))


def text(html):
    return re.sub(r"<[^>]*>", "", html)


def test_nothing_to_look_at_takes_no_room():
    assert attention([[row(1, "a")], []]) == ""
    assert not_inspected({}) == ""


def test_few_warnings_are_told_one_by_one():
    html = attention(
        [
            [row(1, "a&b", Warned(WarningKind.FEW_PIXELS, "tolerance of 1.1 px"))],
            [row(2, "c", Warned(WarningKind.BETTER, "0.04 better"))],
        ]
    )
    assert html.count("<li>") == 2
    # those of one kind, too
    html_of_a_kind = attention(
        [
            [
                row(1, "a", Warned(WarningKind.FEW_PIXELS, "1.1 px")),
                row(1, "b", Warned(WarningKind.FEW_PIXELS, "1.2 px")),
            ]
        ]
    )
    assert re.findall("<li>(.*?)</li>", html_of_a_kind)[1].startswith("<b>b</b>")
    assert "a&amp;b (setting 1): tolerance of 1.1 px" in text(html)
    assert "c (setting 2): 0.04 better" in text(html)


def test_many_warnings_of_a_kind_are_one_line_with_every_name_once():
    fine = Warned(WarningKind.FEW_PIXELS, "tolerance of 1.1 px")
    names = [f"e{i}" for i in range(FEW)]
    html = attention([[row(1, name, fine) for name in names], [row(2, "e0", fine)]])
    assert html.count("<li>") == 1
    assert f"{WarningKind.FEW_PIXELS.value} in {FEW + 1} measurements: e0 (1, 2), e1 (1), " in text(
        html
    )
    assert 'href="#setting-2"' in html


def test_settings_with_little_room_in_focus_are_named():
    assert "Narrow margin of focus in setting 2: a point is less than" in text(
        attention([[row(1, "a")]], [2])
    )
    assert "Narrow margin of focus in settings 2, 3: a point is less than" in text(
        attention([], [2, 3])
    )


def test_few_reasons_stand_at_the_head():
    html = not_inspected({"a": "unobservable: <b>"})
    assert "unobservable: &lt;b&gt;" in html
    assert "#reasons" not in html


def test_many_reasons_are_counted_at_the_head_and_listed_below():
    low = ReasonKind.PROBABILITY_TOO_LOW
    reasons = {f"e{i}": Reason.of(low, f"P = 0.{i}") for i in range(FEW)}
    # the kind is no part of the text
    reasons["x"] = Reason("x: y", ReasonKind.UNOBSERVABLE)
    html = not_inspected(reasons)
    head = text(html)
    assert f"probability too low ({FEW}): e0, e1, " in head
    assert "unobservable (1): x" in head
    assert "P = 0.3" not in head
    assert 'href="#reasons"' in html
    assert tables.not_inspected(reasons, "edge").table.rows == list(reasons.items())
