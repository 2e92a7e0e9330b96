"""Tables of comma-separated values that a spreadsheet shows and does not run.

Excel, LibreOffice and Google Sheets take text that begins with ``=``, ``+``, ``-`` or ``@`` for a
formula, and tabs and line breaks for the border of a cell. So such text gets an apostrophe in front,
which Excel and OWASP advise. Numbers stay as they are. `text_of_cell` takes the apostrophe away.
Control characters, which a terminal obeys, are shown as Python writes them. All tables are written here.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

# full-width signs start formulas where Excel runs in Japanese; blanks before a sign are no shelter
_FORMULA = re.compile(r"[\s']*?[=+\-@\t\r\n\0\uff1d\uff0b\uff0d\uff20]")
# C0 but for tab and line ends, DEL, C1; signs that turn the direction; halves of characters
_CONTROL = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


class NumberText(str):
    """A number that is written out already, such as with a number of decimals; a table takes it as it is."""

    __slots__ = ()


def cell_of_text(text: str) -> str:
    """Return a text as a cell that no spreadsheet takes for a formula.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        With an apostrophe in front if a formula could begin so, otherwise the text itself.

    Examples
    --------
    >>> cell_of_text("=1+1"), cell_of_text("bore"), cell_of_text("it's")
    ("'=1+1", 'bore', "it's")
    """
    return f"'{text}" if _FORMULA.match(text) else text


def text_of_cell(cell: str) -> str:
    """Return the text that `cell_of_text` made a cell of.

    Parameters
    ----------
    cell : str
        The cell.

    Returns
    -------
    str
        Without the apostrophe in front if a formula could begin behind it.

    Examples
    --------
    >>> text_of_cell("'=1+1"), text_of_cell("'bore'")
    ('=1+1', "'bore'")
    """
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    r"""Return a table as comma-separated values with a heading, as RFC 4180 defines them.

    Parameters
    ----------
    columns : sequence of str
        Keys of the rows.
    rows : iterable of mapping
        Values as `table_text` takes them.

    Returns
    -------
    str
        Lines end with ``\r\n``, so that a cell with a line break of any kind is quoted.
    """
    return table_text(columns, ([row[column] for column in columns] for row in rows))


def table_text(
    heading: Sequence[str],
    rows: Iterable[Sequence[Any]],
    head: Sequence[str] = (),
    line_end: str = "\r\n",
) -> str:
    """Return rows of values as comma-separated values; names of columns may come twice.

    Parameters
    ----------
    heading : sequence of str
        Names of the columns.
    rows : iterable of sequence
        Text is written by `cell_of_text`, with control characters shown; numbers without loss,
        None as nothing.
    head : sequence of str, optional
        Lines of a comment before the heading; each gets ``# `` in front.
    line_end : str, optional
        What ends a line.

    Returns
    -------
    str
        As `csv_text` returns it.
    """
    text = io.StringIO()
    for line in head:
        text.write(f"# {_without_control(' '.join(line.split()))}{line_end}")
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerow(map(_cell, heading))
    writer.writerows(map(_cell, row) for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, NumberText) or not isinstance(value, str):
        return value
    return _without_control(cell_of_text(value))


def _without_control(text: str) -> str:
    return _CONTROL.sub(_shown, text)


def _shown(character: re.Match[str]) -> str:
    code = ord(character[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
