"""Tables of comma-separated values that a spreadsheet shows and does not run.

Excel, LibreOffice and Google Sheets take text that begins with ``=``, ``+``, ``-`` or ``@`` for a
formula, and tabs and line breaks for the border of a cell. So such text gets an apostrophe in front,
which Excel and OWASP advise. Numbers stay as they are. `text_of_cell` takes the apostrophe away.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

# full-width signs start formulas where Excel runs in Japanese; blanks before a sign are no shelter
_FORMULA = re.compile(r"[\s']*?[=+\-@\t\r\n\0\uff1d\uff0b\uff0d\uff20]")


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
        Text is written by `cell_of_text`; numbers without loss, None as nothing.

    Returns
    -------
    str
        Lines end with ``\r\n``, so that a cell with a line break of any kind is quoted.
    """
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow([cell_of_text(column) for column in columns])
    for row in rows:
        values = (row[column] for column in columns)
        writer.writerow([cell_of_text(v) if isinstance(v, str) else v for v in values])
    return text.getvalue()
