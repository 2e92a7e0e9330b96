"""Text for a terminal of any width: tables and sentences whose names are never broken.

A table is printed as it is where it fits. Otherwise its texts are wrapped between words. Where that
is not enough, the first column, which holds names, gets lines of its own; at last, each value does.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from planner.progress import visible

_GAP = "  "
_INDENT = "  "


class Column(NamedTuple):
    """A column of a table.

    Attributes
    ----------
    title : str
        Its heading.
    right : bool
        Whether its cells are aligned on the right, as numbers are.
    """

    title: str
    right: bool = False


class WholePieces(NamedTuple):
    """Text that may be broken between its pieces only.

    Attributes
    ----------
    pieces : tuple of str
        Words, or names that stay whole.
    separator : str
        What stands between two of them; at the end of a line its blanks are left out.
    """

    pieces: tuple[str, ...]
    separator: str = " "

    def __str__(self) -> str:
        return self.separator.join(self.pieces)


Cell = str | WholePieces


def listed(names: Iterable[str]) -> WholePieces:
    """Return a list of names that stay whole.

    Parameters
    ----------
    names : iterable of str
        The names.
    """
    return WholePieces(tuple(names), ", ")


def words(text: str, names: Iterable[str] = ()) -> WholePieces:
    """Return a sentence that may be broken between its words, but not in a name.

    Parameters
    ----------
    text : str
        The sentence.
    names : iterable of str
        Names that stay whole, blanks or not.
    """
    spaced = sorted((name for name in names if " " in name), key=len, reverse=True)
    either = "".join(f"(?:{re.escape(name)})\\S*|" for name in spaced)
    return WholePieces(tuple(re.findall(rf"{either}\S+", text)))


def terminal_width() -> int | None:
    """Return how many columns a line may have, by the variable COLUMNS or by the terminal.

    Returns
    -------
    int or None
        None: the output is no terminal, and lines may be as long as they are.
    """
    try:
        columns = int(os.environ.get("COLUMNS", "0"))
    except ValueError:
        columns = 0
    if columns > 0:
        return columns
    try:
        return os.get_terminal_size(sys.stdout.fileno()).columns or None
    except (OSError, ValueError, AttributeError):
        return None


def print_text(text: Cell, indent: str = "") -> None:
    """Print a sentence, broken between words.

    Parameters
    ----------
    text : str or WholePieces
        The sentence.
    indent : str
        Stands in front of all lines but the first.
    """
    pieces = words(text) if isinstance(text, str) else text
    width = terminal_width()
    lines = _wrapped(pieces, None if width is None else width - len(indent))
    print(f"\n{indent}".join(visible(line) for line in lines))


def print_table(columns: Sequence[Column], rows: Sequence[Sequence[Cell]]) -> None:
    """Print a table; nothing of one without rows.

    Parameters
    ----------
    columns : sequence of Column
        The first holds what names a row.
    rows : sequence of sequence of str or WholePieces
        A cell per column. A `str` is never broken.
    """
    if rows:
        print("\n".join(table_lines(columns, rows, terminal_width())))


def table_lines(
    columns: Sequence[Column], rows: Sequence[Sequence[Cell]], width: int | None
) -> list[str]:
    """Return the lines of a table.

    Parameters
    ----------
    columns, rows
        See `print_table`.
    width : int or None
        Columns of the terminal; None: no limit.

    Returns
    -------
    list of str
        Escaped for a terminal, without blanks at their ends. A line is longer than the width only
        where a single name is.
    """
    sizes = _sizes(columns, rows, width)
    if sizes is not None:
        return [
            *_heading(columns, sizes),
            *(line for row in rows for line in _lines(columns, row, sizes)),
        ]
    if len(columns) < 2:
        return [line for row in rows for line in _wrapped(row[0], width)]
    inner = None if width is None else width - len(_INDENT)
    rest = columns[1:]
    sizes = _sizes(rest, [row[1:] for row in rows], inner)
    lines = []
    if sizes is not None:
        lines = [visible(columns[0].title)]
        lines += [f"{_INDENT}{line}" for line in _heading(rest, sizes)]
    for row in rows:
        lines += [visible(line) for line in _wrapped(row[0], width) if line]
        if sizes is not None:
            lines += [f"{_INDENT}{line}" for line in _lines(rest, row[1:], sizes)]
            continue
        for column, cell in zip(rest, row[1:], strict=True):
            lines += _value_lines(column, cell, inner)
    return lines


def _value_lines(column: Column, cell: Cell, width: int | None) -> list[str]:
    """Return the lines of one value under its name: title and value."""
    if not str(cell):
        return []
    title = f"{column.title}: " if column.title else ""
    pieces = cell if isinstance(cell, WholePieces) else WholePieces((cell,))
    if width is None or _cells(title) + _least(pieces) <= width:
        lines = _wrapped(pieces, None if width is None else width - _cells(title))
        lines[1:] = [" " * _cells(title) + line for line in lines[1:]]
        lines[0] = title + lines[0]
    else:
        lines = _wrapped(words(title), width) if title else []
        lines += [_INDENT + line for line in _wrapped(pieces, width - len(_INDENT))]
    return [_INDENT + visible(line) for line in lines]


def _sizes(
    columns: Sequence[Column], rows: Sequence[Sequence[Cell]], width: int | None
) -> list[int] | None:
    """Return the width of each column; None if no wrapping makes them fit."""
    natural = []
    least = []
    for k, column in enumerate(columns):
        cells = [row[k] for row in rows]
        title = max(map(_cells, column.title.split()), default=0)
        natural.append(max(_cells(column.title), *map(_natural, cells)))
        least.append(max(title, *map(_least, cells)))
    if width is None:
        return natural
    free = width - len(_GAP) * (len(columns) - 1) - sum(least)
    if free < 0:
        return None
    sizes = list(least)
    # what is nearest to its own width gets it first, so that as few cells as possible are wrapped
    for k in sorted(range(len(columns)), key=lambda k: natural[k] - least[k]):
        more = min(natural[k] - least[k], free)
        sizes[k] += more
        free -= more
    return sizes


def _heading(columns: Sequence[Column], sizes: Sequence[int]) -> list[str]:
    if not any(column.title for column in columns):
        return []
    titles = _lines(columns, [words(column.title) for column in columns], sizes)
    rule = "-" * (sum(sizes) + len(_GAP) * (len(sizes) - 1))
    return [*titles, rule]


def _lines(columns: Sequence[Column], row: Sequence[Cell], sizes: Sequence[int]) -> list[str]:
    """Return the lines of one row."""
    cells = [_wrapped(cell, size) for cell, size in zip(row, sizes, strict=True)]
    lines = []
    for k in range(max(map(len, cells))):
        texts = []
        for column, lines_of_cell, size in zip(columns, cells, sizes, strict=True):
            text = visible(lines_of_cell[k]) if k < len(lines_of_cell) else ""
            blanks = " " * (size - _cells(text))
            texts.append(blanks + text if column.right else text + blanks)
        lines.append(_GAP.join(texts).rstrip())
    return lines


def _wrapped(cell: Cell, width: int | None) -> list[str]:
    """Return the lines of a cell, none longer than the width but for a piece that is."""
    if isinstance(cell, str):
        return [cell]
    if width is None:
        return [str(cell)]
    lines = [""]
    last = len(cell.pieces) - 1
    for k, piece in enumerate(cell.pieces):
        # a comma stays on the line of its name
        whole = piece + (cell.separator.rstrip() if k < last else "")
        if k == 0:
            lines = [whole]
        elif _cells(lines[-1]) + 1 + _cells(whole) <= width:
            lines[-1] += f" {whole}"
        else:
            lines.append(whole)
    return lines


def _natural(cell: Cell) -> int:
    return _cells(str(cell))


def _least(cell: Cell) -> int:
    """Return the width of a cell that is broken wherever it may be."""
    if isinstance(cell, str):
        return _cells(cell)
    mark = len(cell.separator.rstrip())
    return max((_cells(piece) + mark for piece in cell.pieces), default=0)


def _cells(text: str) -> int:
    """Return how many columns a text takes: a Chinese character takes two."""
    text = visible(text)
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)
