"""The console that results are printed to, and its tables."""

from __future__ import annotations

import shutil
import sys
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from planner.progress.terminal_text import unescaped, visible

if TYPE_CHECKING:
    from rich.console import JustifyMethod


def new_console() -> Console:
    """Return a console that does not squeeze tables when the output is not a terminal, and never guesses at markup."""
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else 160
    stream = unescaped(sys.stdout)
    return _VisibleConsole(
        file=stream, width=width, markup=False, emoji=False, highlight=False, soft_wrap=False
    )


class _VisibleConsole(Console):
    """A console all of whose text, in cells and lines, is escaped; only its own colours are not."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(visible(text), **options)

    def on_broken_pipe(self) -> None:
        """Raise when nobody reads any more, where rich's own console ends the program with 1."""
        raise BrokenPipeError


def new_table(*columns: tuple[str, JustifyMethod]) -> Table:
    """Return a table with these columns, each with its title and its side."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title, justify in columns:
        table.add_column(title, justify=justify, overflow="fold")
    return table
