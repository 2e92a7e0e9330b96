"""Tables for every reader, and sentences for a terminal of any width; names are never broken there.

On a terminal a table is printed as it is where it fits. Otherwise its texts are wrapped between words. Where that
is not enough, the first column, which holds names, gets lines of its own; at last, each value does.
"""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from ground.short_repr import count as count
from ground.templates import render_macro
from planner.progress import visible

if TYPE_CHECKING:
    from markupsafe import Markup


_GAP = "  "
_INDENT = "  "
_MOST_DECIMALS = 6


@dataclass(frozen=True)
class Column:
    """A column of a table: what its values are, and how they are shown.

    Attributes
    ----------
    title : str
        Its name: the key of a value in records and CSV.
    right : bool
        Whether its cells are aligned on the right, as numbers are.
    unit : str
        Stands in brackets behind the title of a shown column.
    spec : str
        Format of its numbers, such as ``".3f"``.
    kind : str
        What a page makes of its values: a macro of ``table.html``.
    ceiling : float
        Rounding for CSV goes no higher, such as 0.999999 for a probability: no model proves certainty.
    """

    title: str
    right: bool = False
    unit: str = ""
    spec: str = ""
    kind: str = "text"
    ceiling: float = math.inf

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def cell(self, value: Any) -> Cell:
        """Return a value as text: numbers in their format, those of a vector next to each other."""
        if value is None:
            return ""
        if isinstance(value, str | WholePieces):
            return value
        if isinstance(value, Iterable):
            return " ".join(format(number, self.spec) for number in value)
        return format(value, self.spec)

    def rounded(self, value: Any) -> Any:
        """Return a float with the digits of the format; other values as they are."""
        if not self.spec or not isinstance(value, float):
            return value
        return min(float(format(value, self.spec)), self.ceiling)


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


def data_frame(rows: list[dict[str, Any]]) -> Any:
    """Return rows as a data frame of pandas.

    Parameters
    ----------
    rows : list of dict
        Values by column.

    Returns
    -------
    pandas.DataFrame
        A row for each.

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise ImportError(
            "to_dataframe() needs pandas. Install it with: pip install pandas; "
            "rows() and to_csv() need nothing."
        ) from None
    return pandas.DataFrame(rows)


def share_text(share: float, limit: float) -> str:
    """Return a share in %, with a digit more where it is below a limit and would read the same.

    Parameters
    ----------
    share, limit : float
        Shares of 1.

    Examples
    --------
    >>> share_text(0.797, 0.8), share_text(0.53, 0.8)
    ('79.7', '53')
    """
    short = f"{100 * share:.0f}"
    is_same = share < limit and short == f"{100 * limit:.0f}"
    # rounded down, it stays below
    return f"{math.floor(1000 * share + 1e-9) / 10:.1f}" if is_same else short


def digits_text(value: float, digits: int) -> str:
    """Return a number with so many significant digits as a person writes it, without an exponent.

    Parameters
    ----------
    value : float
        The number.
    digits : int
        Significant digits; no more than six decimals are written.

    Examples
    --------
    >>> digits_text(0.0000321, 3), digits_text(1234.5, 3), digits_text(3e-9, 2)
    ('0.000032', '1234', '< 0.000001')
    """
    if 0 < abs(value) < 0.5 * 10.0**-_MOST_DECIMALS:
        return f"< {10.0**-_MOST_DECIMALS:.{_MOST_DECIMALS}f}"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    if abs(value) >= 1:
        return f"{value:.0f}"
    return f"{float(text):.{_MOST_DECIMALS}f}".rstrip("0")


def enumerated(names: Sequence[str]) -> str:
    """Return names as a list in a sentence, with "and" before the last one."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


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


def print_table(columns: Sequence[Column], rows: Sequence[Sequence[Any]]) -> None:
    """Print a table; nothing of one without rows.

    Parameters
    ----------
    columns, rows
        See `Table`.
    """
    if rows:
        print("\n".join(Table(columns, rows).lines(terminal_width())))


@dataclass(frozen=True)
class Table:
    """A table, for a terminal, a page, a spreadsheet or another program.

    Attributes
    ----------
    columns : sequence of Column
        The first holds what names a row.
    rows : sequence of sequence
        A value per column. A `str` is never broken.
    name, style : str
        Identifier and class in a page.
    below : mapping of int to str
        In a page, what is said below a row, by its number from 0.
    notes : sequence of str
        In a page, what is said below the table.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]
    name: str = ""
    style: str = ""
    below: Mapping[int, str] = field(default_factory=dict)
    notes: Sequence[str] = ()

    def records(self) -> list[dict[str, Any]]:
        """Return its values by title, a mapping per row: for JSON and data frames."""
        titles = [column.title for column in self.columns]
        return [dict(zip(titles, row, strict=True)) for row in self.rows]

    def csv(self) -> str:
        """Return its values as CSV with a heading (RFC 4180); floats have the digits of their column's format."""
        from aspectgraph.entities.entity_rules import table_text

        rows = [list(map(Column.rounded, self.columns, row)) for row in self.rows]
        return table_text([column.heading for column in self.columns], rows)

    def html(self) -> Markup:
        """Return it as a part of a page."""
        return render_macro("planner", "table.html", "draw", self)

    def lines(self, width: int | None) -> list[str]:
        """Return its lines on a terminal.

        Parameters
        ----------
        width : int or None
            Columns of the terminal; None: no limit.

        Returns
        -------
        list of str
            Escaped for a terminal, without blanks at their ends. A line is longer than the width
            only where a single name is.
        """
        columns = self.columns
        rows = [[c.cell(value) for c, value in zip(columns, row, strict=True)] for row in self.rows]
        sizes = _sizes(columns, rows, width)
        if sizes is not None:
            return [
                *_heading(columns, sizes),
                *(line for row in rows for line in _lines(columns, row, sizes)),
            ]
        if len(columns) < 2:
            return [line for row in rows for line in _wrapped(row[0], width)]
        return _named_lines(columns, rows, None if width is None else width - len(_INDENT))


def _named_lines(
    columns: Sequence[Column], rows: Sequence[Sequence[Cell]], width: int | None
) -> list[str]:
    """Return a table whose first column has lines of its own, with so much room beside an indent."""
    values = columns[1:]
    sizes = _sizes(values, [row[1:] for row in rows], width)
    lines = []
    if sizes is not None:
        lines = [visible(columns[0].heading)]
        lines += [f"{_INDENT}{line}" for line in _heading(values, sizes)]
    for row in rows:
        name_width = None if width is None else width + len(_INDENT)
        lines += [visible(line) for line in _wrapped(row[0], name_width) if line]
        if sizes is not None:
            lines += [f"{_INDENT}{line}" for line in _lines(values, row[1:], sizes)]
            continue
        for column, cell in zip(values, row[1:], strict=True):
            lines += _value_lines(column, cell, width)
    return lines


def _value_lines(column: Column, cell: Cell, width: int | None) -> list[str]:
    """Return the lines of one value under its name: title and value."""
    if not str(cell):
        return []
    title = f"{column.heading}: " if column.title else ""
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
    narrowest = []
    for k, column in enumerate(columns):
        cells = [row[k] for row in rows]
        title = max(map(_cells, column.heading.split()), default=0)
        natural.append(max([_cells(column.heading), *map(_natural, cells)]))
        narrowest.append(max([title, *map(_least, cells)]))
    if width is None:
        return natural
    free = width - len(_GAP) * (len(columns) - 1) - sum(narrowest)
    if free < 0:
        return None
    sizes = list(narrowest)
    # what is nearest to its own width gets it first, so that as few cells as possible are wrapped
    for k in sorted(range(len(columns)), key=lambda k: natural[k] - narrowest[k]):
        more = min(natural[k] - narrowest[k], free)
        sizes[k] += more
        free -= more
    return sizes


def _heading(columns: Sequence[Column], sizes: Sequence[int]) -> list[str]:
    if not any(column.title for column in columns):
        return []
    titles = _lines(columns, [words(column.heading) for column in columns], sizes)
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
