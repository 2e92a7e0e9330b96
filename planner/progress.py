"""Progress of long work, for programs (a callable) and for people (a bar on the terminal).

A progress callable is ``progress(done, total, label)``; None everywhere means silence. It may raise to cancel the work.
What will take long is told with about how long, see `Pace`.
"""

from __future__ import annotations

import math
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID


# Text for a terminal: names of other people's files cannot move its cursor or forge a line.
#
# Control characters (ISO 6429: C0, DEL and C1, ESC among them), signs that turn the direction of
# writing, and halves of characters are shown as Python writes them: ``\x1b``, ``\u202e``.


# C0, DEL, C1; direction marks, overrides and isolates; line and paragraph separators; half pairs,
# by which Python holds bytes of file names that are not UTF-8
_HIDDEN = "\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff"
_IN_LINES = re.compile(f"[{_HIDDEN}]")
_IN_TEXT = re.compile(f"(?![\n\t])[{_HIDDEN}]")
_SHORT = {"\n": r"\n", "\r": r"\r", "\t": r"\t"}


def visible(text: str, *, lines: bool = False) -> str:
    r"""Return text with what a terminal would obey shown instead.

    Parameters
    ----------
    text : str
        The text.
    lines : bool
        Keep line feeds and tabs: the text has several lines.

    Returns
    -------
    str
        For instance ``\x1b[2J`` in words of a terminal, and ``\n`` unless there may be `lines`.

    Examples
    --------
    >>> print(visible("bore\x1b[2J"))
    bore\x1b[2J
    """
    return (_IN_TEXT if lines else _IN_LINES).sub(_shown, text)


def _shown(character: re.Match[str]) -> str:
    code = ord(character[0])
    form = f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
    return _SHORT.get(character[0], form)


class VisibleStream:
    """A text stream that shows what a terminal would obey; all else is up to the stream beneath.

    Parameters
    ----------
    unescaped : text file
        The stream beneath, for who escapes names and writes colours.
    """

    def __init__(self, unescaped: TextIO) -> None:
        self.unescaped = unescaped

    def write(self, text: str) -> int:
        """Write a text; the number of its characters comes back."""
        self.unescaped.write(visible(text, lines=True))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write texts one after another."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unescaped, name)


def unescaped(stream: TextIO) -> TextIO:
    """Return the stream beneath a `VisibleStream`, for a console that escapes its text itself."""
    return getattr(stream, "unescaped", stream)


@contextmanager
def visible_output() -> Iterator[None]:
    """Escape all that is written to standard output and standard error, such as messages and notes.

    What replaces a stream meanwhile, or closes it, is left in place.
    """
    replaced: dict[str, VisibleStream] = {}
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and not isinstance(stream, VisibleStream):
            replaced[name] = VisibleStream(stream)
            setattr(sys, name, replaced[name])
    try:
        yield
    finally:
        for name, stream in replaced.items():
            if getattr(sys, name) is stream:
                setattr(sys, name, stream.unescaped)


# Whether there is time for one more piece of work before a deadline.


class TimeIsUpError(Exception):
    """The time limit has passed. It never leaves the package."""


class TimeLeft:
    """Tells before each piece of some work whether it fits: if it takes as long as the longest one so far.

    Parameters
    ----------
    until : float
        Deadline, as `clock` counts. Default: never.
    clock : callable
        Seconds.
    """

    def __init__(self, until: float = math.inf, clock: Callable[[], float] = time.time) -> None:
        self.until = until
        self._clock = clock
        self._last = math.nan
        self._longest = 0.0

    @property
    def seconds(self) -> float:
        """Seconds until the deadline, not negative."""
        return max(self.until - self._clock(), 0.0)

    def fits_another(self) -> bool:
        """Return whether one more piece fits; to be called before each piece."""
        if self.until == math.inf:
            return True
        now = self._clock()
        # the first call has no piece before it
        if now - self._last > self._longest:
            self._longest = now - self._last
        self._last = now
        return now + self._longest <= self.until

    def check(self) -> None:
        """Raise `TimeIsUpError` if the deadline has passed."""
        if self._clock() > self.until:
            raise TimeIsUpError


Progress = Callable[[int, int, str], None]


def report(progress: Progress | None, done: int, total: int, label: str) -> None:
    """Call the callable if there is one."""
    if progress is not None:
        progress(done, total, label)


def note(progress: Progress | None, text: str) -> None:
    """Show a line that stays, where progress is shown."""
    show = getattr(progress, "note", None)
    if show is not None:
        show(text)


def labelled(progress: Progress | None, label: str) -> Progress | None:
    """Return a callable that reports everything under one label."""
    return None if progress is None else lambda done, total, _: progress(done, total, label)


@contextmanager
def terminal_progress(
    stream: TextIO | None = None,
    *,
    quiet: bool = False,
    lines: bool = False,
    waiting: bool = False,
    most_silent_s: float | None = None,
    until: float = math.inf,
) -> Iterator[Progress | None]:
    """Show progress: a live bar per label on a terminal, otherwise one line per finished label.

    Parameters
    ----------
    stream : text file, optional
        Default: standard error, so that results on standard output can be piped.
    quiet : bool
        Show nothing.
    lines : bool
        Lines on a terminal, too: they stay when the work is done.
    waiting : bool
        Of few labels that take long: where there are lines, also say soon how far each is, and now and then.
    most_silent_s : float, optional
        With `waiting`, the longest time between two such lines, also between two labels. Default: ever longer times.
    until : float
        When a time limit ends the work, of `time.monotonic`: no estimate exceeds it. Default: never.
    """
    if quiet:
        with _compiling(None):
            yield None
        return
    stream = sys.stderr if stream is None else stream
    if stream.isatty() and not lines:
        with _bars(stream, until=until) as progress, _compiling(progress):
            yield progress
    else:
        line_stream = _LineStream(stream, until)
        with _compiling(line_stream):
            if not waiting:
                yield line_stream
                return
            with _Waiting(line_stream, all_told=True, most_silent_s=most_silent_s) as progress:
                yield progress


@contextmanager
def loading_shown(begun: float) -> Iterator[None]:
    """Show a line if the program takes long to load.

    Parameters
    ----------
    begun : float
        When the command began, of `time.monotonic`: the line is due that long after it.
    """
    with _Waiting(_LineStream(sys.stderr), all_told=False, begun=begun) as waiting:
        waiting(0, 1, "load the program")
        yield


@contextmanager
def reading_shown(
    *,
    quiet: bool = False,
    lines: bool = False,
    begun: float | None = None,
    most_silent_s: float | None = None,
) -> Iterator[None]:
    """Show what reading a part is busy with: bars on a terminal until it is read, otherwise lines.

    Parameters
    ----------
    begun : float, optional
        When the command began, of `time.monotonic`: the first line is due that long after it. Default: now.
    quiet : bool
        Show nothing.
    lines : bool
        Lines on standard error for everything, also on a terminal. Without them, lines only tell of what takes long.
    most_silent_s : float, optional
        As `terminal_progress` takes it.
    """
    if quiet:
        yield
        return
    # the package takes long to load, and commands that read no part do without it
    from aspectgraph.phases import phases_reported_to

    with (
        _passing(lines=lines, begun=begun, most_silent_s=most_silent_s) as progress,
        phases_reported_to(progress),
    ):
        yield


@contextmanager
def work_shown(*, quiet: bool = False, lines: bool = False) -> Iterator[Progress | None]:
    """Show what short work is busy with: bars on a terminal until it is done, otherwise lines of what takes long.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    lines : bool
        Lines on standard error for everything, also on a terminal.
    """
    if quiet:
        with _compiling(None):
            yield None
        return
    shown = _passing(lines=lines, most_silent_s=WATCHED_S, first_s=_FIRST_WORD_S)
    with shown as progress, _compiling(progress):
        yield progress


@contextmanager
def _passing(
    *,
    lines: bool,
    begun: float | None = None,
    most_silent_s: float | None = None,
    first_s: float | None = None,
) -> Iterator[Progress]:
    """Yield what shows bars on a terminal that do not stay, or else lines of what takes long; see `reading_shown`."""
    if sys.stderr.isatty() and not lines:
        with _bars(sys.stderr, transient=True) as bars:
            yield bars
        return
    stream = _LineStream(sys.stderr)
    waiting = _Waiting(
        stream, all_told=lines, begun=begun, most_silent_s=most_silent_s, first_s=first_s
    )
    with waiting as progress:
        yield progress


class _Waiting:
    """Tells in lines what takes long, while it is done: a call into a library reports nothing before it ends.

    Parameters
    ----------
    stream : _LineStream
        Where lines go.
    all_told : bool
        Also pass everything on to it.
    begun : float, optional
        Since when whoever waits has seen nothing, of `time.monotonic`. Default: now.
    most_silent_s : float, optional
        As `terminal_progress` takes it.
    first_s : float, optional
        When the first line of a stage is due. Default: soon where the time is limited, otherwise later.
    """

    def __init__(
        self,
        stream: _LineStream,
        *,
        all_told: bool,
        begun: float | None = None,
        most_silent_s: float | None = None,
        first_s: float | None = None,
    ) -> None:
        self._stream = stream
        self._most_silent_s = most_silent_s
        self._all_told = all_told
        self._state: tuple[int, int, str] | None = None
        self._since = time.monotonic() if begun is None else begun
        # another stage may have been silent before
        soon = _FIRST_WORD_S if most_silent_s is None else min(_FIRST_WATCHED_S, most_silent_s)
        self._first = soon if first_s is None else first_s
        self._pause = self._first
        self._next = self._since + self._pause
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._tell, daemon=True)

    def __enter__(self) -> _Waiting:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def __call__(self, done: int, total: int, label: str) -> None:
        if self._state is not None and label != self._state[2]:
            self._since = time.monotonic()
            # a stage is named soon after it begins, however long the one before was
            self._pause = self._first
            self._next = min(self._next, self._since + self._pause)
        self._state = (done, total, label)
        if self._all_told:
            self._stream(done, total, label)

    def note(self, text: str) -> None:
        self._next = max(self._next, time.monotonic() + self._pause)
        self._stream.note(text)

    def _tell(self) -> None:
        while not self._ended.wait(_FIRST_WORD_S / 10.0):
            state = self._state
            now = time.monotonic()
            is_steady = self._most_silent_s is not None
            if now < self._next or state is None or (state[0] >= state[1] and not is_steady):
                continue
            self._pause = self._most_silent_s or min(2.0 * self._pause, _MOST_SILENT_S)
            self._next = now + self._pause
            done, total, label = state
            if done >= total:
                label = f"after {label}"
            share = f": {done}/{total}" if total > 1 else ""
            try:
                self._stream.note(f"{label}{share} ({time.monotonic() - self._since:.0f} s so far)")
            except BrokenPipeError:
                # the next line of the command itself meets it, too
                return


@contextmanager
def _compiling(progress: Progress | None) -> Iterator[None]:
    """Show that loops are compiled, if they are."""
    try:
        from planner.compiling import ahead_told, compiling_told
    except (ImportError, AttributeError):
        # a numba that says nothing of what it compiles
        yield
        return
    with (
        compiling_told(
            lambda text: note(progress, text),
            lambda done, total: report(progress, done, total, LOOPS),
        ),
        ahead_told(
            lambda text: note(progress, text),
            lambda done, total: report(progress, done, total, AHEAD),
        ),
    ):
        yield


class Pace:
    """Tells about how long the rest of some work takes, from how long its first pieces took here and now.

    The first piece is not counted: a process is started for it, and loops may be compiled. Nothing is told of what is
    soon done, or already told; again only where it has turned out to take twice as long.

    Parameters
    ----------
    clock : callable
        Seconds.
    until : float
        When a time limit ends the work, as the clock counts. Default: never.
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, *, until: float = math.inf
    ) -> None:
        self._clock = clock
        self._until = until
        self._begun: dict[str, tuple[float, int]] = {}
        self._last: dict[str, int] = {}
        self._again: dict[str, float] = {}

    def __call__(self, done: int, total: int, label: str) -> str | None:
        """Return a line to be shown, or None."""
        if label in (LOOPS, AHEAD):
            return None
        now = self._clock()
        if done < self._last.get(label, 0):
            # the same work is done once more, after other work
            self._begun.pop(label, None)
        self._last[label] = done
        begun, first = self._begun.setdefault(label, (now, done))
        pieces = done - first
        seconds = now - begun
        few = pieces < max(_PIECES, _SHARE * total) or seconds < _SECONDS
        if done >= total or few or now < self._again.get(label, 0.0):
            return None
        remaining_s = seconds * (total - done) / pieces
        limit_s = self._until - now
        if min(remaining_s, limit_s) < _LONG_S:
            return None
        self._again[label] = now + 2.0 * remaining_s
        if remaining_s > limit_s:
            text = duration(limit_s, down=True)
            return f"{label}: at most {text} more, then the time limit ends it"
        suffix = ", or less" if label in _AT_MOST else ""
        text = duration(remaining_s, down=limit_s < math.inf)
        return f"{label}: about {text} more{suffix}, at the pace of the first {done} of {total}"


# a pace is told from so many pieces, such a share of them and so many seconds on, if so much more is to come
_PIECES = 3
_SHARE = 0.01
_SECONDS = 3.0
_LONG_S = 20.0
# reading a part tells after so long what it is at, in each stage, then after twice as long and so
# on, at least so often
_FIRST_WORD_S = 2.0
_MOST_SILENT_S = 30.0
# the same where the time is limited, which whoever set the limit watches; and before its first line
WATCHED_S = 2.0
_FIRST_WATCHED_S = 0.5
# what is done between other work, of which nobody knows how much there is: no pace is told of it
LOOPS = "compiling loops"
# what other processes do meanwhile
AHEAD = "compiling loops, once"
# between two lines about it
_AHEAD_S = 10.0
# what usually ends before its total
_AT_MOST = ("combining targets", "lower bound")


def duration(seconds: float, *, down: bool = False) -> str:
    """Return seconds for people, without digits that nobody knows: 40 s, 3 min, 2.5 h, 4 days.

    Parameters
    ----------
    seconds : float
        Finite, not negative.
    down : bool
        Round down, but to 10 s at least.
    """
    whole: Callable[[float], int] = math.floor if down else round
    if seconds < 90.0:
        return f"{max(10, 10 * whole(seconds / 10.0))} s"
    if seconds < 5400.0:
        return f"{whole(seconds / 60.0)} min"
    hours = seconds / 3600.0
    if hours < 10.0:
        return f"{whole(2.0 * hours) / 2.0:g} h"
    return f"{whole(hours)} h" if hours < 48.0 else f"{whole(hours / 24.0)} days"


@contextmanager
def _bars(
    stream: TextIO | None, *, transient: bool = False, until: float = math.inf
) -> Iterator[Progress]:
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as RichProgress
    from rich.text import Text

    class TimeToLimitColumn(TimeRemainingColumn):
        def render(self, task: Task) -> Text:
            limit_s = max(until - time.monotonic(), 0.0)
            if task.finished or (task.time_remaining or 0.0) <= limit_s:
                return super().render(task)
            minutes, seconds = divmod(int(limit_s), 60)
            return Text(f"{minutes // 60:d}:{minutes % 60:02d}:{seconds:02d}", "progress.remaining")

    # its colours are no text; the text is escaped before it comes here
    console_stream = None if stream is None else unescaped(stream)
    times = (TimeElapsedColumn(), TextColumn("left:"), TimeToLimitColumn())
    columns = (
        TextColumn("{task.description:<34}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        *times,
    )
    console = terminal_console(console_stream)
    # while bars are shown, rich has its own standard error, for which names are escaped, too
    with RichProgress(*columns, console=console, transient=transient) as bars, visible_output():
        yield _Bars(bars, until)


def terminal_console(stream: TextIO | None, **options: Any) -> Console:
    """Return a console of rich that raises when nobody reads any more, where rich's own ends the program with 1."""
    from rich.console import Console

    class Raising(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Raising(file=stream, **options)


class _Bars:
    """One live bar per label; lines that stay appear above them."""

    def __init__(self, bars: RichProgress, until: float = math.inf) -> None:
        self._bars = bars
        self._pace = Pace(until=until)
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, done: int, total: int, label: str) -> None:
        stated_total = None if label == LOOPS and done < total else total
        if label not in self._tasks:
            self._tasks[label] = self._bars.add_task(visible(label), total=stated_total)
        self._bars.update(self._tasks[label], completed=done, total=stated_total)
        if (line := self._pace(done, total, label)) is not None:
            self.note(line)

    def note(self, text: str) -> None:
        self._bars.console.print(visible(text), highlight=False, markup=False, emoji=False)


class _LineStream:
    """One line whenever all known work of a label is done, and about how long that takes: readable in a log."""

    def __init__(self, stream: TextIO | None, until: float = math.inf) -> None:
        self._stream = stream
        self._pace = Pace(until=until)
        self._started: dict[str, float] = {}
        self._finished: set[tuple[str, int]] = set()
        self._ahead_again = 0.0

    def __call__(self, done: int, total: int, label: str) -> None:
        if label == LOOPS:
            # a note says at the end how many there were
            return
        if label == AHEAD:
            self._show_ahead(done, total)
            return
        if label not in self._started:
            self._started[label] = time.monotonic()
        if (line := self._pace(done, total, label)) is not None:
            self.note(line)
        if done >= total and (label, total) not in self._finished:
            seconds = time.monotonic() - self._started[label]
            self._finished.add((label, total))
            self.note(f"{label}: {done}/{total} ({seconds:.1f} s)")

    def _show_ahead(self, done: int, total: int) -> None:
        now = time.monotonic()
        if done < total and now >= self._ahead_again:
            self._ahead_again = now + _AHEAD_S
            self.note(f"compiling {done} of {total} loops, once")

    def note(self, text: str) -> None:
        if self._stream is None:
            return
        try:
            print(visible(text), file=self._stream, flush=True)
        except BrokenPipeError:
            raise
        except OSError:
            # a full disk under a log is no reason to lose the work
            self._stream = None
