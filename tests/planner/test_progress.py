"""Progress for people: about how long the rest takes, from how long it took so far."""

from __future__ import annotations

import io
import re
import sys
import time
from pathlib import Path

import pytest

from aspectgraph import read_solid
from aspectgraph.phases import report_phase
from planner import progress
from planner.callbacks import Deadline
from planner.progress import LOOPS, Pace, TimeIsUpError, TimeLeft, duration

BLOCK = Path(__file__).parents[2] / "examples" / "two_pocket_block.off"


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def told(clock, seconds, total, label="visible regions"):
    """What is told when piece after piece takes so many seconds, with the number of pieces done by then."""
    pace = Pace(clock)
    lines = {}
    for done, one in enumerate(seconds, 1):
        clock.now += one
        if (line := pace(done, total, label)) is not None:
            lines[done] = line
    return lines


def test_the_rest_is_told_from_the_first_pieces_but_one(clock):
    # the first one compiles for a minute; then 2 s each: 112 are left after 4, 224 s
    lines = told(clock, [60.0, 2.0, 2.0, 2.0, *[2.0] * 112], 116)
    assert lines == {4: "visible regions: about 4 min more, at the pace of the first 4 of 116"}


@pytest.mark.parametrize(
    ("limit_s", "line"),
    [
        # after 4 pieces 66 s are over, and 224 s remain
        (1000.0, "visible regions: about 3 min more, at the pace of the first 4 of 116"),
        (291.0, "visible regions: about 3 min more, at the pace of the first 4 of 116"),
        (265.0, "visible regions: at most 3 min more, then the time limit ends it"),
        (93.0, "visible regions: at most 20 s more, then the time limit ends it"),
        (68.0, None),
        (10.0, None),
    ],
)
def test_no_estimate_exceeds_what_a_time_limit_leaves(clock, limit_s, line):
    pace = Pace(clock, until=clock.now + limit_s)
    lines = []
    for done, seconds in enumerate([60.0, 2.0, 2.0, 2.0], 1):
        clock.now += seconds
        lines.append(pace(done, 116, "visible regions"))
    assert lines == [None, None, None, line]


def test_a_bar_leaves_no_more_time_than_a_limit(monkeypatch):
    stream = Terminal()
    with progress.terminal_progress(stream, until=time.monotonic() + 40.5) as show:
        for done in range(1, 4):
            time.sleep(0.05)
            show(done, 10**6, "candidate poses")
    assert "left: 0:00:40" in re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", stream.getvalue())


def test_what_is_soon_done_is_not_told(clock):
    assert not told(clock, [1.0] * 20, 20)
    assert not told(clock, [0.01] * 1000, 1000)


def test_it_is_told_again_only_where_it_takes_twice_as_long(clock):
    # 3 s each would leave 36 s; then they take 30 s each
    lines = told(clock, [3.0] * 4 + [30.0] * 12, 16)
    assert list(lines) == [4, 7]
    # 99 s for 6 pieces, and 9 are left: 148.5 s
    assert "about 2 min more" in lines[7]


def test_work_that_usually_ends_early_is_told_so(clock):
    (line,) = told(clock, [5.0] * 50, 50, "lower bound").values()
    assert "about 4 min more, or less, at" in line


def test_nothing_is_told_from_a_small_share(clock):
    assert not told(clock, [5.0] * 90, 10_000)
    assert list(told(clock, [5.0] * 110, 10_000)) == [101]


def test_work_that_begins_anew_is_paced_anew(clock):
    """A proof that was done comes again after an hour of other work: that hour was no part of it."""
    pace = Pace(clock)
    for done in range(1, 51):
        clock.now += 0.1
        assert pace(done, 50, "lower bound") is None
    clock.now += 3600.0
    for done in range(1, 4):
        clock.now += 2.0
        assert pace(done, 50, "lower bound") is None
    clock.now += 2.0
    assert "about 2 min more" in pace(4, 50, "lower bound")


def test_of_loops_no_pace_is_told(clock):
    """Each takes seconds, with minutes of other work between; how many are needed is not known."""
    assert not told(clock, [60.0] * 30, 219, label=LOOPS)


def test_lines_say_nothing_of_single_loops(clock):
    stream = io.StringIO()
    with progress.terminal_progress(stream, lines=True) as show:
        for done in range(1, 8):
            clock.now += 60.0
            show(done, 219, LOOPS)
        show(7, 7, LOOPS)
    assert stream.getvalue() == ""


def test_labels_are_paced_apart(clock):
    pace = Pace(clock)
    for done in (1, 2):
        clock.now += 100.0
        assert pace(done, 50, "visible regions") is None
    clock.now += 100.0
    assert pace(3, 50, "candidate poses") is None


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "10 s"),
        (44.0, "40 s"),
        (89.0, "90 s"),
        (95.0, "2 min"),
        (200.0, "3 min"),
        (5399.0, "90 min"),
        (5500.0, "1.5 h"),
        (9000.0, "2.5 h"),
        (36_000.0, "10 h"),
        (400_000.0, "5 days"),
    ],
)
def test_durations_have_no_more_digits_than_are_known(seconds, text):
    assert duration(seconds) == text


def test_a_log_has_the_estimate_before_the_end(monkeypatch, clock):
    monkeypatch.setattr(progress.time, "monotonic", clock)
    monkeypatch.setattr(Pace.__init__, "__defaults__", (clock,))
    stream = io.StringIO()
    with progress.terminal_progress(stream) as show:
        for done in range(1, 21):
            clock.now += 10.0
            show(done, 20, "candidate poses")
    first, last = stream.getvalue().splitlines()
    assert first == "candidate poses: about 3 min more, at the pace of the first 4 of 20"
    assert last == "candidate poses: 20/20 (190.0 s)"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_has_a_bar_for_each_label_and_lines_that_stay(monkeypatch, clock):
    monkeypatch.setattr(Pace.__init__, "__defaults__", (clock,))
    stream = Terminal()
    with progress.terminal_progress(stream) as show:
        for done in range(1, 21):
            clock.now += 10.0
            progress.labelled(show, "candidate poses")(done, 20, "another label")
        progress.note(show, "[what] stays")
    text = stream.getvalue()
    assert "candidate poses: about 3 min more, at the pace of the first 4 of 20" in text
    assert "20/20" in text
    assert "[what] stays" in text
    assert "another label" not in text


def test_nothing_is_shown_where_nothing_is_wanted():
    stream = Terminal()
    with progress.terminal_progress(stream, quiet=True) as show:
        assert show is None
        progress.report(show, 1, 2, "work")
        progress.note(show, "a line")
        assert progress.labelled(show, "work") is None
    assert stream.getvalue() == ""


@pytest.mark.parametrize(
    ("stream", "quiet", "lines", "shown"),
    [
        (io.StringIO, False, False, False),
        (io.StringIO, False, True, True),
        (Terminal, False, False, True),
        (Terminal, True, False, False),
    ],
)
def test_every_phase_of_reading_is_shown_where_somebody_waits(
    monkeypatch, stream, quiet, lines, shown
):
    terminal = stream()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "120")
    with progress.reading_shown(quiet=quiet, lines=lines):
        read_solid(BLOCK)
    phases = ["read the facets", "repair the facets", "join coplanar facets", "trace the faces"]
    phases += ["check the surface", "list the edges", "look for contacts"]
    assert [label in terminal.getvalue() for label in phases] == [shown] * len(phases)
    # nobody listens any more
    read_solid(BLOCK)
    assert terminal.getvalue().count("list the edges: 1/1") == int(lines)


@pytest.mark.parametrize(
    ("quiet", "lines", "n"), [(False, False, 1), (False, True, 1), (True, False, 0)]
)
def test_reading_that_takes_long_says_what_it_is_at(monkeypatch, quiet, lines, n):
    """Also where nothing is reported before the end: the kernel joins solids in one call."""
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(progress, "_FIRST_WORD_S", 0.05)
    with progress.reading_shown(quiet=quiet, lines=lines):
        report_phase(2, 6, "join solids")
        time.sleep(0.12)
        report_phase(6, 6, "join solids")
        time.sleep(0.12)
    assert stream.getvalue().count("join solids: 2/6 (0 s so far)\n") == n
    assert stream.getvalue().count("\n") == n + (lines and not quiet)


@pytest.mark.parametrize("is_quiet", [False, True])
def test_work_that_passes_is_shown_while_it_is_done(monkeypatch, is_quiet):
    """On a terminal a bar; otherwise lines, and only if it takes long."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "120")
    with progress.work_shown(quiet=is_quiet) as show:
        progress.report(show, 17, 17, "registering images")
    assert ("17/17" in terminal.getvalue()) == (not is_quiet)
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(progress, "_FIRST_WORD_S", 0.05)
    monkeypatch.setattr(progress, "WATCHED_S", 0.05)
    with progress.work_shown(quiet=is_quiet) as show:
        progress.report(show, 3, 17, "registering images")
        assert stream.getvalue() == ""
        time.sleep(0.2)
    line = "registering images: 3/17 (0 s so far)\n"
    assert (line in stream.getvalue()) == (not is_quiet)


def test_each_stage_of_a_long_read_is_named_soon(monkeypatch):
    """A stage before it that took long, and lines further apart, do not delay the first line."""
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(progress, "_FIRST_WORD_S", 0.1)
    with progress.reading_shown():
        report_phase(0, 1, "load")
        time.sleep(0.9)
        n_load = stream.getvalue().count("load (")
        for label in ("build", "check"):
            report_phase(1, 300, label)
            time.sleep(0.25)
            assert f"{label}: 1/300" in stream.getvalue()
    # at 0.1, 0.3 and 0.7 s
    assert 2 <= n_load <= 3


def test_the_first_line_is_due_from_the_command_on(monkeypatch):
    """Loading the program and reading the part are one wait for whoever typed the command."""
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(progress, "_FIRST_WORD_S", 0.2)
    begun = time.monotonic()
    with progress.loading_shown(begun):
        time.sleep(0.1)
    assert stream.getvalue() == ""
    with progress.loading_shown(begun - 3.0):
        time.sleep(0.1)
    assert stream.getvalue() == "load the program (3 s so far)\n"
    with progress.reading_shown(begun=begun - 3.0):
        report_phase(0, 1, "load the STEP file")
        time.sleep(0.1)
    assert stream.getvalue().endswith("\nload the STEP file (3 s so far)\n")


# Whether one more piece of work fits before a deadline.


class _Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_a_piece_fits_if_the_longest_so_far_would():
    clock = _Clock()
    time_left = TimeLeft(110.0, clock)
    answers = []
    for seconds in (1.0, 4.0, 0.5, 0.5, 1.0):
        answers.append(time_left.fits_another())
        clock.now += seconds
    # at 100, 101, 105 and 105.5 the longest of 4 s still ends by 110, at 106 just so
    assert answers == [True, True, True, True, True]
    # at 107 it would end at 111
    assert not time_left.fits_another()


def test_the_deadline_itself_is_in_time_and_what_is_later_is_not():
    clock = _Clock()
    time_left = TimeLeft(100.0, clock)
    time_left.check()
    assert time_left.fits_another()
    assert time_left.seconds == 0.0
    clock.now = 100.5
    assert time_left.seconds == 0.0
    assert not time_left.fits_another()
    with pytest.raises(TimeIsUpError):
        time_left.check()


def test_without_a_deadline_everything_fits():
    time_left = TimeLeft()
    assert all(time_left.fits_another() for _ in range(3))
    time_left.check()


def test_who_has_limited_the_time_is_told_steadily_also_between_two_labels(monkeypatch):
    monkeypatch.setattr("planner.progress._FIRST_WORD_S", 0.05)
    stream = io.StringIO()
    with progress.terminal_progress(stream, waiting=True, most_silent_s=0.05) as shown:
        shown(1, 2, "visible regions")
        time.sleep(0.3)
        shown(2, 2, "visible regions")
        time.sleep(0.3)
        progress.note(shown, "a first plan")
    lines = stream.getvalue().splitlines()
    assert sum(line.startswith("visible regions: 1/2 (") for line in lines) >= 2
    assert sum(line.startswith("after visible regions: 2/2 (") for line in lines) >= 2
    assert lines[-1] == "a first plan"


def test_work_that_comes_later_keeps_its_time():
    """Of 100 s, 90 have passed; the page takes 4 s. Without it, late work has half of the 10 s that are left."""
    deadline = Deadline(100.0, begun=time.monotonic() - 90.0)
    now = time.time()
    assert deadline.time_left(0.8).until - now == pytest.approx(5.0, abs=0.5)
    assert deadline.time_left(0.8, later_s=4.0).until - now == pytest.approx(3.0, abs=0.5)
    # what is in time ends with its share
    early = Deadline(100.0)
    now = time.time()
    assert early.time_left(0.8, later_s=4.0).until - now == pytest.approx(80.0, abs=0.5)
    search = early.of_search(share=0.8, later_s=4.0)
    assert search.at() - now == pytest.approx(76.0, abs=0.5)
    assert early.of_search(share=0.8).at() - now == pytest.approx(80.0, abs=0.5)


def test_what_must_come_later_ends_work_before_its_share_of_the_limit():
    """A page of 800 targets takes 6.4 s, and 0.91 of 60 s leave 5.4."""
    deadline = Deadline(60.0)
    now = time.time()
    assert deadline.time_left(0.91, later_s=6.4).until - now == pytest.approx(53.6, abs=0.5)
    assert deadline.time_left(0.8, later_s=6.4).until - now == pytest.approx(48.0, abs=0.5)
